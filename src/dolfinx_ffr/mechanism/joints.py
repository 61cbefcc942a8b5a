# SPDX-License-Identifier: MIT
"""Joints of a mechanism, in the plane and in space.

Each joint is one to six scalar constraint equations between two markers, its rows. The
multipliers of the rows are the forces of the joint, :meth:`Trajectory.joint_force`. Most joints
exist in the plane and in space; the last ones in this file exist in space only.

A new joint is one class that derives from :class:`Joint`: its markers, its rows and, where pictures
show something else than a pin, its symbols.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import ClassVar, Literal

import numpy as np

from .. import validation
from .connection import Connection, Line, Pin, Slider, Square, Symbol
from .marker import Ground, Marker, Pair, Triple, axis_vector
from .motion import Motion
from .rows import Row, RowKind, direction, point
from .undeformed import (
    Undeformed,
    aligned,
    coincidence,
    on_line,
    on_plane,
    parallel,
    relative_angle,
    turning,
)

#: The global axes.
_GROUND = Ground()
#: Joints of two markers at one point, by dimension
_PINS = {2: "Revolute", 3: "Spherical"}
#: Largest cosine of two axes that are perpendicular in rough placements
_ASKEW = 0.5


@dataclass(frozen=True)
class Joint(Connection):
    """Base class of all joints."""

    kind: ClassVar[str] = "joint"
    drawn: ClassVar[tuple[type[Symbol], ...]] = (Pin,)
    rigid: ClassVar[bool] = False  #: Whether its markers cannot move against each other.

    def rows(self, undeformed: Undeformed) -> list[Row]:
        """The scalar constraint equations of the joint, in the plane or in space.

        ``undeformed`` has the dimension and the placements, from which lengths and angles follow
        that the joint does not give. A ValueError refuses arguments without meaning there.
        """
        raise NotImplementedError

    def _check(self, what: str) -> None:
        """Check the fields that are declared as directions, motions or numbers."""
        for member in fields(self):
            value, field_label = (
                getattr(self, member.name),
                f"{what}: the {member.name.replace('_', ' ')}",
            )
            if member.type == "Motion":
                needed = "a Motion (Motion.constant(...) where the coordinate is held)"
                validation.instance(field_label, value, Motion, needed)
            elif member.type == "float | None" and value is not None:
                validation.number(field_label, value)
            elif member.type == "Pair | Triple" and np.shape(value) != (3,):
                validation.direction(
                    f"{field_label} of the line", value, 2, expected="two components"
                )
            elif member.type in ("Triple", "Triple | None", "Pair | Triple") and value is not None:
                axis_vector(field_label, value)


@dataclass(frozen=True)
class _Between(Joint):
    """A joint between two markers."""

    a: Marker  #: First marker.
    b: Marker  #: Second marker.


@dataclass(frozen=True)
class Revolute(_Between):
    """Two markers coincide: r_a - r_b = 0, two rows; in space also an axis, five rows.

    In space the axis has the same direction on the first body as in the placements.

    Attributes:
        a: First marker.
        b: Second marker.
        name: Name for results and messages.
        axis: Axis in space, in the axes of the second marker and of any length.
    """

    name: str = ""
    axis: Triple = (0.0, 0.0, 1.0)

    def rows(self, undeformed: Undeformed) -> list[Row]:
        shared = parallel(self.a, self.b, self.axis, undeformed)
        return [*coincidence(self.a, self.b, undeformed), *shared]


@dataclass(frozen=True)
class Weld(_Between):
    """Two markers coincide at a constant relative angle: three rows, in space six.

    In space the placements define the relative rotation.

    Attributes:
        a: First marker.
        b: Second marker.
        angle: Angle of the first marker minus angle of the second [rad]; None: as in the
            placements.
        name: Name for results and messages.
    """

    angle: float | None = None
    name: str = ""

    rigid: ClassVar[bool] = True
    drawn = (Square,)

    def rows(self, undeformed: Undeformed) -> list[Row]:
        fixed = aligned(self.a, self.b, (0.0, 0.0, 1.0), undeformed, self.angle)
        return [*coincidence(self.a, self.b, undeformed), *fixed]


@dataclass(frozen=True)
class PointOnLine(Joint):
    """A point stays on a line through another marker, a slider joint: one row, in space two.

    The line is fixed to the axes of its marker and turns with them.

    Attributes:
        point: Marker of the point.
        line: Marker through which the line passes.
        direction: Direction of the line in the axes of its marker, of any length; x, also in space.
        name: Name for results and messages.
    """

    point: Marker
    line: Marker
    direction: Pair | Triple = (1.0, 0.0)
    name: str = ""

    def rows(self, undeformed: Undeformed) -> list[Row]:
        return on_line(self.point, self.line, self.direction, undeformed)

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Slider(self.markers, self.direction),)


@dataclass(frozen=True)
class Translational(_Between):
    """A sliding joint with a constant relative angle: two rows, in space five (a prismatic joint).

    The first marker stays on a line through the second, which is fixed to the axes of the second
    and turns with them, and its angle against the second does not change. In space the placements
    define the relative rotation.

    Attributes:
        a: First marker.
        b: Second marker.
        direction: Direction of the line in the axes of the second marker, of any length; x, also in
            space.
        angle: Angle of the first marker minus angle of the second [rad]; None: as in the
            placements.
        name: Name for results and messages.
    """

    direction: Pair | Triple = (1.0, 0.0)
    angle: float | None = None
    name: str = ""

    def rows(self, undeformed: Undeformed) -> list[Row]:
        line = undeformed.line(self.direction)
        fixed = aligned(self.a, self.b, line, undeformed, self.angle)
        return [*on_line(self.a, self.b, self.direction, undeformed), *fixed]

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Slider(self.markers, self.direction),)


@dataclass(frozen=True)
class Gear(_Between):
    """Two toothed wheels that mesh: one turns with the other at a ratio, one row.

    The markers are at the centres of the wheels, whose bearings are joints of their own. Wheels
    with z_a and z_b teeth that mesh from outside have the ratio -z_b / z_a, a wheel in a ring has
    z_b / z_a. The teeth push at the pitch point, which divides the line of centres in the
    placements by the ratio, so that the bearings are loaded. Angles count from the line of centres,
    so the wheels may be on a carrier that turns; a ring that is at rest is a marker on the ground.

    The force is the same for both directions of load: on teeth with a pressure angle it pushes the
    wheels apart for one sign only. Take the angle of the sign that is needed where the load keeps
    its direction, and zero where it does not, for the mean of both flanks.

    Attributes:
        a: First marker.
        b: Second marker.
        ratio: Speed of the first wheel over speed of the second, on a carrier against it; negative
            if they mesh from outside, between 0 and 1 if the first is the ring, above 1 if the
            second is.
        name: Name for results and messages.
        pressure_angle: Angle of the force from the tangent of the pitch circles [rad]. Positive:
            teeth push apart where they turn the first wheel about the axis, and negative: where
            they turn it back.
        relative_to: Marker in whose axes the axis is given in space, as one of the carrier.
        axis: Axis in space, parallel to the axes of the wheels, in the axes of that marker
            and of any length.
    """

    ratio: float
    name: str = ""
    pressure_angle: float = 0.0
    relative_to: Marker = field(default_factory=Ground)
    axis: Triple = (0.0, 0.0, 1.0)

    drawn = ()

    def rows(self, undeformed: Undeformed) -> list[Row]:
        carrier, axis = self.relative_to, np.array(undeformed.axis(self.axis))
        axis = axis / np.linalg.norm(axis)
        line = undeformed.position(self.a) - undeformed.position(self.b)
        line = undeformed.axes(carrier).T @ line
        line = line - (line @ axis) * axis
        distance = float(np.linalg.norm(line))
        if not distance > 0.0:
            raise ValueError(
                f"{undeformed.user}: the centres of the wheels lie on one axis in the placements; "
                "an AngleCoupling couples shafts without teeth between them"
            )
        wheels = [
            direction(marker, undeformed.seen_from(marker, carrier, line))
            for marker in (self.a, self.b)
        ]
        lines = [direction(carrier, line), direction(carrier, np.cross(axis, line))]
        # a wheel in a ring has its pitch circle on one side of both centres
        lever = abs(distance / (1.0 - self.ratio)) * np.cos(self.pressure_angle)
        separating = -np.sign(self.ratio) * distance * np.sin(self.pressure_angle)
        return [
            Row(
                RowKind.MESH,
                (*wheels, point(self.a), point(self.b), *lines),
                normal=(float(lever), float(-self.ratio * lever), 0.0),
                ratio=float(separating),
                constant=float(separating * np.log(distance)),
            )
        ]

    def _check(self, what: str) -> None:
        super()._check(what)
        ratio = validation.number(f"{what}: the ratio", self.ratio)
        if ratio in (0.0, 1.0):
            raise ValueError(
                f"{what}: the ratio must be a number other than zero and one, but it is {ratio:g}; "
                "an AngleCoupling couples angles as a belt or a shaft does"
            )
        angle = validation.number(f"{what}: the pressure angle", self.pressure_angle)
        if not abs(angle) < 0.5 * np.pi:
            raise ValueError(
                f"{what}: the pressure angle must lie between -pi/2 and pi/2, in radians, but it "
                f"is {angle:g}; most wheels have math.radians(20)"
            )


@dataclass(frozen=True)
class AngleCoupling(_Between):
    """The angle of a marker follows another angle, angle_a - ratio angle_b = constant: one row.

    It is a pure couple of moments, which loads no bearing, as a gearbox whose housing carries the
    rest; a :class:`Gear` has the force between two wheels. The constant follows from the
    placements. In space the angles are about axes that are fixed to the marker that they count
    against.

    Attributes:
        a: First marker.
        b: Second marker.
        ratio: Speed of the first marker over speed of the second, negative if they turn oppositely.
        name: Name for results and messages.
        axis: Axis in space about which the first marker turns, in the axes of the marker against
            which angles count (the global axes by default) and of any length.
        second_axis: Axis of the second one, likewise; None is the axis of the first.
        relative_to: Marker against which both angles count, as one of a housing that turns.
    """

    ratio: float
    name: str = ""
    axis: Triple = (0.0, 0.0, 1.0)
    second_axis: Triple | None = None
    relative_to: Marker = field(default_factory=Ground)

    drawn = ()

    def rows(self, undeformed: Undeformed) -> list[Row]:
        axes = (self.axis, self.axis if self.second_axis is None else self.second_axis)
        pairs = zip((self.a, self.b), axes, strict=True)
        housing = self.relative_to
        vectors = [v for marker, axis in pairs for v in turning(marker, housing, axis, undeformed)]
        return [Row(RowKind.GEAR, tuple(vectors), ratio=self.ratio)]

    def _check(self, what: str) -> None:
        super()._check(what)
        if validation.number(f"{what}: the ratio", self.ratio) == 0.0:
            raise ValueError(f"{what}: the ratio must be a number other than zero")


@dataclass(frozen=True)
class Distance(_Between):
    """The distance of two markers is constant or follows a motion, |r_a - r_b| = length: one row.

    A rod without mass between two pins, or a hydraulic cylinder of given stroke.

    Attributes:
        a: First marker.
        b: Second marker.
        length: The distance [m], which must be positive; None: as in the placements.
        name: Name for results and messages.
    """

    length: float | Motion | None = None
    name: str = ""

    drawn = (Pin, Line)

    def rows(self, undeformed: Undeformed) -> list[Row]:
        ends, length = (point(self.a), point(self.b)), self.length
        if isinstance(length, Motion):
            return [Row(RowKind.DISTANCE, ends, motion=length)]
        if length is None:
            remedy = f"a {_PINS[undeformed.dimension]} joins them"
            length = undeformed.distance(self.a, self.b, remedy)
        return [Row(RowKind.DISTANCE, ends, constant=length)]

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

    In space it is the angle about an axis, which a :class:`Revolute` or :class:`Cylindrical` fixes:
    zero where the axes of the two markers agree but for a rotation of the axis.

    Attributes:
        marker: Marker whose angle is prescribed.
        motion: Motion of the angle [rad].
        relative_to: Marker against which the angle counts.
        name: Name for results and messages.
        axis: Axis in space, in the axes of the other marker and of any length.
    """

    marker: Marker
    motion: Motion
    relative_to: Marker = field(default_factory=Ground)
    name: str = ""
    axis: Triple = (0.0, 0.0, 1.0)

    drawn = ()

    def rows(self, undeformed: Undeformed) -> list[Row]:
        ends = self.marker, self.relative_to
        return [relative_angle(*ends, self.axis, undeformed, motion=self.motion)]


@dataclass(frozen=True)
class PrescribedPosition(Joint):
    """The position of a marker along a global axis follows a motion: one row.

    Attributes:
        marker: Marker whose position is prescribed.
        axis: Global axis, "x" or "y", in space also "z".
        motion: Motion of the position [m].
        name: Name for results and messages.
    """

    marker: Marker
    axis: Literal["x", "y", "z"]
    motion: Motion
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.marker, Ground()

    def rows(self, undeformed: Undeformed) -> list[Row]:
        x, y, z = (float(self.axis == name) for name in "xyz")
        ends = point(self.marker), point(_GROUND)
        return [Row(RowKind.POINT, ends, (x, y, z), motion=self.motion)]

    def _check(self, what: str) -> None:
        super()._check(what)
        validation.choice(f"{what}: the axis", self.axis, ("x", "y", "z"))


@dataclass(frozen=True)
class LinearDrive(Joint):
    """A linear motor or a spindle: the position of a marker along a line follows a motion, one row.

    The line passes through another marker, the origin of the position, and turns with its axes. The
    drive alone leaves the marker free to move across the line, which a :class:`Translational` or a
    :class:`PointOnLine` in the same direction prevents.

    Attributes:
        point: Marker that is driven.
        line: Marker at the origin of the position.
        motion: Motion of the position [m], negative against the direction.
        direction: Direction of the line in the axes of its marker, of any length; x, also in space.
        name: Name for results and messages.
    """

    point: Marker
    line: Marker
    motion: Motion
    direction: Pair | Triple = (1.0, 0.0)
    name: str = ""

    drawn = (Line,)

    def rows(self, undeformed: Undeformed) -> list[Row]:
        # The position along a line is the distance from the plane across it.
        across = on_plane(self.point, self.line, undeformed.line(self.direction))
        return [replace(across, motion=self.motion)]


@dataclass(frozen=True)
class Spherical(_Between):
    """Two markers coincide: r_a - r_b = 0, three rows.

    Attributes:
        a: First marker.
        b: Second marker.
        name: Name for results and messages.
    """

    name: str = ""

    dimension: ClassVar[int | None] = 3
    in_the_plane: ClassVar[str] = "a Revolute"

    def rows(self, undeformed: Undeformed) -> list[Row]:
        return coincidence(self.a, self.b, undeformed)


@dataclass(frozen=True)
class Universal(_Between):
    """A universal joint, or Hooke's: two markers coincide, and two axes stay perpendicular.

    Four rows. Each axis belongs to a fork: fixed to one of the bodies, while the other body turns
    about it.

    Attributes:
        a: First marker.
        b: Second marker.
        axis: Axis of the first marker's fork, in its axes and of any length.
        second_axis: Axis of the second marker's fork, in its axes and of any length.
        name: Name for results and messages.
    """

    axis: Triple = (0.0, 1.0, 0.0)
    second_axis: Triple = (0.0, 0.0, 1.0)
    name: str = ""

    dimension: ClassVar[int | None] = 3

    def rows(self, undeformed: Undeformed) -> list[Row]:
        axis_a = undeformed.axes(self.a) @ np.asarray(self.axis)
        axis_b = undeformed.axes(self.b) @ np.asarray(self.second_axis)
        cosine = float(axis_a @ axis_b / (np.linalg.norm(axis_a) * np.linalg.norm(axis_b)))
        if abs(cosine) > _ASKEW:
            angle = np.degrees(np.arccos(np.clip(abs(cosine), 0.0, 1.0)))
            attitude = f"at {angle:.3g} degrees" if angle > 1e-3 else "parallel"
            raise ValueError(
                f"{undeformed.user}: the two axes of the universal joint must be perpendicular, "
                f"but in the placements they are {attitude}; give each fork its axis, in the axes "
                "of its own marker"
            )
        forks = direction(self.a, self.axis), direction(self.b, self.second_axis)
        return [*coincidence(self.a, self.b, undeformed), Row(RowKind.DOT, forks)]


@dataclass(frozen=True)
class Cylindrical(_Between):
    """A marker slides along an axis through another and turns about it: four rows.

    The axis has the same direction on the first body as in the placements.

    Attributes:
        a: First marker.
        b: Second marker.
        axis: Axis, in the axes of the second marker and of any length.
        name: Name for results and messages.
    """

    axis: Triple = (0.0, 0.0, 1.0)
    name: str = ""

    dimension: ClassVar[int | None] = 3
    drawn = (Slider,)

    def rows(self, undeformed: Undeformed) -> list[Row]:
        turned = parallel(self.a, self.b, self.axis, undeformed)
        return [*on_line(self.a, self.b, self.axis, undeformed), *turned]


@dataclass(frozen=True)
class Planar(_Between):
    """A marker moves in a plane through another and turns about its normal: three rows.

    The normal has the same direction on the first body as in the placements.

    Attributes:
        a: First marker.
        b: Second marker.
        normal: Normal of the plane, in the axes of the second marker and of any length.
        name: Name for results and messages.
    """

    normal: Triple = (0.0, 0.0, 1.0)
    name: str = ""

    dimension: ClassVar[int | None] = 3

    def rows(self, undeformed: Undeformed) -> list[Row]:
        turned = parallel(self.a, self.b, self.normal, undeformed)
        return [on_plane(self.a, self.b, self.normal), *turned]


@dataclass(frozen=True)
class PointOnPlane(Joint):
    """A point stays on a plane through another marker: one row.

    The plane is fixed to the axes of its marker and turns with them.

    Attributes:
        point: Marker of the point.
        plane: Marker through which the plane passes.
        normal: Normal of the plane, in the axes of its marker and of any length.
        name: Name for results and messages.
    """

    point: Marker
    plane: Marker
    normal: Triple = (0.0, 0.0, 1.0)
    name: str = ""

    dimension: ClassVar[int | None] = 3
    in_the_plane: ClassVar[str] = "a PointOnLine"

    def rows(self, undeformed: Undeformed) -> list[Row]:
        return [on_plane(self.point, self.plane, self.normal)]
