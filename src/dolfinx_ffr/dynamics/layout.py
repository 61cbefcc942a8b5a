# SPDX-License-Identifier: MIT
"""Joints as scalar rows and forces as elements, in the form that the kernels take."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body import VolumeIntegrals
from ..forces import AppliedForce, Force, SpringDamper, Torque, TorsionalSpringDamper
from ..joints import (
    Distance,
    Gear,
    Joint,
    PointOnLine,
    PrescribedAngle,
    PrescribedPosition,
    Revolute,
    Translational,
    Weld,
)
from ..mechanism import Placement
from ..motion import Motion, Signal, sample
from ..points import Ground, Marker, Pair
from .arrays import (
    ANGLE,
    DISTANCE,
    FOLLOWER,
    GLOBAL,
    LINE,
    PLANE_SPRING,
    SPRING,
    TORSION,
    X,
    Y,
)

__all__ = [
    "Element",
    "Row",
    "Undeformed",
    "element_of_force",
    "rows_of_joint",
    "table_of_element",
]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Row:
    """One scalar constraint g(z_a, z_b) = constant + motion(t)."""

    kind: int
    a: Marker
    b: Marker
    normal: Pair = (0.0, 0.0)
    ratio: float = 1.0
    constant: float = 0.0
    motion: Motion | None = None


@dataclass(frozen=True)
class Element:
    """One force between two markers, which may be the same."""

    kind: int
    a: Marker
    b: Marker
    constants: Pair
    #: Entries of the table over time, by name.
    table: Mapping[str, Signal]


@dataclass(frozen=True)
class Undeformed:
    """Where markers are in the placements, which settles lengths and angles that are not given."""

    placements: Mapping[str, Placement]
    bodies: Mapping[str, VolumeIntegrals]
    #: Time of the start, shape (1,) [s].
    start: Array

    def angle(self, marker: Marker) -> float:
        """Angle of a marker's axes [rad]."""
        if isinstance(marker, tuple):
            return self.placements[marker[0]].angle
        return float(marker.motions[2].tabulate(self.start)[0, 0])

    def position(self, marker: Marker) -> Array:
        """Position of a marker, shape (2,) [m]."""
        if not isinstance(marker, tuple):
            return np.array([motion.tabulate(self.start)[0, 0] for motion in marker.motions[:2]])
        placement, (x, y) = (
            self.placements[marker[0]],
            self.bodies[marker[0]].markers[marker[1]].position,
        )
        c, s = math.cos(placement.angle), math.sin(placement.angle)
        return np.array(placement.position) + np.array([c * x - s * y, s * x + c * y])

    def distance(self, a: Marker, b: Marker) -> float:
        """Distance of two markers [m]."""
        return float(np.hypot(*(self.position(a) - self.position(b))))


def rows_of_joint(joint: Joint, label: str, undeformed: Undeformed) -> list[Row]:
    """Scalar rows of a joint.

    Args:
        joint: The joint.
        label: Its name, for messages.
        undeformed: Settles what the joint leaves to the placements.

    Raises:
        ValueError: If the kind of the joint is unknown, or its markers coincide where they must
            not.
    """

    def angle(given: float | None, a: Marker, b: Marker, ratio: float = 1.0) -> Row:
        if given is None:
            given = undeformed.angle(a) - ratio * undeformed.angle(b)
        return Row(ANGLE, a, b, ratio=ratio, constant=given)

    def line(point: Marker, line: Marker, direction: Pair) -> Row:
        length = math.hypot(*direction)
        return Row(LINE, point, line, (-direction[1] / length, direction[0] / length))

    if isinstance(joint, Revolute):
        return [Row(kind, joint.a, joint.b) for kind in (X, Y)]
    if isinstance(joint, Weld):
        pin = [Row(kind, joint.a, joint.b) for kind in (X, Y)]
        return [*pin, angle(joint.angle, joint.a, joint.b)]
    if isinstance(joint, PointOnLine):
        return [line(joint.point, joint.line, joint.direction)]
    if isinstance(joint, Translational):
        return [
            line(joint.a, joint.b, joint.direction),
            angle(joint.angle, joint.a, joint.b),
        ]
    if isinstance(joint, Gear):
        return [angle(None, joint.a, joint.b, joint.ratio)]
    if isinstance(joint, Distance):
        if isinstance(joint.length, Motion):
            return [Row(DISTANCE, joint.a, joint.b, motion=joint.length)]
        length = joint.length
        if length is None:
            length = undeformed.distance(joint.a, joint.b)
            _refuse_zero(f"joint {label!r}", length, "a Revolute joins them")
        return [Row(DISTANCE, joint.a, joint.b, constant=length)]
    if isinstance(joint, PrescribedAngle):
        return [Row(ANGLE, joint.marker, joint.relative_to, motion=joint.motion)]
    if isinstance(joint, PrescribedPosition):
        kind = X if joint.axis == "x" else Y
        return [Row(kind, joint.marker, Ground(), motion=joint.motion)]
    raise ValueError(f"a joint of unknown kind: {type(joint).__name__}")


def element_of_force(force: AppliedForce, label: str, undeformed: Undeformed) -> Element:
    """A force in the form that the kernels take.

    Args:
        force: The force.
        label: Its name, for messages.
        undeformed: Settles what the force leaves to the placements.

    Raises:
        ValueError: If the kind of the force is unknown, or its markers coincide where they must
            not.
    """
    if isinstance(force, Force):
        kind = FOLLOWER if force.follower else GLOBAL
        table: dict[str, Signal] = {"x": force.x, "y": force.y}
        return Element(kind, force.marker, force.marker, (0.0, 0.0), table)
    if isinstance(force, Torque):
        table = {"x": 0.0, "y": 0.0, "moment": force.moment}
        return Element(GLOBAL, force.marker, force.marker, (0.0, 0.0), table)
    if isinstance(force, SpringDamper):
        length, kind = force.length, SPRING
        if length is None:
            length = undeformed.distance(force.a, force.b)
            _refuse_zero(f"force {label!r}", length, "give the length, 0 for an elastic bearing")
        elif not (callable(length) or isinstance(length, Motion)) and length == 0.0:
            kind = PLANE_SPRING
        constants = (force.stiffness, force.damping)
        return Element(kind, force.a, force.b, constants, {"length": length})
    if isinstance(force, TorsionalSpringDamper):
        angle = force.angle
        if angle is None:
            angle = undeformed.angle(force.a) - undeformed.angle(force.b)
        constants = (force.stiffness, force.damping)
        return Element(TORSION, force.a, force.b, constants, {"angle": angle})
    raise ValueError(f"a force of unknown kind: {type(force).__name__}")


def table_of_element(element: Element, label: str, instants: Array) -> Array:
    """Table (instants, 3) of a force.

    Args:
        element: The force.
        label: Its name, for messages.
        instants: Times, shape (instants,) [s].

    Raises:
        ValueError: If an entry is NaN or infinite, or a length negative.
    """
    table = np.zeros((instants.size, 3))
    for column, (name, signal) in enumerate(element.table.items()):
        table[:, column] = sample(signal, instants, f"force {label!r}: {name}")
    if element.kind == SPRING and np.min(table[:, 0]) < 0.0:
        raise ValueError(
            f"force {label!r}: the length must not be negative, but it is {table[:, 0].min():g} m"
        )
    return table


def _refuse_zero(what: str, length: float, remedy: str) -> None:
    if not length > 0.0:
        raise ValueError(f"{what}: the markers coincide in the placements; {remedy}")
