# SPDX-License-Identifier: MIT
"""Forces and moments on the markers of a planar mechanism.

A force acts on a body at a marker; on a flexible body it bends the body through the marker's shape
functions. Springs and dampers act between two markers, one of which may stand on the ground or move
as prescribed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .. import validation
from .connection import Connection
from .elements import Element, ElementKind
from .marker import BodyPoint, Marker
from .motion import Motion, Signal, check_signal
from .rows import Undeformed
from .symbols import Spring, Symbol

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

    def element(self, label: str, undeformed: Undeformed) -> Element:
        """The force in the form that the kernels take.

        Args:
            label: Its name, for messages.
            undeformed: Settles what the force leaves to the placements.

        Raises:
            ValueError: If its markers coincide where they must not.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class _On(AppliedForce):
    """A force or moment on one body."""

    #: Name of the body and name of the marker.
    marker: BodyPoint

    @property
    def markers(self) -> tuple[Marker, ...]:
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
        return self.a, self.b

    def _check(self, what: str) -> None:
        validation.number(f"{what}: the stiffness", self.stiffness, least=0.0)
        validation.number(f"{what}: the damping", self.damping, least=0.0)


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

    def element(self, label: str, undeformed: Undeformed) -> Element:
        kind = ElementKind.FOLLOWER if self.follower else ElementKind.GLOBAL
        return Element(kind, self.marker, self.marker, {"x": self.x, "y": self.y})

    def _check(self, what: str) -> None:
        check_signal(f"{what}: x", self.x)
        check_signal(f"{what}: y", self.y)
        validation.flag(f"{what}: follower", self.follower)


@dataclass(frozen=True)
class Torque(_On):
    """A moment on a body at a marker, given over time."""

    #: Moment [N m]: a number, a function of time, or a Motion whose value it is.
    moment: Signal = 0.0
    #: Name for results and messages.
    name: str = ""

    def element(self, label: str, undeformed: Undeformed) -> Element:
        table = {"x": 0.0, "y": 0.0, "moment": self.moment}
        return Element(ElementKind.GLOBAL, self.marker, self.marker, table)

    def _check(self, what: str) -> None:
        check_signal(f"{what}: the moment", self.moment)


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

    def element(self, label: str, undeformed: Undeformed) -> Element:
        length, kind = self.length, ElementKind.SPRING
        if length is None:
            what, remedy = f"force {label!r}", "give the length, 0 for an elastic bearing"
            length = undeformed.distance(self.a, self.b, what, remedy)
        elif not (callable(length) or isinstance(length, Motion)) and length == 0.0:
            kind = ElementKind.PLANE_SPRING
        constants = (self.stiffness, self.damping)
        return Element(kind, self.a, self.b, {"length": length}, constants)

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Spring(self.markers),)

    def _check(self, what: str) -> None:
        super()._check(what)
        if self.length is None:
            return
        check_signal(f"{what}: the length", self.length)
        if not (callable(self.length) or isinstance(self.length, Motion)):
            validation.number(f"{what}: the length", self.length, least=0.0, unit="m")


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

    def element(self, label: str, undeformed: Undeformed) -> Element:
        angle = self.angle
        if angle is None:
            angle = undeformed.angle(self.a) - undeformed.angle(self.b)
        constants = (self.stiffness, self.damping)
        return Element(ElementKind.TORSION, self.a, self.b, {"angle": angle}, constants)

    def _check(self, what: str) -> None:
        super()._check(what)
        if self.angle is not None:
            check_signal(f"{what}: the angle", self.angle)
