# SPDX-License-Identifier: MIT
"""Full turns in space: they count as in the plane, for placements and for steps of any length."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Integrator, Trajectory

#: Steps of more than half a turn are what is asked for.
pytestmark = [
    pytest.mark.filterwarnings(f"ignore::dolfinx_ffr.{name}Warning")
    for name in ("TimeStep", "LargeDeformation", "Placement", "Softening")
]

PIN, AXLE, OTHER = ("wheel", "pin"), ffr.Ground((0.0, 0.0, 0.0)), ("other", "pin")
STIFFNESS, INERTIA = 40.0, 0.4
#: Axes of the bearing: that of z, and a slanted one.
AXES = [(0.0, 0.0, 1.0), (0.6, 0.0, -0.8)]
METHODS = [ffr.GeneralizedAlpha(2.0, 20), ffr.RadauIIA(2.0, steps=20)]


def wheel(dimension: int = 3) -> ffr.VolumeIntegrals:
    """A wheel with the same moment of inertia about all axes."""
    inertia = INERTIA if dimension == 2 else (INERTIA,) * 3
    return ffr.VolumeIntegrals.rigid(2.0, inertia=inertia, markers={"pin": (0.0,) * dimension})


def geared(
    integrator: Integrator,
    spring: ffr.TorsionalSpringDamper,
    *forces: ffr.Torque,
    angle: float = 0.0,
    rate: float = 0.0,
    **options: Any,
) -> Trajectory:
    """The wheel on a spring, turning another by a gear, from an angle with a rate."""
    mechanism = ffr.Mechanism(
        {
            "wheel": ffr.Placement(
                (0.0,) * 3, rotation=(0.0, 0.0, angle), angular_velocity=(0.0, 0.0, rate)
            ),
            "other": ffr.Placement((1.0, 0.0, 0.0), angular_velocity=(0.0, 0.0, -2.0 * rate)),
        },
        [
            ffr.Revolute(PIN, AXLE),
            ffr.Revolute(OTHER, ffr.Ground((1.0, 0.0, 0.0))),
            ffr.mechanism.AngleCoupling(OTHER, PIN, -2.0, "gear"),
        ],
        forces=[spring, *forces],
        **options,
    )
    return ffr.simulate(mechanism, {"wheel": wheel(), "other": wheel()}, integrator)


def spun(
    angle: float,
    speed: float,
    integrator: Integrator,
    axis: tuple[float, float, float] | None = None,
) -> Trajectory:
    """The wheel on a spring without moment at the angle zero; without an axis in the plane."""
    if axis is None:
        place, ground, about = ffr.Placement((0, 0), angle, (0, 0), speed), ffr.Ground(), {}
    else:
        turn, spin, about = angle * np.array(axis), speed * np.array(axis), {"axis": axis}
        place, ground = ffr.Placement((0.0,) * 3, rotation=turn, angular_velocity=spin), AXLE
    spring = ffr.TorsionalSpringDamper(PIN, ground, STIFFNESS, 0.1, 0.0, "spring", **about)
    joints = [ffr.Revolute(PIN, ground, **about)]
    mechanism = ffr.Mechanism({"wheel": place}, joints, forces=[spring])
    return ffr.simulate(mechanism, {"wheel": wheel(2 if axis is None else 3)}, integrator)


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("angle", [3.49, -3.49, 7.0, -20.0])
def test_placement_counts_its_turns(angle: float, axis: tuple[float, float, float]) -> None:
    motion = spun(angle, 0.0, ffr.GeneralizedAlpha(1e-3, 1), axis)
    assert motion.applied_force("spring")[0, 0] == pytest.approx(STIFFNESS * angle)
    alpha = -STIFFNESS * angle / INERTIA
    np.testing.assert_allclose(motion.w[0, 3:6], alpha * np.array(axis), atol=1e-9)
    np.testing.assert_allclose(motion.rigid("wheel")[0, 3:], angle * np.array(axis), atol=1e-12)


@pytest.mark.parametrize("integrator", METHODS, ids=lambda method: type(method).__name__)
@pytest.mark.parametrize("axis", AXES, ids=str)
def test_long_steps_count_turns(axis: tuple[float, float, float], integrator: Integrator) -> None:
    """Steps of more than a turn, as in the plane."""
    plane, space = (spun(4.0, 100.0, integrator, at) for at in (None, axis))
    angle, n = plane.rigid("wheel")[:, 2], np.array(axis)
    assert np.max(np.abs(np.diff(angle))) > math.pi
    scale = float(np.max(np.abs(angle)))
    np.testing.assert_allclose(space.rigid("wheel")[:, 3:] @ n, angle, atol=1e-9 * scale)
    np.testing.assert_allclose(space.v[:, 3:6] @ n, plane.v[:, 2], atol=1e-8 * scale)
    moments = space.applied_force("spring")[:, 0], -plane.applied_force("spring")[:, 2]
    np.testing.assert_allclose(*moments, atol=1e-6 * scale)


@pytest.mark.parametrize("integrator", METHODS, ids=lambda method: type(method).__name__)
def test_turns_between_bodies_and_moving_markers(integrator: Integrator) -> None:
    """A wheel turns with a gear, against a marker that turns in steps of several turns, too."""
    rate, still = 60.0, ffr.Motion.constant(0.0)
    marker = ffr.Moving(still, still, ffr.Motion.polynomial([0.0, rate]), z=still)
    spring = ffr.TorsionalSpringDamper(PIN, marker, STIFFNESS, angle=0.5, name="spring")
    motion = geared(integrator, spring, rate=rate)
    lag, other = motion.y[:, 5] - rate * motion.t, motion.y[:, 11]
    np.testing.assert_allclose(other, -2.0 * motion.y[:, 5], atol=1e-9)
    force = motion.applied_force("spring")[:, 0]
    np.testing.assert_allclose(force, STIFFNESS * (lag - 0.5), atol=1e-8)
    assert np.all(np.abs(lag) < 1.1)  # swings about 0.5


@pytest.mark.parametrize("angle", [3.49, -3.49, 7.0])
def test_equilibrium_unwinds_a_spring(angle: float) -> None:
    """The search moves by more than half a turn, and the motion goes on counting from there."""
    spring = ffr.TorsionalSpringDamper(PIN, AXLE, STIFFNESS, angle=0.0, name="spring")
    torque, start = ffr.Torque(PIN, (0.0, 0.0, 4.0)), ffr.StaticEquilibrium()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", ffr.PlacementWarning)
        motion = geared(ffr.GeneralizedAlpha(0.1, 10), spring, torque, angle=angle, start=start)
    np.testing.assert_allclose(motion.y[:, 5], 0.1, atol=1e-9)
    np.testing.assert_allclose(motion.y[:, 11], -2.0 * (0.1 - angle), atol=1e-9)
    np.testing.assert_allclose(motion.applied_force("spring"), 4.0, atol=1e-7)


def test_rotations_without_turns_count_none() -> None:
    """A matrix is a rotation of half a turn at most, and so are those about other axes."""
    forces = []
    for rotation in (Rotation.from_rotvec([0.0, 0.0, 3.49]), np.array([3.49, 0.0, 0.0])):
        mechanism = ffr.Mechanism(
            {"wheel": ffr.Placement((0.0, 0.0, 0.0), rotation=rotation)},
            [],
            forces=[ffr.TorsionalSpringDamper(PIN, AXLE, STIFFNESS, angle=0.0, name="spring")],
        )
        motion = ffr.simulate(mechanism, {"wheel": wheel()}, ffr.GeneralizedAlpha(1e-6, 1))
        forces.append(motion.applied_force("spring")[0, 0])
    np.testing.assert_allclose(forces[0], STIFFNESS * (3.49 - 2.0 * math.pi))
