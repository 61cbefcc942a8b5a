# SPDX-License-Identifier: MIT
"""Steps that follow from a tolerance: what was asked for is kept, and what was reached is told."""

from __future__ import annotations

import math
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from numpy.typing import NDArray
from shared.motions import pendulum
from shared.rods import STEEL
from shared.scenes import SCENES, Scene, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import GeneralizedAlpha, RadauIIA, SimulationError, Trajectory, simulate
from dolfinx_ffr.mechanical_problem import MechanicalProblem
from dolfinx_ffr.mechanism import Ground, Placement, Revolute
from dolfinx_ffr.mechanism.motion import Motion
from dolfinx_ffr.objective import Constraint, IntegralCompliance, Mass, PathTracking

Array = NDArray[np.float64]


def make(name: str) -> Scene:
    return pendulum() if name == "pendulum" else SCENES[name]()


def way(trajectory: Trajectory, shift: Array) -> Array:
    """Root mean square shift of all material points, from bodies' mass matrices."""
    total = np.zeros(len(shift))
    for name, b in trajectory.model.bodies.items():
        for k, part in enumerate(shift[:, trajectory.model.coordinates(name).all]):
            q = part[3:]
            total[k] += b.mass * part[:2] @ part[:2] + b.G[0, 0] * part[2] ** 2
            total[k] += q @ b.G[1:, 1:] @ q
    return np.sqrt(total)


def true_error(scene: Scene, trajectory: Trajectory, steps: int = 1200) -> float:
    """Difference from the motion with steps of at most half the length, as `error` counts it."""
    ends = trajectory.step_ends
    ends = np.union1d(ends, 0.5 * (ends[1:] + ends[:-1]))
    while ends.size < steps:
        ends = np.union1d(ends, 0.5 * (ends[1:] + ends[:-1]))
    exact = simulate(scene.mechanism, scene.bodies, RadauIIA(scene.integrator.end_time, steps=ends))
    rows = np.searchsorted(exact.t, trajectory.step_ends)
    ours = np.searchsorted(trajectory.t, trajectory.step_ends)
    error = way(trajectory, trajectory.y[ours] - exact.y[rows])
    return float(np.max(error) / np.max(way(exact, exact.y[rows] - exact.y[0])))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        *(("slider-crank", tolerance) for tolerance in (1e-3, 1e-7)),
        *(("four-bar", 1e-7), ("robot", 1e-4), ("loader", 1e-5)),
    ],
)
def test_what_was_asked_for_is_reached(name: str, tolerance: float) -> None:
    """Beside a motion with far more steps."""
    scene = make(name)
    end_time = scene.integrator.end_time
    trajectory = simulate(scene.mechanism, scene.bodies, end_time=end_time, tolerance=tolerance)
    assert 0.0 < trajectory.error <= tolerance
    assert trajectory.t[-1] == end_time
    error = true_error(scene, trajectory)
    assert trajectory.error / 40.0 < error < 1.5 * trajectory.error


def test_finer_steps() -> None:
    assert GeneralizedAlpha(1.0, 8).finer == GeneralizedAlpha(1.0, 16)
    assert RadauIIA(1.0, steps=8).finer == RadauIIA(1.0, steps=16)
    uneven = RadauIIA(1.0, steps=[0.0, 0.2, 1.0])
    np.testing.assert_allclose(uneven.finer.times, [0.0, 0.1, 0.2, 0.6, 1.0])
    assert RadauIIA(1.0, tolerance=1e-3).finer.tolerance == pytest.approx(1e-4)
    assert RadauIIA(1.0, tolerance=1e-13).finer.tolerance == 1e-13


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "radau"), [("slider-crank", True), ("robot", True), ("four-bar", False)]
)
def test_accuracy_of_objectives(name: str, radau: bool) -> None:
    scene = make(name)
    end_time, tolerance = scene.integrator.end_time, 1e-3
    first = RadauIIA(end_time) if radau else GeneralizedAlpha(end_time, 40)
    body = next(key for key in scene.bodies if scene.bodies[key].modes)
    marker = next(iter(scene.bodies[body].markers))
    problem = MechanicalProblem(
        scene.mechanism,
        first,
        IntegralCompliance(),
        [Constraint(PathTracking(body, marker, (0.0, 0.0)), upper=1.0)],
    )
    chosen = problem.with_tolerance(scene.bodies, tolerance)
    evaluation = chosen.value(scene.bodies)
    estimate = chosen.time_error(evaluation.response)
    assert estimate <= tolerance
    far = replace(chosen, integrator=RadauIIA(end_time, steps=1000)).value(scene.bodies)
    for here, there in (
        (evaluation.psi, far.psi),
        (evaluation.constraints["PathTracking"].value, far.constraints["PathTracking"].value),
    ):
        assert abs(here / there - 1.0) < 1.5 * estimate


@pytest.mark.mpi
def test_accuracy_of_a_design(comm: MPI.Intracomm) -> None:
    """Of the number that a problem with a mesh minimises, on any number of ranks."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(16, 2))
    rod = ffr.FlexibleBody(domain, STEEL, frame=ffr.ChordFrame("left", "right"), modes=2)
    mechanism = slider_crank().mechanism
    problem = ffr.Problem({"rod": rod}, mechanism, GeneralizedAlpha(0.2, 20), IntegralCompliance())
    x = np.ones(domain.n_cells)
    chosen = problem.with_tolerance(x, 1e-3)
    assert chosen.integrator.end_time == 0.2
    assert max(chosen.time_errors(chosen.value(x)).values()) <= 1e-3
    far = problem.with_tolerance(x, 1e-5)
    assert chosen.value(x).psi == pytest.approx(far.value(x).psi, rel=1e-3)


def test_problem_without_motion_is_as_accurate_as_can_be() -> None:
    scene = pendulum()
    problem = MechanicalProblem(scene.mechanism, scene.integrator, Mass("rod"))
    assert problem.with_tolerance(scene.bodies, 1e-8) is problem
    assert problem.time_error(problem.value(scene.bodies).response) == 0.0


def test_out_of_reach() -> None:
    """That is said with what was reached."""
    scene, end_time = pendulum(), 2.0
    with pytest.raises(
        SimulationError, match=r"1\.0e-12 is out of reach: with \d+ steps .*Mechanism\.jumps"
    ) as caught:
        simulate(scene.mechanism, scene.bodies, end_time=end_time, tolerance=1e-12)
    trajectory = caught.value.trajectory
    assert 1e-12 < trajectory.error < 1e-8


@pytest.mark.parametrize("tolerance", [1e-4, 1e-9])
def test_jumps_that_nobody_named(tolerance: float) -> None:
    """Steps end there, also those twice as long with which the motion is compared."""
    scene = pendulum()
    jumpy = replace(scene.mechanism, gravity=(0.0, lambda t: np.where(t > 1.1234567, 0.0, -9.81)))
    motion = simulate(jumpy, scene.bodies, end_time=2.0, tolerance=tolerance)
    assert motion.error <= tolerance and motion.step_ends.size < 600
    named = replace(jumpy, jumps=[1.1234567])
    error = true_error(Scene(named, scene.bodies, scene.integrator), motion)
    assert error <= tolerance


def test_no_motion_at_all_is_no_matter_of_steps() -> None:
    stuck = replace(
        pendulum().mechanism,
        joints=[Revolute(("rod", "pin"), Ground()), Revolute(("rod", "pin"), Ground((1.0, 0.0)))],
    )
    with pytest.raises(ValueError):
        simulate(stuck, pendulum().bodies, end_time=1.0, tolerance=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, "either an integrator, or end_time"),
        ({"integrator": GeneralizedAlpha(1.0, 10), "end_time": 1.0}, "either an integrator"),
        ({"integrator": GeneralizedAlpha(1.0, 10), "tolerance": 1e-3}, "either an integrator"),
        ({"end_time": 1.0}, "end_time needs a tolerance"),
    ],
)
def test_refused(changes: dict, message: str) -> None:
    scene = pendulum()
    with pytest.raises(ValueError, match=message):
        simulate(scene.mechanism, scene.bodies, **changes)


def test_a_mechanism_at_rest() -> None:
    scene = pendulum()
    hanging = replace(scene.mechanism, placements={"rod": Placement((0.0, -0.5), -0.5 * math.pi)})
    trajectory = simulate(hanging, scene.bodies, end_time=1.0, tolerance=1e-6)
    assert trajectory.error < 1e-6 and trajectory.step_ends.size < 60
    assert np.max(np.abs(trajectory.y - trajectory.y[0])) < 1e-14
    assert Motion.constant(1.0).jumps == ()
