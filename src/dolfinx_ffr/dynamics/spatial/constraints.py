# SPDX-License-Identifier: MIT
"""Rows: functions of vectors, of which joints are constraints and springs have laws.

A row is a scalar g(s_1, s_2, ...) of vectors; a new kind needs no more than its value and its first
three derivatives (``row_gradient``, ``row_hessian``, ``row_third``). A spring with stiffness k and
damping d is a row whose multiplier is k (g - c(t)) + d g'.

The angle of ANGLE and GEAR is the imaginary part of log z, z = s_1 . (s_2 + i s_3).
"""

from __future__ import annotations

import math

from ..compilation import Vector, kernel
from ..equations import Equations
from .algebra import dot
from .arrays import (
    ACCELERATION,
    ANGLE,
    COMPONENTS,
    DISTANCE,
    DOT,
    GEAR,
    PLACE,
    PLANE,
    POINT,
    RIGID,
    ROTATION,
    SHIFT,
    SIDES,
    VELOCITY,
    ModelArrays,
    Work,
)
from .vectors import (
    place_vectors,
    pull,
    pull_velocity,
    vector_accelerations,
)

#: A turn [rad].
TURN = 2.0 * math.pi


@kernel
def angle_of(model: ModelArrays, work: Work, i: int, at: int) -> tuple[float, float, float]:
    """Real and imaginary part of z of three vectors of a row from number `at` on, its angle."""
    one, two, three = (
        work.s[model.side[i, at]],
        work.s[model.side[i, at + 1]],
        work.s[model.side[i, at + 2]],
    )
    x, y = dot(one, two), dot(one, three)
    return x, y, math.atan2(y, x)


@kernel
def angle_gradient(
    model: ModelArrays, work: Work, i: int, at: int, factor: float, g: Vector
) -> float:
    """Angle of three vectors; factor times its gradient is added to g[3 at:]."""
    x, y, angle = angle_of(model, work, i, at)
    q = x * x + y * y
    # 1 / z = (x - i y) / q
    a, b = x / q, -y / q
    one, two, three = (
        work.s[model.side[i, at]],
        work.s[model.side[i, at + 1]],
        work.s[model.side[i, at + 2]],
    )
    for k in range(3):
        g[3 * at + k] += factor * (a * three[k] + b * two[k])
        g[3 * at + 3 + k] += factor * b * one[k]
        g[3 * at + 6 + k] += factor * a * one[k]
    return angle


@kernel
def angle_hessian(
    model: ModelArrays, work: Work, i: int, at: int, factor: float, u: Vector, out: Vector
) -> None:
    """Add factor times the Hessian of an angle times u."""
    x, y, _ = angle_of(model, work, i, at)
    one, two, three = (
        work.s[model.side[i, at]],
        work.s[model.side[i, at + 1]],
        work.s[model.side[i, at + 2]],
    )
    o = 3 * at
    xd = dot(u[o : o + 3], two) + dot(one, u[o + 3 : o + 6])
    yd = dot(u[o : o + 3], three) + dot(one, u[o + 6 : o + 9])
    q = x * x + y * y
    a, b = x / q, -y / q  # 1 / z
    # z' / z^2
    r, s = xd * a - yd * b, xd * b + yd * a
    c, d = r * a - s * b, r * b + s * a
    for k in range(3):
        # Im of (u2 + i u3) / z - (s2 + i s3) z' / z^2, and so on
        out[o + k] += factor * (a * u[o + 6 + k] + b * u[o + 3 + k] - c * three[k] - d * two[k])
        out[o + 3 + k] += factor * (b * u[o + k] - d * one[k])
        out[o + 6 + k] += factor * (a * u[o + k] - c * one[k])


@kernel
def angle_third(
    model: ModelArrays, work: Work, i: int, at: int, factor: float, u: Vector, out: Vector
) -> None:
    """Add factor times the gradient of u . Hessian u of an angle at fixed u.

    It is that of Im(z'' / z - z'^2 / z^2).
    """
    x, y, _ = angle_of(model, work, i, at)
    one, two, three = (
        work.s[model.side[i, at]],
        work.s[model.side[i, at + 1]],
        work.s[model.side[i, at + 2]],
    )
    o = 3 * at
    zd = complex(
        dot(u[o : o + 3], two) + dot(one, u[o + 3 : o + 6]),
        dot(u[o : o + 3], three) + dot(one, u[o + 6 : o + 9]),
    )
    zdd = 2.0 * complex(dot(u[o : o + 3], u[o + 3 : o + 6]), dot(u[o : o + 3], u[o + 6 : o + 9]))
    inverse = 1.0 / complex(x, y)
    by_z = (2.0 * zd * zd * inverse - zdd) * inverse * inverse
    by_zd = -2.0 * zd * inverse * inverse
    for k in range(3):
        out[o + k] += (
            factor
            * (by_z * complex(two[k], three[k]) + by_zd * complex(u[o + 3 + k], u[o + 6 + k])).imag
        )
        out[o + 3 + k] += factor * (by_z * one[k] + by_zd * u[o + k]).imag
        out[o + 6 + k] += factor * (by_z * one[k] + by_zd * u[o + k]).real


@kernel
def line_of_row(model: ModelArrays, work: Work, i: int) -> tuple[float, float, float, float]:
    """Unit vector from the second to the first point of a row, and their distance."""
    a, b = work.s[model.side[i, 0]], work.s[model.side[i, 1]]
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    length = math.sqrt(x * x + y * y + z * z)
    if not length > 0.0:
        return 1.0, 0.0, 0.0, 0.0
    return x / length, y / length, z / length, length


@kernel
def nearest(angle: float, to: float) -> float:
    """The angle plus the number of turns that makes it closest to another."""
    return angle + TURN * round((to - angle) / TURN)


@kernel
def row_gradient(model: ModelArrays, work: Work, i: int, instant: int, g: Vector) -> float:
    """Value of a row; its gradient with respect to the vectors goes to g."""
    for j in range(COMPONENTS):
        g[j] = 0.0
    kind = model.kind[i]
    if kind == ANGLE or kind == GEAR:
        first = angle_gradient(model, work, i, 0, 1.0, g)
        first = nearest(first, work.turns[instant, i, 0])
        work.angles[i, 0] = first
        if kind == ANGLE:
            return first
        second = angle_gradient(model, work, i, 3, -model.ratio[i], g)
        second = nearest(second, work.turns[instant, i, 1])
        work.angles[i, 1] = second
        return first - model.ratio[i] * second
    if kind == DISTANCE:
        x, y, z, length = line_of_row(model, work, i)
        g[0], g[1], g[2], g[3], g[4], g[5] = x, y, z, -x, -y, -z
        return length
    a, b = work.s[model.side[i, 0]], work.s[model.side[i, 1]]
    value = 0.0
    if kind == DOT:
        for k in range(3):
            g[k], g[3 + k] = b[k], a[k]
        return dot(a, b)
    for k in range(3):
        n = model.normal[i, k] if kind == POINT else work.s[model.side[i, 2], k]
        g[k], g[3 + k] = n, -n
        value += n * (a[k] - b[k])
        if kind == PLANE:
            g[6 + k] = a[k] - b[k]
    return value


@kernel
def row_hessian(model: ModelArrays, work: Work, i: int, u: Vector, out: Vector) -> None:
    """Set out to the Hessian of a row times u."""
    for j in range(COMPONENTS):
        out[j] = 0.0
    kind = model.kind[i]
    if kind == DOT:
        for k in range(3):
            out[k], out[3 + k] = u[3 + k], u[k]
    elif kind == PLANE:
        for k in range(3):
            out[k], out[3 + k], out[6 + k] = u[6 + k], -u[6 + k], u[k] - u[3 + k]
    elif kind == DISTANCE:
        x, y, z, length = line_of_row(model, work, i)
        if not length > 0.0:
            return
        p, q, r = u[0] - u[3], u[1] - u[4], u[2] - u[5]
        along = x * p + y * q + z * r
        out[0], out[1], out[2] = (
            (p - along * x) / length,
            (q - along * y) / length,
            (r - along * z) / length,
        )
        for k in range(3):
            out[3 + k] = -out[k]
    elif kind == ANGLE or kind == GEAR:
        angle_hessian(model, work, i, 0, 1.0, u, out)
        if kind == GEAR:
            angle_hessian(model, work, i, 3, -model.ratio[i], u, out)


@kernel
def row_third(model: ModelArrays, work: Work, i: int, u: Vector, out: Vector) -> None:
    """Set out to the gradient of u . Hessian u at fixed u."""
    for j in range(COMPONENTS):
        out[j] = 0.0
    kind = model.kind[i]
    if kind == DISTANCE:
        x, y, z, length = line_of_row(model, work, i)
        if not length > 0.0:
            return
        p, q, r = u[0] - u[3], u[1] - u[4], u[2] - u[5]
        along = x * p + y * q + z * r
        across = p * p + q * q + r * r - along * along
        inverse = 1.0 / (length * length)
        out[0] = -(across * x + 2.0 * along * (p - along * x)) * inverse
        out[1] = -(across * y + 2.0 * along * (q - along * y)) * inverse
        out[2] = -(across * z + 2.0 * along * (r - along * z)) * inverse
        for k in range(3):
            out[3 + k] = -out[k]
    elif kind == ANGLE or kind == GEAR:
        angle_third(model, work, i, 0, 1.0, u, out)
        if kind == GEAR:
            angle_third(model, work, i, 3, -model.ratio[i], u, out)


@kernel
def row_rate(model: ModelArrays, work: Work, i: int) -> float:
    """Derivative in time of the vectors' share of a row."""
    rate = 0.0
    for side in range(SIDES):
        e = model.side[i, side]
        if e >= 0:
            rate += dot(work.g[i, 3 * side : 3 * side + 3], work.sd[e])
    return rate


@kernel
def gradient_of_row(model: ModelArrays, work: Work, i: int, row: Vector) -> None:
    """Set row to the derivative of a row's value with respect to all coordinates."""
    for j in range(row.size):
        row[j] = 0.0
    for side in range(SIDES):
        e = model.side[i, side]
        if e >= 0:
            pull(model, work, e, work.g[i], 3 * side, row)


@kernel
def evaluate_rows(model: ModelArrays, eq: Equations, work: Work, instant: int) -> None:
    """Constraints on positions and velocities, and their Jacobians, at an instant."""
    place_vectors(model, eq, work, instant)
    for i in range(model.kind.size):
        value = row_gradient(model, work, i, instant, work.g[i])
        if i >= eq.value.size:
            work.stretch[i - eq.value.size] = value
            continue
        value -= model.drive[instant, i, 0]
        if model.kind[i] == ANGLE:
            value = nearest(value, 0.0)
        eq.value[i] = value
        eq.rate[i] = row_rate(model, work, i) - model.drive[instant, i, 1]
        gradient_of_row(model, work, i, eq.C[i])
        for j in range(eq.r.size):
            eq.Cy[i, j] = eq.C[i, j]
        into_coordinates(model, work, eq.Cy[i])


@kernel
def into_coordinates(model: ModelArrays, work: Work, row: Vector) -> None:
    """Turn derivatives with respect to rotations dA = A [dth] into those to coordinates."""
    for b in range(model.first.size):
        p, T = model.first[b] + ROTATION, work.T[b]
        x, y, z = row[p], row[p + 1], row[p + 2]
        for k in range(3):
            row[p + k] = x * T[0, k] + y * T[1, k] + z * T[2, k]


@kernel
def gather_velocities(model: ModelArrays, work: Work, i: int) -> None:
    """Velocities of the vectors of a row side by side in work.u."""
    for side in range(SIDES):
        e = model.side[i, side]
        for k in range(3):
            work.u[3 * side + k] = work.sd[e, k] if e >= 0 else 0.0


@kernel
def row_accelerations(model: ModelArrays, eq: Equations, work: Work, instant: int) -> None:
    """Second derivatives of the constraints in time, eq.acceleration."""
    vector_accelerations(model, eq, work, instant)
    u, h = work.u, work.hz
    for i in range(eq.value.size):
        total = -model.drive[instant, i, 2]
        gather_velocities(model, work, i)
        row_hessian(model, work, i, u, h)
        for side in range(SIDES):
            e = model.side[i, side]
            if e >= 0:
                total += dot(work.g[i, 3 * side : 3 * side + 3], work.sdd[e])
        for j in range(COMPONENTS):
            total += h[j] * u[j]
        eq.acceleration[i] = total


@kernel
def row_drift(model: ModelArrays, eq: Equations, work: Work, i: int, out: Vector) -> None:
    """Set out to the derivative of a row's rate with respect to y, rotations as dA = A [dth]."""
    for j in range(out.size):
        out[j] = 0.0
    curved = model.kind[i] != POINT
    if curved:
        gather_velocities(model, work, i)
        row_hessian(model, work, i, work.u, work.hz)
    for side in range(SIDES):
        e = model.side[i, side]
        if e >= 0:
            pull_velocity(model, eq, work, e, work.g[i], 3 * side, out)
            if curved:
                pull(model, work, e, work.hz, 3 * side, out)


@kernel
def add_row_curvature(model: ModelArrays, eq: Equations, work: Work, i: int, factor: float) -> None:
    """Add factor times the derivative of a row's C_y^T with respect to y to eq.Ky.

    Shares of the curvatures of its vectors wait in work.forces for :func:`add_curvatures`.
    """
    u, h = work.u, work.hz
    for side in range(SIDES):
        e = model.side[i, side]
        if e >= 0:
            for k in range(3):
                work.forces[e, k] += factor * work.g[i, 3 * side + k]
    if model.kind[i] == POINT:
        return
    moving = 0
    for side in range(SIDES):
        if model.side[i, side] >= 0 and model.vector_body[model.side[i, side]] >= 0:
            moving += 1
    if moving == 1 and (model.kind[i] == DOT or model.kind[i] == PLANE):
        return  # they are linear in each of their vectors
    for side in range(SIDES):
        e = model.side[i, side]
        if e < 0 or model.vector_body[e] < 0:
            continue
        body = model.vector_body[e]
        o = model.first[body]
        for k in range(COMPONENTS):
            u[k] = 0.0
        for j in range(RIGID + model.modes[body]):
            if model.vector_kind[e] != 0 and j < ROTATION:
                continue  # directions do not move with the frame
            for k in range(3):
                u[3 * side + k] = factor * work.L[e, k, j]
            row_hessian(model, work, i, u, h)
            for other in range(SIDES):
                f = model.side[i, other]
                if f < 0 or model.vector_body[f] < 0:
                    continue
                x, y, z = h[3 * other], h[3 * other + 1], h[3 * other + 2]
                if x == 0.0 and y == 0.0 and z == 0.0:
                    continue
                p, L = model.first[model.vector_body[f]], work.L[f]
                for q in range(RIGID + model.modes[model.vector_body[f]]):
                    eq.Ky[p + q, o + j] += L[0, q] * x + L[1, q] * y + L[2, q] * z


@kernel
def row_curvatures(model: ModelArrays, eq: Equations, work: Work) -> None:
    """Add d(C_y^T lam)/dy to eq.Ky, and put d(C_y v + C_t)/dy into eq.D, by coordinates."""
    for i in range(eq.value.size):
        row_drift(model, eq, work, i, eq.D[i])
        into_coordinates(model, work, eq.D[i])
        add_row_curvature(model, eq, work, i, eq.lam[i])


@kernel
def row_pullback(
    model: ModelArrays,
    eq: Equations,
    work: Work,
    i: int,
    lam: float,
    on_value: float,
    on_rate: float,
    on_acceleration: float,
) -> None:
    """Derivative of  lam g_s.ds + on_value g + on_rate g' + on_acceleration g''.

    With ds = L adjoint, at fixed factors and adjoint; :func:`begin_pullback` goes before it. It is
    subtracted from work.bars.
    """
    bars, u, h, third, dz = work.bars, work.u, work.hz, work.third, work.dz
    for side in range(SIDES):
        e = model.side[i, side]
        if e >= 0:
            for k in range(3):
                g = work.g[i, 3 * side + k]
                bars[e, PLACE, k] -= on_value * g
                bars[e, SHIFT, k] -= lam * g
                bars[e, VELOCITY, k] -= on_rate * g
                bars[e, ACCELERATION, k] -= on_acceleration * g
    if model.kind[i] == POINT:
        return
    for side in range(SIDES):
        e = model.side[i, side]
        for k in range(3):
            dz[3 * side + k] = work.shift[e, k] if e >= 0 else 0.0
    row_hessian(model, work, i, dz, h)
    subtract(model, work, i, PLACE, lam, h)
    gather_velocities(model, work, i)
    row_hessian(model, work, i, u, h)
    row_third(model, work, i, u, third)
    subtract(model, work, i, PLACE, on_rate, h)
    subtract(model, work, i, PLACE, on_acceleration, third)
    subtract(model, work, i, VELOCITY, 2.0 * on_acceleration, h)
    if on_acceleration != 0.0:
        for side in range(SIDES):
            e = model.side[i, side]
            for k in range(3):
                u[3 * side + k] = work.sdd[e, k] if e >= 0 else 0.0
        row_hessian(model, work, i, u, h)
        subtract(model, work, i, PLACE, on_acceleration, h)


@kernel
def subtract(
    model: ModelArrays, work: Work, i: int, what: int, factor: float, values: Vector
) -> None:
    """Subtract factor times values of the vectors of a row from work.bars."""
    for side in range(SIDES):
        e = model.side[i, side]
        if e >= 0:
            for k in range(3):
                work.bars[e, what, k] -= factor * values[3 * side + k]


@kernel
def rows_pullback(model: ModelArrays, eq: Equations, work: Work) -> None:
    """Subtract the derivative of the constraints' share of Q, see equations.py, from work.bars."""
    for i in range(eq.value.size):
        row_pullback(
            model,
            eq,
            work,
            i,
            eq.lam[i],
            eq.on_values[i],
            eq.on_rates[i],
            eq.on_accelerations[i],
        )
