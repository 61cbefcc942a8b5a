# SPDX-License-Identifier: MIT
"""Bodies with geometric stiffness: fields of displacement that elastic coordinates carry along.

A bent beam is shorter: to second order the points of a body move by

    u = sum_j q_j phi_j + u2(q),    u2 quadratic in q.

A load f does the work  int f . u2 = -1/2 q . K_f q  on u2, K_f being its geometric stiffness. So
the geometric stiffness by unit loads of inertia, -rho X_l e_k with X_0 = 1, gives integrals of u2,

    int rho X_l u2_k = 1/2 q . K_kl q,

and no others are known. Of all fields u2 with these integrals the one that moves the least mass is
linear in the reference position X,

    u2 = sum_m c_m(q) psi_m,    c_m = 1/2 q . C_m q,    psi_m = X_l e_k,    C = Gamma^-1 K,

with Gamma the Gram matrix int rho psi_m . psi_n. In the plane, where only omega^2 and alpha give
loads of rotation, the fields are e_x, e_y, X and J X. A load that is not modelled counts with a
geometric stiffness of zero. A point mass at a marker that has geometric stiffness counts in all of
these integrals.

So the fields psi are shape functions whose coordinates c follow q. With E = [1, D], where D_mj is
(C_m q)_j, the forces are

    r_j = r~_j + sum_m D_mj r~_m

with r~ the forces of a body in which q and c are free, and the mass matrix is E^T M~ E. This matrix
is symmetric, and positive for deformations of any size, since it is the mass matrix of a field. A
mass matrix cut off at the second order of q would become indefinite for a frame that turns with an
end of the body, where rotations of the frame and fast modes nearly cancel. Energy and momenta are
conserved as for any body. To first order in q the elastic forces gain K_f q of the loads f of
inertia.

The part of u2 that has no share in rigid and uniform motions of the body is neglected. Its inertia
would add terms of third order to the kinetic energy, int rho phi_i . u2' q_i': of the relative size
of the slopes of the deformation, beside the inertia of the deformation itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import Array, symmetric
from ..compilation import Array3, Matrix, Vector, kernel
from ..equations import Equations
from .algebra import add_multiple
from .arrays import Arrays, Work

#: Smallest eigenvalue of the Gram matrix at unit diagonal that counts as mass.
_NO_MASS = 1e-13


@kernel
def carry(
    C: Array3, y: Vector, v: Vector, w: Vector, n: int, moved: Matrix, slopes: Array3
) -> None:
    """Carried coordinates and derivatives, moved (3, m); C q, C v, C w in slopes (3, m, modes).

    Elastic coordinates and their derivatives are the first n entries of y, v, w.
    """
    for i in range(C.shape[0]):
        moved[0, i] = moved[1, i] = moved[2, i] = 0.0
        for j in range(n):
            by_q = by_v = by_w = 0.0
            for k in range(n):
                by_q += C[i, j, k] * y[k]
                by_v += C[i, j, k] * v[k]
                by_w += C[i, j, k] * w[k]
            slopes[0, i, j], slopes[1, i, j], slopes[2, i, j] = by_q, by_v, by_w
            moved[0, i] += 0.5 * by_q * y[j]
            moved[1, i] += by_q * v[j]
            moved[2, i] += by_q * w[j] + by_v * v[j]


@kernel
def carried_blocks(model: Arrays, eq: Equations, work: Work, instant: int, b: int) -> None:
    """Forces and blocks of a body whose carried coordinates, the last ones, follow the others."""
    model.body_blocks(model, eq, work, instant, b)
    C, slopes, r, RW, RV, RY = model.carried[b], work.slopes, work.force, work.RW, work.RV, work.RY
    first, n, m = model.rigid, model.modes[b], model.carries
    end = first + n
    for p in range(end + m):
        for i in range(m):
            by_w, by_v, by_y = RW[p, end + i], RV[p, end + i], RY[p, end + i]
            for j in range(n):
                along, along_v = slopes[0, i, j], slopes[1, i, j]
                RY[p, first + j] += by_y * along + by_v * along_v + by_w * slopes[2, i, j]
                RV[p, first + j] += by_v * along + 2.0 * by_w * along_v
                RW[p, first + j] += by_w * along
    for i in range(m):
        force = r[end + i]
        for j in range(n):
            along = slopes[0, i, j]
            r[first + j] += along * force
            for p in range(end):
                RW[first + j, p] += along * RW[end + i, p]
                RV[first + j, p] += along * RV[end + i, p]
                RY[first + j, p] += along * RY[end + i, p]
            for k in range(n):
                RY[first + j, first + k] += force * C[i, j, k]


@kernel
def blocks_equations(model: Arrays, eq: Equations, work: Work, b: int, cv: float) -> None:
    """Put forces and blocks of one body, work.RW and so on, into eq.r, eq.M and eq.Ky."""
    o, n = model.first[b], model.rigid + model.modes[b]
    for i in range(n):
        eq.r[o + i] = work.force[i]
        for j in range(n):
            eq.M[o + i, o + j] = work.RW[i, j] + cv * work.RV[i, j]
            eq.Ky[o + i, o + j] = work.RY[i, j]


@kernel
def blocks_pullback(model: Arrays, eq: Equations, work: Work, b: int) -> None:
    """Transpose of the forces of one body, whose blocks work.RV and work.RY are there."""
    o, n = model.first[b], model.rigid + model.modes[b]
    for i in range(n):
        add_multiple(work.RY[i, :n], -eq.adjoint[o + i], work.gather[o : o + n])
        add_multiple(work.RV[i, :n], -eq.adjoint[o + i], eq.v_bar[o : o + n])


def _inverse(gram: Array) -> Array:
    """Inverse of a Gram matrix where it has mass, at unit diagonal; zero where it has none."""
    diagonal = np.diag(gram)
    scale = np.divide(1.0, np.sqrt(diagonal), out=np.zeros(len(gram)), where=diagonal > 0.0)
    scaled = np.outer(scale, scale)
    inverse = np.linalg.pinv(gram * scaled, rcond=_NO_MASS, hermitian=True)
    return np.asarray(inverse * scaled)


def carried_matrices(gram: Array, moments: Array) -> Array:
    """The matrices C of carried coordinates, shape (m, r, r).

    From the Gram matrix (m, m) of the carried fields, and the geometric stiffness (m, r, r) by the
    loads -rho psi_m.
    """
    return np.asarray(np.tensordot(_inverse(gram), moments, 1))


def carried_matrices_pullback(gram: Array, C: Array, bar: Array) -> tuple[Array, Array]:
    """Derivatives with respect to Gram matrix and geometric stiffness, bar being those by C."""
    moments = np.tensordot(_inverse(gram), bar, 1)
    product = np.tensordot(moments, C, ([1, 2], [1, 2]))
    return -symmetric(product), moments


def marked(C: Array | None, *motion: Array) -> list[Array]:
    """Vectors (1, q, c), (0, v, c'), (0, a, c'') and (0, x, q . C x), (instants, fields + 1) each.

    Of the motion q, v, a and x, shape (instants, r) each, two are given at least. C, of shape
    (m, r, r), is None where nothing is carried.
    """
    vectors = [np.column_stack([np.full(len(z), float(i == 0)), z]) for i, z in enumerate(motion)]
    if C is None:
        return vectors

    def form(x: Array, y: Array) -> Array:
        return np.stack([np.sum((x @ part) * y, axis=1) for part in C], axis=1)

    q, v = motion[:2]
    moved = [0.5 * form(q, q), *(form(q, z) for z in motion[1:])]
    if len(motion) > 2:
        moved[2] += form(v, v)
    return [np.hstack(pair) for pair in zip(vectors, moved, strict=True)]


def marked_pullback(q: Array, v: Array, a: Array, x: Array, bars: Sequence[Array]) -> Array:
    """Derivative with respect to the matrices C in :func:`marked`, shape (m, r, r).

    bars are the derivatives with respect to the carried parts of the four vectors, (instants, m).
    """
    by_c, by_v, by_a, by_x = bars
    by_matrices = []
    for i in range(by_c.shape[1]):
        column = slice(i, i + 1)
        by_matrix = q.T @ (
            0.5 * by_c[:, column] * q
            + by_v[:, column] * v
            + by_a[:, column] * a
            + by_x[:, column] * x
        )
        by_matrix += v.T @ (by_a[:, column] * v)
        by_matrices.append(symmetric(by_matrix))
    return np.array(by_matrices)


def padded_stiffening(stiffening: Array, modes: int) -> Array:
    """Geometric stiffness (n, r, r), exactly symmetric, with zeros added to (n, modes, modes)."""
    r = stiffening.shape[-1]
    out = np.zeros((len(stiffening), modes, modes))
    out[:, :r, :r] = symmetric(stiffening)
    return out
