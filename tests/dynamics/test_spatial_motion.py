# SPDX-License-Identifier: MIT
"""Motions in space against closed forms, published numbers and invariants."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Integrator, Trajectory
from dolfinx_ffr.mechanism import Joint

Array = NDArray[np.float64]


def free_body(
    inertia: tuple[float, ...], spin: tuple[float, ...], integrator: Integrator
) -> Trajectory:
    """A free rigid body from its angular velocity."""
    body = ffr.VolumeIntegrals.rigid(1.0, inertia=inertia)
    mechanism = ffr.Mechanism({"top": ffr.Placement((0.0, 0.0, 0.0), angular_velocity=spin)})  # type: ignore[arg-type]
    return ffr.simulate(mechanism, {"top": body}, integrator)


def extrapolated(coarse: Array, fine: Array) -> Array:
    """Limit of results of second order with steps h and h / 2."""
    return np.asarray((4.0 * fine - coarse) / 3.0)


def test_torque_free_symmetric_top() -> None:
    """Of second order by generalised-alpha, of fifth by Radau's method."""
    J, spin, end = (0.2, 0.2, 0.35), (0.8, 0.0, 5.0), 2.0
    L = np.array(J) * spin
    exact = Rotation.from_rotvec(L * end / J[0]) * Rotation.from_rotvec(
        [0.0, 0.0, -(J[2] - J[0]) / J[0] * spin[2] * end]
    )

    def error(integrator: Integrator, drift: float) -> float:
        trajectory = free_body(J, spin, integrator)
        A = trajectory.rotation("top")
        identities = np.tile(np.eye(3), (len(A), 1, 1))
        np.testing.assert_allclose(A.transpose(0, 2, 1) @ A, identities, atol=1e-14)
        energy = trajectory.kinetic_energy("top")
        assert np.ptp(energy) < drift * energy[0]
        return float(np.max(np.abs(A[-1] - exact.as_matrix())))

    coarse = error(ffr.GeneralizedAlpha(end, 200), 2e-8)
    fine = error(ffr.GeneralizedAlpha(end, 400), 1e-8)
    assert fine < 3e-5
    assert coarse / fine == pytest.approx(4.0, rel=0.02)
    errors = [error(ffr.RadauIIA(end, steps=n), 2e-6) for n in (20, 40, 80)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 5.0, atol=0.1)
    assert error(ffr.RadauIIA(end, tolerance=1e-8), 1e-7) < 1e-8


def test_intermediate_axis() -> None:
    """Dzhanibekov's body turns over; reference by a Runge-Kutta method of order 8."""
    inertia, spin = (3.0, 2.0, 1.0), (0.1, 2.0, 0.1)
    runs = [free_body(inertia, spin, ffr.GeneralizedAlpha(5.0, n)) for n in (1000, 2000)]
    coarse, fine = (run.v[-1, 3:6] for run in runs)
    expected = (0.214448400638, -1.972824282695, 0.343459385675)
    np.testing.assert_allclose(extrapolated(coarse, fine), expected, atol=1e-6)
    trajectory = free_body(inertia, spin, ffr.RadauIIA(10.0, tolerance=1e-10))
    expected = (1.150535090216, 0.242501584624, -1.987760795834)
    np.testing.assert_allclose(trajectory.v[-1, 3:6], expected, atol=1e-7)


def test_heavy_top() -> None:
    """O. Brüls, A. Cardona, M. Arnold, doi:10.1016/j.mechmachtheory.2011.07.017."""
    inertia = (0.234375, 0.46875, 0.234375)
    body = ffr.VolumeIntegrals.rigid(15.0, (0.0, 1.0, 0.0), inertia, {"tip": (0.0, 0.0, 0.0)})
    spin = (0.0, 150.0, -4.61538)
    mechanism = ffr.Mechanism(
        {"top": ffr.Placement((0.0, 0.0, 0.0), angular_velocity=spin)},
        joints=[ffr.Spherical(("top", "tip"), ffr.Ground())],
        gravity=(0.0, 0.0, -9.81),
    )

    def axis(n: int) -> Array:
        integrator = ffr.GeneralizedAlpha(0.2, n)
        return ffr.simulate(mechanism, {"top": body}, integrator).rotation("top")[-1, :, 1]

    # Euler parameters of a Runge-Kutta method, the scalar first.
    e = (-0.708279152974, 0.438781088127, 0.545728396145, 0.089399752824)
    expected = Rotation.from_quat([*e[1:], e[0]]).as_matrix()[:, 1]
    np.testing.assert_allclose(extrapolated(axis(400), axis(800)), expected, atol=1e-5)


def test_rotor_that_turns_too_far_in_a_step_is_reported() -> None:
    with pytest.warns(ffr.TimeStepWarning, match="take 30[01] steps instead of 60"):
        spin = (2.0, 0.0, math.sqrt(896.0))
        free_body((0.2, 0.2, 0.35), spin, ffr.GeneralizedAlpha(1.0, 60))


def test_hooke_joint_transmits_its_ratio() -> None:
    beta, speed = math.radians(30.0), 2.0
    shaft = ffr.VolumeIntegrals.rigid(
        1.0, inertia=(0.1, 0.2, 0.2), markers={"end": (0.0, 0.0, 0.0), "far": (1.0, 0.0, 0.0)}
    )
    x, out = (1.0, 0.0, 0.0), (math.cos(beta), math.sin(beta), 0.0)
    drive, driven = ("in", "end"), ("out", "end")
    mechanism = ffr.Mechanism(
        {
            "in": ffr.Placement((0.0, 0.0, 0.0)),
            "out": ffr.Placement((0.0, 0.0, 0.0), rotation=(0.0, 0.0, beta)),
        },
        joints=[
            ffr.Revolute(drive, ffr.Ground(), axis=x),
            ffr.PrescribedAngle(drive, ffr.Motion.polynomial([0.0, speed]), axis=x),
            # At the start the driving fork is perpendicular to the plane of the shafts.
            ffr.Universal(drive, driven, (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
            ffr.PointOnLine(("out", "far"), ffr.Ground(), out),
        ],
    )
    end = math.radians(160.0) / speed
    trajectory = ffr.simulate(
        mechanism, {"in": shaft, "out": shaft}, ffr.GeneralizedAlpha(end, 160)
    )
    ratio = trajectory.v[:, 9] / speed
    turned = np.sin(speed * trajectory.t)
    exact = math.cos(beta) / (1.0 - (math.sin(beta) * turned) ** 2)
    np.testing.assert_allclose(ratio, exact, atol=1e-10)
    assert np.max(ratio) == pytest.approx(1.154700538, rel=1e-6)
    assert np.min(ratio) == pytest.approx(0.866025404, rel=1e-3)


def bricard(integrator: Integrator) -> Array:
    """Place of the fourth corner of Bricard's mechanism at the end, shape (3,) [m]."""
    corners = [(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)]
    axes = np.eye(3)[[1, 2, 0, 1, 2, 0]]
    long, across = (1.0 + 0.01) / 12.0, 0.02 / 12.0
    placements, bodies = {}, {}
    for k in range(5):
        start, end = (np.array(corners[i], dtype=float) for i in (k, k + 1))
        x = end - start
        y = np.roll(x, 1)
        frame = np.stack([x, y, np.cross(x, y)], axis=1)
        placements[f"rod {k}"] = ffr.Placement(tuple(start), rotation=frame)
        bodies[f"rod {k}"] = ffr.VolumeIntegrals.rigid(
            1.0, (0.5, 0.0, 0.0), (across, long, long), {"a": (0, 0, 0), "b": (1.0, 0, 0)}
        )

    def hinge(k: int) -> Joint:
        here = (f"rod {k}", "a") if k < 5 else ("rod 4", "b")
        if k == 0:
            return ffr.Revolute(here, ffr.Ground(corners[0]), axis=tuple(axes[0]))
        if k == 5:
            # One of the rows of six hinges is redundant: a cylinder leaves it out.
            return ffr.Cylindrical(here, ffr.Ground(corners[5]), tuple(axes[5]))
        before = f"rod {k - 1}"
        frame = np.asarray(placements[before].rotation)
        return ffr.Revolute(here, (before, "b"), axis=tuple(frame.T @ axes[k]))

    mechanism = ffr.Mechanism(placements, [hinge(k) for k in range(6)], gravity=(0.0, -9.81, 0.0))
    trajectory = ffr.simulate(mechanism, bodies, integrator)
    return trajectory.marker_path("rod 2", "b")[-1]


def test_bricard() -> None:
    """IFToMM's benchmark A04; the numbers are those of Exudyn, extrapolated, to 1e-7."""
    motion_at_end = extrapolated(*(bricard(ffr.GeneralizedAlpha(0.4, n)) for n in (100, 200)))
    np.testing.assert_allclose(motion_at_end, (0.987207406, -1.148426164, 0.840558673), atol=3e-7)
    motion_at_end = bricard(ffr.RadauIIA(2.0, tolerance=1e-8))
    np.testing.assert_allclose(motion_at_end, (-0.969340345, -1.221246895, 0.754278011), atol=3e-7)


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
    blocks = {name: (0.05 * sign, 0.0, 0.0) for name, sign in sides.items()}
    foot = {"foot": (0.0, 0.0, -0.5), **hinges}
    bodies = {
        "shaft": rigid(0.3, (0.0,) * 3, (across, across, thin), foot),
        "slider": rigid(3.0, (0.0,) * 3, (small,) * 3, blocks),
        **dict.fromkeys(sides, arm),
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


def test_stiff_flyball_governor() -> None:
    """IFToMM's benchmark A05, whose springs are much faster than its motion.

    The numbers are those of Lagrange's equations in the angle of the arms and the height of the
    slider, at constant angular momentum about the shaft, by Radau's method to 1e-12. Errors and the
    drift of the momentum are at most ten times the tolerance.
    """
    mechanism, bodies = governor()
    tolerance = 1e-8
    motion = ffr.simulate(mechanism, bodies, ffr.RadauIIA(1.0, tolerance=tolerance))
    assert motion.rigid("slider")[-1, 2] == pytest.approx(0.501420922380, abs=10 * tolerance)
    for name in ("east", "west"):
        down = -motion.rotation(name)[-1, 2, 0]
        assert math.asin(down) == pytest.approx(0.521833301626, abs=10 * tolerance)
    shaft = motion.rotation("shaft")
    turn = np.unwrap(np.arctan2(shaft[:, 1, 0], shaft[:, 0, 0]))
    assert turn[-1] == pytest.approx(5.586346965869, rel=10 * tolerance)
    momentum = sum(motion.angular_momentum(name)[:, 2] for name in bodies)
    np.testing.assert_allclose(momentum, momentum[0], rtol=10 * tolerance)
    methods = (ffr.GeneralizedAlpha(0.5, steps) for steps in (250, 500))
    runs = [ffr.simulate(mechanism, bodies, method) for method in methods]
    errors = [motion.rigid("slider")[-1, 2] - 0.743249424786 for motion in runs]
    assert abs(errors[0]) < 1e-4
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


def test_static_equilibrium() -> None:
    """A rod hangs down from a ball, whatever its placement."""
    rod = ffr.VolumeIntegrals.rigid(
        1.0, (0.5, 0.0, 0.0), (0.01, 0.1, 0.1), {"top": (0, 0, 0), "end": (1.0, 0, 0)}
    )
    mechanism = ffr.Mechanism(
        {"rod": ffr.Placement((0.0, 0.0, 0.0), rotation=(0.3, 0.5, 0.2))},
        joints=[ffr.Universal(("rod", "top"), ffr.Ground(), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))],
        gravity=(0.0, 0.0, -9.81),
        start=ffr.StaticEquilibrium(),
    )
    trajectory = ffr.simulate(mechanism, {"rod": rod}, ffr.GeneralizedAlpha(0.1, 10))
    np.testing.assert_allclose(
        trajectory.marker_path("rod", "end"), np.tile([0.0, 0.0, -1.0], (11, 1)), atol=1e-9
    )


def test_between_its_instants_a_motion_turns_as_one_of_many_steps() -> None:
    """Also where rotation vectors jump by a full turn, and through the frames of a film."""
    spin, inertia = (0.3, 8.0, 0.2), (1.0, 2.0, 3.0)
    body = ffr.VolumeIntegrals.rigid(1.0, inertia=inertia, markers={"tip": (0.0, 0.0, 1.0)})
    start = ffr.Placement((0.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0), angular_velocity=spin)
    mechanism = ffr.Mechanism({"top": start})
    coarse = ffr.simulate(mechanism, {"top": body}, ffr.RadauIIA(3.0, steps=80))
    fine = ffr.simulate(mechanism, {"top": body}, ffr.GeneralizedAlpha(3.0, 6000))
    jumps = np.linalg.norm(np.diff(coarse.rigid("top")[:, 3:], axis=0), axis=1)
    assert np.max(jumps) > math.pi  # of a vector, not of the rotation
    between = coarse.at(fine.t)
    np.testing.assert_allclose(between.rotation("top"), fine.rotation("top"), atol=1e-3)
    np.testing.assert_allclose(between.v[:, 3:6], fine.v[:, 3:6], atol=0.05)
    path = between.marker_path("top", "tip")
    np.testing.assert_allclose(path, fine.marker_path("top", "tip"), atol=1e-3)
    # at its own instants it is the motion
    again = coarse.at(coarse.t)
    np.testing.assert_allclose(again.rigid("top"), coarse.rigid("top"), atol=1e-12)


def test_no_way_is_guessed_between_instants_that_are_half_a_turn_apart() -> None:
    trajectory = free_body((1.0, 2.0, 3.0), (0.0, 0.0, 40.0), ffr.GeneralizedAlpha(1.0, 10))
    assert not trajectory.follows_turns
    with pytest.raises(ValueError, match="half a turn or more between two instants"):
        trajectory.at(np.linspace(0.0, 1.0, 50))
