# SPDX-License-Identifier: MIT
"""Consistent start: placements corrected until all joints close, and its transpose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..mechanism import RowKind
from .equilibrium import equilibrium_pullback, static_equilibrium
from .kinematics import (
    Kinematics,
    equations_pullback,
    holds_axes,
    length_of,
    place_vectors,
    reversed_row,
)
from .model import FlatModel


@dataclass(frozen=True)
class AssemblyOptions:
    """Options for closing the joints at the start."""

    most_iterations: int = 100
    #: Joints that stay open by more than this share of the mechanism's size cannot be assembled.
    open_joint: float = 1e-10
    #: Singular values below this share of the largest mean redundant joints.
    redundant: float = 1e-9
    #: Singular values below this share of the largest take no part in corrections.
    no_correction: float = 1e-10
    #: Corrections below this share of the mechanism's size are round-off.
    round_off: float = 1e-15


OPTIONS = AssemblyOptions()


def started(model: FlatModel) -> tuple[FlatModel, Array, Array]:
    """The model with angles unwrapped at the start, and y and v (size,) that close all joints.

    The placements are corrected by the Gauss-Newton method over positions and angles of the
    undeformed bodies. A given deformation shifts them once more, along the directions in which the
    joints of the undeformed bodies pull; a static equilibrium is sought from there instead. The
    velocities are corrected by one least-squares solve. All corrections have the least norm, angles
    counted as the arc that they sweep at the mechanism's size. Joints that contradict each other,
    do not reach or are redundant are named in a ValueError.
    """
    closure = _Closure(model)
    y, v = _placed(model)
    elastic, rate = _elastic_state(model)
    if model.mechanism.start.in_equilibrium:
        y = closure.assembled(y, refuse=False)
        if model.rows:
            _refuse_redundant(model, closure.constraints(y, v)[2])
        _refuse_without_direction(model, y)
        y, turns = static_equilibrium(model, y, closure.length)
        model = model.counting_from(turns)
        closure = _Closure(model)
        closure.refuse_open(y, "in the equilibrium")
    else:
        y = closure.assembled(y)
        if np.any(elastic):
            y = closure.deformed(y, elastic)
    v += rate
    if model.rows:
        v = closure.moving(y, v)
        _refuse_redundant(model, closure.constraints(y, v)[2])
    _refuse_without_direction(model, y)
    placed, _ = _placed(model)
    joint = reversed_joint(model, (0, placed), (0, y))
    if joint is not None:
        raise ValueError(
            f"joint {joint!r} closes with its axis reversed; the placements are too far from a "
            "position in which it closes"
        )
    return model, y, v


def reversed_joint(
    model: FlatModel, before: tuple[int, Array], after: tuple[int, Array]
) -> str | None:
    """Joint in space whose axis is reversed between two instants with their coordinates, if any."""
    arrays = model.arrays
    if not holds_axes(arrays):
        return None
    vectors = (place_vectors(arrays, *at) for at in (before, after))
    row = reversed_row(arrays, model.joints.values(), *vectors)
    return model.joint_of_row(row) if row >= 0 else None


def placement_corrections(model: FlatModel, y: Array) -> dict[str, tuple[float, float]]:
    """Distance [m] and angle [rad] by which closing the joints moves each body, by name.

    They are counted from the placement to the start ``y`` (size,); where that is deformed or a
    static equilibrium, to the position in which the joints of the undeformed bodies close.
    """
    if not model.rows:
        return {}
    model = model.counting_from_placements()
    placed, _ = _placed(model)
    deformation, _ = _elastic_state(model)
    if model.mechanism.start.in_equilibrium or np.any(deformation):
        y = _Closure(model).assembled(placed, refuse=False)
    shift = model.arrays.difference(y[None], placed)[0]
    corrections = {}
    for body in model.bodies:
        columns = model.coordinates(body)
        angle = float(np.linalg.norm(shift[columns.rotation]))
        corrections[body] = float(np.linalg.norm(shift[columns.position])), angle
    return corrections


def widest_gap(model: FlatModel) -> tuple[str, str]:
    """Name of the joint with the widest gap in the placements, and the gap with its unit."""
    closure = _Closure(model.counting_from_placements())
    placed, _ = _placed(model)
    gap, _ = closure.residual(placed)
    row = int(np.argmax(np.abs(gap)))
    size, unit = abs(gap[row]) / closure.row[row], "rad" if model.angular[row] else "m"
    return model.joint_of_row(row), f"{size:.3g} {unit}"


def start_pullback(
    model: FlatModel, y: Array, v: Array, y_bar: Array, v_bar: Array, markers: Array
) -> Array | None:
    """Transpose of :func:`started` with respect to the integrals of the bodies.

    Gives the adjoint of the forces in the static equilibrium (size,), or None for an assembled
    start, which depends on nothing but the markers; adds to the bars of the markers. It is exact
    where the placements close the joints, else to the share of their gaps in the lengths.
    """
    equilibrium, closure = model.mechanism.start.in_equilibrium, _Closure(model)
    elastic, rate = _elastic_state(model)
    placed, placed_velocity = _placed(model)
    if model.rows:
        y_bar = y_bar + closure.moving_pullback(y, placed_velocity + rate, v, v_bar)
    if model.rows and not equilibrium:
        undeformed = closure.assembled(placed) if np.any(elastic) else y
        closure.deformed_pullback(undeformed, y, y_bar)
    markers += closure.marker_bars
    return equilibrium_pullback(model, y, y_bar, markers) if equilibrium else None


def _elastic_state(model: FlatModel) -> tuple[Array, Array]:
    """Coordinates and velocities (size,) of the given deformation, zero at rigid coordinates."""
    y, v = np.zeros(model.size), np.zeros(model.size)
    for name, integrals in model.bodies.items():
        elastic = model.coordinates(name).elastic
        y[elastic], v[elastic] = model.mechanism.start.elastic_state(name, integrals.modes)
    return y, v


def _placed(model: FlatModel) -> tuple[Array, Array]:
    """Coordinates and velocities (size,) of the placements, zero at elastic coordinates."""
    y, v = np.zeros(model.size), np.zeros(model.size)
    for name in model.bodies:
        rigid = model.coordinates(name).rigid
        y[rigid], v[rigid] = model.arrays.placed(model.mechanism.placements[name])
    return y, v


class _Closure:
    """Closes the joints by corrections of the rigid coordinates and of their velocities."""

    def __init__(self, model: FlatModel) -> None:
        arrays = model.arrays
        self.model = model
        self._kinematics = Kinematics(arrays)
        #: Derivatives by the markers' shape functions, to which the transposes add
        self.marker_bars = self._kinematics.marker_bars
        self.length = length_of(arrays)
        self.rigid = model.rigid
        # scales of rigid coordinates and of rows: angles count as arcs at the mechanism's size
        self.column = np.where(model.rotations[self.rigid], 1.0 / self.length, 1.0)
        self.row = np.where(model.angular, self.length, 1.0)

    def constraints(self, y: Array, v: Array) -> tuple[Array, Array, Array]:
        """Gaps of positions and of velocities, (rows,) each, and the Jacobian (rows, size)."""
        zero = np.zeros(self.model.size), np.zeros(self.model.rows)
        values, jacobian, *_ = self._kinematics.evaluated(0, y, v, *zero)
        gaps = values[self.model.size :].reshape(2, -1)
        return gaps[0], gaps[1], jacobian.copy()

    def residual(self, y: Array, shift: Array | None = None) -> tuple[Array, Array]:
        """Gaps and their Jacobian by rigid coordinates, or by the shift to y, scaled to lengths."""
        value, _, jacobian = self.constraints(y, np.zeros_like(y))
        if shift is not None:
            rows = [self.model.arrays.retract_pullback(shift, row)[0] for row in jacobian]
            jacobian = np.array(rows)
        return self.row * value, self.row[:, None] * jacobian[:, self.rigid] * self.column

    def assembled(self, y: Array, *, refuse: bool = True) -> Array:
        """Positions that close the joints of the undeformed bodies."""
        model = self.model
        if model.rows == 0:
            return y
        value, jacobian = self.residual(y)
        for _ in range(OPTIONS.most_iterations):
            if np.max(np.abs(value)) < OPTIONS.round_off * self.length:
                break
            step = self.column * np.linalg.lstsq(jacobian, -value, rcond=OPTIONS.no_correction)[0]
            share = 1.0
            while True:
                trial = y.copy()
                trial[self.rigid] += share * step
                trial = model.arrays.retract(y, trial)
                new_value, new_jacobian = self.residual(trial)
                if np.linalg.norm(new_value) < np.linalg.norm(value) or share < 1e-4:
                    break
                share *= 0.5
            if not np.linalg.norm(new_value) < np.linalg.norm(value):
                break
            y, value, jacobian = trial, new_value, new_jacobian
        if refuse:
            self.refuse_open(y, "")
        return y

    def refuse_open(self, y: Array, how: str) -> None:
        if self.model.rows:
            value, _ = self.residual(y)
            limit, units = OPTIONS.open_joint * self.length, ("m", "rad")
            action = f"assembled {how}".rstrip()
            _refuse_open(self.model, value / self.row, np.abs(value), limit, units, action)

    def deformed(self, undeformed: Array, elastic: Array) -> Array:
        """Positions that close the joints of the deformed bodies.

        The shift keeps to the directions in which the joints pull before the deformation.
        """
        arrays, moved = self.model.arrays, undeformed + elastic
        if self.model.rows == 0:
            return moved
        pulled_rows, pulled_columns = self._directions(undeformed)
        for _ in range(OPTIONS.most_iterations):
            y = arrays.retract(undeformed, moved)
            value, jacobian = self.residual(y, moved - undeformed)
            step = np.linalg.lstsq(
                pulled_rows.T @ jacobian @ pulled_columns, -pulled_rows.T @ value, rcond=None
            )[0]
            moved[self.rigid] += self.column * (pulled_columns @ step)
            if not np.max(np.abs(step)) > OPTIONS.round_off * self.length:
                break
        y = arrays.retract(undeformed, moved)
        self.refuse_open(y, "with the given elastic coordinates")
        return y

    def deformed_pullback(self, undeformed: Array, y: Array, y_bar: Array) -> None:
        """Transpose of :meth:`deformed` with respect to the markers' positions and shapes."""
        pulled_rows, pulled_columns = self._directions(undeformed)
        shift = self.model.arrays.difference(y[None], undeformed)[0]
        _, jacobian = self.residual(y, shift)
        y_bar, _ = self.model.arrays.retract_pullback(shift, y_bar)
        pulled_bar = pulled_columns.T @ (self.column * y_bar[self.rigid])
        row_adjoint = self.row * (
            pulled_rows @ np.linalg.solve((pulled_rows.T @ jacobian @ pulled_columns).T, pulled_bar)
        )
        none, zero = np.zeros(self.model.rows), np.zeros_like(y)
        state, adjoints = (y, zero, none), (zero, row_adjoint, none)
        equations_pullback(self._kinematics, state, adjoints, forces=False)

    def _directions(self, y: Array) -> tuple[Array, Array]:
        """Left and right singular vectors of the Jacobian with non-zero singular values."""
        _, jacobian = self.residual(y)
        u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
        rank = int(np.sum(s > OPTIONS.no_correction * s[0]))
        return u[:, :rank], vt[:rank].T

    def moving(self, y: Array, v: Array) -> Array:
        """Velocities that close the joints."""
        v, model = v.copy(), self.model
        _, drift, full = self.constraints(y, 0.0 * v)
        _, jacobian = self.residual(y)
        speed = float(np.max(self.row * (np.abs(full) @ np.abs(v) + np.abs(drift))))
        _, rate, _ = self.constraints(y, v)
        for _ in range(2):  # the second step removes what round-off leaves of the first
            step = np.linalg.lstsq(jacobian, -self.row * rate, rcond=OPTIONS.no_correction)[0]
            v[self.rigid] += self.column * step
            _, rate, _ = self.constraints(y, v)
        speed = max(speed, float(np.max(self.row * (np.abs(full) @ np.abs(v)))))
        elastic_moves = np.any(np.delete(v, self.rigid))
        action = "set in motion with the " + (
            "given elastic velocities" if elastic_moves else "elastic coordinates at rest"
        )
        size, units = self.row * np.abs(rate), ("m/s", "rad/s")
        _refuse_open(model, rate, size, OPTIONS.open_joint * speed, units, action)
        return v

    def moving_pullback(self, y: Array, before: Array, v: Array, v_bar: Array) -> Array:
        """Transpose of :meth:`moving` with respect to y, (size,), and the markers' shape functions.

        The velocities are v = before - D C_y^T mu with C_y v + C_t = 0. The derivative is the one
        of mu . C_y x + t . (C_y v + C_t) at fixed mu, t, x and v, with
        t = -(C_y D C_y^T)^-1 C_y D v_bar and x = -D (v_bar + C_y^T t).
        """
        _, rate, C_y = self.constraints(y, before)
        _, jacobian = self.residual(y)

        # D is column^2, of the rigid coordinates; J = row C_y column, so that the inverse of
        # C_y D C_y^T is row J^+T J^+ row
        inverse = np.linalg.pinv(jacobian, rcond=OPTIONS.no_correction)
        mu = self.row * (inverse.T @ (inverse @ (self.row * rate)))
        t = -self.row * (inverse.T @ (self.column * v_bar[self.rigid]))
        x = np.zeros_like(y)
        x[self.rigid] = -(self.column**2) * (v_bar + C_y.T @ t)[self.rigid]

        adjoints = x, np.zeros(self.model.rows), -t
        return equations_pullback(self._kinematics, (y, v, -mu), adjoints, forces=False)


def _refuse_open(
    model: FlatModel, residual: Array, size: Array, limit: float, units: tuple[str, str], what: str
) -> None:
    """Raise where a joint stays open, naming the widest gap and all joints involved."""
    worst = int(np.argmax(size))
    if size[worst] <= limit:
        return
    unit = units[int(model.angular[worst])]
    involved = _joints_of(model, size)
    more_joints = f" (joints involved: {involved})" if len(involved) > 1 else ""
    raise ValueError(
        f"the mechanism cannot be {what}: joint {model.joint_of_row(worst)!r} stays open by "
        f"{abs(residual[worst]):.3g} {unit}{more_joints}; the joints contradict each other, or the "
        "placements are too far from a position in which they close"
    )


def _refuse_redundant(model: FlatModel, jacobian: Array) -> None:
    """Raise where rows of the constraint Jacobian depend on each other."""
    # The diagonal of the mass matrix makes unlike coordinates comparable.
    mass = np.concatenate([np.diag(body.mass_matrix()) for body in model.bodies.values()])
    scaled = jacobian / np.sqrt(mass)
    scaled /= np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), np.finfo(float).tiny)
    u, s, _ = np.linalg.svd(scaled, full_matrices=True)
    rank = int(np.sum(s > OPTIONS.redundant * s[0]))
    if rank == model.rows:
        return
    involved = _joints_of(model, np.linalg.norm(u[:, rank:], axis=1))
    count = model.rows - rank
    raise ValueError(
        f"{count} of the {model.rows} constraints {'is' if count == 1 else 'are'} redundant; "
        f"joints involved: {involved}. Remove constraints that another joint already imposes, or "
        f"start from a position that is not singular{_proposal(model, scaled, rank)}"
    )


def _proposal(model: FlatModel, jacobian: Array, rank: int) -> str:
    """Redundant rows in words, where other joints hold less; loops in space may close in planes."""
    if not model.arrays.looser:
        return ""
    # Orthogonalised one after the other, so that the last of rows that depend on each other falls.
    independent, redundant = np.zeros((0, jacobian.shape[1])), []
    for row, direction in enumerate(jacobian):
        remainder = direction - independent.T @ (independent @ direction)
        remainder -= independent.T @ (independent @ remainder)
        if float(np.linalg.norm(remainder)) < 1e-6:
            redundant.append(row)
        else:
            independent = np.vstack([independent, remainder / np.linalg.norm(remainder)])
    locked: dict[str, list[str]] = {}
    for row in redundant[: model.rows - rank]:
        kind_of_row = "rotation" if model.angular[row] else "position"
        locked.setdefault(model.joint_of_row(row), []).append(kind_of_row)
    listed = [
        f"{joint!r} need not hold "
        + " and ".join(
            f"{fixed.count(kind_of_row)} {kind_of_row}{'s' if fixed.count(kind_of_row) > 1 else ''}"
            for kind_of_row in ("position", "rotation")
            if kind_of_row in fixed
        )
        for joint, fixed in locked.items()
    ]
    return f". For instance {'; '.join(listed)}: {model.arrays.looser}"


def _refuse_without_direction(model: FlatModel, y: Array) -> None:
    """Raise where the markers of a spring coincide, so that it has no direction."""
    arrays = model.arrays
    ends, directed = arrays.side[model.rows :], arrays.kind[model.rows :] == RowKind.DISTANCE
    if not np.any(directed):
        return
    positions = place_vectors(arrays, 0, y)
    for number in np.flatnonzero(directed):
        gap = float(np.linalg.norm(positions[ends[number, 0]] - positions[ends[number, 1]]))
        if gap <= OPTIONS.open_joint * length_of(arrays):
            label = next(name for name, places in model.forces.items() if number in places)
            raise ValueError(
                f"force {label!r}: the markers coincide at the start, so that the spring has no "
                "direction; length=0 makes it an elastic bearing"
            )


def _joints_of(model: FlatModel, weight: Array) -> list[str]:
    """Names of the joints whose rows carry a relevant share of the weight."""
    rows = np.flatnonzero(weight > 1e-3 * np.max(weight))
    return list(dict.fromkeys(model.joint_of_row(int(row)) for row in rows))
