# SPDX-License-Identifier: MIT
"""What is raised when a time integration fails, and what it says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .integration.start import SINGULAR
from .kinematics import evaluate_equations
from .model import FlatModel
from .trajectory import Integrator, Trajectory

__all__ = ["SimulationError", "at_rest", "cut", "diagnosis"]


class SimulationError(RuntimeError):
    """The time integration came to an end before its time."""

    #: The trajectory up to the last good step; None where another rank alone has it.
    trajectory: Trajectory

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        """Keep the trajectory so far.

        Args:
            message: What happened, where and when.
            trajectory: The trajectory up to the last good step.
        """
        super().__init__(message)
        self.trajectory = trajectory

    def __reduce__(self) -> tuple[Any, ...]:
        """What is sent to other ranks: the message; a motion may hold functions."""
        return type(self), (str(self), None)


def at_rest(model: FlatModel, steps: int, integrator: Integrator) -> Trajectory:
    """A trajectory of zeros, to be filled in.

    Args:
        model: The compiled mechanism.
        steps: Number of instants after the start.
        integrator: The integration method.
    """
    y, v, w, a = (np.zeros((steps + 1, model.size)) for _ in range(4))
    multipliers, stabilization = (np.zeros((steps + 1, model.rows)) for _ in range(2))
    iterations, beginning = np.zeros(steps, dtype=np.int64), np.zeros((4, model.size))
    times = model.times[: steps + 1]
    return Trajectory(
        times, y, v, w, a, multipliers, stabilization, iterations, beginning, model, integrator
    )


def cut(trajectory: Trajectory, last: int) -> Trajectory:
    """The trajectory up to an instant.

    Args:
        trajectory: The whole trajectory.
        last: Number of the last instant.
    """
    names = ("t", "y", "v", "w", "a", "multipliers", "stabilization")
    parts = {name: getattr(trajectory, name)[: last + 1].copy() for name in names}
    return replace(trajectory, **parts, iterations=trajectory.iterations[:last].copy())


def diagnosis(
    trajectory: Trajectory, k: int, where: str, iterations: int, status: int, remedy: str
) -> str:
    """Say what failed in step k, from the residual of the last iterate.

    Args:
        trajectory: The trajectory, with the last iterate in row k.
        k: Number of the instant that failed.
        where: The step, in words.
        iterations: Newton iterations of the step.
        status: Outcome of the loop.
        remedy: What may help.
    """
    model, n = trajectory.model, trajectory.model.size
    rows = (part[k] for part in (trajectory.y, trajectory.v, trajectory.w, trajectory.multipliers))
    residual = evaluate_equations(model.arrays, k, *rows).residual
    size = np.nan_to_num(np.abs(residual), nan=np.inf, posinf=np.inf)
    worst = int(np.argmax(size[:n]))
    turning = model.rotations[worst]
    text = f"at t = {trajectory.t[k]:.6g} s ({where}) "
    if status == SINGULAR:
        text += "the mechanism is singular (joints redundant, or links in line)"
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
    return text + f"; {remedy}look at the motion so far in the exception's trajectory"
