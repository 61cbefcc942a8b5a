# SPDX-License-Identifier: MIT
"""Start, time steps and their transposes.

The stabilised index-2 form of the generalised-alpha method advances coordinates y, velocities v,
accelerations w and the method's own accelerations a by

    y' = y + h v + h^2 [(1/2 - beta) a + beta a'] - h C_y(y)^T eta
    v' = v + h [(1 - gamma) a + gamma a']
    (1 - alpha_m) a' + alpha_m a = (1 - alpha_f) w' + alpha_f w
    r(y', v', w') + C_y(y')^T lam' = 0,    C(y', t') = 0,    C_y(y') v' + C_t(y', t') = 0

(M. Arnold, O. Brüls, A. Cardona, Error analysis of generalized-alpha Lie group time integration
methods for constrained mechanical systems, Numerische Mathematik 129 (2015),
doi:10.1007/s00211-014-0633-1). The unknowns of a step are (w', lam', h eta / c_y), c_y and c_v the
derivatives of y' and v' with respect to w'.
"""

from __future__ import annotations

import numpy as np

from .arrays import kernel, make_work
from .bodies import body_equations, body_pullback
from .linear import lu_factor, lu_solve, lu_solve_transposed
from .rows import (
    evaluate_rows,
    marker_push,
    marker_velocities,
    row_curvatures,
    row_hessian,
    rows_pullback,
)

#: Outcome of the loops.
CONVERGED, SINGULAR, DIVERGED = 0, 1, 2

#: Most Newton iterations of one step.
MAX_ITERATIONS = 25


@kernel
def marker_accelerations(model, k, w, y, v, work, out):
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


@kernel
def solve_accelerations(model, k, y, v, w, lam, work):
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
    work.M[:, :] = 0.0
    for b in range(model.first.size):
        body_equations(model, b, y, v, w, 0.0, work)
    zdd = np.empty((model.marker_body.size, 3))
    marker_accelerations(model, k, w, y, v, work, zdd)
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
def accelerations_pullback(model, k, y, v, w, lam, w_bar, lam_bar, work, x, y_bar, v_bar, markers):
    """Transpose of solve_accelerations; x (n,) and the marker bars serve for the integrals."""
    n, rows = y.size, model.kind.size
    again = np.empty(n)
    if not solve_accelerations(model, k, y, v, again, lam.copy(), work):
        return False
    work.rhs[:n] = w_bar
    work.rhs[n : n + rows] = lam_bar
    lu_solve(work.A, n + rows, work.pivot, work.rhs)  # the matrix is symmetric
    x[:] = work.rhs[:n]
    last = work.rhs[n : n + rows].copy()
    none = np.zeros(rows)
    for b in range(model.first.size):
        body_pullback(model, b, y, v, w, x, work, y_bar, v_bar)
    zdd = np.empty((model.marker_body.size, 3))
    marker_accelerations(model, k, w, y, v, work, zdd)
    rows_pullback(model, y, v, w, zdd, lam, x, none, none, last, -1.0, work, y_bar, v_bar, markers)
    return True


@kernel
def step_system(model, k, y, v, w, lam, cy, cv, work):
    """Residual (work.rhs) and Jacobian (work.A) of one step in (w, lam, h eta / cy).

    cy and cv are the derivatives of y and v with respect to w; the rows of the constraints are
    divided by them, which makes the matrix well conditioned for any step.
    """
    n, rows = y.size, model.kind.size
    A = work.A
    evaluate_rows(model, k, y, v, work)
    work.M[:, :] = 0.0
    work.Ky[:, :] = 0.0
    for b in range(model.first.size):
        body_equations(model, b, y, v, w, cv, work)
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
                push += work.Ky[i, j] * work.old[c, j]
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
                first += work.C[i, j] * work.old[c, j]
                second += work.D[i, j] * work.old[c, j]
            A[p, n + rows + c] = -first
            A[q, n + rows + c] = -ratio * second


@kernel
def start(model, y, v, w, lam, instant, offset, extra):
    """Accelerations at the first instant, and at another shortly after it.

    The latter are taken at the state moved by `offset` along the motion and written to the rows
    of extra (4, n): coordinates, velocities, accelerations there, and their multipliers.
    """
    work = make_work(model)
    if not solve_accelerations(model, 0, y, v, w, lam, work):
        return SINGULAR
    for i in range(y.size):
        extra[0, i] = y[i] + offset * v[i] + 0.5 * offset * offset * w[i]
        extra[1, i] = v[i] + offset * w[i]
    after = extra[3, : lam.size]
    if not solve_accelerations(model, instant, extra[0], extra[1], extra[2], after, work):
        return SINGULAR
    return CONVERGED


@kernel
def march(model, h, method, y, v, w, a, lam, eta, iterations):
    """All time steps from row 0 of the arrays; returns the outcome and the last step begun.

    Newton's method ends when the correction is negligible, or when quadratic convergence, as seen
    in the last two corrections, has taken the next one below round-off.
    """
    alpha_m, alpha_f, gamma, beta = method
    a1, a2 = (1.0 - alpha_f) / (1.0 - alpha_m), alpha_m / (1.0 - alpha_m)
    a0 = alpha_f / (1.0 - alpha_m)
    cy, cv = h * h * beta * a1, h * gamma * a1
    work = make_work(model)
    n, rows = y.shape[1], model.kind.size
    size = n + 2 * rows
    yp, vp, s = np.empty(n), np.empty(n), np.zeros(rows)
    evaluate_rows(model, 0, y[0], v[0], work)
    work.old[:, :] = work.C
    for k in range(iterations.size):
        yn, vn, wn, ln = y[k + 1], v[k + 1], w[k + 1], lam[k + 1]
        for i in range(n):
            rest = a0 * w[k, i] - a2 * a[k, i]
            yp[i] = y[k, i] + h * v[k, i] + h * h * ((0.5 - beta) * a[k, i] + beta * rest)
            vp[i] = v[k, i] + h * ((1.0 - gamma) * a[k, i] + gamma * rest)
            wn[i] = w[k, i]
            yn[i], vn[i] = yp[i] + cy * wn[i], vp[i] + cv * wn[i]
        for c in range(rows):
            ln[c], s[c] = lam[k, c], 0.0
        status, previous = DIVERGED, 0.0
        for iteration in range(MAX_ITERATIONS):
            step_system(model, k + 1, yn, vn, wn, ln, cy, cv, work)
            if not lu_factor(work.A, size, work.pivot, work.scale):
                status = SINGULAR
                break
            lu_solve(work.A, size, work.pivot, work.rhs)
            for c in range(rows):
                ln[c] -= work.rhs[n + c]
                s[c] -= work.rhs[n + rows + c]
            change = largest = floor = 0.0
            for i in range(n):
                shift = pushed = 0.0
                for c in range(rows):
                    shift += work.old[c, i] * work.rhs[n + rows + c]
                    pushed += work.old[c, i] * s[c]
                # Weights that make corrections in metres, radians and modal units comparable.
                weight = np.sqrt(abs(work.M[i, i] + cy * work.Ky[i, i]))
                delta = work.rhs[i]
                wn[i] -= delta
                yn[i], vn[i] = yp[i] + cy * (wn[i] - pushed), vp[i] + cv * wn[i]
                change = max(change, weight * max(abs(delta), abs(delta - shift)))
                largest = max(largest, weight * abs(wn[i]))
                floor = max(floor, weight * (abs(yn[i]) / cy + abs(vn[i]) / cv))
            iterations[k] = iteration + 1
            if not np.isfinite(change):
                break
            if change <= 1e-10 * largest + 2e-15 * floor:
                status = CONVERGED
            elif iteration > 0 and change <= 1e-2 * previous:
                if change * (change / previous) ** 2 <= 1e-14 * largest:
                    status = CONVERGED
            if status == CONVERGED:
                break
            previous = change
        for c in range(rows):
            eta[k + 1, c] = s[c] * cy / h
        for i in range(n):
            a[k + 1, i] = a1 * wn[i] + a0 * w[k, i] - a2 * a[k, i]
        if status != CONVERGED:
            return status, k
        evaluate_rows(model, k + 1, yn, vn, work)
        work.old[:, :] = work.C
    return CONVERGED, iterations.size


@kernel
def backward(model, h, method, offset, states, multipliers, extra, bars, lam_bars, x, markers):
    """Transpose of start and march.

    Args:
        model: Flat arrays of the mechanism.
        h: Time step.
        method: alpha_m, alpha_f, gamma, beta.
        offset: Time from the first instant to the one of `extra`.
        states: y, v, w, a, shape (4, steps + 1, n).
        multipliers: lam, eta, shape (2, steps + 1, rows).
        extra: As left by start, shape (4, n).
        bars: Derivatives with respect to y, v, w, shape (3, steps + 1, n).
        lam_bars: Derivative with respect to lam, shape (steps + 1, rows).
        x: Filled with the adjoint of the forces r, shape (steps + 2, n); the last row belongs to
            `extra`. The derivative with respect to an integral is minus the sum of x . dr.
        markers: Filled with the derivatives with respect to the markers' shape functions.
    """
    alpha_m, alpha_f, gamma, beta = method
    a1, a2 = (1.0 - alpha_f) / (1.0 - alpha_m), alpha_m / (1.0 - alpha_m)
    a0 = alpha_f / (1.0 - alpha_m)
    cy, cv = h * h * beta * a1, h * gamma * a1
    y, v, w = states[0], states[1], states[2]
    lam, eta = multipliers[0], multipliers[1]
    steps, n, rows = y.shape[0] - 1, y.shape[1], model.kind.size
    size = n + 2 * rows
    work = make_work(model)
    none, zdd = np.zeros(rows), np.zeros((model.marker_body.size, 3))
    yb, vb, wb, ab = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    m2, m3, held, unused = np.empty(rows), np.empty(rows), np.empty(rows), np.zeros(n)
    for k in range(steps, 0, -1):
        evaluate_rows(model, k - 1, y[k - 1], v[k - 1], work)
        work.old[:, :] = work.C
        step_system(model, k, y[k], v[k], w[k], lam[k], cy, cv, work)
        if not lu_factor(work.A, size, work.pivot, work.scale):
            return SINGULAR, k
        rhs = work.rhs
        for i in range(n):
            yb[i] += bars[0, k, i]
            vb[i] += bars[1, k, i]
            wb[i] += bars[2, k, i]
            rhs[i] = wb[i] + a1 * ab[i] + cy * yb[i] + cv * vb[i]
        for c in range(rows):
            rhs[n + c] = lam_bars[k, c]
            total = 0.0
            for i in range(n):
                total += work.old[c, i] * yb[i]
            rhs[n + rows + c] = -cy * total
        lu_solve_transposed(work.A, size, work.pivot, rhs)
        for i in range(n):
            x[k, i] = rhs[i]
        for c in range(rows):
            m2[c] = rhs[n + c] / cy
            m3[c] = rhs[n + rows + c] / cv
            held[c] = h * eta[k, c]
        for b in range(model.first.size):
            body_pullback(model, b, y[k], v[k], w[k], x[k], work, yb, vb)
        rows_pullback(
            model, y[k], v[k], w[k], zdd, lam[k], x[k], m2, m3, none, -1.0, work, yb, vb, markers
        )
        evaluate_rows(model, k - 1, y[k - 1], v[k - 1], work)
        for i in range(n):
            total = ab[i] + h * h * beta * yb[i] + h * gamma * vb[i]
            wb[i] = a0 * total
            ab[i] = h * h * (0.5 - beta) * yb[i] + h * (1.0 - gamma) * vb[i] - a2 * total
            vb[i] += h * yb[i]
            rhs[i] = yb[i]
        rows_pullback(
            model, y[k - 1], v[k - 1], w[k - 1], zdd, held, rhs[:n].copy(), none, none, none,
            -1.0, work, yb, unused, markers,
        )  # fmt: skip
    # a_0 = w_0 + (alpha_m - alpha_f) h (w_1 - w_0) / offset with w_1 the accelerations of `extra`.
    f = (alpha_m - alpha_f) * h / offset
    yb[:] = 0.0
    vb[:] = 0.0
    wb += (1.0 - f) * ab + bars[2, 0]
    ab *= f
    if not accelerations_pullback(
        model, steps + 1, extra[0], extra[1], extra[2], extra[3, :rows], ab, none, work,
        x[steps + 1], yb, vb, markers,
    ):  # fmt: skip
        return SINGULAR, 0
    wb += 0.5 * offset * offset * yb + offset * vb
    if not accelerations_pullback(
        model, 0, y[0], v[0], w[0], lam[0], wb, lam_bars[0], work, x[0], yb, vb, markers
    ):
        return SINGULAR, 0
    return CONVERGED, 0
