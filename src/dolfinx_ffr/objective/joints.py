# SPDX-License-Identifier: MIT
"""Objectives of the forces in joints."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..body import VolumeIntegrals
from ..dynamics import Trajectory, TrajectoryBar
from .base import Bodies, Objective
from .time_average import check_window, power_mean, time_weights

__all__ = ["JointForce"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointForce(Objective):
    """Power mean over time of the force in a joint [N].

        psi = (1/T int |F(t)|^p dt)^(1/p)

    With p = 2 it is the root mean square; it tends to the largest force over time as p grows. F is
    the vector of the joint's forces, as in :meth:`Trajectory.joint_force`. A joint that carries
    forces and a moment, a weld for instance, counts its forces unless ``moment`` is set; a joint
    that carries only a moment, a drive, counts that [N m].

    Raises:
        ValueError: If the power is not above 1 or the window is not an interval; when the value is
            asked for, if there is no such joint or it carries no moment.
    """

    #: Name of the joint.
    joint: str
    #: The power p, above 1.
    power: float = 2.0
    #: Count the moment of a joint that carries forces as well [N m].
    moment: bool = False
    #: Begin and end of the time that counts [s]; None takes the whole motion.
    window: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Check name, power and window."""
        validation.name("joint force: joint", self.joint)
        validation.flag("joint force: moment", self.moment)
        validation.number("joint force: the power", self.power, least=1.0)
        if self.power == 1.0:
            raise ValueError(
                "joint force: with a power of 1 the mean has a kink where the force vanishes; "
                "take a larger one"
            )
        check_window("joint force", self.window)

    def value(self, trajectory: Trajectory, bodies: Bodies) -> float:
        size, weights = self._size(trajectory)
        return power_mean(size, weights, self.power)[0]

    def pullback(
        self, trajectory: Trajectory, bodies: Bodies
    ) -> tuple[TrajectoryBar, dict[str, VolumeIntegrals]]:
        size, weights = self._size(trajectory)
        size_bar = power_mean(size, weights, self.power)[1]
        rows = self._rows(trajectory)
        bar = TrajectoryBar.zeros(trajectory)
        # Where the force vanishes, so does the derivative, as the power is above 1.
        quotient = np.divide(size_bar, size, out=np.zeros_like(size), where=size > 0.0)
        bar.multipliers[:, rows] = quotient[:, None] * trajectory.multipliers[:, rows]
        return bar, {}

    def _size(self, trajectory: Trajectory) -> tuple[Array, Array]:
        """Size of the force over time, and the weights of the time steps, (steps + 1,) each."""
        size = np.linalg.norm(trajectory.multipliers[:, self._rows(trajectory)], axis=1)
        return size, time_weights(trajectory, self.window, "joint force")

    def validate_names(self, markers: Mapping[str, Collection[str]], joints: list[str]) -> None:
        if self.joint not in joints:
            raise ValueError(f"force of joint {self.joint!r}, but the joints are {joints}")

    def _rows(self, trajectory: Trajectory) -> NDArray[np.int64]:
        """Rows of the multipliers that count."""
        joints = trajectory.model.joints
        self.validate_names({}, list(joints))
        rows = np.arange(trajectory.model.rows)[joints[self.joint]]
        turns = trajectory.model.angular[rows]
        if self.moment and not turns.any():
            raise ValueError(f"joint force: joint {self.joint!r} carries no moment")
        return rows[turns] if self.moment or turns.all() else rows[~turns]
