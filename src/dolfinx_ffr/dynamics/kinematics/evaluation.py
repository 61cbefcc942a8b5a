# SPDX-License-Identifier: MIT
"""Kinematics as time integration uses them: the equations of motion at one instant."""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import FunctionType

from .. import equations
from ..compilation import Compiled, Vector, compiled, kernel
from ..equations import Equations
from .algebra import add_multiple
from .arrays import Arrays, Work
from .carried import blocks_equations, blocks_pullback, carried_blocks
from .forces import add_forces, forces_pullback
from .group import compose, inverse_tangent, tangent
from .plane import PlaneArrays
from .rows import evaluate_rows, row_accelerations, row_curvatures, rows_pullback
from .space import SpaceArrays
from .stages import turn_stages
from .vectors import add_curvatures, begin_pullback, finish_pullback


def evaluate(
    eq: Equations, model: Arrays, work: Work, instant: int, rate_weight: float, extent: int
) -> int:
    """Equations at (y, v, w, lam) and an instant, with M = r_w + rate_weight r_v.

    The rate weight is that of the step method; bits of the extent are in dynamics/equations.py.
    """
    if extent & equations.CONSTRAINTS:
        evaluate_rows(model, eq, work, instant)
    if extent & equations.FORCES:
        for i in range(eq.r.size):
            for j in range(eq.r.size):
                eq.M[i, j] = eq.Ky[i, j] = 0.0
        for b in range(model.first.size):
            if model.stiffened[b]:
                carried_blocks(model, eq, work, instant, b)
                blocks_equations(model, eq, work, b, rate_weight)
            else:
                model.body_equations(model, eq, work, instant, b, rate_weight)
        add_forces(model, eq, work, instant, rate_weight, extent & equations.TANGENT != 0)
    if extent & equations.TANGENT:
        row_curvatures(model, eq, work)
        add_curvatures(model, work, eq.Ky)
        for i in range(eq.r.size):
            model.into_coordinates(model, work, eq.Ky[i])
    if extent & equations.ACCELERATIONS:
        row_accelerations(model, eq, work, instant)
    if extent & equations.CORRECTIONS:
        for i in range(eq.value.size):
            apply_inverse(model, eq.C[i], eq.correction[i])
    return 0


def pullback(eq: Equations, model: Arrays, work: Work, instant: int, extent: int) -> int:
    """Transpose of :func:`evaluate`; see equations.py for the extent."""
    if extent & equations.METRIC:
        for j in range(eq.r.size):
            work.line[j] = eq.adjoint[j]
        apply_inverse(model, work.line, eq.adjoint)
    for j in range(eq.r.size):
        work.gather[j] = 0.0
    if extent & equations.BODY_FORCES:
        for b in range(model.first.size):
            if model.stiffened[b]:
                carried_blocks(model, eq, work, instant, b)
            else:
                model.body_slopes(model, eq, work, instant, b)
            blocks_pullback(model, eq, work, b)
    if extent & (equations.OTHER_FORCES | equations.ROWS):
        begin_pullback(model, eq, work, instant)
        if extent & equations.OTHER_FORCES:
            forces_pullback(model, eq, work, instant)
        if extent & equations.ROWS:
            rows_pullback(model, eq, work, instant)
        finish_pullback(model, eq, work, instant)
    model.into_coordinates(model, work, work.gather)
    for j in range(eq.r.size):
        eq.y_bar[j] += work.gather[j]
    return 0


@kernel
def apply_inverse(model: Arrays, x: Vector, out: Vector) -> None:
    """Set out to D x; it may not be x."""
    for b in range(model.first.size):
        o, n, d, rigid = model.first[b], model.modes[b], model.d, model.rigid
        D = model.inverse[b]
        for i in range(d):
            out[o + i] = D[i, i] * x[o + i]
        for i in range(d, rigid):
            total = 0.0
            for j in range(d, rigid):
                total += D[i, j] * x[o + j]
            out[o + i] = total
        to = out[o + rigid : o + rigid + n]
        for i in range(n):
            to[i] = 0.0
        for j in range(n):
            add_multiple(D[rigid + j, rigid : rigid + n], x[o + rigid + j], to)


def measure(eq: Equations, model: Arrays, work: Work) -> int:
    """Norms of y - reference, v (by mass) and elastic part (by energy); the largest rotation."""
    y, v, sizes, reference = eq.y, eq.v, eq.sizes, eq.reference
    for i in range(4):
        sizes[i] = 0.0
    for b in range(model.first.size):
        turn, n, o = model.measure_body(model, eq, b), model.modes[b], model.first[b] + model.rigid
        for i in range(n):
            p = o + i
            for j in range(n):
                q, mass = o + j, model.G[b, i + 1, j + 1]
                rate = v[p] * mass * v[q]
                sizes[0] += (y[p] - reference[p]) * mass * (y[q] - reference[q])
                sizes[1] += rate
                sizes[2] += y[p] * model.K[b, i, j] * y[q] + rate
        # Not a maximum: NaN must stay.
        if not turn <= sizes[3]:
            sizes[3] = turn
    for i in range(3):
        sizes[i] = math.sqrt(max(sizes[i], 0.0))
    return 0


@compiled(Equations, SpaceArrays, Work, int, int)
def chart(eq: Equations, model: SpaceArrays, work: Work, instant: int, what: int) -> int:
    """Add the rotations of a step to those at its beginning, or pull derivatives back.

    COMPOSE turns y into the rotation that follows the base. ENTER takes y_bar to T^T y_bar, and
    LEAVE to T^-T y_bar, where T is the tangent operator of the step's rotation vector.
    """
    y, base, matrix, bar = eq.y, eq.base, work.small[0], eq.y_bar
    for b in range(model.first.size):
        i = model.first[b] + 3
        if what == equations.COMPOSE:
            compose(y, base, i)
            continue
        step_x, step_y, step_z = y[i] - base[i], y[i + 1] - base[i + 1], y[i + 2] - base[i + 2]
        if what == equations.ENTER:
            tangent(step_x, step_y, step_z, matrix)
            bar_x, bar_y, bar_z = bar[i], bar[i + 1], bar[i + 2]
            for k in range(3):
                bar[i + k] = matrix[0, k] * bar_x + matrix[1, k] * bar_y + matrix[2, k] * bar_z
        elif what == equations.LEAVE:
            inverse_tangent(step_x, step_y, step_z, matrix)
            bar_x, bar_y, bar_z = bar[i], bar[i + 1], bar[i + 2]
            for k in range(3):
                bar[i + k] = matrix[k, 0] * bar_x + matrix[k, 1] * bar_y + matrix[k, 2] * bar_z
    count(work, instant, what)
    return 0


@kernel
def count(work: Work, instant: int, what: int) -> None:
    """Store the angles of rows at an instant, or count from the stored angles."""
    if what == equations.COMPOSE:
        for row in range(work.turns.shape[1]):
            for k in range(2):
                work.turns[instant, row, k] = work.angles[row, k]
    if what == equations.BEGIN:
        work.base_instant[0] = instant
        for row in range(work.turns.shape[1]):
            for k in range(2):
                work.base_angles[row, k] = work.turns[instant, row, k]


@compiled(Equations, PlaneArrays, Work, int, int)
def counting(eq: Equations, model: PlaneArrays, work: Work, instant: int, what: int) -> int:
    """Take the place of chart in the plane, where coordinates are the same everywhere."""
    count(work, instant, what)
    return 0


def _functions(kind: type[Arrays]) -> Iterator[Compiled]:
    """Functions of the plane or of space, under names of their own, as Numba keeps them by name."""
    for function, numbers in ((evaluate, (int, float, int)), (pullback, (int, int)), (measure, ())):
        name = f"{function.__name__}_{kind.__name__}"
        renamed = FunctionType(function.__code__, function.__globals__, name)
        renamed.__qualname__ = name
        yield Compiled(renamed, Equations, kind, Work, *numbers)


#: Functions evaluate, pullback, measure and chart, and in space turn_stages, by dimension.
FUNCTIONS: dict[int, tuple[Compiled, ...]] = {
    2: (*_functions(PlaneArrays), counting),
    3: (*_functions(SpaceArrays), chart, turn_stages),
}
