# SPDX-License-Identifier: MIT
"""Shape functions: frequencies of beams against closed forms, interfaces, orthonormality."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from shared.rods import CHORD, HELD, STEEL, rod, solid, waves

import dolfinx_ffr as ffr
from dolfinx_ffr.reduction.point_marker import PointMarker
from dolfinx_ffr.verification import convergence_order


def beam(beta_length: float) -> float:
    """Frequency of an Euler-Bernoulli beam of steel, 1 m long and 1 cm high [Hz]."""
    return float(beta_length**2 * np.sqrt(STEEL.young / STEEL.density / 12.0) * 0.01 / (2 * np.pi))


def held_domain(comm: MPI.Intracomm, *sizes: float, **options: Any) -> ffr.Domain:
    """A rectangle held at its left end only."""
    domain = ffr.Domain.rectangle(comm, *sizes, **options)
    return ffr.Domain(domain.mesh, {"left": lambda x: x[0] < 1e-9}, order=options["order"])


@pytest.mark.mpi
def test_clamped_free_frequencies(comm: MPI.Intracomm) -> None:
    """A slender cantilever has the frequencies of beam theory."""
    domain = held_domain(comm, 1.0, 0.01, elements=(200, 2), order=2)
    body = ffr.FlexibleBody(domain, STEEL, frame=HELD, modes=4)
    beta_length = [1.87510406871196, 4.69409113297417, 7.85475743823761, 10.9955407348755]
    # shear and rotary inertia lower the k-th frequency by about 2 (beta h)^2 / 12 at most
    for f, bl in zip(solid(body).basis.frequencies, beta_length, strict=True):
        assert f == pytest.approx(beam(bl), rel=2 * (bl * 0.01) ** 2 / 6 + 2e-4)


@pytest.mark.mpi
@pytest.mark.parametrize("frame", [HELD, CHORD])
def test_free_free_frequencies(comm: MPI.Intracomm, frame: ffr.Frame) -> None:
    """Rigid motion and shape functions together give the free beam: three zeros, then theory."""
    body = rod(comm, (50, 2), (1.0, 0.01), order=2, frame=frame, modes=12)
    integrals = solid(body).integrals
    stiffness = scipy.linalg.block_diag(np.zeros((3, 3)), integrals.K)
    values = scipy.linalg.eigh(stiffness, integrals.mass_matrix(), eigvals_only=True)
    frequencies = np.sign(values) * np.sqrt(np.abs(values)) / (2 * np.pi)
    exact = [beam(bl) for bl in (4.73004074486270, 7.85320462409584, 10.9956078380017)]
    assert np.all(np.abs(frequencies[:3]) < 1e-4 * exact[0])
    np.testing.assert_allclose(frequencies[3:6], exact, rtol=5e-3)


@pytest.mark.mpi
@pytest.mark.parametrize("width", [0.04, 0.02])
def test_beam_in_two_planes_and_torsion(comm: MPI.Intracomm, width: float) -> None:
    """Clamped-free frequencies in both planes (Timoshenko) and of torsion (Saint-Venant).

    The first of bending is 3.50264107 sqrt(EI / rho A L^4) for sqrt(I / A) / L = 0.02, nu = 0.3 and
    a shear factor 5/6, and 3.51265 for 0.01. J_t = 0.140577015 h^4 of a square section.
    """
    height = 0.04
    length = height / np.sqrt(12.0) / 0.02
    elements, modes = ((12, 2, 2), 5) if width == height else ((12, 2, 1), 6)
    body = rod(comm, elements, (length, height, width), order=2, frame=HELD, modes=modes)
    integrals = solid(body).integrals
    squares = scipy.linalg.eigh(integrals.K, integrals.G[1:, 1:], eigvals_only=True)
    value = np.sqrt(squares) * length**2 / np.sqrt(STEEL.young / 12 / STEEL.density)
    factors = {0.04: 3.50264107, 0.02: 3.51265}
    # rigid ends and the mesh: less than one percent
    assert value[0] == pytest.approx(factors[width] * width, rel=1e-2)
    assert value[1] == pytest.approx(factors[height] * height, rel=1e-2)
    if width == height:
        shear = STEEL.young / (2.0 * (1.0 + STEEL.poisson))
        twist = 0.5 * np.pi / length * np.sqrt(shear * 0.140577015 / (STEEL.density / 6))
        # rigid ends cannot warp, 0.6 %, and the mesh adds 0.8 %
        assert np.min(np.abs(np.sqrt(squares) / twist - 1.0)) < 1.5e-2


@pytest.mark.mpi
def test_plane_stress_plate_of_du_and_olhoff(comm: MPI.Intracomm) -> None:
    """Clamped-clamped 8 x 1 plate of density one half, doi:10.1007/s00158-007-0101-y."""
    plate, law = ffr.PlaneStress(1e7, 0.3, 1.0, 1.0), ffr.SIMP(3.0, 1e-12, ffr.LinearMass())
    body = rod(comm, (80, 10), (8.0, 1.0), plate, modes=1, interpolation=law)
    omega = 2 * np.pi * body.reduce(np.full(body.domain.n_cells, 0.5)).basis.frequencies[0]
    assert omega == pytest.approx(145.97, abs=0.005)  # bilinear 80 x 10; 146.1 published


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cell", "order"), [("quadrilateral", 1), ("triangle", 1), ("quadrilateral", 2)]
)
def test_convergence_of_frequencies(comm: MPI.Intracomm, cell: str, order: int) -> None:
    """The first frequency of a rod held at an end without corners' singularity: nu = 0."""
    values, sizes = [], (4, 8, 16, 32) if order == 1 else (2, 4, 8, 16)
    for n in sizes:
        domain = held_domain(comm, 4.0, 1.0, elements=(4 * n, n), cell=cell, order=order)
        material = ffr.PlaneStress(1.0, 0.0, 1.0, 1.0)
        body = ffr.FlexibleBody(domain, material, frame=HELD, modes=2)
        values.append(solid(body).basis.frequencies[0])
    # three meshes give the order without a reference value
    differences = np.abs(np.diff(values))
    observed = convergence_order(1.0 / np.array(sizes[:-1]), differences)
    # clamping prevents transverse strain only through shear: the corner limits the order
    assert abs(observed - 2.0) < 0.25 if order == 1 else observed > 1.9
    # the finest mesh's error by Richardson's extrapolation at second order
    assert differences[-1] / 3 / values[-1] < 1e-3


@pytest.mark.mpi
def test_shape_functions(comm: MPI.Intracomm) -> None:
    """Constraint modes are rigid on interfaces and in equilibrium inside.

    Normal modes are M-orthonormal, vanish on interfaces, and diagonalise K.
    """
    body = rod(comm, frame=HELD, modes=6)
    reduced = body.reduce(waves(body.domain))
    basis, matrices = reduced.basis, body.factored(reduced).matrices
    elasticity, reduction = body.elasticity, body.reduction
    constraint, normal = basis.constraint, basis.normal
    assert constraint.shape[1] == 3
    force = elasticity.apply(matrices.stiffness, constraint)
    inside = np.abs(force[~reduction.clamped])
    assert elasticity.largest(inside) < 1e-9 * elasticity.largest(np.abs(force))
    x = elasticity.coordinates()
    right = np.isclose(x[:, 0], 0.4)
    np.testing.assert_allclose(constraint[0::2, 2][right], -x[right, 1], atol=1e-14)
    np.testing.assert_allclose(constraint[1::2, 1][right], 1.0, atol=1e-14)
    displacement, rotation = reduction.interface_motion("right")
    np.testing.assert_array_equal(displacement, np.eye(3)[:2])
    np.testing.assert_array_equal(rotation, np.eye(3)[2])
    gram = elasticity.inner(normal, elasticity.apply(matrices.mass, normal))
    np.testing.assert_allclose(gram, np.eye(6), atol=1e-10)
    stiffness = elasticity.inner(normal, elasticity.apply(matrices.stiffness, normal))
    largest = basis.eigenvalues[-1]
    np.testing.assert_allclose(stiffness, np.diag(basis.eigenvalues), atol=1e-9 * largest)
    assert np.max(np.abs(normal[reduction.clamped]), initial=0.0) == 0.0


@pytest.mark.mpi
def test_what_is_refused(comm: MPI.Intracomm) -> None:
    """Frames, markers, loads and numbers of modes, on every rank."""
    has_none = r"no interface 'top'; it has \['left', 'right'\]"
    refused: list[tuple[dict[str, Any], str]] = [
        ({"frame": ffr.TangentFrame("top")}, has_none),
        ({"frame": ffr.ChordFrame("left", "top")}, has_none),
        ({"frame": ffr.ChordFrame("left", "left")}, "angle of the frame undetermined"),
        *(({"modes": n}, "must be between 0 and 53: the mesh has 54") for n in (-1, 54, 1000)),
        ({"solver": "cg"}, "body: solver must be 'direct' or 'iterative'"),
        ({"stiffening": ["wind"]}, r"loads \['wind'\] must be some of \['omega2'"),
        ({"markers": {"left": (0.5, 0.0)}}, r"markers \['left'\] have the names of interfaces"),
        ({"markers": {"tip": (1.2, 0.0)}}, r"marker 'tip'.*lies outside the body"),
        ({"markers": {"tip": (0.5, 0.0501)}}, r"marker 'tip'.*lies outside the body"),
    ]
    for options, message in refused:
        with pytest.raises(ValueError, match=message):
            rod(comm, (10, 2), (1.0, 0.1), **options)
    with pytest.raises(ValueError, match="position holds NaN"):
        PointMarker.at(rod(comm).domain, (float("nan"), 0.0))
