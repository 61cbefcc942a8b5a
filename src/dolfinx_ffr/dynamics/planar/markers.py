# SPDX-License-Identifier: MIT
"""Markers: places, velocities and accelerations, their derivatives and transposes.

For a marker of a flexible body with shape functions W (reference position first) and psi,

    (x, y) = R + A(theta) W (1, q),      angle = theta + psi q.

A marker with geometric stiffness T moves by -1/2 A (q . T_x q, q . T_y q) as well, and a force f
on it does the work of  P_j = A (W_j - T_j q)  per q_j. With P in place of A W all first
derivatives keep their form; the second ones gain

    d2 (x, y) / dq_j dq_k = -A T_jk.
"""

from __future__ import annotations

import numpy as np

from ..compilation import Vector, kernel
from ..equations import Equations
from .arrays import (
    ACCELERATION,
    PLACE,
    RIGID,
    ROTATION,
    SHIFT,
    VELOCITY,
    ModelArrays,
    Work,
)


@kernel
def place_markers(model: ModelArrays, eq: Equations, work: Work, instant: int) -> None:
    """Positions and velocities of all markers at an instant."""
    y, v, P, psi = eq.y, eq.v, work.P, model.psi
    z, zd, arm, swing, shapes = work.z, work.zd, work.arm, work.swing, model.shapes
    for b in range(model.first.size):
        theta = y[model.first[b] + ROTATION]
        work.rotation[b, 0] = np.cos(theta)
        work.rotation[b, 1] = np.sin(theta)
    for m in range(model.marker_body.size):
        b = model.marker_body[m]
        if b < 0:
            slot = model.marker_slot[m]
            for i in range(3):
                z[m, i] = model.prescribed[instant, slot, 0, i]
                zd[m, i] = model.prescribed[instant, slot, 1, i]
            continue
        o = model.first[b]
        c, s = work.rotation[b, 0], work.rotation[b, 1]
        ax = c * shapes[m, 0, 0] - s * shapes[m, 1, 0]
        ay = s * shapes[m, 0, 0] + c * shapes[m, 1, 0]
        vx = vy = turn = spin = 0.0
        for j in range(model.modes[b]):
            q, rate = y[o + RIGID + j], v[o + RIGID + j]
            px = c * shapes[m, 0, j + 1] - s * shapes[m, 1, j + 1]
            py = s * shapes[m, 0, j + 1] + c * shapes[m, 1, j + 1]
            P[m, 0, j] = px
            P[m, 1, j] = py
            ax += px * q
            ay += py * q
            vx += px * rate
            vy += py * rate
            turn += psi[m, j] * q
            spin += psi[m, j] * rate
        omega = v[o + ROTATION]
        arm[m, 0], arm[m, 1] = ax, ay
        swing[m, 0], swing[m, 1] = vx, vy
        z[m, 0] = y[o] + ax
        z[m, 1] = y[o + 1] + ay
        z[m, 2] = y[o + ROTATION] + turn
        zd[m, 0] = v[o] - omega * ay + vx
        zd[m, 1] = v[o + 1] + omega * ax + vy
        zd[m, 2] = omega + spin
        if model.marker_stiffened[m] >= 0:
            bend_marker(model, eq, work, m)


@kernel
def bend_marker(model: ModelArrays, eq: Equations, work: Work, m: int) -> None:
    """Add the share of geometric stiffness to place and motion of a marker; keep its A T v."""
    b, t = model.marker_body[m], model.marker_stiffened[m]
    o, n, T, y, v = model.first[b], model.modes[b], model.marker_stiffening, eq.y, eq.v
    c, s = work.rotation[b, 0], work.rotation[b, 1]
    ax = ay = vx = vy = 0.0
    for j in range(n):
        qx = qy = dx = dy = 0.0
        for k in range(n):
            qx += T[t, 0, j, k] * y[o + RIGID + k]
            qy += T[t, 1, j, k] * y[o + RIGID + k]
            dx += T[t, 0, j, k] * v[o + RIGID + k]
            dy += T[t, 1, j, k] * v[o + RIGID + k]
        px, py = c * qx - s * qy, s * qx + c * qy
        work.P[m, 0, j] -= px
        work.P[m, 1, j] -= py
        ax -= 0.5 * px * y[o + RIGID + j]
        ay -= 0.5 * py * y[o + RIGID + j]
        vx -= px * v[o + RIGID + j]
        vy -= py * v[o + RIGID + j]
        work.bend[m, 0, j] = c * dx - s * dy
        work.bend[m, 1, j] = s * dx + c * dy
    work.arm[m, 0] += ax
    work.arm[m, 1] += ay
    work.swing[m, 0] += vx
    work.swing[m, 1] += vy
    work.z[m, 0] += ax
    work.z[m, 1] += ay
    work.zd[m, 0] += vx - v[o + ROTATION] * ay
    work.zd[m, 1] += vy + v[o + ROTATION] * ax


@kernel
def marker_push(
    model: ModelArrays, work: Work, m: int, shift: Vector, out: Vector, at: int
) -> None:
    """Into out[at:at+3]: z_y shift, the way of a marker under a shift of the coordinates."""
    b = model.marker_body[m]
    out[at] = out[at + 1] = out[at + 2] = 0.0
    if b >= 0:
        o, P, psi = model.first[b], work.P, model.psi
        x = shift[o] - shift[o + ROTATION] * work.arm[m, 1]
        y = shift[o + 1] + shift[o + ROTATION] * work.arm[m, 0]
        turn = shift[o + ROTATION]
        for j in range(model.modes[b]):
            x += P[m, 0, j] * shift[o + RIGID + j]
            y += P[m, 1, j] * shift[o + RIGID + j]
            turn += psi[m, j] * shift[o + RIGID + j]
        out[at], out[at + 1], out[at + 2] = x, y, turn


@kernel
def marker_pull(
    model: ModelArrays, work: Work, m: int, force: Vector, at: int, out: Vector
) -> None:
    """Add z_y^T f to out, the generalised forces of f = force[at:at+3] at a marker."""
    b = model.marker_body[m]
    if b >= 0:
        o, P, psi = model.first[b], work.P, model.psi
        fx, fy, moment = force[at], force[at + 1], force[at + 2]
        out[o] += fx
        out[o + 1] += fy
        out[o + ROTATION] += fy * work.arm[m, 0] - fx * work.arm[m, 1] + moment
        for j in range(model.modes[b]):
            out[o + RIGID + j] += fx * P[m, 0, j] + fy * P[m, 1, j] + moment * psi[m, j]


@kernel
def subtract_bend(
    model: ModelArrays, work: Work, m: int, shift: Vector, out: Vector, at: int
) -> None:
    """Subtract A (shift . T v), where a marker has geometric stiffness, from out[at:at+2]."""
    if model.marker_stiffened[m] >= 0:
        o = model.first[model.marker_body[m]]
        for j in range(model.modes[model.marker_body[m]]):
            out[at] -= work.bend[m, 0, j] * shift[o + RIGID + j]
            out[at + 1] -= work.bend[m, 1, j] * shift[o + RIGID + j]


@kernel
def pull_bend(model: ModelArrays, work: Work, m: int, fx: float, fy: float, out: Vector) -> None:
    """Subtract f . A T v, where a marker has geometric stiffness, from out."""
    if model.marker_stiffened[m] >= 0:
        o = model.first[model.marker_body[m]]
        for j in range(model.modes[model.marker_body[m]]):
            out[o + RIGID + j] -= fx * work.bend[m, 0, j] + fy * work.bend[m, 1, j]


@kernel
def marker_velocity_push(
    model: ModelArrays, eq: Equations, work: Work, m: int, shift: Vector, out: Vector, at: int
) -> None:
    """Into out[at:at+3]: z'_y shift, the change of a marker's velocity under a shift."""
    b = model.marker_body[m]
    out[at] = out[at + 1] = out[at + 2] = 0.0
    if b >= 0:
        o, P = model.first[b], work.P
        omega, turn = eq.v[o + ROTATION], shift[o + ROTATION]
        out[at] = -turn * (omega * work.arm[m, 0] + work.swing[m, 1])
        out[at + 1] = turn * (work.swing[m, 0] - omega * work.arm[m, 1])
        for j in range(model.modes[b]):
            out[at] -= omega * P[m, 1, j] * shift[o + RIGID + j]
            out[at + 1] += omega * P[m, 0, j] * shift[o + RIGID + j]
        subtract_bend(model, work, m, shift, out, at)


@kernel
def marker_accelerations(model: ModelArrays, eq: Equations, work: Work, instant: int) -> None:
    """Accelerations of all markers, work.zdd."""
    zdd, out = work.zdd, work.du
    for m in range(model.marker_body.size):
        b = model.marker_body[m]
        if b < 0:
            for i in range(3):
                zdd[m, i] = model.prescribed[instant, model.marker_slot[m], 2, i]
        else:
            omega = eq.v[model.first[b] + ROTATION]
            marker_push(model, work, m, eq.w, out, 0)
            out[0] -= omega * (omega * work.arm[m, 0] + 2.0 * work.swing[m, 1])
            out[1] -= omega * (omega * work.arm[m, 1] - 2.0 * work.swing[m, 0])
            subtract_bend(model, work, m, eq.v, out, 0)
            for i in range(3):
                zdd[m, i] = out[i]


@kernel
def add_arm_stiffness(
    model: ModelArrays, eq: Equations, work: Work, m: int, fx: float, fy: float, factor: float
) -> None:
    """Add factor times the derivative of z_y^T f, at a fixed force f on a marker, to eq.Ky."""
    b = model.marker_body[m]
    if b < 0:
        return
    o, n, Ky, P = model.first[b], model.modes[b], eq.Ky, work.P
    Ky[o + ROTATION, o + ROTATION] -= factor * (fx * work.arm[m, 0] + fy * work.arm[m, 1])
    for j in range(n):
        turned = factor * (fy * P[m, 0, j] - fx * P[m, 1, j])
        Ky[o + ROTATION, o + RIGID + j] += turned
        Ky[o + RIGID + j, o + ROTATION] += turned
    t = model.marker_stiffened[m]
    if t >= 0:
        e, T = o + RIGID, model.marker_stiffening
        c, s = factor * work.rotation[b, 0], factor * work.rotation[b, 1]
        lx, ly = c * fx + s * fy, c * fy - s * fx  # in the body's axes
        for j in range(n):
            for k in range(n):
                Ky[e + j, e + k] -= lx * T[t, 0, j, k] + ly * T[t, 1, j, k]


@kernel
def marker_pullback(model: ModelArrays, eq: Equations, work: Work, m: int, at: int) -> None:
    """Transpose of (z, z_y adj, z', z'') with respect to y, v and the marker's shape functions.

    Adds to eq.y_bar, eq.v_bar and work.marker_bars; the derivatives with respect to these four are
    the rows of work.bars[:, at:at+3].
    """
    b = model.marker_body[m]
    o, n = model.first[b], model.modes[b]
    y, v, w, adj, y_bar, v_bar = eq.y, eq.v, eq.w, eq.adjoint, eq.y_bar, eq.v_bar
    P, psi, bars, out = work.P, model.psi, work.bars, work.marker_bars
    c, s = work.rotation[b, 0], work.rotation[b, 1]
    omega, eps, spin = v[o + ROTATION], w[o + ROTATION], adj[o + ROTATION]
    px, py, pt = bars[PLACE, at], bars[PLACE, at + 1], bars[PLACE, at + 2]
    ex, ey, et = bars[SHIFT, at], bars[SHIFT, at + 1], bars[SHIFT, at + 2]
    dx, dy, dt = bars[VELOCITY, at], bars[VELOCITY, at + 1], bars[VELOCITY, at + 2]
    cx, cy, ct = bars[ACCELERATION, at], bars[ACCELERATION, at + 1], bars[ACCELERATION, at + 2]
    ax, ay = work.arm[m, 0], work.arm[m, 1]
    vx, vy = work.swing[m, 0], work.swing[m, 1]
    hx = hy = kx = ky = 0.0
    for j in range(n):
        hx += P[m, 0, j] * adj[o + RIGID + j]
        hy += P[m, 1, j] * adj[o + RIGID + j]
        kx += P[m, 0, j] * w[o + RIGID + j]
        ky += P[m, 1, j] * w[o + RIGID + j]
    # Derivatives with respect to the arm and to the elastic velocity; those with respect to the
    # products of the shape functions with adj and w are e and c.
    sx = px + spin * ey + omega * dy + eps * cy - omega * omega * cx
    sy = py - spin * ex - omega * dx - eps * cx - omega * omega * cy
    ux, uy = dx + 2.0 * omega * cy, dy - 2.0 * omega * cx
    y_bar[o] += px
    y_bar[o + 1] += py
    y_bar[o + ROTATION] += (
        ax * sy - ay * sx + hx * ey - hy * ex + vx * uy - vy * ux + kx * cy - ky * cx
    )
    y_bar[o + ROTATION] += pt
    v_bar[o] += dx
    v_bar[o + 1] += dy
    v_bar[o + ROTATION] += ax * dy - ay * dx - 2.0 * omega * (ax * cx + ay * cy) + dt
    v_bar[o + ROTATION] += 2.0 * (vx * cy - vy * cx)
    out[m, 0, 0] += c * sx + s * sy
    out[m, 1, 0] += c * sy - s * sx
    for j in range(n):
        i = o + RIGID + j
        y_bar[i] += P[m, 0, j] * sx + P[m, 1, j] * sy + psi[m, j] * pt
        v_bar[i] += P[m, 0, j] * ux + P[m, 1, j] * uy + psi[m, j] * dt
        fx = sx * y[i] + ux * v[i] + cx * w[i] + ex * adj[i]
        fy = sy * y[i] + uy * v[i] + cy * w[i] + ey * adj[i]
        out[m, 0, j + 1] += c * fx + s * fy
        out[m, 1, j + 1] += c * fy - s * fx
        out[m, 2, j + 1] += pt * y[i] + dt * v[i] + ct * w[i] + et * adj[i]
    if model.marker_stiffened[m] >= 0:
        pulls = work.pulls
        pulls[PLACE, 0], pulls[PLACE, 1] = sx, sy
        pulls[SHIFT, 0], pulls[SHIFT, 1] = ex, ey
        pulls[VELOCITY, 0], pulls[VELOCITY, 1] = ux, uy
        pulls[ACCELERATION, 0], pulls[ACCELERATION, 1] = cx, cy
        bend_pullback(model, eq, work, m)


@kernel
def bend_pullback(model: ModelArrays, eq: Equations, work: Work, m: int) -> None:
    """Share of geometric stiffness in marker_pullback, from work.pulls.

    The derivative with respect to the acceleration -A (v . T v) is that of P w.
    """
    b, t = model.marker_body[m], model.marker_stiffened[m]
    o, n, T = model.first[b], model.modes[b], model.marker_stiffening
    y, v, w, adj, y_bar, v_bar = eq.y, eq.v, eq.w, eq.adjoint, eq.y_bar, eq.v_bar
    c, s, out, pulls = work.rotation[b, 0], work.rotation[b, 1], work.marker_bars, work.pulls
    sx, sy = pulls[PLACE, 0], pulls[PLACE, 1]
    ex, ey = pulls[SHIFT, 0], pulls[SHIFT, 1]
    ux, uy = pulls[VELOCITY, 0], pulls[VELOCITY, 1]
    cx, cy = pulls[ACCELERATION, 0], pulls[ACCELERATION, 1]
    # in the body's axes
    lsx, lsy, lux, luy = c * sx + s * sy, c * sy - s * sx, c * ux + s * uy, c * uy - s * ux
    lex, ley, lcx, lcy = c * ex + s * ey, c * ey - s * ex, c * cx + s * cy, c * cy - s * cx
    for j in range(n):
        i = o + RIGID + j
        bx, by = work.bend[m, 0, j], work.bend[m, 1, j]
        y_bar[o + ROTATION] += (by * cx - bx * cy) * v[i]
        v_bar[i] -= 2.0 * (cx * bx + cy * by)
        fx = 0.5 * lsx * y[i] + lux * v[i] + lcx * w[i] + lex * adj[i]
        fy = 0.5 * lsy * y[i] + luy * v[i] + lcy * w[i] + ley * adj[i]
        for k in range(n):
            p = o + RIGID + k
            y_bar[i] -= T[t, 0, j, k] * (lex * adj[p] + lux * v[p] + lcx * w[p])
            y_bar[i] -= T[t, 1, j, k] * (ley * adj[p] + luy * v[p] + lcy * w[p])
            out[m, 3 + j, k + 1] -= fx * y[p] + lcx * v[i] * v[p]
            out[m, 3 + n + j, k + 1] -= fy * y[p] + lcy * v[i] * v[p]
