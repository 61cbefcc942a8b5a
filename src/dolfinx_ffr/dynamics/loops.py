# SPDX-License-Identifier: MIT
"""Start, time loop and adjoint loop, compiled and kept on disk between runs."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from .arrays import Array, Integers, ModelArrays, make_work
from .bodies import body_pullback
from .forces import force_law, forces_pullback
from .linear import lu_factor, lu_solve, lu_solve_transposed
from .rows import evaluate_rows, place_markers, rows_pullback
from .steps import (
    accelerations_pullback,
    apply_inverse,
    keep_corrections,
    solve_accelerations,
    step_system,
)

#: Outcome of the loops.
CONVERGED, SINGULAR, DIVERGED = 0, 1, 2

#: Modules whose code is compiled.
SOURCES = ("arrays", "linear", "rows", "forces", "bodies", "steps", "loops")

#: Most Newton iterations of one step.
MAX_ITERATIONS = 25


class Kernels(NamedTuple):
    """The compiled functions that Python calls."""

    #: (model, k, y, v, w, lam) -> residuals (forces, positions, velocities), constraint Jacobian,
    #: r_w + r_v, derivative of the forces with respect to y.
    evaluate: Callable[..., Any]
    #: (model, k, y) -> positions and angles of all markers.
    place: Callable[..., Any]
    #: (model, y, v, out) with the forces on the first markers over time in out.
    loads: Callable[..., Any]
    #: Accelerations at the start.
    start: Callable[..., Any]
    #: All time steps.
    march: Callable[..., Any]
    #: Transpose of start and march.
    backward: Callable[..., Any]
    #: Transpose of forces and constraints at one instant.
    transpose: Callable[..., Any]


def _entry(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile and keep on disk, where there is a place for it."""
    try:
        return njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # neither the package's directory nor the user's cache can be written
        return njit(error_model="numpy")(function)


def _make_kernels(digest: str) -> Kernels:
    # Numba renews a cached function when its own file changes, but not when that of a function
    # that it calls does. It also renews it when a value changes over which the function closes:
    # hence the digest of all sources in each of them.

    @_entry
    def evaluate(
        model: ModelArrays, k: int, y: Array, v: Array, w: Array, lam: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Residuals of the equations of motion and of the constraints, and their Jacobians."""
        _ = digest
        work = make_work(model)
        step_system(model, k, y, v, w, lam, 1.0, 1.0, work)
        return work.rhs, work.C, work.M, work.Ky

    @_entry
    def place(model: ModelArrays, k: int, y: Array) -> Array:
        """Positions and angles of all markers, shape (markers, 3)."""
        _ = digest
        work = make_work(model)
        place_markers(model, k, y, y, work)
        return work.z

    @_entry
    def loads(model: ModelArrays, y: Array, v: Array, out: Array) -> None:
        """Fill out (instants, forces, 3) with the forces and moments on their first markers."""
        _ = digest
        work = make_work(model)
        for k in range(y.shape[0]):
            place_markers(model, k, y[k], v[k], work)
            for i in range(model.force_kind.size):
                force_law(model, i, k, work)
                for p in range(3):
                    out[k, i, p] = work.load[p]

    @_entry
    def start(
        model: ModelArrays,
        y: Array,
        v: Array,
        w: Array,
        lam: Array,
        instant: int,
        offset: float,
        extra: Array,
    ) -> int:
        """Accelerations at the first instant, and at another shortly after it.

        The latter are taken at the state moved by `offset` along the motion and written to the rows
        of extra (4, n): coordinates, velocities, accelerations there, and their multipliers.
        """
        _ = digest
        work = make_work(model)
        first = np.int64(0)  # a literal would have Numba compile all that is called once more
        if not solve_accelerations(model, first, y, v, w, lam, work):
            return SINGULAR
        for i in range(y.size):
            extra[0, i] = y[i] + offset * v[i] + 0.5 * offset * offset * w[i]
            extra[1, i] = v[i] + offset * w[i]
        after = extra[3, : lam.size]
        if not solve_accelerations(model, instant, extra[0], extra[1], extra[2], after, work):
            return SINGULAR
        return CONVERGED

    @_entry
    def march(
        model: ModelArrays,
        h: float,
        method: tuple[float, float, float, float],
        y: Array,
        v: Array,
        w: Array,
        a: Array,
        lam: Array,
        eta: Array,
        iterations: Integers,
    ) -> tuple[int, int]:
        """All time steps from row 0 of the arrays; returns the outcome and the last good step.

        Newton's method ends when the correction is negligible, or when the next one, at the rate
        of the last two, would be below round-off. Less would do for the motion, but the adjoint is
        that of steps solved exactly.
        """
        _ = digest
        alpha_m, alpha_f, gamma, beta = method
        a1, a2 = (1.0 - alpha_f) / (1.0 - alpha_m), alpha_m / (1.0 - alpha_m)
        a0 = alpha_f / (1.0 - alpha_m)
        cy, cv = h * h * beta * a1, h * gamma * a1
        work = make_work(model)
        n, rows = y.shape[1], model.kind.size
        size = n + 2 * rows
        yp, vp, s = np.empty(n), np.empty(n), np.zeros(rows)
        evaluate_rows(model, np.int64(0), y[0], v[0], work)
        keep_corrections(model, work)
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
                finite = True
                for i in range(n):
                    shift = pushed = 0.0
                    for c in range(rows):
                        shift += work.correction[c, i] * work.rhs[n + rows + c]
                        pushed += work.correction[c, i] * s[c]
                    # Weights that make corrections in metres, radians and modal units comparable.
                    weight = np.sqrt(abs(work.M[i, i] + cy * work.Ky[i, i]))
                    delta = work.rhs[i]
                    finite = finite and np.isfinite(delta)
                    wn[i] -= delta
                    yn[i], vn[i] = yp[i] + cy * (wn[i] - pushed), vp[i] + cv * wn[i]
                    change = max(change, weight * max(abs(delta), abs(delta - shift)))
                    largest = max(largest, weight * abs(wn[i]))
                    floor = max(floor, weight * (abs(yn[i]) / cy + abs(vn[i]) / cv))
                iterations[k] = iteration + 1
                if not finite:
                    break
                if change <= 1e-10 * largest + 2e-15 * floor:
                    status = CONVERGED
                elif iteration > 0 and change <= 1e-2 * previous:
                    if change * (change / previous) <= 1e-14 * largest:
                        status = CONVERGED
                elif iteration > 1 and change <= 1e-8 * largest + 1e-10 * floor:
                    status = CONVERGED  # round-off, which a nearly singular position magnifies
                elif iteration > 7 and change <= 1e-8 * (largest + floor):
                    status = CONVERGED  # likewise, and no iteration makes it any better
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
            keep_corrections(model, work)
        return CONVERGED, iterations.size

    @_entry
    def backward(
        model: ModelArrays,
        h: float,
        method: tuple[float, float, float, float],
        offset: float,
        states: Array,
        multipliers: Array,
        extra: Array,
        bars: Array,
        lam_bars: Array,
        x: Array,
        shifts: Array,
        markers: Array,
        first: Array,
    ) -> tuple[int, int]:
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
            x: Filled with the adjoint of the forces r, shape (steps + 2, n), the last row that of
                `extra`; the derivative with respect to an integral is minus the sum of x . dr.
            shifts: Filled with D y_bar and D C_y^T eta, shape (2, steps + 1, n).
            markers: Filled with the derivatives with respect to the markers' shape functions.
            first: Filled with the derivatives with respect to the start, y and v, shape (2, n).
        """
        _ = digest
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
            keep_corrections(model, work)
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
                    total += work.correction[c, i] * yb[i]
                rhs[n + rows + c] = -cy * total
            lu_solve_transposed(work.A, size, work.pivot, rhs)
            for i in range(n):
                x[k, i] = rhs[i]
            for c in range(rows):
                m2[c] = rhs[n + c] / cy
                m3[c] = rhs[n + rows + c] / cv
                held[c] = h * eta[k, c]
            for b in range(model.first.size):
                body_pullback(model, k, b, y[k], v[k], w[k], x[k], work, yb, vb)
            forces_pullback(model, k, y[k], v[k], w[k], x[k], work, yb, vb, markers)
            rows_pullback(
                model,
                y[k],
                v[k],
                w[k],
                zdd,
                lam[k],
                x[k],
                m2,
                m3,
                none,
                -1.0,
                work,
                yb,
                vb,
                markers,
            )
            evaluate_rows(model, k - 1, y[k - 1], v[k - 1], work)
            for i in range(n):
                total = ab[i] + h * h * beta * yb[i] + h * gamma * vb[i]
                wb[i] = a0 * total
                ab[i] = h * h * (0.5 - beta) * yb[i] + h * (1.0 - gamma) * vb[i] - a2 * total
                vb[i] += h * yb[i]
                rhs[i] = yb[i]
            # The share of y' = ... - h D C_y^T eta; shifts[0] = D y_bar, shifts[1] = D C_y^T eta.
            apply_inverse(model, rhs, shifts[0, k])
            for i in range(n):
                shifts[1, k, i] = 0.0
                for c in range(rows):
                    shifts[1, k, i] += work.correction[c, i] * eta[k, c]
            rows_pullback(
                model, y[k - 1], v[k - 1], w[k - 1], zdd, held, shifts[0, k], none, none, none,
                -1.0, work, yb, unused, markers,
            )  # fmt: skip
        # a_0 = w_0 + (alpha_m - alpha_f) h (w_1 - w_0) / offset, w_1 the accelerations of `extra`.
        f = (alpha_m - alpha_f) * h / offset
        ye, ve = np.zeros(n), np.zeros(n)
        for i in range(n):
            yb[i] += bars[0, 0, i]
            vb[i] += bars[1, 0, i]
            wb[i] += (1.0 - f) * ab[i] + bars[2, 0, i]
            ab[i] *= f
        if not accelerations_pullback(
            model, model.drive.shape[0] - 1, extra[0], extra[1], extra[2], extra[3, :rows],
            ab, none, work, x[steps + 1], ye, ve, markers,
        ):  # fmt: skip
            return SINGULAR, 0
        for i in range(n):
            wb[i] += 0.5 * offset * offset * ye[i] + offset * ve[i]
            yb[i] += ye[i]
            vb[i] += offset * ye[i] + ve[i]
        if not accelerations_pullback(
            model,
            np.int64(0),
            y[0],
            v[0],
            w[0],
            lam[0],
            wb,
            lam_bars[0],
            work,
            x[0],
            yb,
            vb,
            markers,
        ):
            return SINGULAR, 0
        for i in range(n):
            first[0, i], first[1, i] = yb[i], vb[i]
        return CONVERGED, 0

    @_entry
    def transpose(
        model: ModelArrays,
        k: int,
        y: Array,
        v: Array,
        lam: Array,
        x: Array,
        m2: Array,
        m3: Array,
        forces: bool,
        y_bar: Array,
        markers: Array,
    ) -> None:
        """Subtract the derivative of Q from y_bar and from the markers' bars.

            Q = x . (C_y^T lam - z_y^T F) + m2 . C + m3 . dC/dt

        at fixed v, lam, x, m2, m3; the forces F count only if asked for.
        """
        _ = digest
        work = make_work(model)
        rest, unused, none = np.zeros(y.size), np.zeros(y.size), np.zeros(model.kind.size)
        zdd = np.zeros((model.marker_body.size, 3))
        evaluate_rows(model, k, y, v, work)
        if forces:
            forces_pullback(model, k, y, v, rest, x, work, y_bar, unused, markers)
        rows_pullback(
            model, y, v, rest, zdd, lam, x, m2, m3, none, -1.0, work, y_bar, unused, markers
        )

    return Kernels(evaluate, place, loads, start, march, backward, transpose)


def _digest_of_sources() -> str:
    here = Path(__file__).parent
    return sha256(b"".join((here / f"{name}.py").read_bytes() for name in SOURCES)).hexdigest()


kernels = _make_kernels(_digest_of_sources())
