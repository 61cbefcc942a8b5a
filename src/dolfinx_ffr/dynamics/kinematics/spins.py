# SPDX-License-Identifier: MIT
"""Spins of markers in space, on which moments act.

A spin, A (omega + Psi v), is the velocity of nothing: L = [0, A, A Psi] takes moments, and there is
neither a position nor an acceleration.
"""

from __future__ import annotations

from ..compilation import Matrix, kernel
from ..equations import Equations
from .algebra import add_cross, cross, turned, turned_back
from .arrays import SHIFT, Arrays, Work
from .vectors import place_vector


@kernel
def place_spin(model: Arrays, eq: Equations, work: Work, e: int) -> None:
    """The vector A Psi q of no meaning, the velocity, and L."""
    place_vector(model, eq, work, e)
    b, c1 = model.vector_body[e], work.c1[e]
    omega = model.first[b] + 3
    for k in range(3):
        c1[k] = eq.v[omega + k] + work.cv[e, k]
        for i in range(3):
            work.L[e, k, 3 + i] = work.A[b, k, i]
    turned(model, work.A[b], c1, work.sd[e])


@kernel
def add_spin_curvature(model: Arrays, work: Work, e: int, Ky: Matrix) -> None:
    """Add d(L^T f)/dy at the fixed moment f, work.forces, to Ky."""
    b, f, turn = model.vector_body[e], work.vectors[0], work.vectors[1]
    turned_back(model, work.A[b], work.forces[e], f)
    p = model.first[b] + 3
    Ky[p, p + 1] -= f[2]
    Ky[p, p + 2] += f[1]
    Ky[p + 1, p] += f[2]
    Ky[p + 1, p + 2] -= f[0]
    Ky[p + 2, p] -= f[1]
    Ky[p + 2, p + 1] += f[0]
    for j in range(model.modes[b]):
        cross(f, work.B[e, :, j], turn)
        for k in range(3):
            Ky[p + 3 + j, p + k] -= turn[k]


@kernel
def spin_pullback(model: Arrays, eq: Equations, work: Work, e: int) -> None:
    """Transpose of L adj, see vector_pullback."""
    b, f, m, adj = model.vector_body[e], work.vectors[0], work.vectors[1], eq.adjoint
    p, n = model.first[b] + 3, model.modes[b]
    turned_back(model, work.A[b], work.bars[e, SHIFT], f)
    for k in range(3):
        m[k] = 0.0
        for j in range(n):
            m[k] += work.B[e, k, j] * adj[p + 3 + j]
            work.vector_bars[e, k, j + 1] += f[k] * adj[p + 3 + j]
        m[k] += adj[p + k]
    add_cross(m, f, 1.0, work.gather[p : p + 3])
