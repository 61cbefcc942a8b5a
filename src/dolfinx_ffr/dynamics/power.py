# SPDX-License-Identifier: MIT
"""The pullback of the power of drives (`Trajectory.drive_power`), and forces on the frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Array, Integers
from ..body import VolumeIntegrals
from ..mechanism import RowKind
from .equations import CONSTRAINTS, ROWS
from .kinematics import marker_bar
from .model import FlatModel
from .trajectory import Trajectory, TrajectoryBar


def driving_power_pullback(
    trajectory: Trajectory, joints: Sequence[str], power_bar: Array
) -> tuple[TrajectoryBar, dict[str, VolumeIntegrals]]:
    """Derivatives by trajectory and markers from those by the power over time, (steps + 1,)."""
    kinematics, driving = trajectory.of_joints(joints)
    model, eq, bar = trajectory.model, kinematics.equations, TrajectoryBar.zeros(trajectory)
    counts = np.zeros(model.rows, dtype=bool)
    for name in joints:
        counts[model.joints[name]] = True
    for k in np.flatnonzero(power_bar):
        v, lam = trajectory.v[k], power_bar[k] * driving[k]
        kinematics.set(trajectory.y[k], v, None, lam)
        eq.adjoint[:], eq.y_bar[:] = v, 0.0
        kinematics.evaluate(int(k), CONSTRAINTS)
        # The derivative of v . C_y^T lam is subtracted.
        kinematics.pullback(int(k), ROWS)
        bar.y[k] = eq.y_bar
        bar.v[k] = -lam @ eq.C
        bar.multipliers[k] = np.where(counts, -power_bar[k] * (eq.C @ v), 0.0)
    bodies = {name: body.zeros_like() for name, body in model.bodies.items()}
    for (body, marker), number in model.markers.items():
        bodies[body].markers[marker] += marker_bar(model.arrays, number, kinematics.marker_bars)
    return bar, bodies


def forces_on_frame(model: FlatModel, joints: Sequence[str]) -> tuple[Integers, Array]:
    """Forces of bodies on the frame by joints, for multipliers of 1.

    The rows of the joints that carry forces, shape (rows,), and the forces in the global axes,
    shape (instants, rows, d). A joint that is not between a body and the ground, or a marker in
    prescribed motion, and one along a line or a distance that turns with a body are refused by a
    ValueError.
    """
    arrays, rows, unit_forces = model.arrays, list[int](), list[Array]()
    shape = len(model.times), arrays.d
    for name in joints:
        numbers = np.arange(model.rows)[model.joints[name]]
        for row in numbers[~model.angular[numbers]]:
            first_end, second_end, line = arrays.side[row, :3]
            is_on_body = arrays.vector_body[[first_end, second_end]] >= 0
            kind = arrays.kind[row]
            if is_on_body[0] == is_on_body[1]:
                raise ValueError(
                    f"joint force: joint {name!r} connects two bodies, but forces of several "
                    "joints add up to the force on the frame; give joints on the ground or on "
                    "moving markers"
                )
            if kind == RowKind.POINT:
                force = np.broadcast_to(arrays.normal[row], shape)
            elif kind == RowKind.PLANE and arrays.vector_body[line] < 0:
                force = arrays.prescribed[:-1, arrays.vector_slot[line], 0]
            else:
                raise ValueError(
                    f"joint force: the force of joint {name!r} turns with a body, so that it "
                    "cannot be added to others; give its line in axes of the frame"
                )
            rows.append(int(row))
            unit_forces.append(force if is_on_body[0] else -force)
    if not rows:
        raise ValueError(f"joint force: the joints {list(joints)} carry no forces")
    return np.array(rows), np.stack(unit_forces, axis=1)
