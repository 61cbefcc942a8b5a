# SPDX-License-Identifier: MIT
"""Shape functions: frequencies of beams, frames, clusters, and the pullback of their span."""

from __future__ import annotations

import warnings

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from shared.meshes import prongs

from dolfinx_ffr import (
    SIMP,
    ChordFrame,
    CraigBampton,
    Domain,
    Elasticity,
    FlexibleBody,
    LinearMass,
    PlaneStress,
    TangentFrame,
)
from dolfinx_ffr.verification import assert_taylor_order, convergence_order, taylor_test

STEEL = PlaneStress(210e9, 0.3, 7850.0, 0.01)


def beam(length: float, height: float, beta_length: float) -> float:
    """Frequency of an Euler-Bernoulli beam of steel [Hz]."""
    wave = np.sqrt(STEEL.young / STEEL.density / 12.0) * height
    return float((beta_length / length) ** 2 * wave / (2 * np.pi))


def cantilever(comm: MPI.Intracomm, order: int = 2, nx: int = 50, height: float = 0.01) -> Domain:
    """A rod of one metre held at its left end only."""
    domain = Domain.rectangle(comm, 1.0, height, elements=(nx, 2), order=order)
    return Domain(domain.mesh, {"left": lambda x: x[0] < 1e-9}, order=order)


@pytest.mark.mpi
def test_clamped_free_frequencies(comm: MPI.Intracomm) -> None:
    """A slender cantilever has the frequencies of beam theory."""
    body = FlexibleBody(cantilever(comm, nx=200), STEEL, frame=TangentFrame("left"), modes=4)
    frequencies = body.reduce(np.ones(body.domain.n_cells)).basis.frequencies
    beta_length = [1.87510406871196, 4.69409113297417, 7.85475743823761, 10.9955407348755]
    # shear and rotary inertia lower the k-th frequency by about 2 (beta h)^2 / 12 at most
    for f, bl in zip(frequencies, beta_length, strict=True):
        assert f == pytest.approx(beam(1.0, 0.01, bl), rel=2 * (bl * 0.01) ** 2 / 6 + 2e-4)


def free_frequencies(body: FlexibleBody) -> np.ndarray:
    """Frequencies of the body floating freely, from its volume integrals alone [Hz]."""
    integrals = body.reduce(np.ones(body.domain.n_cells)).integrals
    stiffness = np.zeros((3 + integrals.modes,) * 2)
    stiffness[3:, 3:] = integrals.K
    values = scipy.linalg.eigh(stiffness, integrals.mass_matrix(), eigvals_only=True)
    return np.sign(values) * np.sqrt(np.abs(values)) / (2 * np.pi)


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["tangent", "chord"])
def test_free_free_frequencies(comm: MPI.Intracomm, kind: str) -> None:
    """Rigid motion and shape functions together give the free beam: three zeros, then theory."""
    domain = Domain.rectangle(comm, 1.0, 0.01, elements=(50, 2), order=2)
    frame = TangentFrame("left") if kind == "tangent" else ChordFrame("left", "right")
    frequencies = free_frequencies(FlexibleBody(domain, STEEL, frame=frame, modes=12))
    exact = [beam(1.0, 0.01, bl) for bl in (4.73004074486270, 7.85320462409584, 10.9956078380017)]
    assert np.all(np.abs(frequencies[:3]) < 1e-4 * exact[0])
    np.testing.assert_allclose(frequencies[3:6], exact, rtol=5e-3)


@pytest.mark.mpi
def test_plane_stress_plate_of_du_and_olhoff(comm: MPI.Intracomm) -> None:
    """Clamped-clamped 8 x 1 plate of density one half, doi:10.1007/s00158-007-0101-y."""
    domain = Domain.rectangle(comm, 8.0, 1.0, elements=(80, 10))
    body = FlexibleBody(
        domain,
        PlaneStress(1e7, 0.3, 1.0, 1.0),
        frame=ChordFrame("left", "right"),
        modes=1,
        interpolation=SIMP(3.0, 1e-12, LinearMass()),
    )
    omega = 2 * np.pi * body.reduce(np.full(domain.n_cells, 0.5)).basis.frequencies[0]
    assert omega == pytest.approx(145.97, abs=0.005)  # bilinear 80 x 10; 146.1 published
    assert omega == pytest.approx(146.1, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cell", "order", "expected"),
    [
        ("quadrilateral", 1, 2.0),
        ("triangle", 1, 2.0),
        ("quadrilateral", 2, 4.0),
    ],
)
def test_convergence_of_frequencies(
    comm: MPI.Intracomm, cell: str, order: int, expected: float
) -> None:
    """The first frequency of a rod held at an end without corners' singularity: nu = 0."""
    material = PlaneStress(1.0, 0.0, 1.0, 1.0)
    values = []
    sizes = (4, 8, 16, 32) if order == 1 else (2, 4, 8, 16)
    for ny in sizes:
        domain = Domain.rectangle(comm, 4.0, 1.0, elements=(4 * ny, ny), cell=cell, order=order)
        held = Domain(domain.mesh, {"left": lambda x: x[0] < 1e-9}, order=order)
        body = FlexibleBody(held, material, frame=TangentFrame("left"), modes=2)
        values.append(body.reduce(np.ones(held.n_cells)).basis.frequencies[0])
    # three meshes give the order without a reference value
    differences = np.abs(np.diff(values))
    order_seen = convergence_order(1.0 / np.array(sizes[:-1]), differences)
    if order == 1:
        assert order_seen == pytest.approx(expected, abs=0.25)
    else:
        # clamping prevents transverse strain only through shear: the corner limits the order
        assert order_seen > 1.9
    # the finest mesh's error by Richardson's extrapolation at second order
    assert differences[-1] / 3 / values[-1] < 1e-3


@pytest.mark.mpi
def test_constraint_modes_carry_interface_motion(comm: MPI.Intracomm) -> None:
    """Constraint modes are rigid on interfaces and in equilibrium inside."""
    domain = Domain.rectangle(comm, 0.4, 0.04, elements=(20, 4))
    elasticity = Elasticity(domain, STEEL, SIMP())
    reduction = CraigBampton(elasticity, TangentFrame("left"), 2)
    matrices = elasticity.assemble(np.linspace(0.3, 1.0, domain.n_cells))
    basis = reduction.basis(reduction.factor(matrices))
    shapes = basis.shapes[:, : basis.n_constraint]
    assert shapes.shape[1] == 3
    force = elasticity.apply(matrices.stiffness, shapes)
    scale = comm.allreduce(float(np.max(np.abs(force), initial=0.0)), MPI.MAX)
    assert np.max(np.abs(force[~reduction.held]), initial=0.0) < 1e-9 * scale
    x = elasticity.coordinates()
    right = np.isclose(x[:, 0], 0.4)
    np.testing.assert_allclose(shapes[0::2, 2][right], -x[right, 1], atol=1e-14)
    np.testing.assert_allclose(shapes[1::2, 1][right], 1.0, atol=1e-14)
    displacement, rotation = reduction.interface_motion("right")
    np.testing.assert_array_equal(displacement, np.eye(3)[:2])
    np.testing.assert_array_equal(rotation, np.eye(3)[2])


@pytest.mark.mpi
def test_normal_modes_are_orthonormal(comm: MPI.Intracomm) -> None:
    """Modes are M-orthonormal, vanish on interfaces, and diagonalise K."""
    domain = Domain.rectangle(comm, 0.4, 0.04, elements=(20, 4))
    elasticity = Elasticity(domain, STEEL, SIMP())
    reduction = CraigBampton(elasticity, ChordFrame("left", "right"), 6)
    matrices = elasticity.assemble(np.linspace(0.3, 1.0, domain.n_cells))
    basis = reduction.basis(reduction.factor(matrices))
    normal = basis.shapes[:, basis.n_constraint :]
    gram = elasticity.inner(normal, elasticity.apply(matrices.mass, normal))
    np.testing.assert_allclose(gram, np.eye(6), atol=1e-10)
    stiffness = elasticity.inner(normal, elasticity.apply(matrices.stiffness, normal))
    np.testing.assert_allclose(
        stiffness, np.diag(basis.eigenvalues), atol=1e-9 * basis.eigenvalues[-1]
    )
    assert np.max(np.abs(normal[reduction.held]), initial=0.0) == 0.0


@pytest.mark.mpi
def test_pullback_of_the_span(comm: MPI.Intracomm) -> None:
    """Taylor test of a response that depends on the shape functions only through their span."""
    domain = Domain.rectangle(comm, 0.4, 0.04, elements=(24, 4))
    elasticity = Elasticity(domain, STEEL, SIMP())
    reduction = CraigBampton(elasticity, ChordFrame("left", "right"), 4)
    x = elasticity.coordinates()
    load = np.zeros((elasticity.n_dofs, 1))
    load[1::2, 0] = np.sin(9 * x[:, 0]) / domain.n_cells_global
    # a metric that stays as it is, so that only the shape functions move
    metric = elasticity.assemble(np.ones(domain.n_cells)).stiffness

    def response(density: np.ndarray) -> tuple[float, tuple, np.ndarray, np.ndarray]:
        factored = reduction.factor(elasticity.assemble(density))
        basis = reduction.basis(factored)
        metric_shapes = elasticity.apply(metric, basis.shapes)
        gram = elasticity.inner(basis.shapes, metric_shapes)
        force = elasticity.inner(basis.shapes, load)
        q = np.linalg.solve(gram, force)
        return float((force.T @ q)[0, 0]), (factored, basis), q, metric_shapes

    c = domain.centroids
    density = 0.6 + 0.3 * np.sin(40 * c[:, 0] + 200 * c[:, 1])
    direction = np.cos(37 * c[:, 0] + 130 * c[:, 1])
    _, (factored, basis), q, metric_shapes = response(density)
    bar = 2 * load @ q.T - 2 * (metric_shapes @ q) @ q.T
    adjoint = reduction.pullback(factored, basis, bar)
    shapes, z = basis.shapes, adjoint.fields
    y = np.zeros_like(z)
    y[:, basis.n_constraint :] = -basis.eigenvalues * z[:, basis.n_constraint :]
    gradient = elasticity.density_gradient(density, shapes, y, shapes, z)
    result = taylor_test(
        lambda d: response(d)[0],
        lambda d: comm.allreduce(float(gradient @ d)),
        density,
        direction,
        steps=[0.08, 0.04, 0.02, 0.01],
        roundoff=1e-11,
    )
    assert_taylor_order(result)
    assert 0 < adjoint.iterations < 60


@pytest.mark.mpi
def test_density_gradient_of_the_forms(comm: MPI.Intracomm) -> None:
    """Taylor test of m_x(w, y) + k_x(phi, kappa) at fixed fields."""
    domain = Domain.rectangle(comm, 1.0, 0.5, elements=(8, 4), cell="triangle", order=2)
    elasticity = Elasticity(domain, PlaneStress(1.0, 0.3, 1.0), SIMP())
    x = elasticity.coordinates().ravel()
    block = np.column_stack([np.sin((k + 1) * x + k) for k in range(8)])
    w, y, phi, kappa = block[:, :3], block[:, 3:6], block[:, 4:6], block[:, 6:8]
    c = domain.centroids
    # on both sides of the mass law's threshold
    density = 0.12 + 0.08 * np.sin(9 * c[:, 0] + 20 * c[:, 1])
    direction = 0.1 * np.cos(5 * c[:, 0] + 7 * c[:, 1])

    def value(d: np.ndarray) -> float:
        matrices = elasticity.assemble(d)
        mass = elasticity.inner(w, elasticity.apply(matrices.mass, y))
        stiffness = elasticity.inner(phi, elasticity.apply(matrices.stiffness, kappa))
        return float(np.trace(mass) + np.trace(stiffness))

    gradient = elasticity.density_gradient(density, w, y, phi, kappa)
    result = taylor_test(
        value,
        lambda d: comm.allreduce(float(gradient @ d)),
        density,
        direction,
        steps=[0.1, 0.05, 0.025, 0.0125],
    )
    assert_taylor_order(result)


@pytest.mark.mpi
def test_cut_cluster_is_reported(comm: MPI.Intracomm) -> None:
    """Cutting between two equal frequencies warns and names a better number."""
    domain = prongs(comm)
    x = np.ones(domain.n_cells)

    def reduce(modes: int) -> FlexibleBody:
        body = FlexibleBody(domain, STEEL, frame=TangentFrame("root"), modes=modes)
        body.reduce(x)
        return body

    with pytest.warns(UserWarning, match=r"cuts through a cluster.*take modes = 2 or 4"):
        reduce(3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert reduce(2).reduce(x).basis.outer_gap > 1.0


def test_equal_eigenvalues_inside(comm: MPI.Intracomm) -> None:
    """The gradient is exact where frequencies kept are equal."""
    domain = prongs(comm)
    body = FlexibleBody(domain, STEEL, frame=TangentFrame("root"), modes=2)
    c = domain.centroids
    density = np.full(domain.n_cells, 0.8)
    direction = np.where(c[:, 1] > 0.5, 0.2, -0.1) * np.cos(3 * c[:, 0])

    def value(d: np.ndarray) -> tuple[float, object, np.ndarray]:
        reduced = body.reduce(d)
        force = reduced.integrals.S[1:] @ np.array([0.3, 1.0])
        return force @ np.linalg.solve(reduced.integrals.K, force), reduced, force

    _, reduced, force = value(density)
    eigenvalues = reduced.basis.eigenvalues  # type: ignore[attr-defined]
    assert eigenvalues[1] / eigenvalues[0] - 1 < 1e-9
    integrals = reduced.integrals  # type: ignore[attr-defined]
    q = np.linalg.solve(integrals.K, force)
    bar = integrals.zeros_like()
    bar.S[1:] = 2 * np.outer(q, [0.3, 1.0])
    bar.K[:] = -np.outer(q, q)
    gradient, _ = body.pullback(reduced, bar)  # type: ignore[arg-type]
    result = taylor_test(
        lambda d: value(d)[0],
        lambda d: float(gradient @ d),
        density,
        direction,
        steps=[0.08, 0.04, 0.02, 0.01],
        roundoff=1e-11,
    )
    assert_taylor_order(result)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (TangentFrame("top"), r"no interface 'top'; it has \['left', 'right'\]"),
        (ChordFrame("left", "top"), "no interface 'top'"),
        (ChordFrame("left", "left"), "angle of the frame undetermined"),
    ],
)
def test_bad_frame(comm: MPI.Intracomm, frame: object, message: str) -> None:
    """Frames that name no interface, or leave the angle open, are refused."""
    domain = Domain.rectangle(comm, 1.0, 0.1, elements=(10, 2))
    with pytest.raises(ValueError, match=message):
        FlexibleBody(domain, STEEL, frame=frame, modes=2)  # type: ignore[arg-type]


@pytest.mark.mpi
@pytest.mark.parametrize("modes", [-1, 54, 1000])
def test_more_modes_than_freedoms(comm: MPI.Intracomm, modes: int) -> None:
    """The message says how many modes the mesh can give."""
    domain = Domain.rectangle(comm, 1.0, 0.1, elements=(10, 2))
    with pytest.raises(ValueError, match="must be between 0 and 53"):
        FlexibleBody(domain, STEEL, frame=ChordFrame("left", "right"), modes=modes)
