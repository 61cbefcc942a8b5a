# SPDX-License-Identifier: MIT
"""One design for several load cases: combinations, resuming, trials that cannot be simulated."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from optimization.quiet import quiet
from shared.problems import three_load_cases

import dolfinx_ffr as ffr

WEIGHTS = {"slow": 1.5, "fast": 1.0, "lever": 1.2}

# of a body with few elements; some iterations of a design do not make a part
pytestmark = pytest.mark.filterwarnings("ignore:.*cuts through a cluster of frequencies")


def run(problem: ffr.Problem, kind: Any = ffr.DensityDesign, **options: Any) -> ffr.Result:
    """Run from an even density, which becomes sharp within 40 iterations."""
    design = kind(problem.flexible["rod"].domain)
    return quiet(problem, design, **{"iterations": 8, "optimizer": ffr.MMA(length=40), **options})


@pytest.mark.slow
def test_the_worst_case_is_least_where_it_is_minimised(comm: MPI.Intracomm) -> None:
    """And keeps several load cases at the same value."""
    computed = []
    for combine in (ffr.WeightedSum(WEIGHTS), ffr.WorstCase(WEIGHTS)):
        problem = three_load_cases(comm, combine, constraints=False, modes=3, steps=300)
        result = run(problem, iterations=40)
        values = {name: m.psi for name, m in result.evaluation.load_cases.items()}
        assert result.psi == combine.value(values)
        computed.append({name: WEIGHTS[name] * psi for name, psi in values.items()})
        history = result.history
        columns = {name: history[f"psi of {name}"] for name in WEIGHTS}
        assert all(column[-1] < column[0] for column in columns.values())
        rows = range(len(history["psi"]))
        combined = [combine.value({n: c[k] for n, c in columns.items()}) for k in rows]
        # the sum of floats is rounded otherwise from one release of Python to another
        np.testing.assert_allclose(combined, history["psi"], rtol=1e-14)
    total, worst = computed
    assert max(worst.values()) < max(total.values())
    assert sum(total.values()) < sum(worst.values())
    largest = sorted(worst.values())
    assert largest[-2] > 0.99 * largest[-1]


@pytest.mark.slow
def test_constraints_of_each_load_case_hold(comm: MPI.Intracomm) -> None:
    """Also those of a load case without weight."""
    combine = ffr.WorstCase({**WEIGHTS, "lever": 0.0})
    problem = three_load_cases(comm, combine)
    free = run(three_load_cases(comm, combine, constraints=False), iterations=16)
    rod, lever = free.problem.flexible["rod"], free.evaluation.alone("lever")
    stress = ffr.worst_stress(rod, lever, "rod", relaxation=0.5)
    bound = ffr.Constraint(ffr.PeakStress("rod"), upper=0.9 * stress.largest, name="stress")
    cases = {**problem.load_cases}
    cases["lever"] = replace(cases["lever"], constraints=[bound])
    result = run(ffr.Problem.of_load_cases(problem.bodies, cases, combine), iterations=16)
    assert result.feasible, result.violations
    assert result.evaluation.constraints["lever: stress"].violation <= 1e-8
    assert result.psi > free.psi
    assert "constraint lever: stress" in result.history


@pytest.mark.slow
@pytest.mark.mpi
def test_resumed_runs(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    problem = three_load_cases(comm, ffr.WorstCase(WEIGHTS), (20, 4), modes=3, steps=200)
    uninterrupted = run(problem, iterations=4)
    options: dict[str, Any] = {"output": shared_tmp_path}
    first = run(problem, **options, iterations=2)
    options["iterations"] = 4
    rest = run(problem, **options, resume=True)
    for name in ("psi", "psi of slow", "psi of lever", "volume", "accepted", "merit"):
        assert np.array_equal(rest.history[name][:3], first.history[name]), name
        size = np.abs(uninterrupted.history[name]).max()
        assert rest.history[name] == pytest.approx(uninterrupted.history[name], abs=1e-6 * size), (
            name
        )
    other = ffr.Problem.of_load_cases(problem.bodies, problem.load_cases, ffr.WeightedSum(WEIGHTS))
    with pytest.raises(ffr.CheckpointError, match="of another problem: it differs in 'load_cases'"):
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


@pytest.mark.mpi
def test_a_trial_is_taken_back_where_one_load_case_of_it_fails(comm: MPI.Intracomm) -> None:
    """The run goes on, on every rank; a start that fails says which load case it is."""
    problem = three_load_cases(comm, ffr.WorstCase(WEIGHTS), (20, 4), modes=3, constraints=False)

    def flaky(*failing: int) -> ffr.Problem:
        method = Flaky(1.6, 400, failing=failing, calls=[])
        return problem.with_integrators({"fast": method})

    result = run(flaky(3), iterations=5)
    assert result.history["accepted"].tolist() == [1, 1, 0, 1, 1, 1]
    assert result.history["psi"][-1] < result.history["psi"][0]
    with pytest.raises(ffr.SimulationError, match="load case 'fast': too soft"):
        run(flaky(1))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:no part can be made of the design")  # it is torn
def test_explicit_steps_take_a_smooth_number(comm: MPI.Intracomm) -> None:
    evolution = ffr.LevelSetEvolution()
    problem = three_load_cases(comm, ffr.PowerMean(WEIGHTS), constraints=False)
    result = run(problem, ffr.LevelSet, optimizer=evolution, iterations=12)
    assert result.psi < result.history["psi"][0]
    worst = ffr.Problem.of_load_cases(problem.bodies, problem.load_cases, ffr.WorstCase(WEIGHTS))
    with pytest.raises(ValueError, match=r"WorstCase.*give optimizer=MMA\(\), or combine"):
        run(worst, ffr.LevelSet, optimizer=evolution)


def test_other_gradients_serve_smooth_numbers(comm: MPI.Intracomm) -> None:
    """Of the largest value they know no gradient by load case, and MMA says what does."""
    problem = three_load_cases(comm, ffr.WorstCase(WEIGHTS), (10, 2), constraints=False, modes=2)
    with pytest.raises(ValueError, match="only the gradient of all together; take ExactAdjoint"):
        run(problem, gradient=ffr.paper.ApproximateGradient())
