# SPDX-License-Identifier: MIT
"""Joints of a planar mechanism.

Each joint is one to three scalar constraint equations between two markers, its rows. The
multipliers of the rows are the forces of the joint, :meth:`Trajectory.joint_force`.

A joint is all that is known about it: a new one derives from :class:`Joint`, with its markers, its
rows and, where a pin is not what it looks like, its symbols.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

from .. import validation
from .connection import Connection
from .marker import Ground, Marker, Pair
from .motion import Motion
from .rows import Row, RowKind, Undeformed
from .symbols import Line, Pin, Slider, Square, Symbol

__all__ = [
    "Distance",
    "Gear",
    "Joint",
    "LinearDrive",
    "PointOnLine",
    "PrescribedAngle",
    "PrescribedPosition",
    "Revolute",
    "Translational",
    "Weld",
]


@dataclass(frozen=True)
class Joint(Connection):
    """What all joints have in common."""

    kind: ClassVar[str] = "joint"
    #: Whether its markers cannot move against each other.
    rigid: ClassVar[bool] = False

    @property
    def markers(self) -> tuple[Marker, Marker]:
        raise NotImplementedError

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        """The scalar constraint equations of the joint.

        Args:
            label: Its name, for messages.
            undeformed: Settles what the joint leaves to the placements.

        Raises:
            ValueError: If its markers coincide where they must not.
        """
        raise NotImplementedError

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Pin(self.markers),)


@dataclass(frozen=True)
class _Between(Joint):
    """A joint between two markers."""

    #: First marker.
    a: Marker
    #: Second marker.
    b: Marker

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.a, self.b


@dataclass(frozen=True)
class Revolute(_Between):
    """Two markers coincide: r_a - r_b = 0, two rows."""

    #: Name for results and messages.
    name: str = ""

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        return _coincidence(self.a, self.b)


@dataclass(frozen=True)
class Weld(_Between):
    """Two markers coincide and keep their relative angle: three rows."""

    #: Angle of the first marker minus that of the second [rad]; None takes that of the placements.
    angle: float | None = None
    #: Name for results and messages.
    name: str = ""

    rigid: ClassVar[bool] = True

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        return [*_coincidence(self.a, self.b), _angle(self.angle, self.a, self.b, undeformed)]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Square(self.markers),)

    def _check(self, what: str) -> None:
        _check_angle(what, self.angle)


@dataclass(frozen=True)
class PointOnLine(Joint):
    """A point stays on a line through another marker, a slider joint: one row.

    The line is fixed to the axes of its marker and turns with them.
    """

    #: Marker of the point.
    point: Marker
    #: Marker through which the line passes.
    line: Marker
    #: Direction of the line in the axes of its marker, of any length.
    direction: Pair = (1.0, 0.0)
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.point, self.line

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        return [_line(self.point, self.line, self.direction)]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Slider(self.markers, self.direction),)

    def _check(self, what: str) -> None:
        _check_direction(what, self.direction)


@dataclass(frozen=True)
class Translational(_Between):
    """A sliding joint that keeps the relative angle: two rows.

    The first marker stays on a line through the second, which is fixed to the axes of the second
    and turns with them, and its angle against the second does not change.
    """

    #: Direction of the line in the axes of the second marker, of any length.
    direction: Pair = (1.0, 0.0)
    #: Angle of the first marker minus that of the second [rad]; None takes that of the placements.
    angle: float | None = None
    #: Name for results and messages.
    name: str = ""

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        line = _line(self.a, self.b, self.direction)
        return [line, _angle(self.angle, self.a, self.b, undeformed)]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Slider(self.markers, self.direction),)

    def _check(self, what: str) -> None:
        _check_direction(what, self.direction)
        _check_angle(what, self.angle)


@dataclass(frozen=True)
class Gear(_Between):
    """The angle of a marker follows that of another, angle_a - ratio angle_b = constant: one row.

    The constant is that of the placements. Wheels with z_a and z_b teeth that mesh from outside
    have the ratio -z_b / z_a, an inner gearing and a belt have z_b / z_a; the first marker is on
    the driven wheel, say. The bearings of the wheels are joints of their own.
    """

    #: Speed of the first marker over that of the second, negative if they turn in opposite senses.
    ratio: float
    #: Name for results and messages.
    name: str = ""

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        return [_angle(None, self.a, self.b, undeformed, self.ratio)]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return ()

    def _check(self, what: str) -> None:
        if validation.number(f"{what}: the ratio", self.ratio) == 0.0:
            raise ValueError(f"{what}: the ratio must be a number other than zero")


@dataclass(frozen=True)
class Distance(_Between):
    """The distance of two markers is constant or follows a motion, |r_a - r_b| = length: one row.

    A rod without mass between two pins, or a hydraulic cylinder of given stroke.
    """

    #: The distance [m], which must be positive; None takes that of the placements.
    length: float | Motion | None = None
    #: Name for results and messages.
    name: str = ""

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        if isinstance(self.length, Motion):
            return [Row(RowKind.DISTANCE, self.a, self.b, motion=self.length)]
        length = self.length
        if length is None:
            what, remedy = f"joint {label!r}", "a Revolute joins them"
            length = undeformed.distance(self.a, self.b, what, remedy)
        return [Row(RowKind.DISTANCE, self.a, self.b, constant=length)]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Pin(self.markers), Line(self.markers))

    def _check(self, what: str) -> None:
        if self.length is None or isinstance(self.length, Motion):
            return
        if not validation.number(f"{what}: the length", self.length) > 0.0:
            raise ValueError(
                f"{what}: the length must be positive, but it is {self.length} m; markers that "
                "coincide are joined by a Revolute"
            )


@dataclass(frozen=True)
class PrescribedAngle(Joint):
    """The angle of a marker, against another marker or the ground, follows a motion: one row."""

    #: Marker whose angle is prescribed.
    marker: Marker
    #: Motion of the angle [rad].
    motion: Motion
    #: Marker against which the angle counts.
    relative_to: Marker = field(default_factory=Ground)
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.marker, self.relative_to

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        return [Row(RowKind.ANGLE, self.marker, self.relative_to, motion=self.motion)]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return ()

    def _check(self, what: str) -> None:
        _check_motion(what, self.motion)


@dataclass(frozen=True)
class PrescribedPosition(Joint):
    """The position of a marker along a global axis follows a motion: one row."""

    #: Marker whose position is prescribed.
    marker: Marker
    #: Global axis, "x" or "y".
    axis: Literal["x", "y"]
    #: Motion of the position [m].
    motion: Motion
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.marker, Ground()

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        kind = RowKind.X if self.axis == "x" else RowKind.Y
        return [Row(kind, *self.markers, motion=self.motion)]

    def _check(self, what: str) -> None:
        validation.choice(f"{what}: the axis", self.axis, ("x", "y"))
        _check_motion(what, self.motion)


@dataclass(frozen=True)
class LinearDrive(Joint):
    """A linear motor or a spindle: how far a marker is along a line follows a motion, one row.

    The line passes through another marker and turns with its axes; the way counts from there. The
    drive alone leaves the marker free to move across the line, which a :class:`Translational` or a
    :class:`PointOnLine` in the same direction prevents.
    """

    #: Marker that is driven.
    point: Marker
    #: Marker from which the way counts.
    line: Marker
    #: Motion of the way [m], negative against the direction.
    motion: Motion
    #: Direction of the line in the axes of its marker, of any length.
    direction: Pair = (1.0, 0.0)
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.point, self.line

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        # The way along a line is the distance from the line across it.
        x, y = self.direction
        across = _line(self.point, self.line, (y, -x))
        return [replace(across, motion=self.motion)]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Line(self.markers),)

    def _check(self, what: str) -> None:
        _check_direction(what, self.direction)
        _check_motion(what, self.motion)


def _coincidence(a: Marker, b: Marker) -> list[Row]:
    """Two markers at one point."""
    return [Row(kind, a, b) for kind in (RowKind.X, RowKind.Y)]


def _line(point: Marker, line: Marker, direction: Pair) -> Row:
    """A marker on a line through another."""
    length = math.hypot(*direction)
    normal = (-direction[1] / length, direction[0] / length)
    return Row(RowKind.LINE, point, line, normal)


def _angle(
    given: float | None, a: Marker, b: Marker, undeformed: Undeformed, ratio: float = 1.0
) -> Row:
    """A relative angle that is given, or that of the placements."""
    if given is None:
        given = undeformed.angle(a) - ratio * undeformed.angle(b)
    return Row(RowKind.ANGLE, a, b, ratio=ratio, constant=given)


def _check_motion(what: str, motion: object) -> None:
    needed = "a Motion (Motion.constant(...) where the coordinate is held)"
    validation.instance(f"{what}: the motion", motion, Motion, needed)


def _check_direction(what: str, direction: Pair) -> None:
    if (
        not math.hypot(*validation.plane_vector(f"{what}: the direction of the line", direction))
        > 0.0
    ):
        raise ValueError(f"{what}: the direction of the line must not be zero")


def _check_angle(what: str, angle: float | None) -> None:
    if angle is not None:
        validation.number(f"{what}: the angle", angle)
