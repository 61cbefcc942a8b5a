# SPDX-License-Identifier: MIT
"""Peak stress: closed forms, the same stress as `worst_stress`, exact gradients, calibration."""

from __future__ import annotations

import math

from mpi4py import MPI

import numpy as np
import pytest
from shared.meshes import star

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import StressRecovery
from dolfinx_ffr.objective import stress
from dolfinx_ffr.verification import assert_taylor_order, central_difference, taylor_test

pytestmark = pytest.mark.mpi

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
    domain = ffr.Domain.rectangle(
        comm, 0.4 * m, 0.04 * m, elements=(10, 3), cell=cell, order=order, solid_columns=1
    )
    plastic = law(5e9 * kg / m, 0.3, 1200.0 * kg / m**3, 0.01 * m)
    frame = ffr.ChordFrame("left", "right")
    body = ffr.FlexibleBody(domain, plastic, frame=frame, modes=3)
    crank = ffr.Moving.circle((0.0, 0.0), 0.1 * m, ffr.Motion.smooth_step(2.0 * math.pi, 0.2))
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(0.1 * m, 0.0))},
        joints=[
            ffr.Revolute(("rod", "left"), crank),
            ffr.PointOnLine(("rod", "right"), ffr.Ground()),
        ],
        point_masses=[ffr.PointMass(("rod", "right"), 0.2 * kg)],
        gravity=(0.0, -9.81 * m),
    )
    return ffr.Problem({"rod": body}, mechanism, integrator, objective, **options)  # type: ignore[arg-type]


def design(problem: ffr.Problem, metre: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """A density and a direction, functions of position alone."""
    x, y = metre * problem.flexible["rod"].domain.centroids.T
    return 0.7 + 0.2 * np.sin(60 * x + 90 * y), np.cos(50 * x + 70 * y)


def slope(problem: ffr.Problem, x: np.ndarray, direction: np.ndarray) -> float:
    gradient = problem.gradient(x).gradient
    assert gradient is not None
    return problem.flexible["rod"].domain.sum(gradient["rod"] * direction)


# ---------------------------------------------------------------------- values


@pytest.mark.parametrize("integrator", [FIXED, ADAPTIVE], ids=["generalised alpha", "Radau IIA"])
@pytest.mark.parametrize("order", [1, 2])
def test_a_bar_that_is_pulled(comm: MPI.Intracomm, order: int, integrator: ffr.Integrator) -> None:
    """Everywhere and always F / A, and x^(s - 3) of it in an even density, whatever the power."""
    domain = ffr.Domain.rectangle(comm, 1.0, 0.1, elements=(6, 2), order=order, solid_columns=0)
    soft = ffr.PlaneStress(2e9, 0.0, 1000.0, 0.02)
    body = ffr.FlexibleBody(domain, soft, frame=ffr.TangentFrame("left"), modes=2)
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
        x = np.full(domain.n_cells, 0.8)
        exact = pull * (1e-6 + (1.0 - 1e-6) * 0.8**3) ** -1 * 0.8**relaxation
        evaluation = problem.value(x)
        assert evaluation.psi == pytest.approx(scale * exact, rel=1e-6)
        assert objective.largest(problem.response(evaluation)) == pytest.approx(exact, rel=1e-6)


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
    modes = ffr.StressModes.of(
        body, evaluation.bodies["rod"], correction=correction, relaxation=0.5, void=0.0
    )
    z = modes.coordinates(evaluation.motion, "rod")
    fields = np.array([modes.von_mises(row) for row in z])
    # three points of equal weight in each triangle
    means = np.array([domain.sum(domain.cell_volumes * np.mean(f**8, axis=1)) for f in fields])
    weights = evaluation.motion.weights
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


def test_blocks_ranks_and_large_powers(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither how points are gone through nor the power of pascals makes a difference."""
    objective = ffr.PeakStress("rod", 64.0)
    found = []
    for group in (comm, MPI.COMM_SELF):
        problem = slider_crank(group, objective)
        x, direction = design(problem)
        found.append((problem.value(x).psi, slope(problem, x, direction)))
    monkeypatch.setattr(stress, "BLOCK", 1)
    found.append((problem.value(x).psi, slope(problem, x, direction)))
    assert np.all(np.isfinite(found)) and found[0][0] > 1e5
    np.testing.assert_allclose(found, [found[0]] * 3, rtol=1e-7)


def test_units_change_nothing(comm: MPI.Intracomm) -> None:
    """Millimetres and grams: the same number in other pascals, the same relative slope."""
    objective = ffr.PeakStress("rod")
    here = slider_crank(comm, objective)
    there = slider_crank(comm, objective, metre=1e-3, kilogram=1e-3)
    pascal = 1e3 / 1e3  # of kg / (m s^2) in g / (mm s^2)
    psi, slopes = [], []
    for problem, metre in ((here, 1.0), (there, 1e-3)):
        x, direction = design(problem, metre)
        psi.append(problem.value(x).psi)
        slopes.append(slope(problem, x, direction))
    assert psi[1] == pytest.approx(psi[0] * pascal, rel=1e-7)
    assert slopes[1] == pytest.approx(slopes[0] * pascal, rel=1e-6)


# ---------------------------------------------------------------------- gradients


@pytest.mark.parametrize(
    ("cell", "order", "law", "integrator", "objective"),
    [
        ("quadrilateral", 1, ffr.PlaneStress, FIXED, ffr.PeakStress("rod")),
        ("quadrilateral", 1, ffr.PlaneStrain, ADAPTIVE, ffr.PeakStress("rod", 9.0, 0.0, False)),
        ("quadrilateral", 2, ffr.PlaneStress, ADAPTIVE, ffr.PeakStress("rod", scale=1.7)),
        ("quadrilateral", 2, ffr.PlaneStrain, FIXED, ffr.PeakStress("rod", 12.0, 0.3)),
        ("triangle", 1, ffr.PlaneStress, FIXED, ffr.PeakStress("rod", 8.0, 1.0)),
        ("triangle", 2, ffr.PlaneStrain, ADAPTIVE, ffr.PeakStress("rod", correction=False)),
        (
            "triangle",
            1,
            ffr.PlaneStrain,
            FIXED,
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
    exact = slope(problem, x, direction)

    def value(step: np.ndarray) -> float:
        return problem.value(x + float(step) * direction).psi

    assert_taylor_order(
        taylor_test(
            value, lambda s: float(s) * exact, 0.0, 1.0, steps=[4e-3, 2e-3, 1e-3], roundoff=1e-12
        )
    )
    difference = central_difference(value, 0.0, 1.0, 2e-3)
    assert exact == pytest.approx(difference, rel=1e-7)
    bound = problem.gradient(x).constraints["bound"]
    assert bound.gradient is not None and bound.stress_gradient is None
    found = problem.flexible["rod"].domain.sum(bound.gradient["rod"] * direction)
    assert found == pytest.approx(exact / 1e6, rel=1e-7)


@pytest.mark.parametrize(
    ("cell", "order"),
    [("quadrilateral", 1), ("quadrilateral", 2), ("triangle", 1), ("triangle", 2), ("triangle", 3)],
)
def test_stress_recovery_and_its_transpose(comm: MPI.Intracomm, cell: str, order: int) -> None:
    """The areas of the points fill the cells; <S u, b> = <u, S^T b> over all ranks."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.1, elements=(6, 3), cell=cell, order=order)
    steel = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)
    body = ffr.FlexibleBody(domain, steel, frame=ffr.TangentFrame("left"), modes=1)
    recovery: StressRecovery = body.stress_recovery
    np.testing.assert_allclose(recovery.weights.sum(axis=1), domain.cell_volumes, rtol=1e-12)
    x = body.elasticity.coordinates()
    fields = 1e-3 * np.stack([np.sin(9 * x), np.cos(7 * x[:, ::-1])], axis=2).reshape(-1, 2)
    found = recovery(fields)
    points = recovery.points
    bar = np.stack([np.cos(8 * points[..., :1] + i) + 0 * points for i in range(3)], axis=2)
    back = recovery.transposed(bar)
    products = [domain.sum(found * bar), domain.sum(fields * back)]
    assert products[0] == pytest.approx(products[1], rel=1e-12)


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
    evaluation = problem.gradient(x)
    eigenvalues = evaluation.bodies["fan"].basis.eigenvalues.reshape(2, 3)
    np.testing.assert_allclose(eigenvalues[:, 2], eigenvalues[:, 0], rtol=1e-9)
    assert evaluation.gradient is not None
    direction = np.random.default_rng(3).standard_normal(domain.n_cells)
    exact = float(evaluation.gradient["fan"] @ direction)
    difference = central_difference(
        lambda step: problem.value(x + float(step) * direction).psi, 0.0, 1.0, 1e-3
    )
    assert exact == pytest.approx(difference, rel=1e-6)


def test_void_has_no_stress_and_no_derivative(comm: MPI.Intracomm) -> None:
    """Densities of zero, as in a void region, leave everything finite."""
    problem = slider_crank(comm, ffr.PeakStress("rod"))
    x, _ = design(problem)
    domain = problem.flexible["rod"].domain
    hole = np.abs(domain.centroids[:, 0] - 0.22) < 0.03
    empty = np.where(hole & (np.abs(domain.centroids[:, 1]) < 0.01), 0.0, x)
    evaluation = problem.gradient(empty)
    assert evaluation.gradient is not None
    assert np.all(np.isfinite(evaluation.gradient["rod"]))


# ---------------------------------------------------------------------- use


def test_calibrated_at_a_design(comm: MPI.Intracomm) -> None:
    """Objective, sum and constraint equal the largest stress there, and near to it elsewhere."""
    peak = ffr.PeakStress("rod")
    bound = ffr.Constraint(peak, upper=1e6, name="stress")
    problem = slider_crank(comm, 2.0 * peak + ffr.Volume("rod"), constraints=[bound])
    x, direction = design(problem)
    evaluation = problem.value(x)
    response = problem.response(evaluation)
    largest, volume = peak.largest(response), ffr.Volume("rod").evaluate(response)
    calibrated, told = problem.calibrated(evaluation)
    again = calibrated.value(x)
    for found in (told, again):
        assert found.psi == pytest.approx(2.0 * largest + volume, rel=1e-7)
        assert found.constraints["stress"].psi == pytest.approx(largest, rel=1e-7)
        assert found.constraints["stress"].value == pytest.approx(largest / 1e6 - 1.0, rel=1e-7)
    # once more changes nothing, and near to the design the ratio hardly changes
    twice = calibrated.calibrated(again)[0].constraints[0].objective
    assert isinstance(twice, ffr.PeakStress)
    assert twice.scale == pytest.approx(largest / peak.evaluate(response), rel=1e-7)
    near = calibrated.value(x + 1e-3 * direction)
    top = peak.largest(calibrated.response(near))
    assert near.constraints["stress"].psi == pytest.approx(top, rel=1e-2)
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
    more = problem.with_modes({"rod": 20}).value(x)
    assert error == pytest.approx(abs(evaluation.psi / more.psi - 1.0), rel=0.2)


def test_what_is_refused() -> None:
    problem = slider_crank(MPI.COMM_SELF, ffr.PeakStress("rod"))
    with pytest.raises(ValueError, match=r"stress of body 'bar', but the bodies .* \['rod'\]"):
        slider_crank(MPI.COMM_SELF, ffr.PeakStress("bar"))
    with pytest.raises(ValueError, match="must be above 1, or void has no derivative"):
        ffr.PeakStress("rod", 2.0, 0.5)
    with pytest.raises(ValueError, match="the power must be at least 2"):
        ffr.PeakStress("rod", 1.0)
    x, _ = design(problem)
    evaluation = problem.value(x)
    with pytest.raises(ValueError, match="element by element: derivatives of the stress"):
        ffr.elementwise_gradient(problem, evaluation, progress=False)
    mechanical = ffr.MechanicalProblem(problem.mechanism, FIXED, ffr.PeakStress("rod"))
    with pytest.raises(ValueError, match=r"bodies with a mesh and a density are \[\]"):
        mechanical.value(problem.integrals(evaluation))
