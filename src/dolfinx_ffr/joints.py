# SPDX-License-Identifier: MIT
"""Joints of a planar mechanism.

Each joint is one to three scalar constraints between two markers, its rows. The multipliers of the
rows are the forces of the joint, :meth:`Trajectory.joint_force`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from .motion import Motion
from .points import Ground, Marker, Pair, label_of

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
class Joint:
    """What all joints have in common."""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        """The two markers that the joint connects."""
        raise NotImplementedError

    @property
    def label(self) -> str:
        """Name given by the user, or one made from the kind and the markers."""
        return label_of(self, self.markers)

    def validate(self, label: str) -> None:
        """Check the numbers.

        Args:
            label: Name of the joint, for the message.

        Raises:
            ValueError: If a number is out of range or no body is connected.
        """
        if not any(isinstance(marker, tuple) for marker in self.markers):
            raise ValueError(f"joint {label!r} connects no body")
        direction = getattr(self, "direction", None)
        if direction is not None and not 0.0 < math.hypot(*direction) < math.inf:
            raise ValueError(f"joint {label!r}: the direction of the line must not be zero")
        angle = getattr(self, "angle", None)
        if angle is not None and not math.isfinite(angle):
            raise ValueError(f"joint {label!r}: the angle is {angle}")


@dataclass(frozen=True)
class Revolute(Joint):
    """Two markers coincide: r_a - r_b = 0, two rows."""

    #: First marker.
    a: Marker
    #: Second marker.
    b: Marker
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        """The two markers that the joint connects."""
        return self.a, self.b


@dataclass(frozen=True)
class Weld(Joint):
    """Two markers coincide and keep their relative angle: three rows."""

    #: First marker.
    a: Marker
    #: Second marker.
    b: Marker
    #: Angle of the first marker minus that of the second [rad]; None takes that of the placements.
    angle: float | None = None
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        """The two markers that the joint connects."""
        return self.a, self.b


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
class Translational(Joint):
    """A sliding joint that keeps the relative angle: two rows.

    The first marker stays on a line through the second, which is fixed to the axes of the second
    and turns with them, and its angle against the second does not change.
    """

    #: First marker.
    a: Marker
    #: Second marker, which carries the line.
    b: Marker
    #: Direction of the line in the axes of the second marker, of any length.
    direction: Pair = (1.0, 0.0)
    #: Angle of the first marker minus that of the second [rad]; None takes that of the placements.
    angle: float | None = None
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        """The two markers that the joint connects."""
        return self.a, self.b


@dataclass(frozen=True)
class Gear(Joint):
    """The angle of a marker follows that of another, angle_a - ratio angle_b = constant: one row.

    The constant is that of the placements. Wheels with z_a and z_b teeth that mesh from outside
    have the ratio -z_b / z_a, an inner gearing and a belt have z_b / z_a. The bearings of the
    wheels are joints of their own.
    """

    #: First marker, on the driven wheel, say.
    a: Marker
    #: Second marker, on the driving wheel.
    b: Marker
    #: Speed of the first marker over that of the second, negative if they turn in opposite senses.
    ratio: float
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        """The two markers that the joint connects."""
        return self.a, self.b

    def validate(self, label: str) -> None:
        """Check the numbers.

        Args:
            label: Name of the joint, for the message.

        Raises:
            ValueError: If a number is out of range or no body is connected.
        """
        super().validate(label)
        if not (math.isfinite(self.ratio) and self.ratio != 0.0):
            raise ValueError(
                f"joint {label!r}: the ratio must be a number other than zero, but it is "
                f"{self.ratio}"
            )


@dataclass(frozen=True)
class Distance(Joint):
    """The distance of two markers is constant or follows a motion, |r_a - r_b| = length: one row.

    A rod without mass between two pins, or a hydraulic cylinder of given stroke.
    """

    #: First marker.
    a: Marker
    #: Second marker.
    b: Marker
    #: The distance [m], which must be positive; None takes that of the placements.
    length: float | Motion | None = None
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        """The two markers that the joint connects."""
        return self.a, self.b

    def validate(self, label: str) -> None:
        """Check the numbers.

        Args:
            label: Name of the joint, for the message.

        Raises:
            ValueError: If a number is out of range or no body is connected.
        """
        super().validate(label)
        given = self.length
        if not (given is None or isinstance(given, Motion) or 0.0 < given < math.inf):
            raise ValueError(
                f"joint {label!r}: the length must be positive, but it is {given} m; markers that "
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

    def validate(self, label: str) -> None:
        """Check the numbers.

        Args:
            label: Name of the joint, for the message.

        Raises:
            ValueError: If a number is out of range or no body is connected.
        """
        super().validate(label)
        if self.axis not in ("x", "y"):
            raise ValueError(f"joint {label!r}: the axis must be 'x' or 'y', not {self.axis!r}")
