# SPDX-License-Identifier: MIT
"""Radau IIA: orders, constraints, tolerance, discrete adjoint, and refused runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.beams import beam
from shared.derivatives import along, check_slope, dot, random_direction
from shared.motions import pendulum
from shared.scenes import (
    SCENES,
    Bodies,
    Scene,
    parallelograms,
    slider_crank,
    slider_crank_mechanism,
    trapezoidal_drive,
)

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import Trajectory
from dolfinx_ffr.dynamics.integration.stages import NODES, stage_integrals
from dolfinx_ffr.verification import convergence_order

Array = NDArray[np.float64]
Function = Callable[[float], float]


def run(scene: Scene, **changes: object) -> Trajectory:
    integrator = ffr.RadauIIA(scene.integrator.end_time, **changes)
    return ffr.simulate(scene.mechanism, scene.bodies, integrator)


def compliance(trajectory: Trajectory) -> float:
    return ffr.IntegralCompliance().evaluate(ffr.Response(trajectory, trajectory.model.bodies))


def soft(name: str) -> Scene:
    """A scene over a short time whose bodies vibrate slowly enough to be resolved."""
    scene = slider_crank(modes=2) if name == "slider-crank" else SCENES[name]()
    bodies = {
        key: replace(body, K=0.02 * body.K, stiffening={}) for key, body in scene.bodies.items()
    }
    return Scene(scene.mechanism, bodies, ffr.GeneralizedAlpha(0.02, 100))


@pytest.mark.parametrize("name", ["slider-crank", "four-bar", "robot", "loader"])
def test_orders(name: str) -> None:
    # Enough steps for the fastest vibration, few enough for errors above round-off.
    scene = soft(name)
    steps = np.array([1, 2, 4]) * (80 if name == "slider-crank" else 40)
    runs = [run(scene, steps=int(count)) for count in (*steps, 4 * steps[-1])]

    def order(value: Callable[[Trajectory], Array]) -> float:
        exact = value(runs[-1])
        errors = [float(np.max(np.abs(value(r) - exact))) for r in runs[:-1]]
        return convergence_order(1.0 / steps, errors)

    assert order(lambda r: r.y[-1]) > 4.8
    assert order(lambda r: r.v[-1]) > 4.8
    assert order(lambda r: np.array(compliance(r))) > 4.8
    assert order(lambda r: r.multipliers[-1]) > 2.8
    assert order(lambda r: r.w[-1]) > 2.8


def test_pendulum_keeps_its_energy_over_a_long_time() -> None:
    scene = pendulum()
    trajectory = ffr.simulate(scene.mechanism, scene.bodies, ffr.RadauIIA(60.0, tolerance=1e-10))
    energy = trajectory.kinetic_energy("rod") + trajectory.potential_energy("rod")
    ends = energy[::3] / np.max(trajectory.kinetic_energy("rod"))
    assert np.max(np.abs(ends)) < 1e-7
    assert np.max(np.abs(np.hypot(*trajectory.rigid("rod")[:, :2].T) - 0.5)) < 1e-14


def test_steps_that_were_taken_can_be_taken_again() -> None:
    scene = slider_crank()
    adaptive = run(scene, tolerance=1e-5)
    again = run(scene, steps=adaptive.step_ends)
    np.testing.assert_array_equal(adaptive.t, again.t)
    scale = np.max(np.abs(adaptive.w), axis=0)
    assert np.max(np.abs(adaptive.w - again.w) / scale) < 1e-9
    # The sizes of the motion are those of the run itself, not also those of the one before it.
    assert again.error == pytest.approx(adaptive.error, rel=1e-2)


@pytest.mark.parametrize("count", [20, 40])
def test_estimated_error_is_that_of_the_deformations(count: int) -> None:
    """Within a factor of ten: it holds nothing of what joints correct in positions."""
    coarse, fine = (run(slider_crank(), steps=steps) for steps in (count, 4 * count))
    exact = fine.elastic("rod")[::12]
    error = np.max(np.abs(coarse.elastic("rod")[::3] - exact)) / np.max(np.abs(exact))
    assert 0.1 < coarse.error / error < 10.0


def test_forces_that_no_steps_follow_are_left_out_and_that_is_said() -> None:
    """Where links come into line forces grow without bound, and longer steps pass."""
    with pytest.warns(ffr.TimeStepWarning, match="not in the forces in joints.*links come into"):
        trajectory = ffr.simulate(*parallelograms(), ffr.RadauIIA(4.0, tolerance=1e-4))
    assert math.isnan(trajectory.force_error) and trajectory.error <= 1e-4


def jerky(known: bool = True) -> Scene:
    """A bar driven with a trapezoidal velocity, and a force that sets in."""
    begin, drive = 0.0503, trapezoidal_drive(known)
    bar = beam(0.4, 0.01, 0.01, elements=8, modes=2)
    mechanism = ffr.Mechanism(
        {"bar": ffr.Placement((0.2, 0.0))},
        [
            ffr.Revolute(("bar", "left"), ffr.Ground(), name="hinge"),
            ffr.PrescribedAngle(("bar", "left"), drive, name="motor"),
        ],
        forces=[ffr.Force(("bar", "right"), 0.0, lambda t: np.where(t > begin, 2.0, 0.0))],
        gravity=(0.0, -9.81),
        jumps=[begin] if known else [],
    )
    return Scene(mechanism, {"bar": replace(bar, K=0.05 * bar.K)}, ffr.GeneralizedAlpha(0.5, 1000))


@pytest.mark.filterwarnings("ignore:.*excites vibrations:dolfinx_ffr.TimeStepWarning")
def test_order_across_jumps() -> None:
    scene = jerky()
    steps = np.array([400, 800, 1600])
    exact = run(scene, steps=6400)
    errors = [
        [abs(compliance(r) / compliance(exact) - 1.0), np.max(np.abs(r.y[-1] - exact.y[-1]))]
        for r in (run(scene, steps=int(count)) for count in steps)
    ]
    for column in np.array(errors).T:
        assert convergence_order(1.0 / steps, column) > 4.7
    ends = run(scene, steps=7).step_ends
    assert {0.0503, 0.1, 0.4 - 0.1, 0.4} < set(ends)
    np.testing.assert_array_equal(run(scene, steps=ends).step_ends, ends)
    assert {0.0503, 0.1} < set(run(scene, steps=[0.0, 0.02, 0.3, 0.5]).step_ends)


@pytest.mark.slow
def test_steps_end_at_jumps() -> None:
    """Those that nobody named are found, and the motion is as accurate as where they are named."""
    scene, unaware = jerky(), jerky(known=False)
    exact = compliance(run(scene, steps=6400))
    for tolerance in (1e-5, 1e-7, 1e-9):
        aware = run(scene, tolerance=tolerance)
        other = run(unaware, tolerance=tolerance)
        assert {0.0503, 0.1, 0.4 - 0.1, 0.4} < set(aware.step_ends)
        for jump in (0.0503, 0.1, 0.4 - 0.1, 0.4):
            assert np.min(np.abs(other.step_ends - jump)) < 1e-14
        assert other.step_ends.size < 1.5 * aware.step_ends.size
        for computed in (aware, other):
            assert abs(compliance(computed) / exact - 1.0) < max(20.0 * tolerance, 1e-7)


def test_values_at_jumps_are_those_before() -> None:
    scene = jerky()
    trajectory = run(scene, steps=100)
    row = int(np.flatnonzero(trajectory.t == 0.0503)[0])
    force = trajectory.applied_force(scene.mechanism.force_names[0])[:, 1]
    assert force[row] == 0.0 and force[row + 1] == 2.0


def psi_along(problem: ffr.MechanicalProblem, bodies: Bodies) -> tuple[Function, float]:
    """The objective along a random change of the bodies, and its derivative."""
    direction = random_direction(bodies, 3)
    slope = dot(problem.gradient(bodies).integrals_gradient, direction)
    return along(lambda changed: problem.value(changed).psi, bodies, direction), slope


def test_gradient_across_jumps() -> None:
    scene, objective = jerky(), ffr.IntegralCompliance()
    problem = ffr.MechanicalProblem(scene.mechanism, ffr.RadauIIA(0.5, steps=400), objective)
    check_slope(*psi_along(problem, scene.bodies), 4e-4, points=4)


def test_weights_integrate_polynomials_exactly() -> None:
    trajectory = run(slider_crank(end_time=0.1), steps=np.array([0.0, 0.01, 0.04, 0.1]))
    for power in range(5):
        exact = 0.1 ** (power + 1) / (power + 1)
        assert trajectory.weights @ trajectory.t**power == pytest.approx(exact, rel=1e-12)
    over_a_step = stage_integrals(np.array([1.0]))[0]
    np.testing.assert_allclose(over_a_step @ NODES[:, None] ** np.arange(3), 1.0 / np.arange(1, 4))


def test_gradient_of_an_adaptive_run() -> None:
    """It is that of the steps taken, and close to the one of the exact motion."""
    scene, objective = soft("robot"), ffr.IntegralCompliance()
    adaptive, fine = (
        psi_along(ffr.MechanicalProblem(scene.mechanism, integrator, objective), scene.bodies)[1]
        for integrator in (ffr.RadauIIA(0.02, tolerance=1e-7), ffr.RadauIIA(0.02, steps=500))
    )
    assert adaptive == pytest.approx(fine, rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"steps": [0.0, 0.5, 0.5, 1.0]}, "times that grow"),
        ({"steps": [0.0, 0.5]}, "steps must go from 0 to end_time"),
    ],
)
def test_refused(changes: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ffr.RadauIIA(**{"end_time": 1.0, **changes})


@pytest.mark.filterwarnings("ignore:.*excites vibrations:dolfinx_ffr.TimeStepWarning")
@pytest.mark.parametrize("steps", [41, 42])
def test_a_sudden_force_on_a_stiff_body(steps: int) -> None:
    """Accelerations at the start, of vibrations that no step resolves, are no guess of a step."""
    rod = beam(elements=10, modes=16)
    angle, push = ffr.Motion.smooth_step(10.0 * math.pi, 2.0), ffr.Force(("rod", "right"), x=-60.0)
    mechanism = slider_crank_mechanism(angle, slider=0.1, forces=[push])
    problem = ffr.MechanicalProblem(
        mechanism, ffr.RadauIIA(2.0, steps=steps), ffr.IntegralCompliance()
    )
    fine = replace(problem, integrator=ffr.RadauIIA(2.0, steps=200))
    psi = [each.value({"rod": rod}).psi for each in (problem, fine)]
    assert psi[0] == pytest.approx(psi[1], rel=1e-3)
