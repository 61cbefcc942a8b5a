# SPDX-License-Identifier: MIT
"""Filtered and projected densities of elements (SIMP).

The filter replaces each value by a weighted mean over its neighbourhood, so that no detail is finer
than its radius and no checkerboard of solid and void looks stiff,

    y = D K D V z,     K_ef = max(0, R - |X_e - X_f|),     V = diag(sizes of the cells),

with the diagonal matrix D for which the rows sum to one. Because K is symmetric, the same D keeps
the volume: sum_e V_e y_e = sum_e V_e z_e. (The usual filter divides by the sum of the row instead,
and keeps the volume only far from the edges.) D is found by a fixed point,
d <- sqrt(d / (K V d)), which is Sinkhorn's balancing of a symmetric matrix.

The projection drives the mean towards void and solid,

    x = (tanh(beta eta) + tanh(beta (y - eta))) / (tanh(beta eta) + tanh(beta (1 - eta))).

References:
    B. Bourdin, International Journal for Numerical Methods in Engineering 50 (2001),
    doi:10.1002/nme.116 (filter).
    F. Wang, B. S. Lazarov and O. Sigmund, Structural and Multidisciplinary Optimization 43 (2011),
    doi:10.1007/s00158-010-0602-y (projection).
    P. A. Knight, D. Ruiz and B. Ucar, SIAM Journal on Matrix Analysis 35 (2014),
    doi:10.1137/110825753 (symmetric balancing).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from .. import validation
from ..fem import Array, Domain
from ..limits import check_pairs
from ..parallel import agreed_memory, on_every_rank
from .base import SHARP, Design, checked_web, density_field, steepness
from .rims import HoleRims

#: Minimum member and gap of densities, in mean elements, as of a level set by default
LEAST = 0.64
#: Number of points in each direction of a cell by which its share in a rim is found
_POINTS = 4


def check_neighbours(
    domain: Domain, what: str, sizes: tuple[float, float], reach: float, remedy: str, ranks: int = 1
) -> None:
    """Refuse more pairs than fit into memory, within ``reach`` distances of the second points."""
    memory = agreed_memory(domain.comm) * ranks
    with on_every_rank(domain.comm, what):
        check_pairs(what, sizes, reach, domain.dimension, remedy, memory)


class DensityFilter:
    """Weighted means over round neighbourhoods, which preserve constants and the volume.

    Values are of all cells, in the order of `Domain.everywhere`, on every rank.

    Args:
        domain: The body.
        radius: R [m]; two to three elements are usual, zero filters nothing.

    Raises:
        ValueError: If the radius is negative, NaN or infinite, or so long that the weights take
            more than the memory.

    Warns:
        UserWarning: If a radius above zero is not longer than the distance of neighbouring
            centroids, so that nothing is filtered.
    """

    def __init__(self, domain: Domain, radius: float) -> None:
        self.domain = validation.instance("density filter: domain", domain, Domain, "a Domain")
        validation.number("density filter: radius", radius, least=0.0, unit="m")
        #: Reach of the means [m]
        self.radius = float(radius)
        n = domain.n_cells_global
        reach = self.radius / domain.cell_size
        remedy = "take a smaller radius [m]; two to three elements are usual"
        check_neighbours(domain, "density filter", (n, n), reach, remedy)
        areas = domain.everywhere(domain.cell_volumes)
        self._share = areas / areas.mean()
        tree = cKDTree(domain.everywhere(domain.centroids))
        pairs = tree.sparse_distance_matrix(tree, self.radius, output_type="ndarray")
        weights = 1.0 - pairs["v"] / (self.radius or 1.0)
        if self.radius > 0.0:
            # at the radius itself the weight is round-off
            self._warn_without_neighbours(tree, np.count_nonzero(weights > 1e-9))
        kernel = scipy.sparse.coo_matrix((weights, (pairs["i"], pairs["j"])), shape=(n, n)).tocsr()
        balance = _balance(kernel, self._share)
        row_scale, column_scale = (
            scipy.sparse.diags(balance),
            scipy.sparse.diags(balance * self._share),
        )
        #: (cells, cells) weights of the means; rows sum to one
        self.matrix = scipy.sparse.csr_matrix(row_scale @ kernel @ column_scale)

    def _warn_without_neighbours(self, tree: cKDTree, pairs: int) -> None:
        """Warn if fewer than half of the cells have a neighbour within the radius."""
        cells = self.domain.n_cells_global
        if cells > 1 and pairs < 1.5 * cells:  # each cell is a pair with itself
            nearest = float(np.median(tree.query(tree.data, k=2)[0][:, 1]))
            warnings.warn(
                f"density filter: radius = {self.radius:.4g} m is not longer than the "
                f"distance of neighbouring cells, {nearest:.4g} m, and filters nothing; take "
                f"{2.5 * nearest:.4g} m",
                stacklevel=3,
            )

    def __call__(self, values: Array) -> Array:
        """The means of ``values`` (cells of all ranks,), of the same shape."""
        return np.asarray(self.matrix @ values)

    def pullback(self, means_bar: Array) -> Array:
        """The derivative by the values from the derivative ``means_bar`` by the means, (cells,)."""
        return np.asarray(self.matrix.T @ means_bar)


def _balance(kernel: scipy.sparse.csr_matrix, share: Array) -> Array:
    """The positive d for which diag(d) kernel diag(d) share is one everywhere."""
    d = np.ones(len(share))
    for _ in range(500):
        sums = kernel @ (share * d)
        if np.max(np.abs(d * sums - 1.0)) < 1e-14:
            break
        d = np.sqrt(d / sums)
    return d


@dataclass(frozen=True)
class HeavisideProjection:
    """Smoothed step from void to solid, of [0, 1] onto itself.

    Attributes:
        beta: Steepness; below one nearly the identity, above sixteen nearly a step.
        eta: Threshold, in (0, 1).
    """

    beta: float
    eta: float = 0.5

    def __post_init__(self) -> None:
        validation.number("projection: beta", self.beta, above=0.0)
        validation.number("projection: eta", self.eta, above=0.0, below=1.0)

    def __call__(self, means: Array) -> Array:
        """The projection of ``means``, of the same shape."""
        low, high = self._ends
        x = (low + np.tanh(self.beta * (means - self.eta))) / (low + high)
        return np.clip(x, 0.0, 1.0)  # by round-off it may leave it

    @property
    def _ends(self) -> Array:
        return np.tanh(self.beta * np.array([self.eta, 1.0 - self.eta]))

    def pullback(self, means: Array, x_bar: Array) -> Array:
        """The derivative by ``means`` from the derivative ``x_bar`` by their projection."""
        slope = 1.0 - np.tanh(self.beta * (means - self.eta)) ** 2
        return np.asarray(x_bar * self.beta * slope / sum(self._ends))


class DensityDesign(Design):
    """One variable in [0, 1] for each designed element, filtered and projected (SIMP).

    Elements that are not designed are solid or void, also in the means of their neighbours.
    Variables have the order of `Domain.everywhere`.

    Args:
        domain: The body.
        radius: Radius of the filter [m]; by default two and a half mean elements. With shorter ones
            struts may be connected by corners of elements, which are too stiff. Zero filters
            nothing.
        eta: Threshold of the projection, in (0, 1).
        hole_rim: Width of the rim that stays solid around each hole of the body's drawing, with a
            name or without [m]; by default 0.64 mean elements, the minimum member of densities, 0
            for none.
        web: Web of pockets, as for `LevelSet`.
    """

    each: ClassVar[str] = "designed cell"

    def __init__(
        self,
        domain: Domain,
        *,
        radius: float | None = None,
        eta: float = 0.5,
        hole_rim: float | None = None,
        web: float = 0.0,
    ) -> None:
        self.domain = validation.instance("density design: domain", domain, Domain, "a Domain")
        width = LEAST * domain.cell_size if hole_rim is None else hole_rim
        self.web = checked_web("density design", domain, web, width)
        rims = HoleRims(domain, width, outline=self.web > 0.0)
        #: Width of the solid rim around each hole of the body's drawing [m]
        self.hole_rim, self._rims = rims.width, rims
        points, weights = domain.quadrature_points(_POINTS)
        #: Share of each cell that is in a rim, (cells of all ranks,)
        self._rim_share = domain.everywhere(np.sum(weights * rims.contain(points), axis=1))
        self.filter = DensityFilter(domain, 2.5 * domain.cell_size if radius is None else radius)
        #: From means to densities
        self.projection = HeavisideProjection(SHARP, eta)
        self._designed = domain.everywhere(domain.design_cells)
        self._passive = domain.everywhere(domain.passive_density)
        self.size = int(np.count_nonzero(self._designed))

    @property
    def sharpness(self) -> float:  # type: ignore[override]
        """Steepness of the projection."""
        return self.projection.beta

    def at(self, progress: float) -> DensityDesign:
        design = copy(self)
        design.projection = HeavisideProjection(steepness(progress), self.projection.eta)
        return design

    def density(self, variables: Array) -> Array:
        x = self._without_rims(variables)
        x = np.where(self._designed, self._rim_share + (1.0 - self._rim_share) * x, x)
        return self.with_web(self.domain.owned(np.clip(x, 0.0, 1.0)))

    def _without_rims(self, variables: Array) -> Array:
        return np.where(self._designed, self.projection(self._means(variables)), self._passive)

    def pullback(self, variables: Array, x_bar: Array) -> Array:
        bar = np.where(self._designed, self.domain.everywhere(x_bar), 0.0)
        bar *= (1.0 - self.web) * (1.0 - self._rim_share)
        means_bar = self.projection.pullback(self._means(variables), bar)
        return self.filter.pullback(means_bar)[self._designed]

    def level(self, variables: Array) -> Callable[[ArrayLike], Array]:
        x = self.domain.owned(self._without_rims(variables))
        return self._rims.added_to(density_field(self.domain, x))

    def identity(self) -> dict[str, Any]:
        radius, eta = self.filter.radius, self.projection.eta
        sizes = {"radius": radius, "eta": eta, "hole_rim": self.hole_rim, "web": self.web}
        return {"cells": self.domain.n_cells_global, **sizes}

    def _means(self, variables: Array) -> Array:
        values = self._passive.copy()
        label = "density design: variables"
        values[self._designed] = validation.real_array(label, variables, (self.size,))
        return self.filter(values)
