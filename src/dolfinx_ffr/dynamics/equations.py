# SPDX-License-Identifier: MIT
"""Equations of motion at one instant, the interface of time integration and kinematics.

    r(y, v, w) + C_y(y)^T lam = 0,    C(y, t) = 0,    C_y(y) v + C_t(y, t) = 0

with coordinates y, their first derivatives v and second derivatives w, and multipliers lam. A kind
of kinematics is three compiled functions, which work on the arrays of :class:`Equations`.

Where bodies turn in space, v is no derivative of y, but dy/dt = T(y)^-1 v, and w = dv/dt. A fourth
function then changes between coordinates within a step, which add up, and coordinates between
steps, and a fifth one integrates dy/dt = T^-1 v through the stages of a step; T = 1 where a step
begins. Derivatives with respect to y in these arrays are to coordinates within a step, and C_y v
stands for C v, C the derivative of the constraints' rate with respect to v.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .compilation import Array3, IntVector, Matrix, Vector, call_at, kernel

#: What to evaluate; the values are added. Positions, velocities and gradients of the constraints,
#: which all others need; forces and mass matrix; the rest of their derivatives; directions of the
#: position corrections; second derivative of the constraints in time.
CONSTRAINTS, FORCES, TANGENT, CORRECTIONS, ACCELERATIONS = 1, 2, 4, 8, 16

#: What to transpose; the values are added. Forces r of the bodies; the other forces; constraints;
#: first the product of the adjoint and D.
BODY_FORCES, OTHER_FORCES, ROWS, METRIC = 1, 2, 4, 8

#: Changes of coordinates. COMPOSE: from coordinates within the step that began at `base` to
#: coordinates between steps. ENTER: from derivatives with respect to motions of the bodies at y to
#: derivatives with respect to coordinates within the step. LEAVE: from these to derivatives with
#: respect to motions of the bodies at its beginning. BEGIN: a step begins at an instant, from whose
#: angles angles are unwrapped.
COMPOSE, ENTER, LEAVE, BEGIN = 1, 2, 3, 4


class Equations(NamedTuple):
    """State at one instant, and the equations of motion there."""

    y: Vector  # (n,) coordinates
    v: Vector  # (n,) velocities
    w: Vector  # (n,) accelerations
    lam: Vector  # (rows,) multipliers of the forces that constraints exert
    base: Vector  # (n,) coordinates at the beginning of the step, read where bodies turn in space
    floor: Vector  # (n,) sizes below which coordinates have no less round-off
    reference: Vector  # (n,) coordinates from which to measure y
    sizes: Vector  # (4,) mass norms of y - reference and v, elastic energy norm; largest turn [rad]
    r: Vector  # (n,) inertia, elastic and applied forces
    M: Matrix  # (n, n) r_w + cv r_v
    Ky: Matrix  # (n, n) derivative of r + C_y^T lam with respect to y
    value: Vector  # (rows,) C
    rate: Vector  # (rows,) C_y v + C_t
    acceleration: Vector  # (rows,) second derivative of C in time
    C: Matrix  # (rows, n) C, derivative of the rate with respect to v
    Cy: Matrix  # (rows, n) derivative of C with respect to y; the same array where v = dy/dt
    D: Matrix  # (rows, n) derivative of C_y v + C_t with respect to y
    correction: Matrix  # (rows, n) D C_y^T, transposed
    adjoint: Vector  # (n,) adjoint of the forces
    on_values: Vector  # (rows,) adjoint of C
    on_rates: Vector  # (rows,) adjoint of C_y v + C_t
    on_accelerations: Vector  # (rows,) adjoint of the second derivative of C
    y_bar: Vector  # (n,) derivatives of the result with respect to y
    v_bar: Vector  # (n,) and to v
    turning: IntVector  # (bodies,) places of their rotations in space; none where v = dy/dt
    stage_weights: Matrix  # (3, 3) coefficients of a method of three stages
    stage_v: Matrix  # (3, n) velocities of its stages; empty where v = dy/dt, like the next three
    stage_shift: Matrix  # (3, n) u of rotations less h times the weighted sum of velocities
    excess: Array3  # (9, n, 3) derivatives of it, in stage i, by the accelerations of stage j
    excess_start: Array3  # (3, n, 3) and by the velocities at the beginning of the step
    #: (7,) addresses of the functions evaluate, pullback and measure, of the two tables that they
    #: take beside the equations, and of the functions chart and turn_stages, 0 where v = dy/dt;
    #: chart counts the turns of angles, too, and is there where these are counted
    kinematics: IntVector


def equations(
    n: int, rows: int, kinematics: tuple[int, ...], turning: Sequence[int] = ()
) -> Equations:
    """Arrays of zeros for n coordinates and a number of scalar constraints.

    `kinematics` are the entries of the field of that name, `turning` the places of the rotations of
    bodies in space.
    """
    of_coordinates = ("y", "v", "w", "base", "floor", "reference", "r", "adjoint", "y_bar", "v_bar")
    of_rows = ("lam", "value", "rate", "acceleration", "on_values", "on_rates", "on_accelerations")
    jacobian = np.zeros((rows, n))
    m = n if len(turning) else 0
    return Equations(
        **{name: np.zeros(n) for name in of_coordinates},
        **{name: np.zeros(rows) for name in of_rows},
        **{name: np.zeros((rows, n)) for name in ("D", "correction")},
        C=jacobian,
        Cy=np.zeros((rows, n)) if len(turning) else jacobian,
        **{name: np.zeros((n, n)) for name in ("M", "Ky")},
        turning=np.array(turning, dtype=np.int64),
        stage_weights=np.zeros((3, 3)),
        stage_v=np.zeros((3, m)),
        stage_shift=np.zeros((3, m)),
        excess=np.zeros((9, m, 3)),
        excess_start=np.zeros((3, m, 3)),
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
    """Norms of (y - reference, v), which do not depend on the basis of elastic coordinates."""
    f = eq.kinematics
    call_at(f[2], (eq, f[3], f[4]))


@kernel
def chart(eq: Equations, instant: int, what: int) -> None:
    """Change coordinates y or derivatives y_bar, see COMPOSE; nothing where v = dy/dt."""
    f = eq.kinematics
    if f[5] != 0:
        call_at(f[5], (eq, f[3], f[4], np.int64(instant), np.int64(what)))


@kernel
def turn_stages(eq: Equations, h: float) -> None:
    """Shifts of rotations in the stages of a step of length h, and their derivatives.

    From the velocities in stage_v. With the coefficients a_ij of the method the coordinates u of
    rotations within the step hold u_i = h sum_j a_ij T(u_j)^-1 v_j.
    """
    f = eq.kinematics
    if f[6] != 0:
        call_at(f[6], (eq, f[3], f[4], np.float64(h)))
