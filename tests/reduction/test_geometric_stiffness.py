# SPDX-License-Identifier: MIT
"""Geometric stiffness: a rotating beam's frequencies, buckling loads, foreshortening, gradients."""

from __future__ import annotations

import math

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose

import dolfinx_ffr as ffr
from dolfinx_ffr.verification import assert_taylor_order, taylor_test

LENGTH, HEIGHT = 1.0, 0.01
STEEL = ffr.PlaneStress(young=210e9, poisson=0.0, density=7850.0, thickness=0.02)
BENDING = STEEL.young * STEEL.thickness * HEIGHT**3 / 12.0
PER_LENGTH = STEEL.density * STEEL.thickness * HEIGHT


def cantilever(
    comm: MPI.Intracomm, elements: tuple[int, int] = (40, 1), **options: object
) -> ffr.FlexibleBody:
    """A slender beam, held at its left end by the frame."""
    domain = ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=elements, order=2, solid_columns=0)
    return ffr.FlexibleBody(
        domain,
        STEEL,
        frame=ffr.TangentFrame("left"),
        modes=6,
        **options,  # type: ignore[arg-type]
    )


@pytest.mark.mpi
@pytest.mark.parametrize(("speed", "flap"), [(1.0, 3.6816), (2.0, 4.1373), (10.0, 11.2023)])
def test_rotating_beam(comm: MPI.Intracomm, speed: float, flap: float) -> None:
    """Flapping frequencies of a beam rotating about its clamped end.

    Dimensionless, A. D. Wright et al., Journal of Applied Mechanics 49 (1982),
    doi:10.1115/1.3161966.
    """
    body = cantilever(comm, stiffening=["omega2"])
    integrals = body.reduce(np.ones(body.domain.n_cells)).integrals
    scale = math.sqrt(BENDING / (PER_LENGTH * LENGTH**4))
    omega = speed * scale
    K = integrals.K + omega**2 * integrals.stiffening["omega2"]
    lowest = scipy.linalg.eigh(K, integrals.G[1:, 1:], eigvals_only=True)[0]
    # slender: shear and rotatory inertia change less than 1e-3
    assert math.sqrt(lowest) / scale == pytest.approx(flap, rel=1e-3)


@pytest.mark.mpi
def test_column_under_its_own_weight(comm: MPI.Intracomm) -> None:
    """Buckling of a standing column under gravity, g rho A L^3 / EI = 7.8373 (Greenhill 1881)."""
    body = cantilever(comm, stiffening=["acceleration"])
    integrals = body.reduce(np.ones(body.domain.n_cells)).integrals
    # the frame's acceleration less gravity, along the column's axis
    stiffening = integrals.stiffening["acceleration"][0]
    factors = scipy.linalg.eigh(stiffening, integrals.K, eigvals_only=True)
    critical = 1.0 / max(-factors)
    assert critical * PER_LENGTH * LENGTH**3 / BENDING == pytest.approx(7.8373, rel=1e-3)
    # hanging it gets stiffer by as much
    assert np.all(factors < 1e-6 * max(-factors))


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("frame", "factor"), [(ffr.ChordFrame("left", "right"), 1.0), (ffr.TangentFrame("left"), 0.25)]
)
def test_load_of_euler(comm: MPI.Intracomm, frame: ffr.ChordFrame, factor: float) -> None:
    """Buckling under a force at the end: pinned pi^2 E I / L^2, clamped at one end a quarter."""
    domain = ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=(40, 1), order=2, solid_columns=0)
    body = ffr.FlexibleBody(domain, STEEL, frame=frame, modes=6, stiffening=["markers"])
    integrals = body.reduce(np.ones(domain.n_cells)).integrals
    assert integrals.stiffening == {}
    assert integrals.markers["left"].stiffening is None  # a force there stresses nothing
    stiffening = integrals.markers["right"].stiffening
    assert stiffening is not None
    factors = scipy.linalg.eigh(stiffening[0], integrals.K, eigvals_only=True)
    assert 1.0 / max(factors) == pytest.approx(factor * math.pi**2 * BENDING / LENGTH**2, rel=5e-4)


@pytest.mark.mpi
def test_a_bent_beam_is_shorter(comm: MPI.Intracomm) -> None:
    """The end of a clamped beam under a transverse force moves by -1/2 int w'^2 = -3/5 w^2 / L."""
    body = cantilever(comm, stiffening=["markers"], markers={"half": (0.5 * LENGTH, 0.0)})
    integrals = body.reduce(np.ones(body.domain.n_cells)).integrals
    end, half = integrals.markers["right"], integrals.markers["half"]
    q = np.linalg.solve(integrals.K, end.displacement.T @ [0.0, 1.0])
    w = float(end.displacement[1] @ q)
    assert end.shift(q)[0] == pytest.approx(-0.6 * w**2 / LENGTH, rel=1e-3)
    # w = W (3 x^2 - x^3) / 2, and 1/2 int w'^2 from 0 to 1/2 in these units
    share = 9.0 / 8.0 * (4.0 / 24.0 - 1.0 / 16.0 + 1.0 / 160.0)
    assert half.shift(q)[0] == pytest.approx(-share * w**2 / LENGTH, rel=1e-3)


@pytest.mark.mpi
def test_angular_acceleration_bends_and_stiffens_nothing_at_once(comm: MPI.Intracomm) -> None:
    """Its load is transverse: a straight beam gets no axial force, bending modes no stiffness."""
    body = cantilever(comm, stiffening=["omega2", "alpha"])
    integrals = body.reduce(np.ones(body.domain.n_cells)).integrals
    gram = integrals.G[1:, 1:]
    spun, swung = (
        np.abs(scipy.linalg.eigh(integrals.stiffening[load], gram, eigvals_only=True)).max()
        for load in ("omega2", "alpha")
    )
    shapes = scipy.linalg.eigh(integrals.K, gram)[1][:, :2]
    assert_allclose(
        shapes.T @ integrals.stiffening["alpha"] @ shapes, 0.0, atol=1e-6 * max(spun, swung)
    )


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize("loads", [["omega2"], ["omega2", "alpha", "acceleration"], ["markers"]])
@pytest.mark.parametrize("frame", [ffr.TangentFrame("left"), ffr.ChordFrame("left", "right")])
def test_pullback(comm: MPI.Intracomm, frame: ffr.TangentFrame, loads: list[str]) -> None:
    """A compliance with geometric stiffness: Taylor order 2."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(16, 4))
    body = ffr.FlexibleBody(
        domain,
        ffr.PlaneStress(2e9, 0.3, 1000.0, 0.01),
        frame=frame,
        modes=4,
        stiffening=loads,
        markers={"corner": (0.31, 0.013)},
    )
    c = domain.centroids
    density = 0.6 + 0.3 * np.sin(60 * c[:, 0] + 100 * c[:, 1])
    direction = np.cos(80 * c[:, 0] - 150 * c[:, 1])
    # of about the size of the elastic stiffness, and neither load nor sum of loads singular
    weights = {"omega2": 3e5, "alpha": 1e5, "acceleration": np.array([2e4, -1e4])[:, None, None]}
    forces = {"right": np.array([40.0, 10.0]), "corner": np.array([-10.0, 60.0])}
    load = np.array([0.3, 1.0])

    def stiff(integrals: ffr.VolumeIntegrals) -> np.ndarray:
        K = integrals.K.copy()
        for name, part in integrals.stiffening.items():
            term = weights[name] * part
            K += term if term.ndim == 2 else term.sum(axis=0)
        for name, force in forces.items():
            stiffening = integrals.markers[name].stiffening
            if stiffening is not None:
                K += np.tensordot(force, stiffening, 1)
        return K

    def value(x: np.ndarray) -> float:
        integrals = body.reduce(x).integrals
        force = integrals.S[1:] @ load
        return float(force @ np.linalg.solve(stiff(integrals), force))

    reduced = body.reduce(density)
    assert set(reduced.integrals.stiffening) == set(loads) - {"markers"}
    q = np.linalg.solve(stiff(reduced.integrals), reduced.integrals.S[1:] @ load)
    bar = reduced.integrals.zeros_like()
    bar.S[1:] = 2.0 * np.outer(q, load)
    bar.K[:] = -np.outer(q, q)
    for name in bar.stiffening:
        bar.stiffening[name][:] = -weights[name] * np.outer(q, q)
    for name, force in forces.items():
        stiffening = bar.markers[name].stiffening
        if stiffening is not None:
            stiffening[:] = -force[:, None, None] * np.outer(q, q)
    gradient, _ = body.pullback(reduced, bar)
    result = taylor_test(
        value,
        lambda d: comm.allreduce(float(gradient @ d)),
        density,
        direction,
        steps=[0.04, 0.02, 0.01, 0.005],
        roundoff=1e-11,
    )
    assert_taylor_order(result)


@pytest.mark.mpi
def test_same_on_any_number_of_ranks(comm: MPI.Intracomm) -> None:
    loads = ["omega2", "alpha", "acceleration", "markers"]
    found, alone = (cantilever(c, (16, 2), stiffening=loads) for c in (comm, MPI.COMM_SELF))
    many, one = (body.reduce(np.ones(body.domain.n_cells)).integrals for body in (found, alone))
    for name in ("right",):
        pulled, again = many.markers[name].stiffening, one.markers[name].stiffening
        assert pulled is not None
        assert again is not None
        assert_allclose(np.abs(pulled), np.abs(again), atol=1e-7 * np.abs(again).max())
    for load in loads[:-1]:
        # alpha puts next to no stress on a straight beam: omega2, of the same unit, sets its scale
        scale = np.abs(one.stiffening["omega2" if load == "alpha" else load]).max()
        # the signs of modes may differ
        assert_allclose(
            np.abs(many.stiffening[load]), np.abs(one.stiffening[load]), atol=1e-7 * scale
        )


@pytest.mark.mpi
def test_refusals(comm: MPI.Intracomm) -> None:
    with pytest.raises(ValueError, match=r"loads \['wind'\] must be some of \['omega2'"):
        cantilever(comm, (4, 1), stiffening=["wind"])


def lever(comm: MPI.Intracomm) -> tuple[ffr.Problem, np.ndarray]:
    """A driven beam with a mass at its end, which a spring and an oblique force load as well."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(12, 3))
    body = ffr.FlexibleBody(
        domain,
        ffr.PlaneStress(2e8, 0.3, 1000.0, 0.01),
        frame=ffr.ChordFrame("left", "right"),
        modes=2,
        stiffening=["omega2", "markers"],
        markers={"top": (0.2, 0.02)},
    )
    swing = ffr.Motion(
        lambda t: 1.2 * np.sin(9.0 * t),
        lambda t: 10.8 * np.cos(9.0 * t),
        lambda t: -97.2 * np.sin(9.0 * t),
    )
    mechanism = ffr.Mechanism(
        {"beam": ffr.Placement((0.0, 0.0), 0.0, (0.0, 0.0), 10.8)},
        [
            ffr.Revolute(("beam", "left"), ffr.Ground()),
            ffr.PrescribedAngle(("beam", "left"), swing),
        ],
        forces=[
            ffr.SpringDamper(("beam", "top"), ffr.Ground((0.2, -0.3)), 200.0, 1.0),
            ffr.Force(("beam", "right"), -20.0, 5.0, follower=True),
        ],
        point_masses=[ffr.PointMass(("beam", "right"), 0.1)],
    )
    objective = ffr.IntegralCompliance() + 1e-2 * ffr.PathTracking("beam", "right", (0.4, 0.0))
    problem = ffr.Problem({"beam": body}, mechanism, ffr.GeneralizedAlpha(0.2, 60), objective)
    c = domain.centroids
    return problem, 0.6 + 0.3 * np.sin(60 * c[:, 0] + 100 * c[:, 1])


@pytest.mark.mpi
def test_gradient_of_a_motion(comm: MPI.Intracomm) -> None:
    """From the densities to the motion under forces at markers and back: Taylor order 2."""
    problem, density = lever(comm)
    c = problem.flexible["beam"].domain.centroids
    gradient = problem.gradient(density).gradient
    assert gradient is not None
    result = taylor_test(
        lambda x: problem.value(x).psi,
        lambda d: comm.allreduce(float(gradient["beam"] @ d)),
        density,
        np.cos(80 * c[:, 0] - 150 * c[:, 1]),
        steps=[0.04, 0.02, 0.01, 0.005],
        roundoff=1e-11,
    )
    assert_taylor_order(result)


@pytest.mark.mpi
def test_given_arrays_move_as_the_mesh_does(comm: MPI.Intracomm) -> None:
    problem, density = lever(comm)
    found = problem.gradient(density)
    integrals = problem.integrals(found)
    given = ffr.MechanicalProblem(
        problem.mechanism,
        problem.integrator,
        ffr.IntegralCompliance() + 1e-2 * ffr.PathTracking("beam", "right", (0.4, 0.0)),
    ).gradient(integrals)
    assert given.psi == found.psi
    assert found.integrals_gradient is not None
    ours, theirs = given.integrals_gradient["beam"], found.integrals_gradient["beam"]
    for name in ("right", "top"):
        mine = ours.markers[name].stiffening
        assert mine is not None
        assert np.any(mine)
        np.testing.assert_array_equal(mine, theirs.markers[name].stiffening)
