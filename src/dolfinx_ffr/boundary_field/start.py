# SPDX-License-Identifier: MIT
"""The first field of a part that a level set or densities have drawn.

What is thinner than the minimum member is widened before the fit, as splines would lose it. Slits,
fingers and corners that splines cannot show are left out, and all slits along what stays solid.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

import numpy as np
import shapely

from .. import validation
from ..arrays import Array
from ..design import Mirror
from ..part import Part, PartWarning
from .field import BoundaryField, FieldSpace, spread
from .options import FieldOptions
from .sizes import SizeRows, opposite
from .smoothing import mended, redistanced


def space_of(
    part: Part,
    sizes: Mapping[str, float | None],
    outline: bool,
    mirrors: Sequence[Mirror],
    options: FieldOptions,
) -> FieldSpace:
    """The fields of a part with ``sizes``, all of which are checked as `PlaneBoundary.of` says."""
    validation.instance("boundary: part", part, Part, "a Part, of a body in the plane")
    member = validation.number("boundary: member", sizes["member"], above=0.0, unit="m")
    given = {name: member if sizes[name] is None else sizes[name] for name in ("gap", "rim")}
    gap = validation.number("boundary: gap", given["gap"], above=0.0, unit="m")
    rim = validation.number("boundary: rim", given["rim"], least=0.0, unit="m")
    radius = 0.5 * gap if sizes["radius"] is None else sizes["radius"]
    radius = validation.number("boundary: radius", radius, least=0.0, unit="m")
    volume = validation.number("boundary: volume", sizes["volume"], above=0.0, most=1.0)
    validation.flag("boundary: outline", outline)
    lines = validation.instances("boundary: mirrors", mirrors, Mirror, "lines of symmetry")
    for line in lines:
        if len(line.normal) != 2:
            raise ValueError(f"boundary: {line} is a plane; give lines, of two components")
    if (part.pieces != 1 and not part.web) or part.lost_interfaces:
        raise ValueError(
            f"boundary: the part has {part.pieces} pieces and has lost the interfaces "
            f"{part.lost_interfaces}; take a design in one piece that all interfaces hold"
        )
    if part.body.outline.buffer(-0.5 * member).is_empty:
        raise ValueError(
            f"boundary: minimum members of {1e3 * member:.4g} mm do not fit into the body; "
            "give smaller ones"
        )
    space = FieldSpace.of(
        part.body,
        member,
        gap,
        radius=radius,
        volume=(volume - part.web) / (1.0 - part.web),
        rim=rim,
        outline=outline and not part.web,
        web=part.web,
        mirrors=lines,
        material=part.material,
        options=options,
    )
    _check_mirrors(space, part)
    return space


def check_start(boundary: BoundaryField, part: Part) -> None:
    """Refuse a first field of a part that cannot move, and warn of holes that it has lost."""
    if not np.any(boundary.edge.moves):
        raise ValueError(
            "boundary: interfaces, solid regions and the holes of the body's drawing leave no "
            "side that could move"
        )
    holes = [shapely.Polygon(ring) for piece in part.polygon.geoms for ring in piece.interiors]
    lost = [hole for hole in holes if boundary.material.covers(hole)]
    if lost:
        named = ", ".join(map(_place, lost[:3]))
        warnings.warn(
            f"boundary: holes of the design near {named} are left out, as they are too small for "
            f"gaps of {1e3 * boundary.space.gap:.3g} mm; give smaller sizes or a finer design to "
            "keep them",
            PartWarning,
            stacklevel=3,
        )


def _check_mirrors(space: FieldSpace, part: Part) -> None:
    """Refuse a part that is not its own mirror image, to two minimum members."""
    near = 2.0 * space.member
    for image in space.isometries[1:]:
        mirrored = shapely.transform(part.polygon, image)
        apart = shapely.union(
            part.polygon.buffer(-near).difference(mirrored),
            mirrored.buffer(-near).difference(part.polygon),
        )
        if not apart.is_empty:
            raise ValueError(
                f"boundary: the part has no mirror image near {_place(apart)} to "
                f"{1e3 * near:.3g} mm; take a design with these mirrors, or leave them out"
            )


def _place(shape: shapely.Geometry) -> str:
    """A point of a shape in words."""
    x, y = 1e3 * np.array(shape.representative_point().coords[0])
    return f"({x:.4g}, {y:.4g}) mm"


def field_with_sizes(space: FieldSpace, material: shapely.Geometry) -> BoundaryField:
    """The field whose zero is the free boundary of a ``material``, as near as sizes allow."""
    for _ in range(2):
        field = redistanced(space.of_material(_with_sizes(space, material)))
        for _ in range(space.options.mending):
            field = mended(field, space.options.longest_reach * space.member)
        if SizeRows.of(field).violation <= space.options.at_once:
            break
        # where a member and a gap are too narrow side by side one of both goes in the next round
        material = field.material
    return field


def _with_sizes(space: FieldSpace, material: shapely.Geometry) -> shapely.Geometry:
    """A ``material`` with minimum sizes nearly everywhere, in one piece where it was in one."""
    body, share = space.body.outline, 0.5 * space.options.opened
    # material grows beside what stays solid only where there is some
    skin = space.solid.buffer(space.options.skin * space.member).intersection(body)
    stays = shapely.union_all([space.solid, skin, space.strip])
    whole = shapely.union_all([material, stays, _widening(space, material)])
    slits = shapely.get_parts(_closed(whole, 0.5 * space.gap).difference(whole))
    beside = slits[shapely.dwithin(slits, space.solid, 1e-3 * space.gap)]
    closed = shapely.union_all([_closed(whole, share * space.gap), *beside]).intersection(body)
    opened = closed.buffer(-share * space.member).buffer(share * space.member)
    # corners as round as splines can show
    round_ = max(space.options.spare * space.radius, space.grid.spacing)
    void = _rounded(body.difference(shapely.union(opened, stays)), round_)
    return shapely.union(_rounded(body.difference(void), round_), stays)


def _closed(shape: shapely.Geometry, radius: float) -> shapely.Geometry:
    """A shape with what discs of a ``radius`` beside it do not reach."""
    return shape.buffer(radius).buffer(-radius)


def _rounded(shape: shapely.Geometry, radius: float) -> shapely.Geometry:
    """A shape without its corners; what is too narrow for the ``radius`` is no corner and stays."""
    opened = shape.buffer(-radius).buffer(radius)
    left = shapely.get_parts(shape.difference(opened))
    return shapely.union_all([opened, *left[shapely.area(left) > radius**2]])


def _widening(space: FieldSpace, material: shapely.Geometry) -> shapely.Geometry:
    """Discs of the minimum member along the middle of what is thinner, within the body."""
    least = space.options.spare * space.member
    points, normals = _boundary(material, space.options.sample * space.member)
    first, second, width = opposite(points, normals, -1.0, least, space.options)
    middles = 0.5 * (points[first] + points[second])
    middles = middles[(width < least) & ~shapely.contains_xy(space.solid, *middles.T)]
    if not len(middles):
        return shapely.MultiPolygon()
    room = space.body.outline.buffer(-0.5 * least)
    if not room.is_empty:
        # along the outline a member becomes wider to the inside
        lines = shapely.shortest_line(shapely.points(middles), room)
        inside = shapely.get_coordinates(lines)[1::2]
        near = np.linalg.norm(inside - middles, axis=1) < 0.5 * least
        middles = np.where(near[:, None], inside, middles)
    discs = shapely.buffer(shapely.points(middles), 0.5 * least)
    return shapely.union_all(discs)


def _boundary(shape: shapely.Geometry, step: float) -> tuple[Array, Array]:
    """Points about a ``step`` apart on the boundary of a shape, and its outward normals there."""
    rings = [
        shapely.get_coordinates(ring)[:-1]
        for piece in shapely.get_parts(shape)
        for oriented in [shapely.geometry.polygon.orient(piece)]
        for ring in (oriented.exterior, *oriented.interiors)
    ]
    points, normals, _ = zip(*(spread(ring, step) for ring in rings), strict=True)
    return np.concatenate(points), np.concatenate(normals)
