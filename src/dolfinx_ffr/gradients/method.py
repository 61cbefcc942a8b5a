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
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..fem import Domain
from ..parallel import on_every_rank
from ..problem import Evaluation, Problem
from .elementwise import elementwise_gradient
from .mode_derivatives import SOLVERS, Solver

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
    cosine: float  #: Cosine of the angle between both
    worst: float  #: Largest difference of an element, relative to the largest exact value


@dataclass(frozen=True, eq=False)
class GradientReport:
    """What a gradient of one body was made from."""

    elements: int  #: Elements with exact values, on all ranks
    share: float  #: Their share of the designed elements
    selected: NDArray[np.bool_] = field(repr=False)  #: Which of this rank's cells they are
    #: Estimated relative error (Euclidean norm) over the designed elements; 0 for exact gradients
    estimate: float = 0.0
    errors: GradientErrors | None = None  #: True errors over the designed elements, where asked for
    #: True errors over the designed elements near the active boundary, where asked for
    band_errors: GradientErrors | None = None
    length: float = math.nan  #: Of the kernel [m]
    condition: float = math.nan  #: Condition number of the interpolation


class GradientMethod(Protocol):
    """Adds the gradient to an evaluation."""

    exact: ClassVar[bool]  #: Whether there is no error to report

    def __call__(
        self,
        problem: Problem,
        evaluation: Evaluation,
        distance: Distance,
        iteration: int,
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """The evaluation with a gradient, and a report for each body.

        Args:
            problem: The problem.
            evaluation: What its `value` returned, at any time.
            distance: Gives, by name of the body, the distance of the centroid of each cell of this
                rank from the active boundary, shape (cells,) [m]; None where there is no boundary.
            iteration: Number of the iteration.
        """
        ...


@dataclass(frozen=True)
class ExactAdjoint:
    """The exact gradient of `Problem.differentiate`."""

    exact: ClassVar[bool] = True

    def __call__(
        self,
        problem: Problem,
        evaluation: Evaluation,
        distance: Distance,
        iteration: int,
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """The evaluation with the exact gradient, see `GradientMethod`."""
        return problem.differentiate(evaluation), _all_elements(problem)


@dataclass(frozen=True)
class ElementByElement:
    """Exact values at all designed elements, one after the other; zero at the others."""

    exact: ClassVar[bool] = True
    solver: Solver = "bordered"  #: Of the normal modes' derivatives, "bordered" or "deflated"
    batch: int = 128  #: Elements whose linear systems are solved at once
    #: Show a progress bar for every gradient; the ranks may differ in that
    progress: bool = field(default=False, compare=False)

    def __post_init__(self) -> None:
        """Check the numbers."""
        validation.choice("element by element: solver", self.solver, SOLVERS)
        validation.integer("element by element: batch", self.batch, least=1)

    def __call__(
        self,
        problem: Problem,
        evaluation: Evaluation,
        distance: Distance,
        iteration: int,
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """The evaluation with the gradient, see `GradientMethod`."""
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
    """How a gradient differs from the exact one.

    Args:
        domain: The body.
        gradient: Of the cells of this rank, shape (cells,).
        exact: Its exact counterpart, shape (cells,).
        cells: Which elements count, shape (cells,).

    Returns:
        The same on every rank; NaN where no element counts or the exact gradient is zero.

    Raises:
        TypeError: On every rank, if an argument is of a wrong kind.
        ValueError: On every rank, if an array has another shape, or holds NaN or infinity.
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
