# SPDX-License-Identifier: MIT
"""Thinnest member and narrowest gap of a shape, by discs that do not fit.

A member thinner than d is one of two things.

* A *neck*: the centres of the discs of diameter d that fit into the shape (its erosion) hang
  together otherwise than the shape does: a piece is split in two or gone, or a frame is opened.
* A *finger*, which ends freely: a connected part that is not reached by the discs that fit (what
  the opening leaves out), longer than d and on average wider than 0.7 d. What discs leave out at
  corners is none: above 39 degrees it is shorter than d, below it is half as wide as d on average.

The thinnest member is the smallest d at which there is one, the narrowest gap the thinnest member
of what is not material: a milling cutter up to this diameter reaches all but inner corners.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from ..arrays import Array

#: Relative accuracy of a width
ACCURACY = 2e-3
#: Ratio of the diameters among which the first one is looked for; a finger is seen up to 1 / 0.7
#: times its width
_RATIO = 1.3
#: Sides of a quarter of the discs
_SIDES = 24
#: Length of the ray on which the point of a width that is opposite to the nearest one is looked
#: for, and the largest distance of such a point from the disc's center, both in radii of the disc
_RAY, _ON_DISC = 6.0, 1.02
#: Mean width of a finger, in units of the disc's diameter
_FULL = 0.7


@dataclass(frozen=True, eq=False)
class Width:
    """The width of a member or a gap, and where it is.

    Attributes:
        value: [m].
        ends: (2, 2), in space (2, 3) ends of a diameter of the disc or ball, the first on the
            boundary [m].
    """

    value: float
    ends: Array


def least_width(
    find: Callable[[float], object | None],
    thick: float,
    thin: float,
    most: float,
    ratio: float,
    accurate: Callable[[float], float],
) -> float | None:
    """The least width, up to ``most``, at which something is found; None where there is none.

    At ``thick`` there is nothing. From ``thin`` on widths grow by a ratio until something is found,
    and the last interval is halved until it is no longer than what is accurate.
    """
    while find(thin) is None:
        if thin >= most:
            return None
        thick, thin = thin, min(ratio * thin, most)
    while thick > 0.0 and thin - thick > accurate(thin):
        middle = 0.5 * (thick + thin)
        thick, thin = (middle, thin) if find(middle) is None else (thick, middle)
    return thin


def thinnest_member(shape: BaseGeometry, least: float, largest: float) -> Width | None:
    """The thinnest member of polygons; None if there is none below the ``largest`` width [m].

    ``least`` is the accuracy of the polygons [m]; thinner members are taken to be as thin.
    """
    find = partial(_member, shape, _connected(shape))
    thin = least_width(find, 0.0, least, largest, _RATIO, lambda d: ACCURACY * d)
    if thin is None or thin >= (1.0 - 2.0 * ACCURACY) * largest:
        return None
    member = find(thin)
    assert member is not None
    ends = _across(shape, member)
    across = float(np.hypot(*(ends[1] - ends[0])))
    # the way across is more accurate than the disc, which is a polygon
    return Width(across if abs(across - thin) < 0.01 * thin else thin, ends)


def narrowest_gap(shape: BaseGeometry, least: float, largest: float) -> Width | None:
    """The narrowest gap or hole: the thinnest member of the region without material."""
    around = shapely.box(*shape.bounds).buffer(3.0 * largest, join_style="mitre")
    return thinnest_member(around.difference(shape), least, largest)


def _connected(shape: BaseGeometry) -> tuple[int, int]:
    """Numbers of pieces and of holes."""
    polygons = [polygon for polygon in shapely.get_parts(shape) if polygon.area > 0.0]
    return len(polygons), sum(len(polygon.interiors) for polygon in polygons)


def _member(shape: BaseGeometry, connected: tuple[int, int], d: float) -> BaseGeometry | None:
    """A point in the middle of a member that is thinner than d, or None.

    The numbers of pieces and of holes of the shape are ``connected``.
    """
    centers = shape.buffer(-0.5 * d, quad_segs=_SIDES)
    if _connected(centers) != connected:
        # centres of discs a little smaller get through; where a way is too short to be told from
        # its ends, larger discs are kept out of more of it
        for wide in (d, (1.0 + ACCURACY) * d):
            fitting = centers if wide == d else shape.buffer(-0.5 * wide, quad_segs=_SIDES)
            narrow = shape.buffer(-0.5 * (1.0 - 2.0 * ACCURACY) * wide, quad_segs=_SIDES)
            passing = narrow.difference(fitting.buffer(4.0 * ACCURACY * wide, quad_segs=4))
            if not passing.is_empty:
                return _middle(passing, shape)
        return _middle(shape, shape)
    reached = centers.buffer(0.5 * d, quad_segs=_SIDES)
    # the discs are polygons: what they miss of a round boundary is no member
    missed = shape.difference(reached.buffer(0.01 * d, quad_segs=4))
    for finger in shapely.get_parts(missed):
        if finger.area < _FULL * d * d:
            continue
        corners = shapely.points(shapely.get_coordinates(finger))
        length = float(np.max(shapely.distance(corners, reached)))
        if length > d and finger.area > _FULL * d * length:
            return _middle(finger, shape)
    return None


def _middle(region: BaseGeometry, shape: BaseGeometry) -> BaseGeometry:
    """The point of a region that is farthest from the boundary of the shape, nearly."""
    polygons = [polygon for polygon in shapely.get_parts(region) if polygon.area > 0.0]
    if not polygons:
        return region.representative_point()
    edges = shape.boundary
    points = [polygon.representative_point() for polygon in polygons]
    return max(points, key=lambda point: shapely.distance(point, edges))


def _across(shape: BaseGeometry, middle: BaseGeometry) -> Array:
    """Two points (2, 2) of the boundary: the nearest one to a point in the middle, and opposite."""
    edges = shape.boundary
    nearest = shapely.get_coordinates(shapely.shortest_line(middle, edges))[1]
    center = shapely.get_coordinates(middle)[0]
    radial = center - nearest
    radius = float(np.hypot(*radial))
    if radius == 0.0:
        return np.array([nearest, nearest])
    ray = shapely.LineString([center, center + _RAY * radial]).intersection(edges)
    if ray.is_empty:
        return np.array([nearest, center + radial])
    hits = shapely.get_coordinates(ray)
    opposite = hits[np.argmin(np.linalg.norm(hits - center, axis=1))]
    # in the middle of a hole the disc may meet its boundary in three points, none opposite
    is_on_disc = np.hypot(*(opposite - center)) < _ON_DISC * radius
    return np.array([nearest, opposite if is_on_disc else center + radial])


def member_widths(rings: Sequence[Array], step: float, largest: float) -> tuple[Array, Array]:
    """Points of the boundary (n, 2) [m], and from each the way (n,) through the material [m].

    The rings (corners, 2) have it on their left. Points stand at most a ``step`` apart, the
    accuracy of the widths; a width beyond the ``largest`` is this one.
    """
    points, inward = [], []
    for ring in rings:
        side = np.roll(ring, -1, axis=0) - ring
        length = np.linalg.norm(side, axis=1)

        # the middles of the intervals into which each side is divided
        counts = np.maximum(1, np.ceil(length / step).astype(int))
        side_of_point = np.repeat(np.arange(len(ring)), counts)
        first_of_side = np.repeat(np.cumsum(counts) - counts, counts)
        interval = np.arange(len(side_of_point)) - first_of_side + 0.5
        share = interval / counts[side_of_point]
        points.append(ring[side_of_point] + share[:, None] * side[side_of_point])

        normal = np.column_stack([-side[:, 1], side[:, 0]]) / np.maximum(length, 1e-300)[:, None]
        inward.append(normal[side_of_point])
    x, normals = np.vstack(points), np.vstack(inward)
    widths = np.full(len(x), largest)

    # the opposite boundary has nearly the opposite normal, and lies nearly straight ahead
    pairs = cKDTree(x).query_pairs(largest, output_type="ndarray")
    cosines = np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]])
    pairs = pairs[cosines < -0.5]
    for i, j in (pairs.T, pairs.T[::-1]):
        across = x[j] - x[i]
        distance = np.linalg.norm(across, axis=1)
        is_opposite = np.einsum("ij,ij->i", across, normals[i]) > 0.7 * distance
        np.minimum.at(widths, i[is_opposite], distance[is_opposite])
    return x, widths
