# SPDX-License-Identifier: MIT
"""Points that joints and forces connect: on a body, on the ground, or moving as prescribed.

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

from .motion import Motion

__all__ = ["BodyPoint", "Ground", "Marker", "Moving", "Pair", "marker_name"]

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

            return Motion(value, velocity, acceleration, angle.name, angle.jumps)

        x, y = along(center[0], 0.0), along(center[1], math.pi / 2.0)
        return Moving(x, y, angle, name)


Marker = BodyPoint | Ground | Moving


def marker_name(marker: Marker) -> str:
    """Name of a marker for messages.

    Args:
        marker: The marker.
    """
    return ".".join(marker) if isinstance(marker, tuple) else marker.name
