# SPDX-License-Identifier: MIT
"""Where struts are missing: straight ones across holes, by what they would change."""

from __future__ import annotations

import numpy as np
import shapely

from ..arrays import Array, Integers
from ..reduction import Struts
from .options import CURVES
from .outline import Boundary


def missing(boundary: Boundary, struts: Struts) -> list[Array]:
    """Ends (2, 2) [m] of struts that promise most, the best first."""
    points, ends = _candidates(boundary)
    if not len(ends):
        return []
    gains = -struts.changes(points, ends, boundary.member)
    order = np.argsort(-gains, kind="stable")
    least_gain = max(CURVES.promised, CURVES.promised_of_best * gains[order[0]])

    promising: list[Array] = []
    with_images: list[tuple[shapely.Geometry, float]] = []  # and the length of each
    for k in order[gains[order] > least_gain]:
        line = shapely.LineString(points[ends[k]])
        if any(
            line.distance(images) < CURVES.struts_apart * min(line.length, length)
            for images, length in with_images
        ):
            continue
        promising.append(points[ends[k]])
        if len(promising) == CURVES.tried:
            break
        images = shapely.MultiLineString([g(promising[-1]) for g in boundary.isometries])
        with_images.append((images, line.length))
    return promising


def _candidates(boundary: Boundary) -> tuple[Array, Integers]:
    """Points (n, 2) of all holes, and pairs of them between which nothing but void is, (m, 2)."""
    all_points, all_pairs = [np.zeros((0, 2))], [np.zeros((0, 2), dtype=np.int64)]
    count = 0
    for key in boundary.holes:
        curve = boundary.free[key]
        s = curve.sampled(CURVES.strut_ends * boundary.member, 1)
        points, normals = curve.at(s), curve.normals(s)
        i, j = np.triu_indices(len(points), 1)
        displacement = points[j] - points[i]
        length = np.linalg.norm(displacement, axis=1)
        # normals are out of the material
        is_across = np.einsum("ij,ij->i", displacement, normals[i]) > CURVES.steep * length
        is_across &= np.einsum("ij,ij->i", displacement, normals[j]) < -CURVES.steep * length
        is_across &= length > CURVES.shortest_strut * boundary.member
        pairs = np.column_stack([i[is_across], j[is_across]])

        room = boundary.hole(key).buffer(0.1 * boundary.member)
        shapely.prepare(room)
        lines = shapely.linestrings(points[pairs])
        all_pairs.append(pairs[shapely.covers(room, lines)] + count)
        all_points.append(points)
        count += len(points)
    return np.vstack(all_points), np.vstack(all_pairs)
