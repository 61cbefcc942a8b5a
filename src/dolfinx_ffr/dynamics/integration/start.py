# SPDX-License-Identifier: MIT
"""Accelerations and multipliers at given coordinates and velocities, and their transpose.

Solved are  r(y, v, w) + C_y^T lam = 0  and  d^2C/dt^2 = 0,  both linear in (w, lam).
"""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from .. import equations
from ..compilation import Table, Vector, compiled, kernel
from ..equations import Equations, evaluate, pullback
from ..kinematics import Kinematics
from ..model import FlatModel
from ..tables import BESIDE_JUMP
from .linear import LinearSystem, linear_system, lu_factor, lu_solve, lu_solve_transposed

#: Outcome of the compiled functions.
CONVERGED, SINGULAR, DIVERGED = 0, 1, 2
#: Error where :func:`start_accelerations` finds none.
NO_START = (
    "the accelerations at the start cannot be found: the mass matrix of the bodies and the joints "
    "together are singular"
)


@kernel
def set_units(eq: Equations, system: LinearSystem, cy: float) -> None:
    """Units of coordinates by mass and stiffness, and of multipliers by their rows.

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
    """Unit of the multiplier of a row, from the units of the coordinates."""
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
    """Set (w, lam) at (y, v) and an instant; the result is the outcome."""
    n, rows = eq.r.size, eq.value.size
    for i in range(n):
        eq.w[i] = 0.0
    evaluate(eq, instant, 0.0, equations.CONSTRAINTS | equations.FORCES | equations.ACCELERATIONS)
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
    evaluate(eq, instant, 0.0, equations.CONSTRAINTS | equations.FORCES)
    if not factor_mass(eq, system):
        return SINGULAR
    lu_solve_transposed(system, n + rows)
    for i in range(n):
        eq.adjoint[i] = system.rhs[i]
    for i in range(rows):
        eq.on_values[i] = eq.on_rates[i] = 0.0
        eq.on_accelerations[i] = system.rhs[n + i]
    pullback(eq, instant, equations.BODY_FORCES | equations.OTHER_FORCES | equations.ROWS)
    return CONVERGED


def start_accelerations(
    kinematics: Kinematics, instant: int, y: Array, v: Array
) -> tuple[Array, Array] | None:
    """Accelerations (n,) and multipliers (rows,) at (y, v) and an instant of the tables.

    None where they cannot be found.
    """
    eq = kinematics.equations
    kinematics.set(y, v)
    system = Table(linear_system(eq.r.size + eq.value.size))
    status = accelerations(kinematics.table, system, instant)
    if status != CONVERGED or not np.all(np.isfinite(eq.w)):
        return None
    return eq.w.copy(), eq.lam.copy()


def accelerations_at_jump(
    model: FlatModel, t: float, y: Array, v: Array, slack: float = 0.0
) -> list[tuple[Kinematics, Array, Array]] | None:
    """Equations, accelerations (n,) and multipliers (rows,) at (y, v) just before and after t.

    The jump lies at t [s] or up to `slack` [s] behind. None where no accelerations can be found.
    """
    sides = []
    for beside in ((1.0 - BESIDE_JUMP) * t, (1.0 + BESIDE_JUMP) * t + slack):
        tables = model.tables.tabulate(np.full(2, beside))
        kinematics = Kinematics(model.arrays._replace(**tables))
        kinematics.begin(y)
        solution = start_accelerations(kinematics, 0, y, v)
        if solution is None:
            return None
        sides.append((kinematics, *solution))
    return sides


def start_accelerations_pullback(
    kinematics: Kinematics,
    instant: int,
    state: tuple[Array, Array, Array, Array],
    w_bar: Array,
    lam_bar: Array,
) -> tuple[Array, Array, Array]:
    """Transpose of :func:`start_accelerations` at a state (y, v, w, lam).

    Gives the derivatives with respect to y and v and the adjoint of the forces, (n,) each, and adds
    to the bars of the markers.
    """
    eq = kinematics.equations
    kinematics.set(*state)
    eq.y_bar[:] = eq.v_bar[:] = 0.0
    system = linear_system(eq.r.size + eq.value.size)
    system.rhs[:] = np.concatenate([w_bar, lam_bar])
    if accelerations_pullback(kinematics.table, Table(system), instant) != CONVERGED:
        raise RuntimeError("the matrix of the accelerations at the start is singular")
    return eq.y_bar.copy(), eq.v_bar.copy(), eq.adjoint.copy()
