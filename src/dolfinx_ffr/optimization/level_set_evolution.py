# SPDX-License-Identifier: MIT
"""Design by explicit steps of level sets.

Each iteration makes one explicit step of an `Evolution` and accepts it if psi falls; otherwise the
next step is half as long. The projection from void to solid becomes sharper in stages: at first
derivatives reach over an element, and the final design is sharp. In the second half of the stages
an eroded design is analysed (`LevelSet.eroded`); bounds on volumes, psi and densities of the result
belong to the nominal one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import validation
from ..arrays import Array
from ..design import Evolution, LevelSet
from ..dynamics import SimulationError
from ..problem import Evaluation
from .loop import Arrays, Bounds, DesignLoop, Designs, Iterate, Optimizer
from .result import Result, warn

#: Factors of the step's size after an accepted and after a rejected step
GROW, SHRINK = 1.3, 0.5
#: Shortest step, as a share of a spacing, before the stage has converged
SHORTEST = 1e-3
#: Number of accepted steps between re-initialisations to the signed distance
REINITIALIZED = 5
#: Number of iterations over which psi must fall by more than the tolerance
WINDOW = 5
#: Ratio of psi to a reference above which a design is in pieces, so that its gradient is that of
#: the void between them
APART = 1e3


@dataclass(frozen=True)
class LevelSetEvolution(Optimizer):
    """Explicit steps of level sets, for a volume bound and no other constraint.

    Args:
        sharpness: Steepness of the projection in each stage. A stage ends when it has converged or
            used its share of the iterations.
        step: Largest change of phi in one iteration, in knot spacings (CFL number); above one the
            zero line overshoots thin struts.
        tolerance: A stage has converged when psi falls by less than this, relatively, over five
            iterations.
        stage_iterations: Largest number of iterations of a stage; by default the iterations of the
            run are divided evenly. A number makes the path of a design independent of the number of
            iterations.
    """

    sharpness: Sequence[float] = (11.0, 19.0, 32.0, 56.0)
    step: float = 1.0
    tolerance: float = 1e-3
    stage_iterations: int | None = None

    def __post_init__(self) -> None:
        label = "LevelSetEvolution: sharpness"
        if not len(validation.real_array(label, self.sharpness, (None,))):
            raise ValueError(f"{label} must have a number for each stage, but it is empty")
        for value in self.sharpness:
            validation.number(label, value, above=0.0)
        validation.number("LevelSetEvolution: step", self.step, above=0.0)
        validation.number("LevelSetEvolution: tolerance", self.tolerance, least=0.0)
        if (count := self.stage_iterations) is not None:
            validation.integer("LevelSetEvolution: stage_iterations", count, least=1)

    def run(self, loop: DesignLoop, designs: Designs, start: Arrays, volume: Bounds) -> Result:
        """The level sets ``designs`` moved from ``start`` below ``volume`` in a ``loop``."""
        steps = LevelSetSteps(self, loop, designs, volume)
        with loop.running():
            reason = loop.follow(steps, start, len(steps.stages), self.stage_iterations)
            state = steps.state
            evaluation = steps.nominal(state, steps.evaluation)
            designs, coefficients = steps.designs(state), steps.coefficients(state)
            return loop.result(designs, coefficients, evaluation, reason, steps.bounds)


def _in_pieces(psi: float) -> float:
    """The value above which a design is in pieces, if psi of the reference is ``psi``."""
    return psi + (APART - 1.0) * abs(psi)


@dataclass
class _State:
    """The state on which the next iteration depends."""

    phi: dict[str, Array]
    iteration: int = 0
    stage: int = 0
    size: float = 1.0
    accepted: int = 0  #: Number of accepted steps since the last re-initialisation
    stage_start: int = 0  #: Iteration in which the stage began


class LevelSetSteps(Iterator[Iterate]):
    """The iterations of one run; after `begin` or `load` it is at a ``state``."""

    reason = "stalled"
    state: _State
    evaluation: Evaluation  #: Of the state, with its gradient

    def __init__(
        self, options: LevelSetEvolution, loop: DesignLoop, designs: Designs, volume: Bounds
    ) -> None:
        for name, design in designs.items():
            if not isinstance(design, LevelSet):
                raise ValueError(
                    f"optimize: LevelSetEvolution moves level sets, and the design of body "
                    f"{name!r} is a {type(design).__name__}; give optimizer=MMA()"
                )
        if loop.problem.combine.bounds:
            raise ValueError(
                "optimize: LevelSetEvolution minimises one smooth number, and the largest value of "
                "several load cases (WorstCase) is not smooth; give optimizer=MMA(), or combine "
                "them by a PowerMean"
            )
        if loop.problem.constraints:
            raise ValueError(
                "optimize: LevelSetEvolution takes a volume bound and no other constraint, and the "
                "problem has some; give optimizer=MMA()"
            )
        self.loop, self.options = loop, options
        evolutions = {name: Evolution(design, volume[name]) for name, design in designs.items()}
        self.bounds = volume  #: Of the filled shares, by name of the body
        #: Evolutions of each stage, by name of the body
        self.stages = []
        for stage, sharpness in enumerate(options.sharpness):
            eroded = 2 * stage >= len(options.sharpness)
            self.stages.append(
                {
                    name: evolution.with_sharpness(sharpness, eroded=eroded)
                    for name, evolution in evolutions.items()
                }
            )

    def coefficients(self, state: _State) -> dict[str, Array]:
        """The coefficients of the level sets."""
        evolutions = self.stages[state.stage]
        return {name: e.variables(state.phi[name]) for name, e in evolutions.items()}

    def densities(self, state: _State) -> dict[str, Array]:
        """The analysed densities of this rank's cells."""
        variables, evolutions = self.coefficients(state), self.stages[state.stage]
        return {name: e.analysed.density(variables[name]) for name, e in evolutions.items()}

    def designs(self, state: _State) -> dict[str, LevelSet]:
        """The nominal level sets, with the sharpness of a state."""
        return {name: e.levelset for name, e in self.stages[state.stage].items()}

    def nominal(self, state: _State, evaluation: Evaluation) -> Evaluation:
        """The evaluation of the nominal level sets, even if eroded ones are analysed."""
        if all(e.analysed is e.levelset for e in self.stages[state.stage].values()):
            return evaluation
        variables = self.coefficients(state)
        return self.loop.value({n: d.density(variables[n]) for n, d in self.designs(state).items()})

    def value(self, state: _State, limit: float = math.inf) -> Evaluation | None:
        """The evaluation of a state; None where psi exceeds a limit or nothing can be simulated."""
        try:
            evaluation = self.loop.value(self.densities(state))
        except SimulationError:  # so soft that it cannot move
            if limit == math.inf:
                raise
            return None
        return evaluation if evaluation.psi <= limit else None

    def differentiate(self, evaluation: Evaluation, state: _State) -> Evaluation:
        """The evaluation of a state with its gradient."""

        def distance(name: str) -> Array:
            evolution = self.stages[state.stage][name]
            return evolution.levelset.distance(evolution.variables(state.phi[name]))

        return self.loop.differentiate(evaluation, distance, state.iteration)

    @property
    def converged(self) -> bool:
        """Whether the last stage has converged."""
        is_last = self.state.stage + 1 == len(self.options.sharpness)
        return is_last and self._converged(self.state)

    def __next__(self) -> Iterate:
        """The accepted design after one step."""
        if self.stage_ended(self.state):
            sharper = self.next_stage(self.state, self.evaluation)
            if sharper is None:
                raise StopIteration
            self.state, self.evaluation = sharper
        self.state, self.evaluation, accepted, multiplier = self.stepped(
            self.state, self.evaluation
        )
        return self.iterate(accepted=accepted, multiplier=multiplier)

    def begin(self, start: Mapping[str, Array]) -> Iterate:
        """The first state."""
        phi = {n: evolution.start(start[n]) for n, evolution in self.stages[0].items()}
        state = _State(phi, size=self.options.step)
        even_phi = {n: e.bounded(np.zeros(len(phi[n]))) for n, e in self.stages[0].items()}
        even = replace(state, phi=even_phi)
        even_evaluation = self.value(even)
        assert even_evaluation is not None
        evaluation = self.value(state, _in_pieces(even_evaluation.psi))
        if evaluation is None:
            warn(
                "optimize: the start design has fallen apart; the loop begins with an even density "
                "instead. Take smaller or fewer holes, or raise the volume bound, to which the "
                "start design is shrunk"
            )
            state, evaluation = even, even_evaluation
        self.state, self.evaluation = state, self.differentiate(evaluation, state)
        return self.iterate()

    def stepped(
        self, state: _State, evaluation: Evaluation
    ) -> tuple[_State, Evaluation, bool, float]:
        """The next state, its evaluation, whether the step was accepted, and the multiplier."""
        gradient = evaluation.gradient
        assert gradient is not None
        reinitialized = state.accepted + 1 >= REINITIALIZED
        moved, multiplier = {}, 0.0
        for name, evolution in self.stages[state.stage].items():
            phi, of_volume = evolution.step(state.phi[name], gradient[name], state.size)
            moved[name] = evolution.reinitialize(phi) if reinitialized else phi
            multiplier = max(multiplier, of_volume)
        trial = replace(state, phi=moved, iteration=state.iteration + 1)
        evaluated = self.value(trial, evaluation.psi)
        if evaluated is not None and evaluated.psi < evaluation.psi:
            evaluated = self.loop.accurate(evaluated, self.densities(trial), trial.iteration)
            trial.size = min(GROW * state.size, self.options.step)
            trial.accepted = 0 if reinitialized else state.accepted + 1
            return trial, self.differentiate(evaluated, trial), True, multiplier
        shorter = replace(state, iteration=state.iteration + 1, size=SHRINK * state.size)
        if reinitialized:
            shorter.accepted = 0  # the next trial is not re-initialised
        return shorter, evaluation, False, multiplier

    def stage_ended(self, state: _State) -> bool:
        """Whether the next stage begins, if there is one."""
        stages = len(self.options.sharpness)
        if state.stage + 1 >= stages:
            return False
        share = (state.stage + 1) * self.loop.stage_iterations
        return state.iteration >= share or self._converged(state)

    def next_stage(self, state: _State, evaluation: Evaluation) -> tuple[_State, Evaluation] | None:
        """The state at the beginning of the next stage; None if it falls apart there."""
        stage = state.stage + 1
        sharper = replace(
            state,
            phi={n: evolution.bounded(state.phi[n]) for n, evolution in self.stages[stage].items()},
            stage=stage,
            stage_start=state.iteration,
            size=max(state.size, 0.3 * self.options.step),
        )
        evaluated = self.value(sharper, _in_pieces(evaluation.psi))
        return None if evaluated is None else (sharper, self.differentiate(evaluated, sharper))

    def _converged(self, state: _State) -> bool:
        if state.size < SHORTEST:
            return True
        # the row in which a stage began has the value of the last stage
        if state.iteration - state.stage_start <= WINDOW:
            return False
        rows = self.loop.rows
        earlier_psi, psi = rows[-1 - WINDOW]["psi"], rows[-1]["psi"]
        # after a rejected step a shorter one may still lower psi
        is_accepted = rows[-1]["accepted"] > 0
        return earlier_psi - psi < self.options.tolerance * abs(earlier_psi) and is_accepted

    def iterate(self, *, accepted: bool = True, multiplier: float = 0.0) -> Iterate:
        """The state for history and checkpoint."""
        state, evaluation = self.state, self.evaluation
        fields = {k: v for k, v in vars(state).items() if k != "phi"}
        fields |= {f"phi of {name}": phi for name, phi in state.phi.items()}
        return Iterate(
            iteration=state.iteration,
            x=self.densities(state),
            evaluation=evaluation,
            accepted=accepted,
            step=state.size,
            sharpness=max(e.levelset.sharpness for e in self.stages[state.stage].values()),
            merit=evaluation.psi,
            multiplier=multiplier,
            state=fields if state.iteration else None,
        )

    def identity(self) -> dict[str, Any]:
        """The entries that a checkpoint and the run that reads it have in common."""
        common: dict[str, Any] = {"optimizer": "LevelSetEvolution"}
        for name, evolution in self.stages[0].items():
            levelset = evolution.levelset
            entries = {**levelset.identity(), "sharpness": list(self.options.sharpness)}
            entries["volume"] = evolution.bound
            common |= {f"{key} of {name}": value for key, value in entries.items()}
        return common

    def load(self, data: Mapping[str, Any]) -> None:
        """Continue from the state of an earlier run, which is evaluated anew."""
        names = [name for name in _State.__dataclass_fields__ if name != "phi"]
        fields: dict[str, Any] = {name: data[name].item() for name in names}
        state = _State({name: data[f"phi of {name}"] for name in self.stages[0]}, **fields)
        evaluation = self.loop.value(self.densities(state))
        self.loop.resumed(evaluation)
        self.state, self.evaluation = state, self.differentiate(evaluation, state)
