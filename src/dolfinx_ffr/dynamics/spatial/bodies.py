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

import numpy as np

from ..compilation import Matrix, Vector, kernel
from ..equations import Equations
from .algebra import add_multiple, axial, cross, cross_matrix, product, theta, turned, turned_back
from .arrays import RIGID, ROTATION, ModelArrays, Work


@kernel
def body_products(model: ModelArrays, eq: Equations, work: Work, b: int) -> None:
    """Put qh, vh, ah of one body into work.qh, P_a(q), P_a(v), P_a(a) of all a into work.PX."""
    o, n, P, qh, PX = model.first[b] + RIGID, model.modes[b] + 1, model.P[b], work.qh, work.PX
    qh[0, 0], qh[1, 0], qh[2, 0] = 1.0, 0.0, 0.0
    for j in range(n - 1):
        qh[0, j + 1], qh[1, j + 1], qh[2, j + 1] = eq.y[o + j], eq.v[o + j], eq.w[o + j]
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
def body_blocks(model: ModelArrays, eq: Equations, work: Work, instant: int, b: int) -> None:
    """Forces r of one body; work.RW, work.RV, work.RY: their derivatives by w, v, y.

    Those of elastic forces by elastic coordinates are in work.pairs, see elastic_pairs.
    """
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
    for i in range(RIGID):
        for j in range(RIGID):
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
    if n:
        elastic_blocks(model, eq, work, b, f)
        elastic_pairs(model, eq, work, b, f)


@kernel
def put(to: Matrix, row: int, column: int, block: Matrix, factor: float) -> None:
    """Add factor times a block of three to a matrix."""
    for k in range(3):
        for i in range(3):
            to[row + k, column + i] += factor * block[k, i]


@kernel
def elastic_blocks(model: ModelArrays, eq: Equations, work: Work, b: int, f: Vector) -> None:
    """Forces on elastic coordinates, and rows and columns of body_blocks that belong to them.

    With axial([omega] Z) = tr(Z) omega - Z omega, of which axial([omega]^2 X) = -omega x (X omega)
    for a symmetric X is a consequence.
    """
    o, n, S, A, size = model.first[b], model.modes[b], model.S[b], work.A[b], model.S.shape[1]
    Q, V, Z = work.PX[0, 1:], work.PX[1, 1:], work.PX[2, 1:]
    RW, RV, RY, da = work.RW, work.RV, work.RY, model.alpha[b]
    p = o + ROTATION
    wx, wy, wz = eq.v[p], eq.v[p + 1], eq.v[p + 2]
    ex, ey, ez = eq.w[p], eq.w[p + 1], eq.w[p + 2]
    fx, fy, fz = f[0], f[1], f[2]
    square = wx * wx + wy * wy + wz * wz
    for j in range(n):
        p = RIGID + j
        x, y, z = S[j + 1, 0], S[j + 1, 1], S[j + 1, 2]
        # Columns: R by w A S_j, by v 2 A W S_j, by y A B S_j.
        ux, uy, uz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
        bx = ey * z - ez * y + wy * uz - wz * uy
        by = ez * x - ex * z + wz * ux - wx * uz
        bz = ex * y - ey * x + wx * uy - wy * ux
        for k in range(3):
            RW[k, p] = A[k, 0] * x + A[k, 1] * y + A[k, 2] * z
            RV[k, p] = 2.0 * (A[k, 0] * ux + A[k, 1] * uy + A[k, 2] * uz)
            RY[k, p] = A[k, 0] * bx + A[k, 1] * by + A[k, 2] * bz
        # th by w axial(P_j(q)), by v 2 axial(W P_j(q)),
        # by y S_j x f + axial(B (P_j(q) + P_j(q)^T) + 2 W P_j(v)^T + P_j(a)^T)
        q00, q01, q02 = Q[j], Q[size + j], Q[2 * size + j]
        q10, q11, q12 = Q[3 * size + j], Q[4 * size + j], Q[5 * size + j]
        q20, q21, q22 = Q[6 * size + j], Q[7 * size + j], Q[8 * size + j]
        v00, v01, v02 = V[j], V[size + j], V[2 * size + j]
        v10, v11, v12 = V[3 * size + j], V[4 * size + j], V[5 * size + j]
        v20, v21, v22 = V[6 * size + j], V[7 * size + j], V[8 * size + j]
        trace, trace_v = q00 + q11 + q22, v00 + v11 + v22
        trace_a = Z[j] + Z[4 * size + j] + Z[8 * size + j]
        RW[3, p], RW[4, p], RW[5, p] = q21 - q12, q02 - q20, q10 - q01
        RV[3, p] = 2.0 * (trace * wx - q00 * wx - q01 * wy - q02 * wz)
        RV[4, p] = 2.0 * (trace * wy - q10 * wx - q11 * wy - q12 * wz)
        RV[5, p] = 2.0 * (trace * wz - q20 * wx - q21 * wy - q22 * wz)
        x00, x11, x22, x01, x02, x12 = (
            2.0 * q00,
            2.0 * q11,
            2.0 * q22,
            q01 + q10,
            q02 + q20,
            q12 + q21,
        )
        sx, sy, sz = (
            x00 * wx + x01 * wy + x02 * wz,
            x01 * wx + x11 * wy + x12 * wz,
            x02 * wx + x12 * wy + x22 * wz,
        )
        RY[3, p] = (
            y * fz
            - z * fy
            + 2.0 * trace * ex
            - x00 * ex
            - x01 * ey
            - x02 * ez
            - wy * sz
            + wz * sy
            + 2.0 * (trace_v * wx - v00 * wx - v10 * wy - v20 * wz)
            - Z[7 * size + j]
            + Z[5 * size + j]
        )
        RY[4, p] = (
            z * fx
            - x * fz
            + 2.0 * trace * ey
            - x01 * ex
            - x11 * ey
            - x12 * ez
            - wz * sx
            + wx * sz
            + 2.0 * (trace_v * wy - v01 * wx - v11 * wy - v21 * wz)
            - Z[2 * size + j]
            + Z[6 * size + j]
        )
        RY[5, p] = (
            x * fy
            - y * fx
            + 2.0 * trace * ez
            - x02 * ex
            - x12 * ey
            - x22 * ez
            - wx * sy
            + wy * sx
            + 2.0 * (trace_v * wz - v02 * wx - v12 * wy - v22 * wz)
            - Z[3 * size + j]
            + Z[size + j]
        )
        # Geometric stiffness acts on the force r_j alone.
        if model.stiffened[b]:
            T = model.stiffening[b]
            for k in range(n):
                q = eq.y[o + RIGID + k]
                q00, q01, q02 = q00 + T[0, j, k] * q, q01 + T[1, j, k] * q, q02 + T[2, j, k] * q
                q10, q11, q12 = q10 + T[3, j, k] * q, q11 + T[4, j, k] * q, q12 + T[5, j, k] * q
                q20, q21, q22 = q20 + T[6, j, k] * q, q21 + T[7, j, k] * q, q22 + T[8, j, k] * q
                x, y, z = x + T[9, j, k] * q, y + T[10, j, k] * q, z + T[11, j, k] * q
            trace = q00 + q11 + q22
        hx, hy, hz = q21 - q12, q02 - q20, q10 - q01
        nx, ny, nz = v21 - v12, v02 - v20, v10 - v01
        # (Q + Q^T) omega with Q = P_j(q)
        sx = 2.0 * q00 * wx + (q01 + q10) * wy + (q02 + q20) * wz
        sy = (q01 + q10) * wx + 2.0 * q11 * wy + (q12 + q21) * wz
        sz = (q02 + q20) * wx + (q12 + q21) * wy + 2.0 * q22 * wz
        eq.r[o + p] = (
            x * fx
            + y * fy
            + z * fz
            + trace_a
            + da * trace_v
            + ex * hx
            + ey * hy
            + ez * hz
            + 0.5 * (wx * sx + wy * sy + wz * sz)
            - square * trace
            + 2.0 * (wx * nx + wy * ny + wz * nz)
        )
        # Rows: R by w s A^T; th by w axial(Q), by v (Q + Q^T) omega - 2 tr(Q) omega
        # + 2 axial(P_j(v)), by y s x f.
        for k in range(3):
            RW[p, k] = A[k, 0] * x + A[k, 1] * y + A[k, 2] * z
        RW[p, 3], RW[p, 4], RW[p, 5] = hx, hy, hz
        RV[p, 3] = sx - 2.0 * trace * wx + 2.0 * nx
        RV[p, 4] = sy - 2.0 * trace * wy + 2.0 * ny
        RV[p, 5] = sz - 2.0 * trace * wz + 2.0 * nz
        RY[p, 3], RY[p, 4], RY[p, 5] = y * fz - z * fy, z * fx - x * fz, x * fy - y * fx
    K, db, q, rate = model.K[b], model.beta[b], eq.y, eq.v
    force = eq.r[o + RIGID : o + RIGID + n]
    for k in range(n):
        shift, row = q[o + RIGID + k] + db * rate[o + RIGID + k], K[k]
        add_multiple(row[:n], shift, force)


@kernel
def elastic_pairs(model: ModelArrays, eq: Equations, work: Work, b: int, f: Vector) -> None:
    """Rows W : P_jk of work.pairs[0], B : P_jk and what geometric stiffness adds of work.pairs[1].

    W : P_jk is omega . axial(P_jk), and B : P_jk = alpha . axial(P_jk) + omega . P_jk omega
    - omega^2 tr(P_jk).
    """
    p, E = model.first[b] + ROTATION, model.pairs[b]
    wx, wy, wz = eq.v[p], eq.v[p + 1], eq.v[p + 2]
    ex, ey, ez = eq.w[p], eq.w[p + 1], eq.w[p + 2]
    xx, yy, zz = -wy * wy - wz * wz, -wx * wx - wz * wz, -wx * wx - wy * wy
    xy, xz, yz = wx * wy, wx * wz, wy * wz
    by_v, by_y = work.pairs[0], work.pairs[1]
    end = np.uintp(model.modes[b] * model.K.shape[1])
    X, Y, Z = E[0], E[1], E[2]
    for i in range(end):
        by_v[i] = wx * X[i] + wy * Y[i] + wz * Z[i]
    for i in range(end):
        by_y[i] = ex * X[i] + ey * Y[i] + ez * Z[i]
    X, Y, Z = E[3], E[4], E[5]
    for i in range(end):
        by_y[i] += xx * X[i] + yy * Y[i] + zz * Z[i]
    X, Y, Z = E[6], E[7], E[8]
    for i in range(end):
        by_y[i] += xy * X[i] + xz * Y[i] + yz * Z[i]
    if model.stiffened[b]:
        n, T, B = model.modes[b], model.stiffening[b], work.small[1]
        for j in range(n):
            for m in range(12):
                factor = B[m // 3, m % 3] if m < 9 else f[m - 9]
                for k in range(n):
                    by_y[j * model.K.shape[1] + k] += factor * T[m, j, k]


@kernel
def body_equations(
    model: ModelArrays, eq: Equations, work: Work, instant: int, b: int, cv: float
) -> None:
    """Forces r of one body, its block of r_w + cv r_v (eq.M) and of r_y (eq.Ky)."""
    body_blocks(model, eq, work, instant, b)
    o, n, size = model.first[b], model.modes[b], model.K.shape[1]
    RW, RV, RY, M, Ky = work.RW, work.RV, work.RY, eq.M, eq.Ky
    for i in range(RIGID + n):
        for j in range(RIGID + n if i < RIGID else RIGID):
            M[o + i, o + j] = RW[i, j] + cv * RV[i, j]
            Ky[o + i, o + j] = RY[i, j]
    if not n:
        return
    mass, stiff = 1.0 + cv * model.alpha[b], cv * model.beta[b]
    at, end = o + RIGID, np.uintp(n)
    for j in range(n):
        left, right = M[at + j, at : at + n], Ky[at + j, at : at + n]
        G, K = model.pairs[b, 9, j * size : j * size + n], model.K[b, j]
        by_v = work.pairs[0, j * size : j * size + n]
        by_y = work.pairs[1, j * size : j * size + n]
        for k in range(end):
            left[k] = mass * G[k] + stiff * K[k] + 2.0 * cv * by_v[k]
        for k in range(end):
            right[k] = by_y[k] + K[k]


@kernel
def body_pullback(model: ModelArrays, eq: Equations, work: Work, instant: int, b: int) -> None:
    """Subtract r_y^T adj from work.gather and r_v^T adj from eq.v_bar for one body."""
    o, n, size = model.first[b], model.modes[b], model.K.shape[1]
    for i in range(RIGID + n):
        work.line[i] = eq.r[o + i]
    body_blocks(model, eq, work, instant, b)
    for i in range(RIGID + n):
        eq.r[o + i] = work.line[i]
        x = eq.adjoint[o + i]
        for j in range(RIGID + n if i < RIGID else RIGID):
            work.gather[o + j] -= work.RY[i, j] * x
            eq.v_bar[o + j] -= work.RV[i, j] * x
    da, db, at, end = model.alpha[b], model.beta[b], o + RIGID, np.uintp(n)
    by_q, by_rate = work.gather[at : at + n], eq.v_bar[at : at + n]
    for j in range(n):
        x = eq.adjoint[at + j]
        G, K = model.pairs[b, 9, j * size : j * size + n], model.K[b, j]
        by_v = work.pairs[0, j * size : j * size + n]
        by_y = work.pairs[1, j * size : j * size + n]
        for k in range(end):
            by_q[k] -= x * (by_y[k] + K[k])
        for k in range(end):
            by_rate[k] -= x * (2.0 * by_v[k] + da * G[k] + db * K[k])
