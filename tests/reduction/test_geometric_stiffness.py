# SPDX-License-Identifier: MIT
"""Geometric stiffness: a rotating beam's frequencies, buckling loads, foreshortening, gradients."""

from __future__ import annotations

import math
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from shared.derivatives import check_gradient
from shared.rods import CHORD, HELD, rod, solid
from shared.scenes import swing

import dolfinx_ffr as ffr

pytestmark = pytest.mark.mpi

LENGTH, HEIGHT = 1.0, 0.01
STEEL = ffr.PlaneStress(young=210e9, poisson=0.0, density=7850.0, thickness=0.02)
BENDING = STEEL.young * STEEL.thickness * HEIGHT**3 / 12.0
PER_LENGTH = STEEL.density * STEEL.thickness * HEIGHT


def slender(comm: MPI.Intracomm, loads: list[str], **options: Any) -> ffr.VolumeIntegrals:
    """A slender beam, held at its left end if nothing else is said."""
    settings = {"frame": HELD, "modes": 6, "order": 2, "solid_columns": 0, **options}
    return solid(
        rod(comm, (40, 1), (LENGTH, HEIGHT), STEEL, stiffening=loads, **settings)
    ).integrals


def test_rotating_beam(comm: MPI.Intracomm) -> None:
    """Flapping frequencies of a beam rotating about its clamped end.

    Dimensionless, A. D. Wright et al., Journal of Applied Mechanics 49 (1982),
    doi:10.1115/1.3161966.
    """
    integrals = slender(comm, ["omega2"])
    scale = math.sqrt(BENDING / (PER_LENGTH * LENGTH**4))
    for speed, flap in ((1.0, 3.6816), (2.0, 4.1373), (10.0, 11.2023)):
        K = integrals.K + (speed * scale) ** 2 * integrals.stiffening["omega2"]
        lowest = scipy.linalg.eigh(K, integrals.G[1:, 1:], eigvals_only=True)[0]
        # slender: shear and rotatory inertia change less than 1e-3
        assert math.sqrt(lowest) / scale == pytest.approx(flap, rel=1e-3)


def test_rotating_beam_in_space(comm: MPI.Intracomm) -> None:
    """Flap and chord of a square beam that spins about its clamped end, hub radius 0.

    Flap as above; chord^2 = flap^2 - speed^2 but for the section's own inertia. The unit of
    frequency is taken from the beam at rest, 3.5160153, since it is no Euler beam.
    """
    options = {"frame": HELD, "modes": 6, "order": 2, "stiffening": ["rotation"]}
    integrals = solid(rod(comm, (12, 1, 1), (1.0, 0.02, 0.02), **options)).integrals
    assert integrals.P is not None
    G, K = integrals.G[1:, 1:], integrals.K
    unit = np.sqrt(scipy.linalg.eigh(K, G, eigvals_only=True)[0]) / 3.5160153
    by_rotation = integrals.stiffening["rotation"] + np.moveaxis(
        integrals.P[1:, 1:], (0, 1), (2, 3)
    )
    for speed, flap in ((2.0, 4.1373196), (6.0, 7.3603730), (10.0, 11.2023279)):
        centrifugal = -((speed * unit) ** 2) * np.diag([1.0, 1.0, 0.0])
        stiff = K + np.tensordot(centrifugal, by_rotation, 2)
        chord, out = np.sqrt(scipy.linalg.eigh(stiff, G, eigvals_only=True)[:2]) / unit
        assert out == pytest.approx(flap, rel=3e-3)
        assert chord**2 + speed**2 == pytest.approx(out**2, rel=1e-3)


def test_column_under_its_own_weight(comm: MPI.Intracomm) -> None:
    """Buckling of a standing column under gravity, g rho A L^3 / EI = 7.8373 (Greenhill 1881)."""
    integrals = slender(comm, ["acceleration"])
    # the frame's acceleration less gravity, along the column's axis
    stiffening = integrals.stiffening["acceleration"][0]
    factors = scipy.linalg.eigh(stiffening, integrals.K, eigvals_only=True)
    critical = 1.0 / max(-factors)
    assert critical * PER_LENGTH * LENGTH**3 / BENDING == pytest.approx(7.8373, rel=1e-3)
    # hanging it gets stiffer by as much
    assert np.all(factors < 1e-6 * max(-factors))


@pytest.mark.parametrize(("frame", "factor"), [(CHORD, 1.0), (HELD, 0.25)])
def test_load_of_euler(comm: MPI.Intracomm, frame: ffr.ChordFrame, factor: float) -> None:
    """Buckling under a force at the end: pinned pi^2 E I / L^2, clamped at one end a quarter."""
    integrals = slender(comm, ["markers"], frame=frame)
    assert integrals.stiffening == {}
    assert integrals.markers["left"].stiffening is None  # a force there stresses nothing
    stiffening = integrals.markers["right"].stiffening
    assert stiffening is not None
    factors = scipy.linalg.eigh(stiffening[0], integrals.K, eigvals_only=True)
    assert 1.0 / max(factors) == pytest.approx(factor * math.pi**2 * BENDING / LENGTH**2, rel=5e-4)


def test_a_bent_beam_is_shorter(comm: MPI.Intracomm) -> None:
    """The end of a clamped beam under a transverse force moves by -1/2 int w'^2 = -3/5 w^2 / L."""
    integrals = slender(comm, ["markers"], markers={"half": (0.5 * LENGTH, 0.0)})
    end, half = integrals.markers["right"], integrals.markers["half"]
    q = np.linalg.solve(integrals.K, end.displacement.T @ [0.0, 1.0])
    w = float(end.displacement[1] @ q)
    assert end.shift(q)[0] == pytest.approx(-0.6 * w**2 / LENGTH, rel=1e-3)
    # w = W (3 x^2 - x^3) / 2, and 1/2 int w'^2 from 0 to 1/2 in these units
    share = 9.0 / 8.0 * (4.0 / 24.0 - 1.0 / 16.0 + 1.0 / 160.0)
    assert half.shift(q)[0] == pytest.approx(-share * w**2 / LENGTH, rel=1e-3)


def test_angular_acceleration_bends_and_stiffens_nothing_at_once(comm: MPI.Intracomm) -> None:
    """Its load is transverse: a straight beam gets no axial force, bending modes no stiffness."""
    integrals = slender(comm, ["omega2", "alpha"])
    gram, alpha = integrals.G[1:, 1:], integrals.stiffening["alpha"]
    scale = max(
        np.abs(scipy.linalg.eigh(array, gram, eigvals_only=True)).max()
        for array in integrals.stiffening.values()
    )
    shapes = scipy.linalg.eigh(integrals.K, gram)[1][:, :2]
    assert_allclose(shapes.T @ alpha @ shapes, 0.0, atol=1e-6 * scale)


def lever(comm: MPI.Intracomm, *, free: bool = False) -> tuple[ffr.Problem, np.ndarray]:
    """A driven beam with a mass at its end, which a spring and an oblique force load as well.

    Or a hinged one in a frame that turns with its hinged end, with stiffness by all loads.
    """
    body = rod(
        comm,
        (12, 3),
        material=ffr.PlaneStress(8e8 if free else 2e8, 0.3, 1000.0, 0.01),
        frame=HELD if free else CHORD,
        modes=2,
        stiffening=["omega2", *(["alpha", "acceleration"] if free else []), "markers"],
        markers={"top": (0.2, 0.02)},
    )
    mechanism = ffr.Mechanism(
        {"beam": ffr.Placement((0.0, 0.0), 0.0, (0.0, 0.0), 10.8)},
        [
            ffr.Revolute(("beam", "left"), ffr.Ground()),
            *([] if free else [ffr.PrescribedAngle(("beam", "left"), swing(0.0, 1.2, 9.0))]),
        ],
        forces=[
            ffr.SpringDamper(("beam", "top"), ffr.Ground((0.2, -0.3)), 200.0, 1.0),
            ffr.Force(("beam", "right"), -20.0, 5.0, follower=True),
        ],
        point_masses=[ffr.PointMass(("beam", "right"), 0.1)],
    )
    objective = ffr.IntegralCompliance() + 1e-2 * ffr.PathTracking("beam", "right", (0.4, 0.0))
    problem = ffr.Problem({"beam": body}, mechanism, ffr.GeneralizedAlpha(0.2, 60), objective)
    c = body.domain.centroids
    return problem, 0.6 + 0.3 * np.sin(60 * c[:, 0] + 100 * c[:, 1])


@pytest.mark.parametrize("free", [False, True], ids=["driven", "hinged"])
def test_gradient_of_a_motion(comm: MPI.Intracomm, free: bool) -> None:
    """From the densities to the motion under forces at markers and back."""
    problem, density = lever(comm, free=free)
    check_gradient(problem, {"beam": density}, taylor=0.04, roundoff=1e-11)
    if free:
        return
    # given arrays move as the mesh does
    evaluation = problem.gradient(density)
    arrays = ffr.MechanicalProblem(problem.mechanism, problem.integrator, problem.objective)
    by_arrays = arrays.gradient(problem.integrals(evaluation))
    assert by_arrays.psi == evaluation.psi
    for name in ("right", "top"):
        mine, theirs = (
            each.integrals_gradient["beam"].markers[name].stiffening
            for each in (by_arrays, evaluation)
        )
        assert np.any(mine)
        np.testing.assert_array_equal(mine, theirs)
