# SPDX-License-Identifier: MIT
"""Planar kinematics as Python sees it: equations at one instant, places, forces, transposes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compilation import Compiled, Table
from ..equations import CONSTRAINTS, FORCES, OTHER_FORCES, ROWS, TANGENT, equations
from .arrays import ModelArrays, size, work_arrays
from .evaluation import evaluate, measure, pullback

Array = NDArray[np.float64]

#: All compiled functions of planar kinematics.
COMPILED: tuple[Compiled, ...] = (evaluate, pullback, measure)


class Kinematics:
    """Equations of motion of a mechanism, with the arrays on which one computation works.

    Time integration takes :attr:`table`; whoever needs the equations at single instants takes the
    functions below.
    """

    def __init__(self, model: ModelArrays) -> None:
        """Make work arrays.

        Args:
            model: Flat arrays of the mechanism, which must stay as they are.
        """
        self._model, self.work = Table(model), work_arrays(model)
        self._work = Table(self.work)
        functions = evaluate.address, pullback.address, measure.address
        tables = self._model.address, self._work.address
        #: State at one instant, and what the equations of motion are there.
        self.equations = equations(size(model), int(model.kind.size), (*functions, *tables))
        #: The same for compiled functions.
        self.table = Table(self.equations)

    @property
    def marker_bars(self) -> Array:
        """Derivatives with respect to the markers' shape functions, to which transposes add.

        Shape (markers, 3 + 2 modes, modes + 1); see :func:`marker_bars`.
        """
        return self.work.marker_bars

    def set(
        self,
        y: Array,
        v: Array | None = None,
        w: Array | None = None,
        multipliers: Array | None = None,
    ) -> None:
        """Set the state; what is left out is zero.

        Args:
            y: Coordinates, shape (n,).
            v: Velocities, shape (n,).
            w: Accelerations, shape (n,).
            multipliers: Multipliers, shape (rows,).
        """
        eq = self.equations
        eq.y[:] = y
        eq.v[:] = 0.0 if v is None else v
        eq.w[:] = 0.0 if w is None else w
        eq.lam[:] = 0.0 if multipliers is None else multipliers

    def evaluate(self, instant: int, extent: int) -> None:
        """Evaluate the equations at the state, with M = r_w + r_v.

        Args:
            instant: Number of the instant in the tables of the mechanism.
            extent: What to evaluate, see :mod:`dolfinx_ffr.dynamics.equations`.
        """
        evaluate(self.table, self._model, self._work, instant, 1.0, extent)

    def pullback(self, instant: int, extent: int) -> None:
        """Transpose the equations at the state, which must have been evaluated there.

        Args:
            instant: Number of the instant in the tables of the mechanism.
            extent: What to transpose, see :mod:`dolfinx_ffr.dynamics.equations`.
        """
        pullback(self.table, self._model, self._work, instant, extent)


class Evaluation(NamedTuple):
    """Equations of motion at one instant."""

    #: Residuals of forces, positions and velocities, shape (n + 2 rows,).
    residual: Array
    #: Constraint Jacobian C_y, shape (rows, n).
    jacobian: Array
    #: r_w + r_v, at rest and without damping the mass matrix, shape (n, n).
    mass: Array
    #: Derivative of the forces r + C_y^T lam with respect to y, shape (n, n).
    stiffness: Array


def evaluate_equations(
    model: ModelArrays, instant: int, y: Array, v: Array, w: Array, multipliers: Array
) -> Evaluation:
    """Residuals of the equations of motion and of the constraints, and their Jacobians.

    Args:
        model: Flat arrays of the mechanism.
        instant: Number of the instant in its tables.
        y: Coordinates, shape (n,).
        v: Velocities, shape (n,).
        w: Accelerations, shape (n,).
        multipliers: Multipliers, shape (rows,).
    """
    kinematics = Kinematics(model)
    kinematics.set(y, v, w, multipliers)
    kinematics.evaluate(instant, CONSTRAINTS | FORCES | TANGENT)
    eq = kinematics.equations
    residual = np.concatenate([eq.r + eq.C.T @ eq.lam, eq.value, eq.rate])
    return Evaluation(residual, eq.C, eq.M, eq.Ky)


def place_markers(model: ModelArrays, instant: int, y: Array) -> Array:
    """Positions and angles of all markers, shape (markers, 3).

    Args:
        model: Flat arrays of the mechanism.
        instant: Number of the instant in its tables.
        y: Coordinates, shape (n,).
    """
    kinematics = Kinematics(model)
    kinematics.set(y)
    kinematics.evaluate(instant, CONSTRAINTS)
    return kinematics.work.z


def applied_forces(model: ModelArrays, y: Array, v: Array) -> Array:
    """Forces and moments of all forces on their first markers, shape (instants, forces, 3).

    Args:
        model: Flat arrays of the mechanism.
        y: Coordinates over time, shape (instants, n).
        v: Velocities over time, shape (instants, n).
    """
    kinematics = Kinematics(model)
    out = np.zeros((len(y), model.force_kind.size, 3))
    for instant, state in enumerate(zip(y, v, strict=True)):
        kinematics.set(*state)
        kinematics.evaluate(instant, CONSTRAINTS | FORCES)
        out[instant] = kinematics.work.loads
    return out


def equations_pullback(
    model: ModelArrays,
    state: tuple[Array, Array, Array],
    adjoints: tuple[Array, Array, Array],
    *,
    forces: bool,
) -> tuple[Array, Array]:
    """Minus the derivatives of Q at the first instant, at fixed v, lam and adjoints.

        Q = x . (C_y^T lam - z_y^T F) + m2 . C + m3 . dC/dt

    Args:
        model: Flat arrays of the mechanism.
        state: Coordinates y, velocities v and multipliers lam.
        adjoints: x, m2 and m3.
        forces: Whether the forces F at markers count.

    Returns:
        Derivatives with respect to y, shape (n,), and with respect to the markers' shape functions,
        as :attr:`Kinematics.marker_bars` has them.
    """
    kinematics = Kinematics(model)
    y, v, multipliers = state
    kinematics.set(y, v, None, multipliers)
    eq = kinematics.equations
    eq.adjoint[:], eq.on_values[:], eq.on_rates[:] = adjoints
    kinematics.evaluate(0, CONSTRAINTS)
    kinematics.pullback(0, ROWS | OTHER_FORCES if forces else ROWS)
    return eq.y_bar, kinematics.marker_bars
