# SPDX-License-Identifier: MIT
"""The circle or the cylinder on which the nodes of a bearing surface lie.

The centre (a, b) and c = r^2 - a^2 - b^2 minimise sum (x^2 + y^2 - 2 a x - 2 b y - c)^2, a linear
problem (I. Kasa, IEEE Transactions on Instrumentation and Measurement 25 (1976),
doi:10.1109/TIM.1976.6312298), whose solution is exact for points on a circle. A cylinder
minimises the squared distances of its points.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from ..arrays import Array

#: Fewer points lie on a circle by chance: any three do, and the corners of a rectangle
FEWEST = 5
#: Largest distance of a point from the circle, relative to its radius
ROUND = 1e-4


def nearest_circle(points: Array, accuracy: float) -> tuple[Array, float] | None:
    """Centre (2,) and radius of the circle of points (n, 2); None beyond an accuracy, in radii."""
    middle = points.mean(axis=0)
    extent = float(np.max(np.linalg.norm(points - middle, axis=1)))
    if not extent > 0.0:
        return None
    s = (points - middle) / extent
    matrix = np.column_stack([2.0 * s, np.ones(len(s))])
    solution, _, rank, _ = np.linalg.lstsq(matrix, np.sum(s**2, axis=1), rcond=1e-9)
    radii = np.linalg.norm(s - solution[:2], axis=1)
    radius = float(radii.mean())
    if rank < 3 or np.max(np.abs(radii - radius)) > accuracy * radius:
        return None
    return np.asarray(middle + extent * solution[:2]), extent * radius


def fit_circle(points: Array) -> Array | None:
    """The centre (2,) of the circle of points (n, 2); None for fewer than five or under a sixth."""
    found, offset = nearest_circle(points, ROUND), points - points.mean(axis=0)
    extent = float(np.max(np.linalg.norm(offset, axis=1)))
    # the chord of a sixth of the circle is as long as the radius; these points extend to its half
    if found is None or found[1] > 2.0 * (1.0 + ROUND) * extent:
        return None
    return found[0] if len(np.unique(np.round(offset / extent, 9), axis=0)) >= FEWEST else None


def fit_cylinder(points: Array, axis: Array) -> tuple[Array, Array] | None:
    """Middle and axis, (3,), of the cylinder of points (n, 3) near a guessed ``axis``, or None."""
    middle = points.mean(axis=0)
    extent = np.max(np.linalg.norm(points - middle, axis=1))
    if not extent > 0.0:
        return None
    s = np.unique(np.round((points - middle) / extent, 12), axis=0)
    across = np.linalg.svd(axis[None, :])[2][1:]  # two directions perpendicular to it

    def along(tilt: Array) -> Array:
        direction = axis + tilt @ across
        return np.asarray(direction / np.linalg.norm(direction))

    def distances(unknown: Array) -> Array:
        offset, direction = s - unknown[2:4] @ across, along(unknown[:2])
        radial = offset - np.outer(offset @ direction, direction)
        return np.asarray(np.linalg.norm(radial, axis=1) - unknown[4])

    circle = fit_circle(s @ across.T)
    center = s.mean(axis=0) @ across.T if circle is None else circle
    radius = np.mean(np.linalg.norm(s @ across.T - center, axis=1))
    start = np.array([0.0, 0.0, *center, radius])
    direction = along(least_squares(distances, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x[:2])
    plane = np.linalg.svd(direction[None, :])[2][1:]
    circle = fit_circle(s @ plane.T)
    if circle is None:
        return None
    height = s @ direction
    center = circle @ plane + 0.5 * (height.min() + height.max()) * direction
    return middle + extent * center, direction * np.sign(direction[np.argmax(np.abs(direction))])
