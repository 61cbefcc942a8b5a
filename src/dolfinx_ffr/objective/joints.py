# SPDX-License-Identifier: MIT
"""The force in a joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..dynamics import TrajectoryBar
from .base import Derivatives, Inventory, Response
from .time_average import MeanOverTime, time_weights

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointForce(MeanOverTime):
    """Power mean over time of the force in a joint [N].

        psi = scale (1/T int |F(t)|^p dt)^(1/p)

    With p = 2 it is the root mean square; it tends to the largest force over time as p grows, and
    with ``peak`` the objective :meth:`calibrated` at a design is the largest force there. F is
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
    peak: bool = False  #: Correct the mean, by its scale, to the largest force of each design kept
    scale: float = 1.0  #: Factor of the mean, positive

    def __post_init__(self) -> None:
        validation.name("joint force: joint", self.joint)
        validation.flag("joint force: moment", self.moment)
        self._check_mean("joint force")

    def derivatives(self, response: Response) -> Derivatives:
        trajectory, rows = response.trajectory, self._rows(response)
        size, size_bar = self._sizes(response)[0], self._sizes_bar(response)
        bar = TrajectoryBar.zeros(trajectory)
        # Where the force vanishes, so does the derivative, as the power is above 1.
        quotient = np.divide(size_bar, size, out=np.zeros_like(size), where=size > 0.0)
        bar.multipliers[:, rows] = quotient[:, None] * trajectory.multipliers[:, rows]
        return Derivatives(bar)

    def _sizes(self, response: Response) -> tuple[Array, Array]:
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
