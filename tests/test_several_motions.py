# SPDX-License-Identifier: MIT
"""Several motions of the same bodies: one number, its gradient, one design, on any ranks."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import crank_motion, slider_crank, three_motions

import dolfinx_ffr as ffr
from dolfinx_ffr.problem.spread import owners

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


# ---------------------------------------------------------------------- values and gradients


@pytest.mark.parametrize("combine", COMBINATIONS, ids=repr)
def test_gradient_of_each_combination(comm: MPI.Intracomm, combine: ffr.Combination) -> None:
    """To 1e-6 of central differences, constraints too; and by motion, where that is asked for."""
    problem = three_motions(comm, combine, (24, 4), modes=3)
    domain, x = problem.flexible["rod"].domain, wavy(problem)
    direction = np.cos(80.0 * domain.centroids[:, 0] + 200.0 * domain.centroids[:, 1])
    evaluation = problem.differentiate(problem.value(x), by_motion=True)

    def numbers(at: np.ndarray) -> np.ndarray:
        found = problem.value(at)
        by_motion = [motion.psi for motion in found.motions.values()]
        return np.array([found.psi, *by_motion, *(c.value for c in found.constraints.values())])

    gradients = [
        evaluation.gradient,
        *(motion.gradient for motion in evaluation.motions.values()),
        *(constraint.gradient for constraint in evaluation.constraints.values()),
    ]
    # of fourth order, as the sums of several motions turn quickly
    expected = sum(
        weight * (numbers(x + step * direction) - numbers(x - step * direction)) / (2.0 * step)
        for step, weight in ((1e-3, 4.0 / 3.0), (2e-3, -1.0 / 3.0))
    )
    for gradient, difference in zip(gradients, expected, strict=True):
        assert gradient is not None
        found = domain.sum(gradient["rod"] * direction)
        assert found == pytest.approx(difference, rel=1e-6)
    # with one adjoint solution for all motions the gradient is the same
    together = problem.gradient(x)
    assert together.gradient is not None and evaluation.gradient is not None
    size = np.linalg.norm(evaluation.gradient["rod"])
    rest = np.linalg.norm(together.gradient["rod"] - evaluation.gradient["rod"])
    assert rest < 1e-8 * size


def test_numbers_are_those_of_each_motion_alone(comm: MPI.Intracomm) -> None:
    problem = three_motions(comm, ffr.WeightedSum(WEIGHTS))
    x = wavy(problem)
    evaluation = problem.differentiate(problem.value(x), by_motion=True)
    total = np.zeros(len(x))
    for name, motion in problem.motions.items():
        alone = ffr.Problem(
            problem.bodies,
            motion.mechanism,
            motion.integrator,
            motion.objective,
            motion.constraints,
        ).gradient(x)
        own = evaluation.alone(name)
        assert own.psi == alone.psi == evaluation.motions[name].psi
        assert {k: c.value for k, c in own.constraints.items()} == {
            k: c.value for k, c in alone.constraints.items()
        }
        label = f"{name}: {next(iter(alone.constraints))}"
        assert evaluation.constraints[label].psi == alone.constraints[label.split(": ")[1]].psi
        assert own.gradient is not None and alone.gradient is not None
        size = np.linalg.norm(alone.gradient["rod"])
        assert np.linalg.norm(own.gradient["rod"] - alone.gradient["rod"]) < 1e-8 * size
        assert np.array_equal(own.motion.y, alone.motion.y)
        total += WEIGHTS[name] * alone.gradient["rod"]
        # pictures and reports of one motion take these
        assert ffr.model_report(problem.alone(name), own).psi == alone.psi
    weighted = sum(WEIGHTS[n] * motion.psi for n, motion in evaluation.motions.items())
    assert evaluation.psi == pytest.approx(weighted, rel=1e-14)
    assert evaluation.gradient is not None
    assert np.linalg.norm(evaluation.gradient["rod"] - total) < 1e-8 * np.linalg.norm(total)


def test_bodies_are_reduced_once_and_derivatives_go_back_together(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One reduction a design, one adjoint solution for all motions and one for each constraint."""
    calls = {"reduce_checked": 0, "pullback": 0}
    for name in calls:
        method = getattr(ffr.FlexibleBody, name)

        def counted(*given: Any, name: str = name, method: Any = method) -> Any:
            calls[name] += 1
            return method(*given)

        monkeypatch.setattr(ffr.FlexibleBody, name, counted)
    for combine in (ffr.WeightedSum(WEIGHTS), ffr.WorstCase(WEIGHTS)):
        problem = three_motions(comm, combine, (10, 2), modes=2)
        evaluation = problem.value(wavy(problem))
        near = combine.near({name: motion.psi for name, motion in evaluation.motions.items()})
        calls.update(dict.fromkeys(calls, 0))
        problem.differentiate(problem.value(wavy(problem)))
        assert calls == {"reduce_checked": 1, "pullback": max(1, len(near)) + 3}


def test_one_motion_by_name_is_the_same_bit_for_bit(comm: MPI.Intracomm) -> None:
    plain = slider_crank(comm)
    motion = ffr.MechanicalProblem(plain.mechanism, plain.integrator, plain.objective)
    named = ffr.Problem.of_motions(plain.bodies, {"only": motion})
    x = wavy(plain)
    one, other = plain.gradient(x), named.gradient(x)
    assert one.psi == other.psi
    assert one.gradient is not None and other.gradient is not None
    assert np.array_equal(one.gradient["rod"], other.gradient["rod"])
    assert other.motions["only"].gradient is other.gradient
    assert np.array_equal(one.motion.y, other.motion.y)
    assert named.objective is plain.objective


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
    # a mean of a motion alone is its own value; negative ones have a largest, too
    assert ffr.PowerMean({"a": 0.0, "b": 2.0, "c": 0.0}, p=3.0).value(psi) == pytest.approx(6.0)
    assert ffr.WorstCase().value({"a": -1.0, "b": -3.0}) == -1.0


# ---------------------------------------------------------------------- ranks


@pytest.mark.mpi
def test_same_numbers_of_several_motions_on_any_ranks(comm: MPI.Intracomm) -> None:
    """Psi to 1e-9 and gradients to 1e-7 as on one rank alone, with steps of both kinds."""
    shared = three_motions(comm, ffr.WorstCase(WEIGHTS), steps=300)
    alone = three_motions(MPI.COMM_SELF, ffr.WorstCase(WEIGHTS), steps=300)
    adaptive = ffr.RadauIIA(0.5, tolerance=1e-5)
    for problem in (shared, alone):
        problem.motions["lever"] = replace(problem.motions["lever"], integrator=adaptive)
    one, every = (
        problem.differentiate(problem.value(wavy(problem)), by_motion=True)
        for problem in (alone, shared)
    )
    assert every.psi == pytest.approx(one.psi, rel=1e-9)
    place = {tuple(p): k for k, p in enumerate(np.round(alone.flexible["rod"].domain.centroids, 9))}
    mine = [place[tuple(p)] for p in np.round(shared.flexible["rod"].domain.centroids, 9)]
    for name, motion in every.motions.items():
        assert motion.psi == pytest.approx(one.motions[name].psi, rel=1e-9)
        # who computed it, and who was sent it, have the same bits
        assert motion.trajectory is not None
        state = motion.trajectory.y.tobytes(), motion.trajectory.strain_energy("rod").tobytes()
        assert all(other == state for other in comm.allgather(state))
        expected = one.motions[name].gradient
        assert motion.gradient is not None and expected is not None
        scale = np.linalg.norm(expected["rod"]) / np.sqrt(len(expected["rod"]))
        worst = np.max(np.abs(motion.gradient["rod"] - expected["rod"][mine]), initial=0.0)
        assert comm.allreduce(worst, MPI.MAX) < 1e-7 * scale
    for name, value in every.constraints.items():
        assert value.value == pytest.approx(one.constraints[name].value, rel=1e-8)


def test_work_is_balanced() -> None:
    costs = {"a": 5.0, "b": 1.0, "c": 4.0, "d": 3.0, "e": 3.0}
    found = owners(costs, 2)
    loads = [sum(costs[name] for name, rank in found.items() if rank == r) for r in range(2)]
    assert loads == [8.0, 8.0]
    assert owners(costs, 1) == dict.fromkeys(costs, 0)
    assert len(set(owners(costs, 9).values())) == 5


@pytest.mark.mpi
def test_warnings_of_a_motion_reach_every_rank_and_name_it(comm: MPI.Intracomm) -> None:
    """A motion with too few steps is computed on one rank, and all are warned of it."""
    problem = three_motions(comm, constraints=False)
    short = ffr.GeneralizedAlpha(1.6, 60)
    problem.motions["fast"] = replace(problem.motions["fast"], integrator=short)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        problem.value(wavy(problem))
    found = [w for w in caught if issubclass(w.category, ffr.TimeStepWarning)]
    assert [str(w.message)[:15] for w in found] == ["motion 'fast': "]


@pytest.mark.mpi
def test_a_motion_that_fails_on_one_rank_fails_on_every_rank(comm: MPI.Intracomm) -> None:
    """With the name of the motion, so that a design loop can go back everywhere."""
    problem = three_motions(comm, constraints=False)
    short = ffr.GeneralizedAlpha(1.6, 20)
    problem.motions["fast"] = replace(problem.motions["fast"], integrator=short)
    with pytest.raises(ffr.SimulationError, match=r"^motion 'fast': at t = .*Newton"):
        problem.value(wavy(problem))


# ---------------------------------------------------------------------- bad input


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("motions", "combine", "error", "message"),
    [
        ({}, None, ValueError, "give at least one motion"),
        ([FAST], None, TypeError, "motions must be a mapping from names to"),
        ({"a": FAST, "b": crank_motion(1.0)}, None, TypeError, "'b' must be a MechanicalProblem"),
        (
            {"a": FAST, "b": replace(FAST, mechanism=ffr.Mechanism({"bar": ffr.Placement()}, []))},
            None,
            ValueError,
            r"motion 'b': placement for 'bar', but the bodies are \['rod'\]",
        ),
        (
            {"a": FAST, "b": replace(FAST, mechanism=ffr.Mechanism({}, []))},
            None,
            ValueError,
            "motion 'b': body 'rod' has no placement",
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
            "motion 'b': volume of body 'bar'",
        ),
        ({"a": FAST}, "sum", TypeError, r"combine must be WeightedSum\(...\), PowerMean"),
        ({"a": FAST}, ffr.WeightedSum({"b": 1.0}), ValueError, r"no motion 'b', but \['a'\]"),
        (
            {"a": FAST, "b": FAST},
            ffr.WorstCase({"a": 1.0}),
            ValueError,
            "that of 'b' is missing; a motion that is not to count has the weight 0",
        ),
    ],
)
def test_bad_motions(
    comm: MPI.Intracomm, motions: Any, combine: Any, error: type[Exception], message: str
) -> None:
    """Refused on every rank when the problem is made."""
    rod = slider_crank(comm, (10, 2), modes=2).bodies
    with pytest.raises(error, match=message):
        ffr.Problem.of_motions(rod, motions, combine)


@pytest.mark.parametrize("kind", [ffr.WeightedSum, ffr.PowerMean, ffr.WorstCase])
@pytest.mark.parametrize(
    ("weights", "error", "message"),
    [
        ({"a": -1.0, "b": 1.0}, ValueError, "weights: that of 'a' must not be negative"),
        ({"a": 0.0, "b": 0.0}, ValueError, "one at least must be positive"),
        ({}, ValueError, "one at least must be positive"),
        ({"a": "1"}, TypeError, "that of 'a' must be a number"),
        ([1.0], TypeError, "weights must be a mapping from names to weights"),
    ],
)
def test_bad_weights(
    kind: type[ffr.Combination], weights: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        kind(weights)


@pytest.mark.mpi
def test_power_mean_refuses_what_has_none(comm: MPI.Intracomm) -> None:
    with pytest.raises(ValueError, match="PowerMean: p must be at least 1"):
        ffr.PowerMean(p=0.5)
    problem = slider_crank(comm, (10, 2), modes=2)
    motions = {"a": FAST, "b": replace(FAST, objective=-1.0 * ffr.Mass("rod"))}
    mean = ffr.Problem.of_motions(problem.bodies, motions, ffr.PowerMean())
    with pytest.raises(ValueError, match="positive objectives, and that of motion 'b' is -"):
        mean.value(wavy(problem))


def test_parts_of_several_motions_are_asked_for_by_name(comm: MPI.Intracomm) -> None:
    problem = three_motions(comm, elements=(10, 2))
    evaluation = problem.value(wavy(problem))
    for ask, instead in (
        (lambda: problem.mechanism, r"problem.motions\['slow'\].mechanism"),
        (lambda: problem.objective, r"problem.motions\['slow'\].objective"),
        (lambda: evaluation.motion, r"evaluation.alone\('slow'\).trajectory"),
        (lambda: problem.response(evaluation), r"problem.alone\('slow'\)"),
    ):
        with pytest.raises(ValueError, match=f"there are 3 motions.*{instead}"):
            ask()
    for who in (problem, evaluation):
        with pytest.raises(ValueError, match="'quick'"):
            who.alone("quick")
    assert [c.label for c in problem.constraints] == list(evaluation.constraints)


# ---------------------------------------------------------------------- what problems can do


@pytest.mark.mpi
def test_modes_errors_and_tolerances_of_several_motions(comm: MPI.Intracomm) -> None:
    """What is offered for one motion works for several, and says the same of one as of two."""
    problem = three_motions(comm, ffr.WeightedSum(WEIGHTS), modes=2)
    x = wavy(problem)
    evaluation = problem.value(x)
    twice = {name: problem.motions["slow"] for name in ("a", "b")}
    same = ffr.Problem.of_motions(problem.bodies, twice, ffr.PowerMean(p=3.0))
    single = problem.alone("slow")
    found, expected = (ffr.mode_error(p, p.value(x))["rod"] for p in (same, single))
    assert found == pytest.approx(expected, rel=1e-6)
    more = ffr.propose_modes(problem, evaluation, tolerance=1e-4)
    richer = problem.with_modes(more)
    assert richer.combine is problem.combine and list(richer.motions) == list(problem.motions)
    assert ffr.mode_error(richer, richer.value(x))["rod"] < 1e-3
    report = ffr.model_report(problem, evaluation)
    assert report.psi == evaluation.psi and 0.0 < report.step_error < 1.0
    assert "damping" not in report.left_out and "gravity" in report.left_out
    calm = problem.with_tolerance(x, 0.05)
    assert all(m.integrator.steps >= 200 for m in calm.motions.values())
    corrected, told = problem.calibrated(evaluation)
    assert corrected.motions["slow"] is problem.motions["slow"]
    stress = ffr.worst_stress(
        problem.flexible["rod"], told.alone("lever"), "rod", relaxation=0.5
    ).largest
    assert told.constraints["lever: stress"].psi == pytest.approx(stress, rel=1e-9)
    assert ffr.worst_stress(problem.flexible["rod"], told, "rod", relaxation=0.5).largest >= stress


def test_elements_one_by_one_give_the_same_gradient(comm: MPI.Intracomm) -> None:
    problem = three_motions(
        comm, ffr.PowerMean(WEIGHTS, p=4.0), (16, 4), constraints=False, modes=2
    )
    x = wavy(problem)
    exact = problem.gradient(x).gradient
    assert exact is not None
    found = ffr.elementwise_gradient(problem, problem.value(x), progress=False)["rod"]
    assert np.linalg.norm(found.values - exact["rod"]) < 1e-7 * np.linalg.norm(exact["rod"])
