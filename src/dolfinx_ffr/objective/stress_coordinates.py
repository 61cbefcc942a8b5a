# SPDX-License-Identifier: MIT
"""Coordinates in which the stress of a body is linear, and their pullback to the trajectory.

They are the elastic ones and, with static correction, the factors of the fields that make up the
acceleration of the body's points in its frame,

    b = A^T (a_R - g) + alpha J w + sum_j q''_j w_j - omega^2 w + 2 omega J sum_j q'_j w_j.

In space, with B = [alpha] + [omega]^2,

    b = A^T (a_R - g) + B w_0 + sum_j q''_j w_j + sum_j (alpha q_j + 2 omega q'_j) x w_j,

where the centrifugal force acts on the undeformed body: its change by the elastic displacement,
which is in proportion to it as small as this is to the body, would take six fields more for each
shape function.

Modes that were left out follow the inertia forces of b statically (the method of mode
accelerations, D. Rixen, AIAA 2001-1300, doi:10.2514/6.2001-1300).
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..dynamics import Trajectory, TrajectoryBar


def stress_coordinates(
    trajectory: Trajectory, name: str, n_constraint: int, *, correction: bool
) -> Array:
    """The coordinates z over time, shape (steps + 1, coordinates).

    These are the elastic coordinates and, with static ``correction``, the factors of the fields
    e_x, e_y, w_0, J w_0, the ``n_constraint`` constraint modes, and J times all shape functions in
    b; in space those of e_k, w_0^l e_k, the constraint modes and e_k x w_j, k first.
    """
    q = trajectory.elastic(name)
    if not correction:
        return q
    if trajectory.model.dimension == 3:
        return _in_space(trajectory, name, n_constraint)
    columns, k = trajectory.model.coordinates(name), n_constraint
    velocity, acceleration = trajectory.v, trajectory.w
    omega = velocity[:, columns.rotation, None]
    alpha = acceleration[:, columns.rotation, None]
    return np.column_stack(
        [
            q,
            *_forces(trajectory, name),
            -(omega**2),
            alpha,
            acceleration[:, columns.elastic][:, :k] - omega**2 * q[:, :k],
            alpha * q + 2.0 * omega * velocity[:, columns.elastic],
        ]
    )


def stress_coordinates_pullback(
    trajectory: Trajectory, name: str, n_constraint: int, bar: Array
) -> TrajectoryBar:
    """The transpose of the derivative of `stress_coordinates` for a ``bar`` of the shape of z."""
    q, k = trajectory.elastic(name), n_constraint
    columns, r = trajectory.model.coordinates(name), q.shape[1]
    out = TrajectoryBar.zeros(trajectory)
    out.y[:, columns.elastic] = bar[:, :r]
    if bar.shape[1] == r:
        return out
    if trajectory.model.dimension == 3:
        _add_in_space(out, trajectory, name, k, bar)
        return out
    along, across = _forces(trajectory, name)
    angle = trajectory.y[:, columns.rotation]
    c, s = np.cos(angle), np.sin(angle)
    omega = trajectory.v[:, columns.rotation, None]
    alpha = trajectory.w[:, columns.rotation, None]
    rate = trajectory.v[:, columns.elastic]
    along_bar, across_bar, square, turn = bar[:, r : r + 4].T
    carried, turned = bar[:, r + 4 : r + 4 + k], bar[:, r + 4 + k :]
    out.y[:, columns.rotation] = along_bar * across - across_bar * along
    out.w[:, columns.position] = np.column_stack(
        [c * along_bar - s * across_bar, s * along_bar + c * across_bar]
    )
    out.w[:, columns.rotation] = turn + np.sum(turned * q, axis=1)
    elastic = bar[:, :r] + alpha * turned
    elastic[:, :k] -= omega**2 * carried
    out.y[:, columns.elastic] = elastic
    accelerations = np.zeros_like(q)
    accelerations[:, :k] = carried
    out.w[:, columns.elastic] = accelerations
    out.v[:, columns.elastic] = 2.0 * omega * turned
    out.v[:, columns.rotation] = -2.0 * omega[:, 0] * (
        square + np.sum(carried * q[:, :k], axis=1)
    ) + 2.0 * np.sum(turned * rate, axis=1)
    return out


def _forces(trajectory: Trajectory, name: str) -> tuple[Array, Array]:
    """A^T (a_R - g) along both axes of the body's frame, shape (steps + 1,) each [m/s^2]."""
    columns = trajectory.model.coordinates(name)
    angle = trajectory.y[:, columns.rotation]
    gravity = trajectory.model.arrays.gravity[: len(angle)]
    x, y = (trajectory.w[:, columns.position] - gravity).T
    c, s = np.cos(angle), np.sin(angle)
    return c * x + s * y, c * y - s * x


def _in_space(trajectory: Trajectory, name: str, k: int) -> Array:
    """The coordinates z of a body in space, with static correction."""
    columns, steps = trajectory.model.coordinates_in_space(name), len(trajectory.t)
    q, rate = trajectory.elastic(name), trajectory.v[:, columns.elastic]
    omega, alpha = trajectory.v[:, columns.rotation], trajectory.w[:, columns.rotation]
    B = np.cross(alpha[:, None], np.eye(3)).transpose(0, 2, 1)
    B += omega[:, :, None] * omega[:, None] - np.sum(omega**2, 1)[:, None, None] * np.eye(3)
    turned = alpha[:, :, None] * q[:, None] + 2.0 * omega[:, :, None] * rate[:, None]
    return np.column_stack(
        [
            q,
            _force_in_space(trajectory, name),
            B.reshape(steps, 9),
            trajectory.w[:, columns.elastic][:, :k],
            turned.reshape(steps, -1),
        ]
    )


def _add_in_space(
    out: TrajectoryBar, trajectory: Trajectory, name: str, k: int, bar: Array
) -> None:
    """Add the transpose of the derivative of `_in_space`, but for its first columns, to ``out``.

    ``bar`` has the shape of z, (steps + 1, coordinates), and ``k`` constraint modes are in it.
    """
    columns, steps = trajectory.model.coordinates_in_space(name), len(trajectory.t)
    q, rate = trajectory.elastic(name), trajectory.v[:, columns.elastic]
    r = q.shape[1]
    omega, alpha = trajectory.v[:, columns.rotation], trajectory.w[:, columns.rotation]

    # the blocks of z after q, in the order of `_in_space`
    force_bar = bar[:, r : r + 3]
    B_bar = bar[:, r + 3 : r + 12].reshape(steps, 3, 3)
    acceleration_bar = bar[:, r + 12 : r + 12 + k]
    turned_bar = bar[:, r + 12 + k :].reshape(steps, 3, r)

    # dA = A [dth] turns what is seen in the body's axes by -dth
    out.y[:, columns.rotation] += np.cross(force_bar, _force_in_space(trajectory, name))
    out.y[:, columns.elastic] += np.einsum("tkj,tk->tj", turned_bar, alpha)

    out.v[:, columns.rotation] += np.einsum("tkl,tl->tk", B_bar + B_bar.transpose(0, 2, 1), omega)
    out.v[:, columns.rotation] -= 2.0 * np.trace(B_bar, axis1=1, axis2=2)[:, None] * omega
    out.v[:, columns.rotation] += 2.0 * np.einsum("tkj,tj->tk", turned_bar, rate)
    out.v[:, columns.elastic] += 2.0 * np.einsum("tkj,tk->tj", turned_bar, omega)

    out.w[:, columns.position] += np.einsum("tij,tj->ti", trajectory.rotation(name), force_bar)
    out.w[:, columns.rotation] += np.einsum("tkj,tj->tk", turned_bar, q)
    # B holds the component of alpha along an axis at (i, j), and its negative at (j, i)
    for axis, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        out.w[:, columns.rotation.start + axis] += B_bar[:, i, j] - B_bar[:, j, i]
    out.w[:, columns.elastic.start : columns.elastic.start + k] += acceleration_bar


def _force_in_space(trajectory: Trajectory, name: str) -> Array:
    """A^T (a_R - g) in the axes of the body's frame, shape (steps + 1, 3) [m/s^2]."""
    columns = trajectory.model.coordinates_in_space(name)
    gravity = trajectory.model.arrays.gravity[: len(trajectory.t)]
    acceleration = trajectory.w[:, columns.position] - gravity
    return np.asarray(np.einsum("tij,ti->tj", trajectory.rotation(name), acceleration))
