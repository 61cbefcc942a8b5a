# SPDX-License-Identifier: MIT
"""Method and steps that a time interval and a tolerance lead to."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import crank_motion, slider_crank
from shared.scenes import slider_crank as rod_on_a_crank

from dolfinx_ffr import (
    GeneralizedAlpha,
    IntegralCompliance,
    JointForce,
    Mass,
    MechanicalProblem,
    Problem,
    RadauIIA,
    SimulationError,
    TimeInterval,
    simulate,
)


@dataclass
class Motion:
    """Stands for a motion whose objective has an error of the method's order."""

    psi: float
    step_ends: np.ndarray


def model(radau: float, alpha: float, failing: int = 0) -> tuple[Any, Any]:
    """What simulates, and compares: relative errors by steps over a number of them.

    Args:
        radau: Steps of Radau IIA at which the error would be one.
        alpha: Those of generalised alpha.
        failing: With fewer steps there is no motion.
    """

    def run(method: Any) -> Any:
        steps = method.times.size - 1
        if steps < failing:
            raise SimulationError(f"no motion with {steps} steps", None)  # type: ignore[arg-type]
        needed = radau if isinstance(method, RadauIIA) else alpha
        return Motion(1.0 + (needed / steps) ** method.order, method.times)

    return run, lambda fine, coarse: abs(fine.psi - coarse.psi)


def test_cheaper_method_with_enough_steps_is_chosen() -> None:
    interval = TimeInterval(2.0, tolerance=1e-4)
    # (20 / 200)^5 = 1e-5 and (20 / 100)^5 = 3e-4
    radau = interval.chosen(*model(radau=20.0, alpha=100.0))
    assert radau == RadauIIA(2.0, steps=200, judged=True)
    # 250 steps for the error of (2 / 250)^2 cost less than those 200
    assert interval.chosen(*model(20.0, 2.0)) == GeneralizedAlpha(2.0, 250, judged=True)
    # coarse steps need not lead to a motion
    assert interval.chosen(*model(20.0, 100.0, failing=150)) == radau
    # Radau IIA has no fifth order in what is rough: then the other method goes on alone
    rough = interval.chosen(*model(1e9, 20.0, failing=0))
    assert rough == GeneralizedAlpha(2.0, 2000, judged=True)


def test_tolerance_out_of_reach() -> None:
    interval = TimeInterval(2.0, tolerance=1e-4)
    with pytest.raises(SimulationError, match=r"tolerance of 1\.0e-04 is out of reach"):
        interval.chosen(*model(1e9, 1e9))
    with pytest.raises(SimulationError, match="no motion with 64000 steps"):
        interval.chosen(*model(20.0, 100.0, failing=10**9))
    with pytest.raises(ValueError, match="tolerance"):
        TimeInterval(2.0, tolerance=-1.0)


@pytest.mark.parametrize("objective", [IntegralCompliance(), JointForce("crank pin")])
def test_error_is_below_the_tolerance(objective: Any) -> None:
    """Beside a motion with far more steps, and without a warning of steps that are too long."""
    scene = rod_on_a_crank()
    problem = MechanicalProblem(scene.mechanism, TimeInterval(0.4, 1e-3), objective)
    settled = problem.settled(scene.bodies)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = problem.gradient(scene.bodies)
    assert found.trajectory is not None and found.trajectory.integrator == settled.integrator
    exact = MechanicalProblem(scene.mechanism, RadauIIA(0.4, steps=3200), objective)
    assert found.psi == pytest.approx(exact.value(scene.bodies).psi, rel=1e-3)
    assert found.psi == settled.value(scene.bodies).psi
    assert settled.settled(scene.bodies) is settled
    finer = problem.with_tolerance(scene.bodies, 1e-5).integrator
    assert (
        finer
        == MechanicalProblem(scene.mechanism, TimeInterval(0.4, 1e-5), objective)
        .settled(scene.bodies)
        .integrator
    )
    motion = simulate(scene.mechanism, scene.bodies, TimeInterval(0.4, 1e-3))
    assert motion.error <= 1e-3


@pytest.mark.mpi
def test_problem_chooses_once(comm: MPI.Intracomm) -> None:
    """With half of the material, alike on every rank, for all designs and problems made of it."""
    given = slider_crank(comm)
    body = given.flexible["rod"]
    interval = TimeInterval(0.4, 1e-3)
    problem = Problem({"rod": body}, crank_motion(0.4), interval, IntegralCompliance())
    chosen = problem.integrator
    assert comm.allgather(chosen) == [chosen] * comm.size
    assert not isinstance(chosen, TimeInterval)
    assert problem.with_modes({"rod": 2}).integrator is chosen
    evaluation = problem.gradient(np.full(body.domain.n_cells, 0.8))
    assert evaluation.motion.integrator == chosen
    # what does not depend on the motion needs no steps
    assert Problem({"rod": body}, crank_motion(0.4), interval, Mass("rod")).integrator is interval


def test_motion_between_its_instants() -> None:
    """By cubic splines: beside a motion with more steps, and exact at the instants."""
    scene = rod_on_a_crank()
    few, many = (
        simulate(scene.mechanism, scene.bodies, RadauIIA(0.4, steps=n)) for n in (100, 800)
    )
    np.testing.assert_allclose(few.at(few.t).y, few.y, rtol=1e-14)
    between = few.at(many.t)
    way = np.max(np.abs(many.rigid("rod") - many.rigid("rod")[0]), axis=0)
    assert np.all(np.abs(between.rigid("rod") - many.rigid("rod")) <= 1e-4 * way)
    energy = many.kinetic_energy("rod")
    np.testing.assert_allclose(between.kinetic_energy("rod"), energy, atol=1e-3 * np.max(energy))
