# SPDX-License-Identifier: MIT
"""Start, time steps and their transposes.

The stabilised index-2 form of the generalised-alpha method advances coordinates y, velocities v,
accelerations w and the method's own accelerations a by

    y' = y + h v + h^2 [(1/2 - beta) a + beta a'] - h D C_y(y)^T eta
    v' = v + h [(1 - gamma) a + gamma a']
    (1 - alpha_m) a' + alpha_m a = (1 - alpha_f) w' + alpha_f w
    r(y', v', w') + C_y(y')^T lam' = 0,    C(y', t') = 0,    C_y(y') v' + C_t(y', t') = 0

(M. Arnold, O. Brüls, A. Cardona, Error analysis of generalized-alpha Lie group time integration
methods for constrained mechanical systems, Numerische Mathematik 129 (2015),
doi:10.1007/s00211-014-0633-1). D is the inverse of a mass matrix, as in the original stabilisation
(C. W. Gear, B. Leimkuhler, G. K. Gupta, Automatic integration of Euler-Lagrange equations with
constraints, Journal of Computational and Applied Mathematics 12-13 (1985),
doi:10.1016/0377-0427(85)90008-1), which makes the result independent of the basis of the elastic
coordinates; it suffices to take the constant blocks m, m, G_00 and G_jk. The unknowns of a step are
(w', lam', h eta / c_y), c_y and c_v the derivatives of y' and v' with respect to w'.
"""

from __future__ import annotations

import numpy as np

from .arrays import Array, ModelArrays, Work, kernel
from .bodies import body_equations, body_pullback
from .forces import add_forces, forces_pullback
from .linear import lu_factor, lu_solve, lu_solve_transposed
from .rows import (
    evaluate_rows,
    marker_push,
    marker_velocities,
    row_curvatures,
    row_hessian,
    rows_pullback,
    subtract_bend,
)


@kernel
def marker_accelerations(
    model: ModelArrays, k: int, w: Array, v: Array, work: Work, out: Array
) -> None:
    """Accelerations of all markers under w at given positions and velocities, out (markers, 3)."""
    for m in range(model.marker_body.size):
        b = model.marker_body[m]
        if b < 0:
            for i in range(3):
                out[m, i] = model.prescribed[k, model.marker_slot[m], 2, i]
        else:
            omega = v[model.first[b] + 2]
            marker_push(model, m, w, work, work.out, 0)
            out[m, 0] = work.out[0] - omega * (omega * work.arm[m, 0] + 2.0 * work.swing[m, 1])
            out[m, 1] = work.out[1] - omega * (omega * work.arm[m, 1] - 2.0 * work.swing[m, 0])
            out[m, 2] = work.out[2]
            subtract_bend(model, m, v, work, out[m], 0)


@kernel
def solve_accelerations(
    model: ModelArrays, k: int, y: Array, v: Array, w: Array, lam: Array, work: Work
) -> bool:
    """Accelerations and multipliers at given coordinates and velocities; False where singular.

    Solves M w + C_y^T lam = -r(y, v, 0) and d^2C/dt^2 = 0. The factors stay in work.A.
    """
    n, rows = y.size, model.kind.size
    evaluate_rows(model, k, y, v, work)
    for i in range(n):
        w[i] = 0.0
    for i in range(n + rows):
        for j in range(n + rows):
            work.A[i, j] = 0.0
    for i in range(n):
        for j in range(n):
            work.M[i, j] = 0.0
    for b in range(model.first.size):
        body_equations(model, k, b, y, v, w, 0.0, work)
    add_forces(model, k, v, 0.0, work)
    zdd = np.empty((model.marker_body.size, 3))
    marker_accelerations(model, k, w, v, work, zdd)
    for i in range(n):
        work.rhs[i] = -work.r[i]
        for j in range(n):
            work.A[i, j] = work.M[i, j]
    for i in range(rows):
        total = -model.drive[k, i, 2]
        marker_velocities(model, i, work)
        row_hessian(model, i, work.z, work.u, work.out)
        for j in range(6):
            total += work.out[j] * work.u[j]
            total += work.g[i, j] * zdd[model.side[i, j // 3], j % 3]
        work.rhs[n + i] = -total
        for j in range(n):
            work.A[n + i, j] = work.A[j, n + i] = work.C[i, j]
    if not lu_factor(work.A, n + rows, work.pivot, work.scale):
        return False
    lu_solve(work.A, n + rows, work.pivot, work.rhs)
    for i in range(n):
        w[i] = work.rhs[i]
    for i in range(rows):
        lam[i] = work.rhs[n + i]
    return True


@kernel
def accelerations_pullback(
    model: ModelArrays,
    k: int,
    y: Array,
    v: Array,
    w: Array,
    lam: Array,
    w_bar: Array,
    lam_bar: Array,
    work: Work,
    x: Array,
    y_bar: Array,
    v_bar: Array,
    markers: Array,
) -> bool:
    """Transpose of solve_accelerations; x (n,) and the marker bars serve for the integrals."""
    n, rows = y.size, model.kind.size
    again = np.empty(n)
    if not solve_accelerations(model, k, y, v, again, lam.copy(), work):
        return False
    for i in range(n):
        work.rhs[i] = w_bar[i]
    for i in range(rows):
        work.rhs[n + i] = lam_bar[i]
    lu_solve_transposed(work.A, n + rows, work.pivot, work.rhs)
    last = np.empty(rows)
    for i in range(n):
        x[i] = work.rhs[i]
    for i in range(rows):
        last[i] = work.rhs[n + i]
    none = np.zeros(rows)
    for b in range(model.first.size):
        body_pullback(model, k, b, y, v, w, x, work, y_bar, v_bar)
    forces_pullback(model, k, y, v, w, x, work, y_bar, v_bar, markers)
    zdd = np.empty((model.marker_body.size, 3))
    marker_accelerations(model, k, w, v, work, zdd)
    rows_pullback(model, y, v, w, zdd, lam, x, none, none, last, -1.0, work, y_bar, v_bar, markers)
    return True


@kernel
def step_system(
    model: ModelArrays,
    k: int,
    y: Array,
    v: Array,
    w: Array,
    lam: Array,
    cy: float,
    cv: float,
    work: Work,
) -> None:
    """Residual (work.rhs) and Jacobian (work.A) of one step in (w, lam, h eta / cy).

    cy and cv are the derivatives of y and v with respect to w; the rows of the constraints are
    divided by them, which makes the matrix well conditioned for any step.
    """
    n, rows = y.size, model.kind.size
    A = work.A
    evaluate_rows(model, k, y, v, work)
    for i in range(n):
        for j in range(n):
            work.M[i, j] = work.Ky[i, j] = 0.0
    for b in range(model.first.size):
        body_equations(model, k, b, y, v, w, cv, work)
    add_forces(model, k, v, cv, work)
    row_curvatures(model, v, lam, work)
    for i in range(n):
        for j in range(n):
            A[i, j] = work.M[i, j] + cy * work.Ky[i, j]
        total = work.r[i]
        for c in range(rows):
            total += work.C[c, i] * lam[c]
            A[i, n + c] = work.C[c, i]
            push = 0.0
            for j in range(n):
                push += work.Ky[i, j] * work.correction[c, j]
            A[i, n + rows + c] = -cy * push
        work.rhs[i] = total
    ratio = cy / cv
    for i in range(rows):
        p, q = n + i, n + rows + i
        work.rhs[p] = work.value[i] / cy
        work.rhs[q] = work.rate[i] / cv
        for j in range(n):
            A[p, j] = work.C[i, j]
            A[q, j] = work.C[i, j] + ratio * work.D[i, j]
        for c in range(rows):
            A[p, n + c] = A[q, n + c] = 0.0
            first = second = 0.0
            for j in range(n):
                first += work.C[i, j] * work.correction[c, j]
                second += work.D[i, j] * work.correction[c, j]
            A[p, n + rows + c] = -first
            A[q, n + rows + c] = -ratio * second


@kernel
def keep_corrections(model: ModelArrays, work: Work) -> None:
    """Keep D C_y^T, the directions in which the step that begins here corrects positions."""
    for i in range(model.kind.size):
        apply_inverse(model, work.C[i], work.correction[i])


@kernel
def apply_inverse(model: ModelArrays, x: Array, out: Array) -> None:
    """Set out to D x."""
    for b in range(model.first.size):
        o, size = model.first[b], 3 + model.modes[b]
        for j in range(size):
            out[o + j] = 0.0
        for i in range(size):
            for j in range(size):
                out[o + j] += model.inverse[b, i, j] * x[o + i]
