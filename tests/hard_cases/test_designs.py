# SPDX-License-Identifier: MIT
"""Designs that strain the reduction: void, islands, checkerboards, necks, modes that swap."""

from __future__ import annotations

import warnings
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.body_compliance import body_compliance
from shared.meshes import prongs
from shared.problems import slider_crank
from slider_crank import reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.verification import assert_taylor_order, taylor_test

STEEL = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)


def scene(comm: MPI.Intracomm, **of_the_rod: Any) -> ffr.Problem:
    """The slider-crank at a coarse mesh, with any interpolation.

    A density belongs to its mesh: a second one of the same size may be partitioned otherwise.
    """
    return slider_crank(comm, modes=5, steps=300, **of_the_rod)


def check_gradient(problem: ffr.Problem, x: np.ndarray, comm: MPI.Intracomm) -> float:
    """Demand a gradient of Taylor order 2 that leads inwards, and return psi."""
    domain = problem.flexible["rod"].domain
    c = domain.centroids
    direction = np.abs(np.cos(300 * c[:, 0] + 900 * c[:, 1] + 1.0))
    direction *= np.where(x > 0.5, -1.0, 1.0) * domain.design_cells
    evaluation = problem.gradient(x)
    assert evaluation.gradient is not None
    gradient = evaluation.gradient["rod"]
    assert np.isfinite(evaluation.psi) and np.all(np.isfinite(gradient))
    result = taylor_test(
        lambda d: problem.value(d).psi,
        lambda d: comm.allreduce(float(gradient @ d)),
        x,
        direction,
        steps=[4e-4 / 2**k for k in range(4)],
        roundoff=1e-11,
    )
    assert_taylor_order(result)
    return evaluation.psi


def solid_ends(domain: ffr.Domain, x: np.ndarray) -> np.ndarray:
    """A design whose cells outside the design region are solid."""
    return np.where(domain.design_cells, x, 1.0)


@pytest.mark.mpi
@pytest.mark.parametrize("floor", [1e-6, 1e-9])
def test_half_the_body_is_void(comm: MPI.Intracomm, floor: float) -> None:
    """A strip in a void of next to no stiffness: psi of the strip alone, and an exact gradient."""
    problem = scene(comm, interpolation=ffr.SIMP(floor=floor))
    domain = problem.flexible["rod"].domain
    strip = solid_ends(domain, np.where(np.abs(domain.centroids[:, 1]) < 0.01, 1.0, 0.0))
    psi = check_gradient(problem, strip, comm)
    # the void bears a share of the load in proportion to its stiffness, from both sides of a strip
    # of half the height, at up to twice its lever: psi changes by some times that stiffness
    stiffer = 1e3 * floor
    other = scene(comm, interpolation=ffr.SIMP(floor=stiffer), domain=domain).value(strip).psi
    assert other < psi
    assert psi == pytest.approx(other, rel=10.0 * stiffer)


@pytest.mark.mpi
def test_many_modes_beside_void(comm: MPI.Intracomm) -> None:
    """Void has next to no mass; what a hundred modes move there is no more than its motion is."""
    problem = reference_problem(comm, (50, 5), modes=100, steps=300)
    body = problem.flexible["rod"]
    domain = body.domain
    strip = solid_ends(domain, np.where(np.abs(domain.centroids[:, 1]) < 0.01, 1.0, 0.0))
    basis = body.reduce(strip).basis
    normal = basis.shapes[:, basis.n_constraint :]
    assert body.elasticity.largest(np.abs(normal)) < 100.0
    gram = body.elasticity.inner(normal, basis.mass_times_normal)
    assert np.abs(gram - np.eye(100)).max() < 1e-10
    few = problem.with_modes({"rod": 20}).value(strip).psi
    assert problem.value(strip).psi == pytest.approx(few, rel=1e-3)


@pytest.mark.mpi
@pytest.mark.parametrize("floor", [1e-6, 1e-9])
def test_checkerboard(comm: MPI.Intracomm, floor: float) -> None:
    """Bilinear elements take it for stiffer than it is; value and gradient are sound."""
    problem = scene(comm, interpolation=ffr.SIMP(floor=floor))
    domain = problem.flexible["rod"].domain
    low = domain.bounding_box[0]
    i, j = np.floor((domain.centroids - low) / [0.01, 0.005]).astype(int).T
    board = solid_ends(domain, np.where((i + j) % 2 == 0, 1.0, 0.0))
    check_gradient(problem, board, comm)


@pytest.mark.mpi
def test_necks_of_one_element(comm: MPI.Intracomm) -> None:
    """Blocks hang together by single elements."""
    problem = scene(comm)
    domain = problem.flexible["rod"].domain
    low = domain.bounding_box[0]
    i, j = np.floor((domain.centroids - low) / [0.01, 0.005]).astype(int).T
    necks = solid_ends(domain, np.where((i % 8 == 4) & (j != 3), 0.0, 1.0))
    assert check_gradient(problem, necks, comm) > problem.value(np.ones(domain.n_cells)).psi


@pytest.mark.mpi
def test_islands(comm: MPI.Intracomm) -> None:
    """A design that has fallen apart: refused by name and time, or reported as far too soft."""
    problem = scene(comm)
    domain = problem.flexible["rod"].domain
    gap = np.abs(domain.centroids[:, 0] - 0.205) < 0.016
    islands = solid_ends(domain, np.where(gap, 0.0, 1.0))
    full = problem.value(np.ones(domain.n_cells)).psi
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            psi = problem.value(islands).psi
        except ffr.SimulationError as error:
            assert "body 'rod'" in str(error) and "t = " in str(error)
            assert np.all(np.isfinite(error.trajectory.y))
            return
    softened = any(issubclass(w.category, ffr.SofteningWarning) for w in caught)
    assert np.isfinite(psi) and (softened or psi > 100.0 * full)


@pytest.mark.mpi
def test_modes_that_swap(comm: MPI.Intracomm) -> None:
    """Two prongs, one of which becomes the softer one: value and gradient pass on continuously."""
    domain = prongs(comm)
    body = ffr.FlexibleBody(domain, STEEL, frame=ffr.TangentFrame("root"), modes=2)
    upper = np.where(domain.centroids[:, 1] > 0.5, 1.0, -1.0)
    step = 1e-4
    line = [body_compliance(body, 0.8 + step * k * upper) for k in (-2, -1, 0, 1, 2)]
    slopes = [comm.allreduce(float(gradient @ upper)) for _, gradient in line]
    for (before, _), (after, _), s, t in zip(line, line[1:], slopes, slopes[1:], strict=False):
        # the trapezoidal rule for the gradient gives the difference, to third order
        assert after - before == pytest.approx(0.5 * step * (s + t), abs=1e-9 * before)
    # even in the swap, by symmetry
    assert line[0][0] == pytest.approx(line[4][0], rel=1e-9)
    assert slopes[2] == pytest.approx(
        0.0, abs=1e-6 * abs(slopes[0] - slopes[4]) + 1e-9 * line[0][0]
    )


@pytest.mark.mpi
@pytest.mark.parametrize("difference", [0.0, 1e-10, 1e-5])
def test_cluster_at_the_edge_of_the_basis(comm: MPI.Intracomm, difference: float) -> None:
    """Cutting through a pair of equal frequencies is reported, with a number that does not.

    The gradient is that of the value where the solver tells them apart, and refused where not.
    """
    domain = prongs(comm)
    body = ffr.FlexibleBody(domain, STEEL, frame=ffr.TangentFrame("root"), modes=3)
    upper = domain.centroids[:, 1] > 0.5
    x = np.where(upper, 0.8 * (1.0 + difference), 0.8)
    cut = pytest.warns(UserWarning, match=r"cuts through a cluster.*take modes = 2 or 4")
    if difference < 1e-6:
        with cut:
            reduced = body.reduce(x)
        with pytest.raises(RuntimeError, match=r"there is no gradient; take modes = 2 or 4"):
            body.pullback(reduced, reduced.integrals)
        with pytest.raises(RuntimeError, match="there is no gradient"):
            next(ffr.mode_derivatives(body, reduced, [0]))
        return
    direction = np.where(upper, 1.0, -1.0) * np.cos(3 * domain.centroids[:, 0])
    step = 0.1 * difference
    with cut:
        slope = comm.allreduce(float(body_compliance(body, x)[1] @ direction))
    with cut:
        ends = [body_compliance(body, x + s * step * direction)[0] for s in (-1.0, 1.0)]
    assert slope == pytest.approx((ends[1] - ends[0]) / (2.0 * step), rel=1e-3)


@pytest.mark.mpi
@pytest.mark.parametrize("difference", [0.0, 1e-12, 1e-9, 1e-6, 1e-3])
def test_nearly_equal_frequencies(comm: MPI.Intracomm, difference: float) -> None:
    """The gradient is exact however close two frequencies are."""
    domain = prongs(comm)
    body = ffr.FlexibleBody(domain, STEEL, frame=ffr.TangentFrame("root"), modes=2)
    upper = domain.centroids[:, 1] > 0.5
    x = np.where(upper, 0.8 * (1.0 + difference), 0.8)
    direction = np.where(upper, 0.2, -0.1) * np.cos(3 * domain.centroids[:, 0])
    gradient = body_compliance(body, x)[1]
    slope = comm.allreduce(float(gradient @ direction))
    eps = 1e-3
    values = [body_compliance(body, x + k * eps * direction)[0] for k in (-2, -1, 1, 2)]
    difference_quotient = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * eps)
    assert slope == pytest.approx(difference_quotient, rel=1e-7)
