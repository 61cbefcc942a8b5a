# SPDX-License-Identifier: MIT
"""Designs by the method of moving asymptotes: closed forms, constraints, bodies, resuming."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from optimization.quiet import check_alike, quiet
from shared.problems import Copy, four_bar, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.mechanical_problem import ConstraintValue
from dolfinx_ffr.optimization.loop import COLUMNS


def hills(c: np.ndarray) -> np.ndarray:
    """Densities in [0.3, 0.9] as a function of position."""
    return np.asarray(0.6 + 0.3 * np.sin(40.0 * c[:, 0]) * np.cos(30.0 * c[:, 1]))


class BoundedCopy(Copy):
    """A copy whose mean over the left half is bounded too."""

    def __init__(self, comm: MPI.Intracomm, target: Any, upper: float) -> None:
        super().__init__(comm, target)
        self.upper = upper
        self.constraints = ["left half"]
        self.left = (self.domain.centroids[:, 0] < 0.2) & self.domain.design_cells

    def value(self, x: np.ndarray) -> Any:
        share = np.where(self.left, self.domain.cell_volumes, 0.0)
        share /= self.domain.sum(share)
        mean = self.domain.sum(share * x)
        gradient = {"plate": share / self.upper}
        value = ConstraintValue(mean, mean / self.upper - 1.0, gradient=gradient)
        return replace(super().value(x), constraints={"left half": value})


class Plain(ffr.DensityDesign):
    """A design whose variables are the densities: no neighbours, and never any projection."""

    def __init__(self, domain: ffr.Domain) -> None:
        super().__init__(domain, radius=0.0)
        self.projection = ffr.design.HeavisideProjection(1e-4)

    def at(self, progress: float) -> Plain:
        return self


def run(problem: Any, design: Any, start: Any = None, **options: Any) -> ffr.Result:
    """Run the method, by default from an even density."""
    return quiet(problem, design, start, **{"iterations": 12, **options})


def rod(
    comm: MPI.Intracomm, kind: Callable[..., Any] = ffr.LevelSet, **constraint: Any
) -> tuple[ffr.Problem, Any]:
    """The slider-crank on a coarse mesh with a design, and a constraint if one is given."""
    problem = slider_crank(comm)
    if constraint:
        parts = (problem.bodies, problem.mechanism, problem.integrator, problem.objective)
        problem = ffr.Problem(*parts, [ffr.Constraint(**constraint, name="bound")])
    return problem, kind(problem.flexible["rod"].domain)


@pytest.mark.slow
@pytest.mark.parametrize("upper", [None, 0.3])
def test_a_quadratic_function_under_bounds(comm: MPI.Intracomm, upper: float | None) -> None:
    """The densities are the wanted ones less one number, the multiplier of the bound.

    With a bound of each half, from an infeasible start: one number in each, and both are used up.
    """
    problem = BoundedCopy(comm, hills, upper) if upper else Copy(comm, hills)
    result = run(problem, Plain(problem.domain), iterations=60, optimizer=ffr.MMA(tolerance=1e-8))
    assert result.feasible and result.reason in ("converged", "iterations")
    assert result.evaluation.volume["plate"] == pytest.approx(0.5, rel=1e-5)
    assert result.evaluation.volume["plate"] <= 0.5 * (1.0 + 1e-8)
    domain, missing, means = problem.domain, problem.target - result.x, []
    left = domain.centroids[:, 0] < 0.2
    for part in (left, ~left) if upper else (left | ~left,):
        weights = np.where(part & domain.design_cells, domain.cell_volumes, 0.0)
        means.append(domain.sum(weights * missing) / domain.sum(weights))
        # psi - psi_min is the mean square of the rest
        rest = domain.sum(weights * (missing - means[-1]) ** 2) / domain.area
        assert rest < (1e-5 if upper else 1e-6)
    assert means[0] > 0.1 + sum(means[1:])
    if upper:
        assert result.history["constraint left half"][0] > 0.4
        assert result.evaluation.constraints["left half"].violation == pytest.approx(0.0, abs=1e-5)


@pytest.mark.slow
def test_bounds_are_those_of_the_level_set_that_is_made(comm: MPI.Intracomm) -> None:
    """Near the end a level set is analysed a little within its boundary; its bounds are not."""
    problem = BoundedCopy(comm, lambda c: hills(c) + 0.25, upper=0.3)
    design = ffr.LevelSet(problem.domain)
    result = run(problem, design, iterations=30)
    assert result.feasible
    assert result.evaluation.volume["plate"] == pytest.approx(0.5, rel=2e-3)
    assert -0.03 < result.evaluation.constraints["left half"].violation <= 1e-8
    np.testing.assert_array_equal(result.x, result.designs["plate"].density(result.coefficients))
    seen = design.at(1.0).density(result.coefficients)
    assert np.all(seen <= result.x)
    domain = problem.domain
    assert domain.sum((result.x - seen) * domain.cell_volumes) > 0.01 * domain.area


@pytest.mark.mpi
def test_constraints_out_of_reach_are_named(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """In a warning, in the result and in the summary."""
    problem = BoundedCopy(comm, hills, upper=1e-3)
    message = r"violates 'left half' by .*% of the bound, after 4 iterations \(infeasible\)"
    with pytest.warns(ffr.DesignWarning, match=message):
        result = run(problem, Plain(problem.domain), iterations=4)
    violation = result.evaluation.constraints["left half"].violation
    assert (result.reason, result.feasible) == ("infeasible", False)
    assert result.violations == {"left half": violation}
    summary = result.summary()
    assert summary["feasible"] is False and summary["violations"] == result.violations
    ffr.write_summary(comm, shared_tmp_path / "summary.json", summary)
    # an optimizer of one's own may end above a bound of the volume
    evaluation = replace(result.evaluation, constraints={})
    domains = {"plate": problem.domain}
    loop = ffr.optimization.DesignLoop(problem, domains, gradient=ffr.ExactAdjoint(), iterations=1)
    loop.differentiate(evaluation, lambda name: None, 0)
    start = ffr.optimization.Iterate(0, result.densities, evaluation, True, 0.0, 1.0, 0.0)
    loop.record(start)
    bound = 0.5 * evaluation.volume["plate"]
    with pytest.warns(ffr.DesignWarning, match=r"violates 'volume of plate' by 100\.000% of the"):
        computed = (result.designs, result.variables, evaluation)
        above = loop.result(*computed, "iterations", {"plate": bound})
    assert above.reason == "infeasible" and above.violations == {"volume of plate": 1.0}


@pytest.mark.slow
@pytest.mark.parametrize("kind", [ffr.DensityDesign, ffr.LevelSet])
def test_psi_falls_and_the_bound_holds(comm: MPI.Intracomm, kind: Any) -> None:
    problem, design = rod(comm, kind)
    result = run(problem, design, volume=0.6, iterations=16)
    history = result.history
    assert list(history) == COLUMNS
    assert history["iteration"].tolist() == list(range(17))
    assert (result.reason, result.iterations) == ("iterations", 16)
    assert history["psi"][-1] < 0.6 * history["psi"][0]
    assert np.all(history["volume"] <= 0.61)
    assert result.evaluation.volume["rod"] <= 0.6 * (1.0 + 1e-8)
    assert history["sharpness"][[0, -1]].tolist() == pytest.approx([1.0, 32.0])
    assert np.all(np.diff(history["sharpness"]) >= 0.0)
    assert np.all(history["step"] <= 0.1 + 1e-12)
    # the result is the best sharp one, and fits together
    last = result.designs["rod"]
    assert last.sharpness == 32.0
    np.testing.assert_array_equal(result.x, last.density(result.variables["rod"]))
    assert np.all(result.x[~design.domain.design_cells] == 1.0)
    value = problem.value(result.x).psi
    # what the run saw of it; a level set is analysed a little within its boundary
    seen = problem.value(design.at(1.0).density(result.variables["rod"])).psi
    assert np.nanmin(np.abs(history["psi"] / seen - 1.0)) < 1e-9
    assert (seen == value) == (kind is ffr.DensityDesign)
    assert result.problem.value(result.x).psi == pytest.approx(result.psi, rel=1e-9)
    if kind is ffr.LevelSet:  # told by the law of cut elements, which is stiffer
        assert result.problem is not problem and 0.7 * value < result.psi < value
        assert result.problem.flexible["rod"].interpolation == ffr.SIMP(exponent=1.35)
    else:
        assert result.problem is problem


@pytest.mark.slow
def test_constraints_of_the_problem(comm: MPI.Intracomm) -> None:
    """A bound on the first frequency, which the design without it violates."""
    frequency = {"objective": ffr.Frequency("rod")}
    free = run(*rod(comm, ffr.DensityDesign, **frequency, lower=1.0), volume=0.6)
    least = 1.03 * free.evaluation.constraints["bound"].value
    problem, design = rod(comm, ffr.DensityDesign, **frequency, lower=least)
    result = run(problem, design, volume=0.6)
    assert result.feasible
    assert result.evaluation.constraints["bound"].value >= least * (1.0 - 1e-8)
    assert result.evaluation.volume["rod"] <= 0.6 * (1.0 + 1e-8)
    assert result.psi > free.psi
    with pytest.raises(ValueError, match="takes a volume bound and no other constraint"):
        run(problem, ffr.LevelSet(design.domain), optimizer=ffr.LevelSetEvolution())


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*violates 'stress'.*after (6|12):dolfinx_ffr.DesignWarning")
def test_stress_limit(tmp_path: Path) -> None:
    """The least material for a stress: the limit is active, and holds for the largest stress."""
    problem, design = rod(MPI.COMM_SELF, ffr.DensityDesign)
    peak = ffr.PeakStress("rod")
    full = problem.value(np.ones(problem.flexible["rod"].domain.n_cells))
    limit = 2.0 * peak.largest(problem.response(full))
    parts = (problem.bodies, problem.mechanism, problem.integrator)
    bounds = [ffr.Constraint(peak, upper=limit, name="stress")]
    problem = ffr.Problem(*parts, ffr.Volume("rod"), bounds)
    options = {"volume": 1.0, "output": tmp_path, "optimizer": ffr.MMA(length=30)}
    start = design.even(0.9)
    run(problem, design, start, iterations=6, **options)
    result = run(problem, design, start, iterations=30, resume=True, **options)
    assert result.feasible
    assert -0.05 < result.evaluation.constraints["stress"].violation
    body = result.problem.flexible["rod"]
    worst = ffr.worst_stress(body, result.evaluation, "rod", relaxation=0.5, void=0.0)
    assert result.evaluation.constraints["stress"].value == pytest.approx(worst.largest, rel=1e-9)
    # the scale is that of the design at hand: the way is the same however often it is resumed
    uninterrupted = run(problem, design, start, iterations=12, **{**options, "output": None})
    np.testing.assert_allclose(uninterrupted.history["psi"], result.history["psi"][:13], rtol=1e-5)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:no part can be made of the design")
def test_a_step_held_for_a_constraint_may_raise_the_merit() -> None:
    """Sharpening broke the stress limit: the way back costs material, until nothing sharpens."""
    problem, design = rod(MPI.COMM_SELF)
    peak = ffr.PeakStress("rod")
    full = problem.value(np.ones(problem.flexible["rod"].domain.n_cells))
    limit = 1.5 * peak.largest(problem.response(full))
    parts = (problem.bodies, problem.mechanism, problem.integrator, ffr.Volume("rod"))
    problem = ffr.Problem(*parts, [ffr.Constraint(peak, upper=limit, name="stress")])
    result = run(problem, design, iterations=16, volume=1.0)
    assert result.evaluation.constraints["stress"].violation <= 1e-8
    assert result.psi < 0.85  # 0.89 where only a lower merit is accepted


@pytest.mark.mpi
def test_any_number_of_ranks(comm: MPI.Intracomm) -> None:
    """A few iterations are those of one rank, to the accuracy of the solvers."""
    together = run(*rod(comm), iterations=6)
    alone = run(*rod(MPI.COMM_SELF), iterations=6)
    for name in ("psi", "volume", "frequency", "gray", "step", "merit"):
        near = 1e-6 * np.abs(alone.history[name]).max()
        assert together.history[name] == pytest.approx(alone.history[name], abs=near), name
    assert together.variables["rod"] == pytest.approx(alone.variables["rod"], abs=1e-6)
    check_alike(comm, together)


@pytest.mark.slow
def test_a_design_for_each_body(comm: MPI.Intracomm) -> None:
    """A level set and a density, each on its mesh with its share; one adjoint pass for both."""
    problem = four_bar(comm, ffr.IntegralCompliance(["coupler", "rocker"]))
    coupler = ffr.LevelSet(problem.flexible["coupler"].domain)
    rocker = ffr.DensityDesign(problem.flexible["rocker"].domain)
    designs = {"coupler": coupler, "rocker": rocker}
    start = {"coupler": coupler.with_holes(4, 1, 0.005), "rocker": rocker.even()}
    seen: list[set[str]] = []
    options = {"volume": {"coupler": 0.6, "rocker": 0.7}, "iterations": 20}
    result = run(problem, designs, start, **options, callback=lambda k, x, _: seen.append(set(x)))
    assert result.psi < 0.8 * result.history["psi"][0]
    assert seen == [{"coupler", "rocker"}] * 20
    for name, design in result.designs.items():
        assert result.evaluation.volume[name] <= options["volume"][name] * (1.0 + 1e-8)
        variables = result.variables[name]
        assert len(variables) == len(start[name])
        np.testing.assert_array_equal(result.densities[name], design.density(variables))
    laws = {name: body.interpolation for name, body in result.problem.flexible.items()}
    assert laws == {"coupler": ffr.SIMP(exponent=1.35), "rocker": ffr.SIMP()}
    with pytest.raises(ValueError, match="several bodies are designed"):
        _ = result.x


@pytest.mark.mpi
def test_checkpoints_of_other_methods(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    problem = Copy(comm, hills)
    design, wider = (ffr.DensityDesign(problem.domain, radius=r) for r in (0.02, 0.03))
    folder = {"iterations": 1, "output": shared_tmp_path}
    run(problem, design, **folder)
    others = {"radius": (wider, ffr.MMA()), "optimizer": (design, ffr.MMA(move=0.2))}
    for name, (other, optimizer) in others.items():
        with pytest.raises(ffr.CheckpointError, match=f"of another problem.*{name}"):
            run(problem, other, **folder, resume=True, optimizer=optimizer)


@pytest.mark.mpi
def test_trials_that_cannot_be_simulated_are_taken_back(comm: MPI.Intracomm) -> None:
    """The next step is half as long, and later ones grow again.

    A run that cannot go on has stalled, and one that cannot begin is an error.
    """
    problem = Copy(comm, hills)
    design = Plain(problem.domain)
    problem.broken = {3}
    history = run(problem, design, optimizer=ffr.MMA(tolerance=0.0)).history
    assert history["accepted"].tolist() == [1, 1, 0, *[1] * 10]
    assert history["psi"][2] == history["psi"][1]
    assert history["step"][3] == pytest.approx(0.5 * history["step"][2])
    assert history["psi"][-1] < history["psi"][1]
    problem.calls, problem.broken = 0, set(range(3, 99))
    result = run(problem, design, iterations=20)
    assert (result.reason, result.iterations) == ("stalled", 9)
    assert result.psi == result.history["psi"][1] == result.history["psi"][-1]
    problem.calls, problem.broken = 0, {1}
    with pytest.raises(ffr.SimulationError, match="too soft"):
        run(problem, design)
