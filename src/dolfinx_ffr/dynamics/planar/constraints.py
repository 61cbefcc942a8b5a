# SPDX-License-Identifier: MIT
"""Constraint rows: values, Jacobians, curvature terms and transposes.

A constraint is a scalar row

    g(z_a, z_b) - c(t) = 0

of the coordinates z = (x, y, angle) of two markers. A new kind of joint needs no more than the
value of g and its first three derivatives in z (``row_gradient``, ``row_hessian``, ``row_third``);
the chain from the coordinates of the bodies to the markers, and its transpose, are shared.
"""

from __future__ import annotations

import numpy as np

from ..compilation import Vector, kernel
from ..equations import Equations
from .arrays import (
    ACCELERATION,
    DISTANCE,
    LINE,
    PLACE,
    RIGID,
    ROTATION,
    SHIFT,
    VELOCITY,
    ModelArrays,
    Work,
)
from .markers import (
    add_arm_stiffness,
    marker_accelerations,
    marker_pull,
    marker_pullback,
    marker_push,
    place_markers,
    pull_bend,
)


@kernel
def line_of_row(model: ModelArrays, work: Work, i: int) -> tuple[float, float, float, float]:
    """Normal of the line in global axes, and the first marker as seen from the second."""
    z = work.z
    a, b = model.side[i, 0], model.side[i, 1]
    c, s = np.cos(z[b, 2]), np.sin(z[b, 2])
    nx = c * model.normal[i, 0] - s * model.normal[i, 1]
    ny = s * model.normal[i, 0] + c * model.normal[i, 1]
    return nx, ny, z[a, 0] - z[b, 0], z[a, 1] - z[b, 1]


@kernel
def distance_of_row(model: ModelArrays, work: Work, i: int) -> tuple[float, float, float]:
    """Unit vector from the second to the first marker, and their distance."""
    z = work.z
    a, b = model.side[i, 0], model.side[i, 1]
    dx, dy = z[a, 0] - z[b, 0], z[a, 1] - z[b, 1]
    length = np.hypot(dx, dy)
    if not length > 0.0:
        return 1.0, 0.0, 0.0
    return dx / length, dy / length, length


@kernel
def row_gradient(model: ModelArrays, work: Work, i: int, g: Vector) -> float:
    """Value of a row; its gradient with respect to (z_a, z_b) goes to g (6,)."""
    z = work.z
    for j in range(6):
        g[j] = 0.0
    kind = model.kind[i]
    if kind == LINE:
        nx, ny, dx, dy = line_of_row(model, work, i)
        g[0], g[1], g[3], g[4] = nx, ny, -nx, -ny
        g[5] = nx * dy - ny * dx
        return nx * dx + ny * dy
    if kind == DISTANCE:
        ex, ey, length = distance_of_row(model, work, i)
        g[0], g[1], g[3], g[4] = ex, ey, -ex, -ey
        return length
    g[kind], g[3 + kind] = 1.0, -model.ratio[i]
    return z[model.side[i, 0], kind] - model.ratio[i] * z[model.side[i, 1], kind]


@kernel
def row_hessian(model: ModelArrays, work: Work, i: int, u: Vector, out: Vector) -> None:
    """Set out (6,) to the Hessian of a row times u (6,)."""
    for j in range(6):
        out[j] = 0.0
    if model.kind[i] == LINE:
        nx, ny, dx, dy = line_of_row(model, work, i)
        out[0], out[1], out[3], out[4] = -ny * u[5], nx * u[5], ny * u[5], -nx * u[5]
        out[5] = nx * (u[1] - u[4]) - ny * (u[0] - u[3]) - (nx * dx + ny * dy) * u[5]
    elif model.kind[i] == DISTANCE:
        ex, ey, length = distance_of_row(model, work, i)
        across = (ex * (u[1] - u[4]) - ey * (u[0] - u[3])) / length
        out[0], out[1], out[3], out[4] = -ey * across, ex * across, ey * across, -ex * across


@kernel
def row_third(model: ModelArrays, work: Work, i: int, u: Vector, out: Vector) -> None:
    """Set out (6,) to the gradient of u . Hessian u at fixed u (6,)."""
    for j in range(6):
        out[j] = 0.0
    if model.kind[i] == LINE:
        nx, ny, dx, dy = line_of_row(model, work, i)
        q = u[5] * u[5]
        out[0], out[1], out[3], out[4] = -nx * q, -ny * q, nx * q, ny * q
        out[5] = -2.0 * (nx * (u[0] - u[3]) + ny * (u[1] - u[4])) * u[5]
        out[5] -= (nx * dy - ny * dx) * q
    elif model.kind[i] == DISTANCE:
        # u . Hessian u = c^2 / length, c the part of the difference across e; de = J e c / length.
        ex, ey, length = distance_of_row(model, work, i)
        along = ex * (u[0] - u[3]) + ey * (u[1] - u[4])
        across = (ex * (u[1] - u[4]) - ey * (u[0] - u[3])) / length
        px = across * (2.0 * along * ey / length - across * ex)
        py = -across * (2.0 * along * ex / length + across * ey)
        out[0], out[1], out[3], out[4] = px, py, -px, -py


@kernel
def evaluate_rows(model: ModelArrays, eq: Equations, work: Work, instant: int) -> None:
    """Constraints on positions and velocities, and the constraint Jacobian, at an instant."""
    place_markers(model, eq, work, instant)
    C, zd, gradients = eq.C, work.zd, work.g
    for i in range(model.kind.size):
        a, b = model.side[i, 0], model.side[i, 1]
        g, row = gradients[i], C[i]
        eq.value[i] = row_gradient(model, work, i, g) - model.drive[instant, i, 0]
        rate = -model.drive[instant, i, 1]
        for j in range(3):
            rate += g[j] * zd[a, j] + g[3 + j] * zd[b, j]
        eq.rate[i] = rate
        for j in range(eq.r.size):
            row[j] = 0.0
        marker_pull(model, work, a, g, 0, row)
        marker_pull(model, work, b, g, 3, row)


@kernel
def marker_velocities(model: ModelArrays, work: Work, i: int) -> None:
    """Gather the velocities of the two markers of a row in work.u."""
    for j in range(3):
        work.u[j] = work.zd[model.side[i, 0], j]
        work.u[3 + j] = work.zd[model.side[i, 1], j]


@kernel
def row_accelerations(model: ModelArrays, eq: Equations, work: Work, instant: int) -> None:
    """Second derivatives of the constraints in time, eq.acceleration."""
    marker_accelerations(model, eq, work, instant)
    u, h = work.u, work.hessian
    for i in range(model.kind.size):
        total = -model.drive[instant, i, 2]
        marker_velocities(model, work, i)
        row_hessian(model, work, i, u, h)
        for j in range(6):
            total += h[j] * u[j]
            total += work.g[i, j] * work.zdd[model.side[i, j // 3], j % 3]
        eq.acceleration[i] = total


@kernel
def row_curvatures(model: ModelArrays, eq: Equations, work: Work) -> None:
    """Add d(C_y^T lam)/dy to eq.Ky, and put d(C_y v + C_t)/dy into eq.D."""
    for i in range(model.kind.size):
        row, h, lam = eq.D[i], work.hz[i], eq.lam[i]
        for j in range(eq.r.size):
            row[j] = 0.0
        curved = model.kind[i] >= LINE
        if curved:
            marker_velocities(model, work, i)
            row_hessian(model, work, i, work.u, h)
        for side in range(2):
            m = model.side[i, side]
            b = model.marker_body[m]
            if b < 0:
                continue
            o = model.first[b]
            omega = eq.v[o + ROTATION]
            gx, gy = work.g[i, 3 * side], work.g[i, 3 * side + 1]
            if curved:
                marker_pull(model, work, m, h, 3 * side, row)
            row[o + ROTATION] += gy * work.swing[m, 0] - gx * work.swing[m, 1]
            row[o + ROTATION] -= omega * (gx * work.arm[m, 0] + gy * work.arm[m, 1])
            for j in range(model.modes[b]):
                row[o + RIGID + j] += omega * (gy * work.P[m, 0, j] - gx * work.P[m, 1, j])
            pull_bend(model, work, m, gx, gy, row)
            add_arm_stiffness(model, eq, work, m, gx, gy, lam)
        # The Hessian of a line fixed to the ground or to a prescribed marker does not reach y.
        if curved and (model.kind[i] == DISTANCE or model.marker_body[model.side[i, 1]] >= 0):
            add_row_hessian(model, eq, work, i)


@kernel
def add_row_hessian(model: ModelArrays, eq: Equations, work: Work, i: int) -> None:
    """Add lam z_y^T g_zz z_y of a row to eq.Ky."""
    n, Ky, unit, column, u, h = eq.r.size, eq.Ky, work.unit, work.column, work.u, work.hessian
    a, b, factor = model.side[i, 0], model.side[i, 1], eq.lam[i]
    for j in range(n):
        unit[j] = 0.0
    for side in range(2):
        body = model.marker_body[model.side[i, side]]
        if body < 0 or (side == 1 and body == model.marker_body[a]):
            continue
        o = model.first[body]
        for j in range(o, o + RIGID + model.modes[body]):
            unit[j] = 1.0
            marker_push(model, work, a, unit, u, 0)
            marker_push(model, work, b, unit, u, 3)
            unit[j] = 0.0
            row_hessian(model, work, i, u, h)
            for p in range(n):
                column[p] = 0.0
            marker_pull(model, work, a, h, 0, column)
            marker_pull(model, work, b, h, 3, column)
            for p in range(n):
                Ky[p, j] += factor * column[p]


@kernel
def rows_pullback(model: ModelArrays, eq: Equations, work: Work, instant: int) -> None:
    """Subtract the derivative of Q from eq.y_bar, eq.v_bar and work.marker_bars.

        Q = sum over rows of  lam g_z.dz + on_values g + on_rates g_z.z'
                              + on_accelerations (g_z.z'' + z'.g_zz z')

    with dz = z_y adjoint, at fixed lam and adjoints. Of geometric stiffness at markers, the
    derivative is the symmetric part of what is added. Markers must have been placed.
    """
    marker_accelerations(model, eq, work, instant)
    dz, u, h, third, bars = work.du, work.u, work.hessian, work.third, work.bars
    for i in range(model.kind.size):
        a, b = model.side[i, 0], model.side[i, 1]
        lam, m2, m3, m4 = eq.lam[i], eq.on_values[i], eq.on_rates[i], eq.on_accelerations[i]
        marker_push(model, work, a, eq.adjoint, dz, 0)
        marker_push(model, work, b, eq.adjoint, dz, 3)
        g = work.g[i]
        for j in range(6):
            bars[PLACE, j] = -m2 * g[j]
            bars[SHIFT, j] = -lam * g[j]
            bars[VELOCITY, j] = -m3 * g[j]
            bars[ACCELERATION, j] = -m4 * g[j]
        if model.kind[i] >= LINE:
            row_hessian(model, work, i, dz, h)
            for j in range(6):
                bars[PLACE, j] -= lam * h[j]
            marker_velocities(model, work, i)
            row_hessian(model, work, i, u, h)
            row_third(model, work, i, u, third)
            for j in range(6):
                bars[PLACE, j] -= m3 * h[j] + m4 * third[j]
                bars[VELOCITY, j] -= 2.0 * m4 * h[j]
            if m4 != 0.0:
                for j in range(6):
                    u[j] = work.zdd[model.side[i, j // 3], j % 3]
                row_hessian(model, work, i, u, h)
                for j in range(6):
                    bars[PLACE, j] -= m4 * h[j]
        for side in range(2):
            if model.marker_body[model.side[i, side]] >= 0:
                marker_pullback(model, eq, work, model.side[i, side], 3 * side)
