# SPDX-License-Identifier: MIT
"""The gradient element by element agrees with the exact adjoint."""

from __future__ import annotations

from importlib import import_module

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shared.body_compliance import compliance
from shared.derivatives import waves
from shared.meshes import prongs
from shared.problems import swing_about_a_point
from shared.rods import STEEL
from slider_crank import reference_problem

import dolfinx_ffr as ffr
from dolfinx_ffr.paper.elementwise import elementwise_gradient, integral_derivatives

SOLVERS = ("bordered", "deflated")


def agree(found: np.ndarray, exact: np.ndarray, comm: MPI.Comm) -> None:
    """Demand seven digits of every element, and of elements that hardly matter a few less.

    A derivative is a sum over all shape functions, whose terms cancel where it is small: round-off
    counts against the largest one.
    """
    largest = comm.allreduce(float(np.max(np.abs(exact), initial=0.0)), MPI.MAX)
    assert_allclose(found, exact, rtol=1e-7, atol=1e-10 * largest)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cell", "order", "solver"),
    [
        ("quadrilateral", 1, SOLVERS[0]),
        *(pytest.param("quadrilateral", 2, solver, marks=pytest.mark.mpi) for solver in SOLVERS),
        ("triangle", 2, SOLVERS[-1]),
    ],
)
def test_every_element(comm: MPI.Comm, cell: str, order: int, solver: ffr.paper.Solver) -> None:
    """All elements, with a design between void and solid."""
    problem = reference_problem(comm, (12, 3), cell=cell, order=order, modes=5, steps=100)
    domain = problem.flexible["rod"].domain
    c = domain.centroids
    x = 0.55 + 0.4 * np.sin(130 * c[:, 0]) * np.cos(210 * c[:, 1] + 0.3)
    evaluation = problem.gradient(x)
    assert evaluation.gradient is not None
    derivatives = elementwise_gradient(problem, evaluation, solver=solver, progress=False)
    agree(derivatives["rod"].values, evaluation.gradient["rod"], comm)
    assert derivatives["rod"].count == domain.n_cells_global
    # the interfaces do not depend on the design, and the rod has no other markers
    assert not np.any(derivatives["rod"].kinematics)
    assert np.any(derivatives["rod"].objective) and np.any(derivatives["rod"].motion)


@pytest.mark.mpi
def test_chosen_elements(comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mask, numbers and all elements give the same values; batches do not matter."""
    problem = reference_problem(comm, (24, 4), modes=4, steps=200)
    domain = problem.flexible["rod"].domain
    x = np.full(domain.n_cells, 0.7)
    evaluation = problem.gradient(x)
    assert evaluation.gradient is not None
    exact = evaluation.gradient["rod"]
    mask = domain.centroids[:, 0] > 0.15
    with monkeypatch.context() as patch:
        patch.setattr(import_module("dolfinx_ffr.paper.mode_derivatives"), "BATCH", 7)
        by_mask = elementwise_gradient(problem, evaluation, mask, progress=False)["rod"]
    by_number = elementwise_gradient(
        problem, evaluation, {"rod": np.flatnonzero(mask)[::-1]}, progress=False
    )["rod"]
    assert_allclose(by_mask.values, by_number.values[::-1], rtol=1e-9)
    agree(by_mask.values, exact[mask], comm)
    none = elementwise_gradient(problem, evaluation, np.zeros(domain.n_cells, bool), progress=False)
    assert none["rod"].count == 0 and none["rod"].values.shape == (0,)


@pytest.mark.mpi
@pytest.mark.parametrize("solver", SOLVERS)
def test_marker_inside(comm: MPI.Comm, solver: ffr.paper.Solver) -> None:
    """A joint and a point mass inside the body: the kinematic relations depend on the design."""
    problem = swing_about_a_point(comm, 100)
    evaluation = problem.gradient(waves(problem))
    assert evaluation.gradient is not None
    gradient = elementwise_gradient(problem, evaluation, solver=solver, progress=False)["rod"]
    agree(gradient.values, evaluation.gradient["rod"], comm)
    assert np.any(gradient.kinematics)


@pytest.mark.mpi
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("difference", [0.0, 1e-9, 1e-5])
def test_close_eigenvalues(comm: MPI.Comm, difference: float, solver: ffr.paper.Solver) -> None:
    """Two equal prongs, and two that differ a little in their density."""
    domain = prongs(comm)
    body = ffr.FlexibleBody(domain, STEEL, frame=ffr.TangentFrame("root"), modes=4)
    upper = domain.centroids[:, 1] > 0.5
    reduced = body.reduce(0.8 * np.where(upper, 1.0 + difference, 1.0))
    eigenvalues = reduced.basis.eigenvalues
    assert eigenvalues[1] / eigenvalues[0] - 1.0 < 1e-4
    # the compliance under a load by acceleration depends on the span of the modes alone
    _, bar = compliance(reduced)
    exact = body.pullback(reduced, bar).density
    derivatives = integral_derivatives(body, reduced, solver=solver)
    agree(derivatives.through_integrals(bar), exact, comm)


@pytest.mark.mpi
def test_derivatives_of_the_integrals_along_a_line(comm: MPI.Comm) -> None:
    """Static modes are unique: their integrals agree entry by entry with differences."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(16, 3))
    marked = {"frame": ffr.ChordFrame("left", "right"), "markers": {"middle": (0.19, 0.005)}}
    body = ffr.FlexibleBody(domain, STEEL, modes=0, **marked)
    c = domain.centroids
    x = 0.6 + 0.3 * np.sin(90 * c[:, 0])
    direction = np.cos(70 * c[:, 0] + 200 * c[:, 1])
    change = integral_derivatives(body, body.reduce(x))
    step = 1e-4
    ahead, behind = (body.reduce(x + s * step * direction).integrals for s in (1.0, -1.0))
    triples = [[getattr(each, key) for each in (change, ahead, behind)] for key in "SGNK"]
    triples.append([change.mass, ahead.mass, behind.mass])
    markers = (each.markers["middle"].displacement for each in (ahead, behind))
    triples.append([change.markers["middle"][0], *markers])
    for by_cell, after, before in triples:
        total = comm.allreduce(np.einsum("c,c...->...", direction, by_cell))
        difference = (after - before) / (2.0 * step)
        assert_allclose(total, difference, rtol=1e-6, atol=1e-7 * np.abs(difference).max())


@pytest.mark.mpi
def test_bad_requests(comm: MPI.Comm) -> None:
    """Each is refused by name, on every rank."""
    problem = reference_problem(comm, (12, 2), modes=2, steps=120)
    body = problem.flexible["rod"]
    n = body.domain.n_cells
    evaluation = problem.value(np.ones(n))
    with pytest.raises(ValueError, match="must be a mask of shape"):
        elementwise_gradient(problem, evaluation, np.ones(n + 1, dtype=bool))
    with pytest.raises(ValueError, match="different whole numbers"):
        elementwise_gradient(problem, evaluation, [0, 0])
