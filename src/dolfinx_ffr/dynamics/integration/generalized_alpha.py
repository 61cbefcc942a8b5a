# SPDX-License-Identifier: MIT
"""Stabilised index-2 generalised-alpha method with constant steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ... import validation
from ...arrays import Array
from ..compilation import Compiled, Table
from ..failures import SimulationError, diagnosis
from ..kinematics import Kinematics, Samples
from ..model import FlatModel
from ..trajectory import (
    Integrator,
    Trajectory,
    TrajectoryBar,
    TrajectoryPullback,
    at_rest,
    leading,
)
from .linear import linear_system
from .start import (
    CONVERGED,
    NO_START,
    accelerations,
    accelerations_pullback,
    start_accelerations,
    start_accelerations_pullback,
)
from .steps import StepBars, Steps, backward, march, step_bars


@dataclass(frozen=True)
class GeneralizedAlpha(Integrator):
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

    Attributes:
        end_time: Duration of the simulation, which starts at zero [s].
        chosen_for: Relative error of an objective for which a `TimeInterval` chose these steps,
            else None.
        steps: Number of time steps.
        spectral_radius: Spectral radius at infinite frequency, from 0 to 1. At 0.8 vibrations that
            no step resolves decay by a fifth a step, and errors of psi and of its gradient are
            within a tenth of those at 1, the least; at 0 they are up to six times as large
            (benchmarks/integration.py).
    """

    order: ClassVar[int] = 2
    compiled: ClassVar[tuple[Compiled, ...]] = (
        accelerations,
        accelerations_pullback,
        march,
        backward,
    )

    steps: int
    spectral_radius: float = 0.8

    def __post_init__(self) -> None:
        validation.number("end_time", self.end_time, above=0.0, unit="s")
        validation.integer("steps", self.steps, least=1)
        validation.number("spectral_radius", self.spectral_radius, least=0.0, most=1.0)

    @property
    def step(self) -> float:
        """Time step [s]."""
        return self.end_time / int(self.steps)

    @property
    def times(self) -> Array:
        return np.linspace(0.0, self.end_time, int(self.steps) + 1)

    @property
    def instants(self) -> int:
        return int(self.steps) + 1

    @property
    def in_words(self) -> str:
        return f"{super().in_words} of spectral radius {self.spectral_radius:g}"

    @property
    def finer(self) -> GeneralizedAlpha:
        return replace(self, steps=2 * int(self.steps))

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        """The parameters alpha_m, alpha_f, gamma and beta of the method."""
        rho = float(self.spectral_radius)
        alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        gamma = 0.5 + alpha_f - alpha_m
        return alpha_m, alpha_f, gamma, 0.25 * (gamma + 0.5) ** 2

    def amplification(self, phase: float) -> float:
        if self.spectral_radius == 1.0:
            return 1.0
        # One step for x'' = -x with the phase as time; the unknowns are x', v' and a', the method's
        # own accelerations, and the equation of motion gives w = -x.
        alpha_m, alpha_f, gamma, beta = self.parameters
        h = phase
        new = np.array([[1.0, 0.0, -h * h * beta], [0.0, 1.0, -h * gamma],
                        [1.0 - alpha_f, 0.0, 1.0 - alpha_m]])  # fmt: skip
        old = np.array([[1.0, h, h * h * (0.5 - beta)], [0.0, 1.0, h * (1.0 - gamma)],
                        [-alpha_f, 0.0, -alpha_m]])  # fmt: skip
        return float(np.max(np.abs(np.linalg.eigvals(np.linalg.solve(new, old)))))

    def _near_start_weight(self, model: FlatModel) -> float:
        """Weight of the accelerations near the start in the method's first own accelerations.

        a_0 = w_0 + (alpha_m - alpha_f) h (w_1 - w_0) / offset, with w_1 near the start.
        It is zero where damping is proportional to stiffness: it ends the accelerations of stiff
        modes within a share of a step, and their slope at the start says nothing of the step.
        """
        if np.any(model.arrays.beta > 0.0):
            return 0.0
        alpha_m, alpha_f, *_ = self.parameters
        return (alpha_m - alpha_f) * self.step / model.offset

    def integrate(self, model: FlatModel, y0: Array, v0: Array) -> Trajectory:
        count, kinematics = int(self.steps), Kinematics(model.arrays)
        trajectory = at_rest(model, model.times[: count + 1], self)
        trajectory.y[0], trajectory.v[0] = y0, v0
        kinematics.begin(y0)
        if not self._begin(trajectory, kinematics):
            raise SimulationError(NO_START, leading(trajectory, 0))

        steps = self._steps(trajectory, self.step)
        system = Table(linear_system(model.size + 2 * model.rows))
        status = march(kinematics.table, Table(steps), system)
        trajectory = replace(trajectory, turns=kinematics.turns(count + 1))
        if status != CONVERGED:
            good = int(steps.last[0])
            step = f"step {good + 1} of {count}, {self.step:.3g} s each"
            iterations = int(trajectory.iterations[good])
            text = diagnosis(trajectory, good + 1, step, iterations, status)
            raise SimulationError(text, leading(trajectory, good))
        return trajectory

    def _begin(self, trajectory: Trajectory, kinematics: Kinematics) -> bool:
        """Set the accelerations at the start, and the state near it; False where there are none."""
        model, near_start = trajectory.model, trajectory.beginning
        y, v, w, offset = trajectory.y[0], trajectory.v[0], trajectory.w[0], model.offset
        at_start = start_accelerations(kinematics, 0, y, v)
        if at_start is None:
            return False
        w[:], trajectory.multipliers[0] = at_start

        near_start[0] = model.arrays.retract(y, y + offset * v + 0.5 * offset * offset * w)
        near_start[1] = v + offset * w
        shortly_after = start_accelerations(kinematics, _near_start(model), *near_start[:2])
        if shortly_after is None:
            return False
        near_start[2], near_start[3, : model.rows] = shortly_after
        trajectory.a[0] = w + self._near_start_weight(model) * (near_start[2] - w)
        return True

    def pullback(self, trajectory: Trajectory, bar: TrajectoryBar) -> TrajectoryPullback:
        model = trajectory.model
        kinematics = Kinematics(model.arrays, trajectory.turns)
        h = float(model.times[1] - model.times[0])
        steps = self._steps(trajectory, h)
        bars = step_bars(bar.y, bar.v, bar.w, bar.multipliers)
        system = Table(linear_system(model.size + 2 * model.rows))
        if backward(kinematics.table, Table(steps), Table(bars), system) != CONVERGED:
            t = trajectory.t[steps.last[0]]
            raise RuntimeError(f"the matrix of the step at t = {t:.6g} s is singular")

        y_bar, v_bar, adjoint_near_start = self._begin_pullback(trajectory, kinematics, bars)
        near_start = trajectory.beginning
        samples = Samples(
            np.append(np.arange(trajectory.steps + 1), _near_start(model)),
            np.vstack([trajectory.y, near_start[0]]),
            np.vstack([trajectory.v, near_start[1]]),
            np.vstack([trajectory.w, near_start[2]]),
            np.vstack([bars.adjoint, adjoint_near_start]),
        )
        return TrajectoryPullback(
            samples,
            (h * bars.left, bars.right),
            y_bar,
            v_bar,
            kinematics.marker_bars,
            kinematics.table_bars,
        )

    def _begin_pullback(
        self, trajectory: Trajectory, kinematics: Kinematics, bars: StepBars
    ) -> tuple[Array, Array, Array]:
        """Transpose of :meth:`_begin`; sets the adjoint at the start.

        Gives the derivatives with respect to y and v at the start, and the adjoint near it, (n,)
        each.
        """
        model, offset = trajectory.model, trajectory.model.offset
        weight = self._near_start_weight(model)
        y_bar, v_bar, w_bar, a_bar = bars.start
        y_bar, v_bar = y_bar + bars.y[0], v_bar + bars.v[0]
        w_bar = w_bar + ((1.0 - weight) * a_bar + bars.w[0])

        *near_start, multipliers = trajectory.beginning
        y_near_bar, v_near_bar, adjoint_near_start = start_accelerations_pullback(
            kinematics,
            _near_start(model),
            (*near_start, multipliers[: model.rows]),
            weight * a_bar,
            0.0 * bars.lam[0],
        )
        # From coordinates near the start to the shift that leads there.
        shift = offset * trajectory.v[0] + 0.5 * offset * offset * trajectory.w[0]
        shift_bar, y_near_bar = model.arrays.retract_pullback(shift, y_near_bar)
        w_bar = w_bar + (0.5 * offset * offset * shift_bar + offset * v_near_bar)
        y_bar, v_bar = y_bar + y_near_bar, v_bar + (offset * shift_bar + v_near_bar)

        start = trajectory.y[0], trajectory.v[0], trajectory.w[0], trajectory.multipliers[0]
        by_y, by_v, bars.adjoint[0] = start_accelerations_pullback(
            kinematics, 0, start, w_bar, bars.lam[0]
        )
        return y_bar + by_y, v_bar + by_v, adjoint_near_start

    def _steps(self, trajectory: Trajectory, h: float) -> Steps:
        """Arrays of a trajectory for the compiled loops, without copies."""
        n, rows = trajectory.model.size, trajectory.model.rows
        return Steps(
            np.array([h, *self.parameters]),
            trajectory.y,
            trajectory.v,
            trajectory.w,
            trajectory.a,
            trajectory.multipliers,
            trajectory.stabilization,
            trajectory.iterations,
            np.zeros(1, dtype=np.int64),
            np.zeros(n),
            np.zeros(n),
            np.zeros(rows),
        )


def _near_start(model: FlatModel) -> int:
    """Number of the instant near the start, with which the tables of a mechanism end."""
    return len(model.arrays.drive) - 1
