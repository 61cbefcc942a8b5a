# SPDX-License-Identifier: MIT
"""Equations of motion at single instants, as Python asks for them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import Array
from ..compilation import Compiled, Table
from ..equations import CONSTRAINTS, FORCES, OTHER_FORCES, ROWS, TANGENT, equations
from .arrays import TABLES, constraints, size, work_arrays
from .body_arrays import ModelArrays
from .evaluation import FUNCTIONS


def compiled_kinematics(*, space: bool) -> tuple[Compiled, ...]:
    """All compiled functions of the kinematics, those in space or in the plane."""
    return FUNCTIONS[3 if space else 2]


class Kinematics:
    """Equations of motion of a mechanism, with the arrays on which one computation works.

    Time integration takes :attr:`table`; whoever needs the equations at single instants takes the
    functions below.
    """

    def __init__(self, model: ModelArrays, turns: Array | None = None) -> None:
        """Make work arrays for flat arrays, which must stay as they are.

        The counted angles begin with ``turns``, see :meth:`turns`, by default with the angles at
        the start.
        """
        self.model, self.work = model, work_arrays(model)
        self._model, self._work = Table(model), Table(self.work)
        if turns is not None and turns.size:
            self.work.turns[: len(turns)] = turns
        self._evaluate, self._pullback, measure, *charts = FUNCTIONS[model.d]
        addresses = [f.address for f in (self._evaluate, self._pullback, measure)]
        addresses += [self._model.address, self._work.address]
        turning = model.turning
        addresses += [f.address for f in charts if turning or self.work.turns.size]
        addresses += [0] * (7 - len(addresses))
        #: State and equations of motion at one instant.
        self.equations = equations(size(model), constraints(model), tuple(addresses), turning)
        # The round-off of a position follows from the lengths that a joint adds up: it does not
        # vanish for a body at the origin.
        for first in model.first:
            self.equations.floor[first : first + model.d] = model.reach[0]
        for place in turning:
            # The round-off of a rotation follows from its matrix, whose entries are up to one.
            self.equations.floor[place : place + 3] = 1.0
        #: The equations of motion as a table for compiled functions.
        self.table = Table(self.equations)

    def set_tables(self, tables: dict[str, Array], turns: Array) -> None:
        """Overwrite the model's tables by name; new ``tables`` have at most as many instants.

        The counted angles (rows and springs, 2) start from ``turns``, see :meth:`turns`.
        """
        for name, table in tables.items():
            getattr(self.model, name)[: len(table)] = table
        self.work.turns[: len(turns)] = turns

    @property
    def marker_bars(self) -> Array:
        """Derivatives by the markers' shape functions, to which transposes add: `marker_bar`."""
        return self.work.vector_bars

    @property
    def table_bars(self) -> dict[str, Array]:
        """Derivatives by tables and constants, to which transposes add, by field of ModelArrays."""
        return {name: getattr(self.work, f"{name}_bars") for name in TABLES}

    def set(
        self,
        y: Array,
        v: Array | None = None,
        w: Array | None = None,
        multipliers: Array | None = None,
    ) -> None:
        """Set coordinates, velocities, accelerations (n,) and multipliers (rows,), else to zero."""
        eq = self.equations
        eq.y[:] = eq.base[:] = y
        eq.v[:] = 0.0 if v is None else v
        eq.w[:] = 0.0 if w is None else w
        eq.lam[:] = 0.0 if multipliers is None else multipliers

    def evaluate(self, instant: int, extent: int, share: float = 1.0) -> None:
        """Evaluate the equations at the state and an instant, with M = r_w + share r_v.

        The extent says what to evaluate, see :mod:`dolfinx_ffr.dynamics.equations`.
        """
        self._count_from(instant)
        self._evaluate(self.table, self._model, self._work, instant, share, extent)

    def _count_from(self, instant: int) -> None:
        """Let turns count from an instant, as chart does."""
        counted = self.work.turns[instant]
        self.work.base_instant[0], self.work.base_angles[: len(counted)] = instant, counted

    def evaluated(
        self, instant: int, y: Array, v: Array, w: Array, multipliers: Array
    ) -> Evaluation:
        """Evaluation as of :func:`evaluate_equations`; the next one overwrites its arrays."""
        self.set(y, v, w, multipliers)
        self.evaluate(instant, CONSTRAINTS | FORCES | TANGENT)
        eq = self.equations
        residual = np.concatenate([eq.r + eq.C.T @ eq.lam, eq.value, eq.rate])
        return Evaluation(residual, eq.C, eq.M, eq.Ky)

    def pullback(self, instant: int, extent: int) -> None:
        """Transpose the equations at the state, which must have been evaluated there."""
        self._pullback(self.table, self._model, self._work, instant, extent)

    def forces(self) -> Array:
        """Forces after an evaluation, see :func:`applied_forces`."""
        return self.model.forces(self.work)

    def begin(self, y: Array) -> None:
        """Let a motion begin at coordinates (n,), from which turns are counted."""
        if self.work.turns.size:
            self.set(y)
            self.evaluate(0, CONSTRAINTS)
            self.work.turns[0] = self.work.angles
            self._count_from(0)

    def turns(self, instants: int) -> Array:
        """Angles of rows and springs over time that count turns, two each for gears [rad].

        Shape (instants, rows and springs, 2); empty where nothing counts turns.
        """
        return np.array(self.work.turns[:instants])


class Evaluation(NamedTuple):
    """Equations of motion at one instant."""

    #: Residuals of forces, positions and velocities, shape (n + 2 rows,).
    residual: Array
    #: Constraint Jacobian C_y, shape (rows, n).
    jacobian: Array
    #: r_w + r_v, at rest and without damping the mass matrix, shape (n, n).
    mass: Array
    #: Derivative of the forces r + C_y^T lam with respect to y, shape (n, n); where bodies turn in
    #: space, with respect to turns dth in the axes of the bodies, dA = A [dth].
    stiffness: Array


def evaluate_equations(
    model: ModelArrays,
    instant: int,
    y: Array,
    v: Array,
    w: Array,
    multipliers: Array,
    turns: Array | None = None,
) -> Evaluation:
    """Residuals of the equations of motion and of the constraints, and their Jacobians.

    At coordinates y, velocities v, accelerations w (n,) and multipliers (rows,); turns are angles
    that count turns over time, as a trajectory has them.
    """
    return Kinematics(model, turns).evaluated(instant, y, v, w, multipliers)


def place_vectors(model: ModelArrays, instant: int, y: Array) -> Array:
    """All vectors by their number at coordinates y, shape (vectors, d); in the plane spins, too."""
    kinematics = Kinematics(model)
    kinematics.set(y)
    kinematics.evaluate(instant, CONSTRAINTS)
    return kinematics.work.s


def applied_forces(model: ModelArrays, y: Array, v: Array, turns: Array | None = None) -> Array:
    """Forces and moments of all springs and loads over time, shape (instants, forces, 3).

    In the plane they are (F_x, F_y, M) on the first marker; in space that of a spring is its
    tension along its row, then zeros. Coordinates y and velocities v are of shape (instants, n).
    """
    kinematics = Kinematics(model, turns)
    forces = []
    for instant, state in enumerate(zip(y, v, strict=True)):
        kinematics.set(*state)
        kinematics.evaluate(instant, CONSTRAINTS | FORCES)
        forces.append(kinematics.forces())
    return np.array(forces)


def equations_pullback(
    kinematics: Kinematics,
    state: tuple[Array, Array, Array],
    adjoints: tuple[Array, Array, Array],
    *,
    forces: bool,
) -> Array:
    """Minus the derivative of Q by y at the first instant, at fixed v, lam and adjoints, (n,).

        Q = x . (C_y^T lam - z_y^T F) + m2 . C + m3 . dC/dt

    with the state y, v, lam and the adjoints x, m2, m3; the forces F at markers count if asked for.
    The derivatives by the markers' shape functions are added to :attr:`Kinematics.marker_bars`.
    """
    y, v, multipliers = state
    kinematics.set(y, v, None, multipliers)
    eq = kinematics.equations
    eq.y_bar[:] = 0.0
    eq.adjoint[:], eq.on_values[:], eq.on_rates[:] = adjoints
    kinematics.evaluate(0, CONSTRAINTS)
    kinematics.pullback(0, ROWS | OTHER_FORCES if forces else ROWS)
    return eq.y_bar.copy()
