# SPDX-License-Identifier: MIT
"""Steps of boundaries that are fields, as the loop asks for them.

The steps themselves are `FieldSteps`. Here are their safety margins where the largest stress
counts or finer meshes exceed a bound, these meshes, and the state in a checkpoint.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..boundary_field import MovingBoundary
from ..objective import is_stress
from ..part import STRESSED, TURN
from ..problem import Problem
from .boundary_phase import BoundaryPhase
from .checkpoint import Checkpoint
from .descent import of_stress
from .enough_modes import chosen_methods, with_methods
from .field_steps import FieldSteps
from .field_trial import FieldProblem, FieldTrial
from .result import BoundaryResult, ranks_of
from .running import Run
from .signed_log import SignedLog
from .stepper import FEASIBLE, numbers_by_name, safety_margins, with_prefix, without_prefix
from .trial_failed import TrialFailed


@dataclass(frozen=True)
class PhaseOptions:
    """Numbers that are chosen for what goes with the steps of fields."""

    #: Share by which a largest stress is kept below its bound in steps, and where it is reported:
    #: it differs as much from mesh to mesh
    stress_spare: float = 0.01
    stress_spare_reported: float = 5e-3
    #: Share of its violation by which a bound on stress is tightened after a step, and at most
    tightened: float = 0.4
    tightest: float = 0.08
    #: Share of that margin which is given back after a step without violation
    relaxed: float = 0.2
    #: Reach of the first step after a bound was tightened, in minimum members: the best is near
    short: float = 0.12
    #: Share by which a size may be missed before that is warned of
    missed: float = 0.01


class FieldPhaseSteps(Iterator[FieldTrial]):
    """Steps of fields with margins, finer meshes and a state; ends where no step is better.

    Args:
        problem: What is lowered.
        fields: Where the steps begin, by body.
        mode_tolerance: Relative error of psi by the normal modes that a body leaves out, or None.
        state: Of an earlier run from these fields, by `state`; None begins.
        options: Numbers that are chosen.
    """

    reason = "no better step"
    converged = False
    #: One finer mesh tells the result, however much psi changes by it
    still = math.inf

    def __init__(
        self,
        problem: FieldProblem,
        fields: Mapping[str, MovingBoundary],
        mode_tolerance: float | None,
        state: Mapping[str, Any] | None = None,
        options: PhaseOptions = PhaseOptions(),
    ) -> None:
        self._start, self._mode_tolerance, self._options = dict(fields), mode_tolerance, options
        self._stressed = problem.turn < math.inf
        self.number = self.last = 0
        self._steps = self._begun(problem) if state is None else self._restored(problem, state)
        self.row = self.row_of(self.trial)

    def _begun(self, problem: FieldProblem) -> FieldSteps:
        try:
            trial = problem.trial(self._start)
        except TrialFailed as failed:  # there is nothing to go back to
            raise failed.__cause__ or failed from None
        return FieldSteps(problem, trial, self._mode_tolerance)

    @property
    def trial(self) -> FieldTrial:
        """The present trial."""
        return self._steps.trial

    @property
    def mode_errors(self) -> dict[str, float]:
        """Of psi of the best trial, by the modes that bodies leave out."""
        return self._steps.best.mode_errors

    def __next__(self) -> FieldTrial:
        """The trial after one step; collective."""
        trial = next(self._steps)
        self.number += 1
        if self._stressed:
            options, margin = self._options, self._steps.problem.step_margin
            if trial.violation > FEASIBLE:
                margin = min(margin + options.tightened * trial.violation, options.tightest)
            else:
                margin *= 1.0 - options.relaxed
            self._steps.problem = replace(self._steps.problem, step_margin=margin)
        last = self._steps.history[-1]
        self.row = self.row_of(trial) | {name: last[name] for name in ("step", "rejected")}
        self.row |= {name: float(count) for name, count in self._steps.changes.items()}
        return trial

    def rank(self, trial: FieldTrial) -> tuple[bool, float]:
        """Which of several trials is the best: the one of the least rank."""
        return self._steps.rank(trial)

    def row_of(self, trial: FieldTrial) -> dict[str, float]:
        """The row of the history for a trial that no step has led to."""
        bodies = [trial.problem.flexible[name] for name in trial.fields]
        volume = trial.evaluation.volume
        filled = sum(volume[n] * trial.problem.flexible[n].domain.area for n in trial.fields)
        full = sum(boundary.body.area for boundary in trial.fields.values())
        return {
            "psi": trial.evaluation.psi,
            "volume": filled / full,
            "narrowest": trial.narrowest,
            "excess": max(0.0, *trial.violations.values()) if trial.violations else 0.0,
            "size_violation": trial.size_violation,
            "step": 0.0,
            "cells": sum(body.domain.n_cells_global for body in bodies),
            "modes": sum(body.modes for body in bodies),
            "rejected": 0.0,
            "removed": 0.0,
            "inserted": 0.0,
        }

    # ------------------------------------------------------------------ finer meshes

    def _fine(self) -> FieldProblem:
        """The problem on meshes that resolve notches."""
        problem = self._steps.problem
        margins = of_stress(problem.problem, self._options.stress_spare_reported)
        turn = STRESSED if self._stressed else TURN
        return replace(problem, turn=turn, fine=True, margins=margins, step_margin=0.0)

    def refined(self) -> tuple[FieldTrial, float]:
        """The best trial on finer meshes, and how much psi changed."""
        best = self._steps.best
        best.release()
        try:
            fine = self._fine().trial(best.fields)
        except (TrialFailed, MemoryError):
            return best, math.inf
        fine = replace(fine, mode_errors=best.mode_errors)
        return fine, abs(best.evaluation.psi / fine.evaluation.psi - 1.0)

    @property
    def first(self) -> Callable[[], FieldTrial]:
        """Evaluates the boundaries at the start on finer meshes."""
        fine, start = self._fine(), self._start
        return lambda: fine.trial(start)

    def tighten(self, fine: FieldTrial) -> bool:
        """Tighten the bounds that only ``fine`` meshes of the best trial exceed; if there are any.

        The next steps are short, as the best trial is near.
        """
        steps = self._steps
        margins = safety_margins(steps.problem.margins, steps.best, fine)
        if not margins:
            return False
        steps.problem = replace(steps.problem, margins=margins)
        steps.trial = steps.best = replace(steps.best, margins=margins)
        steps.begin_anew(self._options.short)
        return True

    def remarks(self, trial: FieldTrial) -> list[str]:
        """What is to be said of a result, besides bounds and sizes of its parts."""
        return [
            f"a member, gap or radius of {name!r} is {rows.violation:.1%} below its minimum: take "
            "more iterations, another start or other bounds"
            for name, rows in trial.rows.items()
            if rows.violation > self._options.missed
        ]

    # ------------------------------------------------------------------ in a checkpoint

    @staticmethod
    def identity(fields: Mapping[str, MovingBoundary]) -> dict[str, Array]:
        """What a run and the one that goes on from it have in common."""
        return {name: field.variables for name, field in fields.items()}

    def state(self) -> dict[str, Any]:
        """All that the next step depends on, as arrays by name."""
        steps, problem = self._steps, self._steps.problem
        assert problem.logarithm is not None
        bodies = problem.problem.flexible
        now = {name: field.variables for name, field in steps.trial.fields.items()}
        best = {name: field.variables for name, field in steps.best.fields.items()}
        return {
            "number": self.number,
            "log_scale": problem.logarithm.scale,
            "step_margin": problem.step_margin,
            "methods": chosen_methods(problem.problem),
            **with_prefix("learnt", steps.learnt()),
            **with_prefix("now", now),
            **with_prefix("best", {} if steps.best is steps.trial else best),
            **with_prefix("margin", problem.margins),
            **with_prefix("modes", {name: body.modes for name, body in bodies.items()}),
            **with_prefix("error", self.mode_errors),
        }

    def _restored(self, problem: FieldProblem, state: Mapping[str, Any]) -> FieldSteps:
        modes = {name: int(count) for name, count in numbers_by_name("modes", state).items()}
        problem = replace(
            problem,
            problem=with_methods(problem.problem.with_modes(modes), state["methods"].tolist()),
            logarithm=SignedLog(float(state["log_scale"])),
            margins=numbers_by_name("margin", state),
            step_margin=float(state["step_margin"]),
        )
        now, best = (self._fields(what, state) for what in ("now", "best"))
        errors = numbers_by_name("error", state)
        trial = replace(problem.trial(now), mode_errors=errors)
        best_trial = replace(problem.trial(best), mode_errors=errors) if best else trial
        steps = FieldSteps(problem, trial, None)
        steps.mode_tolerance, steps.best = self._mode_tolerance, best_trial
        steps.restore(without_prefix("learnt", state))
        self.number = int(state["number"])
        return steps

    def _fields(self, what: str, state: Mapping[str, Any]) -> dict[str, MovingBoundary]:
        names = [name for name in self._start if f"{what} {name}" in state]
        return {n: self._start[n].with_variables(np.asarray(state[f"{what} {n}"])) for n in names}


def moved_fields(
    problem: Problem,
    fields: Mapping[str, MovingBoundary],
    volume: Mapping[str, float],
    variables: Mapping[str, Array],
    iterations: int,
    mode_tolerance: float | None,
    progress: bool,
    checkpoint: Checkpoint | None = None,
) -> BoundaryResult:
    """Lower the objective by moving boundaries that are fields; as `move_boundary`."""
    phase, objectives = PhaseOptions(), [case.objective for case in problem.load_cases.values()]
    objectives += [constraint.objective for constraint in problem.constraints]
    field_problem = FieldProblem(
        problem,
        dict(volume),
        dict(variables),
        next(iter(fields.values())).options,
        turn=TURN if any(map(is_stress, objectives)) else math.inf,
        margins=of_stress(problem, phase.stress_spare),
    )

    def steps_from(
        show: Callable[[str], object], state: Mapping[str, Any] | None
    ) -> FieldPhaseSteps:
        return FieldPhaseSteps(replace(field_problem, tell=show), fields, mode_tolerance, state)

    run = Run(ranks_of(problem), iterations, "step", progress, "boundary")
    identity = FieldPhaseSteps.identity(fields)
    return BoundaryPhase(run, iterations, identity, checkpoint).result(steps_from)
