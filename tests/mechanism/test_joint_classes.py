# SPDX-License-Identifier: MIT
"""A joint is one class: what it says of itself is all that simulation and pictures need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import dolfinx_ffr as ffr
from dolfinx_ffr.mechanism import (
    AngleCoupling,
    AppliedForce,
    BodyVector,
    Element,
    Joint,
    Load,
    Marker,
    Pin,
    Row,
    RowKind,
    SpringRow,
    Symbol,
    Undeformed,
    VectorKind,
    coincidence,
    direction,
    point,
    relative_angle,
)

#: The origin fits the plane and space
A, B = ("block", "center"), ffr.Ground(name="wall")
STILL = ffr.Motion.constant(0.5)
BODIES = {"block": ffr.VolumeIntegrals.rigid(3.0, (0.0, 0.0), 0.5, {"center": (0.0, 0.0)})}


@dataclass(frozen=True)
class LevelSwing(Joint):
    """A joint of one's own: a marker on a circle, and level; two rows of unlike kinds."""

    marker: Marker
    center: Marker
    radius: float

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.marker, self.center

    def rows(self, undeformed: Undeformed) -> list[Row]:
        ends = point(self.marker), point(self.center)
        swing = Row(RowKind.DISTANCE, ends, constant=self.radius)
        return [swing, relative_angle(*self.markers, (0.0, 0.0, 1.0), undeformed)]


def test_joint_of_ones_own() -> None:
    """A block that hangs level on two parallel bars is a mathematical pendulum."""
    joint = LevelSwing(("block", "center"), ffr.Ground(), 2.0)
    symbols: tuple[Symbol, ...] = (Pin(joint.markers),)
    assert joint.symbols == symbols
    mechanism = ffr.Mechanism({"block": ffr.Placement((2.0, 0.1))}, [joint], gravity=(0.0, -9.81))
    t = ffr.simulate(mechanism, BODIES, ffr.GeneralizedAlpha(0.5, 1000))
    place = t.rigid("block")
    np.testing.assert_allclose(np.hypot(place[:, 0], place[:, 1]), 2.0, rtol=1e-13)
    np.testing.assert_allclose(place[:, 2], 0.0, atol=1e-14)
    energy = t.kinetic_energy("block") + t.potential_energy("block")
    np.testing.assert_allclose(energy, energy[0], atol=1e-4 * np.ptp(t.kinetic_energy("block")))
    # The bars carry the weight along them and what turns the velocity.
    along = place[:, :2] / 2.0
    speed = np.sum(t.v[:, :2] ** 2, axis=1)
    pull = 3.0 * (-9.81 * along[:, 1] + speed / 2.0)
    force = -t.joint_force("LevelSwing(block.center, ground)")[:, 0]
    np.testing.assert_allclose(force, pull, atol=1e-4 * np.max(np.abs(pull)))


@dataclass(frozen=True)
class Own(Joint):
    """A joint of one's own with one row."""

    row: Row

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return A, B

    def rows(self, undeformed: Undeformed) -> list[Row]:
        return [self.row]


@dataclass(frozen=True)
class OwnForce(AppliedForce):
    """A force of one's own."""

    own: Element

    @property
    def markers(self) -> tuple[Marker, ...]:
        return (A,)

    def element(self, undeformed: Undeformed) -> Element:
        return self.own


ENDS, DOWN, ASIDE = (point(A), point(B)), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)
X, Y, Z = (direction(B, axis) for axis in np.eye(3))
ALONG_X = Row(RowKind.POINT, ENDS, ASIDE)
REFUSED: list[tuple[Joint | AppliedForce, str]] = [
    (
        AngleCoupling(A, B, 2.0, axis=ASIDE),
        "the axis is perpendicular to the plane in which",
    ),
    (ffr.Gear(A, B, -2.0), "centres of the wheels lie on one axis .* an AngleCoupling couples"),
    (
        ffr.PrescribedAngle(A, STILL, B, axis=DOWN),
        r"count about the axis \(0, 0, 1\); give this axis",
    ),
    (Own(Row(RowKind.DOT, (X, Y))), "a row DOT of these vectors.* exists in space only"),
    (Own(Row(RowKind.POINT, ENDS, (0.6, 0.8, 0.0))), "in the plane take POINT along x or y"),
    (Own(Row(RowKind.PLANE, (*ENDS, Z))), "a row PLANE of these"),
    (Own(Row(RowKind.DISTANCE, (X, Y))), "a row DISTANCE of these"),
    (
        Own(Row(RowKind.GEAR, (X, X, Y, *[direction(A, e) for e in np.eye(3)[[0, 0, 1]]]))),
        "a row GEAR",
    ),
    (OwnForce(Element((SpringRow(Row(RowKind.PLANE, (*ENDS, Z)), 1.0, 0.0),))), "a row PLANE of"),
    (OwnForce(Element(loads=(Load(point(A), ASIDE, (X, Y, Z)),))), "axes of its own marker"),
    (OwnForce(Element(loads=(Load(BodyVector(A, VectorKind.SPIN), ASIDE),))), "about z"),
    (ffr.Force(A, z=1.0), "there is no axis z in the plane"),
    (ffr.PrescribedPosition(A, "z", STILL), "no axis z in the plane"),
    (ffr.PointOnLine(A, B, ASIDE), "direction of the line has three"),
    (ffr.Revolute(A, B, axis=ASIDE), "perpendicular to the plane"),
    (
        ffr.Bushing(A, B, (1.0, 1.0, 1.0)),
        "there it is a SpringDamper with length=0 and a Torsional",
    ),
    (ffr.Spherical(A, B), "is in space, but body 'block' is in the plane; there it is a Revolute"),
]


@pytest.mark.parametrize(("thing", "message"), REFUSED, ids=[type(t).__name__ for t, _ in REFUSED])
def test_what_the_plane_does_not_have_is_refused(thing: Joint | AppliedForce, message: str) -> None:
    connections = {"joints": [thing]} if isinstance(thing, Joint) else {"forces": [thing]}
    mechanism = ffr.Mechanism({"block": ffr.Placement()}, **connections)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=message):
        ffr.simulate(mechanism, BODIES, ffr.GeneralizedAlpha(0.1, 1))


@dataclass(frozen=True)
class Bush(OwnForce):
    """An elastic bearing that resists turning, too."""

    def element(self, undeformed: Undeformed) -> Element:
        turn = relative_angle(A, B, (0.0, 0.0, 1.0), undeformed)
        springs = [SpringRow(row, 20.0, 0.0) for row in coincidence(A, B, undeformed)]
        return Element((*springs, SpringRow(turn, 5.0, 0.0)))


def test_a_spring_of_ones_own_acts_along_one_axis() -> None:
    """The block swings along x as a spring and a mass do, and keeps its place along y."""
    spring = OwnForce(Element((SpringRow(ALONG_X, 12.0, 0.0),)))
    mechanism = ffr.Mechanism({"block": ffr.Placement((0.1, -0.2))}, forces=[spring])
    motion = ffr.simulate(mechanism, BODIES, ffr.GeneralizedAlpha(1.0, 1000))
    place = motion.rigid("block")
    np.testing.assert_allclose(place[:, 0], 0.1 * np.cos(2.0 * motion.t), atol=1e-6)
    np.testing.assert_allclose(place[:, 1:], [[-0.2, 0.0]] * len(place), atol=1e-15)


def test_a_force_of_ones_own_in_the_plane_has_several_parts() -> None:
    """It is their sum; full turns count."""
    bush, start = Bush(Element()), ffr.Placement((0.1, -0.2), 7.0)
    with pytest.warns(ffr.PlacementWarning, match="more than a full turn"):
        mechanism = ffr.Mechanism({"block": start}, forces=[bush])
    motion = ffr.simulate(mechanism, BODIES, ffr.GeneralizedAlpha(0.01, 1))
    assert motion.applied_force(bush.label)[0] == pytest.approx([-2.0, 4.0, -35.0], rel=1e-13)
