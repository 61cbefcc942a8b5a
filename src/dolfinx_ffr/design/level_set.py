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
import warnings
from collections.abc import Callable, Sequence
from copy import copy
from typing import Any

from mpi4py import MPI

import contourpy
import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from .. import validation
from ..fem import Domain
from ..parallel import ROUND_OFF
from .parametrization import Design, check_stages
from .rbf import Kernel, RadialBasis, Wendland, check_kernel, finite_vector

__all__ = ["LevelSet", "LevelSetDesign"]

Array = NDArray[np.float64]

#: Entries of the largest dense matrix that a rank may hold (4 GB)
LARGEST = 2**29


class LevelSet:
    """Phi on knots over a body, and the fill fraction of the body's elements.

    Args:
        domain: The body.
        knots: Shape (knots, 2) [m], the same on every rank; by default a regular grid over the
            body's bounding box.
        spacing: Distance of the grid's knots [m]; by default the size of a mean element. With
            given knots it is the resolution at which the zero line is drawn, by default their
            median distance.
        kernel: Radial basis function; by default Wendland's with a radius of three spacings. The
            matrices of a global kernel are dense: take a spacing of two or more elements with it.
        width: Half-width of the smoothed Heaviside function in units of phi, which re-initialised
            is a distance [m]; by default the size of a mean element.
        quadrature: Points in each direction of an element.

    Raises:
        ValueError: On every rank, if there are no knots, a length is not positive, the spacing
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
        self.domain = validation.instance("level set: domain", domain, Domain, "a Domain")
        #: Size of a mean element [m]
        self.element = float(np.sqrt(domain.area / domain.n_cells_global))
        for name, value in (("spacing", spacing), ("width", width)):
            if value is not None:
                validation.number(f"level set: {name}", value, above=0.0, unit="m")
        points_across = validation.whole("level set: quadrature", quadrature, least=1)
        given = None if knots is None else _check_knots(knots)
        wanted = spacing
        if wanted is None:
            wanted = self.element if given is None else _median_distance(given)
        low, high = domain.bounding_box
        # halves are rounded up, whatever the order in which the ranks add up the area
        counts = np.floor((high - low) / wanted + 0.5 + ROUND_OFF).astype(int) + 1
        if counts.min() < 3:
            raise ValueError(
                f"level set: spacing = {wanted:.4g} m leaves fewer than 3 knots across the body of "
                f"{high[0] - low[0]:.4g} m x {high[1] - low[1]:.4g} m; take a smaller one"
            )
        #: Coordinates of the columns and rows of the grid on which the zero line is drawn [m]; by
        #: default the knots form this grid, column by column
        self.grid = (
            np.linspace(low[0], high[0], counts[0]),
            np.linspace(low[1], high[1], counts[1]),
        )
        #: Distance of neighbouring grid points [m]
        self.spacing = float(max(g[1] - g[0] for g in self.grid))
        self._width = self.element if width is None else float(width)
        grid = np.column_stack([x.ravel() for x in np.meshgrid(*self.grid, indexing="ij")])
        points, self._weights = domain.quadrature_points(points_across)
        if kernel is None:
            kernel = Wendland(3.0 * self.spacing)
        check_kernel("level set", kernel)
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

    @property
    def width(self) -> float:
        """Half-width of the smoothed Heaviside function [m]."""
        return self._width

    @width.setter
    def width(self, value: float) -> None:
        warnings.warn(
            "LevelSet.width cannot be set any more from the next release on: take "
            "levelset.with_width(width)",
            DeprecationWarning,
            stacklevel=2,
        )
        self._width = float(value)

    def with_width(self, width: float) -> LevelSet:
        """The same level set with another half-width of the smoothed Heaviside function.

        Args:
            width: In units of phi [m].

        Raises:
            ValueError: If it is not a positive length.
        """
        validation.number("level set: width", width, above=0.0, unit="m")
        other = copy(self)
        other._width = float(width)
        return other

    def as_design(self) -> LevelSetDesign:
        """The coefficients as bounded variables, in the stages of `LevelSetDesign`."""
        return LevelSetDesign(self)

    # ------------------------------------------------------------------ density

    def fill_fraction(self, coefficients: ArrayLike) -> Array:
        """The density of each cell owned by this rank, shape (cells,), in [0, 1].

        Args:
            coefficients: Alpha, shape (knots,).

        Raises:
            ValueError: If there is not one finite coefficient a knot.
        """
        phi = self._at_points(coefficients)
        x = np.einsum("cq,cq->c", self._weights, _heaviside(phi / self.width))
        # the mean of values in [0, 1] may leave it by round-off
        return np.where(self.domain.design_cells, np.clip(x, 0.0, 1.0), 1.0)

    def pullback(self, coefficients: ArrayLike, x_bar: Array) -> Array:
        """The transpose of the derivative of `fill_fraction`.

        Args:
            coefficients: Alpha, shape (knots,).
            x_bar: Derivative with respect to the density of this rank's cells, shape (cells,).

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
        """The filled share of the body's area at ``coefficients``, alike on every rank."""
        filled = self.fill_fraction(coefficients) * self.domain.cell_volumes
        return self.domain.sum(filled) / self.domain.area

    def _at_points(self, coefficients: ArrayLike) -> Array:
        return np.asarray(self._matrix @ self._check(coefficients)).reshape(self._weights.shape)

    def _check(self, coefficients: ArrayLike) -> Array:
        return finite_vector(coefficients, len(self.knots), "level set", "coefficients, one a knot")

    def _sum(self, local: Array) -> Array:
        comm: MPI.Comm = self.domain.comm
        total = np.empty_like(local)
        comm.Reduce(local, total, root=0)
        comm.Bcast(total, root=0)
        return total

    def identity(self) -> dict[str, Any]:
        """What the level sets of a checkpoint and of the run that reads it have in common."""
        return {
            "knots": self.knots,
            "kernel": repr(self.basis.kernel),
            "cells": self.domain.n_cells_global,
        }

    # ------------------------------------------------------------------ phi on the knots

    def interpolate(self, phi: ArrayLike | Callable[[Array], Array]) -> Array:
        """The coefficients of a function given at the knots.

        Args:
            phi: Values at the knots, shape (knots,) [m], or a function of positions (n, 2) [m].
        """
        return self.basis.interpolate(phi(self.knots) if callable(phi) else phi)

    def at_knots(self, coefficients: ArrayLike) -> Array:
        """Phi at the knots for ``coefficients`` (knots,), shape (knots,) [m]."""
        return np.asarray(self._knot_matrix @ self._check(coefficients))

    def on_grid(self, coefficients: ArrayLike) -> Array:
        """Phi on `grid` for ``coefficients`` (knots,), shape (columns, rows) [m]."""
        values = np.asarray(self._grid_matrix @ self._check(coefficients))
        return values.reshape(len(self.grid[0]), len(self.grid[1]))

    def with_holes(
        self, columns: int, rows: int, radius: float, *, margin: float | None = None
    ) -> Array:
        """A start design: solid with staggered round holes, mirror-symmetric about the axis.

        Args:
            columns: Holes along the longer side of the body's bounding box.
            rows: Holes across.
            radius: Of the holes [m]; zero leaves the body solid.
            margin: Distance of the outermost rows' centers from the longer sides [m]; by default
                half the distance between rows.

        Returns:
            Coefficients of the signed distance, shape (knots,).
        """
        columns = validation.whole("level set: columns of holes", columns, least=1)
        rows = validation.whole("level set: rows of holes", rows, least=1)
        validation.number("level set: radius of holes", radius, least=0.0, unit="m")
        if margin is not None:
            validation.number("level set: margin", margin, unit="m")
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
        """The signed distance from the zero line of phi, at the knots.

        The zero line is the polygon along which phi, bilinear on `grid`, is zero.

        Args:
            phi: Values at the knots, shape (knots,).

        Returns:
            Values at the knots, shape (knots,) [m]; ``phi`` itself where it has no zero line.
        """
        values = np.asarray(phi, dtype=np.float64)
        line = self._zero_line(self.basis.interpolate(values))
        if line is None:
            return values.copy()
        return np.where(values >= 0.0, 1.0, -1.0) * _distance(self.knots, *line)

    def boundary_distance(self, coefficients: ArrayLike, points: ArrayLike | None = None) -> Array:
        """The signed distance from the active boundary, the zero line of phi.

        The zero line is that of `signed_distance`. The distance is positive in the material. Not
        collective: each rank may ask for its own points.

        Args:
            coefficients: Alpha, shape (knots,).
            points: Positions, shape (n, 2) [m]; by default the centroids of this rank's cells.

        Returns:
            Shape (n,) [m]; infinite, with the sign of phi, where phi has no zero line.

        Raises:
            ValueError: If there is not one finite coefficient a knot, or a point is not finite.
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
        """Start and end of the segments along which phi, bilinear on `grid`, is zero."""
        generator = contourpy.contour_generator(*self.grid, self.on_grid(coefficients).T)
        lines = [line for line in generator.lines(0.0) if len(line) > 1]
        if not lines:
            return None
        return np.vstack([line[:-1] for line in lines]), np.vstack([line[1:] for line in lines])


class LevelSetDesign(Design):
    """The coefficients of a level set, bounded.

    Args:
        levelset: Of radial basis functions; its own width does not count.
        widths: Half-widths of the smoothed Heaviside function in units of a mean element, one a
            stage.
        bound: Largest size of a coefficient, in knot spacings.

    Raises:
        ValueError: If a number is out of range.
    """

    each = "knot"

    def __init__(
        self,
        levelset: LevelSet,
        *,
        widths: Sequence[float] = (1.0, 0.6, 0.35),
        bound: float = 1.0,
    ) -> None:
        validation.instance("level set design: levelset", levelset, LevelSet, "a LevelSet")
        stages = check_stages("level set design: widths", widths)
        validation.number("level set design: bound", bound, above=0.0)
        self.domain = levelset.domain
        self.stages = len(stages)
        self.size = len(levelset.knots)
        self.upper = bound * levelset.spacing
        self.lower = -self.upper
        self._widths = stages
        #: With the width of this stage
        self.levelset = levelset.with_width(levelset.element * self._widths[0])

    @property
    def width(self) -> float:  # type: ignore[override]
        """Half-width of the smoothed Heaviside function [m]."""
        return self.levelset.width

    def at_stage(self, stage: int) -> LevelSetDesign:
        """The design with the width of a ``stage``."""
        other = copy(self)
        other.levelset = self.levelset.with_width(self.levelset.element * self._widths[stage])
        return other

    def density(self, variables: Array) -> Array:
        """The fill fraction at the coefficients ``variables``."""
        return self.levelset.fill_fraction(variables)

    def pullback(self, variables: Array, x_bar: Array) -> Array:
        """The transpose of the fill fraction's derivative at ``variables``, on ``x_bar``."""
        return self.levelset.pullback(variables, x_bar)

    def distance(self, variables: Array) -> Array:
        """The distance from the zero line of the coefficients ``variables``."""
        return self.levelset.boundary_distance(variables)

    def identity(self) -> dict[str, Any]:
        """Knots, kernel, cells, widths and bound."""
        return {
            **self.levelset.identity(),
            "widths": self._widths,
            "bound": self.upper,
        }


def _check_knots(knots: ArrayLike) -> Array:
    given = validation.numbers("level set: knots", knots)
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
    """The distance of each point from the nearest of some line segments."""
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
