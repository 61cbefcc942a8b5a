# SPDX-License-Identifier: MIT
"""Design by explicit steps of level sets.

Each iteration makes one explicit step of an `Evolution` and keeps it if psi falls; otherwise the
next step is half as long. The projection from void to solid becomes sharper in stages: at first
derivatives reach over an element, and the final design is crisp. In the second half of the stages
what is analysed lies a little within the boundary of the design that is made (`LevelSet.eroded`);
bounds on volumes, psi and densities of the result are of the latter.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..design import Evolution, LevelSet
from ..dynamics import SimulationError
from ..problem import Evaluation
from .loop import DesignLoop, Optimizer
from .result import DesignWarning, Result

__all__ = ["LevelSetEvolution"]

Array = NDArray[np.float64]

#: Factors of the step's size after one that was kept and one that was not
GROW, SHRINK = 1.3, 0.5
#: A step shorter than this share of a spacing means that there is no descent left
SHORTEST = 1e-3
#: Iterations over which convergence is judged
WINDOW = 5
#: A design this many times softer than what it is compared with is in pieces: its gradient tells of
#: the void that holds it together, and leads nowhere
APART = 1e3


@dataclass(frozen=True)
class LevelSetEvolution(Optimizer):
    """Explicit steps of one level set a body; takes a volume bound and no other constraint.

    Args:
        evolution: How the level set moves, of several bodies by name; by default an `Evolution`
            with the volume bound of the run. One that is given brings its own bound.
        sharpness: Steepness of the projection, one a stage. The next stage begins where one has
            converged, or has had its share of the iterations.
        step: Largest change of phi in one iteration, in knot spacings (CFL number); above one the
            zero line overshoots thin struts.
        tolerance: A stage has converged when psi falls by less than this, relatively, over five
            iterations.
        reinitialize_every: Steps kept between re-initialisations to the signed distance; 0 for
            none.
        stage_iterations: Iterations that a stage has at most; by default those of the run are
            shared out evenly where it begins. A number makes the way of a design independent of the
            number of iterations, which then says only where it ends.

    Raises:
        ValueError: If a number is out of range.
    """

    evolution: Evolution | Mapping[str, Evolution] | None = None
    sharpness: Sequence[float] = (11.0, 19.0, 32.0, 56.0)
    step: float = 1.0
    tolerance: float = 1e-3
    reinitialize_every: int = 5
    stage_iterations: int | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        what = "LevelSetEvolution"
        stages = f"{what}: sharpness"
        if not len(validation.real_array(stages, self.sharpness, (None,))):
            raise ValueError(f"{stages} must have a number for each stage, but it is empty")
        for value in self.sharpness:
            validation.number(stages, value, above=0.0)
        validation.number(f"{what}: step", self.step, above=0.0)
        validation.number(f"{what}: tolerance", self.tolerance, least=0.0)
        validation.integer(f"{what}: reinitialize_every", self.reinitialize_every)
        if self.stage_iterations is not None:
            validation.integer(f"{what}: stage_iterations", self.stage_iterations, least=1)
        given = self.evolution if isinstance(self.evolution, Mapping) else {"": self.evolution}
        for evolution in given.values():
            kinds = (Evolution, type(None))
            validation.instance(f"{what}: evolution", evolution, kinds, "an Evolution")

    @staticmethod
    def fits(design: Any) -> bool:
        """Whether explicit steps can move a ``design``: they move level sets only."""
        return isinstance(design, LevelSet)

    def run(
        self,
        loop: DesignLoop,
        designs: Mapping[str, Any],
        start: Mapping[str, Array],
        volume: Mapping[str, float],
    ) -> Result:
        """The level sets ``designs`` moved from ``start`` below ``volume`` in a ``loop``."""
        steps = _Steps(self, loop, designs, volume)
        with loop.running():
            data = loop.earlier(steps.identity())
            loop.plan(len(steps.stages), self.stage_iterations)
            if data is not None:
                state = steps.loaded(data)
                evaluation = steps.evaluate(state)
                loop.resumed(evaluation)
                evaluation = steps.differentiate(evaluation, state)
            else:
                state, evaluation = steps.begin(start)
                steps.record(state, evaluation)
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
            made = steps.made(state, evaluation)
        return loop.result(
            steps.designs(state), steps.coefficients(state), made, reason, steps.bounds
        )


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
            if not options.fits(design):
                raise ValueError(
                    f"optimize: LevelSetEvolution moves level sets, and the design of body "
                    f"{name!r} is a {type(design).__name__}; give optimizer=MMA()"
                )
        if loop.problem.combine.bounds:
            raise ValueError(
                "optimize: LevelSetEvolution minimises one smooth number, and the largest value of "
                "several motions (WorstCase) is none; give optimizer=MMA(), or combine the motions "
                "by a PowerMean"
            )
        if loop.problem.constraints:
            raise ValueError(
                "optimize: LevelSetEvolution takes a volume bound and no other constraint, and the "
                "problem has some; give optimizer=MMA()"
            )
        self.loop, self.options = loop, options
        given = options.evolution
        if given is None:
            evolutions = {name: Evolution(ls, volume[name]) for name, ls in designs.items()}
        else:
            by_name = given if isinstance(given, Mapping) else dict.fromkeys(designs, given)
            evolutions = dict(by_name)
        if list(evolutions) != list(designs) or any(
            evolutions[name].levelset is not levelset for name, levelset in designs.items()
        ):
            raise ValueError("optimize: the evolution moves another level set")
        #: Of the filled shares, by name of the body
        self.bounds = {name: e.bisection.bound for name, e in evolutions.items()}
        #: Of each stage, by name of the body
        self.stages = [
            {
                name: e.with_sharpness(sharpness, eroded=2 * stage >= len(options.sharpness))
                for name, e in evolutions.items()
            }
            for stage, sharpness in enumerate(options.sharpness)
        ]

    # ------------------------------------------------------------------ evaluations

    def coefficients(self, state: _State) -> dict[str, Array]:
        """The coefficients of the level sets."""
        evolutions = self.stages[state.stage]
        return {name: e.variables(state.phi[name]) for name, e in evolutions.items()}

    def densities(self, state: _State, *, made: bool = False) -> dict[str, Array]:
        """The densities of this rank's cells, as they are analysed, or as they are ``made``."""
        variables, evolutions = self.coefficients(state), self.stages[state.stage]
        return {
            name: (e.levelset if made else e.analysed).density(variables[name])
            for name, e in evolutions.items()
        }

    def designs(self, state: _State) -> dict[str, LevelSet]:
        """The level sets as they are made, as sharp as in a state."""
        return {name: e.levelset for name, e in self.stages[state.stage].items()}

    def made(self, state: _State, evaluation: Evaluation) -> Evaluation:
        """The evaluation of the designs as they are made."""
        evolutions = self.stages[state.stage].values()
        if all(e.analysed is e.levelset for e in evolutions):
            return evaluation
        return self.loop.value(self.densities(state, made=True))

    def evaluate(self, state: _State) -> Evaluation:
        """The value of a state."""
        return self.loop.value(self.densities(state))

    def differentiate(self, evaluation: Evaluation, state: _State) -> Evaluation:
        """The evaluation of a state with its gradient."""

        def distance(name: str) -> Array:
            evolution = self.stages[state.stage][name]
            return evolution.levelset.distance(evolution.variables(state.phi[name]))

        return self.loop.differentiate(evaluation, distance, state.iteration)

    def begin(self, start: Mapping[str, Array]) -> tuple[_State, Evaluation]:
        """The first state with its evaluation."""
        phi = {n: evolution.start(start[n]) for n, evolution in self.stages[0].items()}
        given = _State(phi, size=self.options.step)
        flat = {n: e.bounded(np.zeros(len(phi[n]))) for n, e in self.stages[0].items()}
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
            DesignWarning,
            stacklevel=4,
        )
        return even, self.differentiate(self.evaluate(even), even)

    def iterate(
        self, state: _State, evaluation: Evaluation
    ) -> tuple[_State, Evaluation, bool, float]:
        """The state after one step that was tried, its evaluation, and what became of it."""
        if evaluation.gradient is None:
            raise AssertionError("the design that is kept has its gradient")
        due = bool(
            self.options.reinitialize_every
            and state.accepted + 1 >= self.options.reinitialize_every
        )
        moved, multiplier = {}, 0.0
        for name, evolution in self.stages[state.stage].items():
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
            found = self.loop.with_modes(found, self.densities(trial), trial.iteration)
            trial.size = min(GROW * state.size, self.options.step)
            trial.accepted = 0 if due else state.accepted + 1
            return trial, self.differentiate(found, trial), True, multiplier
        kept = replace(state, iteration=state.iteration + 1, size=SHRINK * state.size)
        if due:
            kept.accepted = 0  # the next trial does without
        return kept, evaluation, False, multiplier

    # ------------------------------------------------------------------ stages

    def stage_ended(self, state: _State) -> bool:
        """Whether a sharper projection is due."""
        stages = len(self.options.sharpness)
        if state.stage + 1 >= stages:
            return False
        share = (state.stage + 1) * self.loop.stage_iterations
        return state.iteration >= share or self._converged(state)

    def next_stage(self, state: _State, evaluation: Evaluation) -> tuple[_State, Evaluation] | None:
        """The state at the beginning of the next stage; None if it falls apart there."""
        stage = state.stage + 1
        narrowed = replace(
            state,
            phi={n: evolution.bounded(state.phi[n]) for n, evolution in self.stages[stage].items()},
            stage=stage,
            since=state.iteration,
            size=max(state.size, 0.3 * self.options.step),
        )
        try:
            found = self.evaluate(narrowed)
            if found.psi <= APART * evaluation.psi:
                return narrowed, self.differentiate(found, narrowed)
        except SimulationError:  # so soft that it cannot move
            pass
        return None

    def ended(self, state: _State) -> str:
        """Why the loop ends here, or nothing."""
        if state.stage + 1 == len(self.options.sharpness) and self._converged(state):
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
            sharpness=max(e.levelset.sharpness for e in self.stages[state.stage].values()),
            merit=evaluation.psi,
            multiplier=multiplier,
            state={**fields, **{f"phi of {name}": phi for name, phi in state.phi.items()}}
            if state.iteration
            else None,
        )

    def identity(self) -> dict[str, Any]:
        """What a checkpoint and the run that reads it have in common."""
        common: dict[str, Any] = {"optimizer": "LevelSetEvolution"}
        for name, evolution in self.stages[0].items():
            levelset = evolution.levelset
            parts = {
                **levelset.identity(),
                "sharpness": list(self.options.sharpness),
                "volume": evolution.bisection.bound,
            }
            common |= {f"{key} of {name}": value for key, value in parts.items()}
        return common

    def loaded(self, data: Mapping[str, Any]) -> _State:
        """The state of an earlier run."""
        fields: dict[str, Any] = {
            name: data[name].item() for name in _State.__dataclass_fields__ if name != "phi"
        }
        return _State({name: data[f"phi of {name}"] for name in self.stages[0]}, **fields)
