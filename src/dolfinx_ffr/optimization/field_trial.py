# SPDX-License-Identifier: MIT
"""Boundaries that are fields, evaluated and differentiated on meshes that fit them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.sparse import block_diag, csr_matrix, vstack
from shapely.geometry.base import BaseGeometry

from ..arrays import Array
from ..boundary_field import FieldOptions, MovingBoundary, SizeRows
from ..part import Part, Solid
from ..problem import Evaluation, Problem
from .descent import parted
from .enough_modes import with_enough_modes, with_steps_for
from .signed_log import SignedLog, check_start
from .stepper import FEASIBLE, AskedSizes
from .trial_failed import shaping, simulating


@dataclass(frozen=True, eq=False)
class FieldTrial:
    """Boundaries with the meshes that fit them, and what was computed there."""

    fields: dict[str, MovingBoundary]  #: By body
    problem: Problem
    evaluation: Evaluation
    logarithm: SignedLog  #: By which psi is compared
    violations: dict[str, float]  #: Of constraints and volumes, negative where they are satisfied
    margins: Mapping[str, float] = field(default_factory=dict)  #: Of `FieldProblem`
    #: Of psi, by the modes that bodies leave out, when last estimated
    mode_errors: dict[str, float] = field(default_factory=dict)
    warned: tuple[warnings.WarningMessage, ...] = ()  #: What was said while it was computed

    @property
    def boundaries(self) -> dict[str, MovingBoundary]:
        """The fields, by body."""
        return self.fields

    @property
    def parts(self) -> dict[str, Part | Solid]:
        """What they enclose, by body."""
        return {name: boundary.drawn for name, boundary in self.fields.items()}

    @property
    def materials(self) -> dict[str, BaseGeometry]:
        """The same as polygons [m], by body in the plane."""
        return {name: part.polygon for name, part in self.parts.items() if isinstance(part, Part)}

    @property
    def asked(self) -> dict[str, AskedSizes]:
        """Sizes that were asked for, by body."""
        return {n: AskedSizes(b.member, b.gap, b.rim) for n, b in self.fields.items()}

    @property
    def narrowest(self) -> float:
        """The narrowest member that has a row [m]; infinite if there is none."""
        widths = [
            boundary.options.spare * boundary.member * (1.0 - value)
            for name, boundary in self.fields.items()
            for value in self.rows[name].values[: self.rows[name].members]
        ]
        return float(min(widths, default=math.inf))

    @cached_property
    def rows(self) -> dict[str, SizeRows]:
        """Constraints on sizes, by body."""
        return {name: boundary.sizes for name, boundary in self.fields.items()}

    @property
    def size_violation(self) -> float:
        """Largest share by which a member, a gap or a radius is below its minimum."""
        return max(rows.violation for rows in self.rows.values())

    @property
    def violation(self) -> float:
        """Largest violation of a constraint or a volume with its margin, at least zero."""
        return max(0.0, *self.with_margins.values()) if self.violations else 0.0

    @property
    def with_margins(self) -> dict[str, float]:
        """Values of the constraints with their safety margins, by name."""
        return {name: v + self.margins.get(name, 0.0) for name, v in self.violations.items()}

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
    """Derivatives of psi and of all constraints by the motions of all boundaries."""

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
    size: float | None = None  #: Of cells [m]; None for one that is fine enough
    logarithm: SignedLog | None = None  #: By which psi is compared; None before the first trial
    #: Size of triangles in notches, in radii; finite where the largest stress counts
    turn: float = math.inf
    fine: bool = False  #: Whether meshes are those that tell a result
    #: Safety margins of constraints, by name
    margins: Mapping[str, float] = field(default_factory=dict)
    #: That of all constraints of the problem in the next step
    step_margin: float = 0.0
    tell: Callable[[str], object] = str  #: Shows that something is tried without a step

    def point(self, problem: Problem, fields: Mapping[str, MovingBoundary]) -> dict[str, Array]:
        """Where the problem is evaluated: full bodies, with the webs of their pockets."""
        bodies = problem.flexible
        full = {n: field_.part.density(bodies[n].domain) for n, field_ in fields.items()}
        return full | dict(self.others)

    def trial(self, fields: Mapping[str, MovingBoundary]) -> FieldTrial:
        """The ``fields`` meshed and evaluated; collective. Raises TrialFailed."""
        bodies = dict(self.problem.bodies)
        # what a trial warns of need not be true of the result
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            with shaping():
                for name, field_ in fields.items():
                    bodies[name] = self.problem.flexible[name].with_domain(
                        field_.mesh(self.turn, fine=self.fine, size=self.size)
                    )
                problem = self.problem.with_bodies(bodies)
            with simulating():
                evaluation = problem.value(self.point(problem, fields))
        return replace(self.evaluated(fields, problem, evaluation), warned=tuple(warned))

    def evaluated(
        self, fields: Mapping[str, MovingBoundary], problem: Problem, evaluation: Evaluation
    ) -> FieldTrial:
        """A trial that is evaluated, with its violations; collective."""
        problem, evaluation = problem.calibrated(evaluation)
        logarithm = self.logarithm
        if logarithm is None:
            check_start("boundary", evaluation.psi)
            logarithm = SignedLog.around(evaluation.psi)
        violations = {n: float(c.violation) for n, c in evaluation.constraints.items()}
        for name, most in self.volume.items():
            area = evaluation.volume[name] * problem.flexible[name].domain.area
            violations[f"volume of {name}"] = area / fields[name].body.area / most - 1.0
        return FieldTrial(dict(fields), problem, evaluation, logarithm, violations, self.margins)

    def gradients(self, trial: FieldTrial) -> FieldGradients:
        """All derivatives at a trial; collective."""
        bodies = trial.problem.flexible
        problem, evaluation = trial.problem.adapted(trial.evaluation, parted)
        evaluation = problem.differentiate(evaluation, nodes=True, densities=False)
        motions = {n: b.node_motion(bodies[n].domain) for n, b in trial.fields.items()}

        def by_motions(of_nodes: Mapping[str, Array] | None) -> Array:
            assert of_nodes is not None
            parts = [
                motions[name].pullback(of_nodes[name])
                if name in of_nodes
                else np.zeros(boundary.n_motions)
                for name, boundary in trial.fields.items()
            ]
            return np.concatenate(parts)

        bounds = [by_motions(bound.nodes) for bound in evaluation.constraints.values()]
        for name, most in self.volume.items():
            body = bodies[name]
            by_nodes = body.measures_pullback(evaluation.bodies[name].density, None)
            bounds.append(by_motions({name: by_nodes}) / (most * trial.fields[name].body.area))
        sizes = csr_matrix(block_diag([rows.slopes for rows in trial.rows.values()]))
        values = [rows.values for rows in trial.rows.values()]
        return FieldGradients(
            trial.logarithm.slope(evaluation.psi) * by_motions(evaluation.nodes),
            np.concatenate([*values, self._bound_values(trial, evaluation)]),
            csr_matrix(vstack([sizes, *(csr_matrix(row) for row in bounds)])),
            len(bounds),
            evaluation,
        )

    def _bound_values(self, trial: FieldTrial, evaluation: Evaluation) -> Array:
        """The constraints with their margins, of which one may have several places, and volumes."""
        values = []
        for name, bound in evaluation.constraints.items():
            # each place of a bound keeps the margin of that bound
            margins = [
                margin
                for whole, margin in trial.margins.items()
                if name == whole or name.startswith(f"{whole}, part")
            ]
            values.append(float(bound.violation) + max(margins, default=0.0) + self.step_margin)
        volumes = [trial.with_margins[f"volume of {name}"] for name in self.volume]
        return np.array([*values, *volumes])

    def with_enough(
        self, trial: FieldTrial, tolerance: float | None, first: Mapping[str, int]
    ) -> tuple[FieldProblem, FieldTrial]:
        """The problem with as many modes and time steps as the parts need; collective."""
        problem, evaluation = trial.problem, trial.evaluation
        x = self.point(problem, trial.fields)
        errors: dict[str, float] = {}
        if tolerance is not None:
            problem, evaluation, errors = with_enough_modes(
                problem, x, evaluation, tolerance, first
            )
        problem, evaluation = with_steps_for(problem, x, evaluation)
        if problem is trial.problem:
            trial.mode_errors.update(errors)
            return self, trial
        grown = self.evaluated(trial.fields, problem, evaluation)
        grown = replace(grown, mode_errors=errors, warned=trial.warned)
        return replace(self, problem=problem), grown
