# SPDX-License-Identifier: MIT
"""Objective values that are certain to a tolerance, and the cheapest steps that reproduce them.

Let J be the numbers that are asked for, R_h those by Radau IIA with steps of length h, and T_h
those by the trapezoidal rule with steps of a quarter of it. All steps end where loads and
prescribed motions jump, and are so short that they resolve both (`load_steps`).

Where steps resolve a motion, R_h = J + O(h^5) and T_h = J + c h^2 + O(h^4), so that
T_h + (T_h - T_2h) / 3 is of fourth order. A vibration that they do not resolve is lost by Radau IIA
with the first steps, also by steps half as long: R_h and R_2h agree and prove nothing. The
trapezoidal rule keeps its amplitude, and damps it less than the machine does. Both errors have
opposite signs, and

    error of R_h  <=  max(|R_h - T_h|, |R_h - R_2h| / 4),

where T_h may be the extrapolated value; the second term is far more than the order of Radau IIA
leaves, in case that both methods agree by chance. In a machine without damping the trapezoidal rule
is right about the vibrations long before Radau IIA resolves them. There also

    error of T_h  <=  3 max(|T_h - T_2h|, |T_h - T_4h|),

with a factor for agreement by chance. The steps are halved until one of the bounds is a third of
the tolerance. Where equal steps do not come so far, as a motion is fast for a short time, both
methods follow graded steps: those of an adaptive run, each divided by the same number.

None of the mechanisms stands for another. Without the search of jumps a blow of a millisecond lies
between the instants of all methods, which then agree that nothing happens. Radau IIA alone, also
with adaptive steps, converges to the motion without the vibrations of a cantilever that feels its
weight suddenly. The trapezoidal rule alone finds no force in the joint of a damped pendulum under a
load that jumps: with 128,000 steps it is three times as large as it is. Adaptive steps alone find
the grading of a motion that a damper stops within 1e-5 of its time.
"""

from __future__ import annotations

import heapq
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import repeat
from time import perf_counter

import numpy as np

from ...arrays import Array
from ..failures import SimulationError
from ..load_steps import SAMPLING, LoadSteps, equal_steps
from ..trajectory import Integrator, Trajectory
from .generalized_alpha import GeneralizedAlpha
from .radau import CONTROL, RadauIIA
from .witness import TrapezoidalWitness

#: Simulates with a method.
Run = Callable[[Integrator], Trajectory]
#: The numbers that are asked for, of a trajectory, shape (numbers,).
Judge = Callable[[Trajectory], Array]


@dataclass(frozen=True)
class ChoiceOptions:
    """Options of the search for accurate numbers and for the cheapest steps that reach them."""

    tightest: float = 1e-12  #: Least tolerance that may be asked for.
    loosest: float = 0.1  #: Largest tolerance.
    #: Time of a step of Radau IIA and its adjoint over the time of a step of generalised alpha: 5.7
    #: to 8.6 were measured with 4 to 80 normal modes. It is a constant, so that the choice does not
    #: depend on the machine.
    cost: int = 6
    #: Steps of the trapezoidal rule for one of Radau IIA, which then take about the same time.
    trapezoidal_steps: int = 4
    #: Factor of the change of three trajectories, as steps that do not resolve a vibration may
    #: agree by chance.
    luck: float = 3.0
    near: float = 0.2  #: Relative accuracy with which the error of given numbers is estimated.
    finest: float = 1e-8  #: Error of numbers below which none is looked for.
    #: Most steps of all trajectories of a certificate, in steps of generalised alpha.
    most_work: int = 2**19
    #: Share of a tolerance that is left to the certified numbers.
    share_of_certificate: float = 1.0 / 3.0
    fewest_steps: int = 250  #: Steps of generalised alpha to begin with.
    #: Most steps that are chosen, of generalised alpha; of Radau IIA as many as cost the same.
    most_steps: int = 2**16
    #: Where the tolerance is out of reach, an error up to this factor above the least is as good.
    as_good: float = 1.5

    @property
    def cost_of_both(self) -> int:
        """Time of a step of Radau IIA and of the steps of the trapezoidal rule beside it."""
        return self.cost + self.trapezoidal_steps


CHOICE = ChoiceOptions()


@dataclass(frozen=True)
class StepChoice:
    """Method and steps for an accuracy, and how far they can be trusted."""

    integrator: Integrator  #: Method with its steps.
    error: float  #: Estimate of the largest relative error of all objectives.
    tolerance: float  #: Relative error that was asked for.
    #: Whether vibrations contribute that steps as long as the motion allows would lose.
    rings: bool
    resolved: bool  #: Whether all changes of loads and prescribed motions could be followed.
    seconds: float  #: Time that the choice took [s].

    @property
    def met(self) -> bool:
        """Whether the steps meet the tolerance."""
        return self.resolved and self.error <= self.tolerance

    @property
    def cost(self) -> int:
        """Time of a trajectory and its adjoint, in steps of generalised alpha."""
        return _cost(self.integrator)

    def __str__(self) -> str:
        """One line for a log."""
        method, error = self.integrator.in_words, f"{self.error:.1e}"
        text = f"time steps: {method}, estimated relative error of psi {error}"
        if self.rings:
            text += ", vibrations contribute to it"
        return f"{text} (chosen in {self.seconds:.2g} s)"

    @property
    def doubt(self) -> str:
        """Warning where the tolerance is not met."""
        if not self.resolved:
            reason = (
                ", and a load or a motion changes within every step; give it as a smooth function "
                "of time"
            )
        elif self.rings:
            reason = (
                ", because the motion excites vibrations (a load or a drive that sets in "
                "suddenly, a spring out of balance); damp them, let loads and drives begin "
                "smoothly, begin in StaticEquilibrium(), or take a larger tolerance"
            )
        else:
            reason = (
                "; name the times at which forces or motions jump (Mechanism.jumps), or take a "
                "larger tolerance"
            )
        return (
            f"the time steps are too long for the relative error of {self.tolerance:.1e}: with "
            f"{self.integrator.in_words} the estimated error is {self.error:.1e}{reason}"
        )


@dataclass(frozen=True)
class Certificate:
    """Numbers of a trajectory, and how certain they are."""

    values: Array  #: The numbers, shape (numbers,).
    #: Their largest relative error at most, with a factor for trajectories that agree by chance.
    bound: float
    estimate: float  #: The likely error, without that factor.
    cells: LoadSteps  #: The cells, each divided by the same number, in which methods agree.
    #: Whether vibrations contribute to them that Radau IIA had lost with the first steps.
    rings: bool = False


class StepSearch:
    """The search of certain numbers of one motion, and of the cheapest steps that reach them.

    Each method is simulated once.
    """

    def __init__(self, run: Run, judge: Judge, cells: LoadSteps, *, damped: bool) -> None:
        """Prepare a search.

        Args:
            run: Simulates with a method.
            judge: Computes the objective and the constraints of a trajectory.
            cells: Steps that resolve loads and prescribed motions.
            damped: Whether anything in the machine damps vibrations.
        """
        self.run, self.judge, self.cells, self.damped = run, judge, cells, damped
        self.end_time = float(cells.ends[-1])
        self._numbers: dict[Integrator, Array | None] = {}
        self._failure: SimulationError | MemoryError | None = None

    def chosen(self, tolerance: float, present: Trajectory | None = None) -> StepChoice:
        """The cheapest method and number of steps that meet a tolerance.

        The method and steps of a `present` trajectory are reused if they meet it. Raises the
        SimulationError or MemoryError of the last method if none finds a trajectory.
        """
        start = perf_counter()
        exact = self.certificate(CHOICE.share_of_certificate * tolerance)

        def choice(method: Integrator, error: float) -> StepChoice:
            chosen = replace(method, chosen_for=tolerance)
            seconds = perf_counter() - start
            return StepChoice(chosen, error, tolerance, exact.rings, self.cells.resolved, seconds)

        if present is not None:
            error = relative_change(exact.values, self.judge(present)) + exact.bound
            if error <= tolerance:
                return choice(present.integrator, error)

        families = [self._radau(exact.cells), self._alpha(GeneralizedAlpha.spectral_radius)]
        if not self.cells.corners.size and not self.damped:
            families.append(self._alpha(1.0))
        method, error = self._cheapest(families, exact, tolerance)
        if error > tolerance and exact.cells is self.cells and self._graded_cells is not None:
            families = [self._radau(self._graded_cells)]
            graded_method, graded_error = self._cheapest(families, exact, tolerance)
            if graded_error < error:
                method, error = graded_method, graded_error
        return choice(method, error)

    def error_of(self, trajectory: Trajectory) -> float:
        """Estimate of the largest relative error of a trajectory's numbers."""
        values = self.judge(trajectory)
        exact = self.certificate(CHOICE.finest, near=values)
        return relative_change(exact.values, values) + exact.bound

    def certificate(self, tolerance: float, near: Array | None = None) -> Certificate:
        """Numbers to a tolerance, or as certain as the work that is allowed makes them.

        Where they are the numbers `near` to some whose error is asked for, that error need be known
        to a share only. Raises the error of the last method if none finds a trajectory.
        """

        def certain(numbers: Certificate) -> bool:
            if near is None:
                return numbers.bound <= tolerance
            error = relative_change(numbers.values, near)
            return numbers.bound <= max(tolerance, CHOICE.near * error)

        equal = self._agreement_in(self.cells, tolerance, certain)
        if equal is not None and certain(equal):
            return equal

        graded = None
        if self._graded_cells is not None:
            graded = self._agreement_in(self._graded_cells, tolerance, certain)
        if equal is None:
            if graded is None:
                assert self._failure is not None
                raise self._failure
            return graded
        if graded is not None and certain(graded):
            # long steps may lose vibrations that the equal ones have seen
            if relative_change(equal.values, graded.values) <= equal.bound:
                return graded
        return equal

    def numbers(self, method: Integrator) -> Array | None:
        """The numbers by a method; None where it finds no trajectory."""
        if method not in self._numbers:
            try:
                self._numbers[method] = self.judge(self.run(method))
            except (SimulationError, MemoryError) as error:
                self._numbers[method], self._failure = None, error
        return self._numbers[method]

    @cached_property
    def _graded_cells(self) -> LoadSteps | None:
        """The steps of an adaptive run as cells; None where equal steps would be about as good.

        Its tolerance is the loosest, as each cell is divided afterwards.
        """
        cells, end_time = self.cells, self.end_time
        try:
            ends = self.run(RadauIIA(end_time, tolerance=CONTROL.loosest)).step_ends
        except (SimulationError, MemoryError):
            return None

        named = np.union1d(cells.corners, cells.special)
        if named.size:
            # the run has found the same jumps and fast changes, but for round-off
            distance = np.min(np.abs(ends[1:-1, None] - named), axis=1)
            inner = ends[1:-1][distance > CONTROL.same_time * end_time]
            ends = np.union1d(np.append(ends[[0, -1]], named), inner)
        ends = equal_steps(ends, np.ceil(np.diff(ends) * (SAMPLING.fewest_cells / end_time)), 1)

        # twice as many equal steps are tried anyway, and none of more steps than the work allows
        lengths = np.diff(ends)
        as_equal_steps = end_time / float(np.min(lengths))
        work = 3 * CHOICE.cost_of_both * lengths.size
        if as_equal_steps <= 2.0 * lengths.size or work > CHOICE.most_work:
            return None
        return replace(cells, ends=ends, special=ends[1:-1], fast=np.ones(lengths.size, dtype=bool))

    def _agreement_in(
        self, cells: LoadSteps, tolerance: float, certain: Callable[[Certificate], bool]
    ) -> Certificate | None:
        """Numbers by both methods in cells that are divided until they are certain.

        None where no method finds two trajectories.
        """
        by_radau: list[Array | None] = []
        by_trapezoids: list[Array | None] = []
        best: Certificate | None = None
        work, steps_of_cell = CHOICE.cost_of_both * (cells.ends.size - 1), 1
        # the work of all trajectories down to these steps is 1 + 2 + 4 + ... times the first one's
        while steps_of_cell == 1 or work * (2 * steps_of_cell - 1) <= CHOICE.most_work:
            by_radau.append(self.numbers(radau_in(cells, steps_of_cell)))
            trapezoidal_steps = CHOICE.trapezoidal_steps * steps_of_cell
            witness = TrapezoidalWitness(self.end_time, cells, trapezoidal_steps)
            by_trapezoids.append(self.numbers(witness))
            steps_of_cell *= 2

            newest = _agreement(cells, by_radau, by_trapezoids, damped=self.damped)
            if newest is not None and (best is None or newest.bound <= best.bound):
                best = newest
                if certain(best):
                    break
        best = best or _by_one_method(cells, by_radau) or _by_one_method(cells, by_trapezoids)
        if best is None:
            return None

        trusted = [best.values]
        if best.bound > tolerance and by_trapezoids[-1] is not None:
            trusted.append(by_trapezoids[-1])  # it may know better
        rings = any(_lost_by_radau(by_radau, values, tolerance) for values in trusted)
        return replace(best, rings=rings)

    def _radau(self, cells: LoadSteps) -> Iterator[Integrator]:
        """Radau IIA in cells that are divided further and further."""
        steps_of_cell, count = 1, cells.ends.size - 1
        while steps_of_cell == 1 or CHOICE.cost * count * steps_of_cell <= CHOICE.most_steps:
            yield radau_in(cells, steps_of_cell)
            steps_of_cell *= 2

    def _alpha(self, spectral_radius: float) -> Iterator[Integrator]:
        """Generalised alpha with more and more steps."""
        steps = CHOICE.fewest_steps
        while steps <= CHOICE.most_steps:
            yield GeneralizedAlpha(self.end_time, steps, spectral_radius)
            steps *= 2

    def _cheapest(
        self, families: list[Iterator[Integrator]], exact: Certificate, tolerance: float
    ) -> tuple[Integrator, float]:
        """The cheapest method near enough to certain numbers, and its estimated error.

        The steps of each family become shorter and shorter. A method is taken if the next one of
        its family is near enough, too. If there is none, the cheapest of the methods with about the
        least error is taken.
        """
        cheapest: tuple[Integrator, float] | None = None
        tried: list[tuple[Integrator, float]] = []
        newest_of_family: dict[int, tuple[Integrator, float]] = {}
        by_family = [zip(repeat(k), family) for k, family in enumerate(families)]
        for family, method in heapq.merge(*by_family, key=lambda pair: _cost(pair[1])):
            if cheapest is not None and _cost(method) >= 2 * _cost(cheapest[0]):
                return cheapest
            values, error = self.numbers(method), math.inf
            if values is not None:
                error = relative_change(exact.values, values) + exact.bound
            tried.append((method, error))
            coarser = newest_of_family.get(family)
            newest_of_family[family] = method, error
            if coarser is not None and max(coarser[1], error) <= tolerance:
                if cheapest is None or _cost(coarser[0]) < _cost(cheapest[0]):
                    cheapest = coarser
        if cheapest is not None:
            return cheapest

        least = min(error for _, error in tried)
        if not math.isfinite(least):
            assert self._failure is not None
            raise self._failure
        good = [pair for pair in tried if pair[1] <= CHOICE.as_good * least]
        method, error = min(good, key=lambda pair: _cost(pair[0]))
        # far from the tolerance the larger part of the error tells more than the sum of both
        larger = max(error - exact.bound, exact.estimate)
        return method, larger if larger > tolerance else error


def relative_change(exact: Array, approximate: Array) -> float:
    """Largest relative change of numbers (numbers,), infinite if one is not finite."""
    size = np.where(exact == 0.0, 1.0, np.abs(exact))
    change = np.abs(exact - approximate) / size
    return float(np.max(change, initial=0.0)) if np.all(np.isfinite(change)) else np.inf


def radau_in(cells: LoadSteps, steps_of_cell: int) -> RadauIIA:
    """Radau IIA in the given cells, each divided into a number of steps."""
    ends = cells.ends
    if not cells.special.size:
        return RadauIIA(float(ends[-1]), steps=(ends.size - 1) * steps_of_cell)
    shares = np.arange(steps_of_cell) / steps_of_cell
    inner = ends[:-1, None] + np.diff(ends)[:, None] * shares
    return RadauIIA(float(ends[-1]), steps=np.append(np.ravel(inner), ends[-1]))


def _cost(method: Integrator) -> int:
    """Time of a trajectory and its adjoint, in steps of generalised alpha."""
    return (CHOICE.cost if method.stages > 1 else 1) * (method.times.size - 1)


def _agreement(
    cells: LoadSteps,
    by_radau: list[Array | None],
    by_trapezoids: list[Array | None],
    *,
    damped: bool,
) -> Certificate | None:
    """The better of both bounds after the newest trajectories; None where there are too few."""
    radau, trapezoids = _newest_first(by_radau), _newest_first(by_trapezoids)
    candidates: list[Certificate] = []
    if len(radau) > 1 and trapezoids:
        gap = relative_change(radau[0], trapezoids[0])
        if len(trapezoids) > 1:
            extrapolated = trapezoids[0] + (trapezoids[0] - trapezoids[1]) / 3.0
            gap = min(gap, relative_change(radau[0], extrapolated))
        gap = max(gap, relative_change(radau[0], radau[1]) / 4.0)
        candidates.append(Certificate(radau[0], gap, gap, cells))
    if not damped and len(trapezoids) > 2:
        change = max(relative_change(trapezoids[0], coarser) for coarser in trapezoids[1:3])
        candidates.append(Certificate(trapezoids[0], CHOICE.luck * change, change, cells))
    return min(candidates, key=lambda candidate: candidate.bound, default=None)


def _newest_first(numbers: list[Array | None]) -> list[Array]:
    """The ``numbers`` of the shortest steps first, up to steps that gave no trajectory.

    The argument begins with the longest steps; None stands for no trajectory.
    """
    newest: list[Array] = []
    for values in reversed(numbers):
        if values is None:
            break
        newest.append(values)
    return newest


def _by_one_method(cells: LoadSteps, numbers: list[Array | None]) -> Certificate | None:
    """The newest numbers and their change, where the other method has no trajectory."""
    computed = [values for values in numbers if values is not None]
    if len(computed) < 2:
        return None
    change = relative_change(computed[-1], computed[-2])
    return Certificate(computed[-1], change, change, cells)


def _lost_by_radau(by_radau: list[Array | None], exact: Array, tolerance: float) -> bool:
    """Whether Radau IIA seemed to have converged and had not, as it damps vibrations."""
    if len(by_radau) < 2:
        return False
    coarse, fine = by_radau[:2]
    if coarse is None or fine is None:
        return False
    apparent = max(relative_change(fine, coarse), tolerance)
    return relative_change(exact, fine) > 3.0 * apparent


def recorded(integrator: Integrator) -> str:
    """Method and steps as a text, from which :func:`restored_method` makes them again."""
    return json.dumps({"method": type(integrator).__name__, **asdict(integrator)})


def restored_method(text: str) -> Integrator:
    """Method and steps from the text that :func:`recorded` gave."""
    numbers = json.loads(text)
    kinds: dict[str, type[Integrator]] = {k.__name__: k for k in (RadauIIA, GeneralizedAlpha)}
    return kinds[numbers.pop("method")](**numbers)
