# SPDX-License-Identifier: MIT
"""Rotations through the stages of a step, u' = T(u)^-1 omega from u = 0.

    T(u)^-1 omega = omega + u x omega / 2 + k(q) u x (u x omega),   q = u . u,
    k = (1 - (t / 2) cot(t / 2)) / t^2,  t = |u|

A collocation method with the coefficients a_ij makes of it u_i = h sum_j a_ij T(u_j)^-1 omega_j,
which is solved for the u_i of each body by Newton's method, and differentiated.
"""

from __future__ import annotations

import math

from ..compilation import Matrix, Vector, compiled, kernel
from ..equations import Equations
from .algebra import cross, dot
from .arrays import Work
from .space import SpaceArrays

#: Most Newton iterations; corrections that are round-off.
_ITERATIONS, _ROUND_OFF = 20, 1e-15
#: Square of an angle below which series take the place of quotients.
_SERIES = 0.02


@kernel
def factor(q: float) -> tuple[float, float]:
    """The function k and its derivative."""
    if q < _SERIES:
        k = 1.0 / 12.0 + q / 720.0 * (1.0 + q / 42.0 * (1.0 + q / 40.0 * (1.0 + q / 39.6)))
        by_q = (1.0 + q / 21.0 * (1.0 + 3.0 * q / 80.0 * (1.0 + q / 29.7))) / 720.0
        return k, by_q
    t = math.sqrt(q)
    s, c = math.sin(0.5 * t), math.cos(0.5 * t)
    f = 0.5 * t * c / s
    by_t = 0.5 * c / s - 0.25 * t / (s * s)
    k = (1.0 - f) / q
    return k, (-by_t / t - 2.0 * k) / (2.0 * q)


@kernel
def rate_of(u: Vector, omega: Vector, work: Work, out: Vector) -> None:
    """Set out to T(u)^-1 omega."""
    first, second = work.vectors[0], work.vectors[1]
    k, _ = factor(dot(u, u))
    cross(u, omega, first)
    cross(u, first, second)
    for i in range(3):
        out[i] = omega[i] + 0.5 * first[i] + k * second[i]


@kernel
def derivatives_of_rate(u: Vector, omega: Vector, by_u: Matrix, by_omega: Matrix) -> None:
    """Set the matrices to the derivatives of T(u)^-1 omega with respect to u and omega."""
    q, along = dot(u, u), dot(u, omega)
    k, by_q = factor(q)
    # u x (u x omega) = u (u . omega) - omega q
    for i in range(3):
        double = u[i] * along - omega[i] * q
        for j in range(3):
            by_u[i, j] = k * (u[i] * omega[j] - 2.0 * omega[i] * u[j]) + 2.0 * by_q * double * u[j]
            by_omega[i, j] = k * u[i] * u[j]
        by_u[i, i] += k * along
        by_omega[i, i] += 1.0 - k * q
    # -[omega] / 2 and [u] / 2
    by_u[0, 1] += 0.5 * omega[2]
    by_u[0, 2] -= 0.5 * omega[1]
    by_u[1, 0] -= 0.5 * omega[2]
    by_u[1, 2] += 0.5 * omega[0]
    by_u[2, 0] += 0.5 * omega[1]
    by_u[2, 1] -= 0.5 * omega[0]
    by_omega[0, 1] -= 0.5 * u[2]
    by_omega[0, 2] += 0.5 * u[1]
    by_omega[1, 0] += 0.5 * u[2]
    by_omega[1, 2] -= 0.5 * u[0]
    by_omega[2, 0] -= 0.5 * u[1]
    by_omega[2, 1] += 0.5 * u[0]


@kernel
def eliminate(Q: Matrix, columns: int) -> None:
    """Solve with the first nine columns of Q for those that follow, in place."""
    for k in range(9):
        p = k
        for i in range(k + 1, 9):
            if abs(Q[i, k]) > abs(Q[p, k]):
                p = i
        if p != k:
            for j in range(9 + columns):
                Q[k, j], Q[p, j] = Q[p, j], Q[k, j]
        for i in range(9):
            if i != k and Q[i, k] != 0.0:
                ratio = Q[i, k] / Q[k, k]
                for j in range(k, 9 + columns):
                    Q[i, j] -= ratio * Q[k, j]
    for i in range(9):
        for j in range(columns):
            Q[i, 9 + j] /= Q[i, i]


@kernel
def fill_equations(eq: Equations, work: Work, at: int, h: float) -> None:
    """Set the leading columns of work.Q to the derivative of u_i - h sum_j a_ij T_j^-1 omega_j."""
    Q, u, a = work.Q, eq.stage_shift, eq.stage_weights
    by_u, by_omega = work.small[0], work.small[1]
    for j in range(3):
        derivatives_of_rate(u[j, at : at + 3], eq.stage_v[j, at : at + 3], by_u, by_omega)
        for i in range(3):
            for p in range(3):
                for q in range(3):
                    Q[3 * i + p, 3 * j + q] = -h * a[i, j] * by_u[p, q]
            if i == j:
                for p in range(3):
                    Q[3 * i + p, 3 * j + p] += 1.0


@compiled(Equations, SpaceArrays, Work, float)
def turn_stages(eq: Equations, model: SpaceArrays, work: Work, h: float) -> int:
    """See equations.py."""
    Q, u, a, omega = work.Q, eq.stage_shift, eq.stage_weights, eq.stage_v
    rate, by_u, by_omega = work.vectors[2], work.small[0], work.small[1]
    for b in range(eq.turning.size):
        at = eq.turning[b]
        for i in range(3):
            for p in range(3):
                u[i, at + p] = 0.0
                for j in range(3):
                    u[i, at + p] += h * a[i, j] * omega[j, at + p]
        for _ in range(_ITERATIONS):
            fill_equations(eq, work, at, h)
            for i in range(9):
                Q[i, 9] = u[i // 3, at + i % 3]
            for j in range(3):
                rate_of(u[j, at : at + 3], omega[j, at : at + 3], work, rate)
                for i in range(3):
                    for p in range(3):
                        Q[3 * i + p, 9] -= h * a[i, j] * rate[p]
            eliminate(Q, 1)
            change = 0.0
            for i in range(9):
                u[i // 3, at + i % 3] -= Q[i, 9]
                change = max(change, abs(Q[i, 9]))
            # Also where it is no number.
            if not change > _ROUND_OFF:
                break
        # Derivatives of u_i by omega_j: Q^-1 h a_ij T_j^-1.
        fill_equations(eq, work, at, h)
        for j in range(3):
            derivatives_of_rate(u[j, at : at + 3], omega[j, at : at + 3], by_u, by_omega)
            for i in range(3):
                for p in range(3):
                    for q in range(3):
                        Q[3 * i + p, 9 + 3 * j + q] = h * a[i, j] * by_omega[p, q]
        eliminate(Q, 9)
        for i in range(3):
            for p in range(3):
                for q in range(3):
                    eq.excess_start[i, at + p, q] = 0.0
                    for j in range(3):
                        # Less what it is where coordinates are the integrals of velocities.
                        if p == q:
                            Q[3 * i + p, 9 + 3 * j + q] -= h * a[i, j]
                        eq.excess_start[i, at + p, q] += Q[3 * i + p, 9 + 3 * j + q]
                    for k in range(3):
                        total = 0.0
                        for j in range(3):
                            total += Q[3 * i + p, 9 + 3 * j + q] * h * a[j, k]
                        eq.excess[3 * i + k, at + p, q] = total
                for j in range(3):
                    u[i, at + p] -= h * a[i, j] * omega[j, at + p]
    return 0
