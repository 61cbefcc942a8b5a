# SPDX-License-Identifier: MIT
"""Markers and constraint rows: values, Jacobians, curvature terms and transposes.

A constraint is a scalar row

    g(z_a, z_b) - c(t) = 0

of the coordinates z = (x, y, angle) of two markers. A new kind of joint needs no more than the
value of g and its first three derivatives in z (``row_gradient``, ``row_hessian``, ``row_third``);
the chain from the coordinates of the bodies to the markers, and its transpose, are shared.

For a marker of a flexible body with shape functions W (reference position first) and psi,

    (x, y) = R + A(theta) W (1, q),      angle = theta + psi q.

A marker with geometric stiffness T moves by -1/2 A (q . T_x q, q . T_y q) as well, and a force f
on it does the work of  P_j = A (W_j - T_j q)  per q_j. With P in place of A W all first
derivatives keep their form; the second ones gain

    d2 (x, y) / dq_j dq_k = -A T_jk.
"""

from __future__ import annotations

import numpy as np

from .arrays import DISTANCE, LINE, Array, ModelArrays, Work, kernel, stiffened_kernel


@stiffened_kernel
def bend_marker(model: ModelArrays, m: int, y: Array, v: Array, work: Work) -> None:
    """Add the share of geometric stiffness to place and motion of a marker; keep its A T v."""
    b, t = model.marker_body[m], model.bent[0][m]
    if t >= 0:
        o, n = model.first[b], model.modes[b]
        c, s = work.rotation[b, 0], work.rotation[b, 1]
        ax = ay = vx = vy = 0.0
        for j in range(n):
            qx = qy = dx = dy = 0.0
            for k in range(n):
                qx += model.bent[1][t, 0, j, k] * y[o + 3 + k]
                qy += model.bent[1][t, 1, j, k] * y[o + 3 + k]
                dx += model.bent[1][t, 0, j, k] * v[o + 3 + k]
                dy += model.bent[1][t, 1, j, k] * v[o + 3 + k]
            px, py = c * qx - s * qy, s * qx + c * qy
            work.P[m, 0, j] -= px
            work.P[m, 1, j] -= py
            ax -= 0.5 * px * y[o + 3 + j]
            ay -= 0.5 * py * y[o + 3 + j]
            vx -= px * v[o + 3 + j]
            vy -= py * v[o + 3 + j]
            work.bend[m, 0, j] = c * dx - s * dy
            work.bend[m, 1, j] = s * dx + c * dy
        work.arm[m, 0] += ax
        work.arm[m, 1] += ay
        work.swing[m, 0] += vx
        work.swing[m, 1] += vy
        work.z[m, 0] += ax
        work.z[m, 1] += ay
        work.zd[m, 0] += vx - v[o + 2] * ay
        work.zd[m, 1] += vy + v[o + 2] * ax


@stiffened_kernel
def subtract_bend(model: ModelArrays, m: int, x: Array, work: Work, out: Array, at: int) -> None:
    """Subtract A (x . T v), where a marker has geometric stiffness, from out[at:at+2]."""
    if model.bent[0][m] >= 0:
        o = model.first[model.marker_body[m]]
        for j in range(model.modes[model.marker_body[m]]):
            out[at] -= work.bend[m, 0, j] * x[o + 3 + j]
            out[at + 1] -= work.bend[m, 1, j] * x[o + 3 + j]


@stiffened_kernel
def pull_bend(model: ModelArrays, m: int, fx: float, fy: float, work: Work, out: Array) -> None:
    """Subtract f . A T v, where a marker has geometric stiffness, from out."""
    if model.bent[0][m] >= 0:
        o = model.first[model.marker_body[m]]
        for j in range(model.modes[model.marker_body[m]]):
            out[o + 3 + j] -= fx * work.bend[m, 0, j] + fy * work.bend[m, 1, j]


@stiffened_kernel
def add_bend_stiffness(
    model: ModelArrays, m: int, fx: float, fy: float, factor: float, work: Work
) -> None:
    """Share of geometric stiffness in add_arm_stiffness."""
    b, t = model.marker_body[m], model.bent[0][m]
    if t >= 0:
        o = model.first[b] + 3
        c, s = factor * work.rotation[b, 0], factor * work.rotation[b, 1]
        lx, ly = c * fx + s * fy, c * fy - s * fx  # in the body's axes
        for j in range(model.modes[b]):
            for k in range(model.modes[b]):
                work.Ky[o + j, o + k] -= (
                    lx * model.bent[1][t, 0, j, k] + ly * model.bent[1][t, 1, j, k]
                )


@kernel
def place_markers(model: ModelArrays, k: int, y: Array, v: Array, work: Work) -> None:
    """Positions and velocities of all markers at instant k."""
    for b in range(model.first.size):
        theta = y[model.first[b] + 2]
        work.rotation[b, 0] = np.cos(theta)
        work.rotation[b, 1] = np.sin(theta)
    for m in range(model.marker_body.size):
        b = model.marker_body[m]
        if b < 0:
            slot = model.marker_slot[m]
            for i in range(3):
                work.z[m, i] = model.prescribed[k, slot, 0, i]
                work.zd[m, i] = model.prescribed[k, slot, 1, i]
            continue
        o = model.first[b]
        c, s = work.rotation[b, 0], work.rotation[b, 1]
        ax = c * model.W[m, 0, 0] - s * model.W[m, 1, 0]
        ay = s * model.W[m, 0, 0] + c * model.W[m, 1, 0]
        vx = vy = turn = spin = 0.0
        for j in range(model.modes[b]):
            px = c * model.W[m, 0, j + 1] - s * model.W[m, 1, j + 1]
            py = s * model.W[m, 0, j + 1] + c * model.W[m, 1, j + 1]
            work.P[m, 0, j] = px
            work.P[m, 1, j] = py
            ax += px * y[o + 3 + j]
            ay += py * y[o + 3 + j]
            vx += px * v[o + 3 + j]
            vy += py * v[o + 3 + j]
            turn += model.psi[m, j] * y[o + 3 + j]
            spin += model.psi[m, j] * v[o + 3 + j]
        omega = v[o + 2]
        work.arm[m, 0], work.arm[m, 1] = ax, ay
        work.swing[m, 0], work.swing[m, 1] = vx, vy
        work.z[m, 0] = y[o] + ax
        work.z[m, 1] = y[o + 1] + ay
        work.z[m, 2] = y[o + 2] + turn
        work.zd[m, 0] = v[o] - omega * ay + vx
        work.zd[m, 1] = v[o + 1] + omega * ax + vy
        work.zd[m, 2] = omega + spin
        bend_marker(model, m, y, v, work)


@kernel
def marker_push(model: ModelArrays, m: int, x: Array, work: Work, out: Array, at: int) -> None:
    """out[at:at+3] = z_y x, the shift of a marker under a shift x of the coordinates."""
    b = model.marker_body[m]
    out[at] = out[at + 1] = out[at + 2] = 0.0
    if b >= 0:
        o = model.first[b]
        out[at] = x[o] - x[o + 2] * work.arm[m, 1]
        out[at + 1] = x[o + 1] + x[o + 2] * work.arm[m, 0]
        out[at + 2] = x[o + 2]
        for j in range(model.modes[b]):
            out[at] += work.P[m, 0, j] * x[o + 3 + j]
            out[at + 1] += work.P[m, 1, j] * x[o + 3 + j]
            out[at + 2] += model.psi[m, j] * x[o + 3 + j]


@kernel
def marker_pull(
    model: ModelArrays, m: int, fx: float, fy: float, moment: float, work: Work, out: Array
) -> None:
    """Add z_y^T f to out, the generalised forces of a force and a moment at a marker."""
    b = model.marker_body[m]
    if b >= 0:
        o = model.first[b]
        out[o] += fx
        out[o + 1] += fy
        out[o + 2] += fy * work.arm[m, 0] - fx * work.arm[m, 1] + moment
        for j in range(model.modes[b]):
            out[o + 3 + j] += fx * work.P[m, 0, j] + fy * work.P[m, 1, j] + moment * model.psi[m, j]


@kernel
def marker_velocity_push(
    model: ModelArrays, m: int, x: Array, v: Array, work: Work, out: Array, at: int
) -> None:
    """out[at:at+3] = z'_y x, the change of a marker's velocity under a shift x."""
    b = model.marker_body[m]
    out[at] = out[at + 1] = out[at + 2] = 0.0
    if b >= 0:
        o = model.first[b]
        omega, turn = v[o + 2], x[o + 2]
        out[at] = -turn * (omega * work.arm[m, 0] + work.swing[m, 1])
        out[at + 1] = turn * (work.swing[m, 0] - omega * work.arm[m, 1])
        for j in range(model.modes[b]):
            out[at] -= omega * work.P[m, 1, j] * x[o + 3 + j]
            out[at + 1] += omega * work.P[m, 0, j] * x[o + 3 + j]
        subtract_bend(model, m, x, work, out, at)


@kernel
def add_arm_stiffness(
    model: ModelArrays, m: int, fx: float, fy: float, factor: float, work: Work
) -> None:
    """Add factor times the derivative of z_y^T f, at a fixed force f on a marker, to work.Ky."""
    b = model.marker_body[m]
    if b >= 0:
        o = model.first[b]
        work.Ky[o + 2, o + 2] -= factor * (fx * work.arm[m, 0] + fy * work.arm[m, 1])
        for j in range(model.modes[b]):
            turned = factor * (fy * work.P[m, 0, j] - fx * work.P[m, 1, j])
            work.Ky[o + 2, o + 3 + j] += turned
            work.Ky[o + 3 + j, o + 2] += turned
        add_bend_stiffness(model, m, fx, fy, factor, work)


@kernel
def line_of_row(model: ModelArrays, i: int, z: Array) -> tuple[float, float, float, float]:
    """Normal of the line in global axes, and the first marker as seen from the second."""
    a, b = model.side[i, 0], model.side[i, 1]
    c, s = np.cos(z[b, 2]), np.sin(z[b, 2])
    nx = c * model.normal[i, 0] - s * model.normal[i, 1]
    ny = s * model.normal[i, 0] + c * model.normal[i, 1]
    return nx, ny, z[a, 0] - z[b, 0], z[a, 1] - z[b, 1]


@kernel
def distance_of_row(model: ModelArrays, i: int, z: Array) -> tuple[float, float, float]:
    """Unit vector from the second to the first marker, and their distance."""
    a, b = model.side[i, 0], model.side[i, 1]
    dx, dy = z[a, 0] - z[b, 0], z[a, 1] - z[b, 1]
    length = np.hypot(dx, dy)
    if not length > 0.0:
        return 1.0, 0.0, 0.0
    return dx / length, dy / length, length


@kernel
def row_gradient(model: ModelArrays, i: int, z: Array, g: Array) -> float:
    """Value of a row; its gradient with respect to (z_a, z_b) goes to g (6,)."""
    for j in range(6):
        g[j] = 0.0
    kind = model.kind[i]
    if kind == LINE:
        nx, ny, dx, dy = line_of_row(model, i, z)
        g[0], g[1], g[3], g[4] = nx, ny, -nx, -ny
        g[5] = nx * dy - ny * dx
        return nx * dx + ny * dy
    if kind == DISTANCE:
        ex, ey, length = distance_of_row(model, i, z)
        g[0], g[1], g[3], g[4] = ex, ey, -ex, -ey
        return length
    g[kind], g[3 + kind] = 1.0, -model.ratio[i]
    return z[model.side[i, 0], kind] - model.ratio[i] * z[model.side[i, 1], kind]


@kernel
def row_hessian(model: ModelArrays, i: int, z: Array, u: Array, out: Array) -> None:
    """Set out (6,) to the Hessian of a row times u (6,)."""
    for j in range(6):
        out[j] = 0.0
    if model.kind[i] == LINE:
        nx, ny, dx, dy = line_of_row(model, i, z)
        out[0], out[1], out[3], out[4] = -ny * u[5], nx * u[5], ny * u[5], -nx * u[5]
        out[5] = nx * (u[1] - u[4]) - ny * (u[0] - u[3]) - (nx * dx + ny * dy) * u[5]
    elif model.kind[i] == DISTANCE:
        ex, ey, length = distance_of_row(model, i, z)
        across = (ex * (u[1] - u[4]) - ey * (u[0] - u[3])) / length
        out[0], out[1], out[3], out[4] = -ey * across, ex * across, ey * across, -ex * across


@kernel
def row_third(model: ModelArrays, i: int, z: Array, u: Array, out: Array) -> None:
    """Set out (6,) to the gradient of u . Hessian u at fixed u (6,)."""
    for j in range(6):
        out[j] = 0.0
    if model.kind[i] == LINE:
        nx, ny, dx, dy = line_of_row(model, i, z)
        q = u[5] * u[5]
        out[0], out[1], out[3], out[4] = -nx * q, -ny * q, nx * q, ny * q
        out[5] = -2.0 * (nx * (u[0] - u[3]) + ny * (u[1] - u[4])) * u[5]
        out[5] -= (nx * dy - ny * dx) * q
    elif model.kind[i] == DISTANCE:
        # u . Hessian u = c^2 / length, c the part of the difference across e; de = J e c / length.
        ex, ey, length = distance_of_row(model, i, z)
        along = ex * (u[0] - u[3]) + ey * (u[1] - u[4])
        across = (ex * (u[1] - u[4]) - ey * (u[0] - u[3])) / length
        px = across * (2.0 * along * ey / length - across * ex)
        py = -across * (2.0 * along * ex / length + across * ey)
        out[0], out[1], out[3], out[4] = px, py, -px, -py


@kernel
def evaluate_rows(model: ModelArrays, k: int, y: Array, v: Array, work: Work) -> None:
    """Constraints on positions and velocities, and the constraint Jacobian, at instant k."""
    place_markers(model, k, y, v, work)
    n = y.size
    for i in range(model.kind.size):
        a, b = model.side[i, 0], model.side[i, 1]
        g = work.g[i]
        work.value[i] = row_gradient(model, i, work.z, g) - model.drive[k, i, 0]
        rate = -model.drive[k, i, 1]
        for j in range(3):
            rate += g[j] * work.zd[a, j] + g[3 + j] * work.zd[b, j]
        work.rate[i] = rate
        for j in range(n):
            work.C[i, j] = 0.0
        marker_pull(model, a, g[0], g[1], g[2], work, work.C[i])
        marker_pull(model, b, g[3], g[4], g[5], work, work.C[i])


@kernel
def marker_velocities(model: ModelArrays, i: int, work: Work) -> None:
    """Gather the velocities of the two markers of a row in work.u."""
    for j in range(3):
        work.u[j] = work.zd[model.side[i, 0], j]
        work.u[3 + j] = work.zd[model.side[i, 1], j]


@kernel
def row_curvatures(model: ModelArrays, v: Array, lam: Array, work: Work) -> None:
    """Add d(C_y^T lam)/dy to work.Ky, and put d(C_y v + C_t)/dy into work.D."""
    n = v.size
    for i in range(model.kind.size):
        for j in range(n):
            work.D[i, j] = 0.0
        curved = model.kind[i] >= LINE
        if curved:
            marker_velocities(model, i, work)
            row_hessian(model, i, work.z, work.u, work.hz[i])
        for side in range(2):
            m = model.side[i, side]
            b = model.marker_body[m]
            if b < 0:
                continue
            o = model.first[b]
            omega = v[o + 2]
            gx, gy = work.g[i, 3 * side], work.g[i, 3 * side + 1]
            if curved:
                h = work.hz[i]
                marker_pull(
                    model, m, h[3 * side], h[3 * side + 1], h[3 * side + 2], work, work.D[i]
                )
            work.D[i, o + 2] += gy * work.swing[m, 0] - gx * work.swing[m, 1]
            work.D[i, o + 2] -= omega * (gx * work.arm[m, 0] + gy * work.arm[m, 1])
            for j in range(model.modes[b]):
                work.D[i, o + 3 + j] += omega * (gy * work.P[m, 0, j] - gx * work.P[m, 1, j])
            pull_bend(model, m, gx, gy, work, work.D[i])
            add_arm_stiffness(model, m, gx, gy, lam[i], work)
        # The Hessian of a line fixed to the ground or to a prescribed marker does not reach y.
        if curved and (model.kind[i] == DISTANCE or model.marker_body[model.side[i, 1]] >= 0):
            add_row_hessian(model, i, lam[i], work)


@kernel
def add_row_hessian(model: ModelArrays, i: int, factor: float, work: Work) -> None:
    """Add factor z_y^T g_zz z_y of a row to work.Ky."""
    n = work.r.size
    unit, column = work.rhs[:n], work.scale[:n]  # free at this point of the step
    for j in range(n):
        unit[j] = 0.0
    for side in range(2):
        body = model.marker_body[model.side[i, side]]
        if body < 0 or (side == 1 and body == model.marker_body[model.side[i, 0]]):
            continue
        o = model.first[body]
        for j in range(o, o + 3 + model.modes[body]):
            unit[j] = 1.0
            marker_push(model, model.side[i, 0], unit, work, work.u, 0)
            marker_push(model, model.side[i, 1], unit, work, work.u, 3)
            unit[j] = 0.0
            row_hessian(model, i, work.z, work.u, work.out)
            for p in range(n):
                column[p] = 0.0
            f = work.out
            marker_pull(model, model.side[i, 0], f[0], f[1], f[2], work, column)
            marker_pull(model, model.side[i, 1], f[3], f[4], f[5], work, column)
            for p in range(n):
                work.Ky[p, j] += factor * column[p]


@kernel
def rows_pullback(
    model: ModelArrays,
    y: Array,
    v: Array,
    w: Array,
    zdd: Array,
    lam: Array,
    x: Array,
    m2: Array,
    m3: Array,
    m4: Array,
    sign: float,
    work: Work,
    y_bar: Array,
    v_bar: Array,
    markers: Array,
) -> None:
    """Add the derivative of sign * Q to the bars.

        Q = sum over rows of  lam g_z.dz + m2 g + m3 g_z.z' + m4 (g_z.z'' + z'.g_zz z')

    with dz = z_y x, and x, lam, m2, m3, m4 held fixed. The bars of a marker are markers[m]
    (3, modes + 1): x and y of the shape functions W in the body's axes, and those of the rotation,
    whose first entry stays zero. Where markers have geometric stiffness there are 2 modes rows
    more, those of T_x and of T_y, whose first column stays zero; the derivative is their symmetric
    part. Markers must have been placed by evaluate_rows.
    """
    dz, u, h, third = np.empty(6), work.u, np.empty(6), np.empty(6)
    bars = np.empty((4, 6))  # of z, dz, z', z''
    for i in range(model.kind.size):
        marker_push(model, model.side[i, 0], x, work, dz, 0)
        marker_push(model, model.side[i, 1], x, work, dz, 3)
        g = work.g[i]
        for j in range(6):
            bars[0, j] = m2[i] * g[j]
            bars[1, j] = lam[i] * g[j]
            bars[2, j] = m3[i] * g[j]
            bars[3, j] = m4[i] * g[j]
        if model.kind[i] >= LINE:
            row_hessian(model, i, work.z, dz, h)
            for j in range(6):
                bars[0, j] += lam[i] * h[j]
            marker_velocities(model, i, work)
            row_hessian(model, i, work.z, u, h)
            row_third(model, i, work.z, u, third)
            for j in range(6):
                bars[0, j] += m3[i] * h[j] + m4[i] * third[j]
                bars[2, j] += 2.0 * m4[i] * h[j]
            if m4[i] != 0.0:
                for j in range(6):
                    u[j] = zdd[model.side[i, j // 3], j % 3]
                row_hessian(model, i, work.z, u, h)
                for j in range(6):
                    bars[0, j] += m4[i] * h[j]
        for side in range(2):
            if model.marker_body[model.side[i, side]] >= 0:
                marker_pullback(
                    model, model.side[i, side], y, v, w, x, bars, 3 * side, sign, work,
                    y_bar, v_bar, markers,
                )  # fmt: skip


@kernel
def marker_pullback(
    model: ModelArrays,
    m: int,
    y: Array,
    v: Array,
    w: Array,
    x: Array,
    bars: Array,
    at: int,
    sign: float,
    work: Work,
    y_bar: Array,
    v_bar: Array,
    markers: Array,
) -> None:
    """Transpose of (z, z_y x, z', z'') with respect to y, v and the marker's shape functions."""
    b = model.marker_body[m]
    o, n = model.first[b], model.modes[b]
    c, s = work.rotation[b, 0], work.rotation[b, 1]
    omega, eps, spin = v[o + 2], w[o + 2], x[o + 2]
    px, py, pt = sign * bars[0, at], sign * bars[0, at + 1], sign * bars[0, at + 2]
    ex, ey, et = sign * bars[1, at], sign * bars[1, at + 1], sign * bars[1, at + 2]
    dx, dy, dt = sign * bars[2, at], sign * bars[2, at + 1], sign * bars[2, at + 2]
    cx, cy, ct = sign * bars[3, at], sign * bars[3, at + 1], sign * bars[3, at + 2]
    ax, ay = work.arm[m, 0], work.arm[m, 1]
    vx, vy = work.swing[m, 0], work.swing[m, 1]
    hx = hy = kx = ky = 0.0
    for j in range(n):
        hx += work.P[m, 0, j] * x[o + 3 + j]
        hy += work.P[m, 1, j] * x[o + 3 + j]
        kx += work.P[m, 0, j] * w[o + 3 + j]
        ky += work.P[m, 1, j] * w[o + 3 + j]
    # Bars of the arm A W qh and of A W vh; those of A W xh and A W ah are e and c.
    sx = px + spin * ey + omega * dy + eps * cy - omega * omega * cx
    sy = py - spin * ex - omega * dx - eps * cx - omega * omega * cy
    ux, uy = dx + 2.0 * omega * cy, dy - 2.0 * omega * cx
    y_bar[o] += px
    y_bar[o + 1] += py
    y_bar[o + 2] += ax * sy - ay * sx + hx * ey - hy * ex + vx * uy - vy * ux + kx * cy - ky * cx
    y_bar[o + 2] += pt
    v_bar[o] += dx
    v_bar[o + 1] += dy
    v_bar[o + 2] += ax * dy - ay * dx - 2.0 * omega * (ax * cx + ay * cy) + dt
    v_bar[o + 2] += 2.0 * (vx * cy - vy * cx)
    markers[m, 0, 0] += c * sx + s * sy
    markers[m, 1, 0] += c * sy - s * sx
    for j in range(n):
        i = o + 3 + j
        y_bar[i] += work.P[m, 0, j] * sx + work.P[m, 1, j] * sy + model.psi[m, j] * pt
        v_bar[i] += work.P[m, 0, j] * ux + work.P[m, 1, j] * uy + model.psi[m, j] * dt
        fx = sx * y[i] + ux * v[i] + cx * w[i] + ex * x[i]
        fy = sy * y[i] + uy * v[i] + cy * w[i] + ey * x[i]
        markers[m, 0, j + 1] += c * fx + s * fy
        markers[m, 1, j + 1] += c * fy - s * fx
        markers[m, 2, j + 1] += pt * y[i] + dt * v[i] + ct * w[i] + et * x[i]
    bend_pullback(model, m, y, v, w, x, sx, sy, ux, uy, ex, ey, cx, cy, work, y_bar, v_bar, markers)


@stiffened_kernel
def bend_pullback(
    model: ModelArrays,
    m: int,
    y: Array,
    v: Array,
    w: Array,
    x: Array,
    sx: float,
    sy: float,
    ux: float,
    uy: float,
    ex: float,
    ey: float,
    cx: float,
    cy: float,
    work: Work,
    y_bar: Array,
    v_bar: Array,
    markers: Array,
) -> None:
    """Share of geometric stiffness in marker_pullback.

    The bars s, u, e, c are those of the arm, of P v, of P x and of P w; that of the acceleration
    -A (v . T v) is c as well.
    """
    b, t = model.marker_body[m], model.bent[0][m]
    if t < 0:
        return
    o, n = model.first[b], model.modes[b]
    c, s = work.rotation[b, 0], work.rotation[b, 1]
    # in the body's axes
    lsx, lsy, lux, luy = c * sx + s * sy, c * sy - s * sx, c * ux + s * uy, c * uy - s * ux
    lex, ley, lcx, lcy = c * ex + s * ey, c * ey - s * ex, c * cx + s * cy, c * cy - s * cx
    for j in range(n):
        i = o + 3 + j
        bx, by = work.bend[m, 0, j], work.bend[m, 1, j]
        y_bar[o + 2] += (by * cx - bx * cy) * v[i]
        v_bar[i] -= 2.0 * (cx * bx + cy * by)
        fx = 0.5 * lsx * y[i] + lux * v[i] + lcx * w[i] + lex * x[i]
        fy = 0.5 * lsy * y[i] + luy * v[i] + lcy * w[i] + ley * x[i]
        for k in range(n):
            p = o + 3 + k
            y_bar[i] -= model.bent[1][t, 0, j, k] * (lex * x[p] + lux * v[p] + lcx * w[p])
            y_bar[i] -= model.bent[1][t, 1, j, k] * (ley * x[p] + luy * v[p] + lcy * w[p])
            markers[m, 3 + j, k + 1] -= fx * y[p] + lcx * v[i] * v[p]
            markers[m, 3 + n + j, k + 1] -= fy * y[p] + lcy * v[i] * v[p]
