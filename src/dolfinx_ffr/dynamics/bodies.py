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

from .arrays import Array, ModelArrays, Work, kernel


@kernel
def body_products(model: ModelArrays, b: int, y: Array, v: Array, w: Array, work: Work) -> None:
    """Rows 0-8 of work.v6: qh, vh, ah, G qh, G vh, G ah, N qh, N vh, N ah of one body."""
    o, n = model.first[b], model.modes[b]
    G, N, t = model.G[b], model.N[b], work.v6
    t[0, 0], t[1, 0], t[2, 0] = 1.0, 0.0, 0.0
    for j in range(n):
        t[0, j + 1] = y[o + 3 + j]
        t[1, j + 1] = v[o + 3 + j]
        t[2, j + 1] = w[o + 3 + j]
    for j in range(n + 1):
        for i in range(3, 9):
            t[i, j] = 0.0
    for k in range(n + 1):
        q, d, a = t[0, k], t[1, k], t[2, k]
        for j in range(n + 1):  # G symmetric, N antisymmetric: rows serve as columns
            t[3, j] += G[k, j] * q
            t[4, j] += G[k, j] * d
            t[5, j] += G[k, j] * a
            t[6, j] -= N[k, j] * q
            t[7, j] -= N[k, j] * d
            t[8, j] -= N[k, j] * a


@kernel
def body_equations(
    model: ModelArrays,
    instant: int,
    b: int,
    y: Array,
    v: Array,
    w: Array,
    cv: float,
    work: Work,
) -> None:
    """Forces r of one body, its block of r_w + cv r_v (work.M) and of r_y (work.Ky)."""
    o, n = model.first[b], model.modes[b]
    S, G, N, K = model.S[b], model.G[b], model.N[b], model.K[b]
    M, Ky, r, t = work.M, work.Ky, work.r, work.v6
    mass, da, db = model.mass[b], model.alpha[b], model.beta[b]
    body_products(model, b, y, v, w, work)
    c, s = work.rotation[b, 0], work.rotation[b, 1]
    qx = qy = vx = vy = ax = ay = qgq = qgv = qna = 0.0
    for j in range(n + 1):
        qx += S[j, 0] * t[0, j]
        qy += S[j, 1] * t[0, j]
        vx += S[j, 0] * t[1, j]
        vy += S[j, 1] * t[1, j]
        ax += S[j, 0] * t[2, j]
        ay += S[j, 1] * t[2, j]
        qgq += t[0, j] * t[3, j]
        qgv += t[0, j] * t[4, j]
        qna += t[0, j] * t[8, j]
    omega, eps = v[o + 2], w[o + 2]
    gx, gy = w[o] - model.gravity[instant, 0], w[o + 1] - model.gravity[instant, 1]
    fx, fy = c * gx + s * gy, c * gy - s * gx  # in the body's axes
    bx = ax - eps * qy - omega * omega * qx - 2.0 * omega * vy
    by = ay + eps * qx - omega * omega * qy + 2.0 * omega * vx
    r[o] = mass * gx + c * bx - s * by
    r[o + 1] = mass * gy + s * bx + c * by
    r[o + 2] = qx * fy - qy * fx + eps * qgq + qna + 2.0 * omega * qgv
    M[o, o] = M[o + 1, o + 1] = mass
    M[o, o + 1] = M[o + 1, o] = 0.0
    ex = -qy - 2.0 * cv * (omega * qx + vy)
    ey = qx - 2.0 * cv * (omega * qy - vx)
    M[o, o + 2], M[o + 1, o + 2] = c * ex - s * ey, s * ex + c * ey
    M[o + 2, o], M[o + 2, o + 1] = -c * qy - s * qx, c * qx - s * qy
    M[o + 2, o + 2] = qgq + 2.0 * cv * qgv
    Ky[o, o + 2], Ky[o + 1, o + 2] = -s * bx - c * by, c * bx - s * by
    Ky[o + 2, o + 2] = -qx * fx - qy * fy
    turn = 2.0 * cv * omega
    for j in range(n):
        i = o + 3 + j
        sx, sy = S[j + 1, 0], S[j + 1, 1]
        px, py = c * sx - s * sy, s * sx + c * sy
        gq, gv, nq, nv = t[3, j + 1], t[4, j + 1], t[6, j + 1], t[7, j + 1]
        lever = sx * fy - sy * fx
        r[i] = sx * fx + sy * fy + t[5, j + 1] - omega * omega * gq + da * gv
        r[i] -= eps * nq + 2.0 * omega * nv
        M[o, i], M[o + 1, i] = px - turn * py, py + turn * px
        M[i, o], M[i, o + 1] = px, py
        M[o + 2, i] = turn * gq - nq
        M[i, o + 2] = -nq - turn * gq - 2.0 * cv * nv
        Ky[o, i] = -eps * py - omega * omega * px
        Ky[o + 1, i] = eps * px - omega * omega * py
        Ky[o + 2, i] = lever + 2.0 * eps * gq + t[8, j + 1] + 2.0 * omega * gv
        Ky[i, o + 2] = lever
    for j in range(n):
        i = o + 3 + j
        for k in range(n):
            r[i] += K[j, k] * (y[o + 3 + k] + db * v[o + 3 + k])
    for j in range(n):
        i = o + 3 + j
        for k in range(n):
            M[i, o + 3 + k] = (
                (1.0 + cv * da) * G[j + 1, k + 1] + cv * db * K[j, k] - turn * N[j + 1, k + 1]
            )
            Ky[i, o + 3 + k] = K[j, k] - omega * omega * G[j + 1, k + 1] - eps * N[j + 1, k + 1]
    if model.stiffened[b]:
        add_stiffening(model, b, y, omega, eps, fx, fy, cv, work)


@kernel
def add_stiffening(
    model: ModelArrays,
    b: int,
    y: Array,
    omega: float,
    eps: float,
    fx: float,
    fy: float,
    cv: float,
    work: Work,
) -> None:
    """Add the share of geometric stiffness; (fx, fy) is the acceleration in the body's axes."""
    o, n, T = model.first[b], model.modes[b], model.stiffening[b]
    c, s = work.rotation[b, 0], work.rotation[b, 1]
    M, Ky, r = work.M, work.Ky, work.r
    for j in range(n):
        i = o + 3 + j
        spun = swung = pulled = lifted = 0.0
        for k in range(n):
            q = y[o + 3 + k]
            spun += T[0, j, k] * q
            swung += T[1, j, k] * q
            pulled += T[2, j, k] * q
            lifted += T[3, j, k] * q
            Ky[i, o + 3 + k] += (
                omega * omega * T[0, j, k] + eps * T[1, j, k] + fx * T[2, j, k] + fy * T[3, j, k]
            )
        r[i] += omega * omega * spun + eps * swung + fx * pulled + fy * lifted
        M[i, o] += c * pulled - s * lifted
        M[i, o + 1] += s * pulled + c * lifted
        M[i, o + 2] += swung + 2.0 * cv * omega * spun
        Ky[i, o + 2] += fy * pulled - fx * lifted


@kernel
def body_pullback(
    model: ModelArrays,
    instant: int,
    b: int,
    y: Array,
    v: Array,
    w: Array,
    x: Array,
    work: Work,
    y_bar: Array,
    v_bar: Array,
) -> None:
    """Subtract r_y^T x from y_bar and r_v^T x from v_bar for one body."""
    o, n = model.first[b], model.modes[b]
    S, K, t = model.S[b], model.K[b], work.v6
    # The products with x take the place of those with v, whose own are gathered in the sums below.
    body_products(model, b, y, v, w, work)
    c, s = work.rotation[b, 0], work.rotation[b, 1]
    da, db = model.alpha[b], model.beta[b]
    omega, eps, spin = v[o + 2], w[o + 2], x[o + 2]
    gx, gy = w[o] - model.gravity[instant, 0], w[o + 1] - model.gravity[instant, 1]
    fx, fy = c * gx + s * gy, c * gy - s * gx
    mx, my = c * x[o] + s * x[o + 1], c * x[o + 1] - s * x[o]
    qx = qy = vx = vy = ax = ay = lx = ly = qgv = qgx = vnx = 0.0
    for j in range(n + 1):
        qx += S[j, 0] * t[0, j]
        qy += S[j, 1] * t[0, j]
        vx += S[j, 0] * t[1, j]
        vy += S[j, 1] * t[1, j]
        ax += S[j, 0] * t[2, j]
        ay += S[j, 1] * t[2, j]
        qgv += t[0, j] * t[4, j]
    for j in range(n):
        xj = x[o + 3 + j]
        lx += S[j + 1, 0] * xj
        ly += S[j + 1, 1] * xj
        qgx += t[3, j + 1] * xj
        vnx -= t[7, j + 1] * xj
    y_bar[o + 2] -= (
        -eps * (qx * mx + qy * my)
        - omega * omega * (qx * my - qy * mx)
        - spin * (qx * fx + qy * fy)
        + ax * my
        - ay * mx
        - 2.0 * omega * (vx * mx + vy * my)
        + lx * fy
        - ly * fx
    )
    v_bar[o + 2] -= (
        -2.0 * omega * (qx * mx + qy * my)
        + 2.0 * (vx * my - vy * mx)
        + 2.0 * spin * qgv
        - 2.0 * omega * qgx
        + 2.0 * vnx
    )
    for j in range(n):
        i = o + 3 + j
        sx, sy = S[j + 1, 0], S[j + 1, 1]
        side = sx * my - sy * mx  # S_j . J^T x in the body's axes
        dy = eps * side - omega * omega * (sx * mx + sy * my) + spin * (sx * fy - sy * fx)
        dv = 2.0 * omega * side
        gx_, nx_, kx_ = 0.0, 0.0, 0.0
        for k in range(n):
            xk = x[o + 3 + k]
            gx_ += model.G[b, j + 1, k + 1] * xk
            nx_ += model.N[b, j + 1, k + 1] * xk
            kx_ += K[j, k] * xk
        dy += 2.0 * spin * (eps * t[3, j + 1] + omega * t[4, j + 1]) - omega * omega * gx_
        dy += spin * t[8, j + 1] + eps * nx_ + kx_
        dv += 2.0 * omega * (spin * t[3, j + 1] + nx_) + da * gx_ + db * kx_
        y_bar[i] -= dy
        v_bar[i] -= dv
    if model.stiffened[b]:
        stiffening_pullback(model, b, y, omega, eps, fx, fy, x, y_bar, v_bar)


@kernel
def stiffening_pullback(
    model: ModelArrays,
    b: int,
    y: Array,
    omega: float,
    eps: float,
    fx: float,
    fy: float,
    x: Array,
    y_bar: Array,
    v_bar: Array,
) -> None:
    """Share of geometric stiffness in body_pullback."""
    o, n, T = model.first[b], model.modes[b], model.stiffening[b]
    for j in range(n):
        spun = swung = pulled = lifted = 0.0
        for k in range(n):
            xk = x[o + 3 + k]
            spun += T[0, j, k] * xk
            swung += T[1, j, k] * xk
            pulled += T[2, j, k] * xk
            lifted += T[3, j, k] * xk
        q = y[o + 3 + j]
        y_bar[o + 3 + j] -= omega * omega * spun + eps * swung + fx * pulled + fy * lifted
        y_bar[o + 2] -= q * (fy * pulled - fx * lifted)
        v_bar[o + 2] -= 2.0 * omega * q * spun
