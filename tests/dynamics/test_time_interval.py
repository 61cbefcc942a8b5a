# SPDX-License-Identifier: MIT
"""Method and steps that a time interval and a tolerance lead to."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import crank_motion, slider_crank
from shared.scenes import slider_crank as rod_on_a_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import StepSearch, recorded, restored_method
from dolfinx_ffr.dynamics.integration.witness import TrapezoidalWitness
from dolfinx_ffr.dynamics.load_steps import LoadSteps

#: Cells of a motion of two seconds in which nothing changes fast
CELLS = LoadSteps(np.linspace(0.0, 2.0, 51), np.zeros(0), np.zeros(0), np.zeros(50, bool), True)


def model(
    radau: float, alpha: float, failing: int = 0, *, rings: float = 0.0, until: float = 1e9
) -> tuple[Any, Any]:
    """What simulates, and judges: numbers with errors by steps over a number of them.

    Args:
        radau: Steps of Radau IIA at which the error would be one.
        alpha: Those of generalised alpha.
        failing: With fewer steps there is no motion.
        rings: What vibrations add to a number that is one without them.
        until: Steps of a method with damping from which on it does not lose them.
    """

    def run(method: Any) -> Any:
        if method.adaptive:
            raise ffr.SimulationError("no adaptive steps", None)  # type: ignore[arg-type]
        witness = isinstance(method, TrapezoidalWitness)
        steps = 50 * method.steps_of_cell if witness else method.times.size - 1
        if steps < failing:
            raise ffr.SimulationError(f"no motion with {steps} steps", None)  # type: ignore[arg-type]
        needed = radau if isinstance(method, ffr.RadauIIA) else alpha
        keeps = method.amplification(1.0) == 1.0 or steps > until
        return np.array([1.0 + (needed / steps) ** method.order + (rings if keeps else 0.0)])

    return run, lambda motion: motion


def chosen(tolerance: float, *args: Any, damped: bool = True, **options: Any) -> Any:
    return StepSearch(*model(*args, **options), CELLS, damped=damped).chosen(tolerance)


def test_cheaper_method_with_enough_steps_is_chosen() -> None:
    # (20 / 200)^5 = 1e-5 and (20 / 100)^5 = 3e-4
    steps = chosen(1e-4, 20.0, 100.0)
    assert steps.integrator == ffr.RadauIIA(2.0, steps=200) and steps.met and not steps.rings
    assert steps.integrator.chosen_for == 1e-4
    # 250 steps for the error of (2 / 250)^2 cost less than those 200
    assert chosen(1e-4, 20.0, 2.0).integrator == ffr.GeneralizedAlpha(2.0, 250)
    # coarse steps need not lead to a motion
    assert chosen(1e-4, 20.0, 100.0, failing=150).integrator == ffr.RadauIIA(2.0, steps=200)


def test_vibrations_that_radau_loses() -> None:
    """Any number of its steps that lose them agree; those of a method that keeps them do not."""
    steps = chosen(1e-4, 1.0, 0.1, damped=False, rings=0.5)
    assert steps.integrator == ffr.GeneralizedAlpha(2.0, 250, 1.0)
    assert steps.rings and steps.met and steps.error < 1e-4
    # where the machine damps them, neither method is believed before both agree
    steps = chosen(1e-4, 1.0, 0.1, rings=0.5, until=900)
    assert steps.rings and steps.met
    assert steps.integrator == ffr.GeneralizedAlpha(2.0, 1000)
    # and where they never do, that is told
    steps = chosen(1e-4, 1.0, 0.1, rings=0.5)
    assert not steps.met and steps.error == pytest.approx(0.5 / 1.0, rel=0.5)
    assert "excites vibrations" in steps.doubt and "StaticEquilibrium" in steps.doubt


def test_tolerance_out_of_reach() -> None:
    steps = chosen(1e-4, 1e9, 1e9)
    assert not steps.met and steps.error > 1e-4
    assert "estimated error is" in steps.doubt
    with pytest.raises(ffr.SimulationError, match="no motion with"):
        chosen(1e-4, 20.0, 100.0, failing=10**9)
    with pytest.raises(ValueError, match="tolerance"):
        ffr.TimeInterval(2.0, tolerance=-1.0)


def test_steps_that_do_are_kept() -> None:
    """Where they are looked at again; else they are chosen anew."""
    run, judge = model(20.0, 100.0)

    @dataclass
    class Present:
        integrator: Any

    for steps, kept in ((400, True), (50, False)):
        method = ffr.RadauIIA(2.0, steps=steps)

        def judged(motion: Any, method: Any = method) -> Any:
            return judge(run(method) if isinstance(motion, Present) else motion)

        again = StepSearch(run, judged, CELLS, damped=True).chosen(1e-4, Present(method))  # type: ignore[arg-type]
        assert (again.integrator == method) is kept


def test_methods_travel_as_text() -> None:
    for method in (
        ffr.RadauIIA(2.0, steps=[0.0, 0.1, 2.0], chosen_for=1e-3),
        ffr.GeneralizedAlpha(2.0, 7, 1.0),
    ):
        again = restored_method(recorded(method))
        assert again == method and again.chosen_for == method.chosen_for


@pytest.mark.parametrize("objective", [ffr.IntegralCompliance(), ffr.JointForce("crank pin")])
def test_error_is_below_the_tolerance(objective: Any) -> None:
    """Beside a motion with far more steps, and without a warning of steps that are too long."""
    scene = rod_on_a_crank()
    problem = ffr.MechanicalProblem(scene.mechanism, ffr.TimeInterval(0.4, 1e-3), objective)
    chosen = problem.with_chosen_steps(scene.bodies)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        evaluation = problem.gradient(scene.bodies)
    assert (
        evaluation.trajectory is not None and evaluation.trajectory.integrator == chosen.integrator
    )
    exact = ffr.MechanicalProblem(scene.mechanism, ffr.RadauIIA(0.4, steps=3200), objective)
    assert evaluation.psi == pytest.approx(exact.value(scene.bodies).psi, rel=1e-3)
    assert evaluation.psi == chosen.value(scene.bodies).psi
    assert chosen.with_chosen_steps(scene.bodies) is chosen
    finer = replace(problem, integrator=ffr.TimeInterval(0.4, 1e-5)).with_chosen_steps(scene.bodies)
    assert problem.with_tolerance(scene.bodies, 1e-5).integrator == finer.integrator
    motion = ffr.simulate(scene.mechanism, scene.bodies, ffr.TimeInterval(0.4, 1e-3))
    assert motion.error <= 1e-3


def test_steps_are_graded_where_a_motion_is_fast_for_a_short_time() -> None:
    """A damper stops a body within some 10 microseconds of a second: equal steps are too many."""
    damping, body = 1e5, ffr.VolumeIntegrals.rigid(1.0, (0.0, 0.0), 0.1, {"pin": (0.0, 0.0)})
    mechanism = ffr.Mechanism(
        {"body": ffr.Placement((0.0, 0.0), velocity=(1.0, 0.0))},
        [ffr.Translational(("body", "pin"), ffr.Ground(), name="rails")],
        forces=[ffr.SpringDamper(("body", "pin"), ffr.Ground((10.0, 0.0)), 0.0, damping)],
    )
    interval, speed = ffr.TimeInterval(1.0, 1e-3), ffr.MarkerVelocity("body", "pin")
    problem = ffr.MechanicalProblem(mechanism, interval, speed)
    choice = problem.choose_steps({"body": body}, interval)
    assert choice.met and choice.integrator.times.size < 300
    # frozen: the same for other bodies, so that gradients are exact
    frozen = replace(problem, integrator=choice.integrator)
    assert np.isclose(frozen.value({"body": body}).psi, 0.5 / damping, rtol=choice.error)
    heavy = ffr.VolumeIntegrals.rigid(1.5, (0.0, 0.0), 0.1, {"pin": (0.0, 0.0)})
    motion = frozen.value({"body": heavy}).trajectory
    assert np.array_equal(motion.step_ends, choice.integrator.times)


@pytest.mark.mpi
def test_problem_chooses_once(comm: MPI.Intracomm) -> None:
    """With half of the material, alike on every rank, for all designs and problems made of it."""
    given = slider_crank(comm)
    body = given.flexible["rod"]
    interval = ffr.TimeInterval(0.4, 1e-3)
    problem = ffr.Problem({"rod": body}, crank_motion(0.4), interval, ffr.IntegralCompliance())
    chosen = problem.integrator
    assert comm.allgather(chosen) == [chosen] * comm.size
    assert not isinstance(chosen, ffr.TimeInterval)
    assert problem.with_modes({"rod": 2}).integrator is chosen
    evaluation = problem.gradient(np.full(body.domain.n_cells, 0.8))
    assert evaluation.trajectory.integrator == chosen
    # what does not depend on the motion needs no steps
    at_rest = ffr.Problem({"rod": body}, crank_motion(0.4), interval, ffr.Mass("rod"))
    assert at_rest.integrator is interval


def test_motion_between_its_instants() -> None:
    """By cubic splines: beside a motion with more steps, and exact at the instants."""
    scene = rod_on_a_crank()
    few, many = (
        ffr.simulate(scene.mechanism, scene.bodies, ffr.RadauIIA(0.4, steps=n)) for n in (100, 800)
    )
    np.testing.assert_allclose(few.at(few.t).y, few.y, rtol=1e-14)
    between = few.at(many.t)
    travel = np.max(np.abs(many.rigid("rod") - many.rigid("rod")[0]), axis=0)
    assert np.all(np.abs(between.rigid("rod") - many.rigid("rod")) <= 1e-4 * travel)
    energy = many.kinetic_energy("rod")
    np.testing.assert_allclose(between.kinetic_energy("rod"), energy, atol=1e-3 * np.max(energy))


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (0.1, r"a list of times, \[0\.1\] for one"),
        ([0.1, 0.5], "lasts from 0 to 0.4 s and is not defined at 0.5 s"),
        ([-0.1, 0.2], "not defined at -0.1 s"),
        ([0.2, 0.1], "times must increase"),
        ([], "at least one"),
    ],
)
def test_times_without_a_motion_are_refused(times: Any, message: str) -> None:
    scene = rod_on_a_crank()
    motion = ffr.simulate(scene.mechanism, scene.bodies, ffr.RadauIIA(0.4, steps=50))
    with pytest.raises(ValueError, match=message):
        motion.at(times)
