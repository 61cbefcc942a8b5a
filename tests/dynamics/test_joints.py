# SPDX-License-Identifier: MIT
"""Joints one by one: closed forms, forces, energy on flexible bodies, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shared.beams import beam
from shared.motions import check_order

import dolfinx_ffr as ffr

STEPS = np.array([200, 400, 800])


def disc(mass: float = 2.0, inertia: float = 0.5) -> ffr.VolumeIntegrals:
    markers = {"center": (0.0, 0.0), "rim": (0.2, 0.0)}
    return ffr.VolumeIntegrals.rigid(mass, (0.0, 0.0), inertia, markers)


def test_block_slides_down_an_incline() -> None:
    slope, g = 0.5, 9.81
    along = np.array([math.cos(slope), -math.sin(slope)])
    rails = ffr.Translational(
        ("block", "rim"),
        ffr.Ground((0.0, 1.0), angle=0.2),
        (2.0 * math.cos(slope + 0.2), -2.0 * math.sin(slope + 0.2)),
        name="rails",
    )
    mechanism = ffr.Mechanism({"block": ffr.Placement((-0.2, 1.0))}, [rails], gravity=(0.0, -g))
    t = ffr.simulate(mechanism, {"block": disc()}, ffr.GeneralizedAlpha(0.5, 20))
    way = 0.5 * g * math.sin(slope) * t.t**2
    exact = np.array([-0.2, 1.0]) + way[:, None] * along
    np.testing.assert_allclose(t.rigid("block")[:, :2], exact, atol=1e-13)
    np.testing.assert_allclose(t.rigid("block")[:, 2], 0.0, atol=1e-14)
    # The normal force, and the moment that keeps the marker beside the centre of mass upright.
    normal = 2.0 * g * math.cos(slope)
    force = t.joint_force("rails")
    np.testing.assert_allclose(force[:, 0], normal, rtol=1e-12)
    np.testing.assert_allclose(force[:, 1], -0.2 * math.cos(slope) * normal, rtol=1e-12)


def test_translational_joint_keeps_the_given_angle() -> None:
    joint = ffr.Translational(("block", "center"), ffr.Ground(angle=0.1), angle=0.4)
    mechanism = ffr.Mechanism({"block": ffr.Placement((0.1, 0.0), 0.45)}, [joint])
    t = ffr.simulate(mechanism, {"block": disc()}, ffr.GeneralizedAlpha(0.1, 2))
    np.testing.assert_allclose(t.rigid("block")[:, 2], 0.5, atol=1e-14)


@pytest.mark.parametrize("ratio", [-2.5, 0.4])
def test_gear_pair_driven_by_a_torque(ratio: float) -> None:
    moment, own, other = 3.0, 0.5, 0.2
    joints = [
        ffr.Revolute(("driven", "center"), ffr.Ground(), name="axle"),
        ffr.Revolute(("driver", "center"), ffr.Ground((1.0, 0.0)), name="other axle"),
        ffr.Gear(("driven", "rim"), ("driver", "rim"), ratio, name="mesh"),
    ]
    mechanism = ffr.Mechanism(
        {"driven": ffr.Placement(angle=0.3), "driver": ffr.Placement((1.0, 0.0), -0.8)},
        joints,
        forces=[ffr.Torque(("driver", "center"), moment)],
    )
    bodies = {"driven": disc(2.0, own), "driver": disc(1.0, other)}
    t = ffr.simulate(mechanism, bodies, ffr.GeneralizedAlpha(1.0, 20))
    growth = moment / (other + ratio**2 * own)
    driver = -0.8 + 0.5 * growth * t.t**2
    np.testing.assert_allclose(t.rigid("driver")[:, 2], driver, atol=1e-12)
    np.testing.assert_allclose(t.rigid("driven")[:, 2], 0.3 + ratio * (driver + 0.8), atol=1e-12)
    np.testing.assert_allclose(t.joint_force("mesh")[:, 0], own * ratio * growth, rtol=1e-12)


def test_rope_that_shortens_at_constant_rate() -> None:
    """A mass on a rope of length r = r0 + c t: r^2 phi' is constant, the tension m r phi'^2."""
    r0, c, spin, mass, hook = 1.0, -0.4, 2.0, 2.0, ffr.Ground((0.3, 0.0))
    rope = ffr.Distance(("ball", "center"), hook, ffr.Motion.polynomial([r0, c]), name="rope")
    mechanism = ffr.Mechanism(
        {"ball": ffr.Placement((r0 + 0.3, 0.0), velocity=(0.0, spin * r0))}, [rope]
    )

    def errors(steps: int) -> list[float]:
        t = ffr.simulate(mechanism, {"ball": disc(mass)}, ffr.GeneralizedAlpha(1.0, steps))
        r, phi = r0 + c * t.t, spin * r0 * t.t / (r0 + c * t.t)
        exact = np.array([0.3, 0.0]) + r[:, None] * np.stack([np.cos(phi), np.sin(phi)], axis=1)
        tension = mass * (spin * r0**2) ** 2 / r**3
        moved = np.max(np.abs(t.rigid("ball")[:, :2] - exact))
        pulled = np.max(np.abs(t.joint_force("rope")[:, 0] + tension)) / tension[-1]
        return [float(moved), float(pulled)]

    check_order(errors, STEPS, 1e-4, 1e-4)


@pytest.mark.filterwarnings("ignore:.*excites vibrations:dolfinx_ffr.TimeStepWarning")
@pytest.mark.parametrize("modulus", [None, 2.1e13])
def test_bead_on_a_turning_rod(modulus: float | None) -> None:
    """As r'' = omega^2 r: r = r0 cosh(omega t), and the rod pushes with 2 m omega r'."""
    omega, r0, mass, hub = 3.0, 0.1, 0.01, ("rod", "left")
    ends = {"left": (-0.2, 0.0), "middle": (0.0, 0.0)}
    rod = ffr.VolumeIntegrals.rigid(1.0, (0.0, 0.0), 0.1, ends)
    if modulus is not None:
        rod = beam(0.4, 0.04, 0.01, modulus, modes=3, frame="tangent")
    mechanism = ffr.Mechanism(
        {
            "rod": ffr.Placement((0.2, 0.0), 0.0, (0.0, 0.2 * omega), omega),
            "bead": ffr.Placement((r0, 0.0), 0.0, (0.0, omega * r0), 0.0),
        },
        [
            ffr.Revolute(hub, ffr.Ground()),
            ffr.PrescribedAngle(hub, ffr.Motion.polynomial([0.0, omega])),
            ffr.PointOnLine(("bead", "center"), ("rod", "middle"), (-2.0, 0.0), name="slide"),
        ],
    )

    def errors(steps: int) -> list[float]:
        bodies = {"rod": rod, "bead": disc(mass, 1e-4)}
        t = ffr.simulate(mechanism, bodies, ffr.GeneralizedAlpha(0.5, steps))
        r, phi = r0 * np.cosh(omega * t.t), omega * t.t
        exact = r[:, None] * np.stack([np.cos(phi), np.sin(phi)], axis=1)
        push = 2.0 * mass * omega**2 * r0 * np.sinh(omega * t.t)
        moved = np.max(np.abs(t.rigid("bead")[:, :2] - exact))
        # The normal is a quarter turn ahead of the line's direction, which points inwards.
        pushed = np.max(np.abs(t.joint_force("slide")[:, 0] + push)) / push[-1]
        return [float(moved), float(pushed)]

    if modulus is None:
        check_order(errors, STEPS, 1e-6, 1e-4)
    else:  # the rod bends by a millionth of its length
        assert np.all(np.array(errors(800)) < [1e-6, 1e-3])


def test_linear_drive_moves_a_carriage_along_a_turning_arm() -> None:
    """An arm turned by a motor, and a carriage that a spindle moves out along it."""
    arm = ffr.VolumeIntegrals.rigid(
        1.0, (0.0, 0.0), 0.1, {"left": (-0.2, 0.0), "middle": (0.0, 0.0)}
    )
    carriage, hub, turned = ("carriage", "center"), ("arm", "left"), 0.3
    direction = (2.0 * math.cos(turned), 2.0 * math.sin(turned))
    spindle = ffr.Motion.polynomial([0.05, 0.1, 0.2])
    mechanism = ffr.Mechanism(
        {"arm": ffr.Placement((0.2, 0.0)), "carriage": ffr.Placement((0.25, 0.01))},
        [
            ffr.Revolute(hub, ffr.Ground(), name="bearing"),
            ffr.PrescribedAngle(hub, ffr.Motion.polynomial([0.0, 3.0]), name="motor"),
            ffr.Translational(carriage, hub, direction, name="rails"),
            ffr.LinearDrive(carriage, hub, spindle, direction, name="spindle"),
        ],
    )
    bodies = {"arm": arm, "carriage": disc(0.2, 1e-3)}
    t = ffr.simulate(mechanism, bodies, ffr.GeneralizedAlpha(0.5, 400))
    way, angle = 0.05 + 0.1 * t.t + 0.2 * t.t**2, 3.0 * t.t + turned
    exact = way[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    seen = t.marker_path(*carriage) - t.marker_path(*hub)
    np.testing.assert_allclose(seen, exact, atol=1e-12)
    # m (r'' - omega^2 r) along the line, 2 m omega r' across it
    push, side = 0.2 * (0.4 - 9.0 * way), 0.2 * 2.0 * 3.0 * (0.1 + 0.4 * t.t)
    np.testing.assert_allclose(t.joint_force("spindle")[:, 0], push, atol=1e-4)
    np.testing.assert_allclose(t.joint_force("rails")[:, 0], side, atol=1e-4)
