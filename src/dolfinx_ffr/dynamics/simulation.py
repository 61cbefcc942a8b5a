# SPDX-License-Identifier: MIT
"""Simulation of a mechanism: start, time integration, and a look at the result."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from ..body import VolumeIntegrals
from ..mechanism import Mechanism
from .compiled import compile_kernels
from .equilibrium import NoEquilibriumError
from .failures import SimulationError, at_rest
from .generalized_alpha import GeneralizedAlpha, integrate_with_constant_steps
from .initial import initial_state
from .model import assemble_model
from .radau import RadauIIA, compile_stage_kernels, integrate_with_radau
from .trajectory import Trajectory

__all__ = ["Integrator", "SofteningWarning", "one_thread", "simulate"]

Array = NDArray[np.float64]
Integrator: TypeAlias = GeneralizedAlpha | RadauIIA

#: Steps whose stiffness is looked at together.
_CHUNK = 2000


class SofteningWarning(UserWarning):
    """A body turns faster than its lowest frequency, where the linear theory fails."""


def simulate(
    mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals], integrator: Integrator
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
    if isinstance(integrator, RadauIIA):
        compile_stage_kernels()
    with one_thread():
        try:
            y0, v0 = initial_state(model)
        except NoEquilibriumError as error:
            method = () if isinstance(integrator, RadauIIA) else integrator.parameters
            raise SimulationError(str(error), at_rest(model, 0, method)) from error
        try:
            if isinstance(integrator, RadauIIA):
                trajectory = integrate_with_radau(model, integrator, y0, v0)
            else:
                trajectory = integrate_with_constant_steps(model, integrator, y0, v0)
        except SimulationError as error:
            _warn_of_softening(error.trajectory)  # a likely reason
            raise
        _warn_of_softening(trajectory)
    return trajectory


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
