# SPDX-License-Identifier: MIT
"""Forces at markers: values, Jacobians and transposes.

A force is a function F(z_a, z_b, z_a', z_b', t) of the coordinates z = (x, y, angle) of two markers
and their velocities, with three components for each marker. It adds -z_y^T F to the forces r of the
equations of motion. A new kind of force needs no more than F and its first derivatives
(``force_law``); the chain from the coordinates of the bodies to the markers is shared with the
joints.

A force at a single marker has this marker on both sides, and no share on the second.
"""

from __future__ import annotations

import numpy as np

from ..compilation import kernel
from ..equations import Equations
from .arrays import (
    ACCELERATION,
    FOLLOWER,
    GLOBAL,
    PLACE,
    PLANE_SPRING,
    RIGID,
    SHIFT,
    TORSION,
    VELOCITY,
    ModelArrays,
    Work,
)
from .markers import (
    add_arm_stiffness,
    marker_pull,
    marker_pullback,
    marker_push,
    marker_velocity_push,
)


@kernel
def force_law(model: ModelArrays, work: Work, i: int, instant: int) -> None:
    """Force i at an instant (work.load), its derivatives in z (work.load_z), z' (work.load_v)."""
    F, Z, V = work.load, work.load_z, work.load_v
    for p in range(6):
        F[p] = 0.0
        for q in range(6):
            Z[p, q] = V[p, q] = 0.0
    a, b, kind = model.force_side[i, 0], model.force_side[i, 1], model.force_kind[i]
    z, zd, table = work.z, work.zd, model.force_table[instant, i]
    if kind == GLOBAL:
        for p in range(3):
            F[p] = table[p]
        return
    if kind == FOLLOWER:
        c, s = np.cos(z[a, 2]), np.sin(z[a, 2])
        F[0], F[1] = c * table[0] - s * table[1], s * table[0] + c * table[1]
        Z[0, 2], Z[1, 2] = -F[1], F[0]
        return
    stiffness, damping = model.force_constants[i, 0], model.force_constants[i, 1]
    if kind == TORSION:
        moment = stiffness * (z[a, 2] - z[b, 2] - table[0]) + damping * (zd[a, 2] - zd[b, 2])
        F[2], F[5] = -moment, moment
        Z[2, 2], Z[5, 5], Z[2, 5], Z[5, 2] = -stiffness, -stiffness, stiffness, stiffness
        V[2, 2], V[5, 5], V[2, 5], V[5, 2] = -damping, -damping, damping, damping
        return
    dx, dy = z[a, 0] - z[b, 0], z[a, 1] - z[b, 1]
    vx, vy = zd[a, 0] - zd[b, 0], zd[a, 1] - zd[b, 1]
    if kind == PLANE_SPRING:
        F[0], F[1] = -stiffness * dx - damping * vx, -stiffness * dy - damping * vy
        for p in range(2):
            Z[p, p], V[p, p] = -stiffness, -damping
    else:
        length = np.hypot(dx, dy)
        if not length > 0.0:
            return  # no direction to pull
        ex, ey = dx / length, dy / length
        rate = ex * vx + ey * vy
        tension = stiffness * (length - table[0]) + damping * rate
        F[0], F[1] = -tension * ex, -tension * ey
        # The direction turns by the share of a shift across it.
        turn = tension / length
        gx = stiffness * ex + damping * (vx - ex * rate) / length - turn * ex
        gy = stiffness * ey + damping * (vy - ey * rate) / length - turn * ey
        Z[0, 0], Z[0, 1] = -ex * gx - turn, -ex * gy
        Z[1, 0], Z[1, 1] = -ey * gx, -ey * gy - turn
        V[0, 0], V[0, 1] = -damping * ex * ex, -damping * ex * ey
        V[1, 0], V[1, 1] = -damping * ey * ex, -damping * ey * ey
    for p in range(2):
        F[3 + p] = -F[p]
        for q in range(2):
            Z[3 + p, 3 + q], Z[p, 3 + q], Z[3 + p, q] = Z[p, q], -Z[p, q], -Z[p, q]
            V[3 + p, 3 + q], V[p, 3 + q], V[3 + p, q] = V[p, q], -V[p, q], -V[p, q]


@kernel
def add_forces(
    model: ModelArrays, eq: Equations, work: Work, instant: int, cv: float, tangent: bool
) -> None:
    """Add r of all forces to eq.r; if asked for, r_w + cv r_v to eq.M and r_y to eq.Ky.

    Markers must have been placed.
    """
    F, pull = work.load, work.third
    for i in range(model.force_kind.size):
        force_law(model, work, i, instant)
        for p in range(6):
            pull[p] = -F[p]
        for p in range(3):
            work.loads[i, p] = F[p]
        for side in range(2):
            m = model.force_side[i, side]
            marker_pull(model, work, m, pull, 3 * side, eq.r)
            if tangent:
                add_arm_stiffness(model, eq, work, m, pull[3 * side], pull[3 * side + 1], 1.0)
        if tangent and model.force_kind[i] != GLOBAL:
            add_force_tangent(model, eq, work, i, cv)


@kernel
def add_force_tangent(model: ModelArrays, eq: Equations, work: Work, i: int, cv: float) -> None:
    """Subtract z_y^T (F_z z_y + F_z' z'_y) from eq.Ky and cv z_y^T F_z' z_y from eq.M."""
    n, unit, column, Ky, M = eq.r.size, work.unit, work.column, eq.Ky, eq.M
    shift, drift, fy, fv = work.u, work.du, work.hessian, work.third
    Z, V = work.load_z, work.load_v
    for j in range(n):
        unit[j] = 0.0
    a, b = model.force_side[i, 0], model.force_side[i, 1]
    for side in range(2):
        body = model.marker_body[model.force_side[i, side]]
        if body < 0 or (side == 1 and body == model.marker_body[a]):
            continue
        o = model.first[body]
        for j in range(o, o + RIGID + model.modes[body]):
            unit[j] = 1.0
            marker_push(model, work, a, unit, shift, 0)
            marker_push(model, work, b, unit, shift, 3)
            marker_velocity_push(model, eq, work, a, unit, drift, 0)
            marker_velocity_push(model, eq, work, b, unit, drift, 3)
            unit[j] = 0.0
            for p in range(6):
                fy[p] = fv[p] = 0.0
                for q in range(6):
                    fy[p] -= Z[p, q] * shift[q] + V[p, q] * drift[q]
                    fv[p] -= cv * V[p, q] * shift[q]
            for p in range(n):
                column[p] = 0.0
            marker_pull(model, work, a, fy, 0, column)
            marker_pull(model, work, b, fy, 3, column)
            for p in range(n):
                Ky[p, j] += column[p]
                column[p] = 0.0
            marker_pull(model, work, a, fv, 0, column)
            marker_pull(model, work, b, fv, 3, column)
            for p in range(n):
                M[p, j] += column[p]


@kernel
def forces_pullback(model: ModelArrays, eq: Equations, work: Work, instant: int) -> None:
    """Subtract the derivative of adjoint . r of all forces, at fixed adjoint, from the bars."""
    dz, bars, F, Z, V = work.du, work.bars, work.load, work.load_z, work.load_v
    for i in range(model.force_kind.size):
        force_law(model, work, i, instant)
        marker_push(model, work, model.force_side[i, 0], eq.adjoint, dz, 0)
        marker_push(model, work, model.force_side[i, 1], eq.adjoint, dz, 3)
        for q in range(6):
            bars[PLACE, q] = bars[VELOCITY, q] = bars[ACCELERATION, q] = 0.0
            bars[SHIFT, q] = F[q]
            for p in range(6):
                bars[PLACE, q] += Z[p, q] * dz[p]
                bars[VELOCITY, q] += V[p, q] * dz[p]
        for side in range(2):
            if model.marker_body[model.force_side[i, side]] >= 0:
                marker_pullback(model, eq, work, model.force_side[i, side], 3 * side)
