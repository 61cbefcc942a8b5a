# SPDX-License-Identifier: MIT
"""Steps of curves in the plane and of surfaces in space, as an iterator of trials.

A step goes along the best motion within linear constraints. It is halved until it can be meshed and
simulated and does not raise the merit by more than another mesh alone would.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..boundary import Boundary, Surface
from .descent import NONE, Descent, Slopes, Step, Trial
from .enough_modes import EVERY, chosen_methods, with_methods
from .signed_log import SignedLog
from .stepper import FEASIBLE, numbers_by_name, safety_margins, with_prefix, without_prefix
from .topology import changed, with_slides
from .trial_failed import TrialFailed

Boundaries = dict[str, Boundary | Surface]

#: Share by which the result may miss a minimum radius before that is warned of, as of other sizes
_RADIUS_TOLERANCE = 0.01


class CurveSteps(Iterator[Trial]):
    """Steps of the boundaries of a problem; ends where no step is better.

    Args:
        descent: Evaluates boundaries, and finds steps.
        boundaries: The boundaries from which the steps begin, by body.
        steps: Planned number of steps.
        mode_tolerance: Relative error of psi by the normal modes that a body leaves out, or None.
        state: State of an earlier run from these boundaries, by `state`; None begins a run.
    """

    reason = "no better step"
    converged = False

    def __init__(
        self,
        descent: Descent,
        boundaries: Boundaries,
        steps: int,
        mode_tolerance: float | None,
        state: Mapping[str, Any] | None = None,
    ) -> None:
        self.start, self.planned = boundaries, steps
        #: Number of the last step, which is followed by finer meshes
        self.last = steps
        #: Number of the step that was taken last
        self.number = 0
        self._mode_tolerance = mode_tolerance
        self._first_modes = {n: body.modes for n, body in descent.problem.flexible.items()}
        self._descent = descent
        self._options = descent.options
        self._reach, self._weight = self._options.first, self._options.penalty
        self._margin, self._secants = 0.0, NONE
        if state is None:
            self._begin(boundaries)
        else:
            self._restore(state)
        #: Row of the history for the present trial
        self.row = self.row_of(self.trial)

    def _begin(self, boundaries: Boundaries) -> None:
        try:
            trial = self._descent.trial_of(boundaries)
        except TrialFailed as failed:  # there is nothing to go back to
            raise failed.__cause__ or failed from None
        descent, trial, errors = self._accurate(self._descent, trial)
        self._first_psi = trial.evaluation.psi
        logarithm = SignedLog.around(self._first_psi)
        self._descent = replace(descent, logarithm=logarithm)
        self.trial = self.best = replace(trial, logarithm=logarithm)
        self.mode_errors = self._errors = errors

    def __next__(self) -> Trial:
        """The trial after one step; collective."""
        number = self.number + 1
        slopes = self._descent.slopes(self.trial, self._margin)
        inserted = removed = 0
        if number % EVERY == 1 and number < max(self.planned - 1, 2):
            slopes, inserted, removed = self._change_topology(slopes)
        next_trial, step, rejected = self._accepted(slopes)
        if next_trial is None or step is None:
            raise StopIteration
        self._adapt(next_trial, step)
        self.trial.release()
        self._secants = self._descent.secants(self._secants, self.trial, slopes, next_trial)
        self.trial = next_trial
        if number % EVERY == 0 or number == self.last:
            self._check_modes()
        if self.rank(self.trial) <= self.rank(self.best):
            self.best, self.mode_errors = self.trial, self._errors
        self.number = number
        longest = max(float(np.max(np.abs(offsets))) for offsets in step.offsets.values())
        self.row = self.trial.row(longest, rejected, removed, inserted)
        return self.trial

    def _change_topology(self, slopes: Slopes) -> tuple[Slopes, int, int]:
        """Insert, delete and translate struts.

        The slopes at the trial with the new struts, and how many struts were inserted and removed.
        """
        before, step = self.trial, self._descent.step(self.trial, slopes, self._reach)
        trial, inserted, removed = changed(
            self._descent, before, slopes.evaluation, step.bound_multipliers, self._weight
        )
        if trial is not before:
            before.release()
            slopes = self._descent.slopes(trial, self._margin)
            self._reach, self._secants = max(self._reach, self._options.reach_again), NONE
        before, slopes_before = trial, slopes
        multipliers = step.bound_multipliers
        trial, slopes = with_slides(self._descent, trial, slopes, multipliers, self._weight)
        if trial is not before:
            before.release()
            self._secants = self._descent.secants(self._secants, before, slopes_before, trial)
        self.trial = trial
        return slopes, inserted, removed

    def _accepted(self, slopes: Slopes) -> tuple[Trial | None, Step | None, int]:
        """The first trial that is accepted, its step, and how many were rejected."""
        options, rejected = self._options, 0
        while self._reach >= options.shortest:
            step = self._descent.step(self.trial, slopes, self._reach, self._secants)
            multipliers = float(np.sum(step.bound_multipliers))
            self._weight = max(self._weight, options.penalty * multipliers)
            trial = self._descent.moved(self.trial, step)
            if trial is not None and self._accepts(trial):
                return trial, step, rejected
            self._reach, rejected = 0.5 * self._reach, rejected + 1
        return None, None, rejected

    def _accepts(self, trial: Trial) -> bool:
        """Whether a step to a trial is accepted."""
        merits = [t.merit(self._weight) for t in (trial, self.trial, self.best)]
        if not self._options.rejects(*merits):
            return True
        # shorter steps change the largest stress less than a new mesh does
        return self._descent.is_stressed and self._reach <= self._options.stress_reach

    def _adapt(self, next_trial: Trial, step: Step) -> None:
        """Choose the reach of the next step, and by how much bounds are tightened."""
        # a step that brings little of what it promises by its curvature was too long
        promised = (
            self._options.promised_share * max(0.0, step.promised) if self._secants.size else 0.0
        )
        better = next_trial.merit(self._weight) < self.trial.merit(self._weight) - promised
        options = self._options
        factor = options.longer if better else options.shorter
        self._reach = min(self._reach * factor, options.longest)
        if self._descent.is_stressed:
            self._reach = max(self._reach, self._options.stress_reach)
            # the largest stress is always a little more than its slopes say
            if next_trial.violation > FEASIBLE:
                self._margin += options.tightening * next_trial.violation
            else:
                self._margin -= 0.5 * options.tightening * self._margin
            self._margin = min(self._margin, options.largest_margin)

    def _check_modes(self) -> None:
        was_best = self.best is self.trial
        descent, self.trial, self._errors = self._accurate(self._descent, self.trial)
        if descent is not self._descent:  # results with fewer modes do not count
            self._descent, self.mode_errors, self._secants = descent, self._errors, NONE
            if was_best:
                self.best = self.trial
            else:
                self.best = descent.trial_of(self.best.boundaries)
                self.best.release()
        self._reach = max(self._reach, self._options.reach_again)

    def _accurate(self, descent: Descent, trial: Trial) -> tuple[Descent, Trial, dict[str, float]]:
        return descent.accurate(trial, self._mode_tolerance, self._first_modes)

    def refined(self) -> tuple[Trial, float]:
        """The best trial on finer meshes, and how much psi changed from one to the next."""
        return self._descent.finer(self.best)

    def tighten(self, fine: Trial) -> bool:
        """Tighten the bounds that the best trial exceeds on ``fine`` meshes alone.

        False if it exceeds none there. The steps that follow begin at the best trial and are short,
        as little has to move for the tightened bounds.
        """
        margins = safety_margins(self._descent.margins, self.best, fine)
        if not margins:
            return False
        self._descent = replace(self._descent, margins=margins)
        self.trial = self.best = replace(self.best, margins=margins)
        self._reach, self._secants = min(self._reach, 2.0 * self._options.stress_reach), NONE
        return True

    def rank(self, trial: Trial) -> tuple[bool, float]:
        """Which of several trials is the best: the one of the least rank."""
        return trial.rank(self._weight)

    def row_of(self, trial: Trial) -> dict[str, float]:
        """The row of the history for a trial to which no step has led."""
        return trial.row(0.0, 0, 0, 0)

    @property
    def first(self) -> Any:
        """Evaluates the boundaries at the start on finer meshes."""
        descent, start = self._descent, self.start
        return lambda: descent.resolved(start)

    def remarks(self, trial: Trial) -> list[str]:
        """What is to be said of a result, by body, besides bounds and sizes of its parts."""
        geometry = self._descent.geometry
        texts = [
            f"a radius of {name!r} is {share:.1%} below its minimum: take more iterations, another "
            "start or other bounds"
            for name, share in trial.radius_violations.items()
            if share > _RADIUS_TOLERANCE
        ]
        for name, boundary in trial.boundaries.items():
            texts += [f"{name!r}: {text}" for text in geometry.remarks(boundary)]
        return texts

    @property
    def mesh_tolerance(self) -> float:
        """Largest change of psi by finer meshes that is not worth a warning."""
        return self._descent.geometry.mesh_tolerance

    # ------------------------------------------------------------------ in a checkpoint

    @staticmethod
    def identity(boundaries: Boundaries) -> dict[str, Array]:
        """What a run and the one that goes on from it have in common."""
        return _states(boundaries)

    def state(self) -> dict[str, Any]:
        """The state of the steps as arrays by name."""
        best = {} if self.best is self.trial else self.best.boundaries
        modes = {name: body.modes for name, body in self._descent.problem.flexible.items()}
        return {
            "number": self.number,
            "reach": self._reach,
            "weight": self._weight,
            "margin": self._margin,
            "first_psi": self._first_psi,
            "methods": chosen_methods(self._descent.problem),
            "secants": self._secants,
            **with_prefix("now", _states(self.trial.boundaries)),
            **with_prefix("best", _states(best)),
            **with_prefix("margins", self._descent.margins),
            **with_prefix("modes", modes),
            **with_prefix("error", self.mode_errors),
        }

    def _restore(self, state: Mapping[str, Any]) -> None:
        self.number = int(state["number"])
        self._reach, self._weight = float(state["reach"]), float(state["weight"])
        self._margin, self._secants = float(state["margin"]), np.asarray(state["secants"])
        self._first_psi = float(state["first_psi"])
        modes = {n: int(count) for n, count in numbers_by_name("modes", state).items()}
        problem = self._descent.problem.with_modes(modes)
        self._descent = replace(
            self._descent,
            problem=with_methods(problem, state["methods"].tolist()),
            margins=numbers_by_name("margins", state),
            logarithm=SignedLog.around(self._first_psi),
        )
        now, best = (_restored(what, state, self.start) for what in ("now", "best"))
        assert now is not None
        self.trial = self._descent.trial_of(now)
        self.best = self._descent.trial_of(best) if best else self.trial
        self.mode_errors = self._errors = numbers_by_name("error", state)


def _states(boundaries: Boundaries) -> dict[str, Array]:
    """The states of boundaries in one mapping."""
    states: dict[str, Array] = {}
    for name, boundary in boundaries.items():
        states |= with_prefix(name, boundary.state())
    return states


def _restored(what: str, state: Mapping[str, Any], start: Boundaries) -> Boundaries | None:
    """The boundaries of a state that began as the ``start`` did; None where there are none."""
    boundaries = {}
    for name, boundary in start.items():
        arrays = without_prefix(f"{what} {name}", state)
        if not arrays:
            return None
        boundaries[name] = boundary.restored(arrays)
    return boundaries
