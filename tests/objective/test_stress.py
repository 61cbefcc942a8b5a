# SPDX-License-Identifier: MIT
"""Peak stress: closed forms, the same stress as `worst_stress`, exact gradients, calibration."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shared.derivatives import check_gradient
from shared.meshes import star
from shared.rods import HELD, rod
from shared.scenes import slider_crank_mechanism
from slider_crank import reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.objective import stress, stress_mean, von_mises_root

FIXED = ffr.GeneralizedAlpha(0.2, 80)
ADAPTIVE = ffr.RadauIIA(0.2, steps=16)


def slider_crank(
    comm: MPI.Intracomm,
    objective: ffr.Objective,
    *,
    integrator: ffr.Integrator = FIXED,
    law: type = ffr.PlaneStress,
    cell: str = "quadrilateral",
    order: int = 1,
    metre: float = 1.0,
    kilogram: float = 1.0,
    **options: object,
) -> ffr.Problem:
    """A soft rod between a crank that speeds up and a slider, in units of which these make SI."""
    m, kg = 1.0 / metre, 1.0 / kilogram
    plastic = law(5e9 * kg / m, 0.3, 1200.0 * kg / m**3, 0.01 * m)
    mesh = {"cell": cell, "order": order, "solid_columns": 1}
    body = rod(comm, (10, 3), (0.4 * m, 0.04 * m), plastic, **mesh)
    sizes = {"crank": 0.1 * m, "rod": 0.4 * m, "slider": 0.2 * kg, "origin": 0.0}
    turn = ffr.Motion.smooth_step(2.0 * math.pi, 0.2)
    mechanism = slider_crank_mechanism(turn, **sizes, gravity=(0.0, -9.81 * m))
    return ffr.Problem({"rod": body}, mechanism, integrator, objective, **options)  # type: ignore[arg-type]


def design(problem: ffr.Problem, metre: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """A density and a direction, functions of position alone."""
    x, y = metre * problem.flexible["rod"].domain.centroids.T
    return 0.7 + 0.2 * np.sin(60 * x + 90 * y), np.cos(50 * x + 70 * y)


@pytest.mark.parametrize("integrator", [FIXED, ADAPTIVE], ids=["generalised alpha", "Radau IIA"])
@pytest.mark.parametrize("order", [1, 2])
def test_a_bar_that_is_pulled(comm: MPI.Intracomm, order: int, integrator: ffr.Integrator) -> None:
    """Everywhere and always F / A, and x^(s - 3) of it in an even density, whatever the power."""
    soft = ffr.PlaneStress(2e9, 0.0, 1000.0, 0.02)
    settings = {"order": order, "solid_columns": 0, "frame": HELD, "modes": 2}
    body = rod(comm, (6, 2), (1.0, 0.1), soft, **settings)
    mechanism = ffr.Mechanism(
        {"bar": ffr.Placement()},
        [ffr.Weld(("bar", "left"), ffr.Ground())],
        forces=[ffr.Force(("bar", "right"), 4e3)],
        start=ffr.StaticEquilibrium(),
    )
    pull = 4e3 / (0.1 * 0.02)
    for power, relaxation, scale in ((2.0, 0.0, 1.0), (8.0, 0.5, 1.0), (9.5, 1.5, 2.0)):
        objective = ffr.PeakStress("bar", power, relaxation, scale=scale)
        problem = ffr.Problem({"bar": body}, mechanism, integrator, objective)
        x = np.full(body.domain.n_cells, 0.8)
        exact = pull * (1e-6 + (1.0 - 1e-6) * 0.8**3) ** -1 * 0.8**relaxation
        evaluation = problem.value(x)
        assert evaluation.psi == pytest.approx(scale * exact, rel=1e-6)
        assert objective.largest(problem.response(evaluation)) == pytest.approx(exact, rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize("correction", [True, False], ids=["corrected", "plain"])
@pytest.mark.parametrize("integrator", [FIXED, ADAPTIVE], ids=["generalised alpha", "Radau IIA"])
def test_the_mean_of_the_stress_that_is_reported(
    comm: MPI.Intracomm, integrator: ffr.Integrator, correction: bool
) -> None:
    """Point by point and instant by instant it is that of `StressModes` and `worst_stress`."""
    objective = ffr.PeakStress("rod", 8.0, 0.5, correction)
    problem = slider_crank(
        comm, objective, integrator=integrator, law=ffr.PlaneStrain, cell="triangle", order=2
    )
    x, _ = design(problem)
    evaluation = problem.value(x)
    body, domain = problem.flexible["rod"], problem.flexible["rod"].domain
    modes = ffr.postprocessing.StressModes.of(
        body, evaluation.bodies["rod"], correction=correction, relaxation=0.5, void=0.0
    )
    z = modes.coordinates(evaluation.trajectory, "rod")
    fields = np.array([modes.von_mises(row) for row in z])
    # three points of equal weight in each triangle
    means = np.array([domain.sum(domain.cell_volumes * np.mean(f**8, axis=1)) for f in fields])
    weights = evaluation.trajectory.weights
    if weights is None:
        weights = np.full(len(z), 0.2 / 80)
        weights[[0, -1]] *= 0.5
    exact = (weights @ means / domain.area / 0.2) ** (1 / 8)
    assert evaluation.psi == pytest.approx(exact, rel=1e-12)
    worst = ffr.worst_stress(
        body, evaluation, "rod", correction=correction, relaxation=0.5, void=0.0
    )
    largest = objective.largest(problem.response(evaluation))
    assert largest == pytest.approx(worst.largest, rel=1e-12)
    assert 0.2 * largest < evaluation.psi < largest


def test_stress_clear_of_interfaces_and_in_ranges(comm: MPI.Intracomm) -> None:
    """What is beside an interface does not count, and the largest of the ranges is that of all."""
    peak = ffr.PeakStress("rod")
    problem = slider_crank(comm, peak, cell="triangle", order=2)
    x, direction = design(problem)
    evaluation = problem.value(x)
    response, largest = problem.response(evaluation), peak.largest(problem.response(evaluation))
    settings: dict[str, Any] = {"relaxation": 0.5, "void": 0.0}
    body = problem.flexible["rod"]
    every, kept = (
        ffr.postprocessing.StressModes.of(body, evaluation.bodies["rod"], clear=clear, **settings)
        for clear in (0.0, 0.1)
    )
    beside = np.minimum(every.points[..., 0], 0.4 - every.points[..., 0]) < 0.1
    assert np.all(kept.values[beside] == 0.0)
    np.testing.assert_array_equal(kept.values[~beside], every.values[~beside])
    for clear in (0.0, 0.1, 0.19):
        reported = ffr.worst_stress(body, evaluation, "rod", clear=clear, **settings).largest
        assert replace(peak, clear=clear).largest(response) == pytest.approx(reported, rel=1e-12)
    assert replace(peak, clear=0.21).evaluate(response) == 0.0
    ranges = peak.parts(response)
    values = [part.evaluate(response) for part in ranges]
    assert len(values) == 3 and max(values) == pytest.approx(largest, rel=1e-12)
    for value, low, high in zip(values, stress.LEVELS, (0.9, 0.97, 1.0), strict=True):
        assert low * largest <= value <= high * largest * (1.0 + 1e-12)
    limit = ffr.Constraint(peak, upper=1e6, name="limit").parts(response)
    assert [part.label for part in limit] == [f"limit, part {k}" for k in (1, 2, 3)]
    middle = slider_crank(comm, ranges[1], cell="triangle", order=2)
    check_gradient(middle, {"rod": x}, {"rod": direction}, step=2e-3, rel=1e-5)


@pytest.mark.mpi
def test_places_fill_the_body(comm: MPI.Intracomm) -> None:
    """The largest stress of all is that of the worst place; on another design they are as well."""
    peak = ffr.PeakStress("rod")
    problem = slider_crank(comm, peak)
    x, direction = design(problem)
    response = problem.response(problem.value(x))
    places = peak.places(response)
    assert len(places) == stress.PLACES
    problem_here = slider_crank(comm, places[2])
    check_gradient(problem_here, {"rod": x}, {"rod": direction}, step=2e-3, rel=1e-5)
    values = [place.evaluate(response) for place in places]
    assert max(values) == pytest.approx(peak.largest(response), rel=1e-12)

    # each value is scale * mean; the powers of the means add up to that of all
    powers = [(v / place.scale) ** peak.power for v, place in zip(values, places, strict=True)]
    assert sum(powers) == pytest.approx(peak.evaluate(response) ** peak.power, rel=1e-10)
    assert min(powers) > 0.0
    assert len(set(comm.allgather(tuple(place.box for place in places)))) == 1

    limit = ffr.Constraint(peak, upper=1e6, name="limit")
    assert [each.label for each in limit.places(response)][:2] == [
        "limit, place 1",
        "limit, place 2",
    ]
    other = problem.response(problem.value(np.clip(x + 0.2 * direction, 0.1, 1.0)))
    again = max(place.calibrated(other).evaluate(other) for place in places)
    assert again == pytest.approx(peak.largest(other), rel=1e-12)


@pytest.mark.mpi
@pytest.mark.parametrize("power", [8.0, 64.0])
def test_blocks_ranks_units_and_large_powers(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch, power: float
) -> None:
    """Neither how points are gone through nor the power of pascals makes a difference.

    Nor do millimetres and grams, in which the pascal is the same.
    """
    objective, computed = ffr.PeakStress("rod", power), []
    for group, unit, tile in ((comm, 1.0, None), (comm, 1e-3, None), (MPI.COMM_SELF, 1.0, 7)):
        if tile:
            monkeypatch.setattr(stress_mean, "POINTS", tile)
        problem = slider_crank(group, objective, metre=unit, kilogram=unit)
        x, direction = design(problem, unit)
        gradient = problem.gradient(x).gradient
        assert gradient is not None
        slope = problem.flexible["rod"].domain.sum(gradient["rod"] * direction)
        computed.append((problem.value(x).psi, slope))
    assert np.all(np.isfinite(computed)) and computed[0][0] > 1e5
    np.testing.assert_allclose(computed, [computed[0]] * 3, rtol=1e-7)


@pytest.mark.mpi
def test_instants_that_tell_of_others(comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of short steps few instants are gone through; all numbers are the same, cell by cell."""
    objective, computed = ffr.PeakStress("rod"), []
    given = reference_problem(comm, (20, 4), steps=2000, modes=2)
    problem = ffr.Problem(given.bodies, given.mechanism, given.integrator, objective)
    for smooth in (stress_mean.SMOOTH, -1.0):
        monkeypatch.setattr(stress_mean, "SMOOTH", smooth)
        evaluation = problem.gradient(np.ones(len(design(problem)[0])))
        response = problem.response(evaluation)
        spans = objective._mean(response).spans
        thinned = [len(each.shares) / (each.instants.stop - each.instants.start) for each in spans]
        assert np.mean(thinned) < 0.6 if smooth > 0.0 else thinned == [1.0] * len(thinned)
        computed.append((evaluation.psi, objective.largest(response), evaluation.gradient["rod"]))  # type: ignore[index]
    (*of_few, slopes_of_few), (*of_all, slopes) = computed
    assert of_few == pytest.approx(of_all, rel=1e-11)
    assert np.sum(np.abs(slopes_of_few - slopes)) <= 1e-10 * np.sum(np.abs(slopes))


PLAIN = ffr.PeakStress("rod", correction=False)


@pytest.mark.parametrize(
    ("cell", "order", "law", "integrator", "objective"),
    [
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("quadrilateral", 2, ffr.PlaneStrain, FIXED, ffr.PeakStress("rod", 12.0, 0.3)),
                ("triangle", 3, ffr.PlaneStress, FIXED, PLAIN),
            )
        ),
        ("quadrilateral", 1, ffr.PlaneStress, FIXED, ffr.PeakStress("rod")),
        ("quadrilateral", 2, ffr.PlaneStress, ADAPTIVE, ffr.PeakStress("rod", scale=1.7)),
        ("triangle", 1, ffr.PlaneStress, FIXED, ffr.PeakStress("rod", 8.0, 1.0)),
        (
            *("triangle", 1, ffr.PlaneStrain, FIXED),
            2.0 * ffr.PeakStress("rod")
            + 1e8 * ffr.IntegralCompliance()
            + 3.0 * ffr.PeakStress("rod", correction=False),
        ),
    ],
)
def test_exact_gradient(
    comm: MPI.Intracomm,
    cell: str,
    order: int,
    law: type,
    integrator: ffr.Integrator,
    objective: ffr.Objective,
) -> None:
    """Taylor's order, and central differences; as a constraint and beside another objective."""
    problem = slider_crank(
        comm,
        objective,
        integrator=integrator,
        law=law,
        cell=cell,
        order=order,
        constraints=[ffr.Constraint(objective, upper=1e6, name="bound")],
    )
    x, direction = design(problem)
    body = problem.flexible["rod"]
    areas = body.stress_recovery.weights.sum(axis=1)
    np.testing.assert_allclose(areas, body.domain.cell_volumes, rtol=1e-12)
    check_gradient(problem, {"rod": x}, {"rod": direction}, taylor=4e-3, step=2e-3, rel=1e-7)
    evaluation = problem.gradient(x)
    bound = evaluation.constraints["bound"]
    assert bound.gradient is not None and bound.derivatives is not None
    assert not bound.derivatives.stresses
    computed, exact = (
        body.domain.sum(each.gradient["rod"] * direction) for each in (bound, evaluation)
    )
    assert computed == pytest.approx(exact / 1e6, rel=1e-7)


@pytest.mark.parametrize("correction", [True, False], ids=["corrected", "plain"])
def test_exact_gradient_at_equal_eigenvalues(correction: bool) -> None:
    """Three alike blades: each frequency comes three times, with any basis of its three modes."""
    domain = star(MPI.COMM_SELF, 3, nx=6)
    plastic = ffr.PlaneStress(5e9, 0.3, 1200.0, 0.01)
    body = ffr.FlexibleBody(domain, plastic, frame=ffr.TangentFrame("hub"), modes=6)
    swing = ffr.Motion.smooth_step(1.0, 0.1)
    shaft = ffr.Moving(ffr.Motion.constant(0.0), ffr.Motion.constant(0.0), swing)
    mechanism = ffr.Mechanism({"fan": ffr.Placement()}, [ffr.Weld(("fan", "hub"), shaft)])
    objective = ffr.PeakStress("fan", correction=correction)
    problem = ffr.Problem({"fan": body}, mechanism, ffr.GeneralizedAlpha(0.1, 100), objective)
    x = np.full(domain.n_cells, 0.7)
    eigenvalues = problem.value(x).bodies["fan"].basis.eigenvalues.reshape(2, 3)
    np.testing.assert_allclose(eigenvalues[:, 2], eigenvalues[:, 0], rtol=1e-9)
    direction = np.random.default_rng(3).standard_normal(domain.n_cells)
    check_gradient(problem, {"fan": x}, {"fan": direction}, step=1e-3)


@pytest.mark.mpi
def test_void_has_no_stress_and_no_derivative(comm: MPI.Intracomm) -> None:
    """Densities of zero, as in a void region, leave everything finite."""
    problem = slider_crank(comm, ffr.PeakStress("rod"))
    c = problem.flexible["rod"].domain.centroids
    hole = (np.abs(c[:, 0] - 0.22) < 0.03) & (np.abs(c[:, 1]) < 0.01)
    gradient = problem.gradient(np.where(hole, 0.0, design(problem)[0])).gradient
    assert gradient is not None and np.all(np.isfinite(gradient["rod"]))


def test_calibrated_at_a_design(comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Objective, sum and constraint equal the largest stress there, and near to it elsewhere."""
    peak = ffr.PeakStress("rod")
    bound = ffr.Constraint(peak, upper=1e6, name="stress")
    problem = slider_crank(comm, 2.0 * peak + ffr.Volume("rod"), constraints=[bound])
    x, direction = design(problem)
    evaluation = problem.value(x)
    response = problem.response(evaluation)
    largest, volume = peak.largest(response), ffr.Volume("rod").evaluate(response)
    with monkeypatch.context() as known:  # no mean over points and instants is taken twice
        known.delattr(stress_mean.Stresses, "mean")
        calibrated, reported = problem.calibrated(evaluation)
        calibrated.differentiate(reported)
    assert response.cache and not replace(response, bodies=response.bodies).cache
    again = calibrated.value(x)
    for computed in (reported, again):
        assert computed.psi == pytest.approx(2.0 * largest + volume, rel=1e-7)
        assert computed.constraints["stress"].value == pytest.approx(largest, rel=1e-7)
        assert computed.constraints["stress"].violation == pytest.approx(
            largest / 1e6 - 1.0, rel=1e-7
        )
    # once more changes nothing, and near to the design the ratio hardly changes
    twice = calibrated.calibrated(again)[0].constraints[0].objective
    assert isinstance(twice, ffr.PeakStress)
    assert twice.scale == pytest.approx(largest / peak.evaluate(response), rel=1e-7)
    moved = calibrated.value(x + 1e-3 * direction)
    top = peak.largest(calibrated.response(moved))
    assert moved.constraints["stress"].value == pytest.approx(top, rel=1e-2)
    # nothing to be done is nothing done
    plain = slider_crank(comm, ffr.IntegralCompliance() + ffr.Volume("rod"))
    value = plain.value(x)
    assert plain.calibrated(value) == (plain, value)


def test_model_report_takes_the_stress_of_residual_modes() -> None:
    """What the modes left out add to psi, stress modes of their own included."""
    problem = slider_crank(MPI.COMM_SELF, ffr.PeakStress("rod", correction=False))
    x, _ = design(problem)
    evaluation = problem.value(x)
    error = ffr.model_report(problem, evaluation).modes_error
    with_more_modes = problem.with_modes({"rod": 20}).value(x)
    assert error == pytest.approx(abs(evaluation.psi / with_more_modes.psi - 1.0), rel=0.2)


def test_what_is_refused() -> None:
    problem = slider_crank(MPI.COMM_SELF, ffr.PeakStress("rod"))
    evaluation = problem.value(design(problem)[0])
    alone = ffr.MechanicalProblem(problem.mechanism, FIXED, problem.objective)
    with pytest.raises(ValueError, match=r"stress of body 'bar', but the bodies .* \['rod'\]"):
        slider_crank(MPI.COMM_SELF, ffr.PeakStress("bar"))
    with pytest.raises(ValueError, match="must be above 1, or void has no derivative"):
        ffr.PeakStress("rod", 2.0, 0.5)
    with pytest.raises(ValueError, match="the power must be at least 2"):
        ffr.PeakStress("rod", 1.0)
    with pytest.raises(ValueError, match="element by element: derivatives of the stress"):
        ffr.paper.elementwise_gradient(problem, evaluation, progress=False)
    with pytest.raises(ValueError, match=r"bodies with a mesh and a density are \[\]"):
        alone.value(problem.integrals(evaluation))


def test_von_mises_stress_in_space() -> None:
    """The length of six numbers; in the plane it is that of three."""
    rng = np.random.default_rng(0)
    stress = rng.standard_normal(6)
    sx, sy, sz, txy, tyz, txz = stress
    exact = sx**2 + sy**2 + sz**2 - sx * sy - sy * sz - sz * sx + 3 * (txy**2 + tyz**2 + txz**2)
    assert np.sum((von_mises_root(0.0, 6) @ stress) ** 2) == pytest.approx(exact, rel=1e-13)
    flat = np.array([sx, sy, 0.3 * (sx + sy), txy, 0.0, 0.0])
    plane = von_mises_root(0.3) @ [sx, sy, txy]
    assert_allclose(np.linalg.norm(von_mises_root(0.0, 6) @ flat), np.linalg.norm(plane))


def arm(comm: MPI.Intracomm, modes: int) -> ffr.Problem:
    """A short arm that is started askew about its end, and held there."""
    soft = ffr.Isotropic(young=2e8, poisson=0.3, density=1200.0)
    settings = {"solid_layers": 0, "frame": HELD, "modes": modes}
    rest_motion, turn = ffr.Motion.constant(0.0), ffr.Motion.smooth_step(2.0, 0.1)
    shaft = ffr.Moving(rest_motion, rest_motion, turn, z=rest_motion, axis=(0.2, 0.5, 1.0))
    mechanism = ffr.Mechanism(
        {"arm": ffr.Placement((0.0, 0.0, 0.0))},
        [ffr.Weld(("arm", "left"), shaft)],
        gravity=(0.0, 0.0, -9.81),
    )
    body = rod(comm, (5, 2, 1), (0.3, 0.06, 0.04), soft, **settings)
    steps = ffr.GeneralizedAlpha(0.1, 60)
    return ffr.Problem({"arm": body}, mechanism, steps, ffr.PeakStress("arm", 4.0))


def test_stress_follows_the_modes_left_out(comm: MPI.Intracomm) -> None:
    """With two modes the corrected stress is near that of many, and its gradient is exact."""
    problem, many = arm(comm, 2), arm(comm, 30)
    domain = problem.flexible["arm"].domain
    x = 0.7 + 0.3 * np.sin(40.0 * domain.centroids @ [1.0, 2.0, 3.0])
    exact = ffr.worst_stress(many.flexible["arm"], many.value(x), "arm")
    evaluation = problem.value(x)
    plain, corrected = (
        ffr.worst_stress(problem.flexible["arm"], evaluation, "arm", correction=correction)
        for correction in (False, True)
    )
    errors = [
        comm.allreduce(np.max(np.abs(computed.stress - exact.stress), initial=0.0), MPI.MAX)
        / exact.largest
        for computed in (plain, corrected)
    ]
    assert errors[1] < 2e-3 and errors[1] < 0.05 * errors[0]
    check_gradient(problem, {"arm": x}, step=1e-4)
