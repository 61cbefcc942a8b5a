# SPDX-License-Identifier: MIT
"""What a design loop ends with: the design, its history, and what it falls short of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..design import Design
from ..fem import Domain
from ..problem import Evaluation, Problem

__all__ = ["DesignWarning", "Result", "gray_fraction", "of_problem", "only"]

Array = NDArray[np.float64]


class DesignWarning(UserWarning):
    """A run that began otherwise than it was asked to, or a result that is not what was wanted."""


def gray_fraction(domain: Domain, x: Array, low: float = 0.1, high: float = 0.9) -> float:
    """The share of the body's area whose density is neither void nor solid.

    Args:
        domain: The body.
        x: Density of this rank's cells, shape (cells,).
        low: Densities up to this one count as void.
        high: Densities from this one on count as solid.

    Raises:
        TypeError: If an argument is of a wrong kind.
        ValueError: On every rank, if the density has the wrong size, is NaN or leaves [0, 1].
    """
    validation.instance("gray fraction: domain", domain, Domain, "a Domain")
    validation.number("gray fraction: low", low)
    validation.number("gray fraction: high", high)
    density = domain.check_density(x)
    gray = (density > low) & (density < high)
    return domain.sum(domain.cell_volumes * gray) / domain.area


@dataclass(frozen=True)
class Result:
    """A design and how it came about."""

    densities: dict[str, Array]  #: Of this rank's cells by body, shape (cells,)
    #: By body, the same on every rank: coefficients of a level set, shape (knots,), or design
    #: variables of a `DensityDesign`, shape (designed cells,)
    variables: dict[str, Array]
    #: psi and motion of the design, by `problem`
    evaluation: Evaluation = field(repr=False)
    history: dict[str, Array] = field(repr=False)  #: Columns over the iterations
    #: Why the loop ended: "converged", "iterations" (none were left), "interrupted", "stalled" (the
    #: design would fall apart with a narrower Heaviside function), or "infeasible" (without a
    #: design that fulfils all constraints)
    reason: str
    #: By body, as sharp as at the end: its `Design.density` of the variables is the density
    designs: dict[str, Design] = field(repr=False)
    #: The one that evaluates the design: of a crisp level set with the law of cut elements, of
    #: anything else the one that was given
    problem: Problem = field(repr=False)
    #: Constraints that the design violates, by name (that of a volume bound is "volume of rod"), by
    #: how much relative to their bounds
    violations: dict[str, float] = field(default_factory=dict)
    #: Estimated relative error of psi by the normal modes that each body leaves out; empty where it
    #: was not asked for
    mode_errors: dict[str, float] = field(default_factory=dict)

    @property
    def feasible(self) -> bool:
        """Whether the design fulfils all constraints and volume bounds."""
        return not self.violations

    def summary(self) -> dict[str, Any]:
        """How the run ended, for `write_summary`."""
        return {
            "psi": self.psi,
            "reason": self.reason,
            "iterations": self.iterations,
            "feasible": self.feasible,
            "violations": self.violations,
            "volume": self.evaluation.volume,
            "gray": float(self.history["gray"][-1]),
            "modes": {name: body.modes for name, body in self.problem.flexible.items()},
            "mode_error": max(self.mode_errors.values(), default=None),
        }

    @property
    def x(self) -> Array:
        """Density of this rank's cells, shape (cells,), where one body is designed."""
        return only(self.densities)

    @property
    def coefficients(self) -> Array:
        """Coefficients of the level set, shape (knots,), where one body is designed."""
        return only(self.variables)

    @property
    def psi(self) -> float:
        """Objective of the design."""
        return self.evaluation.psi

    @property
    def iterations(self) -> int:
        """Number of steps tried."""
        return int(self.history["iteration"][-1])


def only(by_name: Mapping[str, Any]) -> Any:
    """The value of a mapping with one name.

    Args:
        by_name: Values by body.

    Raises:
        ValueError: If there are several.
    """
    if len(by_name) > 1:
        raise ValueError(
            f"several bodies are designed ({sorted(by_name)}): ask by name, for example "
            f"result.densities[{next(iter(by_name))!r}]"
        )
    return next(iter(by_name.values()))


def of_problem(densities: Mapping[str, Array]) -> Any:
    """Densities as `Problem.value` takes them: by name, or those of the only body.

    Args:
        densities: By body.
    """
    return dict(densities) if len(densities) > 1 else only(densities)
