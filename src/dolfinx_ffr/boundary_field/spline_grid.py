# SPDX-License-Identifier: MIT
"""Cubic tensor B-splines on a uniform grid, whose fields are their own mirror images.

A field is phi(x) = sum_i c_i B_i(x). Such splines are a partition of unity and reproduce linear
functions, so a field lies in the convex hull of its coefficients near each point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, identity, kron
from scipy.spatial import cKDTree

from ..arrays import Array, Integers
from ..design import Isometry
from ..fem import connected

#: Coefficients beyond the box around a body that count inside of it, and one more for its sides
_PADDING = 2


@dataclass(frozen=True, eq=False)
class SplineGrid:
    """A space of spline fields; its variables are the coefficients that are no mirror images."""

    center: Array  #: A node of the grid that all isometries leave, (d,) [m]
    axes: Array  #: Directions of the grid as rows, orthonormal, (d, d)
    half: Integers  #: Number of nodes on each side of the center, (d,)
    spacing: float  #: [m]
    masters: csr_matrix  #: Ones that give each coefficient its variable, (coefficients, variables)

    @staticmethod
    def around(
        corners: Array, spacing: float, isometries: Sequence[Isometry], axes: Array
    ) -> SplineGrid:
        """The grid whose splines cover the box of ``corners`` (n, d) [m].

        A ValueError says that an isometry does not map the grid to itself.
        """
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        # the mean of all images of a point is a point that all isometries leave
        center = np.mean([g(middle[None])[0] for g in isometries], axis=0)
        reach = np.max(np.abs((corners - center) @ axes.T), axis=0)
        half = np.ceil(reach / spacing - 1e-9).astype(np.int64) + _PADDING
        nodes = _nodes(center, axes, half, spacing)
        tree = cKDTree(nodes)
        pairs = [np.column_stack([np.arange(len(nodes))] * 2)]
        for isometry in isometries[1:]:
            distance, image = tree.query(isometry(nodes))
            if np.max(distance) > 1e-6 * spacing:
                raise ValueError(
                    "boundary: mirror lines must be parallel, perpendicular or at 45 degrees to "
                    "the first one; leave others out"
                )
            pairs.append(np.column_stack([np.arange(len(nodes)), image]))
        number = connected(np.vstack(pairs), len(nodes))
        ones = np.ones(len(nodes)), (np.arange(len(nodes)), number)
        return SplineGrid(center, axes, half, spacing, csr_matrix(ones))

    @property
    def size(self) -> int:
        """Number of variables."""
        return int(self.masters.shape[1])

    @property
    def dimension(self) -> int:
        """Two in the plane, three in space."""
        return len(self.half)

    @cached_property
    def leaders(self) -> Integers:
        """The first coefficient of each variable, (variables,)."""
        first = np.unique(self.masters.indices, return_index=True)[1]
        return np.asarray(first, dtype=np.int64)

    @cached_property
    def nodes(self) -> Array:
        """Where the coefficient of each variable stands, (variables, d) [m]."""
        return _nodes(self.center, self.axes, self.half, self.spacing)[self.leaders]

    def rows(self, points: Array) -> csr_matrix:
        """The shares of the variables in the field at ``points`` (n, d) [m], (n, variables)."""
        shares, columns = self._shares(points, 0)
        return self._matrix(shares[0], columns)

    def slope_rows(self, points: Array, ways: Array) -> csr_matrix:
        """Their shares in its derivative along ``ways`` (n, d) at points, (n, variables)."""
        shares, columns = self._shares(points, 1)
        return self._matrix(np.einsum("inc,ni->nc", shares[1], ways), columns)

    def bend_rows(self, points: Array, bends: Array, ways: Array, values: Array) -> csr_matrix:
        """Their shares in a sum of its second and first derivatives and its value at points.

        Args:
            points: (n, d) [m].
            bends: Factors of the second derivatives, (n, d, d).
            ways: Factors of the first derivatives, (n, d).
            values: Factors of the value, (n,).
        """
        shares, columns = self._shares(points, 2)
        total = shares[0] * values[:, None] + np.einsum("inc,ni->nc", shares[1], ways)
        return self._matrix(total + np.einsum("ijnc,nij->nc", shares[2], bends), columns)

    def value(self, variables: Array, points: Array) -> Array:
        """The field of some ``variables`` at ``points`` (n, d) [m], (n,)."""
        return self.derivatives(variables, points, 0)[0]

    def gradient(self, variables: Array, points: Array) -> Array:
        """The gradient of that field, (n, d) [1/m]."""
        return self.derivatives(variables, points, 1)[1]

    def derivatives(self, variables: Array, points: Array, order: int) -> list[Array]:
        """The value of that field (n,), its gradient (n, d) and its bends (n, d, d) at points.

        They are given up to an ``order``: 0, 1 or 2 [1, 1/m, 1/m^2].
        """
        shares, columns = self._shares(points, order)
        coefficients = variables[columns]
        sums = ("nc,nc->n", "inc,nc->ni", "ijnc,nc->nij")[: order + 1]
        return [np.einsum(s, x, coefficients) for s, x in zip(sums, shares, strict=True)]

    @cached_property
    def integrals(self) -> tuple[csc_matrix, csc_matrix]:
        """Matrices of int v^2 / h and of h int |grad v|^2 over the box of the grid, [m^(d-1)].

        h is the spacing; two midpoints a spacing and direction are enough for a metric.
        """
        ticks = [self.spacing * (np.arange(-2 * n + 2.5, 2 * n - 2, 1.0) / 2.0) for n in self.half]
        steps = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1)
        points = self.center + steps.reshape(-1, self.dimension) @ self.axes
        weight = (0.5 * self.spacing) ** self.dimension
        value = self.rows(points)
        mass = (weight / self.spacing) * (value.T @ value)
        units = np.eye(self.dimension)
        slopes = [self.slope_rows(points, np.tile(unit, (len(points), 1))) for unit in units]
        stiffness = sum(slope.T @ slope for slope in slopes)
        return csc_matrix(mass), csc_matrix(weight * self.spacing * stiffness)

    @cached_property
    def bending(self) -> csc_matrix:
        """Matrix of the squared second differences of coefficients: zero for linear fields."""
        total = csr_matrix((self.size, self.size))
        pairs = [(i, j) for i in range(self.dimension) for j in range(self.dimension)]
        for i, j in pairs:
            whole = csr_matrix([[1.0]])
            for k, count in enumerate(2 * self.half + 1):
                along = identity(count, format="csr")
                for _ in range((i == k) + (j == k)):
                    along = along[1:] - along[:-1]
                whole = kron(whole, along, format="csr")
            whole = whole @ self.masters
            total = total + whole.T @ whole
        return csc_matrix(total)

    def _places(self, points: Array) -> tuple[Array, Integers]:
        """Where points are in the middle span of their splines, and the variables of these."""
        where = ((points - self.center) @ self.axes.T) / self.spacing + self.half
        counts = 2 * self.half + 1
        # beyond the grid fields go on as polynomials
        first = np.clip(np.floor(where).astype(np.int64), 1, counts - 3)
        columns = np.zeros((len(points), 1), dtype=np.int64)
        for k, count in enumerate(counts):
            number = first[:, k, None] + np.arange(-1, 3)
            columns = columns[:, :, None] * count + number[:, None, :]
            columns = columns.reshape(len(points), 4 ** (k + 1))
        return where - first, self.masters.indices[columns]

    def _shares(self, points: Array, order: int) -> tuple[list[Array], Integers]:
        """The shares of splines in the value and its derivatives, and the variables of these.

        The value (n, 4^d), slopes (d, n, 4^d) [1/m] and bends (d, d, n, 4^d) [1/m^2], up to an
        ``order``; the variables (n, 4^d).
        """
        where, columns = self._places(points)
        splines = [
            [_splines(where[:, k], m) / self.spacing**m for m in range(order + 1)]
            for k in range(self.dimension)
        ]

        def product(orders: Array) -> Array:
            shares = np.ones((len(points), 1))
            for k, m in enumerate(orders.tolist()):
                shares = shares[:, :, None] * splines[k][m][:, None, :]
                shares = shares.reshape(len(points), 4 ** (k + 1))
            return shares

        unit, axes = np.eye(self.dimension, dtype=np.int64), self.axes
        total = [product(np.zeros(self.dimension, dtype=np.int64))]
        if order > 0:
            slopes = np.array([product(i) for i in unit])
            total.append(np.einsum("ki,knc->inc", axes, slopes))
        if order > 1:
            bends = np.array([[product(i + j) for j in unit] for i in unit])
            total.append(np.einsum("ki,lj,klnc->ijnc", axes, axes, bends, optimize=True))
        return total, columns

    def _matrix(self, shares: Array, columns: Integers) -> csr_matrix:
        ends = np.arange(0, shares.size + 1, columns.shape[1])
        # at a mirror line both images of a coefficient count
        entries = shares.flatten(), columns.flatten(), ends
        rows = csr_matrix(entries, (len(shares), self.size))
        rows.sum_duplicates()
        return rows


def _nodes(center: Array, axes: Array, half: Integers, spacing: float) -> Array:
    """All nodes of a grid, the last direction fastest, (coefficients, d) [m]."""
    steps = np.meshgrid(*[np.arange(-n, n + 1) for n in half], indexing="ij")
    return np.asarray(center + spacing * np.stack(steps, axis=-1).reshape(-1, len(half)) @ axes)


def _splines(t: Array, derivative: int) -> Array:
    """The four cubic B-splines, or a derivative of them, at ``t`` within their middle span."""
    u = 1.0 - t
    if derivative == 0:
        parts = [u**3, 4.0 - 6.0 * t**2 + 3.0 * t**3, 4.0 - 6.0 * u**2 + 3.0 * u**3, t**3]
    elif derivative == 1:
        parts = [-3.0 * u**2, 9.0 * t**2 - 12.0 * t, 3.0 + 6.0 * t - 9.0 * t**2, 3.0 * t**2]
    else:
        parts = [6.0 * u, 18.0 * t - 12.0, 6.0 - 18.0 * t, 6.0 * t]
    return np.stack(parts, axis=1) / 6.0
