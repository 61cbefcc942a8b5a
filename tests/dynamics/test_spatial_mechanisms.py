# SPDX-License-Identifier: MIT
"""Machines in space against closed forms: a shaft with a universal joint, a governor, a linkage."""

from __future__ import annotations

import math

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.integrate import OdeSolution, solve_ivp

import dolfinx_ffr as ffr

Array = NDArray[np.float64]


def turned(motion: ffr.Trajectory, body: str) -> Array:
    """Angle of a body about the x axis of its frame at the start, over time [rad]."""
    rotation = motion.rotation(body)
    relative = rotation[0].T @ rotation
    return np.unwrap(np.arctan2(relative[:, 2, 1], relative[:, 1, 1]))


@pytest.mark.mpi
def test_flexible_shaft_behind_a_universal_joint(comm: MPI.Intracomm) -> None:
    """Its fork turns as Hooke's joint tells, a disc at its end lags by the twist.

    The twist is that of Saint-Venant's torsion under the disc's inertia, tan(out) = tan(in) cos.
    """
    angle, speed, length, side, inertia = math.radians(20.0), 20.0 * math.pi, 0.3, 0.03, 0.01
    box = ffr.Domain.box(comm, length, side, side, elements=(4, 2, 2), order=2, solid_layers=0)
    steel = ffr.Isotropic(young=210e9, poisson=0.3, density=7850.0)
    axis = (math.cos(angle), math.sin(angle), 0.0)
    end, incline = (length * axis[0], length * axis[1], 0.0), (0.0, 0.0, angle)
    bodies = {
        "shaft": ffr.VolumeIntegrals.rigid(
            1.0, inertia=(1e-3, 4e-3, 4e-3), markers={"end": (0,) * 3}
        ),
        "link": ffr.FlexibleBody(box, steel, frame=ffr.TangentFrame("left"), modes=0),
        "disc": ffr.VolumeIntegrals.rigid(
            2.0, inertia=(inertia, inertia / 2.0, inertia / 2.0), markers={"hub": (0,) * 3}
        ),
    }
    drive = ffr.Motion.polynomial([0.0, speed])
    mechanism = ffr.Mechanism(
        placements={
            "shaft": ffr.Placement((0.0, 0.0, 0.0)),
            "link": ffr.Placement((0.0, 0.0, 0.0), rotation=incline),
            "disc": ffr.Placement(end, rotation=incline),
        },
        joints=[
            ffr.Revolute(("shaft", "end"), ffr.Ground(), axis=(1.0, 0.0, 0.0)),
            ffr.PrescribedAngle(("shaft", "end"), drive, axis=(1.0, 0.0, 0.0)),
            ffr.Universal(("shaft", "end"), ("link", "left"), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
            ffr.Weld(("disc", "hub"), ("link", "right")),
            ffr.PointOnLine(("disc", "hub"), ffr.Ground(end), direction=axis),
        ],
        damping={"link": ffr.RayleighDamping(beta=1e-4)},
    )
    problem = ffr.Problem(
        bodies,
        mechanism,
        ffr.GeneralizedAlpha(2.0 * math.pi / speed, 100),
        ffr.IntegralCompliance(),
    )
    motion = problem.value(np.ones(box.n_cells)).motion
    assert motion is not None
    turn = speed * motion.t
    hooke = np.unwrap(np.arctan2(math.cos(angle) * np.sin(turn), np.cos(turn)))
    fork, disc = turned(motion, "link"), turned(motion, "disc")
    # The cross bends the link a little, which tilts the fork.
    assert_allclose(fork, hooke, atol=1e-5)

    ratio = math.cos(angle) / (1.0 - (math.sin(angle) * np.sin(turn)) ** 2)
    rate = math.sin(angle) ** 2 * np.sin(2.0 * turn) / math.cos(angle)
    acceleration = speed**2 * ratio**2 * rate
    torsion = 0.140577015 * side**4 * 210e9 / 2.6 / length
    twist = -inertia / torsion * acceleration
    assert_allclose(disc - fork, twist, atol=0.1 * np.max(np.abs(twist)))

    x = 0.7 + 0.2 * np.sin(50.0 * box.centroids.sum(axis=1))
    direction = np.cos(80.0 * box.centroids[:, 0] + box.centroids[:, 1] / side)
    gradient = problem.gradient(x).gradient
    assert gradient is not None
    above, below = (problem.value(x + step * direction).psi for step in (1e-4, -1e-4))
    slope = comm.allreduce(gradient["link"] @ direction)
    assert slope == pytest.approx((above - below) / 2e-4, rel=1e-6)


def governor() -> tuple[ffr.Mechanism, dict[str, ffr.VolumeIntegrals]]:
    """The flyball governor: a shaft, a slider on it, and two arms with springs to the slider."""
    thin, small, across = 0.3 * 1e-4 / 6.0, 3.0 * 0.01 / 6.0, 0.3 * 1.0001 / 12.0
    rigid = ffr.VolumeIntegrals.rigid
    arm = rigid(
        0.3,
        (0.5, 0.0, 0.0),
        (thin, across, across),
        {"hinge": (0.0, 0.0, 0.0), "middle": (0.5, 0.0, 0.0), "ball": (1.0, 0.0, 0.0)},
    )
    sides = {"east": 1.0, "west": -1.0}
    hinges = {name: (0.05 * sign, 0.0, 0.5) for name, sign in sides.items()}
    bodies = {
        "shaft": rigid(
            0.3, (0.0,) * 3, (across, across, thin), {"foot": (0.0, 0.0, -0.5), **hinges}
        ),
        "slider": rigid(
            3.0,
            inertia=(small,) * 3,
            markers={name: (0.05 * sign, 0.0, 0.0) for name, sign in sides.items()},
        ),
        "east": arm,
        "west": arm,
    }
    spin, c, s = (0.0, 0.0, 2.0 * math.pi), math.cos(math.pi / 6.0), math.sin(math.pi / 6.0)
    arms = {
        name: ffr.Placement(
            (0.05 * sign, 0.0, 1.0),
            velocity=(0.0, 0.05 * sign * spin[2], 0.0),
            rotation=np.array([[sign * c, 0.0, sign * s], [0.0, sign, 0.0], [-s, 0.0, c]]),
            angular_velocity=spin,
        )
        for name, sign in sides.items()
    }
    up, level = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
    mechanism = ffr.Mechanism(
        placements={
            "shaft": ffr.Placement((0.0, 0.0, 0.5), angular_velocity=spin),
            "slider": ffr.Placement((0.0, 0.0, 0.5), angular_velocity=spin),
            **arms,
        },
        joints=[
            ffr.Revolute(("shaft", "foot"), ffr.Ground(), axis=up),
            ffr.Translational(("slider", "east"), ("shaft", "east"), direction=up),
            *(ffr.Revolute((name, "hinge"), ("shaft", name), axis=level) for name in sides),
        ],
        forces=[
            ffr.SpringDamper((name, "middle"), ("slider", name), 8e5, 4e4, length=0.5)
            for name in sides
        ],
        point_masses=[ffr.PointMass((name, "ball"), 5.0) for name in sides],
        gravity=(0.0, 0.0, -9.81),
    )
    return mechanism, bodies


def governor_by_lagrange() -> OdeSolution:
    """Angle of the arms below level, height of the slider, their rates, and turn of the shaft.

    Lagrange's equations at constant angular momentum about the shaft.
    """
    g, thin, across, ends = 9.81, 0.3 * 1e-4 / 6.0, 0.3 * 1.0001 / 12.0, 0.3 * 1e-4 / 6.0 + 0.005
    stiffness, damping, length, inertia = 8e5, 4e4, 0.5, 5.0 + 0.3 * 0.25 + 0.3 * 1.0001 / 12.0

    def about_shaft(a: float) -> tuple[float, float]:
        """Moment of inertia, and its derivative."""
        c, s = math.cos(a), math.sin(a)
        value = 5.0 * (0.05 + c) ** 2 + 0.3 * (0.05 + 0.5 * c) ** 2 + across * c**2 + thin * s**2
        slope = -10.0 * (0.05 + c) * s - 0.3 * (0.05 + 0.5 * c) * s + 2.0 * (thin - across) * c * s
        return ends + 2.0 * value, 2.0 * slope

    momentum = 2.0 * math.pi * about_shaft(math.pi / 6.0)[0]

    def rates(_: float, state: Array) -> list[float]:
        a, z, da, dz, _ = state
        out, up = 0.5 * math.cos(a), 1.0 - 0.5 * math.sin(a) - z
        spring = math.hypot(out, up)
        by_a = -0.5 * (out * math.sin(a) + up * math.cos(a)) / spring
        by_z = -up / spring
        force = stiffness * (spring - length) + damping * (by_a * da + by_z * dz)
        value, slope = about_shaft(a)
        turn = momentum / value
        weight = 2.0 * (5.0 + 0.15) * g * math.cos(a)
        arm = (0.5 * turn**2 * slope + weight - 2.0 * force * by_a) / (2.0 * inertia)
        return [da, dz, arm, -g - 2.0 * force * by_z / 3.0, turn]

    start = [math.pi / 6.0, 0.5, 0.0, 0.0, 0.0]
    exact = {"rtol": 1e-12, "atol": 1e-13, "dense_output": True}
    return solve_ivp(rates, (0.0, 1.0), start, "Radau", **exact).sol


def test_stiff_flyball_governor() -> None:
    """IFToMM's benchmark A05, whose springs are much faster than its motion.

    Errors and the drift of the momentum are at most ten times the tolerance.
    """
    mechanism, bodies = governor()
    exact = governor_by_lagrange()
    tolerance = 1e-8
    motion = ffr.simulate(mechanism, bodies, ffr.RadauIIA(1.0, tolerance=tolerance))
    angle, height, _, _, turn = exact(1.0)
    assert motion.rigid("slider")[-1, 2] == pytest.approx(height, abs=10 * tolerance)
    for name in ("east", "west"):
        down = -motion.rotation(name)[-1, 2, 0]
        assert math.asin(down) == pytest.approx(angle, abs=10 * tolerance)
    assert turned_about_z(motion, "shaft")[-1] == pytest.approx(turn, rel=10 * tolerance)
    momentum = sum(motion.angular_momentum(name)[:, 2] for name in bodies)
    assert_allclose(momentum, momentum[0], rtol=10 * tolerance)
    coarse, fine = (
        ffr.simulate(mechanism, bodies, ffr.GeneralizedAlpha(0.5, steps)) for steps in (250, 500)
    )
    errors = [motion.rigid("slider")[-1, 2] - exact(0.5)[1] for motion in (coarse, fine)]
    assert abs(errors[0]) < 1e-4
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


def turned_about_z(motion: ffr.Trajectory, body: str) -> Array:
    """Angle of a body about the z axis, over time [rad]."""
    rotation = motion.rotation(body)
    return np.unwrap(np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]))


@pytest.mark.parametrize("tilt", [0.0, 5.0, 30.0])
def test_four_bar_with_a_misaligned_axis(tilt: float) -> None:
    """The axis of the rocker is tilted about the line of centres; with 0 degrees all is in a plane.

    The distance of the two pins is constant, which is Freudenstein's equation for the rocker.
    """
    base, crank, coupler, rocker = 0.2, 0.06, 0.2, 0.12
    lean = math.radians(tilt)
    axis, across = np.array([0.0, -math.sin(lean), math.cos(lean)]), np.array([1.0, 0.0, 0.0])
    upward = np.cross(axis, across)

    def exact(angle: Array) -> Array:
        """Angle of the rocker from the line of centres [rad]."""
        pin = crank * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
        gap = pin - [base, 0.0, 0.0]
        a, b = 2.0 * rocker * gap @ across, 2.0 * rocker * gap @ upward
        rest = np.sum(gap**2, axis=-1) + rocker**2 - coupler**2
        return np.arctan2(b, a) - np.arccos(rest / np.hypot(a, b))

    def rod(length: float) -> ffr.VolumeIntegrals:
        across = length**2 / 12.0
        markers = {"a": (0.0, 0.0, 0.0), "b": (length, 0.0, 0.0)}
        return ffr.VolumeIntegrals.rigid(1.0, (length / 2, 0, 0), (1e-4, across, across), markers)

    start = float(exact(np.array([0.5 * math.pi]))[0])
    pins = [
        np.array([0.0, crank, 0.0]),
        np.array([base, 0, 0]) + rocker * (math.cos(start) * across + math.sin(start) * upward),
    ]
    along = (pins[1] - pins[0]) / coupler
    third = np.cross(along, np.cross([0.0, 0.0, 1.0], along))
    third /= np.linalg.norm(third)
    frame = np.stack([along, np.cross(third, along), third], axis=1)
    arm = math.cos(start) * across + math.sin(start) * upward
    mechanism = ffr.Mechanism(
        placements={
            "crank": ffr.Placement((0.0, 0.0, 0.0), rotation=(0.0, 0.0, 0.5 * math.pi)),
            "coupler": ffr.Placement(tuple(pins[0]), rotation=frame),
            "rocker": ffr.Placement(
                (base, 0.0, 0.0), rotation=np.stack([arm, np.cross(axis, arm), axis], axis=1)
            ),
        },
        joints=[
            ffr.Revolute(("crank", "a"), ffr.Ground()),
            ffr.PrescribedAngle(
                ("crank", "a"), ffr.Motion.polynomial([0.5 * math.pi, 2.0 * math.pi])
            ),
            # The coupler must not spin about itself, as it could between two balls.
            ffr.Universal(("coupler", "a"), ("crank", "b"), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
            ffr.Spherical(("coupler", "b"), ("rocker", "b")),
            ffr.Revolute(("rocker", "a"), ffr.Ground((base, 0.0, 0.0)), axis=tuple(axis)),
        ],
    )
    bodies = {"crank": rod(crank), "coupler": rod(coupler), "rocker": rod(rocker)}
    motion = ffr.simulate(mechanism, bodies, ffr.GeneralizedAlpha(1.0, 100))
    path = motion.marker_path("rocker", "b") - [base, 0.0, 0.0]
    found = np.unwrap(np.arctan2(path @ upward, path @ across))
    angle = exact(2.0 * math.pi * (motion.t + 0.25))
    assert_allclose(found, np.unwrap(angle), atol=1e-11)
    assert_allclose(path @ axis, 0.0, atol=1e-13)
    assert np.ptp(found) > 0.9
