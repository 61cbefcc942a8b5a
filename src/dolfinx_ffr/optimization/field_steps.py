# SPDX-License-Identifier: MIT
"""Steps of boundaries that are fields: lower psi within sizes, volumes and constraints.

Each step fits meshes to the parts, takes the exact derivative by their nodes back to the variables
of the fields, and projects the steepest descent onto the linear constraints. A step that cannot be
meshed or simulated, or that raises the merit, is taken back and halved.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..boundary_field import (
    JoinedMotions,
    MovingBoundary,
    Projection,
    Secants,
    SmoothMotion,
    Step,
    split_by_boundary,
)
from ..parallel import on_rank_0
from .field_topology import with_better_topology
from .field_trial import FieldGradients, FieldProblem, FieldTrial
from .result import ranks_of
from .signed_log import SignedLog
from .trial_failed import TrialFailed, shaping


@dataclass(eq=False)
class FieldSteps:
    """Steps from one trial to the next; an iterator that ends when no step is better.

    Its `best` trial is the one that satisfies all constraints and has the lowest psi.
    """

    problem: FieldProblem
    trial: FieldTrial
    mode_tolerance: float | None = 2e-3
    converged: bool = False  #: Whether no step was better
    history: list[dict[str, float]] = field(default_factory=list)  #: One row a trial
    #: Members that were inserted and removed before the last step
    changes: dict[str, int] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        options = self.problem.options
        self._first = {name: body.modes for name, body in self.trial.problem.flexible.items()}
        self.best = self.trial
        self._check_modes()
        logarithm = self.problem.logarithm or SignedLog.around(self.trial.evaluation.psi)
        self.problem = replace(self.problem, logarithm=logarithm)
        self.trial = self.best = replace(self.trial, logarithm=logarithm)
        member = min(boundary.member for boundary in self.trial.fields.values())
        self._member, self._reach = member, options.longest_reach * member
        self._bound_weight = options.bound_weight
        self._weight: float | None = None
        self._secants = Secants()
        self._next_look, self._pause = 0, options.topology_every
        self._note(0.0, 0)

    def __iter__(self) -> Iterator[FieldTrial]:
        return self

    def __next__(self) -> FieldTrial:
        """The trial after one step; collective."""
        if self.converged:
            raise StopIteration
        options, before = self.problem.options, self.trial
        gradients = self.problem.gradients(before)
        smooth, projection = self._projection(before, gradients)
        self.changes = {"inserted": 0, "removed": 0}
        if len(self.history) > self._next_look:
            costs = self._costs(projection, gradients)
            self.trial = with_better_topology(
                self.problem, before, gradients, costs, self._bound_weight
            )
            # what was in vain is not tried again soon
            self._pause = options.topology_every if self.trial is not before else 2 * self._pause
            self._next_look += self._pause
            if self.trial is not before:
                self.changes = _changes(before, self.trial)
                before.release()
                before, self._secants = self.trial, Secants()
                gradients = self.problem.gradients(before)
                smooth, projection = self._projection(before, gradients)
        after, step, rejected = self._accepted(projection, gradients, smooth)
        if after is None or step is None:
            self.converged = True
            raise StopIteration

        better = self._merit(after) < self._merit(before)
        longest = options.longest_reach * self._member
        self._reach = min(self._reach * (options.longer if better else options.shorter), longest)
        if self.problem.turn < math.inf:
            self._reach = max(self._reach, options.shortest_of_stress * self._member)
        motion = np.concatenate(
            [before_.motion_to(after.fields[name]) for name, before_ in before.fields.items()]
        )
        self._secants = self._secants.after(motion, gradients.psi, options.secants)
        before.release()
        after.mode_errors.update(before.mode_errors)  # as last estimated
        self.trial = after
        self._note(float(np.max(np.abs(step.motion))), rejected)
        if len(self.history) % options.topology_every == 0:
            self._check_modes()
        if self.rank(self.trial) <= self.rank(self.best):
            self.best = self.trial
        return self.trial

    def _projection(
        self, trial: FieldTrial, gradients: FieldGradients
    ) -> tuple[dict[str, SmoothMotion], Projection]:
        """The steps from a trial; variables at their bounds that would leave these stay."""
        slopes = split_by_boundary(gradients.psi, trial.fields)
        smooth = {n: b.smooth_motion(slopes[n]) for n, b in trial.fields.items()}
        joined = JoinedMotions(list(smooth.values()))
        share = self.problem.options.curvature_share
        bends = self._secants.bends(joined.metric, gradients.psi, share)
        return smooth, Projection(joined, gradients.psi, gradients.slopes, bends)

    def _costs(self, projection: Projection, gradients: FieldGradients) -> Array:
        """What all constraints cost, as shares of psi, (rows,)."""
        values = np.minimum(gradients.values, self.problem.options.at_once)
        return projection.within(values, self._reach, self._weight).multipliers

    def _accepted(
        self, projection: Projection, gradients: FieldGradients, smooth: Mapping[str, SmoothMotion]
    ) -> tuple[FieldTrial | None, Step | None, int]:
        """The first trial that is accepted, its step, and how many were taken back."""
        options, before = self.problem.options, self.trial
        values = np.minimum(gradients.values, options.at_once)
        for rejected in range(100):
            step = on_rank_0(
                ranks_of(before.problem),
                lambda: projection.within(values, self._reach, self._weight),
            )
            self._weight = step.weight
            costs = step.multipliers[len(values) - gradients.bounds :]
            self._bound_weight = max(self._bound_weight, 1.5 * float(np.sum(costs)))
            try:
                after = self.problem.trial(self._moved(before, step.motion, smooth))
            except TrialFailed:
                after = None
            if after is not None and self._merit(after) <= self._merit(before) + options.noise:
                return after, step, rejected
            if after is not None and self._at_shortest_of_stress:
                return after, step, rejected
            self._reach *= options.shorter
            if self._reach < options.shortest * self._member:
                break
        return None, None, 0

    def _moved(
        self, trial: FieldTrial, motion: Array, smooth: Mapping[str, SmoothMotion]
    ) -> dict[str, MovingBoundary]:
        """The boundaries after a motion of all."""
        motions = split_by_boundary(motion, trial.fields)
        with shaping():
            return {n: b.moved(motions[n], smooth[n]) for n, b in trial.fields.items()}

    def _check_modes(self) -> None:
        problem, trial = self.problem.with_enough(self.trial, self.mode_tolerance, self._first)
        if problem is not self.problem:
            self._secants = Secants()
            # what was computed with fewer modes does not count
            if self.best is not self.trial:
                self.best = replace(problem.trial(self.best.fields), mode_errors=trial.mode_errors)
                self.best.release()
            else:
                self.best = trial
        self.problem, self.trial = problem, trial

    def _merit(self, trial: FieldTrial) -> float:
        return trial.merit(self._bound_weight)

    def rank(self, trial: FieldTrial) -> tuple[bool, float]:
        """Which of several trials is the best: the one of the least rank."""
        return not trial.feasible, self._merit(trial)

    @property
    def _at_shortest_of_stress(self) -> bool:
        """Whether shorter steps would change the largest stress less than another mesh does."""
        shortest = self.problem.options.shortest_of_stress * self._member
        return self.problem.turn < math.inf and self._reach <= shortest

    def begin_anew(self, reach: float) -> None:
        """Forget the curvature, and take a step of at most so many minimum members."""
        self._secants, self._reach = Secants(), min(self._reach, reach * self._member)

    def learnt(self) -> dict[str, Any]:
        """What the next step depends on besides trial and best, as arrays by name."""
        count = len(self.history[0])
        return {
            "reach": self._reach,
            "bound_weight": self._bound_weight,
            "weight": math.nan if self._weight is None else self._weight,
            "motions": np.array(self._secants.motions),
            "gradients": np.array(self._secants.gradients),
            "next_look": self._next_look,
            "pause": self._pause,
            "columns": list(self.history[0]),
            "history": np.array([list(row.values()) for row in self.history]).reshape(-1, count),
        }

    def restore(self, learnt: Mapping[str, Any]) -> None:
        """Go on with what an earlier run has `learnt`."""
        self._reach, self._bound_weight = float(learnt["reach"]), float(learnt["bound_weight"])
        weight = float(learnt["weight"])
        self._weight = None if math.isnan(weight) else weight
        self._secants = Secants(tuple(learnt["motions"]), tuple(learnt["gradients"]))
        self._next_look, self._pause = int(learnt["next_look"]), int(learnt["pause"])
        columns = [str(name) for name in learnt["columns"]]
        rows = learnt["history"].tolist()
        self.history = [dict(zip(columns, row, strict=True)) for row in rows]

    def _note(self, step: float, rejected: int) -> None:
        trial = self.trial
        areas = {n: trial.problem.flexible[n].domain.area for n in trial.fields}
        full = sum(boundary.body.area for boundary in trial.fields.values())
        row = {"psi": trial.evaluation.psi, "volume": sum(areas.values()) / full}
        row |= {"excess": trial.violation, "size_violation": trial.size_violation}
        row |= {"step": step, "reach": self._reach, "rejected": float(rejected)}
        self.history.append(row)


def _changes(before: FieldTrial, after: FieldTrial) -> dict[str, int]:
    """How many members or holes came and went, as the number of holes tells."""
    holes = [sum(b.n_holes for b in trial.fields.values()) for trial in (before, after)]
    return {"inserted": max(0, holes[1] - holes[0]), "removed": max(0, holes[0] - holes[1])}
