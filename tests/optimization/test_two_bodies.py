# SPDX-License-Identifier: MIT
"""Two flexible bodies on two meshes: one adjoint pass gives the gradients of both."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import four_bar
from shared.scenes import CRANK

import dolfinx_ffr as ffr
from dolfinx_ffr import mechanical_problem
from dolfinx_ffr.verification import assert_taylor_order, central_difference, taylor_test


def designs(problem: ffr.Problem) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Densities, and directions in which to move them, as functions of position alone."""
    centroids = {name: body.domain.centroids for name, body in problem.flexible.items()}
    x = {name: 0.7 + 0.2 * np.sin(60 * c[:, 0] + 90 * c[:, 1]) for name, c in centroids.items()}
    return x, {name: np.cos(50 * c[:, 0] + 70 * c[:, 1]) for name, c in centroids.items()}


def slope(comm: MPI.Comm, gradient: dict[str, np.ndarray], direction: dict[str, np.ndarray]):  # type: ignore[no-untyped-def]
    """Derivative in a direction, summed over bodies and ranks; only bodies with a direction."""
    return comm.allreduce(sum(float(gradient[name] @ d) for name, d in direction.items()))


@pytest.mark.mpi
def test_gradients_of_both_bodies_from_one_adjoint_pass(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    weights = {"coupler": 1.0, "rocker": 3.0}
    problem = four_bar(comm, ffr.IntegralCompliance(["coupler", "rocker"], weights))
    x, directions = designs(problem)
    calls = []
    adjoint = mechanical_problem.adjoint
    monkeypatch.setattr(mechanical_problem, "adjoint", lambda *a: calls.append(1) or adjoint(*a))
    evaluation = problem.gradient(x)
    assert len(calls) == 1
    assert evaluation.gradient is not None
    assert list(evaluation.gradient) == ["coupler", "rocker"]
    for moving in (["coupler"], ["rocker"], ["coupler", "rocker"]):
        direction = {name: directions[name] for name in moving}

        def value(step: np.ndarray, direction=direction) -> float:  # type: ignore[no-untyped-def]
            y = {name: x[name] + float(step) * d for name, d in direction.items()}
            return problem.value({**x, **y}).psi

        expected = slope(comm, evaluation.gradient, direction)
        assert expected == pytest.approx(central_difference(value, 0.0, 1.0, 2e-3), rel=1e-6)
        if len(moving) == 2:
            steps = [4e-3 / 2.0**k for k in range(4)]
            assert_taylor_order(
                taylor_test(value, lambda s, e=expected: float(s) * e, 0.0, 1.0, steps=steps)
            )


@pytest.mark.mpi
def test_weights_of_bodies_add_up(comm: MPI.Intracomm) -> None:
    """Psi and both gradients are linear in the weights."""
    results = {}
    for key, weights in (("coupler", (1, 0)), ("rocker", (0, 1)), ("both", (0.3, 2.0))):
        objective = ffr.IntegralCompliance(
            weights=dict(zip(("coupler", "rocker"), weights, strict=True))
        )
        problem = four_bar(comm, objective)
        x, directions = designs(problem)
        result = problem.gradient(x)
        assert result.gradient is not None
        results[key] = np.array([result.psi, slope(comm, result.gradient, directions)])
    expected = 0.3 * results["coupler"] + 2.0 * results["rocker"]
    np.testing.assert_allclose(results["both"], expected, rtol=1e-9)
    # Each matters: the rocker bends under the coupler's inertia.
    assert min(results["coupler"][0], results["rocker"][0]) > 0.01 * results["both"][0]


#: One of every kind; the first four need no motion.
CONSTRAINTS = [
    ffr.Constraint(ffr.Volume("coupler"), upper=0.5),
    ffr.Constraint(ffr.Mass("rocker"), upper=0.05),
    ffr.Constraint(ffr.Frequency("coupler"), lower=30.0, name="bending"),
    ffr.Constraint(ffr.Frequency("rocker", cluster=2, free=True), lower=30.0, name="free"),
    ffr.Constraint(ffr.PeakCompliance(power=6.0), upper=1e-3),
    ffr.Constraint(ffr.JointForce("coupler pin", power=6.0), upper=5.0),
    ffr.Constraint(ffr.MarkerAcceleration("rocker", "left"), upper=100.0),
    ffr.Constraint(
        ffr.PathTracking("coupler", "right", (lambda t: 0.2 + t, 0.3), (0.2, 0.25)), upper=1e-3
    ),
]


@pytest.mark.mpi
def test_constraints_from_the_same_simulation(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The gradient of every objective with respect to the densities of both bodies."""
    calls = {"simulate": 0, "adjoint": 0}
    originals = {name: getattr(mechanical_problem, name) for name in calls}
    for name in calls:

        def counted(*args, name=name):  # type: ignore[no-untyped-def]
            calls[name] += 1
            return originals[name](*args)

        monkeypatch.setattr(mechanical_problem, name, counted)
    problem = four_bar(comm, ffr.IntegralCompliance(), constraints=CONSTRAINTS)
    x, direction = designs(problem)
    result = problem.gradient(x)
    assert calls == {"simulate": 1, "adjoint": 5}
    assert list(result.constraints) == [constraint.label for constraint in CONSTRAINTS]

    def values(step: float) -> np.ndarray:
        moved = {name: x[name] + step * d for name, d in direction.items()}
        return np.array([g.value for g in problem.value(moved).constraints.values()])

    h = 5e-4
    coarse, fine = ((values(s) - values(-s)) / (2.0 * s) for s in (h, 0.5 * h))
    slopes = []
    for constraint in result.constraints.values():
        assert constraint.gradient is not None
        slopes.append(slope(comm, constraint.gradient, direction))
    np.testing.assert_allclose(slopes, (4.0 * fine - coarse) / 3.0, rtol=1e-6)
    volume = result.constraints["Volume"]
    assert volume.psi == result.volume["coupler"]
    assert volume.value == pytest.approx(volume.psi / 0.5 - 1.0, rel=1e-14)
    assert volume.gradient is not None
    assert not volume.gradient["rocker"].any()


@pytest.mark.mpi
def test_nothing_is_simulated_for_mass_and_frequency(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object) -> None:
        raise AssertionError("a simulation")

    monkeypatch.setattr(mechanical_problem, "simulate", refuse)
    monkeypatch.setattr(mechanical_problem, "adjoint", refuse)
    problem = four_bar(comm, ffr.Mass("coupler") + ffr.Mass("rocker"), constraints=CONSTRAINTS[:4])
    x, direction = designs(problem)
    result = problem.gradient(x)
    assert result.trajectory is None
    assert result.gradient is not None
    # With a linear mass law the derivative of the mass is the mass of the direction.
    areal = 1200.0 * 0.01
    expected = sum(
        body.domain.sum(body.domain.cell_volumes * direction[name]) * areal
        for name, body in problem.flexible.items()
    )
    assert slope(comm, result.gradient, direction) == pytest.approx(expected, rel=1e-10)
    with pytest.raises(ValueError, match="there is no motion: nothing was simulated"):
        _ = result.motion


def test_refused(comm: MPI.Intracomm) -> None:
    twice = [ffr.Constraint(ffr.Mass("coupler"), 1.0), ffr.Constraint(ffr.Mass("rocker"), 1.0)]
    with pytest.raises(ValueError, match="two constraints have the name 'Mass'"):
        four_bar(comm, ffr.IntegralCompliance(), constraints=twice)
    with pytest.raises(
        ValueError, match=r"volume of body 'crank', but the .*\['coupler', 'rocker'"
    ):
        four_bar(
            comm,
            ffr.IntegralCompliance(),
            constraints=[ffr.Constraint(ffr.Volume("crank"), upper=0.5)],
        )
    with pytest.raises(ValueError, match=r"volume of body 'crank', but the .* Mass is similar"):
        four_bar(comm, ffr.IntegralCompliance() + ffr.Volume("crank"))


@pytest.mark.mpi
def test_mechanism_from_files_is_the_same(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """Arrays saved from the reduced bodies give the same numbers without any mesh.

    Up to round-off: what LAPACK makes of the same numbers depends on where they lie in memory.
    """
    objective = ffr.IntegralCompliance() + 1e-4 * ffr.JointForce("coupler pin")
    constraints = [CONSTRAINTS[3], CONSTRAINTS[6]]
    problem = four_bar(comm, objective, constraints=constraints)
    result = problem.gradient(designs(problem)[0])
    assert result.integrals_gradient is not None
    if comm.rank == 0:
        for name, body in result.bodies.items():
            body.integrals.save(shared_tmp_path / f"{name}.npz")
    comm.Barrier()
    bodies = {
        name: ffr.VolumeIntegrals.load(shared_tmp_path / f"{name}.npz")
        if name in result.bodies
        else problem.bodies[name]
        for name in problem.bodies
    }
    given = ffr.MechanicalProblem(
        problem.mechanism, problem.integrator, objective, constraints
    ).gradient(bodies)
    assert given.psi == pytest.approx(result.psi, rel=1e-13)
    assert given.integrals_gradient is not None
    pairs = [(given.integrals_gradient, result.integrals_gradient)]
    for name, own in given.constraints.items():
        other = result.constraints[name]
        assert own.value == pytest.approx(other.value, rel=1e-13)
        assert own.integrals_gradient is not None
        assert other.integrals_gradient is not None
        pairs.append((own.integrals_gradient, other.integrals_gradient))
    for a, b in pairs:
        assert list(a) == list(b) == ["crank", "coupler", "rocker"]
        # of the crank, whose motion is prescribed, round-off of zero is left
        size = max(b[name].dot(b[name]) for name in b)
        for name in a:
            difference = a[name] + b[name].scaled(-1.0)
            assert difference.dot(difference) <= 1e-24 * size


def test_parameters_of_a_given_body_beside_a_mesh(comm: MPI.Intracomm) -> None:
    """The chain goes on from the integrals' derivative: the mass of the rigid crank."""

    def crank(p: np.ndarray) -> ffr.VolumeIntegrals:
        return ffr.VolumeIntegrals.rigid(
            p[0], (0.05, 0.0), 3e-4, {"left": (0.0, 0.0), "right": (CRANK, 0.0)}
        )

    zero = crank(np.ones(1)).zeros_like()
    by_mass = replace(zero, mass=1.0, S=np.array([[0.05, 0.0]]), G=np.array([[0.05**2]]))
    body = ffr.ParametricBody(crank, lambda p: [by_mass])
    problem = four_bar(comm, ffr.JointForce("motor bearing"))
    x = designs(problem)[0]

    def value(p: np.ndarray) -> float:
        problem.bodies["crank"] = body(p)
        return problem.value(x).psi

    p, direction = np.array([0.2]), np.array([0.05])
    difference = central_difference(value, p, direction, 0.1)
    problem.bodies["crank"] = body(p)
    gradient = problem.gradient(x).integrals_gradient
    assert gradient is not None
    assert body.pullback(p, gradient["crank"]) @ direction == pytest.approx(difference, rel=1e-6)
