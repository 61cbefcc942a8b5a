# SPDX-License-Identifier: MIT
"""Crossings of struts that slide as a whole: across each curve steps hardly move them."""

from __future__ import annotations

import numpy as np
import shapely

from ..arrays import Array
from .outline import Boundary


def slides(boundary: Boundary) -> Array:
    """Motions (slides, controls, 2) of crossings along x or y, the longest offset of each one 1.

    What is around of holes slides along less and less, and mirror images slide as they must.
    """
    member, isometries = boundary.member, boundary.isometries
    # struts that are nearer to each other than a member cross
    struts = [strut.buffer(0.5 * member) for _, strut in boundary.struts()]
    union = shapely.union_all(struts)
    hulls = [crossing.convex_hull for crossing in getattr(union, "geoms", [union])]
    curves = boundary.free.values()
    x = np.vstack([curve.control for curve in curves])
    inner = np.concatenate([np.full(len(curve.control), curve.closed) for curve in curves])
    if not hulls:
        return np.zeros((0, len(x), 2))
    distances = [
        [shapely.distance(hull, shapely.points(g(x))) for g in isometries] for hull in hulls
    ]
    near = inner * np.exp(
        -0.5 * (np.array(distances) / (boundary.options.slide_reach * member)) ** 2
    )
    shares = near / np.maximum(1.0, np.mean(np.sum(near, axis=0), axis=0))
    turned_back = np.array([g.turn.T for g in isometries])
    motions: list[Array] = []
    for k, hull in enumerate(hulls):
        images = shapely.MultiPoint(
            np.vstack([g(np.array(hull.centroid.coords)) for g in isometries])
        )
        if any(other.intersects(images) for other in hulls[:k]):
            continue  # it slides with that one
        for motion in np.einsum("gk,gdi->ikd", shares[k], turned_back):
            longest = np.max(np.linalg.norm(motion, axis=1))
            # where mirror images leave less than half of it, crossings meet
            if longest > 0.5:
                motions.append(motion / longest)
    return np.array(motions).reshape(-1, len(x), 2)
