# SPDX-License-Identifier: MIT
"""Derivatives with respect to the volume integrals of a body, from sums over time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import Array, Integers, symmetric
from ...body import BodyMarker, VolumeIntegrals
from .arrays import OF_POINT, carried_of
from .body_arrays import ModelArrays
from .carried import marked, marked_pullback


class Samples(NamedTuple):
    """States at some instants, and the adjoint of the forces there."""

    instants: Integers  # (samples,) rows in the tables of the mechanism
    y: Array  # (samples, n) coordinates
    v: Array  # (samples, n) velocities
    w: Array  # (samples, n) accelerations
    adjoint: Array  # (samples, n) adjoint of the forces

    def __add__(self, other: Samples) -> Samples:  # type: ignore[override]
        """The samples of both."""
        return Samples(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


def integral_bars(
    model: ModelArrays, body: int, integrals: VolumeIntegrals, samples: Samples
) -> VolumeIntegrals:
    """Minus the sum over time of adjoint . dr, r being linear in each integral of a body.

    With x = (x_R, x_th, x_q) the adjoint of the forces of the body, m_x = A^T x_R, f = A^T a_R,
    X = [x_th], W = [omega], B = [alpha] + W W, and h marking vectors to which the entry a = 0 has
    been added (1 for q, 0 for the others), x . r is

        m m_x . f
        + S_a . [qh_a (B^T m_x + X^T f) + 2 vh_a W^T m_x + ah_a m_x + xh_a f]
        + P_ab : [X^T (B qh_a qh_b + 2 W qh_a vh_b + qh_a ah_b)
                  + B xh_a qh_b + 2 W xh_a vh_b + xh_a (ah_b + d_M vh_b)]
        + K_jk x_j (q_k + d_K v_k).

    In the plane a turn x_th has the matrix x_th J. Of a body with geometric stiffness these vectors
    go on with the carried coordinates c, their derivatives, and q . C x, see carried.py. Markers
    get derivatives of zero.
    """
    columns, d, cross = model.coordinates(body), model.d, model.cross_matrices
    y, v, w, x = samples.y, samples.v, samples.w, samples.adjoint
    q, rate, accel, x_q = (states[:, columns.elastic] for states in (y, v, w, x))
    qh, vh, ah, xh = marked(carried_of(model, body), q, rate, accel, x_q)
    A, damping = model.rotations(y[:, columns.rotation]), model.alpha[body]
    f = _turned_back(A, w[:, columns.position] - model.gravity[samples.instants])
    m = _turned_back(A, x[:, columns.position])
    W, X = cross(v[:, columns.rotation]), cross(x[:, columns.rotation])
    B = cross(w[:, columns.rotation]) + W @ W
    push = _turned_back(B, m) + _turned_back(X, f)
    S = qh.T @ push + vh.T @ (2.0 * _turned_back(W, m)) + ah.T @ m + xh.T @ f
    n = qh.shape[1]
    P, XT = np.zeros((n, n, d, d)), X.transpose(0, 2, 1)
    by_q, by_v, later = XT @ B, 2.0 * XT @ W, ah + damping * vh
    for k in range(d):
        for i in range(d):
            P[:, :, k, i] = qh.T @ (
                by_q[:, k, i, None] * qh + by_v[:, k, i, None] * vh + XT[:, k, i, None] * ah
            )
            P[:, :, k, i] += xh.T @ (B[:, k, i, None] * qh + 2.0 * W[:, k, i, None] * vh)
        P[:, :, k, k] += xh.T @ later
    K = -symmetric(x_q.T @ (q + model.beta[body] * rate))
    markers = {name: marker.scaled(0.0) for name, marker in integrals.markers.items()}
    mass = -float(np.sum(f * m))
    bar = model.integrals(mass, -S, -P, K, markers)
    if not model.stiffened[body]:
        return bar
    # Derivatives with respect to the carried parts of qh, vh, ah and xh.
    moments_of_carried = model.moments(body, carried=True)[n - model.carries :]
    fields = moments_of_carried.transpose(1, 0, 2, 3).reshape(n, -1)
    pq, pv, pa, px = (
        (z @ fields).reshape(-1, len(moments_of_carried), d, d) for z in (qh, vh, ah, xh)
    )
    moment = model.S[body, n - model.carries : n].T

    def along(matrices: Array, parts: Array) -> Array:
        return np.einsum("tkl,tmkl->tm", matrices, parts, optimize=True)

    def trace(parts: Array) -> Array:
        return np.einsum("tmkk->tm", parts)

    by_c = push @ moment + along(by_q + by_q.transpose(0, 2, 1), pq) + along(by_v, pv)
    by_c += along(XT, pa) + along(B.transpose(0, 2, 1), px)
    by_d = 2.0 * _turned_back(W, m) @ moment + along(by_v.transpose(0, 2, 1), pq)
    by_d += 2.0 * along(W.transpose(0, 2, 1), px) + damping * trace(px)
    by_a = m @ moment + along(X, pq) + trace(px)
    by_x = f @ moment + along(B, pq) + 2.0 * along(W, pv) + trace(pa) + damping * trace(pv)
    bars = marked_pullback(q, rate, accel, x_q, [-by_c, -by_d, -by_a, -by_x])
    return model.carried_bars(body, bar, bars)


def field_bars(model: ModelArrays, body: int, samples: Samples) -> tuple[Array, float, float]:
    """Derivatives by gravity (instants, d), and by the coefficients alpha and beta of a body.

    Each is minus the sum over time of adjoint . dr, in the terms of :func:`integral_bars`.
    """
    columns, n = model.coordinates(body), int(model.fields[body]) + 1
    y, v, x = samples.y, samples.v, samples.adjoint
    q, rate, x_q = (states[:, columns.elastic] for states in (y, v, x))
    qh, vh, _, xh = marked(carried_of(model, body), q, rate, samples.w[:, columns.elastic], x_q)
    A, S = model.rotations(y[:, columns.rotation]), model.S[body, :n]
    X = model.cross_matrices(x[:, columns.rotation])
    turned = np.einsum("tkl,tl->tk", X, qh @ S) + xh @ S
    fall = model.mass[body] * x[:, columns.position] + np.einsum("tkl,tl->tk", A, turned)
    gravity = np.zeros_like(model.gravity)
    np.add.at(gravity, samples.instants, fall)
    by_alpha = -float(np.sum((xh @ model.G[body, :n, :n]) * vh))
    K = model.K[body, : columns.modes, : columns.modes]
    return gravity, by_alpha, -float(np.sum((x_q @ K) * rate))


def vector_bars(model: ModelArrays, marker_bars: Array) -> dict[str, Array]:
    """Derivatives with respect to the shape functions of vectors and their geometric stiffness.

    By name of the field of ModelArrays; marker_bars as in :func:`marker_bar`.
    """
    d, modes = model.d, model.shapes.shape[2] - 1
    bent = np.zeros_like(model.vector_stiffening)
    for e in np.flatnonzero(model.vector_stiffened >= 0):
        stiffening = marker_bars[e, d:, 1:].reshape(d, modes, modes)
        bent[model.vector_stiffened[e]] += symmetric(stiffening)
    return {"shapes": marker_bars[:, :d].copy(), "vector_stiffening": bent}


def _turned_back(A: Array, x: Array) -> Array:
    """A^T x row by row."""
    return np.asarray(np.einsum("tki,tk->ti", A, x))


def metric_bars(
    model: ModelArrays, body: int, integrals: VolumeIntegrals, left: Array, right: Array
) -> VolumeIntegrals:
    """Share of the metric of the position corrections: sum over time of left . dD^-1 right.

    left and right are vectors over time, shape (instants, n).
    """
    columns, zero = model.coordinates(body), integrals.zeros_like()
    mass = float(np.sum(left[:, columns.position] * right[:, columns.position]))
    elastic = symmetric(left[:, columns.elastic].T @ right[:, columns.elastic])
    P = np.zeros((columns.modes + 1, columns.modes + 1, model.d, model.d))
    P[0, 0] = model.inertia_pullback(left[:, columns.rotation].T @ right[:, columns.rotation])
    P[1:, 1:] = np.einsum("ab,kl->abkl", elastic, np.eye(model.d))
    return model.integrals(mass, zero.S, P, zero.K, zero.markers)


def marker_bar(model: ModelArrays, marker: int, marker_bars: Array) -> BodyMarker:
    """Derivatives with respect to the position and the shape functions of a marker.

    marker_bars is what transposes have added, see ``Work.vector_bars``.
    """
    d, vectors = model.d, np.flatnonzero(model.vector_marker == marker)
    r = int(model.modes[model.vector_body[vectors[0]]])
    position, displacement, stiffening = np.zeros(d), np.zeros((d, r)), None
    turns = {}
    for e in vectors:
        bars = marker_bars[e, :d, 1 : r + 1]
        if model.vector_kind[e] != OF_POINT:
            turns[int(e)] = bars
            continue
        position += marker_bars[e, :d, 0]
        displacement += bars
        if model.vector_stiffened[e] >= 0:
            stiffening = symmetric(marker_bars[e, d : d + d * r, 1 : r + 1].reshape(d, r, r))
    return BodyMarker(position, displacement, model.rotation_bar(turns, r), stiffening)
