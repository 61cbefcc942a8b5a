# SPDX-License-Identifier: MIT
"""Ways to the gradient of a problem, and what each says of its own error.

A design loop takes any of them:

- `ExactAdjoint`, the exact gradient of all elements at the cost of little more than the value;
- `ElementByElement`, the same gradient by the paper's route, one element after the other;
- `ApproximateGradient` (in a module of its own), exact at some elements, interpolated at the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .domain import Domain
from .elementwise import elementwise_gradient
from .sensitivity import Evaluation, Problem
from .shape_sensitivity import Solver

__all__ = [
    "ElementByElement",
    "ExactAdjoint",
    "GradientErrors",
    "GradientMethod",
    "GradientReport",
    "gradient_errors",
]

Array = NDArray[np.float64]
Distance = Callable[[str], Array | None]


@dataclass(frozen=True)
class GradientErrors:
    """How a gradient differs from the exact one over some elements."""

    l2: float  #: Euclidean norm of the difference, relative to that of the exact gradient
    cosine: float  #: cosine of the angle between both
    worst: float  #: largest difference of an element, relative to the largest exact value


@dataclass(frozen=True, eq=False)
class GradientReport:
    """What a gradient of one body was made from."""

    elements: int  #: elements with exact values, on all ranks
    share: float  #: their share of the designed elements
    selected: NDArray[np.bool_] = field(repr=False)  #: which of this rank's cells they are
    #: estimated relative error (Euclidean norm) over the designed elements; 0 for exact gradients
    estimate: float = 0.0
    errors: GradientErrors | None = None  #: true errors over the designed elements, where asked for
    #: true errors over the designed elements near the active boundary, where asked for
    band_errors: GradientErrors | None = None
    length: float = math.nan  #: of the kernel [m]
    condition: float = math.nan  #: condition number of the interpolation


class GradientMethod(Protocol):
    """Adds the gradient to an evaluation."""

    def __call__(
        self,
        problem: Problem,
        evaluation: Evaluation,
        distance: Distance,
        iteration: int,
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """Return the evaluation with a gradient, and a report for each body.

        Args:
            problem: the problem.
            evaluation: what its `value` returned last.
            distance: gives, by name of the body, the distance of the centroid of each cell of this
                rank from the active boundary, shape (cells,) [m]; None where there is no boundary.
            iteration: number of the iteration.
        """
        ...


@dataclass(frozen=True)
class ExactAdjoint:
    """The exact gradient of `Problem.differentiate`."""

    def __call__(
        self,
        problem: Problem,
        evaluation: Evaluation,
        distance: Distance,
        iteration: int,
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """Return the evaluation with the exact gradient, see `GradientMethod`."""
        return problem.differentiate(evaluation), _all_elements(problem)


@dataclass(frozen=True)
class ElementByElement:
    """Exact values at all designed elements, one after the other; zero at the others."""

    solver: Solver = "bordered"  #: of the normal modes' derivatives, "bordered" or "deflated"
    batch: int = 128  #: elements whose linear systems are solved at once
    progress: bool = False  #: show a progress bar for every gradient

    def __call__(
        self,
        problem: Problem,
        evaluation: Evaluation,
        distance: Distance,
        iteration: int,
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """Return the evaluation with the gradient, see `GradientMethod`."""
        cells = {name: body.domain.design_cells for name, body in problem.flexible.items()}
        found = elementwise_gradient(
            problem,
            evaluation,
            cells,
            solver=self.solver,
            batch=self.batch,
            progress=self.progress,
        )
        gradient = {}
        for name, part in found.items():
            gradient[name] = np.zeros(problem.flexible[name].domain.n_cells)
            gradient[name][part.cells] = part.values
        seconds = dict(evaluation.seconds)
        seconds["element by element"] = sum(part.seconds for part in found.values())
        return replace(evaluation, gradient=gradient, seconds=seconds), _all_elements(problem)


def gradient_errors(
    domain: Domain, gradient: Array, exact: Array, cells: NDArray[np.bool_]
) -> GradientErrors:
    """Return how a gradient differs from the exact one.

    Args:
        domain: the body.
        gradient: of the cells of this rank, shape (cells,).
        exact: its exact counterpart, shape (cells,).
        cells: which elements count, shape (cells,).

    Returns:
        The same on every rank; NaN where no element counts or the exact gradient is zero.
    """
    a: Array = gradient[cells]
    b: Array = exact[cells]
    d: Array = a - b
    aa, bb, ab, dd = domain.sum(a * a), domain.sum(b * b), domain.sum(a * b), domain.sum(d * d)
    largest, worst = (
        max(domain.comm.allgather(float(np.max(np.abs(v), initial=0.0)))) for v in (b, d)
    )
    if bb == 0.0:
        return GradientErrors(math.nan, math.nan, math.nan)
    cosine = ab / math.sqrt(aa * bb) if aa > 0.0 else math.nan
    return GradientErrors(math.sqrt(dd / bb), cosine, worst / largest)


def _all_elements(problem: Problem) -> dict[str, GradientReport]:
    reports = {}
    for name, body in problem.flexible.items():
        design = body.domain.design_cells
        count = body.domain.comm.allreduce(int(np.count_nonzero(design)))
        reports[name] = GradientReport(count, 1.0, design)
    return reports
