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
from numpy.typing import NDArray

from .. import validation
from .motion import Motion

__all__ = ["BodyPoint", "Ground", "Marker", "Moving", "Pair", "check_marker", "marker_name"]

Array = NDArray[np.float64]
Pair = tuple[float, float]

#: Name of a body and name of one of its markers.
BodyPoint = tuple[str, str]


@dataclass(frozen=True)
class Ground:
    """A marker fixed to the ground.

    Raises:
        TypeError: If position or angle hold something else than numbers.
        ValueError: If the position has not two components, or a number is NaN or infinite.
    """

    #: Position [m].
    position: Pair = (0.0, 0.0)
    #: Angle of the marker's axes [rad].
    angle: float = 0.0
    #: Name for messages.
    name: str = "ground"

    def __post_init__(self) -> None:
        """Check the numbers."""
        validation.plane_vector("ground: position", self.position)
        validation.number("ground: angle", self.angle)
        validation.name("ground: name", self.name)

    @property
    def motions(self) -> tuple[Motion, Motion, Motion]:
        """Motions of x, y and angle."""
        x, y = self.position
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

    def __post_init__(self) -> None:
        """Check the motions."""
        validation.name("moving marker: name", self.name)
        for part in ("x", "y", "angle"):
            validation.instance(
                f"{self.name}: {part}",
                getattr(self, part),
                Motion,
                "a Motion (Motion.constant(...) where it is held)",
            )

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

        x, y = validation.plane_vector(f"{name}: center", center)
        return Moving(along(x, 0.0), along(y, math.pi / 2.0), angle, name)


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
