# SPDX-License-Identifier: MIT
"""Consistent start: rough placements corrected until all joints close."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .arrays import ANGLE, SPRING
from .loops import kernels
from .model import FlatModel

__all__ = ["initial_state"]

Array = NDArray[np.float64]

_MAX_ITERATIONS = 100
#: Joints that stay open by more than this share of the mechanism's size cannot be assembled.
_OPEN = 1e-10
#: Singular values below this share of the largest mean redundant joints.
_RANK = 1e-9


def initial_state(model: FlatModel) -> tuple[Array, Array]:
    """Coordinates and velocities at the start, such that all joints close.

    The placements are corrected by the Gauss-Newton method over positions and angles of the
    bodies, then the velocities by one least-squares solve; both corrections are the smallest ones
    that do. Elastic coordinates and their velocities start from zero, so the start depends on the
    positions of the markers but not on the integrals of the bodies.

    Args:
        model: The compiled mechanism.

    Returns:
        Coordinates and velocities, shape (size,) each.

    Raises:
        ValueError: If the joints contradict each other or do not reach, naming the joint that is
            open the most, or if joints are redundant, naming them.
    """
    arrays = model.arrays
    y, v = np.zeros(model.size), np.zeros(model.size)
    rigid = np.concatenate([first + np.arange(3) for first in arrays.first])
    for name in model.bodies:
        first = model.coordinates(name).start
        placement = model.mechanism.placements[name]
        y[first : first + 3] = *placement.position, placement.angle
        v[first : first + 3] = *placement.velocity, placement.angular_velocity
    if model.rows == 0:
        _refuse_without_direction(model, y)
        return y, v
    length = _length(model)
    # Angles count as the arc they sweep at the mechanism's size.
    column = np.tile([1.0, 1.0, 1.0 / length], arrays.first.size)
    row = np.where(arrays.kind == ANGLE, length, 1.0)

    def constraints(position: Array, velocity: Array) -> tuple[Array, Array, Array]:
        zero = np.zeros(model.size), np.zeros(model.rows)
        values, jacobian = kernels.evaluate(arrays, 0, position, velocity, *zero)
        gaps = values[model.size :].reshape(2, -1)
        return gaps[0], gaps[1], jacobian

    def residual(position: Array) -> tuple[Array, Array]:
        value, _, jacobian = constraints(position, v)
        return row * value, row[:, None] * jacobian[:, rigid] * column

    value, jacobian = residual(y)
    for _ in range(_MAX_ITERATIONS):
        if np.max(np.abs(value)) < 1e-15 * length:
            break
        step = column * np.linalg.lstsq(jacobian, -value, rcond=1e-10)[0]
        share = 1.0
        while True:
            trial = y.copy()
            trial[rigid] += share * step
            new_value, new_jacobian = residual(trial)
            if np.linalg.norm(new_value) < np.linalg.norm(value) or share < 1e-4:
                break
            share *= 0.5
        if not np.linalg.norm(new_value) < np.linalg.norm(value):
            break
        y, value, jacobian = trial, new_value, new_jacobian
    _refuse_open(model, value / row, np.abs(value), _OPEN * length, ("m", "rad"), "assembled")

    _, drift, full = constraints(y, 0.0 * v)
    _, rate, _ = constraints(y, v)
    speed = float(np.max(row * (np.abs(full) @ np.abs(v) + np.abs(drift))))
    v[rigid] += column * np.linalg.lstsq(jacobian, -row * rate, rcond=1e-10)[0]
    _, rate, _ = constraints(y, v)
    speed = max(speed, float(np.max(row * (np.abs(full) @ np.abs(v)))))
    _refuse_open(model, rate, row * np.abs(rate), _OPEN * speed, ("m/s", "rad/s"), "set in motion")
    _refuse_redundant(model, full)
    _refuse_without_direction(model, y)
    return y, v


def _length(model: FlatModel) -> float:
    """Size of the bodies: largest distance of a marker from the origin of its body's frame."""
    used = model.arrays.marker_body >= 0
    length = float(np.max(np.linalg.norm(model.arrays.W[used, :, 0], axis=1), initial=0.0))
    return length if length > 0.0 else 1.0


def _refuse_open(
    model: FlatModel, residual: Array, size: Array, limit: float, units: tuple[str, str], what: str
) -> None:
    """Raise where a joint stays open, naming the worst and all that are involved."""
    worst = int(np.argmax(size))
    if size[worst] <= limit:
        return
    unit = units[int(model.arrays.kind[worst] == ANGLE)]
    involved = _joints_of(model, size)
    others = f" (joints involved: {involved})" if len(involved) > 1 else ""
    start = "" if what == "assembled" else " with the elastic coordinates at rest"
    raise ValueError(
        f"the mechanism cannot be {what}{start}: joint {model.joint_of_row(worst)!r} stays open by "
        f"{abs(residual[worst]):.3g} {unit}{others}; the joints contradict each other, or the "
        "placements are too far from a position in which they close"
    )


def _refuse_redundant(model: FlatModel, jacobian: Array) -> None:
    """Raise where rows of the constraint Jacobian depend on each other."""
    scaled = jacobian / np.sqrt(_diagonal_of_mass(model))
    scaled /= np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), np.finfo(float).tiny)
    u, s, _ = np.linalg.svd(scaled, full_matrices=True)
    rank = int(np.sum(s > _RANK * s[0]))
    if rank == model.rows:
        return
    involved = _joints_of(model, np.linalg.norm(u[:, rank:], axis=1))
    count = model.rows - rank
    raise ValueError(
        f"{count} of the {model.rows} constraints {'is' if count == 1 else 'are'} redundant; "
        f"joints involved: {involved}. Remove what another joint already holds, or start from a "
        "position that is not singular"
    )


def _refuse_without_direction(model: FlatModel, y: Array) -> None:
    """Raise where the markers of a spring coincide, so that it does not know where to pull."""
    arrays = model.arrays
    if not np.any(arrays.force_kind == SPRING):
        return
    positions = kernels.place(arrays, 0, y)
    for kind, (a, b), label in zip(
        arrays.force_kind, arrays.force_side, model.mechanism.force_names, strict=True
    ):
        gap = float(np.hypot(*(positions[a, :2] - positions[b, :2])))
        if kind == SPRING and gap <= _OPEN * _length(model):
            raise ValueError(
                f"force {label!r}: the markers coincide at the start, so that the spring has no "
                "direction; length=0 makes it an elastic bearing"
            )


def _diagonal_of_mass(model: FlatModel) -> Array:
    """Diagonal of the mass matrix, weights that make unlike coordinates comparable."""
    return np.concatenate([np.diag(body.mass_matrix()) for body in model.bodies.values()])


def _joints_of(model: FlatModel, weight: Array) -> list[str]:
    """Names of the joints whose rows carry a share of the weight worth naming."""
    rows = np.flatnonzero(weight > 1e-3 * np.max(weight))
    return list(dict.fromkeys(model.joint_of_row(int(row)) for row in rows))
