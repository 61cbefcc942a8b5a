# SPDX-License-Identifier: MIT
"""Forces, springs and dampers: closed forms, balances of momentum and energy, refusals."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from shared.beams import beam
from shared.motions import check_order

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Trajectory
from dolfinx_ffr.mechanism.forces import AppliedForce
from dolfinx_ffr.mechanism.marker import Marker

Array = NDArray[np.float64]

MASS, INERTIA = 2.0, 0.5
STEPS = np.array([200, 400, 800])
CENTER = ("block", "center")


def block() -> dict[str, ffr.VolumeIntegrals]:
    """Rigid body with a marker at its centre of mass and one beside it."""
    markers = {"center": (0.0, 0.0), "rim": (0.3, 0.1)}
    return {"block": ffr.VolumeIntegrals.rigid(MASS, (0.0, 0.0), INERTIA, markers)}


def motion_of_block(
    forces: list[AppliedForce],
    steps: int,
    placement: ffr.Placement | None = None,
    **options: object,
) -> Trajectory:
    mechanism = ffr.Mechanism({"block": placement or ffr.Placement()}, forces=forces, **options)  # type: ignore[arg-type]
    return ffr.simulate(mechanism, block(), ffr.GeneralizedAlpha(1.0, steps))


def test_constant_force_and_torque_give_parabolas() -> None:
    forces = [ffr.Force(CENTER, 6.0, -4.0), ffr.Torque(("block", "rim"), 3.0)]
    t = motion_of_block(forces, 20)
    exact = 0.5 * np.outer(t.t**2, [6.0 / MASS, -4.0 / MASS, 3.0 / INERTIA])
    np.testing.assert_allclose(t.rigid("block"), exact, atol=1e-13)


def swing(stiffness: float, damping: float, t: Array) -> tuple[Array, Array]:
    """Damped vibrations of a unit mass: from a unit deflection, and from a unit velocity."""
    decay = 0.5 * damping
    omega = math.sqrt(stiffness - decay**2)
    sine = np.exp(-decay * t) * np.sin(omega * t) / omega
    return np.exp(-decay * t) * np.cos(omega * t) + decay * sine, sine


def followed(t: Array) -> tuple[ArrayLike, ...]:
    """Under a force of 6 N along an axis that turns by 4 rad/s from 0.3 rad."""
    phi = 0.3 + 4.0 * t
    x = (math.cos(0.3) - np.cos(phi)) / 16.0 - math.sin(0.3) * t / 4.0
    y = (math.sin(0.3) - np.sin(phi)) / 16.0 + math.cos(0.3) * t / 4.0
    return 6.0 / MASS * x, 6.0 / MASS * y, phi


LENGTH = ffr.Motion(
    lambda t: 1.0 + 0.05 * np.sin(9.0 * t),
    lambda t: 0.45 * np.cos(9.0 * t),
    lambda t: -4.05 * np.sin(9.0 * t),
)


def driven(t: Array) -> tuple[ArrayLike, ...]:
    """By a spring of 80 N/m whose length follows this motion."""
    square = 80.0 / MASS
    response = np.sin(9.0 * t) - 9.0 * swing(square, 0.0, t)[1]
    return 1.0 + 0.05 * square / (square - 81.0) * response, 0.0, 0.0


def ellipse(t: Array) -> tuple[ArrayLike, ...]:
    """On a damped spring without length, from a place with a velocity across."""
    deflected, thrown = swing(80.0 / MASS, 3.0 / MASS, t)
    return 0.5 + 1.5 * thrown, 0.2 + 0.3 * deflected, 0.0


#: Forces on the block, where it starts, its x, y and angle over time, and the largest error
CLOSED_FORMS: dict[str, tuple[AppliedForce, ffr.Placement, Callable[[Array], Any], float]] = {
    "follower": (
        ffr.Force(CENTER, 6.0, follower=True),
        ffr.Placement(angle=0.3, angular_velocity=4.0),
        followed,
        1e-5,
    ),
    "spring": (
        ffr.SpringDamper(CENTER, ffr.Ground(), 80.0, 3.0, 1.0),
        ffr.Placement((1.2, 0.0)),
        lambda t: (1.0 + 0.2 * swing(80.0 / MASS, 3.0 / MASS, t)[0], 0.0, 0.0),
        1e-5,
    ),
    "actuator by a motion": (
        ffr.SpringDamper(CENTER, ffr.Ground(), 80.0, length=LENGTH),
        ffr.Placement((1.0, 0.0)),
        driven,
        1e-5,
    ),
    "actuator by a function": (
        ffr.SpringDamper(CENTER, ffr.Ground(), 80.0, length=LENGTH.value),
        ffr.Placement((1.0, 0.0)),
        driven,
        1e-5,
    ),
    "no length": (
        ffr.SpringDamper(CENTER, ffr.Ground((0.5, 0.2)), 80.0, 3.0, 0.0),
        ffr.Placement((0.5, 0.5), velocity=(1.5, 0.0)),
        ellipse,
        2e-5,
    ),
    "torsion": (
        ffr.TorsionalSpringDamper(("block", "rim"), ffr.Ground(angle=0.1), 30.0, 0.8, angle=0.2),
        ffr.Placement(angle=1.0),
        lambda t: (0.0, 0.0, 0.3 + 0.7 * swing(30.0 / INERTIA, 0.8 / INERTIA, t)[0]),
        2e-4,
    ),
}


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_closed_form(name: str) -> None:
    force, start, exact, limit = CLOSED_FORMS[name]

    def error(steps: int) -> list[float]:
        t = motion_of_block([force], steps, start)
        return [float(np.max(np.abs(t.y - np.transpose(np.broadcast_arrays(*exact(t.t))))))]

    check_order(error, STEPS, limit)


def test_springs_take_length_and_angle_from_the_placements() -> None:
    forces = [
        ffr.SpringDamper(("block", "rim"), ffr.Ground((1.0, 1.0)), 50.0),
        ffr.TorsionalSpringDamper(("block", "rim"), ffr.Ground(), 50.0),
    ]
    t = motion_of_block(forces, 5, ffr.Placement((0.1, 0.2), 0.4))
    np.testing.assert_allclose(t.y, np.tile([0.1, 0.2, 0.4], (6, 1)), atol=1e-14)


def test_ground_that_shakes_is_a_pivot_that_moves() -> None:
    amplitude, rate = 0.03, 20.0
    shake = ffr.Motion(
        lambda t: amplitude * (rate * t - np.sin(rate * t)),
        lambda t: amplitude * rate * (1.0 - np.cos(rate * t)),
        lambda t: amplitude * rate**2 * np.sin(rate * t),
    )
    arm = {"arm": beam(0.5, 0.01, 0.01, 2e9, elements=8, modes=2, frame="tangent")}

    def motion(pivot: Marker, steps: int, **more: Any) -> Trajectory:
        joints, place = [ffr.Revolute(("arm", "left"), pivot)], {"arm": ffr.Placement((0.25, 0.0))}
        mechanism = ffr.Mechanism(place, joints, gravity=(0, -9.81), **more)
        return ffr.simulate(mechanism, arm, ffr.GeneralizedAlpha(0.4, steps))

    def error(steps: int) -> list[float]:
        first = motion(ffr.Moving(shake, ffr.Motion.constant(0.0)), steps)
        second = motion(ffr.Ground(), steps, ground_acceleration=(shake.acceleration, 0.0))
        gap = first.y - second.y
        gap[:, 0] -= shake.tabulate(first.t)[0]
        return [float(np.max(np.abs(gap)))]

    check_order(error, 4 * STEPS, 1e-4)


def test_gravity_may_be_given_over_time() -> None:
    constant, function, motion = (
        motion_of_block([], 5, gravity=(1.0, g))
        for g in (-9.81, lambda t: np.full(t.shape, -9.81), ffr.Motion.constant(-9.81))
    )
    np.testing.assert_array_equal(constant.y, function.y)
    np.testing.assert_array_equal(constant.y, motion.y)
    np.testing.assert_allclose(constant.y[-1, :2], [0.5, -0.5 * 9.81], rtol=1e-13)
    # Without force, kinetic and potential energy add up to a constant.
    energy = constant.kinetic_energy("block") + constant.potential_energy("block")
    np.testing.assert_allclose(energy, 0.0, atol=1e-12)
