# SPDX-License-Identifier: MIT
"""Power and work of drives: closed forms, and derivatives in the plane and in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shared.derivatives import check_slope, difference
from shared.spatial_bodies import cloud, stiffened_cloud

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import simulate
from dolfinx_ffr.objective import DrivePower, DriveWork

MASS, ARM, GRAVITY, SPEED, END = 2.0, 0.25, 9.81, 7.0, 2.0 * np.pi / 7.0


def wheel(space: bool, motion: ffr.Motion | None = None) -> tuple[ffr.Mechanism, dict]:
    """A rigid bar on a bearing, turned by a motor under gravity: one turn in the time END."""
    mark = {"hub": (0.0, 0.0, 0.0)[: 2 + space]}
    inertia = 0.1 * np.eye(3) if space else 0.1
    body = ffr.VolumeIntegrals.rigid(MASS, (ARM, 0.0, 0.0)[: 2 + space], inertia, mark)
    mechanism = ffr.Mechanism(
        {"bar": ffr.Placement((0.0, 0.0, 0.0)[: 2 + space])},
        [
            ffr.Revolute(("bar", "hub"), ffr.Ground(), name="bearing"),
            ffr.PrescribedAngle(
                ("bar", "hub"), motion or ffr.Motion.polynomial([0.0, SPEED]), name="motor"
            ),
        ],
        gravity=(0.0, -GRAVITY, 0.0)[: 2 + space],
    )
    return mechanism, {"bar": body}


@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
@pytest.mark.parametrize(
    "method", [ffr.GeneralizedAlpha(END, 400), ffr.RadauIIA(END, steps=60)], ids=["alpha", "radau"]
)
def test_a_bar_that_is_lifted_and_let_down(space: bool, method: ffr.RadauIIA) -> None:
    """P = m g a omega cos(omega t): a half of the turn is paid for, the other gives it back."""
    mechanism, bodies = wheel(space)
    trajectory = simulate(mechanism, bodies, method)
    response = ffr.Response(trajectory, bodies)
    largest = MASS * GRAVITY * ARM * SPEED
    powers = DrivePower("motor").powers(response)
    np.testing.assert_allclose(powers, largest * np.cos(SPEED * trajectory.t), atol=1e-6 * largest)
    force = trajectory.joint_force("motor")[:, 0]
    np.testing.assert_allclose(powers, force * SPEED, rtol=1e-9, atol=1e-9 * largest)
    assert DrivePower("motor").evaluate(response) == pytest.approx(largest / 2**0.5, rel=1e-4)
    for of in (DrivePower, ffr.JointForce):
        peak = of("motor", power=8.0, peak=True)
        size = np.abs(powers if of is DrivePower else force)
        # A peak is the peak, and what its derivative takes is the mean, as large as that there.
        assert peak.evaluate(response) == pytest.approx(np.max(size), rel=1e-12)
        mean, slopes = replace(peak, peak=False), peak.derivatives(response).trajectory
        share = peak.evaluate(response) / mean.evaluate(response)
        of_mean = mean.derivatives(response).trajectory
        assert slopes is not None and of_mean is not None
        np.testing.assert_allclose(slopes.multipliers, share * of_mean.multipliers, rtol=1e-12)
    lifted = 2.0 * MASS * GRAVITY * ARM
    for recovered, expected in ((1.0, 0.0), (0.4, 0.6), (0.0, 1.0), (-1.0, 2.0)):
        work = DriveWork("motor", recovered, rounding=1e-3).evaluate(response)
        assert work == pytest.approx(expected * lifted, abs=2e-3 * lifted)


def test_work_is_the_energy_gained_and_a_crank_has_its_power_at_the_pin() -> None:
    """With a motor, and with the same bar on the end of a prescribed crank."""
    swing = ffr.Motion.smooth_step(2.0, 0.5)
    mechanism, bodies = wheel(False, swing)
    trajectory = simulate(mechanism, bodies, ffr.RadauIIA(0.4, steps=40))
    energy = trajectory.kinetic_energy("bar") + trajectory.potential_energy("bar")
    work = DriveWork("motor", recovered=1.0).evaluate(ffr.Response(trajectory, bodies))
    assert work == pytest.approx(energy[-1] - energy[0], rel=1e-8)
    crank = ffr.Moving.circle((0.0, 0.0), 0.3, swing)
    joints = [
        ffr.Revolute(("bar", "hub"), crank, name="pin"),
        ffr.PrescribedAngle(("bar", "hub"), ffr.Motion.constant(0.0), crank, name="held"),
    ]
    placed = {"bar": ffr.Placement((0.3, 0.0))}
    mechanism = replace(mechanism, placements=placed, joints=joints)
    trajectory = simulate(mechanism, bodies, ffr.RadauIIA(0.4, steps=80))
    energy = trajectory.kinetic_energy("bar") + trajectory.potential_energy("bar")
    both = DriveWork(["pin", "held"], recovered=1.0)  # type: ignore[arg-type]
    response = ffr.Response(trajectory, bodies)
    assert both.evaluate(response) == pytest.approx(energy[-1] - energy[0], rel=1e-8)
    works = [DriveWork(name, recovered=1.0).evaluate(response) for name in ("pin", "held")]
    assert sum(works) == pytest.approx(both.evaluate(response), rel=1e-12)
    assert all(abs(part) > 0.05 * abs(work) for part in works)


def test_a_body_at_rest_takes_no_power() -> None:
    mechanism, bodies = wheel(False, ffr.Motion.constant(0.0))
    response = ffr.Response(simulate(mechanism, bodies, ffr.GeneralizedAlpha(0.1, 10)), bodies)
    for objective in (DrivePower("motor"), DriveWork("motor")):
        assert objective.evaluate(response) == pytest.approx(0.0, abs=1e-12)
        assert objective.derivatives(response).trajectory is not None


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.LargeDeformationWarning")
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.SofteningWarning")
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.TimeStepWarning")
@pytest.mark.filterwarnings("ignore::dolfinx_ffr.dynamics.TiltedAxisWarning")
@pytest.mark.parametrize(
    ("make", "method"),
    [(cloud, ffr.RadauIIA(0.3, steps=10)), (stiffened_cloud, ffr.GeneralizedAlpha(0.3, 30))],
    ids=["radau", "alpha, stiffened"],
)
@pytest.mark.parametrize(
    "objective",
    [
        DrivePower(("motor", "spindle"), power=4.0),
        DriveWork(("motor", "spindle"), recovered=0.3, rounding=0.1),
    ],
    ids=["power", "work"],
)
def test_derivatives_in_space(make, method, objective: ffr.Objective) -> None:  # type: ignore[no-untyped-def]
    """A motor and a spindle between flexible bodies; markers move with all their shapes."""
    bodies = {"one": make(3, 1), "two": make(2, 2)}
    axis = (0.3, 0.2, 1.0)
    turn, way = ffr.Motion.smooth_step(1.0, 0.5), ffr.Motion.fourier(0.4, [], [0.05, 0.02])
    mechanism = ffr.Mechanism(
        {"one": ffr.Placement((0.5, 0.0, 0.0)), "two": ffr.Placement((1.5, 0.1, -0.1))},
        [
            ffr.Revolute(("one", "root"), ffr.Ground(), axis=axis),
            ffr.PrescribedAngle(("one", "root"), turn, axis=axis, name="motor"),
            ffr.Translational(("two", "root"), ("one", "tip"), (1.0, 0.2, 0.0)),
            ffr.LinearDrive(("two", "root"), ("one", "tip"), way, (1.0, 0.2, 0.0), name="spindle"),
        ],
        gravity=(0.0, 0.0, -9.81),
    )
    problem = ffr.MechanicalProblem(mechanism, method, objective)
    gradient = problem.gradient(bodies).integrals_gradient
    assert gradient is not None
    rng = np.random.default_rng(0)
    direction = {name: body.zeros_like() for name, body in bodies.items()}
    for name, body in bodies.items():
        for mark, point in body.markers.items():
            direction[name].markers[mark] = replace(
                point.scaled(0.0),
                position=0.05 * rng.standard_normal(3),
                displacement=rng.standard_normal(point.displacement.shape),
                rotation=rng.standard_normal(point.rotation.shape),
            )
        K = rng.standard_normal(body.K.shape) * np.max(body.K)
        direction[name] = replace(direction[name], mass=0.3, K=0.1 * (K + K.T))

    def psi(way: float) -> float:
        return problem.value({n: b + direction[n].scaled(way) for n, b in bodies.items()}).psi

    slope = sum(gradient[name].dot(direction[name]) for name in bodies)
    check_slope(psi, slope, 1e-3, points=3, roundoff=1e-13)
    assert slope == pytest.approx(difference(psi, 1e-3), rel=1e-7)
