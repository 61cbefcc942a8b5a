# SPDX-License-Identifier: MIT
"""Designs by the method of moving asymptotes: closed forms, constraints, bodies, resuming."""

from __future__ import annotations

import os
import signal
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import Copy, four_bar, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.mechanical_problem import ConstraintValue
from dolfinx_ffr.optimization.loop import COLUMNS
from dolfinx_ffr.verification import assert_taylor_order, taylor_test


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
        value = ConstraintValue(
            mean / self.upper - 1.0, mean, gradient={"plate": share / self.upper}
        )
        return replace(super().value(x), constraints={"left half": value})


def plain(domain: ffr.Domain) -> ffr.DensityDesign:
    """A design whose variables are the densities: no neighbours, hardly any projection."""
    return ffr.DensityDesign(domain, radius=0.0, betas=(1e-4,))


def run(problem: Any, design: Any, start: Any = None, **options: Any) -> ffr.Result:
    """Run the method without noise, by default from an even density."""
    options = {"optimizer": ffr.MMA(), "progress": False, "iterations": 20, **options}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ffr.SofteningWarning)
        return ffr.optimize(
            problem, design, design.even(0.5) if start is None else start, **options
        )


def rod(comm: MPI.Intracomm, **options: Any) -> tuple[ffr.Problem, ffr.DensityDesign]:
    """The slider-crank on a coarse mesh, and a design in two stages."""
    problem = slider_crank(comm)
    domain = problem.flexible["rod"].domain
    return problem, ffr.DensityDesign(domain, **{"radius": 0.015, "betas": (1.0, 4.0), **options})


# ---------------------------------------------------------------------- closed forms


@pytest.mark.mpi
@pytest.mark.parametrize("approximation", ["quadratic", "reciprocal"])
def test_a_quadratic_function_under_a_volume_bound(comm: MPI.Intracomm, approximation: Any) -> None:
    """The densities are the wanted ones less one number, the multiplier of the bound."""
    problem = Copy(comm, hills)
    optimizer = ffr.MMA(approximation=approximation, tolerance=1e-9)
    result = run(problem, plain(problem.domain), optimizer=optimizer, iterations=200)
    assert result.reason == "converged"
    assert result.history["volume"][-1] == pytest.approx(0.5, rel=1e-6)
    domain = problem.domain
    missing = (problem.target - result.x)[domain.design_cells]
    weights = domain.cell_volumes[domain.design_cells]
    mean = domain.sum(weights * missing) / domain.sum(weights)
    assert mean > 0.1
    # psi - psi_min is the mean square of the rest
    assert domain.sum(weights * (missing - mean) ** 2) / domain.area < 1e-6


@pytest.mark.mpi
def test_several_constraints(comm: MPI.Intracomm) -> None:
    """Each half has a multiplier of its own, and both bounds are used up."""
    problem = BoundedCopy(comm, hills, upper=0.3)
    result = run(problem, plain(problem.domain), optimizer=ffr.MMA(tolerance=1e-9), iterations=200)
    assert result.history["constraint left half"][-1] == pytest.approx(0.0, abs=1e-5)
    assert result.history["volume"][-1] == pytest.approx(0.5, rel=1e-5)
    assert result.evaluation.constraints["left half"].value <= 1e-8
    assert result.history["volume"][-1] <= 0.5 * (1.0 + 1e-8)
    domain = problem.domain
    means = []
    for half in (problem.left, domain.design_cells & ~problem.left):
        weights = np.where(half, domain.cell_volumes, 0.0)
        missing = problem.target - result.x
        means.append(domain.sum(weights * missing) / domain.sum(weights))
        assert domain.sum(weights * (missing - means[-1]) ** 2) / domain.area < 1e-5
    assert means[0] > means[1] + 0.1


@pytest.mark.mpi
def test_an_infeasible_start_becomes_feasible(comm: MPI.Intracomm) -> None:
    problem = BoundedCopy(comm, hills, upper=0.2)
    result = run(problem, plain(problem.domain), iterations=30)
    kept = result.history["constraint left half"]
    assert kept[0] > 0.5 and kept[-1] <= 1e-8
    first = int(np.argmax(kept <= 1e-8))
    assert np.all(np.diff(result.history["psi"][first:]) <= 0.0)


@pytest.mark.mpi
def test_constraints_that_cannot_be_met_are_named(
    comm: MPI.Intracomm, shared_tmp_path: Path
) -> None:
    """In a warning, in the result and in the summary."""
    problem = BoundedCopy(comm, hills, upper=1e-3)
    message = r"violates 'left half' by .*% of the bound, after 4 iterations \(infeasible\)"
    with pytest.warns(ffr.DesignWarning, match=message):
        result = run(problem, ffr.DensityDesign(problem.domain), iterations=4)
    assert (result.reason, result.feasible, list(result.violations)) == (
        "infeasible",
        False,
        ["left half"],
    )
    assert result.violations["left half"] == result.evaluation.constraints["left half"].value
    summary = result.summary()
    assert summary["feasible"] is False and summary["violations"] == result.violations
    ffr.write_summary(comm, shared_tmp_path / "summary.json", summary)
    # an optimizer of one's own may end above a bound of the volume
    evaluation = replace(result.evaluation, constraints={})
    domains = {"plate": problem.domain}
    loop = ffr.DesignLoop(problem, domains, gradient=ffr.ExactAdjoint(), iterations=1)
    loop.differentiate(evaluation, lambda name: None, 0)
    loop.record(0, result.densities, evaluation, accepted=True, step=0.0, width=1.0)
    bound = 0.5 * evaluation.volume["plate"]
    with pytest.warns(ffr.DesignWarning, match=r"violates 'volume of plate' by 100\.000% of the"):
        above = loop.result(
            result.designs, result.variables, evaluation, "iterations", {"plate": bound}
        )
    assert above.reason == "infeasible" and above.violations == {"volume of plate": 1.0}


# ---------------------------------------------------------------------- the slider-crank


@pytest.mark.mpi
@pytest.mark.parametrize("beta", [2.0, 8.0])
def test_taylor_order_of_the_whole_chain(comm: MPI.Intracomm, beta: float) -> None:
    """From the variables by filter, projection, shape functions and motion to psi, and back."""
    problem, design = rod(comm, betas=(beta,))
    z = 0.55 + 0.15 * np.sin(np.arange(len(design.even(0.5))))
    direction = np.cos(0.7 * np.arange(len(z)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ffr.SofteningWarning)
        found = problem.gradient(design.density(z))
        assert found.gradient is not None
        bar = design.pullback(z, found.gradient["rod"])
        assert len(set(comm.allgather(bar.tobytes()))) == 1
        assert_taylor_order(
            taylor_test(
                lambda v: problem.value(design.density(v)).psi,
                lambda d: float(bar @ d),
                z,
                direction,
                steps=[4e-3 / 2.0**k for k in range(4)],
            )
        )


@pytest.mark.mpi
def test_psi_falls_and_the_bound_holds(comm: MPI.Intracomm) -> None:
    problem, design = rod(comm)
    result = run(problem, design, volume=0.6)
    history = result.history
    assert list(history) == COLUMNS
    assert history["iteration"].tolist() == list(range(21))
    assert (result.reason, result.iterations) == ("iterations", 20)
    assert history["psi"][-1] < 0.6 * history["psi"][0]
    assert np.all(history["volume"] <= 0.6 * (1.0 + 1e-8))
    same_stage = np.diff(history["width"]) == 0.0
    kept = history["accepted"][1:] == 1.0
    falls = np.diff(history["psi"])
    assert np.all(falls[same_stage & kept] < 0.0)
    assert np.all(falls[same_stage & ~kept] == 0.0)
    assert np.unique(history["width"]).tolist() == [0.25, 1.0]
    # the result is what the last row says, and fits together
    assert result.psi == history["psi"][-1]
    last = result.designs["rod"]
    assert last.width == history["width"][-1] and design.width == history["width"][0]
    np.testing.assert_array_equal(result.x, last.density(result.variables["rod"]))
    assert np.all(result.x[~design.domain.design_cells] == 1.0)
    assert result.evaluation.gradient is not None


@pytest.mark.mpi
def test_level_set_coefficients(comm: MPI.Intracomm) -> None:
    problem, _ = rod(comm)
    levelset = ffr.LevelSet(problem.flexible["rod"].domain)
    start = levelset.with_holes(6, 1, 0.01)
    result = run(problem, levelset, start, volume=0.6)
    assert result.history["psi"][-1] < 0.7 * result.history["psi"][0]
    assert np.all(result.history["volume"] <= 0.6 * (1.0 + 1e-8))
    levelset = levelset.with_width(result.history["width"][-1])
    np.testing.assert_array_equal(result.x, levelset.fill_fraction(result.coefficients))
    assert np.unique(result.history["width"] / levelset.element) == pytest.approx([0.35, 0.6, 1.0])


@pytest.mark.slow
@pytest.mark.mpi
def test_constraints_of_the_problem(comm: MPI.Intracomm) -> None:
    """A bound on the first frequency, which the design without it violates."""
    problem, design = rod(comm, betas=(2.0,))

    def bounded_by(least: float) -> ffr.Problem:
        bound = ffr.Constraint(ffr.Frequency("rod"), lower=least, name="frequency")
        return ffr.Problem(
            problem.bodies, problem.mechanism, problem.integrator, problem.objective, [bound]
        )

    free = run(bounded_by(1.0), design, volume=0.6, iterations=8)
    least = 1.05 * free.evaluation.constraints["frequency"].psi
    bounded = bounded_by(least)
    result = run(bounded, design, volume=0.6, iterations=14)
    assert result.evaluation.constraints["frequency"].psi >= least * (1.0 - 1e-8)
    assert result.history["constraint frequency"][-1] <= 1e-8
    assert result.history["volume"][-1] <= 0.6 * (1.0 + 1e-8)
    with pytest.raises(ValueError, match="takes a volume bound and no other constraint"):
        levelset = ffr.LevelSet(design.domain)
        ffr.optimize(bounded, levelset, levelset.with_holes(6, 1, 0.01), progress=False)


@pytest.mark.parametrize(
    ("objective", "bound"),
    [(ffr.Frequency("rod"), {"lower": 1e6}), (ffr.Mass("rod"), {"upper": 1e-6})],
    ids=["frequency", "mass"],
)
def test_bounds_of_the_rod_that_cannot_be_met(
    objective: ffr.Objective, bound: dict[str, float]
) -> None:
    """No rod of this size vibrates at 1 MHz, and its ends alone weigh more than a milligram."""
    problem, design = rod(MPI.COMM_SELF, betas=(1.0,))
    problem = ffr.Problem(
        problem.bodies,
        problem.mechanism,
        problem.integrator,
        problem.objective,
        [ffr.Constraint(objective, **bound, name="bound")],
    )
    with pytest.warns(ffr.DesignWarning, match="violates 'bound' by"):
        result = run(problem, design, iterations=2)
    assert (result.reason, list(result.violations)) == ("infeasible", ["bound"])


@pytest.mark.mpi
def test_any_number_of_ranks(comm: MPI.Intracomm) -> None:
    """A few iterations are those of one rank, to the accuracy of the solvers."""
    together = run(*rod(comm), iterations=6)
    alone = run(*rod(MPI.COMM_SELF), iterations=6)
    for name in ("psi", "volume", "frequency", "gray", "step"):
        assert together.history[name] == pytest.approx(alone.history[name], rel=1e-6), name
    assert together.variables["rod"] == pytest.approx(alone.variables["rod"], abs=1e-6)
    columns = np.array([together.history[name] for name in COLUMNS])
    mine = together.variables["rod"].tobytes() + columns.tobytes() + together.reason.encode()
    assert len(set(comm.allgather(mine))) == 1


# ---------------------------------------------------------------------- several bodies


@pytest.mark.mpi
def test_a_design_for_each_body(comm: MPI.Intracomm) -> None:
    """Each on its mesh with its share; one adjoint pass serves both."""
    problem = four_bar(comm, ffr.IntegralCompliance(["coupler", "rocker"]))
    designs = {
        name: ffr.DensityDesign(body.domain, radius=0.018, betas=(1.0, 3.0))
        for name, body in problem.flexible.items()
    }
    start = {name: design.even(0.5) for name, design in designs.items()}
    seen: list[set[str]] = []
    result = run(
        problem,
        designs,
        start,
        volume={"coupler": 0.6, "rocker": 0.7},
        iterations=12,
        callback=lambda iteration, x, evaluation: seen.append(set(x)),
    )
    history = result.history
    assert history["psi"][-1] < 0.8 * history["psi"][0]
    assert np.all(history["volume of coupler"] <= 0.6 * (1.0 + 1e-8))
    assert np.all(history["volume of rocker"] <= 0.7 * (1.0 + 1e-8))
    assert seen == [{"coupler", "rocker"}] * 12
    for name, design in result.designs.items():
        assert len(result.variables[name]) == len(start[name])
        np.testing.assert_array_equal(
            result.densities[name], design.density(result.variables[name])
        )
    with pytest.raises(ValueError, match="several bodies are designed"):
        _ = result.x


@pytest.mark.slow
@pytest.mark.mpi
def test_a_level_set_for_each_body(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """Explicit steps move both level sets; a density and a level set go together by MMA."""
    problem = four_bar(comm, ffr.IntegralCompliance(["coupler", "rocker"]))
    levelsets = {name: ffr.LevelSet(body.domain) for name, body in problem.flexible.items()}
    start = {name: ls.with_holes(4, 1, 0.0) for name, ls in levelsets.items()}
    evolution = ffr.LevelSetEvolution(widths=(1.0,))
    options = {"volume": {"coupler": 0.7, "rocker": 0.8}, "output": shared_tmp_path}
    whole = run(
        problem, levelsets, start, optimizer=evolution, iterations=4, volume=options["volume"]
    )
    run(problem, levelsets, start, optimizer=evolution, iterations=4, **options)
    assert whole.history["psi"][-1] < 0.8 * whole.history["psi"][0]
    assert np.all(whole.history["volume of coupler"] <= 0.7 + 1e-12)
    assert np.all(whole.history["volume of rocker"] <= 0.8 + 1e-12)
    again = run(
        problem, levelsets, start, optimizer=evolution, iterations=4, resume=True, **options
    )
    for name in levelsets:
        # on several ranks MUMPS adds up in an order that changes from run to run
        size = np.abs(whole.variables[name]).max()
        atol = 1e-12 if comm.size == 1 else 1e-6 * size
        np.testing.assert_allclose(again.variables[name], whole.variables[name], atol=atol)

    mixed = {
        "coupler": levelsets["coupler"],
        "rocker": ffr.DensityDesign(levelsets["rocker"].domain),
    }
    begin = {"coupler": start["coupler"], "rocker": mixed["rocker"].even(0.5)}
    result = run(problem, mixed, begin, iterations=4, volume=0.7)
    assert result.history["psi"][-1] < result.history["psi"][0]


# ---------------------------------------------------------------------- interruption


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize("at", [3, 5])
def test_interrupted_and_resumed_is_as_if_uninterrupted(
    comm: MPI.Intracomm, shared_tmp_path: Path, at: int
) -> None:
    """In the middle of a stage, and where one ends."""
    problem, design = rod(comm)
    whole = run(problem, design, iterations=10)

    def interrupt(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        if iteration == at and comm.rank == comm.size - 1:
            os.kill(os.getpid(), signal.SIGINT)

    first = run(problem, design, iterations=10, output=shared_tmp_path, callback=interrupt)
    assert (first.reason, first.iterations) == ("interrupted", at)
    rest = run(problem, design, iterations=10, output=shared_tmp_path, resume=True)
    assert (rest.reason, rest.iterations) == (whole.reason, whole.iterations)
    # what was done before is not done again; what follows agrees to the accuracy of the solvers,
    # whose iterations begin where the last ones ended
    for name in ("psi", "volume", "gray", "accepted", "step", "width"):
        assert np.array_equal(rest.history[name][: at + 1], first.history[name]), name
        # psi is small, the others are shares
        near = 0.0 if name == "psi" else 1e-6
        assert rest.history[name] == pytest.approx(whole.history[name], rel=1e-6, abs=near), name
    assert rest.variables["rod"] == pytest.approx(whole.variables["rod"], abs=1e-6)
    comm.Barrier()
    found = ffr.read_history(shared_tmp_path / "history.csv")
    assert np.array_equal(found["psi"], rest.history["psi"])
    finished = run(problem, design, iterations=10, output=shared_tmp_path, resume=True)
    assert np.array_equal(finished.variables["rod"], rest.variables["rod"])
    assert np.array_equal(finished.history["seconds"], rest.history["seconds"])


@pytest.mark.mpi
def test_a_checkpoint_of_another_problem_is_refused(
    comm: MPI.Intracomm, shared_tmp_path: Path
) -> None:
    problem, design = rod(comm)
    run(problem, design, iterations=2, output=shared_tmp_path)
    changes: list[tuple[Callable[[], Any], dict[str, Any], str]] = [
        (lambda: design, {"volume": 0.4}, "volume of rod"),
        (lambda: rod(comm, betas=(1.0, 5.0))[1], {}, "betas of rod"),
        (lambda: design, {"optimizer": ffr.MMA(boldness=2.0)}, "optimizer"),
    ]
    for make, options, what in changes:
        other = make()
        parts = (problem, other) if other is design else rod(comm, betas=(1.0, 5.0))
        with pytest.raises(ffr.CheckpointError, match=f"of another problem.*{what}"):
            run(*parts, iterations=2, output=shared_tmp_path, resume=True, **options)
    problem.integrator = ffr.GeneralizedAlpha(2.0, 190)
    with pytest.raises(ffr.CheckpointError, match="psi of its design was"):
        run(problem, design, iterations=2, output=shared_tmp_path, resume=True)


# ---------------------------------------------------------------------- failures


@pytest.mark.mpi
def test_a_trial_that_cannot_be_simulated_is_rejected(comm: MPI.Intracomm) -> None:
    problem = Copy(comm, hills)
    problem.broken = {3}
    result = run(problem, plain(problem.domain), iterations=25)
    assert result.history["accepted"][2] == 0.0
    assert result.history["psi"][-1] < result.history["psi"][1]


@pytest.mark.mpi
def test_a_start_that_cannot_be_simulated_is_reported(comm: MPI.Intracomm) -> None:
    problem = Copy(comm, hills)
    problem.broken = {1}
    with pytest.raises(ffr.SimulationError, match="too soft"):
        run(problem, plain(problem.domain))


@pytest.mark.mpi
def test_a_stage_that_falls_apart_is_not_entered(comm: MPI.Intracomm) -> None:
    problem = Copy(comm, hills)
    design = ffr.DensityDesign(problem.domain, betas=(1.0, 4.0))
    problem.broken = {12}
    result = run(problem, design, iterations=20, optimizer=ffr.MMA(tolerance=0.0))
    assert (result.reason, result.iterations) == ("stalled", 10)
    design = result.designs["plate"]
    assert design.width == 1.0
    assert result.psi == problem.value(design.density(result.variables["plate"])).psi


@pytest.mark.mpi
def test_bad_input_is_refused(comm: MPI.Intracomm) -> None:
    problem, design = rod(comm)
    with pytest.raises(ValueError, match=r"approximation must be .* but it is 'cubic'"):
        ffr.MMA(approximation="cubic")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="tolerance must not be negative"):
        ffr.MMA(tolerance=-1.0)
    with pytest.raises(ValueError, match="boldness must be positive"):
        ffr.MMA(boldness=0.0)
    with pytest.raises(ValueError, match=r"expected .* finite variables, one a designed cell"):
        run(problem, design, np.ones(3))
    with pytest.raises(ValueError, match="with NaN"):
        run(problem, design, np.full(design.size, np.nan))
    with pytest.raises(
        ValueError, match=r"volume must lie between 0 and 1, 0 excluded, but it is 1\.5"
    ):
        run(problem, design, volume=1.5)
    with pytest.raises(ValueError, match="leaves nothing to design"):
        run(problem, design, volume=0.05)
    with pytest.raises(ValueError, match="moves level sets"):
        run(problem, design, optimizer=ffr.LevelSetEvolution())
    with pytest.raises(ValueError, match=r"give \['step'\] to the optimizer, MMA"):
        run(problem, design, step=0.5)
    with pytest.warns(DeprecationWarning), pytest.raises(TypeError, match="'widths'"):
        run(problem, design, optimizer=None, widths=(1.0,))
    with pytest.raises(ValueError, match=r"start is given for \['beam'\]"):
        run(problem, design, {"beam": design.even(0.5)})
    with pytest.raises(ValueError, match=r"designs are given for \['beam'\]"):
        run(problem, {"beam": design}, design.even(0.5))
    with pytest.raises(ValueError, match="betas"):
        ffr.DensityDesign(design.domain, betas=())
    with pytest.raises(ValueError, match="not on the domain"):
        run(problem, rod(comm)[1])
