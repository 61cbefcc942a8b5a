# SPDX-License-Identifier: MIT
"""Objective values that are certain to a tolerance, by two methods with opposite errors.

Radau IIA damps a vibration that its steps do not resolve; the trapezoidal rule keeps it, and damps
it less than the machine does. Where the values of both agree, no vibration matters to them, or all
are resolved; where they do not, the steps are halved. Both follow steps that resolve the loads and
prescribed motions (`load_steps`). In a machine without damping the trapezoidal rule alone is
trusted, once three of its trajectories agree, as there only the other method damps vibrations.

Where equal steps do not come to an agreement, as a motion is fast for a short time, both follow
graded steps: the steps of an adaptive run, each divided by the same number.

None of the mechanisms stands for another. The search of jumps (`load_steps`) finds a blow of a
millisecond between the instants of all methods, which then agree that nothing happens. Radau IIA
alone, also with adaptive steps, converges to the motion without the vibrations of a cantilever that
feels its weight suddenly. The trapezoidal rule alone finds no force in the joint of a damped
pendulum under a load that jumps: with 128,000 steps it is three times as large as it is. Adaptive
steps alone find the grading of a motion that a damper stops within 1e-5 of its time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Array
from ..failures import SimulationError
from ..load_steps import SAMPLING, LoadSteps, equal_steps
from ..trajectory import Integrator, Trajectory
from .radau import CONTROL, RadauIIA
from .witness import TrapezoidalWitness

#: Simulates with a method.
Run = Callable[[Integrator], Trajectory]
#: The numbers that are asked for, of a trajectory, shape (numbers,).
Judge = Callable[[Trajectory], Array]


@dataclass(frozen=True)
class ChoiceOptions:
    """Options of the search for accurate numbers and for the cheapest steps that reach them."""

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
class Certificate:
    """Numbers of a trajectory, and how certain they are."""

    values: Array  #: The numbers, shape (numbers,).
    #: Their largest relative error at most, with a factor for trajectories that agree by chance.
    error: float
    estimate: float  #: The likely error, without that factor.
    #: Whether vibrations contribute to them that Radau IIA had lost with the first steps.
    rings: bool
    tried: tuple[tuple[Integrator, Array], ...]  #: The methods that were tried, and their numbers.
    cells: LoadSteps  #: The cells, each divided by the same number, in which both methods agree.


def relative_change(exact: Array, other: Array) -> float:
    """Largest relative change of numbers (numbers,), infinite if one is not finite."""
    size = np.where(exact == 0.0, 1.0, np.abs(exact))
    change = np.abs(exact - other) / size
    return float(np.max(change, initial=0.0)) if np.all(np.isfinite(change)) else np.inf


def certified(
    run: Run,
    judge: Judge,
    cells: LoadSteps,
    tolerance: float,
    *,
    damped: bool,
    near: Array | None = None,
) -> Certificate:
    """Numbers to a relative tolerance, or as certain as the work that is allowed makes them.

    `damped` says whether anything in the machine damps vibrations; `near` are the same numbers with
    some steps, whose error need be known to a share only. Raises the SimulationError or MemoryError
    of the last method if neither finds a trajectory.
    """

    def enough(values: Array) -> float:
        """The admissible error of values, given the estimates `near` them."""
        return max(tolerance, 0.0 if near is None else CHOICE.near * relative_change(values, near))

    equal: Certificate | None = None
    failure: SimulationError | MemoryError | None = None
    try:
        equal = _certified_in(cells, run, judge, tolerance, enough, damped=damped)
    except (SimulationError, MemoryError) as error:
        failure = error
    if equal is not None and equal.error <= enough(equal.values):
        return equal

    graded: Certificate | None = None
    if (cells_of_adaptive_run := graded_cells(run, cells)) is not None:
        try:
            graded = _certified_in(
                cells_of_adaptive_run, run, judge, tolerance, enough, damped=damped
            )
        except (SimulationError, MemoryError) as error:
            failure = failure or error
    if equal is None:
        if graded is not None:
            return graded
        assert failure is not None
        raise failure
    if graded is not None and graded.error <= enough(graded.values):
        # long steps may lose vibrations that the equal ones have seen
        if relative_change(equal.values, graded.values) <= equal.error:
            return graded
    return equal


def graded_cells(run: Run, cells: LoadSteps) -> LoadSteps | None:
    """The steps of an adaptive run as cells; None where equal steps would be about as good.

    Its tolerance is the loosest, as each cell is divided afterwards.
    """
    end_time = float(cells.ends[-1])
    try:
        ends = run(RadauIIA(end_time, tolerance=CONTROL.loosest)).step_ends
    except (SimulationError, MemoryError):
        return None
    named = np.union1d(cells.corners, cells.special)
    if named.size:
        # the run has found the same jumps and fast changes, but for round-off
        distance = np.min(np.abs(ends[1:-1, None] - named), axis=1)
        inner = ends[1:-1][distance > CONTROL.same_time * end_time]
        ends = np.union1d(np.append(ends[[0, -1]], named), inner)
    ends = equal_steps(ends, np.ceil(np.diff(ends) * (SAMPLING.fewest_cells / end_time)), 1)
    lengths = np.diff(ends)
    # Twice as many equal steps are tried anyway, and none of more steps than the work allows.
    gains = end_time > 2.0 * lengths.size * float(np.min(lengths))
    if not gains or 3 * CHOICE.cost_of_both * lengths.size > CHOICE.most_work:
        return None
    return replace(cells, ends=ends, special=ends[1:-1], fast=np.ones(lengths.size, dtype=bool))


def _certified_in(
    cells: LoadSteps,
    run: Run,
    judge: Judge,
    tolerance: float,
    enough: Callable[[Array], float],
    *,
    damped: bool,
) -> Certificate:
    """Numbers by both methods in cells that are divided until the methods agree."""
    tried: list[tuple[Integrator, Array]] = []
    failure: SimulationError | MemoryError | None = None

    def numbers_by(method: Integrator) -> Array | None:
        nonlocal failure
        try:
            numbers = judge(run(method))
        except (SimulationError, MemoryError) as error:
            failure = error
            return None
        tried.append((method, numbers))
        return numbers

    by_radau: list[Array | None] = []
    by_trapezoids: list[Array | None] = []
    best: _Agreement | None = None
    end_time, count = float(cells.ends[-1]), cells.ends.size - 1
    work, steps_of_cell = 0, 1
    while work == 0 or work + CHOICE.cost_of_both * count * steps_of_cell <= CHOICE.most_work:
        work += CHOICE.cost_of_both * count * steps_of_cell
        by_radau.append(numbers_by(radau_in(cells, steps_of_cell)))
        witness = TrapezoidalWitness(end_time, cells, CHOICE.trapezoidal_steps * steps_of_cell)
        by_trapezoids.append(numbers_by(witness))
        steps_of_cell *= 2
        agreement = _agreement(by_radau, by_trapezoids, damped=damped)
        if agreement is None:
            continue
        if best is None or agreement.gap <= best.gap:
            best = agreement
        if agreement.gap <= enough(agreement.values):
            break
    best = best or _by_one_method(by_radau) or _by_one_method(by_trapezoids)
    if best is None:
        assert failure is not None
        raise failure
    trusted = [best.values]
    if best.gap > tolerance:  # then the other method may know better
        trusted += [values for values in by_trapezoids[-1:] if values is not None]
    rings = any(_rings(by_radau, values, tolerance) for values in trusted)
    return Certificate(best.values, best.gap, best.error, rings, tuple(tried), cells)


def _rings(by_radau: list[Array | None], exact: Array, tolerance: float) -> bool:
    """Whether Radau IIA seemed to have converged and had not, as it damps vibrations."""
    coarse, fine = [*by_radau, None, None][:2]
    if coarse is None or fine is None:
        return False
    apparent = max(relative_change(fine, coarse), tolerance)
    return relative_change(exact, fine) > 3.0 * apparent


@dataclass(frozen=True)
class _Agreement:
    """Numbers of several trajectories that agree."""

    values: Array  #: The numbers, shape (numbers,).
    gap: float  #: Their largest relative difference, times what agreement by chance takes.
    error: float  #: Estimate of their largest relative error.


def _agreement(
    by_radau: list[Array | None], by_trapezoids: list[Array | None], *, damped: bool
) -> _Agreement | None:
    """The numbers to trust after the last trajectories of both methods; None of the first ones."""
    options: list[_Agreement] = []
    radau, coarser_radau = _newest(by_radau, 2)
    trapezoids, coarser, coarsest = _newest(by_trapezoids, 3)
    if radau is not None and coarser_radau is not None and trapezoids is not None:
        gap = relative_change(radau, trapezoids)
        if coarser is not None:
            # of second order: a third of the last change lies ahead
            extrapolated = trapezoids + (trapezoids - coarser) / 3.0
            gap = min(gap, relative_change(radau, extrapolated))
        gap = max(gap, relative_change(radau, coarser_radau) / 4.0)
        options.append(_Agreement(radau, gap, gap))
    if not damped and trapezoids is not None and coarser is not None and coarsest is not None:
        change = max(relative_change(trapezoids, coarser), relative_change(trapezoids, coarsest))
        options.append(_Agreement(trapezoids, CHOICE.luck * change, change))
    return min(options, key=lambda option: option.gap, default=None)


def _newest(numbers: list[Array | None], count: int) -> list[Array | None]:
    """The last `count` entries, the newest first, filled up with None."""
    return [*numbers[::-1], *[None] * count][:count]


def _by_one_method(numbers: list[Array | None]) -> _Agreement | None:
    """The last numbers of a method alone and their change, where the other has no trajectory."""
    computed = [values for values in numbers if values is not None]
    if len(computed) < 2:
        return None
    change = relative_change(computed[-1], computed[-2])
    return _Agreement(computed[-1], change, change)


def radau_in(cells: LoadSteps, steps_of_cell: int) -> RadauIIA:
    """Radau IIA in the given cells, each divided into a number of steps."""
    ends = cells.ends
    if not cells.special.size:
        return RadauIIA(float(ends[-1]), steps=(ends.size - 1) * steps_of_cell)
    shares = np.arange(steps_of_cell) / steps_of_cell
    inner = ends[:-1, None] + np.diff(ends)[:, None] * shares
    return RadauIIA(float(ends[-1]), steps=np.append(np.ravel(inner), ends[-1]))
