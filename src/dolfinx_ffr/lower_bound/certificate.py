# SPDX-License-Identifier: MIT
"""The least value of an affine bound over all densities, at every point and not only in cells.

With x(X) in [0, 1] the least integral of x g over a cell is that of min(0, g). In affine cells g is
a polynomial, and min(0, .) is concave: with the Bernstein polynomials B_i, which are positive and
add up to one,

    min(0, sum_i c_i B_i) >= sum_i min(0, c_i) B_i,

whose integral is the mean of min(0, c_i) times the volume. So the quadrature errs on the safe side,
and where g changes its sign cells are divided until it errs little.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from math import comb, factorial, prod

from mpi4py import MPI

import numpy as np

from ..arrays import Array
from .quasi_static import BodyHistory, StaticBody
from .sheet import Support, multiplier, room_of

#: How often cells are divided; each time the error by quadrature falls to about a quarter
_DIVISIONS = 3
#: Deviation from a polynomial, relative to the largest value, that is round-off
_ROUND_OFF = 1e-9


class Bernstein:
    """Bernstein polynomials of a ``degree`` on a reference cell."""

    def __init__(self, cell: str, degree: int) -> None:
        self.simplex = cell in ("triangle", "tetrahedron")
        self.degree = degree
        self.dimension = 2 if cell in ("triangle", "quadrilateral") else 3
        every = product(range(degree + 1), repeat=self.dimension)
        #: Exponents of each polynomial, (polynomials, dimension)
        self.exponents = np.array([k for k in every if not self.simplex or sum(k) <= degree])
        #: Points at which values determine a polynomial
        self.lattice = self.exponents / degree
        self._from_values = np.linalg.inv(self(self.lattice))
        #: Maps from coefficients on a cell to those on the cells into which it is divided
        self.divided = [
            self._from_values @ self(origin + self.lattice @ edges)
            for origin, edges in self._parts()
        ]

    def __call__(self, points: Array) -> Array:
        """Values at ``points`` (points, dimension) of the reference cell, (points, polynomials)."""
        n, found = self.degree, np.ones((len(points), len(self.exponents)))
        if self.simplex:
            inside = np.column_stack([points, 1.0 - points.sum(axis=1)])
            for column, k in enumerate(self.exponents):
                powers = (*k, n - sum(k))
                count = factorial(n) / prod(factorial(int(p)) for p in powers)
                found[:, column] = count * np.prod(inside**powers, axis=1)
            return found
        for column, k in enumerate(self.exponents):
            count = prod(comb(n, int(p)) for p in k)
            found[:, column] = count * np.prod(points**k * (1.0 - points) ** (n - k), axis=1)
        return found

    def coefficients(self, values: Array) -> Array:
        """From ``values`` at the lattice, shape (cells, polynomials)."""
        return values @ self._from_values.T

    def _parts(self) -> list[tuple[Array, Array]]:
        """Origin and edges, one a row, of the equal parts of a cell."""
        d, half = self.dimension, 0.5 * np.eye(self.dimension)
        if not self.simplex:
            return [(0.5 * np.array(corner), half) for corner in product((0, 1), repeat=d)]
        corners = np.vstack([np.zeros(d), np.eye(d)])
        parts = [(0.5 * corner, half) for corner in corners]
        # what is left in the middle is a triangle, or an octahedron of four tetrahedra
        if d == 2:
            return [*parts, (np.array([0.5, 0.5]), -half)]
        a, b, c = 0.5 * np.eye(3)
        axis, around = b, [a, a + b, b + c, c]
        opposite = a + c
        for first, second in zip(around, [*around[1:], around[0]], strict=True):
            parts.append((axis, np.array([first - axis, second - axis, opposite - axis])))
        return parts


def certified(
    support: Support, bodies: Mapping[str, StaticBody], volume: Mapping[str, float]
) -> float:
    """The least value of an affine bound over all densities at points, from below; collective.

    Raises:
        ValueError: On every rank, if a mesh has cells in which g is no polynomial.
    """
    value = support.constant
    for name, body in bodies.items():
        domain = body.body.domain
        integrals = np.sum(support.slopes[name], axis=0)
        value += domain.sum(np.where(domain.solid_cells, integrals, 0.0))
        basis = Bernstein(domain.cell, 2 * domain.order)
        coefficients = _coefficients(basis, body, support.histories[name])
        room = room_of(domain, volume.get(name))
        designed = domain.design_cells
        means = np.where(designed, coefficients.mean(axis=1), np.inf)
        cost = multiplier(domain.everywhere(means), domain.everywhere(domain.cell_volumes), room)
        sizes = domain.cell_volumes[designed]
        value += domain.sum(np.array(_least(basis, coefficients[designed] + cost, sizes)))
        value -= cost * room if cost else 0.0
    return value


def _coefficients(basis: Bernstein, body: StaticBody, history: BodyHistory) -> Array:
    """Coefficients of g in each cell, shape (cells, polynomials); collective."""
    domain = body.body.domain
    between = basis.lattice.mean(axis=0) + 0.07  # a point that is none of the lattice
    pairing = body.body.elasticity.solid_pairing(np.vstack([basis.lattice, between]))
    g = pairing(body.fields, -2.0 * history.loads, history.strains, -history.strains)
    coefficients = basis.coefficients(g[:, :-1])
    off = np.abs(coefficients @ basis(between[None])[0] - g[:, -1])
    _, shares = domain.quadrature_points(2)
    curved = np.any(off > _ROUND_OFF * np.max(np.abs(g), initial=0.0))
    curved |= np.any(np.abs(shares - shares[:1]) > _ROUND_OFF)
    if domain.comm.allreduce(bool(curved), MPI.LOR):
        raise ValueError(
            "bound: the mesh has curved cells, or quadrilaterals that are no parallelograms, over "
            "which the bound cannot be integrated on the safe side; take triangles of order 1"
        )
    return coefficients


def _least(basis: Bernstein, c: Array, sizes: Array) -> float:
    """Integral of min(0, .) over cells, from below, of coefficients ``c`` and volumes ``sizes``."""
    total = 0.0
    for division in range(_DIVISIONS + 1):
        mixed = (c.min(axis=1) < 0.0) & (c.max(axis=1) > 0.0) & (division < _DIVISIONS)
        total += float(sizes[~mixed] @ np.minimum(c[~mixed], 0.0).mean(axis=1))
        c = np.concatenate([c[mixed] @ part.T for part in basis.divided])
        sizes = np.tile(sizes[mixed] / len(basis.divided), len(basis.divided))
    return total
