# SPDX-License-Identifier: MIT
"""Equations of motion of one planar body, their Jacobians and their transpose.

With J the rotation by a quarter turn, A = A(theta), qh = (1, q), S(q) = sum_a qh_a S_a,
S(v) = sum_j v_j S_j, accelerations (a_R, alpha, a) with gravity taken off a_R, and

    b = alpha J S(q) + S(a) - omega^2 S(q) + 2 omega J S(v),

the inertia, elastic and damping forces are

    r_R     = m a_R + A b
    r_theta = (A J S(q)) . a_R + alpha qh . G qh + qh . N a + 2 omega qh . G v
    r_qj    = (A S_j) . a_R + alpha (qh N)_j + (G a)_j - omega^2 (G qh)_j + 2 omega (v N)_j
              + (K q)_j + d_M (G v)_j + d_K (K v)_j

with d_M and d_K the coefficients of Rayleigh damping (R. Seifried, Dynamics of Underactuated
Multibody Systems, Springer 2014, doi:10.1007/978-3-319-01228-5). A body with geometric stiffness
has further shape functions whose coordinates follow q, see carried.py; to first order in q they
add to r_qj, with f = A^T a_R,

    omega^2 (K_w q)_j + alpha (K_al q)_j + f_x (K_x q)_j + f_y (K_y q)_j.
"""

from __future__ import annotations

import math

import numpy as np

from ..compilation import Matrix, Vector, kernel
from ..equations import Equations
from .algebra import add_multiple
from .arrays import (
    G_ONE,
    G_RATE,
    G_SECOND,
    N_ONE,
    N_RATE,
    N_SECOND,
    ONE,
    RATE,
    SECOND,
    Arrays,
    Work,
)
from .carried import carry

#: Place of the rotation among the coordinates of a body, and number of its rigid coordinates.
ROTATION, RIGID = 2, 3


@kernel
def swing(omega: Vector, x: Vector, out: Vector) -> None:
    """Set out to omega x x, with omega (1,) about the axis z."""
    out[0], out[1] = -omega[0] * x[1], omega[0] * x[0]


@kernel
def torque(x: Vector, f: Vector, out: Vector) -> None:
    """Set out to x x f, its component (1,) along z."""
    out[0] = x[0] * f[1] - x[1] * f[0]


@kernel
def add_torque(x: Vector, f: Vector, factor: float, out: Vector) -> None:
    """Add factor times x x f to out."""
    out[0] += factor * (x[0] * f[1] - x[1] * f[0])


@kernel
def add_combination(B: Matrix, x: Vector, out: Vector) -> None:
    """Add x . B to out."""
    row_x, row_y, p, q = B[0], B[1], x[0], x[1]
    # Unsigned bounds let the compiler vectorise, see integration/linear.py.
    for j in range(np.uintp(out.size)):
        out[j] += row_x[j] * p + row_y[j] * q


@kernel
def place_body(model: Arrays, eq: Equations, work: Work, b: int) -> None:
    """Rotation of one body."""
    angle, A = eq.y[model.first[b] + ROTATION], work.A[b]
    c, s = math.cos(angle), math.sin(angle)
    A[0, 0], A[0, 1], A[1, 0], A[1, 1] = c, -s, s, c


@kernel
def measure_body(model: Arrays, eq: Equations, b: int) -> float:
    """Add the sizes of y - reference and v by the mass of a rigid body; angle of its turn."""
    sizes, y, v, reference, o = eq.sizes, eq.y, eq.v, eq.reference, model.first[b]
    for p in range(RIGID):
        mass = model.G[b, 0, 0] if p == ROTATION else model.mass[b]
        sizes[0] += mass * (y[o + p] - reference[o + p]) ** 2
        sizes[1] += mass * v[o + p] ** 2
    return abs(y[o + ROTATION] - reference[o + ROTATION])


@kernel
def body_products(model: Arrays, eq: Equations, work: Work, b: int) -> None:
    """Rows 0-8 of work.products: qh, vh, ah, G qh, G vh, G ah, N qh, N vh, N ah of one body."""
    y, v, w = eq.y, eq.v, eq.w
    o, n, fields = model.first[b], model.modes[b], model.fields[b]
    G, N, t = model.G[b], model.N[b], work.products
    t[ONE, 0], t[RATE, 0], t[SECOND, 0] = 1.0, 0.0, 0.0
    for j in range(n):
        t[ONE, j + 1] = y[o + RIGID + j]
        t[RATE, j + 1] = v[o + RIGID + j]
        t[SECOND, j + 1] = w[o + RIGID + j]
    if model.stiffened[b]:
        moved, e = work.moved, o + RIGID
        carry(model.carried[b], y[e:], v[e:], w[e:], n, moved, work.slopes)
        for j in range(fields - n):
            for i in range(3):
                t[i, n + 1 + j] = moved[i, j]
    for j in range(fields + 1):
        for i in range(3, 9):
            t[i, j] = 0.0
    for k in range(fields + 1):
        q, d, a = t[ONE, k], t[RATE, k], t[SECOND, k]
        for j in range(fields + 1):  # G symmetric, N antisymmetric: rows serve as columns
            t[G_ONE, j] += G[k, j] * q
            t[G_RATE, j] += G[k, j] * d
            t[G_SECOND, j] += G[k, j] * a
            t[N_ONE, j] -= N[k, j] * q
            t[N_RATE, j] -= N[k, j] * d
            t[N_SECOND, j] -= N[k, j] * a


@kernel
def body_forces(
    model: Arrays,
    eq: Equations,
    work: Work,
    instant: int,
    b: int,
    cw: float,
    cv: float,
    o: int,
    r: Vector,
    M: Matrix,
    Ky: Matrix,
) -> None:
    """Forces of one body whose fields all have coordinates, its blocks cw r_w + cv r_v and r_y.

    They go to r, M and Ky from place o on. The products of the body must be there.
    """
    begin, n = model.first[b], model.fields[b]
    S, G, N, K, t = model.S[b], model.G[b], model.N[b], model.K[b], work.products
    mass, da, db = model.mass[b], model.alpha[b], model.beta[b]
    c, s = work.A[b, 0, 0], work.A[b, 1, 0]
    qx = qy = vx = vy = ax = ay = qgq = qgv = qna = 0.0
    for j in range(n + 1):
        qx += S[j, 0] * t[ONE, j]
        qy += S[j, 1] * t[ONE, j]
        vx += S[j, 0] * t[RATE, j]
        vy += S[j, 1] * t[RATE, j]
        ax += S[j, 0] * t[SECOND, j]
        ay += S[j, 1] * t[SECOND, j]
        qgv += t[ONE, j] * t[G_RATE, j]
        qgq += t[ONE, j] * t[G_ONE, j]
        qna += t[ONE, j] * t[N_SECOND, j]
    omega, eps = eq.v[begin + ROTATION], eq.w[begin + ROTATION]
    gx = eq.w[begin] - model.gravity[instant, 0]
    gy = eq.w[begin + 1] - model.gravity[instant, 1]
    fx, fy = c * gx + s * gy, c * gy - s * gx  # in the body's axes
    bx = ax - eps * qy - omega * omega * qx - 2.0 * omega * vy
    by = ay + eps * qx - omega * omega * qy + 2.0 * omega * vx
    r[o] = mass * gx + c * bx - s * by
    r[o + 1] = mass * gy + s * bx + c * by
    r[o + ROTATION] = qx * fy - qy * fx + eps * qgq + qna + 2.0 * omega * qgv
    M[o, o] = M[o + 1, o + 1] = cw * mass
    M[o, o + 1] = M[o + 1, o] = 0.0
    ex = -cw * qy - 2.0 * cv * (omega * qx + vy)
    ey = cw * qx - 2.0 * cv * (omega * qy - vx)
    M[o, o + ROTATION], M[o + 1, o + ROTATION] = c * ex - s * ey, s * ex + c * ey
    M[o + ROTATION, o], M[o + ROTATION, o + 1] = cw * (-c * qy - s * qx), cw * (c * qx - s * qy)
    M[o + ROTATION, o + ROTATION] = cw * qgq + 2.0 * cv * qgv
    Ky[o, o + ROTATION], Ky[o + 1, o + ROTATION] = -s * bx - c * by, c * bx - s * by
    Ky[o + ROTATION, o + ROTATION] = -qx * fx - qy * fy
    turn = 2.0 * cv * omega
    for j in range(n):
        i = o + RIGID + j
        sx, sy = S[j + 1, 0], S[j + 1, 1]
        px, py = c * sx - s * sy, s * sx + c * sy
        gq, gv, nq, nv = t[G_ONE, j + 1], t[G_RATE, j + 1], t[N_ONE, j + 1], t[N_RATE, j + 1]
        lever = sx * fy - sy * fx
        r[i] = sx * fx + sy * fy + t[G_SECOND, j + 1] - omega * omega * gq + da * gv
        r[i] -= eps * nq + 2.0 * omega * nv
        M[o, i], M[o + 1, i] = cw * px - turn * py, cw * py + turn * px
        M[i, o], M[i, o + 1] = cw * px, cw * py
        M[o + ROTATION, i] = turn * gq - cw * nq
        M[i, o + ROTATION] = -cw * nq - turn * gq - 2.0 * cv * nv
        Ky[o, i] = -eps * py - omega * omega * px
        Ky[o + 1, i] = eps * px - omega * omega * py
        Ky[o + ROTATION, i] = lever + 2.0 * eps * gq + t[N_SECOND, j + 1] + 2.0 * omega * gv
        Ky[i, o + ROTATION] = lever
    # Unsigned bounds let the compiler vectorise, see integration/linear.py.
    e, end, force = o + RIGID, np.uintp(n), r[o + RIGID : o + RIGID + n]
    inertia, drag, square = cw + cv * da, cv * db, omega * omega
    for j in range(n):
        add_multiple(K[j, :n], t[ONE, j + 1] + db * t[RATE, j + 1], force)
        mass_row, stiffness_row = M[e + j, e : e + n], Ky[e + j, e : e + n]
        symmetric, side, stiff = G[j + 1, 1 : n + 1], N[j + 1, 1 : n + 1], K[j]
        for k in range(end):
            mass_row[k] = inertia * symmetric[k] + drag * stiff[k] - turn * side[k]
            stiffness_row[k] = stiff[k] - square * symmetric[k] - eps * side[k]


@kernel
def body_equations(
    model: Arrays, eq: Equations, work: Work, instant: int, b: int, cv: float
) -> None:
    """Forces r of one body, its block of r_w + cv r_v (eq.M) and of r_y (eq.Ky)."""
    body_products(model, eq, work, b)
    body_forces(model, eq, work, instant, b, 1.0, cv, model.first[b], eq.r, eq.M, eq.Ky)


@kernel
def body_blocks(model: Arrays, eq: Equations, work: Work, instant: int, b: int) -> None:
    """Forces of a body whose fields all have coordinates, and their derivatives by w, v and y."""
    r, RW, RV, RY = work.force, work.RW, work.RV, work.RY
    body_products(model, eq, work, b)
    body_forces(model, eq, work, instant, b, 0.0, 1.0, 0, r, RV, RY)
    body_forces(model, eq, work, instant, b, 1.0, 0.0, 0, r, RW, RY)


@kernel
def body_slopes(model: Arrays, eq: Equations, work: Work, instant: int, b: int) -> None:
    """Derivatives of the same forces by v and y."""
    body_products(model, eq, work, b)
    body_forces(model, eq, work, instant, b, 0.0, 1.0, 0, work.force, work.RV, work.RY)
