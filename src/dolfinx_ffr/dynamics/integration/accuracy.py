# SPDX-License-Identifier: MIT
"""Steps that follow from a tolerance, for either time integration.

The error of a trajectory is judged by a second one with steps twice as long: their difference is
three times the error of a second-order method and 31 times the error of a fifth-order one, while
vibrations that no step resolves make it about as large as the error. It is taken as it is, on the
safe side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ... import validation
from ..equations import CONSTRAINTS, FORCES
from ..failures import SimulationError
from ..kinematics import Kinematics, mass_norm, norm_floors
from ..trajectory import Integrator, Trajectory
from .step_choice import Run


@dataclass(frozen=True)
class AccuracyOptions:
    """Admissible tolerances, and limits for the shortening of steps."""

    tightest: float = 1e-12  #: Least tolerance.
    loosest: float = 0.1  #: Largest tolerance.
    most_steps: int = 2**17  #: Most steps that are tried.
    #: Change of the estimated error of forces by halved steps, below which they converge.
    converging: float = 0.5
    #: Steps that are far too long are not of the method's order yet: a gain beyond it, of this
    #: factor, is left to them.
    beyond_order: float = 100.0


ACCURACY = AccuracyOptions()


def _position_error(fine: Trajectory, coarse: Trajectory) -> float:
    """Largest difference of the positions of all material points, over the largest displacement.

    Both are mass norms, at the times at which steps of both trajectories end; the displacement is
    from the start of the fine one.
    """
    common = np.intersect1d(fine.step_ends, coarse.step_ends)
    ours, theirs = (r.y[np.searchsorted(r.t, common)] for r in (fine, coarse))
    arrays = fine.model.arrays
    displacement = float(np.max(mass_norm(arrays, arrays.difference(fine.y, fine.y[0]))))
    floor = norm_floors(arrays, float(fine.t[-1]))[0]
    difference = float(np.max(mass_norm(arrays, arrays.difference(ours, theirs))))
    return difference / max(displacement, floor)


def _force_error(fine: Trajectory, coarse: Trajectory) -> float:
    """Largest difference of the multipliers, relative to the largest of them.

    Rows count by the accelerations that their multipliers give the bodies at the start, so that
    forces and moments can be compared.
    """
    model, arrays = fine.model, fine.model.arrays
    if not model.rows:
        return 0.0
    kinematics = Kinematics(arrays)
    kinematics.begin(fine.y[0])
    kinematics.set(fine.y[0])
    kinematics.evaluate(0, CONSTRAINTS | FORCES, 0.0)
    eq = kinematics.equations
    reach = np.max(np.abs(eq.C) / np.sqrt(np.abs(np.diag(eq.M))), axis=1)
    common = np.intersect1d(fine.step_ends, coarse.step_ends)
    ours, theirs = (r.multipliers[np.searchsorted(r.t, common)] * reach for r in (fine, coarse))
    floor = norm_floors(arrays, float(fine.t[-1]))[3]
    return float(np.max(np.abs(ours - theirs)) / max(float(np.max(np.abs(ours))), floor))


def run_to_tolerance(integrator: Integrator, tolerance: float, run: Run) -> Trajectory:
    """Trajectory with as many steps as an accuracy of the positions takes.

    Fixed steps are halved, adaptive ones get a smaller tolerance, until the position error against
    a trajectory with steps twice as long is small enough, and with Radau IIA also the estimate of
    the error which single steps add. The trajectory's ``error`` is the former. Positions that are
    prescribed have no error, however long the steps: forces in joints reach the square root of the
    tolerance, too, unless they do not converge, as where they jump at times that nobody named; the
    trajectory's ``force_error`` tells.
    """
    validation.number("tolerance", tolerance, least=ACCURACY.tightest, most=ACCURACY.loosest)
    integrator = integrator.toward(tolerance)
    forces = math.inf
    while True:
        estimate, unresolved, trajectory = math.inf, False, None
        try:
            trajectory = run(integrator)
            # Steps that damp a vibration at once, and their double, both leave it out.
            unresolved = trajectory.error > tolerance * (1.0 + 1e-9)
            coarse = run(integrator.with_steps_of(trajectory).coarser)
            estimate = _position_error(trajectory, coarse)
            if math.isnan(trajectory.force_error):
                coarser_forces, forces = forces, _force_error(trajectory, coarse)
                trajectory = replace(trajectory, force_error=forces)
                unresolved = math.sqrt(tolerance) < forces <= ACCURACY.converging * coarser_forces
            trajectory = replace(trajectory, error=estimate)
        except SimulationError:
            # Shorter steps may help; adaptive ones have been as short as they can be.
            too_many = 2 * _steps(integrator, None) > ACCURACY.most_steps
            if trajectory is None and (integrator.adaptive or too_many):
                raise
        if trajectory is not None:
            if estimate <= tolerance and not unresolved:
                return trajectory
            if not _may_do(integrator.finer, trajectory, tolerance):
                raise SimulationError(
                    f"the tolerance of {tolerance:.1e} is out of reach: with "
                    f"{_steps(integrator, trajectory)} steps the estimated relative error of "
                    f"positions is {trajectory.error:.1e}; {integrator.remedy}",
                    trajectory,
                )
        integrator = integrator.finer


def _steps(integrator: Integrator, trajectory: Trajectory | None) -> int:
    """Number of steps of a method; of an adaptive one, the steps that a trajectory has taken."""
    if integrator.adaptive:
        return trajectory.step_ends.size - 1 if trajectory else 0
    return integrator.times.size - 1


def _may_do(finer: Integrator, trajectory: Trajectory, tolerance: float) -> bool:
    """Whether a finer method is allowed, and may do by its order."""
    steps = _steps(finer, trajectory)
    if steps > ACCURACY.most_steps:
        return False
    if finer.adaptive:
        return not finer.finest
    if not math.isfinite(trajectory.error):
        return True
    error = trajectory.error * (steps / ACCURACY.most_steps) ** finer.order
    return error <= ACCURACY.beyond_order * tolerance
