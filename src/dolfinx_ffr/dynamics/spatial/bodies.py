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

with axial(Z) = (Z_32 - Z_23, ...) and d_M, d_K the coefficients of Rayleigh damping. Geometric
stiffness adds (K_k q)_j to (S_j)_k and (K_kl q)_j to P_j(q)_kl in r_j (R. Seifried, Dynamics of
Underactuated Multibody Systems, Springer 2014, doi:10.1007/978-3-319-01228-5).

Derivatives with respect to rotations are those in the body's axes, dA = A [dth].
"""

from __future__ import annotations

from ..compilation import Matrix, Vector, kernel
from ..equations import Equations
from .algebra import axial, cross, cross_matrix, product, theta, turned, turned_back
from .arrays import RIGID, ROTATION, ModelArrays, Work


@kernel
def body_products(model: ModelArrays, eq: Equations, work: Work, b: int) -> None:
    """Put qh, vh, ah of one body into work.qh, P_a(q), P_a(v), P_a(a) of all a into work.PX."""
    o, n, P, qh, PX = model.first[b] + RIGID, model.modes[b] + 1, model.P[b], work.qh, work.PX
    qh[0, 0], qh[1, 0], qh[2, 0] = 1.0, 0.0, 0.0
    for j in range(n - 1):
        qh[0, j + 1], qh[1, j + 1], qh[2, j + 1] = eq.y[o + j], eq.v[o + j], eq.w[o + j]
    for k in range(9):
        for a in range(n):
            x = y = z = 0.0
            for c in range(n):
                x += P[k, a, c] * qh[0, c]
                y += P[k, a, c] * qh[1, c]
                z += P[k, a, c] * qh[2, c]
            PX[0, k, a], PX[1, k, a], PX[2, k, a] = x, y, z


@kernel
def weighted(PX: Matrix, x: Vector, n: int, out: Matrix) -> None:
    """Set out to Z(x, y), PX being P_a(y)."""
    for k in range(3):
        for i in range(3):
            total = 0.0
            for a in range(n):
                total += PX[3 * k + i, a] * x[a]
            out[k, i] = total


@kernel
def moment(S: Matrix, x: Vector, n: int, out: Vector) -> None:
    """Set out to S(x)."""
    for k in range(3):
        out[k] = 0.0
        for a in range(n):
            out[k] += S[a, k] * x[a]


@kernel
def matrix_of(PX: Matrix, j: int, out: Matrix) -> None:
    """Set out to P_j(x), PX being that of all."""
    for k in range(3):
        for i in range(3):
            out[k, i] = PX[3 * k + i, j]


@kernel
def body_blocks(model: ModelArrays, eq: Equations, work: Work, instant: int, b: int) -> None:
    """Forces r of one body; work.RW, work.RV, work.RY: their derivatives by w, v, y."""
    body_products(model, eq, work, b)
    o, n, S = model.first[b], model.modes[b], model.S[b]
    RW, RV, RY, r, A = work.RW, work.RV, work.RY, eq.r, work.A[b]
    PX, qh, mass, small, x = work.PX, work.qh, model.mass[b], work.small, work.vectors
    omega, eps = eq.v[o + ROTATION : o + RIGID], eq.w[o + ROTATION : o + RIGID]
    g, f, sq, sv, sa, h, t, u = x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7]
    W, B, Zq, Zv, J = small[0], small[1], small[2], small[3], small[4]
    M1, M2, M3, M4 = small[5], small[6], small[7], small[8]
    for k in range(3):
        g[k] = eq.w[o + k] - model.gravity[instant, k]
    turned_back(A, g, f)
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
    for i in range(RIGID + n):
        for j in range(RIGID + n):
            RW[i, j] = RV[i, j] = RY[i, j] = 0.0

    # Forces on the frame.
    turned(B, sq, h)
    cross(omega, sv, t)
    for k in range(3):
        h[k] += mass * f[k] + 2.0 * t[k] + sa[k]
    turned(A, h, t)
    for k in range(3):
        r[o + k] = t[k]
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
        r[o + 3 + k] = t[k] + u[k]
        for i in range(3):
            RW[3 + k, i] = RW[i, 3 + k]  # [Sq] A^T = (-A [Sq])^T
            RW[3 + k, 3 + i] = J[k, i]
    cross_matrix(f, M2)
    product(M1, M2, M3)
    put(RY, 3, 3, M3, 1.0)
    # W J - [J omega] + 2 theta(Z(v, q))
    product(W, J, M2)
    put(RV, 3, 3, M2, 1.0)
    turned(J, omega, t)
    cross_matrix(t, M2)
    put(RV, 3, 3, M2, -1.0)
    theta(Zv, M2)
    put(RV, 3, 3, M2, 2.0)
    for j in range(n):
        elastic_blocks(model, eq, work, b, j, f)


@kernel
def put(to: Matrix, row: int, column: int, block: Matrix, factor: float) -> None:
    """Add factor times a block of three to a matrix."""
    for k in range(3):
        for i in range(3):
            to[row + k, column + i] += factor * block[k, i]


@kernel
def elastic_blocks(
    model: ModelArrays, eq: Equations, work: Work, b: int, j: int, f: Vector
) -> None:
    """Force on an elastic coordinate, and rows and columns of body_blocks that belong to it."""
    o, n, S, P, K = model.first[b], model.modes[b], model.S[b], model.P[b], model.K[b]
    RW, RV, RY, A, PX = work.RW, work.RV, work.RY, work.A[b], work.PX
    small, x, da, db = work.small, work.vectors, model.alpha[b], model.beta[b]
    omega = eq.v[o + ROTATION : o + RIGID]
    W, B = small[0], small[1]
    Pq, Pv, Pa, M1, M2, M3 = small[9], small[10], small[11], small[5], small[6], small[7]
    s, t, u = x[8], x[9], x[10]
    p = RIGID + j
    matrix_of(PX[0], j + 1, Pq)
    matrix_of(PX[1], j + 1, Pv)
    matrix_of(PX[2], j + 1, Pa)
    for k in range(3):
        s[k] = S[j + 1, k]
    # Columns: R by w A S_j, by v 2 A W S_j, by y A B S_j.
    turned(A, s, t)
    for k in range(3):
        RW[k, p] = t[k]
    cross(omega, s, u)
    turned(A, u, t)
    for k in range(3):
        RV[k, p] = 2.0 * t[k]
    turned(B, s, u)
    turned(A, u, t)
    for k in range(3):
        RY[k, p] = t[k]
    # th by w axial(P_j(q)), by v 2 axial(W P_j(q)),
    # by y S_j x f + axial(B (P_j(q) + P_j(q)^T) + 2 W P_j(v)^T + P_j(a)^T)
    axial(Pq, t)
    product(W, Pq, M1)
    axial(M1, u)
    for k in range(3):
        RW[3 + k, p] = t[k]
        RV[3 + k, p] = 2.0 * u[k]
        for i in range(3):
            M1[k, i] = Pq[k, i] + Pq[i, k]
            M2[k, i] = 2.0 * Pv[i, k]
    product(B, M1, M3)
    product(W, M2, M1)
    for k in range(3):
        for i in range(3):
            M3[k, i] += M1[k, i] + Pa[i, k]
    axial(M3, t)
    cross(s, f, u)
    for k in range(3):
        RY[3 + k, p] = t[k] + u[k]
    # Geometric stiffness acts on the force r_j alone.
    if model.stiffened[b]:
        T = model.stiffening[b]
        for k in range(n):
            q = eq.y[o + RIGID + k]
            for i in range(3):
                s[i] += T[9 + i, j, k] * q
                for m in range(3):
                    Pq[i, m] += T[3 * i + m, j, k] * q
                    RY[p, RIGID + k] += B[i, m] * T[3 * i + m, j, k]
                RY[p, RIGID + k] += f[i] * T[9 + i, j, k]
    force = 0.0
    for k in range(3):
        force += s[k] * f[k] + Pa[k, k] + da * Pv[k, k]
        for i in range(3):
            force += B[k, i] * Pq[k, i] + 2.0 * W[k, i] * Pv[k, i]
    for k in range(n):
        force += K[j, k] * (eq.y[o + RIGID + k] + db * eq.v[o + RIGID + k])
    eq.r[o + p] = force
    # Rows: R by w s A^T; th by w axial(Q), by v (Q + Q^T) omega - 2 tr(Q) omega + 2 axial(P_j(v)),
    # by y s x f, with Q = P_j(q).
    turned(A, s, t)
    cross(s, f, u)
    trace = Pq[0, 0] + Pq[1, 1] + Pq[2, 2]
    for k in range(3):
        RW[p, k] = t[k]
        RY[p, 3 + k] = u[k]
        spin = -2.0 * trace * omega[k]
        for i in range(3):
            spin += (Pq[k, i] + Pq[i, k]) * omega[i]
        RV[p, 3 + k] = spin
    axial(Pq, t)
    axial(Pv, u)
    for k in range(3):
        RW[p, 3 + k] = t[k]
        RV[p, 3 + k] += 2.0 * u[k]
    # G, 2 W : P_jk and B : P_jk
    for k in range(n):
        P0, P4, P8 = P[0, j + 1, k + 1], P[4, j + 1, k + 1], P[8, j + 1, k + 1]
        trace = P0 + P4 + P8
        by_v = by_y = 0.0
        for i in range(3):
            for m in range(3):
                entry = P[3 * i + m, j + 1, k + 1]
                by_v += W[i, m] * entry
                by_y += B[i, m] * entry
        RW[p, RIGID + k] += trace
        RV[p, RIGID + k] += 2.0 * by_v + da * trace + db * K[j, k]
        RY[p, RIGID + k] += by_y + K[j, k]


@kernel
def body_equations(
    model: ModelArrays, eq: Equations, work: Work, instant: int, b: int, cv: float
) -> None:
    """Forces r of one body, its block of r_w + cv r_v (eq.M) and of r_y (eq.Ky)."""
    body_blocks(model, eq, work, instant, b)
    o = model.first[b]
    for i in range(RIGID + model.modes[b]):
        for j in range(RIGID + model.modes[b]):
            eq.M[o + i, o + j] = work.RW[i, j] + cv * work.RV[i, j]
            eq.Ky[o + i, o + j] = work.RY[i, j]


@kernel
def body_pullback(model: ModelArrays, eq: Equations, work: Work, instant: int, b: int) -> None:
    """Subtract r_y^T adj from work.gather and r_v^T adj from eq.v_bar for one body."""
    for i in range(RIGID + model.modes[b]):
        work.line[i] = eq.r[model.first[b] + i]
    body_blocks(model, eq, work, instant, b)
    o, n = model.first[b], RIGID + model.modes[b]
    for i in range(n):
        eq.r[o + i] = work.line[i]
        x = eq.adjoint[o + i]
        for j in range(n):
            work.gather[o + j] -= work.RY[i, j] * x
            eq.v_bar[o + j] -= work.RV[i, j] * x
