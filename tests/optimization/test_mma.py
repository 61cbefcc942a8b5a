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
from dolfinx_ffr.design import image_cells
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


class Plain(ffr.DensityDesign):
    """A design whose variables are the densities: no neighbours, and never any projection."""

    def __init__(self, domain: ffr.Domain) -> None:
        super().__init__(domain, radius=0.0)
        self.projection = ffr.HeavisideProjection(1e-4)

    def at(self, progress: float) -> Plain:
        return self


def run(problem: Any, design: Any, start: Any = None, **options: Any) -> ffr.Result:
    """Run the method without noise, by default from an even density."""
    options = {"progress": False, "iterations": 12, "mode_tolerance": None, **options}
    with warnings.catch_warnings():
        for expected in (ffr.SofteningWarning, ffr.LargeDeformationWarning):
            warnings.simplefilter("ignore", expected)
        return ffr.optimize(problem, design, start, **options)


def rod(
    comm: MPI.Intracomm, kind: Callable[..., Any] = ffr.LevelSet, **constraint: Any
) -> tuple[ffr.Problem, Any]:
    """The slider-crank on a coarse mesh with a design, and a constraint if one is given."""
    problem = slider_crank(comm)
    if constraint:
        problem = ffr.Problem(
            problem.bodies,
            problem.mechanism,
            problem.integrator,
            problem.objective,
            [ffr.Constraint(**constraint, name="bound")],
        )
    return problem, kind(problem.flexible["rod"].domain)


#: On so coarse a mesh a short run ends gray, and says so
gray = pytest.mark.filterwarnings("ignore:.*is gray:dolfinx_ffr.DesignWarning")


# ---------------------------------------------------------------------- closed forms


@gray
@pytest.mark.mpi
def test_a_quadratic_function_under_a_volume_bound(comm: MPI.Intracomm) -> None:
    """The densities are the wanted ones less one number, the multiplier of the bound."""
    problem = Copy(comm, hills)
    result = run(problem, Plain(problem.domain), iterations=60)
    assert result.feasible and result.reason in ("converged", "iterations")
    assert result.evaluation.volume["plate"] == pytest.approx(0.5, rel=1e-5)
    assert result.evaluation.volume["plate"] <= 0.5 * (1.0 + 1e-8)
    domain = problem.domain
    missing = (problem.target - result.x)[domain.design_cells]
    weights = domain.cell_volumes[domain.design_cells]
    mean = domain.sum(weights * missing) / domain.sum(weights)
    assert mean > 0.1
    # psi - psi_min is the mean square of the rest
    assert domain.sum(weights * (missing - mean) ** 2) / domain.area < 1e-6


@gray
@pytest.mark.mpi
def test_several_constraints(comm: MPI.Intracomm) -> None:
    """From an infeasible start: each half has a multiplier, and both bounds are used up."""
    problem = BoundedCopy(comm, hills, upper=0.3)
    result = run(problem, Plain(problem.domain), iterations=60)
    assert result.history["constraint left half"][0] > 0.4 and result.feasible
    assert result.evaluation.constraints["left half"].value == pytest.approx(0.0, abs=1e-5)
    assert result.evaluation.volume["plate"] == pytest.approx(0.5, rel=1e-5)
    domain = problem.domain
    means = []
    for half in (problem.left, domain.design_cells & ~problem.left):
        weights = np.where(half, domain.cell_volumes, 0.0)
        missing = problem.target - result.x
        means.append(domain.sum(weights * missing) / domain.sum(weights))
        assert domain.sum(weights * (missing - means[-1]) ** 2) / domain.area < 1e-5
    assert means[0] > means[1] + 0.1


@gray
@pytest.mark.mpi
def test_bounds_are_those_of_the_level_set_that_is_made(comm: MPI.Intracomm) -> None:
    """Near the end a level set is analysed a little within its boundary; its bounds are not."""
    problem = BoundedCopy(comm, lambda c: hills(c) + 0.25, upper=0.3)
    design = ffr.LevelSet(problem.domain)
    result = run(problem, design, iterations=30)
    assert result.feasible
    assert result.evaluation.volume["plate"] == pytest.approx(0.5, rel=2e-3)
    assert -0.03 < result.evaluation.constraints["left half"].value <= 1e-8
    np.testing.assert_array_equal(result.x, result.designs["plate"].density(result.coefficients))
    seen = design.at(1.0).density(result.coefficients)
    assert np.all(seen <= result.x)
    domain = problem.domain
    assert domain.sum((result.x - seen) * domain.cell_volumes) > 0.01 * domain.area


@gray
@pytest.mark.mpi
def test_constraints_that_cannot_be_met_are_named(
    comm: MPI.Intracomm, shared_tmp_path: Path
) -> None:
    """In a warning, in the result and in the summary."""
    problem = BoundedCopy(comm, hills, upper=1e-3)
    message = r"violates 'left half' by .*% of the bound, after 4 iterations \(infeasible\)"
    with pytest.warns(ffr.DesignWarning, match=message):
        result = run(problem, Plain(problem.domain), iterations=4)
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
    loop.record(0, result.densities, evaluation, accepted=True, step=0.0, sharpness=1.0, merit=0.0)
    bound = 0.5 * evaluation.volume["plate"]
    with pytest.warns(ffr.DesignWarning, match=r"violates 'volume of plate' by 100\.000% of the"):
        above = loop.result(
            result.designs, result.variables, evaluation, "iterations", {"plate": bound}
        )
    assert above.reason == "infeasible" and above.violations == {"volume of plate": 1.0}


# ---------------------------------------------------------------------- the slider-crank


@pytest.mark.mpi
@pytest.mark.parametrize("kind", [ffr.DensityDesign, ffr.LevelSet])
def test_taylor_order_of_the_whole_chain(comm: MPI.Intracomm, kind: Any) -> None:
    """From the variables by density, shape functions and motion to psi, and back."""
    problem, design = rod(comm, kind)
    design = design.at(0.3)
    z = 0.55 + 0.15 * np.sin(np.arange(design.size))
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


@gray
@pytest.mark.slow
@pytest.mark.mpi
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
    # the result is the best crisp one, and fits together
    last = result.designs["rod"]
    assert last.sharpness == 32.0
    np.testing.assert_array_equal(result.x, last.density(result.variables["rod"]))
    assert np.all(result.x[~design.domain.design_cells] == 1.0)
    value = problem.value(result.x).psi
    # what the run saw of it; a level set is analysed a little within its boundary
    seen = problem.value(design.at(1.0).density(result.variables["rod"])).psi
    best = np.nanmin(np.abs(history["psi"] / seen - 1.0))
    assert best < 1e-9
    assert (seen == value) == (kind is ffr.DensityDesign)
    assert result.problem.value(result.x).psi == pytest.approx(result.psi, rel=1e-9)
    if kind is ffr.LevelSet:  # told by the law of cut elements, which is stiffer
        assert result.problem is not problem and 0.7 * value < result.psi < value
        assert result.problem.flexible["rod"].interpolation == ffr.SIMP(exponent=1.35)
    else:
        assert result.problem is problem


@gray
@pytest.mark.slow
@pytest.mark.mpi
def test_constraints_of_the_problem(comm: MPI.Intracomm) -> None:
    """A bound on the first frequency, which the design without it violates."""
    frequency = {"objective": ffr.Frequency("rod")}
    free = run(*rod(comm, ffr.DensityDesign, **frequency, lower=1.0), volume=0.6)
    least = 1.03 * free.evaluation.constraints["bound"].psi
    problem, design = rod(comm, ffr.DensityDesign, **frequency, lower=least)
    result = run(problem, design, volume=0.6)
    assert result.feasible
    assert result.evaluation.constraints["bound"].psi >= least * (1.0 - 1e-8)
    assert result.evaluation.volume["rod"] <= 0.6 * (1.0 + 1e-8)
    assert result.psi > free.psi
    with pytest.raises(ValueError, match="takes a volume bound and no other constraint"):
        run(problem, ffr.LevelSet(design.domain), optimizer=ffr.LevelSetEvolution())


@gray
@pytest.mark.parametrize(
    ("objective", "bound"),
    [
        (ffr.Frequency("rod"), {"lower": 1e6}),
        (ffr.Mass("rod"), {"upper": 1e-6}),
        (ffr.PeakStress("rod"), {"upper": 1e3}),
    ],
    ids=["frequency", "mass", "stress"],
)
def test_bounds_of_the_rod_that_cannot_be_met(
    objective: ffr.Objective, bound: dict[str, float]
) -> None:
    """No rod of this size vibrates at 1 MHz, weighs a milligram or bears a kilopascal."""
    problem, design = rod(MPI.COMM_SELF, objective=objective, **bound)
    with pytest.warns(ffr.DesignWarning, match="violates 'bound' by"):
        result = run(problem, design, iterations=2, volume=1.0)
    assert (result.reason, list(result.violations)) == ("infeasible", ["bound"])


@gray
@pytest.mark.filterwarnings("ignore:.*violates 'stress'.*after 6:dolfinx_ffr.DesignWarning")
def test_stress_limit(tmp_path: Path) -> None:
    """The least material for a stress: the limit is active, and holds for the largest stress."""
    problem, design = rod(MPI.COMM_SELF, ffr.DensityDesign)
    peak = ffr.PeakStress("rod")
    full = problem.value(np.ones(problem.flexible["rod"].domain.n_cells))
    limit = 2.0 * peak.largest(problem.response(full))
    problem = ffr.Problem(
        problem.bodies,
        problem.mechanism,
        problem.integrator,
        ffr.Volume("rod"),
        [ffr.Constraint(peak, upper=limit, name="stress")],
    )
    options = {"volume": 1.0, "output": tmp_path, "optimizer": ffr.MMA(length=30)}
    start = design.even(0.9)
    run(problem, design, start, iterations=6, **options)
    result = run(problem, design, start, iterations=30, resume=True, **options)
    assert result.feasible
    assert -0.05 < result.evaluation.constraints["stress"].value
    worst = ffr.worst_stress(
        result.problem.flexible["rod"], result.evaluation, "rod", relaxation=0.5, void=0.0
    )
    assert result.evaluation.constraints["stress"].psi == pytest.approx(worst.largest, rel=1e-9)
    # the scale is that of the design at hand: the way is the same however often it is resumed
    whole = run(problem, design, start, iterations=30, **{**options, "output": None})
    np.testing.assert_allclose(whole.history["psi"], result.history["psi"], rtol=1e-5)


@gray
@pytest.mark.mpi
def test_any_number_of_ranks(comm: MPI.Intracomm) -> None:
    """A few iterations are those of one rank, to the accuracy of the solvers."""
    together = run(*rod(comm), iterations=6)
    alone = run(*rod(MPI.COMM_SELF), iterations=6)
    for name in ("psi", "volume", "frequency", "gray", "step", "merit"):
        near = 1e-6 * np.abs(alone.history[name]).max()
        assert together.history[name] == pytest.approx(alone.history[name], abs=near), name
    assert together.variables["rod"] == pytest.approx(alone.variables["rod"], abs=1e-6)
    columns = np.array([together.history[name] for name in COLUMNS])
    mine = together.variables["rod"].tobytes() + columns.tobytes() + together.reason.encode()
    assert len(set(comm.allgather(mine))) == 1


@gray
def test_mirrored_designs_of_the_rod() -> None:
    """The same above and below."""
    problem, design = rod(MPI.COMM_SELF)
    lines = ffr.mirror_lines(design.domain)[:1]
    design = ffr.LevelSet(design.domain, mirrors=lines)
    result = run(problem, design, iterations=6)
    nearest = image_cells(design.domain, lines[0])
    x = design.domain.everywhere(result.x)
    np.testing.assert_allclose(x[nearest], x, atol=1e-10)
    assert np.ptp(x) > 0.9


# ---------------------------------------------------------------------- several bodies


@gray
@pytest.mark.slow
@pytest.mark.mpi
def test_a_design_for_each_body(comm: MPI.Intracomm) -> None:
    """A level set and a density, each on its mesh with its share; one adjoint pass for both."""
    problem = four_bar(comm, ffr.IntegralCompliance(["coupler", "rocker"]))
    designs = {
        "coupler": ffr.LevelSet(problem.flexible["coupler"].domain),
        "rocker": ffr.DensityDesign(problem.flexible["rocker"].domain),
    }
    start = {
        "coupler": designs["coupler"].with_holes(4, 1, 0.005),
        "rocker": designs["rocker"].even(),
    }
    seen: list[set[str]] = []
    result = run(
        problem,
        designs,
        start,
        volume={"coupler": 0.6, "rocker": 0.7},
        iterations=20,
        callback=lambda iteration, x, evaluation: seen.append(set(x)),
    )
    assert result.psi < 0.8 * result.history["psi"][0]
    assert result.evaluation.volume["coupler"] <= 0.6 * (1.0 + 1e-8)
    assert result.evaluation.volume["rocker"] <= 0.7 * (1.0 + 1e-8)
    assert seen == [{"coupler", "rocker"}] * 20
    for name, design in result.designs.items():
        assert len(result.variables[name]) == len(start[name])
        np.testing.assert_array_equal(
            result.densities[name], design.density(result.variables[name])
        )
    laws = {name: body.interpolation for name, body in result.problem.flexible.items()}
    assert laws == {"coupler": ffr.SIMP(exponent=1.35), "rocker": ffr.SIMP()}
    with pytest.raises(ValueError, match="several bodies are designed"):
        _ = result.x


# ---------------------------------------------------------------------- interruption


@gray
@pytest.mark.slow
@pytest.mark.mpi
def test_interrupted_and_resumed_is_as_if_uninterrupted(
    comm: MPI.Intracomm, shared_tmp_path: Path
) -> None:
    problem, design = rod(comm)
    whole = run(problem, design, iterations=8)

    def interrupt(iteration: int, x: np.ndarray, evaluation: ffr.Evaluation) -> None:
        if iteration == 5 and comm.rank == comm.size - 1:
            os.kill(os.getpid(), signal.SIGINT)

    first = run(problem, design, iterations=8, output=shared_tmp_path, callback=interrupt)
    assert (first.reason, first.iterations) == ("interrupted", 5)
    rest = run(problem, design, iterations=8, output=shared_tmp_path, resume=True)
    assert (rest.reason, rest.iterations) == (whole.reason, whole.iterations)
    # what was done before is not done again; what follows agrees to the accuracy of the solvers,
    # whose iterations begin where the last ones ended
    for name in ("psi", "volume", "gray", "accepted", "step", "sharpness", "merit"):
        assert np.array_equal(rest.history[name][:6], first.history[name]), name
        size = np.abs(whole.history[name]).max()
        assert rest.history[name] == pytest.approx(whole.history[name], abs=1e-6 * size), name
    assert rest.variables["rod"] == pytest.approx(whole.variables["rod"], abs=1e-6)
    comm.Barrier()
    found = ffr.read_history(shared_tmp_path / "history.csv")
    assert np.array_equal(found["psi"], rest.history["psi"])
    finished = run(problem, design, iterations=8, output=shared_tmp_path, resume=True)
    assert np.array_equal(finished.variables["rod"], rest.variables["rod"])
    assert np.array_equal(finished.history["seconds"], rest.history["seconds"])


@gray
@pytest.mark.filterwarnings("ignore:.*violates 'volume.*after 8:dolfinx_ffr.DesignWarning")
@pytest.mark.mpi
def test_a_run_of_a_given_length_in_two_calls(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """8 iterations and then up to 16 are 16, whose sharpness the length alone decides."""
    problem = Copy(comm, hills)
    design = ffr.LevelSet(problem.domain)
    optimizer = ffr.MMA(length=16)
    whole = run(problem, design, optimizer=optimizer, iterations=16)
    first = run(problem, design, optimizer=optimizer, iterations=8, output=shared_tmp_path)
    assert first.designs["plate"].sharpness == pytest.approx(32.0**0.9)
    options = {"output": shared_tmp_path, "resume": True}
    for later in (ffr.MMA(), ffr.MMA(length=99)):  # keeps the length it began with
        rest = run(problem, design, optimizer=later, iterations=16, **options)
        for name in ("psi", "volume", "gray", "accepted", "step", "sharpness", "merit"):
            np.testing.assert_allclose(
                rest.history[name], whole.history[name], rtol=1e-9, atol=1e-12
            )
        np.testing.assert_allclose(rest.coefficients, whole.coefficients, atol=1e-9)


@gray
@pytest.mark.mpi
def test_a_checkpoint_of_another_problem_is_refused(
    comm: MPI.Intracomm, shared_tmp_path: Path
) -> None:
    problem, design = rod(comm, ffr.DensityDesign)
    run(problem, design, iterations=1, output=shared_tmp_path)
    again = {"iterations": 1, "output": shared_tmp_path, "resume": True}
    shorter = ffr.DensityDesign(design.domain, radius=0.02)
    for options, what in (
        ({"volume": 0.4}, "volume of rod"),
        ({"design": shorter}, "radius of rod"),
        ({"optimizer": ffr.MMA(move=0.2)}, "optimizer"),
    ):
        with pytest.raises(ffr.CheckpointError, match=f"of another problem.*{what}"):
            run(problem, options.pop("design", design), **again, **options)
    problem.integrator = ffr.GeneralizedAlpha(2.0, 190)
    with pytest.raises(ffr.CheckpointError, match="psi of its design was"):
        run(problem, design, **again)


# ---------------------------------------------------------------------- failures


@gray
@pytest.mark.mpi
def test_a_trial_that_cannot_be_simulated_is_taken_back(comm: MPI.Intracomm) -> None:
    """The next step is half as long, and later ones grow again."""
    problem = Copy(comm, hills)
    problem.broken = {3}
    result = run(problem, Plain(problem.domain))
    history = result.history
    assert history["accepted"].tolist() == [1, 1, 0, *[1] * 10]
    assert history["psi"][2] == history["psi"][1]
    assert history["step"][3] == pytest.approx(0.5 * history["step"][2])
    assert history["psi"][-1] < history["psi"][1]


@gray
@pytest.mark.mpi
def test_a_run_that_cannot_go_on_is_stalled(comm: MPI.Intracomm) -> None:
    problem = Copy(comm, hills)
    problem.broken = set(range(3, 99))
    result = run(problem, Plain(problem.domain), iterations=20)
    assert (result.reason, result.iterations) == ("stalled", 9)
    assert result.psi == result.history["psi"][1] == result.history["psi"][-1]


@pytest.mark.mpi
def test_a_start_that_cannot_be_simulated_is_reported(comm: MPI.Intracomm) -> None:
    problem = Copy(comm, hills)
    problem.broken = {1}
    with pytest.raises(ffr.SimulationError, match="too soft"):
        run(problem, Plain(problem.domain))


@pytest.mark.mpi
def test_bad_input_is_refused(comm: MPI.Intracomm) -> None:
    problem = Copy(comm, hills)
    design = ffr.DensityDesign(problem.domain)
    for options, message in (
        ({"move": 0.0}, "move must lie between 0 and 1, 0 excluded"),
        ({"tolerance": -1.0}, "tolerance must not be negative"),
        ({"length": 0}, "length must be a positive whole number"),
    ):
        with pytest.raises(ValueError, match=message):
            ffr.MMA(**options)  # type: ignore[arg-type]
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
        run(problem, design, optimizer=ffr.MMA(), step=0.5)
    with pytest.warns(DeprecationWarning), pytest.raises(TypeError, match="'widths'"):
        run(problem, design, widths=(1.0,))
    with pytest.raises(ValueError, match=r"start is given for \['beam'\]"):
        run(problem, design, {"beam": design.even(0.5)})
    with pytest.raises(ValueError, match=r"designs are given for \['beam'\]"):
        run(problem, {"beam": design}, design.even(0.5))
    with pytest.raises(ValueError, match="not on the domain"):
        run(problem, ffr.DensityDesign(Copy(comm, hills).domain))
