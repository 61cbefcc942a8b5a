# SPDX-License-Identifier: MIT
"""Rows: functions of vectors, of which joints are constraints and springs have laws.

A row is a scalar g(s_1, s_2, ...) of vectors; a new kind needs no more than its value and its first
three derivatives (``row_gradient``, ``row_hessian``, ``row_third``). A spring with stiffness k and
damping d is a row whose multiplier is k (g - c(t)) + d g'.

The angle of ANGLE and GEAR is the imaginary part of log z, z = s_1 . (s_2 + i s_3). In the plane
there are none: they are rows POINT of spins, see lowering.py. MESH has three logarithms, those of
two directions of wheels and of the line between their centres; in the plane the angles of the
wheels are spins, and the logarithm is that of the line.
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


@kernel
def log_gradient(
    model: Arrays,
    x: Vector,
    one: Vector,
    two: Vector,
    factor: complex,
    places: tuple[int, int, int],
    g: Vector,
) -> complex:
    """Z = x . (one + i two); the gradient of Re(factor log z) is added to g.

    The places are those of the derivatives by x, one and two in g; constant directions, in the
    plane, have none, -1.
    """
    place, at_one, at_two = places
    z = complex(inner(model, x, one), inner(model, x, two))
    k = factor / z
    for j in range(model.d):
        g[place + j] += k.real * one[j] - k.imag * two[j]
        if at_one >= 0:
            g[at_one + j] += k.real * x[j]
            g[at_two + j] -= k.imag * x[j]
    return z


@kernel
def log_hessian(
    model: Arrays,
    x: Vector,
    one: Vector,
    two: Vector,
    factor: complex,
    places: tuple[int, int, int],
    u: tuple[Vector, Vector, Vector],
    out: Vector,
) -> None:
    """Add the Hessian of Re(factor log z) times changes u of x, one and two, see log_gradient."""
    place, at_one, at_two = places
    ux, u1, u2 = u
    z = complex(inner(model, x, one), inner(model, x, two))
    zd = complex(
        inner(model, ux, one) + inner(model, x, u1), inner(model, ux, two) + inner(model, x, u2)
    )
    k = factor / z
    kd = -k * zd / z
    for j in range(model.d):
        out[place + j] += (kd * complex(one[j], two[j]) + k * complex(u1[j], u2[j])).real
        if at_one >= 0:
            by_z = kd * x[j] + k * ux[j]
            out[at_one + j] += by_z.real
            out[at_two + j] -= by_z.imag


@kernel
def log_third(
    model: Arrays,
    x: Vector,
    one: Vector,
    two: Vector,
    factor: complex,
    places: tuple[int, int, int],
    u: tuple[Vector, Vector, Vector],
    out: Vector,
) -> None:
    """Add the gradient of u . Hessian u at fixed u, Re(factor (z'' / z - z'^2 / z^2))."""
    place, at_one, at_two = places
    ux, u1, u2 = u
    z = complex(inner(model, x, one), inner(model, x, two))
    zd = complex(
        inner(model, ux, one) + inner(model, x, u1), inner(model, ux, two) + inner(model, x, u2)
    )
    zdd = 2.0 * complex(inner(model, ux, u1), inner(model, ux, u2))
    inverse = 1.0 / z
    by_z = factor * (2.0 * zd * zd * inverse - zdd) * inverse * inverse
    by_zd = -2.0 * factor * zd * inverse * inverse
    for j in range(model.d):
        out[place + j] += (by_z * complex(one[j], two[j]) + by_zd * complex(u1[j], u2[j])).real
        if at_one >= 0:
            by_directions = by_z * x[j] + by_zd * ux[j]
            out[at_one + j] += by_directions.real
            out[at_two + j] -= by_directions.imag


@kernel
def three_vectors(model: Arrays, work: Work, i: int, at: int) -> tuple[Vector, Vector, Vector]:
    """The vectors of a row from number `at` on."""
    s, side = work.s, model.side[i]
    return s[side[at]], s[side[at + 1]], s[side[at + 2]]


@kernel
def three_changes(u: Vector, at: int) -> tuple[Vector, Vector, Vector]:
    """Changes of the vectors of a row in space from number `at` on."""
    o = 3 * at
    return u[o : o + 3], u[o + 3 : o + 6], u[o + 6 : o + 9]


@kernel
def angle_gradient(model: Arrays, work: Work, i: int, at: int, factor: float, g: Vector) -> float:
    """Angle of three vectors; factor times its gradient is added to g[3 at:]."""
    vector, direction_x, direction_y = three_vectors(model, work, i, at)
    places = (3 * at, 3 * at + 3, 3 * at + 6)
    z = log_gradient(model, vector, direction_x, direction_y, complex(0.0, -factor), places, g)
    return math.atan2(z.imag, z.real)


@kernel
def angle_hessian(
    model: Arrays, work: Work, i: int, at: int, factor: float, u: Vector, out: Vector
) -> None:
    """Add factor times the Hessian of an angle times u."""
    vector, direction_x, direction_y = three_vectors(model, work, i, at)
    places, k = (3 * at, 3 * at + 3, 3 * at + 6), complex(0.0, -factor)
    log_hessian(model, vector, direction_x, direction_y, k, places, three_changes(u, at), out)


@kernel
def angle_third(
    model: Arrays, work: Work, i: int, at: int, factor: float, u: Vector, out: Vector
) -> None:
    """Add factor times the gradient of u . Hessian u of an angle at fixed u."""
    vector, direction_x, direction_y = three_vectors(model, work, i, at)
    places, k = (3 * at, 3 * at + 3, 3 * at + 6), complex(0.0, -factor)
    log_third(model, vector, direction_x, direction_y, k, places, three_changes(u, at), out)


@kernel
def has_spins(model: Arrays, i: int) -> bool:
    """Whether a row MESH takes the angles of its wheels from spins, and not from directions."""
    return model.vector_kind[model.side[i, 0]] == OF_SPIN


@kernel
def mesh_axes(model: Arrays, work: Work, i: int) -> tuple[Vector, Vector, tuple[int, int, int]]:
    """Directions against which angles of a row MESH count, and places of the line's derivatives.

    In the plane they are x and y, and have no places.
    """
    d, line = model.d, 2 * model.d
    if not has_spins(model, i):
        axis_x, axis_y = work.s[model.side[i, 4]], work.s[model.side[i, 5]]
        return axis_x, axis_y, (line, 4 * d, 5 * d)
    axis_x, axis_y = work.vectors[3], work.vectors[4]
    axis_x[0], axis_x[1], axis_y[0], axis_y[1] = 1.0, 0.0, 0.0, 1.0
    return axis_x, axis_y, (line, -1, -1)


@kernel
def mesh_line(model: Arrays, work: Work, i: int) -> Vector:
    """Vector from the second to the first centre of a row MESH."""
    line, a, b = work.vectors[2], work.s[model.side[i, 2]], work.s[model.side[i, 3]]
    for k in range(model.d):
        line[k] = a[k] - b[k]
    return line


@kernel
def mesh_changes(model: Arrays, work: Work, i: int, u: Vector) -> tuple[Vector, Vector, Vector]:
    """Changes of the line and of the two directions of a row MESH by those of its vectors."""
    d, line, none = model.d, work.vectors[5], work.vectors[6]
    for k in range(d):
        line[k], none[k] = u[2 * d + k] - u[3 * d + k], 0.0
    if not has_spins(model, i):
        return line, u[4 * d : 5 * d], u[5 * d :]
    return line, none, none


@kernel
def mesh_gradient(
    model: Arrays, work: Work, i: int, instant: int, factors: tuple[float, float, float], g: Vector
) -> float:
    """Value of a row MESH with other factors than its own; its gradient is added to g."""
    first, second, radial = factors
    d, line = model.d, mesh_line(model, work, i)
    axis_x, axis_y, places = mesh_axes(model, work, i)
    z = log_gradient(model, line, axis_x, axis_y, complex(radial, first + second), places, g)
    for k in range(d):
        g[3 * d + k] -= g[2 * d + k]
    value, psi = radial * math.log(abs(z)), math.atan2(z.imag, z.real)
    if has_spins(model, i):
        psi = nearest(psi, work.base_angles[i, 0])
        work.angles[i, 0] = psi
        g[0] += first
        g[d] += second
        a, b = work.s[model.side[i, 0], 0], work.s[model.side[i, 1], 0]
        return value + first * (a - psi) + second * (b - psi)
    for wheel in range(2):
        number, factor = model.side[i, wheel], first if wheel == 0 else second
        places_of_wheel = (d * wheel, 4 * d, 5 * d)
        z = log_gradient(
            model, work.s[number], axis_x, axis_y, complex(0.0, -factor), places_of_wheel, g
        )
        angle = math.atan2(z.imag, z.real) - psi
        directions = (number, model.side[i, 4], model.side[i, 5])
        value += factor * counted(model, work, i, instant, wheel, directions, angle)
    return value


@kernel
def mesh_hessian(
    model: Arrays, work: Work, i: int, factors: tuple[float, float, float], u: Vector, out: Vector
) -> None:
    """Add the Hessian times u of a row MESH with other factors than its own."""
    first, second, radial = factors
    d, line = model.d, mesh_line(model, work, i)
    axis_x, axis_y, places = mesh_axes(model, work, i)
    changes, k = mesh_changes(model, work, i, u), complex(radial, first + second)
    log_hessian(model, line, axis_x, axis_y, k, places, changes, out)
    for j in range(d):
        out[3 * d + j] -= out[2 * d + j]
    if not has_spins(model, i):
        for wheel in range(2):
            x, k = work.s[model.side[i, wheel]], complex(0.0, -(first if wheel == 0 else second))
            changes_of_wheel = (u[d * wheel : d * wheel + d], changes[1], changes[2])
            log_hessian(
                model, x, axis_x, axis_y, k, (d * wheel, 4 * d, 5 * d), changes_of_wheel, out
            )


@kernel
def mesh_third(model: Arrays, work: Work, i: int, u: Vector, out: Vector) -> None:
    """Add the gradient of u . Hessian u of a row MESH at fixed u."""
    d, line = model.d, mesh_line(model, work, i)
    first, second, radial = model.normal[i, 0], model.normal[i, 1], model.ratio[i]
    axis_x, axis_y, places = mesh_axes(model, work, i)
    changes, k = mesh_changes(model, work, i, u), complex(radial, first + second)
    log_third(model, line, axis_x, axis_y, k, places, changes, out)
    for j in range(d):
        out[3 * d + j] -= out[2 * d + j]
    if not has_spins(model, i):
        for wheel in range(2):
            x, k = work.s[model.side[i, wheel]], complex(0.0, -model.normal[i, wheel])
            changes_of_wheel = (u[d * wheel : d * wheel + d], changes[1], changes[2])
            log_third(model, x, axis_x, axis_y, k, (d * wheel, 4 * d, 5 * d), changes_of_wheel, out)


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
    if kind == ANGLE or kind == GEAR:
        side = model.side[i]
        angle = angle_gradient(model, work, i, 0, 1.0, g)
        first = counted(model, work, i, instant, 0, (side[0], side[1], side[2]), angle)
        if kind == ANGLE:
            return first
        angle = angle_gradient(model, work, i, 3, -ratio, g)
        directions = (side[3], side[4], side[5])
        return first - ratio * counted(model, work, i, instant, 1, directions, angle)
    if kind == MESH:
        factors = (model.normal[i, 0], model.normal[i, 1], ratio)
        return mesh_gradient(model, work, i, instant, factors, g)
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
    elif kind == MESH:
        factors = (model.normal[i, 0], model.normal[i, 1], model.ratio[i])
        mesh_hessian(model, work, i, factors, u, out)
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
    elif kind == MESH:
        mesh_third(model, work, i, u, out)
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
        elif model.kind[i] == GEAR:
            ratio_pullback(model, work, i, eq.lam[i], on_value, on_rate, on_second)
        elif model.kind[i] == MESH:
            mesh_pullback(model, eq, work, i, instant)


@kernel
def point_pullback(model: Arrays, work: Work, i: int, factor: float, values: Matrix) -> None:
    """Subtract the derivative of factor times a row POINT of values by its normal and ratio."""
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


@kernel
def mesh_pullback(model: Arrays, eq: Equations, work: Work, i: int, instant: int) -> None:
    """Subtract the derivative of the share of Q of a row MESH by its three factors."""
    g, h, u = work.third, work.hz, work.u
    for which in range(3):
        first = 1.0 if which == 0 else 0.0
        second = 1.0 if which == 1 else 0.0
        radial = 1.0 if which == 2 else 0.0
        for j in range(g.size):
            g[j] = h[j] = 0.0
        value = mesh_gradient(model, work, i, instant, (first, second, radial), g)
        gather(model, i, work.sd, u)
        mesh_hessian(model, work, i, (first, second, radial), u, h)
        total = eq.on_values[i] * value
        for j in range(g.size):
            total += eq.on_rates[i] * g[j] * u[j] + eq.on_accelerations[i] * h[j] * u[j]
        gather(model, i, work.shift, u)
        for j in range(g.size):
            total += eq.lam[i] * g[j] * u[j]
        gather(model, i, work.sdd, u)
        for j in range(g.size):
            total += eq.on_accelerations[i] * g[j] * u[j]
        if which < 2:
            work.normal_bars[i, which] -= total
        else:
            work.ratio_bars[i] -= total
