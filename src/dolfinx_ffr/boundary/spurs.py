# SPDX-License-Identifier: MIT
"""Struts that end free: they carry nothing, and only the minimum width keeps them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ..arrays import Array
from ..part import Part, solid_regions

#: Width of spurs at most, and way around one at least, in minimum members
_WIDE, _AROUND = 3.0, 4.0
#: Way around a spur at least, in its widths where it begins: less is a corner, of 60 degrees
_LONG = 2.0
#: Steps along the boundary of a finished part, in minimum members
_STEP = 0.2


def free_ends(part: Part, member: float, held: Array) -> list[Array]:
    """Where struts of a finished part end free: the place (2,) of each [m], the longest first.

    What is solid, touches an interface or bears one of the points ``held`` (n, 2) [m], at which
    forces may act, does not end free, whatever its shape.
    """
    step = _STEP * member
    rings = [ring for piece in part.polygon.geoms for ring in (piece.exterior, *piece.interiors)]
    curves = [(shapely.get_coordinates(shapely.segmentize(r, step))[:-1], True) for r in rings]
    stays = [*solid_regions(part), *map(shapely.Point, held)]
    for name in part.body.interfaces:
        stays += [shapely.LineString(c.points(part.accuracy)) for c in part.interface(name)]
    near = shapely.union_all(stays).buffer(0.5 * member)
    ends = [spur for spur in _spurs(curves, part.polygon, member) if not spur.intersects(near)]
    return [np.array(spur.representative_point().coords[0]) for spur in ends]


def _spurs(
    curves: Iterable[tuple[Array, bool]], material: shapely.Geometry, member: float
) -> list[shapely.Polygon]:
    """What of a ``material`` ends free, the longest first.

    A curve that passes a narrow place twice encloses a spur in between, where no other curve is
    inside. The ``curves`` are points (n, 2) with the material on their left, and whether they are
    closed. Lengths are in metres, as the minimum ``member``.
    """
    spurs: list[tuple[float, shapely.Polygon]] = []
    inside = material.buffer(0.05 * member)
    shapely.prepare(inside)
    for points, closed in curves:
        for around, spur in _enclosed(points, closed, member):
            if any(spur.intersects(other) for _, other in spurs):
                continue
            if spur.is_valid and inside.covers(spur):
                spurs.append((around, spur))
    spurs.sort(key=lambda pair: -pair[0])
    return [spur for _, spur in spurs]


def _enclosed(x: Array, closed: bool, member: float) -> Iterator[tuple[float, shapely.Polygon]]:
    """Pieces of a curve between two places that are near each other, the longest first."""
    pairs = cKDTree(x).query_pairs(_WIDE * member, output_type="ndarray")
    if closed:
        pairs = np.vstack([pairs, pairs[:, ::-1] + [0, len(x)]])
        x = np.vstack([x, x])
    steps = np.linalg.norm(np.diff(x, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    swept = np.concatenate([[0.0], np.cumsum(0.5 * cross(x[:-1], x[1:]))])
    i, j = pairs.T
    around = along[j] - along[i]
    width = np.linalg.norm(x[j] - x[i], axis=1)
    area = swept[j] - swept[i] + 0.5 * cross(x[j], x[i])
    spur = (around > np.maximum(_LONG * width, _AROUND * member)) & (area > 0.0)
    spur &= 2.0 * area < _WIDE * member * around
    for k in np.flatnonzero(spur)[np.argsort(-around[spur], kind="stable")]:
        yield float(around[k]), shapely.Polygon(x[i[k] : j[k] + 1])


def cross(a: Array, b: Array) -> Array:
    """The cross products of vectors (n, 2)."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
