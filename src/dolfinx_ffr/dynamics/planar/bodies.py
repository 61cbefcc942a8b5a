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

    b_j     = omega^2 (K_w q)_j + alpha (K_al q)_j + f_x (K_x q)_j + f_y (K_y q)_j

where b_j is added to r_qj of a body with geometric stiffness, f = A^T a_R,
and with d_M and d_K the coefficients of Rayleigh damping (R. Seifried, Dynamics of Underactuated
Multibody Systems, Springer 2014, doi:10.1007/978-3-319-01228-5).
"""

from __future__ import annotations

from ..compilation import kernel
from ..equations import Equations
from .arrays import (
    G_ONE,
    G_RATE,
    G_SECOND,
    N_ONE,
    N_RATE,
    N_SECOND,
    ONE,
    RATE,
    RIGID,
    ROTATION,
    SECOND,
    ModelArrays,
    Work,
)


@kernel
def body_products(model: ModelArrays, eq: Equations, work: Work, b: int) -> None:
    """Rows 0-8 of work.products: qh, vh, ah, G qh, G vh, G ah, N qh, N vh, N ah of one body."""
    y, v, w = eq.y, eq.v, eq.w
    o, n = model.first[b], model.modes[b]
    G, N, t = model.G[b], model.N[b], work.products
    t[ONE, 0], t[RATE, 0], t[SECOND, 0] = 1.0, 0.0, 0.0
    for j in range(n):
        t[ONE, j + 1] = y[o + RIGID + j]
        t[RATE, j + 1] = v[o + RIGID + j]
        t[SECOND, j + 1] = w[o + RIGID + j]
    for j in range(n + 1):
        for i in range(3, 9):
            t[i, j] = 0.0
    for k in range(n + 1):
        q, d, a = t[ONE, k], t[RATE, k], t[SECOND, k]
        for j in range(n + 1):  # G symmetric, N antisymmetric: rows serve as columns
            t[G_ONE, j] += G[k, j] * q
            t[G_RATE, j] += G[k, j] * d
            t[G_SECOND, j] += G[k, j] * a
            t[N_ONE, j] -= N[k, j] * q
            t[N_RATE, j] -= N[k, j] * d
            t[N_SECOND, j] -= N[k, j] * a


@kernel
def body_equations(
    model: ModelArrays, eq: Equations, work: Work, instant: int, b: int, cv: float
) -> None:
    """Forces r of one body, its block of r_w + cv r_v (eq.M) and of r_y (eq.Ky)."""
    y, v, w = eq.y, eq.v, eq.w
    o, n = model.first[b], model.modes[b]
    S, G, N, K = model.S[b], model.G[b], model.N[b], model.K[b]
    M, Ky, r, t = eq.M, eq.Ky, eq.r, work.products
    mass, da, db = model.mass[b], model.alpha[b], model.beta[b]
    body_products(model, eq, work, b)
    c, s = work.rotation[b, 0], work.rotation[b, 1]
    qx = qy = vx = vy = ax = ay = qgq = qgv = qna = 0.0
    for j in range(n + 1):
        qx += S[j, 0] * t[ONE, j]
        qy += S[j, 1] * t[ONE, j]
        vx += S[j, 0] * t[RATE, j]
        vy += S[j, 1] * t[RATE, j]
        ax += S[j, 0] * t[SECOND, j]
        ay += S[j, 1] * t[SECOND, j]
        qgq += t[ONE, j] * t[G_ONE, j]
        qgv += t[ONE, j] * t[G_RATE, j]
        qna += t[ONE, j] * t[N_SECOND, j]
    omega, eps = v[o + ROTATION], w[o + ROTATION]
    gx, gy = w[o] - model.gravity[instant, 0], w[o + 1] - model.gravity[instant, 1]
    fx, fy = c * gx + s * gy, c * gy - s * gx  # in the body's axes
    bx = ax - eps * qy - omega * omega * qx - 2.0 * omega * vy
    by = ay + eps * qx - omega * omega * qy + 2.0 * omega * vx
    r[o] = mass * gx + c * bx - s * by
    r[o + 1] = mass * gy + s * bx + c * by
    r[o + ROTATION] = qx * fy - qy * fx + eps * qgq + qna + 2.0 * omega * qgv
    M[o, o] = M[o + 1, o + 1] = mass
    M[o, o + 1] = M[o + 1, o] = 0.0
    ex = -qy - 2.0 * cv * (omega * qx + vy)
    ey = qx - 2.0 * cv * (omega * qy - vx)
    M[o, o + ROTATION], M[o + 1, o + ROTATION] = c * ex - s * ey, s * ex + c * ey
    M[o + ROTATION, o], M[o + ROTATION, o + 1] = -c * qy - s * qx, c * qx - s * qy
    M[o + ROTATION, o + ROTATION] = qgq + 2.0 * cv * qgv
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
        M[o, i], M[o + 1, i] = px - turn * py, py + turn * px
        M[i, o], M[i, o + 1] = px, py
        M[o + ROTATION, i] = turn * gq - nq
        M[i, o + ROTATION] = -nq - turn * gq - 2.0 * cv * nv
        Ky[o, i] = -eps * py - omega * omega * px
        Ky[o + 1, i] = eps * px - omega * omega * py
        Ky[o + ROTATION, i] = lever + 2.0 * eps * gq + t[N_SECOND, j + 1] + 2.0 * omega * gv
        Ky[i, o + ROTATION] = lever
    for j in range(n):
        i = o + RIGID + j
        for k in range(n):
            r[i] += K[j, k] * (y[o + RIGID + k] + db * v[o + RIGID + k])
    for j in range(n):
        i = o + RIGID + j
        for k in range(n):
            M[i, o + RIGID + k] = (
                (1.0 + cv * da) * G[j + 1, k + 1] + cv * db * K[j, k] - turn * N[j + 1, k + 1]
            )
            Ky[i, o + RIGID + k] = K[j, k] - omega * omega * G[j + 1, k + 1] - eps * N[j + 1, k + 1]
    if model.stiffened[b]:
        add_stiffening(model, eq, work, b, fx, fy, cv)


@kernel
def add_stiffening(
    model: ModelArrays, eq: Equations, work: Work, b: int, fx: float, fy: float, cv: float
) -> None:
    """Add the share of geometric stiffness; (fx, fy) is the acceleration in the body's axes."""
    y, omega, eps = eq.y, eq.v[model.first[b] + ROTATION], eq.w[model.first[b] + ROTATION]
    o, n, T = model.first[b], model.modes[b], model.stiffening[b]
    c, s = work.rotation[b, 0], work.rotation[b, 1]
    M, Ky, r = eq.M, eq.Ky, eq.r
    for j in range(n):
        i = o + RIGID + j
        spun = swung = pulled = lifted = 0.0
        for k in range(n):
            q = y[o + RIGID + k]
            spun += T[0, j, k] * q
            swung += T[1, j, k] * q
            pulled += T[2, j, k] * q
            lifted += T[3, j, k] * q
            Ky[i, o + RIGID + k] += (
                omega * omega * T[0, j, k] + eps * T[1, j, k] + fx * T[2, j, k] + fy * T[3, j, k]
            )
        r[i] += omega * omega * spun + eps * swung + fx * pulled + fy * lifted
        M[i, o] += c * pulled - s * lifted
        M[i, o + 1] += s * pulled + c * lifted
        M[i, o + ROTATION] += swung + 2.0 * cv * omega * spun
        Ky[i, o + ROTATION] += fy * pulled - fx * lifted


@kernel
def body_pullback(model: ModelArrays, eq: Equations, work: Work, instant: int, b: int) -> None:
    """Subtract r_y^T adj from y_bar and r_v^T adj from v_bar for one body, adj = eq.adjoint."""
    v, w, adj, y_bar, v_bar = eq.v, eq.w, eq.adjoint, eq.y_bar, eq.v_bar
    o, n = model.first[b], model.modes[b]
    S, K, t = model.S[b], model.K[b], work.products
    body_products(model, eq, work, b)
    c, s = work.rotation[b, 0], work.rotation[b, 1]
    da, db = model.alpha[b], model.beta[b]
    omega, eps, spin = v[o + ROTATION], w[o + ROTATION], adj[o + ROTATION]
    gx, gy = w[o] - model.gravity[instant, 0], w[o + 1] - model.gravity[instant, 1]
    fx, fy = c * gx + s * gy, c * gy - s * gx
    mx, my = c * adj[o] + s * adj[o + 1], c * adj[o + 1] - s * adj[o]
    qx = qy = vx = vy = ax = ay = lx = ly = qgv = qgx = vnx = 0.0
    for j in range(n + 1):
        qx += S[j, 0] * t[ONE, j]
        qy += S[j, 1] * t[ONE, j]
        vx += S[j, 0] * t[RATE, j]
        vy += S[j, 1] * t[RATE, j]
        ax += S[j, 0] * t[SECOND, j]
        ay += S[j, 1] * t[SECOND, j]
        qgv += t[ONE, j] * t[G_RATE, j]
    for j in range(n):
        xj = adj[o + RIGID + j]
        lx += S[j + 1, 0] * xj
        ly += S[j + 1, 1] * xj
        qgx += t[G_ONE, j + 1] * xj
        vnx -= t[N_RATE, j + 1] * xj
    y_bar[o + ROTATION] -= (
        -eps * (qx * mx + qy * my)
        - omega * omega * (qx * my - qy * mx)
        - spin * (qx * fx + qy * fy)
        + ax * my
        - ay * mx
        - 2.0 * omega * (vx * mx + vy * my)
        + lx * fy
        - ly * fx
    )
    v_bar[o + ROTATION] -= (
        -2.0 * omega * (qx * mx + qy * my)
        + 2.0 * (vx * my - vy * mx)
        + 2.0 * spin * qgv
        - 2.0 * omega * qgx
        + 2.0 * vnx
    )
    for j in range(n):
        i = o + RIGID + j
        sx, sy = S[j + 1, 0], S[j + 1, 1]
        side = sx * my - sy * mx  # S_j . J^T adj in the body's axes
        dy = eps * side - omega * omega * (sx * mx + sy * my) + spin * (sx * fy - sy * fx)
        dv = 2.0 * omega * side
        gx_, nx_, kx_ = 0.0, 0.0, 0.0
        for k in range(n):
            xk = adj[o + RIGID + k]
            gx_ += model.G[b, j + 1, k + 1] * xk
            nx_ += model.N[b, j + 1, k + 1] * xk
            kx_ += K[j, k] * xk
        dy += 2.0 * spin * (eps * t[G_ONE, j + 1] + omega * t[G_RATE, j + 1]) - omega * omega * gx_
        dy += spin * t[N_SECOND, j + 1] + eps * nx_ + kx_
        dv += 2.0 * omega * (spin * t[G_ONE, j + 1] + nx_) + da * gx_ + db * kx_
        y_bar[i] -= dy
        v_bar[i] -= dv
    if model.stiffened[b]:
        stiffening_pullback(model, eq, work, b, fx, fy)


@kernel
def stiffening_pullback(
    model: ModelArrays, eq: Equations, work: Work, b: int, fx: float, fy: float
) -> None:
    """Share of geometric stiffness in body_pullback."""
    y, adj, y_bar, v_bar = eq.y, eq.adjoint, eq.y_bar, eq.v_bar
    omega, eps = eq.v[model.first[b] + ROTATION], eq.w[model.first[b] + ROTATION]
    o, n, T = model.first[b], model.modes[b], model.stiffening[b]
    for j in range(n):
        spun = swung = pulled = lifted = 0.0
        for k in range(n):
            xk = adj[o + RIGID + k]
            spun += T[0, j, k] * xk
            swung += T[1, j, k] * xk
            pulled += T[2, j, k] * xk
            lifted += T[3, j, k] * xk
        q = y[o + RIGID + j]
        y_bar[o + RIGID + j] -= omega * omega * spun + eps * swung + fx * pulled + fy * lifted
        y_bar[o + ROTATION] -= q * (fy * pulled - fx * lifted)
        v_bar[o + ROTATION] -= 2.0 * omega * q * spun
