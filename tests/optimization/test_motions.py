# SPDX-License-Identifier: MIT
"""One design for several motions: combinations, resuming, trials that cannot be simulated."""

from __future__ import annotations

import os
import signal
import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import three_motions

import dolfinx_ffr as ffr

WEIGHTS = {"slow": 1.5, "fast": 1.0, "lever": 1.2}

# some iterations of a design do not make a part
gray = pytest.mark.filterwarnings(
    "ignore:.*is gray, neither void nor solid",
    "ignore:.*cuts through a cluster of frequencies",
)


def run(problem: ffr.Problem, kind: Any = ffr.DensityDesign, **options: Any) -> ffr.Result:
    """Run without noise, from an even density, which becomes crisp within 40 iterations."""
    options = {"progress": False, "iterations": 8, "mode_tolerance": None, **options}
    options.setdefault("optimizer", ffr.MMA(length=40))
    design = options.pop("design", None) or kind(problem.flexible["rod"].domain)
    with warnings.catch_warnings():
        for expected in (ffr.SofteningWarning, ffr.LargeDeformationWarning):
            warnings.simplefilter("ignore", expected)
        return ffr.optimize(problem, design, **options)


def weighted(result: ffr.Result) -> dict[str, float]:
    return {name: WEIGHTS[name] * m.psi for name, m in result.evaluation.motions.items()}


@gray
@pytest.mark.slow
@pytest.mark.mpi
def test_the_worst_case_is_least_where_it_is_minimised(comm: MPI.Intracomm) -> None:
    """And keeps several motions at the same value."""
    found = []
    for combine in (ffr.WeightedSum(WEIGHTS), ffr.WorstCase(WEIGHTS)):
        problem = three_motions(comm, combine, constraints=False, modes=3, steps=300)
        result = run(problem, iterations=40)
        assert result.psi == combine.value({n: m.psi for n, m in result.evaluation.motions.items()})
        found.append(weighted(result))
        history = result.history
        values = np.column_stack([history[f"psi of {name}"] for name in WEIGHTS])
        assert np.all(values[-1] < values[0])
        combined = [combine.value(dict(zip(WEIGHTS, row, strict=True))) for row in values]
        # the sum of floats is rounded otherwise from one release of Python to another
        np.testing.assert_allclose(combined, history["psi"], rtol=1e-14)
    total, worst = found
    assert max(worst.values()) < max(total.values())
    assert sum(total.values()) < sum(worst.values())
    largest = sorted(worst.values())
    assert largest[-2] > 0.99 * largest[-1]


@gray
@pytest.mark.mpi
def test_constraints_of_each_motion_hold(comm: MPI.Intracomm) -> None:
    """Also those of a motion without weight."""
    combine = ffr.WorstCase({**WEIGHTS, "lever": 0.0})
    problem = three_motions(comm, combine)
    free = run(three_motions(comm, combine, constraints=False), iterations=16)
    stress = ffr.worst_stress(
        free.problem.flexible["rod"], free.evaluation.alone("lever"), "rod", relaxation=0.5
    )
    bound = ffr.Constraint(ffr.PeakStress("rod"), upper=0.9 * stress.largest, name="stress")
    lever = replace(problem.motions["lever"], constraints=[bound])
    bounded = ffr.Problem.of_motions(
        problem.bodies, {**problem.motions, "lever": lever}, problem.combine
    )
    result = run(bounded, iterations=16)
    assert result.feasible, result.violations
    assert result.evaluation.constraints["lever: stress"].value <= 1e-8
    assert result.psi > free.psi
    assert "constraint lever: stress" in result.history


@gray
@pytest.mark.mpi
@pytest.mark.parametrize("combine", [ffr.WorstCase(WEIGHTS), ffr.PowerMean(WEIGHTS)], ids=repr)
def test_interrupted_and_resumed_with_several_motions(
    comm: MPI.Intracomm, shared_tmp_path: Path, combine: ffr.Combination
) -> None:
    problem = three_motions(comm, combine, (20, 4), modes=3)
    whole = run(problem, iterations=6)

    def interrupt(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        if iteration == 3 and comm.rank == comm.size - 1:
            os.kill(os.getpid(), signal.SIGINT)

    options: dict[str, Any] = {"iterations": 6, "output": shared_tmp_path}
    first = run(problem, **options, callback=interrupt)
    assert (first.reason, first.iterations) == ("interrupted", 3)
    rest = run(problem, **options, resume=True)
    for name in ("psi", "psi of slow", "psi of lever", "volume", "accepted", "merit"):
        assert np.array_equal(rest.history[name][:4], first.history[name]), name
        size = np.abs(whole.history[name]).max()
        assert rest.history[name] == pytest.approx(whole.history[name], abs=1e-6 * size), name
    other = ffr.Problem.of_motions(problem.bodies, problem.motions, ffr.WeightedSum(WEIGHTS))
    with pytest.raises(ffr.CheckpointError, match="of another problem: it differs in 'motions'"):
        run(other, **options, resume=True)
    with pytest.raises(ffr.CheckpointError, match="of another problem"):
        run(problem.alone("slow"), **options, resume=True)


@dataclass(frozen=True)
class Flaky(ffr.GeneralizedAlpha):
    """Fails at the given calls, counted from 1."""

    failing: tuple[int, ...] = ()
    calls: Any = field(default=None, compare=False)

    def integrate(self, model: Any, y0: Any, v0: Any) -> Any:
        self.calls.append(1)
        found = super().integrate(model, y0, v0)
        if len(self.calls) in self.failing:
            raise ffr.SimulationError("too soft", trajectory=found)
        return found


@gray
@pytest.mark.mpi
def test_a_trial_is_taken_back_where_one_motion_of_it_fails(comm: MPI.Intracomm) -> None:
    """The run goes on, on every rank; a start that fails says which motion it is."""
    problem = three_motions(comm, ffr.WorstCase(WEIGHTS), (20, 4), modes=3, constraints=False)

    def flaky(*failing: int) -> ffr.Problem:
        integrator = Flaky(1.6, 400, failing=failing, calls=[])
        fast = replace(problem.motions["fast"], integrator=integrator)
        motions = {**problem.motions, "fast": fast}
        return ffr.Problem.of_motions(problem.bodies, motions, problem.combine)

    result = run(flaky(3), iterations=5)
    assert result.history["accepted"].tolist() == [1, 1, 0, 1, 1, 1]
    assert result.history["psi"][-1] < result.history["psi"][0]
    with pytest.raises(ffr.SimulationError, match="motion 'fast': too soft"):
        run(flaky(1))


@gray
@pytest.mark.mpi
def test_modes_are_added_for_several_motions(comm: MPI.Intracomm) -> None:
    problem = three_motions(comm, ffr.WorstCase(WEIGHTS), constraints=False, modes=1)
    result = run(problem, iterations=5, mode_tolerance=1e-3)
    assert result.problem.flexible["rod"].modes > 1
    assert result.mode_errors["rod"] <= 1e-3
    assert list(result.evaluation.motions) == list(WEIGHTS)


@gray
def test_explicit_steps_take_a_smooth_number(comm: MPI.Intracomm) -> None:
    evolution = ffr.LevelSetEvolution()
    problem = three_motions(comm, ffr.PowerMean(WEIGHTS), constraints=False)
    result = run(problem, ffr.LevelSet, optimizer=evolution, iterations=12)
    assert result.psi < result.history["psi"][0]
    worst = ffr.Problem.of_motions(problem.bodies, problem.motions, ffr.WorstCase(WEIGHTS))
    with pytest.raises(ValueError, match=r"WorstCase.*give optimizer=MMA\(\), or combine"):
        run(worst, ffr.LevelSet, optimizer=evolution)


def test_other_gradients_serve_smooth_numbers(comm: MPI.Intracomm) -> None:
    """Of the largest value they know no gradient by motion, and MMA says what does."""
    problem = three_motions(comm, ffr.WorstCase(WEIGHTS), (10, 2), constraints=False, modes=2)
    with pytest.raises(ValueError, match="only that of all together; take ExactAdjoint"):
        run(problem, gradient=ffr.ElementByElement())
