# SPDX-License-Identifier: MIT
"""Markers, which joints and forces connect: on a body, on the ground, or moving as prescribed.

A marker is

* a point of a body, written ``("rod", "left")``: name of the body, name of the marker;
* a point of the ground, :class:`Ground`;
* a point that moves as prescribed, :class:`Moving`: a crank of given motion is such a marker, not
  a body.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from .motion import Motion, tabulated
from .rotation import RotationLike, checked_rotation, rotation_matrix

__all__ = [
    "BodyPoint",
    "Ground",
    "Marker",
    "Moving",
    "Pair",
    "Triple",
    "axis_vector",
    "check_marker",
    "check_position",
    "marker_name",
    "perpendicular",
]

Array = NDArray[np.float64]
Pair = tuple[float, float]
Triple = tuple[float, float, float]

#: Lengths of axes below this count as zero.
_SHORTEST = 1e-12

#: Name of a body and name of one of its markers.
BodyPoint = tuple[str, str]


@dataclass(frozen=True)
class Ground:
    """A marker fixed to the ground.

    ``Ground()`` is the origin with the global axes, in the plane and in space.

    Raises:
        TypeError: If position, angle or rotation hold something else than numbers.
        ValueError: If the position has not two components, in space three, or a number is NaN or
            infinite.
    """

    #: Position, of two components in the plane and of three in space [m].
    position: Pair | Triple = (0.0, 0.0)
    #: Angle of the marker's axes in the plane [rad].
    angle: float = 0.0
    #: Name for messages.
    name: str = "ground"
    #: Rotation of the marker's axes in space: a vector along its axis as long as the angle [rad], a
    #: matrix whose columns are the axes, or a rotation of SciPy; None is none.
    rotation: RotationLike | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_position("ground: position", self.position, self.rotation is not None)
        validation.number("ground: angle", self.angle)
        validation.name("ground: name", self.name)
        # In tuples, so that markers can be compared.
        object.__setattr__(self, "position", tuple(float(x) for x in self.position))
        if self.rotation is not None:
            rotation = checked_rotation("ground: rotation", self.rotation)
            object.__setattr__(self, "rotation", rotation)
        if self.angle != 0.0 and self.dimension == 3:
            raise ValueError("ground: in space the axes turn by a rotation, not by an angle")

    @property
    def dimension(self) -> int | None:
        """2 in the plane, 3 in space; None for the origin with the global axes, which fits both."""
        if self.rotation is not None or len(self.position) == 3:
            return 3
        return 2 if any(self.position) or self.angle != 0.0 else None

    def tabulate_in_space(self, times: Array, where: str) -> Array:
        """Position and axes over time, see :meth:`Moving.tabulate_in_space`.

        Args:
            times: Times, shape (n,) [s].
            where: The marker's user, for messages.
        """
        table = np.zeros((times.size, 3, 4, 3))
        table[:, 0, 0, : len(self.position)] = self.position
        table[:, 0, 1:] = np.eye(3) if self.rotation is None else rotation_matrix(self.rotation).T
        return table

    @property
    def motions(self) -> tuple[Motion, Motion, Motion]:
        """Motions of x, y and angle in the plane."""
        x, y = self.position[:2]
        return Motion.constant(x), Motion.constant(y), Motion.constant(self.angle)


@dataclass(frozen=True)
class Moving:
    """A marker that moves as prescribed.

    Raises:
        TypeError: If a coordinate is no Motion.
    """

    #: Motion of the position along x [m].
    x: Motion
    #: Motion of the position along y [m].
    y: Motion
    #: Motion of the angle of the marker's axes [rad].
    angle: Motion = field(default_factory=lambda: Motion.constant(0.0))
    #: Name for messages.
    name: str = "moving marker"
    #: Motion of the position along z [m]: the marker is one in space. None in the plane.
    z: Motion | None = None
    #: In space the axis, in the marker's own axes and of any length, about which they turn by the
    #: angle.
    axis: Triple = (0.0, 0.0, 1.0)
    #: In space the rotation of the marker's axes at the angle zero, see :class:`Ground`.
    rotation: RotationLike | None = None

    def __post_init__(self) -> None:
        """Check the motions."""
        validation.name("moving marker: name", self.name)
        for part in ("x", "y", "angle", *(["z"] if self.z is not None else [])):
            validation.instance(
                f"{self.name}: {part}",
                getattr(self, part),
                Motion,
                "a Motion (Motion.constant(...) where it is held)",
            )
        axis_vector(f"{self.name}: axis", self.axis)
        if self.rotation is not None:
            rotation = checked_rotation(f"{self.name}: rotation", self.rotation)
            object.__setattr__(self, "rotation", rotation)
            if self.z is None:
                raise ValueError(f"{self.name}: a marker with a rotation is one in space; give z")

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return 2 if self.z is None else 3

    def tabulate_in_space(self, times: Array, where: str) -> Array:
        """Position and axes over time, with their two derivatives.

        Args:
            times: Times, shape (n,) [s].
            where: The marker's user, for messages.

        Returns:
            Array of shape (n, 3 derivatives, 4 vectors, 3): the position [m], then the three axes.

        Raises:
            ValueError: If a value is NaN or infinite.
        """
        out = np.zeros((times.size, 3, 4, 3))
        for k, motion in enumerate((self.x, self.y, self.z)):
            if motion is not None:
                out[:, :, 0, k] = tabulated(motion, times, where).T
        phi, rate, growth = tabulated(self.angle, times, where)[:, :, None, None]
        n = np.array(self.axis) / np.linalg.norm(self.axis)
        turn = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
        start = np.eye(3) if self.rotation is None else rotation_matrix(self.rotation)
        A = start @ (np.eye(3) + np.sin(phi) * turn + (1.0 - np.cos(phi)) * turn @ turn)
        for k, part in enumerate(
            (A, A @ turn * rate, A @ turn * growth + A @ turn @ turn * rate**2)
        ):
            out[:, k, 1:] = part.transpose(0, 2, 1)
        return out

    @property
    def motions(self) -> tuple[Motion, ...]:
        """Motions of x, y and angle, in space also of z."""
        if self.z is not None:
            return self.x, self.y, self.angle, self.z
        return self.x, self.y, self.angle

    @staticmethod
    def circle(
        center: Pair | Triple,
        radius: float,
        angle: Motion,
        name: str = "crank pin",
        axis: Triple = (0.0, 0.0, 1.0),
    ) -> Moving:
        """The end of a prescribed crank: a point on a circle whose angle is given.

        Args:
            center: Centre of the circle, of three components in space [m].
            radius: Radius of the circle [m].
            angle: Motion of the angle from the x axis [rad]; the marker's axes turn with it. In
                space it counts from the direction that is x where the axis is z, y where it is x
                and z where it is y, and the marker's axes are those three at the angle zero: x
                points along the radius, z along the axis.
            name: Name for messages.
            axis: Axis of the circle in space, in the global axes and of any length.

        Raises:
            TypeError: If the angle is no Motion, or center and radius hold no numbers.
            ValueError: If a number is NaN or infinite.
        """
        length = validation.number(f"{name}: radius", radius)
        validation.instance(f"{name}: angle", angle, Motion, "a Motion")

        def along(middle: float, phase: float) -> Motion:
            # y is x a quarter turn later; sine and cosine of (phi - phase) serve both.
            path = _OnCircle(middle, length, angle, phase)
            parts = path.value, path.velocity, path.acceleration
            return Motion(*parts, angle.name, angle.jumps)

        if np.shape(center) == (3,):
            return _circle_in_space(
                validation.real_array(f"{name}: center", center), length, angle, name, axis
            )
        x, y = validation.plane_vector(f"{name}: center", center)
        return Moving(along(x, 0.0), along(y, math.pi / 2.0), angle, name)


def _circle_in_space(
    center: Array, radius: float, angle: Motion, name: str, axis: Triple
) -> Moving:
    """A point on a circle about an axis."""
    third = np.array(axis_vector(f"{name}: axis", axis))
    first, second = perpendicular(third)
    motions = []
    for k in range(3):
        # A sum of sine and cosine is a cosine of another phase.
        size = radius * math.hypot(first[k], second[k])
        path = _OnCircle(float(center[k]), size, angle, math.atan2(second[k], first[k]))
        motions.append(
            Motion(path.value, path.velocity, path.acceleration, angle.name, angle.jumps)
        )
    x, y, z = motions
    axes = np.stack([first, second, np.cross(first, second)], axis=1)
    return Moving(x, y, angle, name, z, rotation=axes)


def perpendicular(axis: ArrayLike) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed triad with an axis, e_1 x e_2 = axis.

    Where the axis is z, e_1 is x; where it is x, y; where it is y, z.

    Args:
        axis: The axis, shape (3,), of any length.
    """
    n = np.asarray(axis, dtype=np.float64)
    n = n / np.linalg.norm(n)
    first = np.eye(3)[(int(np.argmax(np.abs(n))) + 1) % 3]
    first = first - (first @ n) * n
    first /= np.linalg.norm(first)
    return first, np.cross(n, first)


def axis_vector(what: str, axis: object) -> Triple:
    """Three numbers that are not all zero.

    Args:
        what: Name of the axis, for the message.
        axis: What is given for it.

    Raises:
        TypeError: If it holds something else than numbers.
        ValueError: If there are not three, or all are zero.
    """
    x, y, z = validation.real_array(what, axis, (3,), expected="three components")
    if not math.hypot(x, y, z) > _SHORTEST:
        raise ValueError(f"{what} has no length; give a direction, of any length")
    return float(x), float(y), float(z)


def check_position(what: str, position: object, spatial: bool) -> None:
    """Refuse what is no position in the plane or in space.

    Args:
        what: Name of the position, for the message.
        position: What is given for it.
        spatial: Whether it must be one in space; zeros in the plane are the origin there, too.

    Raises:
        TypeError: If it holds something else than numbers.
        ValueError: If there are too many or too few, or one is NaN or infinite.
    """
    if np.shape(position) == (3,):  # type: ignore[arg-type]
        validation.real_array(what, position)
        return
    expected = "two components, in space three"
    x, y = validation.real_array(what, position, (2,), expected=expected)
    if spatial and (x or y):
        raise ValueError(f"{what} must have three components in space, but it has two")


@dataclass(frozen=True)
class _OnCircle:
    """A coordinate of a point on a circle; its functions can be pickled."""

    middle: float
    radius: float
    angle: Motion
    phase: float

    def value(self, t: Array) -> Array:
        """The coordinate at times ``t``."""
        return self.middle + self.radius * np.cos(np.asarray(self.angle.value(t)) - self.phase)

    def velocity(self, t: Array) -> Array:
        """Its first derivative at times ``t``."""
        phi = np.asarray(self.angle.value(t)) - self.phase
        return -self.radius * np.sin(phi) * self.angle.velocity(t)

    def acceleration(self, t: Array) -> Array:
        """Its second derivative at times ``t``."""
        phi, rate = np.asarray(self.angle.value(t)) - self.phase, np.asarray(self.angle.velocity(t))
        bend = np.sin(phi) * self.angle.acceleration(t)
        return -self.radius * (np.cos(phi) * rate**2 + bend)


Marker = BodyPoint | Ground | Moving


def check_marker(what: str, marker: object) -> None:
    """Refuse what is no marker.

    Args:
        what: Who asks, for the message.
        marker: What is given for the marker.

    Raises:
        TypeError: If it is neither a point of a body nor of the ground nor a moving one.
    """
    if isinstance(marker, Ground | Moving):
        return
    parts = marker if isinstance(marker, tuple) else ()
    if len(parts) != 2 or not all(isinstance(part, str) for part in parts):
        raise TypeError(
            f'{what}: a marker must be ("body", "marker"), Ground(...) or Moving(...), but it is '
            f"{validation.described(marker)}"
        )


def marker_name(marker: Marker) -> str:
    """Name of a marker for messages.

    Args:
        marker: The marker.
    """
    return ".".join(marker) if isinstance(marker, tuple) else marker.name
