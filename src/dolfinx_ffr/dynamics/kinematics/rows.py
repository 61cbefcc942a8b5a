# SPDX-License-Identifier: MIT
"""Rows: functions of vectors, of which joints are constraints and springs have laws.

A row is a scalar g(s_1, s_2, ...) of vectors; a new kind needs no more than its value and its first
three derivatives (``row_gradient``, ``row_hessian``, ``row_third``). A spring with stiffness k and
damping d is a row whose multiplier is k (g - c(t)) + d g'.

The angle of ANGLE and GEAR is the imaginary part of log z, z = s_1 . (s_2 + i s_3). In the plane
there are none: they are rows POINT of spins, see lowering.py.
"""

from __future__ import annotations

import math

from ..compilation import Matrix, Vector, kernel
from ..equations import Equations
from .algebra import cross, dot, inner
from .arrays import (
    ACCELERATION,
    ANGLE,
    DISTANCE,
    DOT,
    GEAR,
    PLACE,
    PLANE,
    POINT,
    SHIFT,
    VELOCITY,
    Arrays,
    Work,
)
from .vectors import place_vectors, pull, pull_velocity, vector_accelerations

#: A turn [rad].
TURN = 2.0 * math.pi


@kernel
def three_vectors(model: Arrays, work: Work, i: int, at: int) -> tuple[Vector, Vector, Vector]:
    """The vectors of a row from number `at` on."""
    s, side = work.s, model.side[i]
    return s[side[at]], s[side[at + 1]], s[side[at + 2]]


@kernel
def angle_of(model: Arrays, work: Work, i: int, at: int) -> tuple[float, float, float]:
    """Real and imaginary part of z of three vectors of a row from number `at` on, its angle."""
    one, two, three = three_vectors(model, work, i, at)
    x, y = dot(one, two), dot(one, three)
    return x, y, math.atan2(y, x)


@kernel
def angle_gradient(model: Arrays, work: Work, i: int, at: int, factor: float, g: Vector) -> float:
    """Angle of three vectors; factor times its gradient is added to g[3 at:]."""
    x, y, angle = angle_of(model, work, i, at)
    q = x * x + y * y
    # 1 / z = (x - i y) / q
    a, b = x / q, -y / q
    one, two, three = three_vectors(model, work, i, at)
    for k in range(3):
        g[3 * at + k] += factor * (a * three[k] + b * two[k])
        g[3 * at + 3 + k] += factor * b * one[k]
        g[3 * at + 6 + k] += factor * a * one[k]
    return angle


@kernel
def angle_hessian(
    model: Arrays, work: Work, i: int, at: int, factor: float, u: Vector, out: Vector
) -> None:
    """Add factor times the Hessian of an angle times u."""
    x, y, _ = angle_of(model, work, i, at)
    one, two, three = three_vectors(model, work, i, at)
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
    model: Arrays, work: Work, i: int, at: int, factor: float, u: Vector, out: Vector
) -> None:
    """Add factor times the gradient of u . Hessian u of an angle at fixed u.

    It is that of Im(z'' / z - z'^2 / z^2).
    """
    x, y, _ = angle_of(model, work, i, at)
    one, two, three = three_vectors(model, work, i, at)
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
def line_of_row(model: Arrays, work: Work, i: int, out: Vector) -> float:
    """Set out to the unit vector from the second to the first point of a row; their distance."""
    a, b = work.s[model.side[i, 0]], work.s[model.side[i, 1]]
    for k in range(model.d):
        out[k] = a[k] - b[k]
    length = math.sqrt(inner(model, out, out))
    if not length > 0.0:
        for k in range(model.d):
            out[k] = 0.0
        out[0] = 1.0
        return 0.0
    for k in range(model.d):
        out[k] /= length
    return length


@kernel
def line_change(
    model: Arrays, work: Work, i: int, u: Vector
) -> tuple[Vector, Vector, float, float]:
    """Unit vector along a row's line, change of the line by u, length, share of the change along.

    Points that coincide have no line: the length is infinite, and derivatives of it are zero.
    """
    e, p = work.vectors[0], work.vectors[1]
    length = line_of_row(model, work, i, e)
    for k in range(model.d):
        p[k] = u[k] - u[model.d + k]
    return e, p, length if length > 0.0 else math.inf, inner(model, e, p)


@kernel
def nearest(angle: float, to: float) -> float:
    """The angle plus the number of turns that makes it closest to another."""
    return angle + TURN * round((to - angle) / TURN)


@kernel
def turn_of(model: Arrays, work: Work, e: int, instant: int, axis: Vector) -> float:
    """Angle by which the marker of a vector has turned about an axis within the step."""
    b, slot, before = model.vector_body[e], model.vector_slot[e], work.base_instant[0]
    if b >= 0:
        return dot(work.turned[b], axis)
    turn = 0.0
    for k in range(3):
        since = model.prescribed_turn[instant, slot, k] - model.prescribed_turn[before, slot, k]
        turn += axis[k] * since
    return turn


@kernel
def counted(model: Arrays, work: Work, i: int, instant: int, which: int, angle: float) -> float:
    """First or second angle of a row, full turns counted from the beginning of the step."""
    one, two, axis = model.side[i, 3 * which], model.side[i, 3 * which + 1], work.vectors[0]
    cross(work.s[two], work.s[model.side[i, 3 * which + 2]], axis)
    turn = turn_of(model, work, one, instant, axis) - turn_of(model, work, two, instant, axis)
    work.angles[i, which] = nearest(angle, work.base_angles[i, which] + turn)
    return work.angles[i, which]


@kernel
def row_gradient(model: Arrays, work: Work, i: int, instant: int, g: Vector) -> float:
    """Value of a row; its gradient with respect to the vectors goes to g."""
    d, kind, ratio = model.d, model.kind[i], model.ratio[i]
    for j in range(d * model.sides):
        g[j] = 0.0
    if kind == ANGLE or kind == GEAR:
        first = counted(model, work, i, instant, 0, angle_gradient(model, work, i, 0, 1.0, g))
        if kind == ANGLE:
            return first
        second = angle_gradient(model, work, i, 3, -ratio, g)
        return first - ratio * counted(model, work, i, instant, 1, second)
    if kind == DISTANCE:
        length = line_of_row(model, work, i, g)
        for k in range(d):
            g[d + k] = -g[k]
        return length
    a, b = work.s[model.side[i, 0]], work.s[model.side[i, 1]]
    value = 0.0
    if kind == POINT:
        for k in range(d):
            n = model.normal[i, k]
            g[k], g[d + k] = n, -ratio * n
            value += n * (a[k] - ratio * b[k])
    elif kind == DOT:
        for k in range(d):
            g[k], g[d + k] = b[k], a[k]
        return inner(model, a, b)
    else:
        normal = work.s[model.side[i, 2]]
        for k in range(d):
            n = normal[k]
            g[k], g[d + k], g[2 * d + k] = n, -n, a[k] - b[k]
            value += n * (a[k] - b[k])
    return value


@kernel
def row_hessian(model: Arrays, work: Work, i: int, u: Vector, out: Vector) -> None:
    """Set out to the Hessian of a row times u."""
    d, kind = model.d, model.kind[i]
    for j in range(d * model.sides):
        out[j] = 0.0
    if kind == DOT:
        for k in range(d):
            out[k], out[d + k] = u[d + k], u[k]
    elif kind == PLANE:
        for k in range(d):
            out[k], out[d + k], out[2 * d + k] = u[2 * d + k], -u[2 * d + k], u[k] - u[d + k]
    elif kind == DISTANCE:
        e, p, length, along = line_change(model, work, i, u)
        for k in range(d):
            out[k] = (p[k] - along * e[k]) / length
            out[d + k] = -out[k]
    elif kind != POINT:
        angle_hessian(model, work, i, 0, 1.0, u, out)
        if kind == GEAR:
            angle_hessian(model, work, i, 3, -model.ratio[i], u, out)


@kernel
def row_third(model: Arrays, work: Work, i: int, u: Vector, out: Vector) -> None:
    """Set out to the gradient of u . Hessian u at fixed u."""
    d, kind = model.d, model.kind[i]
    for j in range(d * model.sides):
        out[j] = 0.0
    if kind == DISTANCE:
        e, p, length, along = line_change(model, work, i, u)
        across = inner(model, p, p) - along * along
        inverse = 1.0 / (length * length)
        for k in range(d):
            out[k] = -(across * e[k] + 2.0 * along * (p[k] - along * e[k])) * inverse
            out[d + k] = -out[k]
    elif kind == ANGLE or kind == GEAR:
        angle_third(model, work, i, 0, 1.0, u, out)
        if kind == GEAR:
            angle_third(model, work, i, 3, -model.ratio[i], u, out)


@kernel
def row_rate(model: Arrays, work: Work, i: int) -> float:
    """Derivative in time of the vectors' share of a row."""
    rate = 0.0
    # Component by component: equal and opposite shares of points cancel at once.
    for k in range(model.d):
        for side in range(model.sides):
            e = model.side[i, side]
            if e >= 0:
                rate += work.g[i, model.d * side + k] * work.sd[e, k]
    return rate


@kernel
def gradient_of_row(model: Arrays, work: Work, i: int, row: Vector) -> None:
    """Set row to the derivative of a row's value with respect to all coordinates."""
    for j in range(row.size):
        row[j] = 0.0
    for side in range(model.sides):
        e = model.side[i, side]
        if e >= 0:
            pull(model, work, e, work.g[i], model.d * side, row)


@kernel
def evaluate_rows(model: Arrays, eq: Equations, work: Work, instant: int) -> None:
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
        if eq.turning.size > 0:
            for j in range(eq.r.size):
                eq.Cy[i, j] = eq.C[i, j]
            model.into_coordinates(model, work, eq.Cy[i])


@kernel
def gather(model: Arrays, i: int, values: Matrix, out: Vector) -> None:
    """Set out to values (vectors, d) of the vectors of a row, side by side."""
    for side in range(model.sides):
        e = model.side[i, side]
        for k in range(model.d):
            out[model.d * side + k] = values[e, k] if e >= 0 else 0.0


@kernel
def row_accelerations(model: Arrays, eq: Equations, work: Work, instant: int) -> None:
    """Second derivatives of the constraints in time, eq.acceleration."""
    vector_accelerations(model, eq, work, instant)
    u, h, dz = work.u, work.hz, work.dz
    for i in range(eq.value.size):
        total = -model.drive[instant, i, 2]
        gather(model, i, work.sdd, dz)
        gather(model, i, work.sd, work.u)
        row_hessian(model, work, i, u, h)
        for j in range(model.d * model.sides):
            total += work.g[i, j] * dz[j]
        for j in range(model.d * model.sides):
            total += h[j] * u[j]
        eq.acceleration[i] = total


@kernel
def row_drift(model: Arrays, eq: Equations, work: Work, i: int, out: Vector) -> None:
    """Set out to the derivative of a row's rate with respect to y, rotations as dA = A [dth]."""
    for j in range(out.size):
        out[j] = 0.0
    curved = model.kind[i] != POINT
    if curved:
        gather(model, i, work.sd, work.u)
        row_hessian(model, work, i, work.u, work.hz)
    for side in range(model.sides):
        e = model.side[i, side]
        if e >= 0:
            pull_velocity(model, eq, work, e, work.g[i], model.d * side, out)
            if curved:
                pull(model, work, e, work.hz, model.d * side, out)


@kernel
def add_row_curvature(model: Arrays, eq: Equations, work: Work, i: int, factor: float) -> None:
    """Add factor times the derivative of a row's C_y^T with respect to y to eq.Ky.

    Shares of the curvatures of its vectors wait in work.forces for :func:`add_curvatures`.
    """
    u, h = work.u, work.hz
    for side in range(model.sides):
        e = model.side[i, side]
        if e >= 0:
            for k in range(model.d):
                work.forces[e, k] += factor * work.g[i, model.d * side + k]
    if model.kind[i] == POINT:
        return
    moving = 0
    for side in range(model.sides):
        if model.side[i, side] >= 0 and model.vector_body[model.side[i, side]] >= 0:
            moving += 1
    if moving == 1 and (model.kind[i] == DOT or model.kind[i] == PLANE):
        return  # they are linear in each of their vectors
    for side in range(model.sides):
        e = model.side[i, side]
        if e < 0 or model.vector_body[e] < 0:
            continue
        body = model.vector_body[e]
        o = model.first[body]
        for k in range(model.d * model.sides):
            u[k] = 0.0
        for j in range(model.rigid + model.modes[body]):
            if model.vector_kind[e] != 0 and j < model.d:
                continue  # directions do not move with the frame
            for k in range(model.d):
                u[model.d * side + k] = factor * work.L[e, k, j]
            row_hessian(model, work, i, u, h)
            for other in range(model.sides):
                f = model.side[i, other]
                if f < 0 or model.vector_body[f] < 0:
                    continue
                p, L, at, none = model.first[model.vector_body[f]], work.L[f], model.d * other, True
                for k in range(model.d):
                    none = none and h[at + k] == 0.0
                if none:
                    continue
                for q in range(model.rigid + model.modes[model.vector_body[f]]):
                    total = 0.0
                    for k in range(model.d):
                        total += L[k, q] * h[at + k]
                    eq.Ky[p + q, o + j] += total


@kernel
def row_curvatures(model: Arrays, eq: Equations, work: Work) -> None:
    """Add d(C_y^T lam)/dy to eq.Ky, and put d(C_y v + C_t)/dy into eq.D, by coordinates."""
    for i in range(eq.value.size):
        row_drift(model, eq, work, i, eq.D[i])
        model.into_coordinates(model, work, eq.D[i])
        add_row_curvature(model, eq, work, i, eq.lam[i])


@kernel
def row_pullback(
    model: Arrays,
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
    u, h, third, dz = work.u, work.hz, work.third, work.dz
    g = work.g[i]
    subtract(model, work, i, PLACE, on_value, g)
    subtract(model, work, i, SHIFT, lam, g)
    subtract(model, work, i, VELOCITY, on_rate, g)
    subtract(model, work, i, ACCELERATION, on_acceleration, g)
    if model.kind[i] == POINT:
        return
    gather(model, i, work.shift, dz)
    row_hessian(model, work, i, dz, h)
    subtract(model, work, i, PLACE, lam, h)
    gather(model, i, work.sd, work.u)
    row_hessian(model, work, i, u, h)
    row_third(model, work, i, u, third)
    subtract(model, work, i, PLACE, on_rate, h)
    subtract(model, work, i, PLACE, on_acceleration, third)
    subtract(model, work, i, VELOCITY, 2.0 * on_acceleration, h)
    if on_acceleration != 0.0:
        gather(model, i, work.sdd, u)
        row_hessian(model, work, i, u, h)
        subtract(model, work, i, PLACE, on_acceleration, h)


@kernel
def subtract(model: Arrays, work: Work, i: int, what: int, factor: float, values: Vector) -> None:
    """Subtract factor times values of the vectors of a row from work.bars."""
    for side in range(model.sides):
        e = model.side[i, side]
        if e >= 0:
            for k in range(model.d):
                work.bars[e, what, k] -= factor * values[model.d * side + k]


@kernel
def rows_pullback(model: Arrays, eq: Equations, work: Work, instant: int) -> None:
    """Subtract the derivative of the constraints' share of Q, see equations.py, from work.bars."""
    for i in range(eq.value.size):
        on_value, on_rate, on_second = eq.on_values[i], eq.on_rates[i], eq.on_accelerations[i]
        row_pullback(model, eq, work, i, eq.lam[i], on_value, on_rate, on_second)
        work.drive_bars[instant, i, 0] += on_value
        work.drive_bars[instant, i, 1] += on_rate
        work.drive_bars[instant, i, 2] += on_second
        if model.kind[i] == POINT:
            point_pullback(model, work, i, on_value, work.s)
            point_pullback(model, work, i, eq.lam[i], work.shift)
            point_pullback(model, work, i, on_rate, work.sd)
            point_pullback(model, work, i, on_second, work.sdd)
        elif model.kind[i] == GEAR:
            ratio_pullback(model, work, i, eq.lam[i], on_value, on_rate, on_second)


@kernel
def point_pullback(model: Arrays, work: Work, i: int, factor: float, values: Matrix) -> None:
    """Subtract the derivative of factor times a row POINT of values by its normal and ratio."""
    a, b, ratio = values[model.side[i, 0]], values[model.side[i, 1]], model.ratio[i]
    for k in range(model.d):
        work.normal_bars[i, k] -= factor * (a[k] - ratio * b[k])
        work.ratio_bars[i] += factor * model.normal[i, k] * b[k]


@kernel
def ratio_pullback(
    model: Arrays,
    work: Work,
    i: int,
    lam: float,
    on_value: float,
    on_rate: float,
    on_acceleration: float,
) -> None:
    """Subtract the derivative of a gear's share of Q by its ratio, minus that of its last angle."""
    g, h, u = work.third, work.hz, work.u
    for j in range(g.size):
        g[j] = h[j] = 0.0
    angle_gradient(model, work, i, 3, 1.0, g)
    gather(model, i, work.sd, u)
    angle_hessian(model, work, i, 3, 1.0, u, h)
    total = on_value * work.angles[i, 1]
    for j in range(9, 18):
        total += on_rate * g[j] * u[j] + on_acceleration * h[j] * u[j]
    gather(model, i, work.shift, u)
    for j in range(9, 18):
        total += lam * g[j] * u[j]
    gather(model, i, work.sdd, u)
    for j in range(9, 18):
        total += on_acceleration * g[j] * u[j]
    work.ratio_bars[i] += total
