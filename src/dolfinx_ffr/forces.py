# SPDX-License-Identifier: MIT
"""Forces and moments on the markers of a planar mechanism.

A force acts on a body at a marker; on a flexible body it bends the body through the marker's shape
functions. Springs and dampers act between two markers, one of which may stand on the ground or move
as prescribed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from .motion import Motion, Signal
from .points import BodyPoint, Marker, label_of

__all__ = [
    "AppliedForce",
    "Force",
    "SpringDamper",
    "Torque",
    "TorsionalSpringDamper",
]


@dataclass(frozen=True)
class AppliedForce:
    """What all forces have in common."""

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The marker or the two markers on which the force acts."""
        raise NotImplementedError

    @property
    def label(self) -> str:
        """Name given by the user, or one made from the kind and the markers."""
        return label_of(self, self.markers)

    def validate(self, label: str) -> None:
        """Check the numbers.

        Args:
            label: Name of the force, for the message.

        Raises:
            ValueError: If a number is out of range or no body is touched.
        """
        if not any(isinstance(marker, tuple) for marker in self.markers):
            raise ValueError(f"force {label!r} acts on no body")


@dataclass(frozen=True)
class Force(AppliedForce):
    """A force on a body at a marker, given over time."""

    #: Name of the body and name of the marker.
    marker: BodyPoint
    #: Force along x [N]: a number, a function of time, or a Motion whose value it is.
    x: Signal = 0.0
    #: Force along y [N], likewise.
    y: Signal = 0.0
    #: Whether x and y are the marker's own axes, which turn with it, and not the global ones.
    follower: bool = False
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The marker on which the force acts."""
        return (self.marker,)


@dataclass(frozen=True)
class Torque(AppliedForce):
    """A moment on a body at a marker, given over time."""

    #: Name of the body and name of the marker.
    marker: BodyPoint
    #: Moment [N m]: a number, a function of time, or a Motion whose value it is.
    moment: Signal = 0.0
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The marker on which the moment acts."""
        return (self.marker,)


@dataclass(frozen=True)
class SpringDamper(AppliedForce):
    """A spring and a damper side by side between two markers.

    They pull with stiffness (l - length) + damping l', l being the distance of the markers. With
    ``length=0`` they have no direction of their own and act as -stiffness d - damping d' on the
    first marker, d = r_a - r_b: an elastic bearing, whose markers ought to stay close, since such
    a damper also resists the turning of d. The markers of any other spring must not coincide.
    """

    #: First marker.
    a: Marker
    #: Second marker.
    b: Marker
    #: Stiffness [N/m].
    stiffness: float
    #: Damping [N s/m].
    damping: float = 0.0
    #: Length without force [m], also over time, as of an actuator; None takes the distance in the
    #: placements.
    length: Signal | None = None
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The two markers between which the spring acts."""
        return self.a, self.b

    def validate(self, label: str) -> None:
        """Check the numbers.

        Args:
            label: Name of the spring, for the message.

        Raises:
            ValueError: If a number is out of range or no body is touched.
        """
        super().validate(label)
        _refuse_negative(label, "stiffness", self.stiffness)
        _refuse_negative(label, "damping", self.damping)
        if self.length is not None and not callable(self.length):
            if not isinstance(self.length, Motion):
                _refuse_negative(label, "length", self.length)


@dataclass(frozen=True)
class TorsionalSpringDamper(AppliedForce):
    """A torsional spring and a damper side by side between two markers.

    The moment on the first marker is -stiffness (phi - angle) - damping phi', phi being the angle
    of the first marker minus that of the second.
    """

    #: First marker.
    a: Marker
    #: Second marker.
    b: Marker
    #: Stiffness [N m/rad].
    stiffness: float
    #: Damping [N m s/rad].
    damping: float = 0.0
    #: Relative angle without moment [rad], also over time; None takes that of the placements.
    angle: Signal | None = None
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The two markers between which the spring acts."""
        return self.a, self.b

    def validate(self, label: str) -> None:
        """Check the numbers.

        Args:
            label: Name of the spring, for the message.

        Raises:
            ValueError: If a number is out of range or no body is touched.
        """
        super().validate(label)
        _refuse_negative(label, "stiffness", self.stiffness)
        _refuse_negative(label, "damping", self.damping)


def _refuse_negative(label: str, what: str, value: float) -> None:
    if not (math.isfinite(value) and value >= 0.0):
        raise ValueError(f"force {label!r}: the {what} must not be negative, but it is {value}")
