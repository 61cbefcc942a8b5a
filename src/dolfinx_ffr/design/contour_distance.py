# SPDX-License-Identifier: MIT
"""The distance of points from the contour of a field on a grid."""

from __future__ import annotations

import math
from collections.abc import Sequence

import contourpy
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["distance_from_contour"]

Array = NDArray[np.float64]


def distance_from_contour(
    points: Array, grid: Sequence[Array], values: Array, level: float
) -> Array:
    """The distance of each point from the contour on which a field is ``level``.

    Args:
        points: Positions, shape (n, dimension) [m].
        grid: The lines of a regular grid, one array for each direction [m].
        values: Of the field at the grid's points, shape (points of each line ...); linear between
            them.
        level: Value on the contour, a polygon in the plane, triangles in space.

    Returns:
        Shape (n,) [m]; infinite where there is no contour.
    """
    if len(grid) == 3:
        return _in_space(points, grid, values, level)
    lines = contourpy.contour_generator(grid[0], grid[1], values.T).lines(level)
    lines = [line for line in lines if len(line) > 1]
    if not lines or len(points) == 0:
        return np.full(len(points), math.inf)
    start = np.vstack([line[:-1] for line in lines])
    end = np.vstack([line[1:] for line in lines])
    return _from_segments(points, start, end)


def _in_space(points: Array, grid: Sequence[Array], values: Array, level: float) -> Array:
    import pyvista  # takes a while

    image = pyvista.ImageData(
        dimensions=values.shape,
        origin=[line[0] for line in grid],
        spacing=[line[1] - line[0] for line in grid],
    )
    surface = image.contour([level], scalars=values.ravel(order="F"))
    if not surface.n_cells or len(points) == 0:
        return np.full(len(points), math.inf)
    nearest = surface.find_closest_cell(points, return_closest_point=True)[1]
    return np.linalg.norm(points - nearest, axis=1)


def _from_segments(points: Array, start: Array, end: Array) -> Array:
    """The distance of each point from the nearest of some line segments."""
    middle, span = 0.5 * (start + end), end - start
    # a segment's middle may be farther than its nearest point by half its length
    half = 0.5 * np.linalg.norm(span, axis=1).max()
    tree = cKDTree(middle)
    nearest = tree.query(points)[0]
    candidates = tree.query_ball_point(points, nearest + 2.0 * half)
    counts = [len(c) for c in candidates]
    segment = np.concatenate(candidates).astype(np.int64)
    point = np.repeat(np.arange(len(points)), counts)
    offset = points[point] - start[segment]
    length2 = np.maximum(np.einsum("ij,ij->i", span, span)[segment], np.finfo(float).tiny)
    t = np.clip(np.einsum("ij,ij->i", offset, span[segment]) / length2, 0.0, 1.0)
    distance = np.linalg.norm(offset - t[:, None] * span[segment], axis=1)
    return np.minimum.reduceat(distance, np.concatenate([[0], np.cumsum(counts)[:-1]]))
