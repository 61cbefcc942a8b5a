# SPDX-License-Identifier: MIT
"""The circle or the cylinder on which the nodes of a bearing surface lie.

The centre (a, b) and c = r^2 - a^2 - b^2 minimise sum (x^2 + y^2 - 2 a x - 2 b y - c)^2, a linear
problem (I. Kasa, IEEE Transactions on Instrumentation and Measurement 25 (1976),
doi:10.1109/TIM.1976.6312298), whose solution is exact for points on a circle. A cylinder is
found by least squares of the distances of its points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

__all__ = ["fit_circle", "fit_cylinder"]

#: Fewer points lie on a circle by chance: any three do, and the corners of a rectangle
FEWEST = 5
#: Largest distance of a point from the circle, relative to its radius
ROUND = 1e-4


def fit_circle(points: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The centre of the circle on which all points lie.

    Args:
        points: Shape (points, 2) [m]; some may stand several times.

    Returns:
        Centre, shape (2,) [m]; None if there are fewer than five points, if they do not lie on one
        circle, or if they are so small an arc of it (less than about a sixth) that its centre is
        not near them.
    """
    middle = points.mean(axis=0)
    extent = float(np.max(np.linalg.norm(points - middle, axis=1)))
    if not extent > 0.0:
        return None
    s = (points - middle) / extent
    if len(np.unique(np.round(s, 9), axis=0)) < FEWEST:
        return None
    matrix = np.column_stack([2.0 * s, np.ones(len(s))])
    solution, _, rank, _ = np.linalg.lstsq(matrix, np.sum(s**2, axis=1), rcond=1e-9)
    if rank < 3:
        return None
    center = solution[:2]
    radii = np.linalg.norm(s - center, axis=1)
    radius = float(radii.mean())
    # the chord of a sixth of the circle is as long as the radius; these points extend to its half
    if np.max(np.abs(radii - radius)) > ROUND * radius or radius > 2.0 * (1.0 + ROUND):
        return None
    return np.asarray(middle + extent * center)


def fit_cylinder(
    points: NDArray[np.float64], axis: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """The cylinder on which all points lie.

    Args:
        points: Shape (points, 3) [m]; some may stand several times.
        axis: About its direction, a unit vector, shape (3,).

    Returns:
        The middle of its axis, halfway between the ends of the points, and the direction of the
        axis, each of shape (3,) [m], [-]; None if they do not lie on one cylinder, or if they are
        so small a part of its circle that its centre is not near them.
    """
    middle = points.mean(axis=0)
    extent = float(np.max(np.linalg.norm(points - middle, axis=1)))
    if not extent > 0.0:
        return None
    s = np.unique(np.round((points - middle) / extent, 12), axis=0)
    across = np.linalg.svd(axis[None, :])[2][1:]  # two directions perpendicular to it

    def along(tilt: NDArray[np.float64]) -> NDArray[np.float64]:
        direction = axis + tilt @ across
        return np.asarray(direction / np.linalg.norm(direction))

    def distances(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        offset = s - unknown[2:4] @ across
        radial = offset - np.outer(offset @ along(unknown[:2]), along(unknown[:2]))
        return np.asarray(np.linalg.norm(radial, axis=1) - unknown[4])

    circle = fit_circle(s @ across.T)
    start = s.mean(axis=0) @ across.T if circle is None else circle
    radius = float(np.mean(np.linalg.norm(s @ across.T - start, axis=1)))
    unknown = least_squares(
        distances, np.array([0.0, 0.0, *start, radius]), xtol=1e-15, ftol=1e-15, gtol=1e-15
    ).x
    direction = along(unknown[:2])
    plane = np.linalg.svd(direction[None, :])[2][1:]
    circle = fit_circle(s @ plane.T)
    if circle is None:
        return None
    height = s @ direction
    center = circle @ plane + 0.5 * (height.min() + height.max()) * direction
    return middle + extent * center, direction * np.sign(direction[np.argmax(np.abs(direction))])
