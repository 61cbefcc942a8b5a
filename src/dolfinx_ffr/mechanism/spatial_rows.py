# SPDX-License-Identifier: MIT
"""Joints and forces in space, put together from vectors that are fixed to markers.

A vector is a point of a marker, or a direction in its axes,

    s = delta R + A b(q),

and a row is a scalar function g of at most three of them, six for a gear. The compiled kernels know
a few kinds of g; a joint is put together from rows of these kinds, a spring is one with a law.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .initial_conditions import Placement
from .marker import BodyPoint, Marker, Triple
from .motion import Motion, Signal, right_hand_side, sample
from .rotation import rotation_matrix

__all__ = [
    "BodyVector",
    "SpatialElement",
    "SpatialLoad",
    "SpatialRow",
    "SpatialRowKind",
    "SpatialSpring",
    "UndeformedInSpace",
    "VectorKind",
    "direction",
    "point",
]

Array = NDArray[np.float64]


class VectorKind(IntEnum):
    """What a vector is of its marker."""

    #: Its position.
    POINT = 0
    #: A direction in its axes, which turns with it.
    DIRECTION = 1
    #: Its angular velocity; of a moment, on which nothing else depends.
    SPIN = 2


class SpatialRowKind(IntEnum):
    """The function g of a row, of the vectors s_1, s_2, ..."""

    #: n . (s_1 - s_2), n fixed in the global axes.
    POINT = 0
    #: s_1 . s_2.
    DOT = 1
    #: (s_1 - s_2) . s_3.
    PLANE = 2
    #: Length of s_1 - s_2, which must be positive.
    DISTANCE = 3
    #: Angle from s_2 to s_1 about s_2 x s_3, atan2(s_1 . s_3, s_1 . s_2).
    ANGLE = 4
    #: Angle of the first three less ratio times that of the last three.
    GEAR = 5


#: Rows that count angles: multipliers are moments.
ANGULAR = (SpatialRowKind.DOT, SpatialRowKind.ANGLE, SpatialRowKind.GEAR)


@dataclass(frozen=True)
class BodyVector:
    """A vector fixed to a marker."""

    #: The marker.
    marker: Marker
    #: What it is of the marker.
    kind: VectorKind = VectorKind.POINT
    #: Components of a direction in the marker's axes.
    components: Triple = (0.0, 0.0, 0.0)


def point(marker: Marker) -> BodyVector:
    """The position of a marker.

    Args:
        marker: The marker.
    """
    return BodyVector(marker)


def direction(marker: Marker, components: ArrayLike) -> BodyVector:
    """A direction in the axes of a marker.

    Args:
        marker: The marker.
        components: Its components, shape (3,), which become those of a unit vector.
    """
    n = np.asarray(components, dtype=np.float64)
    x, y, z = n / np.linalg.norm(n)
    return BodyVector(marker, VectorKind.DIRECTION, (float(x), float(y), float(z)))


@dataclass(frozen=True)
class SpatialRow:
    """One scalar constraint g(s_1, s_2, ...) = constant + motion(t)."""

    #: The function g.
    kind: SpatialRowKind
    #: Its vectors.
    vectors: tuple[BodyVector, ...]
    #: Unit vector of POINT, in the global axes.
    normal: Triple = (0.0, 0.0, 0.0)
    #: Factor of the second angle of GEAR.
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
        length = self.kind == SpatialRowKind.DISTANCE
        return right_hand_side(self.motion, self.constant, instants, label, positive=length)


@dataclass(frozen=True)
class SpatialSpring:
    """A spring and a damper: the force stiffness (g - rest) + damping g' against a row's g."""

    #: The function g.
    row: SpatialRow
    #: Stiffness [N/m or N m/rad].
    stiffness: float
    #: Damping [N s/m or N m s/rad].
    damping: float
    #: Value of g without force [m or rad].
    rest: Signal = 0.0

    @property
    def signals(self) -> tuple[Signal, ...]:
        """What is given over time."""
        return (self.rest,)

    def tabulate(self, instants: Array, label: str) -> Array:
        """Value without force, shape (instants, 3), with zeros for its derivatives.

        Args:
            instants: Times, shape (instants,) [s].
            label: Name of the force, for messages.

        Raises:
            ValueError: If an entry is NaN or infinite, or a length negative.
        """
        table = np.zeros((instants.size, 3))
        angular = self.row.kind in ANGULAR
        what = f"force {label!r}: {'angle' if angular else 'length'}"
        table[:, 0] = sample(self.rest, instants, what)
        if self.row.kind == SpatialRowKind.DISTANCE and np.min(table[:, 0]) < 0.0:
            raise ValueError(
                f"force {label!r}: the length must not be negative, but it is "
                f"{table[:, 0].min():g} m"
            )
        return table


@dataclass(frozen=True)
class SpatialLoad:
    """A force on a point, or a moment on a marker's spin, given over time."""

    #: The point, or the spin.
    target: BodyVector
    #: Components over time [N or N m]: global ones, or along the axes below.
    components: tuple[Signal, Signal, Signal]
    #: Directions of the components; none where they are those of the global axes.
    axes: tuple[BodyVector, ...] = ()

    @property
    def signals(self) -> tuple[Signal, ...]:
        """What is given over time."""
        return self.components

    def tabulate(self, instants: Array, label: str) -> Array:
        """Components over time, shape (instants, 3).

        Args:
            instants: Times, shape (instants,) [s].
            label: Name of the force, for messages.

        Raises:
            ValueError: If an entry is NaN or infinite.
        """
        return np.stack(
            [
                sample(signal, instants, f"force {label!r}: {name}")
                for name, signal in zip("xyz", self.components, strict=True)
            ],
            axis=1,
        )


@dataclass(frozen=True)
class SpatialElement:
    """A force of a mechanism in space: springs, loads, or both."""

    #: Its springs.
    springs: tuple[SpatialSpring, ...] = ()
    #: Its loads.
    loads: tuple[SpatialLoad, ...] = ()


@dataclass(frozen=True)
class UndeformedInSpace:
    """Where markers are in the placements, which settles what joints leave to them."""

    #: Start of every body, by name of the body.
    placements: Mapping[str, Placement]
    #: Positions of the markers in the frames of their bodies, shape (3,) [m].
    positions: Mapping[BodyPoint, Array]
    #: Time of the start, shape (1,) [s].
    start: Array
    #: Axes of markers in the frames of their bodies as columns, shape (3, 3), where they have any.
    marker_axes: Mapping[BodyPoint, Array] = field(default_factory=dict)

    def pose(self, marker: Marker) -> tuple[Array, Array]:
        """Position (3,) [m] of a marker, and its axes as columns (3, 3).

        Args:
            marker: The marker.
        """
        if isinstance(marker, tuple):
            position, rotation, *_ = self.placements[marker[0]].in_space
            A = rotation_matrix(rotation)
            own = self.marker_axes.get(marker)
            return position + A @ self.positions[marker], A if own is None else A @ own
        tables = marker.tabulate_in_space(self.start, "the start")
        return tables[0, 0, 0], tables[0, 0, 1:].T

    def position(self, marker: Marker) -> Array:
        """Position of a marker, shape (3,) [m].

        Args:
            marker: The marker.
        """
        return self.pose(marker)[0]

    def axes(self, marker: Marker) -> Array:
        """Axes of a marker as columns, shape (3, 3).

        Args:
            marker: The marker.
        """
        return self.pose(marker)[1]

    def seen_from(self, marker: Marker, other: Marker, components: ArrayLike) -> Array:
        """A direction in the axes of another marker, in those of a marker, shape (3,).

        Args:
            marker: The marker in whose axes it is sought.
            other: The marker in whose axes it is given.
            components: Its components there, shape (3,).
        """
        turned = self.axes(other) @ np.asarray(components, dtype=np.float64)
        return np.asarray(self.axes(marker).T @ turned)

    def twist(self, marker: Marker, other: Marker, axis: ArrayLike) -> float:
        """Angle by which the axes of a marker are turned about an axis against those of another.

        It is the whole of their rotation where that is one about the axis; else what is left of it
        after the shortest rotation that turns the axis to where it is [rad].

        Args:
            marker: The marker.
            other: The other one.
            axis: The axis, in the axes of the other marker, shape (3,), of any length.
        """
        from scipy.spatial.transform import Rotation

        relative = Rotation.from_matrix(self.axes(other).T @ self.axes(marker)).as_quat()
        n = np.asarray(axis, dtype=np.float64)
        angle = 2.0 * np.arctan2(relative[:3] @ n / np.linalg.norm(n), relative[3])
        return float((angle + np.pi) % (2.0 * np.pi) - np.pi)

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
        length = float(np.linalg.norm(self.position(a) - self.position(b)))
        if not length > 0.0:
            raise ValueError(f"{what}: the markers coincide in the placements; {remedy}")
        return length
