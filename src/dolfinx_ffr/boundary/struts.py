# SPDX-License-Identifier: MIT
"""Where a strut is missing: a straight one across a hole, by what it would change."""

from __future__ import annotations

import numpy as np
import shapely

from ..arrays import Array, Integers
from ..reduction import Struts
from .options import CURVES
from .outline import Boundary


def missing_strut(boundary: Boundary, struts: Struts) -> Array | None:
    """Ends (2, 2) [m] of the strut that promises the largest fall of psi, None if no one does."""
    points, ends = _candidates(boundary)
    if not len(ends):
        return None
    changes = struts.changes(points, ends, boundary.member)
    best = int(np.argmin(changes))
    return points[ends[best]] if changes[best] < -CURVES.promised else None


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
