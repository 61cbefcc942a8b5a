# SPDX-License-Identifier: MIT
"""Design by the method of moving asymptotes, with any number of constraints.

    min over z of log psi(z) + penalty(z)   such that   g_k(z) <= 0,   lower <= z <= upper,

where the g_k are the volume bound of each body and the constraints of the problem, and the penalty
is that of the design. One value and one gradient an iteration; the design becomes sharp by and by.

Near the end an eroded level set is analysed: psi and the slopes of the problem's constraints are
those of the eroded design, the values of all constraints those of the nominal one
(`Design.nominal`), as are psi and densities of the result. Where the problem has constraints, that
takes a second value an iteration.

Near the end the constraints that are violated are tightened by as much, so that the designs come to
lie on the feasible side. The best feasible design is the result; where densities become sharp, the
best of those that are.

While densities become sharp psi rises by that alone, and only a design that falls apart (psi rises
by a quarter, or a constraint is violated by much more) is taken back, after which the next step is
half as long. As soon as nothing becomes sharper, a step is taken back unless the merit falls: the
sum of log psi, the penalty, and the violations at twice the price of their multipliers. Then the
second derivatives by each variable are learnt from the gradients (`Secants`), so that what would
swing is damped. The run has converged where the merit can fall by less than the tolerance, to first
order, by a step of the largest length.

For `WorstCase` log of each weighted psi is bounded by a variable, which is minimised in the place
of log psi.

`PeakStress` is corrected to the largest stress at each design that is kept, and its slope has the
same scale (Le et al., doi:10.1007/s00158-009-0440-y): constraints, and which design is best, are
judged by the largest stress itself. As soon as nothing becomes sharper, a bound on it is one bound
for each of some places (`PeakStress.places`), and as the objective it is the largest of these,
minimised as that of load cases: where the stress is nearly the same everywhere, the one slope of a
mean cannot say which place needs more material.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .. import validation
from ..arrays import Array, Integers, Mask
from ..design import Design, Variables, shrunk
from ..dynamics import SimulationError
from ..mechanical_problem import ConstraintValue, MechanicalProblem
from ..objective import Constraint, Response, value_of, whole
from ..problem import Evaluation, Problem
from .loop import FEASIBLE, Arrays, Bounds, DesignLoop, Designs, Iterate, Optimizer
from .moving_asymptotes import Asymptotes, Secants
from .result import Result
from .sizing import Sizing

#: Iterations over which a merit that changes by less than the tolerance stands still
WINDOW = 8
#: Progress from which on designs are sharp, and may be the result
RESULT_PROGRESS = 0.85
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
#: Violation up to which bounds are tightened: a few steps lead back from further outside
NEAR = 0.02
#: Name of the bounds on places of the objective
OBJECTIVE = "objective of each place"
#: Arrays of the asymptotes in a checkpoint, besides x
STATE = ("before", "earlier", "reach")
#: Those of its secants
SECANTS = ("x", "gradients", "curvature")
#: Numbers of a point in a checkpoint, and their kinds
NUMBERS: dict[str, type] = {
    "iteration": int,
    "progress": float,
    "rejected": int,
    "held": bool,
    "merit": float,
    "best_merit": float,
    "residual": float,
}


@dataclass(frozen=True)
class MMA(Optimizer):
    """Method of moving asymptotes, for any bounded variables.

    Args:
        move: Largest change of a variable in an iteration, in shares of its range.
        tolerance: The run has converged when, with a design that becomes no sharper, log psi and
            the penalty can fall by less than this by a step of length ``move``, to first order
            and within the constraints. Zero makes use of all iterations.
        length: Iterations over which the design becomes sharp and its sizes settle; by default
            those of the run that begins, or, where steps of the boundary follow, so many that it is
            sharp at their end, which is at 0.55 of the length. A number makes the path of a design
            independent of the number of iterations; a run that is resumed keeps the length it began
            with.
    """

    move: float = 0.1
    tolerance: float = 1e-3
    length: int | None = field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        validation.number("MMA: move", self.move, above=0.0, most=1.0)
        validation.number("MMA: tolerance", self.tolerance, least=0.0)
        if self.length is not None:
            validation.integer("MMA: length", self.length, least=1)

    def run(self, loop: DesignLoop, designs: Designs, start: Arrays, volume: Bounds) -> Result:
        """The best sharp ``designs`` from ``start`` below ``volume`` in a ``loop``."""
        steps = MMASteps(self, loop, designs, volume)
        with loop.running():
            reason = loop.follow(steps, start, 1, self.length)
            # the best feasible sharp design, or else the last one
            point = steps.point
            chosen = point.asymptotes.x if point.best is None else point.best
            evaluation = steps.evaluation(point, steps.now.evaluation, chosen)
            designs = steps.designs(point.progress, nominal=True)
            variables = steps.split(chosen)
            return loop.result(designs, variables, evaluation, reason, volume, point.residual)


@dataclass(frozen=True, eq=False)
class _Point:
    """All that the next iteration depends on, besides the evaluation of the design kept."""

    asymptotes: Asymptotes
    margins: Array  #: By how much constraints are tightened, shape (m,)
    bounds: Array  #: The constraints of the design that is kept, shape (m,)
    iteration: int = 0
    progress: float = 0.0  #: Of the same
    rejected: int = 0  #: Steps taken back in a row
    held: bool = False  #: The last one for a constraint, which sharpening may have broken
    merit: float = math.inf  #: log psi and penalty of the design that is kept
    best: Array | None = None  #: The best feasible sharp design, shape (n,)
    best_merit: float = math.inf
    #: How far the merit could still fall to first order when this was last computed
    residual: float = math.nan
    converged: bool = False  #: The design that is kept fulfils the first-order conditions


@dataclass(frozen=True, eq=False)
class _Functions:
    """Values and gradients of all functions at a point, by which the next step is found."""

    slope: Array  #: Of the objective, (n,)
    values: Array  #: (m,): first those whose largest one is minimised, then the constraints
    slopes: Array  #: Their gradients, (m, n)
    bounded: int  #: How many they are whose largest one is minimised
    of: Integers  #: Number of the constraint in `_Point.bounds` that each other one belongs to
    same: Mask  #: Which of all functions, (1 + m,), are the same ones at the next point


@dataclass(frozen=True, eq=False)
class _Now:
    """The evaluation of the design that is kept, and all functions there."""

    evaluation: Evaluation
    functions: _Functions


class MMASteps(Iterator[Iterate]):
    """The iterations of one run; x are densities by body, or variables of a design without any.

    After `begin` or `load` it is at a ``point``, ``now`` has the functions there.
    """

    reason = "stalled"
    point: _Point
    now: _Now

    def __init__(self, options: MMA, loop: DesignLoop, designs: Designs, volume: Bounds) -> None:
        self.options, self.loop = options, loop
        self._designs, self.volume = dict(designs), dict(volume)
        self.dense = any(isinstance(design, Design) for design in designs.values())
        self.sizes = {name: design.size for name, design in designs.items()}
        self.lower, self.upper = (
            np.concatenate([np.full(d.size, getattr(d, side)) for d in designs.values()])
            for side in ("lower", "upper")
        )

    def designs(self, progress: float, *, nominal: bool = False) -> dict[str, Variables]:
        """The designs as sharp as at a progress, as analysed or ``nominal``."""
        found = {name: design.at(progress) for name, design in self._designs.items()}
        return {n: _nominal(d) for n, d in found.items()} if nominal else found

    def split(self, variables: Array) -> dict[str, Array]:
        """The variables of each design."""
        ends = np.cumsum(list(self.sizes.values()))[:-1]
        return dict(zip(self.sizes, np.split(variables, ends), strict=True))

    def x(self, variables: Array, progress: float, *, nominal: bool = False) -> dict[str, Array]:
        """The point at which the problem is evaluated."""
        parts, designs = self.split(variables), self.designs(progress, nominal=nominal)
        return {name: design.point(parts[name]) for name, design in designs.items()}

    @property
    def converged(self) -> bool:
        """Whether the design that is kept fulfils the first-order conditions."""
        return self.point.converged

    def __next__(self) -> Iterate:
        """The design that is kept after one step; collective."""
        if self.point.rejected >= STUCK or self.stands_still(self.point):
            raise StopIteration
        self.point, self.now, iterate = self.stepped(self.point, self.now)
        if iterate is None:  # converged
            raise StopIteration
        return iterate

    def begin(self, start: Mapping[str, Array]) -> Iterate:
        """The first point, lowered until the volume bounds hold."""
        first = {name: design.begin(start[name]) for name, design in self._designs.items()}
        for name, design in self.designs(0.0).items():
            if isinstance(design, Design):
                first[name] = shrunk(design, first[name], self.volume[name])
        variables = np.concatenate(list(first.values()))
        x = self.x(variables, 0.0)
        found = self.loop.calibrated(self.loop.accurate(self.loop.value(x), x, 0))
        bounds = self.bounds(variables, self.made(variables, found, 0.0), 0.0)
        state = Asymptotes(self.lower, self.upper, variables, self.options.move)
        merit = self.merit(variables, found, 0.0)
        point = self.with_best(_Point(state, np.zeros(len(bounds)), bounds, merit=merit))
        self.point, self.now = point, self.differentiate(found, point)
        kept = self.now.evaluation
        return self.iterate(point, kept, x, accepted=True, step=0.0, multiplier=0.0)

    def stepped(self, point: _Point, now: _Now) -> tuple[_Point, _Now, Iterate | None]:
        """The point after one step, the evaluation of the design that is kept, and its iterate.

        There is no iterate where the point has converged.
        """
        iteration, progress = point.iteration + 1, point.progress
        if not point.held:  # else sharpening may have broken a constraint
            progress = min(iteration / self.loop.stage_iterations, 1.0)
        # also where this step makes nothing sharper, as one for a constraint was taken back
        sharpens = self.changes(point.progress, 1.0)

        functions, state = now.functions, replace(point.asymptotes, secants=None)
        margins = np.concatenate([np.zeros(functions.bounded), point.margins[functions.of]])
        if not sharpens:
            gradients = np.vstack([functions.slope[None], functions.slopes])
            before = point.asymptotes.secants or Secants.begin(state.x, gradients)
            state = replace(state, secants=before.next(state.x, gradients, functions.same))
        step = functions.values + margins, functions.slopes, functions.bounded
        tried, multipliers = state.step(functions.slope, *step)
        # every rank has computed the same, and its own last bits may decide nothing
        tried = replace(tried, x=self.loop.comm.bcast(tried.x, root=0))

        # of the constraints as they were given, not as they are tightened
        given = functions.values, functions.slopes, multipliers, self.options.move
        gain = state.possible_gain(functions.slope, *given, functions.bounded)
        residual = self.loop.comm.bcast(gain, root=0)
        point = replace(point, residual=residual)
        small = residual < self.options.tolerance and _largest(point.bounds) <= FEASIBLE
        if small and not sharpens and self.may_be_result(point.progress):
            return replace(point, converged=True), now, None

        # the largest change of a variable as a share of its range
        size = float(np.max(np.abs(tried.x - state.x) / (self.upper - self.lower)))
        prices = np.zeros(len(point.bounds))  # those of all places of a constraint together
        np.add.at(prices, functions.of, multipliers[functions.bounded :])
        said = {"step": size, "multiplier": float(prices[0]) if len(prices) else 0.0}
        x = self.x(tried.x, progress)
        try:
            found = self.loop.value(x)
        except SimulationError:  # so soft that it cannot move
            found = None
        if sharpens:
            apart, broken = self.judged(point, now.evaluation, tried.x, found, progress)
        else:
            apart, broken = not self.better(point, tried.x, found, prices), False
        if found is None or apart:
            kept = replace(point, iteration=iteration, rejected=point.rejected + 1, held=broken)
            kept = replace(kept, asymptotes=tried.retreat(state))
            x = self.x(state.x, point.progress)
            return kept, now, self.iterate(kept, now.evaluation, x, accepted=False, **said)
        found = self.loop.calibrated(self.loop.accurate(found, x, iteration))
        bounds = self.bounds(tried.x, self.made(tried.x, found, progress), progress)
        merit = self.merit(tried.x, found, progress)
        tried = replace(tried, move=min(RECOVER * tried.move, self.options.move))
        moved = replace(point, asymptotes=tried, bounds=bounds, merit=merit, rejected=0, held=False)
        moved = replace(moved, iteration=iteration, progress=progress)
        if self.may_be_result(progress):
            # tightened by what is violated, relaxed slowly where nothing is
            near = (bounds > 0.0) & (bounds < (NEAR if sharpens else VIOLATED))
            margins = np.where(near, point.margins + bounds, 0.9 * point.margins)
            moved = self.with_best(replace(moved, margins=margins))
        after = _Now(found, functions)
        if iteration < self.loop.iterations:
            after = self.differentiate(found, moved)
        return moved, after, self.iterate(moved, after.evaluation, x, accepted=True, **said)

    def changes(self, before: float, after: float) -> bool:
        """Whether variables make other densities at a later progress than before."""
        if before == after:
            return False
        return any(design.at(after) is not design for design in self._designs.values())

    def settled(self, progress: float) -> bool:
        """Whether what is analysed is the design itself, and becomes no sharper."""
        return not self.changes(progress, 1.0) and not self.eroded(progress)

    def may_be_result(self, progress: float) -> bool:
        """Whether designs are as sharp as a result, or will never be sharper."""
        return progress >= RESULT_PROGRESS or not self.changes(0.0, 1.0)

    def with_best(self, point: _Point) -> _Point:
        """The point, with its design as the best one if it is feasible and better."""
        if not self.may_be_result(point.progress) or _largest(point.bounds) > FEASIBLE:
            return point
        if not point.merit < point.best_merit:
            return point
        return replace(point, best=point.asymptotes.x, best_merit=point.merit)

    def better(
        self, point: _Point, tried: Array, found: Evaluation | None, multipliers: Array
    ) -> bool:
        """Whether variables ``tried`` have less merit and violation than the point, as sharp.

        A violation costs twice what its multiplier says, and at least what it is.
        """
        if found is None or not math.isfinite(found.psi):
            return False
        prices = np.maximum(2.0 * multipliers, 1.0)
        found = self.loop.problem.calibrated(found)[1]
        made = self.made(tried, found, point.progress)
        bounds = self.bounds(tried, made, point.progress) + point.margins
        violation = np.maximum(bounds, 0.0) - np.maximum(point.bounds + point.margins, 0.0)
        change = self.merit(tried, found, point.progress) - point.merit + prices @ violation
        return bool(change < 0.0)

    def judged(
        self,
        point: _Point,
        now: Evaluation,
        tried: Array,
        found: Evaluation | None,
        progress: float,
    ) -> tuple[bool, bool]:
        """Whether a step to variables ``tried`` is taken back, and whether for a constraint."""
        if found is None or not math.isfinite(found.psi):
            return True, False
        worst = _largest(point.bounds)
        then = _largest(self.bounds(tried, found, progress))
        # psi may rise where that brings a violated constraint nearer
        pays = worst > VIOLATED and then < worst
        broken = then > max(worst, 0.0) + BROKEN
        rises = found.psi > now.psi + APART * abs(now.psi) and not pays
        # what becoming sharper alone brings is no fault of the step
        if rises and not broken:
            try:
                before = self.loop.value(self.x(point.asymptotes.x, progress)).psi
            except SimulationError:
                before = math.inf
            rises = found.psi > before + APART * abs(before)
        return broken or rises, broken

    def merit(self, variables: Array, evaluation: Evaluation, progress: float) -> float:
        """Log psi, of any sign, and the penalties."""
        parts = self.split(variables)
        penalty = sum(d.penalty(parts[n])[0] for n, d in self.designs(progress).items())
        return penalty + self.loop.logarithm.value(evaluation.psi)

    def made(self, variables: Array, analysed: Evaluation, progress: float) -> Evaluation:
        """Evaluation at the nominal design rather than the eroded one, for its constraints."""
        if not analysed.constraints or not self.eroded(progress):
            return analysed
        try:
            found = self.loop.value(self.x(variables, progress, nominal=True))
        except SimulationError:  # what is analysed moves, and has a little less material
            return analysed
        # by its own largest stress; the scale of the next designs is that of the analysed one
        return self.loop.problem.calibrated(found)[1]

    def eroded(self, progress: float) -> bool:
        """Whether a design is analysed in the place of the nominal one."""
        return any(_nominal(design) is not design for design in self.designs(progress).values())

    def bounds(self, variables: Array, made: Evaluation, progress: float) -> Array:
        """G of all constraints, (m,): volumes of nominal bodies, and those of the problem."""
        x, domains = self.x(variables, progress, nominal=True), self.loop.domains
        filled = {n: d.sum(x[n] * d.cell_volumes) / d.area for n, d in domains.items()}
        volumes = [filled[name] / bound - 1.0 for name, bound in self.volume.items()]
        return np.array([*volumes, *(c.violation for c in made.constraints.values())])

    def functions(self, point: _Point, evaluation: Evaluation, labels: Sequence[str]) -> _Functions:
        """All functions by an ``evaluation`` with gradients, of constraints with ``labels``.

        In the place of a constraint there may be several, each of which bounds the same at a place
        of its own. Where the largest of several values is minimised, the objective is the penalty:
        of several load cases, or of the places of an objective that is the largest stress.
        """
        parts, designs = self.split(point.asymptotes.x), self.designs(point.progress)
        nominal = self.designs(point.progress, nominal=True)
        volumes = np.zeros((len(self.volume), len(self.lower)))
        for row, (name, bound) in zip(volumes, self.volume.items(), strict=True):
            domain = self.loop.domains[name]
            share = domain.cell_volumes / domain.area / bound
            self.split(row)[name][:] = _by_variables(name, nominal[name], parts[name], share)
        slope = np.concatenate([d.penalty(parts[n])[1] for n, d in designs.items()])
        peaks, peak_slopes = self.peaks(point, evaluation)
        rest = {n: bound for n, bound in evaluation.constraints.items() if whole(n) != OBJECTIVE}
        places_of_objective = len(evaluation.constraints) - len(rest)
        if not len(peaks):
            own = self.pulled_back(point, [evaluation.gradient])[0]
            slope = self.loop.logarithm.slope(evaluation.psi) * own + slope

        gradients = self.pulled_back(point, [constraint.gradient for constraint in rest.values()])
        slopes = np.vstack([peak_slopes, volumes, gradients])

        placed = np.array([label not in labels for label in rest], dtype=bool)
        wholes = [n if n in labels else whole(n) for n in rest]
        of = len(volumes) + np.array([labels.index(name) for name in wholes], dtype=int)
        # a constraint without places is that of the nominal design
        at_places = np.array([constraint.violation for constraint in rest.values()])
        bounds = np.where(placed, at_places, point.bounds[of])
        same = np.concatenate([np.full(1 + len(slopes) - len(placed), True), ~placed])
        same[1 : 1 + places_of_objective] = False
        return _Functions(
            slope,
            np.concatenate([peaks, point.bounds[: len(volumes)], bounds]),
            slopes,
            len(peaks),
            np.concatenate([np.arange(len(volumes)), of]),
            same,
        )

    def peaks(self, point: _Point, evaluation: Evaluation) -> tuple[Array, Array]:
        """The functions whose largest value is minimised, if there are several, and their slopes.

        Of an objective with places they are the logs of its values there, relative to the largest;
        of `WorstCase` those of the weighted psi of the load cases that come near the largest one,
        or where one is not positive, the weighted psi relative to the largest.
        """
        places = [c for n, c in evaluation.constraints.items() if whole(n) == OBJECTIVE]
        if places:
            ratios = np.array([1.0 + place.violation for place in places])
            gradients = self.pulled_back(point, [place.gradient for place in places])
            return np.log(ratios), gradients / ratios[:, None]
        combine, cases = self.loop.problem.combine, evaluation.load_cases
        if not combine.bounds:
            return np.zeros(0), np.zeros((0, len(self.lower)))
        near = combine.near({name: case.psi for name, case in cases.items()})
        weights = np.array([combine.weight(name) for name in near])
        weighted = weights * np.array([cases[name].psi for name in near])
        slopes = self.pulled_back(point, [cases[name].gradient for name in near])
        if np.all(weighted > 0.0):
            return np.log(weighted), slopes * (weights / weighted)[:, None]
        scale = float(np.max(np.abs(weighted))) or 1.0
        return weighted / scale, slopes * (weights / scale)[:, None]

    def pulled_back(self, point: _Point, rows: Sequence[Mapping[str, Array] | None]) -> Array:
        """Derivatives by the variables, shape (rows, n), from those by x."""
        parts, designs = self.split(point.asymptotes.x), self.designs(point.progress)
        found = [np.zeros((0, len(self.lower)))]
        for row in rows:
            if row is None:
                raise ValueError(
                    "MMA: this way to the gradient gives none of the constraints, and of several "
                    "load cases only that of all together; take ExactAdjoint"
                )
            own = [_by_variables(n, d, parts[n], row.get(n)) for n, d in designs.items()]
            found.append(np.concatenate(own)[None])
        return np.concatenate(found)

    def differentiate(self, evaluation: Evaluation, point: _Point) -> _Now:
        """An evaluation with its gradient.

        Where designs become no sharper a bound on the largest stress is one on that of each place,
        and such an objective the largest of the places: at nearly uniform stress one slope cannot
        say which of them need more material.
        """
        parts, designs = self.split(point.asymptotes.x), self.designs(point.progress)

        def distance(name: str) -> Array | None:
            design = designs[name]
            return design.distance(parts[name]) if isinstance(design, Design) else None

        labels = list(evaluation.constraints)
        placed, given = self.loop.problem, evaluation
        if self.settled(point.progress) and isinstance(placed, Problem | Sizing):
            alone = len(evaluation.load_cases) == 1
            adapt = _with_placed_objective if alone else MechanicalProblem.placed
            placed, given = placed.adapted(evaluation, adapt)
        found = self.loop.differentiate(given, distance, point.iteration, placed)
        functions = self.functions(point, found, labels)
        if placed is not self.loop.problem:
            found = _with_largest(evaluation, found)
        return _Now(found, functions)

    def stands_still(self, point: _Point) -> bool:
        """Whether the merit hardly changes any more, of designs that become no sharper."""
        if point.best is None or self.changes(point.progress, 1.0):
            return False
        rows = [row for row in self.loop.rows if row["accepted"]][-1 - WINDOW :]
        merits = [row["merit"] for row in rows]
        sharp_iterations = point.iteration - math.ceil(RESULT_PROGRESS * self.loop.stage_iterations)
        if len(rows) <= WINDOW or (self.changes(0.0, 1.0) and sharp_iterations <= WINDOW + 1):
            return False
        return max(merits) - min(merits) < self.options.tolerance

    def evaluation(self, point: _Point, now: Evaluation, chosen: Array) -> Evaluation:
        """The evaluation of the result."""
        if chosen is point.asymptotes.x and not self.eroded(point.progress):
            return now
        return self.loop.calibrated(self.loop.value(self.x(chosen, point.progress, nominal=True)))

    def iterate(
        self,
        point: _Point,
        evaluation: Evaluation,
        x: Mapping[str, Array],
        *,
        accepted: bool,
        step: float,
        multiplier: float,
    ) -> Iterate:
        """A point for history and checkpoint."""
        state = point.asymptotes
        kept = {name: getattr(state, name) for name in STATE} | {"best": point.best}
        kept = {name: np.zeros(0) if value is None else value for name, value in kept.items()}
        kept |= {name: getattr(point, name) for name in ("margins", *NUMBERS)}
        if state.secants is not None:
            kept |= {f"secant {name}": getattr(state.secants, name) for name in SECANTS}
        designs = self.designs(point.progress).values()
        return Iterate(
            iteration=point.iteration,
            x=x,
            evaluation=evaluation,
            accepted=accepted,
            step=step,
            merit=point.merit,
            sharpness=max((d.sharpness for d in designs if isinstance(d, Design)), default=1.0),
            multiplier=multiplier,
            state={**kept, "x": state.x, "move": state.move} if point.iteration else None,
        )

    def load(self, data: Mapping[str, Any]) -> None:
        """Go on from the point of an earlier run, evaluated anew."""
        arrays = {n: np.asarray(data[n]) if len(data[n]) else None for n in (*STATE, "best")}
        best, x, progress = arrays.pop("best"), np.asarray(data["x"]), float(data["progress"])
        if f"secant {SECANTS[0]}" in data:
            secants = [np.asarray(data[f"secant {name}"]) for name in SECANTS]
            arrays["secants"] = Secants(*secants)  # type: ignore[assignment]
        state = Asymptotes(self.lower, self.upper, x, float(data["move"]), **arrays)  # type: ignore[arg-type]
        found = self.loop.calibrated(self.loop.value(self.x(x, progress)))
        numbers = {name: kind(data[name]) for name, kind in NUMBERS.items()}
        bounds = self.bounds(x, self.made(x, found, progress), progress)
        point = _Point(state, np.asarray(data["margins"]), bounds, best=best, **numbers)
        self.loop.resumed(found)
        self.point, self.now = point, self.differentiate(found, point)

    def identity(self) -> dict[str, Any]:
        """The entries that a checkpoint and the run that reads it have in common."""
        common: dict[str, Any] = {"optimizer": repr(self.options)}
        for name, design in self._designs.items():
            parts = design.identity()
            if name in self.volume:
                parts = {**parts, "volume": self.volume[name]}
            common |= {f"{key} of {name}": value for key, value in parts.items()}
        return common


def _nominal(design: Variables) -> Variables:
    """The nominal design, where another one may be analysed in its place."""
    return design.nominal if isinstance(design, Design) else design


def _by_variables(name: str, design: Variables, variables: Array, bar: Array | None) -> Array:
    """The derivative by the variables, shape (size,), from that by the density or by them."""
    return design.pullback(
        variables, validation.real_array(f"optimize: the derivative by {name!r}", bar)
    )


def _with_largest(evaluation: Evaluation, found: Evaluation) -> Evaluation:
    """An ``evaluation`` with the gradients that were ``found`` with a constraint at each place.

    A constraint on all places has the gradient of the worst one.
    """
    worst: dict[str, ConstraintValue] = {}
    for label, place in found.constraints.items():
        if whole(label) == OBJECTIVE:
            continue
        name = label if label in evaluation.constraints else whole(label)
        if name not in worst or place.violation > worst[name].violation:
            worst[name] = place
    cases = {
        name: replace(case, constraints=evaluation.load_cases[name].constraints)
        for name, case in found.load_cases.items()
    }
    names = ["gradient", "integrals_gradient", "nodes", "centers", "parameters"]
    new = {name: getattr(found, name) for name in [*names, "solver_iterations", "seconds"]}
    return replace(evaluation, **new, constraints=worst, load_cases=cases)


def _with_placed_objective(problem: MechanicalProblem, response: Response) -> MechanicalProblem:
    """The problem with bounds on places of the largest stress, also where that is the objective.

    Those of the objective are relative to its value at the ``response``.
    """
    found, value = problem.placed(response), value_of(problem.objective, response)
    if not value > 0.0:
        return found
    places = Constraint(problem.objective, upper=value, name=OBJECTIVE).places(response)
    if len(places) == 1:
        return found
    return replace(found, constraints=[*found.constraints, *places])


def _largest(bounds: Array) -> float:
    """The largest of the constraints; minus infinity without any."""
    return float(np.max(bounds, initial=-math.inf))
