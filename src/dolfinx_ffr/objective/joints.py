# SPDX-License-Identifier: MIT
"""Forces in joints, and power and work of the joints that drive a mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .. import validation
from ..arrays import Array, Integers
from ..dynamics import (
    Trajectory,
    TrajectoryBar,
    driving_power_pullback,
    forces_on_frame,
)
from .base import Derivatives, Inventory, Objective, Response
from .time_average import MeanOverTime, check_window, time_weights


@dataclass(frozen=True)
class OfJoints(Objective):
    """A number of one joint, or of several together."""

    joint: str | tuple[str, ...]  #: Name of the joint, or names of several, whose parts add up

    _what: ClassVar[str]  #: Name for messages

    @property
    def _joints(self) -> list[str]:
        return [self.joint] if isinstance(self.joint, str) else list(self.joint)

    def _check_joints(self) -> None:
        if not isinstance(self.joint, str):
            names = validation.names(f"{self._what}: joint", self.joint)
            if not names or len(set(names)) < len(names):
                raise ValueError(
                    f"{self._what}: give the name of one joint, or different names of several "
                    "joints"
                )
            object.__setattr__(self, "joint", tuple(names))

    def validate(self, inventory: Inventory) -> None:
        for name in self._joints:
            if name not in inventory.joints:
                raise ValueError(
                    f"{self._what} of joint {name!r}, but the joints are {list(inventory.joints)}"
                )


@dataclass(frozen=True)
class JointForce(OfJoints, MeanOverTime):
    """Power mean over time of the force in a joint, or of joints on the frame together [N].

        psi = (1/T int |F(t)|^p dt)^(1/p)

    With p = 2 it is the root mean square. With ``peak`` psi is the largest force of all instants,
    and its derivatives are the mean's derivatives, times peak over mean: take p = 8, say. F is the
    vector of the joint's forces, as in :meth:`Trajectory.joint_force`. A joint that carries forces
    and a moment, a weld for instance, counts its forces unless ``moment`` is set; a joint that
    carries only a moment, a drive, counts that [N m].

    Of several joints, ``JointForce(("crank's bearing", "rocker's bearing"))``, F is the sum of the
    vectors of their forces on the frame: with all bearings of a machine the force by which it
    shakes its frame. Each must hold a body on the ground, or on a marker that moves as prescribed.

    Attributes:
        joint: Name of the joint, or names of several, whose parts add up.
        power: The power p, above 1.
        moment: Count the moment of a joint that carries forces as well [N m].
        window: Begin and end of the time that counts [s]; None takes the whole motion.
        peak: Whether psi is the largest force instead of the mean.
    """

    power: float = 2.0
    moment: bool = False
    window: tuple[float, float] | None = None
    peak: bool = False

    _what = "force"

    def __post_init__(self) -> None:
        if isinstance(self.joint, str):
            validation.name("joint force: joint", self.joint)
        self._check_joints()
        validation.flag("joint force: moment", self.moment)
        if self.moment and not isinstance(self.joint, str):
            raise ValueError("joint force: moments of several joints do not add up; give one joint")
        self._check_mean("joint force")

    def derivatives(self, response: Response) -> Derivatives:
        trajectory, (rows, unit_forces) = response.trajectory, self._unit_forces(response)
        size_bar, bar = self._sizes_bar(response), TrajectoryBar.zeros(trajectory)
        force = self._force(trajectory, rows, unit_forces)
        size = np.linalg.norm(force, axis=1)
        # Where the force vanishes, so does the derivative, as the power is above 1.
        quotient = np.divide(size_bar, size, out=np.zeros_like(size), where=size > 0.0)
        bar.multipliers[:, rows] = np.einsum("tc,trc->tr", quotient[:, None] * force, unit_forces)
        return Derivatives(bar)

    def _sizes(self, response: Response) -> tuple[Array, Array]:
        trajectory = response.trajectory
        size = np.linalg.norm(self._force(trajectory, *self._unit_forces(response)), axis=1)
        return size, time_weights(trajectory, self.window, "joint force")

    def _force(self, trajectory: Trajectory, rows: Integers, unit_forces: Array) -> Array:
        """The force over time, shape (steps + 1, components) [N], or its moment [N m]."""
        return np.asarray(np.einsum("tr,trc->tc", trajectory.multipliers[:, rows], unit_forces))

    def _unit_forces(self, response: Response) -> tuple[Integers, Array]:
        """Rows whose multipliers count, and the forces of these rows for multipliers of 1.

        The rows have the shape (rows,), the forces (steps + 1, rows, components).
        """
        model = response.trajectory.model
        self.validate(response.inventory)
        if not isinstance(self.joint, str):
            return forces_on_frame(model, self._joints)
        rows = np.arange(model.rows)[model.joints[self.joint]]
        turns = model.angular[rows]
        if self.moment and not turns.any():
            raise ValueError(f"joint force: joint {self.joint!r} carries no moment")
        rows = rows[turns] if self.moment or turns.all() else rows[~turns]
        return rows, np.broadcast_to(
            np.eye(rows.size), (len(response.trajectory.t), *2 * (rows.size,))
        )


@dataclass(frozen=True)
class _OfDrives(OfJoints):
    """A number of the power that drives bring into the bodies; powers of several add up."""

    def powers(self, response: Response) -> Array:
        """The power over time at a ``response``, negative where drives brake, (steps + 1,) [W]."""
        self.validate(response.inventory)
        return response.trajectory.drive_power(*self._joints)

    def _pullback(self, response: Response, bar: Array) -> Derivatives:
        """Derivatives from those by the power over time, (steps + 1,)."""
        return Derivatives(*driving_power_pullback(response.trajectory, self._joints, bar))


@dataclass(frozen=True)
class DrivePower(_OfDrives, MeanOverTime):
    """Power mean over time of the absolute power of a drive [W].

        psi = (1/T int |P(t)|^p dt)^(1/p),    P = -lam . (C_y v)

    P is what the joint brings into the bodies: moment times speed of a :class:`PrescribedAngle`,
    force times velocity of a :class:`LinearDrive` or of the pin of a crank (:class:`Moving`), which
    has no mass of its own. With p = 2 psi is the root mean square. With ``peak`` psi is the largest
    power of all instants, and its derivatives are the mean's derivatives, times peak over mean:
    take p = 8, say.

    Attributes:
        joint: Name of the joint, or names of several, whose parts add up.
        power: The power p, above 1.
        window: Begin and end of the time that counts [s]; None takes the whole motion.
        peak: Whether psi is the largest power instead of the mean.
    """

    unit: ClassVar[str] = "W"
    _what: ClassVar[str] = "drive power"

    power: float = 2.0
    window: tuple[float, float] | None = None
    peak: bool = False

    def __post_init__(self) -> None:
        self._check_joints()
        self._check_mean("drive power")

    def _sizes(self, response: Response) -> tuple[Array, Array]:
        weights = time_weights(response.trajectory, self.window, "drive power")
        return np.abs(self.powers(response)), weights

    def derivatives(self, response: Response) -> Derivatives:
        # Where the power vanishes, so does the derivative, as the power of it is above 1.
        return self._pullback(response, self._sizes_bar(response) * np.sign(self.powers(response)))


@dataclass(frozen=True)
class DriveWork(_OfDrives):
    """Energy that a drive takes from its supply within the window [J].

        psi = int ((1 + r)/2 P + (1 - r)/2 sqrt(P^2 + e^2)) dt,    P = -lam . (C_y v)

    The power P, as of :class:`DrivePower`, is paid where it is positive; where the drive brakes,
    the share r of it is won back. With r = 0 it is lost, with r = 1 psi is the work int P dt, and
    with r = -1 braking costs as much as driving, int |P| dt. The root is |P|, rounded where the
    power changes its sign over e, a small part of the root mean square of P: psi is at most
    (1 - r)/2 e T too large, and usually far less.

    Attributes:
        joint: Name of the joint, or names of several, whose parts add up.
        recovered: Share r of the braking power that is won back, from -1 to 1.
        window: Begin and end of the time that counts [s]; None takes the whole motion.
        rounding: The part e / rms(P), positive.
    """

    unit: ClassVar[str] = "J"
    _what: ClassVar[str] = "drive work"

    recovered: float = 0.0
    window: tuple[float, float] | None = None
    rounding: float = 0.01

    def __post_init__(self) -> None:
        self._check_joints()
        validation.number("drive work: recovered", self.recovered, least=-1.0, most=1.0)
        validation.number("drive work: rounding", self.rounding, above=0.0)
        check_window("drive work", self.window)

    def _parts(self, response: Response) -> tuple[Array, Array, Array, float]:
        """Power, weights of the instants, root, and mean square of the power."""
        P, weights = self.powers(response), time_weights(response.trajectory, self.window, "work")
        square = float(weights @ P**2) / float(np.sum(weights))
        return P, weights, np.sqrt(P**2 + self.rounding**2 * square), square

    def evaluate(self, response: Response) -> float:
        P, weights, root, _ = self._parts(response)
        r = self.recovered
        return float(weights @ (0.5 * (1.0 + r) * P + 0.5 * (1.0 - r) * root))

    def derivatives(self, response: Response) -> Derivatives:
        P, weights, root, square = self._parts(response)
        bar = 0.5 * (1.0 + self.recovered) * weights
        if square > 0.0:  # at rest all the time the root has a kink
            by_square = 0.5 * self.rounding**2 * float(np.sum(weights / root)) / np.sum(weights)
            bar += 0.5 * (1.0 - self.recovered) * weights * P * (1.0 / root + 2.0 * by_square)
        return self._pullback(response, bar)
