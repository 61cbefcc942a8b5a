# SPDX-License-Identifier: MIT
"""The least value of an affine bound over all densities, at every point and not only in cells.

With x(X) in [0, 1] the least integral of x g over a cell is the integral of min(0, g). In affine
cells g is a polynomial, and min(0, .) is concave: with the Bernstein polynomials B_i, which are
positive and add up to one,

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
from ..fem import Domain
from .quasi_static import BodyHistory, StaticBody, Support

#: How often cells are divided; each time the error by quadrature falls to about a quarter. For a
#: rod of 200 x 20 elements a fourth time would raise the bound by 6e-5 of it.
_DIVISIONS = 3
#: Deviation from a polynomial, relative to the largest value, that is round-off of the derivatives
#: of a displacement: that of a field that is none is larger by orders of magnitude
_ROUND_OFF = 1e-9


class Bernstein:
    """Bernstein polynomials of a ``degree`` on a reference cell."""

    def __init__(self, cell: str, degree: int) -> None:
        self.simplex = cell in ("triangle", "tetrahedron")
        self.degree = degree
        self.dimension = 2 if cell in ("triangle", "quadrilateral") else 3
        powers = product(range(degree + 1), repeat=self.dimension)
        #: Exponents of each polynomial, (polynomials, dimension)
        self.exponents = np.array([k for k in powers if not self.simplex or sum(k) <= degree])
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
        n, values = self.degree, np.ones((len(points), len(self.exponents)))
        if self.simplex:
            inside = np.column_stack([points, 1.0 - points.sum(axis=1)])
            for column, k in enumerate(self.exponents):
                powers = (*k, n - sum(k))
                count = factorial(n) / prod(factorial(int(p)) for p in powers)
                values[:, column] = count * np.prod(inside**powers, axis=1)
            return values
        for column, k in enumerate(self.exponents):
            count = prod(comb(n, int(p)) for p in k)
            values[:, column] = count * np.prod(points**k * (1.0 - points) ** (n - k), axis=1)
        return values

    def coefficients(self, values: Array) -> Array:
        """From ``values`` at the lattice, shape (cells, polynomials)."""
        return values @ self._from_values.T

    def _parts(self) -> list[tuple[Array, Array]]:
        """Origin and edges, one a row, of the equal parts of a cell."""
        d, half = self.dimension, 0.5 * np.eye(self.dimension)
        if not self.simplex:
            return [(0.5 * np.array(corner), half) for corner in product((0, 1), repeat=d)]
        corners = np.vstack([np.zeros(d), np.eye(d)])
        at_corners = [(0.5 * corner, half) for corner in corners]
        # the remaining middle is a triangle, or an octahedron of four tetrahedra
        if d == 2:
            return [*at_corners, (np.array([0.5, 0.5]), -half)]
        a, b, c = 0.5 * np.eye(3)
        axis, around = b, [a, a + b, b + c, c]
        opposite = a + c
        inner = [
            (axis, np.array([corner, following, opposite]) - axis)
            for corner, following in zip(around, [*around[1:], around[0]], strict=True)
        ]
        return [*at_corners, *inner]


def refuse_curved_cells(domain: Domain) -> None:
    """Refuse, on every rank, a mesh in whose cells no displacement has a polynomial as strain."""
    _, shares = domain.quadrature_points(2)
    if domain.comm.allreduce(bool(np.any(np.abs(shares - shares[:1]) > _ROUND_OFF)), MPI.LOR):
        raise ValueError(
            "bound: the mesh has curved cells, or quadrilaterals that are no parallelograms, for "
            "which integrals are no lower bounds; take triangles of order 1"
        )


def least_over_cells(
    support: Support, bodies: Mapping[str, StaticBody], volume: Mapping[str, float]
) -> float:
    """The least value of an affine bound over densities that are constant in cells; collective."""
    value = support.constant
    for name, history in support.histories.items():
        domain = bodies[name].body.domain
        means = (history.integrals / domain.cell_volumes)[:, None]
        value += _least(domain, history.integrals, means, volume.get(name), None)
    return value


def least_over_points(
    support: Support, bodies: Mapping[str, StaticBody], volume: Mapping[str, float]
) -> float:
    """The least value of an affine bound over all densities, from below; collective.

    Raises:
        ValueError: On every rank, if g is no polynomial in a cell.
    """
    value = support.constant
    for name, history in support.histories.items():
        domain = bodies[name].body.domain
        basis = Bernstein(domain.cell, 2 * domain.order)
        coefficients = _coefficients(basis, bodies[name], history)
        value += _least(domain, history.integrals, coefficients, volume.get(name), basis)
    return value


def room_of(domain: Domain, share: float | None) -> float:
    """Volume that designed cells may have besides those that stay solid; inf without a bound."""
    if share is None:
        return np.inf
    return share * domain.area - domain.sum(domain.cell_volumes * domain.solid_cells)


def _least(
    domain: Domain,
    integrals: Array,
    coefficients: Array,
    share: float | None,
    basis: Bernstein | None,
) -> float:
    """The least integral of x g over a body, from below, that fills at most a ``share`` of it.

    Args:
        domain: The body, whose cells stay solid in part.
        integrals: Integrals of g over cells, shape (cells,).
        coefficients: Coefficients of g in cells, shape (cells, polynomials).
        share: None for any.
        basis: The polynomials of the coefficients; None where g is constant in each cell.
    """
    designed, sizes, room = domain.design_cells, domain.cell_volumes, room_of(domain, share)
    means = np.where(designed, coefficients.mean(axis=1), np.inf)
    cost = _multiplier(domain.everywhere(means), domain.everywhere(sizes), room)
    negative = _negative_part(basis, coefficients[designed] + cost, sizes[designed])
    solid = float(np.sum(integrals[domain.solid_cells]))
    return domain.sum(np.array(negative + solid)) - (cost * room if cost else 0.0)


def _multiplier(g: Array, sizes: Array, room: float) -> float:
    """The multiplier of the volume where x g is least for densities x in [0, 1] of cells.

    The cells have the mean ``g`` and the volumes ``sizes``; a total volume of ``room`` may be
    filled.
    """
    order = np.argsort(g)
    full = np.cumsum(sizes[order]) > room
    return max(0.0, -float(g[order][np.argmax(full)])) if np.any(full) else 0.0


def _coefficients(basis: Bernstein, body: StaticBody, history: BodyHistory) -> Array:
    """Coefficients of g in each cell, shape (cells, polynomials); collective."""
    domain = body.body.domain
    between = basis.lattice.mean(axis=0) + 0.07  # a point that is none of the lattice
    pairing = body.body.elasticity.solid_pairing(np.vstack([basis.lattice, between]))
    g = pairing(body.fields, -2.0 * history.loads, history.strains, -history.strains)
    coefficients = basis.coefficients(g[:, :-1])
    off = np.abs(coefficients @ basis(between[None])[0] - g[:, -1])
    odd = np.any(off > _ROUND_OFF * np.max(np.abs(g), initial=0.0))
    if domain.comm.allreduce(bool(odd), MPI.LOR):
        raise ValueError(
            "bound: the material varies within cells, for which integrals are no lower bounds; "
            "give the material constant numbers"
        )
    return coefficients


def _negative_part(basis: Bernstein | None, c: Array, sizes: Array) -> float:
    """Integral of min(0, .) over cells, from below.

    The polynomials have the coefficients ``c`` (cells, polynomials), the cells the volumes
    ``sizes`` (cells,).
    """
    total = 0.0
    for divisions_left in range(_DIVISIONS if basis else 0, -1, -1):
        # a polynomial lies between its smallest and its largest coefficient: where these have one
        # sign, or no division is left, the integral is taken, and else the cells are divided
        mixed = (c.min(axis=1) < 0.0) & (c.max(axis=1) > 0.0) & (divisions_left > 0)
        total += float(sizes[~mixed] @ np.minimum(c[~mixed], 0.0).mean(axis=1))
        if basis and divisions_left:
            c = np.concatenate([c[mixed] @ to_divided.T for to_divided in basis.divided])
            sizes = np.tile(sizes[mixed] / len(basis.divided), len(basis.divided))
    return total
