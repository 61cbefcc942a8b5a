# SPDX-License-Identifier: MIT
"""Accelerations and multipliers at given coordinates and velocities, and their transpose.

Solved are  r(y, v, w) + C_y^T lam = 0  and  d^2C/dt^2 = 0,  both linear in (w, lam).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compilation import Table, Vector, compiled, kernel
from ..equations import (
    ACCELERATIONS,
    BODY_FORCES,
    CONSTRAINTS,
    FORCES,
    OTHER_FORCES,
    ROWS,
    Equations,
    evaluate,
    pullback,
)
from ..kinematics import Kinematics
from .linear import LinearSystem, linear_system, lu_factor, lu_solve, lu_solve_transposed

Array = NDArray[np.float64]

#: Outcome of the compiled functions.
CONVERGED, SINGULAR, DIVERGED = 0, 1, 2


@kernel
def set_units(eq: Equations, system: LinearSystem, cy: float) -> None:
    """Units of coordinates by mass and stiffness, and of multipliers by what they hold.

    In these the matrix of the equations has no physical units.
    """
    n, unit = eq.r.size, system.unit
    for i in range(n):
        unit[i] = 1.0 / np.sqrt(abs(eq.M[i, i]) + cy * abs(eq.Ky[i, i]))
    rows = eq.value.size
    for c in range(rows):
        unit[n + c] = unit_of_row(eq, unit, c)
        # Of the position corrections of a step, where the system has them.
        if unit.size > n + rows:
            unit[n + rows + c] = unit[n + c]


@kernel
def unit_of_row(eq: Equations, unit: Vector, c: int) -> float:
    """Unit of the multiplier of a row, from those of the coordinates."""
    reach = 0.0
    for i in range(eq.r.size):
        reach = max(reach, abs(eq.C[c, i]) * unit[i])
    return 1.0 / reach


@kernel
def factor_mass(eq: Equations, system: LinearSystem) -> bool:
    """Factors of the mass matrix with the constraint Jacobian; False where it is singular."""
    n, rows, A = eq.r.size, eq.value.size, system.A
    set_units(eq, system, 0.0)
    for i in range(n):
        for j in range(n):
            A[i, j] = eq.M[i, j]
    for i in range(rows):
        for j in range(rows):
            A[n + i, n + j] = 0.0
        for j in range(n):
            A[n + i, j] = A[j, n + i] = eq.C[i, j]
    return lu_factor(system, n + rows)


@compiled(Equations, LinearSystem, int)
def accelerations(eq: Equations, system: LinearSystem, instant: int) -> int:
    """Set (w, lam) at (y, v) and an instant; gives the outcome."""
    n, rows = eq.r.size, eq.value.size
    for i in range(n):
        eq.w[i] = 0.0
    evaluate(eq, instant, 0.0, CONSTRAINTS | FORCES | ACCELERATIONS)
    for i in range(n):
        system.rhs[i] = -eq.r[i]
    for i in range(rows):
        system.rhs[n + i] = -eq.acceleration[i]
    if not factor_mass(eq, system):
        return SINGULAR
    lu_solve(system, n + rows)
    for i in range(n):
        eq.w[i] = system.rhs[i]
    for i in range(rows):
        eq.lam[i] = system.rhs[n + i]
    return CONVERGED


@compiled(Equations, LinearSystem, int)
def accelerations_pullback(eq: Equations, system: LinearSystem, instant: int) -> int:
    """Transpose of :func:`accelerations` at its result (y, v, w, lam).

    The right-hand side of the system holds the derivatives with respect to (w, lam). Adds to y_bar,
    v_bar and the bars of the integrals, and leaves the adjoint.
    """
    n, rows = eq.r.size, eq.value.size
    evaluate(eq, instant, 0.0, CONSTRAINTS | FORCES)
    if not factor_mass(eq, system):
        return SINGULAR
    lu_solve_transposed(system, n + rows)
    for i in range(n):
        eq.adjoint[i] = system.rhs[i]
    for i in range(rows):
        eq.on_values[i] = eq.on_rates[i] = 0.0
        eq.on_accelerations[i] = system.rhs[n + i]
    pullback(eq, instant, BODY_FORCES | OTHER_FORCES | ROWS)
    return CONVERGED


def start_accelerations(
    kinematics: Kinematics, instant: int, y: Array, v: Array
) -> tuple[Array, Array] | None:
    """Accelerations (n,) and multipliers (rows,) at a state; None where they cannot be found.

    Args:
        kinematics: Equations of motion.
        instant: Number of the instant in the tables of the mechanism.
        y: Coordinates, shape (n,).
        v: Velocities, shape (n,).
    """
    eq = kinematics.equations
    kinematics.set(y, v)
    system = Table(linear_system(eq.r.size + eq.value.size))
    status = accelerations(kinematics.table, system, instant)
    if status != CONVERGED or not np.all(np.isfinite(eq.w)):
        return None
    return eq.w.copy(), eq.lam.copy()


def start_accelerations_pullback(
    kinematics: Kinematics,
    instant: int,
    state: tuple[Array, Array, Array, Array],
    w_bar: Array,
    lam_bar: Array,
) -> tuple[Array, Array, Array]:
    """Transpose of :func:`start_accelerations`; adds to the bars of the markers.

    Args:
        kinematics: Equations of motion.
        instant: Number of the instant in the tables of the mechanism.
        state: Coordinates, velocities, accelerations and multipliers.
        w_bar: Derivative with respect to the accelerations, shape (n,).
        lam_bar: Derivative with respect to the multipliers, shape (rows,).

    Returns:
        Derivatives with respect to coordinates and velocities, and the adjoint of the forces.

    Raises:
        RuntimeError: If the matrix is singular.
    """
    eq = kinematics.equations
    kinematics.set(*state)
    eq.y_bar[:] = eq.v_bar[:] = 0.0
    system = linear_system(eq.r.size + eq.value.size)
    system.rhs[:] = np.concatenate([w_bar, lam_bar])
    if accelerations_pullback(kinematics.table, Table(system), instant) != CONVERGED:
        raise RuntimeError("the matrix of the accelerations at the start is singular")
    return eq.y_bar.copy(), eq.v_bar.copy(), eq.adjoint.copy()
