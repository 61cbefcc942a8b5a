# SPDX-License-Identifier: MIT
"""Description of a planar mechanism: placements, joints, point masses, gravity, damping.

A mechanism says how bodies are put together; the bodies themselves come as volume integrals, so
one mechanism serves all designs. Joints connect markers. A marker is

* a point of a body, written ``("rod", "left")``: name of the body, name of the marker;
* a point of the ground, :class:`Ground`;
* a point that moves as prescribed, :class:`Moving`: a crank of given motion is such a marker, not
  a body.

Example:
    >>> crank = Moving.circle((0.0, 0.0), 0.1, Motion.smooth_step(distance=62.8, duration=2.0))
    >>> slider_crank = Mechanism(
    ...     placements={"rod": Placement(position=(0.3, 0.0))},
    ...     joints=[
    ...         Revolute(("rod", "left"), crank),
    ...         PointOnLine(("rod", "right"), Ground(), name="slider"),
    ...     ],
    ...     point_masses=[PointMass(("rod", "right"), 0.5)],
    ... )
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from .motion import Motion

__all__ = [
    "BodyPoint",
    "Ground",
    "Joint",
    "Marker",
    "Mechanism",
    "Moving",
    "Placement",
    "PointMass",
    "PointOnLine",
    "PrescribedAngle",
    "PrescribedPosition",
    "RayleighDamping",
    "Revolute",
    "Weld",
]

Pair = tuple[float, float]

#: Name of a body and name of one of its markers.
BodyPoint = tuple[str, str]


@dataclass(frozen=True)
class Ground:
    """A marker fixed to the ground."""

    #: Position [m].
    position: Pair = (0.0, 0.0)
    #: Angle of the marker's axes [rad].
    angle: float = 0.0
    #: Name for messages.
    name: str = "ground"

    @property
    def motions(self) -> tuple[Motion, Motion, Motion]:
        """Motions of x, y and angle."""
        x, y = self.position
        return Motion.constant(x), Motion.constant(y), Motion.constant(self.angle)


@dataclass(frozen=True)
class Moving:
    """A marker that moves as prescribed."""

    #: Motion of the position along x [m].
    x: Motion
    #: Motion of the position along y [m].
    y: Motion
    #: Motion of the angle of the marker's axes [rad].
    angle: Motion = field(default_factory=lambda: Motion.constant(0.0))
    #: Name for messages.
    name: str = "moving marker"

    @property
    def motions(self) -> tuple[Motion, Motion, Motion]:
        """Motions of x, y and angle."""
        return self.x, self.y, self.angle

    @staticmethod
    def circle(center: Pair, radius: float, angle: Motion, name: str = "crank pin") -> Moving:
        """The end of a prescribed crank: a point on a circle whose angle is given.

        Args:
            center: Centre of the circle [m].
            radius: Radius of the circle [m].
            angle: Motion of the angle from the x axis [rad]; the marker's axes turn with it.
            name: Name for messages.
        """

        def along(middle: float, phase: float) -> Motion:
            # y is x a quarter turn later; sine and cosine of (phi - phase) serve both.
            def value(t):  # type: ignore[no-untyped-def]
                return middle + radius * np.cos(np.asarray(angle.value(t)) - phase)

            def velocity(t):  # type: ignore[no-untyped-def]
                phi = np.asarray(angle.value(t)) - phase
                return -radius * np.sin(phi) * angle.velocity(t)

            def acceleration(t):  # type: ignore[no-untyped-def]
                phi, rate = np.asarray(angle.value(t)) - phase, np.asarray(angle.velocity(t))
                return -radius * (np.cos(phi) * rate**2 + np.sin(phi) * angle.acceleration(t))

            return Motion(value, velocity, acceleration, angle.name)

        x, y = along(center[0], 0.0), along(center[1], math.pi / 2.0)
        return Moving(x, y, angle, name)


Marker = BodyPoint | Ground | Moving


@dataclass(frozen=True)
class Placement:
    """Where a body starts, roughly: position and velocity are corrected so that the joints close.

    The correction is the smallest one in position and angle (velocities alike).
    """

    #: Position of the origin of the body's frame [m].
    position: Pair = (0.0, 0.0)
    #: Angle of the body's frame [rad].
    angle: float = 0.0
    #: Velocity of the origin of the body's frame [m/s].
    velocity: Pair = (0.0, 0.0)
    #: Angular velocity [rad/s].
    angular_velocity: float = 0.0


@dataclass(frozen=True)
class PointMass:
    """A point mass fixed to a marker of a body."""

    #: Name of the body and name of the marker.
    marker: BodyPoint
    #: Mass [kg].
    mass: float


@dataclass(frozen=True)
class RayleighDamping:
    """Damping of the elastic coordinates, alpha times their mass plus beta times the stiffness."""

    #: Mass-proportional coefficient [1/s].
    alpha: float = 0.0
    #: Stiffness-proportional coefficient [s].
    beta: float = 0.0


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
        given = getattr(self, "name", "")
        if given:
            return str(given)
        return f"{type(self).__name__}({', '.join(marker_name(m) for m in self.markers)})"


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


@dataclass(frozen=True)
class Mechanism:
    """A planar mechanism.

    Raises:
        ValueError: If a number is out of range, a joint lacks a body, or a name stands twice.
    """

    #: Start of every body, by name of the body.
    placements: Mapping[str, Placement]
    #: Joints, in the order of their rows in the multipliers.
    joints: Sequence[Joint] = ()
    #: Point masses.
    point_masses: Sequence[PointMass] = ()
    #: Acceleration of free fall [m/s^2], for instance (0, -9.81).
    gravity: Pair = (0.0, 0.0)
    #: Damping, by name of the body.
    damping: Mapping[str, RayleighDamping] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not np.all(np.isfinite(np.asarray(self.gravity, dtype=float))):
            raise ValueError(f"gravity holds NaN or infinity: {self.gravity}")
        for name, placement in self.placements.items():
            numbers = (*placement.position, placement.angle, *placement.velocity)
            if not np.all(np.isfinite((*numbers, placement.angular_velocity))):
                raise ValueError(f"placement of body {name!r} holds NaN or infinity")
        for point in self.point_masses:
            if not (math.isfinite(point.mass) and point.mass > 0.0):
                raise ValueError(
                    f"point mass at {marker_name(point.marker)}: the mass must be positive, "
                    f"but it is {point.mass} kg"
                )
        for name, d in self.damping.items():
            if not (math.isfinite(d.alpha + d.beta) and d.alpha >= 0.0 and d.beta >= 0.0):
                raise ValueError(
                    f"damping of body {name!r}: the coefficients must not be negative, "
                    f"but they are {d.alpha} and {d.beta}"
                )
        for joint, label in zip(self.joints, self.joint_names, strict=True):
            if not any(isinstance(marker, tuple) for marker in joint.markers):
                raise ValueError(f"joint {label!r} connects no body")
            if isinstance(joint, PointOnLine) and not math.hypot(*joint.direction) > 0.0:
                raise ValueError(f"joint {label!r}: the direction of the line must not be zero")
            if isinstance(joint, PrescribedPosition) and joint.axis not in ("x", "y"):
                raise ValueError(
                    f"joint {label!r}: the axis must be 'x' or 'y', not {joint.axis!r}"
                )

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints; names made from the markers are numbered where they repeat.

        Raises:
            ValueError: If two joints have been given the same name.
        """
        names: list[str] = []
        for joint in self.joints:
            label, count = joint.label, 1
            while label in names:
                if getattr(joint, "name", ""):
                    raise ValueError(f"two joints have the name {label!r}")
                count += 1
                label = f"{joint.label} #{count}"
            names.append(label)
        return names


def marker_name(marker: Marker) -> str:
    """Name of a marker for messages.

    Args:
        marker: The marker.
    """
    return ".".join(marker) if isinstance(marker, tuple) else marker.name
