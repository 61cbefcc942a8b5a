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

from .. import validation
from ..arrays import Array
from ..dynamics import TrajectoryBar
from .base import Derivatives, Inventory, Objective, Response, no_body
from .time_average import power_mean, time_weights


@dataclass(frozen=True)
class _Compliance(Objective):
    """Sum over bodies of weight * q^T K q, as a function of time."""

    bodies: Sequence[str] | None = None  #: Names of the bodies that count; None takes all
    #: Weights by name of the body; 1 where none is given.
    weights: Mapping[str, float] | None = None

    _what: ClassVar[str]  #: Name for messages

    def __post_init__(self) -> None:
        if self.bodies is not None and not validation.names(f"{self._what}: bodies", self.bodies):
            raise ValueError(
                f"{self._what}: bodies is an empty list; leave it out to take all flexible bodies"
            )
        if self.weights is not None:
            label = f"{self._what}: weights"
            for name, weight in validation.by_name(label, self.weights, "numbers").items():
                validation.number(f"{label}: weight of body {name!r}", weight, least=0.0)

    def validate(self, inventory: Inventory) -> None:
        self._terms(inventory.modes)
        for name in [*(self.bodies or ()), *(self.weights or {})]:
            if not inventory.modes[name]:
                flexible = [body for body, count in inventory.modes.items() if count]
                raise ValueError(
                    f"{self._what}: body {name!r} is rigid and has no compliance; the flexible "
                    f"bodies are {flexible}"
                )

    def _terms(self, bodies: Collection[str]) -> dict[str, float]:
        """Weights of the bodies that count."""
        chosen = list(bodies) if self.bodies is None else list(self.bodies)
        for name in [*chosen, *(self.weights or {})]:
            if name not in bodies:
                raise no_body(self._what, name, bodies)
        return {name: float((self.weights or {}).get(name, 1.0)) for name in chosen}

    def _compliance(self, response: Response) -> Array:
        """The compliance over time, shape (steps + 1,) [J]."""
        trajectory, bodies = response.trajectory, response.bodies
        total = np.zeros_like(trajectory.t)
        for name, weight in self._terms(bodies).items():
            q = trajectory.elastic(name)
            total += weight * np.sum((q @ bodies[name].K) * q, axis=1)
        return total

    def _pullback(self, response: Response, bar: Array) -> Derivatives:
        """Transpose of the derivative of the compliance for a ``bar`` of shape (steps + 1,)."""
        trajectory, bodies = response.trajectory, response.bodies
        out = TrajectoryBar.zeros(trajectory)
        bars = {name: integrals.zeros_like() for name, integrals in bodies.items()}
        for name, weight in self._terms(bodies).items():
            q, columns = trajectory.elastic(name), trajectory.model.coordinates(name)
            scaled = weight * bar[:, None] * q
            out.y[:, columns.elastic] = 2.0 * scaled @ bodies[name].K
            square = q.T @ scaled
            bars[name].K[:] = 0.5 * (square + square.T)
        return Derivatives(out, bars)


@dataclass(frozen=True)
class IntegralCompliance(_Compliance):
    """Integral over time of the compliance of flexible bodies [J s].

        psi = sum_bodies weight int q^T K q dt

    is twice the integral of the strain energy; it is taken by the trapezoidal rule over equal time
    steps, and with the weights of the method where that is Radau IIA (A. Held, S. Knüfer,
    R. Seifried, Multibody System Dynamics 40 (2017), doi:10.1007/s11044-016-9540-9).

    Attributes:
        bodies: Names of the bodies that count; None takes all.
        weights: Weights by name of the body; 1 where none is given.
    """

    unit: ClassVar[str] = "J s"
    _what: ClassVar[str] = "integral compliance"

    def evaluate(self, response: Response) -> float:
        return float(time_weights(response.trajectory) @ self._compliance(response))

    def derivatives(self, response: Response) -> Derivatives:
        return self._pullback(response, time_weights(response.trajectory))


@dataclass(frozen=True)
class PeakCompliance(_Compliance):
    """Power mean over time of the compliance of flexible bodies, close to its peak [J].

        psi = (1/T int c(t)^p dt)^(1/p),     c(t) = sum_bodies weight q^T K q

    With a power p of 1 it is the mean, and it tends to the maximum over time as p grows; it is
    never above the maximum. Large powers make the problem more nonlinear: 8 is a fair start.

    Attributes:
        bodies: Names of the bodies that count; None takes all.
        weights: Weights by name of the body; 1 where none is given.
        power: The power p.
    """

    unit: ClassVar[str] = "J"
    _what: ClassVar[str] = "peak compliance"

    power: float = 8.0

    def __post_init__(self) -> None:
        super().__post_init__()
        validation.number(f"{self._what}: the power", self.power, least=1.0)

    def evaluate(self, response: Response) -> float:
        return self._mean(response)[0]

    def derivatives(self, response: Response) -> Derivatives:
        return self._pullback(response, self._mean(response)[1])

    def _mean(self, response: Response) -> tuple[float, Array]:
        # Round-off in a stiffness with a zero eigenvalue can leave a value just below zero.
        compliance = np.maximum(self._compliance(response), 0.0)
        return power_mean(compliance, time_weights(response.trajectory), self.power)
