# SPDX-License-Identifier: MIT
"""Thinnest member and narrowest gap of a shape, by discs that do not fit.

The opening of a shape by a disc is what the disc covers where it fits. Of what an opening with the
diameter d leaves out, some is no member: at each convex corner a disc leaves out a cap. A connected
part that is left out is a *member* thinner than d if

* it meets the opening along two or more separate stretches: a strut, a neck; or along none, where
  no disc fits into a whole piece; or
* it meets it along one stretch, but is deeper than d: a finger that ends freely. The cap of a
  corner of the angle a has the depth d/2 (1/sin(a/2) - 1), so that corners above 39 degrees are
  never members, and sharper ones are feather edges, members of whatever thickness.

Parts smaller than `SHARE` of the shape's area do not count. The thinnest member is the smallest d
at which there is a member. The narrowest gap is that of the shape's complement; so a milling cutter
up to this diameter reaches all of the outline but the inner corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

__all__ = ["SHARE", "Width", "member_widths", "narrowest_gap", "thinnest_member"]

Array = NDArray[np.float64]

#: Share of a shape's area below which what is left out does not count
SHARE = 1e-6
#: Relative accuracy of a width
ACCURACY = 5e-3
#: Sides of a quarter of the discs
_SIDES = 24


@dataclass(frozen=True, eq=False)
class Width:
    """The width of a member or a gap, and where it is."""

    value: float  #: [m]
    ends: Array  #: (2, 2) points on both sides [m]


def thinnest_member(shape: BaseGeometry, least: float, largest: float) -> Width | None:
    """The thinnest member of a shape, as the module's description defines it.

    Args:
        shape: Polygons [m].
        least: Accuracy of the shape itself [m]; thinner members are taken to be as thin.
        largest: Width from which on members are of no interest [m].

    Returns:
        None, if no member is thinner than ``largest``.
    """
    lattice = [least]
    while lattice[-1] < largest:
        lattice.append(min(1.4 * lattice[-1], largest))
    thick = 0.0
    for thin in lattice:
        if _member(shape, thin) is not None:
            break
        thick = thin
    else:
        return None
    while thick > 0.0 and thin - thick > ACCURACY * thin:
        middle = 0.5 * (thick + thin)
        if _member(shape, middle) is None:
            thick = middle
        else:
            thin = middle
    member = _member(shape, thin)
    assert member is not None
    ends = _across(shape, member, thin)
    across = float(np.hypot(*(ends[1] - ends[0])))
    # the way across is more accurate than the disc, which is a polygon
    return Width(across if abs(across - thin) < 4.0 * ACCURACY * thin else thin, ends)


def narrowest_gap(shape: BaseGeometry, least: float, largest: float) -> Width | None:
    """The narrowest gap between members, or hole: the thinnest member of what is not material.

    Args:
        shape: Polygons [m].
        least: As for `thinnest_member`.
        largest: As for `thinnest_member`.
    """
    around = shapely.box(*shape.bounds).buffer(3.0 * largest, join_style="mitre")
    return thinnest_member(around.difference(shape), least, largest)


def _member(shape: BaseGeometry, d: float) -> BaseGeometry | None:
    """The largest member of a shape that is thinner than d, or None."""
    r = 0.5 * d
    opened = shape.buffer(-r, quad_segs=_SIDES).buffer(r, quad_segs=_SIDES)
    # the discs are polygons: what they miss of a round boundary is no member
    grown = opened.buffer(0.02 * r, quad_segs=4)
    left = shape.difference(grown)
    found = []
    for part in shapely.get_parts(left):
        if part.area < SHARE * shape.area or part.area < 1e-3 * d * d:
            continue
        touching = part.boundary.intersection(grown.boundary.buffer(1e-4 * r, quad_segs=2))
        lines = [g for g in shapely.get_parts(touching) if g.length > 0.0]
        stretches = shapely.line_merge(shapely.union_all(lines)) if lines else None
        count = 0 if stretches is None else len(shapely.get_parts(stretches))
        if count == 1:
            corners = shapely.get_coordinates(part)
            deep = max(shapely.distance(shapely.points(corners), opened)) > d
            if not deep:
                continue
        found.append(part)
    return max(found, key=lambda part: part.area) if found else None


def _across(shape: BaseGeometry, member: BaseGeometry, d: float) -> Array:
    """Two points of the boundary on both sides of a member of width d."""
    core = shape.buffer(-0.5 * 0.97 * d, quad_segs=_SIDES).intersection(member)
    inside = (core if core.area > 0.0 else member).representative_point()
    edges = shapely.MultiLineString(
        [ring for part in shapely.get_parts(shape) for ring in (part.exterior, *part.interiors)]
    )
    near = shapely.get_coordinates(shapely.shortest_line(inside, edges))[1]
    middle = shapely.get_coordinates(inside)[0]
    away = middle - near
    size = float(np.hypot(*away))
    if size == 0.0:
        return np.array([near, near])
    ray = shapely.LineString([middle, middle + 3.0 * d * away / size]).intersection(edges)
    if ray.is_empty:
        return np.array([near, middle + away])
    hits = shapely.get_coordinates(ray)
    far = hits[np.argmin(np.linalg.norm(hits - middle, axis=1))]
    return np.array([near, far])


def member_widths(rings: Sequence[Array], step: float, largest: float) -> tuple[Array, Array]:
    """The way through the material from points of its boundary to the opposite boundary.

    Args:
        rings: Closed polygons with material on the left, the first vertex not repeated [m].
        step: Distance of the points [m], which is the accuracy of the widths.
        largest: Width from which on they are not told apart [m].

    Returns:
        Points, shape (n, 2) [m], and widths, shape (n,) [m].
    """
    points, inward = [], []
    for ring in rings:
        side = np.roll(ring, -1, axis=0) - ring
        length = np.linalg.norm(side, axis=1)
        counts = np.maximum(1, np.ceil(length / step).astype(int))
        number = np.repeat(np.arange(len(ring)), counts)
        place = np.arange(len(number)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5
        points.append(ring[number] + (place / counts[number])[:, None] * side[number])
        normal = np.column_stack([-side[:, 1], side[:, 0]]) / np.maximum(length, 1e-300)[:, None]
        inward.append(normal[number])
    x, n = np.vstack(points), np.vstack(inward)
    widths = np.full(len(x), largest)
    pairs = cKDTree(x).query_pairs(largest, output_type="ndarray")
    for i, j in (pairs.T, pairs.T[::-1]):
        way = x[j] - x[i]
        distance = np.linalg.norm(way, axis=1)
        across = np.einsum("ij,ij->i", way, n[i]) > 0.7 * distance
        facing = np.einsum("ij,ij->i", n[i], n[j]) < -0.5
        met = across & facing
        np.minimum.at(widths, i[met], distance[met])
    return x, widths
