# SPDX-License-Identifier: MIT
"""Forces and moments on the markers of a mechanism, in the plane and in space.

A force acts on a body at a marker; on a flexible body it bends the body through the marker's shape
functions. Springs and dampers act between two markers, one of which may stand on the ground or move
as prescribed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .. import validation
from .connection import Connection
from .elements import Element, ElementKind
from .marker import BodyPoint, Marker, Triple, axis_vector
from .motion import Motion, Signal, check_signal
from .rows import Undeformed
from .spatial_parts import coincidence, on_plane, turning
from .spatial_rows import (
    BodyVector,
    SpatialElement,
    SpatialLoad,
    SpatialRow,
    SpatialRowKind,
    SpatialSpring,
    UndeformedInSpace,
    VectorKind,
    direction,
    point,
)
from .symbols import Spring, Symbol

__all__ = [
    "AppliedForce",
    "Bushing",
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

    def spatial_element(self, label: str, undeformed: UndeformedInSpace) -> SpatialElement:
        """The force in space, in the form that the kernels take.

        Args:
            label: Its name, for messages.
            undeformed: Settles what the force leaves to the placements.

        Raises:
            ValueError: If it is a force in the plane only, or its markers coincide where they must
                not.
        """
        raise ValueError(f"force {label!r}: {type(self).__name__} is a force in the plane only")


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
    #: Force along z in space [N], likewise.
    z: Signal = 0.0

    def spatial_element(self, label: str, undeformed: UndeformedInSpace) -> SpatialElement:
        axes = _axes(self.marker) if self.follower else ()
        load = SpatialLoad(BodyVector(self.marker), (self.x, self.y, self.z), axes)
        return SpatialElement(loads=(load,))

    def element(self, label: str, undeformed: Undeformed) -> Element:
        if callable(self.z) or isinstance(self.z, Motion) or self.z != 0.0:
            raise ValueError(f"force {label!r}: there is no axis z in the plane")
        kind = ElementKind.FOLLOWER if self.follower else ElementKind.GLOBAL
        return Element(kind, self.marker, self.marker, {"x": self.x, "y": self.y})

    def _check(self, what: str) -> None:
        check_signal(f"{what}: x", self.x)
        check_signal(f"{what}: y", self.y)
        check_signal(f"{what}: z", self.z)
        validation.flag(f"{what}: follower", self.follower)


@dataclass(frozen=True)
class Torque(_On):
    """A moment on a body at a marker, given over time."""

    #: Moment [N m]: a number, a function of time, or a Motion whose value it is; in space three of
    #: these, those about x, y and z.
    moment: Signal | tuple[Signal, Signal, Signal] = 0.0
    #: Name for results and messages.
    name: str = ""
    #: In space, whether x, y and z are the marker's own axes, which turn with it.
    follower: bool = False

    def spatial_element(self, label: str, undeformed: UndeformedInSpace) -> SpatialElement:
        if not isinstance(self.moment, tuple | list):
            raise ValueError(f"force {label!r}: in space the moment has three components")
        axes = _axes(self.marker) if self.follower else ()
        x, y, z = self.moment
        load = SpatialLoad(BodyVector(self.marker, VectorKind.SPIN), (x, y, z), axes)
        return SpatialElement(loads=(load,))

    def element(self, label: str, undeformed: Undeformed) -> Element:
        if isinstance(self.moment, tuple | list):
            raise ValueError(f"force {label!r}: in the plane the moment is one number")
        table = {"x": 0.0, "y": 0.0, "moment": self.moment}
        return Element(ElementKind.GLOBAL, self.marker, self.marker, table)

    def _check(self, what: str) -> None:
        validation.flag(f"{what}: follower", self.follower)
        if not isinstance(self.moment, tuple | list):
            check_signal(f"{what}: the moment", self.moment)
            return
        if len(self.moment) != 3:
            raise ValueError(
                f"{what}: the moment has three components in space, but there are "
                f"{len(self.moment)}"
            )
        for axis, signal in zip("xyz", self.moment, strict=True):
            check_signal(f"{what}: the moment about {axis}", signal)


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

    def spatial_element(self, label: str, undeformed: UndeformedInSpace) -> SpatialElement:
        length, law = self.length, (self.stiffness, self.damping)
        if length is None:
            what, remedy = f"force {label!r}", "give the length, 0 for an elastic bearing"
            length = undeformed.distance(self.a, self.b, what, remedy)
        elif not (callable(length) or isinstance(length, Motion)) and length == 0.0:
            rows = coincidence(self.a, self.b)
            return SpatialElement(tuple(SpatialSpring(row, *law) for row in rows))
        row = SpatialRow(SpatialRowKind.DISTANCE, (point(self.a), point(self.b)))
        return SpatialElement((SpatialSpring(row, *law, length),))

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
    of the first marker minus that of the second; in space that about an axis, see
    :class:`PrescribedAngle`. It counts full turns.
    """

    #: Relative angle without moment [rad], also over time; None takes that of the placements.
    angle: Signal | None = None
    #: Name for results and messages.
    name: str = ""
    #: Axis in space, in the axes of the second marker and of any length.
    axis: Triple = (0.0, 0.0, 1.0)

    def spatial_element(self, label: str, undeformed: UndeformedInSpace) -> SpatialElement:
        rest = self.angle
        vectors = turning(self.a, self.b, self.axis, undeformed, absolute=rest is not None)
        row = SpatialRow(SpatialRowKind.ANGLE, vectors)
        spring = SpatialSpring(row, self.stiffness, self.damping, 0.0 if rest is None else rest)
        return SpatialElement((spring,))

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
        axis_vector(f"{what}: the axis", self.axis)


@dataclass(frozen=True)
class Bushing(AppliedForce):
    """An elastic bearing in space with stiffness and damping along and about each of its axes.

    With d the way from the second marker to the first along the axes e_k of the second, and c_k the
    cosine of the angle between the axes e_i and e_j of the two, which for small rotations are the
    angles about e_k, forces and moments are -stiffness_k d_k - damping_k d_k' and likewise for c_k.
    The rotation without moment is that of the placements. In the plane a :class:`SpringDamper` with
    ``length=0`` and a :class:`TorsionalSpringDamper` make a bushing.
    """

    #: First marker.
    a: Marker
    #: Second marker, in whose axes the bushing lies.
    b: Marker
    #: Stiffness along the axes [N/m].
    stiffness: Triple
    #: Damping along the axes [N s/m].
    damping: Triple = (0.0, 0.0, 0.0)
    #: Stiffness about the axes [N m/rad].
    torsional_stiffness: Triple = (0.0, 0.0, 0.0)
    #: Damping about the axes [N m s/rad].
    torsional_damping: Triple = (0.0, 0.0, 0.0)
    #: Name for results and messages.
    name: str = ""

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.a, self.b

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        return (Spring(self.markers),)

    def element(self, label: str, undeformed: Undeformed) -> Element:
        raise ValueError(
            f"force {label!r}: Bushing is a force in space; in the plane take a SpringDamper with "
            "length=0 and a TorsionalSpringDamper"
        )

    def spatial_element(self, label: str, undeformed: UndeformedInSpace) -> SpatialElement:
        unit, springs = np.eye(3), []
        for k in range(3):
            law = (self.stiffness[k], self.damping[k])
            turn = (self.torsional_stiffness[k], self.torsional_damping[k])
            if any(law):
                springs.append(SpatialSpring(on_plane(self.a, self.b, unit[k]), *law))
            if any(turn):
                own = undeformed.seen_from(self.a, self.b, unit[(k + 1) % 3])
                ends = direction(self.a, own), direction(self.b, unit[(k + 2) % 3])
                springs.append(SpatialSpring(SpatialRow(SpatialRowKind.DOT, ends), *turn))
        return SpatialElement(tuple(springs))

    def _check(self, what: str) -> None:
        for part in ("stiffness", "damping", "torsional_stiffness", "torsional_damping"):
            where = f"{what}: the {part.replace('_', ' ')}"
            for value in validation.real_array(where, getattr(self, part), (3,)):
                validation.number(where, float(value), least=0.0)


def _axes(marker: Marker) -> tuple[BodyVector, ...]:
    """The axes of a marker."""
    return tuple(direction(marker, e) for e in np.eye(3))
