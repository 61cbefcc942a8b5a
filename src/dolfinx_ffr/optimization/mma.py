# SPDX-License-Identifier: MIT
"""Design by the method of moving asymptotes, with any number of constraints.

    min over z of psi(z)   such that   g_k(z) <= 0,   lower <= z <= upper,

where the g_k are the volume bound of each body and the constraints of the problem. The method
replaces psi and the g_k by separable convex functions around the best design so far, whose
curvature is raised until they are on the safe side: a design that is kept fulfils all constraints.
It is NLopt's; here are its stages, its checkpoints and its work on several ranks.

NLopt asks for one design after the other: each is an iteration, and a row of the history. The
gradient of one that is worse than the best feasible one is never used, and not computed.

NLopt cannot be interrupted and continued. What it has been told in the present stage is therefore
part of the checkpoint, and is told again: a resumed run tries the same designs as one that was
never interrupted.

References:
    K. Svanberg, International Journal for Numerical Methods in Engineering 24 (1987),
    doi:10.1002/nme.1620240207.
    K. Svanberg, SIAM Journal on Optimization 12 (2002), doi:10.1137/S1052623499362822.
    S. G. Johnson, The NLopt nonlinear-optimization package, https://github.com/stevengj/nlopt.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import nlopt
import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..design import Design, shrunk
from ..dynamics import SimulationError
from ..parallel import announce
from ..problem import Evaluation
from .loop import FEASIBLE, DesignLoop, Optimizer
from .result import Result

__all__ = ["MMA"]

Array = NDArray[np.float64]

#: Iterations over which convergence is judged; NLopt may reject several in a row
WINDOW = 8
#: A design that cannot be simulated counts as this many times worse than the one that is kept
FAILED = 10.0
#: A design this many times softer than before its projection became sharper is in pieces
APART = 1e3


@dataclass(frozen=True)
class MMA(Optimizer):
    """Globally convergent method of moving asymptotes, for densities and level sets.

    Args:
        approximation: ``"quadratic"`` or ``"reciprocal"``, the two separable functions of
            Svanberg's paper of 2002. Inertia makes derivatives of both signs, for which quadratic
            ones fit as well on both sides, and need fewer iterations.
        tolerance: A stage has converged when psi falls by less than this, relatively, over eight
            iterations. The next stage begins where one has converged, or has had its share of the
            iterations, but at least eight.
        stage_iterations: Iterations that a stage has at most; by default those of the run are
            shared out evenly where it begins. A number makes the way of a design independent of the
            number of iterations, which then says only where it ends.
        boldness: psi is handed to NLopt in units of its value at the beginning of a stage, times
            this. Larger numbers make the first steps of a stage longer, and more of them rejected.

    Raises:
        ValueError: If a number is out of range.
    """

    approximation: Literal["quadratic", "reciprocal"] = "quadratic"
    tolerance: float = 1e-3
    boldness: float = 1.0
    stage_iterations: int | None = field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        """Check the numbers."""
        known = ("quadratic", "reciprocal")
        validation.choice("MMA: approximation", self.approximation, known)
        validation.number("MMA: tolerance", self.tolerance, least=0.0)
        validation.number("MMA: boldness", self.boldness, above=0.0)
        if self.stage_iterations is not None:
            validation.whole("MMA: stage_iterations", self.stage_iterations, least=1)

    @staticmethod
    def fits(design: Any) -> bool:
        """Whether the method can move a ``design``: any whose variables are bounded."""
        return hasattr(design, "as_design")

    def run(
        self,
        loop: DesignLoop,
        designs: Mapping[str, Any],
        start: Mapping[str, Array],
        volume: Mapping[str, float],
    ) -> Result:
        """The best ``designs`` of the last stage from ``start`` below ``volume`` in a ``loop``."""
        run = _Run(self, loop, designs, volume)
        with loop.running():
            data = loop.earlier(run.identity())
            loop.plan(run.stages, self.stage_iterations)
            if data is None:
                run.begin(start)
            else:
                run.load(data)
            while not run.reason:
                run.stage()
        kept = run.kept
        assert kept.evaluation is not None
        return loop.result(
            run.designs, run.split(kept.variables), kept.evaluation, run.reason, run.volume
        )


@dataclass
class _Kept:
    """The best design so far: feasible with the least psi, or else the least infeasible one."""

    variables: Array
    psi: float
    bounds: Array  #: g of all constraints, shape (constraints,)
    evaluation: Evaluation | None = field(default=None, repr=False)

    def beats(self, other: _Kept | None) -> bool:
        """Whether this design is better than another."""
        if other is None:
            return True
        mine, its = (max(float(np.max(kept.bounds)), 0.0) for kept in (self, other))
        if its > FEASIBLE:
            return mine < its
        return mine <= FEASIBLE and self.psi < other.psi


class _Run:
    """One run: stages, each a call of NLopt."""

    def __init__(
        self,
        options: MMA,
        loop: DesignLoop,
        designs: Mapping[str, Any],
        volume: Mapping[str, float],
    ) -> None:
        self.options, self.loop = options, loop
        #: Of this stage
        self.designs: dict[str, Design] = {
            name: design.as_design() for name, design in designs.items()
        }
        self.volume = dict(volume)
        self.stages = max(design.stages for design in self.designs.values())
        self.sizes = {name: design.size for name, design in self.designs.items()}
        self.reason = ""
        self.iteration = -1
        #: The best design of the stage before this one
        self.before: _Kept | None = None
        self.next_stage(0, np.empty(0))

    def next_stage(self, stage: int, variables: Array) -> None:
        """Begin a stage at some variables."""
        self.number, self.start = stage, variables
        self.since = self.iteration
        self.told: list[Array] = []  # psi and constraints of each trial
        self.gradients: dict[int, Array] = {}  # by number of the trial
        self.calls = 0
        self.ended = False
        self.best: _Kept | None = None
        self.sharpen(stage)

    @property
    def kept(self) -> _Kept:
        """The best design of this stage."""
        assert self.best is not None
        return self.best

    # ------------------------------------------------------------------ variables

    def begin(self, start: Mapping[str, Array]) -> None:
        """Take the start design."""
        self.start = self.shrunk({n: design.check(start[n]) for n, design in self.designs.items()})

    def shrunk(self, variables: Mapping[str, Array]) -> Array:
        """All variables, lowered until the volume bounds hold."""
        return np.concatenate(
            [
                shrunk(design, variables[name], self.volume[name])
                for name, design in self.designs.items()
            ]
        )

    def split(self, variables: Array) -> dict[str, Array]:
        """The variables of each body."""
        ends = np.cumsum(list(self.sizes.values()))[:-1]
        return dict(zip(self.sizes, np.split(variables, ends), strict=True))

    def densities(self, variables: Array) -> dict[str, Array]:
        """The densities of this rank's cells."""
        parts = self.split(variables)
        return {name: design.density(parts[name]) for name, design in self.designs.items()}

    # ------------------------------------------------------------------ one stage

    def stage(self) -> None:
        """Let NLopt work through a stage, and begin the next one."""
        comm = self.loop.comm
        # rank 0 asks NLopt, the others evaluate with it what it wants to know
        if comm.rank == 0:
            self.ask_nlopt()
        else:
            while not self.ended:
                variables = self.from_rank_0()
                if variables is None:
                    break
                self.trial(variables)
        if not self.ended:  # NLopt itself saw no way on
            self.ended = True
            if self.number + 1 == self.stages:
                self.reason = "converged"
        if not self.reason:
            self.before = self.kept
            number, variables = self.number + 1, self.split(self.kept.variables)
            self.next_stage(number, np.empty(0))
            self.start = self.shrunk(variables)

    def sharpen(self, stage: int) -> None:
        """Make the designs as sharp as in a stage."""
        self.designs = {
            name: design.at_stage(min(stage, design.stages - 1))
            for name, design in self.designs.items()
        }

    def ask_nlopt(self) -> None:
        """Run NLopt's optimiser on this rank."""
        error: list[BaseException] = []

        def objective(variables: Array, gradient: Array) -> float:
            try:
                self.trial(self.from_rank_0(np.array(variables)))
            except BaseException as caught:  # it must not pass through compiled code
                error.append(caught)
                raise nlopt.ForcedStop from None
            if self.ended:
                raise nlopt.ForcedStop
            if gradient.size:
                gradient[:] = scale() * self.gradient()[0]
            return float(scale() * self.told[self.calls - 1][0])

        def bounds(values: Array, variables: Array, gradient: Array) -> None:
            # asked for right after the objective, at the same variables
            if gradient.size:
                gradient[:] = self.gradient()[1:]
            values[:] = self.told[self.calls - 1][1:]

        def scale() -> float:
            return self.options.boldness / abs(self.told[0][0] or 1.0)

        quadratic = self.options.approximation == "quadratic"
        optimizer = nlopt.opt(nlopt.LD_CCSAQ if quadratic else nlopt.LD_MMA, len(self.start))
        lower, upper = (
            np.concatenate(
                [np.full(n, getattr(self.designs[k], side)) for k, n in self.sizes.items()]
            )
            for side in ("lower", "upper")
        )
        optimizer.set_lower_bounds(lower)
        optimizer.set_upper_bounds(upper)
        optimizer.set_min_objective(objective)
        count = len(self.designs) + len(self.loop.problem.constraints)
        optimizer.add_inequality_mconstraint(bounds, np.full(count, FEASIBLE))
        # a fixed point is recognised by the rows; this only keeps NLopt from turning on the spot
        optimizer.set_maxeval(max(self.loop.iterations, self.iteration) + 2)
        try:
            optimizer.optimize(self.start)
        except (nlopt.ForcedStop, nlopt.RoundoffLimited):
            pass
        if error:
            raise error[0]
        if not self.ended:
            self.from_rank_0()

    def from_rank_0(self, variables: Array | None = None) -> Any:
        """The variables that NLopt asks for, or None where it asks for no more."""
        announce(self.loop.comm, "a trial of MMA")
        return self.loop.comm.bcast(variables, root=0)

    def gradient(self) -> Array:
        """The derivatives of the last trial, shape (1 + constraints, variables)."""
        found = self.gradients.get(self.calls - 1)
        return np.zeros((len(self.told[0]), len(self.start))) if found is None else found

    # ------------------------------------------------------------------ one trial

    def trial(self, variables: Array) -> None:
        """Evaluate what NLopt asks for, on all ranks together, and record it."""
        call = self.calls
        self.calls += 1
        if call < len(self.told):
            self.replay(call, variables)
            return
        densities = self.densities(variables)
        best = self.best
        try:
            evaluation = self.loop.value(densities)
        except SimulationError:  # so soft that it cannot move: as bad as can be
            if best is None and self.before is None:
                raise
            if best is None:
                self.stall()
                return
            bad = FAILED * max(abs(best.psi), abs(float(self.told[0][0])))
            found = _Kept(variables, bad, best.bounds + FAILED)
        else:
            found = _Kept(variables, evaluation.psi, self.bounds(evaluation), evaluation)
            if best is None and self.before and found.psi > APART * abs(self.before.psi):
                self.stall()
                return
        self.iteration += 1
        # NLopt never looks at the gradient of a trial that is worse than a feasible one
        worse = best is not None and np.max(best.bounds) <= 0.0 and found.psi >= best.psi
        self.told.append(np.array([found.psi, *found.bounds]))
        if found.evaluation is not None and not worse:
            self.differentiate(found, call)
        accepted = found.beats(best)
        if accepted:
            self.best = found
        kept = self.kept
        assert kept.evaluation is not None
        self.loop.record(
            self.iteration,
            densities if accepted else self.densities(kept.variables),
            kept.evaluation,
            accepted=accepted,
            step=0.0 if best is None else self.relative_step(variables - best.variables),
            width=max(design.width for design in self.designs.values()),
            state=self.state() if self.iteration else None,
        )
        self.decide()

    def stall(self) -> None:
        """End the run with the best design of the stage before, as this one falls apart."""
        self.number -= 1
        self.sharpen(self.number)
        self.best = self.before
        self.reason, self.ended = "stalled", True

    def replay(self, call: int, variables: Array) -> None:
        """Tell NLopt again what it was told before the run was interrupted."""
        told = self.told[call]
        found = _Kept(variables, float(told[0]), told[1:])
        if found.beats(self.best):
            self.best = found
        if call + 1 == len(self.told):
            kept = self.kept
            evaluation = self.loop.value(self.densities(kept.variables))
            self.loop.resumed(evaluation)
            kept.evaluation = self.with_gradient(evaluation, kept.variables)
            self.decide()

    def relative_step(self, difference: Array) -> float:
        """The largest change of a variable as a share of its bounds."""
        parts = self.split(np.abs(difference))
        return max(
            float(np.max(parts[name])) / (design.upper - design.lower)
            for name, design in self.designs.items()
        )

    def bounds(self, evaluation: Evaluation) -> Array:
        """G of all constraints: the volumes of the bodies, and those of the problem."""
        volumes = [evaluation.volume[name] / self.volume[name] - 1.0 for name in self.designs]
        return np.array([*volumes, *(c.value for c in evaluation.constraints.values())])

    def with_gradient(self, evaluation: Evaluation, variables: Array) -> Evaluation:
        """An evaluation with its gradient."""
        parts = self.split(variables)

        def distance(name: str) -> Array | None:
            return self.designs[name].distance(parts[name])

        return self.loop.differentiate(evaluation, distance, self.iteration)

    def differentiate(self, found: _Kept, call: int) -> None:
        """Add the gradients of a trial."""
        assert found.evaluation is not None
        evaluation = self.with_gradient(found.evaluation, found.variables)
        found.evaluation = evaluation
        parts = self.split(found.variables)
        rows = [evaluation.gradient]
        for moving, design in self.designs.items():
            share = design.domain.cell_volumes / design.domain.area / self.volume[moving]
            rows.append(
                {
                    n: share if n == moving else np.zeros(d.domain.n_cells)
                    for n, d in self.designs.items()
                }
            )
        rows.extend(constraint.gradient for constraint in evaluation.constraints.values())
        if any(row is None for row in rows):
            raise ValueError(
                "MMA: this way to the gradient gives none of the constraints; take ExactAdjoint"
            )
        self.gradients[call] = np.array(
            [
                np.concatenate([d.pullback(parts[n], row[n]) for n, d in self.designs.items()])  # type: ignore[index]
                for row in rows
            ]
        )

    def decide(self) -> None:
        """Set why the run ends here, or that the stage does."""
        if self.iteration >= self.loop.iterations:
            self.reason = "iterations"
        elif self.loop.interrupted():
            self.reason = "interrupted"
        last = self.number + 1 == self.stages
        share = (self.number + 1) * self.loop.stage_iterations
        converged = self.converged()
        # an even density has no shape yet that could become sharper
        shaped = len(self.told) > WINDOW
        if not self.reason and last and converged:
            self.reason = "converged"
        done = converged or (shaped and self.iteration >= share)
        self.ended = bool(self.reason) or (done and not last)

    def converged(self) -> bool:
        """Whether psi hardly falls any more."""
        feasible = [i for i, told in enumerate(self.told) if np.max(told[1:]) <= FEASIBLE]
        # from the first feasible design on, psi of the one that is kept does not rise
        if not feasible or len(self.told) - feasible[0] <= WINDOW + 1:
            return False
        before, now = self.loop.rows[-1 - WINDOW]["psi"], self.loop.rows[-1]["psi"]
        return before - now < self.options.tolerance * abs(before)

    # ------------------------------------------------------------------ checkpoint

    def state(self) -> dict[str, Any]:
        """All that a later run needs to go on."""
        calls = sorted(self.gradients)
        return {
            "iteration": self.iteration,
            "stage": self.number,
            "since": self.since,
            "start": self.start,
            "told": np.array(self.told),
            "calls": np.array(calls),
            "gradients": np.array([self.gradients[call] for call in calls]),
        }

    def load(self, data: Mapping[str, Any]) -> None:
        """Take the state of an earlier run."""
        self.iteration = int(data["iteration"])
        self.next_stage(int(data["stage"]), data["start"])
        self.since = int(data["since"])
        self.told = list(data["told"])
        self.gradients = dict(zip(map(int, data["calls"]), data["gradients"], strict=True))

    def identity(self) -> dict[str, Any]:
        """What a checkpoint and the run that reads it have in common."""
        common: dict[str, Any] = {"optimizer": repr(self.options)}
        for name, design in self.designs.items():
            parts = {**design.identity(), "volume": self.volume[name]}
            common |= {f"{key} of {name}": value for key, value in parts.items()}
        return common
