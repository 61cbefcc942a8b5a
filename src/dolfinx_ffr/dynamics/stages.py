# SPDX-License-Identifier: MIT
"""Stage equations of the Radau IIA method of order 5, and its error estimate.

With the coefficients a_ij of the three stages, alpha = a^2, and the state (y, v) at the beginning
of a step of length h, the unknowns of stage i are accelerations w_i, multipliers lam_i and
corrections sigma_i of the positions:

    V_i = v + h sum_j a_ij w_j
    Y_i = y + c_i h v + h^2 sum_j alpha_ij w_j - h^2 D C_y(y)^T sigma_i
    r(Y_i, V_i, w_i) + C_y(Y_i)^T lam_i = 0,   C(Y_i, t_i) = 0,   C_y(Y_i) V_i + C_t(Y_i, t_i) = 0

This is the method applied to y' = v - D C_y^T mu, v' = w with h^2 sigma_i = h sum_j a_ij mu_j: the
form of Gear, Leimkuhler and Gupta, whose multipliers mu vanish along the exact motion, so that the
directions D C_y^T may be those at the beginning of the step (see steps.py for D). The last stage is
the end of the step: constraints on positions and on velocities hold there, and at the others.

Coordinates and velocities are of order 5, accelerations and multipliers of order 3 (E. Hairer,
G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., Springer 1996, sections IV.8 and
VII.4, doi:10.1007/978-3-642-05221-7).
"""

from __future__ import annotations

import math

import numpy as np

from .arrays import Array, ModelArrays, Work, kernel
from .bodies import body_equations
from .forces import add_forces, force_law
from .linear import lu_factor, lu_solve
from .rows import evaluate_rows, marker_pull, row_curvatures
from .steps import step_system

ROOT = math.sqrt(6.0)

#: Nodes and coefficients of the method; the last row of A holds the weights.
NODES = np.array([(4.0 - ROOT) / 10.0, (4.0 + ROOT) / 10.0, 1.0])
A = np.array(
    [
        [(88.0 - 7.0 * ROOT) / 360.0, (296.0 - 169.0 * ROOT) / 1800.0, (-2.0 + 3.0 * ROOT) / 225.0],
        [(296.0 + 169.0 * ROOT) / 1800.0, (88.0 + 7.0 * ROOT) / 360.0, (-2.0 - 3.0 * ROOT) / 225.0],
        [(16.0 - ROOT) / 36.0, (16.0 + ROOT) / 36.0, 1.0 / 9.0],
    ]
)
#: Twice the coefficients, from accelerations to positions.
AA = A @ A
#: Real eigenvalue of A, the coefficient of the error estimate, and its weights of the stages.
REAL = (6.0 + 81.0 ** (1.0 / 3.0) - 9.0 ** (1.0 / 3.0)) / 30.0
ESTIMATE = REAL / 3.0 * np.array([-13.0 - 7.0 * ROOT, -13.0 + 7.0 * ROOT, -1.0])


#: Coefficients of the polynomials that are 1 at one node and 0 at the others, shape (3, 3), from
#: the power 0 on.
LAGRANGE = np.linalg.inv(np.vander(NODES, increasing=True)).T


def stage_integrals(x: Array) -> Array:
    """Integrals from 0 to x of the polynomials through the stages of a step of length 1.

    Args:
        x: Shares of the step, shape (n,).

    Returns:
        Array of shape (n, 3), one column for each stage; at x = 1 the weights of the method.
    """
    powers = x[:, None] ** np.arange(1, 4) / np.arange(1, 4)
    return powers @ LAGRANGE.T


@kernel
def stage_states(
    h: float,
    y0: Array,
    v0: Array,
    w: Array,
    sigma: Array,
    work: Work,
    y: Array,
    v: Array,
) -> None:
    """Coordinates and velocities (3, n) of the stages from their unknowns."""
    n, rows = y0.size, sigma.shape[1]
    for i in range(3):
        for p in range(n):
            first = second = push = 0.0
            for j in range(3):
                first += A[i, j] * w[j, p]
                second += AA[i, j] * w[j, p]
            for c in range(rows):
                push += work.correction[c, p] * sigma[i, c]
            v[i, p] = v0[p] + h * first
            y[i, p] = y0[p] + NODES[i] * h * v0[p] + h * h * (second - push)


@kernel
def stage_residual(
    model: ModelArrays,
    k: int,
    h: float,
    y: Array,
    v: Array,
    w: Array,
    lam: Array,
    work: Work,
    rhs: Array,
) -> None:
    """Residuals of the three stages, which stand at the instants k, k + 1, k + 2, into rhs."""
    n, rows = y.shape[1], lam.shape[1]
    for i in range(3):
        o = i * (n + 2 * rows)
        evaluate_rows(model, k + i, y[i], v[i], work)
        for b in range(model.first.size):
            body_equations(model, k + i, b, y[i], v[i], w[i], 0.0, work)
        for f in range(model.force_kind.size):
            force_law(model, f, k + i, work)
            for side in range(2):
                m, F = model.force_side[f, side], work.load[3 * side : 3 * side + 3]
                marker_pull(model, m, -F[0], -F[1], -F[2], work, work.r)
        for p in range(n):
            total = work.r[p]
            for c in range(rows):
                total += work.C[c, p] * lam[i, c]
            rhs[o + p] = total
        for c in range(rows):
            rhs[o + n + c] = work.value[c] / (h * h)
            rhs[o + n + rows + c] = work.rate[c] / h


@kernel
def stage_jacobian(
    model: ModelArrays,
    k: int,
    h: float,
    y: Array,
    v: Array,
    w: Array,
    lam: Array,
    work: Work,
    mass: Array,
    weight: Array,
    matrix: Array,
) -> None:
    """Derivative of the residuals with respect to (w_j, lam_j, sigma_j), stage by stage.

    weight (n,) makes corrections of accelerations in metres, radians and modal units comparable;
    mass (n, n) is a work array.
    """
    n, rows = y.shape[1], lam.shape[1]
    size = n + 2 * rows
    for p in range(3 * size):
        for q in range(3 * size):
            matrix[p, q] = 0.0
    for i in range(3):
        o = i * size
        evaluate_rows(model, k + i, y[i], v[i], work)
        for p in range(n):
            for q in range(n):
                work.M[p, q] = work.Ky[p, q] = 0.0
        for b in range(model.first.size):
            body_equations(model, k + i, b, y[i], v[i], w[i], 0.0, work)
        for p in range(n):
            for q in range(n):
                mass[p, q] = work.M[p, q]
                work.M[p, q] = work.Ky[p, q] = 0.0
        for b in range(model.first.size):
            body_equations(model, k + i, b, y[i], v[i], w[i], h, work)
        add_forces(model, k + i, v[i], h, work)
        row_curvatures(model, v[i], lam[i], work)
        for p in range(n):
            weight[p] = np.sqrt(abs(mass[p, p]) + 0.1 * h * h * abs(work.Ky[p, p]))
            for q in range(n):
                drag, stiff = work.M[p, q] - mass[p, q], h * h * work.Ky[p, q]
                for j in range(3):
                    matrix[o + p, j * size + q] = A[i, j] * drag + AA[i, j] * stiff
                matrix[o + p, o + q] += mass[p, q]
            for c in range(rows):
                push = 0.0
                for q in range(n):
                    push += work.Ky[p, q] * work.correction[c, q]
                matrix[o + p, o + n + c] = work.C[c, p]
                matrix[o + p, o + n + rows + c] = -h * h * push
        for c in range(rows):
            at, rate = o + n + c, o + n + rows + c
            for j in range(3):
                for q in range(n):
                    matrix[at, j * size + q] = AA[i, j] * work.C[c, q]
                    matrix[rate, j * size + q] = A[i, j] * work.C[c, q]
                    matrix[rate, j * size + q] += h * AA[i, j] * work.D[c, q]
            for d in range(rows):
                first = second = 0.0
                for q in range(n):
                    first += work.C[c, q] * work.correction[d, q]
                    second += work.D[c, q] * work.correction[d, q]
                matrix[at, o + n + rows + d] = -first
                matrix[rate, o + n + rows + d] = -h * second


@kernel
def state_sizes(model: ModelArrays, y: Array, v: Array, reference: Array, out: Array) -> None:
    """Sizes of y - reference and v by mass, and of the elastic part by energy, into out (3,).

    They do not depend on the basis of the elastic coordinates.
    """
    out[0] = out[1] = out[2] = 0.0
    for b in range(model.first.size):
        o, n, G, K = model.first[b], model.modes[b], model.G[b], model.K[b]
        for p in range(3):
            mass = G[0, 0] if p == 2 else model.mass[b]
            out[0] += mass * (y[o + p] - reference[o + p]) ** 2
            out[1] += mass * v[o + p] ** 2
        for i in range(n):
            p = o + 3 + i
            for j in range(n):
                q = o + 3 + j
                rate = v[p] * G[i + 1, j + 1] * v[q]
                out[0] += (y[p] - reference[p]) * G[i + 1, j + 1] * (y[q] - reference[q])
                out[1] += rate
                out[2] += y[p] * K[i, j] * y[q] + rate
    for i in range(3):
        out[i] = np.sqrt(max(out[i], 0.0))


@kernel
def estimate_error(
    model: ModelArrays,
    k: int,
    h: float,
    y0: Array,
    v0: Array,
    w0: Array,
    y: Array,
    v: Array,
    w: Array,
    lam: Array,
    work: Work,
    dy: Array,
    dv: Array,
    size: Array,
) -> bool:
    """Difference from an embedded formula of order 3 at the end of the step, instant k + 2.

    The difference passes through one implicit step of length REAL h, which keeps it finite where
    the step does not resolve a vibration; size (3,) is that of the result, see state_sizes. False
    where that step is singular. (A second such step would make the estimate of stiff bodies closer
    where the motion is smooth, but lets steps pass that set them vibrating.)
    """
    n, rows, g = y0.size, lam.shape[1], REAL * h
    for p in range(n):
        dy[p], dv[p] = g * v0[p], g * w0[p]
        for i in range(3):
            dy[p] += ESTIMATE[i] * (y[i, p] - y0[p])
            dv[p] += ESTIMATE[i] * (v[i, p] - v0[p])
    for p in range(n):
        dy[p] += y[2, p] + g * dv[p]
        dv[p] += v[2, p]
    step_system(model, k + 2, dy, dv, w[2], lam[2], g * g, g, work)
    if not lu_factor(work.A, n + 2 * rows, work.pivot, work.scale):
        return False
    lu_solve(work.A, n + 2 * rows, work.pivot, work.rhs)
    for p in range(n):
        push = 0.0
        for c in range(rows):
            push += work.correction[c, p] * work.rhs[n + rows + c]
        dy[p] -= y[2, p] + g * g * (work.rhs[p] - push)
        dv[p] -= v[2, p] + g * work.rhs[p]
    state_sizes(model, dy, dv, np.zeros(n), size)
    return True
