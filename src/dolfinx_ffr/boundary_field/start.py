# SPDX-License-Identifier: MIT
"""The first field of a part that a level set or densities have drawn.

What is thinner than the minimum member is widened before the fit, as splines would lose it. Slits,
fingers and corners that splines cannot show are left out, and all slits along what stays solid.
"""

from __future__ import annotations

import numpy as np
import shapely

from ..arrays import Array
from .field import FieldSpace, spread
from .plane import PlaneBoundary
from .sizes import opposite
from .smoothing import mended, redistanced

#: Rounds in which the sizes of the first field are mended
_ROUNDS = 3


def first_field(space: FieldSpace, material: shapely.Geometry) -> PlaneBoundary:
    """The field whose zero is the free boundary of a ``material``, as near as sizes allow."""
    field = redistanced(PlaneBoundary.of_material(space, _with_sizes(space, material)))
    for _ in range(_ROUNDS):
        field = mended(field, space.options.longest_reach * space.member)
    return field


def _with_sizes(space: FieldSpace, material: shapely.Geometry) -> shapely.Geometry:
    """A ``material`` with minimum sizes nearly everywhere, in one piece where it was in one."""
    body, share = space.body.outline, 0.5 * space.options.opened
    whole = shapely.union_all([material, space.solid, _widening(space, material)])
    slits = shapely.get_parts(_closed(whole, 0.5 * space.gap).difference(whole))
    beside = slits[shapely.dwithin(slits, space.solid, 1e-3 * space.gap)]
    closed = shapely.union_all([_closed(whole, share * space.gap), *beside]).intersection(body)
    opened = closed.buffer(-share * space.member).buffer(share * space.member)
    # corners as round as splines can show
    round_ = max(space.options.spare * space.radius, space.grid.spacing)
    void = _rounded(body.difference(shapely.union(opened, space.solid)), round_)
    return shapely.union(_rounded(body.difference(void), round_), space.solid)


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
