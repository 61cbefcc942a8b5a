# SPDX-License-Identifier: MIT
"""A joint is one class: what it says of itself is all that simulation and pictures need."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from dolfinx_ffr.body import VolumeIntegrals
from dolfinx_ffr.dynamics import GeneralizedAlpha, simulate
from dolfinx_ffr.mechanism import (
    Distance,
    Gear,
    Ground,
    Joint,
    Line,
    LinearDrive,
    Marker,
    Mechanism,
    Motion,
    Pin,
    Placement,
    PointOnLine,
    PrescribedAngle,
    PrescribedPosition,
    Revolute,
    Row,
    RowKind,
    Slider,
    Square,
    Symbol,
    Translational,
    Undeformed,
    Weld,
)

A, B = ("block", "center"), Ground((1.0, 0.5), angle=0.2)
STILL = Motion.constant(0.5)
KINDS: list[tuple[Joint, list[RowKind], list[type[Symbol]]]] = [
    (Revolute(A, B), [RowKind.X, RowKind.Y], [Pin]),
    (Weld(A, B), [RowKind.X, RowKind.Y, RowKind.ANGLE], [Square]),
    (PointOnLine(A, B), [RowKind.LINE], [Slider]),
    (Translational(A, B), [RowKind.LINE, RowKind.ANGLE], [Slider]),
    (Gear(A, B, -2.0), [RowKind.ANGLE], []),
    (Distance(A, B), [RowKind.DISTANCE], [Pin, Line]),
    (PrescribedAngle(A, STILL, B), [RowKind.ANGLE], []),
    (PrescribedPosition(A, "y", STILL), [RowKind.Y], [Pin]),
    (LinearDrive(A, B, STILL), [RowKind.LINE], [Line]),
]


@pytest.mark.parametrize(
    ("joint", "kinds", "symbols"), KINDS, ids=[type(joint).__name__ for joint, *_ in KINDS]
)
def test_rows_and_symbols(joint: Joint, kinds: list[RowKind], symbols: list[type[Symbol]]) -> None:
    undeformed = Undeformed({"block": Placement()}, {A: np.zeros(2)}, np.zeros(1))
    rows = joint.rows("joint", undeformed)
    assert [row.kind for row in rows] == kinds
    assert all((row.a, row.b) == joint.markers for row in rows)
    assert [type(symbol) for symbol in joint.symbols] == symbols
    assert all(symbol.markers == joint.markers for symbol in joint.symbols)
    assert joint.rigid == (len(rows) == 3)
    for row in rows:
        if row.kind == RowKind.LINE:
            assert np.hypot(*row.normal) == pytest.approx(1.0, rel=1e-15)


@dataclass(frozen=True)
class LevelSwing(Joint):
    """A joint of one's own: a marker on a circle, and level; two rows of unlike kinds."""

    marker: Marker
    center: Marker
    radius: float

    @property
    def markers(self) -> tuple[Marker, Marker]:
        return self.marker, self.center

    def rows(self, label: str, undeformed: Undeformed) -> list[Row]:
        swing = Row(RowKind.DISTANCE, *self.markers, constant=self.radius)
        return [swing, Row(RowKind.ANGLE, *self.markers)]


def test_joint_of_ones_own() -> None:
    """A block that hangs level on two parallel bars is a mathematical pendulum."""
    joint = LevelSwing(("block", "center"), Ground(), 2.0)
    symbols: tuple[Symbol, ...] = (Pin(joint.markers),)
    assert joint.symbols == symbols
    block = VolumeIntegrals.rigid(3.0, (0.0, 0.0), 0.5, {"center": (0.0, 0.0)})
    mechanism = Mechanism({"block": Placement((2.0, 0.1))}, [joint], gravity=(0.0, -9.81))
    t = simulate(mechanism, {"block": block}, GeneralizedAlpha(0.5, 1000))
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
class OldSwing(LevelSwing):
    """A joint that is checked as in the release before."""

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.radius <= 0.0:
            yield ": the radius must be positive"


def test_joint_with_checks_of_the_release_before() -> None:
    """They are still made, with a warning."""
    ends, warned = (("block", "center"), Ground()), "overrides _faults.* name the method _check"
    with pytest.warns(DeprecationWarning, match=warned):
        Mechanism({"block": Placement()}, [OldSwing(*ends, 1.0)])
    with (
        pytest.warns(DeprecationWarning, match=warned),
        pytest.raises(ValueError, match=r"joint 'OldSwing\(.*: the radius must be positive"),
    ):
        Mechanism({"block": Placement()}, [OldSwing(*ends, 0.0)])
