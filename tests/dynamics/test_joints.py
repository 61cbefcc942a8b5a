# SPDX-License-Identifier: MIT
"""Joints one by one: closed forms, forces, energy on flexible bodies, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shared.beams import beam
from shared.motions import check_order

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Integrator, Trajectory

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
    distance = 0.5 * g * math.sin(slope) * t.t**2
    exact = np.array([-0.2, 1.0]) + distance[:, None] * along
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
        ffr.mechanism.AngleCoupling(("driven", "rim"), ("driver", "rim"), ratio, name="mesh"),
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


def wheel(inertia: float, space: bool, mass: float = 1.0) -> ffr.VolumeIntegrals:
    """A body with its centre at the origin of its frame, in the plane or in space."""
    markers = {"center": (0.0, 0.0, 0.0)[: 2 + space], "rim": (0.2, 0.0, 0.0)[: 2 + space]}
    moments = (0.6 * inertia, 0.6 * inertia, inertia) if space else inertia
    return ffr.VolumeIntegrals.rigid(mass, inertia=moments, markers=markers)


def ground(x: float, y: float, space: bool) -> ffr.Ground:
    return ffr.Ground((x, y, 0.0)[: 2 + space])


def at(x: float, y: float, space: bool, spin: float = 0.0, speed: float = 0.0) -> ffr.Placement:
    """A placement that turns about z and moves along y."""
    velocity = (0.0, speed, 0.0)[: 2 + space]
    rate = (0.0, 0.0, spin) if space else spin
    return ffr.Placement((x, y, 0.0)[: 2 + space], velocity=velocity, angular_velocity=rate)


def torque(body: str, moment: float, space: bool) -> ffr.Torque:
    return ffr.Torque((body, "center"), (0.0, 0.0, moment) if space else moment)


def spin(trajectory: Trajectory, body: str) -> np.ndarray:
    """Angular velocity about z."""
    return trajectory.v[:, trajectory.model.coordinates(body).rigid][:, -1]


@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize("angle", [0.0, math.radians(20.0)])
def test_teeth_load_the_bearings(angle: float, space: bool) -> None:
    """Two wheels of 0.2 m: 20 N m need 100 N along the tangent, and more along the line."""
    moment, inertia = 20.0, 0.5
    bodies = {name: wheel(inertia, space) for name in ("driven", "driver")}
    mechanism = ffr.Mechanism(
        {"driven": at(0.0, 0.0, space), "driver": at(0.0, 0.4, space)},
        [
            ffr.Revolute(("driven", "center"), ground(0.0, 0.0, space), name="axle"),
            ffr.Revolute(("driver", "center"), ground(0.0, 0.4, space), name="other axle"),
            ffr.Gear(("driven", "center"), ("driver", "center"), -1.0, "teeth", angle),
        ],
        forces=[torque("driver", -2.0 * moment, space)],
    )
    t = ffr.simulate(mechanism, bodies, ffr.GeneralizedAlpha(1.0, 20))
    # Half of the moment accelerates the driver, the other half the driven wheel by the teeth.
    np.testing.assert_allclose(spin(t, "driven"), moment / inertia * t.t, atol=1e-10)
    np.testing.assert_allclose(t.joint_force("teeth")[:, 0], 100.0 / math.cos(angle), rtol=1e-9)
    # The teeth push at (0, 0.2), above the driven wheel: to the left, and apart.
    push = np.array([-100.0, -100.0 * math.tan(angle)])
    for axle, sign in (("axle", -1.0), ("other axle", 1.0)):
        force = t.joint_force(axle)
        np.testing.assert_allclose(force[:, :2], np.broadcast_to(sign * push, (21, 2)), atol=1e-8)
        np.testing.assert_allclose(force[:, 2:], 0.0, atol=1e-9)


def test_teeth_of_the_other_flank_are_told() -> None:
    """They would pull the wheels together where they push them apart."""
    bodies = {"wheel": wheel(0.5, False)}
    mechanism = ffr.Mechanism(
        {"wheel": ffr.Placement()},
        [
            ffr.Revolute(("wheel", "center"), ffr.Ground()),
            ffr.Gear(("wheel", "center"), ffr.Ground((0.4, 0.0)), -1.0, "teeth", -0.3),
        ],
        forces=[torque("wheel", -20.0, False)],
    )
    message = r"'teeth'.* pull .* up to 105 N, and push by 0 N at most: give pressure_angle=0.3,"
    with pytest.warns(ffr.dynamics.GearFlankWarning, match=message):
        ffr.simulate(mechanism, bodies, ffr.GeneralizedAlpha(0.1, 5))


@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize(
    "integrator", [ffr.GeneralizedAlpha(2.0, 200), ffr.RadauIIA(2.0, steps=100)]
)
def test_pin_of_a_planet_carries_both_teeth(integrator: Integrator, space: bool) -> None:
    """The sun's 10 N m on 0.1 m are 100 N on the planet, and so is the ring's share: 200 N.

    40 N m hold the carrier, so that all turns uniformly; the ring is at rest.
    """
    moment, sun, planet, ring, speed = 10.0, 0.1, 0.1, 0.3, 40.0
    bodies = {"sun": wheel(0.3, space), "carrier": wheel(0.7, space)}
    bodies["planet"] = wheel(1e-3, space, 1e-6)
    spins = {"sun": speed, "carrier": speed / 4.0, "planet": -speed / 2.0}
    places = {"sun": 0.0, "carrier": 0.0, "planet": sun + planet}
    mechanism = ffr.Mechanism(
        {n: at(places[n], 0.0, space, spins[n], places[n] * spins["carrier"]) for n in bodies},
        [
            ffr.Revolute(("sun", "center"), ground(0.0, 0.0, space)),
            ffr.Revolute(("carrier", "center"), ground(0.0, 0.0, space)),
            ffr.Revolute(("planet", "center"), ("carrier", "rim"), name="pin"),
            ffr.Gear(("planet", "center"), ("sun", "center"), -sun / planet, "inner"),
            ffr.Gear(("planet", "center"), ground(0.0, 0.0, space), ring / planet, "outer"),
        ],
        forces=[torque("sun", moment, space), torque("carrier", -4.0 * moment, space)],
    )
    t = ffr.simulate(mechanism, bodies, integrator)
    for name, expected in spins.items():
        np.testing.assert_allclose(spin(t, name), expected, rtol=1e-9)
    force = np.linalg.norm(t.joint_force("pin")[:, :2], axis=1)
    np.testing.assert_allclose(force, 200.0, rtol=1e-5)
    np.testing.assert_allclose(t.joint_force("inner")[:, 0], -100.0, rtol=1e-5)
    np.testing.assert_allclose(t.joint_force("outer")[:, 0], 100.0, rtol=1e-5)


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
