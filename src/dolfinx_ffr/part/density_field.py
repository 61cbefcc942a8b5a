# SPDX-License-Identifier: MIT
"""A smooth field out of the densities of cells, zero where they cross one half.

    phi(X) = sum_e w_e(X) x_e / sum_e w_e(X) - 1/2,    w_e(X) = g(|X - X_e| / r_e),

with Wendland's function g(s) = (1 - s)^4 (4 s + 1) of the distance from the centroids, which has
two continuous derivatives. The radius r_e is 1.5 times the size of the cell, so that the mean is
little more than its nearest cells: an edge between solid and void cells stays where it is, and
members of one row of cells stay members.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from ..fem import Domain

__all__ = ["density_field"]

Array = NDArray[np.float64]

#: Reach of a cell's density, in units of the root of its area
_REACH = 1.5


def density_field(domain: Domain, x: ArrayLike) -> Callable[[Array], Array]:
    """The field of the module's description; collective.

    Args:
        domain: The body.
        x: Density of each cell owned by this rank, shape (cells,), in [0, 1].

    Returns:
        A function of positions (n, 2) [m], on every rank, that gives (n,) numbers.

    Raises:
        ValueError: On every rank, if the density is not usable.
    """
    values = domain.everywhere(domain.check_density(x))
    centers = domain.everywhere(domain.centroids)
    radii = _REACH * np.sqrt(domain.everywhere(domain.cell_volumes))
    nearest = cKDTree(centers)

    def field(points: Array) -> Array:
        tree = cKDTree(points)
        near = tree.query_ball_point(centers, radii, return_sorted=True)
        counts = np.array([len(each) for each in near])
        cell = np.repeat(np.arange(len(centers)), counts)
        point = np.concatenate([np.asarray(each, dtype=np.int64) for each in near])
        s = np.linalg.norm(points[point] - centers[cell], axis=1) / radii[cell]
        weight = np.maximum(1.0 - s, 0.0) ** 4 * (4.0 * s + 1.0)
        matrix = csr_matrix((weight, (point, cell)), shape=(len(points), len(centers)))
        total = np.asarray(matrix.sum(axis=1)).ravel()
        bare = ~(total > 0.0)  # no centroid is near: the cell is much longer than wide
        means = np.asarray(matrix @ values) / np.where(bare, 1.0, total)
        means[bare] = values[nearest.query(points[bare])[1]]
        return means - 0.5

    return field
