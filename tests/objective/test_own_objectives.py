# SPDX-License-Identifier: MIT
"""Objectives of one's own that return no number, or no derivatives: refused by name."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.derivatives import check_gradient
from shared.problems import slider_crank, swing_about_a_point
from shared.scenes import slider_crank as slider_crank_of_arrays

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import TrajectoryBar
from dolfinx_ffr.objective import marker_derivatives

NO_NUMBERS = [math.nan, 1j, None, "1.0", np.ones(2)]


class Own(ffr.Objective):
    """The filled area, or on the last rank what it is told to return instead."""

    needs_trajectory = False  # type: ignore[assignment]

    def __init__(self, comm: MPI.Comm = MPI.COMM_SELF, **instead: Any) -> None:
        self.instead = instead if comm.rank == comm.size - 1 else {}

    def evaluate(self, response: ffr.Response) -> float:
        if "value" in self.instead:
            return self.instead["value"]  # type: ignore[no-any-return]
        density = response.densities["rod"]
        return density.sum(density.areas * density.values)

    def derivatives(self, response: ffr.Response) -> Any:
        if "derivatives" in self.instead:
            return self.instead["derivatives"](response)
        return ffr.Derivatives(densities={"rod": response.densities["rod"].areas})


class OfMotion(Own):
    """One of the motion alone."""

    needs_trajectory = True


def problem_of(
    comm: MPI.Comm, objective: ffr.Objective, as_constraint: bool
) -> tuple[ffr.Problem, np.ndarray]:
    """A problem and densities."""
    base = slider_crank(comm, (10, 2), modes=1, steps=20)
    bound = ffr.Constraint(objective, upper=1.0, name="bound")
    psi = ffr.Mass("rod") if as_constraint else 2.0 * objective + ffr.Mass("rod")
    constraints = [bound] if as_constraint else []
    problem = ffr.Problem(base.bodies, base.mechanism, base.integrator, psi, constraints)
    return problem, np.full(problem.flexible["rod"].domain.n_cells, 0.5)


PLACES = pytest.mark.parametrize(
    "as_constraint", [False, True], ids=["term of a sum", "constraint"]
)


@pytest.mark.mpi
@PLACES
@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
def test_values_that_are_no_numbers(comm: MPI.Intracomm, value: Any, as_constraint: bool) -> None:
    """No design loop takes them for a design that fulfils its constraints."""
    problem, x = problem_of(comm, Own(comm, value=value), as_constraint)
    message = (
        "constraint 'bound': the value of Own must" if as_constraint else "the value of Own must"
    )
    with pytest.raises((TypeError, ValueError), match=message):
        problem.value(x)
    if value is NO_NUMBERS[0]:
        design = ffr.DensityDesign(problem.flexible["rod"].domain)
        with pytest.raises(ValueError, match=message):
            ffr.optimize(problem, design, iterations=2, progress=False)


def rod(values: Callable[[ffr.Response], Any]) -> Callable[[ffr.Response], ffr.Derivatives]:
    return lambda response: ffr.Derivatives(densities={"rod": values(response)})


def of_mass(value: Any, modes: int) -> Callable[[ffr.Response], ffr.Derivatives]:
    def derivatives(response: ffr.Response) -> ffr.Derivatives:
        zeros = response.bodies["rod"].zeros_like().leading(modes)
        return ffr.Derivatives(integrals={"rod": zeros + zeros.scaled(value)})

    return derivatives


def of_marker(response: ffr.Response) -> ffr.Derivatives:
    zeros = response.bodies["rod"].zeros_like()
    broken = {name: marker.scaled(math.nan) for name, marker in zeros.markers.items()}
    return ffr.Derivatives(integrals={"rod": replace(zeros, markers=broken)})


@pytest.mark.mpi
@PLACES
@pytest.mark.parametrize(
    ("derivatives", "message"),
    [
        (lambda response: None, "the derivatives of Own must be ffr.Derivatives"),
        (rod(lambda r: r.densities["rod"].areas * math.nan), "by the density of 'rod' holds NaN"),
        (rod(lambda r: r.densities["rod"].areas[1:]), r"by the density of 'rod' must have shape"),
        (rod(lambda r: 1j * r.densities["rod"].areas), "by the density of 'rod' must hold real"),
        (
            lambda r: ffr.Derivatives(densities={"bar": r.densities["rod"].areas}),
            r"by the density of 'bar', but the bodies with a density are \['rod'\]",
        ),
        (lambda r: ffr.Derivatives(densities=[1.0]), "must be a mapping"),  # type: ignore[arg-type]
        (of_mass(math.nan, 4), "by the integrals of 'rod': S holds NaN"),
        (of_marker, "by the integrals of 'rod' hold NaN"),
        (of_mass(1.0, 3), r"by the integrals of 'rod': S must have shape"),
        (lambda r: ffr.Derivatives(integrals={"rod": 1.0}), "integrals of 'rod' must be Volume"),
        (lambda r: ffr.Derivatives(trajectory=np.ones(3)), "by the trajectory must be a Traj"),
        (lambda r: ffr.Derivatives(stresses={"rod": np.ones(3)}), "by the stress of 'rod' must"),
    ],
)
def test_derivatives_that_are_none(
    comm: MPI.Intracomm, derivatives: Any, message: str, as_constraint: bool
) -> None:
    """On every rank, also where one alone returns them."""
    problem, x = problem_of(comm, Own(comm, derivatives=derivatives), as_constraint)
    value = problem.value(x)
    with pytest.raises((TypeError, ValueError), match=message):
        problem.differentiate(value)
    if not as_constraint:
        with pytest.raises((TypeError, ValueError), match=message):
            problem.partial_derivatives(value)


def by_y(value: float, first: int = 0) -> Callable[[ffr.Response], ffr.Derivatives]:
    def derivatives(response: ffr.Response) -> ffr.Derivatives:
        zeros = TrajectoryBar.zeros(response.trajectory)
        return ffr.Derivatives(replace(zeros, y=np.full_like(zeros.y[first:], value)))

    return derivatives


@pytest.mark.parametrize(
    ("value", "bars", "message"),
    [
        (math.nan, None, "the value of OfMotion must be finite, but it is nan"),
        (
            1.0,
            lambda t: ffr.Derivatives(None, None),
            "derivatives of OfMotion by integrals must be a map",
        ),
        (1.0, by_y(math.nan), "the derivatives of OfMotion by y holds NaN"),
        (1.0, by_y(1.0, 1), "the derivatives of OfMotion by y must have"),
    ],
)
def test_objectives_of_the_motion_alone(value: Any, bars: Any, message: str) -> None:
    scene = slider_crank_of_arrays(0.01, 4, 1)
    objective = OfMotion(value=value, derivatives=bars)
    problem = ffr.MechanicalProblem(scene.mechanism, scene.integrator, objective)
    with pytest.raises((TypeError, ValueError), match=message):
        problem.gradient(scene.bodies)


class Broken(ffr.WeightedSum):
    """A sum of several motions whose value or slopes are no numbers."""

    fault = ""

    def value(self, psi: Mapping[str, float]) -> float:
        return math.nan if self.fault == "value" else super().value(psi)

    def slopes(self, psi: Mapping[str, float]) -> dict[str, float]:
        return {**super().slopes(psi), **({"fast": math.nan} if self.fault == "slopes" else {})}


def test_combinations_that_are_no_numbers(comm: MPI.Intracomm) -> None:
    base, combine = slider_crank(comm, (10, 2), modes=1, steps=20), Broken()
    motion = ffr.MechanicalProblem(base.mechanism, base.integrator, ffr.Mass("rod"))
    problem = ffr.Problem.of_load_cases(base.bodies, {"slow": motion, "fast": motion}, combine)
    x = np.full(problem.flexible["rod"].domain.n_cells, 0.5)
    evaluation = problem.value(x)
    object.__setattr__(combine, "fault", "slopes")
    with pytest.raises(ValueError, match="the slope of Broken by 'fast' must be finite"):
        problem.differentiate(evaluation)
    object.__setattr__(combine, "fault", "value")
    with pytest.raises(ValueError, match="the value of Broken must be finite, but it is nan"):
        problem.value(x)


class OfAnother:
    """A way to the gradient of one's own, whose numbers are none."""

    exact = True

    def __init__(self, values: Any) -> None:
        self.values = values

    def __call__(self, problem: ffr.Problem, evaluation: ffr.Evaluation, *rest: Any) -> Any:
        derivatives, reports = ffr.ExactAdjoint()(problem, evaluation, *rest)
        return replace(derivatives, gradient=self.values(derivatives.gradient)), reports


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("values", "message"),
    [
        (lambda g: {"rod": math.nan * g["rod"]}, "the gradient of psi by 'rod' holds NaN"),
        (lambda g: {"rod": g["rod"][1:]}, "the gradient of psi by 'rod' must have shape"),
        (lambda g: None, "the gradient of psi must be a mapping"),
        (lambda g: {}, "the gradient of psi by 'rod' must hold real numbers, but it is None"),
    ],
)
def test_gradients_of_ones_own_way(comm: MPI.Intracomm, values: Any, message: str) -> None:
    problem, _ = problem_of(comm, ffr.Volume("rod"), as_constraint=True)
    design = ffr.DensityDesign(problem.flexible["rod"].domain)
    with pytest.raises((TypeError, ValueError), match=message):
        ffr.optimize(problem, design, gradient=OfAnother(values), iterations=1, progress=False)


class Way(ffr.Objective):
    """How far a marker comes in y in the end, and its velocity and acceleration there."""

    def __init__(self, marker: str, *, whole: bool) -> None:
        self.marker, self.whole = marker, whole

    def vectors(self, run: ffr.dynamics.Trajectory) -> list[np.ndarray]:
        point = ("rod", self.marker)
        return [
            run.marker_path(*point),
            run.marker_velocity(*point),
            run.marker_acceleration(*point),
        ]

    def evaluate(self, response: ffr.Response) -> float:
        place, velocity, acceleration = self.vectors(response.trajectory)
        return float(place[-1, 1] + 0.1 * velocity[-1, 0] + 1e-4 * acceleration[-1, 1])

    def derivatives(self, response: ffr.Response) -> ffr.Derivatives:
        bars = [np.zeros_like(part) for part in self.vectors(response.trajectory)]
        bars[0][-1, 1], bars[1][-1, 0], bars[2][-1, 1] = 1.0, 0.1, 1e-4
        names = ("position", "velocity", "acceleration")
        derivatives = marker_derivatives(
            response, "rod", self.marker, **dict(zip(names, bars, strict=True))
        )
        return derivatives if self.whole else replace(derivatives, integrals={})


def with_objective(problem: ffr.Problem, objective: ffr.Objective) -> ffr.Problem:
    return ffr.Problem(problem.bodies, problem.mechanism, problem.integrator, objective)


def test_own_objectives_of_a_marker(comm: MPI.Intracomm) -> None:
    """Exact by `marker_derivatives`; refused where shapes inside of the body are left out."""
    problem = swing_about_a_point(comm, 200)
    check_gradient(with_objective(problem, Way("tip", whole=True)), step=2e-3)
    x = np.full(problem.flexible["rod"].domain.n_cells, 0.7)
    for objective in (Way("tip", whole=False), ffr.Mass("rod") + Way("tip", whole=False)):
        lacking = with_objective(problem, objective)
        with pytest.raises(ValueError, match="the derivatives of Way by the integrals of 'rod' do"):
            lacking.gradient(x)
    # at an interface, which the density does not move in the body, nothing is lacking
    evaluations = [
        with_objective(problem, Way("right", whole=w)).gradient(x) for w in (True, False)
    ]
    one, two = (evaluation.gradient["rod"] for evaluation in evaluations if evaluation.gradient)
    np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-12 * np.abs(one).max(initial=0.0))
    response = problem.response(problem.value(x))
    with pytest.raises(ValueError, match=r"by the velocity must have shape \(201, 2\)"):
        marker_derivatives(response, "rod", "tip", velocity=np.zeros(2))


@pytest.mark.mpi
@pytest.mark.parametrize("part", ["trajectory", "integrals"])
def test_derivatives_that_differ_between_ranks(comm: MPI.Intracomm, part: str) -> None:
    class Differing(Way):
        def derivatives(self, response: ffr.Response) -> ffr.Derivatives:
            computed = super().derivatives(response)
            share = 1.0 + 1e-3 * comm.rank
            if part == "trajectory" and computed.trajectory is not None:
                return replace(computed, trajectory=computed.trajectory.scaled(share))
            scaled = {
                name: bar.scaled(1.0 + 1e-4 * comm.rank) for name, bar in computed.integrals.items()
            }
            return replace(computed, integrals=scaled)

    problem = with_objective(swing_about_a_point(comm, 60), Differing("tip", whole=True))
    value = problem.value(np.full(problem.flexible["rod"].domain.n_cells, 0.7))
    if comm.size == 1:
        problem.differentiate(value)
        return
    with pytest.raises(
        ValueError, match=rf"the derivative of the objective by .*{part[:6]}.*differs"
    ):
        problem.differentiate(value)
