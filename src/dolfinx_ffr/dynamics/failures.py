# SPDX-License-Identifier: MIT
"""The error of a time integration that fails, with its diagnosis."""

from __future__ import annotations

from typing import Any

import numpy as np

from .integration.start import SINGULAR
from .kinematics import evaluate_equations
from .trajectory import Trajectory

#: Smallest singular value of the joints' scaled rows, in parts of the largest, below which the
#: mechanism is said to be singular where a step fails
NEARLY_SINGULAR = 0.05


class SimulationError(RuntimeError):
    """The time integration stopped before the end time.

    Its ``message`` tells time, body and joint.
    """

    #: The trajectory up to the last good step; None where another rank alone has it.
    trajectory: Trajectory

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        super().__init__(message)
        self.trajectory = trajectory

    def __reduce__(self) -> tuple[Any, ...]:
        # Other ranks get the message alone, as a trajectory may hold functions.
        return type(self), (str(self), None)


def diagnosis(trajectory: Trajectory, k: int, where: str, iterations: int, status: int) -> str:
    """Message for a failed step, from the residual of its last iterate in row k."""
    model, n = trajectory.model, trajectory.model.size
    y, v, w, lam = trajectory.y[k], trajectory.v[k], trajectory.w[k], trajectory.multipliers[k]
    residual = evaluate_equations(model.arrays, k, y, v, w, lam, trajectory.turns).residual
    size = np.nan_to_num(np.abs(residual), nan=np.inf, posinf=np.inf)
    worst = int(np.argmax(size[:n]))
    turning = model.rotations[worst]
    text = f"at t = {trajectory.t[k]:.6g} s ({where}) "
    if status == SINGULAR and _is_singular(trajectory, k - trajectory.integrator.stages):
        text += "the mechanism is singular (joints redundant, or links in line)"
    elif status == SINGULAR:
        text += (
            "Newton's method diverges, as a step is too long for the motion, or as the joints "
            "cannot follow it any further"
        )
    else:
        text += f"Newton's method does not converge in {iterations} iterations"
    text += (
        f": the largest residual is {size[worst]:.3g} {'N m' if turning else 'N'} in body "
        f"{model.body_of_coordinate(worst)!r}"
    )
    if model.rows:
        gap = size[n : n + model.rows]
        row = int(np.argmax(gap))
        unit = "rad" if model.angular[row] else "m"
        text += f" and {gap[row]:.3g} {unit} in joint {model.joint_of_row(row)!r}"
    if not trajectory.integrator.adaptive:
        text += (
            "; take smaller steps, or RadauIIA(end_time, tolerance=1e-6), which takes short ones "
            "where the motion needs them, or"
        )
    else:
        text += ";"
    return text + " look at the motion so far in the exception's trajectory"


def _is_singular(trajectory: Trajectory, k: int) -> bool:
    """Whether joints nearly depend on each other at the instant of a number."""
    model, none = trajectory.model, np.zeros(trajectory.model.rows)
    if not model.rows:
        return False
    state = trajectory.y[k], trajectory.v[k], trajectory.w[k], none
    evaluation = evaluate_equations(model.arrays, k, *state, trajectory.turns)
    # in units of the coordinates in which they have the same inertia
    scaled = evaluation.jacobian / np.sqrt(np.abs(np.diag(evaluation.mass)))
    scaled /= np.linalg.norm(scaled, axis=1, keepdims=True)
    values = np.linalg.svd(scaled, compute_uv=False)
    return bool(values[-1] < NEARLY_SINGULAR * values[0])
