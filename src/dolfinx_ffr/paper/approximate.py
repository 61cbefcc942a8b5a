# SPDX-License-Identifier: MIT
"""The paper's approximate gradient, with an estimate of its error.

Exact values are computed at selected elements (`GradientElements`, `elementwise_gradient`). Between
them the gradient per area is a linear combination of radial basis functions,

    1/V_e dpsi/dx_e  ~  sum_j alpha_j g(|X_e - X_j|) + polynomial,

with X_e the centroids and V_e the areas of the elements. (On a mesh of equal elements this is the
paper's eq. 4.)

The error is estimated by leaving out: at each selected element the interpolant through all others
misses the known value by e_j. Any other element has the e_j of the nearest selected one,

    estimate^2 = sum_e (V_e e_j(e))^2 / sum_e (dpsi/dx_e)^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import ClassVar, cast

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Integers, Mask
from ..design import ExponentialSpline, Kernel, ThinPlate, check_kernel
from ..fem import Array, Domain
from ..optimization import Distance, GradientErrors, GradientReport
from ..parallel import on_every_rank
from ..problem import Evaluation, Problem
from .elementwise import elementwise_gradient
from .mode_derivatives import SOLVERS, Solver
from .rbf_interpolation import ScatteredInterpolation, best_length

#: Part of the share that goes to the grid where no spacing is given; the band takes the rest
GRID_PART = 0.25
#: Largest distance of a grid point from the nearest centroid, in sizes of that cell, for which it
#: lies in the body or within about one element of it
NEAR = 1.5
#: Coordinates and distances that differ by less than this part of a mean element are equal
ROUND_OFF = 1e-6


@dataclass(frozen=True)
class GradientElements:
    """Elements on a coarse grid and in a band around the active boundary.

    Give a grid spacing, the half-width of a band, or both; or a share, with or without a grid
    spacing. With a share the grid comes first, and the band is as wide as the share asks for;
    without a spacing a quarter of the share goes to the grid. Where no boundary is known the whole
    share goes to the grid, as nearly as a regular grid can meet it.

    Only designed cells are selected. The set does not depend on the number of ranks nor on the
    numbering of the mesh: ties are broken by coordinates (in favor of the cell next to the middle
    of the body, so that a mirror-symmetric mesh gets a mirror-symmetric selection off the axis),
    and in the band all cells that are equally far from the boundary are in or out together.

    Example:
        >>> from mpi4py import MPI
        >>> from dolfinx_ffr import Domain
        >>> from dolfinx_ffr.paper import GradientElements
        >>> rod = Domain.rectangle(MPI.COMM_SELF, 0.4, 0.04, elements=(40, 4))
        >>> int(GradientElements(grid=0.04).select(rod).sum())
        10

    Attributes:
        grid: Spacing of the grid [m]; its points lie in the middle of equal rectangles over the
            bounding box, and those in the body or within about one element of it take the nearest
            cell.
        band: Half-width of the band around the active boundary, between cell centroids and boundary
            [m].
        share: Selected share of the body's designed cells, in ]0, 1].
    """

    grid: float | None = None
    band: float | None = None
    share: float | None = None

    def __post_init__(self) -> None:
        if self.grid is None and self.band is None and self.share is None:
            raise ValueError("gradient elements: give a grid spacing, a band or a share")
        for name in ("grid", "band"):
            if (length := getattr(self, name)) is not None:
                validation.number(f"gradient elements: {name}", length, above=0.0, unit="m")
        if self.share is not None:
            validation.number("gradient elements: share", self.share, above=0.0, most=1.0)
        if self.share is not None and self.band is not None:
            raise ValueError(
                "gradient elements: a share widens or narrows the band by itself; give either a "
                "band or a share"
            )

    def select(self, domain: Domain, distance: ArrayLike | None = None) -> Mask:
        """Which cells of a ``domain`` on this rank are selected, shape (cells,).

        The ``distance`` of their centroids from the active boundary, signed or absolute, is such as
        `LevelSet.distance`, shape (cells,) [m]. None, or infinity in all cells, means that there is
        no boundary.
        """
        away = self._check(domain, distance)
        # arrays of the cells of all ranks
        design = domain.everywhere(domain.design_cells)
        designed = int(np.count_nonzero(design))
        eps = ROUND_OFF * domain.cell_size
        selected = np.zeros(len(design), dtype=bool)
        spacing = self.grid
        if spacing is None and self.share is not None:
            grid_points = designed * self.share * (1.0 if away is None else GRID_PART)
            area = domain.sum(np.where(domain.design_cells, domain.cell_volumes, 0.0))
            spacing = math.sqrt(area / grid_points)
        if spacing is not None:
            selected[_nearest_cells(domain, spacing, eps)] = True
            selected &= design
        if away is not None and self.band is not None:
            selected |= design & (away <= self.band + eps)
        if self.share is not None:
            on_grid = int(np.count_nonzero(selected))
            # a spacing that follows from the share meets it by itself, as nearly as a grid can
            if self.grid is not None and on_grid > self.share * designed + 1.0:
                raise ValueError(
                    f"gradient elements: the grid of spacing {self.grid} m takes {on_grid} of "
                    f"{designed} designed cells, more than the share of {self.share}; take a "
                    "larger spacing or share"
                )
            missing = round(self.share * designed) - on_grid
            if away is not None and missing > 0:
                free = design & ~selected & np.isfinite(away)
                farthest = np.max(np.sort(away[free])[:missing], initial=0.0)
                selected |= free & (away <= farthest + eps)
        if not np.any(selected):
            raise ValueError(
                f"gradient elements: {self} selects none of {designed} designed cells; take a "
                "smaller grid spacing, a wider band or a larger share"
            )
        return domain.owned(selected)

    def _check(self, domain: Domain, distance: ArrayLike | None) -> Array | None:
        """The absolute distance, shape (cells of all ranks,), or None without a boundary."""
        away = np.full(domain.n_cells, np.inf)
        if distance is not None:
            away = np.abs(validation.numbers("gradient elements: distance", distance))
        wrong = away.shape != (domain.n_cells,) or bool(np.any(np.isnan(away)))
        if domain.comm.allreduce(wrong, MPI.LOR):
            raise ValueError(
                "gradient elements: expected the distance of each cell's centroid from the "
                f"boundary, shape ({domain.n_cells},) on rank {domain.comm.rank}, without NaN; got "
                + ("none" if distance is None else f"shape {away.shape}")
            )
        away = domain.everywhere(away)
        if np.any(np.isfinite(away)):
            return away
        if self.grid is None and self.share is None:
            raise ValueError(
                "gradient elements: a band needs a boundary, which this design does not have; "
                "give a grid spacing too, or a share"
            )
        return None


def _nearest_cells(domain: Domain, spacing: float, eps: float) -> Integers:
    """The cells nearest to points of the grid in or near the body, ties within ``eps`` broken."""
    low, high = domain.bounding_box
    counts = np.maximum(np.rint((high - low) / spacing), 1.0).astype(int)
    middles = np.indices(counts).reshape(len(counts), -1).T + 0.5
    points = low + middles * (high - low) / counts
    x, areas = map(domain.everywhere, (domain.centroids, domain.cell_volumes))
    tree = cKDTree(x)
    nearest = tree.query(points)[0]
    candidates = tree.query_ball_point(points, nearest + eps)  # of each point of the grid
    point = np.repeat(np.arange(len(points)), list(map(len, candidates)))
    cell = np.concatenate(list(candidates)).astype(np.int64)
    close = nearest[point] <= NEAR * np.sqrt(areas[cell]) + eps
    point, cell = point[close], cell[close]

    # of equally near cells first the one next to the middle, then the one of least coordinates
    for key in (np.linalg.norm(x - 0.5 * (low + high), axis=1), x[:, 0], x[:, 1]):
        least = np.full(len(points), np.inf)
        np.minimum.at(least, point, key[cell])
        tied = key[cell] <= least[point] + eps
        point, cell = point[tied], cell[tied]
    return np.unique(cell)


@dataclass(frozen=True)
class ApproximateGradient:
    """Exact derivatives at selected elements, radial basis functions between them.

    Use it to see what the approximation costs and gains; `ExactAdjoint` is exact and faster.

    Attributes:
        elements: Which elements get exact values.
        kernel: Radial basis function; or its class, whose length is then chosen by leaving out
            (about twenty lengths are tried, which takes long with more than a thousand elements).
        degree: Degree of the polynomial, -1 for none; None takes the least that the kernel needs.
        compare_every: Iterations after which the true error is measured with the exact adjoint; 0:
            never.
        band: Half-width of the band around the active boundary for which errors are reported as
            well [m]; None takes two mean elements.
        solver: Solver of the normal modes' derivatives, "bordered" or "deflated".
        progress: Show a progress bar for every gradient; the ranks may differ in that.
    """

    exact: ClassVar[bool] = False
    elements: GradientElements = field(default_factory=lambda: GradientElements(share=0.35))
    kernel: Kernel | Callable[[float], Kernel] = ExponentialSpline
    degree: int | None = None
    compare_every: int = 0
    band: float | None = None
    solver: Solver = "bordered"
    progress: bool = field(default=False, compare=False)

    def __post_init__(self) -> None:
        label, needed = "approximate gradient", "GradientElements(...)"
        validation.instance(f"{label}: elements", self.elements, GradientElements, needed)
        if not isinstance(self.kernel, type):
            check_kernel(label, self.kernel)
        if self.degree is not None:
            validation.integer(f"{label}: degree", self.degree, least=-1)
        if self.band is not None:
            validation.number(f"{label}: band", self.band, above=0.0)
        validation.integer(f"{label}: compare_every", self.compare_every)
        validation.choice(f"{label}: solver", self.solver, SOLVERS)

    def __call__(
        self, problem: Problem, evaluation: Evaluation, distance: Distance, iteration: int
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        start = perf_counter()
        gradients, reports = {}, {}
        for name in problem.flexible:
            gradients[name], reports[name] = self._approximate(
                problem, evaluation, name, distance(name)
            )
        seconds = {**evaluation.seconds, "approximate gradient": perf_counter() - start}
        if self.compare_every and iteration % self.compare_every == 0:
            exact = problem.differentiate(evaluation).gradient or {}
            for name, body in problem.flexible.items():
                reports[name] = self._compared(
                    reports[name], body.domain, gradients[name], exact[name], distance(name)
                )
        return replace(evaluation, gradient=gradients, seconds=seconds), reports

    def _approximate(
        self, problem: Problem, evaluation: Evaluation, name: str, distance: Array | None
    ) -> tuple[Array, GradientReport]:
        """The gradient of one body, shape (cells,), and its report."""
        domain = problem.flexible[name].domain
        selected = self.elements.select(domain, distance)
        exact = elementwise_gradient(
            problem, evaluation, {name: selected}, solver=self.solver, progress=self.progress
        )[name]
        values = np.zeros(domain.n_cells)
        values[exact.cells] = exact.values
        return self._interpolate(domain, selected, values)

    def _interpolate(
        self, domain: Domain, selected: Mask, values: Array
    ) -> tuple[Array, GradientReport]:
        """The gradient of all elements from the exact ``values`` of those ``selected``.

        All arrays have shape (cells,); the gradient is zero at elements that are not designed.
        """
        # arrays of the cells of all ranks
        known, values, design, points, areas = map(
            domain.everywhere,
            (selected, values, domain.design_cells, domain.centroids, domain.cell_volumes),
        )
        unknown = design & ~known
        density = values[known] / areas[known]
        interpolation = ScatteredInterpolation(
            points[known], self._kernel(points[known], density), degree=self.degree
        )
        gradient = np.where(known, values, 0.0)
        gradient[unknown] = areas[unknown] * interpolation(density, points[unknown])

        # an unknown element has the error of the nearest known one
        nearest = cKDTree(points[known]).query(points[unknown])[1]
        errors = areas[unknown] * interpolation.leave_one_out(density)[nearest]
        norm, count = float(np.linalg.norm(gradient)), int(np.count_nonzero(known))
        kernel = interpolation.kernel
        return domain.owned(gradient), GradientReport(
            elements=count,
            share=count / int(np.count_nonzero(design)),
            selected=selected,
            estimate=float(np.linalg.norm(errors)) / norm if norm > 0.0 else 0.0,
            length=float(getattr(kernel, "length", getattr(kernel, "radius", math.nan))),
            condition=interpolation.condition,
        )

    def _kernel(self, points: Array, values: Array) -> Kernel:
        """The kernel; of a class, with the length at which leaving out errs least."""
        if not isinstance(self.kernel, type):
            return cast(Kernel, self.kernel)
        if self.kernel is ThinPlate:  # it has no length
            return ThinPlate()
        return self.kernel(best_length(self.kernel, points, values, degree=self.degree))

    def _compared(
        self,
        report: GradientReport,
        domain: Domain,
        gradient: Array,
        exact: Array,
        distance: Array | None,
    ) -> GradientReport:
        """The report with the errors of ``gradient`` against the ``exact`` one.

        They are taken over all designed cells, and over the band around the boundary where there is
        a ``distance`` from it. All arrays have the shape (cells,) of this rank.
        """
        design = domain.design_cells
        report = replace(report, errors=gradient_errors(domain, gradient, exact, design))
        if distance is None:
            return report
        in_band = design & (np.abs(distance) <= (self.band or 2.0 * domain.cell_size))
        return replace(report, band_errors=gradient_errors(domain, gradient, exact, in_band))


def gradient_errors(domain: Domain, gradient: Array, exact: Array, cells: Mask) -> GradientErrors:
    """Errors of a ``gradient`` against the ``exact`` one over some ``cells`` of a ``domain``.

    All arrays have shape (cells,) of this rank. The result is the same on every rank, and NaN where
    no element counts or the exact gradient is zero.
    """
    validation.instance("gradient errors: domain", domain, Domain, "a Domain")
    shape = (domain.n_cells,)
    with on_every_rank(domain.comm, "gradient errors"):
        a = validation.real_array("gradient errors: gradient", gradient, shape)
        b = validation.real_array("gradient errors: exact", exact, shape)
        mask = np.asarray(cells)
        if mask.dtype != np.bool_ or mask.shape != shape:
            raise ValueError(
                f"gradient errors: cells must be True or False for each of {domain.n_cells} cells"
            )
    a, b = a[mask], b[mask]
    difference: Array = a - b
    aa, bb, ab, dd = map(domain.sum, (a * a, b * b, a * b, difference * difference))
    maxima = [float(np.max(np.abs(v), initial=0.0)) for v in (b, difference)]
    largest, worst = map(max, zip(*domain.comm.allgather(maxima), strict=True))
    if bb == 0.0:
        return GradientErrors(math.nan, math.nan, math.nan)
    cosine = ab / math.sqrt(aa * bb) if aa > 0.0 else math.nan
    return GradientErrors(math.sqrt(dd / bb), cosine, worst / largest)
