# SPDX-License-Identifier: MIT
"""Vectors of bodies: points and directions, their velocities, derivatives and transposes.

A vector s = delta R + A b(q), delta = 1 for a point and 0 for a direction, has with c = b(q), its
derivatives B = b_q and cv = B v, and the angular velocity omega in the body's axes

    s'  = delta R'  + A c1,   c1 = omega x c + cv
    s'' = delta R'' + A c2,   c2 = alpha x c + omega x (omega x c) + 2 omega x cv + B w - v . T v
    L   = [delta 1, -A [c], A B]

with L the derivative of s, and of s' with respect to v. B is B_0 - T q, and T is zero but for
points with geometric stiffness. All derivatives with respect to rotations in space are those in the
body's axes, dA = A [dth]. Kinds of vectors from `Arrays.own` on have kernels of their own: spins in
space (spins.py), directions and spins in the plane (directions.py).
"""

from __future__ import annotations

from ..compilation import Matrix, Vector, kernel
from ..equations import Equations
from .algebra import turned, turned_back
from .arrays import ACCELERATION, OF_POINT, PLACE, SHIFT, VELOCITY, Arrays, Work


@kernel
def place_vectors(model: Arrays, eq: Equations, work: Work, instant: int) -> None:
    """Values and velocities of all vectors at an instant, and their derivatives.

    Kinds of vectors from model.own on exist in the plane, or in space, alone.
    """
    for b in range(model.first.size):
        model.place_body(model, eq, work, b)
    for e in range(model.vector_body.size):
        if model.vector_body[e] < 0:
            table = model.prescribed[instant, model.vector_slot[e]]
            for k in range(model.d):
                work.s[e, k] = table[0, k]
                work.sd[e, k] = table[1, k]
        elif model.vector_kind[e] < model.own:
            place_vector(model, eq, work, e)
        else:
            model.place_own(model, eq, work, e)


@kernel
def place_vector(model: Arrays, eq: Equations, work: Work, e: int) -> None:
    """Value and velocity of one vector of a body, and their derivatives."""
    y, v, b, d, rigid = eq.y, eq.v, model.vector_body[e], model.d, model.rigid
    o, n, A, L = model.first[b], model.modes[b], work.A[b], work.L[e]
    s, sd, c, cv, c1 = work.s[e], work.sd[e], work.c[e], work.cv[e], work.c1[e]
    B, shapes = work.B[e], model.shapes[e]
    for k in range(d):
        total, rate = shapes[k, 0], 0.0
        for j in range(n):
            shape = shapes[k, j + 1]
            B[k, j] = shape
            total += shape * y[o + rigid + j]
            rate += shape * v[o + rigid + j]
        c[k], cv[k] = total, rate
    if model.vector_stiffened[e] >= 0:
        bend_vector(model, eq, work, e)
    model.swing(v[o + d : o + rigid], c, c1)
    for k in range(d):
        c1[k] += cv[k]
    delta = 1.0 if model.vector_kind[e] == OF_POINT else 0.0
    turned(model, A, c, s)
    turned(model, A, c1, sd)
    for k in range(d):
        s[k] += delta * y[o + k]
        sd[k] += delta * v[o + k]
        for i in range(rigid + n):
            L[k, i] = 0.0
        L[k, k] = delta
        model.torque(c, A[k], L[k, d:rigid])
        model.add_combination(B, A[k], L[k, rigid : rigid + n])


@kernel
def bend_vector(model: Arrays, eq: Equations, work: Work, e: int) -> None:
    """Add the share of geometric stiffness to a vector in the body's axes; keep its T v."""
    b, T = model.vector_body[e], model.vector_stiffening[model.vector_stiffened[e]]
    o, n = model.first[b] + model.rigid, model.modes[b]
    for k in range(model.d):
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
def pull(model: Arrays, work: Work, e: int, force: Vector, at: int, out: Vector) -> None:
    """Add L^T f to out, the generalised forces of f = force[at:at+d] on a vector."""
    b = model.vector_body[e]
    if b >= 0:
        o, d = model.first[b], model.d
        to = out[o : o + model.rigid + model.modes[b]]
        model.add_combination(work.L[e], force[at : at + d], to)


@kernel
def pull_velocity(
    model: Arrays, eq: Equations, work: Work, e: int, force: Vector, at: int, out: Vector
) -> None:
    """Add (ds'/dy)^T f to out, f = force[at:at+d]; not for spins in space."""
    b, d, rigid = model.vector_body[e], model.d, model.rigid
    if b < 0:
        return
    if model.vector_kind[e] >= model.own:
        model.pull_velocity_own(model, work, e, force[at : at + d], out)
        return
    o, n, small = model.first[b], model.modes[b], work.vectors
    f, turn = small[0], small[1]
    turned_back(model, work.A[b], force[at : at + d], f)
    model.add_torque(work.c1[e], f, 1.0, out[o + d : o + rigid])
    model.swing(eq.v[o + d : o + rigid], f, turn)
    for j in range(n):
        for k in range(d):
            out[o + rigid + j] -= work.B[e, k, j] * turn[k]
    if model.vector_stiffened[e] >= 0:
        for j in range(n):
            for k in range(d):
                out[o + rigid + j] -= f[k] * work.bend[e, k, j]


@kernel
def vector_accelerations(model: Arrays, eq: Equations, work: Work, instant: int) -> None:
    """Second derivatives of all vectors in time, work.sdd, and work.c2; not of spins in space."""
    d, rigid, first, second = model.d, model.rigid, work.vectors[0], work.vectors[1]
    for e in range(model.vector_body.size):
        b = model.vector_body[e]
        if b < 0:
            for k in range(d):
                work.sdd[e, k] = model.prescribed[instant, model.vector_slot[e], 2, k]
            continue
        if model.vector_kind[e] >= model.own:
            model.accelerate_own(model, eq, work, e)
            continue
        o, n, c2 = model.first[b], model.modes[b], work.c2[e]
        omega, eps = eq.v[o + d : o + rigid], eq.w[o + d : o + rigid]
        for k in range(d):
            # omega x (c1 + cv) is omega x (omega x c) + 2 omega x cv
            first[k] = work.c1[e, k] + work.cv[e, k]
        model.swing(eps, work.c[e], c2)
        model.swing(omega, first, second)
        for k in range(d):
            c2[k] += second[k]
            for j in range(n):
                c2[k] += work.B[e, k, j] * eq.w[o + rigid + j]
            if model.vector_stiffened[e] >= 0:
                for j in range(n):
                    c2[k] -= work.bend[e, k, j] * eq.v[o + rigid + j]
        turned(model, work.A[b], c2, work.sdd[e])
        if model.vector_kind[e] == OF_POINT:
            for k in range(d):
                work.sdd[e, k] += eq.w[o + k]


@kernel
def add_curvatures(model: Arrays, work: Work, Ky: Matrix) -> None:
    """Add d(L^T f)/dy of all vectors at fixed forces f, work.forces, to Ky, and clear these."""
    for e in range(model.vector_body.size):
        if model.vector_body[e] >= 0:
            if model.vector_kind[e] < model.own:
                add_curvature(model, work, e, Ky)
            else:
                model.add_curvature_own(model, work, e, Ky)
        for k in range(model.d):
            work.forces[e, k] = 0.0


@kernel
def add_curvature(model: Arrays, work: Work, e: int, Ky: Matrix) -> None:
    """Add d(L^T f)/dy of one vector of a body to Ky."""
    b, small, B, c = model.vector_body[e], work.vectors, work.B[e], work.c[e]
    f, turn, axis, swung = small[0], small[1], small[2], small[3]
    d, o, n, turns = model.d, model.first[b], model.modes[b], model.rigid - model.d
    turned_back(model, work.A[b], work.forces[e], f)
    p, e0 = o + d, o + model.rigid
    for k in range(turns):
        for i in range(turns):
            axis[i] = 1.0 if i == k else 0.0
        model.swing(axis, f, swung)
        model.torque(c, swung, turn)
        for i in range(turns):
            Ky[p + i, p + k] -= turn[i]
    for j in range(n):
        model.torque(f, B[:, j], turn)
        for k in range(turns):
            Ky[p + k, e0 + j] -= turn[k]
            Ky[e0 + j, p + k] -= turn[k]
    if model.vector_stiffened[e] >= 0:
        T = model.vector_stiffening[model.vector_stiffened[e]]
        for i in range(n):
            for j in range(n):
                for k in range(d):
                    Ky[e0 + i, e0 + j] -= f[k] * T[k, i, j]


@kernel
def begin_pullback(model: Arrays, eq: Equations, work: Work, instant: int) -> None:
    """Shifts L adj of all vectors, work.shift, and their accelerations; clears work.bars."""
    vector_accelerations(model, eq, work, instant)
    for e in range(model.vector_body.size):
        b, L, shift, bars = model.vector_body[e], work.L[e], work.shift[e], work.bars[e]
        for k in range(model.d):
            shift[k] = 0.0
            for what in range(4):
                bars[what, k] = 0.0
        if b >= 0:
            o = model.first[b]
            for i in range(model.rigid + model.modes[b]):
                x = eq.adjoint[o + i]
                for k in range(model.d):
                    shift[k] += L[k, i] * x


@kernel
def finish_pullback(model: Arrays, eq: Equations, work: Work, instant: int) -> None:
    """Transpose of (s, L adj, s', s'') of all vectors."""
    for e in range(model.vector_body.size):
        if model.vector_body[e] < 0:
            to = work.prescribed_bars[instant, model.vector_slot[e]]
            for k in range(model.d):
                to[0, k] += work.bars[e, PLACE, k]
                to[1, k] += work.bars[e, VELOCITY, k]
                to[2, k] += work.bars[e, ACCELERATION, k]
        if model.vector_body[e] >= 0:
            if model.vector_kind[e] < model.own:
                vector_pullback(model, eq, work, e)
            else:
                model.pullback_own(model, eq, work, e)


@kernel
def vector_pullback(model: Arrays, eq: Equations, work: Work, e: int) -> None:
    """Transpose of (s, L adj, s', s'') with respect to y, v and the vector's shape functions.

    Adds to work.gather, eq.v_bar and work.vector_bars; the derivatives with respect to these four
    are the rows of work.bars[e].
    """
    b, dim, rigid = model.vector_body[e], model.d, model.rigid
    o, n, A, B = model.first[b], model.modes[b], work.A[b], work.B[e]
    c, cv = work.c[e], work.cv[e]
    y, v, w, adj, gather, v_bar = eq.y, eq.v, eq.w, eq.adjoint, work.gather, eq.v_bar
    out, small, r, t = work.vector_bars, work.vectors, o + dim, o + rigid
    omega, eps, spin = v[r:t], w[r:t], adj[r:t]
    p, f, d, a = small[0], small[1], small[2], small[3]
    turned_back(model, A, work.bars[e, PLACE], p)
    turned_back(model, A, work.bars[e, SHIFT], f)
    turned_back(model, A, work.bars[e, VELOCITY], d)
    turned_back(model, A, work.bars[e, ACCELERATION], a)
    m, x, s, u, swung = small[4], small[5], small[6], small[7], small[8]
    for k in range(dim):
        m[k] = 0.0
        for j in range(n):
            m[k] += B[k, j] * adj[t + j]
    model.swing(spin, c, x)
    for k in range(dim):
        m[k] += x[k]
    if model.vector_kind[e] == OF_POINT:
        for k in range(dim):
            gather[o + k] += work.bars[e, PLACE, k]
            v_bar[o + k] += work.bars[e, VELOCITY, k]
    # Derivatives with respect to c and cv; swung is omega x a.
    model.swing(omega, a, swung)
    model.swing(omega, swung, s)
    for k in range(dim):
        s[k] += p[k]
        u[k] = d[k] - 2.0 * swung[k]
    model.swing(spin, f, x)
    for k in range(dim):
        s[k] -= x[k]
    model.swing(omega, d, x)
    for k in range(dim):
        s[k] -= x[k]
    model.swing(eps, a, x)
    for k in range(dim):
        s[k] -= x[k]
    # Turns of the body.
    turn = gather[r:t]
    model.add_torque(c, p, 1.0, turn)
    model.add_torque(m, f, 1.0, turn)
    model.add_torque(work.c1[e], d, 1.0, turn)
    model.add_torque(work.c2[e], a, 1.0, turn)
    # The angular velocity: of c1 c x d, of c2 (omega x c) x a + c x (a x omega) + 2 cv x a.
    turn = v_bar[r:t]
    model.add_torque(c, d, 1.0, turn)
    model.add_torque(c, swung, -1.0, turn)
    for k in range(dim):
        m[k] = work.c1[e, k] + cv[k]
    model.add_torque(m, a, 1.0, turn)
    for k in range(dim):
        out[e, k, 0] += s[k]
    for j in range(n):
        for k in range(dim):
            gather[t + j] += B[k, j] * s[k]
            v_bar[t + j] += B[k, j] * u[k]
            out[e, k, j + 1] += (
                s[k] * y[t + j] + u[k] * v[t + j] + a[k] * w[t + j] + f[k] * adj[t + j]
            )
    if model.vector_stiffened[e] >= 0:
        bend_pullback(model, eq, work, e, s, u, f, a)


@kernel
def bend_pullback(
    model: Arrays,
    eq: Equations,
    work: Work,
    e: int,
    c_bar: Vector,
    cv_bar: Vector,
    adjoint_bar: Vector,
    w_bar: Vector,
) -> None:
    """Share of the geometric stiffness T of vector e in vector_pullback.

    The bars are derivatives with respect to c, cv, B adj and B w - v . T v, of shape (d,) each.
    """
    b, T = model.vector_body[e], model.vector_stiffening[model.vector_stiffened[e]]
    first, n, out = model.first[b] + model.rigid, model.modes[b], work.vector_bars
    y, v, w, adj = eq.y, eq.v, eq.w, eq.adjoint
    for k in range(model.d):
        for j in range(n):
            eq.v_bar[first + j] -= 2.0 * w_bar[k] * work.bend[e, k, j]
            row_bar = (
                0.5 * c_bar[k] * y[first + j]
                + cv_bar[k] * v[first + j]
                + w_bar[k] * w[first + j]
                + adjoint_bar[k] * adj[first + j]
            )
            for i in range(n):
                work.gather[first + j] -= T[k, j, i] * (
                    adjoint_bar[k] * adj[first + i]
                    + cv_bar[k] * v[first + i]
                    + w_bar[k] * w[first + i]
                )
                by_T = row_bar * y[first + i] + w_bar[k] * v[first + j] * v[first + i]
                out[e, model.d + k * n + j, i + 1] -= by_T
