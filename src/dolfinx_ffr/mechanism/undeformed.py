# SPDX-License-Identifier: MIT
"""Markers in the placements, and the rows between two markers that most joints consist of.

Where the plane has fewer rows than space, or others, this module knows it; joints do not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .initial_conditions import Placement
from .marker import BodyPoint, Ground, Marker, Pair, Triple, perpendicular
from .motion import sample
from .rotation import rotation_matrix, rotation_vector, upright_matrix
from .rows import BodyVector, Row, RowKind, direction, point

#: Components in which an axis of rotations is zero, by dimension.
_NO_AXES = {2: (0, 1), 3: ()}
#: Largest part of a rotation vector across an axis for which the rotation is about the axis [rad]
_ALONG = 1e-6
#: Axis of all rotations in the plane.
_UPRIGHT = (0.0, 0.0, 1.0)


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
    user: str = "joint"  #: The joint or force that uses it, for messages.
    #: Cache of the poses of markers of bodies.
    poses: dict[BodyPoint, tuple[Array, Array]] = field(default_factory=dict)
    #: Cache of moving markers in the plane and their angles [rad], by id of the marker.
    angles: dict[int, tuple[Marker, float]] = field(default_factory=dict)

    def of(self, user: str) -> Undeformed:
        """The placements for another joint or force, which shares the caches."""
        return replace(self, user=user)

    def pose(self, marker: Marker) -> tuple[Array, Array]:
        """Position (3,) [m] of a marker, and its axes as columns (3, 3)."""
        if not isinstance(marker, tuple):
            tables = marker.tabulate_in_space(self.start, self.user)
            return tables[0, 0, 0], tables[0, 0, 1:].T
        if marker not in self.poses:
            placement, marker_axes = self.placements[marker[0]], self.marker_axes.get(marker)
            rotation, position = placement.rotation, np.zeros(3)
            position[: len(placement.position)] = placement.position
            A = upright_matrix(placement.angle) if rotation is None else rotation_matrix(rotation)
            local = self.positions[marker]
            position += A[:, : len(local)] @ local
            self.poses[marker] = position, A if marker_axes is None else A @ marker_axes
        return self.poses[marker]

    def position(self, marker: Marker) -> Array:
        """Position of a marker, shape (3,) [m]."""
        return self.pose(marker)[0]

    def axes(self, marker: Marker) -> Array:
        """Axes of a marker as columns, shape (3, 3)."""
        return self.pose(marker)[1]

    def seen_from(self, marker: Marker, other: Marker, components: Array | Triple) -> Array:
        """The components in the axes of a marker of a direction given in another's, shape (3,)."""
        angle = self._in_plane(other, marker)
        if angle is not None:  # takes a tenth of the time of the matrices
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
        unit_axis = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
        angle = _twist(self.axes(marker), self.axes(other), unit_axis)
        n = self.axes(other) @ unit_axis
        (turn_a, A), (turn_b, B) = self._turned(marker), self._turned(other)
        if max(np.linalg.norm(np.cross(turn, n)) for turn in (turn_a, turn_b)) > _ALONG:
            return angle
        counted = _twist(A, B, unit_axis) + float((turn_a - turn_b) @ n)
        return angle + 2.0 * np.pi * float(np.round((counted - angle) / (2.0 * np.pi)))

    def _in_plane(self, marker: Marker, other: Marker) -> float | None:
        """Angle of a marker's axes against another's in the plane [rad]; None in space."""
        return self._angle(marker) - self._angle(other) if self.dimension == 2 else None

    def _angle(self, marker: Marker) -> float:
        """Angle of a marker's axes in the plane [rad]."""
        if isinstance(marker, tuple):
            return self.placements[marker[0]].angle
        if isinstance(marker, Ground):
            return marker.angle
        cached, angle = self.angles.get(id(marker), (None, 0.0))
        if cached is not marker:
            user = f"{self.user}, marker {marker.name!r}"
            angle = float(sample(marker.angle, self.start, user)[0])
            self.angles[id(marker)] = marker, angle
        return angle

    def _turned(self, marker: Marker) -> tuple[Array, Array]:
        """Unwrapped rotation vector of a marker (3,) [rad], and its axes before that rotation."""
        if isinstance(marker, tuple):
            marker_axes = self.marker_axes.get(marker)
            rotation = self.placements[marker[0]].rotation
        else:
            marker_axes, rotation = None, marker.rotation
        start = np.eye(3) if marker_axes is None else marker_axes
        turn = np.zeros(3)
        if rotation is not None and np.shape(rotation) == (3,):
            turn = rotation_vector(rotation)
        elif rotation is not None:
            start = rotation_matrix(rotation) @ start
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
        """The components about existing axes of rotation: all three, in the plane z alone."""
        return [x for k, x in enumerate(components) if k not in _NO_AXES[self.dimension]]

    def axis(self, axis: Triple) -> Triple:
        """The axis itself; a ValueError if it is not perpendicular to the plane of the bodies."""
        if any(axis[k] for k in _NO_AXES[self.dimension]):
            raise ValueError(
                f"{self.user}: the axis is perpendicular to the plane in which the bodies are, but "
                f"it is {tuple(axis)}"
            )
        return axis


def coincidence(a: Marker, b: Marker, undeformed: Undeformed) -> list[Row]:
    """Rows of two markers at one point: two, in space three."""
    normals: tuple[Triple, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    ends = point(a), point(b)
    return [Row(RowKind.POINT, ends, n) for n in normals[: undeformed.dimension]]


def parallel(a: Marker, b: Marker, axis: Triple, undeformed: Undeformed) -> list[Row]:
    """Rows of an axis, in the axes of b, that both markers share as in the placements: two.

    With e_1 x e_2 the axis, the multipliers are moments about e_1 and e_2, as the rows hold the
    axis of the first marker perpendicular to -e_2 and e_1. In the plane there are no such rows; a
    ValueError refuses an axis that is not perpendicular to it.
    """
    axis = undeformed.axis(axis)
    if undeformed.dimension == 2:
        return []
    axis_of_a, (e_1, e_2) = direction(a, undeformed.seen_from(a, b, axis)), perpendicular(axis)
    return [Row(RowKind.DOT, (axis_of_a, direction(b, e))) for e in (-e_2, e_1)]


def aligned(
    a: Marker, b: Marker, axis: Triple, undeformed: Undeformed, angle: float | None = None
) -> list[Row]:
    """Rows that keep the relative rotation of two markers as placed: one, in space three.

    The multipliers are moments about e_1, e_2 and the axis (in the axes of b), in the plane about
    z. An angle, in the plane alone, takes the place of the angle in the placements [rad].
    """
    if undeformed.dimension == 2:
        constant = 0.0 if angle is None else angle
        return [relative_angle(a, b, _UPRIGHT, undeformed, angle is not None, constant=constant)]
    if angle is not None:
        raise ValueError(
            f"{undeformed.user}: in space the placements give the relative rotation; leave "
            "the angle out"
        )
    e_1, e_2 = perpendicular(axis)
    e_1_of_a = direction(a, undeformed.seen_from(a, b, e_1))
    return [*parallel(a, b, axis, undeformed), Row(RowKind.DOT, (e_1_of_a, direction(b, e_2)))]


def on_plane(a: Marker, b: Marker, normal: ArrayLike) -> Row:
    """Row of marker a on a plane through b, in the plane a line, with a normal in b's axes."""
    return Row(RowKind.PLANE, (point(a), point(b), direction(b, normal)))


def on_line(a: Marker, b: Marker, line: Pair | Triple, undeformed: Undeformed) -> list[Row]:
    """Rows of marker a on a line through b, with a direction in b's axes: one, in space two."""
    along = undeformed.line(line)
    if undeformed.dimension == 2:
        return [on_plane(a, b, (-along[1], along[0], 0.0))]
    return [on_plane(a, b, e) for e in perpendicular(along)]


def turning(
    a: Marker, b: Marker, axis: Triple, undeformed: Undeformed, angle: float = 0.0
) -> tuple[BodyVector, BodyVector, BodyVector]:
    """Directions of an ANGLE row of marker a about an axis of b, at an angle in the placements.

    In the plane a ValueError refuses an axis that is not perpendicular to it.
    """
    e_1, e_2 = perpendicular(undeformed.axis(axis))
    now = math.cos(angle) * e_1 + math.sin(angle) * e_2
    start_direction = direction(a, undeformed.seen_from(a, b, now))
    return start_direction, direction(b, e_1), direction(b, e_2)


def relative_angle(
    a: Marker,
    b: Marker,
    axis: Triple,
    undeformed: Undeformed,
    counted: bool = True,
    **right_hand_side: Any,
) -> Row:
    """The row of the angle of marker a against marker b, about an axis given in the axes of b.

    If ``counted``, the angle is unwrapped, and zero where the axes of the markers agree but for a
    rotation about the axis; else the angle is zero in the placements. The ``right_hand_side`` has
    the fields ``constant`` and ``motion`` of `Row`.
    """
    angle = undeformed.twist(a, b, undeformed.axis(axis)) if counted else 0.0
    vectors = turning(a, b, axis, undeformed, angle)
    return Row(RowKind.ANGLE, vectors, start_angle=angle, **right_hand_side)
