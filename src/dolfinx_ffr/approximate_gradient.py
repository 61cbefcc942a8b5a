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
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .domain import Domain
from .elementwise import elementwise_gradient
from .gradient_elements import GradientElements
from .gradient_method import Distance, GradientReport, gradient_errors
from .rbf import ExponentialSpline, Kernel, ThinPlate
from .scattered import ScatteredInterpolation, best_length
from .sensitivity import Evaluation, Problem
from .shape_derivatives import Solver

__all__ = ["ApproximateGradient"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: share of the selected elements beside which one more is selected in a round of refinement
REFINED = 0.25


@dataclass(frozen=True)
class ApproximateGradient:
    """Exact derivatives at selected elements, radial basis functions between them.

    Use it to see what the approximation costs and gains; `ExactAdjoint` is exact and faster.

    Raises:
        ValueError: if a number is out of range.
    """

    #: which elements get exact values
    elements: GradientElements = field(default_factory=lambda: GradientElements(share=0.35))
    #: radial basis function; or its class, whose length is then chosen by leaving out (about twenty
    #: lengths are tried, which takes long with more than a thousand elements)
    kernel: Kernel | Callable[[float], Kernel] = ExponentialSpline
    #: degree of the polynomial, -1 for none; None takes the least that the kernel needs
    degree: int | None = None
    #: number of nearest selected elements that count for an element; None takes all
    neighbors: int | None = None
    #: estimated error above which further elements are selected, up to ``largest_share``; None: no
    tolerance: float | None = None
    #: share of the designed elements that refinement does not exceed
    largest_share: float = 1.0
    #: iterations after which the true error is measured with the exact adjoint; 0: never
    compare_every: int = 0
    #: half-width of the band around the active boundary for which errors are reported as well [m];
    #: None takes two mean elements
    band: float | None = None
    #: of the normal modes' derivatives, "bordered" or "deflated"
    solver: Solver = "bordered"
    #: elements whose linear systems are solved at once
    batch: int = 128
    #: show a progress bar for every gradient
    progress: bool = False

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name, value, fits in (
            ("tolerance", self.tolerance, self.tolerance is None or self.tolerance > 0.0),
            ("largest_share", self.largest_share, 0.0 < self.largest_share <= 1.0),
            ("compare_every", self.compare_every, self.compare_every >= 0),
            ("band", self.band, self.band is None or 0.0 < self.band < math.inf),
        ):
            if not fits:
                raise ValueError(f"approximate gradient: {name} = {value} is out of range")

    def __call__(
        self,
        problem: Problem,
        evaluation: Evaluation,
        distance: Distance,
        iteration: int,
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """Return the evaluation with the approximate gradient, see `GradientMethod`.

        Warns:
            IllConditionedWarning: if the interpolation is ill-conditioned.
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
        """Return the gradient of one body and how it came about."""
        design = domain.everywhere(domain.design_cells)
        centroids = domain.everywhere(domain.centroids)
        areas = domain.everywhere(domain.cell_volumes)
        selected = domain.everywhere(self.elements.select(domain, distance))
        known = np.zeros(len(selected), dtype=bool)
        values = np.zeros(len(selected))
        kernel: Kernel | None = None
        while True:
            fresh = domain.owned(selected & ~known)
            found = elementwise_gradient(
                problem,
                evaluation,
                {name: fresh},
                solver=self.solver,
                batch=self.batch,
                progress=self.progress,
            )[name]
            local = np.zeros(domain.n_cells)
            local[found.cells] = found.values
            values += domain.everywhere(local) / areas
            known |= selected
            if kernel is None:
                kernel = self._kernel(centroids[known], values[known])
            through = ScatteredInterpolation(
                centroids[known], kernel, degree=self.degree, neighbors=self.neighbors
            )
            rest = design & ~known
            gradient = np.where(known, values, 0.0)
            gradient[rest] = through(values[known], centroids[rest])
            gradient *= areas
            left_out = np.abs(through.leave_one_out(values[known]))
            away, nearest = cKDTree(centroids[known]).query(centroids[rest])
            expected = left_out[nearest] * areas[rest]
            size = float(np.linalg.norm(gradient))
            estimate = float(np.linalg.norm(expected)) / size if size > 0.0 else 0.0
            count = int(np.count_nonzero(known))
            free = int(self.largest_share * np.count_nonzero(design)) - count
            if self.tolerance is None or estimate <= self.tolerance or free <= 0:
                break
            selected = known.copy()
            selected[np.flatnonzero(rest)[_worst(away, nearest, expected, count, free)]] = True
        report = GradientReport(
            elements=count,
            share=count / int(np.count_nonzero(design)),
            selected=domain.owned(known),
            estimate=estimate,
            length=float(getattr(kernel, "length", getattr(kernel, "radius", math.nan))),
            condition=through.condition,
        )
        return domain.owned(gradient), report

    def _kernel(self, points: Array, values: Array) -> Kernel:
        if not isinstance(self.kernel, type):
            return cast(Kernel, self.kernel)
        if self.kernel is ThinPlate:
            return ThinPlate()
        length = best_length(
            self.kernel, points, values, degree=self.degree, neighbors=self.neighbors
        )
        return cast(Kernel, self.kernel(length))

    def _compared(
        self,
        domain: Domain,
        report: GradientReport,
        gradient: Array,
        exact: Array,
        distance: Array | None,
    ) -> GradientReport:
        """Return a report with the true errors."""
        design = domain.design_cells
        errors = gradient_errors(domain, gradient, exact, design)
        if distance is None:
            return replace(report, errors=errors)
        band = self.band or 2.0 * math.sqrt(domain.area / domain.n_cells_global)
        near = design & (np.abs(distance) <= band)
        return replace(
            report, errors=errors, band_errors=gradient_errors(domain, gradient, exact, near)
        )


def _worst(
    away: Array, nearest: NDArray[np.int64], expected: Array, count: int, free: int
) -> NDArray[np.int64]:
    """Return which elements refine the selection where the expected error is largest.

    Args:
        away: distance of each candidate from the selected element next to it, shape (n,).
        nearest: number of that element, shape (n,).
        expected: estimated error of each candidate, shape (n,).
        count: number of selected elements.
        free: how many more may be selected.
    """
    total = np.bincount(nearest, expected**2, minlength=count)
    wanted = min(max(int(REFINED * count), 1), free, int(np.count_nonzero(total)))
    # equal ones, as in a symmetric body, in the order of the mesh in spite of round-off
    places = np.argsort(-np.round(total / np.max(total, initial=1e-300), 9), kind="stable")
    places = places[:wanted]
    # in the neighborhood of each of them, the element that is farthest away
    order = np.lexsort((-away, nearest))
    first = order[np.searchsorted(nearest[order], places)]
    return np.asarray(first, dtype=np.int64)
