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
        where, columns = self._places(points)
        return self._matrix(self._shares(where, (0,) * self.dimension), columns)

    def slope_rows(self, points: Array) -> list[csr_matrix]:
        """Their shares in the d components of its gradient, (n, variables) [1/m] each."""
        where, columns = self._places(points)
        return [self._matrix(shares, columns) for shares in self._slopes(where)]

    def bend_rows(self, points: Array) -> list[list[csr_matrix]]:
        """Their shares in the second derivatives, d by d of (n, variables) [1/m^2]."""
        where, columns = self._places(points)
        return [[self._matrix(s, columns) for s in row] for row in self._bends(where)]

    def value(self, variables: Array, points: Array) -> Array:
        """The field of some ``variables`` at ``points`` (n, d) [m], (n,)."""
        where, columns = self._places(points)
        shares = self._shares(where, (0,) * self.dimension)
        return np.asarray(np.sum(shares * variables[columns], axis=1))

    def gradient(self, variables: Array, points: Array) -> Array:
        """The gradient of that field, (n, d) [1/m]."""
        where, columns = self._places(points)
        return np.einsum("inc,nc->ni", self._slopes(where), variables[columns])

    def bend(self, variables: Array, points: Array) -> Array:
        """The second derivatives of that field, (d, d, n) [1/m^2]."""
        where, columns = self._places(points)
        return np.einsum("ijnc,nc->ijn", self._bends(where), variables[columns])

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
        stiffness = sum(slope.T @ slope for slope in self.slope_rows(points))
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

    def _shares(self, where: Array, order: Sequence[int]) -> Array:
        """Products of splines, or of their derivatives, along the axes of the grid, (n, 4^d)."""
        shares = np.ones((len(where), 1))
        for k, derivative in enumerate(order):
            along = _splines(where[:, k], derivative) / self.spacing**derivative
            shares = shares[:, :, None] * along[:, None, :]
            shares = shares.reshape(len(where), 4 ** (k + 1))
        return shares

    def _slopes(self, where: Array) -> Array:
        """Shares in the components of the gradient, (d, n, 4^d) [1/m]."""
        unit = np.eye(self.dimension, dtype=np.int64)
        along = np.array([self._shares(where, order) for order in unit])
        return np.einsum("ki,knc->inc", self.axes, along)

    def _bends(self, where: Array) -> Array:
        """Shares in the second derivatives, (d, d, n, 4^d) [1/m^2]."""
        unit = np.eye(self.dimension, dtype=np.int64)
        along = np.array([[self._shares(where, tuple(i + j)) for j in unit] for i in unit])
        return np.einsum("ki,lj,klnc->ijnc", self.axes, self.axes, along, optimize=True)

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
