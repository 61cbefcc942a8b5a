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

#: Reach of a cell's density, in units of the edge of a square or cube as large
_REACH = 1.5


def density_field(domain: Domain, x: ArrayLike) -> Callable[[Array], Array]:
    """The field of the module's description; collective.

    Args:
        domain: The body.
        x: Density of each cell owned by this rank, shape (cells,), in [0, 1].

    Returns:
        A function of positions (n, dimension) [m], on every rank, that gives (n,) numbers.

    Raises:
        ValueError: On every rank, if the density is not usable.
    """
    values = domain.everywhere(domain.check_density(x))
    centers = domain.everywhere(domain.centroids)
    radii = _REACH * domain.everywhere(domain.cell_volumes) ** (1.0 / domain.dimension)
    nearest, farthest = cKDTree(centers), float(radii.max())

    def field(points: Array) -> Array:
        near = cKDTree(points).sparse_distance_matrix(nearest, farthest, output_type="ndarray")
        reached = near["v"] < radii[near["j"]]
        point, cell = near["i"][reached], near["j"][reached]
        s = near["v"][reached] / radii[cell]
        weight = (1.0 - s) ** 4 * (4.0 * s + 1.0)
        matrix = csr_matrix((weight, (point, cell)), shape=(len(points), len(centers)))
        total = np.asarray(matrix.sum(axis=1)).ravel()
        bare = ~(total > 0.0)  # no centroid is near: the cell is much longer than wide
        means = np.asarray(matrix @ values) / np.where(bare, 1.0, total)
        means[bare] = values[nearest.query(points[bare])[1]]
        return means - 0.5

    return field
