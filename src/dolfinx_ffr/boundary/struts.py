# SPDX-License-Identifier: MIT
"""Where struts are missing: straight ones across holes, by what they would change."""

from __future__ import annotations

import numpy as np
import shapely

from ..arrays import Array, Integers
from ..reduction import Struts
from .outline import Boundary

#: Distance of points that can be ends of struts, and shortest strut, in minimum members
_APART, _SHORTEST = 1.5, 3.0
#: Fall of log psi at least that a strut of minimum width promises, and share of the best one's
_PROMISED, _OF_BEST = 0.01, 0.3
#: Least cosine between a strut and the normals at its ends
_STEEP = 0.3
#: Struts that are tried, and how far they are apart, in lengths of the shorter one
_TRIED, _BETWEEN = 2, 0.5


def missing(boundary: Boundary, struts: Struts) -> list[Array]:
    """Ends (2, 2) [m] of struts that promise most, the best first."""
    points, ends = _candidates(boundary)
    if not len(ends):
        return []
    gains = -struts.changes(points, ends, boundary.member)
    order = np.argsort(-gains, kind="stable")
    order = order[gains[order] > max(_PROMISED, _OF_BEST * gains[order[0]])]
    found: list[Array] = []
    taken: list[tuple[shapely.Geometry, float]] = []
    for k in order:
        line = shapely.LineString(points[ends[k]])
        if any(line.distance(o) < _BETWEEN * min(line.length, n) for o, n in taken):
            continue
        found.append(points[ends[k]])
        if len(found) == _TRIED:
            break
        images = shapely.MultiLineString([g(found[-1]) for g in boundary.isometries])
        taken.append((images, line.length))
    return found


def _candidates(boundary: Boundary) -> tuple[Array, Integers]:
    """Points of all holes, and pairs of them between which nothing but void is."""
    points, pairs, count = [], [], 0
    for key in boundary.holes:
        curve, hole = boundary.free[key], boundary.hole(key)
        s = curve.sampled(_APART * boundary.member, 1)
        x, n = curve.at(s), curve.normals(s)
        i, j = np.triu_indices(len(x), 1)
        way = x[j] - x[i]
        length = np.linalg.norm(way, axis=1)
        # normals are out of the material
        across = np.einsum("ij,ij->i", way, n[i]) > _STEEP * length
        across &= np.einsum("ij,ij->i", way, n[j]) < -_STEEP * length
        across &= length > _SHORTEST * boundary.member
        i, j = i[across], j[across]
        lines = shapely.linestrings(np.stack([x[i], x[j]], axis=1))
        room = hole.buffer(0.1 * boundary.member)
        shapely.prepare(room)
        inside = shapely.covers(room, lines)
        pairs.append(np.column_stack([i[inside], j[inside]]) + count)
        points.append(x)
        count += len(x)
    if not points:
        return np.zeros((0, 2)), np.zeros((0, 2), dtype=np.int64)
    return np.vstack(points), np.vstack(pairs)
