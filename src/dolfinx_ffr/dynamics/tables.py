# SPDX-License-Identifier: MIT
"""What a mechanism prescribes over time, tabulated at the instants of a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mechanism import Ground, Mechanism, Motion, Moving, Row, SpatialRow, sample, tabulated

__all__ = ["BESIDE_JUMP", "TimeTables", "free_fall"]

Array = NDArray[np.float64]

#: Relative distance from a jump at which the values on its sides are taken.
BESIDE_JUMP = 1e-15


@dataclass(frozen=True, eq=False)
class TimeTables:
    """What a mechanism prescribes over time, to be tabulated at any instants."""

    mechanism: Mechanism
    #: Markers that move as prescribed, with their first users for messages.
    prescribed: Sequence[tuple[Ground | Moving, str]]
    #: Rows of all joints, with the names of the joints.
    rows: Sequence[tuple[Row, str]] | Sequence[tuple[SpatialRow, str]]
    #: Forces, with their names.
    elements: Sequence[tuple[Any, str]]

    @cached_property
    def _motions(self) -> list[tuple[Motion, str]]:
        """Those of markers, with the users of these; the ground does not move."""
        moving = [(m, where) for m, where in self.prescribed if isinstance(m, Moving)]
        return [(motion, where) for marker, where in moving for motion in marker.motions]

    @cached_property
    def jumps(self) -> Array:
        """Times after the start at which something prescribed is not smooth, in order [s]."""
        fields = (self.mechanism.gravity, self.mechanism.ground_acceleration)
        signals: list[object] = [signal for field in fields for signal in field]
        signals += [motion for motion, _ in self._motions]
        signals += [row.motion for row, _ in self.rows]
        signals += [signal for element, _ in self.elements for signal in element.signals]
        known = [t for signal in signals if isinstance(signal, Motion) for t in signal.jumps]
        jumps = np.unique(np.array([*known, *self.mechanism.jumps], dtype=np.float64))
        return jumps[jumps > 0.0]

    def check(self, start: float, end: float) -> None:
        """Compare all derivatives with differences.

        Args:
            start: Begin of the motion [s].
            end: End of the motion [s].

        Raises:
            ValueError: If a derivative is wrong; the message names the marker or the joint.
        """
        motions = list(self._motions)
        motions += [(row.motion, f"joint {label!r}") for row, label in self.rows if row.motion]
        for motion, where in motions:
            try:
                motion.check(start, end)
            except ValueError as error:
                raise ValueError(f"{where}: {error}") from error

    def beside_jumps(self, instants: Array) -> Array:
        """Times just before those at which something jumps, others as they are [s].

        Args:
            instants: Times, shape (instants,) [s].
        """
        if not self.jumps.size:
            return instants
        at_jump = np.isin(instants, self.jumps)
        return np.where(at_jump, instants * (1.0 - BESIDE_JUMP), instants)

    def tabulate(self, instants: Array) -> dict[str, Any]:
        """Tables by name of the field of ModelArrays.

        At the very time of a jump they hold the values before it: a step may end there, and the
        stages of the one that begins there lie behind it.

        Args:
            instants: Times, shape (instants,) [s].

        Raises:
            ValueError: If a value is NaN or infinite, or a length is not positive; the message
                names the marker, the joint or the force.
        """
        instants = self.beside_jumps(instants)
        prescribed = []
        for marker, where in self.prescribed:
            table = np.zeros((instants.size, 3, 3))
            if isinstance(marker, Ground):
                table[:, 0] = *marker.position, marker.angle
            else:
                for axis, motion in enumerate(marker.motions):
                    table[:, :, axis] = tabulated(motion, instants, where).T
            prescribed.append(table)
        drives = [row.tabulate(instants, label) for row, label in self.rows]
        pulls = [element.tabulate(instants, label) for element, label in self.elements]
        return {
            "gravity": free_fall(self.mechanism, instants, 2),
            "prescribed": _stack(prescribed, (instants.size, 3, 3)),
            "drive": _stack(drives, (instants.size, 3)),
            "force_table": _stack(pulls, (instants.size, 3)),
        }


def free_fall(mechanism: Mechanism, instants: Array, dimension: int) -> Array:
    """Gravity less the acceleration of the ground, shape (instants, dimension) [m/s^2].

    Args:
        mechanism: The mechanism.
        instants: Times, shape (instants,) [s].
        dimension: 2 in the plane, 3 in space.

    Raises:
        ValueError: If a value is NaN or infinite.
    """
    fall = np.zeros((instants.size, dimension))
    for field, sign in (("gravity", 1.0), ("ground_acceleration", -1.0)):
        for axis, signal in enumerate(getattr(mechanism, field)[:dimension]):
            fall[:, axis] += sign * sample(signal, instants, f"{field} along {'xyz'[axis]}")
    return fall


def _stack(tables: Sequence[Array], shape: tuple[int, ...]) -> Array:
    """Tables side by side along a second axis, which may be empty."""
    if not tables:
        return np.zeros((shape[0], 0, *shape[1:]))
    return np.ascontiguousarray(np.stack(tables, axis=1))
