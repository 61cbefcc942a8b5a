# SPDX-License-Identifier: MIT
"""Joints of a planar mechanism.

Each joint is one to three scalar constraints between two markers, its rows. The multipliers of the
rows are the forces of the joint, :meth:`Trajectory.joint_force`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from .connection import Connection
from .motion import Motion
from .points import Ground, Marker, Pair

__all__ = [
    "Distance",
    "Gear",
    "Joint",
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
    verb: ClassVar[str] = "connects"

    @property
    def markers(self) -> tuple[Marker, Marker]:
        """The two markers that the joint connects."""
        raise NotImplementedError

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        direction = getattr(self, "direction", None)
        if direction is not None and not 0.0 < math.hypot(*direction) < math.inf:
            yield ": the direction of the line must not be zero"
        angle = getattr(self, "angle", None)
        if angle is not None and not math.isfinite(angle):
            yield f": the angle is {angle}"


@dataclass(frozen=True)
class _Between(Joint):
    """A joint between two markers."""

    #: First marker.
    a: Marker
    #: Second marker.
    b: Marker

    @property
    def markers(self) -> tuple[Marker, Marker]:
        """The two markers that the joint connects."""
        return self.a, self.b


@dataclass(frozen=True)
class Revolute(_Between):
    """Two markers coincide: r_a - r_b = 0, two rows."""

    #: Name for results and messages.
    name: str = ""


@dataclass(frozen=True)
class Weld(_Between):
    """Two markers coincide and keep their relative angle: three rows."""

    #: Angle of the first marker minus that of the second [rad]; None takes that of the placements.
    angle: float | None = None
    #: Name for results and messages.
    name: str = ""


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
        """The two markers that the joint connects."""
        return self.point, self.line


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

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if not (math.isfinite(self.ratio) and self.ratio != 0.0):
            yield f": the ratio must be a number other than zero, but it is {self.ratio}"


@dataclass(frozen=True)
class Distance(_Between):
    """The distance of two markers is constant or follows a motion, |r_a - r_b| = length: one row.

    A rod without mass between two pins, or a hydraulic cylinder of given stroke.
    """

    #: The distance [m], which must be positive; None takes that of the placements.
    length: float | Motion | None = None
    #: Name for results and messages.
    name: str = ""

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        given = self.length
        if not (given is None or isinstance(given, Motion) or 0.0 < given < math.inf):
            yield (
                f": the length must be positive, but it is {given} m; markers that coincide are "
                "joined by a Revolute"
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
        """The two markers that the joint connects."""
        return self.marker, self.relative_to


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
        """The two markers that the joint connects."""
        return self.marker, Ground()

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.axis not in ("x", "y"):
            yield f": the axis must be 'x' or 'y', not {self.axis!r}"
