# SPDX-License-Identifier: MIT
"""The load cases of a problem, how they become one number, and the parameters that they share."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..dynamics import Integrator, TimeInterval, assemble_model, influence
from ..mechanical_problem import ConstraintValue, MechanicalProblem
from ..mechanism import Mechanism, Parameters, ParametricMechanism, TopologyError
from ..objective import Combination, Constraint, Derivatives, Objective, Response
from ..parallel import alike
from .evaluation import Evaluation, LoadCaseEvaluation, only_case

Cases = Mapping[str, MechanicalProblem]

#: Number of instants at which prescribed motions are compared to see which parameters matter
INSTANTS = 1001


class LoadCases:
    """Load cases by name, and how their objectives become one number.

    It is the part of a `Problem` that knows nothing of densities.
    """

    load_cases: dict[str, MechanicalProblem]  #: By name
    combine: Combination  #: How the objectives of the load cases become one number

    def _prepare(self) -> None:
        """Compile what the load cases take, and choose the steps that they leave open."""
        raise NotImplementedError

    def refuse_foreign_load_cases(self, evaluation: Evaluation) -> None:
        """Raise a ValueError if an ``evaluation`` is of other load cases."""
        evaluated = {name: list(case.constraints) for name, case in evaluation.load_cases.items()}
        labels = {n: [c.label for c in case.constraints] for n, case in self.load_cases.items()}
        if evaluated != labels:
            raise ValueError(
                "problem: the evaluation is of another problem: its load cases and their "
                f"constraints are {evaluated}, and those of this problem {labels}"
            )
        for name, case in self.load_cases.items():
            trajectory = evaluation.load_cases[name].trajectory
            if trajectory is None:
                continue
            for quantity, evaluated_with, expected in (
                ("mechanism", trajectory.model.mechanism, case.mechanism),
                ("end time", trajectory.integrator.end_time, case.integrator.end_time),
            ):
                if not alike(evaluated_with, expected):
                    raise ValueError(
                        f"problem: the evaluation is of another problem: "
                        f"{self._of(f'its {quantity}', name)} is not that of this problem"
                    )

    @property
    def mechanism(self) -> Mechanism:
        """Mechanism of the only load case: joints, drives, point masses, loads.

        Raises:
            ValueError: If there are several load cases; so do `integrator` and `objective`.
        """
        return only_case(self.load_cases, "problem.load_cases[{!r}].mechanism").mechanism

    @property
    def integrator(self) -> Integrator | TimeInterval:
        """Time interval and steps of the only load case."""
        return only_case(self.load_cases, "problem.load_cases[{!r}].integrator").integrator

    @integrator.setter
    def integrator(self, integrator: Integrator | TimeInterval) -> None:
        self._change(integrator=integrator)

    @property
    def objective(self) -> Objective:
        """Objective of the only load case, which is minimised."""
        return only_case(self.load_cases, "problem.load_cases[{!r}].objective").objective

    @objective.setter
    def objective(self, objective: Objective) -> None:
        self._change(objective=objective)

    def _change(self, **fields: Any) -> None:
        """Replace fields of the only load case."""
        only_case(self.load_cases, "Problem.of_load_cases")
        self.load_cases = {name: replace(case, **fields) for name, case in self.load_cases.items()}
        self._prepare()

    @property
    def constraints(self) -> list[Constraint]:
        """The constraints of all load cases; with several cases named "load case: name"."""
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

    def _of(self, name: str, case: str) -> str:
        """The name of a field of a load case in messages, with the case if there are several."""
        return name if len(self.load_cases) == 1 else f"{name} of load case {case!r}"

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
        slopes, kind = self.combine.slopes(psi), type(self.combine).__name__
        return {n: validation.number(f"the slope of {kind} by {n!r}", slopes.get(n)) for n in psi}


def weighted(derivatives: Mapping[str, Derivatives], weights: Mapping[str, float]) -> Derivatives:
    """Weighted sum of derivatives by load case."""
    scaled = [p if weights[n] == 1.0 else p.scaled(weights[n]) for n, p in derivatives.items()]
    return sum(scaled[1:], scaled[0])


def parametric(cases: Cases) -> dict[str, ParametricMechanism]:
    """The mechanisms with parameters, by load case."""
    mechanisms = {name: case.mechanism for name, case in cases.items()}
    return {name: m for name, m in mechanisms.items() if isinstance(m, ParametricMechanism)}


def shared(cases: Cases) -> Parameters | None:
    """The parameters that all load cases share, or a ValueError if they have different ones."""
    by_case = {name: mechanism.parameters for name, mechanism in parametric(cases).items()}
    if not by_case:
        return None
    reference_case, reference = next(iter(by_case.items()))
    for name, parameters in by_case.items():
        if parameters != reference:
            raise ValueError(
                f"problem: the load cases {reference_case!r} and {name!r} have different "
                f"parameters, {reference} and {parameters}; make all mechanisms by the same "
                "ffr.Parameters"
            )
    return reference


def split_parameters(
    x: ArrayLike | Mapping[str, ArrayLike], bodies: Collection[str], parameters: Parameters | None
) -> tuple[str, ArrayLike | None, ArrayLike | Mapping[str, ArrayLike]]:
    """Split ``x`` into the label and the values of parameters, and the densities of ``bodies``.

    Without values of parameters the label is "" and the values are None.
    """
    if parameters is None:
        return "", None, x
    if not isinstance(x, Mapping):
        return ("", None, x) if bodies else ("parameters", x, {})
    labels = [name for name in x if name not in bodies]
    if len(labels) != 1:
        return "", None, x
    densities = {name: density for name, density in x.items() if name in bodies}
    return labels[0], x[labels[0]], densities


def check_influence(cases: Cases, reduced: Response) -> None:
    """Refuse parameters on which nothing depends, and functions that make other topologies.

    Args:
        cases: Load cases by name.
        reduced: The bodies of the problem, without a trajectory.
    """
    mechanisms = parametric(cases)
    without_influence: set[str] = set()
    for name, mechanism in mechanisms.items():
        for bound in mechanism.parameters.bounds:
            try:
                mechanism.at(bound)
            except TopologyError:
                raise
            except ValueError:  # there need not be a mechanism at these values
                continue
        case, end = cases[name], cases[name].integrator.end_time
        times = np.linspace(0.0, end, INSTANTS)
        model = assemble_model(mechanism, case.response(reduced).bodies, times, checked=True)
        in_this_case = set(influence(model))
        is_first = name == next(iter(mechanisms))
        without_influence = in_this_case if is_first else without_influence & in_this_case
    if without_influence:
        names = ", ".join(map(repr, sorted(without_influence)))
        raise ValueError(
            f"parameters: nothing depends on {names}: take them out, or use them in the function "
            "that makes the mechanism"
        )
