# SPDX-License-Identifier: MIT
"""Directions and spins in the plane, which have the angle of their marker and no more.

With u = (1, psi) of the angle phi = theta + psi q of a marker among the coordinates of its body and
Omega = u . v, a direction s turns by exactly this angle,

    s' = Omega J s,    s'' = (u . w) J s - Omega^2 s,    L = J s u^T.

A spin is the angle itself, (phi, 0), with L = e_x u^T; moments and rows of angles use it.
"""

from __future__ import annotations

import math

from ..compilation import Matrix, Vector, kernel
from ..equations import Equations
from .algebra import inner
from .arrays import ACCELERATION, OF_SPIN, PLACE, SHIFT, VELOCITY, Arrays, Work

#: Place of the rotation among the coordinates of a body, and number of its rigid coordinates.
ROTATION, RIGID = 2, 3


@kernel
def place_direction(model: Arrays, eq: Equations, work: Work, e: int) -> None:
    """Value and velocity, L, the angle in work.c and the rate Omega in work.cv."""
    b, s, sd, L, shapes = model.vector_body[e], work.s[e], work.sd[e], work.L[e], model.shapes[e]
    o, n = model.first[b], model.modes[b]
    angle, rate = eq.y[o + ROTATION], eq.v[o + ROTATION]
    for j in range(n):
        angle += shapes[0, j + 1] * eq.y[o + RIGID + j]
        rate += shapes[0, j + 1] * eq.v[o + RIGID + j]
    work.c[e, 0], work.cv[e, 0] = angle, rate
    if model.vector_kind[e] == OF_SPIN:
        s[0], s[1], x, y = angle, 0.0, 1.0, 0.0
    else:
        c, d = math.cos(angle), math.sin(angle)
        s[0], s[1] = c * shapes[0, 0] - d * shapes[1, 0], d * shapes[0, 0] + c * shapes[1, 0]
        x, y = -s[1], s[0]
    sd[0], sd[1] = rate * x, rate * y
    L[0, 0] = L[0, 1] = L[1, 0] = L[1, 1] = 0.0
    L[0, ROTATION], L[1, ROTATION] = x, y
    for j in range(n):
        L[0, RIGID + j], L[1, RIGID + j] = x * shapes[0, j + 1], y * shapes[0, j + 1]


@kernel
def accelerate_direction(model: Arrays, eq: Equations, work: Work, e: int) -> None:
    """Second derivative in time, and u . w in work.c2."""
    b, rate = model.vector_body[e], work.cv[e, 0]
    o, growth = model.first[b], eq.w[model.first[b] + ROTATION]
    for j in range(model.modes[b]):
        growth += model.shapes[e, 0, j + 1] * eq.w[o + RIGID + j]
    work.c2[e, 0] = growth
    inward = 0.0 if model.vector_kind[e] == OF_SPIN else rate * rate
    for k in range(2):
        work.sdd[e, k] = growth * work.L[e, k, ROTATION] - inward * work.s[e, k]


@kernel
def pull_direction_velocity(model: Arrays, work: Work, e: int, f: Vector, out: Vector) -> None:
    """Add (ds'/dy)^T f = -Omega (s . f) u to out."""
    if model.vector_kind[e] != OF_SPIN:
        add_angle(model, e, -work.cv[e, 0] * inner(model, work.s[e], f), out)


@kernel
def add_angle(model: Arrays, e: int, factor: float, out: Vector) -> None:
    """Add factor times u to out."""
    b = model.vector_body[e]
    o = model.first[b]
    out[o + ROTATION] += factor
    for j in range(model.modes[b]):
        out[o + RIGID + j] += factor * model.shapes[e, 0, j + 1]


@kernel
def add_direction_curvature(model: Arrays, work: Work, e: int, Ky: Matrix) -> None:
    """Add d(L^T f)/dy = -(s . f) u u^T at the fixed force f, work.forces, to Ky."""
    if model.vector_kind[e] != OF_SPIN:
        b, along = model.vector_body[e], inner(model, work.s[e], work.forces[e])
        o = model.first[b]
        add_angle(model, e, -along, Ky[o + ROTATION])
        for j in range(model.modes[b]):
            add_angle(model, e, -along * model.shapes[e, 0, j + 1], Ky[o + RIGID + j])


@kernel
def direction_pullback(model: Arrays, eq: Equations, work: Work, e: int) -> None:
    """Transpose of (s, L adj, s', s''), see vector_pullback."""
    b, s, out, shapes = model.vector_body[e], work.s[e], work.vector_bars, model.shapes[e]
    bars = work.bars[e]
    p, f, d, a = bars[PLACE], bars[SHIFT], bars[VELOCITY], bars[ACCELERATION]
    o, n = model.first[b], model.modes[b]
    rate, growth, shift = work.cv[e, 0], work.c2[e, 0], eq.adjoint[o + ROTATION]
    for j in range(n):
        shift += shapes[0, j + 1] * eq.adjoint[o + RIGID + j]
    # Derivatives with respect to the angle, u . adj, Omega and u . w.
    if model.vector_kind[e] == OF_SPIN:
        by_angle, by_shift, by_rate, by_growth = p[0], f[0], d[0], a[0]
    else:
        x, y = -s[1], s[0]
        by_shift, by_growth = x * f[0] + y * f[1], x * a[0] + y * a[1]
        by_rate = x * d[0] + y * d[1] - 2.0 * rate * inner(model, s, a)
        by_angle = x * p[0] + y * p[1] - shift * inner(model, s, f) - rate * inner(model, s, d)
        by_angle -= growth * inner(model, s, a) + rate * rate * by_growth
        inward, c, x = rate * rate, math.cos(work.c[e, 0]), math.sin(work.c[e, 0])
        # Derivatives with respect to s, turned back to the components of the direction.
        along_x = p[0] + shift * f[1] + rate * d[1] + growth * a[1] - inward * a[0]
        along_y = p[1] - shift * f[0] - rate * d[0] - growth * a[0] - inward * a[1]
        out[e, 0, 0] += c * along_x + x * along_y
        out[e, 1, 0] += c * along_y - x * along_x
    add_angle(model, e, by_angle, work.gather)
    add_angle(model, e, by_rate, eq.v_bar)
    for j in range(n):
        i = o + RIGID + j
        out[e, 0, j + 1] += (
            by_angle * eq.y[i] + by_shift * eq.adjoint[i] + by_rate * eq.v[i] + by_growth * eq.w[i]
        )
