# SPDX-License-Identifier: MIT
"""Simulation of a mechanism: start, time integration, and a look at the result."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping
from typing import TypeAlias

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from ..body import VolumeIntegrals
from ..mechanism import Mechanism
from .accuracy import position_error, run_to_tolerance
from .compiled import compile_kernels
from .equilibrium import NoEquilibriumError
from .failures import SimulationError, at_rest
from .generalized_alpha import GeneralizedAlpha, integrate_with_constant_steps
from .initial import initial_state
from .loops import kernels
from .model import assemble_model
from .radau import RadauIIA, compile_stage_kernels, integrate_with_radau
from .trajectory import Trajectory

__all__ = ["Integrator", "SofteningWarning", "one_thread", "simulate"]

Array = NDArray[np.float64]
Integrator: TypeAlias = GeneralizedAlpha | RadauIIA

#: Steps whose stiffness is looked at together.
_CHUNK = 2000


class SofteningWarning(UserWarning):
    """A body turns faster than its lowest frequency, where the linear theory fails.

    Judged by the loads of the body's own inertia, and of point masses at markers with geometric
    stiffness. Forces of joints, springs and others at such markers may take the warning back, where
    they hold the body; that they alone buckle a body is not reported, as this depends on how its
    neighbours hold it.
    """


def simulate(
    mechanism: Mechanism,
    bodies: Mapping[str, VolumeIntegrals],
    integrator: Integrator | None = None,
    *,
    end_time: float | None = None,
    tolerance: float | None = None,
) -> Trajectory:
    """Motion of a mechanism over time, with given steps or to a given accuracy.

    With a tolerance, the steps are shortened until the positions of all material points move by
    less than the tolerance when steps are twice as long: root mean square by mass, at any time,
    relative to the longest way from the start. The trajectory's ``error`` is the change of the
    last ones. Their error itself is smaller, by up to 31 times (Radau IIA) or 3 times (generalised
    alpha); where unresolved vibrations make all of it, it is about as large. That of velocities,
    deformations and multipliers, each relative to its own size, is larger; for the error of an
    objective see :meth:`MechanicalProblem.with_tolerance`. It takes one and a half to twice the
    time of the last steps alone.

    Args:
        mechanism: The mechanism.
        bodies: Volume integrals of all bodies, by name.
        integrator: Time integration; with a tolerance, the one to begin with.
        end_time: Duration of the simulation, which starts at zero [s], instead of an integrator:
            :class:`RadauIIA` with the tolerance.
        tolerance: Largest relative error of the positions that is allowed.

    Returns:
        The trajectory; computed alike on every rank that calls, without communication.

    Raises:
        ValueError: If a name does not exist, a number is not valid, or the mechanism cannot be
            assembled; see :func:`assemble_model` and :func:`initial_state`. Also if not exactly one
            of integrator and duration is given, or a duration without a tolerance.
        SimulationError: If Newton's method does not converge or the mechanism becomes singular;
            it names time, body and joint and keeps the trajectory so far. Likewise if a static
            equilibrium to start from is not found, or a tolerance is not reached.

    Warns:
        SofteningWarning: If a body turns faster than its lowest frequency.

    Example:
        >>> trajectory = simulate(mechanism, bodies, end_time=2.0, tolerance=1e-6)
        >>> trajectory.error  # estimate of what was reached
    """
    if (integrator is None) == (end_time is None):
        raise ValueError("simulate: give either an integrator, or end_time and a tolerance")
    if end_time is not None and tolerance is None:
        raise ValueError("simulate: end_time needs a tolerance; or give an integrator with steps")
    method = integrator if integrator is not None else RadauIIA(float(end_time or math.nan))
    try:
        if tolerance is None:
            trajectory = _simulate(mechanism, bodies, method)
        else:
            _, trajectory = run_to_tolerance(
                method,
                tolerance,
                lambda chosen: _simulate(mechanism, bodies, chosen),
                position_error,
                "positions",
            )
    except SimulationError as error:
        _warn_of_softening(error.trajectory)  # a likely reason
        raise
    _warn_of_softening(trajectory)
    return trajectory


def _simulate(
    mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals], integrator: Integrator
) -> Trajectory:
    model = assemble_model(mechanism, bodies, integrator.times)
    stiffened = model.arrays.bent is not None
    compile_kernels(stiffened_markers=stiffened)
    if isinstance(integrator, RadauIIA):
        compile_stage_kernels(stiffened_markers=stiffened)
    with one_thread():
        try:
            y0, v0 = initial_state(model)
        except NoEquilibriumError as error:
            method = () if isinstance(integrator, RadauIIA) else integrator.parameters
            raise SimulationError(str(error), at_rest(model, 0, method)) from error
        if isinstance(integrator, RadauIIA):
            return integrate_with_radau(model, integrator, y0, v0)
        return integrate_with_constant_steps(model, integrator, y0, v0)


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
            k = _first_unheld(trajectory, b, _softening(trajectory, b))
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
        fast = np.flatnonzero((speed**2 > lowest) & (lowest > 0.0))
        k = _first_unheld(trajectory, b, fast)
        if k >= 0:
            warnings.warn(
                f"body {name!r} turns with {speed[k]:.4g} rad/s at t = {trajectory.t[k]:.4g} s, "
                f"faster than its lowest frequency of {math.sqrt(lowest):.4g} rad/s: without "
                "geometric stiffening its deformation grows without bound",
                SofteningWarning,
                stacklevel=3,
            )


def _softening(trajectory: Trajectory, b: int) -> Iterator[int]:
    """Steps at which K + B - omega^2 G is indefinite, B the stiffness by the body's inertia."""
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
        yield from start + np.flatnonzero(soft)


def _first_unheld(trajectory: Trajectory, b: int, steps: Iterable[int]) -> int:
    """First of these steps at which forces at markers do not hold the body either; or -1."""
    arrays = trajectory.model.arrays
    elastic = slice(int(arrays.first[b]) + 3, int(arrays.first[b] + 3 + arrays.modes[b]))
    stiffened = arrays.bent is not None and np.any(arrays.bent[0][arrays.marker_body == b] >= 0)
    for k in steps:
        if not stiffened:
            return int(k)
        state = (part[k] for part in (trajectory.y, trajectory.v, trajectory.w))
        *_, Ky = kernels.evaluate(arrays, int(k), *state, trajectory.multipliers[k])
        stiffness = Ky[elastic, elastic] + Ky[elastic, elastic].T
        scale = 1.0 / np.sqrt(np.diag(arrays.G[b])[1 : len(stiffness) + 1])
        squares = np.linalg.eigvalsh(scale[:, None] * stiffness * scale)
        if squares[0] < min(0.0, -1e-12 * squares[-1]):
            return int(k)
    return -1


_controller: ThreadpoolController | None = None


def one_thread():  # type: ignore[no-untyped-def]
    """Context in which BLAS runs on one thread: for small matrices more threads cost time."""
    global _controller
    if _controller is None:
        _controller = ThreadpoolController()
    return _controller.limit(limits=1, user_api="blas")
