# SPDX-License-Identifier: MIT
"""Discrete adjoint of the simulation: derivatives with respect to the integrals of the bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..body import BodyMarker, VolumeIntegrals
from .initial import start_pullback
from .loops import CONVERGED, kernels
from .model import FlatModel
from .radau import compile_stage_kernels
from .simulation import one_thread
from .stage_loops import stage_kernels
from .trajectory import Trajectory, TrajectoryBar

__all__ = ["adjoint"]

Array = NDArray[np.float64]


def adjoint(trajectory: Trajectory, bar: TrajectoryBar) -> dict[str, VolumeIntegrals]:
    """Derivatives of a number with respect to the volume integrals of all bodies.

    The transpose of the computed time steps, of the method's first acceleration and of the start,
    solved backward once. It is the exact derivative of what was computed, for
    any step, and tends to the adjoint system of the continuous problem as the step tends to zero
    (A. Held, S. Knüfer, R. Seifried, Structural sensitivity analysis of flexible multibody systems
    modeled with the floating frame of reference approach using the adjoint variable method,
    Multibody System Dynamics 40 (2017), doi:10.1007/s11044-016-9540-9). The cost does not depend
    on the number of parameters.

    Args:
        trajectory: Result of the simulation.
        bar: Derivatives of the number with respect to the trajectory.

    Returns:
        Derivatives by name of the body, those of the markers' shape functions included. The
        positions of the markers are data, their derivatives zero. The number's own dependence on
        the integrals, at fixed trajectory, is not included.

    Raises:
        ValueError: If the derivatives have the wrong shape or hold NaN.
        RuntimeError: If the matrix of a step is singular.
    """
    model, size, rows = trajectory.model, trajectory.y.shape, trajectory.multipliers.shape
    for name, shape in (("y", size), ("v", size), ("w", size), ("multipliers", rows)):
        array = getattr(bar, name)
        if array.shape != shape:
            raise ValueError(f"bar.{name} must have shape {shape}, but it has shape {array.shape}")
        if not np.all(np.isfinite(array)):
            raise ValueError(f"bar.{name} holds NaN or infinity")
    modes = model.arrays.psi.shape[1]
    bent = model.arrays.bent
    rows_of_marker = 3 if bent is None else 3 + 2 * modes
    markers = np.zeros((model.arrays.marker_body.size, rows_of_marker, modes + 1))
    with one_thread():
        if trajectory.method:
            x, shifts, first, states, gravity = _constant_steps(trajectory, bar, markers)
        else:
            x, shifts, first, states, gravity = _stages(trajectory, bar, markers)
        settled = start_pullback(
            model, trajectory.y[0], trajectory.v[0], first[0], first[1], markers
        )
        if settled is not None:
            rest = np.zeros((1, model.size))
            states = [
                np.vstack(p) for p in zip(states, (trajectory.y[:1], rest, rest), strict=True)
            ]
            gravity, x = np.vstack([gravity, model.arrays.gravity[:1]]), np.vstack([x, settled])
        bars = {
            name: _integral_bars(model, name, states, gravity, x)
            + _metric_bars(model, name, shifts[0], shifts[1])
            for name in model.bodies
        }
    for (body, marker), number in model.markers.items():
        r, stiffening = model.bodies[body].modes, None
        if bent is not None and bent[0][number] >= 0:
            parts = markers[number, 3 : 3 + 2 * r, 1 : r + 1].reshape(2, r, r)
            stiffening = 0.5 * (parts + parts.transpose(0, 2, 1))
        bars[body].markers[marker] += BodyMarker(
            np.zeros(2),
            markers[number, :2, 1 : r + 1],
            markers[number, 2, 1 : r + 1],
            stiffening,
        )
    for point in reversed(model.mechanism.point_masses):
        body, marker = point.marker
        bars[body] = model.bodies[body].point_mass_pullback(bars[body], marker, point.mass)
    # Loads that point masses alone have brought are no integrals of the body.
    for name, bar_of_body in bars.items():
        given = model.bodies[name].stiffening.keys()
        kept = {load: part for load, part in bar_of_body.stiffening.items() if load in given}
        bars[name] = replace(bar_of_body, stiffening=kept)
    return bars


#: Adjoint of the forces at all instants, shares of the metric, derivatives with respect to the
#: start, and the states (y, v, w) and gravity at these instants.
_Pulled = tuple[Array, Array, Array, list[Array], Array]


def _constant_steps(trajectory: Trajectory, bar: TrajectoryBar, markers: Array) -> _Pulled:
    """Transpose of the generalised-alpha method."""
    model, size = trajectory.model, trajectory.y.shape
    x = np.zeros((trajectory.steps + 2, model.size))
    shifts, first = np.zeros((2, *size)), np.zeros((2, model.size))
    h = float(model.times[1] - model.times[0])
    status, step = kernels.backward(
        model.arrays,
        h,
        trajectory.method,
        model.offset,
        np.stack([trajectory.y, trajectory.v, trajectory.w, trajectory.a]),
        np.stack([trajectory.multipliers, trajectory.stabilization]),
        trajectory.beginning,
        np.stack([bar.y, bar.v, bar.w]),
        np.ascontiguousarray(bar.multipliers, dtype=np.float64),
        x,
        shifts,
        markers,
        first,
    )
    _refuse_singular(trajectory, status, step)
    states = [
        np.vstack([part, extra])
        for part, extra in zip(
            (trajectory.y, trajectory.v, trajectory.w), trajectory.beginning, strict=False
        )
    ]
    # The trajectory may end before the tables do; their last row is that of the beginning.
    gravity = np.vstack([model.arrays.gravity[: trajectory.steps + 1], model.arrays.gravity[-1]])
    shifts[0] *= h
    return x, shifts, first, states, gravity


def _stages(trajectory: Trajectory, bar: TrajectoryBar, markers: Array) -> _Pulled:
    """Transpose of the Radau IIA method."""
    model, size = trajectory.model, trajectory.y.shape
    x, shifts, first = np.zeros(size), np.zeros((2, *size)), np.zeros((2, model.size))
    compile_stage_kernels(stiffened_markers=model.arrays.bent is not None)
    status, step = stage_kernels.backward(
        model.arrays,
        np.diff(trajectory.step_ends),
        np.stack([trajectory.y, trajectory.v, trajectory.w]),
        np.stack([trajectory.multipliers, trajectory.stabilization]),
        np.stack([bar.y, bar.v, bar.w]),
        np.ascontiguousarray(bar.multipliers, dtype=np.float64),
        x,
        shifts,
        markers,
        first,
    )
    _refuse_singular(trajectory, status, step)
    states = [trajectory.y, trajectory.v, trajectory.w]
    return x, shifts, first, states, model.arrays.gravity[: trajectory.t.size]


def _refuse_singular(trajectory: Trajectory, status: int, step: int) -> None:
    if status != CONVERGED:
        raise RuntimeError(f"the matrix of the step at t = {trajectory.t[step]:.6g} s is singular")


def _integral_bars(
    model: FlatModel, body: str, states: list[Array], gravity: Array, adjoint_forces: Array
) -> VolumeIntegrals:
    """Minus the sum over time of x . dr, r being linear in each integral.

    With x = (x_R, xi, x_q) the adjoint of the forces of one body, in the body's axes, and h marking
    vectors to which the entry a = 0 has been added (1 for q, 0 for the others), x . r is

        m x_R . a_R
        + S_a . [qh_a (alpha J^T x_R - omega^2 x_R + xi J^T a_R) + ah_a x_R
                 + 2 omega vh_a J^T x_R + xh_a a_R]
        + G_ab [xi qh_a (alpha qh_b + 2 omega vh_b) - omega^2 qh_a xh_b + xh_a (ah_b + d_M vh_b)]
        + N_ab [qh_a (xi ah_b + alpha xh_b) + 2 omega vh_a xh_b]
        + K_jk x_j (q_k + d_K v_k)
        + [omega^2 (K_w)_jk + alpha (K_al)_jk + a_Rx (K_x)_jk + a_Ry (K_y)_jk] x_j q_k.
    """
    b, where = model.body_index(body), model.coordinates(body)
    integrals = model.bodies[body]
    damping_m, damping_k = model.arrays.alpha[b], model.arrays.beta[b]
    y, v, w = (state[:, where] for state in states)
    x = adjoint_forces[:, where]
    # The column of the angle makes room for the entry a = 0.
    qh, vh, ah, xh = (array[:, 2:].copy() for array in (y, v, w, x))
    for extended, first in ((qh, 1.0), (vh, 0.0), (ah, 0.0), (xh, 0.0)):
        extended[:, 0] = first
    omega, alpha, xi = v[:, 2:3], w[:, 2:3], x[:, 2:3]
    c, s = np.cos(y[:, 2:3]), np.sin(y[:, 2:3])

    def in_body_axes(vector: Array) -> Array:
        return np.hstack(
            [c * vector[:, :1] + s * vector[:, 1:], c * vector[:, 1:] - s * vector[:, :1]]
        )

    def turned_back(vector: Array) -> Array:
        return np.hstack([vector[:, 1:], -vector[:, :1]])

    a_r, x_r = in_body_axes(w[:, :2] - gravity), in_body_axes(x[:, :2])
    S = qh.T @ (alpha * turned_back(x_r) - omega**2 * x_r + xi * turned_back(a_r))
    S += ah.T @ x_r + vh.T @ (2.0 * omega * turned_back(x_r)) + xh.T @ a_r
    G = qh.T @ (xi * (alpha * qh + 2.0 * omega * vh) - omega**2 * xh)
    G += xh.T @ (ah + damping_m * vh)
    N = qh.T @ (xi * ah + alpha * xh) + vh.T @ (2.0 * omega * xh)
    K = x[:, 3:].T @ (y[:, 3:] + damping_k * v[:, 3:])
    stiffening = {}
    if model.arrays.stiffened[b]:
        loads = (("omega2", omega**2), ("alpha", alpha), ("x", a_r[:, :1]), ("y", a_r[:, 1:]))
        products = {load: x[:, 3:].T @ (weight * y[:, 3:]) for load, weight in loads}
        parts = {load: -0.5 * (product + product.T) for load, product in products.items()}
        acceleration = np.stack([parts.pop("x"), parts.pop("y")])
        stiffening = {**parts, "acceleration": acceleration}
    return VolumeIntegrals(
        mass=-float(np.sum(a_r * x_r)),
        S=-S,
        G=-0.5 * (G + G.T),
        N=-0.5 * (N - N.T),
        K=-0.5 * (K + K.T),
        markers={name: marker.scaled(0.0) for name, marker in integrals.markers.items()},
        stiffening=stiffening,
    )


def _metric_bars(model: FlatModel, body: str, left: Array, right: Array) -> VolumeIntegrals:
    """Share of the metric of the position corrections, sum over time of left . dD^-1 right."""
    where = model.coordinates(body)
    x, z = left[:, where], right[:, where]
    out = model.bodies[body].zeros_like()
    elastic = x[:, 3:].T @ z[:, 3:]
    out.G[1:, 1:] = 0.5 * (elastic + elastic.T)
    out.G[0, 0] = x[:, 2] @ z[:, 2]
    return replace(out, mass=float(np.sum(x[:, :2] * z[:, :2])))
