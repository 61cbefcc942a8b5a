# SPDX-License-Identifier: MIT
"""Several load cases of the same bodies: one number, its gradient, one design, on any ranks."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import crank_motion, slider_crank, three_load_cases

import dolfinx_ffr as ffr

WEIGHTS = {"slow": 1.5, "fast": 1.0, "lever": 0.7}
COMBINATIONS = [
    ffr.WeightedSum(WEIGHTS),
    ffr.WeightedSum({**WEIGHTS, "slow": 0.0}),
    ffr.PowerMean(WEIGHTS, p=6.0),
    ffr.PowerMean(p=1.0),
    ffr.WorstCase(WEIGHTS),
]
FAST = ffr.MechanicalProblem(
    crank_motion(1.6), ffr.GeneralizedAlpha(1.6, 200), ffr.IntegralCompliance()
)


def wavy(problem: ffr.Problem) -> np.ndarray:
    c = problem.flexible["rod"].domain.centroids
    return 0.7 + 0.2 * np.sin(60.0 * c[:, 0] + 40.0 * c[:, 1])


@pytest.mark.slow
@pytest.mark.parametrize("combine", COMBINATIONS, ids=repr)
def test_gradient_of_each_combination(comm: MPI.Intracomm, combine: ffr.Combination) -> None:
    """To 1e-6 of central differences, constraints too; by load case, where asked for."""
    problem = three_load_cases(comm, combine, (24, 4), modes=3)
    domain, x = problem.flexible["rod"].domain, wavy(problem)
    direction = np.cos(80.0 * domain.centroids[:, 0] + 200.0 * domain.centroids[:, 1])
    evaluation = problem.differentiate(problem.value(x), by_load_case=True)

    def numbers(at: np.ndarray) -> np.ndarray:
        owners_of_costs = problem.value(at)
        by_load_case = [case.psi for case in owners_of_costs.load_cases.values()]
        return np.array(
            [
                owners_of_costs.psi,
                *by_load_case,
                *(c.violation for c in owners_of_costs.constraints.values()),
            ]
        )

    gradients = [
        evaluation.gradient,
        *(case.gradient for case in evaluation.load_cases.values()),
        *(constraint.gradient for constraint in evaluation.constraints.values()),
    ]
    # of fourth order, as the sums of several load cases turn quickly
    expected = sum(
        weight * (numbers(x + step * direction) - numbers(x - step * direction)) / (2.0 * step)
        for step, weight in ((1e-3, 4.0 / 3.0), (2e-3, -1.0 / 3.0))
    )
    for gradient, difference in zip(gradients, expected, strict=True):
        assert gradient is not None
        owners_of_costs = domain.sum(gradient["rod"] * direction)
        assert owners_of_costs == pytest.approx(difference, rel=1e-6)
    # with one adjoint solution for all load cases the gradient is the same
    evaluation_of_all = problem.gradient(x)
    assert evaluation_of_all.gradient is not None and evaluation.gradient is not None
    size = np.linalg.norm(evaluation.gradient["rod"])
    rest = np.linalg.norm(evaluation_of_all.gradient["rod"] - evaluation.gradient["rod"])
    assert rest < 1e-8 * size


@pytest.mark.slow
def test_numbers_are_those_of_each_load_case_alone(comm: MPI.Intracomm) -> None:
    problem = three_load_cases(comm, ffr.WeightedSum(WEIGHTS))
    x = wavy(problem)
    evaluation = problem.differentiate(problem.value(x), by_load_case=True)
    total = np.zeros(len(x))
    for name, case in problem.load_cases.items():
        arguments = case.mechanism, case.integrator, case.objective, case.constraints
        alone = ffr.Problem(problem.bodies, *arguments).gradient(x)
        evaluation_of_case = evaluation.alone(name)
        assert evaluation_of_case.psi == alone.psi == evaluation.load_cases[name].psi
        assert {k: c.violation for k, c in evaluation_of_case.constraints.items()} == {
            k: c.violation for k, c in alone.constraints.items()
        }
        label = f"{name}: {next(iter(alone.constraints))}"
        assert evaluation.constraints[label].value == alone.constraints[label.split(": ")[1]].value
        assert evaluation_of_case.gradient is not None and alone.gradient is not None
        size = np.linalg.norm(alone.gradient["rod"])
        assert (
            np.linalg.norm(evaluation_of_case.gradient["rod"] - alone.gradient["rod"]) < 1e-8 * size
        )
        assert np.array_equal(evaluation_of_case.trajectory.y, alone.trajectory.y)
        total += WEIGHTS[name] * alone.gradient["rod"]
        # pictures and reports of one load case take these
        assert ffr.model_report(problem.alone(name), evaluation_of_case).psi == alone.psi
    weighted = sum(WEIGHTS[n] * case.psi for n, case in evaluation.load_cases.items())
    assert evaluation.psi == pytest.approx(weighted, rel=1e-14)
    assert evaluation.gradient is not None
    assert np.linalg.norm(evaluation.gradient["rod"] - total) < 1e-8 * np.linalg.norm(total)


def test_bodies_are_reduced_once_and_derivatives_go_back_together(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One reduction a design, one adjoint solution for all load cases, one for each constraint."""
    calls = {"reduce_checked": 0, "pullback": 0}
    for name in calls:
        method = getattr(ffr.FlexibleBody, name)

        def counted(*given: Any, name: str = name, method: Any = method, **options: Any) -> Any:
            calls[name] += 1
            return method(*given, **options)

        monkeypatch.setattr(ffr.FlexibleBody, name, counted)
    for combine in (ffr.WeightedSum(WEIGHTS), ffr.WorstCase(WEIGHTS)):
        problem = three_load_cases(comm, combine, (10, 2), modes=2)
        evaluation = problem.value(wavy(problem))
        smoothed = combine.near({name: case.psi for name, case in evaluation.load_cases.items()})
        calls.update(dict.fromkeys(calls, 0))
        problem.differentiate(problem.value(wavy(problem)))
        assert calls == {"reduce_checked": 1, "pullback": max(1, len(smoothed)) + 3}


def test_combinations_of_numbers() -> None:
    psi = {"a": 1.0, "b": 3.0, "c": 2.0}
    assert ffr.WeightedSum().value(psi) == 6.0
    assert ffr.PowerMean(p=1.0).value(psi) == pytest.approx(2.0)
    assert ffr.PowerMean(p=2.0).value(psi) == pytest.approx(np.sqrt(14.0 / 3.0))
    # without overflow, and from below to the largest
    assert ffr.PowerMean(p=2000.0).value(psi) == pytest.approx(3.0, rel=1e-3)
    assert ffr.PowerMean({"a": 0.0, "b": 1.0, "c": 1.5}, p=7.0).value(psi) == pytest.approx(3.0)
    assert ffr.WorstCase({"a": 4.0, "b": 1.0, "c": 0.0}).value(psi) == 4.0
    assert ffr.WorstCase().slopes(psi) == {"a": 0.0, "b": 1.0, "c": 0.0}
    # a mean of a load case alone is its own value; negative ones have a largest, too
    assert ffr.PowerMean({"a": 0.0, "b": 2.0, "c": 0.0}, p=3.0).value(psi) == pytest.approx(6.0)
    assert ffr.WorstCase().value({"a": -1.0, "b": -3.0}) == -1.0


@pytest.mark.mpi
def test_same_numbers_of_several_load_cases_on_any_ranks(comm: MPI.Intracomm) -> None:
    """Psi to 1e-9 and gradients to 1e-7 as on one rank alone, with steps of both kinds."""
    shared = three_load_cases(comm, ffr.WorstCase(WEIGHTS), steps=300)
    serial_problem = three_load_cases(MPI.COMM_SELF, ffr.WorstCase(WEIGHTS), steps=300)
    adaptive = ffr.RadauIIA(0.5, tolerance=1e-5)
    for problem in (shared, serial_problem):
        problem.load_cases["lever"] = replace(problem.load_cases["lever"], integrator=adaptive)
    one, every = (
        problem.differentiate(problem.value(wavy(problem)), by_load_case=True)
        for problem in (serial_problem, shared)
    )
    assert every.psi == pytest.approx(one.psi, rel=1e-9)
    place = {
        tuple(p): k
        for k, p in enumerate(np.round(serial_problem.flexible["rod"].domain.centroids, 9))
    }
    mine = [place[tuple(p)] for p in np.round(shared.flexible["rod"].domain.centroids, 9)]
    for name, case in every.load_cases.items():
        assert case.psi == pytest.approx(one.load_cases[name].psi, rel=1e-9)
        # who computed it, and who was sent it, have the same bits
        assert case.trajectory is not None
        state = case.trajectory.y.tobytes(), case.trajectory.strain_energy("rod").tobytes()
        assert all(other == state for other in comm.allgather(state))
        expected = one.load_cases[name].gradient
        assert case.gradient is not None and expected is not None
        scale = np.linalg.norm(expected["rod"]) / np.sqrt(len(expected["rod"]))
        worst = np.max(np.abs(case.gradient["rod"] - expected["rod"][mine]), initial=0.0)
        assert comm.allreduce(worst, MPI.MAX) < 1e-7 * scale
    for name, value in every.constraints.items():
        assert value.violation == pytest.approx(one.constraints[name].violation, rel=1e-8)


@pytest.mark.mpi
def test_warnings_of_a_load_case_reach_every_rank_and_name_it(comm: MPI.Intracomm) -> None:
    """A load case with too few steps is computed on one rank, and all are warned of it."""
    problem = three_load_cases(comm, constraints=False)
    short = ffr.GeneralizedAlpha(1.6, 60)
    problem.load_cases["fast"] = replace(problem.load_cases["fast"], integrator=short)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        problem.value(wavy(problem))
    step_warnings = [w for w in caught if issubclass(w.category, ffr.TimeStepWarning)]
    assert [str(w.message)[:18] for w in step_warnings] == ["load case 'fast': "]


@pytest.mark.mpi
def test_a_load_case_that_fails_on_one_rank_fails_on_every_rank(comm: MPI.Intracomm) -> None:
    """With the name of the load case, so that a design loop can go back everywhere."""
    problem = three_load_cases(comm, constraints=False)
    short = ffr.GeneralizedAlpha(1.6, 20)
    problem.load_cases["fast"] = replace(problem.load_cases["fast"], integrator=short)
    with pytest.raises(ffr.SimulationError, match=r"^load case 'fast': at t = .*Newton"):
        problem.value(wavy(problem))


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("load_cases", "combine", "error", "message"),
    [
        ({"a": FAST, "b": crank_motion(1.0)}, None, TypeError, "'b' must be a MechanicalProblem"),
        (
            {"a": FAST, "b": replace(FAST, mechanism=ffr.Mechanism({"bar": ffr.Placement()}, []))},
            None,
            ValueError,
            r"load case 'b': placement for 'bar', but the bodies are \['rod'\]",
        ),
        (
            {"a": FAST, "b": replace(FAST, mechanism=ffr.Mechanism({}, []))},
            None,
            ValueError,
            "load case 'b': body 'rod' has no placement",
        ),
        (
            {"a": replace(FAST, mechanism=ffr.Mechanism({}, []))},
            None,
            ValueError,
            "^body 'rod' has no placement",
        ),
        (
            {"a": FAST, "b": replace(FAST, objective=ffr.Volume("bar"))},
            None,
            ValueError,
            "load case 'b': volume of body 'bar'",
        ),
        (
            {"a": FAST},
            ffr.WeightedSum({"b": 1.0}),
            ValueError,
            r"no load case 'b'; the load cases are \['a'\]",
        ),
        (
            {"a": FAST, "b": FAST},
            ffr.WorstCase({"a": 1.0}),
            ValueError,
            "the weight of 'b' is missing; give the weight 0 to a load case",
        ),
    ],
)
def test_bad_load_cases(
    comm: MPI.Intracomm, load_cases: Any, combine: Any, error: type[Exception], message: str
) -> None:
    """Refused on every rank when the problem is made."""
    rod = slider_crank(comm, (10, 2), modes=2).bodies
    with pytest.raises(error, match=message):
        ffr.Problem.of_load_cases(rod, load_cases, combine)


def test_power_mean_refuses_what_has_none(comm: MPI.Intracomm) -> None:

    problem = slider_crank(comm, (10, 2), modes=2)
    load_cases = {"a": FAST, "b": replace(FAST, objective=-1.0 * ffr.Mass("rod"))}
    mean = ffr.Problem.of_load_cases(problem.bodies, load_cases, ffr.PowerMean())
    with pytest.raises(ValueError, match="positive objectives, but psi of load case 'b' is -"):
        mean.value(wavy(problem))


def test_parts_of_several_load_cases_are_asked_for_by_name(comm: MPI.Intracomm) -> None:
    problem = three_load_cases(comm, elements=(10, 2))
    evaluation = problem.value(wavy(problem))
    for ask, instead in (
        (lambda: problem.mechanism, r"problem.load_cases\['slow'\].mechanism"),
        (lambda: problem.objective, r"problem.load_cases\['slow'\].objective"),
        (lambda: evaluation.trajectory, r"evaluation.alone\('slow'\).trajectory"),
        (lambda: problem.response(evaluation), r"problem.alone\('slow'\)"),
    ):
        with pytest.raises(ValueError, match=f"there are 3 load cases.*{instead}"):
            ask()
    for who in (problem, evaluation):
        with pytest.raises(ValueError, match="'quick'"):
            who.alone("quick")
    assert [c.label for c in problem.constraints] == list(evaluation.constraints)


@pytest.mark.slow
def test_modes_errors_and_tolerances_of_several_load_cases(comm: MPI.Intracomm) -> None:
    """What is offered for one load case works for several, and says the same of one as of two."""
    problem = three_load_cases(comm, ffr.WeightedSum(WEIGHTS), modes=2)
    x = wavy(problem)
    evaluation = problem.value(x)
    twice = {name: problem.load_cases["slow"] for name in ("a", "b")}
    with_power_mean = ffr.Problem.of_load_cases(problem.bodies, twice, ffr.PowerMean(p=3.0))
    single = problem.alone("slow")
    owners_of_costs, expected = (
        ffr.mode_error(p, p.value(x))["rod"] for p in (with_power_mean, single)
    )
    assert owners_of_costs == pytest.approx(expected, rel=1e-6)
    proposed = ffr.propose_modes(problem, evaluation, tolerance=1e-4)
    richer = problem.with_modes(proposed)
    assert richer.combine is problem.combine and list(richer.load_cases) == list(problem.load_cases)
    assert ffr.mode_error(richer, richer.value(x))["rod"] < 1e-3
    report = ffr.model_report(problem, evaluation)
    assert report.psi == evaluation.psi and 0.0 < report.step_error < 1.0
    assert "damping" not in report.left_out and "gravity" in report.left_out
    calm = problem.with_tolerance(x, 0.05)
    assert max(calm.time_errors(calm.value(x)).values()) <= 0.05
    corrected, calibrated = problem.calibrated(evaluation)
    assert corrected.load_cases["slow"] is problem.load_cases["slow"]
    stress = ffr.worst_stress(
        problem.flexible["rod"], calibrated.alone("lever"), "rod", relaxation=0.5
    ).largest
    assert calibrated.constraints["lever: stress"].value == pytest.approx(stress, rel=1e-9)
    assert (
        ffr.worst_stress(problem.flexible["rod"], calibrated, "rod", relaxation=0.5).largest
        >= stress
    )


def test_elements_one_by_one_give_the_same_gradient(comm: MPI.Intracomm) -> None:
    problem = three_load_cases(
        comm, ffr.PowerMean(WEIGHTS, p=4.0), (16, 4), constraints=False, modes=2
    )
    x = wavy(problem)
    exact = problem.gradient(x).gradient
    assert exact is not None
    gradient = ffr.paper.elementwise_gradient(problem, problem.value(x), progress=False)["rod"]
    assert np.linalg.norm(gradient.values - exact["rod"]) < 1e-7 * np.linalg.norm(exact["rod"])
