# SPDX-License-Identifier: MIT
"""Objective values that are certain to a tolerance, by two methods with opposite errors.

Radau IIA damps a vibration that its steps do not resolve; the trapezoidal rule keeps it, and damps
it less than the machine does. Where the values of both agree, no vibration matters to them, or all
are resolved; where they do not, the steps are halved. Both follow steps that resolve the loads and
prescribed motions (`load_steps`). In a machine without damping the trapezoidal rule alone is
trusted, once three of its trajectories agree, as there only the other method damps vibrations.

Where equal steps do not come to an agreement, as a motion is fast for a short time, both follow
graded steps: those of an adaptive run, each divided by the same number.

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
from ..load_steps import FEWEST_CELLS, LoadSteps, equal_steps
from ..trajectory import Integrator, Trajectory
from .radau import LOOSEST, SAME, RadauIIA
from .witness import TrapezoidalWitness

#: Simulates with a method.
Run = Callable[[Integrator], Trajectory]
#: The numbers that are asked for, of a trajectory, shape (numbers,).
Judge = Callable[[Trajectory], Array]

#: Time of a step of Radau IIA and its adjoint over that of generalised alpha: 5.7 to 8.6 were
#: measured with 4 to 80 normal modes. A number, so that the choice does not depend on the machine.
COST = 6
#: Steps of the trapezoidal rule for one of Radau IIA, which then take about the same time
EACH = 4
#: Factor of the change of three trajectories, as steps that do not resolve a vibration may agree by
#: chance
LUCK = 3.0
#: Relative accuracy with which the error of given numbers is estimated
NEAR = 0.2
#: Most steps of all trajectories of a certificate, in steps of generalised alpha
MOST_WORK = 2**19


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
    some steps, whose error need be known to a share `NEAR` only. Raises the SimulationError or
    MemoryError of the last method if neither finds a trajectory.
    """
    equal: Certificate | None = None
    failure: SimulationError | MemoryError | None = None
    try:
        equal = _certified(run, judge, cells, tolerance, damped=damped, near=near)
    except (SimulationError, MemoryError) as error:
        failure = error
    if equal is not None and equal.error <= _enough(tolerance, equal.values, near):
        return equal

    cells_of_adaptive_run = graded_cells(run, cells)
    if cells_of_adaptive_run is not None:
        try:
            graded = _certified(
                run, judge, cells_of_adaptive_run, tolerance, damped=damped, near=near
            )
        except (SimulationError, MemoryError) as error:
            failure = failure or error
        else:
            if equal is None:
                return graded
            # long steps may lose vibrations that the equal ones have seen
            agrees = relative_change(equal.values, graded.values) <= equal.error
            if agrees and graded.error <= _enough(tolerance, graded.values, near):
                return graded
    if equal is None:
        assert failure is not None
        raise failure
    return equal


def _enough(tolerance: float, values: Array, near: Array | None) -> float:
    """The error of values that is small enough, beside that of the same numbers `near` them."""
    return max(tolerance, 0.0 if near is None else NEAR * relative_change(values, near))


def graded_cells(run: Run, cells: LoadSteps) -> LoadSteps | None:
    """The steps of an adaptive run as cells; None where equal ones would be about as good.

    Its tolerance is the loosest, as each cell is divided afterwards.
    """
    end_time = float(cells.ends[-1])
    try:
        ends = run(RadauIIA(end_time, tolerance=LOOSEST)).step_ends
    except (SimulationError, MemoryError):
        return None
    named = np.union1d(cells.corners, cells.special)
    if named.size:
        # the run has found the same jumps and fast changes, but for round-off
        apart = np.min(np.abs(ends[1:-1, None] - named), axis=1) > SAME * end_time
        ends = np.union1d(np.append(ends[[0, -1]], named), ends[1:-1][apart])
    ends = equal_steps(ends, np.ceil(np.diff(ends) * (FEWEST_CELLS / end_time)), 1)
    lengths = np.diff(ends)
    # Twice as many equal steps are tried anyway, and none of more steps than the work allows.
    gains = end_time > 2.0 * lengths.size * float(np.min(lengths))
    if not gains or 3 * (COST + EACH) * lengths.size > MOST_WORK:
        return None
    return replace(cells, ends=ends, special=ends[1:-1], fast=np.ones(lengths.size, dtype=bool))


def _certified(
    run: Run,
    judge: Judge,
    cells: LoadSteps,
    tolerance: float,
    *,
    damped: bool,
    near: Array | None,
) -> Certificate:
    """The same in given cells."""
    tried: list[tuple[Integrator, Array]] = []
    radau: list[Array | None] = []
    kept: list[Array | None] = []
    failure: Exception | None = None
    best: _Agreement | None = None
    work, each, end_time = 0, 1, float(cells.ends[-1])
    count = cells.ends.size - 1
    while work == 0 or work + (COST + EACH) * count * each <= MOST_WORK:
        work += (COST + EACH) * count * each
        for method, found in (
            (radau_in(cells, each), radau),
            (TrapezoidalWitness(end_time, cells, EACH * each), kept),
        ):
            try:
                numbers = judge(run(method))
            except (SimulationError, MemoryError) as error:
                failure = error
                found.append(None)
                continue
            found.append(numbers)
            tried.append((method, numbers))
        each *= 2
        agreement = _agreement(radau, kept, damped=damped)
        if agreement is None:
            continue
        if best is None or agreement.gap <= best.gap:
            best = agreement
        if agreement.gap <= _enough(tolerance, agreement.values, near):
            break
    if best is None:
        best = _last_resort(radau, kept)
    if best is None:
        assert failure is not None
        raise failure
    against = [best.values]
    if best.gap > tolerance:  # then the other method may know better
        against += [values for values in kept[-1:] if values is not None]
    rings = any(_rings(radau, values, tolerance) for values in against)
    return Certificate(best.values, best.gap, best.error, rings, tuple(tried), cells)


def _ahead(now: Array, before: Array | None) -> Array:
    """Numbers of second order where all is resolved: a third of the last change lies ahead."""
    return now if before is None else now + (now - before) / 3.0


def _rings(radau: list[Array | None], exact: Array, tolerance: float) -> bool:
    """Whether Radau IIA seemed to have converged and had not, as it damps vibrations."""
    coarse, fine = [*radau, None, None][:2]
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
    radau: list[Array | None], kept: list[Array | None], *, damped: bool
) -> _Agreement | None:
    """The numbers to trust after the last trajectories of both methods; None of the first ones."""
    options: list[_Agreement] = []
    damping, before = _last(radau, 2)
    keeping, previous = _last(kept, 2)
    if damping is not None and before is not None and keeping is not None:
        ends = keeping, _ahead(keeping, previous)
        gap = min(relative_change(damping, end) for end in ends)
        gap = max(gap, relative_change(damping, before) / 4.0)
        options.append(_Agreement(damping, gap, gap))
    if not damped and len(kept) > 2:
        keeping, previous, first = _last(kept, 3)
        if keeping is not None and previous is not None and first is not None:
            change = max(relative_change(keeping, previous), relative_change(keeping, first))
            options.append(_Agreement(keeping, LUCK * change, change))
    return min(options, key=lambda option: option.gap, default=None)


def _last(found: list[Array | None], count: int) -> list[Array | None]:
    """The last `count` entries, the newest first, filled up with None."""
    return [*found[::-1], *[None] * count][:count]


def _last_resort(radau: list[Array | None], kept: list[Array | None]) -> _Agreement | None:
    """Last change and numbers of one method alone, where the other finds no trajectory."""
    for found in (radau, kept):
        good = [values for values in found if values is not None]
        if len(good) > 1:
            change = relative_change(good[-1], good[-2])
            return _Agreement(good[-1], change, change)
    return None


def radau_in(cells: LoadSteps, each: int) -> RadauIIA:
    """Radau IIA in the given cells, each divided into a number of steps."""
    ends = cells.ends
    if not cells.special.size:
        return RadauIIA(float(ends[-1]), steps=(ends.size - 1) * each)
    inner = ends[:-1, None] + np.diff(ends)[:, None] * (np.arange(each) / each)
    return RadauIIA(float(ends[-1]), steps=np.append(np.ravel(inner), ends[-1]))
