# SPDX-License-Identifier: MIT
"""Crossings of struts that slide as a whole: steps across each curve hardly move them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from ..arrays import Array, Mask
from .holes import struts_between_holes
from .options import PLANE_STEPS
from .outline import Boundary


def slides(boundary: Boundary) -> Array:
    """Motions (slides, controls, 2) of crossings along x or y, the longest offset of each one 1.

    Holes around a crossing slide along, the less the farther away they are, and mirror images slide
    as they must.
    """
    isometries, curves = boundary.isometries, boundary.free.values()
    control = np.vstack([curve.control for curve in curves])
    of_holes = np.concatenate([np.full(len(curve.control), curve.closed) for curve in curves])
    crossings = _crossings(boundary)
    if not crossings:
        return np.zeros((0, len(control), 2))

    shares = _shares(boundary, crossings, control, of_holes)
    turned_back = np.array([isometry.turn.T for isometry in isometries])
    motions: list[Array] = []
    for k, crossing in enumerate(crossings):
        center = np.array(crossing.centroid.coords)
        images = shapely.MultiPoint(np.vstack([isometry(center) for isometry in isometries]))
        if any(earlier.intersects(images) for earlier in crossings[:k]):
            continue  # it slides as the image of that one
        for motion in np.einsum("gk,gdi->ikd", shares[k], turned_back):
            longest = np.max(np.linalg.norm(motion, axis=1))
            # where mirror images leave less than half of it, crossings meet
            if longest > 0.5:
                motions.append(motion / longest)
    return np.array(motions).reshape(-1, len(control), 2)


def _crossings(boundary: Boundary) -> list[shapely.Geometry]:
    """Convex hulls around struts that are nearer to each other than a member [m]."""
    struts = [strut.buffer(0.5 * boundary.member) for _, strut in struts_between_holes(boundary)]
    union = shapely.union_all(struts)
    return [crossing.convex_hull for crossing in getattr(union, "geoms", [union])]


def _shares(
    boundary: Boundary, crossings: Sequence[shapely.Geometry], control: Array, of_holes: Mask
) -> Array:
    """Shares of a slide that each control follows, (crossings, isometries, controls)."""
    images = [shapely.points(isometry(control)) for isometry in boundary.isometries]
    distances = np.array(
        [[shapely.distance(crossing, points) for points in images] for crossing in crossings]
    )
    length = PLANE_STEPS.slide_reach * boundary.member
    shares = of_holes * np.exp(-0.5 * (distances / length) ** 2)
    return np.asarray(shares / np.maximum(1.0, np.mean(np.sum(shares, axis=0), axis=0)))
