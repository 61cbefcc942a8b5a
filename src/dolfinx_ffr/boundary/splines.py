# SPDX-License-Identifier: MIT
"""Fields on a grid of uniform tensor-product cubic B-splines in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter
from scipy.sparse import csc_matrix, csr_matrix, eye, kron
from scipy.sparse.linalg import lsmr
from scipy.spatial import cKDTree

from ..arrays import Array, Integers
from ..fem import ShapeError
from .fields import Field, contour

#: Step of central differences, in spacings of the grid: its error is near that of round-off
DIFFERENCE = 1e-4


@dataclass(frozen=True, eq=False)
class SplineGrid:
    """A regular grid with a cubic B-spline at each node, and a coarser one for motions.

    The *coarse* splines have every second node of each line.
    """

    low: Array  #: First node, (3,) [m]
    spacing: Array  #: (3,) [m]
    shape: tuple[int, int, int]  #: Numbers of nodes

    @property
    def nodes(self) -> Array:
        """Places of all nodes, (nodes, 3) [m]."""
        return np.asarray(self.low + self.spacing * np.indices(self.shape).reshape(3, -1).T)

    # ------------------------------------------------------------------ values

    def values(self, coefficients: Array, x: Array) -> Array:
        """Values (n,) of the spline at points x (n, 3) [m]; coefficients have the grid's shape."""
        grid_coordinates = (x - self.low) / self.spacing
        values = map_coordinates(
            coefficients, grid_coordinates.T, order=3, prefilter=False, mode="nearest"
        )
        return np.asarray(values)

    def basis(self, x: Array) -> csr_matrix:
        """Values (n, nodes) of the B-splines of all nodes at points x (n, 3) [m]."""
        weights, _, (i, j, k) = self._along_axes(x)
        _, n_y, n_z = self.shape
        values = np.einsum("ni,nj,nk->nijk", *weights).reshape(len(x), 64)
        columns = (i[:, :, None, None] * n_y + j[:, None, :, None]) * n_z + k[:, None, None]
        rows = np.repeat(np.arange(len(x)), 64)
        size = len(x), int(np.prod(self.shape))
        return csr_matrix((values.ravel(), (rows, columns.ravel())), shape=size)

    def gradients(self, coefficients: Array, x: Array) -> Array:
        """Gradients (n, 3) of the spline with these coefficients at points x (n, 3) [m]."""
        (u, v, w), (du, dv, dw), (i, j, k) = self._along_axes(x)
        local = coefficients[i[:, :, None, None], j[:, None, :, None], k[:, None, None]]

        # the sum over the third axis is common to the first two components
        of_w, of_dw = (np.einsum("nijk,nk->nij", local, factor) for factor in (w, dw))
        components = [
            np.einsum("nij,nj,ni->n", *factors, optimize=True)
            for factors in ((of_w, v, du), (of_w, dv, u), (of_dw, v, u))
        ]
        return np.stack(components, axis=1)

    def _along_axes(self, x: Array) -> tuple[list[Array], list[Array], list[Integers]]:
        """The four B-splines at points (n, 3) along each axis.

        Returned are, for each axis, values and derivatives [1/m] and numbers of the nodes, shape
        (n, 4) each. The splines are polynomials of the distances t from the knot before a point and
        s from the knot after it, in spacings.
        """
        grid_coordinates = (x - self.low) / self.spacing
        values, derivatives, numbers = [], [], []
        for axis, count in enumerate(self.shape):
            knot = np.floor(grid_coordinates[:, axis])
            t = grid_coordinates[:, axis] - knot
            s = 1.0 - t

            splines = [s**3, 4.0 - 6.0 * t**2 + 3.0 * t**3, 4.0 - 6.0 * s**2 + 3.0 * s**3, t**3]
            values.append(np.stack(splines, axis=1) / 6.0)
            slopes = [-0.5 * s**2, 1.5 * t**2 - 2.0 * t, 0.5 + t - 1.5 * t**2, 0.5 * t**2]
            derivatives.append(np.stack(slopes, axis=1) / self.spacing[axis])

            number = knot[:, None].astype(np.int64) + np.arange(-1, 3)
            numbers.append(np.clip(number, 0, count - 1))  # as `map_coordinates` does
        return values, derivatives, numbers

    def interpolated(self, values: Array) -> Array:
        """Coefficients, of the grid's shape, of the spline through ``values`` (nodes,)."""
        return np.asarray(spline_filter(values.reshape(self.shape), mode="mirror"))

    def fitted(self, field: Field, iterations: int) -> Array:
        """Coefficients of the spline that has a field's zero surface and is near the distance."""
        nodes, spacing = self.nodes, self.spacing
        points = contour(field, self.low, nodes[-1], 0.5 * spacing)
        if not len(points):
            raise ShapeError("surface: the field has no zero surface to move")

        # off the contour of linear pieces the first-order distance is exact on the field's zero
        # surface
        steps = np.diag(DIFFERENCE * spacing)
        slopes = [(field(points + s) - field(points - s)) / (2.0 * s.sum()) for s in steps]
        slope_length = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
        point_distance = np.clip(field(points) / slope_length, -spacing.min(), spacing.min())
        normals = (slopes / slope_length).T

        _, nearest = cKDTree(points).query(nodes)
        surface_points = points - point_distance[:, None] * normals
        displacement = nodes - surface_points[nearest]
        length = np.linalg.norm(displacement, axis=1)
        along_normal = np.einsum("nd,nd->n", displacement, normals[nearest])
        # from the plane at the nearest point, but for nodes beyond an edge of the surface
        tangential = np.sqrt(np.maximum(length**2 - along_normal**2, 0.0))
        is_beside = tangential < 0.5 * spacing.min()
        node_distance = np.where(is_beside, np.abs(along_normal), length)
        node_distance *= np.where(field(nodes) > 0.0, 1.0, -1.0)

        rows = self.basis(np.vstack([nodes, points]))
        right = np.concatenate([node_distance, point_distance])
        tolerance = {"atol": 1e-8, "btol": 1e-8}
        coefficients = lsmr(rows, right, x0=node_distance, maxiter=iterations, **tolerance)[0]
        return np.asarray(coefficients.reshape(self.shape))

    # ------------------------------------------------------------------ coarse splines

    @cached_property
    def _refinements(self) -> list[csr_matrix]:
        return [_refinement(count) for count in self.shape]

    @cached_property
    def refinement(self) -> csr_matrix:
        """From coefficients of coarse splines to those of all, (nodes, coarse splines)."""
        x, y, z = self._refinements
        return csr_matrix(kron(kron(x, y), z))

    def coarse_metric(self, length: float) -> csc_matrix:
        """1 + length^2 times second differences of coarse coefficients, a length in [m]."""
        counts = [line.shape[1] for line in self._refinements]
        bending = []
        for count, spacing in zip(counts, self.spacing, strict=True):
            differences = np.diff(np.eye(count), axis=0)
            scale = (length / (2.0 * spacing)) ** 2  # the coarse spacing is twice the fine one
            bending.append(csr_matrix(scale * differences.T @ differences))

        identity = [eye(count) for count in counts]
        metric = eye(self.refinement.shape[1])
        metric = metric + kron(kron(bending[0], identity[1]), identity[2])
        metric = metric + kron(kron(identity[0], bending[1]), identity[2])
        return csc_matrix(metric + kron(kron(identity[0], identity[1]), bending[2]))


def _refinement(count: int) -> csr_matrix:
    """From B-splines on every second knot of a line to those on all, (count, about half)."""
    n_coarse = (count - 1) // 2 + 3  # from the one before the first knot to that after the last
    weights: Sequence[float] = (0.125, 0.5, 0.75, 0.5, 0.125)
    table = np.zeros((count, n_coarse))
    for j in range(n_coarse):
        for step, weight in zip(range(-2, 3), weights, strict=True):
            i = 2 * (j - 1) + step + 1
            if 0 <= i < count:
                table[i, j] += weight
    return csr_matrix(table[:, np.any(table, axis=0)])
