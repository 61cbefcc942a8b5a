# SPDX-License-Identifier: MIT
"""Time loop of the Radau IIA method and its transpose, compiled and kept on disk between runs."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .arrays import Array, Integers, ModelArrays, make_work
from .bodies import body_pullback
from .forces import forces_pullback
from .linear import lu_factor, lu_solve, lu_solve_transposed
from .loops import CONVERGED, DIVERGED, MAX_ITERATIONS, SINGULAR, _entry
from .rows import evaluate_rows, rows_pullback
from .stages import (
    AA,
    NODES,
    A,
    estimate_error,
    stage_jacobian,
    stage_residual,
    stage_states,
    state_sizes,
)
from .steps import accelerations_pullback, apply_inverse, keep_corrections

#: Outcome of the loop, beside those of loops.py: the error of a step is too large.
REJECTED = 3

#: Largest angle by which a body turns in one step of a length that is free to choose [rad].
LARGEST_TURN = 1.0

#: Ratio of two corrections up to which factors serve the next step, and from which those of earlier
#: steps are given up: the step begins anew, for corrections that hardly shrink may have led astray.
STEADY, ASTRAY = 0.02, 0.3

#: Modules whose code is compiled.
SOURCES = ("arrays", "linear", "rows", "forces", "bodies", "steps", "stages", "stage_loops")


class StageKernels(NamedTuple):
    """The compiled functions that Python calls."""

    #: A number of steps.
    march: Callable[..., Any]
    #: Transpose of all steps and of the accelerations at the start.
    backward: Callable[..., Any]


def _make_kernels(digest: str) -> StageKernels:
    # See loops.py for the digest.

    @_entry
    def march(
        model: ModelArrays,
        lengths: Array,
        y: Array,
        v: Array,
        w: Array,
        lam: Array,
        eta: Array,
        before: float,
        w_before: Array,
        lam_before: Array,
        reference: Array,
        sizes: Array,
        limit: float,
        errors: Array,
        iterations: Integers,
        matrix: Array,
        pivot: Integers,
        weight: Array,
        kept: Array,
    ) -> tuple[int, int]:
        """Steps of the given lengths from row 0 of the arrays; three rows of them are one step.

        Newton's method goes on with the Jacobian at the predicted stages, also of steps before of
        the same length, as long as it converges quickly, and ends where the next correction would
        be below round-off.

        Args:
            model: Flat arrays of the mechanism, tables at the instants of the rows.
            lengths: Lengths of the steps, shape (steps,).
            y: Coordinates, shape (3 steps + 1, n), likewise v and w.
            v: Velocities.
            w: Accelerations.
            lam: Multipliers, shape (3 steps + 1, rows), likewise eta.
            eta: Multipliers that keep the positions on the constraints.
            before: Length of the step before the first one; zero if there is none.
            w_before: Its accelerations, shape (3, n).
            lam_before: Its multipliers, shape (3, rows).
            reference: Coordinates at the start of the motion, shape (n,).
            sizes: Largest sizes of the motion so far, see state_sizes; kept up to date.
            limit: Error above which a step is rejected.
            errors: Filled with the sizes of the errors of the steps, shape (steps, 3).
            iterations: Filled with the Newton iterations of the steps.
            matrix: Factors of the last Jacobian, shape (size, size), kept up to date.
            pivot: Their pivots, shape (size,).
            weight: Weights of the corrections of accelerations, shape (n,).
            kept: Length of the step of the factors, zero if there are none, and whether they do
                for other steps, shape (2,).

        Returns:
            Outcome, and number of good steps.
        """
        _ = digest
        work = make_work(model)
        n, rows = y.shape[1], model.kind.size
        size = 3 * (n + 2 * rows)
        rhs, scale, mass = np.empty(size), np.empty(size), np.empty((n, n))
        sigma, dy, dv, own = np.empty((3, rows)), np.empty(n), np.empty(n), np.empty(3)
        for k in range(lengths.size):
            h, at = lengths[k], 3 * k + 1
            y0, v0, w0 = y[at - 1], v[at - 1], w[at - 1]
            ys, vs, ws, ls = y[at : at + 3], v[at : at + 3], w[at : at + 3], lam[at : at + 3]
            evaluate_rows(model, at - 1, y0, v0, work)
            keep_corrections(model, work)
            if k > 0:
                before = lengths[k - 1]
            status, stale = DIVERGED, kept[1] >= 1.0 and abs(h - kept[0]) <= 1e-9 * h
            # Factors of steps before may do. Where the polynomial is far off, the accelerations of
            # the start may.
            for attempt in range(0 if stale else 1, 3 if before > 0.0 else 2):
                for i in range(3):
                    for c in range(rows):
                        sigma[i, c] = 0.0
                        ls[i, c] = lam[at - 1, c]
                    for p in range(n):
                        ws[i, p] = w0[p]
                    # The polynomial through the stages of the step before goes on.
                    if attempt < 2 and before > 0.0:
                        x = 1.0 + NODES[i] * h / before
                        for p in range(n):
                            ws[i, p] = 0.0
                        for c in range(rows):
                            ls[i, c] = 0.0
                        for j in range(3):
                            factor = 1.0
                            for m in range(3):
                                if m != j:
                                    factor *= (x - NODES[m]) / (NODES[j] - NODES[m])
                            for p in range(n):
                                ws[i, p] += factor * (w[at - 3 + j, p] if k > 0 else w_before[j, p])
                            for c in range(rows):
                                old = lam[at - 3 + j, c] if k > 0 else lam_before[j, c]
                                ls[i, c] += factor * old
                status, previous, fresh = DIVERGED, 0.0, False
                renew = attempt > 0
                kept[1] = 1.0
                for iteration in range(MAX_ITERATIONS):
                    stage_states(h, y0, v0, ws, sigma, work, ys, vs)
                    if renew:
                        stage_jacobian(model, at, h, ys, vs, ws, ls, work, mass, weight, matrix)
                        if not lu_factor(matrix, size, pivot, scale):
                            status, kept[0] = SINGULAR, 0.0
                            break
                        kept[0], fresh = h, True
                    stage_residual(model, at, h, ys, vs, ws, ls, work, rhs)
                    lu_solve(matrix, size, pivot, rhs)
                    change = largest = floor = 0.0
                    finite = True
                    for i in range(3):
                        o = i * (n + 2 * rows)
                        for c in range(rows):
                            ls[i, c] -= rhs[o + n + c]
                            sigma[i, c] -= rhs[o + n + rows + c]
                        for p in range(n):
                            shift = 0.0
                            for c in range(rows):
                                shift += work.correction[c, p] * rhs[o + n + rows + c]
                            delta = rhs[o + p]
                            finite = finite and np.isfinite(delta)
                            ws[i, p] -= delta
                            change = max(change, weight[p] * max(abs(delta), abs(shift)))
                            largest = max(largest, weight[p] * abs(ws[i, p]))
                            floor = max(floor, weight[p] * (abs(ys[i, p]) / h + abs(vs[i, p])) / h)
                    iterations[k] = iteration + 1
                    if not finite:
                        break
                    ratio = change / previous if previous > 0.0 else 1.0
                    if change <= 1e-13 * largest + 4e-16 * floor:
                        status = CONVERGED
                    elif ratio < 0.5 and change * ratio / (1.0 - ratio) <= 1e-14 * largest:
                        status = CONVERGED
                    elif fresh and iteration > 2 and ratio > 0.1:
                        if change <= 1e-9 * largest + 1e-12 * floor:
                            status = CONVERGED  # round-off, which no iteration makes any better
                    if status == CONVERGED or (not fresh and iteration > 0 and ratio > ASTRAY):
                        break
                    renew = iteration > 0 and ratio > 0.05
                    if iteration > 0 and ratio > STEADY:
                        kept[1] = 0.0
                    previous = change
                if status == CONVERGED:
                    break
            stage_states(h, y0, v0, ws, sigma, work, ys, vs)
            for i in range(3):
                for c in range(rows):
                    eta[at + i, c] = h * sigma[i, c]
            if status != CONVERGED:
                return status, k
            error = errors[k]
            if not estimate_error(model, at, h, y0, v0, w0, ys, vs, ws, ls, work, dy, dv, error):
                return SINGULAR, k
            state_sizes(model, ys[2], vs[2], reference, own)
            for i in range(3):
                own[i] = max(sizes[i], own[i])
                if not error[i] <= limit * own[i]:
                    return REJECTED, k
            # Where a body turns too far, the method may find another motion, and sees no error.
            if limit < np.inf:
                for b in range(model.first.size):
                    p = model.first[b] + 2
                    if not abs(ys[2, p] - y0[p]) <= LARGEST_TURN:
                        return REJECTED, k
            for i in range(3):
                sizes[i] = own[i]
        return CONVERGED, lengths.size

    @_entry
    def backward(
        model: ModelArrays,
        lengths: Array,
        states: Array,
        multipliers: Array,
        bars: Array,
        lam_bars: Array,
        x: Array,
        shifts: Array,
        markers: Array,
        first: Array,
    ) -> tuple[int, int]:
        """Transpose of all steps and of the accelerations at the start.

        Args:
            model: Flat arrays of the mechanism.
            lengths: Lengths of the steps, shape (steps,).
            states: y, v, w, shape (3, 3 steps + 1, n).
            multipliers: lam, eta, shape (2, 3 steps + 1, rows).
            bars: Derivatives with respect to y, v, w, shape (3, 3 steps + 1, n).
            lam_bars: Derivative with respect to lam, shape (3 steps + 1, rows).
            x: Filled with the adjoint of the forces r, shape (3 steps + 1, n); the derivative with
                respect to an integral is minus the sum of x . dr.
            shifts: Filled with D y_bar and h^2 D C_y^T sigma, shape (2, 3 steps + 1, n).
            markers: Filled with the derivatives with respect to the markers' shape functions.
            first: Filled with the derivatives with respect to the start, y and v, shape (2, n).
        """
        _ = digest
        y, v, w = states[0], states[1], states[2]
        lam, eta = multipliers[0], multipliers[1]
        n, rows = y.shape[1], model.kind.size
        block = n + 2 * rows
        size = 3 * block
        work = make_work(model)
        matrix, rhs, scale = np.empty((size, size)), np.empty(size), np.empty(size)
        pivot = np.empty(size, dtype=np.int64)
        mass, weight = np.empty((n, n)), np.empty(n)
        none, zdd = np.zeros(rows), np.zeros((model.marker_body.size, 3))
        yb, vb, unused = np.zeros((3, n)), np.zeros((3, n)), np.zeros(n)
        y0b, v0b, wb = np.zeros(n), np.zeros(n), np.zeros(n)
        m2, m3, held = np.empty(rows), np.empty(rows), np.empty(rows)
        for k in range(lengths.size - 1, -1, -1):
            h, at = lengths[k], 3 * k + 1
            ys, vs, ws, ls = y[at : at + 3], v[at : at + 3], w[at : at + 3], lam[at : at + 3]
            evaluate_rows(model, at - 1, y[at - 1], v[at - 1], work)
            keep_corrections(model, work)
            stage_jacobian(model, at, h, ys, vs, ws, ls, work, mass, weight, matrix)
            if not lu_factor(matrix, size, pivot, scale):
                return SINGULAR, at
            for i in range(3):
                for p in range(n):
                    yb[i, p] = bars[0, at + i, p]
                    vb[i, p] = bars[1, at + i, p]
                    if i == 2:
                        yb[i, p] += y0b[p]
                        vb[i, p] += v0b[p]
            for j in range(3):
                o = j * block
                for p in range(n):
                    total = bars[2, at + j, p]
                    for i in range(3):
                        total += h * A[i, j] * vb[i, p] + h * h * AA[i, j] * yb[i, p]
                    rhs[o + p] = total
                for c in range(rows):
                    rhs[o + n + c] = lam_bars[at + j, c]
                    total = 0.0
                    for p in range(n):
                        total += work.correction[c, p] * yb[j, p]
                    rhs[o + n + rows + c] = -h * h * total
            lu_solve_transposed(matrix, size, pivot, rhs)
            for p in range(n):
                y0b[p] = v0b[p] = 0.0
            for i in range(3):
                o, row = i * block, at + i
                for p in range(n):
                    x[row, p] = rhs[o + p]
                for c in range(rows):
                    m2[c] = rhs[o + n + c] / (h * h)
                    m3[c] = rhs[o + n + rows + c] / h
                evaluate_rows(model, row, ys[i], vs[i], work)
                for b in range(model.first.size):
                    body_pullback(model, row, b, ys[i], vs[i], ws[i], x[row], work, yb[i], vb[i])
                forces_pullback(
                    model, row, ys[i], vs[i], ws[i], x[row], work, yb[i], vb[i], markers
                )
                rows_pullback(
                    model, ys[i], vs[i], ws[i], zdd, ls[i], x[row], m2, m3, none, -1.0, work,
                    yb[i], vb[i], markers,
                )  # fmt: skip
                for p in range(n):
                    y0b[p] += yb[i, p]
                    v0b[p] += vb[i, p] + NODES[i] * h * yb[i, p]
            # The share of Y_i = ... - h^2 D C_y(y)^T sigma_i through D and C_y at the beginning.
            evaluate_rows(model, at - 1, y[at - 1], v[at - 1], work)
            for i in range(3):
                row = at + i
                apply_inverse(model, yb[i], shifts[0, row])
                for c in range(rows):
                    held[c] = h * eta[row, c]
                for p in range(n):
                    shifts[1, row, p] = 0.0
                    for c in range(rows):
                        shifts[1, row, p] += work.correction[c, p] * held[c]
                rows_pullback(
                    model, y[at - 1], v[at - 1], w[at - 1], zdd, held, shifts[0, row], none, none,
                    none, -1.0, work, y0b, unused, markers,
                )  # fmt: skip
        for p in range(n):
            y0b[p] += bars[0, 0, p]
            v0b[p] += bars[1, 0, p]
            wb[p] = bars[2, 0, p]
        if not accelerations_pullback(
            model, np.int64(0), y[0], v[0], w[0], lam[0], wb, lam_bars[0], work, x[0], y0b, v0b,
            markers,
        ):  # fmt: skip
            return SINGULAR, 0
        for p in range(n):
            first[0, p], first[1, p] = y0b[p], v0b[p]
        return CONVERGED, 0

    return StageKernels(march, backward)


def _digest_of_sources() -> str:
    here = Path(__file__).parent
    return sha256(b"".join((here / f"{name}.py").read_bytes() for name in SOURCES)).hexdigest()


stage_kernels = _make_kernels(_digest_of_sources())
