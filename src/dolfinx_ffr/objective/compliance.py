# SPDX-License-Identifier: MIT
"""Compliance of flexible bodies: its integral over time, and its peak.

The compliance of a body is c(t) = q^T K q, twice its strain energy; q are its elastic coordinates
and K its reduced stiffness.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..body import VolumeIntegrals
from ..dynamics import Trajectory, TrajectoryBar
from .base import Bodies, Objective, no_body
from .time_average import power_mean, time_weights

__all__ = ["IntegralCompliance", "PeakCompliance"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Compliance(Objective):
    """Sum over bodies of weight * q^T K q, as a function of time."""

    #: Names of the bodies that count; None takes all.
    bodies: Sequence[str] | None = None
    #: Weights by name of the body; 1 where none is given.
    weights: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        """Check bodies and weights."""
        if self.bodies is not None and not validation.names(f"{self._what}: bodies", self.bodies):
            raise ValueError(
                f"{self._what}: bodies is an empty list, and nothing would count; leave it out to "
                "take all"
            )
        if self.weights is not None:
            what = f"{self._what}: weights"
            for name, weight in validation.by_name(what, self.weights, "numbers").items():
                validation.number(f"{what}: that of body {name!r}", weight)

    def validate_names(self, markers: Mapping[str, Collection[str]], joints: list[str]) -> None:
        self._terms(markers)

    def validate_modes(self, modes: Mapping[str, int]) -> None:
        for name in [*(self.bodies or ()), *(self.weights or {})]:
            if not modes[name]:
                flexible = [other for other, count in modes.items() if count]
                raise ValueError(
                    f"{self._what} of body {name!r}, which is rigid and has none; the flexible "
                    f"bodies are {flexible}"
                )

    def _terms(self, bodies: Collection[str]) -> dict[str, float]:
        """Weights of the bodies that count."""
        chosen = list(bodies) if self.bodies is None else list(self.bodies)
        for name in [*chosen, *(self.weights or {})]:
            if name not in bodies:
                raise no_body(self._what, name, bodies)
        return {name: float((self.weights or {}).get(name, 1.0)) for name in chosen}

    @property
    def _what(self) -> str:
        """Name for messages."""
        raise NotImplementedError

    def _compliance(self, trajectory: Trajectory, bodies: Bodies) -> Array:
        """The compliance over time, shape (steps + 1,) [J]."""
        total = np.zeros_like(trajectory.t)
        for name, weight in self._terms(bodies).items():
            q = trajectory.elastic(name)
            total += weight * np.sum((q @ bodies[name].K) * q, axis=1)
        return total

    def _pullback(
        self, trajectory: Trajectory, bodies: Bodies, bar: Array
    ) -> tuple[TrajectoryBar, dict[str, VolumeIntegrals]]:
        """Transpose of the derivative of the compliance, ``bar`` of shape (steps + 1,)."""
        out = TrajectoryBar.zeros(trajectory)
        bars = {name: integrals.zeros_like() for name, integrals in bodies.items()}
        for name, weight in self._terms(bodies).items():
            q, where = trajectory.elastic(name), trajectory.model.coordinates(name)
            scaled = weight * bar[:, None] * q
            out.y[:, where.elastic] = 2.0 * scaled @ bodies[name].K
            square = q.T @ scaled
            bars[name].K[:] = 0.5 * (square + square.T)
        return out, bars


@dataclass(frozen=True)
class IntegralCompliance(_Compliance):
    """Integral over time of the compliance of flexible bodies [J s].

        psi = sum_bodies weight int q^T K q dt

    is twice the integral of the strain energy; it is taken by the trapezoidal rule over equal time
    steps, and with the weights of the method where that is Radau IIA (A. Held, S. Knüfer,
    R. Seifried, Multibody System Dynamics 40 (2017), doi:10.1007/s11044-016-9540-9).

    Raises:
        ValueError: If a weight is not a finite number.
    """

    unit: ClassVar[str] = "J s"

    @property
    def _what(self) -> str:
        return "integral compliance"

    def value(self, trajectory: Trajectory, bodies: Bodies) -> float:
        return float(time_weights(trajectory) @ self._compliance(trajectory, bodies))

    def pullback(
        self, trajectory: Trajectory, bodies: Bodies
    ) -> tuple[TrajectoryBar, dict[str, VolumeIntegrals]]:
        return self._pullback(trajectory, bodies, time_weights(trajectory))


@dataclass(frozen=True)
class PeakCompliance(_Compliance):
    """Power mean over time of the compliance of flexible bodies, close to its peak [J].

        psi = (1/T int c(t)^p dt)^(1/p),     c(t) = sum_bodies weight q^T K q

    With a power p of 1 it is the mean, and it tends to the maximum over time as p grows; it is
    never above the maximum. Large powers make the problem more nonlinear: 8 is a fair start.

    Raises:
        ValueError: If the power is below 1, or a weight is negative or not a finite number.
    """

    unit: ClassVar[str] = "J"

    #: The power p.
    power: float = 8.0

    def __post_init__(self) -> None:
        """Check the weights and the power."""
        super().__post_init__()
        validation.number(f"{self._what}: the power", self.power, least=1.0)
        for name, weight in (self.weights or {}).items():
            if weight < 0.0:
                raise ValueError(f"{self._what}: the weight of body {name!r} is negative: {weight}")

    @property
    def _what(self) -> str:
        return "peak compliance"

    def value(self, trajectory: Trajectory, bodies: Bodies) -> float:
        return self._mean(trajectory, bodies)[0]

    def pullback(
        self, trajectory: Trajectory, bodies: Bodies
    ) -> tuple[TrajectoryBar, dict[str, VolumeIntegrals]]:
        return self._pullback(trajectory, bodies, self._mean(trajectory, bodies)[1])

    def _mean(self, trajectory: Trajectory, bodies: Bodies) -> tuple[float, Array]:
        # Round-off in a stiffness with a zero eigenvalue can leave a value just below zero.
        compliance = np.maximum(self._compliance(trajectory, bodies), 0.0)
        return power_mean(compliance, time_weights(trajectory), self.power)
