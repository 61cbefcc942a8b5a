# SPDX-License-Identifier: MIT
"""The gradient that a design loop asks for: the exact one, and what other methods must give.

`dolfinx_ffr.paper` has two other methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np

from ..arrays import Array, Mask
from ..problem import Evaluation, Problem

Distance = Callable[[str], Array | None]


@dataclass(frozen=True)
class GradientErrors:
    """How a gradient differs from the exact one over some elements."""

    l2: float  #: Euclidean norm of the difference, relative to that of the exact gradient
    cosine: float  #: Cosine of the angle between both
    worst: float  #: Largest difference of an element, relative to the largest exact value


@dataclass(frozen=True, eq=False)
class GradientReport:
    """How the gradient of one body was computed, and how accurate it is."""

    elements: int  #: Elements with exact values, on all ranks
    share: float  #: Their share of the designed elements
    selected: Mask = field(repr=False)  #: Which of this rank's cells they are
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
        self, problem: Problem, evaluation: Evaluation, distance: Distance, iteration: int
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """The ``evaluation`` of a ``problem`` with a gradient, and a report for each body.

        ``distance`` gives, by name of the body, the distance of the centroid of each cell of this
        rank from the active boundary, shape (cells,) [m], or None where there is no boundary.
        ``iteration`` is the number of the iteration.
        """
        ...


@dataclass(frozen=True)
class ExactAdjoint:
    """The exact gradient of `Problem.differentiate`."""

    exact: ClassVar[bool] = True

    def __call__(
        self, problem: Problem, evaluation: Evaluation, distance: Distance, iteration: int
    ) -> tuple[Evaluation, dict[str, GradientReport]]:
        """The evaluation with the exact gradient, see `GradientMethod`."""
        reports = {}
        for name, body in problem.flexible.items():
            design = body.domain.design_cells
            count = body.domain.comm.allreduce(int(np.count_nonzero(design)))
            reports[name] = GradientReport(count, 1.0, design)
        return problem.differentiate(evaluation), reports
