# SPDX-License-Identifier: MIT
"""Forces and moments on the markers of a planar mechanism.

A force acts on a body at a marker; on a flexible body it bends the body through the marker's shape
functions. Springs and dampers act between two markers, one of which may stand on the ground or move
as prescribed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from .connection import Connection
from .motion import Motion, Signal
from .points import BodyPoint, Marker

__all__ = [
    "AppliedForce",
    "Force",
    "SpringDamper",
    "Torque",
    "TorsionalSpringDamper",
]


@dataclass(frozen=True)
class AppliedForce(Connection):
    """What all forces have in common."""

    kind: ClassVar[str] = "force"
    verb: ClassVar[str] = "acts on"


@dataclass(frozen=True)
class _On(AppliedForce):
    """A force or moment on one body."""

    #: Name of the body and name of the marker.
    marker: BodyPoint

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The marker on which it acts."""
        return (self.marker,)


@dataclass(frozen=True)
class _Between(AppliedForce):
    """A spring and a damper side by side between two markers."""

    #: First marker.
    a: Marker
    #: Second marker.
    b: Marker
    #: Stiffness [N/m], of a torsional spring [N m/rad].
    stiffness: float
    #: Damping [N s/m], of a torsional damper [N m s/rad].
    damping: float = 0.0

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The two markers between which the spring acts."""
        return self.a, self.b

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        yield from _negative("stiffness", self.stiffness)
        yield from _negative("damping", self.damping)


@dataclass(frozen=True)
class Force(_On):
    """A force on a body at a marker, given over time."""

    #: Force along x [N]: a number, a function of time, or a Motion whose value it is.
    x: Signal = 0.0
    #: Force along y [N], likewise.
    y: Signal = 0.0
    #: Whether x and y are the marker's own axes, which turn with it, and not the global ones.
    follower: bool = False
    #: Name for results and messages.
    name: str = ""


@dataclass(frozen=True)
class Torque(_On):
    """A moment on a body at a marker, given over time."""

    #: Moment [N m]: a number, a function of time, or a Motion whose value it is.
    moment: Signal = 0.0
    #: Name for results and messages.
    name: str = ""


@dataclass(frozen=True)
class SpringDamper(_Between):
    """A spring and a damper side by side between two markers.

    They pull with stiffness (l - length) + damping l', l being the distance of the markers. With
    ``length=0`` they have no direction of their own and act as -stiffness d - damping d' on the
    first marker, d = r_a - r_b: an elastic bearing, whose markers ought to stay close, since such
    a damper also resists the turning of d. The markers of any other spring must not coincide.
    """

    #: Length without force [m], also over time, as of an actuator; None takes the distance in the
    #: placements.
    length: Signal | None = None
    #: Name for results and messages.
    name: str = ""

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.length is not None and not callable(self.length):
            if not isinstance(self.length, Motion):
                yield from _negative("length", self.length)


@dataclass(frozen=True)
class TorsionalSpringDamper(_Between):
    """A torsional spring and a damper side by side between two markers.

    The moment on the first marker is -stiffness (phi - angle) - damping phi', phi being the angle
    of the first marker minus that of the second.
    """

    #: Relative angle without moment [rad], also over time; None takes that of the placements.
    angle: Signal | None = None
    #: Name for results and messages.
    name: str = ""


def _negative(what: str, value: float) -> Iterator[str]:
    if not (math.isfinite(value) and value >= 0.0):
        yield f": the {what} must not be negative, but it is {value}"
