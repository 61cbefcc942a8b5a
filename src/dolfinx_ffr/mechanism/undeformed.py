# SPDX-License-Identifier: MIT
"""Markers in the placements: positions and rotations that joints and forces leave open."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .initial_conditions import Placement
from .marker import BodyPoint, Ground, Marker, Pair, Triple
from .motion import sample
from .rotation import rotation_matrix, rotation_vector, upright_matrix

#: Components in which an axis of rotations is zero, by dimension.
_NO_AXES = {2: (0, 1), 3: ()}
#: Part of a rotation vector across an axis up to which it is one about the axis [rad].
_ALONG = 1e-6


def _twist(A: Array, B: Array, axis: Array) -> float:
    """Angle of axes A against axes B about a unit vector in B, within half a turn [rad]."""
    from scipy.spatial.transform import Rotation

    relative = Rotation.from_matrix(B.T @ A).as_quat()
    angle = 2.0 * np.arctan2(relative[:3] @ axis, relative[3])
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


@dataclass(frozen=True)
class Undeformed:
    """Where markers are in the placements, in space or in its plane of x and y."""

    placements: Mapping[str, Placement]  #: Start of every body, by name of the body.
    #: Positions of the markers in the frames of their bodies, shape (2,), in space (3,) [m].
    positions: Mapping[BodyPoint, Array]
    start: Array  #: Time of the start, shape (1,) [s].
    dimension: int = 2  #: 2 in the plane, 3 in space.
    #: Axes of markers in the frames of their bodies as columns, shape (3, 3), where they have any.
    marker_axes: Mapping[BodyPoint, Array] = field(default_factory=dict)
    user: str = "joint"  #: The joint or force that asks, for messages.
    #: Cache of the poses of markers of bodies.
    poses: dict[BodyPoint, tuple[Array, Array]] = field(default_factory=dict)
    #: Cache of moving markers in the plane and their angles [rad], by id of the marker.
    angles: dict[int, tuple[Marker, float]] = field(default_factory=dict)

    def of(self, user: str) -> Undeformed:
        """The same for another joint or force, which shares the caches."""
        return replace(self, user=user)

    def pose(self, marker: Marker) -> tuple[Array, Array]:
        """Position (3,) [m] of a marker, and its axes as columns (3, 3)."""
        if not isinstance(marker, tuple):
            tables = marker.tabulate_in_space(self.start, self.user)
            return tables[0, 0, 0], tables[0, 0, 1:].T
        if marker not in self.poses:
            placement, own = self.placements[marker[0]], self.marker_axes.get(marker)
            given, position = placement.rotation, np.zeros(3)
            position[: len(placement.position)] = placement.position
            A = upright_matrix(placement.angle) if given is None else rotation_matrix(given)
            local = self.positions[marker]
            position += A[:, : len(local)] @ local
            self.poses[marker] = position, A if own is None else A @ own
        return self.poses[marker]

    def position(self, marker: Marker) -> Array:
        """Position of a marker, shape (3,) [m]."""
        return self.pose(marker)[0]

    def axes(self, marker: Marker) -> Array:
        """Axes of a marker as columns, shape (3, 3)."""
        return self.pose(marker)[1]

    def seen_from(self, marker: Marker, other: Marker, components: Array | Triple) -> Array:
        """A direction given in the axes of another marker, in the axes of a marker, shape (3,)."""
        angle = self._in_plane(other, marker)
        if angle is not None:  # at a tenth of the time
            (x, y, z), c, s = components, math.cos(angle), math.sin(angle)
            return np.array([c * x - s * y, s * x + c * y, z])
        turned = self.axes(other) @ np.asarray(components, dtype=np.float64)
        return np.asarray(self.axes(marker).T @ turned)

    def twist(self, marker: Marker, other: Marker, axis: ArrayLike) -> float:
        """Angle of a marker against another about an axis in the axes of the other one [rad].

        It is the whole relative rotation if that is about the axis; else the remainder after the
        shortest rotation that aligns the axis. It is unwrapped where rotations are given as vectors
        along the axis, and for moving markers.
        """
        in_plane = self._in_plane(marker, other)
        if in_plane is not None:
            return in_plane
        own = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
        angle, n = _twist(self.axes(marker), self.axes(other), own), self.axes(other) @ own
        (here, A), (there, B) = self._turned(marker), self._turned(other)
        if max(np.linalg.norm(np.cross(turn, n)) for turn in (here, there)) > _ALONG:
            return angle
        counted = _twist(A, B, own) + float((here - there) @ n)
        return angle + 2.0 * np.pi * float(np.round((counted - angle) / (2.0 * np.pi)))

    def _in_plane(self, marker: Marker, other: Marker) -> float | None:
        """Angle of a marker's axes against another's in the plane, where it is all there is."""
        return self._angle(marker) - self._angle(other) if self.dimension == 2 else None

    def _angle(self, marker: Marker) -> float:
        """Angle of a marker's axes in the plane [rad]."""
        if isinstance(marker, tuple):
            return self.placements[marker[0]].angle
        if isinstance(marker, Ground):
            return marker.angle
        known, angle = self.angles.get(id(marker), (None, 0.0))
        if known is not marker:
            where = f"{self.user}, marker {marker.name!r}"
            angle = float(sample(marker.angle, self.start, where)[0])
            self.angles[id(marker)] = marker, angle
        return angle

    def _turned(self, marker: Marker) -> tuple[Array, Array]:
        """Unwrapped rotation vector of a marker (3,) [rad], and its axes before that rotation."""
        if isinstance(marker, tuple):
            own, given = self.marker_axes.get(marker), self.placements[marker[0]].rotation
        else:
            own, given = None, marker.rotation
        start = np.eye(3) if own is None else own
        turn = np.zeros(3)
        if given is not None and np.shape(given) == (3,):
            turn = rotation_vector(given)
        elif given is not None:
            start = rotation_matrix(given) @ start
        if not isinstance(marker, tuple):
            turn = turn + marker.turns_in_space(self.start, "the start")[0]
        return turn, start

    def distance(self, a: Marker, b: Marker, remedy: str) -> float:
        """Distance of two markers [m]; if they coincide, a ValueError with a remedy."""
        length = math.hypot(*(self.position(a) - self.position(b)))
        if not length > 0.0:
            raise ValueError(f"{self.user}: the markers coincide in the placements; {remedy}")
        return length

    def line(self, direction: Pair | Triple) -> Triple:
        """Direction of a line in three components; a ValueError if the plane is given three."""
        if len(direction) > self.dimension:
            raise ValueError(
                f"{self.user}: the direction of the line has three components, but the bodies are "
                "in the plane"
            )
        x, y, z = (*direction, 0.0)[:3]
        return x, y, z

    def turning(self, components: Sequence[Any]) -> list[Any]:
        """Of three components those about axes that there are, z alone in the plane."""
        return [part for k, part in enumerate(components) if k not in _NO_AXES[self.dimension]]

    def axis(self, axis: Triple) -> Triple:
        """The axis itself; a ValueError if it is not perpendicular to the plane of the bodies."""
        if any(axis[k] for k in _NO_AXES[self.dimension]):
            raise ValueError(
                f"{self.user}: the axis is perpendicular to the plane in which the bodies are, but "
                f"it is {tuple(axis)}"
            )
        return axis
