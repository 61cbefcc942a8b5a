# SPDX-License-Identifier: MIT
"""Forces, springs and dampers: closed forms, balances of momentum and energy, refusals."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.beams import beam

from dolfinx_ffr.body.volume_integrals import VolumeIntegrals
from dolfinx_ffr.dynamics import GeneralizedAlpha, Trajectory, simulate
from dolfinx_ffr.mechanism import Mechanism, Placement
from dolfinx_ffr.mechanism.forces import (
    AppliedForce,
    Force,
    SpringDamper,
    Torque,
    TorsionalSpringDamper,
)
from dolfinx_ffr.mechanism.joints import PrescribedAngle, Revolute, Translational
from dolfinx_ffr.mechanism.marker import Ground, Moving
from dolfinx_ffr.mechanism.motion import Motion, sample
from dolfinx_ffr.verification import convergence_order

Array = NDArray[np.float64]

MASS, INERTIA = 2.0, 0.5
STEPS = np.array([200, 400, 800])


def block() -> dict[str, VolumeIntegrals]:
    """Rigid body with a marker at its centre of mass and one beside it."""
    markers = {"center": (0.0, 0.0), "rim": (0.3, 0.1)}
    return {"block": VolumeIntegrals.rigid(MASS, (0.0, 0.0), INERTIA, markers)}


def motion_of_block(
    forces: list[AppliedForce], steps: int, placement: Placement | None = None, **options: object
) -> Trajectory:
    mechanism = Mechanism({"block": placement or Placement()}, forces=forces, **options)  # type: ignore[arg-type]
    return simulate(mechanism, block(), GeneralizedAlpha(1.0, steps))


def check_order_two(error: Callable[[int], float], limit: float) -> None:
    errors = [error(int(n)) for n in STEPS]
    assert errors[-1] < limit
    assert convergence_order(1.0 / STEPS, errors) == pytest.approx(2.0, abs=0.1)


# --- Closed forms --------------------------------------------------------------------------------


def test_constant_force_and_torque_give_parabolas() -> None:
    forces = [Force(("block", "center"), 6.0, -4.0), Torque(("block", "rim"), 3.0)]
    t = motion_of_block(forces, 20)
    exact = 0.5 * np.outer(t.t**2, [6.0 / MASS, -4.0 / MASS, 3.0 / INERTIA])
    np.testing.assert_allclose(t.rigid("block"), exact, atol=1e-13)


def test_force_at_a_lever_turns_the_body() -> None:
    t = motion_of_block([Force(("block", "rim"), 6.0, -4.0)], 2)
    moment = 0.3 * -4.0 - 0.1 * 6.0
    np.testing.assert_allclose(t.w[0], [6.0 / MASS, -4.0 / MASS, moment / INERTIA], rtol=1e-13)


def test_follower_force_turns_with_the_body() -> None:
    spin, angle = 4.0, 0.3

    def error(steps: int) -> float:
        start = Placement(angle=angle, angular_velocity=spin)
        t = motion_of_block([Force(("block", "center"), 6.0, follower=True)], steps, start)
        phi = angle + spin * t.t
        x = (np.cos(angle) - np.cos(phi)) / spin**2 - np.sin(angle) * t.t / spin
        y = (np.sin(angle) - np.sin(phi)) / spin**2 + np.cos(angle) * t.t / spin
        return float(np.max(np.abs(t.rigid("block")[:, :2] - 3.0 * np.stack([x, y], axis=1))))

    check_order_two(error, 1e-5)


def test_damped_spring_along_a_rail() -> None:
    stiffness, damping, x0 = 80.0, 3.0, 0.2

    def error(steps: int) -> float:
        mechanism = Mechanism(
            {"block": Placement((1.0 + x0, 0.0))},
            [Translational(("block", "center"), Ground())],
            forces=[SpringDamper(("block", "center"), Ground(), stiffness, damping, 1.0)],
        )
        t = simulate(mechanism, block(), GeneralizedAlpha(1.0, steps))
        decay = 0.5 * damping / MASS
        omega = math.sqrt(stiffness / MASS - decay**2)
        swing = np.cos(omega * t.t) + decay / omega * np.sin(omega * t.t)
        exact = 1.0 + x0 * np.exp(-decay * t.t) * swing
        return float(np.max(np.abs(t.rigid("block")[:, 0] - exact)))

    check_order_two(error, 1e-5)


@pytest.mark.parametrize("as_motion", [True, False])
def test_actuator_drives_a_block(as_motion: bool) -> None:
    stiffness, amplitude, rate = 80.0, 0.05, 9.0
    length = Motion(
        lambda t: 1.0 + amplitude * np.sin(rate * t),
        lambda t: amplitude * rate * np.cos(rate * t),
        lambda t: -amplitude * rate**2 * np.sin(rate * t),
    )

    def error(steps: int) -> float:
        spring = SpringDamper(
            ("block", "center"), Ground(), stiffness, length=length if as_motion else length.value
        )
        mechanism = Mechanism(
            {"block": Placement((1.0, 0.0))},
            [Translational(("block", "center"), Ground())],
            forces=[spring],
        )
        t = simulate(mechanism, block(), GeneralizedAlpha(1.0, steps))
        omega = math.sqrt(stiffness / MASS)
        response = np.sin(rate * t.t) - rate / omega * np.sin(omega * t.t)
        exact = 1.0 + amplitude * omega**2 / (omega**2 - rate**2) * response
        return float(np.max(np.abs(t.rigid("block")[:, 0] - exact)))

    check_order_two(error, 1e-5)


def test_spring_of_zero_length_moves_a_body_on_an_ellipse() -> None:
    stiffness, damping = 80.0, 3.0

    def error(steps: int) -> float:
        spring = SpringDamper(("block", "center"), Ground((0.5, 0.2)), stiffness, damping, 0.0)
        t = motion_of_block([spring], steps, Placement((0.5, 0.5), velocity=(1.5, 0.0)))
        decay = 0.5 * damping / MASS
        omega = math.sqrt(stiffness / MASS - decay**2)
        x = 0.5 + 1.5 / omega * np.exp(-decay * t.t) * np.sin(omega * t.t)
        y = np.cos(omega * t.t) + decay / omega * np.sin(omega * t.t)
        y = 0.2 + 0.3 * np.exp(-decay * t.t) * y
        return float(np.max(np.abs(t.rigid("block")[:, :2] - np.stack([x, y], axis=1))))

    check_order_two(error, 2e-5)


def test_damped_torsional_spring() -> None:
    stiffness, damping, start = 30.0, 0.8, 0.7

    def error(steps: int) -> float:
        spring = TorsionalSpringDamper(
            ("block", "rim"), Ground(angle=0.1), stiffness, damping, angle=0.2
        )
        t = motion_of_block([spring], steps, Placement(angle=0.3 + start))
        decay = 0.5 * damping / INERTIA
        omega = math.sqrt(stiffness / INERTIA - decay**2)
        swing = np.cos(omega * t.t) + decay / omega * np.sin(omega * t.t)
        exact = 0.3 + start * np.exp(-decay * t.t) * swing
        return float(np.max(np.abs(t.rigid("block")[:, 2] - exact)))

    check_order_two(error, 2e-4)


def test_springs_take_length_and_angle_from_the_placements() -> None:
    forces = [
        SpringDamper(("block", "rim"), Ground((1.0, 1.0)), 50.0),
        TorsionalSpringDamper(("block", "rim"), Ground(), 50.0),
    ]
    t = motion_of_block(forces, 5, Placement((0.1, 0.2), 0.4))
    np.testing.assert_allclose(t.y, np.tile([0.1, 0.2, 0.4], (6, 1)), atol=1e-14)


def test_ground_that_shakes_is_a_pivot_that_moves() -> None:
    amplitude, rate = 0.03, 20.0
    shake = Motion(
        lambda t: amplitude * (rate * t - np.sin(rate * t)),
        lambda t: amplitude * rate * (1.0 - np.cos(rate * t)),
        lambda t: amplitude * rate**2 * np.sin(rate * t),
    )
    arm = {"arm": beam(0.5, 0.01, 0.01, 2e9, elements=8, modes=2, frame="tangent")}

    def error(steps: int) -> float:
        placements = {"arm": Placement((0.25, 0.0))}
        pivot = Moving(shake, Motion.constant(0.0))
        integrator = GeneralizedAlpha(0.4, steps)
        first, second = (
            simulate(
                Mechanism(placements, [Revolute(("arm", "left"), at)], gravity=(0, -9.81), **more),
                arm,
                integrator,
            )
            for at, more in (
                (pivot, {}),
                (Ground(), {"ground_acceleration": (shake.acceleration, 0.0)}),
            )
        )
        gap = first.y - second.y
        gap[:, 0] -= shake.tabulate(first.t)[0]
        return float(np.max(np.abs(gap)))

    steps = 4 * STEPS
    errors = [error(int(n)) for n in steps]
    assert errors[-1] < 1e-4
    assert convergence_order(1.0 / steps, errors) == pytest.approx(2.0, abs=0.1)


def test_gravity_may_be_given_over_time() -> None:
    constant, function, motion = (
        motion_of_block([], 5, gravity=(1.0, g))
        for g in (-9.81, lambda t: np.full(t.shape, -9.81), Motion.constant(-9.81))
    )
    np.testing.assert_array_equal(constant.y, function.y)
    np.testing.assert_array_equal(constant.y, motion.y)
    np.testing.assert_allclose(constant.y[-1, :2], [0.5, -0.5 * 9.81], rtol=1e-13)
    # Without force, kinetic and potential energy add up to a constant.
    energy = constant.kinetic_energy("block") + constant.potential_energy("block")
    np.testing.assert_allclose(energy, 0.0, atol=1e-12)


def test_applied_forces_by_name() -> None:
    forces = [
        SpringDamper(("block", "rim"), Ground((1.0, 1.0)), 50.0, 2.0, 0.5, name="spring"),
        Force(("block", "rim"), 2.0, lambda t: 3.0 * t, follower=True, name="jet"),
        TorsionalSpringDamper(("block", "rim"), Ground(), 5.0, 0.3, 0.1),
        Torque(("block", "rim"), 7.0, name="motor"),
    ]
    t = motion_of_block(forces, 50, Placement((0.1, 0.2), 0.4, (0.3, -0.2), 2.0))
    angle, spin = t.rigid("block")[:, 2], t.v[:, 2]
    c, s, push = np.cos(angle), np.sin(angle), 3.0 * t.t
    arm = np.stack([0.3 * c - 0.1 * s, 0.3 * s + 0.1 * c], axis=1)
    away = t.rigid("block")[:, :2] + arm - 1.0
    rate = t.v[:, :2] + spin[:, None] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    length = np.linalg.norm(away, axis=1)
    along = away / length[:, None]
    tension = 50.0 * (length - 0.5) + 2.0 * np.sum(along * rate, axis=1)
    spring = t.applied_force("spring")
    np.testing.assert_allclose(spring[:, :2], -tension[:, None] * along, atol=1e-12)
    np.testing.assert_array_equal(spring[:, 2], 0.0)
    jet = np.stack([2.0 * c - push * s, 2.0 * s + push * c, 0.0 * c], axis=1)
    np.testing.assert_allclose(t.applied_force("jet"), jet, atol=1e-13)
    moment = t.applied_force("TorsionalSpringDamper(block.rim, ground)")[:, 2]
    np.testing.assert_allclose(moment, -5.0 * (angle - 0.1) - 0.3 * spin, atol=1e-13)
    np.testing.assert_array_equal(t.applied_force("motor"), np.tile([0.0, 0.0, 7.0], (51, 1)))
    with pytest.raises(ValueError, match=r"no force 'rope'; the forces are \['spring', 'jet'"):
        t.applied_force("rope")


# --- Balances on flexible bodies -----------------------------------------------------------------


def pair(steps: int, forces: list[AppliedForce]) -> Trajectory:
    """Two free flexible beams, thrown with spin."""
    bodies = {
        "front": beam(0.4, 0.01, 0.01, 2e10, elements=8, modes=2, frame="tangent"),
        "back": beam(0.3, 0.008, 0.01, 2e10, elements=8, modes=2, frame="chord"),
    }
    mechanism = Mechanism(
        {
            "front": Placement((0.2, 0.0), 0.0, (1.5, -0.7), 5.0),
            "back": Placement((0.0, -0.2), 0.5 * math.pi, (1.5, -1.7), -9.0),
        },
        forces=forces,
    )
    return simulate(mechanism, bodies, GeneralizedAlpha(0.1, steps, 1.0))


#: Springs between markers that bend, and their stiffnesses and lengths.
SPRINGS: list[AppliedForce] = [
    SpringDamper(("front", "right"), ("back", "left"), 300.0, length=0.4),
    SpringDamper(("front", "middle"), ("back", "middle"), 200.0, length=0.0),
    TorsionalSpringDamper(("front", "right"), ("back", "left"), 2.0, angle=-1.0),
]


def marker_angle(t: Trajectory, body: str, marker: str) -> Array:
    return t.rigid(body)[:, 2] + t.elastic(body) @ t.model.bodies[body].markers[marker].rotation


def spring_energy(t: Trajectory) -> Array:
    far = np.linalg.norm(t.marker_path("front", "right") - t.marker_path("back", "left"), axis=1)
    near = t.marker_path("front", "middle") - t.marker_path("back", "middle")
    turn = marker_angle(t, "front", "right") - marker_angle(t, "back", "left") + 1.0
    return 150.0 * (far - 0.4) ** 2 + 100.0 * np.sum(near**2, axis=1) + turn**2


def energy_and_momenta(t: Trajectory) -> tuple[Array, Array, Array]:
    bodies = list(t.model.bodies)
    energy = sum(t.strain_energy(b) + t.kinetic_energy(b) for b in bodies)
    linear = sum(t.linear_momentum(b) for b in bodies)
    return energy, linear, sum(t.angular_momentum(b) for b in bodies)


def test_springs_keep_energy_and_momentum() -> None:
    steps, drifts = np.array([400, 800, 1600]), []
    for count in steps:
        t = pair(int(count), SPRINGS)
        energy, linear, angular = energy_and_momenta(t)
        energy = energy + spring_energy(t)
        assert np.ptp(spring_energy(t)) > 0.1 * energy[0], "the springs hardly work"
        drifts.append(
            [
                np.max(np.abs(energy / energy[0] - 1.0)),
                np.max(np.abs(linear - linear[0])) / np.linalg.norm(linear[0]),
                np.max(np.abs(angular / angular[0] - 1.0)),
            ]
        )
    for name, drift in zip(("energy", "linear", "angular"), np.array(drifts).T, strict=True):
        assert drift[-1] < 1e-3, name
        assert convergence_order(1.0 / steps, drift) == pytest.approx(2.0, abs=0.1), name


@pytest.mark.slow
@pytest.mark.parametrize("bearing", [0.0, 2.0])
def test_dampers_keep_momentum_and_take_their_share_of_energy(bearing: float) -> None:
    dampers: list[AppliedForce] = [
        SpringDamper(("front", "right"), ("back", "left"), 0.0, 1.5, 0.4),
        SpringDamper(("front", "middle"), ("back", "middle"), 0.0, bearing, 0.0),
        TorsionalSpringDamper(("front", "right"), ("back", "left"), 0.0, 0.01, 0.0),
    ]
    steps, drifts = np.array([1600, 3200, 6400]), []
    for count in steps:
        t = pair(int(count), dampers)
        energy, linear, angular = energy_and_momenta(t)
        far = np.linalg.norm(
            t.marker_path("front", "right") - t.marker_path("back", "left"), axis=1
        )
        near = t.marker_path("front", "middle") - t.marker_path("back", "middle")
        turn = marker_angle(t, "front", "right") - marker_angle(t, "back", "left")
        rates = [np.gradient(part, t.t, axis=0, edge_order=2) for part in (far, near, turn)]
        power = 1.5 * rates[0] ** 2 + bearing * np.sum(rates[1] ** 2, axis=1) + 0.01 * rates[2] ** 2
        lost = integral(t, power)
        assert lost[-1] > 0.1 * energy[0], "the dampers hardly work"
        drifts.append(
            [
                np.max(np.abs(energy + lost - energy[0])) / lost[-1],
                np.max(np.abs(linear - linear[0])) / np.linalg.norm(linear[0]),
                np.max(np.abs(angular / angular[0] - 1.0)),
            ]
        )
    # A damper without a direction of its own also resists the turning of the line between its ends.
    for drift in np.array(drifts).T[: 3 if bearing == 0.0 else 2]:
        assert drift[-1] < 1e-3
        assert convergence_order(1.0 / steps, drift) == pytest.approx(2.0, abs=0.1)


def integral(t: Trajectory, rate: Array) -> Array:
    """Integral over time by the trapezoidal rule, shape of rate."""
    mean = 0.5 * (rate[1:] + rate[:-1])
    return np.concatenate([[0.0], np.cumsum(mean * np.diff(t.t))])


def test_power_of_forces_is_the_growth_of_energy() -> None:
    push, turn = (lambda t: 5.0 * np.cos(60.0 * t)), (lambda t: 0.3 * np.sin(50.0 * t))
    forces: list[AppliedForce] = [
        Force(("front", "right"), push, 2.0),
        Force(("back", "middle"), 1.0, push, follower=True),
        Torque(("front", "right"), turn),
    ]
    t = pair(3000, forces)
    energy, linear, angular = energy_and_momenta(t)
    bend = marker_angle(t, "back", "middle")
    along, across = np.ones_like(t.t), push(t.t)
    pulls = [
        np.stack([push(t.t), np.full_like(t.t, 2.0)], axis=1),
        np.stack(
            [
                np.cos(bend) * along - np.sin(bend) * across,
                np.sin(bend) * along + np.cos(bend) * across,
            ],
            axis=1,
        ),
    ]
    paths = [t.marker_path("front", "right"), t.marker_path("back", "middle")]

    velocities = [np.gradient(path, t.t, axis=0, edge_order=2) for path in paths]
    spin = np.gradient(marker_angle(t, "front", "right"), t.t, edge_order=2)
    power = sum(np.sum(f * u, axis=1) for f, u in zip(pulls, velocities, strict=True))
    work = integral(t, power + turn(t.t) * spin)
    np.testing.assert_allclose(energy - energy[0], work, atol=1e-4 * np.ptp(energy))
    for axis in range(2):
        impulse = integral(t, sum(f[:, axis] for f in pulls))
        np.testing.assert_allclose(linear[:, axis] - linear[0, axis], impulse, atol=1e-5)
    moments = [p[:, 0] * f[:, 1] - p[:, 1] * f[:, 0] for p, f in zip(paths, pulls, strict=True)]
    np.testing.assert_allclose(
        angular - angular[0], integral(t, sum(moments) + turn(t.t)), atol=1e-5
    )


# --- Refused -------------------------------------------------------------------------------------

CENTER = ("block", "center")


@pytest.mark.parametrize(
    ("force", "message"),
    [
        (SpringDamper(Ground(), Ground(), 1.0), r"'SpringDamper\(ground, ground\)' has no marker"),
        (SpringDamper(CENTER, Ground(), -1.0), "stiffness must not be negative, but it is -1.0"),
        (SpringDamper(CENTER, Ground(), 1.0, np.nan), "damping must not be negative, but it is na"),
        (SpringDamper(CENTER, Ground(), 1.0, length=-0.1, name="s"), "'s': the length must not be"),
        (TorsionalSpringDamper(CENTER, Ground(), np.inf), "stiffness must not be negative"),
        (TorsionalSpringDamper(CENTER, Ground(), 1.0, -2.0), "damping must not be negative"),
    ],
)
def test_refused_description(force: AppliedForce, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Mechanism({"block": Placement()}, forces=[force])


def test_names_stand_once() -> None:
    force = Force(CENTER, 1.0, name="push")
    with pytest.raises(ValueError, match="two forces have the name 'push'"):
        Mechanism({"block": Placement()}, forces=[force, force])
    unnamed = replace(force, name="")
    mechanism = Mechanism({"block": Placement()}, forces=[unnamed, unnamed])
    assert mechanism.force_names == ["Force(block.center)", "Force(block.center) #2"]


@pytest.mark.parametrize(
    ("force", "message"),
    [
        (Force(("rod", "center"), 1.0), r"'Force\(rod.center\)' refers to body 'rod', but the"),
        (Torque(("block", "end"), 1.0), "marker 'end' of body 'block', whose markers are"),
        (Force(CENTER, np.nan, name="push"), "force 'push': x must be finite, but it is nan"),
        (Force(CENTER, 0.0, lambda t: 1.0 / (t - 0.5)), r"y is NaN or infinite at t = 0.5 s"),
        (Torque(CENTER, lambda t: np.ones(3)), r"moment at 12 times has shape \(3,\)"),
        (SpringDamper(CENTER, Ground(), 1.0, name="s"), "'s': the markers coincide in the placem"),
        (SpringDamper(CENTER, Ground(), 1.0, length=0.2, name="s"), "'s': the markers coincide at"),
        (SpringDamper(CENTER, Ground((1, 0)), 1.0, length=lambda t: 0.1 - t), "must not be negati"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_refused_when_assembled(force: AppliedForce, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        motion_of_block([force], 10)


def test_refused_gravity_and_ground_acceleration() -> None:
    with pytest.raises(ValueError, match="ground_acceleration along x must be finite"):
        Mechanism({}, ground_acceleration=(np.nan, 0.0))
    message = "gravity must have two components, in space three, but it has 4"
    with pytest.raises(ValueError, match=message):
        Mechanism({}, gravity=(0.0, 0.0, 1.0, 0.0))
    with pytest.raises(ValueError, match="gravity along y is NaN or infinite at t = 0 s"):
        motion_of_block([], 10, gravity=(0.0, lambda t: np.nan * t))


def test_samples() -> None:
    times = np.array([0.0, 1.0, 2.0])
    np.testing.assert_array_equal(sample(2.0, times, "x"), [2.0, 2.0, 2.0])
    np.testing.assert_array_equal(sample(lambda t: 3.0 * t, times, "x"), [0.0, 3.0, 6.0])
    motion = Motion.polynomial([1.0, 1.0])
    np.testing.assert_array_equal(sample(motion, times, "x"), [1.0, 2.0, 3.0])


def test_prescribed_angle_works_against_a_torsional_spring() -> None:
    """The motor's moment is that of the spring where nothing is accelerated."""
    mechanism = Mechanism(
        {"block": Placement()},
        [
            Revolute(CENTER, Ground(), name="pin"),
            PrescribedAngle(CENTER, Motion.polynomial([0.0, 0.4]), name="motor"),
        ],
        forces=[TorsionalSpringDamper(CENTER, Ground(), 5.0, 0.7, 0.0)],
    )
    t = simulate(mechanism, block(), GeneralizedAlpha(1.0, 10))
    exact = 5.0 * 0.4 * t.t + 0.7 * 0.4
    np.testing.assert_allclose(t.joint_force("motor")[:, 0], exact, atol=1e-12)
