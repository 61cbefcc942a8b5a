# SPDX-License-Identifier: MIT
"""Joints as scalar constraint equations, the rows of the constraint Jacobian.

A row is one equation

    g(z_a, z_b) = constant + motion(t)

of the coordinates z = (x, y, angle) of two markers. The compiled kernels know a few kinds of g; a
joint is put together from rows of these kinds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from .initial_conditions import Placement
from .marker import BodyPoint, Marker, Pair
from .motion import Motion, right_hand_side

__all__ = ["Row", "RowKind", "Undeformed"]

Array = NDArray[np.float64]


class RowKind(IntEnum):
    """What a row says; the first three are numbered as the coordinate of a marker."""

    #: x_a - ratio x_b.
    X = 0
    #: y_a - ratio y_b.
    Y = 1
    #: angle_a - ratio angle_b.
    ANGLE = 2
    #: Distance of a from a line through b, which is fixed to the axes of b.
    LINE = 3
    #: Distance of the two markers, which must be positive.
    DISTANCE = 4


@dataclass(frozen=True)
class Row:
    """One scalar constraint g(z_a, z_b) = constant + motion(t)."""

    #: The function g.
    kind: RowKind
    #: First marker.
    a: Marker
    #: Second marker.
    b: Marker
    #: Unit normal of the line, in the axes of the second marker; other kinds have none.
    normal: Pair = (0.0, 0.0)
    #: Factor of the second marker's coordinate in X, Y and ANGLE.
    ratio: float = 1.0
    #: Constant part of the right-hand side [m or rad].
    constant: float = 0.0
    #: Part of the right-hand side over time [m or rad].
    motion: Motion | None = None

    def tabulate(self, instants: Array, label: str) -> Array:
        """Right-hand side and its two derivatives, shape (instants, 3).

        Args:
            instants: Times, shape (instants,) [s].
            label: Name of the joint, for messages.

        Raises:
            ValueError: If a value is NaN or infinite, or a distance is not positive.
        """
        length = self.kind == RowKind.DISTANCE
        return right_hand_side(self.motion, self.constant, instants, label, positive=length)


@dataclass(frozen=True)
class Undeformed:
    """Where markers are in the placements, which settles lengths and angles that are not given."""

    #: Start of every body, by name of the body.
    placements: Mapping[str, Placement]
    #: Positions of the markers in the frames of their bodies, shape (2,) [m].
    positions: Mapping[BodyPoint, Array]
    #: Time of the start, shape (1,) [s].
    start: Array

    def angle(self, marker: Marker) -> float:
        """Angle of a marker's axes [rad].

        Args:
            marker: The marker.
        """
        if isinstance(marker, tuple):
            return self.placements[marker[0]].angle
        return float(marker.motions[2].tabulate(self.start)[0, 0])

    def position(self, marker: Marker) -> Array:
        """Position of a marker, shape (2,) [m].

        Args:
            marker: The marker.
        """
        if not isinstance(marker, tuple):
            return np.array([motion.tabulate(self.start)[0, 0] for motion in marker.motions[:2]])
        placement, (x, y) = self.placements[marker[0]], self.positions[marker]
        c, s = math.cos(placement.angle), math.sin(placement.angle)
        return np.array(placement.position) + np.array([c * x - s * y, s * x + c * y])

    def distance(self, a: Marker, b: Marker, what: str, remedy: str) -> float:
        """Distance of two markers that must not coincide [m].

        Args:
            a: First marker.
            b: Second marker.
            what: What needs the distance, for the message.
            remedy: What to do where they coincide, for the message.

        Raises:
            ValueError: If the markers coincide.
        """
        length = float(np.hypot(*(self.position(a) - self.position(b))))
        if not length > 0.0:
            raise ValueError(f"{what}: the markers coincide in the placements; {remedy}")
        return length
