# SPDX-License-Identifier: MIT
"""Kinematics in space as time integration uses it: the equations of motion at one instant."""

from __future__ import annotations

import math

from ..compilation import Vector, compiled, kernel
from ..equations import (
    ACCELERATIONS,
    BODY_FORCES,
    COMPOSE,
    CONSTRAINTS,
    CORRECTIONS,
    ENTER,
    FORCES,
    LEAVE,
    LOCALISE,
    METRIC,
    OTHER_FORCES,
    ROWS,
    TANGENT,
    Equations,
)
from .algebra import add_multiple, dot
from .arrays import RIGID, ROTATION, ModelArrays, Work
from .bodies import body_equations, body_pullback
from .constraints import (
    evaluate_rows,
    into_coordinates,
    row_accelerations,
    row_curvatures,
    rows_pullback,
)
from .forces import add_forces, forces_pullback
from .group import compose, inverse_tangent, rotation_between, tangent
from .vectors import add_curvatures, begin_pullback, finish_pullback


@compiled(Equations, ModelArrays, Work, int, float, int)
def evaluate(
    eq: Equations, model: ModelArrays, work: Work, instant: int, cv: float, extent: int
) -> int:
    """Equations at (y, v, w, lam) and an instant; see equations.py for the extent."""
    n = eq.r.size
    if extent & CONSTRAINTS:
        evaluate_rows(model, eq, work, instant)
    if extent & FORCES:
        for i in range(n):
            for j in range(n):
                eq.M[i, j] = eq.Ky[i, j] = 0.0
        for b in range(model.first.size):
            body_equations(model, eq, work, instant, b, cv)
        add_forces(model, eq, work, instant, cv, extent & TANGENT != 0)
    if extent & TANGENT:
        row_curvatures(model, eq, work)
        add_curvatures(model, work, eq.Ky)
        for i in range(n):
            into_coordinates(model, work, eq.Ky[i])
    if extent & ACCELERATIONS:
        row_accelerations(model, eq, work, instant)
    if extent & CORRECTIONS:
        for i in range(eq.value.size):
            apply_inverse(model, eq.C[i], eq.correction[i])
    return 0


@compiled(Equations, ModelArrays, Work, int, int)
def pullback(eq: Equations, model: ModelArrays, work: Work, instant: int, extent: int) -> int:
    """Transpose of :func:`evaluate`; see equations.py for the extent."""
    n, gather = eq.r.size, work.gather
    if extent & METRIC:
        for j in range(n):
            work.line[j] = eq.adjoint[j]
        apply_inverse(model, work.line, eq.adjoint)
    for j in range(n):
        gather[j] = 0.0
    if extent & BODY_FORCES:
        for b in range(model.first.size):
            body_pullback(model, eq, work, instant, b)
    if extent & (OTHER_FORCES | ROWS):
        begin_pullback(model, eq, work, instant)
        if extent & OTHER_FORCES:
            forces_pullback(model, eq, work, instant)
        if extent & ROWS:
            rows_pullback(model, eq, work)
        finish_pullback(model, eq, work)
    into_coordinates(model, work, gather)
    for j in range(n):
        eq.y_bar[j] += gather[j]
    return 0


@kernel
def apply_inverse(model: ModelArrays, x: Vector, out: Vector) -> None:
    """Set out to D x; it may not be x."""
    for b in range(model.first.size):
        o, n, D = model.first[b], model.modes[b], model.inverse[b]
        for i in range(3):
            out[o + i] = D[i, i] * x[o + i]
            total = 0.0
            for j in range(3):
                total += D[3 + i, 3 + j] * x[o + 3 + j]
            out[o + 3 + i] = total
        to = out[o + RIGID : o + RIGID + n]
        for i in range(n):
            to[i] = 0.0
        for j in range(n):
            add_multiple(D[RIGID + j, RIGID : RIGID + n], x[o + RIGID + j], to)


@compiled(Equations, ModelArrays, Work, int, int)
def chart(eq: Equations, model: ModelArrays, work: Work, instant: int, what: int) -> int:
    """Change between coordinates within a step and those between steps; see equations.py."""
    y, base, matrix, bar = eq.y, eq.base, work.small[0], eq.y_bar
    for b in range(model.first.size):
        i = model.first[b] + ROTATION
        if what == COMPOSE:
            compose(y, base, i)
            continue
        if what == LOCALISE:
            u, v, w = rotation_between(base[i], base[i + 1], base[i + 2], y[i], y[i + 1], y[i + 2])
            y[i], y[i + 1], y[i + 2] = base[i] + u, base[i + 1] + v, base[i + 2] + w
            continue
        u, v, w = y[i] - base[i], y[i + 1] - base[i + 1], y[i + 2] - base[i + 2]
        if what == ENTER:
            tangent(u, v, w, matrix)
            p, q, r = bar[i], bar[i + 1], bar[i + 2]
            for k in range(3):
                bar[i + k] = matrix[0, k] * p + matrix[1, k] * q + matrix[2, k] * r
        elif what == LEAVE:
            inverse_tangent(u, v, w, matrix)
            p, q, r = bar[i], bar[i + 1], bar[i + 2]
            for k in range(3):
                bar[i + k] = matrix[k, 0] * p + matrix[k, 1] * q + matrix[k, 2] * r
    if what == COMPOSE:
        # Angles of rows are counted on from here, through the next step of three stages at most.
        turns, last = work.turns, work.turns.shape[0] - 1
        for row in range(model.kind.size):
            for k in range(2):
                for later in range(instant, min(instant + 3, last) + 1):
                    turns[later, row, k] = work.angles[row, k]
    return 0


@compiled(Equations, ModelArrays, Work)
def measure(eq: Equations, model: ModelArrays, work: Work) -> int:
    """Sizes of y - reference and v by mass, and of the elastic part by energy; largest turn."""
    sizes, y, v, reference, shift = eq.sizes, eq.y, eq.v, eq.reference, work.vectors[0]
    for i in range(4):
        sizes[i] = 0.0
    for b in range(model.first.size):
        o, n, r = model.first[b], model.modes[b], model.first[b] + ROTATION
        shift[0], shift[1], shift[2] = rotation_between(
            reference[r], reference[r + 1], reference[r + 2], y[r], y[r + 1], y[r + 2]
        )
        P, size = model.P[b, 0], model.P.shape[1]
        trace = P[0] + P[4 * size] + P[8 * size]
        for k in range(3):
            sizes[0] += model.mass[b] * (y[o + k] - reference[o + k]) ** 2
            sizes[1] += model.mass[b] * v[o + k] ** 2
            for i in range(3):
                inertia = (trace if i == k else 0.0) - P[(3 * k + i) * size]
                sizes[0] += shift[k] * inertia * shift[i]
                sizes[1] += v[r + k] * inertia * v[r + i]
        for i in range(n):
            p = o + RIGID + i
            for j in range(n):
                q = o + RIGID + j
                G = model.pairs[b, 9, i * (size - 1) + j]
                rate = v[p] * G * v[q]
                sizes[0] += (y[p] - reference[p]) * G * (y[q] - reference[q])
                sizes[1] += rate
                sizes[2] += y[p] * model.K[b, i, j] * y[q] + rate
        # Within the step, where it may be more than half a turn.
        for k in range(3):
            shift[k] = y[r + k] - eq.base[r + k]
        turn = math.sqrt(dot(shift, shift))
        # Not a maximum: NaN must stay.
        if not turn <= sizes[3]:
            sizes[3] = turn
    for i in range(3):
        sizes[i] = math.sqrt(max(sizes[i], 0.0))
    return 0
