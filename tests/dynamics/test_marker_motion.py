# SPDX-License-Identifier: MIT
"""Velocities, accelerations and turns of markers, and the power of drives, in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shared.scenes import slider_crank

import dolfinx_ffr as ffr

SPEED, GROWTH, MASS, INERTIA, ARM = 3.0, 4.0, 2.0, 0.05, 0.3
#: The axis of the hub in space, on which it turns
AXIS = np.array([0.0, 0.6, 0.8])


def turning(space: bool) -> ffr.dynamics.Trajectory:
    """A rigid arm that a motor turns by SPEED t + GROWTH t^2 / 2, with a mass beside the axis."""
    motor = ffr.Motion.polynomial([0.0, SPEED, 0.5 * GROWTH])
    steps = ffr.RadauIIA(1.0, steps=40)
    if not space:
        body = ffr.VolumeIntegrals.rigid(
            MASS, (ARM, 0.0), INERTIA, {"hub": (0, 0), "tip": (ARM, 0)}
        )
        joints = [
            ffr.Revolute(("arm", "hub"), ffr.Ground(), name="bearing"),
            ffr.PrescribedAngle(("arm", "hub"), motor, name="motor"),
        ]
        placed = ffr.Placement(angular_velocity=SPEED)
        return ffr.simulate(ffr.Mechanism({"arm": placed}, joints), {"arm": body}, steps)
    markers = {"hub": (0, 0, 0), "tip": (ARM, 0, 0)}
    body = ffr.VolumeIntegrals.rigid(MASS, (ARM, 0, 0), [INERTIA] * 3, markers)
    joints = [
        ffr.Revolute(("arm", "hub"), ffr.Ground((0, 0, 0)), name="bearing", axis=tuple(AXIS)),
        ffr.PrescribedAngle(("arm", "hub"), motor, name="motor", axis=tuple(AXIS)),
    ]
    placed = ffr.Placement((0, 0, 0), angular_velocity=tuple(SPEED * AXIS))
    return ffr.simulate(ffr.Mechanism({"arm": placed}, joints), {"arm": body}, steps)


@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
def test_a_rigid_arm_that_a_motor_turns(space: bool) -> None:
    run = turning(space)
    t, tip = run.t, ("arm", "tip")
    angle, omega = SPEED * t + 0.5 * GROWTH * t**2, SPEED + GROWTH * t
    axis = AXIS if space else np.array([0.0, 0.0, 1.0])
    d = 3 if space else 2
    turn = Rotation.from_rotvec(angle[:, None] * axis)
    place = turn.apply([ARM, 0.0, 0.0])
    velocity = np.cross(omega[:, None] * axis, place)
    swung = np.cross(omega[:, None] * axis, velocity)
    acceleration = np.cross(GROWTH * axis, place) + swung
    for computed, exact in (
        (run.marker_path(*tip), place),
        (run.marker_velocity(*tip), velocity),
        (run.marker_acceleration(*tip), acceleration),
    ):
        np.testing.assert_allclose(computed, exact[:, :d], atol=1e-9)
    np.testing.assert_allclose(run.marker_rotation(*tip), turn.as_matrix()[:, :d, :d], atol=1e-9)
    turning_speed = run.marker_angular_velocity(*tip)
    if space:
        np.testing.assert_allclose(turning_speed, omega[:, None] * AXIS, atol=1e-9)
        with pytest.raises(ValueError, match="is in space, where a rotation is no angle"):
            run.marker_angle(*tip)
    else:
        np.testing.assert_allclose(run.marker_angle(*tip), angle, atol=1e-9)
        np.testing.assert_allclose(turning_speed, omega, atol=1e-9)
    # the moment about the axis times the speed; all mass is at the distance of the tip from it
    distance = np.linalg.norm(np.cross(axis, [ARM, 0.0, 0.0]))
    moment = (INERTIA + MASS * distance**2) * GROWTH
    np.testing.assert_allclose(run.drive_power("motor"), moment * omega, rtol=1e-8)
    with pytest.raises(ValueError, match=r"'bearing' has no drive.* motion are \['motor'\]"):
        run.drive_power("motor", "bearing")
    with pytest.raises(ValueError, match=r"no body 'leg'; the bodies are \['arm'\]"):
        run.marker_velocity("leg", "tip")
    with pytest.raises(ValueError, match=r"has no marker 'top'; its markers are \['hub', 'tip'\]"):
        run.marker_angular_velocity("arm", "top")


def test_markers_of_a_flexible_rod() -> None:
    """Velocities are the derivatives of places over time, also where the rod bends."""
    scene = slider_crank(0.2, 400, 3)
    run = ffr.simulate(scene.mechanism, scene.bodies, scene.integrator)
    name = next(body for body, integrals in scene.bodies.items() if integrals.modes)
    marker = list(scene.bodies[name].markers)[-1]
    middle, step = slice(1, -1), run.t[1] - run.t[0]

    def rate(values: np.ndarray) -> np.ndarray:
        return (values[2:] - values[:-2]) / (2.0 * step)

    velocity, turned = run.marker_velocity(name, marker), run.marker_angle(name, marker)
    for computed, exact in (
        (velocity, rate(run.marker_path(name, marker))),
        (run.marker_acceleration(name, marker), rate(velocity)),
        (run.marker_angular_velocity(name, marker), rate(turned)),
    ):
        np.testing.assert_allclose(computed[middle], exact, atol=2e-2 * np.abs(exact).max())
    assert np.abs(turned - run.rigid(name)[:, 2]).max() > 0.0  # it turns in the body
    cosine = run.marker_rotation(name, marker)[:, 0, 0]
    np.testing.assert_allclose(cosine, np.cos(turned), atol=1e-12)
