# SPDX-License-Identifier: MIT
"""Planar kinematics as time integration uses it: the equations of motion at one instant."""

from __future__ import annotations

import numpy as np

from ..compilation import compiled, kernel
from ..equations import (
    ACCELERATIONS,
    BODY_FORCES,
    CONSTRAINTS,
    CORRECTIONS,
    FORCES,
    METRIC,
    OTHER_FORCES,
    ROWS,
    TANGENT,
    Equations,
)
from .arrays import RIGID, ROTATION, ModelArrays, Work
from .bodies import body_equations, body_pullback
from .constraints import evaluate_rows, row_accelerations, row_curvatures, rows_pullback
from .forces import add_forces, forces_pullback


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
    if extent & ACCELERATIONS:
        row_accelerations(model, eq, work, instant)
    if extent & CORRECTIONS:
        for i in range(model.kind.size):
            for j in range(n):
                work.unit[j] = eq.C[i, j]
            apply_inverse(model, work)
            for j in range(n):
                eq.correction[i, j] = work.column[j]
    return 0


@compiled(Equations, ModelArrays, Work, int, int)
def pullback(eq: Equations, model: ModelArrays, work: Work, instant: int, extent: int) -> int:
    """Transpose of :func:`evaluate`; see equations.py for the extent."""
    if extent & METRIC:
        for j in range(eq.r.size):
            work.unit[j] = eq.adjoint[j]
        apply_inverse(model, work)
        for j in range(eq.r.size):
            eq.adjoint[j] = work.column[j]
    if extent & BODY_FORCES:
        for b in range(model.first.size):
            body_pullback(model, eq, work, instant, b)
    if extent & OTHER_FORCES:
        forces_pullback(model, eq, work, instant)
    if extent & ROWS:
        rows_pullback(model, eq, work, instant)
    return 0


@kernel
def apply_inverse(model: ModelArrays, work: Work) -> None:
    """Set work.column to D work.unit."""
    x, out = work.unit, work.column
    for b in range(model.first.size):
        o, size = model.first[b], RIGID + model.modes[b]
        for j in range(size):
            out[o + j] = 0.0
        for i in range(size):
            for j in range(size):
                out[o + j] += model.inverse[b, i, j] * x[o + i]


@compiled(Equations, ModelArrays, Work)
def measure(eq: Equations, model: ModelArrays, work: Work) -> int:
    """Sizes of y - reference and v by mass, and of the elastic part by energy; largest turn."""
    sizes, y, v, reference = eq.sizes, eq.y, eq.v, eq.reference
    for i in range(4):
        sizes[i] = 0.0
    for b in range(model.first.size):
        o, n = model.first[b], model.modes[b]
        for p in range(RIGID):
            mass = model.G[b, 0, 0] if p == ROTATION else model.mass[b]
            sizes[0] += mass * (y[o + p] - reference[o + p]) ** 2
            sizes[1] += mass * v[o + p] ** 2
        for i in range(n):
            p = o + RIGID + i
            for j in range(n):
                q, G = o + RIGID + j, model.G[b, i + 1, j + 1]
                rate = v[p] * G * v[q]
                sizes[0] += (y[p] - reference[p]) * G * (y[q] - reference[q])
                sizes[1] += rate
                sizes[2] += y[p] * model.K[b, i, j] * y[q] + rate
        turn = abs(y[o + ROTATION] - reference[o + ROTATION])
        # Not a maximum: NaN must stay.
        if not turn <= sizes[3]:
            sizes[3] = turn
    for i in range(3):
        sizes[i] = np.sqrt(max(sizes[i], 0.0))
    return 0
