# SPDX-License-Identifier: MIT
"""Joints of a mechanism, in the plane and in space.

Each joint is one to six scalar constraint equations between two markers, its rows. The
multipliers of the rows are the forces of the joint, :meth:`Trajectory.joint_force`.

Most joints are joints in space as well, where bodies are: then directions have three components,
and axes count. Those that exist in space only stand in :mod:`.spatial_joints`.

A joint is all that is known about it: a new one derives from :class:`Joint`, with its markers, its
rows and, where a pin is not what it looks like, its symbols.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np

from .. import validation
from .connection import Connection
from .marker import Ground, Marker, Pair, Triple, axis_vector
from .motion import Motion
from .rows import Row, RowKind, Undeformed
from .spatial_parts import (
    aligned,
    coincidence,
    in_space,
    on_line,
    on_plane,
    parallel,
    turning,
)
from .spatial_rows import SpatialRow, SpatialRowKind, UndeformedInSpace, point
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

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        """The scalar constraint equations of the joint in space.

        Args:
            label: Its name, for messages.
            undeformed: Settles what the joint leaves to the placements.

        Raises:
            ValueError: If it is a joint in the plane only, if its markers coincide where they must
                not, or if an argument has no meaning in space.
        """
        raise ValueError(f"joint {label!r}: {type(self).__name__} is a joint in the plane only")

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
    """Two markers coincide: r_a - r_b = 0, two rows; in space also an axis, five rows.

    In space the axis stays that of the placements on the first body, too.
    """

    #: Name for results and messages.
    name: str = ""
    #: Axis in space, in the axes of the second marker and of any length.
    axis: Triple = (0.0, 0.0, 1.0)

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        _check_planar_axis(label, self.axis)
        return _coincidence(self.a, self.b)

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        return [*coincidence(self.a, self.b), *parallel(self.a, self.b, self.axis, undeformed)]

    def _check(self, what: str) -> None:
        axis_vector(f"{what}: the axis", self.axis)


@dataclass(frozen=True)
class Weld(_Between):
    """Two markers coincide and keep their relative angle: three rows, in space six.

    In space the relative rotation is that of the placements.
    """

    #: Angle of the first marker minus that of the second [rad]; None takes that of the placements.
    angle: float | None = None
    #: Name for results and messages.
    name: str = ""

    rigid: ClassVar[bool] = True

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        return [*_coincidence(self.a, self.b), _angle(self.angle, self.a, self.b, undeformed)]

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        _refuse_angle(label, self.angle)
        return [*coincidence(self.a, self.b), *aligned(self.a, self.b, (0, 0, 1), undeformed)]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Square(self.markers),)

    def _check(self, what: str) -> None:
        _check_angle(what, self.angle)


@dataclass(frozen=True)
class PointOnLine(Joint):
    """A point stays on a line through another marker, a slider joint: one row, in space two.

    The line is fixed to the axes of its marker and turns with them.
    """

    #: Marker of the point.
    point: Marker
    #: Marker through which the line passes.
    line: Marker
    #: Direction of the line in the axes of its marker, of any length; x, also in space.
    direction: Pair | Triple = (1.0, 0.0)
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.point, self.line

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        return [_line(self.point, self.line, _in_plane(label, self.direction))]

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        return on_line(self.point, self.line, in_space(self.direction))

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Slider(self.markers, self.direction),)

    def _check(self, what: str) -> None:
        _check_direction(what, self.direction)


@dataclass(frozen=True)
class Translational(_Between):
    """A sliding joint that keeps the relative angle: two rows, in space five (a prismatic joint).

    The first marker stays on a line through the second, which is fixed to the axes of the second
    and turns with them, and its angle against the second does not change. In space the relative
    rotation stays that of the placements.
    """

    #: Direction of the line in the axes of the second marker, of any length; x, also in space.
    direction: Pair | Triple = (1.0, 0.0)
    #: Angle of the first marker minus that of the second [rad]; None takes that of the placements.
    angle: float | None = None
    #: Name for results and messages.
    name: str = ""

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        line = _line(self.a, self.b, _in_plane(label, self.direction))
        return [line, _angle(self.angle, self.a, self.b, undeformed)]

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        _refuse_angle(label, self.angle)
        line = in_space(self.direction)
        rows = on_line(self.a, self.b, line)
        return [*rows, *aligned(self.a, self.b, line, undeformed)]

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
    the driven wheel, say. The bearings of the wheels are joints of their own. In space angles are
    those about axes that the ground holds.
    """

    #: Speed of the first marker over that of the second, negative if they turn in opposite senses.
    ratio: float
    #: Name for results and messages.
    name: str = ""
    #: Axis in space about which the first marker turns, in the global axes and of any length.
    axis: Triple = (0.0, 0.0, 1.0)
    #: Axis of the second one, likewise; None is that of the first.
    second_axis: Triple | None = None

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        axes = (self.axis, self.axis if self.second_axis is None else self.second_axis)
        pairs = zip((self.a, self.b), axes, strict=True)
        vectors = [v for marker, axis in pairs for v in turning(marker, Ground(), axis, undeformed)]
        return [SpatialRow(SpatialRowKind.GEAR, tuple(vectors), ratio=self.ratio)]

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        return [_angle(None, self.a, self.b, undeformed, self.ratio)]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return ()

    def _check(self, what: str) -> None:
        if validation.number(f"{what}: the ratio", self.ratio) == 0.0:
            raise ValueError(f"{what}: the ratio must be a number other than zero")
        axis_vector(f"{what}: the axis", self.axis)
        if self.second_axis is not None:
            axis_vector(f"{what}: the second axis", self.second_axis)


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

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        ends, length = (point(self.a), point(self.b)), self.length
        if isinstance(length, Motion):
            return [SpatialRow(SpatialRowKind.DISTANCE, ends, motion=length)]
        if length is None:
            what, remedy = f"joint {label!r}", "a Spherical joins them"
            length = undeformed.distance(self.a, self.b, what, remedy)
        return [SpatialRow(SpatialRowKind.DISTANCE, ends, constant=length)]

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
    """The angle of a marker, against another marker or the ground, follows a motion: one row.

    In space it is the angle about an axis, which a :class:`Revolute` or :class:`Cylindrical` holds:
    zero where the axes of the two markers agree but for a rotation of the axis.
    """

    #: Marker whose angle is prescribed.
    marker: Marker
    #: Motion of the angle [rad].
    motion: Motion
    #: Marker against which the angle counts.
    relative_to: Marker = field(default_factory=Ground)
    #: Name for results and messages.
    name: str = ""
    #: Axis in space, in the axes of the other marker and of any length.
    axis: Triple = (0.0, 0.0, 1.0)

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.marker, self.relative_to

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        _check_planar_axis(label, self.axis)
        return [Row(RowKind.ANGLE, self.marker, self.relative_to, motion=self.motion)]

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        vectors = turning(self.marker, self.relative_to, self.axis, undeformed, absolute=True)
        return [SpatialRow(SpatialRowKind.ANGLE, vectors, motion=self.motion)]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return ()

    def _check(self, what: str) -> None:
        _check_motion(what, self.motion)
        axis_vector(f"{what}: the axis", self.axis)


@dataclass(frozen=True)
class PrescribedPosition(Joint):
    """The position of a marker along a global axis follows a motion: one row."""

    #: Marker whose position is prescribed.
    marker: Marker
    #: Global axis, "x" or "y", in space also "z".
    axis: Literal["x", "y", "z"]
    #: Motion of the position [m].
    motion: Motion
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.marker, Ground()

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        if self.axis == "z":
            raise ValueError(f"joint {label!r}: there is no axis z in the plane")
        kind = RowKind.X if self.axis == "x" else RowKind.Y
        return [Row(kind, *self.markers, motion=self.motion)]

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        vectors = (point(self.marker), point(Ground()))
        x, y, z = (float(self.axis == name) for name in "xyz")
        return [SpatialRow(SpatialRowKind.POINT, vectors, (x, y, z), motion=self.motion)]

    def _check(self, what: str) -> None:
        validation.choice(f"{what}: the axis", self.axis, ("x", "y", "z"))
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
    #: Direction of the line in the axes of its marker, of any length; x, also in space.
    direction: Pair | Triple = (1.0, 0.0)
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.point, self.line

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        # The way along a line is the distance from the line across it.
        x, y = _in_plane(label, self.direction)
        across = _line(self.point, self.line, (y, -x))
        return [replace(across, motion=self.motion)]

    def spatial_rows(self, label: str, undeformed: UndeformedInSpace) -> list[SpatialRow]:
        return [
            replace(on_plane(self.point, self.line, in_space(self.direction)), motion=self.motion)
        ]

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


def _in_plane(label: str, direction: Pair | Triple) -> Pair:
    """A direction in the plane."""
    if len(direction) == 3:
        raise ValueError(
            f"joint {label!r}: the direction of the line has three components, but the bodies are "
            "in the plane"
        )
    return direction


def _check_planar_axis(label: str, axis: Triple) -> None:
    """Refuse an axis that is not perpendicular to the plane."""
    if axis[0] or axis[1]:
        raise ValueError(
            f"joint {label!r}: the axis is perpendicular to the plane in which the bodies are, but "
            f"it is {tuple(axis)}"
        )


def _refuse_angle(label: str, angle: float | None) -> None:
    """Refuse an angle where a rotation would be needed."""
    if angle is not None:
        raise ValueError(
            f"joint {label!r}: in space the relative rotation is that of the placements; leave the "
            "angle out"
        )


def _check_direction(what: str, direction: Pair | Triple) -> None:
    if np.shape(direction) == (3,):
        axis_vector(f"{what}: the direction of the line", direction)
        return
    plane = validation.plane_vector(f"{what}: the direction of the line", direction)
    if not math.hypot(*plane) > 0.0:
        raise ValueError(f"{what}: the direction of the line must not be zero")


def _check_angle(what: str, angle: float | None) -> None:
    if angle is not None:
        validation.number(f"{what}: the angle", angle)
