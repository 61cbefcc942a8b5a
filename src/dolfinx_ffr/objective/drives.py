# SPDX-License-Identifier: MIT
"""Power and work of the drives of a mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .. import validation
from ..arrays import Array
from ..dynamics import drives, driving_power, driving_power_pullback
from .base import Derivatives, Response
from .joints import OfJoints
from .time_average import MeanOverTime, check_window, time_weights


@dataclass(frozen=True)
class _OfDrives(OfJoints):
    """A number of the power that drives bring into the bodies; those of several add up."""

    def powers(self, response: Response) -> Array:
        """The power over time at a ``response``, negative where drives brake, (steps + 1,) [W]."""
        self.validate(response.inventory)
        driving = drives(response.trajectory.model)
        for name in self._joints:
            if name not in driving:
                raise ValueError(
                    f"{self._what}: joint {name!r} drives nothing, so that it has no power; the "
                    f"joints with a motion or a marker in prescribed motion are {driving}"
                )
        return driving_power(response.trajectory, self._joints)

    def _pullback(self, response: Response, bar: Array) -> Derivatives:
        """Derivatives from those by the power over time, (steps + 1,)."""
        return Derivatives(*driving_power_pullback(response.trajectory, self._joints, bar))


@dataclass(frozen=True)
class DrivePower(_OfDrives, MeanOverTime):
    """Power mean over time of the power of a drive, whatever its sign [W].

        psi = scale (1/T int |P(t)|^p dt)^(1/p),    P = -lam . (C_y v)

    P is what the joint brings into the bodies: moment times speed of a :class:`PrescribedAngle`,
    force times velocity of a :class:`LinearDrive` or of the pin of a crank (:class:`Moving`), which
    has no mass of its own. With p = 2 psi is the root mean square; it tends to the peak as p grows.
    With ``peak`` the objective :meth:`calibrated` at a design is the peak there, as that of
    :class:`PeakStress`.

    Raises:
        ValueError: If the power is not above 1 or the window is not an interval; when the value is
            asked for, if there is no such joint or it drives nothing.
    """

    unit: ClassVar[str] = "W"
    _what: ClassVar[str] = "drive power"

    power: float = 2.0  #: The power p, above 1
    #: Begin and end of the time that counts [s]; None takes the whole motion.
    window: tuple[float, float] | None = None
    peak: bool = False  #: Correct the mean, by its scale, to the largest power of each design kept
    scale: float = 1.0  #: Factor of the mean, positive

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
    """Energy that a drive takes from its supply in the time that counts [J].

        psi = int ((1 + r)/2 P + (1 - r)/2 sqrt(P^2 + e^2)) dt,    P = -lam . (C_y v)

    The power P, that of :class:`DrivePower`, is paid where it is positive; where the drive brakes,
    the share r of it is won back. With r = 0 it is lost, with r = 1 psi is the work int P dt, and
    with r = -1 braking costs as much as driving, int |P| dt. The root is |P|, rounded where the
    power changes its sign over e, a small part of the root mean square of P: psi is at most
    (1 - r)/2 e T too large, and usually far less.

    Raises:
        ValueError: If the share is not in [-1, 1], the rounding is not positive or the window is
            not an interval; when the value is asked for, if there is no such joint or it drives
            nothing.
    """

    unit: ClassVar[str] = "J"
    _what: ClassVar[str] = "drive work"

    recovered: float = 0.0  #: Share r of the braking power that is won back, from -1 to 1
    #: Begin and end of the time that counts [s]; None takes the whole motion.
    window: tuple[float, float] | None = None
    rounding: float = 0.01  #: The part e / rms(P), positive

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
