# SPDX-License-Identifier: MIT
"""Vectors of bodies: points and directions, their velocities, derivatives and transposes.

A vector s = delta R + A b(q), delta = 1 for a point and 0 for a direction, has with c = b(q), its
derivatives B = b_q and cv = B v, and the angular velocity omega in the body's axes

    s'  = delta R'  + A c1,   c1 = omega x c + cv
    s'' = delta R'' + A c2,   c2 = alpha x c + omega x (omega x c) + 2 omega x cv + B w - v . T v
    L   = [delta 1, -A [c], A B]

with L the derivative of s, and of s' with respect to v. B is B_0 - T q, and T is zero but for
points with geometric stiffness. The spin of a marker, A (omega + Psi v), is the velocity of
nothing; with L = [0, A, A Psi] it takes moments. All derivatives with respect to rotations are
those in the body's axes, dA = A [dth].
"""

from __future__ import annotations

import numpy as np

from ..compilation import Matrix, Vector, kernel
from ..equations import Equations
from .algebra import cross, dot, product, turned, turned_back
from .arrays import (
    ACCELERATION,
    OF_POINT,
    OF_SPIN,
    PLACE,
    RIGID,
    ROTATION,
    SHIFT,
    VELOCITY,
    ModelArrays,
    Work,
)
from .group import exponential, tangent


@kernel
def place_bodies(model: ModelArrays, eq: Equations, work: Work) -> None:
    """Rotations of all bodies, and their derivatives with respect to the coordinates."""
    base, short = work.small[0], work.small[1]
    for b in range(model.first.size):
        i = model.first[b] + ROTATION
        x, y, z = (
            eq.y[i] - eq.base[i],
            eq.y[i + 1] - eq.base[i + 1],
            eq.y[i + 2] - eq.base[i + 2],
        )
        exponential(eq.base[i], eq.base[i + 1], eq.base[i + 2], base)
        exponential(x, y, z, short)
        product(base, short, work.A[b])
        tangent(x, y, z, work.T[b])


@kernel
def place_vectors(model: ModelArrays, eq: Equations, work: Work, instant: int) -> None:
    """Values and velocities of all vectors at an instant, and their derivatives."""
    y, v = eq.y, eq.v
    place_bodies(model, eq, work)
    for e in range(model.vector_body.size):
        b = model.vector_body[e]
        s, sd = work.s[e], work.sd[e]
        if b < 0:
            slot = model.vector_slot[e]
            for k in range(3):
                s[k] = model.prescribed[instant, slot, 0, k]
                sd[k] = model.prescribed[instant, slot, 1, k]
            continue
        o, n, A, L = model.first[b], model.modes[b], work.A[b], work.L[e]
        c, cv, B, shapes, kind = (
            work.c[e],
            work.cv[e],
            work.B[e],
            model.shapes[e],
            model.vector_kind[e],
        )
        for k in range(3):
            c[k] = shapes[k, 0]
            cv[k] = 0.0
            for j in range(n):
                B[k, j] = shapes[k, j + 1]
                c[k] += B[k, j] * y[o + RIGID + j]
                cv[k] += B[k, j] * v[o + RIGID + j]
        if model.vector_stiffened[e] >= 0:
            bend_vector(model, eq, work, e)
        omega, c1 = v[o + ROTATION : o + RIGID], work.c1[e]
        if kind == OF_SPIN:
            for k in range(3):
                c1[k] = omega[k] + cv[k]
        else:
            cross(omega, c, c1)
            for k in range(3):
                c1[k] += cv[k]
        delta = 1.0 if kind == OF_POINT else 0.0
        turned(A, c, s)
        turned(A, c1, sd)
        for k in range(3):
            s[k] += delta * y[o + k]
            sd[k] += delta * v[o + k]
            for i in range(3):
                L[k, i] = 0.0
            L[k, k] = delta
            if kind == OF_SPIN:
                for i in range(3):
                    L[k, 3 + i] = A[k, i]
            else:
                L[k, 3] = A[k, 2] * c[1] - A[k, 1] * c[2]
                L[k, 4] = A[k, 0] * c[2] - A[k, 2] * c[0]
                L[k, 5] = A[k, 1] * c[0] - A[k, 0] * c[1]
            combine(B, A[k, 0], A[k, 1], A[k, 2], L[k, RIGID : RIGID + n])


@kernel
def combine(B: Matrix, x: float, y: float, z: float, out: Vector) -> None:
    """Set out to x B_0 + y B_1 + z B_2, rows of B or their beginnings."""
    first, second, third = B[0], B[1], B[2]
    for j in range(np.uintp(out.size)):
        out[j] = first[j] * x + second[j] * y + third[j] * z


@kernel
def bend_vector(model: ModelArrays, eq: Equations, work: Work, e: int) -> None:
    """Add the share of geometric stiffness to a vector in the body's axes; keep its T v."""
    b, T = model.vector_body[e], model.vector_stiffening[model.vector_stiffened[e]]
    o, n = model.first[b] + RIGID, model.modes[b]
    for k in range(3):
        for j in range(n):
            by_q = by_v = 0.0
            for i in range(n):
                by_q += T[k, j, i] * eq.y[o + i]
                by_v += T[k, j, i] * eq.v[o + i]
            work.B[e, k, j] -= by_q
            work.bend[e, k, j] = by_v
            work.c[e, k] -= 0.5 * by_q * eq.y[o + j]
            work.cv[e, k] -= by_q * eq.v[o + j]


@kernel
def pull(model: ModelArrays, work: Work, e: int, force: Vector, at: int, out: Vector) -> None:
    """Add L^T f to out, the generalised forces of f = force[at:at+3] on a vector."""
    b = model.vector_body[e]
    if b >= 0:
        o, L = model.first[b], work.L[e]
        x, y, z = force[at], force[at + 1], force[at + 2]
        to = out[o : o + RIGID + model.modes[b]]
        first, second, third = L[0], L[1], L[2]
        for i in range(np.uintp(to.size)):
            to[i] += first[i] * x + second[i] * y + third[i] * z


@kernel
def pull_velocity(
    model: ModelArrays, eq: Equations, work: Work, e: int, force: Vector, at: int, out: Vector
) -> None:
    """Add (ds'/dy)^T f to out, f = force[at:at+3]; not for spins."""
    b = model.vector_body[e]
    if b < 0:
        return
    o, n, small = model.first[b], model.modes[b], work.vectors
    f, turn = small[0], small[1]
    turned_back(work.A[b], force[at : at + 3], f)
    cross(work.c1[e], f, turn)
    for k in range(3):
        out[o + ROTATION + k] += turn[k]
    cross(f, eq.v[o + ROTATION : o + RIGID], turn)
    for j in range(n):
        out[o + RIGID + j] += (
            work.B[e, 0, j] * turn[0] + work.B[e, 1, j] * turn[1] + work.B[e, 2, j] * turn[2]
        )
    if model.vector_stiffened[e] >= 0:
        for j in range(n):
            out[o + RIGID + j] -= (
                f[0] * work.bend[e, 0, j] + f[1] * work.bend[e, 1, j] + f[2] * work.bend[e, 2, j]
            )


@kernel
def vector_accelerations(model: ModelArrays, eq: Equations, work: Work, instant: int) -> None:
    """Second derivatives of all vectors in time, work.sdd, and work.c2; not of spins."""
    first, second = work.vectors[0], work.vectors[1]
    for e in range(model.vector_body.size):
        b = model.vector_body[e]
        if b < 0:
            for k in range(3):
                work.sdd[e, k] = model.prescribed[instant, model.vector_slot[e], 2, k]
            continue
        o, n, c2 = model.first[b], model.modes[b], work.c2[e]
        omega, eps = eq.v[o + ROTATION : o + RIGID], eq.w[o + ROTATION : o + RIGID]
        for k in range(3):
            # omega x (c1 + cv) is omega x (omega x c) + 2 omega x cv
            first[k] = work.c1[e, k] + work.cv[e, k]
        cross(eps, work.c[e], c2)
        cross(omega, first, second)
        for k in range(3):
            c2[k] += second[k]
            for j in range(n):
                c2[k] += work.B[e, k, j] * eq.w[o + RIGID + j]
            if model.vector_stiffened[e] >= 0:
                for j in range(n):
                    c2[k] -= work.bend[e, k, j] * eq.v[o + RIGID + j]
        turned(work.A[b], c2, work.sdd[e])
        if model.vector_kind[e] == OF_POINT:
            for k in range(3):
                work.sdd[e, k] += eq.w[o + k]


@kernel
def add_curvatures(model: ModelArrays, work: Work, Ky: Matrix) -> None:
    """Add d(L^T f)/dy of all vectors at fixed forces f, work.forces, to Ky, and clear these."""
    for e in range(model.vector_body.size):
        if model.vector_body[e] >= 0:
            add_curvature(model, work, e, Ky)
        for k in range(3):
            work.forces[e, k] = 0.0


@kernel
def add_curvature(model: ModelArrays, work: Work, e: int, Ky: Matrix) -> None:
    """Add d(L^T f)/dy of one vector of a body to Ky."""
    b, f, c, B = model.vector_body[e], work.vectors[0], work.c[e], work.B[e]
    o, n = model.first[b], model.modes[b]
    turned_back(work.A[b], work.forces[e], f)
    p, e0 = o + ROTATION, o + RIGID
    spin = model.vector_kind[e] == OF_SPIN
    if spin:
        Ky[p, p + 1] -= f[2]
        Ky[p, p + 2] += f[1]
        Ky[p + 1, p] += f[2]
        Ky[p + 1, p + 2] -= f[0]
        Ky[p + 2, p] -= f[1]
        Ky[p + 2, p + 1] += f[0]
    else:
        along = dot(c, f)
        for i in range(3):
            for k in range(3):
                Ky[p + i, p + k] += f[i] * c[k]
            Ky[p + i, p + i] -= along
    for j in range(n):
        # f x B_j
        x = f[1] * B[2, j] - f[2] * B[1, j]
        y = f[2] * B[0, j] - f[0] * B[2, j]
        z = f[0] * B[1, j] - f[1] * B[0, j]
        if not spin:
            Ky[p, e0 + j] -= x
            Ky[p + 1, e0 + j] -= y
            Ky[p + 2, e0 + j] -= z
        Ky[e0 + j, p] -= x
        Ky[e0 + j, p + 1] -= y
        Ky[e0 + j, p + 2] -= z
    if model.vector_stiffened[e] >= 0:
        T = model.vector_stiffening[model.vector_stiffened[e]]
        for i in range(n):
            for j in range(n):
                Ky[e0 + i, e0 + j] -= f[0] * T[0, i, j] + f[1] * T[1, i, j] + f[2] * T[2, i, j]


@kernel
def begin_pullback(model: ModelArrays, eq: Equations, work: Work, instant: int) -> None:
    """Shifts L adj of all vectors, work.shift, and their accelerations; clears work.bars."""
    vector_accelerations(model, eq, work, instant)
    for e in range(model.vector_body.size):
        b, L, shift, bars = model.vector_body[e], work.L[e], work.shift[e], work.bars[e]
        for k in range(3):
            shift[k] = 0.0
            for what in range(4):
                bars[what, k] = 0.0
        if b >= 0:
            o = model.first[b]
            for i in range(RIGID + model.modes[b]):
                x = eq.adjoint[o + i]
                shift[0] += L[0, i] * x
                shift[1] += L[1, i] * x
                shift[2] += L[2, i] * x


@kernel
def finish_pullback(model: ModelArrays, eq: Equations, work: Work) -> None:
    """Transpose of (s, L adj, s', s'') of all vectors of bodies."""
    for e in range(model.vector_body.size):
        if model.vector_body[e] >= 0:
            vector_pullback(model, eq, work, e)


@kernel
def vector_pullback(model: ModelArrays, eq: Equations, work: Work, e: int) -> None:
    """Transpose of (s, L adj, s', s'') with respect to y, v and the vector's shape functions.

    Adds to work.gather, eq.v_bar and work.vector_bars; the derivatives with respect to these four
    are the rows of work.bars[e].
    """
    b = model.vector_body[e]
    o, n = model.first[b], model.modes[b]
    y, v, w, adj, gather, v_bar = eq.y, eq.v, eq.w, eq.adjoint, work.gather, eq.v_bar
    A, B, c, cv, out, small = (
        work.A[b],
        work.B[e],
        work.c[e],
        work.cv[e],
        work.vector_bars,
        work.vectors,
    )
    omega, eps, spin = (
        v[o + ROTATION : o + RIGID],
        w[o + ROTATION : o + RIGID],
        adj[o + ROTATION : o + RIGID],
    )
    p, f, d, a = small[0], small[1], small[2], small[3]
    turned_back(A, work.bars[e, PLACE], p)
    turned_back(A, work.bars[e, SHIFT], f)
    turned_back(A, work.bars[e, VELOCITY], d)
    turned_back(A, work.bars[e, ACCELERATION], a)
    m, x, s, u, swung = small[4], small[5], small[6], small[7], small[8]
    for k in range(3):
        m[k] = 0.0
        for j in range(n):
            m[k] += B[k, j] * adj[o + RIGID + j]
    r, t = o + ROTATION, o + RIGID
    if model.vector_kind[e] == OF_SPIN:
        for k in range(3):
            m[k] += spin[k]
        cross(m, f, x)
        for k in range(3):
            gather[r + k] += x[k]
            for j in range(n):
                out[e, k, j + 1] += f[k] * adj[t + j]
        return
    cross(spin, c, x)
    for k in range(3):
        m[k] += x[k]
    if model.vector_kind[e] == OF_POINT:
        for k in range(3):
            gather[o + k] += work.bars[e, PLACE, k]
            v_bar[o + k] += work.bars[e, VELOCITY, k]
    # Derivatives with respect to c and cv.
    cross(a, omega, swung)
    cross(swung, omega, s)
    for k in range(3):
        s[k] += p[k]
        u[k] = d[k] + 2.0 * swung[k]
    cross(f, spin, x)
    for k in range(3):
        s[k] += x[k]
    cross(d, omega, x)
    for k in range(3):
        s[k] += x[k]
    cross(a, eps, x)
    for k in range(3):
        s[k] += x[k]
    # Turns of the body.
    cross(c, p, x)
    for k in range(3):
        gather[r + k] += x[k]
    cross(m, f, x)
    for k in range(3):
        gather[r + k] += x[k]
    cross(work.c1[e], d, x)
    for k in range(3):
        gather[r + k] += x[k]
    cross(work.c2[e], a, x)
    for k in range(3):
        gather[r + k] += x[k]
    # The angular velocity: of c1 c x d, of c2 (omega x c) x a + c x (a x omega) + 2 cv x a.
    cross(c, d, x)
    for k in range(3):
        v_bar[r + k] += x[k]
    cross(c, swung, x)
    for k in range(3):
        v_bar[r + k] += x[k]
    for k in range(3):
        m[k] = work.c1[e, k] + cv[k]
    cross(m, a, x)
    for k in range(3):
        v_bar[r + k] += x[k]
        out[e, k, 0] += s[k]
    for j in range(n):
        for k in range(3):
            gather[t + j] += B[k, j] * s[k]
            v_bar[t + j] += B[k, j] * u[k]
            out[e, k, j + 1] += (
                s[k] * y[t + j] + u[k] * v[t + j] + a[k] * w[t + j] + f[k] * adj[t + j]
            )
    if model.vector_stiffened[e] >= 0:
        bend_pullback(model, eq, work, e, s, u, f, a)


@kernel
def bend_pullback(
    model: ModelArrays,
    eq: Equations,
    work: Work,
    e: int,
    s: Vector,
    u: Vector,
    f: Vector,
    a: Vector,
) -> None:
    """Share of geometric stiffness in vector_pullback.

    s and u are the derivatives with respect to c and cv, f and a those with respect to B adj and
    B w - v . T v.
    """
    b, T = model.vector_body[e], model.vector_stiffening[model.vector_stiffened[e]]
    t, n, out = model.first[b] + RIGID, model.modes[b], work.vector_bars
    y, v, w, adj = eq.y, eq.v, eq.w, eq.adjoint
    for k in range(3):
        for j in range(n):
            eq.v_bar[t + j] -= 2.0 * a[k] * work.bend[e, k, j]
            q = 0.5 * s[k] * y[t + j] + u[k] * v[t + j] + a[k] * w[t + j] + f[k] * adj[t + j]
            for i in range(n):
                work.gather[t + j] -= T[k, j, i] * (
                    f[k] * adj[t + i] + u[k] * v[t + i] + a[k] * w[t + i]
                )
                out[e, 3 + k * n + j, i + 1] -= q * y[t + i] + a[k] * v[t + j] * v[t + i]
