# SPDX-License-Identifier: MIT
"""Forces and moments on the markers of a mechanism, in the plane and in space.

A force acts on a body at a marker; on a flexible body it bends the body through the marker's shape
functions. Springs and dampers act between two markers; one may stand on the ground or move as
prescribed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .. import validation
from .connection import Connection, Spring
from .marker import BodyPoint, Marker, Triple, axis_vector
from .motion import Motion, Signal, check_signal, is_zero
from .rows import BodyVector, Element, Load, Row, RowKind, SpringRow, VectorKind, direction, point
from .undeformed import Undeformed, coincidence, on_plane, relative_angle

#: Error for a spring of infinite stiffness
_RIGID = "{}: the stiffness and the damping must be finite; a joint holds without giving way"


@dataclass(frozen=True)
class AppliedForce(Connection):
    """Base class of all forces."""

    kind: ClassVar[str] = "force"

    def element(self, undeformed: Undeformed) -> Element:
        """Springs and loads that make up the force, in the plane or in space.

        ``undeformed`` has the dimension and the placements, from which lengths and angles follow
        that the force does not give. A ValueError refuses arguments without meaning there.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class _On(AppliedForce):
    """A force or moment on one body."""

    marker: BodyPoint  #: Name of the body and name of the marker.


@dataclass(frozen=True)
class _Between(AppliedForce):
    """A spring and a damper side by side between two markers."""

    a: Marker  #: First marker.
    b: Marker  #: Second marker.
    stiffness: float  #: Stiffness [N/m], of a torsional spring [N m/rad].
    damping: float = 0.0  #: Damping [N s/m], of a torsional damper [N m s/rad].

    def _check(self, what: str) -> None:
        if validation.is_number(self.stiffness) and self.stiffness == math.inf:
            raise ValueError(_RIGID.format(what))
        validation.number(f"{what}: the stiffness", self.stiffness, least=0.0)
        validation.number(f"{what}: the damping", self.damping, least=0.0)


@dataclass(frozen=True)
class Force(_On):
    """A force on a body at a marker, given over time.

    Attributes:
        marker: Name of the body and name of the marker.
        x: Force along x [N]: a number, a function of time, or a Motion whose value it is.
        y: Force along y [N], likewise.
        follower: Whether x and y are the marker's own axes, which turn with it, and not the global
            ones.
        name: Name for results and messages.
        z: Force along z in space [N], likewise.
    """

    x: Signal = 0.0
    y: Signal = 0.0
    follower: bool = False
    name: str = ""
    z: Signal = 0.0

    def element(self, undeformed: Undeformed) -> Element:
        axes = _axes(self.marker) if self.follower else ()
        return Element(loads=(Load(point(self.marker), (self.x, self.y, self.z), axes),))

    def _check(self, what: str) -> None:
        check_signal(f"{what}: x", self.x)
        check_signal(f"{what}: y", self.y)
        check_signal(f"{what}: z", self.z)
        validation.flag(f"{what}: follower", self.follower)


@dataclass(frozen=True)
class Torque(_On):
    """A moment on a body at a marker, given over time.

    Attributes:
        marker: Name of the body and name of the marker.
        moment: Moment [N m]: a number, a function of time, or a Motion whose value it is; in space
            three of these, about x, y and z.
        name: Name for results and messages.
        follower: In space, whether x, y and z are the marker's own axes, which turn with it.
    """

    moment: Signal | tuple[Signal, Signal, Signal] = 0.0
    name: str = ""
    follower: bool = False

    def element(self, undeformed: Undeformed) -> Element:
        spin = BodyVector(self.marker, VectorKind.SPIN)
        if undeformed.dimension == 2:
            if isinstance(self.moment, tuple | list):
                raise ValueError(f"{undeformed.user}: in the plane the moment is one number")
            return Element(loads=(Load(spin, (0.0, 0.0, self.moment)),))
        if not isinstance(self.moment, tuple | list):
            raise ValueError(f"{undeformed.user}: in space the moment has three components")
        x, y, z = self.moment
        return Element(loads=(Load(spin, (x, y, z), _axes(self.marker) if self.follower else ()),))

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

    Attributes:
        a: First marker.
        b: Second marker.
        stiffness: Stiffness [N/m], of a torsional spring [N m/rad].
        damping: Damping [N s/m], of a torsional damper [N m s/rad].
        length: Length without force [m], also over time, as of an actuator; None: as in the
            placements.
        name: Name for results and messages.
    """

    length: Signal | None = None
    name: str = ""

    drawn = (Spring,)

    def element(self, undeformed: Undeformed) -> Element:
        length, law = self.length, (self.stiffness, self.damping)
        if length is None:
            remedy = "give the length, 0 for an elastic bearing"
            length = undeformed.distance(self.a, self.b, remedy)
        elif is_zero(length):
            rows = coincidence(self.a, self.b, undeformed)
            return Element(tuple(SpringRow(row, *law) for row in rows))
        row = Row(RowKind.DISTANCE, (point(self.a), point(self.b)))
        return Element((SpringRow(row, *law, length),))

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
    of the first marker minus the angle of the second; in space about an axis, see
    :class:`PrescribedAngle`. It is unwrapped.

    Attributes:
        a: First marker.
        b: Second marker.
        stiffness: Stiffness [N/m], of a torsional spring [N m/rad].
        damping: Damping [N s/m], of a torsional damper [N m s/rad].
        angle: Relative angle without moment [rad], also over time; None: as in the placements.
        name: Name for results and messages.
        axis: Axis in space, in the axes of the second marker and of any length.
    """

    angle: Signal | None = None
    name: str = ""
    axis: Triple = (0.0, 0.0, 1.0)

    def element(self, undeformed: Undeformed) -> Element:
        has_angle = self.angle is not None
        row = relative_angle(self.a, self.b, self.axis, undeformed, has_angle)
        free_angle = 0.0 if self.angle is None else self.angle
        return Element((SpringRow(row, self.stiffness, self.damping, free_angle),))

    def _check(self, what: str) -> None:
        super()._check(what)
        if self.angle is not None:
            check_signal(f"{what}: the angle", self.angle)
        axis_vector(f"{what}: the axis", self.axis)


@dataclass(frozen=True)
class Bushing(AppliedForce):
    """An elastic bearing in space with stiffness and damping along and about each of its axes.

    With d the vector from the second marker to the first along the axes e_k of the second, and c_k
    the cosine of the angle between the axes e_i and e_j of the two, for small rotations the angle
    about e_k, forces and moments are -stiffness_k d_k - damping_k d_k' and likewise for c_k. There
    is no moment at the rotation of the placements. In the plane a :class:`SpringDamper` with
    ``length=0`` and a :class:`TorsionalSpringDamper` make a bushing.

    Attributes:
        a: First marker.
        b: Second marker, in whose axes the bushing lies.
        stiffness: Stiffness along the axes [N/m].
        damping: Damping along the axes [N s/m].
        torsional_stiffness: Stiffness about the axes [N m/rad].
        torsional_damping: Damping about the axes [N m s/rad].
        name: Name for results and messages.
    """

    a: Marker
    b: Marker
    stiffness: Triple
    damping: Triple = (0.0, 0.0, 0.0)
    torsional_stiffness: Triple = (0.0, 0.0, 0.0)
    torsional_damping: Triple = (0.0, 0.0, 0.0)
    name: str = ""

    dimension: ClassVar[int | None] = 3
    drawn = (Spring,)
    in_the_plane: ClassVar[str] = "a SpringDamper with length=0 and a TorsionalSpringDamper"

    def element(self, undeformed: Undeformed) -> Element:
        unit, springs = np.eye(3), []
        for k in range(3):
            law = (self.stiffness[k], self.damping[k])
            torsion = (self.torsional_stiffness[k], self.torsional_damping[k])
            if any(law):
                springs.append(SpringRow(on_plane(self.a, self.b, unit[k]), *law))
            if any(torsion):
                in_first_marker = undeformed.seen_from(self.a, self.b, unit[(k + 1) % 3])
                ends = direction(self.a, in_first_marker), direction(self.b, unit[(k + 2) % 3])
                springs.append(SpringRow(Row(RowKind.DOT, ends), *torsion))
        return Element(tuple(springs))

    def _check(self, what: str) -> None:
        for name in ("stiffness", "damping", "torsional_stiffness", "torsional_damping"):
            label = f"{what}: the {name.replace('_', ' ')}"
            if np.any(validation.numbers(label, getattr(self, name)) == np.inf):
                raise ValueError(_RIGID.format(what))
            for value in validation.real_array(label, getattr(self, name), (3,)):
                validation.number(label, float(value), least=0.0)


def _axes(marker: Marker) -> tuple[BodyVector, ...]:
    return tuple(direction(marker, e) for e in np.eye(3))
