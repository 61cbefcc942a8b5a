# SPDX-License-Identifier: MIT
"""Joints as scalar constraint equations, and forces as springs against rows and loads on vectors.

Both are put together from vectors that are fixed to markers. A vector is a point of a marker, or a
direction in its axes,

    s = delta R + A b(q),

and a row is one equation

    g(s_1, s_2, ...) = constant + motion(t)

of at most three of them, six for a gear, in the plane and in space alike: the plane has x and y.
The compiled kernels know a few kinds of g; a joint is put together from rows of these kinds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .marker import Marker, Triple
from .motion import Motion, Signal, is_zero, sample, tabulated


class VectorKind(IntEnum):
    """The meaning of a vector for its marker."""

    POINT = 0  #: Its position.
    DIRECTION = 1  #: A direction in its axes, which turns with it.
    SPIN = 2  #: Its angular velocity; on which moments alone act.


class RowKind(IntEnum):
    """The function g of a row, of the vectors s_1, s_2, ..."""

    POINT = 0  #: n . (s_1 - s_2), n fixed in the global axes; in the plane n is x or y.
    DOT = 1  #: s_1 . s_2, in space only.
    PLANE = 2  #: (s_1 - s_2) . s_3; in the plane s_2 and s_3 are of one marker.
    DISTANCE = 3  #: Length of s_1 - s_2, which must be positive.
    ANGLE = 4  #: Angle from s_2 to s_1 about s_2 x s_3, atan2(s_1 . s_3, s_1 . s_2).
    GEAR = 5  #: Angle of the first three less ratio times angle of the last three.
    #: Of two directions of wheels, their centres and two directions d, e: n_1 and n_2 times the
    #: angles of the wheels from the line of centres about d x e, plus ratio times the logarithm of
    #: its length.
    MESH = 6


@dataclass(frozen=True)
class BodyVector:
    """A vector fixed to a marker: its position, a direction in its axes, or its spin."""

    marker: Marker
    kind: VectorKind = VectorKind.POINT  #: Which of these three it is.
    components: Triple = (0.0, 0.0, 0.0)  #: Components of a direction in the marker's axes.


def point(marker: Marker) -> BodyVector:
    """The position of a marker."""
    return BodyVector(marker)


def direction(marker: Marker, components: ArrayLike) -> BodyVector:
    """The unit vector along three components in the axes of a marker."""
    x, y, z = np.asarray(components, dtype=np.float64).tolist()
    size = math.sqrt(x * x + y * y + z * z)
    return BodyVector(marker, VectorKind.DIRECTION, (x / size, y / size, z / size))


@dataclass(frozen=True)
class Row:
    """One scalar constraint g(s_1, s_2, ...) = constant + motion(t)."""

    kind: RowKind  #: The function g.
    vectors: tuple[BodyVector, ...]  #: The vectors s_1, s_2, ...
    #: Unit vector of POINT, in the global axes; lever arms n_1 and n_2 of MESH [m].
    normal: Triple = (0.0, 0.0, 0.0)
    ratio: float = 1.0  #: Factor of the second angle of GEAR, of the logarithm of MESH [m].
    #: Unwrapped angle of ANGLE in the placements [rad]; 0 for GEAR and MESH.
    start_angle: float = 0.0
    constant: float = 0.0  #: Constant part of the right-hand side [m or rad].
    motion: Motion | None = None  #: Part of the right-hand side over time [m or rad].

    @property
    def angular(self) -> bool:
        """Whether g is an angle, so that the multiplier is a moment."""
        return self.kind in (RowKind.DOT, RowKind.ANGLE, RowKind.GEAR)

    @property
    def counts_angles(self) -> bool:
        """Whether g contains angles of markers."""
        return self.kind in (RowKind.ANGLE, RowKind.GEAR, RowKind.MESH)

    def tabulate(self, instants: Array, label: str) -> Array:
        """Right-hand side and its two derivatives at times (instants,), shape (instants, 3)."""
        table = np.zeros((instants.size, 3))
        if self.motion is not None:
            table += tabulated(self.motion, instants, f"joint {label!r}").T
        table[:, 0] += self.constant
        if self.kind == RowKind.DISTANCE and not np.min(table[:, 0]) > 0.0:
            k = int(np.argmax(~(table[:, 0] > 0.0)))
            raise ValueError(
                f"joint {label!r}: the length must be positive at all times, but it is "
                f"{table[k, 0]:.6g} m at t = {instants[k]:.6g} s"
            )
        return table


@dataclass(frozen=True)
class SpringRow:
    """A spring and a damper: the force stiffness (g - rest) + damping g' against a row's g."""

    row: Row
    stiffness: float  #: Stiffness [N/m or N m/rad].
    damping: float  #: Damping [N s/m or N m s/rad].
    rest: Signal = 0.0  #: Value of g without force [m or rad].

    def tabulate(self, instants: Array, label: str) -> Array:
        """Value without force, shape (instants, 3), with zeros for its derivatives."""
        table = np.zeros((instants.size, 3))
        if not is_zero(self.rest):
            quantity = "angle" if self.row.angular else "length"
            table[:, 0] = sample(self.rest, instants, f"force {label!r}: {quantity}")
        if self.row.kind == RowKind.DISTANCE and np.min(table[:, 0]) < 0.0:
            raise ValueError(
                f"force {label!r}: the length must not be negative, but it is "
                f"{table[:, 0].min():g} m"
            )
        return table


@dataclass(frozen=True)
class Load:
    """A force on a point, or a moment on a marker's spin, given over time."""

    target: BodyVector  #: The point, or the spin.
    #: Components over time [N or N m]: global ones, or along the axes below.
    components: tuple[Signal, Signal, Signal]
    axes: tuple[BodyVector, ...] = ()  #: Directions of the components; empty for the global axes.

    def tabulate(self, instants: Array, label: str) -> Array:
        """Components over time, shape (instants, 3)."""
        quantity = "moment about " if self.target.kind == VectorKind.SPIN else ""
        table = np.zeros((instants.size, 3))
        for k, signal in enumerate(self.components):
            if not is_zero(signal):
                table[:, k] = sample(signal, instants, f"force {label!r}: {quantity}{'xyz'[k]}")
        return table


@dataclass(frozen=True)
class Element:
    """The springs and loads that make up a force of a mechanism."""

    springs: tuple[SpringRow, ...] = ()
    loads: tuple[Load, ...] = ()
