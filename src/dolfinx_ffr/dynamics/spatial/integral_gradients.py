# SPDX-License-Identifier: MIT
"""Derivatives with respect to the volume integrals of a body in space, from sums over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...body import BodyMarker, VolumeIntegrals
from ..samples import Samples
from .arrays import OF_DIRECTION, OF_POINT, ModelArrays
from .metric import coordinates_of
from .motion import rotations_of

Array = NDArray[np.float64]


def integral_bars(
    model: ModelArrays, body: int, integrals: VolumeIntegrals, samples: Samples
) -> VolumeIntegrals:
    """Minus the sum over time of adjoint . dr, r being linear in each integral.

    With x = (x_R, x_th, x_q) the adjoint of the forces of one body, m_x = A^T x_R, f = A^T a_R,
    X = [x_th], W = [omega], B = [alpha] + W W, and h marking vectors to which the entry a = 0 has
    been added (1 for q, 0 for the others), x . r is

        m m_x . f
        + S_a . [qh_a (B^T m_x + X^T f) + 2 vh_a W^T m_x + ah_a m_x + xh_a f]
        + P_ab : [X^T (B qh_a qh_b + 2 W qh_a vh_b + qh_a ah_b)
                  + B xh_a qh_b + 2 W xh_a vh_b + xh_a (ah_b + d_M vh_b)]
        + K_jk x_j (q_k + d_K v_k) + [B_kl K_kl + f_k K_k]_ij x_i q_j.

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
        integrals: Its integrals, whose markers get derivatives of zero.
        samples: States and adjoint.
    """
    where = coordinates_of(model, body)
    y, v, w, x = samples.y, samples.v, samples.w, samples.adjoint
    extended = (_extended(a[:, where.elastic], f) for a, f in ((y, 1.0), (v, 0.0), (w, 0.0)))
    qh, vh, ah = extended
    xh = _extended(x[:, where.elastic], 0.0)
    A = rotations_of(y[:, where.rotation])
    f = _turned_back(A, w[:, where.position] - model.gravity[samples.instants])
    m = _turned_back(A, x[:, where.position])
    W, X = cross_matrices(v[:, where.rotation]), cross_matrices(x[:, where.rotation])
    B = cross_matrices(w[:, where.rotation]) + W @ W
    S = qh.T @ (_turned_back(B, m) + _turned_back(X, f))
    S += vh.T @ (2.0 * _turned_back(W, m)) + ah.T @ m + xh.T @ f
    n = qh.shape[1]
    P, XT = np.zeros((n, n, 3, 3)), X.transpose(0, 2, 1)
    by_q, by_v, later = XT @ B, 2.0 * XT @ W, ah + model.alpha[body] * vh
    for k in range(3):
        for i in range(3):
            P[:, :, k, i] = qh.T @ (
                by_q[:, k, i, None] * qh + by_v[:, k, i, None] * vh + XT[:, k, i, None] * ah
            )
            P[:, :, k, i] += xh.T @ (B[:, k, i, None] * qh + 2.0 * W[:, k, i, None] * vh)
        P[:, :, k, k] += xh.T @ later
    q, rate, x_q = y[:, where.elastic], v[:, where.elastic], x[:, where.elastic]
    K = x_q.T @ (q + model.beta[body] * rate)
    stiffening = {}
    if model.stiffened[body]:
        rotation = np.einsum("tkl,ti,tj->klij", B, x_q, q, optimize=True)
        acceleration = np.einsum("tk,ti,tj->kij", f, x_q, q, optimize=True)
        stiffening = {"rotation": -_symmetric(rotation), "acceleration": -_symmetric(acceleration)}
    return VolumeIntegrals.in_space(
        -float(np.sum(f * m)),
        -S,
        -0.5 * (P + P.transpose(1, 0, 3, 2)),
        -_symmetric(K),
        {name: marker.scaled(0.0) for name, marker in integrals.markers.items()},
        stiffening,
    )


def cross_matrices(x: Array) -> Array:
    """Matrices of the cross product with vectors, shape (n, 3, 3).

    Args:
        x: The vectors, shape (n, 3).
    """
    out = np.zeros((len(x), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = x.T
    return out - out.transpose(0, 2, 1)


def _turned_back(A: Array, x: Array) -> Array:
    """A^T x row by row."""
    return np.asarray(np.einsum("tki,tk->ti", A, x))


def _symmetric(array: Array) -> Array:
    return np.asarray(0.5 * (array + np.swapaxes(array, -1, -2)))


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
    where = coordinates_of(model, body)
    zero = integrals.zeros_like()
    assert zero.P is not None
    turn = left[:, where.rotation].T @ right[:, where.rotation]
    elastic = left[:, where.elastic].T @ right[:, where.elastic]
    P = zero.P.copy()
    P[0, 0] = np.trace(turn) * np.eye(3) - _symmetric(turn)
    P[1:, 1:] = np.einsum("ab,kl->abkl", _symmetric(elastic), np.eye(3))
    mass = float(np.sum(left[:, where.position] * right[:, where.position]))
    return VolumeIntegrals.in_space(mass, zero.S, P, zero.K, zero.markers, zero.stiffening)


def marker_bar(model: ModelArrays, marker: int, marker_bars: Array) -> BodyMarker:
    """Derivatives with respect to the shape functions of a marker; its position is data.

    Args:
        model: Flat arrays of the mechanism.
        marker: Number of the marker.
        marker_bars: What transposes have added, see ``Work.vector_bars``.
    """
    vectors = np.flatnonzero(model.vector_marker == marker)
    r = int(model.modes[model.vector_body[vectors[0]]])
    displacement, rotation, stiffening = np.zeros((3, r)), np.zeros((3, r)), None
    for e in vectors:
        bars = marker_bars[e, :3, 1 : r + 1]
        if model.vector_kind[e] == OF_POINT:
            displacement += bars
            if model.vector_stiffened[e] >= 0:
                stiffening = _symmetric(marker_bars[e, 3 : 3 + 3 * r, 1 : r + 1].reshape(3, r, r))
        elif model.vector_kind[e] == OF_DIRECTION:
            # psi_j x n, of which the derivative is n x bar_j
            rotation += np.cross(model.shapes[e, :, 0], bars, axisb=0, axisc=0)
        else:
            rotation += bars
    return BodyMarker(np.zeros(3), displacement, rotation, stiffening)
