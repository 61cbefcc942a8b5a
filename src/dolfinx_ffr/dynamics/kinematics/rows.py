# SPDX-License-Identifier: MIT
"""Rows: scalar functions of vectors that are the constraints of joints or the lengths of springs.

A row is a scalar g(s_1, s_2, ...) of vectors; a new kind needs its value and its first three
derivatives (``row_gradient``, ``row_hessian``, ``row_third``), the derivatives by its normal and
ratio (``rows_pullback``) where it uses these, and its vectors in the plane (lowering_plane.py). A
spring with stiffness k and damping d is a row whose multiplier is k (g - c(t)) + d g'.

ANGLE, GEAR and MESH are sums of Re(f log z), z = x . (one + i two): an angle, the imaginary part of
log z, of a vector x against two directions has the factor -i. GEAR has two angles. MESH has the
angles of its two wheels and the logarithm of the line between their centres, from which both angles
are counted; in the plane its wheels are spins, and the line alone has a logarithm. Other angles of
the plane are rows POINT of spins, see lowering_plane.py.
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
    MESH,
    OF_SPIN,
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
#: Number of the logarithm of the line of a row MESH, after the logarithms of its angles.
LINE = 2


@kernel
def has_spins(model: Arrays, i: int) -> bool:
    """Whether a row MESH takes the angles of its wheels from spins, and not from directions."""
    return model.vector_kind[model.side[i, 0]] == OF_SPIN


@kernel
def logs_of(model: Arrays, i: int) -> tuple[int, int]:
    """First of the logarithms of a row, and the number after the last: angles, then the line."""
    if model.kind[i] == MESH:
        return LINE if has_spins(model, i) else 0, LINE + 1
    return 0, 1 if model.kind[i] == ANGLE else 2


@kernel
def factors_of(model: Arrays, i: int) -> tuple[float, float, float]:
    """Factors of the two angles of a row, and of the logarithm of the length of its line."""
    if model.kind[i] == MESH:
        return model.normal[i, 0], model.normal[i, 1], model.ratio[i]
    return 1.0, -model.ratio[i], 0.0


@kernel
def log_term(
    model: Arrays, i: int, which: int, factors: tuple[float, float, float]
) -> tuple[int, int, int, complex]:
    """Places in a row of x, of the vector subtracted from it and of the first direction; factor f.

    A place is -1 where no vector is subtracted, and where the directions are the axes of the plane.
    """
    first, second, radial = factors
    factor = complex(0.0, -first if which == 0 else -second)
    if model.kind[i] != MESH:
        return 3 * which, -1, 3 * which + 1, factor
    one = -1 if has_spins(model, i) else 4
    if which == LINE:
        return 2, 3, one, complex(radial, first + second)
    return which, -1, one, factor


@kernel
def log_vectors(
    model: Arrays,
    work: Work,
    term: tuple[int, int, int, complex],
    values: Vector,
    unit: float,
    slot: int,
) -> tuple[Vector, Vector, Vector]:
    """Vectors x, one and two of a logarithm, from the ``values`` of all vectors of the row.

    Axes of the plane have this unit, zero for changes. Slots are of work.vectors, three each.
    """
    (at, origin, one, _), d, x = term, model.d, work.vectors[slot]
    for k in range(d):
        x[k] = values[d * at + k] - (values[d * origin + k] if origin >= 0 else 0.0)
    if one >= 0:
        return x, values[d * one : d * one + d], values[d * one + d : d * one + 2 * d]
    axis_x, axis_y = work.vectors[slot + 1], work.vectors[slot + 2]
    axis_x[0], axis_x[1], axis_y[0], axis_y[1] = unit, 0.0, 0.0, unit
    return x, axis_x, axis_y


@kernel
def add_log(
    model: Arrays,
    term: tuple[int, int, int, complex],
    by_z: complex,
    by_rate: complex,
    vectors: tuple[Vector, Vector, Vector],
    changes: tuple[Vector, Vector, Vector],
    out: Vector,
) -> None:
    """Add the gradient of Re(by_z z + by_rate z'); z' is the change of z by ``changes``."""
    (at, origin, one, _), (x, a, b), (ux, ua, ub), d = term, vectors, changes, model.d
    for j in range(d):
        share = (by_z * complex(a[j], b[j]) + by_rate * complex(ua[j], ub[j])).real
        out[d * at + j] += share
        if origin >= 0:
            out[d * origin + j] -= share
        if one >= 0:
            by_directions = by_z * x[j] + by_rate * ux[j]
            out[d * one + j] += by_directions.real
            out[d * one + d + j] -= by_directions.imag


@kernel
def logs_gradient(
    model: Arrays, work: Work, i: int, instant: int, factors: tuple[float, float, float], g: Vector
) -> float:
    """Value of a row of logarithms with any factors; its gradient is added to g."""
    (first, second, radial), (begin, end) = factors, logs_of(model, i)
    side, value, psi = model.side[i], 0.0, 0.0
    gather(model, i, work.s, work.places)
    for which in range(end - 1, begin - 1, -1):  # the line first
        term = log_term(model, i, which, factors)
        at, _, one, factor = term
        vectors = log_vectors(model, work, term, work.places, 1.0, 2)
        x, a, b = vectors
        z = complex(inner(model, x, a), inner(model, x, b))
        add_log(model, term, factor / z, 0j, vectors, vectors, g)
        angle = math.atan2(z.imag, z.real)
        if which == LINE:
            value, psi = radial * math.log(abs(z)), angle
        else:
            directions = (side[at], side[one], side[one + 1])
            angle = counted(model, work, i, instant, which, directions, angle - psi)
            value += (first if which == 0 else second) * angle
    if begin == LINE:
        psi = nearest(psi, work.base_angles[i, 0])
        work.angles[i, 0] = psi
        g[0] += first
        g[model.d] += second
        value += first * (work.s[side[0], 0] - psi) + second * (work.s[side[1], 0] - psi)
    return value


@kernel
def add_logs(
    model: Arrays,
    work: Work,
    i: int,
    factors: tuple[float, float, float],
    u: Vector,
    third: bool,
    out: Vector,
) -> None:
    """Add the Hessian times u of a row of logarithms, or the gradient of u . Hessian u at fixed u.

    The latter is the gradient of Re(f (z'' / z - z'^2 / z^2)).
    """
    begin, end = logs_of(model, i)
    gather(model, i, work.s, work.places)
    for which in range(begin, end):
        term = log_term(model, i, which, factors)
        vectors = log_vectors(model, work, term, work.places, 1.0, 2)
        changes = log_vectors(model, work, term, u, 0.0, 5)
        (x, a, b), (ux, ua, ub), factor = vectors, changes, term[3]
        z = complex(inner(model, x, a), inner(model, x, b))
        rate = complex(
            inner(model, ux, a) + inner(model, x, ua), inner(model, ux, b) + inner(model, x, ub)
        )
        by_rate = factor / z
        by_z = -by_rate * rate / z
        if third:
            second = 2.0 * complex(inner(model, ux, ua), inner(model, ux, ub))
            by_z = -(2.0 * by_z * rate + by_rate * second) / z
            by_rate = -2.0 * by_rate * rate / z
        add_log(model, term, by_z, by_rate, vectors, changes, out)


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
    b, slot, base_instant = model.vector_body[e], model.vector_slot[e], work.base_instant[0]
    if b >= 0:
        return dot(work.turned[b], axis)
    turn = 0.0
    for k in range(3):
        since = (
            model.prescribed_turn[instant, slot, k] - model.prescribed_turn[base_instant, slot, k]
        )
        turn += axis[k] * since
    return turn


@kernel
def counted(
    model: Arrays,
    work: Work,
    i: int,
    instant: int,
    which: int,
    directions: tuple[int, int, int],
    angle: float,
) -> float:
    """First or second angle of a row, full turns counted from the beginning of the step.

    It is the angle of the first of three directions, numbers of vectors, about the axis that the
    other two are perpendicular to.
    """
    (turning, side_x, side_y), axis = directions, work.vectors[0]
    cross(work.s[side_x], work.s[side_y], axis)
    turn = turn_of(model, work, turning, instant, axis) - turn_of(
        model, work, side_x, instant, axis
    )
    work.angles[i, which] = nearest(angle, work.base_angles[i, which] + turn)
    return work.angles[i, which]


@kernel
def row_gradient(model: Arrays, work: Work, i: int, instant: int, g: Vector) -> float:
    """Value of a row; its gradient with respect to the vectors goes to g."""
    d, kind, ratio = model.d, model.kind[i], model.ratio[i]
    for j in range(d * model.sides):
        g[j] = 0.0
    if kind >= ANGLE:
        return logs_gradient(model, work, i, instant, factors_of(model, i), g)
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
        if model.side[i, 2] >= 0:
            c = work.s[model.side[i, 2]]
            for k in range(d):
                n = model.normal[i, k] * (1.0 - ratio)
                g[2 * d + k] = -n
                value -= n * c[k]
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
        add_logs(model, work, i, factors_of(model, i), u, False, out)


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
    elif kind >= ANGLE:
        add_logs(model, work, i, factors_of(model, i), u, True, out)


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
            for column in range(model.sides):
                f = model.side[i, column]
                if f < 0 or model.vector_body[f] < 0:
                    continue
                p, L, begin, none = (
                    model.first[model.vector_body[f]],
                    work.L[f],
                    model.d * column,
                    True,
                )
                for k in range(model.d):
                    none = none and h[begin + k] == 0.0
                if none:
                    continue
                for q in range(model.rigid + model.modes[model.vector_body[f]]):
                    total = 0.0
                    for k in range(model.d):
                        total += L[k, q] * h[begin + k]
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
        elif model.kind[i] == GEAR or model.kind[i] == MESH:
            factors_pullback(model, eq, work, i, instant)


@kernel
def point_pullback(model: Arrays, work: Work, i: int, factor: float, values: Matrix) -> None:
    """Subtract the derivative of factor times row i by its normal and ratio; kind POINT.

    The row is n . (a - ratio b - (1 - ratio) c), a, b, c being values of its vectors.
    """
    a, b, ratio = values[model.side[i, 0]], values[model.side[i, 1]], model.ratio[i]
    for k in range(model.d):
        work.normal_bars[i, k] -= factor * (a[k] - ratio * b[k])
        work.ratio_bars[i] += factor * model.normal[i, k] * b[k]
    if model.side[i, 2] >= 0:
        c = values[model.side[i, 2]]
        for k in range(model.d):
            work.normal_bars[i, k] += factor * (1.0 - ratio) * c[k]
            work.ratio_bars[i] -= factor * model.normal[i, k] * c[k]


@kernel
def factors_pullback(model: Arrays, eq: Equations, work: Work, i: int, instant: int) -> None:
    """Subtract the derivative of the share of Q of a row GEAR or MESH by its factors."""
    g, h, u, gear = work.third, work.hz, work.u, model.kind[i] == GEAR
    for which in range(1 if gear else 0, 2 if gear else 3):
        factors = (
            1.0 if which == 0 else 0.0,
            1.0 if which == 1 else 0.0,
            1.0 if which == 2 else 0.0,
        )
        for j in range(g.size):
            g[j] = h[j] = 0.0
        total = eq.on_values[i] * logs_gradient(model, work, i, instant, factors, g)
        gather(model, i, work.sd, u)
        add_logs(model, work, i, factors, u, False, h)
        for j in range(g.size):
            total += eq.on_rates[i] * g[j] * u[j] + eq.on_accelerations[i] * h[j] * u[j]
        gather(model, i, work.shift, u)
        for j in range(g.size):
            total += eq.lam[i] * g[j] * u[j]
        gather(model, i, work.sdd, u)
        for j in range(g.size):
            total += eq.on_accelerations[i] * g[j] * u[j]
        if gear:
            work.ratio_bars[i] += total
        elif which < LINE:
            work.normal_bars[i, which] -= total
        else:
            work.ratio_bars[i] -= total
