# SPDX-License-Identifier: MIT
"""Design by the method of moving asymptotes, with any number of constraints.

    min over z of log psi(z) + penalty(z)   such that   g_k(z) <= 0,   lower <= z <= upper,

where the g_k are the volume bound of each body and the constraints of the problem, and the penalty
is that of the design (a `LevelSet` asks for a minimum size by it). One value and one gradient an
iteration; along the run the design becomes crisp, see `Design.at`.

Near the end a level set is analysed a little within its boundary: psi and the slopes of the
problem's constraints are those of the design that is analysed, the values of all constraints those
of the design that is made (`Design.nominal`), as are psi and densities of the result. Where the
problem has constraints, that takes a second value an iteration.

Steps are not safeguarded by a line search, so that a constraint may be violated by a little along
the way. Near the end the constraints that are violated are tightened by as much, so that the
designs come to lie on the feasible side; the best feasible crisp design is the result. A design
that falls apart (psi rises by a quarter, or a constraint is violated by much more) is taken back,
and the next step is half as long.

Of several motions the largest value is minimised (`WorstCase`) by the bound formulation: log of
each weighted psi is bounded by a variable of its own, which is minimised in the place of log psi.

`PeakStress` stands for the largest stress. It is corrected to it at each design that is kept, and
its slope has the same scale (Le et al., doi:10.1007/s00158-009-0440-y): constraints, and which
design is best, are judged by the largest stress itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..design import Design, shrunk
from ..dynamics import SimulationError
from ..problem import Evaluation
from .loop import FEASIBLE, DesignLoop, Optimizer
from .moving_asymptotes import Asymptotes
from .result import Result

__all__ = ["MMA"]

Array = NDArray[np.float64]

#: Iterations over which convergence is judged
WINDOW = 8
#: Progress from which on designs are crisp, and may be the result
CRISP = 0.85
#: Rise of psi, relative, for which a step is taken back: more than sharpening alone brings
APART = 0.25
#: Rise of the largest violation for which it is: less is mended by the steps that follow
BROKEN = 0.25
#: Steps taken back in a row after which there is no way on
STUCK = 8
#: Growth of the longest step after a step that was kept
RECOVER = 1.5
#: Violation, relative, from which on psi may rise so that a constraint is met
VIOLATED = 1e-3


@dataclass(frozen=True)
class MMA(Optimizer):
    """Method of moving asymptotes, for level sets and densities.

    Args:
        move: Largest change of a variable in an iteration, in shares of its range.
        tolerance: The run has converged when, with a crisp design, log psi and the penalty fall by
            less than this over eight iterations. Zero makes use of all iterations.
        length: Iterations over which the design becomes crisp; by default those of the run that
            begins. A number makes the way of a design independent of the number of iterations,
            which then says only where it ends; a run that is resumed keeps the length it began
            with.

    Raises:
        ValueError: If a number is out of range.
    """

    move: float = 0.1
    tolerance: float = 1e-3
    length: int | None = field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        """Check the numbers."""
        validation.number("MMA: move", self.move, above=0.0, most=1.0)
        validation.number("MMA: tolerance", self.tolerance, least=0.0)
        if self.length is not None:
            validation.integer("MMA: length", self.length, least=1)

    @staticmethod
    def fits(design: Any) -> bool:
        """Whether the method can move a ``design``: any whose variables are bounded."""
        return isinstance(design, Design)

    def run(
        self,
        loop: DesignLoop,
        designs: Mapping[str, Design],
        start: Mapping[str, Array],
        volume: Mapping[str, float],
    ) -> Result:
        """The best crisp ``designs`` from ``start`` below ``volume`` in a ``loop``."""
        run = _Run(self, loop, designs, volume)
        with loop.running():
            data = loop.earlier(run.identity())
            loop.plan(1, self.length)
            if data is None:
                point, now = run.begin(start)
            else:
                point, now = run.load(data)
            while not (reason := run.ended(point)):
                point, now = run.iterate(point, now)
            chosen = run.chosen(point)
            return loop.result(
                run.designs(point.progress, nominal=True),
                run.split(chosen),
                run.evaluation(point, now, chosen),
                reason,
                volume,
            )


@dataclass(frozen=True, eq=False)
class _Point:
    """All that the next iteration depends on, but the evaluation of the design that is kept."""

    asymptotes: Asymptotes
    margins: Array  #: By how much constraints are tightened, shape (m,)
    bounds: Array  #: The constraints of the design that is kept, shape (m,)
    iteration: int = 0
    progress: float = 0.0  #: Of the same
    rejected: int = 0  #: Steps taken back in a row
    held: bool = False  #: The last one for a constraint, which sharpening may have broken
    merit: float = math.inf  #: log psi and penalty of the design that is kept
    best: Array | None = None  #: The best feasible crisp design, shape (n,)
    best_merit: float = math.inf


class _Run:
    """What an iteration does."""

    def __init__(
        self,
        options: MMA,
        loop: DesignLoop,
        designs: Mapping[str, Design],
        volume: Mapping[str, float],
    ) -> None:
        self.options, self.loop = options, loop
        self._designs, self.volume = dict(designs), dict(volume)
        self.sizes = {name: design.size for name, design in designs.items()}
        self.lower, self.upper = (
            np.concatenate([np.full(d.size, getattr(d, side)) for d in designs.values()])
            for side in ("lower", "upper")
        )

    # ------------------------------------------------------------------ variables

    def designs(self, progress: float, *, nominal: bool = False) -> dict[str, Design]:
        """The designs as sharp as at a progress, as they are analysed or as they are made."""
        found = {name: design.at(progress) for name, design in self._designs.items()}
        return {name: d.nominal for name, d in found.items()} if nominal else found

    def split(self, variables: Array) -> dict[str, Array]:
        """The variables of each body."""
        ends = np.cumsum(list(self.sizes.values()))[:-1]
        return dict(zip(self.sizes, np.split(variables, ends), strict=True))

    def shrunk(self, variables: Mapping[str, Array], progress: float) -> Array:
        """All variables, lowered until the volume bounds hold."""
        designs = self.designs(progress)
        return np.concatenate([shrunk(d, variables[n], self.volume[n]) for n, d in designs.items()])

    def densities(
        self, variables: Array, progress: float, *, nominal: bool = False
    ) -> dict[str, Array]:
        """The densities of this rank's cells."""
        parts, designs = self.split(variables), self.designs(progress, nominal=nominal)
        return {name: design.density(parts[name]) for name, design in designs.items()}

    # ------------------------------------------------------------------ iterations

    def begin(self, start: Mapping[str, Array]) -> tuple[_Point, Evaluation]:
        """The first point with its evaluation."""
        variables = self.shrunk({n: d.begin(start[n]) for n, d in self._designs.items()}, 0.0)
        state = Asymptotes(self.lower, self.upper, variables, self.options.move)
        densities = self.densities(variables, 0.0)
        now = self.loop.with_modes(self.loop.value(densities), densities, 0)
        now = self.loop.calibrated(now)
        bounds = self.bounds(variables, self.made(variables, now, 0.0), 0.0)
        merit = self.merit(variables, now, 0.0)
        point = _Point(state, np.zeros(len(bounds)), bounds, merit=merit)
        now = self.differentiate(now, point)
        self.record(point, now, densities, accepted=True, step=0.0, multiplier=0.0)
        return point, now

    def iterate(self, point: _Point, now: Evaluation) -> tuple[_Point, Evaluation]:
        """The point after one step, and the evaluation of the design that is kept."""
        state = point.asymptotes
        slope, slopes = self.functions(point, now)
        peaks, peak_slopes = self.peaks(point, now)
        tried, multipliers = state.step(
            slope,
            np.concatenate([peaks, point.bounds + point.margins]),
            np.vstack([peak_slopes, slopes]),
            bounded=len(peaks),
        )
        multipliers = multipliers[len(peaks) :]
        # every rank has computed the same, and its own last bits may decide nothing
        tried = replace(tried, x=self.loop.comm.bcast(tried.x, root=0))
        iteration = point.iteration + 1
        progress = self.next_progress(point)
        densities = self.densities(tried.x, progress)
        try:
            found = self.loop.value(densities)
        except SimulationError:  # so soft that it cannot move
            found = None
        limit, broken = now.psi + APART * abs(now.psi), False
        if found is None or not math.isfinite(found.psi):
            apart = True
        else:
            # psi may rise where that brings a violated constraint nearer
            bounds = self.bounds(tried.x, found, progress)
            worst, then = float(np.max(point.bounds)), float(np.max(bounds))
            pays = worst > VIOLATED and then < worst
            broken = then > max(worst, 0.0) + BROKEN
            rises = found.psi > limit and not pays
            if rises and not broken:  # what becoming sharper alone brings is no fault of the step
                before = self.psi(state.x, progress)
                rises = found.psi > before + APART * abs(before)
            apart = broken or rises
        if found is None or apart:
            kept = replace(
                point,
                asymptotes=tried.retreat(state),
                iteration=iteration,
                rejected=point.rejected + 1,
                held=broken,
            )
            self.record(
                kept,
                now,
                self.densities(state.x, point.progress),
                accepted=False,
                step=self.relative_step(tried.x - state.x),
                multiplier=float(multipliers[0]),
            )
            return kept, now
        found = self.loop.calibrated(self.loop.with_modes(found, densities, iteration))
        bounds = self.bounds(tried.x, self.made(tried.x, found, progress), progress)
        moved = replace(
            point,
            asymptotes=replace(tried, move=min(RECOVER * tried.move, self.options.move)),
            bounds=bounds,
            iteration=iteration,
            progress=progress,
            rejected=0,
            held=False,
            merit=self.merit(tried.x, found, progress),
        )
        if progress >= CRISP:
            # tightened by what is violated, relaxed slowly where nothing is
            margins = np.where(bounds > 0.0, point.margins + bounds, 0.9 * point.margins)
            moved = replace(moved, margins=margins)
            if np.max(bounds) <= FEASIBLE and moved.merit < point.best_merit:
                moved = replace(moved, best=tried.x, best_merit=moved.merit)
        if iteration < self.loop.iterations:
            found = self.differentiate(found, moved)
        self.record(
            moved,
            found,
            densities,
            accepted=True,
            step=self.relative_step(tried.x - state.x),
            multiplier=float(multipliers[0]),
        )
        return moved, found

    def next_progress(self, point: _Point) -> float:
        """The progress of the next trial, or that of the design kept where a constraint broke."""
        if point.held:
            return point.progress
        return min((point.iteration + 1) / self.loop.stage_iterations, 1.0)

    def relative_step(self, difference: Array) -> float:
        """The largest change of a variable as a share of its bounds."""
        return float(np.max(np.abs(difference) / (self.upper - self.lower)))

    def merit(self, variables: Array, evaluation: Evaluation, progress: float) -> float:
        """Log psi and the penalties; psi itself where it has no logarithm."""
        parts = self.split(variables)
        penalty = sum(d.penalty(parts[n])[0] for n, d in self.designs(progress).items())
        psi = evaluation.psi
        return penalty + (math.log(psi) if psi > 0.0 else psi)

    def psi(self, variables: Array, progress: float) -> float:
        """Psi as it is analysed at a progress; infinite where nothing can be simulated."""
        try:
            return self.loop.value(self.densities(variables, progress)).psi
        except SimulationError:
            return math.inf

    def made(self, variables: Array, analysed: Evaluation, progress: float) -> Evaluation:
        """The evaluation whose constraints are those of the designs as they are made."""
        same = all(design.nominal is design for design in self.designs(progress).values())
        if same or not analysed.constraints:
            return analysed
        try:
            found = self.loop.value(self.densities(variables, progress, nominal=True))
        except SimulationError:  # what is analysed moves, and has a little less material
            return analysed
        # by its own largest stress; the scale of the next designs is that of the analysed one
        return self.loop.problem.calibrated(found)[1]

    def bounds(self, variables: Array, made: Evaluation, progress: float) -> Array:
        """G of all constraints: the volumes of the bodies as made, and those of the problem."""
        densities, domains = self.densities(variables, progress, nominal=True), self.loop.domains
        filled = {n: d.sum(densities[n] * d.cell_volumes) / d.area for n, d in domains.items()}
        volumes = [filled[name] / self.volume[name] - 1.0 for name in self.sizes]
        return np.array([*volumes, *(c.value for c in made.constraints.values())])

    def functions(self, point: _Point, evaluation: Evaluation) -> tuple[Array, Array]:
        """The slope of the merit, and those of the constraints.

        Where the largest of several values is minimised, the slope is that of the penalty alone.
        """
        parts, designs = self.split(point.asymptotes.x), self.designs(point.progress)
        rows: list[Any] = []
        for moving in designs:
            rows.append(
                {
                    n: d.domain.cell_volumes / d.domain.area / self.volume[n]
                    if n == moving
                    else np.zeros(d.domain.n_cells)
                    for n, d in designs.items()
                }
            )
        slopes = self.pulled_back(point, rows, nominal=True)
        others = [constraint.gradient for constraint in evaluation.constraints.values()]
        slopes = np.vstack([slopes, *self.pulled_back(point, others)])
        slope = np.concatenate([d.penalty(parts[n])[1] for n, d in designs.items()])
        if not self.loop.problem.combine.bounds:
            psi = evaluation.psi
            own = self.pulled_back(point, [evaluation.gradient])[0]
            slope = own / (psi if psi > 0.0 else 1.0) + slope
        return slope, slopes

    def peaks(self, point: _Point, evaluation: Evaluation) -> tuple[Array, Array]:
        """The functions whose largest value is minimised, with their slopes; none but then.

        They are the logs of the weighted psi of the motions that come near the largest one, or
        these themselves, relative to the largest, where one is not positive.
        """
        combine = self.loop.problem.combine
        if not combine.bounds:
            return np.zeros(0), np.zeros((0, len(self.lower)))
        motions = evaluation.motions
        psi = {name: motion.psi for name, motion in motions.items()}
        near = combine.near(psi)
        weighted = np.array([combine.weight(name) * psi[name] for name in near])
        slopes = self.pulled_back(point, [motions[name].gradient for name in near])
        weights = np.array([combine.weight(name) for name in near])
        if np.all(weighted > 0.0):
            return np.log(weighted), slopes * (weights / weighted)[:, None]
        scale = float(np.max(np.abs(weighted))) or 1.0
        return weighted / scale, slopes * (weights / scale)[:, None]

    def pulled_back(
        self, point: _Point, rows: Sequence[Mapping[str, Array] | None], *, nominal: bool = False
    ) -> Array:
        """Derivatives with respect to the variables from those by densities, shape (rows, n)."""
        parts = self.split(point.asymptotes.x)
        designs = self.designs(point.progress, nominal=nominal)
        found = []
        for row in rows:
            if row is None:
                raise ValueError(
                    "MMA: this way to the gradient gives none of the constraints, and of several "
                    "motions only that of all together; take ExactAdjoint"
                )
            found.append(np.concatenate([d.pullback(parts[n], row[n]) for n, d in designs.items()]))
        return np.array(found)

    def differentiate(self, evaluation: Evaluation, point: _Point) -> Evaluation:
        """An evaluation with its gradient."""
        parts, designs = self.split(point.asymptotes.x), self.designs(point.progress)
        return self.loop.differentiate(
            evaluation, lambda name: designs[name].distance(parts[name]), point.iteration
        )

    # ------------------------------------------------------------------ end

    def ended(self, point: _Point) -> str:
        """Why the run ends here, or nothing."""
        if point.iteration >= self.loop.iterations:
            return "iterations"
        if self.loop.interrupted():
            return "interrupted"
        if point.rejected >= STUCK:
            return "stalled"
        return "converged" if self.converged(point) else ""

    def converged(self, point: _Point) -> bool:
        """Whether the merit of crisp feasible designs hardly falls any more."""
        crisp = point.iteration - math.ceil(CRISP * self.loop.stage_iterations)
        if point.best is None or crisp <= WINDOW + 1 or point.progress < 1.0:
            return False
        rows = self.loop.rows[-1 - WINDOW :]
        return rows[0]["merit"] - rows[-1]["merit"] < self.options.tolerance

    def chosen(self, point: _Point) -> Array:
        """The variables of the result: the best feasible crisp ones, or else the last ones."""
        return point.asymptotes.x if point.best is None else point.best

    def evaluation(self, point: _Point, now: Evaluation, chosen: Array) -> Evaluation:
        """That of the result."""
        analysed = self.designs(point.progress).values()
        if chosen is point.asymptotes.x and all(d.nominal is d for d in analysed):
            return now
        densities = self.densities(chosen, point.progress, nominal=True)
        return self.loop.calibrated(self.loop.value(densities))

    # ------------------------------------------------------------------ records

    def record(
        self,
        point: _Point,
        evaluation: Evaluation,
        densities: Mapping[str, Array],
        *,
        accepted: bool,
        step: float,
        multiplier: float,
    ) -> None:
        """Add a point to history and checkpoint."""
        state = point.asymptotes
        arrays = {"x": state.x, "margins": point.margins}
        arrays |= {
            name: np.zeros(0) if value is None else value
            for name, value in (
                ("before", state.before),
                ("earlier", state.earlier),
                ("reach", state.reach),
                ("best", point.best),
            )
        }
        numbers = {
            name: getattr(point, name)
            for name in ("iteration", "progress", "rejected", "held", "merit", "best_merit")
        }
        self.loop.record(
            point.iteration,
            densities,
            evaluation,
            accepted=accepted,
            step=step,
            merit=point.merit,
            sharpness=max(d.sharpness for d in self.designs(point.progress).values()),
            multiplier=multiplier,
            state={**arrays, **numbers, "move": state.move} if point.iteration else None,
        )

    def load(self, data: Mapping[str, Any]) -> tuple[_Point, Evaluation]:
        """The point of an earlier run, evaluated anew."""

        def given(name: str) -> Array | None:
            return np.asarray(data[name]) if len(data[name]) else None

        progress = float(data["progress"])
        state = Asymptotes(
            self.lower,
            self.upper,
            np.asarray(data["x"]),
            float(data["move"]),
            given("before"),
            given("earlier"),
            given("reach"),
        )
        now = self.loop.calibrated(self.loop.value(self.densities(state.x, progress)))
        point = _Point(
            state,
            np.asarray(data["margins"]),
            self.bounds(state.x, self.made(state.x, now, progress), progress),
            best=given("best"),
            iteration=int(data["iteration"]),
            progress=progress,
            rejected=int(data["rejected"]),
            held=bool(data["held"]),
            merit=float(data["merit"]),
            best_merit=float(data["best_merit"]),
        )
        self.loop.resumed(now)
        return point, self.differentiate(now, point)

    def identity(self) -> dict[str, Any]:
        """What a checkpoint and the run that reads it have in common."""
        common: dict[str, Any] = {"optimizer": repr(self.options)}
        for name, design in self._designs.items():
            parts = {**design.identity(), "volume": self.volume[name]}
            common |= {f"{key} of {name}": value for key, value in parts.items()}
        return common
