# SPDX-License-Identifier: MIT
"""Boundaries on fitted meshes: psi, its derivatives, violated bounds, the best step."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import block_diag as sparse_block_diag
from scipy.sparse import csc_matrix, csr_matrix, issparse
from scipy.sparse import vstack as sparse_vstack
from shapely.geometry.base import BaseGeometry

from ..arrays import Array
from ..boundary import (
    PLANE_STEPS,
    Boundary,
    BoundaryGeometry,
    PlaneGeometry,
    Rows,
    SpatialGeometry,
    StepOptions,
    Surface,
    best_step,
    curvature,
    secants,
)
from ..mechanical_problem import MechanicalProblem
from ..objective import Constraint, PeakStress, Response, is_stress, value_of
from ..parallel import on_rank_0
from ..part import STRESSED, TURN, Part, Solid
from ..problem import Evaluation, Problem
from .enough_modes import with_enough_modes, with_steps_for
from .result import drawn_of, ranks_of
from .signed_log import SignedLog, check_start
from .stepper import FEASIBLE, AskedSizes
from .trial_failed import TrialFailed, shaping, simulating

#: By the dimension of the bodies
_GEOMETRIES: dict[int, BoundaryGeometry[Any]] = {2: PlaneGeometry(), 3: SpatialGeometry()}

#: Nothing is known by steps, as before the first one
NONE = np.zeros((2, 0, 0))
#: From derivatives by nodes, by body, to those by the offsets of all boundaries, (offsets,)
Pullback = Callable[[Mapping[str, Array] | None], Array]


@dataclass(frozen=True, eq=False)
class Trial:
    """Boundaries with the meshes that fit them, and what was computed there."""

    boundaries: dict[str, Boundary | Surface]
    problem: Problem
    evaluation: Evaluation
    sizes: dict[str, Rows]  #: Of members and gaps
    radii: dict[str, Rows]
    violations: dict[str, float]  #: Values of constraints by name, positive where they are violated
    margins: dict[str, float]  #: Safety margins of constraints, by name
    logarithm: SignedLog  #: By which psi is compared
    size_penalty: float  #: Weight of the largest violated size in the merit
    warned: tuple[warnings.WarningMessage, ...] = ()  #: What was said while it was computed

    @property
    def parts(self) -> dict[str, Part | Solid]:
        """What the boundaries enclose, by body."""
        return {name: drawn_of(boundary) for name, boundary in self.boundaries.items()}

    @property
    def materials(self) -> dict[str, BaseGeometry]:
        """The parts as polygons [m], by body in the plane."""
        return {
            name: boundary.material
            for name, boundary in self.boundaries.items()
            if isinstance(boundary, Boundary)
        }

    @property
    def asked(self) -> dict[str, AskedSizes]:
        """Required minimum sizes, by body."""
        return {
            name: AskedSizes(b.member, b.gap if isinstance(b, Boundary) else 0.0, b.rim)
            for name, b in self.boundaries.items()
        }

    @property
    def radius_violations(self) -> dict[str, float]:
        """Share by which the smallest radius of each body is below its minimum."""
        return {name: rows.size_violation for name, rows in self.radii.items()}

    @property
    def with_margins(self) -> dict[str, float]:
        """Values of the constraints with their safety margins, by name."""
        return {
            name: value + self.margins.get(name, 0.0) for name, value in self.violations.items()
        }

    @property
    def violation(self) -> float:
        """Largest violation of the constraints with their safety margins, at least zero."""
        return max(0.0, *self.with_margins.values()) if self.violations else 0.0

    def merit(self, bound_weight: float) -> float:
        """Logarithm of psi, of any sign, and the largest violations with their weights."""
        constraints = [*self.sizes.values(), *self.radii.values()]
        largest = [float(np.max(rows.values, initial=0.0)) for rows in constraints]
        return self.without_sizes(bound_weight) + self.size_penalty * max(largest, default=0.0)

    def without_sizes(self, bound_weight: float) -> float:
        """The merit without sizes, which steps mend where a strut has gone."""
        return self.logarithm.value(self.evaluation.psi) + bound_weight * self.violation

    def rank(self, bound_weight: float) -> tuple[bool, float]:
        """Which trial is the best: one that satisfies bounds and sizes, and of those by merit."""
        return max(self.violation, self.size_violation) > FEASIBLE, self.merit(bound_weight)

    @property
    def size_violation(self) -> float:
        """The largest share by which a member, gap or radius is below its minimum."""
        constraints = (*self.sizes.values(), *self.radii.values())
        return max((rows.size_violation for rows in constraints), default=0.0)

    def release(self) -> None:
        """Free the matrices of its bodies, which would stay beside those of others."""
        for name in self.boundaries:
            self.problem.flexible[name].release()

    def row(self, step: float, rejected: int, removed: int, inserted: int) -> dict[str, float]:
        """One row of the history."""
        bodies = self.problem.flexible
        area = sum(self.evaluation.volume[n] * bodies[n].domain.area for n in self.boundaries)
        return {
            "psi": self.evaluation.psi,
            "volume": area / sum(b.body.area for b in self.boundaries.values()),
            "narrowest": min(rows.smallest for rows in self.sizes.values()),
            "tightest": min(rows.smallest for rows in self.radii.values()),
            "excess": max(0.0, *self.violations.values()) if self.violations else 0.0,
            "step": step,
            "cells": sum(bodies[name].domain.n_cells_global for name in self.boundaries),
            "modes": sum(bodies[name].modes for name in self.boundaries),
            "rejected": rejected,
            "removed": removed,
            "inserted": inserted,
        }


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives by the offsets of all boundaries, in minimum members."""

    psi: Array  #: Of log psi, of any sign, (offsets,)
    values: Array  #: Of the constraints: members and gaps, radii, bounds, (m,)
    slopes: Array | csr_matrix  #: Their derivatives, (m, offsets)
    n_bounds: int  #: Number of bounds, which are the last of the constraints
    evaluation: Evaluation  #: With the gradients


@dataclass(frozen=True, eq=False)
class Descent:
    """Steps of the boundaries of a problem's designed bodies."""

    problem: Problem
    volume: dict[str, float]  #: Upper bounds of the filled shares
    sizes: dict[str, float]  #: Of the triangles [m]
    others: dict[str, Array]  #: Variables of designs without a domain, and densities, that stay
    turn: float = math.inf  #: Size of triangles in notches, in radii
    margins: dict[str, float] = field(default_factory=dict)  #: Of `Trial`
    tell: Callable[[str], object] = str  #: Shows that something is tried without a step
    #: By which psi is compared; None before the first trial
    logarithm: SignedLog | None = None

    @property
    def is_stressed(self) -> bool:
        """Whether the largest stress counts, so that notches have smaller triangles."""
        return self.turn < math.inf

    @property
    def geometry(self) -> BoundaryGeometry[Any]:
        """What its boundaries are."""
        return geometry_of(self.problem)

    @property
    def options(self) -> StepOptions:
        """Numbers of the steps."""
        return self.geometry.steps

    def point(
        self, problem: Problem, boundaries: Mapping[str, Boundary | Surface]
    ) -> dict[str, Array]:
        """Where the problem is evaluated: full bodies, with the webs of their pockets."""
        bodies = problem.flexible
        full = {
            name: drawn_of(boundary).density(bodies[name].domain)
            for name, boundary in boundaries.items()
        }
        return full | self.others

    def trial_of(self, boundaries: dict[str, Boundary | Surface]) -> Trial:
        """Boundaries meshed and evaluated.

        Its warnings stay with the trial, which may not be the result. Raises a TrialFailed if they
        cannot be meshed or simulated.
        """
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            trial = self._trial_of(boundaries)
        return replace(trial, warned=tuple(warned))

    def _trial_of(self, boundaries: dict[str, Boundary | Surface]) -> Trial:
        bodies, comm = dict(self.problem.bodies), ranks_of(self.problem)
        boundaries = {name: self.geometry.agreed(b, comm) for name, b in boundaries.items()}
        with shaping():
            for name, boundary in boundaries.items():
                domain = self.geometry.mesh(boundary, self.sizes[name], self.turn)
                domain.whole = boundary.body
                bodies[name] = self.problem.flexible[name].with_domain(domain)
            problem = self.problem.with_bodies(bodies)
        with simulating():
            evaluation = problem.value(self.point(problem, boundaries))
        return self.evaluated(boundaries, problem, evaluation)

    def evaluated(
        self, boundaries: dict[str, Boundary | Surface], problem: Problem, evaluation: Evaluation
    ) -> Trial:
        """The trial of boundaries at which the problem is evaluated, with its violations."""
        # stress limits are those of these parts
        problem, evaluation = problem.calibrated(evaluation)
        logarithm = self.logarithm
        if logarithm is None:
            check_start("boundary", evaluation.psi)
            logarithm = SignedLog.around(evaluation.psi)
        violations = {
            name: float(bound.violation) for name, bound in evaluation.constraints.items()
        }
        for name, bound_share in self.volume.items():
            domain = problem.flexible[name].domain
            share = evaluation.volume[name] * domain.area / boundaries[name].body.area
            violations[f"volume of {name}"] = share / bound_share - 1.0
        sizes = {name: self.geometry.sizes(boundary) for name, boundary in boundaries.items()}
        radii = {name: self.geometry.radii(boundary) for name, boundary in boundaries.items()}
        geometric = sizes, radii, violations
        penalty = self.options.size_penalty
        return Trial(boundaries, problem, evaluation, *geometric, self.margins, logarithm, penalty)

    def slopes(self, trial: Trial, margin: float = 0.0) -> Slopes:
        """Derivatives of psi and of constraints, tightened by a margin, at a trial."""
        problem, evaluated = trial.problem.adapted(trial.evaluation, parted)
        evaluation = problem.differentiate(evaluated, nodes=True, densities=False)
        by_offsets = self._pullback(trial)
        psi = trial.logarithm.slope(evaluation.psi) * by_offsets(evaluation.nodes)

        size_values, size_slopes = self._size_constraints(trial)
        case_values, case_slopes = self._cases_below(trial, evaluation, by_offsets)
        bound_values, bound_slopes = self._bounds(trial, evaluation, by_offsets, margin)
        rows = [*(slope - psi for slope in case_slopes), *bound_slopes]
        return Slopes(
            psi,
            np.concatenate([*size_values, case_values, bound_values]),
            _stacked([*size_slopes, *(row[None] for row in rows)]),
            len(bound_slopes),
            evaluation,
        )

    def _pullback(self, trial: Trial) -> Pullback:
        """From derivatives by the nodes of all bodies to those by offsets in minimum members."""
        bodies, boundaries = trial.problem.flexible, trial.boundaries
        motions = {
            name: self.geometry.motion(boundary, bodies[name].domain)
            for name, boundary in boundaries.items()
        }

        def by_offsets(nodes: Mapping[str, Array] | None) -> Array:
            assert nodes is not None
            slopes = []
            for name, boundary in boundaries.items():
                if name in nodes:
                    slopes.append(boundary.member * motions[name].pullback(nodes[name]))
                else:
                    slopes.append(np.zeros(boundary.n_offsets))
            return np.concatenate(slopes)

        return by_offsets

    def _size_constraints(self, trial: Trial) -> tuple[list[Array], list[Array | csr_matrix]]:
        """Values and slopes of constraints on members and gaps, on radii, and on positions."""
        boundaries = trial.boundaries
        # no offset is longer than 1.5 times that of the step
        longest = 1.5 * self.options.longest
        positions = {
            name: self.geometry.position_rows(boundary, longest * boundary.member)
            for name, boundary in boundaries.items()
        }
        values: list[Array] = []
        slopes: list[Array | csr_matrix] = []
        for rows_of_bodies in (trial.sizes, trial.radii, positions):
            values += [rows.values for rows in rows_of_bodies.values()]
            blocks = [
                boundary.member * rows_of_bodies[name].slopes
                for name, boundary in boundaries.items()
            ]
            if issparse(blocks[0]):
                slopes.append(csr_matrix(sparse_block_diag(blocks)))
            else:
                slopes.append(block_diag(*blocks))
        return values, slopes

    def _bounds(
        self, trial: Trial, evaluation: Evaluation, by_offsets: Pullback, margin: float
    ) -> tuple[list[float], list[Array]]:
        """Violations with their margins, and slopes, of constraints and of volumes."""
        values: list[float] = []
        slopes: list[Array] = []
        for name, bound in evaluation.constraints.items():
            # each place of a bound keeps the margin of that bound
            margins = [
                bound_margin
                for bound_name, bound_margin in trial.margins.items()
                if name == bound_name or name.startswith(f"{bound_name}, part")
            ]
            values.append(float(bound.violation) + max(margins, default=0.0) + margin)
            slopes.append(by_offsets(bound.nodes))
        for name, bound_share in self.volume.items():
            values.append(trial.with_margins[f"volume of {name}"])
            body = trial.problem.flexible[name]
            by_nodes = body.measures_pullback(evaluation.bodies[name].density, None)
            area = bound_share * trial.boundaries[name].body.area
            slopes.append(by_offsets({name: by_nodes}) / area)
        return values, slopes

    def _cases_below(
        self,
        trial: Trial,
        evaluation: Evaluation,
        by_offsets: Pullback,
    ) -> tuple[Array, list[Array]]:
        """By how much other load cases are below the worst one, where that is minimised.

        A step lowers the worst load case as far as no other one near it becomes worse. Returned
        are differences of log psi, (cases,), and slopes of log psi of these load cases.
        """
        combine, cases = trial.problem.combine, evaluation.load_cases
        if not combine.bounds or len(cases) == 1:
            return np.zeros(0), []
        psi = {name: case.psi for name, case in cases.items()}
        weighted, logarithm = combine.weighted(psi), trial.logarithm
        worst = max(weighted, key=lambda name: weighted[name])
        values, slopes = [], []
        for name in combine.near(psi):
            if name == worst:
                continue
            values.append(logarithm.value(weighted[name]) - logarithm.value(weighted[worst]))
            weight = combine.weight(name) * logarithm.slope(weighted[name])
            slopes.append(weight * by_offsets(cases[name].nodes))
        return np.array(values), slopes

    def step(self, trial: Trial, slopes: Slopes, reach: float, earlier: Array = NONE) -> Step:
        """The step that lowers log psi most, the longest offset of which is ``reach`` members.

        The curvature of log psi is estimated from ``earlier`` steps, see `secants`.
        """
        boundaries = trial.boundaries
        options = self.options
        # where a stress counts, steps are as smooth in space as in the plane
        smoothing = PLANE_STEPS.smooth if self.is_stressed else options.smooth
        metrics = [boundary.metric(smoothing * boundary.member) for boundary in boundaries.values()]
        metric = csc_matrix(sparse_block_diag(metrics))
        is_fixed = np.concatenate([boundary.fixed_offsets for boundary in boundaries.values()])
        curvature_columns = curvature(metric, earlier, slopes.psi)
        # round-off may decide which constraints a step is bounded by
        step = on_rank_0(
            ranks_of(self.problem),
            lambda: best_step(
                metric,
                slopes.psi,
                slopes.values,
                slopes.slopes,
                is_fixed,
                reach,
                curvature_columns,
                options,
            ),
        )
        offsets, start = {}, 0
        for name, boundary in boundaries.items():
            end = start + boundary.n_offsets
            offsets[name] = boundary.member * step.offsets[start:end]
            start = end
        bound_multipliers = step.multipliers[len(step.multipliers) - slopes.n_bounds :]
        return Step(offsets, bound_multipliers, step.promised)

    def secants(self, earlier: Array, before: Trial, slopes: Slopes, after: Trial) -> Array:
        """Moves and gradients of the last steps, (2, steps, offsets), see `curvature`.

        To the ``earlier`` ones the step from the trial ``before`` to that ``after`` it is added.
        Empty where the largest stress or the worst load case counts: the place of that stress, or
        that load case, is another one after each step, and differences of gradients tell nothing.
        """
        displacements = [
            self.geometry.offsets_between(boundary, after.boundaries[name]) / boundary.member
            for name, boundary in before.boundaries.items()
        ]
        motion = np.concatenate(displacements)
        several = before.problem.combine.bounds and len(before.problem.load_cases) > 1
        if not motion.size or self.is_stressed or several:
            return NONE
        return secants(earlier, motion, slopes.psi, self.options.secants)

    def moved(self, trial: Trial, step: Step) -> Trial | None:
        """The trial after a step, None if no mesh fits it or it cannot be simulated."""
        try:
            with shaping():
                moved = {
                    name: boundary.moved(step.offsets[name])
                    for name, boundary in trial.boundaries.items()
                }
                if not self.is_stressed:  # a step along tangents misses sizes, and costs a value
                    moved = {
                        name: self.geometry.with_minimum_sizes(boundary, FEASIBLE)
                        for name, boundary in moved.items()
                    }
            return self.trial_of(moved)
        except TrialFailed:
            return None

    def accurate(
        self, trial: Trial, tolerance: float | None, first: Mapping[str, int]
    ) -> tuple[Descent, Trial, dict[str, float]]:
        """With as many normal modes, and as short time steps, as the parts need."""
        problem, evaluation = trial.problem, trial.evaluation
        x = self.point(problem, trial.boundaries)
        errors: dict[str, float] = {}
        if tolerance is not None:
            problem, evaluation, errors = with_enough_modes(
                problem, x, evaluation, tolerance, first
            )
        problem, evaluation = with_steps_for(problem, x, evaluation)
        if problem is trial.problem:
            return self, trial, errors
        accurate_trial = self.evaluated(trial.boundaries, problem, evaluation)
        return replace(self, problem=problem), replace(accurate_trial, warned=trial.warned), errors

    def resolved(self, boundaries: dict[str, Boundary | Surface]) -> Trial:
        """Boundaries on meshes that resolve notches or walls."""
        with shaping():
            fine = {name: self.geometry.finer(boundary) for name, boundary in boundaries.items()}
        # stress differs as much from mesh to mesh
        margin = 0.5 * self.options.stress_margin
        sizes = {n: size * (0.5 if self.is_stressed else 1.0) for n, size in self.sizes.items()}
        margins, turn = of_stress(self.problem, margin), STRESSED if self.is_stressed else TURN
        return replace(self, turn=turn, sizes=sizes, margins=margins).trial_of(fine)

    def with_drawn_sizes(self, trial: Trial) -> Trial:
        """The trial whose drawn boundaries have the minimum sizes, if it can be simulated."""
        boundaries = {
            name: self.geometry.with_drawn_sizes(boundary)
            for name, boundary in trial.boundaries.items()
        }
        if all(boundaries[name] is boundary for name, boundary in trial.boundaries.items()):
            return trial
        try:
            return self.trial_of(boundaries)
        except TrialFailed:
            return trial

    def finer(self, trial: Trial) -> tuple[Trial, float]:
        """The trial on finer meshes, if these can be made, and the last relative change of psi.

        Meshes are refined until psi has converged.
        """
        change, repaired = math.inf, self.with_drawn_sizes(trial)
        if repaired is not trial:
            trial.release()
            trial = repaired
        for _ in range(self.geometry.finer_meshes):
            trial.release()
            try:
                refined = self.resolved(trial.boundaries)
            except (TrialFailed, MemoryError):
                break
            change = abs(trial.evaluation.psi / refined.evaluation.psi - 1.0)
            trial = refined
            if change <= self.geometry.mesh_tolerance:
                break
        return trial, change


@dataclass(frozen=True, eq=False)
class Step:
    """A step of all boundaries."""

    offsets: dict[str, Array]  #: Of the boundaries, by body [m]
    bound_multipliers: Array  #: Multipliers of constraints and volumes, in units of log psi
    promised: float  #: Fall of log psi by its slopes and the curvature that is known


def parted(
    problem: MechanicalProblem, response: Response, fall: float = PLANE_STEPS.stress_fall
) -> MechanicalProblem:
    """The problem with parts of its constraints, and with bounds on parts of a largest stress.

    Where that is the objective, the derivative of the mean over all lowers one place and raises
    others: so each part is to become less than the largest by a share, the ``fall`` of a step.
    """
    split = problem.parted(response)
    if not isinstance(problem.objective, PeakStress):
        return split
    largest = (1.0 - fall) * value_of(problem.objective, response)
    bound = Constraint(problem.objective, upper=largest, name="objective: largest stress")
    return replace(split, constraints=[*split.constraints, *bound.parts(response)])


def _stacked(rows: list[Array | csr_matrix]) -> Array | csr_matrix:
    """Rows below each other, sparse where some are."""
    if not any(map(issparse, rows)):
        return np.vstack(rows)
    return csr_matrix(sparse_vstack(list(map(csr_matrix, rows))))


def of_stress(problem: Problem, margin: float) -> dict[str, float]:
    """Safety ``margin`` of bounds of a largest stress, by their names."""
    return {c.label: margin for c in problem.constraints if is_stress(c.objective)}


def geometry_of(problem: Problem) -> BoundaryGeometry[Any]:
    """What the boundaries of its designed bodies are."""
    first = next(iter(problem.flexible.values()))
    return _GEOMETRIES[first.domain.dimension]
