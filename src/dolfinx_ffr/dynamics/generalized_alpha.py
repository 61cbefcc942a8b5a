# SPDX-License-Identifier: MIT
"""Stabilised index-2 generalised-alpha method with constant steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from .failures import SimulationError, at_rest, cut, diagnosis
from .loops import CONVERGED, kernels
from .model import FlatModel
from .trajectory import Trajectory

__all__ = ["GeneralizedAlpha", "integrate_with_constant_steps"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GeneralizedAlpha:
    """Stabilised index-2 generalised-alpha method with constant steps.

    Second-order accurate in positions, velocities and multipliers; constraints hold to round-off
    in positions and in velocities. The parameters follow from the spectral radius at infinite
    frequency: 1 keeps all oscillations, 0 removes in one step those that the step does not resolve.

    References:
        J. Chung, G. M. Hulbert, A time integration algorithm for structural dynamics with improved
        numerical dissipation: the generalized-alpha method, Journal of Applied Mechanics 60 (1993),
        doi:10.1115/1.2900803.
        M. Arnold, O. Brüls, A. Cardona, Error analysis of generalized-alpha Lie group time
        integration methods for constrained mechanical systems, Numerische Mathematik 129 (2015),
        doi:10.1007/s00211-014-0633-1.

    Raises:
        ValueError: If a number is out of range.
    """

    #: Order of positions, velocities and objectives in the time step.
    order: ClassVar[int] = 2

    #: Duration of the simulation, which starts at zero [s].
    end_time: float
    #: Number of time steps.
    steps: int
    #: Spectral radius at infinite frequency, from 0 to 1. At 0.8 vibrations that no step resolves
    #: decay by a fifth a step, and errors of psi and of its gradient are within a tenth of those
    #: at 1, the least; at 0 they are up to six times as large (benchmarks/integration.py).
    spectral_radius: float = 0.8

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (math.isfinite(self.end_time) and self.end_time > 0.0):
            raise ValueError(f"end_time must be positive, but it is {self.end_time} s")
        if int(self.steps) != self.steps or self.steps < 1:
            raise ValueError(f"steps must be a positive whole number, but it is {self.steps}")
        if not 0.0 <= self.spectral_radius <= 1.0:
            raise ValueError(
                f"spectral_radius must lie between 0 and 1, but it is {self.spectral_radius}"
            )

    @property
    def step(self) -> float:
        """Time step [s]."""
        return self.end_time / int(self.steps)

    @property
    def times(self) -> Array:
        """Times, shape (steps + 1,) [s]."""
        return np.linspace(0.0, self.end_time, int(self.steps) + 1)

    @property
    def coarser(self) -> GeneralizedAlpha:
        """The method with steps twice as long, for an estimate of the error."""
        return replace(self, steps=max(int(self.steps) // 2, 1))

    @property
    def finer(self) -> GeneralizedAlpha:
        """The method with steps half as long."""
        return replace(self, steps=2 * int(self.steps))

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        """The parameters alpha_m, alpha_f, gamma and beta of the method."""
        rho = float(self.spectral_radius)
        alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        gamma = 0.5 + alpha_f - alpha_m
        return alpha_m, alpha_f, gamma, 0.25 * (gamma + 0.5) ** 2


def integrate_with_constant_steps(
    model: FlatModel, integrator: GeneralizedAlpha, y0: Array, v0: Array
) -> Trajectory:
    """Motion from a consistent start.

    Args:
        model: The compiled mechanism.
        integrator: The method.
        y0: Coordinates at the start, shape (size,).
        v0: Velocities at the start, shape (size,).

    Raises:
        SimulationError: If Newton's method does not converge or the mechanism becomes singular.
    """
    steps, h, method = int(integrator.steps), integrator.step, integrator.parameters
    trajectory = at_rest(model, steps, method)
    y, v, w, a = trajectory.y, trajectory.v, trajectory.w, trajectory.a
    multipliers, stabilization = trajectory.multipliers, trajectory.stabilization
    iterations, beginning = trajectory.iterations, trajectory.beginning
    y[0], v[0] = y0, v0
    status = kernels.start(
        model.arrays, y[0], v[0], w[0], multipliers[0], steps + 1, model.offset, beginning
    )
    if status != CONVERGED or not np.all(np.isfinite(beginning)):
        raise SimulationError(
            "the accelerations at the start cannot be found: the mass matrix of the bodies and the "
            "joints together are singular",
            cut(trajectory, 0),
        )
    alpha_m, alpha_f = method[:2]
    a[0] = w[0] + (alpha_m - alpha_f) * h / model.offset * (beginning[2] - w[0])
    status, last = kernels.march(
        model.arrays, h, method, y, v, w, a, multipliers, stabilization, iterations
    )
    if status != CONVERGED:
        k = last + 1
        where, remedy = f"step {k} of {steps}", "take smaller steps, or "
        text = diagnosis(trajectory, k, where, iterations[last], status, remedy)
        raise SimulationError(text, cut(trajectory, last))
    return trajectory
