# SPDX-License-Identifier: MIT
"""Simulation of a mechanism by the stabilised index-2 generalised-alpha method."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from ..body import VolumeIntegrals
from ..mechanism import Mechanism
from .arrays import ANGLE
from .compiled import compile_kernels
from .equilibrium import NoEquilibriumError
from .initial import initial_state
from .loops import CONVERGED, SINGULAR, kernels
from .model import FlatModel, assemble_model
from .trajectory import Trajectory

__all__ = ["GeneralizedAlpha", "SimulationError", "SofteningWarning", "simulate"]

Array = NDArray[np.float64]


#: Steps whose stiffness is looked at together.
_CHUNK = 2000


class SimulationError(RuntimeError):
    """The time integration came to an end before its time."""

    #: The trajectory up to the last good step.
    trajectory: Trajectory

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        """Keep the trajectory so far.

        Args:
            message: What happened, where and when.
            trajectory: The trajectory up to the last good step.
        """
        super().__init__(message)
        self.trajectory = trajectory


class SofteningWarning(UserWarning):
    """A body turns faster than its lowest frequency, where the linear theory fails."""


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

    #: Duration of the simulation, which starts at zero [s].
    end_time: float
    #: Number of time steps.
    steps: int
    #: Spectral radius at infinite frequency, from 0 to 1.
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
    def parameters(self) -> tuple[float, float, float, float]:
        """The parameters alpha_m, alpha_f, gamma and beta of the method."""
        rho = float(self.spectral_radius)
        alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        gamma = 0.5 + alpha_f - alpha_m
        return alpha_m, alpha_f, gamma, 0.25 * (gamma + 0.5) ** 2


def simulate(
    mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals], integrator: GeneralizedAlpha
) -> Trajectory:
    """Motion of a mechanism over time.

    Args:
        mechanism: The mechanism.
        bodies: Volume integrals of all bodies, by name.
        integrator: Time integration.

    Returns:
        The trajectory; computed alike on every rank that calls, without communication.

    Raises:
        ValueError: If a name does not exist, a number is not valid, or the mechanism cannot be
            assembled; see :func:`assemble_model` and :func:`initial_state`.
        SimulationError: If Newton's method does not converge or the mechanism becomes singular;
            it names time, body and joint and keeps the trajectory so far. Likewise if a static
            equilibrium to start from is not found.

    Warns:
        SofteningWarning: If a body turns faster than its lowest frequency.
    """
    model = assemble_model(mechanism, bodies, integrator.times)
    compile_kernels()
    with one_thread():
        try:
            y0, v0 = initial_state(model)
        except NoEquilibriumError as error:
            raise SimulationError(str(error), _cut(_at_rest(model, integrator), 0)) from error
        try:
            trajectory = _integrate(model, integrator, y0, v0)
        except SimulationError as error:
            _warn_of_softening(error.trajectory)  # a likely reason
            raise
        _warn_of_softening(trajectory)
    return trajectory


def _at_rest(model: FlatModel, integrator: GeneralizedAlpha) -> Trajectory:
    """A trajectory of zeros."""
    steps, method = int(integrator.steps), integrator.parameters
    y, v, w, a = (np.zeros((steps + 1, model.size)) for _ in range(4))
    multipliers, stabilization = (np.zeros((steps + 1, model.rows)) for _ in range(2))
    iterations = np.zeros(steps, dtype=np.int64)
    beginning = np.zeros((4, model.size))
    return Trajectory(
        model.times, y, v, w, a, multipliers, stabilization, iterations, beginning, model, method
    )


def _integrate(model: FlatModel, integrator: GeneralizedAlpha, y0: Array, v0: Array) -> Trajectory:
    steps, h, method = int(integrator.steps), integrator.step, integrator.parameters
    trajectory = _at_rest(model, integrator)
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
            _cut(trajectory, 0),
        )
    alpha_m, alpha_f = method[:2]
    a[0] = w[0] + (alpha_m - alpha_f) * h / model.offset * (beginning[2] - w[0])
    status, last = kernels.march(
        model.arrays, h, method, y, v, w, a, multipliers, stabilization, iterations
    )
    if status != CONVERGED:
        raise SimulationError(_diagnosis(trajectory, last + 1, status), _cut(trajectory, last))
    return trajectory


def _cut(trajectory: Trajectory, last: int) -> Trajectory:
    """The trajectory up to a step."""
    names = ("t", "y", "v", "w", "a", "multipliers", "stabilization")
    parts = {name: getattr(trajectory, name)[: last + 1].copy() for name in names}
    return replace(trajectory, **parts, iterations=trajectory.iterations[:last].copy())


def _diagnosis(trajectory: Trajectory, k: int, status: int) -> str:
    """Say what failed in step k, from the residual of the last iterate."""
    model, n = trajectory.model, trajectory.model.size
    rows = (part[k] for part in (trajectory.y, trajectory.v, trajectory.w, trajectory.multipliers))
    residual, *_ = kernels.evaluate(model.arrays, k, *rows)
    size = np.nan_to_num(np.abs(residual), nan=np.inf, posinf=np.inf)
    worst = int(np.argmax(size[:n]))
    turning = worst in set(model.arrays.first + 2)
    text = f"at t = {trajectory.t[k]:.6g} s (step {k} of {trajectory.steps}) "
    if status == SINGULAR:
        text += "the mechanism is singular (joints redundant, or links in line)"
    else:
        text += f"Newton's method does not converge in {trajectory.iterations[k - 1]} iterations"
    text += (
        f": the largest residual is {size[worst]:.3g} {'N m' if turning else 'N'} in body "
        f"{model.body_of_coordinate(worst)!r}"
    )
    if model.rows:
        gap = size[n : n + model.rows]
        row = int(np.argmax(gap))
        unit = "rad" if model.arrays.kind[row] == ANGLE else "m"
        text += f" and {gap[row]:.3g} {unit} in joint {model.joint_of_row(row)!r}"
    return text + "; take smaller steps, or look at the motion so far in the exception's trajectory"


def _warn_of_softening(trajectory: Trajectory) -> None:
    """Warn once of each body whose stiffness less omega^2 G loses definiteness."""
    model = trajectory.model
    for b, name in enumerate(model.bodies):
        n = int(model.arrays.modes[b])
        if n == 0:
            continue
        G, K = model.arrays.G[b, 1 : n + 1, 1 : n + 1], model.arrays.K[b, :n, :n]
        speed = np.abs(trajectory.v[:, model.coordinates(name).start + 2])
        if model.arrays.stiffened[b]:
            k = _first_softening(trajectory, b)
            if k >= 0:
                warnings.warn(
                    f"body {name!r} loses its stiffness at t = {trajectory.t[k]:.4g} s, where it "
                    f"turns with {speed[k]:.4g} rad/s, in spite of geometric stiffening: while "
                    "that lasts, its deformation grows without bound",
                    SofteningWarning,
                    stacklevel=3,
                )
            continue
        lowest = scipy.linalg.eigh(K, G, eigvals_only=True, subset_by_index=[0, 0])[0]
        fast = speed**2 > lowest
        if lowest > 0.0 and np.any(fast):
            k = int(np.argmax(fast))
            warnings.warn(
                f"body {name!r} turns with {speed[k]:.4g} rad/s at t = {trajectory.t[k]:.4g} s, "
                f"faster than its lowest frequency of {math.sqrt(lowest):.4g} rad/s: without "
                "geometric stiffening its deformation grows without bound",
                SofteningWarning,
                stacklevel=3,
            )


def _first_softening(trajectory: Trajectory, b: int) -> int:
    """First step at which K + B - omega^2 G is indefinite, B the geometric stiffness; or -1."""
    arrays = trajectory.model.arrays
    o, n = int(arrays.first[b]), int(arrays.modes[b])
    G, T = arrays.G[b, 1 : n + 1, 1 : n + 1], arrays.stiffening[b, :, :n, :n]
    # In the basis of the modes at rest, so that no unit hides a slip.
    frequencies, modes = scipy.linalg.eigh(arrays.K[b, :n, :n], G)
    parts = np.concatenate([T, -np.eye(n)[None]])
    parts[:4] = modes.T @ T @ modes
    fall = arrays.gravity[: trajectory.steps + 1]
    c, s = np.cos(trajectory.y[:, o + 2]), np.sin(trajectory.y[:, o + 2])
    ax, ay = (trajectory.w[:, o : o + 2] - fall).T
    spin = trajectory.v[:, o + 2] ** 2
    loads = np.stack([spin, trajectory.w[:, o + 2], c * ax + s * ay, c * ay - s * ax, spin], 1)
    for start in range(0, len(loads), _CHUNK):
        stiffness = np.diag(frequencies) + np.tensordot(loads[start : start + _CHUNK], parts, 1)
        soft = np.linalg.eigvalsh(stiffness)[:, 0] < min(0.0, -1e-12 * frequencies[-1])
        if np.any(soft):
            return start + int(np.argmax(soft))
    return -1


_controller: ThreadpoolController | None = None


def one_thread():  # type: ignore[no-untyped-def]
    """Context in which BLAS runs on one thread: for small matrices more threads cost time."""
    global _controller
    if _controller is None:
        _controller = ThreadpoolController()
    return _controller.limit(limits=1, user_api="blas")
