# SPDX-License-Identifier: MIT
"""Changes of a part's topology: the material of a field united with shapes, or cut by them.

A shape comes with its mirror images. Which shapes are worth a trial follows from what members
carry, and from the topological derivatives of members that are missing and of holes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ..arrays import Array, Integers
from ..reduction import Struts
from .field import AnyField, BoundaryField, FieldSpace
from .smoothing import mended, redistanced


def united(field: AnyField, shape: shapely.Geometry) -> AnyField:
    """The field whose material is that of ``field`` and a ``shape`` [m]."""
    return refitted(field, np.maximum(_values(field), _inside(field.space, shape)))


def cut(field: AnyField, shape: shapely.Geometry) -> AnyField:
    """The field whose material is that of ``field`` without a ``shape`` [m]."""
    return refitted(field, np.minimum(_values(field), -_inside(field.space, shape)))


def _values(field: BoundaryField) -> Array:
    far = field.space.options.cut_off * field.space.grid.spacing
    return np.asarray(np.clip(field.space.raster_rows @ field.variables, -far, far))


def _inside(space: FieldSpace, shape: shapely.Geometry) -> Array:
    """The signed distance from the edge of a shape, positive inside, at the raster [m]."""
    far = space.options.cut_off * space.grid.spacing
    values = np.full(len(space.raster), -far)
    left, low, right, high = shape.buffer(far).bounds
    x, y = space.raster.T
    near = np.flatnonzero((x > left) & (x < right) & (y > low) & (y < high))
    points = shapely.points(space.raster[near])
    shapely.prepare(shape)
    sign = np.where(shapely.contains(shape, points), 1.0, -1.0)
    values[near] = np.clip(sign * shapely.distance(shape.boundary, points), -far, far)
    return values


def refitted(field: AnyField, values: Array) -> AnyField:
    """The field nearest to ``values`` (n,) at the raster [m], with minimum sizes."""
    changed = redistanced(field.with_variables(field.space.fitted(values).variables))
    for _ in range(field.space.options.mending):
        changed = mended(changed, field.space.member)
    return changed


def with_images(space: FieldSpace, shape: shapely.Geometry) -> shapely.Geometry:
    """A shape and all of its mirror images."""
    return shapely.union_all([shapely.transform(shape, image) for image in space.isometries])


def small_voids(field: BoundaryField) -> shapely.Geometry | None:
    """All holes that are so small that they may be worth nothing; None if there are none."""
    space, options = field.space, field.space.options
    largest = options.small_void * space.member**2
    holes = [shapely.Polygon(ring) for ring in field.holes]
    drawn = shapely.MultiPolygon(space.drawn_holes)
    small = [hole for hole in holes if hole.area < largest and not hole.intersects(drawn)]
    return shapely.union_all(small).buffer(space.grid.spacing) if small else None


def thin_members(field: BoundaryField) -> list[shapely.Geometry]:
    """The members between wider material, each with its mirror images."""
    space, options = field.space, field.space.options
    material = field.material
    radius = options.opened * space.member
    wide = material.buffer(-radius).buffer(1.01 * radius)
    pieces = shapely.get_parts(material.difference(wide).intersection(space.designed))
    pieces = [piece for piece in pieces if piece.area > 0.5 * space.member**2]
    members: list[shapely.Geometry] = []
    for piece in pieces:
        place = piece.representative_point()
        if not any(member.contains(place) for member in members):
            members.append(with_images(space, piece).buffer(0.2 * space.member))
    return members


def most_idle(field: BoundaryField, struts: Struts) -> shapely.Geometry | None:
    """The thin member that carries least, if that is next to nothing; None otherwise; collective.

    What cells carry are shares of psi.
    """
    carried = struts.domain.everywhere(struts.carried)
    x, y = struts.domain.everywhere(struts.domain.centroids)[:, :2].T
    least, idle = field.space.options.idle, None
    for member in thin_members(field):
        shapely.prepare(member)
        share = float(np.sum(carried[shapely.contains_xy(member, x, y)]))
        if share < least:
            least, idle = share, member
    return None if idle is None else with_its_ends(field, idle)


def with_its_ends(field: BoundaryField, members: shapely.Geometry) -> shapely.Geometry:
    """Thin members and what would be left of them as noses: voids that they part become convex."""
    near = field.space.options.noses * field.space.member
    shapes = []
    for member in shapely.get_parts(members):
        around = member.buffer(near)
        voids = shapely.get_parts(around.difference(field.material))
        beside = voids[shapely.intersects(voids, member)]
        shapes.append(shapely.union_all([member, *beside]).convex_hull.intersection(around))
    return shapely.union_all([members, *shapes])


def best_hole(field: BoundaryField, struts: Struts) -> shapely.Geometry | None:
    """The round hole that promises most, with members around it; None if none is worth a trial.

    What it changes is the sum of the topological derivatives of its cells; collective.
    """
    space, domain = field.space, struts.domain
    change = domain.everywhere(struts.removed)
    places = domain.everywhere(domain.centroids)[:, :2]
    free = space.designed.intersection(field.material)
    room = shapely.distance(free.boundary, shapely.points(places)) - space.member
    room[~shapely.contains_xy(free, *places.T)] = -1.0
    tree, radius = cKDTree(places), max(space.gap, space.member)
    promised, best = space.options.promised, None
    while np.any(fits := room >= radius):
        gains = [-np.sum(change[near]) for near in tree.query_ball_point(places[fits], radius)]
        if max(gains) > promised:
            promised = max(gains)
            best = shapely.Point(places[fits][np.argmax(gains)]).buffer(radius)
        radius *= np.sqrt(2.0)
    return None if best is None else with_images(space, best)


def missing_members(field: BoundaryField, struts: Struts) -> Iterator[shapely.Geometry]:
    """Straight members across holes that are worth a trial, those first that promise most.

    Of those near each other only the best one is tried.
    """
    space, options = field.space, field.space.options
    points, ends = _across_holes(field)
    if not len(ends):
        return
    gains = -struts.changes(points, ends, space.member)
    taken: list[shapely.Geometry] = []
    for k in np.argsort(-gains, kind="stable"):
        if gains[k] < options.promised or len(taken) == options.members_tried:
            return
        line = shapely.LineString(points[ends[k]])
        near = [o.distance(line) < 0.5 * min(o.geoms[0].length, line.length) for o in taken]
        if any(near):
            continue
        taken.append(
            shapely.MultiLineString([image(points[ends[k]]) for image in space.isometries])
        )
        yield _bar(field, line)


def _bar(field: BoundaryField, line: shapely.LineString) -> shapely.Geometry:
    """The member along a line and its mirror images, with rounded corners beside their ends."""
    space, options = field.space, field.space.options
    bar = with_images(space, line.buffer(0.5 * options.bar * space.member))
    # so few sizes are to be mended
    round_ = max(1.5 * space.radius, 0.5 * space.gap)
    whole = field.material.union(bar).buffer(round_).buffer(-round_)
    return whole.intersection(bar.buffer(4.0 * round_))


def _across_holes(field: BoundaryField) -> tuple[Array, Integers]:
    """Points around holes, and pairs of them that face each other with nothing between."""
    member, edge = field.space.member, field.edge
    step = max(1, int(1.5 / field.space.options.sample))
    points, pairs, count = [], [], 0
    for ring in field.holes:
        near = shapely.Polygon(ring).buffer(0.1 * member)
        shapely.prepare(near)
        on = np.flatnonzero(shapely.contains_xy(near, *edge.points.T))[::step]
        x, normals = edge.points[on], edge.normals[on]
        i, j = np.triu_indices(len(x), 1)
        way = x[j] - x[i]
        length = np.linalg.norm(way, axis=1)
        facing = np.einsum("ij,ij->i", way, normals[i]) > 0.3 * length
        facing &= np.einsum("ij,ij->i", way, normals[j]) < -0.3 * length
        facing &= length > 3.0 * member
        i, j = i[facing], j[facing]
        clear = shapely.covers(near, shapely.linestrings(np.stack([x[i], x[j]], axis=1)))
        pairs.append(np.column_stack([i[clear], j[clear]]) + count)
        points.append(x)
        count += len(x)
    if not points:
        return np.zeros((0, 2)), np.zeros((0, 2), dtype=np.int64)
    return np.vstack(points), np.vstack(pairs)
