# SPDX-License-Identifier: MIT
"""Volume integrals of a body in the plane, also of the fields that elastic coordinates carry along.

These are e_x, e_y, X and J X. Vectors are complex numbers here, J is i, and the fields are 1, i, X
and i X. With F_a = int rho w_a and H_a = int rho conj(X) w_a, for the carried fields those of mass,
S_0 and G_00,

    G_ab + i N_ab = int rho conj(w_a) w_b = conj(u_a) F_b    or    conj(u_a) H_b

where w_a is one of the carried fields u_a or u_a X, u_a = 1 or i. See carried.py for their purpose.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import Array, symmetric
from ...body import VolumeIntegrals
from .arrays import Arrays
from .carried import carried_matrices, carried_matrices_pullback

#: Number of carried fields.
CARRIED = 4
#: u of the carried fields, those that are constant first.
_UNITS = np.array([1.0, 1.0j])
#: The loads -rho psi of the carried fields are these times those by omega^2, alpha, and the
#: acceleration along x and y.
_LOADS = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-1, 0, 0, 0], [0, 1, 0, 0]], dtype=np.float64)


def with_carried_fields(mass: float, S: Array, G: Array, N: Array) -> tuple[Array, Array, Array]:
    """The integrals S (n, 2), G (n, n) and N (n, n) with the four fields, carried along, behind."""
    n = len(S)
    F, H = S[:, 0] + 1j * S[:, 1], G[0] + 1j * N[0]
    center, second = F[0], G[0, 0]
    F = np.concatenate([F, mass * _UNITS, center * _UNITS])
    H = np.concatenate([H, np.conj(center) * _UNITS, second * _UNITS])
    products = np.zeros((n + CARRIED, n + CARRIED), dtype=complex)
    products[:n, :n] = G + 1j * N
    products[n:] = np.concatenate([np.outer(np.conj(_UNITS), moments) for moments in (F, H)])
    products[:n, n:] = np.conj(products[n:, :n]).T
    return np.stack([F.real, F.imag], axis=1), products.real.copy(), products.imag.copy()


def carried_coordinates(G: Array, stiffening: Array) -> Array:
    """The matrices C of the carried coordinates, shape (4, modes, modes).

    G has the carried fields; the stiffening is by omega^2, alpha and the acceleration.
    """
    return carried_matrices(G[-CARRIED:, -CARRIED:], np.tensordot(_LOADS, stiffening, 1))


def carried_bars(model: Arrays, body: int, bar: VolumeIntegrals, carried: Array) -> VolumeIntegrals:
    """Derivatives with respect to the integrals, from those with the carried fields and with C."""
    r = int(model.modes[body])
    n, C = r + 1, model.carried[body, :, :r, :r]
    gram = model.G[body, n : n + CARRIED, n : n + CARRIED]
    G, N = bar.G.copy(), bar.N
    by_gram, moments = carried_matrices_pullback(gram, C, carried)
    G[n:, n:] += by_gram
    spun, swung, *pulled = np.tensordot(_LOADS.T, moments, 1)
    both = G + 1j * N
    rows = both[n:].copy()
    rows[:, :n] += np.conj(both[:n, n:]).T
    F, H = _UNITS @ rows[:2], _UNITS @ rows[2:]
    F = F + bar.S[:, 0] + 1j * bar.S[:, 1]
    by_center = np.sum(np.conj(_UNITS) * F[n + 2 :] + _UNITS * np.conj(H[n : n + 2]))
    mass = bar.mass + float(np.sum(np.conj(F[n : n + 2]) * _UNITS).real)
    second = float(np.sum(np.conj(H[n + 2 :]) * _UNITS).real)
    S = np.stack([F[:n].real, F[:n].imag], axis=1)
    S[0] += by_center.real, by_center.imag
    G, N = G[:n, :n], N[:n, :n].copy()
    G[0] += H[:n].real
    N[0] += H[:n].imag
    G[0, 0] += second
    stiffening = {"omega2": spun, "alpha": swung, "acceleration": np.stack(pulled)}
    return replace(bar, mass=mass, S=S, G=symmetric(G), N=0.5 * (N - N.T), stiffening=stiffening)


def set_moments(
    out: dict[str, Array], b: int, integrals: VolumeIntegrals, stiffening: Array | None
) -> Array:
    """Set the moments of body b in the arrays of all bodies; return its inertia, (1, 1).

    out has arrays of zeros by name of the field of ModelArrays; the stiffening, where there is any,
    is of shape (4, modes, modes).
    """
    # The kernels use rows as columns: remove what round-off has left of the other part.
    S, G, N = integrals.S, symmetric(integrals.G), 0.5 * (integrals.N - integrals.N.T)
    if stiffening is not None:
        S, G, N = with_carried_fields(integrals.mass, S, G, N)
        out["carried"][b] = carried_coordinates(G, stiffening)
    n = len(S)
    out["S"][b, :n], out["G"][b, :n, :n], out["N"][b, :n, :n] = S, G, N
    return integrals.G[:1, :1]
