# SPDX-License-Identifier: MIT
"""Where struts are missing: straight ones across holes, by what they would change."""

from __future__ import annotations

import numpy as np
import shapely

from ..arrays import Array, Integers
from ..reduction import Struts
from .outline import Boundary


def missing(boundary: Boundary, struts: Struts) -> list[Array]:
    """Ends (2, 2) [m] of struts that promise most, the best first."""
    options = boundary.options
    points, ends = _candidates(boundary)
    if not len(ends):
        return []
    gains = -struts.changes(points, ends, boundary.member)
    order = np.argsort(-gains, kind="stable")
    order = order[gains[order] > max(options.promised, options.promised_of_best * gains[order[0]])]
    promising: list[Array] = []
    taken: list[tuple[shapely.Geometry, float]] = []
    for k in order:
        line = shapely.LineString(points[ends[k]])
        if any(
            line.distance(images) < options.struts_apart * min(line.length, length)
            for images, length in taken
        ):
            continue
        promising.append(points[ends[k]])
        if len(promising) == options.tried:
            break
        images = shapely.MultiLineString([g(promising[-1]) for g in boundary.isometries])
        taken.append((images, line.length))
    return promising


def _candidates(boundary: Boundary) -> tuple[Array, Integers]:
    """Points of all holes, and pairs of them between which nothing but void is."""
    options = boundary.options
    points, pairs, count = [], [], 0
    for key in boundary.holes:
        curve, hole = boundary.free[key], boundary.hole(key)
        s = curve.sampled(options.ends * boundary.member, 1)
        x, n = curve.at(s), curve.normals(s)
        i, j = np.triu_indices(len(x), 1)
        displacement = x[j] - x[i]
        length = np.linalg.norm(displacement, axis=1)
        # normals are out of the material
        across = np.einsum("ij,ij->i", displacement, n[i]) > options.steep * length
        across &= np.einsum("ij,ij->i", displacement, n[j]) < -options.steep * length
        across &= length > options.shortest_strut * boundary.member
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
