# SPDX-License-Identifier: MIT
"""A level set of radial basis functions, and the density that it gives each element.

The body's material is where phi(X) = sum_j alpha_j g(|X - X_j|) is positive. The knots X_j are a
regular grid of their own or given points, whatever the mesh. The density of an element is its fill
fraction, the mean of a smoothed Heaviside function over the element's area,

    x_e = sum_q w_q H(phi(X_q) / width),     H(s) = 1/2 + 15/16 (s - 2/3 s^3 + 1/5 s^5), |s| < 1,

so that the derivative with respect to the coefficients is exact. Cells that are not designed are
solid. Coefficients are replicated: every rank holds all of them, bit-identical.

References:
    S. Wang and M. Y. Wang, International Journal for Numerical Methods in Engineering 65 (2006),
    doi:10.1002/nme.1536.
    P. Wei, Z. Li, X. Li and M. Y. Wang, Structural and Multidisciplinary Optimization 58 (2018),
    doi:10.1007/s00158-018-1904-8.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from mpi4py import MPI

import contourpy
import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from .domain import Domain
from .rbf import Kernel, RadialBasis, Wendland

__all__ = ["LevelSet"]

Array = NDArray[np.float64]

#: entries of the largest dense matrix that a rank may hold (4 GB)
LARGEST = 2**29


class LevelSet:
    """phi on knots over a body, and the fill fraction of the body's elements.

    Args:
        domain: the body.
        knots: shape (knots, 2) [m], the same on every rank; by default a regular grid over the
            body's bounding box.
        spacing: distance of the grid's knots [m]; by default the size of a mean element. With
            given knots it is the resolution at which the zero line is drawn, by default their
            median distance.
        kernel: radial basis function; by default Wendland's with a radius of three spacings. The
            matrices of a global kernel are dense: take a spacing of two or more elements with it.
        width: half-width of the smoothed Heaviside function in units of phi, which re-initialised
            is a distance [m]; by default the size of a mean element.
        quadrature: points in each direction of an element.

    Raises:
        ValueError: on every rank, if there are no knots, a length is not positive, the spacing
            leaves fewer than three knots across the body, the kernel does not reach from knot to
            knot, the knots do not cover the body, or a dense matrix would not fit into memory.
    """

    def __init__(
        self,
        domain: Domain,
        *,
        knots: ArrayLike | None = None,
        spacing: float | None = None,
        kernel: Kernel | None = None,
        width: float | None = None,
        quadrature: int = 3,
    ) -> None:
        self.domain = domain
        #: size of a mean element [m]
        self.element = float(np.sqrt(domain.area / domain.n_cells_global))
        for name, value in (("spacing", spacing), ("width", width)):
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"level set: {name} = {value} must be a positive length [m]")
        if int(quadrature) != quadrature or quadrature < 1:
            raise ValueError(f"level set: quadrature = {quadrature} must be a whole number above 0")
        given = None if knots is None else _check_knots(knots)
        wanted = spacing
        if wanted is None:
            wanted = self.element if given is None else _median_distance(given)
        low, high = domain.bounding_box
        counts = np.rint((high - low) / wanted).astype(int) + 1
        if counts.min() < 3:
            raise ValueError(
                f"level set: spacing = {wanted:.4g} m leaves fewer than 3 knots across the body of "
                f"{high[0] - low[0]:.4g} m x {high[1] - low[1]:.4g} m; take a smaller one"
            )
        #: coordinates of the columns and rows of the grid on which the zero line is drawn [m]; by
        #: default the knots form this grid, column by column
        self.grid = (
            np.linspace(low[0], high[0], counts[0]),
            np.linspace(low[1], high[1], counts[1]),
        )
        #: distance of neighbouring grid points [m]
        self.spacing = float(max(g[1] - g[0] for g in self.grid))
        #: half-width of the smoothed Heaviside function [m]
        self.width = self.element if width is None else float(width)
        grid = np.column_stack([x.ravel() for x in np.meshgrid(*self.grid, indexing="ij")])
        points, self._weights = domain.quadrature_points(quadrature)
        kernel = kernel or Wendland(3.0 * self.spacing)
        self._check_memory(kernel, self._weights.size, len(grid if given is None else given))
        self.basis = RadialBasis(grid if given is None else given, kernel)
        self._matrix = self.basis.matrix(points.reshape(-1, 2))
        self._check_cover()
        self._knot_matrix = self.basis.matrix(self.knots)
        self._grid_matrix = self._knot_matrix if given is None else self.basis.matrix(grid)

    def _check_memory(self, kernel: Kernel, points: int, knots: int) -> None:
        largest = self.domain.comm.allreduce(points, MPI.MAX)
        if math.isinf(kernel.support) and largest * knots > LARGEST:
            raise ValueError(
                f"level set: a global kernel on {knots} knots makes a dense matrix of "
                f"{8e-9 * largest * knots:.1f} GB; take a larger spacing, fewer quadrature points, "
                "or a compactly supported kernel"
            )

    def _check_cover(self) -> None:
        if not isinstance(self._matrix, scipy.sparse.csr_matrix):
            return
        reached = np.where(np.diff(self._matrix.indptr) > 0, 1.0, 0.0)
        bare = 1.0 - self.domain.sum(reached) / self.domain.sum(np.ones(len(reached)))
        if bare:
            raise ValueError(
                f"level set: {100.0 * bare:.2g} % of the body is beyond the reach of all "
                "knots; add knots there or take a kernel with a larger radius"
            )

    @property
    def knots(self) -> Array:
        """Positions of the knots, shape (knots, 2) [m]."""
        return self.basis.knots

    # ------------------------------------------------------------------ density

    def fill_fraction(self, coefficients: ArrayLike) -> Array:
        """Return the density of each cell owned by this rank, shape (cells,), in [0, 1].

        Args:
            coefficients: alpha, shape (knots,).

        Raises:
            ValueError: if there is not one finite coefficient a knot.
        """
        phi = self._at_points(coefficients)
        x = np.einsum("cq,cq->c", self._weights, _heaviside(phi / self.width))
        # the mean of values in [0, 1] may leave it by round-off
        return np.where(self.domain.design_cells, np.clip(x, 0.0, 1.0), 1.0)

    def pullback(self, coefficients: ArrayLike, x_bar: Array) -> Array:
        """Return the transpose of the derivative of `fill_fraction`.

        Args:
            coefficients: alpha, shape (knots,).
            x_bar: derivative with respect to the density of this rank's cells, shape (cells,).

        Returns:
            Derivative with respect to the coefficients, shape (knots,), summed over the ranks and
            bit-identical on each.
        """
        phi = self._at_points(coefficients)
        slope = _heaviside_slope(phi / self.width) / self.width
        bar = np.where(self.domain.design_cells, x_bar, 0.0)[:, None] * self._weights * slope
        local = np.ascontiguousarray(self._matrix.T @ bar.ravel())
        return self._sum(local)

    def volume(self, coefficients: ArrayLike) -> float:
        """Return the filled share of the body's area at ``coefficients``, alike on every rank."""
        filled = self.fill_fraction(coefficients) * self.domain.cell_volumes
        return self.domain.sum(filled) / self.domain.area

    def _at_points(self, coefficients: ArrayLike) -> Array:
        return np.asarray(self._matrix @ self._check(coefficients)).reshape(self._weights.shape)

    def _check(self, coefficients: ArrayLike) -> Array:
        alpha = np.asarray(coefficients, dtype=np.float64)
        if alpha.shape != (len(self.knots),) or not np.all(np.isfinite(alpha)):
            raise ValueError(
                f"level set: expected {len(self.knots)} finite coefficients, one a knot, and got "
                f"an array of shape {alpha.shape}"
                + ("" if np.all(np.isfinite(alpha)) else " with NaN or infinity")
            )
        return alpha

    def _sum(self, local: Array) -> Array:
        comm: MPI.Comm = self.domain.comm
        total = np.empty_like(local)
        comm.Reduce(local, total, root=0)
        comm.Bcast(total, root=0)
        return total

    # ------------------------------------------------------------------ phi on the knots

    def interpolate(self, phi: ArrayLike | Callable[[Array], Array]) -> Array:
        """Return the coefficients of a function given at the knots.

        Args:
            phi: values at the knots, shape (knots,) [m], or a function of positions (n, 2) [m].
        """
        return self.basis.interpolate(phi(self.knots) if callable(phi) else phi)

    def at_knots(self, coefficients: ArrayLike) -> Array:
        """Return phi at the knots for ``coefficients`` (knots,), shape (knots,) [m]."""
        return np.asarray(self._knot_matrix @ self._check(coefficients))

    def on_grid(self, coefficients: ArrayLike) -> Array:
        """Return phi on `grid` for ``coefficients`` (knots,), shape (columns, rows) [m]."""
        values = np.asarray(self._grid_matrix @ self._check(coefficients))
        return values.reshape(len(self.grid[0]), len(self.grid[1]))

    def with_holes(
        self, columns: int, rows: int, radius: float, *, margin: float | None = None
    ) -> Array:
        """Return a start design: solid with staggered round holes, mirror-symmetric about the axis.

        Args:
            columns: holes along the longer side of the body's bounding box.
            rows: holes across.
            radius: of the holes [m]; zero leaves the body solid.
            margin: distance of the outermost rows' centers from the longer sides [m]; by default
                half the distance between rows.

        Returns:
            Coefficients of the signed distance, shape (knots,).
        """
        if columns < 1 or rows < 1 or not radius >= 0.0:
            raise ValueError(
                f"level set: {columns} x {rows} holes of radius {radius} m; take at least one, and "
                "a radius of at least zero"
            )
        low, high = self.domain.bounding_box
        long = int(np.argmax(high - low))
        length, height = (high - low)[long], (high - low)[1 - long]
        edge = height / (2 * rows) if margin is None else margin
        across = np.linspace(edge, height - edge, rows) if rows > 1 else np.array([height / 2])
        pitch = length / columns
        centers = []
        for row, offset in enumerate(across):
            # staggered, and alike on both sides of the middle row
            shift = 0.5 * (min(row, rows - 1 - row) % 2)
            for column in range(-1, columns + 1):
                center = np.empty(2)
                center[long] = low[long] + (column + 0.5 + shift) * pitch
                center[1 - long] = low[1 - long] + offset
                centers.append(center)
        distance = cKDTree(np.array(centers)).query(self.knots)[0] - radius
        return self.interpolate(np.minimum(distance, radius + pitch))

    def signed_distance(self, phi: ArrayLike) -> Array:
        """Return the signed distance from the zero line of phi, at the knots.

        The zero line is the polygon along which phi, bilinear on `grid`, is zero.

        Args:
            phi: values at the knots, shape (knots,).

        Returns:
            Values at the knots, shape (knots,) [m]; ``phi`` itself where it has no zero line.
        """
        values = np.asarray(phi, dtype=np.float64)
        line = self._zero_line(self.basis.interpolate(values))
        if line is None:
            return values.copy()
        return np.where(values >= 0.0, 1.0, -1.0) * _distance(self.knots, *line)

    def boundary_distance(self, coefficients: ArrayLike, points: ArrayLike | None = None) -> Array:
        """Return the signed distance from the active boundary, the zero line of phi.

        The zero line is that of `signed_distance`. The distance is positive in the material. Not
        collective: each rank may ask for its own points.

        Args:
            coefficients: alpha, shape (knots,).
            points: positions, shape (n, 2) [m]; by default the centroids of this rank's cells.

        Returns:
            Shape (n,) [m]; infinite, with the sign of phi, where phi has no zero line.

        Raises:
            ValueError: if there is not one finite coefficient a knot, or a point is not finite.
        """
        alpha = self._check(coefficients)
        x = np.asarray(self.domain.centroids if points is None else points, dtype=np.float64)
        if x.ndim != 2 or x.shape[1] != 2 or not np.all(np.isfinite(x)):
            raise ValueError(
                f"level set: points in an array of shape {x.shape} must be finite coordinates of "
                "shape (n, 2)"
            )
        sign = np.where(np.asarray(self.basis.matrix(x) @ alpha) >= 0.0, 1.0, -1.0)
        line = self._zero_line(alpha)
        return sign * (math.inf if line is None or len(x) == 0 else _distance(x, *line))

    def _zero_line(self, coefficients: Array) -> tuple[Array, Array] | None:
        """Return start and end of the segments along which phi, bilinear on `grid`, is zero."""
        generator = contourpy.contour_generator(*self.grid, self.on_grid(coefficients).T)
        lines = [line for line in generator.lines(0.0) if len(line) > 1]
        if not lines:
            return None
        return np.vstack([line[:-1] for line in lines]), np.vstack([line[1:] for line in lines])


def _check_knots(knots: ArrayLike) -> Array:
    given = np.asarray(knots, dtype=np.float64)
    if given.ndim != 2 or given.shape[1] != 2 or len(given) < 3:
        raise ValueError(
            f"level set: no usable knots in an array of shape {given.shape}; give at least three "
            "points, shape (knots, 2), or none for a regular grid"
        )
    if not np.all(np.isfinite(given)):
        raise ValueError("level set: a knot has a coordinate that is NaN or infinite")
    return given


def _median_distance(points: Array) -> float:
    distance = float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    if distance == 0.0:
        raise ValueError("level set: two knots coincide; remove one of them")
    return distance


def _heaviside(s: Array) -> Array:
    s = np.clip(s, -1.0, 1.0)
    s2 = s * s  # powers are slow
    return 0.5 + s * (0.9375 + s2 * (0.1875 * s2 - 0.625))


def _heaviside_slope(s: Array) -> Array:
    return np.where(np.abs(s) < 1.0, 15.0 / 16.0 * (1.0 - s**2) ** 2, 0.0)


def _distance(points: Array, start: Array, end: Array) -> Array:
    """Return the distance of each point from the nearest of some line segments."""
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
