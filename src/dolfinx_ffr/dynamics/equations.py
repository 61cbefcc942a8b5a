# SPDX-License-Identifier: MIT
"""Equations of motion at one instant, as time integration asks a kind of kinematics for them.

    r(y, v, w) + C_y(y)^T lam = 0,    C(y, t) = 0,    C_y(y) v + C_t(y, t) = 0

with coordinates y, their first derivatives v and second derivatives w, and multipliers lam. A kind
of kinematics is three compiled functions, which work on the arrays of :class:`Equations`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .compilation import IntVector, Matrix, Vector, call_at, kernel

#: What to evaluate; the values are added. Positions, velocities and gradients of the constraints,
#: on which all others rest; forces and mass matrix; what is missing from their derivatives;
#: directions of the position corrections; second derivative of the constraints in time.
CONSTRAINTS, FORCES, TANGENT, CORRECTIONS, ACCELERATIONS = 1, 2, 4, 8, 16

#: What to transpose; the values are added. Forces r of the bodies; the other forces; constraints;
#: adjoint times D before that.
BODY_FORCES, OTHER_FORCES, ROWS, METRIC = 1, 2, 4, 8


class Equations(NamedTuple):
    """State at one instant, and what the equations of motion are there."""

    y: Vector  # (n,) coordinates
    v: Vector  # (n,) velocities
    w: Vector  # (n,) accelerations
    lam: Vector  # (rows,) multipliers of the forces that constraints exert
    reference: Vector  # (n,) coordinates from which to measure y
    sizes: Vector  # (4,) of y - reference and v by mass, elastic by energy; largest turn [rad]
    r: Vector  # (n,) inertia, elastic and applied forces
    M: Matrix  # (n, n) r_w + cv r_v
    Ky: Matrix  # (n, n) derivative of r + C_y^T lam with respect to y
    value: Vector  # (rows,) C
    rate: Vector  # (rows,) C_y v + C_t
    acceleration: Vector  # (rows,) second derivative of C in time
    C: Matrix  # (rows, n) C_y
    D: Matrix  # (rows, n) derivative of C_y v + C_t with respect to y
    correction: Matrix  # (rows, n) D C_y^T, transposed
    adjoint: Vector  # (n,) adjoint of the forces
    on_values: Vector  # (rows,) adjoint of C
    on_rates: Vector  # (rows,) adjoint of C_y v + C_t
    on_accelerations: Vector  # (rows,) adjoint of the second derivative of C
    y_bar: Vector  # (n,) derivatives of the result with respect to y
    v_bar: Vector  # (n,) and to v
    kinematics: IntVector  # (5,) addresses of the three functions and of their two tables


def equations(n: int, rows: int, kinematics: tuple[int, ...]) -> Equations:
    """Arrays of zeros for a mechanism.

    Args:
        n: Number of coordinates.
        rows: Number of scalar constraints.
        kinematics: Addresses of the functions evaluate, pullback and measure, and of the two
            tables that they take beside the equations.
    """
    of_coordinates = ("y", "v", "w", "reference", "r", "adjoint", "y_bar", "v_bar")
    of_rows = ("lam", "value", "rate", "acceleration", "on_values", "on_rates", "on_accelerations")
    return Equations(
        **{name: np.zeros(n) for name in of_coordinates},
        **{name: np.zeros(rows) for name in of_rows},
        **{name: np.zeros((rows, n)) for name in ("C", "D", "correction")},
        **{name: np.zeros((n, n)) for name in ("M", "Ky")},
        sizes=np.zeros(4),
        kinematics=np.array(kinematics, dtype=np.int64),
    )


@kernel
def evaluate(eq: Equations, instant: int, cv: float, extent: int) -> None:
    """Equations at (y, v, w, lam) and an instant, with M = r_w + cv r_v."""
    f = eq.kinematics
    call_at(f[0], (eq, f[3], f[4], np.int64(instant), np.float64(cv), np.int64(extent)))


@kernel
def pullback(eq: Equations, instant: int, extent: int) -> None:
    """Subtract the derivative of Q from (y_bar, v_bar) and from the bars of the integrals.

        Q = adjoint . (r + C_y^T lam) + on_values . C + on_rates . dC/dt
            + on_accelerations . d2C/dt2

    at fixed lam and adjoints. The constraints must have been evaluated at this state.
    """
    f = eq.kinematics
    call_at(f[1], (eq, f[3], f[4], np.int64(instant), np.int64(extent)))


@kernel
def measure(eq: Equations) -> None:
    """Sizes of (y - reference, v), which do not depend on the basis of elastic coordinates."""
    f = eq.kinematics
    call_at(f[2], (eq, f[3], f[4]))
