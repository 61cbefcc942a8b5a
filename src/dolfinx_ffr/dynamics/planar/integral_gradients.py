# SPDX-License-Identifier: MIT
"""Derivatives with respect to the volume integrals of a planar body, from sums over time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...body import BodyMarker, VolumeIntegrals
from ..samples import Samples
from .arrays import ModelArrays
from .metric import coordinates_of

Array = NDArray[np.float64]


def integral_bars(
    model: ModelArrays, body: int, integrals: VolumeIntegrals, samples: Samples
) -> VolumeIntegrals:
    """Minus the sum over time of adjoint . dr, r being linear in each integral.

    With x = (x_R, xi, x_q) the adjoint of the forces of one body, in the body's axes, and h marking
    vectors to which the entry a = 0 has been added (1 for q, 0 for the others), x . r is

        m x_R . a_R
        + S_a . [qh_a (alpha J^T x_R - omega^2 x_R + xi J^T a_R) + ah_a x_R
                 + 2 omega vh_a J^T x_R + xh_a a_R]
        + G_ab [xi qh_a (alpha qh_b + 2 omega vh_b) - omega^2 qh_a xh_b + xh_a (ah_b + d_M vh_b)]
        + N_ab [qh_a (xi ah_b + alpha xh_b) + 2 omega vh_a xh_b]
        + K_jk x_j (q_k + d_K v_k)
        + [omega^2 (K_w)_jk + alpha (K_al)_jk + a_Rx (K_x)_jk + a_Ry (K_y)_jk] x_j q_k.

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
        integrals: Its integrals, whose markers get derivatives of zero.
        samples: States and adjoint.
    """
    where = coordinates_of(model, body)
    y, v, w, x = samples.y, samples.v, samples.w, samples.adjoint
    damping_m, damping_k = model.alpha[body], model.beta[body]
    extended = (_extended(a[:, where.elastic], f) for a, f in ((y, 1.0), (v, 0.0), (w, 0.0)))
    qh, vh, ah = extended
    xh = _extended(x[:, where.elastic], 0.0)
    omega, alpha, xi = (a[:, where.rotation, None] for a in (v, w, x))
    c, s = np.cos(y[:, where.rotation, None]), np.sin(y[:, where.rotation, None])

    def in_body_axes(vector: Array) -> Array:
        return np.hstack(
            [c * vector[:, :1] + s * vector[:, 1:], c * vector[:, 1:] - s * vector[:, :1]]
        )

    def turned_back(vector: Array) -> Array:
        return np.hstack([vector[:, 1:], -vector[:, :1]])

    a_r = in_body_axes(w[:, where.position] - model.gravity[samples.instants])
    x_r = in_body_axes(x[:, where.position])
    S = qh.T @ (alpha * turned_back(x_r) - omega**2 * x_r + xi * turned_back(a_r))
    S += ah.T @ x_r + vh.T @ (2.0 * omega * turned_back(x_r)) + xh.T @ a_r
    G = qh.T @ (xi * (alpha * qh + 2.0 * omega * vh) - omega**2 * xh)
    G += xh.T @ (ah + damping_m * vh)
    N = qh.T @ (xi * ah + alpha * xh) + vh.T @ (2.0 * omega * xh)
    q, rate, x_q = y[:, where.elastic], v[:, where.elastic], x[:, where.elastic]
    K = x_q.T @ (q + damping_k * rate)
    stiffening = {}
    if model.stiffened[body]:
        loads = (("omega2", omega**2), ("alpha", alpha), ("x", a_r[:, :1]), ("y", a_r[:, 1:]))
        products = {load: x_q.T @ (weight * q) for load, weight in loads}
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


def _extended(elastic: Array, first: float) -> Array:
    """Elastic coordinates with an entry a = 0 before them."""
    return np.column_stack([np.full(len(elastic), first), elastic])


def metric_bars(
    model: ModelArrays, body: int, integrals: VolumeIntegrals, left: Array, right: Array
) -> VolumeIntegrals:
    """Share of the metric of the position corrections, sum over time of left . dD^-1 right.

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
        integrals: Its integrals.
        left: Vectors over time, shape (instants, n).
        right: Likewise.
    """
    where, out = coordinates_of(model, body), integrals.zeros_like()
    elastic = left[:, where.elastic].T @ right[:, where.elastic]
    out.G[1:, 1:] = 0.5 * (elastic + elastic.T)
    out.G[0, 0] = left[:, where.rotation] @ right[:, where.rotation]
    mass = float(np.sum(left[:, where.position] * right[:, where.position]))
    return replace(out, mass=mass)


def marker_bar(model: ModelArrays, marker: int, marker_bars: Array) -> BodyMarker:
    """Derivatives with respect to the shape functions of a marker; its position is data.

    Args:
        model: Flat arrays of the mechanism.
        marker: Number of the marker.
        marker_bars: What transposes have added, see ``Work.marker_bars``.
    """
    r = int(model.modes[model.marker_body[marker]])
    bars, stiffening = marker_bars[marker], None
    if model.marker_stiffened[marker] >= 0:
        # The kernels put T_y behind the modes of the marker's own body.
        parts = bars[3 : 3 + 2 * r, 1 : r + 1].reshape(2, r, r)
        stiffening = 0.5 * (parts + parts.transpose(0, 2, 1))
    return BodyMarker(np.zeros(2), bars[:2, 1 : r + 1], bars[2, 1 : r + 1], stiffening)
