# SPDX-License-Identifier: MIT
"""Equations of motion of one body in space, and their Jacobians.

With the rotation A, angular velocity omega and angular acceleration alpha in the body's axes,
qh = (1, q), S(q) = sum_a qh_a S_a, P_j(x) = sum_b P_jb x_b, Z(x, y) = sum_ab x_a y_b P_ab, the
acceleration of the frame less gravity f = A^T a_R, W = [omega] and B = [alpha] + W W, the
acceleration of a point is

    c = f + B w + 2 W w(v) + w(a)

in the body's axes, and the inertia, elastic and damping forces are

    r_R  = A (m f + B S(q) + 2 W S(v) + S(a))
    r_th = S(q) x f + axial(B Z(q, q) + 2 W Z(v, q) + Z(a, q))
    r_j  = S_j . f + B : P_j(q) + 2 W : P_j(v) + tr P_j(a) + (K q)_j + d_M tr P_j(v) + d_K (K v)_j

with axial(Z) = (Z_32 - Z_23, ...) and d_M, d_K the coefficients of Rayleigh damping (R. Seifried,
Dynamics of Underactuated Multibody Systems, Springer 2014, doi:10.1007/978-3-319-01228-5). A body
with geometric stiffness has further shape functions whose coordinates follow q, see carried.py;
to first order in q they add f_k (K_k q)_j + B_kl (K_kl q)_j to r_j.

Derivatives with respect to rotations are those in the body's axes, dA = A [dth].
"""

from __future__ import annotations

import math

import numpy as np

from ..compilation import Matrix, Vector, kernel
from ..equations import Equations
from .algebra import (
    add_cross,
    add_multiple,
    axial,
    cross,
    cross_matrix,
    dot,
    product,
    theta,
    turned,
    turned_back,
)
from .arrays import Arrays, Work
from .carried import blocks_equations, carry
from .group import exponential, rotation_between, tangent

#: Place of the rotation among the coordinates of a body, and number of its rigid coordinates.
ROTATION, RIGID = 3, 6


@kernel
def add_combination(B: Matrix, x: Vector, out: Vector) -> None:
    """Add x . B to out."""
    first, second, third, p, q, r = B[0], B[1], B[2], x[0], x[1], x[2]
    # Unsigned bounds let the compiler vectorise, see integration/linear.py.
    for j in range(np.uintp(out.size)):
        out[j] += first[j] * p + second[j] * q + third[j] * r


@kernel
def place_body(model: Arrays, eq: Equations, work: Work, b: int) -> None:
    """Rotation of one body, and its derivatives with respect to the coordinates."""
    base, short, i, y, origin = work.small[0], work.small[1], model.first[b] + 3, eq.y, eq.base
    u, v, w = y[i] - origin[i], y[i + 1] - origin[i + 1], y[i + 2] - origin[i + 2]
    exponential(origin[i], origin[i + 1], origin[i + 2], base)
    exponential(u, v, w, short)
    product(base, short, work.A[b])
    tangent(u, v, w, work.T[b])
    for k in range(3):
        work.turned[b, k] = base[k, 0] * u + base[k, 1] * v + base[k, 2] * w


@kernel
def into_coordinates(model: Arrays, work: Work, row: Vector) -> None:
    """Turn derivatives with respect to rotations dA = A [dth] into those to coordinates."""
    for b in range(model.first.size):
        p, T = model.first[b] + 3, work.T[b]
        x, y, z = row[p], row[p + 1], row[p + 2]
        for k in range(3):
            row[p + k] = x * T[0, k] + y * T[1, k] + z * T[2, k]


@kernel
def measure_body(model: Arrays, eq: Equations, b: int) -> float:
    """Add the sizes of y - reference and v by the mass of a rigid body; angle of its turn.

    The turn is the one within the step, where it may be more than half a turn.
    """
    sizes, y, v, reference, base = eq.sizes, eq.y, eq.v, eq.reference, eq.base
    o, r = model.first[b], model.first[b] + 3
    shift = rotation_between(
        reference[r], reference[r + 1], reference[r + 2], y[r], y[r + 1], y[r + 2]
    )
    P, size = model.P[b, 0], model.P.shape[1]
    trace = P[0] + P[4 * size] + P[8 * size]
    for k in range(3):
        sizes[0] += model.mass[b] * (y[o + k] - reference[o + k]) ** 2
        sizes[1] += model.mass[b] * v[o + k] ** 2
        for i in range(3):
            inertia = (trace if i == k else 0.0) - P[(3 * k + i) * size]
            sizes[0] += shift[k] * inertia * shift[i]
            sizes[1] += v[r + k] * inertia * v[r + i]
    u, w, x = y[r] - base[r], y[r + 1] - base[r + 1], y[r + 2] - base[r + 2]
    return math.sqrt(u * u + w * w + x * x)


@kernel
def body_products(model: Arrays, eq: Equations, work: Work, b: int) -> None:
    """Put qh, vh, ah of one body into work.qh, P_a(q), P_a(v), P_a(a) of all a into work.PX."""
    o, modes, n = model.first[b] + RIGID, model.modes[b], model.fields[b] + 1
    P, qh, PX = model.P[b], work.qh, work.PX
    qh[0, 0], qh[1, 0], qh[2, 0] = 1.0, 0.0, 0.0
    for j in range(modes):
        qh[0, j + 1], qh[1, j + 1], qh[2, j + 1] = eq.y[o + j], eq.v[o + j], eq.w[o + j]
    if model.stiffened[b]:
        carry(model.carried[b], eq.y[o:], eq.v[o:], eq.w[o:], modes, work.moved, work.slopes)
        for j in range(n - 1 - modes):
            for x in range(3):
                qh[x, modes + 1 + j] = work.moved[x, j]
    for i in range(PX.shape[1]):
        PX[0, i] = P[0, i]
        PX[1, i] = PX[2, i] = 0.0
    for x in range(3):
        for c in range(1, n):
            add_multiple(P[c], qh[x, c], PX[x])


@kernel
def weighted(PX: Vector, x: Vector, n: int, out: Matrix) -> None:
    """Set out to Z(x, y), PX being P_a(y) of all a."""
    size = PX.size // 9
    for k in range(3):
        for i in range(3):
            total, at = 0.0, (3 * k + i) * size
            for a in range(n):
                total += PX[at + a] * x[a]
            out[k, i] = total


@kernel
def moment(S: Matrix, x: Vector, n: int, out: Vector) -> None:
    """Set out to S(x)."""
    for k in range(3):
        out[k] = 0.0
        for a in range(n):
            out[k] += S[a, k] * x[a]


@kernel
def forces_and_frame(model: Arrays, eq: Equations, work: Work, instant: int, b: int) -> None:
    """Forces, work.force, of one body whose fields all have coordinates.

    Their derivatives by w, v and y go to work.RW, work.RV and work.RY. Those of elastic forces by
    elastic coordinates are in work.pairs, see elastic_pairs.
    """
    body_products(model, eq, work, b)
    o, n, S = model.first[b], model.fields[b], model.S[b]
    RW, RV, RY, A, r = work.RW, work.RV, work.RY, work.A[b], work.force
    PX, qh, mass, small, x = work.PX, work.qh, model.mass[b], work.small, work.vectors
    omega, eps = eq.v[o + ROTATION : o + RIGID], eq.w[o + ROTATION : o + RIGID]
    g, f, sq, sv, sa, h, t, u = x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7]
    W, B, Zq, Zv, J = small[0], small[1], small[2], small[3], small[4]
    M1, M2, M3, M4 = small[5], small[6], small[7], small[8]
    for k in range(3):
        g[k] = eq.w[o + k] - model.gravity[instant, k]
    turned_back(model, A, g, f)
    cross_matrix(omega, W)
    product(W, W, B)
    cross_matrix(eps, M1)
    for k in range(3):
        for i in range(3):
            B[k, i] += M1[k, i]
    moment(S, qh[0], n + 1, sq)
    moment(S, qh[1], n + 1, sv)
    moment(S, qh[2], n + 1, sa)
    weighted(PX[0], qh[0], n + 1, Zq)
    weighted(PX[0], qh[1], n + 1, Zv)
    theta(Zq, J)
    for i in range(RIGID):
        for j in range(RIGID):
            RW[i, j] = RV[i, j] = RY[i, j] = 0.0

    # Forces on the frame.
    turned(model, B, sq, h)
    cross(omega, sv, t)
    for k in range(3):
        h[k] += mass * f[k] + 2.0 * t[k] + sa[k]
    turned(model, A, h, t)
    for k in range(3):
        r[k] = t[k]
        RW[k, k] = mass
    # R, th by w: -A [Sq]; by v: -A ([omega x Sq] + W [Sq] + 2 [Sv]); by y: A (m [f] - [h])
    cross_matrix(sq, M1)
    product(A, M1, M2)
    put(RW, 0, 3, M2, -1.0)
    product(W, M1, M3)
    cross(omega, sq, t)
    for k in range(3):
        t[k] += 2.0 * sv[k]
        u[k] = mass * f[k] - h[k]
    cross_matrix(t, M4)
    for k in range(3):
        for i in range(3):
            M4[k, i] += M3[k, i]
    product(A, M4, M2)
    put(RV, 0, 3, M2, -1.0)
    cross_matrix(u, M4)
    product(A, M4, M2)
    put(RY, 0, 3, M2, 1.0)

    # Moments.
    cross(sq, f, t)
    product(B, Zq, M2)
    product(W, Zv, M3)
    weighted(PX[0], qh[2], n + 1, M4)
    for k in range(3):
        for i in range(3):
            M2[k, i] += 2.0 * M3[k, i] + M4[k, i]
    axial(M2, u)
    for k in range(3):
        r[3 + k] = t[k] + u[k]
        for i in range(3):
            RW[3 + k, i] = RW[i, 3 + k]  # [Sq] A^T = (-A [Sq])^T
            RW[3 + k, 3 + i] = J[k, i]
    cross_matrix(f, M2)
    product(M1, M2, M3)
    put(RY, 3, 3, M3, 1.0)
    # W J - [J omega] + 2 theta(Z(v, q))
    product(W, J, M2)
    put(RV, 3, 3, M2, 1.0)
    turned(model, J, omega, t)
    cross_matrix(t, M2)
    put(RV, 3, 3, M2, -1.0)
    theta(Zv, M2)
    put(RV, 3, 3, M2, 2.0)
    if n:
        elastic_blocks(model, eq, work, b, f)
        elastic_pairs(model, work, b, W, B)


@kernel
def put(to: Matrix, row: int, column: int, block: Matrix, factor: float) -> None:
    """Add factor times a block of three to a matrix."""
    for k in range(3):
        for i in range(3):
            to[row + k, column + i] += factor * block[k, i]


@kernel
def elastic_blocks(model: Arrays, eq: Equations, work: Work, b: int, f: Vector) -> None:
    """Forces on elastic coordinates, and rows and columns of forces_and_frame that belong to them.

    With axial([omega] Z) = tr(Z) omega - Z omega, of which axial([omega]^2 X) = -omega x (X omega)
    for a symmetric X is a consequence.
    """
    o, n, S, A, size = model.first[b], model.fields[b], model.S[b], work.A[b], model.S.shape[1]
    # Entry kl of P_j(q) is Q[(3 k + l) size + j].
    Q, V, Z = work.PX[0, 1:], work.PX[1, 1:], work.PX[2, 1:]
    RW, RV, RY, r, da = work.RW, work.RV, work.RY, work.force, model.alpha[b]
    w, e, u, a = eq.v[o + 3 : o + 6], eq.w[o + 3 : o + 6], work.vectors[9], work.vectors[10]
    s, trace, trace_v, square = work.swung, work.traces[0], work.traces[1], dot(w, w)
    for j in range(n):
        # Columns: R by w A S_j, by v 2 A W S_j, by y A B S_j; s = (P_j(q) + P_j(q)^T) omega
        p, shape = RIGID + j, S[j + 1]
        cross(w, shape, u)
        cross(e, shape, a)
        add_cross(w, u, 1.0, a)
        trace[j] = Q[j] + Q[4 * size + j] + Q[8 * size + j]
        trace_v[j] = V[j] + V[4 * size + j] + V[8 * size + j]
        r[p] = dot(shape, f) + (Z[j] + Z[4 * size + j] + Z[8 * size + j]) + da * trace_v[j]
        r[p] -= square * trace[j]
        for k in range(3):
            RW[k, p] = RW[p, k] = dot(A[k], shape)
            RV[k, p], RY[k, p], s[k, j] = 2.0 * dot(A[k], u), dot(A[k], a), 0.0
            for i in range(3):
                s[k, j] += (Q[(3 * k + i) * size + j] + Q[(3 * i + k) * size + j]) * w[i]
    for k in range(3):
        # Columns: th by w axial(P_j(q)), by v 2 axial(W P_j(q)),
        # by y S_j x f + axial(B (P_j(q) + P_j(q)^T) + 2 W P_j(v)^T + P_j(a)^T).
        # Rows: by w axial(P_j(q)), by v s - 2 tr P_j(q) omega + 2 axial(P_j(v)), by y S_j x f.
        i, x = (k + 1) % 3, (k + 2) % 3
        ix, xi = (3 * i + x) * size, (3 * x + i) * size
        for j in range(n):
            p, lever = RIGID + j, S[j + 1, i] * f[x] - S[j + 1, x] * f[i]
            h, spin = Q[xi + j] - Q[ix + j], V[xi + j] - V[ix + j]
            by_w, by_e, by_v = trace[j] * w[k], 2.0 * trace[j] * e[k], trace_v[j] * w[k]
            for m in range(3):
                row, column = (3 * k + m) * size + j, (3 * m + k) * size + j
                by_w -= Q[row] * w[m]
                by_e -= (Q[row] + Q[column]) * e[m]
                by_v -= V[column] * w[m]
            RW[3 + k, p] = RW[p, 3 + k] = h
            RV[3 + k, p] = 2.0 * by_w
            RY[3 + k, p] = lever + by_e - w[i] * s[x, j] + w[x] * s[i, j] + 2.0 * by_v
            RY[3 + k, p] += Z[ix + j] - Z[xi + j]
            RV[p, 3 + k] = s[k, j] - 2.0 * trace[j] * w[k] + 2.0 * spin
            RY[p, 3 + k] = lever
            r[p] += e[k] * h + w[k] * (0.5 * s[k, j] + 2.0 * spin)
    K, db, qh = model.K[b], model.beta[b], work.qh
    force = r[RIGID : RIGID + n]
    for k in range(n):
        shift, row = qh[0, k + 1] + db * qh[1, k + 1], K[k]
        add_multiple(row[:n], shift, force)


@kernel
def elastic_pairs(model: Arrays, work: Work, b: int, W: Matrix, B: Matrix) -> None:
    """W : P_jk in work.pairs[0] and B : P_jk in work.pairs[1]."""
    n, size = model.fields[b], model.S.shape[1]
    end = np.uintp(n)
    for j in range(n):
        P, by_v, by_y = model.P[b, j + 1], work.pairs[0, j], work.pairs[1, j]
        for k in range(end):
            by_v[k] = by_y[k] = 0.0
        for k in range(3):
            for i in range(3):
                at, w, c = (3 * k + i) * size + 1, W[i, k], B[i, k]  # of P_mj, not P_jm
                row = P[at : at + n]
                for m in range(end):
                    by_v[m] += w * row[m]
                    by_y[m] += c * row[m]


@kernel
def body_blocks(model: Arrays, eq: Equations, work: Work, instant: int, b: int) -> None:
    """Forces of a body whose fields all have coordinates, and their derivatives by w, v and y."""
    n, pairs, da, db = model.fields[b], work.pairs, model.alpha[b], model.beta[b]
    end, to = np.uintp(n), slice(RIGID, RIGID + n)
    forces_and_frame(model, eq, work, instant, b)
    for j in range(n):
        RW, RV, RY = work.RW[RIGID + j, to], work.RV[RIGID + j, to], work.RY[RIGID + j, to]
        G, K, by_v, by_y = model.G[b, j + 1, 1:], model.K[b, j], pairs[0, j], pairs[1, j]
        for k in range(end):
            RW[k], RY[k] = G[k], K[k] + by_y[k]
            RV[k] = da * G[k] + db * K[k] + 2.0 * by_v[k]


@kernel
def body_equations(
    model: Arrays, eq: Equations, work: Work, instant: int, b: int, cv: float
) -> None:
    """Forces r of one body, its block of r_w + cv r_v (eq.M) and of r_y (eq.Ky)."""
    body_blocks(model, eq, work, instant, b)
    blocks_equations(model, eq, work, b, cv)
