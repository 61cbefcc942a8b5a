# SPDX-License-Identifier: MIT
"""Objectives: a number from a trajectory, and its derivatives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .body import VolumeIntegrals
from .dynamics.trajectory import Trajectory, TrajectoryBar

__all__ = ["IntegralCompliance", "Objective"]

Array = NDArray[np.float64]


class Objective(Protocol):
    """A number psi that depends on the trajectory and on the volume integrals of the bodies."""

    def value(self, trajectory: Trajectory, bodies: Mapping[str, VolumeIntegrals]) -> float:
        """The number.

        Args:
            trajectory: Result of the simulation.
            bodies: Volume integrals of the bodies, by name.
        """
        ...

    def pullback(
        self, trajectory: Trajectory, bodies: Mapping[str, VolumeIntegrals]
    ) -> tuple[TrajectoryBar, dict[str, VolumeIntegrals]]:
        """Its derivatives with respect to the trajectory, and to the integrals at fixed trajectory.

        Args:
            trajectory: Result of the simulation.
            bodies: Volume integrals of the bodies, by name.
        """
        ...


@dataclass(frozen=True)
class IntegralCompliance:
    """Integral over time of the compliance of flexible bodies [J s].

        psi = sum_bodies weight int q^T K q dt

    is twice the integral of the strain energy; it is taken by the trapezoidal rule over the time
    steps (A. Held, S. Knüfer, R. Seifried, Multibody System Dynamics 40 (2017),
    doi:10.1007/s11044-016-9540-9).

    Raises:
        ValueError: If a weight is not a finite number.
    """

    #: Names of the bodies that count; None takes all.
    bodies: Sequence[str] | None = None
    #: Weights by name of the body; 1 where none is given.
    weights: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        """Check the weights."""
        for name, weight in (self.weights or {}).items():
            if not math.isfinite(weight):
                raise ValueError(f"weight of body {name!r} is {weight}")

    def _terms(self, bodies: Mapping[str, VolumeIntegrals]) -> dict[str, float]:
        """Weights of the bodies that count."""
        chosen = list(bodies) if self.bodies is None else list(self.bodies)
        for name in [*chosen, *(self.weights or {})]:
            if name not in bodies:
                raise ValueError(
                    f"integral compliance of body {name!r}, but the bodies are {list(bodies)}"
                )
        return {name: float((self.weights or {}).get(name, 1.0)) for name in chosen}

    def value(self, trajectory: Trajectory, bodies: Mapping[str, VolumeIntegrals]) -> float:
        """The integral compliance [J s].

        Args:
            trajectory: Result of the simulation.
            bodies: Volume integrals of the bodies, by name.

        Raises:
            ValueError: If a body does not exist; the message lists the bodies.
        """
        dt, total = _trapezoidal_weights(trajectory.t), 0.0
        for name, weight in self._terms(bodies).items():
            q = trajectory.elastic(name)
            total += weight * float(dt @ np.sum((q @ bodies[name].K) * q, axis=1))
        return total

    def pullback(
        self, trajectory: Trajectory, bodies: Mapping[str, VolumeIntegrals]
    ) -> tuple[TrajectoryBar, dict[str, VolumeIntegrals]]:
        """Derivatives with respect to the trajectory, and to the integrals at fixed trajectory.

        Args:
            trajectory: Result of the simulation.
            bodies: Volume integrals of the bodies, by name.

        Raises:
            ValueError: If a body does not exist; the message lists the bodies.
        """
        dt = _trapezoidal_weights(trajectory.t)[:, None]
        bar = TrajectoryBar.zeros(trajectory)
        bars = {name: integrals.zeros_like() for name, integrals in bodies.items()}
        for name, weight in self._terms(bodies).items():
            q, where = trajectory.elastic(name), trajectory.model.coordinates(name)
            bar.y[:, where.start + 3 : where.stop] = 2.0 * weight * dt * (q @ bodies[name].K)
            square = q.T @ (dt * q)
            bars[name].K[:] = 0.5 * weight * (square + square.T)
        return bar, bars


def _trapezoidal_weights(t: Array) -> Array:
    """Weights of the trapezoidal rule at times t, shape of t."""
    weights = np.zeros_like(t)
    weights[:-1] += 0.5 * np.diff(t)
    weights[1:] += 0.5 * np.diff(t)
    return weights
