# SPDX-License-Identifier: MIT
"""Design by the method of moving asymptotes, with any number of constraints.

    min over z of log psi(z) + penalty(z)   such that   g_k(z) <= 0,   lower <= z <= upper,

where the g_k are the volume bound of each body and the constraints of the problem, and the penalty
is that of the design. Each iteration takes one value and one gradient; the design becomes sharp
step by step.

Near the end an eroded level set is analysed: psi and the slopes of the problem's constraints belong
to the eroded design, the values of all constraints to the nominal one (`Design.nominal`), as psi
and densities of the result. If the problem has constraints, an iteration takes a second value.

Near the end a constraint that is violated gets a safety margin of its violation, so that the
designs become feasible. The best feasible design, among sharp ones, is the result.

While densities become sharper psi rises from that alone. Only a design that falls apart is
rejected: psi rises by a quarter, or a constraint is violated by much more. The next step is then
half as long. Once designs are sharp, a step is rejected unless the merit falls: the sum of log psi,
the penalty, and the violations at twice the price of their multipliers. Then the second derivatives
by each variable are learnt from the gradients (`Secants`), which damps oscillations. The run has
converged if no step of the largest length lowers the merit, to first order, by the tolerance.

For `WorstCase` log of each weighted psi is bounded by a variable, which is minimised instead of log
psi.

`PeakStress` is corrected to the largest stress at each accepted design, and its slope has the same
scale (Le et al., doi:10.1007/s00158-009-0440-y): constraints and the best design are judged by the
largest stress itself. Once designs are sharp, a bound on it becomes one bound for each of some
places (`PeakStress.places`), and as the objective it is the largest of these places, minimised as
for load cases: where the stress is nearly uniform, the one slope of a mean cannot tell which place
needs more material.
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
from ..objective import Constraint, Response, constraint_of_place, value_of
from ..problem import Evaluation, Problem
from .loop import FEASIBLE, Arrays, Bounds, DesignLoop, Designs, Iterate, Optimizer
from .moving_asymptotes import Asymptotes, Secants
from .result import Result
from .sizing import Sizing

#: Number of iterations over which the merit must change by more than the tolerance
WINDOW = 8
#: Progress from which on designs are sharp, and may be the result
RESULT_PROGRESS = 0.85
#: Relative rise of psi for which a step is rejected, more than becoming sharper alone brings
APART = 0.25
#: Rise of the largest violation for which a step is rejected; the steps that follow mend less
BROKEN = 0.25
#: Number of rejected steps in a row after which the run ends
MOST_REJECTED = 8
#: Growth of the longest step after an accepted step
RECOVER = 1.5
#: Relative violation from which on psi may rise to satisfy a constraint
VIOLATED = 1e-3
#: Largest violation that is added to a margin; a few steps lead back from further outside
SMALL_VIOLATION = 0.02
#: Name of the bounds on places of the objective
OBJECTIVE = "objective of each place"
#: Arrays of the asymptotes in a checkpoint, besides x
STATE = ("previous", "second_last", "reach")
#: Arrays of the secants in a checkpoint
SECANTS = ("x", "gradients", "curvature")
#: Numbers of a point in a checkpoint, and their types
NUMBERS: dict[str, type] = {
    "iteration": int,
    "progress": float,
    "rejected": int,
    "broke_constraint": bool,
    "merit": float,
    "best_merit": float,
    "residual": float,
}


@dataclass(frozen=True)
class MMA(Optimizer):
    """Method of moving asymptotes, for any bounded variables.

    Args:
        move: Largest change of a variable in an iteration, in shares of its range.
        tolerance: The run has converged when the design is sharp and no step of length ``move``
            within the constraints lowers log psi and the penalty, to first order, by more than
            this. Zero makes use of all iterations.
        length: Iterations over which the design becomes sharp and reaches its minimum sizes; by
            default the iterations of the run, or, where steps of the boundary follow, so many that
            the design is sharp at their end, at 0.55 of the length. A number makes the path of a
            design independent of the number of iterations; a resumed run has the length with which
            it began.
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
            evaluation = steps.evaluation(point, steps.accepted.evaluation, chosen)
            designs = steps.designs(point.progress, nominal=True)
            variables = steps.split(chosen)
            return loop.result(designs, variables, evaluation, reason, volume, point.residual)


@dataclass(frozen=True, eq=False)
class _Point:
    """The accepted design, and all that the next iteration depends on but its evaluation."""

    asymptotes: Asymptotes
    margins: Array  #: Safety margins of the constraints, shape (m,)
    bounds: Array  #: Values of the constraints, shape (m,)
    iteration: int = 0
    progress: float = 0.0  #: Progress at which the design was accepted
    rejected: int = 0  #: Number of rejected steps since
    #: Whether the last step was rejected for a constraint, which becoming sharper may have broken
    broke_constraint: bool = False
    merit: float = math.inf  #: log psi and penalty
    best: Array | None = None  #: The best feasible sharp design, shape (n,)
    best_merit: float = math.inf
    residual: float = math.nan  #: Largest fall of the merit, to first order, by a step
    converged: bool = False  #: Whether the first-order conditions are satisfied


@dataclass(frozen=True, eq=False)
class _Functions:
    """Values and gradients of all functions at a point, for the next step."""

    slope: Array  #: Gradient of the objective, (n,)
    #: Values (m,): first the functions whose largest value is minimised, then the constraints
    values: Array
    slopes: Array  #: Gradients of these functions, (m, n)
    n_peaks: int  #: Number of the functions whose largest value is minimised
    constraint: Integers  #: For each of the others, the number of its constraint in `_Point.bounds`
    comparable: Mask  #: Which of all functions, (1 + m,), are the same at the next point


@dataclass(frozen=True, eq=False)
class _AcceptedDesign:
    """The evaluation of the accepted design, and all functions there."""

    evaluation: Evaluation
    functions: _Functions


class MMASteps(Iterator[Iterate]):
    """The iterations of one run; x are densities by body, or variables of a design without any.

    After `begin` or `load` it is at a ``point``, and ``accepted`` has its evaluation and functions.
    """

    reason = "stalled"
    point: _Point
    accepted: _AcceptedDesign

    def __init__(self, options: MMA, loop: DesignLoop, designs: Designs, volume: Bounds) -> None:
        self.options, self.loop = options, loop
        self._designs, self.volume = dict(designs), dict(volume)
        self.dense = any(isinstance(design, Design) for design in designs.values())
        self.sizes = {name: design.size for name, design in designs.items()}
        self.lower, self.upper = (
            np.concatenate(
                [np.full(design.size, getattr(design, side)) for design in designs.values()]
            )
            for side in ("lower", "upper")
        )

    def designs(self, progress: float, *, nominal: bool = False) -> dict[str, Variables]:
        """The designs as sharp as at a progress, as analysed or ``nominal``."""
        designs = {name: design.at(progress) for name, design in self._designs.items()}
        if not nominal:
            return designs
        return {name: _nominal(design) for name, design in designs.items()}

    def split(self, variables: Array) -> dict[str, Array]:
        """The variables of each design."""
        ends = np.cumsum(list(self.sizes.values()))[:-1]
        return dict(zip(self.sizes, np.split(variables, ends), strict=True))

    def x(self, variables: Array, progress: float, *, nominal: bool = False) -> dict[str, Array]:
        """By body, where the problem is evaluated: the designs as analysed, or ``nominal``."""
        by_design, designs = self.split(variables), self.designs(progress, nominal=nominal)
        return {name: design.point(by_design[name]) for name, design in designs.items()}

    @property
    def converged(self) -> bool:
        """Whether the accepted design satisfies the first-order conditions."""
        return self.point.converged

    def __next__(self) -> Iterate:
        """The accepted design after one step."""
        if self.point.rejected >= MOST_REJECTED or self.merit_is_constant(self.point):
            raise StopIteration
        self.point, self.accepted, iterate = self.stepped(self.point, self.accepted)
        if iterate is None:  # converged
            raise StopIteration
        return iterate

    def begin(self, start: Mapping[str, Array]) -> Iterate:
        """The evaluated ``start``, its densities lowered until the volume bounds hold."""
        by_design = {name: design.begin(start[name]) for name, design in self._designs.items()}
        for name, design in self.designs(0.0).items():
            if isinstance(design, Design):
                by_design[name] = shrunk(design, by_design[name], self.volume[name])
        variables = np.concatenate(list(by_design.values()))
        x = self.x(variables, 0.0)

        evaluation = self.loop.accurate(self.loop.value(x), x, 0)
        evaluation = self.loop.calibrated(evaluation)
        nominal = self.at_nominal(variables, evaluation, 0.0)
        bounds = self.bounds(variables, nominal, 0.0)

        asymptotes = Asymptotes(self.lower, self.upper, variables, self.options.move)
        margins = np.zeros(len(bounds))
        merit = self.merit(variables, evaluation, 0.0)
        point = self.with_best(_Point(asymptotes, margins, bounds, merit=merit))
        self.accepted = self.differentiate(evaluation, point)
        self.point = point

        differentiated = self.accepted.evaluation
        return self.iterate(point, differentiated, x, accepted=True, step=0.0, multiplier=0.0)

    def stepped(
        self, point: _Point, accepted: _AcceptedDesign
    ) -> tuple[_Point, _AcceptedDesign, Iterate | None]:
        """The accepted design after one step, its evaluation, and its iterate.

        There is no iterate if the point has converged.
        """
        iteration, progress = point.iteration + 1, point.progress
        if not point.broke_constraint:
            progress = min(iteration / self.loop.stage_iterations, 1.0)
        # also if this step makes nothing sharper, as the last one broke a constraint
        sharpens = self.changes(point.progress, 1.0)

        functions = accepted.functions
        state = self.with_secants(point, functions, sharpens)
        margins = np.concatenate([np.zeros(functions.n_peaks), point.margins[functions.constraint]])
        proposed, multipliers = state.step(
            functions.slope, functions.values + margins, functions.slopes, functions.n_peaks
        )
        # every rank has computed the same but for its last bits, which must not decide anything
        proposed = replace(proposed, x=self.loop.comm.bcast(proposed.x, root=0))

        # by the constraints as they were given, without margins
        gain = state.possible_gain(
            functions.slope,
            functions.values,
            functions.slopes,
            multipliers,
            self.options.move,
            functions.n_peaks,
        )
        residual = self.loop.comm.bcast(gain, root=0)
        point = replace(point, residual=residual)
        is_optimal = residual < self.options.tolerance and _largest(point.bounds) <= FEASIBLE
        if is_optimal and not sharpens and self.may_be_result(point.progress):
            return replace(point, converged=True), accepted, None

        # the largest change of a variable as a share of its range
        size = float(np.max(np.abs(proposed.x - state.x) / (self.upper - self.lower)))
        prices = np.zeros(len(point.bounds))  # the sum over all places of a constraint
        np.add.at(prices, functions.constraint, multipliers[functions.n_peaks :])
        columns = {"step": size, "multiplier": float(prices[0]) if len(prices) else 0.0}

        x = self.x(proposed.x, progress)
        try:
            trial = self.loop.value(x)
        except SimulationError:  # so soft that it cannot move
            trial = None
        if sharpens:
            rejected, broken = self.falls_apart(
                point, accepted.evaluation, proposed.x, trial, progress
            )
        else:
            rejected, broken = not self.better(point, proposed.x, trial, prices), False
        if trial is None or rejected:
            point = replace(
                point,
                asymptotes=proposed.retreat(state),
                iteration=iteration,
                rejected=point.rejected + 1,
                broke_constraint=broken,
            )
            x = self.x(state.x, point.progress)
            iterate = self.iterate(point, accepted.evaluation, x, accepted=False, **columns)
            return point, accepted, iterate

        trial = self.loop.calibrated(self.loop.accurate(trial, x, iteration))
        bounds = self.bounds(proposed.x, self.at_nominal(proposed.x, trial, progress), progress)
        next_point = replace(
            point,
            asymptotes=replace(proposed, move=min(RECOVER * proposed.move, self.options.move)),
            bounds=bounds,
            merit=self.merit(proposed.x, trial, progress),
            rejected=0,
            broke_constraint=False,
            iteration=iteration,
            progress=progress,
        )
        if self.may_be_result(progress):
            # margins grow by small violations, and shrink slowly where there is none
            largest = SMALL_VIOLATION if sharpens else VIOLATED
            grows = (bounds > 0.0) & (bounds < largest)
            margins = np.where(grows, point.margins + bounds, 0.9 * point.margins)
            next_point = self.with_best(replace(next_point, margins=margins))
        accepted = _AcceptedDesign(trial, functions)
        if iteration < self.loop.iterations:
            accepted = self.differentiate(trial, next_point)
        iterate = self.iterate(next_point, accepted.evaluation, x, accepted=True, **columns)
        return next_point, accepted, iterate

    def with_secants(self, point: _Point, functions: _Functions, sharpens: bool) -> Asymptotes:
        """The asymptotes of a point, with second derivatives if designs become no sharper."""
        state = point.asymptotes
        if sharpens:
            return replace(state, secants=None)
        gradients = np.vstack([functions.slope[None], functions.slopes])
        secants = state.secants or Secants.begin(state.x, gradients)
        return replace(state, secants=secants.next(state.x, gradients, functions.comparable))

    def changes(self, progress: float, later: float) -> bool:
        """Whether variables make other densities at a ``later`` progress."""
        if progress == later:
            return False
        return any(design.at(later) is not design for design in self._designs.values())

    def analyses_final(self, progress: float) -> bool:
        """Whether the design itself is analysed, not an eroded one, and becomes no sharper."""
        return not self.changes(progress, 1.0) and not self.eroded(progress)

    def may_be_result(self, progress: float) -> bool:
        """Whether designs are as sharp as a result, or never become sharper."""
        return progress >= RESULT_PROGRESS or not self.changes(0.0, 1.0)

    def with_best(self, point: _Point) -> _Point:
        """The point, with its design as the best one if it is feasible and better."""
        if not self.may_be_result(point.progress) or _largest(point.bounds) > FEASIBLE:
            return point
        if not point.merit < point.best_merit:
            return point
        return replace(point, best=point.asymptotes.x, best_merit=point.merit)

    def better(
        self, point: _Point, variables: Array, trial: Evaluation | None, multipliers: Array
    ) -> bool:
        """Whether ``variables`` have less merit and violation than the point, which is as sharp.

        The price of a violation is twice its multiplier, and at least one.
        """
        if trial is None or not math.isfinite(trial.psi):
            return False
        prices = np.maximum(2.0 * multipliers, 1.0)
        trial = self.loop.problem.calibrated(trial)[1]
        nominal = self.at_nominal(variables, trial, point.progress)
        bounds = self.bounds(variables, nominal, point.progress) + point.margins
        violation = np.maximum(bounds, 0.0) - np.maximum(point.bounds + point.margins, 0.0)
        change = self.merit(variables, trial, point.progress) - point.merit + prices @ violation
        return bool(change < 0.0)

    def falls_apart(
        self,
        point: _Point,
        evaluation: Evaluation,
        variables: Array,
        trial: Evaluation | None,
        progress: float,
    ) -> tuple[bool, bool]:
        """Whether a step to ``variables`` is rejected, and whether for a constraint."""
        if trial is None or not math.isfinite(trial.psi):
            return True, False
        worst = _largest(point.bounds)
        worst_of_trial = _largest(self.bounds(variables, trial, progress))
        # psi may rise if a constraint is violated by less
        repairs = worst > VIOLATED and worst_of_trial < worst
        broken = worst_of_trial > max(worst, 0.0) + BROKEN
        rises = trial.psi > evaluation.psi + APART * abs(evaluation.psi) and not repairs
        # a rise that becoming sharper brings without the step is no reason
        if rises and not broken:
            try:
                sharper = self.loop.value(self.x(point.asymptotes.x, progress)).psi
            except SimulationError:
                sharper = math.inf
            rises = trial.psi > sharper + APART * abs(sharper)
        return broken or rises, broken

    def merit(self, variables: Array, evaluation: Evaluation, progress: float) -> float:
        """Log psi, of any sign, plus the penalties."""
        by_design, designs = self.split(variables), self.designs(progress)
        penalty = sum(design.penalty(by_design[name])[0] for name, design in designs.items())
        return penalty + self.loop.logarithm.value(evaluation.psi)

    def at_nominal(self, variables: Array, analysed: Evaluation, progress: float) -> Evaluation:
        """The evaluation of the nominal design, if an eroded one is ``analysed``.

        Only its constraints are used, so without any it is the analysed evaluation.
        """
        if not analysed.constraints or not self.eroded(progress):
            return analysed
        try:
            nominal = self.loop.value(self.x(variables, progress, nominal=True))
        except SimulationError:  # the analysed design moves, with a little less material
            return analysed
        # by its own largest stress; the analysed design gives the scale of the next ones
        return self.loop.problem.calibrated(nominal)[1]

    def eroded(self, progress: float) -> bool:
        """Whether an eroded design is analysed instead of the nominal one."""
        return any(_nominal(design) is not design for design in self.designs(progress).values())

    def bounds(self, variables: Array, evaluation: Evaluation, progress: float) -> Array:
        """G of all constraints, (m,): first of nominal volumes, then of the problem."""
        x, domains = self.x(variables, progress, nominal=True), self.loop.domains
        filled = {
            name: domain.sum(x[name] * domain.cell_volumes) / domain.area
            for name, domain in domains.items()
        }
        volumes = [filled[name] / bound - 1.0 for name, bound in self.volume.items()]
        violations = [constraint.violation for constraint in evaluation.constraints.values()]
        return np.array([*volumes, *violations])

    def functions(self, point: _Point, evaluation: Evaluation, labels: Sequence[str]) -> _Functions:
        """All functions by an ``evaluation`` with gradients, of constraints with ``labels``.

        A constraint on the largest stress may be replaced by constraints at several places. If the
        largest of several values is minimised, of load cases or of places of the largest stress,
        the objective is the penalty alone.
        """
        by_design, designs = self.split(point.asymptotes.x), self.designs(point.progress)
        nominal = self.designs(point.progress, nominal=True)
        volumes = np.zeros((len(self.volume), len(self.lower)))
        for row, (name, bound) in zip(volumes, self.volume.items(), strict=True):
            domain = self.loop.domains[name]
            share = domain.cell_volumes / domain.area / bound
            self.split(row)[name][:] = _by_variables(name, nominal[name], by_design[name], share)
        penalty_slopes = [design.penalty(by_design[name])[1] for name, design in designs.items()]
        slope = np.concatenate(penalty_slopes)
        peaks, peak_slopes = self.peaks(point, evaluation)
        constraints = {
            label: constraint
            for label, constraint in evaluation.constraints.items()
            if constraint_of_place(label) != OBJECTIVE
        }
        places_of_objective = len(evaluation.constraints) - len(constraints)
        if not len(peaks):
            psi_slope = self.pulled_back(point, [evaluation.gradient])[0]
            slope = self.loop.logarithm.slope(evaluation.psi) * psi_slope + slope

        by_x = [constraint.gradient for constraint in constraints.values()]
        gradients = self.pulled_back(point, by_x)
        slopes = np.vstack([peak_slopes, volumes, gradients])

        at_place = np.array([label not in labels for label in constraints], dtype=bool)
        names = [label if label in labels else constraint_of_place(label) for label in constraints]
        number = len(volumes) + np.array([labels.index(name) for name in names], dtype=int)
        # a constraint without places has the value of the nominal design
        values = np.array([constraint.violation for constraint in constraints.values()])
        bounds = np.where(at_place, values, point.bounds[number])
        comparable = np.concatenate([np.full(1 + len(slopes) - len(at_place), True), ~at_place])
        comparable[1 : 1 + places_of_objective] = False
        return _Functions(
            slope,
            np.concatenate([peaks, point.bounds[: len(volumes)], bounds]),
            slopes,
            len(peaks),
            np.concatenate([np.arange(len(volumes)), number]),
            comparable,
        )

    def peaks(self, point: _Point, evaluation: Evaluation) -> tuple[Array, Array]:
        """The functions whose largest value is minimised, if there are several, and their slopes.

        For an objective with places these are the logs of its values there, relative to the
        largest. For `WorstCase` these are the logs of the weighted psi of the load cases near the
        largest one, or, if one is not positive, the weighted psi relative to the largest.
        """
        places = [
            place
            for label, place in evaluation.constraints.items()
            if constraint_of_place(label) == OBJECTIVE
        ]
        if places:
            ratios = np.array([1.0 + place.violation for place in places])
            gradients = self.pulled_back(point, [place.gradient for place in places])
            return np.log(ratios), gradients / ratios[:, None]
        combine, cases = self.loop.problem.combine, evaluation.load_cases
        if not combine.bounds:
            return np.zeros(0), np.zeros((0, len(self.lower)))
        worst = combine.near({name: case.psi for name, case in cases.items()})
        weights = np.array([combine.weight(name) for name in worst])
        weighted = weights * np.array([cases[name].psi for name in worst])
        slopes = self.pulled_back(point, [cases[name].gradient for name in worst])
        if np.all(weighted > 0.0):
            return np.log(weighted), slopes * (weights / weighted)[:, None]
        scale = float(np.max(np.abs(weighted))) or 1.0
        return weighted / scale, slopes * (weights / scale)[:, None]

    def pulled_back(self, point: _Point, by_x: Sequence[Mapping[str, Array] | None]) -> Array:
        """Gradients by the variables, (functions, n), from derivatives of these functions by x."""
        variables, designs = self.split(point.asymptotes.x), self.designs(point.progress)
        gradients = [np.zeros((0, len(self.lower)))]  # the shape where there are no functions
        for x_bars in by_x:
            if x_bars is None:
                raise ValueError(
                    "MMA: this gradient method gives no gradients of constraints, and of several "
                    "load cases only the gradient of all together; take ExactAdjoint"
                )
            bars = [
                _by_variables(name, design, variables[name], x_bars.get(name))
                for name, design in designs.items()
            ]
            gradients.append(np.concatenate(bars)[None])
        return np.concatenate(gradients)

    def differentiate(self, evaluation: Evaluation, point: _Point) -> _AcceptedDesign:
        """The ``evaluation`` of a point with its gradient, and all functions there.

        Once designs are sharp, a bound on the largest stress becomes one at each of some places,
        and such an objective the largest of the places.
        """
        by_design, designs = self.split(point.asymptotes.x), self.designs(point.progress)

        def distance(name: str) -> Array | None:
            design = designs[name]
            return design.distance(by_design[name]) if isinstance(design, Design) else None

        labels = list(evaluation.constraints)
        problem, at_places = self.loop.problem, evaluation
        if self.analyses_final(point.progress) and isinstance(problem, Problem | Sizing):
            one_load_case = len(evaluation.load_cases) == 1
            adapt = _with_placed_objective if one_load_case else MechanicalProblem.placed
            problem, at_places = problem.adapted(evaluation, adapt)
        differentiated = self.loop.differentiate(at_places, distance, point.iteration, problem)
        functions = self.functions(point, differentiated, labels)
        if problem is not self.loop.problem:
            differentiated = _with_largest(evaluation, differentiated)
        return _AcceptedDesign(differentiated, functions)

    def merit_is_constant(self, point: _Point) -> bool:
        """Whether the merit of sharp designs has changed by less than the tolerance."""
        if point.best is None or self.changes(point.progress, 1.0):
            return False
        rows = [row for row in self.loop.rows if row["accepted"]][-1 - WINDOW :]
        merits = [row["merit"] for row in rows]
        sharp_iterations = point.iteration - math.ceil(RESULT_PROGRESS * self.loop.stage_iterations)
        if len(rows) <= WINDOW or (self.changes(0.0, 1.0) and sharp_iterations <= WINDOW + 1):
            return False
        return max(merits) - min(merits) < self.options.tolerance

    def evaluation(self, point: _Point, accepted: Evaluation, chosen: Array) -> Evaluation:
        """The nominal design's evaluation at the ``chosen`` variables (n,), computed if needed."""
        if chosen is point.asymptotes.x and not self.eroded(point.progress):
            return accepted
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
        arrays = {name: getattr(state, name) for name in STATE} | {"best": point.best}
        stored = {name: np.zeros(0) if array is None else array for name, array in arrays.items()}
        stored |= {name: getattr(point, name) for name in ("margins", *NUMBERS)}
        stored |= {"x": state.x, "move": state.move}
        if state.secants is not None:
            stored |= {f"secant {name}": getattr(state.secants, name) for name in SECANTS}
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
            state=stored if point.iteration else None,
        )

    def load(self, data: Mapping[str, Any]) -> None:
        """Continue from the point of an earlier run, which is evaluated anew."""
        x, progress = np.asarray(data["x"]), float(data["progress"])
        # `iterate` stores an empty array for None
        arrays = {
            name: np.asarray(data[name]) if len(data[name]) else None for name in (*STATE, "best")
        }
        best = arrays.pop("best")
        if f"secant {SECANTS[0]}" in data:
            secants = [np.asarray(data[f"secant {name}"]) for name in SECANTS]
            arrays["secants"] = Secants(*secants)  # type: ignore[assignment]
        state = Asymptotes(self.lower, self.upper, x, float(data["move"]), **arrays)  # type: ignore[arg-type]

        evaluation = self.loop.calibrated(self.loop.value(self.x(x, progress)))
        nominal = self.at_nominal(x, evaluation, progress)
        bounds = self.bounds(x, nominal, progress)
        numbers = {name: kind(data[name]) for name, kind in NUMBERS.items()}
        point = _Point(state, np.asarray(data["margins"]), bounds, best=best, **numbers)

        self.loop.resumed(evaluation)
        self.point, self.accepted = point, self.differentiate(evaluation, point)

    def identity(self) -> dict[str, Any]:
        """The entries that a checkpoint and the run that reads it have in common."""
        common: dict[str, Any] = {"optimizer": repr(self.options)}
        for name, design in self._designs.items():
            entries = design.identity()
            if name in self.volume:
                entries = {**entries, "volume": self.volume[name]}
            common |= {f"{key} of {name}": value for key, value in entries.items()}
        return common


def _nominal(design: Variables) -> Variables:
    """The nominal design; the analysed one may differ."""
    return design.nominal if isinstance(design, Design) else design


def _by_variables(name: str, design: Variables, variables: Array, bar: Array | None) -> Array:
    """The derivative by the variables, shape (size,), from a derivative by their `point`."""
    return design.pullback(
        variables, validation.real_array(f"optimize: the derivative by {name!r}", bar)
    )


def _with_largest(evaluation: Evaluation, at_places: Evaluation) -> Evaluation:
    """An ``evaluation`` with the gradients of another one, of constraints ``at_places``.

    A constraint on all places has the gradient of the worst place.
    """
    worst: dict[str, ConstraintValue] = {}
    for label, place in at_places.constraints.items():
        if constraint_of_place(label) == OBJECTIVE:
            continue
        name = label if label in evaluation.constraints else constraint_of_place(label)
        if name not in worst or place.violation > worst[name].violation:
            worst[name] = place
    cases = {
        name: replace(case, constraints=evaluation.load_cases[name].constraints)
        for name, case in at_places.load_cases.items()
    }
    names = ["gradient", "integrals_gradient", "nodes", "centers", "parameters"]
    fields = {name: getattr(at_places, name) for name in [*names, "solver_iterations", "seconds"]}
    return replace(evaluation, **fields, constraints=worst, load_cases=cases)


def _with_placed_objective(problem: MechanicalProblem, response: Response) -> MechanicalProblem:
    """The problem with bounds on places of the largest stress, also if it is the objective.

    The bounds on the objective are relative to its value at the ``response``.
    """
    placed, value = problem.placed(response), value_of(problem.objective, response)
    if not value > 0.0:
        return placed
    places = Constraint(problem.objective, upper=value, name=OBJECTIVE).places(response)
    if len(places) == 1:
        return placed
    return replace(placed, constraints=[*placed.constraints, *places])


def _largest(bounds: Array) -> float:
    """The largest of the constraints; minus infinity without any."""
    return float(np.max(bounds, initial=-math.inf))
