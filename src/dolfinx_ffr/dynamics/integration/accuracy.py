# SPDX-License-Identifier: MIT
"""Steps that follow from a tolerance, for either time integration.

The error of a motion is judged by a second one with steps twice as long: their difference is three
times the error of a second-order method and 31 times that of a fifth-order one, while vibrations
that no step resolves make it about as large as the error. It is taken as it is, on the safe side.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ... import validation
from ..failures import SimulationError
from ..kinematics import least_sizes, sizes_by_mass, ways
from ..trajectory import Integrator, Trajectory

__all__ = ["coarser_run", "position_error", "run_to_tolerance"]

Array = NDArray[np.float64]
Run = Callable[[Integrator], Trajectory]

#: Most steps that are tried.
MOST_STEPS = 2**17
#: Bounds of what may be asked for.
TIGHTEST, LOOSEST = 1e-12, 0.1


def coarser_run(integrator: Integrator, trajectory: Trajectory, run: Run) -> Trajectory:
    """The motion with steps twice as long.

    Args:
        integrator: Method of the motion.
        trajectory: The motion.
        run: Simulates with a method.

    Raises:
        SimulationError: If the steps are too long for that.
    """
    return run(integrator.with_steps_of(trajectory).coarser)


def position_error(fine: Trajectory, coarse: Trajectory) -> float:
    """Largest difference of the positions of all material points, relative to the longest way.

    Both are root mean squares by mass, at the times at which steps of both motions end; the way is
    that from the start.

    Args:
        fine: A motion.
        coarse: The same motion with other steps.
    """
    common = np.intersect1d(fine.step_ends, coarse.step_ends)
    ours, theirs = (r.y[np.searchsorted(r.t, common)] for r in (fine, coarse))
    arrays = fine.model.arrays
    way = float(np.max(sizes_by_mass(arrays, ways(arrays, fine.y, fine.y[0]))))
    smallest = least_sizes(arrays, float(fine.t[-1]))[0]
    return float(np.max(sizes_by_mass(arrays, ways(arrays, ours, theirs)))) / max(way, smallest)


def run_to_tolerance(
    integrator: Integrator,
    tolerance: float,
    run: Run,
    error: Callable[[Trajectory, Trajectory], float],
    what: str,
) -> tuple[Integrator, Trajectory]:
    """Motion with as many steps as an accuracy takes, and the method that made it.

    Fixed steps are halved, adaptive ones get a smaller tolerance, until the estimate holds, and
    with Radau IIA also that of the error which single steps add.

    Args:
        integrator: Method to begin with.
        tolerance: Largest error allowed.
        run: Simulates with a method.
        error: Estimate of the error from a motion and one with steps twice as long.
        what: What the error is of, for the message.

    Returns:
        The last method, and its motion, whose ``error`` is the estimate.

    Raises:
        ValueError: If the tolerance is out of range.
        SimulationError: If the tolerance is not reached; it says what was reached, and keeps the
            motion that was.
    """
    validation.number("tolerance", tolerance, least=TIGHTEST, most=LOOSEST)
    integrator = integrator.toward(tolerance)
    while True:
        estimate, unresolved, trajectory = math.inf, False, None
        try:
            trajectory = run(integrator)
            # Steps that damp a vibration at once, and their double, both leave it out.
            unresolved = trajectory.error > tolerance * (1.0 + 1e-9)
            estimate = error(trajectory, coarser_run(integrator, trajectory, run))
            trajectory = replace(trajectory, error=estimate)
        except SimulationError:
            # Shorter steps may help; adaptive ones have been as short as they can be.
            too_many = 2 * _steps(integrator, None) > MOST_STEPS
            if trajectory is None and (integrator.adaptive or too_many):
                raise
        if trajectory is not None:
            if estimate <= tolerance and not unresolved:
                return integrator, trajectory
            if not _may_do(integrator.finer, trajectory, tolerance):
                raise SimulationError(_refusal(integrator, trajectory, tolerance, what), trajectory)
        integrator = integrator.finer


def _steps(integrator: Integrator, trajectory: Trajectory | None) -> int:
    """Number of steps of a method, of an adaptive one those that a motion has taken."""
    if integrator.adaptive:
        return trajectory.step_ends.size - 1 if trajectory else 0
    return integrator.times.size - 1


def _may_do(finer: Integrator, trajectory: Trajectory, tolerance: float) -> bool:
    """Whether a finer method is allowed, and may do by its order."""
    steps = _steps(finer, trajectory)
    if steps > MOST_STEPS:
        return False
    if finer.adaptive:
        return not finer.finest
    if not math.isfinite(trajectory.error):
        return True
    # Steps that are far too long are not of that order yet: a hundredfold gain is left to them.
    return trajectory.error * (steps / MOST_STEPS) ** finer.order <= 100.0 * tolerance


def _refusal(integrator: Integrator, trajectory: Trajectory, tolerance: float, what: str) -> str:
    steps = _steps(integrator, trajectory)
    text = (
        f"the tolerance of {tolerance:.1e} is out of reach: with {steps} steps the estimated "
        f"relative error of {what} is {trajectory.error:.1e}; "
    )
    return text + integrator.remedy
