# SPDX-License-Identifier: MIT
"""Time steps of the generalised-alpha method, and their transpose.

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

from typing import NamedTuple

import numpy as np

from ...arrays import Array
from .. import equations
from ..compilation import IntVector, Matrix, Vector, compiled, kernel
from ..equations import Equations, chart, evaluate, pullback
from .linear import LinearSystem, lu_factor, lu_solve, lu_solve_transposed
from .start import CONVERGED, DIVERGED, SINGULAR, set_units

#: Most Newton iterations of one step.
MAX_ITERATIONS = 25


class NewtonOptions(NamedTuple):
    """When Newton's method of a step has converged.

    A named tuple, whose numbers are constants of the compiled functions.
    """

    #: A correction is negligible below this share of the largest acceleration, or of the round-off
    #: of positions and velocities as it shows in accelerations.
    negligible: float = 1e-10
    round_off: float = 2e-15
    #: Newton's method ends as well when the correction has fallen by this factor at least and the
    #: next one, which falls likewise, would be below this share. The trajectory needs less, but the
    #: adjoint assumes steps that are solved exactly.
    fast: float = 1e-2
    following: float = 1e-14
    #: From the third iteration on corrections of this size, relative to accelerations and to
    #: round-off, are round-off that a nearly singular position magnifies.
    magnified: float = 1e-8
    magnified_round_off: float = 1e-10
    #: From the ninth iteration on no iteration makes corrections of this size any better.
    stalled: float = 1e-8


NEWTON = NewtonOptions()


class Steps(NamedTuple):
    """Trajectory in constant steps, and vectors of one step."""

    parameters: Vector  # (5,) step h, alpha_m, alpha_f, gamma, beta
    y: Matrix  # (steps + 1, n) coordinates
    v: Matrix  # (steps + 1, n) velocities
    w: Matrix  # (steps + 1, n) accelerations
    a: Matrix  # (steps + 1, n) accelerations of the method
    lam: Matrix  # (steps + 1, rows) multipliers
    eta: Matrix  # (steps + 1, rows) multipliers of the position corrections
    iterations: IntVector  # (steps,) Newton iterations
    last: IntVector  # (1,) last good step, or the one whose transpose is singular
    y_known: Vector  # (n,) part of y' that the unknowns do not change
    v_known: Vector  # (n,)
    pushes: Vector  # (rows,) h eta / cy


class StepBars(NamedTuple):
    """Derivatives with respect to a trajectory, and their transposes, with adjoints over time."""

    y: Matrix  # (instants, n) derivatives with respect to coordinates
    v: Matrix  # (instants, n) velocities
    w: Matrix  # (instants, n) accelerations
    lam: Matrix  # (instants, rows) multipliers
    adjoint: Matrix  # (instants, n) adjoint of the forces, to be filled in
    left: Matrix  # (instants, n) D y_bar, to be filled in
    right: Matrix  # (instants, n) D C_y^T times the multipliers of corrections, to be filled in
    start: Matrix  # (4, n) derivatives with respect to y, v, w, a at the start, to be filled in


def step_bars(y: Array, v: Array, w: Array, lam: Array) -> StepBars:
    """Copies of derivatives with respect to a trajectory, with room for their transposes."""

    def copied(array: Array) -> Array:
        return np.array(array, dtype=np.float64, order="C")

    return StepBars(
        copied(y),
        copied(v),
        copied(w),
        copied(lam),
        adjoint=np.zeros(y.shape),
        left=np.zeros(y.shape),
        right=np.zeros(y.shape),
        start=np.zeros((4, y.shape[1])),
    )


@kernel
def coefficients(parameters: Vector) -> tuple[float, ...]:
    """h, gamma, beta; a0, a1, a2 of a' = a0 w + a1 w' - a2 a; derivatives cy, cv by w'."""
    h, gamma, beta = parameters[0], parameters[3], parameters[4]
    alpha_m, alpha_f = parameters[1], parameters[2]
    a0, a1 = alpha_f / (1.0 - alpha_m), (1.0 - alpha_f) / (1.0 - alpha_m)
    a2 = alpha_m / (1.0 - alpha_m)
    return h, gamma, beta, a0, a1, a2, h * h * beta * a1, h * gamma * a1


@kernel
def step_system(eq: Equations, system: LinearSystem, instant: int, cy: float, cv: float) -> None:
    """Residual (system.rhs) and Jacobian (system.A) of one step in (w, lam, h eta / cy).

    cy and cv are the derivatives of y and v with respect to w; the rows of the constraints are
    divided by them, which makes the matrix well conditioned for any step.
    """
    evaluate(eq, instant, cv, equations.CONSTRAINTS | equations.FORCES | equations.TANGENT)
    n, rows, A, rhs = eq.r.size, eq.value.size, system.A, system.rhs
    M, Ky, C, D, correction, lam = eq.M, eq.Ky, eq.C, eq.D, eq.correction, eq.lam
    Cy = eq.Cy
    for i in range(n):
        for j in range(n):
            A[i, j] = M[i, j] + cy * Ky[i, j]
        total = eq.r[i]
        for c in range(rows):
            total += C[c, i] * lam[c]
            A[i, n + c] = C[c, i]
        times_transposed(Ky[i], correction, -cy, A[i, n + rows :])
        rhs[i] = total
    ratio = cy / cv
    for i in range(rows):
        p, q = n + i, n + rows + i
        rhs[p] = eq.value[i] / cy
        rhs[q] = eq.rate[i] / cv
        for j in range(n):
            A[p, j] = Cy[i, j]
            A[q, j] = C[i, j] + ratio * D[i, j]
        for c in range(rows):
            A[p, n + c] = A[q, n + c] = 0.0
        times_transposed(Cy[i], correction, -1.0, A[p, n + rows :])
        times_transposed(D[i], correction, -ratio, A[q, n + rows :])


@kernel
def times_transposed(x: Vector, B: Matrix, factor: float, out: Vector) -> None:
    """Set out to factor times B x; the sums of three rows at a time do not wait for each other."""
    rows, n = B.shape
    in_threes = rows - rows % 3
    for c in range(0, in_threes, 3):
        sum0 = sum1 = sum2 = 0.0
        for j in range(n):
            sum0 += x[j] * B[c, j]
            sum1 += x[j] * B[c + 1, j]
            sum2 += x[j] * B[c + 2, j]
        out[c], out[c + 1], out[c + 2] = factor * sum0, factor * sum1, factor * sum2
    for c in range(in_threes, rows):
        total = 0.0
        for j in range(n):
            total += x[j] * B[c, j]
        out[c] = factor * total


@kernel
def pushed(eq: Equations, factors: Vector, i: int) -> float:
    """Entry i of D C_y^T times factors (rows,)."""
    total = 0.0
    for c in range(eq.value.size):
        total += eq.correction[c, i] * factors[c]
    return total


@kernel
def solved(
    iteration: int, change: float, previous: float, largest: float, round_off: float
) -> bool:
    """Whether Newton's method is done after a correction, `previous` being the one before."""
    if change <= NEWTON.negligible * largest + NEWTON.round_off * round_off:
        return True
    if iteration > 0 and change <= NEWTON.fast * previous:
        return change * (change / previous) <= NEWTON.following * largest
    if (
        iteration > 1
        and change <= NEWTON.magnified * largest + NEWTON.magnified_round_off * round_off
    ):
        return True
    return iteration > 7 and change <= NEWTON.stalled * (largest + round_off)


@compiled(Equations, Steps, LinearSystem)
def march(eq: Equations, steps: Steps, system: LinearSystem) -> int:
    """All time steps from row 0 of the arrays; the result is the outcome."""
    h, gamma, beta, a0, a1, a2, cy, cv = coefficients(steps.parameters)
    n, rows = eq.r.size, eq.value.size
    y, v, w, lam, s, rhs = eq.y, eq.v, eq.w, eq.lam, steps.pushes, system.rhs
    yp, vp, M, Ky = steps.y_known, steps.v_known, eq.M, eq.Ky
    for i in range(n):
        y[i], v[i] = steps.y[0, i], steps.v[0, i]
        eq.base[i] = y[i]
    chart(eq, 0, equations.BEGIN)
    evaluate(eq, 0, 0.0, equations.CONSTRAINTS | equations.CORRECTIONS)
    for k in range(steps.iterations.size):
        for i in range(n):
            wk, ak = steps.w[k, i], steps.a[k, i]
            known = a0 * wk - a2 * ak
            yp[i] = steps.y[k, i] + h * steps.v[k, i] + h * h * ((0.5 - beta) * ak + beta * known)
            vp[i] = steps.v[k, i] + h * ((1.0 - gamma) * ak + gamma * known)
            w[i] = wk
            y[i], v[i] = yp[i] + cy * wk, vp[i] + cv * wk
        for c in range(rows):
            lam[c], s[c] = steps.lam[k, c], 0.0
        status, previous = DIVERGED, 0.0
        for iteration in range(MAX_ITERATIONS):
            step_system(eq, system, k + 1, cy, cv)
            if iteration == 0:
                set_units(eq, system, cy)
            if not lu_factor(system, n + 2 * rows):
                status = SINGULAR
                break
            lu_solve(system, n + 2 * rows)
            for c in range(rows):
                lam[c] -= rhs[n + c]
                s[c] -= rhs[n + rows + c]
            change = largest = round_off = 0.0
            finite = True
            for i in range(n):
                shift = pushed(eq, rhs[n + rows :], i)
                # Weights that make corrections in metres, radians and modal units comparable.
                weight = np.sqrt(abs(M[i, i] + cy * Ky[i, i]))
                delta = rhs[i]
                finite = finite and np.isfinite(delta)
                w[i] -= delta
                y[i], v[i] = yp[i] + cy * (w[i] - pushed(eq, s, i)), vp[i] + cv * w[i]
                change = max(change, weight * max(abs(delta), abs(delta - shift)))
                largest = max(largest, weight * abs(w[i]))
                size = max(abs(y[i]), eq.floor[i])
                round_off = max(round_off, weight * (size / cy + abs(v[i]) / cv))
            steps.iterations[k] = iteration + 1
            if not finite:
                break
            if solved(iteration, change, previous, largest, round_off):
                status = CONVERGED
                break
            previous = change
        for c in range(rows):
            steps.lam[k + 1, c], steps.eta[k + 1, c] = lam[c], s[c] * cy / h
        chart(eq, k + 1, equations.COMPOSE)
        for i in range(n):
            eq.base[i] = y[i]
            steps.y[k + 1, i], steps.v[k + 1, i], steps.w[k + 1, i] = y[i], v[i], w[i]
            steps.a[k + 1, i] = a1 * w[i] + a0 * steps.w[k, i] - a2 * steps.a[k, i]
        steps.last[0] = k
        if status != CONVERGED:
            return status
        chart(eq, k + 1, equations.BEGIN)
        evaluate(eq, k + 1, 0.0, equations.CONSTRAINTS | equations.CORRECTIONS)
        steps.last[0] = k + 1
    return CONVERGED


@compiled(Equations, Steps, StepBars, LinearSystem)
def backward(eq: Equations, steps: Steps, bars: StepBars, system: LinearSystem) -> int:
    """Transpose of :func:`march`; the result is the outcome.

    Fills in what the bars leave open, except the row of the start; the derivative with respect to
    an integral is minus the sum over time of adjoint . dr.
    """
    h, gamma, beta, a0, a1, a2, cy, cv = coefficients(steps.parameters)
    n, rows, rhs = eq.r.size, eq.value.size, system.rhs
    yb, vb, wb, ab = eq.y_bar, eq.v_bar, bars.start[2], bars.start[3]
    for c in range(rows):
        eq.on_accelerations[c] = 0.0
    for i in range(n):
        yb[i] = vb[i] = wb[i] = ab[i] = 0.0
    for k in range(steps.iterations.size, 0, -1):
        for i in range(n):
            eq.y[i], eq.v[i] = steps.y[k - 1, i], steps.v[k - 1, i]
            eq.base[i] = eq.y[i]
        chart(eq, k - 1, equations.BEGIN)
        evaluate(eq, k - 1, 0.0, equations.CONSTRAINTS | equations.CORRECTIONS)
        for i in range(n):
            eq.y[i], eq.v[i], eq.w[i] = steps.y[k, i], steps.v[k, i], steps.w[k, i]
        # Rotations within the step, which may be more than half a turn.
        for b in range(eq.turning.size):
            for i in range(eq.turning[b], eq.turning[b] + 3):
                pull = (0.5 - beta) * steps.a[k - 1, i] + beta * steps.a[k, i]
                eq.y[i] = steps.y[k - 1, i] + h * steps.v[k - 1, i] + h * h * pull
                eq.y[i] -= h * pushed(eq, steps.eta[k], i)
        for c in range(rows):
            eq.lam[c] = steps.lam[k, c]
        step_system(eq, system, k, cy, cv)
        set_units(eq, system, cy)
        if not lu_factor(system, n + 2 * rows):
            steps.last[0] = k
            return SINGULAR
        for i in range(n):
            yb[i] += bars.y[k, i]
        chart(eq, k, equations.ENTER)
        for i in range(n):
            vb[i] += bars.v[k, i]
            wb[i] += bars.w[k, i]
            rhs[i] = wb[i] + a1 * ab[i] + cy * yb[i] + cv * vb[i]
        for c in range(rows):
            rhs[n + c] = bars.lam[k, c]
        times_transposed(yb, eq.correction, -cy, rhs[n + rows :])
        lu_solve_transposed(system, n + 2 * rows)
        for i in range(n):
            bars.adjoint[k, i] = eq.adjoint[i] = rhs[i]
        for c in range(rows):
            eq.on_values[c] = rhs[n + c] / cy
            eq.on_rates[c] = rhs[n + rows + c] / cv
        pullback(eq, k, equations.BODY_FORCES | equations.OTHER_FORCES | equations.ROWS)
        # The share of y' = ... - h D C_y^T eta, with the constraints where the step began.
        for i in range(n):
            eq.adjoint[i] = yb[i]
            total = ab[i] + h * h * beta * yb[i] + h * gamma * vb[i]
            wb[i] = a0 * total
            ab[i] = h * h * (0.5 - beta) * yb[i] + h * (1.0 - gamma) * vb[i] - a2 * total
            vb[i] += h * yb[i]
            bars.right[k, i] = pushed(eq, steps.eta[k], i)
        chart(eq, k, equations.LEAVE)
        for i in range(n):
            eq.y[i], eq.v[i] = steps.y[k - 1, i], steps.v[k - 1, i]
        for c in range(rows):
            eq.lam[c] = h * steps.eta[k, c]
            eq.on_values[c] = eq.on_rates[c] = 0.0
        evaluate(eq, k - 1, 0.0, equations.CONSTRAINTS)
        pullback(eq, k - 1, equations.ROWS | equations.METRIC)
        for i in range(n):
            bars.left[k, i] = eq.adjoint[i]
    for i in range(n):
        bars.start[0, i], bars.start[1, i] = yb[i], vb[i]
    return CONVERGED
