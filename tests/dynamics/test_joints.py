# SPDX-License-Identifier: MIT
"""Joints one by one: closed forms, forces, energy on flexible bodies, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.beams import beam
from shared.scenes import Scene, moved, random_direction

from dolfinx_ffr.body.volume_integrals import VolumeIntegrals
from dolfinx_ffr.dynamics import GeneralizedAlpha, Trajectory, simulate
from dolfinx_ffr.mechanical_problem import MechanicalProblem
from dolfinx_ffr.mechanism import Mechanism, Placement
from dolfinx_ffr.mechanism.forces import Torque
from dolfinx_ffr.mechanism.joints import (
    Distance,
    Gear,
    Joint,
    LinearDrive,
    PointOnLine,
    PrescribedAngle,
    Revolute,
    Translational,
    Weld,
)
from dolfinx_ffr.mechanism.marker import Ground, Marker
from dolfinx_ffr.mechanism.motion import Motion
from dolfinx_ffr.objective import IntegralCompliance, JointForce
from dolfinx_ffr.verification import assert_taylor_order, convergence_order, taylor_test

Array = NDArray[np.float64]

STEPS = np.array([200, 400, 800])


def disc(mass: float = 2.0, inertia: float = 0.5) -> VolumeIntegrals:
    markers = {"center": (0.0, 0.0), "rim": (0.2, 0.0)}
    return VolumeIntegrals.rigid(mass, (0.0, 0.0), inertia, markers)


def check_order_two(errors: list[float], limit: float, steps: Array = STEPS) -> None:
    assert errors[-1] < limit
    assert convergence_order(1.0 / steps, errors) == pytest.approx(2.0, abs=0.1)


def test_block_slides_down_an_incline() -> None:
    slope, g = 0.5, 9.81
    along = np.array([math.cos(slope), -math.sin(slope)])
    rails = Translational(
        ("block", "rim"),
        Ground((0.0, 1.0), angle=0.2),
        (2.0 * math.cos(slope + 0.2), -2.0 * math.sin(slope + 0.2)),
        name="rails",
    )
    mechanism = Mechanism({"block": Placement((-0.2, 1.0))}, [rails], gravity=(0.0, -g))
    t = simulate(mechanism, {"block": disc()}, GeneralizedAlpha(0.5, 20))
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
    joint = Translational(("block", "center"), Ground(angle=0.1), angle=0.4)
    mechanism = Mechanism({"block": Placement((0.1, 0.0), 0.45)}, [joint])
    t = simulate(mechanism, {"block": disc()}, GeneralizedAlpha(0.1, 2))
    np.testing.assert_allclose(t.rigid("block")[:, 2], 0.5, atol=1e-14)


@pytest.mark.parametrize("ratio", [-2.5, 0.4])
def test_gear_pair_driven_by_a_torque(ratio: float) -> None:
    moment, own, other = 3.0, 0.5, 0.2
    joints = [
        Revolute(("driven", "center"), Ground(), name="axle"),
        Revolute(("driver", "center"), Ground((1.0, 0.0)), name="other axle"),
        Gear(("driven", "rim"), ("driver", "rim"), ratio, name="mesh"),
    ]
    mechanism = Mechanism(
        {"driven": Placement(angle=0.3), "driver": Placement((1.0, 0.0), -0.8)},
        joints,
        forces=[Torque(("driver", "center"), moment)],
    )
    bodies = {"driven": disc(2.0, own), "driver": disc(1.0, other)}
    t = simulate(mechanism, bodies, GeneralizedAlpha(1.0, 20))
    growth = moment / (other + ratio**2 * own)
    driver = -0.8 + 0.5 * growth * t.t**2
    np.testing.assert_allclose(t.rigid("driver")[:, 2], driver, atol=1e-12)
    np.testing.assert_allclose(t.rigid("driven")[:, 2], 0.3 + ratio * (driver + 0.8), atol=1e-12)
    np.testing.assert_allclose(t.joint_force("mesh")[:, 0], own * ratio * growth, rtol=1e-12)


def test_gear_starts_with_the_speed_of_its_partner() -> None:
    joints = [
        Revolute(("driven", "center"), Ground()),
        Revolute(("driver", "center"), Ground((1.0, 0.0))),
        PrescribedAngle(("driver", "center"), Motion.polynomial([0.0, 3.0])),
        Gear(("driven", "center"), ("driver", "center"), -2.0),
    ]
    mechanism = Mechanism({"driven": Placement(), "driver": Placement((1.0, 0.0))}, joints)
    t = simulate(mechanism, {"driven": disc(), "driver": disc()}, GeneralizedAlpha(0.1, 2))
    np.testing.assert_allclose(t.v[:, 2], -6.0, rtol=1e-13)


def test_rope_that_shortens_at_constant_rate() -> None:
    """A mass on a rope of length r = r0 + c t: r^2 phi' is constant, the tension m r phi'^2."""
    r0, c, spin, mass = 1.0, -0.4, 2.0, 2.0
    moved, pulled = [], []
    for steps in STEPS:
        mechanism = Mechanism(
            {"ball": Placement((r0 + 0.3, 0.0), velocity=(0.0, spin * r0))},
            [
                Distance(
                    ("ball", "center"),
                    Ground((0.3, 0.0)),
                    Motion.polynomial([r0, c]),
                    name="rope",
                )
            ],
        )
        t = simulate(mechanism, {"ball": disc(mass)}, GeneralizedAlpha(1.0, int(steps)))
        r, phi = r0 + c * t.t, spin * r0 * t.t / (r0 + c * t.t)
        exact = np.array([0.3, 0.0]) + r[:, None] * np.stack([np.cos(phi), np.sin(phi)], axis=1)
        tension = mass * (spin * r0**2) ** 2 / r**3
        moved.append(float(np.max(np.abs(t.rigid("ball")[:, :2] - exact))))
        pulled.append(float(np.max(np.abs(t.joint_force("rope")[:, 0] + tension)) / tension[-1]))
    check_order_two(moved, 1e-4)
    check_order_two(pulled, 1e-4)


@pytest.mark.parametrize("length", [0.4, None])
def test_massless_rod_between_two_bodies(length: float | None) -> None:
    # Two equal masses circle about their middle; the rod carries the centrifugal force.
    mechanism = Mechanism(
        {
            "one": Placement((0.2, 0.0), velocity=(0.0, 0.6)),
            "two": Placement((-0.2, 0.0), velocity=(0.0, -0.6)),
        },
        [Distance(("one", "center"), ("two", "center"), length, name="rod")],
    )
    errors = []
    for steps in STEPS:
        t = simulate(mechanism, {"one": disc(), "two": disc()}, GeneralizedAlpha(1.0, int(steps)))
        exact = 0.2 * np.stack([np.cos(3.0 * t.t), np.sin(3.0 * t.t)], axis=1)
        errors.append(float(np.max(np.abs(t.rigid("one")[:, :2] - exact))))
        np.testing.assert_allclose(t.joint_force("rod")[:, 0], -2.0 * 9.0 * 0.2, rtol=1e-3)
    check_order_two(errors, 1e-5)


@pytest.mark.parametrize("modulus", [None, 2.1e13])
def test_bead_on_a_turning_rod(modulus: float | None) -> None:
    """As r'' = omega^2 r: r = r0 cosh(omega t), and the rod pushes with 2 m omega r'."""
    omega, r0, mass = 3.0, 0.1, 0.01
    moved, pushed = [], []
    for steps in STEPS:
        ends = {"left": (-0.2, 0.0), "middle": (0.0, 0.0)}
        rod = VolumeIntegrals.rigid(1.0, (0.0, 0.0), 0.1, ends)
        if modulus is not None:
            rod = beam(0.4, 0.04, 0.01, modulus, modes=3, frame="tangent")
        mechanism = Mechanism(
            {
                "rod": Placement((0.2, 0.0), 0.0, (0.0, 0.2 * omega), omega),
                "bead": Placement((r0, 0.0), 0.0, (0.0, omega * r0), 0.0),
            },
            [
                Revolute(("rod", "left"), Ground()),
                PrescribedAngle(("rod", "left"), Motion.polynomial([0.0, omega])),
                PointOnLine(("bead", "center"), ("rod", "middle"), (-2.0, 0.0), name="slide"),
            ],
        )
        bodies = {"rod": rod, "bead": disc(mass, 1e-4)}
        t = simulate(mechanism, bodies, GeneralizedAlpha(0.5, int(steps)))
        r = r0 * np.cosh(omega * t.t)
        phi = omega * t.t
        exact = r[:, None] * np.stack([np.cos(phi), np.sin(phi)], axis=1)
        push = 2.0 * mass * omega**2 * r0 * np.sinh(omega * t.t)
        moved.append(float(np.max(np.abs(t.rigid("bead")[:, :2] - exact))))
        # The normal is a quarter turn ahead of the line's direction, which points inwards.
        error = np.abs(t.joint_force("slide")[:, 0] + push)
        pushed.append(float(np.max(error) / push[-1]))
    if modulus is None:
        check_order_two(moved, 1e-6)
        check_order_two(pushed, 1e-4)
    else:  # the rod bends by a millionth of its length
        assert moved[-1] < 1e-6
        assert pushed[-1] < 1e-3


def flexible_machine(steps: int) -> Trajectory:
    """Crank geared to a wheel, carriage on the bending crank, cylinder to a swinging beam."""
    bodies = {
        "crank": beam(0.3, 0.01, 0.01, 2e9, elements=6, modes=2, frame="free"),
        "wheel": beam(0.2, 0.01, 0.01, 2e9, elements=6, modes=2, frame="free"),
        "carriage": beam(0.1, 0.01, 0.01, 2e9, elements=6, modes=1, frame="free"),
        "beam": beam(0.3, 0.01, 0.01, 2e9, elements=6, modes=2, frame="free"),
    }
    mechanism = Mechanism(
        {
            "crank": Placement((0.15, 0.0), 0.0, (0.0, 0.6), 4.0),
            "wheel": Placement((0.0, -0.3), 0.3),
            "carriage": Placement((0.25, 0.0), 0.5),
            "beam": Placement((0.4, -0.15), -0.5 * math.pi),
        },
        [
            Revolute(("crank", "left"), Ground()),
            Revolute(("wheel", "middle"), Ground((0.0, -0.3))),
            Gear(("crank", "left"), ("wheel", "right"), -1.5),
            Translational(("carriage", "left"), ("crank", "middle"), (1.0, 0.1)),
            Revolute(("beam", "right"), Ground((0.4, -0.3))),
            Distance(("carriage", "right"), ("beam", "left")),
        ],
    )
    return simulate(mechanism, bodies, GeneralizedAlpha(0.2, steps, 1.0))


def test_joints_of_flexible_bodies_do_no_work() -> None:
    steps, drifts = np.array([1000, 2000, 4000]), []
    for count in steps:
        t = flexible_machine(int(count))
        strain = sum(t.strain_energy(b) for b in t.model.bodies)
        energy = strain + sum(t.kinetic_energy(b) for b in t.model.bodies)
        assert np.max(strain) > 1e-3 * energy[0], "the bodies hardly deform"
        drifts.append(float(np.max(np.abs(energy / energy[0] - 1.0))))
    check_order_two(drifts, 1e-3, steps)


def driven_carriage(flexible: bool, steps: int = 400) -> Scene:
    """An arm turned by a motor, and a carriage that a spindle moves out along it."""
    arm = VolumeIntegrals.rigid(1.0, (0.0, 0.0), 0.1, {"left": (-0.2, 0.0), "middle": (0.0, 0.0)})
    carriage = disc(0.2, 1e-3)
    if flexible:
        arm = beam(0.4, 0.01, 0.01, 2e9, elements=6, modes=3, frame="tangent")
        carriage = beam(0.1, 0.01, 0.01, 2e9, elements=4, modes=1, frame="tangent")
    at = "left" if flexible else "center"
    turned = 0.3  # of the line in the axes of the arm
    direction = (2.0 * math.cos(turned), 2.0 * math.sin(turned))
    spindle = Motion.polynomial([0.05, 0.1, 0.2])
    mechanism = Mechanism(
        {"arm": Placement((0.2, 0.0)), "carriage": Placement((0.25, 0.01))},
        [
            Revolute(("arm", "left"), Ground(), name="bearing"),
            PrescribedAngle(("arm", "left"), Motion.polynomial([0.0, 3.0]), name="motor"),
            Translational(("carriage", at), ("arm", "left"), direction, name="rails"),
            LinearDrive(("carriage", at), ("arm", "left"), spindle, direction, name="spindle"),
        ],
    )
    return Scene(mechanism, {"arm": arm, "carriage": carriage}, GeneralizedAlpha(0.5, steps))


def way_along_the_arm(t: Trajectory, at: str) -> Array:
    """Place of the carriage in the axes of the drive, shape (steps + 1, 2) [m]."""
    angle = t.rigid("arm")[:, 2] + t.elastic("arm") @ t.model.bodies["arm"].markers["left"].rotation
    seen = t.marker_path("carriage", at) - t.marker_path("arm", "left")
    c, s = np.cos(angle + 0.3), np.sin(angle + 0.3)
    return np.stack([c * seen[:, 0] + s * seen[:, 1], c * seen[:, 1] - s * seen[:, 0]], axis=1)


@pytest.mark.parametrize("flexible", [False, True])
def test_linear_drive_moves_a_carriage_along_a_turning_arm(flexible: bool) -> None:
    scene = driven_carriage(flexible)
    t = simulate(scene.mechanism, scene.bodies, scene.integrator)
    way = 0.05 + 0.1 * t.t + 0.2 * t.t**2
    seen = way_along_the_arm(t, "left" if flexible else "center")
    np.testing.assert_allclose(seen[:, 0], way, atol=1e-12)
    np.testing.assert_allclose(seen[:, 1], 0.0, atol=1e-12)
    if not flexible:  # m (r'' - omega^2 r) along the line, 2 m omega r' across it
        push = 0.2 * (0.4 - 9.0 * way)
        np.testing.assert_allclose(t.joint_force("spindle")[:, 0], push, atol=1e-4)
        side = 0.2 * 2.0 * 3.0 * (0.1 + 0.4 * t.t)
        np.testing.assert_allclose(t.joint_force("rails")[:, 0], side, atol=1e-4)


def test_adjoint_of_a_linear_drive() -> None:
    scene = driven_carriage(flexible=True, steps=100)
    problem = MechanicalProblem(
        scene.mechanism, scene.integrator, JointForce("spindle") + 1e3 * IntegralCompliance()
    )
    gradient = problem.gradient(scene.bodies).integrals_gradient
    assert gradient is not None
    direction = random_direction(scene.bodies, 3)
    slope = sum(gradient[body].dot(direction[body]) for body in gradient)

    def along(step: Array) -> float:
        return problem.value(moved(scene.bodies, direction, float(step))).psi

    steps = [2e-4 / 2.0**k for k in range(5)]
    result = taylor_test(along, lambda step: float(step) * slope, 0.0, 1.0, steps=steps)
    assert_taylor_order(result, points=4)
    assert result.remainders[0] < 0.5 * result.differences[0]


CENTER: Marker = ("block", "center")


@pytest.mark.parametrize(
    ("joint", "message"),
    [
        (Translational(CENTER, Ground(), (0.0, 0.0), name="rails"), "'rails': the direction of th"),
        (Translational(CENTER, Ground(), angle=np.nan), "the angle must be finite, but it is nan"),
        (Weld(CENTER, Ground(), angle=np.inf), "the angle must be finite, but it is inf"),
        (
            LinearDrive(CENTER, Ground(), Motion.constant(0.1), (0.0, 0.0), "spindle"),
            "'spindle': the direction of the line must not be zero",
        ),
        (PointOnLine(CENTER, Ground(), (np.nan, 1.0)), "the direction of the line holds NaN"),
        (Gear(CENTER, Ground(), 0.0, name="g"), "'g': the ratio must be a number other than zero"),
        (Gear(CENTER, Ground(), np.nan), "the ratio must be finite, but it is nan"),
        (Distance(CENTER, Ground(), 0.0, name="rod"), "'rod': the length must be positive, but it"),
        (Distance(CENTER, Ground(), -1.0), "the length must be positive, but it is -1.0 m"),
        (Distance(CENTER, Ground(), np.nan), "the length must be finite, but it is nan"),
        (Distance(Ground(), Ground((1, 0))), "has no marker on a body"),
        (Gear(Ground(), Ground((1, 0)), 1.0), "has no marker on a body"),
    ],
)
def test_refused_description(joint: Joint, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Mechanism({"block": Placement()}, [joint])


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        ([Distance(CENTER, Ground(), name="rod")], "'rod': the markers coincide in the placements"),
        (
            [Distance(CENTER, Ground((1, 0)), Motion.constant(-1.0), name="rod")],
            "'rod': the length must be positive at all times, but it is -1 m at t = 0 s",
        ),
        (
            [Distance(CENTER, Ground((1, 0)), Motion.polynomial([0.5, -1.0]), name="rod")],
            "'rod': the length must be positive at all times, but it is 0 m at t = 0.5 s",
        ),
        (
            [Distance(CENTER, Ground((1, 0)), Motion(np.cos, np.cos, np.cos), name="rod")],
            "joint 'rod': motion '': the velocity is not the derivative",
        ),
        ([Gear(CENTER, ("wheel", "center"), 2.0)], "refers to body 'wheel', but the bodies are"),
        (
            [
                Translational(CENTER, Ground(), name="rails"),
                Gear(CENTER, Ground((1, 0)), 1.0, name="gear"),
            ],
            r"1 of the 3 constraints is redundant; joints involved: \['rails', 'gear'\]",
        ),
        (
            [
                Revolute(CENTER, Ground(), name="pin"),
                Distance(("block", "rim"), Ground((1.0, 0.0)), 2.0, name="rod"),
            ],
            r"cannot be assembled: joint '(pin|rod)' stays open by",
        ),
    ],
)
def test_refused_when_assembled(joints: list[Joint], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        simulate(
            Mechanism({"block": Placement()}, joints), {"block": disc()}, GeneralizedAlpha(1.0, 10)
        )
