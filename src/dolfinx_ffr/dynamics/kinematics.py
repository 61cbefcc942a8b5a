# SPDX-License-Identifier: MIT
"""Equations of motion as Python sees them, in the plane and in space, by the arrays of a mechanism.

Each kind of kinematics is a folder with the same names at its door; what is asked here goes to the
one whose arrays are given.
"""

from __future__ import annotations

from types import ModuleType
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..body import BodyMarker, VolumeIntegrals
from . import planar, spatial
from .compilation import Compiled, Table
from .equations import CONSTRAINTS, FORCES, OTHER_FORCES, ROWS, TANGENT, equations
from .samples import Samples

__all__ = [
    "Coordinates",
    "Evaluation",
    "Kinematics",
    "ModelArrays",
    "applied_forces",
    "compiled_kinematics",
    "coordinates_of",
    "equations_pullback",
    "evaluate_equations",
    "integral_bars",
    "is_spatial",
    "least_sizes",
    "length_of",
    "marker_bar",
    "metric_bars",
    "place_markers",
    "settled",
    "settled_pullback",
    "sizes_by_mass",
    "ways",
]

Array = NDArray[np.float64]
ModelArrays: TypeAlias = planar.ModelArrays | spatial.ModelArrays
Coordinates: TypeAlias = planar.Coordinates | spatial.Coordinates


def is_spatial(model: ModelArrays) -> bool:
    """Whether a mechanism is one in space.

    Args:
        model: Flat arrays of the mechanism.
    """
    return isinstance(model, spatial.ModelArrays)


def _folder(model: ModelArrays) -> ModuleType:
    return spatial if isinstance(model, spatial.ModelArrays) else planar


def compiled_kinematics(*, space: bool) -> tuple[Compiled, ...]:
    """All compiled functions of a kind of kinematics.

    Args:
        space: Whether it is that in space.
    """
    return spatial.KIND.compiled if space else planar.KIND.compiled


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
        self.model, self._kind = model, _folder(model).KIND
        self._model, self.work = Table(model), self._kind.work_arrays(model)
        self._work = Table(self.work)
        kind = self._kind
        functions = kind.evaluate.address, kind.pullback.address, kind.measure.address
        tables = self._model.address, self._work.address
        chart, turn_stages = (0 if f is None else f.address for f in (kind.chart, kind.turn_stages))
        turning = spatial.turning_of(model) if isinstance(model, spatial.ModelArrays) else ()
        #: State at one instant, and what the equations of motion are there.
        self.equations = equations(
            kind.size(model), kind.rows(model), (*functions, *tables, chart, turn_stages), turning
        )
        if isinstance(model, spatial.ModelArrays):
            self.equations.floor[:] = spatial.round_off_floor(model)
        #: The same for compiled functions.
        self.table = Table(self.equations)

    @property
    def marker_bars(self) -> Array:
        """Derivatives with respect to the markers' shape functions, to which transposes add.

        See :func:`marker_bar`.
        """
        return np.asarray(self._kind.marker_bars(self.work))

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
        eq.y[:] = eq.base[:] = y
        eq.v[:] = 0.0 if v is None else v
        eq.w[:] = 0.0 if w is None else w
        eq.lam[:] = 0.0 if multipliers is None else multipliers

    def evaluate(self, instant: int, extent: int) -> None:
        """Evaluate the equations at the state, with M = r_w + r_v.

        Args:
            instant: Number of the instant in the tables of the mechanism.
            extent: What to evaluate, see :mod:`dolfinx_ffr.dynamics.equations`.
        """
        self._kind.evaluate(self.table, self._model, self._work, instant, 1.0, extent)

    def evaluated(
        self, instant: int, y: Array, v: Array, w: Array, multipliers: Array
    ) -> Evaluation:
        """What :func:`evaluate_equations` gives, in arrays that the next evaluation overwrites.

        Args:
            instant: Number of the instant in the tables of the mechanism.
            y: Coordinates, shape (n,).
            v: Velocities, shape (n,).
            w: Accelerations, shape (n,).
            multipliers: Multipliers, shape (rows,).
        """
        self.set(y, v, w, multipliers)
        self.evaluate(instant, CONSTRAINTS | FORCES | TANGENT)
        eq = self.equations
        residual = np.concatenate([eq.r + eq.C.T @ eq.lam, eq.value, eq.rate])
        return Evaluation(residual, eq.C, eq.M, eq.Ky)

    def pullback(self, instant: int, extent: int) -> None:
        """Transpose the equations at the state, which must have been evaluated there.

        Args:
            instant: Number of the instant in the tables of the mechanism.
            extent: What to transpose, see :mod:`dolfinx_ffr.dynamics.equations`.
        """
        self._kind.pullback(self.table, self._model, self._work, instant, extent)

    def places(self) -> Array:
        """Places of all markers after an evaluation, see :func:`place_markers`."""
        return np.asarray(self._kind.places(self.work))

    def forces(self) -> Array:
        """Forces after an evaluation, see :func:`applied_forces`."""
        return np.asarray(self._kind.forces(self.work))

    def begin(self, y: Array, turns: Array | None = None) -> None:
        """Let angles that count turns be those at the start of a motion.

        Args:
            y: Coordinates at the start, shape (n,).
            turns: What :meth:`turns` gave there, if the motion goes on from another one.
        """
        if isinstance(self.model, spatial.ModelArrays):
            spatial.begin_turns(self, y, turns)

    def turns(self, instant: int) -> Array | None:
        """Angles that count turns at an instant of a motion; None in the plane.

        Args:
            instant: Number of the instant in the tables of the mechanism.
        """
        if isinstance(self.model, spatial.ModelArrays):
            return np.array(self.work.turns[instant])
        return None

    def follow(self, y: Array) -> None:
        """Let angles that count turns be those along a motion.

        Args:
            y: Coordinates over time, shape (instants, n).
        """
        if isinstance(self.model, spatial.ModelArrays):
            spatial.follow_turns(self, y)


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
    return Kinematics(model).evaluated(instant, y, v, w, multipliers)


def place_markers(model: ModelArrays, instant: int, y: Array) -> Array:
    """Positions and angles of all markers, shape (markers, 3); in space, vectors by their number.

    Args:
        model: Flat arrays of the mechanism.
        instant: Number of the instant in its tables.
        y: Coordinates, shape (n,).
    """
    kinematics = Kinematics(model)
    kinematics.set(y)
    kinematics.evaluate(instant, CONSTRAINTS)
    return kinematics.places()


def applied_forces(model: ModelArrays, y: Array, v: Array) -> Array:
    """Forces and moments of all forces on their first markers over time.

    Args:
        model: Flat arrays of the mechanism.
        y: Coordinates over time, shape (instants, n).
        v: Velocities over time, shape (instants, n).

    Returns:
        Shape (instants, forces, 3) in the plane; in space (instants, springs and loads, 3), a
        spring's being its tension along its row, then zeros.
    """
    kinematics = Kinematics(model)
    kinematics.follow(y)
    parts = []
    for instant, state in enumerate(zip(y, v, strict=True)):
        kinematics.set(*state)
        kinematics.evaluate(instant, CONSTRAINTS | FORCES)
        parts.append(kinematics.forces().copy())
    return np.array(parts)


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


def coordinates_of(model: ModelArrays, body: int) -> Coordinates:
    """Coordinates of a body by name.

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
    """
    found: Coordinates = _folder(model).coordinates_of(model, body)
    return found


def settled(model: ModelArrays, base: Array, y: Array) -> Array:
    """Coordinates after a shift y - base, which in space turns bodies about their own axes, (n,).

    Args:
        model: Flat arrays of the mechanism.
        base: Coordinates before it, shape (n,).
        y: Their sum with the shift, shape (n,).
    """
    return np.asarray(_folder(model).settled(model, base, y))


def settled_pullback(model: ModelArrays, shift: Array, bar: Array) -> tuple[Array, Array]:
    """Transpose of :func:`settled` with respect to the shift and to the coordinates.

    Args:
        model: Flat arrays of the mechanism.
        shift: The shift, shape (n,).
        bar: Derivative of a number with respect to the coordinates after it, shape (n,); where
            bodies turn in space, with respect to turns dth, dA = A [dth].

    Returns:
        Derivatives with respect to the shift, and to the coordinates before it, shape (n,) each.
    """
    by_shift, by_y = _folder(model).settled_pullback(model, shift, bar)
    return np.asarray(by_shift), np.asarray(by_y)


def ways(model: ModelArrays, y: Array, start: Array) -> Array:
    """Shifts that lead from one motion to another, shape (instants, n).

    Args:
        model: Flat arrays of the mechanism.
        y: Coordinates over time, shape (instants, n).
        start: Coordinates from which, shape (n,) or (instants, n).
    """
    return np.asarray(_folder(model).ways(model, y, start))


def sizes_by_mass(model: ModelArrays, shift: Array) -> Array:
    """Sizes of shifts of all material points, shape (instants,) [m sqrt(kg)].

    Args:
        model: Flat arrays of the mechanism.
        shift: Shifts of the coordinates, shape (instants, n).
    """
    return np.asarray(_folder(model).sizes_by_mass(model, shift))


def length_of(model: ModelArrays) -> float:
    """Size of the bodies: largest distance of a marker from the origin of its body's frame [m].

    Where all markers are at the origins it is the largest radius of gyration.

    Args:
        model: Flat arrays of the mechanism.
    """
    return float(_folder(model).length_of(model))


def least_sizes(model: ModelArrays, duration: float) -> Array:
    """Sizes below which a motion counts as rest: far below what a machine of this size does.

    Args:
        model: Flat arrays of the mechanism.
        duration: Of the motion [s].

    Returns:
        Way and velocity by mass, elastic part by energy, shape (3,).
    """
    least = 1e-6 * length_of(model) * float(np.sqrt(np.sum(model.mass)))
    return np.array([least, least / duration, 1e-6 * least / duration])


def integral_bars(
    model: ModelArrays, body: int, integrals: VolumeIntegrals, samples: Samples
) -> VolumeIntegrals:
    """Minus the sum over time of adjoint . dr, r being linear in each integral.

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
        integrals: Its integrals, whose markers get derivatives of zero.
        samples: States and adjoint.
    """
    found: VolumeIntegrals = _folder(model).integral_bars(model, body, integrals, samples)
    return found


def metric_bars(
    model: ModelArrays, body: int, integrals: VolumeIntegrals, left: Array, right: Array
) -> VolumeIntegrals:
    """Share of the metric of the position corrections, sum over time of left . dD^-1 right.

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
        integrals: Its integrals.
        left: Vectors over time, shape (instants, n).
        right: Likewise.
    """
    found: VolumeIntegrals = _folder(model).metric_bars(model, body, integrals, left, right)
    return found


def marker_bar(model: ModelArrays, marker: int, marker_bars: Array) -> BodyMarker:
    """Derivatives with respect to the shape functions of a marker; its position is data.

    Args:
        model: Flat arrays of the mechanism.
        marker: Number of the marker.
        marker_bars: What transposes have added, see :attr:`Kinematics.marker_bars`.
    """
    found: BodyMarker = _folder(model).marker_bar(model, marker, marker_bars)
    return found
