# SPDX-License-Identifier: MIT
"""Time loop of the Radau IIA method and its transpose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .. import equations
from ..compilation import compiled, kernel
from ..equations import Equations, chart, evaluate, measure, pullback
from .linear import LinearSystem, lu_factor, lu_solve, lu_solve_transposed
from .stages import (
    AA,
    NODES,
    A,
    Stages,
    begin_step,
    estimate_error,
    joint_errors,
    load_stage,
    stage_jacobian,
    stage_residual,
    stage_states,
)
from .start import CONVERGED, DIVERGED, SINGULAR
from .steps import MAX_ITERATIONS, StepBars, pushed, times_transposed

#: Outcome of the loop, in addition to the outcomes in start.py: the error of a step is too large.
REJECTED = 3

#: Exponent of the limit of the errors of multipliers, which are of order 3 and not of order 4.
OF_FORCES = 3.0 / 4.0


class StageOptions(NamedTuple):
    """When Newton's method of a step has converged, and when its factors serve again.

    A named tuple, whose numbers are constants of the compiled functions.
    """

    #: Largest angle by which a body turns in one step of a length that is free to choose [rad].
    largest_turn: float = 1.0
    #: Two lengths of steps are the same up to this share, and may share their factors.
    same_length: float = 1e-9
    #: Ratio of two corrections up to which factors serve the next step.
    steady: float = 0.02
    #: Ratio from which factors of earlier steps are given up: the step begins anew, for corrections
    #: that hardly shrink may have led astray.
    astray: float = 0.3
    slow: float = 0.05  #: Ratio from which factors are made anew within a step.
    #: Share of stiffness times squared step that counts beside inertia in a first guess.
    stiff: float = 0.1
    #: A correction is round-off below this share of the largest acceleration, or of positions and
    #: velocities as they show in accelerations.
    negligible: float = 1e-13
    round_off: float = 4e-16
    #: Newton's method ends as well when corrections shrink by this factor at least, and all that
    #: follow would add up to less than this share.
    shrinking: float = 0.5
    remainder: float = 1e-14
    #: From the fourth iteration on corrections of this size, of accelerations or of round-off,
    #: which shrink no more than by the last factor, in spite of fresh factors, are round-off that
    #: no iteration makes any better.
    magnified: float = 1e-9
    magnified_round_off: float = 1e-12
    stalled: float = 0.1


OPTIONS = StageOptions()


@kernel
def solved(
    iteration: int, fresh: bool, change: float, ratio: float, largest: float, round_off: float
) -> bool:
    """Whether Newton's method has converged after a correction.

    The correction has the size `change` and is `ratio` times the one before; `fresh` factors belong
    to this step.
    """
    if change <= OPTIONS.negligible * largest + OPTIONS.round_off * round_off:
        return True
    if ratio < OPTIONS.shrinking and change * ratio / (1.0 - ratio) <= OPTIONS.remainder * largest:
        return True
    if fresh and iteration > 2 and ratio > OPTIONS.stalled:
        return change <= OPTIONS.magnified * largest + OPTIONS.magnified_round_off * round_off
    return False


@kernel
def predict(eq: Equations, stages: Stages, at: int, h: float, before: float) -> None:
    """First guess of the unknowns of a step.

    The polynomial through the stages of the step before goes on, where there is one; `before` is
    its length. Else accelerations and multipliers are those of the start, but for vibrations that
    the step does not resolve: their accelerations under a sudden force would take bodies out of all
    shape, and Newton's method to another motion, or to none.
    """
    n, rows, w, lam = eq.r.size, eq.value.size, stages.w, stages.lam
    if before <= 0.0:
        load_stage(eq, stages, at - 1)
        evaluate(eq, at - 1, 0.0, equations.CONSTRAINTS | equations.FORCES | equations.TANGENT)
    for i in range(3):
        for c in range(rows):
            stages.eta[at + i, c] = 0.0
            lam[at + i, c] = 0.0 if before > 0.0 else lam[at - 1, c]
        for p in range(n):
            inertia = abs(eq.M[p, p])
            resolved = (
                inertia / (inertia + OPTIONS.stiff * h * h * abs(eq.Ky[p, p])) if inertia else 0.0
            )
            w[at + i, p] = 0.0 if before > 0.0 else resolved * w[at - 1, p]
        if before > 0.0:
            x = 1.0 + NODES[i] * h / before
            for j in range(3):
                factor = 1.0
                for m in range(3):
                    if m != j:
                        factor *= (x - NODES[m]) / (NODES[j] - NODES[m])
                first = at == 1
                for p in range(n):
                    w[at + i, p] += factor * (stages.w_before[j, p] if first else w[at - 3 + j, p])
                for c in range(rows):
                    old = stages.lam_before[j, c] if first else lam[at - 3 + j, c]
                    lam[at + i, c] += factor * old


@kernel
def iterate(
    eq: Equations, stages: Stages, system: LinearSystem, k: int, h: float, renew: bool
) -> int:
    """Newton's method for step k from a first guess; `renew` asks for factors of its own.

    It goes on with the Jacobian at the predicted stages, also of steps before of the same length,
    as long as it converges quickly. Leaves sigma in the rows of eta.
    """
    n, rows, at, weight, rhs = eq.r.size, eq.value.size, 3 * k + 1, stages.weight, system.rhs
    size = n + 2 * rows
    previous, fresh = 0.0, False
    stages.factor_state[1] = 1.0
    for iteration in range(MAX_ITERATIONS):
        stage_states(eq, stages, at, h, h * h)
        if renew:
            stage_jacobian(eq, stages, system, at, h)
            if not lu_factor(system, 3 * size):
                stages.factor_state[0] = 0.0
                return SINGULAR
            stages.factor_state[0], fresh = h, True
        stage_residual(eq, stages, system, at, h)
        lu_solve(system, 3 * size)
        change = largest = round_off = 0.0
        finite = True
        for i in range(3):
            o = i * size
            for c in range(rows):
                stages.lam[at + i, c] -= rhs[o + n + c]
                stages.eta[at + i, c] -= rhs[o + n + rows + c]
            for p in range(n):
                shift = pushed(eq, rhs[o + n + rows :], p)
                delta = rhs[o + p]
                finite = finite and np.isfinite(delta)
                stages.w[at + i, p] -= delta
                y, v = max(abs(stages.y[at + i, p]), eq.floor[p]), abs(stages.v[at + i, p])
                change = max(change, weight[p] * max(abs(delta), abs(shift)))
                largest = max(largest, weight[p] * abs(stages.w[at + i, p]))
                round_off = max(round_off, weight[p] * (y / h + v) / h)
        stages.iterations[k] = iteration + 1
        if not finite:
            return DIVERGED
        ratio = change / previous if previous > 0.0 else 1.0
        if solved(iteration, fresh, change, ratio, largest, round_off):
            return CONVERGED
        if not fresh and iteration > 0 and ratio > OPTIONS.astray:
            return DIVERGED
        renew = iteration > 0 and ratio > OPTIONS.slow
        if iteration > 0 and ratio > OPTIONS.steady:
            stages.factor_state[1] = 0.0
        previous = change
    return DIVERGED


@kernel
def judge(
    eq: Equations, stages: Stages, system: LinearSystem, k: int, h: float, limit: float
) -> int:
    """Whether the error of a solved step is accepted; keeps the norms up to date."""
    at = 3 * k + 1
    if not estimate_error(eq, stages, system, at, h):
        return SINGULAR
    for i in range(3):
        stages.errors[k, i] = eq.sizes[i]
    velocity, multiplier, force = joint_errors(eq, stages, at, h)
    stages.errors[k, 1] = max(stages.errors[k, 1], velocity)
    stages.errors[k, 3] = multiplier * min(h / stages.brief[0], 1.0)
    force = max(force, stages.sizes[3])
    if not stages.errors[k, 3] <= limit**OF_FORCES * force:
        return REJECTED
    load_stage(eq, stages, at + 2)
    chart(eq, at + 2, equations.COMPOSE)
    for p in range(eq.r.size):
        eq.reference[p] = stages.reference[p]
    measure(eq)
    for i in range(3):
        eq.sizes[i] = max(stages.sizes[i], eq.sizes[i])
        if not stages.errors[k, i] <= limit * eq.sizes[i]:
            return REJECTED
    sizes = eq.sizes[0], eq.sizes[1], eq.sizes[2]
    # Where a body turns too far, the method may find another motion, and sees no error.
    if limit < np.inf:
        load_stage(eq, stages, at + 2)
        for p in range(eq.r.size):
            eq.reference[p] = stages.y[at - 1, p]
        measure(eq)
        if not eq.sizes[3] <= OPTIONS.largest_turn:
            return REJECTED
    stages.sizes[0], stages.sizes[1], stages.sizes[2] = sizes
    stages.sizes[3] = force
    return CONVERGED


@kernel
def retract_stages(eq: Equations, stages: Stages, at: int) -> None:
    """Change rows at, at + 1, at + 2 from coordinates within the step to those between steps.

    The angles with counted turns are stored, too.
    """
    if eq.kinematics[5] != 0:
        for i in range(3):
            load_stage(eq, stages, at + i)
            evaluate(eq, at + i, 0.0, equations.CONSTRAINTS)
            chart(eq, at + i, equations.COMPOSE)
            for p in range(eq.r.size):
                stages.y[at + i, p] = eq.y[p]


@compiled(Equations, Stages, LinearSystem, LinearSystem, float, float)
def march(
    eq: Equations,
    stages: Stages,
    system: LinearSystem,
    small: LinearSystem,
    before: float,
    limit: float,
) -> int:
    """Steps of the given lengths from row 0; the result is the outcome.

    `system` holds the last factors of three stages; `small` is one of the size of a single stage.
    `before` is the length of the step before the first one, zero if there is none; a step whose
    error exceeds `limit` is rejected.
    """
    for k in range(stages.lengths.size):
        h, at = stages.lengths[k], 3 * k + 1
        stages.last[0] = k
        begin_step(eq, stages, at - 1)
        if k > 0:
            before = stages.lengths[k - 1]
        status = DIVERGED
        # Factors of steps before may do. Where the polynomial is far off, the accelerations of
        # the start may.
        if (
            stages.factor_state[1] >= 1.0
            and abs(h - stages.factor_state[0]) <= OPTIONS.same_length * h
        ):
            predict(eq, stages, at, h, before)
            status = iterate(eq, stages, system, k, h, False)
        if status != CONVERGED:
            predict(eq, stages, at, h, before)
            status = iterate(eq, stages, system, k, h, True)
        if status != CONVERGED and before > 0.0:
            predict(eq, stages, at, h, 0.0)
            status = iterate(eq, stages, system, k, h, True)
        stage_states(eq, stages, at, h, h * h)
        for i in range(3):
            for c in range(eq.value.size):
                stages.eta[at + i, c] = h * stages.eta[at + i, c]
        if status == CONVERGED:
            status = judge(eq, stages, small, k, h, limit)
        retract_stages(eq, stages, at)
        if status != CONVERGED:
            return status
        stages.last[0] = k + 1
    return CONVERGED


@kernel
def enter_stages(eq: Equations, stages: Stages, bars: StepBars, at: int, h: float) -> None:
    """Change the stages and the derivatives with respect to them to coordinates within the step."""
    if eq.turning.size > 0:
        stage_states(eq, stages, at, h, h)
        for i in range(3):
            load_stage(eq, stages, at + i)
            for p in range(eq.r.size):
                eq.y_bar[p] = bars.y[at + i, p]
            chart(eq, at + i, equations.ENTER)
            for p in range(eq.r.size):
                bars.y[at + i, p] = eq.y_bar[p]


@compiled(Equations, Stages, StepBars, LinearSystem)
def backward(eq: Equations, stages: Stages, bars: StepBars, system: LinearSystem) -> int:
    """Transpose of :func:`march`, the bars filled in as by steps.backward."""
    n, rows, rhs = eq.r.size, eq.value.size, system.rhs
    block = n + 2 * rows
    y0b, v0b = bars.start[0], bars.start[1]
    for c in range(rows):
        eq.on_accelerations[c] = 0.0
    for p in range(n):
        y0b[p] = v0b[p] = 0.0
    for k in range(stages.lengths.size - 1, -1, -1):
        h, at = stages.lengths[k], 3 * k + 1
        begin_step(eq, stages, at - 1)
        for p in range(n):
            bars.y[at + 2, p] += y0b[p]
            bars.v[at + 2, p] += v0b[p]
        enter_stages(eq, stages, bars, at, h)
        stage_jacobian(eq, stages, system, at, h)
        if not lu_factor(system, 3 * block):
            stages.last[0] = at
            return SINGULAR
        for j in range(3):
            o = j * block
            for p in range(n):
                total = bars.w[at + j, p]
                for i in range(3):
                    total += h * A[i, j] * bars.v[at + i, p] + h * h * AA[i, j] * bars.y[at + i, p]
                rhs[o + p] = total
            for b in range(eq.turning.size):
                p = eq.turning[b]
                for i in range(3):
                    for r in range(3):
                        for q in range(3):
                            rhs[o + p + q] += eq.excess[3 * i + j, p + r, q] * bars.y[at + i, p + r]
            for c in range(rows):
                rhs[o + n + c] = bars.lam[at + j, c]
            at_rows = rhs[o + n + rows : o + n + 2 * rows]
            times_transposed(bars.y[at + j], eq.correction, -h * h, at_rows)
        lu_solve_transposed(system, 3 * block)
        for p in range(n):
            y0b[p] = v0b[p] = 0.0
        for i in range(3):
            o, row = i * block, at + i
            load_stage(eq, stages, row)
            for p in range(n):
                bars.adjoint[row, p] = eq.adjoint[p] = rhs[o + p]
                eq.y_bar[p], eq.v_bar[p] = bars.y[row, p], bars.v[row, p]
            for c in range(rows):
                eq.on_values[c] = rhs[o + n + c] / (h * h)
                eq.on_rates[c] = rhs[o + n + rows + c] / h
            evaluate(eq, row, 0.0, equations.CONSTRAINTS)
            pullback(eq, row, equations.BODY_FORCES | equations.OTHER_FORCES | equations.ROWS)
            for p in range(n):
                bars.y[row, p] = eq.y_bar[p]
                v0b[p] += eq.v_bar[p] + NODES[i] * h * eq.y_bar[p]
            for b in range(eq.turning.size):
                p = eq.turning[b]
                for r in range(3):
                    for q in range(3):
                        v0b[p + q] += eq.excess_start[i, p + r, q] * eq.y_bar[p + r]
            chart(eq, row, equations.LEAVE)
            for p in range(n):
                y0b[p] += eq.y_bar[p]
        # The part of Y_i = ... - h^2 D C_y(y)^T sigma_i through D and C_y at the beginning.
        load_stage(eq, stages, at - 1)
        evaluate(eq, at - 1, 0.0, equations.CONSTRAINTS)
        for p in range(n):
            eq.y_bar[p] = y0b[p]
        for c in range(rows):
            eq.on_values[c] = eq.on_rates[c] = 0.0
        for i in range(3):
            row = at + i
            for c in range(rows):
                eq.lam[c] = h * stages.eta[row, c]
            for p in range(n):
                eq.adjoint[p] = bars.y[row, p]
                bars.right[row, p] = pushed(eq, eq.lam, p)
            pullback(eq, at - 1, equations.ROWS | equations.METRIC)
            for p in range(n):
                bars.left[row, p] = eq.adjoint[p]
        for p in range(n):
            y0b[p] = eq.y_bar[p]
    return CONVERGED
