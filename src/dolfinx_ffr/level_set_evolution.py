# SPDX-License-Identifier: MIT
"""Design by explicit steps of level sets.

Each iteration makes one explicit step (`dolfinx_ffr.evolution`) and keeps it if psi falls;
otherwise the next step is half as long. The smoothed Heaviside function starts wide, so that
derivatives reach over an element, and narrows in stages, so that the final design is nearly solid
and void.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .design_loop import DesignLoop, Result
from .dynamics import SimulationError
from .evolution import Evolution
from .levelset import LevelSet
from .sensitivity import Evaluation

__all__ = ["LevelSetEvolution"]

Array = NDArray[np.float64]

#: factors of the step's size after one that was kept and one that was not
GROW, SHRINK = 1.3, 0.5
#: a step shorter than this share of a spacing means that there is no descent left
SHORTEST = 1e-3
#: iterations over which convergence is judged
WINDOW = 5
#: a design this many times softer than what it is compared with is in pieces: its gradient tells of
#: the void that holds it together, and leads nowhere
APART = 1e3


@dataclass(frozen=True)
class LevelSetEvolution:
    """Explicit steps of one level set a body; takes a volume bound and no other constraint.

    Args:
        evolution: how the level set moves, of several bodies by name; by default an `Evolution`
            with the volume bound of the run. One that is given brings its own bound.
        widths: half-widths of the smoothed Heaviside function in units of a mean element, one a
            stage. The next stage begins where one has converged, or has had its share of the
            iterations. Below a fifth of an element derivatives miss the quadrature points.
            The level set keeps the last width.
        step: largest change of phi in one iteration, in knot spacings (CFL number); above one the
            zero line overshoots thin struts.
        tolerance: a stage has converged when psi falls by less than this, relatively, over five
            iterations.
        reinitialize_every: steps kept between re-initialisations to the signed distance; 0 for
            none.

    Raises:
        ValueError: if a number is out of range.
    """

    evolution: Evolution | Mapping[str, Evolution] | None = None
    widths: Sequence[float] = (1.0, 0.6, 0.35, 0.2)
    step: float = 1.0
    tolerance: float = 1e-3
    reinitialize_every: int = 5

    def __post_init__(self) -> None:
        """Check the numbers."""
        widths = tuple(self.widths)
        for name, value, fits in (
            ("widths", widths, len(widths) > 0 and all(0.0 < w < np.inf for w in widths)),
            ("step", self.step, 0.0 < self.step < np.inf),
            ("tolerance", self.tolerance, 0.0 <= self.tolerance < np.inf),
            ("reinitialize_every", self.reinitialize_every, self.reinitialize_every >= 0),
        ):
            if not fits:
                raise ValueError(f"optimize: {name} = {value} must be positive and finite")

    def run(
        self,
        loop: DesignLoop,
        designs: Mapping[str, Any],
        start: Mapping[str, Array],
        volume: Mapping[str, float],
    ) -> Result:
        """Return the last design that was kept.

        Args:
            loop: evaluates and records.
            designs: level set by name of the body.
            start: coefficients by name of the body, shape (knots,).
            volume: upper bound of the filled share by name of the body.

        Raises:
            ValueError: on every rank, if the parts do not fit each other.
            SimulationError: on every rank, if not even an even density can be simulated.
        """
        steps = _Steps(self, loop, designs, volume)
        data = loop.earlier(steps.identity())
        if data is not None:
            state = steps.loaded(data)
            evaluation = steps.evaluate(state)
            loop.resumed(evaluation)
            evaluation = steps.differentiate(evaluation, state)
        else:
            state, evaluation = steps.begin(start)
            steps.record(state, evaluation)
        reason = ""
        with loop.running():
            while True:
                reason = steps.ended(state) or ("interrupted" if loop.interrupted() else "")
                if reason:
                    break
                if steps.stage_ended(state):
                    narrowed = steps.next_stage(state, evaluation)
                    if narrowed is None:
                        reason = "stalled"
                        break
                    state, evaluation = narrowed
                state, evaluation, accepted, multiplier = steps.iterate(state, evaluation)
                steps.record(state, evaluation, accepted=accepted, multiplier=multiplier)
        return loop.result(steps.densities(state), steps.coefficients(state), evaluation, reason)


@dataclass
class _State:
    """All that the next iteration depends on."""

    phi: dict[str, Array]
    iteration: int = 0
    stage: int = 0
    size: float = 1.0
    accepted: int = 0  # since the last re-initialisation
    since: int = 0  # iteration in which the stage began


class _Steps:
    """What an iteration does."""

    def __init__(
        self,
        options: LevelSetEvolution,
        loop: DesignLoop,
        designs: Mapping[str, Any],
        volume: Mapping[str, float],
    ) -> None:
        for name, design in designs.items():
            if not isinstance(design, LevelSet):
                raise ValueError(
                    f"optimize: LevelSetEvolution moves level sets, and the design of body "
                    f"{name!r} is a {type(design).__name__}; give optimizer=MMA()"
                )
        if loop.problem.constraints:
            raise ValueError(
                "optimize: LevelSetEvolution takes a volume bound and no other constraint, and the "
                "problem has some; give optimizer=MMA()"
            )
        self.loop, self.options = loop, options
        self.levelsets: dict[str, LevelSet] = dict(designs)
        given = options.evolution
        if given is None:
            self.evolutions = {n: Evolution(ls, volume[n]) for n, ls in self.levelsets.items()}
        else:
            by_name = given if isinstance(given, Mapping) else dict.fromkeys(designs, given)
            self.evolutions = dict(by_name)
        if list(self.evolutions) != list(self.levelsets) or any(
            self.evolutions[name].levelset is not levelset
            for name, levelset in self.levelsets.items()
        ):
            raise ValueError("optimize: the evolution moves another level set")

    # ------------------------------------------------------------------ evaluations

    def coefficients(self, state: _State) -> dict[str, Array]:
        """Return the coefficients of the level sets."""
        return {name: ls.interpolate(state.phi[name]) for name, ls in self.levelsets.items()}

    def densities(self, state: _State) -> dict[str, Array]:
        """Return the densities of this rank's cells."""
        alpha = self.coefficients(state)
        return {name: ls.fill_fraction(alpha[name]) for name, ls in self.levelsets.items()}

    def set_width(self, stage: int) -> None:
        """Give the smoothed Heaviside functions the width of a stage."""
        for levelset in self.levelsets.values():
            levelset.width = levelset.element * self.options.widths[stage]

    def evaluate(self, state: _State) -> Evaluation:
        """Return the value of a state."""
        self.set_width(state.stage)
        return self.loop.value(self.densities(state))

    def differentiate(self, evaluation: Evaluation, state: _State) -> Evaluation:
        """Return the evaluation of a state with its gradient."""

        def distance(name: str) -> Array:
            levelset = self.levelsets[name]
            return levelset.boundary_distance(levelset.interpolate(state.phi[name]))

        return self.loop.differentiate(evaluation, distance, state.iteration)

    def begin(self, start: Mapping[str, Array]) -> tuple[_State, Evaluation]:
        """Return the first state with its evaluation."""
        self.set_width(0)
        phi = {n: evolution.start(start[n]) for n, evolution in self.evolutions.items()}
        given = _State(phi, size=self.options.step)
        flat = {n: e.bounded(np.zeros(len(phi[n]))) for n, e in self.evolutions.items()}
        even = replace(given, phi=flat)
        limit = APART * self.loop.value(self.densities(even)).psi
        try:
            evaluation = self.evaluate(given)
            if evaluation.psi <= limit:
                return given, self.differentiate(evaluation, given)
        except SimulationError:  # so soft that it cannot move
            pass
        warnings.warn(
            "optimize: the start design has fallen apart; the loop begins with an even density "
            "instead. Take smaller or fewer holes, or raise the volume bound, to which the start "
            "design is shrunk",
            stacklevel=4,
        )
        return even, self.differentiate(self.evaluate(even), even)

    def iterate(
        self, state: _State, evaluation: Evaluation
    ) -> tuple[_State, Evaluation, bool, float]:
        """Return the state after one step that was tried, its evaluation, and what became of it."""
        if evaluation.gradient is None:
            raise AssertionError("the design that is kept has its gradient")
        due = bool(
            self.options.reinitialize_every
            and state.accepted + 1 >= self.options.reinitialize_every
        )
        moved, multiplier = {}, 0.0
        for name, evolution in self.evolutions.items():
            phi, found_multiplier = evolution.step(
                state.phi[name], evaluation.gradient[name], state.size
            )
            moved[name] = evolution.reinitialize(phi) if due else phi
            multiplier = max(multiplier, found_multiplier)
        trial = replace(state, phi=moved, iteration=state.iteration + 1)
        try:
            found = self.loop.value(self.densities(trial))
        except SimulationError:  # so soft that it cannot move: as bad as can be
            found = None
        if found is not None and found.psi < evaluation.psi:
            trial.size = min(GROW * state.size, self.options.step)
            trial.accepted = 0 if due else state.accepted + 1
            return trial, self.differentiate(found, trial), True, multiplier
        kept = replace(state, iteration=state.iteration + 1, size=SHRINK * state.size)
        if due:
            kept.accepted = 0  # the next trial does without
        return kept, evaluation, False, multiplier

    # ------------------------------------------------------------------ stages

    def stage_ended(self, state: _State) -> bool:
        """Return whether a narrower Heaviside function is due."""
        stages = len(self.options.widths)
        if state.stage + 1 >= stages:
            return False
        share = (state.stage + 1) * self.loop.iterations / stages
        return state.iteration >= share or self._converged(state)

    def next_stage(self, state: _State, evaluation: Evaluation) -> tuple[_State, Evaluation] | None:
        """Return the state at the beginning of the next stage; None if it falls apart there."""
        self.set_width(state.stage + 1)
        narrowed = replace(
            state,
            phi={n: evolution.bounded(state.phi[n]) for n, evolution in self.evolutions.items()},
            stage=state.stage + 1,
            since=state.iteration,
            size=max(state.size, 0.3 * self.options.step),
        )
        try:
            found = self.evaluate(narrowed)
            if found.psi <= APART * evaluation.psi:
                return narrowed, self.differentiate(found, narrowed)
        except SimulationError:  # so soft that it cannot move
            pass
        self.set_width(state.stage)
        return None

    def ended(self, state: _State) -> str:
        """Return why the loop ends here, or nothing."""
        if state.stage + 1 == len(self.options.widths) and self._converged(state):
            return "converged"
        return "iterations" if state.iteration >= self.loop.iterations else ""

    def _converged(self, state: _State) -> bool:
        if state.size < SHORTEST:
            return True
        # the row in which a stage began still holds the value before it was narrowed
        if state.iteration - state.since <= WINDOW:
            return False
        rows = self.loop.rows
        before, now = rows[-1 - WINDOW]["psi"], rows[-1]["psi"]
        # a halved step may well bring a descent that the longer one missed
        return before - now < self.options.tolerance * before and rows[-1]["accepted"] > 0

    # ------------------------------------------------------------------ records

    def record(
        self,
        state: _State,
        evaluation: Evaluation,
        *,
        accepted: bool = True,
        multiplier: float = 0.0,
    ) -> None:
        """Add a state to history and checkpoint."""
        fields = {k: v for k, v in vars(state).items() if k != "phi"}
        self.loop.record(
            state.iteration,
            self.densities(state),
            evaluation,
            accepted=accepted,
            step=state.size,
            width=max(levelset.width for levelset in self.levelsets.values()),
            multiplier=multiplier,
            state={**fields, **{f"phi of {name}": phi for name, phi in state.phi.items()}}
            if state.iteration
            else None,
        )

    def identity(self) -> dict[str, Any]:
        """Return what a checkpoint and the run that reads it have in common."""
        common: dict[str, Any] = {"optimizer": "LevelSetEvolution"}
        for name, levelset in self.levelsets.items():
            parts = {
                "knots": levelset.knots,
                "kernel": repr(levelset.basis.kernel),
                "cells": levelset.domain.n_cells_global,
                "widths": [levelset.element * w for w in self.options.widths],
                "volume": self.evolutions[name].bisection.bound,
            }
            common |= {f"{key} of {name}": value for key, value in parts.items()}
        return common

    def loaded(self, data: Mapping[str, Any]) -> _State:
        """Return the state of an earlier run."""
        fields: dict[str, Any] = {
            name: data[name].item() for name in _State.__dataclass_fields__ if name != "phi"
        }
        return _State({name: data[f"phi of {name}"] for name in self.levelsets}, **fields)
