# SPDX-License-Identifier: MIT
"""The load cases of a problem, how they become one number, and their parts by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from .. import validation
from ..dynamics import Integrator
from ..mechanical_problem import ConstraintValue, MechanicalProblem
from ..mechanism import Mechanism
from ..objective import Combination, Constraint, Derivatives, Objective
from .evaluation import LoadCaseEvaluation, only_case


class LoadCases:
    """Load cases by name, and how their objectives become one number."""

    load_cases: dict[str, MechanicalProblem]  #: By name
    combine: Combination  #: How the objectives of the load cases become one number

    def _prepare(self) -> None:
        """Make ready for load cases that have changed."""
        raise NotImplementedError

    @property
    def mechanism(self) -> Mechanism:
        """Mechanism of the only load case: joints, drives, point masses, loads.

        Raises:
            ValueError: If there are several load cases; so do `integrator` and `objective`.
        """
        return only_case(self.load_cases, "problem.load_cases[{!r}].mechanism").mechanism

    @property
    def integrator(self) -> Integrator:
        """Time interval and steps of the only load case."""
        return only_case(self.load_cases, "problem.load_cases[{!r}].integrator").integrator

    @integrator.setter
    def integrator(self, integrator: Integrator) -> None:
        self._change(integrator=integrator)

    @property
    def objective(self) -> Objective:
        """Objective of the only load case, which is minimised."""
        return only_case(self.load_cases, "problem.load_cases[{!r}].objective").objective

    @objective.setter
    def objective(self, objective: Objective) -> None:
        self._change(objective=objective)

    def _change(self, **parts: Any) -> None:
        """Change parts of the only load case."""
        only_case(self.load_cases, "Problem.of_load_cases")
        self.load_cases = {name: replace(case, **parts) for name, case in self.load_cases.items()}
        self._prepare()

    @property
    def constraints(self) -> list[Constraint]:
        """The constraints of all load cases; of several "load case: name" is the name."""
        return [
            constraint
            if len(self.load_cases) == 1
            else replace(constraint, name=self._label(name, constraint.label))
            for name, case in self.load_cases.items()
            for constraint in case.constraints
        ]

    def _label(self, case: str, label: str) -> str:
        """The name of a load case's constraint among all constraints."""
        return label if len(self.load_cases) == 1 else f"{case}: {label}"

    def _of(self, what: str, case: str) -> str:
        """The name of a part of a load case in messages."""
        return what if len(self.load_cases) == 1 else f"{what} of load case {case!r}"

    def _labelled(self, cases: Mapping[str, LoadCaseEvaluation]) -> dict[str, ConstraintValue]:
        """The constraints of all load cases by their labels."""
        return {
            self._label(name, label): value
            for name, case in cases.items()
            for label, value in case.constraints.items()
        }

    def _combined(self, psi: Mapping[str, float]) -> float:
        """The one number from the objectives by load case."""
        kind = type(self.combine).__name__
        return validation.number(f"the value of {kind}", self.combine.value(psi))

    def _slopes(self, psi: Mapping[str, float]) -> dict[str, float]:
        """The derivatives of psi by the objectives of the load cases."""
        given, kind = self.combine.slopes(psi), type(self.combine).__name__
        return {n: validation.number(f"the slope of {kind} by {n!r}", given.get(n)) for n in psi}


def weighted(parts: Mapping[str, Derivatives], weights: Mapping[str, float]) -> Derivatives:
    """Weighted sum of derivatives by load case."""
    scaled = [p if weights[n] == 1.0 else p.scaled(weights[n]) for n, p in parts.items()]
    return sum(scaled[1:], scaled[0])
