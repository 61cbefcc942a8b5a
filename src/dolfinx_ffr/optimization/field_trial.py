# SPDX-License-Identifier: MIT
"""Boundaries that are fields, evaluated and differentiated on meshes that fit them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import block_diag, csr_matrix, vstack

from ..arrays import Array
from ..boundary_field import BoundaryField, FieldOptions, FittedNodes, SizeRows
from ..problem import Evaluation, Problem
from .enough_modes import with_enough_modes, with_steps_for
from .signed_log import SignedLog, check_start
from .trial_failed import shaping, simulating

#: Violation up to which a trial may be the best one: the accuracy of sizes and of a mesh
FEASIBLE = 2e-3


@dataclass(frozen=True, eq=False)
class FieldTrial:
    """Boundaries with the meshes that fit them, and what was computed there."""

    fields: dict[str, BoundaryField]  #: By body
    problem: Problem
    evaluation: Evaluation
    logarithm: SignedLog  #: By which psi is compared
    violations: dict[str, float]  #: Of constraints and volumes, negative where they are satisfied

    @cached_property
    def rows(self) -> dict[str, SizeRows]:
        """Constraints on sizes, by body."""
        return {name: SizeRows.of(field) for name, field in self.fields.items()}

    @property
    def size_violation(self) -> float:
        """Largest share by which a member, a gap or a radius is below its minimum."""
        return max(rows.violation for rows in self.rows.values())

    @property
    def violation(self) -> float:
        """Largest violation of a constraint or a volume, at least zero."""
        return max(0.0, *self.violations.values()) if self.violations else 0.0

    def merit(self, bound_weight: float) -> float:
        """Logarithm of psi with the weighted largest violation of a constraint or a volume."""
        return self.logarithm.value(self.evaluation.psi) + bound_weight * self.violation

    @property
    def feasible(self) -> bool:
        """Whether all constraints and sizes are satisfied."""
        return max(self.violation, self.size_violation) <= FEASIBLE

    def release(self) -> None:
        """Free the matrices of its bodies; collective."""
        for name in self.fields:
            self.problem.flexible[name].release()


@dataclass(frozen=True, eq=False)
class FieldGradients:
    """Derivatives of psi and of all constraints by the variables of all fields."""

    psi: Array  #: Of the logarithm, (n,) [1/m]
    values: Array  #: Of the constraints, not positive where they are satisfied, (rows,)
    slopes: csr_matrix  #: Of the constraints: sizes first, then others and volumes, (rows, n)
    bounds: int  #: Number of constraints that are no sizes, the last ones
    evaluation: Evaluation  #: With the derivative by the integrals of the bodies


@dataclass(frozen=True, eq=False)
class FieldProblem:
    """What is lowered: a problem whose designed bodies have fields as boundaries."""

    problem: Problem
    volume: Mapping[str, float]  #: Upper bounds of the filled shares, by body
    others: Mapping[str, Array]  #: Variables of designs without a domain, and given densities
    options: FieldOptions
    logarithm: SignedLog | None = None  #: By which psi is compared; None before the first trial

    def point(self, problem: Problem) -> dict[str, Array]:
        """Where the problem is evaluated: full bodies."""
        full = {name: np.ones(body.domain.n_cells) for name, body in problem.flexible.items()}
        return full | dict(self.others)

    def trial(self, fields: Mapping[str, BoundaryField]) -> FieldTrial:
        """The ``fields`` meshed and evaluated; collective. Raises TrialFailed."""
        bodies = dict(self.problem.bodies)
        # what a trial warns of need not be true of the result
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with shaping():
                for name, field_ in fields.items():
                    bodies[name] = self.problem.flexible[name].with_domain(field_.mesh())
                problem = self.problem.with_bodies(bodies)
            with simulating():
                evaluation = problem.value(self.point(problem))
        return self.evaluated(fields, problem, evaluation)

    def evaluated(
        self, fields: Mapping[str, BoundaryField], problem: Problem, evaluation: Evaluation
    ) -> FieldTrial:
        """A trial that is evaluated, with its violations; collective."""
        problem, evaluation = problem.calibrated(evaluation)
        logarithm = self.logarithm
        if logarithm is None:
            check_start("boundary", evaluation.psi)
            logarithm = SignedLog.around(evaluation.psi)
        violations = {n: float(c.violation) for n, c in evaluation.constraints.items()}
        for name, most in self.volume.items():
            area = problem.flexible[name].domain.area
            violations[f"volume of {name}"] = area / fields[name].space.body.area / most - 1.0
        return FieldTrial(dict(fields), problem, evaluation, logarithm, violations)

    def gradients(self, trial: FieldTrial) -> FieldGradients:
        """All derivatives at a trial; collective."""
        bodies, evaluation = trial.problem.flexible, trial.evaluation
        evaluation = trial.problem.differentiate(evaluation, nodes=True, densities=False)
        nodes = {n: FittedNodes(f, bodies[n].domain) for n, f in trial.fields.items()}

        def by_variables(of_nodes: Mapping[str, Array] | None) -> Array:
            assert of_nodes is not None
            parts = [
                nodes[name].pullback(of_nodes[name])
                if name in of_nodes
                else np.zeros(len(field_.variables))
                for name, field_ in trial.fields.items()
            ]
            return np.concatenate(parts)

        bounds = [by_variables(bound.nodes) for bound in evaluation.constraints.values()]
        bounds += [self._volume_slope(trial, name, most) for name, most in self.volume.items()]
        sizes = csr_matrix(block_diag([rows.slopes for rows in trial.rows.values()]))
        values = [rows.values for rows in trial.rows.values()]
        return FieldGradients(
            trial.logarithm.slope(evaluation.psi) * by_variables(evaluation.nodes),
            np.concatenate([*values, list(trial.violations.values())]),
            csr_matrix(vstack([sizes, *(csr_matrix(row) for row in bounds)])),
            len(bounds),
            evaluation,
        )

    def _volume_slope(self, trial: FieldTrial, name: str, most: float) -> Array:
        """The derivative of the volume of a body, relative to its bound, (n,) [1/m]."""
        slopes = []
        for other, field_ in trial.fields.items():
            edge = field_.edge
            share = 1.0 / (most * field_.space.body.area) if other == name else 0.0
            slopes.append(share * (edge.rows.T @ edge.lengths))
        return np.concatenate(slopes)

    def with_enough(
        self, trial: FieldTrial, tolerance: float | None, first: Mapping[str, int]
    ) -> tuple[FieldProblem, FieldTrial]:
        """The problem with as many modes and time steps as the parts need; collective."""
        problem, evaluation = trial.problem, trial.evaluation
        x = self.point(problem)
        if tolerance is not None:
            problem, evaluation, _ = with_enough_modes(problem, x, evaluation, tolerance, first)
        problem, evaluation = with_steps_for(problem, x, evaluation)
        if problem is trial.problem:
            return self, trial
        return replace(self, problem=problem), self.evaluated(trial.fields, problem, evaluation)
