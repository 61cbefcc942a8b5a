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

from .arrays import FOLLOWER, GLOBAL, PLANE_SPRING, TORSION, Array, ModelArrays, Work, kernel
from .rows import (
    add_arm_stiffness,
    marker_pull,
    marker_pullback,
    marker_push,
    marker_velocity_push,
)


@kernel
def force_law(model: ModelArrays, i: int, k: int, work: Work) -> None:
    """Force i at instant k (work.load), its derivatives in z (work.load_z), z' (work.load_v)."""
    F, Z, V = work.load, work.load_z, work.load_v
    for p in range(6):
        F[p] = 0.0
        for q in range(6):
            Z[p, q] = V[p, q] = 0.0
    a, b, kind = model.force_side[i, 0], model.force_side[i, 1], model.force_kind[i]
    z, zd, table = work.z, work.zd, model.force_table[k, i]
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
def add_forces(model: ModelArrays, k: int, v: Array, cv: float, work: Work) -> None:
    """Add r, r_w + cv r_v and r_y of all forces to work.r, work.M and work.Ky.

    Markers must have been placed by evaluate_rows.
    """
    for i in range(model.force_kind.size):
        force_law(model, i, k, work)
        F = work.load
        for side in range(2):
            m = model.force_side[i, side]
            fx, fy, moment = F[3 * side], F[3 * side + 1], F[3 * side + 2]
            marker_pull(model, m, -fx, -fy, -moment, work, work.r)
            add_arm_stiffness(model, m, -fx, -fy, 1.0, work)
        if model.force_kind[i] != GLOBAL:
            add_force_tangent(model, i, v, cv, work)


@kernel
def add_force_tangent(model: ModelArrays, i: int, v: Array, cv: float, work: Work) -> None:
    """Subtract z_y^T (F_z z_y + F_z' z'_y) from work.Ky and cv z_y^T F_z' z_y from work.M."""
    n = work.r.size
    unit, column = work.rhs[:n], work.scale[:n]  # free at this point of the step
    shift, drift, fy, fv = work.u, work.out, np.empty(6), np.empty(6)
    for j in range(n):
        unit[j] = 0.0
    first, second = model.force_side[i, 0], model.force_side[i, 1]
    for side in range(2):
        body = model.marker_body[model.force_side[i, side]]
        if body < 0 or (side == 1 and body == model.marker_body[first]):
            continue
        o = model.first[body]
        for j in range(o, o + 3 + model.modes[body]):
            unit[j] = 1.0
            marker_push(model, first, unit, work, shift, 0)
            marker_push(model, second, unit, work, shift, 3)
            marker_velocity_push(model, first, unit, v, work, drift, 0)
            marker_velocity_push(model, second, unit, v, work, drift, 3)
            unit[j] = 0.0
            for p in range(6):
                fy[p] = fv[p] = 0.0
                for q in range(6):
                    fy[p] -= work.load_z[p, q] * shift[q] + work.load_v[p, q] * drift[q]
                    fv[p] -= cv * work.load_v[p, q] * shift[q]
            for p in range(n):
                column[p] = 0.0
            marker_pull(model, first, fy[0], fy[1], fy[2], work, column)
            marker_pull(model, second, fy[3], fy[4], fy[5], work, column)
            for p in range(n):
                work.Ky[p, j] += column[p]
                column[p] = 0.0
            marker_pull(model, first, fv[0], fv[1], fv[2], work, column)
            marker_pull(model, second, fv[3], fv[4], fv[5], work, column)
            for p in range(n):
                work.M[p, j] += column[p]


@kernel
def forces_pullback(
    model: ModelArrays,
    k: int,
    y: Array,
    v: Array,
    w: Array,
    x: Array,
    work: Work,
    y_bar: Array,
    v_bar: Array,
    markers: Array,
) -> None:
    """Subtract the derivative of x . r of all forces, at fixed x, from the bars."""
    dz, bars = np.empty(6), np.zeros((4, 6))  # bars of z, dz = z_y x, z', z''
    for i in range(model.force_kind.size):
        force_law(model, i, k, work)
        marker_push(model, model.force_side[i, 0], x, work, dz, 0)
        marker_push(model, model.force_side[i, 1], x, work, dz, 3)
        for q in range(6):
            bars[0, q] = bars[2, q] = 0.0
            bars[1, q] = work.load[q]
            for p in range(6):
                bars[0, q] += work.load_z[p, q] * dz[p]
                bars[2, q] += work.load_v[p, q] * dz[p]
        for side in range(2):
            if model.marker_body[model.force_side[i, side]] >= 0:
                marker_pullback(
                    model, model.force_side[i, side], y, v, w, x, bars, 3 * side, 1.0, work,
                    y_bar, v_bar, markers,
                )  # fmt: skip
