# SPDX-License-Identifier: MIT
"""The force in a joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..dynamics import TrajectoryBar
from .base import Derivatives, Inventory, Objective, Response
from .time_average import check_window, power_mean, time_weights

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

    joint: str  #: Name of the joint
    power: float = 2.0  #: The power p, above 1
    moment: bool = False  #: Count the moment of a joint that carries forces as well [N m]
    #: Begin and end of the time that counts [s]; None takes the whole motion.
    window: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        validation.name("joint force: joint", self.joint)
        validation.flag("joint force: moment", self.moment)
        validation.number("joint force: the power", self.power, least=1.0)
        if self.power == 1.0:
            raise ValueError(
                "joint force: with a power of 1 the mean has a kink where the force vanishes; "
                "take a larger one"
            )
        check_window("joint force", self.window)

    def evaluate(self, response: Response) -> float:
        size, weights = self._size(response)
        return power_mean(size, weights, self.power)[0]

    def derivatives(self, response: Response) -> Derivatives:
        trajectory, rows = response.trajectory, self._rows(response)
        size, weights = self._size(response)
        size_bar = power_mean(size, weights, self.power)[1]
        bar = TrajectoryBar.zeros(trajectory)
        # Where the force vanishes, so does the derivative, as the power is above 1.
        quotient = np.divide(size_bar, size, out=np.zeros_like(size), where=size > 0.0)
        bar.multipliers[:, rows] = quotient[:, None] * trajectory.multipliers[:, rows]
        return Derivatives(bar)

    def _size(self, response: Response) -> tuple[Array, Array]:
        """Size of the force and weights of the instants, shape (steps + 1,) each."""
        size = np.linalg.norm(response.trajectory.multipliers[:, self._rows(response)], axis=1)
        return size, time_weights(response.trajectory, self.window, "joint force")

    def validate(self, inventory: Inventory) -> None:
        if self.joint not in inventory.joints:
            raise ValueError(
                f"force of joint {self.joint!r}, but the joints are {list(inventory.joints)}"
            )

    def _rows(self, response: Response) -> NDArray[np.int64]:
        """Rows of the joint's multipliers that count."""
        model = response.trajectory.model
        self.validate(response.inventory)
        rows = np.arange(model.rows)[model.joints[self.joint]]
        turns = model.angular[rows]
        if self.moment and not turns.any():
            raise ValueError(f"joint force: joint {self.joint!r} carries no moment")
        return rows[turns] if self.moment or turns.all() else rows[~turns]
