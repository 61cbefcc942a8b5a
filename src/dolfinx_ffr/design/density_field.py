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
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from ..fem import Array, Domain
from .rbf import Wendland, neighbours

#: Reach of a cell's density, in units of the edge of a square or cube as large
_REACH = 1.5


def density_field(domain: Domain, x: ArrayLike) -> Callable[[Array], Array]:
    """A smooth field that is zero where the densities of cells cross one half; collective.

    From densities ``x`` (cells,) in [0, 1] of the cells of a ``domain`` owned by this rank to a
    function of positions (n, dimension) [m], on every rank, that gives (n,) numbers. ValueError on
    every rank if the density is not usable.
    """
    parts = domain.check_density(x), domain.centroids, domain.cell_volumes
    values, centers, volumes = map(domain.everywhere, parts)
    radii = _REACH * volumes ** (1.0 / domain.dimension)
    tree, reach, wendland = cKDTree(centers), float(radii.max()), Wendland(1.0)

    def field(points: Array) -> Array:
        near = neighbours(points, tree, reach)
        weight = wendland(near["v"] / radii[near["j"]])  # zero beyond the radius of the cell
        places = near["i"], near["j"]
        matrix = csr_matrix((weight, places), shape=(len(points), len(centers)))
        total = np.asarray(matrix.sum(axis=1)).ravel()
        bare = ~(total > 0.0)  # no centroid is near: the cell is much longer than wide
        means = np.asarray(matrix @ values) / np.where(bare, 1.0, total)
        means[bare] = values[tree.query(points[bare])[1]]
        return means - 0.5

    return field
