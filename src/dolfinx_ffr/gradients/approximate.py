# SPDX-License-Identifier: MIT
"""The paper's approximate gradient, with its error shown.

Exact values are computed at selected elements (`GradientElements`), one after the other
(`elementwise_gradient`). Between them the gradient per area is a linear combination of radial basis
functions,

    1/V_e dpsi/dx_e  ~  sum_j alpha_j g(|X_e - X_j|) + polynomial,

with X_e the centroids and V_e the areas of the elements. (On a mesh of equal elements this is the
paper's eq. 4.)

The error is estimated by leaving out: at each selected element the interpolant through all others
misses the known value by e_j. An element that was not selected is given the e_j of the selected
element next to it,

    estimate^2 = sum_e (V_e e_j(e))^2 / sum_e (dpsi/dx_e)^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .. import validation
from ..design import ExponentialSpline, Kernel, ThinPlate, check_kernel
from ..fem import Domain
from ..problem import Evaluation, Problem
from .elementwise import elementwise_gradient
from .method import Distance, GradientReport, gradient_errors
from .mode_derivatives import SOLVERS, Solver
from .rbf_interpolation import ScatteredInterpolation, best_length
from .sampling import GradientElements

__all__ = ["ApproximateGradient"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Share of the selected elements beside which one more is selected in a round of refinement
REFINED = 0.25


@dataclass(frozen=True)
class ApproximateGradient:
    """Exact derivatives at selected elements, radial basis functions between them.

    Use it to see what the approximation costs and gains; `ExactAdjoint` is exact and faster.

    Raises:
        ValueError: If a number is out of range.
    """

    exact: ClassVar[bool] = False
    #: Which elements get exact values
    elements: GradientElements = field(default_factory=lambda: GradientElements(share=0.35))
    #: Radial basis function; or its class, whose length is then chosen by leaving out (about twenty
    #: lengths are tried, which takes long with more than a thousand elements)
    kernel: Kernel | Callable[[float], Kernel] = ExponentialSpline
    #: Degree of the polynomial, -1 for none; None takes the least that the kernel needs
    degree: int | None = None
    #: Estimated error above which further elements are selected, up to ``largest_share``; None: no
    tolerance: float | None = None
    #: Share of the designed elements that refinement does not exceed
    largest_share: float = 1.0
    #: Iterations after which the true error is measured with the exact adjoint; 0: never
    compare_every: int = 0
    #: Half-width of the band around the active boundary for which errors are reported as well [m];
    #: None takes two mean elements
    band: float | None = None
    #: Of the normal modes' derivatives, "bordered" or "deflated"
    solver: Solver = "bordered"
    #: Elements whose linear systems are solved at once
    batch: int = 128
    #: Show a progress bar for every gradient
    progress: bool = field(default=False, compare=False)

    def __post_init__(self) -> None:
        """Check kinds and numbers."""
        what = "approximate gradient"
        needed = "GradientElements(...)"
        validation.instance(f"{what}: elements", self.elements, GradientElements, needed)
        if not callable(self.kernel):
            check_kernel(what, self.kernel)
        if self.degree is not None:
            validation.integer(f"{what}: degree", self.degree, least=-1)
        for name in ("tolerance", "band"):
            if getattr(self, name) is not None:
                validation.number(f"{what}: {name}", getattr(self, name), above=0.0)
        validation.number(f"{what}: largest_share", self.largest_share, above=0.0, most=1.0)
        validation.integer(f"{what}: compare_every", self.compare_every)
        validation.choice(f"{what}: solver", self.solver, SOLVERS)
        validation.integer(f"{what}: batch", self.batch, least=1)

    def __call__(
        self,
        problem: Problem,
        evaluation: Evaluation,
        distance: Distance,
        iteration: int,
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """The evaluation with the approximate gradient, see `GradientMethod`.

        Warns:
            IllConditionedWarning: If the interpolation is ill-conditioned.
        """
        start = perf_counter()
        gradient, reports = {}, {}
        for name, body in problem.flexible.items():
            gradient[name], reports[name] = self._approximate(
                problem, evaluation, name, body.domain, distance(name)
            )
        seconds = {**evaluation.seconds, "approximate gradient": perf_counter() - start}
        if self.compare_every and iteration % self.compare_every == 0:
            exact = problem.differentiate(evaluation).gradient or {}
            for name, body in problem.flexible.items():
                reports[name] = self._compared(
                    body.domain, reports[name], gradient[name], exact[name], distance(name)
                )
        return replace(evaluation, gradient=gradient, seconds=seconds), reports

    def _approximate(
        self,
        problem: Problem,
        evaluation: Evaluation,
        name: str,
        domain: Domain,
        distance: Array | None,
    ) -> tuple[Array, GradientReport]:
        """The gradient of one body and how it came about."""
        design = domain.everywhere(domain.design_cells)
        selected = domain.everywhere(self.elements.select(domain, distance))
        known = np.zeros(len(selected), dtype=bool)
        values = np.zeros(domain.n_cells)
        method = self
        while True:
            found = elementwise_gradient(
                problem,
                evaluation,
                {name: domain.owned(selected & ~known)},
                solver=self.solver,
                batch=self.batch,
                progress=self.progress,
            )[name]
            values[found.cells] = found.values
            known |= selected
            through = _Interpolated(method, domain, known, domain.everywhere(values))
            method = replace(self, kernel=through.kernel)  # its length is chosen once
            free = int(self.largest_share * np.count_nonzero(design)) - through.report.elements
            if self.tolerance is None or through.report.estimate <= self.tolerance or free <= 0:
                return domain.owned(through.gradient), through.report
            selected = known.copy()
            selected[through.worst(free)] = True

    def interpolate(
        self, domain: Domain, selected: Mask, values: Array
    ) -> tuple[Array, GradientReport]:
        """The gradient of all elements from exact derivatives at some.

        Args:
            domain: The body.
            selected: Elements of this rank whose derivatives are known, shape (cells,).
            values: Derivatives, shape (cells,); those of other elements do not count.

        Returns:
            Shape (cells,), for the cells owned by this rank, zero at elements that are not
            designed; and a report, the same on every rank.
        """
        through = _Interpolated(
            self, domain, domain.everywhere(selected), domain.everywhere(values)
        )
        return domain.owned(through.gradient), through.report

    def _compared(
        self,
        domain: Domain,
        report: GradientReport,
        gradient: Array,
        exact: Array,
        distance: Array | None,
    ) -> GradientReport:
        """A report with the true errors."""
        design = domain.design_cells
        errors = gradient_errors(domain, gradient, exact, design)
        if distance is None:
            return replace(report, errors=errors)
        band = self.band or 2.0 * domain.cell_size
        near = design & (np.abs(distance) <= band)
        return replace(
            report, errors=errors, band_errors=gradient_errors(domain, gradient, exact, near)
        )


class _Interpolated:
    """The gradient of one body from exact derivatives at some elements; alike on every rank.

    Args:
        method: Kernel and degree.
        domain: The body.
        known: Elements of all ranks whose derivatives are known, shape (cells of all ranks,).
        values: Derivatives, shape (cells of all ranks,).
    """

    def __init__(
        self, method: ApproximateGradient, domain: Domain, known: Mask, values: Array
    ) -> None:
        design = domain.everywhere(domain.design_cells)
        points, areas = domain.everywhere(domain.centroids), domain.everywhere(domain.cell_volumes)
        density = values[known] / areas[known]
        self.kernel = _chosen(method, points[known], density)
        through = ScatteredInterpolation(points[known], self.kernel, degree=method.degree)
        rest = design & ~known
        self.gradient = np.where(known, values, 0.0)
        self.gradient[rest] = areas[rest] * through(density, points[rest])
        self._rest = np.flatnonzero(rest)
        self._away, self._nearest = cKDTree(points[known]).query(points[rest])
        self._expected = np.abs(through.leave_one_out(density))[self._nearest] * areas[rest]
        size = float(np.linalg.norm(self.gradient))
        count = int(np.count_nonzero(known))
        self.report = GradientReport(
            elements=count,
            share=count / int(np.count_nonzero(design)),
            selected=domain.owned(known),
            estimate=float(np.linalg.norm(self._expected)) / size if size > 0.0 else 0.0,
            length=float(getattr(self.kernel, "length", getattr(self.kernel, "radius", math.nan))),
            condition=through.condition,
        )

    def worst(self, free: int) -> NDArray[np.int64]:
        """Which elements to add where the expected error is largest, ``free`` at most."""
        count = self.report.elements
        total = np.bincount(self._nearest, self._expected**2, minlength=count)
        wanted = min(max(int(REFINED * count), 1), free, int(np.count_nonzero(total)))
        # equal ones, as in a symmetric body, in the order of the mesh in spite of round-off
        places = np.argsort(-np.round(total / np.max(total, initial=1e-300), 9), kind="stable")
        # in the neighborhood of each of them, the element that is farthest away
        order = np.lexsort((-self._away, self._nearest))
        first = order[np.searchsorted(self._nearest[order], places[:wanted])]
        return np.asarray(self._rest[first], dtype=np.int64)


def _chosen(method: ApproximateGradient, points: Array, values: Array) -> Kernel:
    """The kernel, its length chosen by leaving out where only its class is given."""
    if not isinstance(method.kernel, type):
        return cast(Kernel, method.kernel)
    if method.kernel is ThinPlate:
        return ThinPlate()
    length = best_length(method.kernel, points, values, degree=method.degree)
    return cast(Kernel, method.kernel(length))
