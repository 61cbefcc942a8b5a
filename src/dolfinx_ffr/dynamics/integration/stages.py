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
from typing import NamedTuple

import numpy as np

from ...arrays import Array
from .. import equations
from ..compilation import IntVector, Matrix, Vector, kernel
from ..equations import Equations, chart, evaluate, measure, turn_stages
from .linear import LinearSystem, lu_factor, lu_solve
from .start import set_units, unit_of_row
from .steps import pushed, step_system, times_transposed

ROOT = math.sqrt(6.0)

#: Round-off of accelerations and multipliers, in parts of positions over the squared step: Newton's
#: method ends at some units in the last place of these.
ROUND_OFF_OF_JUMPS = 1e-12

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
#: Their values at the beginning of a step, shape (3,).
AT_BEGIN = LAGRANGE[:, 0].copy()


def stage_integrals(x: Array) -> Array:
    """Integrals from 0 to x (n,) of the Lagrange polynomials of a step of length 1, shape (n, 3).

    At x = 1 they are the weights of the method.
    """
    powers = x[:, None] ** np.arange(1, 4) / np.arange(1, 4)
    return powers @ LAGRANGE.T


class Stages(NamedTuple):
    """Trajectory in steps of three stages, and what passes from one call of the loop to the next.

    Row 0 is the start; three rows for each step follow.
    """

    lengths: Vector  # (steps,) of the steps
    y: Matrix  # (3 steps + 1, n) coordinates
    v: Matrix  # (3 steps + 1, n) velocities
    w: Matrix  # (3 steps + 1, n) accelerations
    lam: Matrix  # (3 steps + 1, rows) multipliers
    eta: Matrix  # (3 steps + 1, rows) multipliers of the position corrections, h sigma
    iterations: IntVector  # (steps,) Newton iterations
    last: IntVector  # (1,) number of good steps, or instant whose transpose is singular
    errors: Matrix  # (steps, 4) norms of the errors of the steps
    sizes: Vector  # (4,) largest norms of the motion so far, updated
    brief: Vector  # (1,) length below which a step is the less judged by its multipliers [s]
    reference: Vector  # (n,) coordinates at the start of the motion
    w_before: Matrix  # (3, n) accelerations of the step before the first one
    lam_before: Matrix  # (3, rows) and multipliers
    #: (2,) length of the step for which the system was factored, zero if it was not, and one if
    #: the factors may serve other steps; updated
    factor_state: Vector
    weight: Vector  # (n,) weights of corrections of accelerations, updated
    mass: Matrix  # (n, n) updated


@kernel
def load_stage(eq: Equations, stages: Stages, row: int) -> None:
    """Set the state of the equations to one row of the trajectory."""
    for p in range(eq.r.size):
        eq.y[p], eq.v[p], eq.w[p] = stages.y[row, p], stages.v[row, p], stages.w[row, p]
    for c in range(eq.value.size):
        eq.lam[c] = stages.lam[row, c]


@kernel
def begin_step(eq: Equations, stages: Stages, row: int) -> None:
    """Directions of position corrections of the step that begins at a row."""
    load_stage(eq, stages, row)
    for p in range(eq.r.size):
        eq.base[p] = eq.y[p]
    chart(eq, row, equations.BEGIN)
    evaluate(eq, row, 0.0, equations.CONSTRAINTS | equations.CORRECTIONS)


@kernel
def stage_states(eq: Equations, stages: Stages, at: int, h: float, unit: float) -> None:
    """Coordinates and velocities of the stages in rows at, at + 1, at + 2 from their unknowns.

    Rows of eta times the unit are h^2 sigma. Coordinates are those within the step.
    """
    n, w = eq.r.size, stages.w
    for i in range(3):
        for p in range(n):
            first = second = 0.0
            for j in range(3):
                first += A[i, j] * w[at + j, p]
                second += AA[i, j] * w[at + j, p]
            push = pushed(eq, stages.eta[at + i], p)
            y0, v0 = stages.y[at - 1, p], stages.v[at - 1, p]
            stages.v[at + i, p] = v0 + h * first
            stages.y[at + i, p] = y0 + NODES[i] * h * v0 + h * h * second - unit * push
    turn_rotations(eq, stages, at, h)
    for b in range(eq.turning.size):
        for i in range(3):
            for p in range(eq.turning[b], eq.turning[b] + 3):
                stages.y[at + i, p] += eq.stage_shift[i, p]


@kernel
def turn_rotations(eq: Equations, stages: Stages, at: int, h: float) -> None:
    """Shifts of rotations by the velocities of the stages, and their derivatives."""
    if eq.turning.size > 0:
        for i in range(3):
            for p in range(eq.r.size):
                eq.stage_v[i, p] = stages.v[at + i, p]
            for j in range(3):
                eq.stage_weights[i, j] = A[i, j]
        turn_stages(eq, h)


@kernel
def add_turns(eq: Equations, matrix: Matrix, i: int, size: int, h: float) -> None:
    """Add the derivatives of rotations to the Jacobian of stage i."""
    n, rows, o = eq.r.size, eq.value.size, i * size
    for b in range(eq.turning.size):
        at = eq.turning[b]
        for j in range(3):
            for q in range(3):
                column = j * size + at + q
                for r in range(3):
                    excess = eq.excess[3 * i + j, at + r, q]
                    for p in range(n):
                        matrix[o + p, column] += eq.Ky[p, at + r] * excess
                    for c in range(rows):
                        matrix[o + n + c, column] += eq.Cy[c, at + r] * excess / (h * h)
                        matrix[o + n + rows + c, column] += eq.D[c, at + r] * excess / h


@kernel
def stage_residual(eq: Equations, stages: Stages, system: LinearSystem, at: int, h: float) -> None:
    """Residuals of the three stages, which stand in rows at, at + 1, at + 2, into system.rhs."""
    n, rows, rhs = eq.r.size, eq.value.size, system.rhs
    for i in range(3):
        o = i * (n + 2 * rows)
        load_stage(eq, stages, at + i)
        evaluate(eq, at + i, 0.0, equations.CONSTRAINTS | equations.FORCES)
        for p in range(n):
            total = eq.r[p]
            for c in range(rows):
                total += eq.C[c, p] * eq.lam[c]
            rhs[o + p] = total
        for c in range(rows):
            rhs[o + n + c] = eq.value[c] / (h * h)
            rhs[o + n + rows + c] = eq.rate[c] / h


@kernel
def stage_jacobian(eq: Equations, stages: Stages, system: LinearSystem, at: int, h: float) -> None:
    """Derivative of the residuals with respect to (w_j, lam_j, sigma_j), stage by stage.

    Sets stages.weight, which makes corrections of accelerations in metres, radians and modal units
    comparable.
    """
    n, rows, mass, weight, matrix = eq.r.size, eq.value.size, stages.mass, stages.weight, system.A
    M, Ky, C, D, correction = eq.M, eq.Ky, eq.C, eq.D, eq.correction
    Cy = eq.Cy
    size = n + 2 * rows
    for p in range(3 * size):
        for q in range(3 * size):
            matrix[p, q] = 0.0
    for i in range(3):
        o = i * size
        load_stage(eq, stages, at + i)
        evaluate(eq, at + i, 0.0, equations.CONSTRAINTS | equations.FORCES)
        for p in range(n):
            for q in range(n):
                mass[p, q] = M[p, q]
        evaluate(eq, at + i, h, equations.FORCES | equations.TANGENT)
        for p in range(n):
            weight[p] = np.sqrt(abs(mass[p, p]) + 0.1 * h * h * abs(Ky[p, p]))
            for q in range(n):
                drag, stiff = M[p, q] - mass[p, q], h * h * Ky[p, q]
                for j in range(3):
                    matrix[o + p, j * size + q] = A[i, j] * drag + AA[i, j] * stiff
                matrix[o + p, o + q] += mass[p, q]
            for c in range(rows):
                matrix[o + p, o + n + c] = C[c, p]
            times_transposed(Ky[p], correction, -h * h, matrix[o + p, o + n + rows :])
        for c in range(rows):
            at_row, rate = o + n + c, o + n + rows + c
            for j in range(3):
                for q in range(n):
                    matrix[at_row, j * size + q] = AA[i, j] * Cy[c, q]
                    matrix[rate, j * size + q] = A[i, j] * C[c, q]
                    matrix[rate, j * size + q] += h * AA[i, j] * D[c, q]
            times_transposed(Cy[c], correction, -1.0, matrix[at_row, o + n + rows :])
            times_transposed(D[c], correction, -h, matrix[rate, o + n + rows :])
        add_turns(eq, matrix, i, size, h)
    unit = system.unit
    for p in range(n):
        unit[p] = 1.0 / weight[p]
    for c in range(rows):
        unit[n + c] = unit[n + rows + c] = unit_of_row(eq, unit, c)
    for p in range(size):
        unit[size + p] = unit[2 * size + p] = unit[p]


@kernel
def estimate_error(eq: Equations, stages: Stages, system: LinearSystem, at: int, h: float) -> bool:
    """Norms of the difference from an embedded formula of order 3 at the end of a step, eq.sizes.

    The difference passes through one implicit step of length REAL h, which keeps it finite where
    the step does not resolve a vibration. False where that step is singular. (A second such step
    would make the estimate of stiff bodies closer where the motion is smooth, but lets steps pass
    that set them vibrating.)
    """
    n, rows, g, dy, dv = eq.r.size, eq.value.size, REAL * h, eq.y, eq.v
    y, v = stages.y, stages.v
    load_stage(eq, stages, at + 2)
    for p in range(n):
        y0, v0 = y[at - 1, p], v[at - 1, p]
        dy[p], dv[p] = g * v0, g * stages.w[at - 1, p]
        for i in range(3):
            dy[p] += ESTIMATE[i] * (y[at + i, p] - y0)
            dv[p] += ESTIMATE[i] * (v[at + i, p] - v0)
    for p in range(n):
        dy[p] += y[at + 2, p] + g * dv[p]
        dv[p] += v[at + 2, p]
    step_system(eq, system, at + 2, g * g, g)
    set_units(eq, system, g * g)
    if not lu_factor(system, n + 2 * rows):
        return False
    lu_solve(system, n + 2 * rows)
    rhs = system.rhs
    for p in range(n):
        push = pushed(eq, rhs[n + rows :], p)
        dy[p] -= y[at + 2, p] + g * g * (rhs[p] - push)
        dv[p] -= v[at + 2, p] + g * rhs[p]
        eq.reference[p] = 0.0
    measure(eq)
    return True


@kernel
def joint_errors(eq: Equations, stages: Stages, at: int, h: float) -> tuple[float, float, float]:
    """Errors that the embedded formula does not see in the directions of joints, in the mass norm.

    They are the error of velocities, the error of multipliers, and the size of the multipliers.

    The method meets prescribed positions and velocities at its stages, however long the step is, so
    that the embedded formula sees no error in the directions of the joints. There accelerations
    and multipliers are polynomials of their own in each step. Where these polynomials part from the
    end of the step before, neither is right: their jump is of third order, like their errors, and
    as large as the largest of these.
    """
    n, w, lam, C = eq.r.size, stages.w, stages.lam, eq.C
    load_stage(eq, stages, at - 1)
    evaluate(eq, at - 1, 0.0, equations.CONSTRAINTS)
    round_off = 0.0
    # the equations' vectors, which are free here
    change, unit = eq.w, eq.reference
    for p in range(n):
        root = np.sqrt(abs(stages.mass[p, p]))
        y, v = max(abs(eq.y[p]), eq.floor[p]), abs(eq.v[p])
        round_off = max(round_off, root * (y / h + v) / h)
        unit[p] = 1.0 / root
        change[p] = -w[at - 1, p]
        for j in range(3):
            change[p] += AT_BEGIN[j] * w[at + j, p]
    round_off *= ROUND_OFF_OF_JUMPS
    velocity = multiplier = size = 0.0
    for c in range(eq.value.size):
        reach = jump = 0.0
        for p in range(n):
            reach = max(reach, abs(C[c, p]) * unit[p])
            jump += C[c, p] * change[p]
        step = -lam[at - 1, c]
        for j in range(3):
            step += AT_BEGIN[j] * lam[at + j, c]
        velocity = max(velocity, REAL * h * (abs(jump) / reach - round_off))
        multiplier = max(multiplier, abs(step) * reach - round_off)
        size = max(size, abs(lam[at + 2, c]) * reach)
    return velocity, multiplier, size
