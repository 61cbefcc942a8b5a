# SPDX-License-Identifier: MIT
"""Volume integrals of a body in space, also of the fields that elastic coordinates carry along.

These are X_l e_k, X_0 = 1. With V_lb = int rho X_l w_b, which are S_b and rows of P_0b, and
Q_lm = int rho X_l X_m,

    int rho (X_l e_k) w_b^T = e_k V_lb^T,      V_l of a carried field X_m e_k is Q_lm e_k.

See carried.py for their purpose.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from ...body import VolumeIntegrals
from .arrays import Arrays
from .carried import carried_matrices, carried_matrices_pullback

#: Number of carried fields.
CARRIED = 12
#: Places of the loads -rho X_l e_k, in the order of the fields, among those of the rotation, of
#: which entry k, l stands at 3 k + l, and of the acceleration.
_LOADS = np.array([9, 10, 11, 0, 3, 6, 1, 4, 7, 2, 5, 8])


def with_carried_fields(mass: float, S: Array, P: Array) -> tuple[Array, Array]:
    """The integrals S (n, 3) and P (n, n, 3, 3) with the twelve fields, carried along, behind."""
    n, V = len(S), _moments(mass, S, P)
    products = np.zeros((n + CARRIED, n + CARRIED, 3, 3))
    products[:n, :n] = P
    products[n:] = np.einsum("ki,lbj->lkbij", np.eye(3), V).reshape(CARRIED, n + CARRIED, 3, 3)
    products[:n, n:] = products[n:, :n].transpose(1, 0, 3, 2)
    return V[0], products


def _gram(mass: float, S: Array, P: Array) -> Array:
    """The matrix Q, shape (4, 4), of the block P = P_00."""
    return np.block([[np.array([[mass]]), S[:1]], [S[:1].T, P]])


def _moments(mass: float, S: Array, P: Array) -> Array:
    """V of all fields, the carried ones last, shape (4, modes + 13, 3)."""
    carried = np.einsum("lm,ki->lmki", _gram(mass, S, P[0, 0]), np.eye(3)).reshape(4, CARRIED, 3)
    moments = np.concatenate([S[None], P[0].transpose(1, 0, 2)])
    return np.concatenate([moments, carried], axis=1)


def carried_coordinates(mass: float, S: Array, P: Array, stiffening: Array) -> Array:
    """The matrices C of the carried coordinates, shape (12, modes, modes).

    S and P have no carried fields; the stiffening is by the rotation and the acceleration.
    """
    r = stiffening.shape[-1]
    moments = stiffening[_LOADS].reshape(4, 3 * r, r)
    return carried_matrices(_gram(mass, S, P[0, 0]), moments).reshape(CARRIED, r, r)


def carried_bars(model: Arrays, body: int, bar: VolumeIntegrals, carried: Array) -> VolumeIntegrals:
    """Derivatives with respect to the integrals, from those with the carried fields and with C."""
    r = int(model.modes[body])
    n, C = r + 1, model.carried[body, :, :r, :r]
    P, inertia = bar.P, model.P[body, 0].reshape(3, 3, -1)[:, :, 0]
    assert P is not None
    gram = _gram(model.mass[body], model.S[body], inertia)
    by_gram, moments = carried_matrices_pullback(
        gram, C.reshape(4, 3 * r, r), carried.reshape(4, 3 * r, r)
    )
    rows = P[n:].copy()
    rows[:, :n] += P[:n, n:].transpose(1, 0, 3, 2)
    V = np.einsum("lkbki->lbi", rows.reshape(4, 3, n + CARRIED, 3, 3))
    V[0] += bar.S
    by_gram = by_gram + np.einsum("lmkk->lm", V[:, n:].reshape(4, 4, 3, 3))
    S, P = V[0, :n].copy(), P[:n, :n].copy()
    P[0] += V[1:, :n].transpose(1, 0, 2)
    S[0] += by_gram[0, 1:] + by_gram[1:, 0]
    P[0, 0] += by_gram[1:, 1:]
    stacked = np.zeros((CARRIED, r, r))
    stacked[_LOADS] = moments.reshape(CARRIED, r, r)
    stiffening = {"rotation": stacked[:9].reshape(3, 3, r, r), "acceleration": stacked[9:]}
    return VolumeIntegrals.in_space(
        bar.mass + by_gram[0, 0],
        S,
        0.5 * (P + P.transpose(1, 0, 3, 2)),
        bar.K,
        bar.markers,
        stiffening,
    )


def set_moments(
    out: dict[str, Array], b: int, integrals: VolumeIntegrals, stiffening: Array | None
) -> Array:
    """Set the moments of body b in the arrays of all bodies; return its inertia, (3, 3).

    out has arrays of zeros by name of the field of ModelArrays; the stiffening, where there is any,
    is of shape (12, modes, modes).
    """
    mass, S, P = integrals.mass, integrals.S, integrals.P
    assert P is not None
    P = 0.5 * (P + P.transpose(1, 0, 3, 2))
    inertia = np.trace(P[0, 0]) * np.eye(3) - P[0, 0]
    if stiffening is not None:
        out["carried"][b] = carried_coordinates(mass, S, P, stiffening)
        S, P = with_carried_fields(mass, S, P)
    n, width = len(S), out["S"].shape[1]
    out["S"][b, :n] = S
    out["P"][b].reshape(width, 9, width)[:n, :, :n] = P.reshape(n, n, 9).transpose(1, 2, 0)
    out["G"][b, :n, :n] = np.einsum("abkk->ab", P)
    return inertia
