# SPDX-License-Identifier: MIT
"""Bodies reduced by conjugate gradients with multigrid, beside those reduced by factors."""

from __future__ import annotations

import warnings
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shared.body_compliance import body_compliance
from shared.rods import rod

import dolfinx_ffr as ffr
from dolfinx_ffr.reduction import direct_solver, multigrid
from dolfinx_ffr.reduction.nested_boxes import interpolations

pytestmark = pytest.mark.mpi


def pair(comm: MPI.Intracomm, dimension: int) -> tuple[ffr.FlexibleBody, ffr.FlexibleBody]:
    """The same rod by factors and by multigrid; in space of a square section, with equal pairs.

    Multigrid goes by aggregates in the plane, where nodes stand on no lattice, by boxes in space.
    """
    elements, modes = ((12, 2), 3) if dimension == 2 else ((13, 4, 4), 2)
    cell_options = {"cell": "triangle"} if dimension == 2 else {}
    direct, iterative = (
        rod(comm, elements, (0.4, 0.04, 0.04), modes=modes, solver=solver, **cell_options)
        for solver in ("direct", "iterative")
    )
    return direct, iterative


def holes(domain: ffr.Domain) -> np.ndarray:
    """Solid, gray and void, symmetric across the rod."""
    across = np.abs(domain.centroids[:, 1:]).max(axis=1)
    inside = (across < 0.01) & domain.design_cells
    return np.where(inside, np.where(np.sin(60.0 * domain.centroids[:, 0]) > 0.0, 0.0, 0.4), 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_the_same_as_by_factors(comm: MPI.Intracomm, dimension: int) -> None:
    """Frequencies with all copies, a compliance and its gradient, at one density and the next."""
    direct, iterative = pair(comm, dimension)
    domain = direct.domain
    for x in (np.where(domain.design_cells, 0.5, 1.0), holes(domain)):
        (psi, gradient), (other, other_gradient) = (
            body_compliance(b, x) for b in (direct, iterative)
        )
        assert other == pytest.approx(psi, rel=1e-9)
        size = np.sqrt(domain.sum(gradient**2))
        assert np.sqrt(domain.sum((other_gradient - gradient) ** 2)) < 1e-8 * size
        frequencies = direct.reduce(x).basis.frequencies
        assert_allclose(iterative.reduce(x).basis.frequencies, frequencies, rtol=1e-9)
        if dimension == 3:  # bending in both planes
            assert frequencies[1] == pytest.approx(frequencies[0], rel=1e-6)


@pytest.mark.parametrize(("elements", "order"), [((11, 5), 2), ((9, 5, 4), 1)])
def test_boxes_interpolate_linear_fields(
    comm: MPI.Intracomm, elements: tuple[int, ...], order: int
) -> None:
    """But where clamped nodes, which do not move, are near."""
    body = rod(comm, elements, order=order)
    clamped = body.reduction.clamped
    matrices = interpolations(body.elasticity, clamped)
    assert matrices
    exact = body.elasticity.coordinates().ravel()
    # coarse nodes are those that are interpolated by weight one
    coarse, fine = matrices[0].createVecs()
    indptr, columns, weights = matrices[0].getValuesCSR()
    nodes = weights == 1.0
    rows = np.repeat(np.arange(len(exact)), np.diff(indptr))[nodes]
    coarse.setValues(columns[nodes], exact[rows])
    coarse.assemble()
    matrices[0].mult(coarse, fine)
    assert not np.any(fine.getArray()[clamped])
    x = np.repeat(exact[:: len(elements)], len(elements))
    far = np.abs(x - 0.2) < 0.2 - 0.8 / elements[0]
    assert_allclose(fine.getArray()[far], exact[far], atol=1e-14)
    for item in (coarse, fine, *matrices):
        item.destroy()


def test_the_solver_stays_with_the_body(comm: MPI.Intracomm) -> None:
    _, iterative = pair(comm, 2)
    fewer = iterative.with_modes(2)
    assert fewer.modes == 2
    assert fewer.reduction.solver == "iterative"


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_stall_is_told_and_a_factor_takes_over(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch, dimension: int
) -> None:
    monkeypatch.setattr(multigrid, "MULTIGRID", replace(multigrid.MULTIGRID, max_iterations=4))
    direct, iterative = pair(comm, dimension)
    x = holes(direct.domain)
    with pytest.warns(UserWarning, match=r"stalls .* in 4 iterations.* continues with a factor"):
        frequencies = iterative.reduce(x).basis.frequencies
    assert_allclose(frequencies, direct.reduce(x).basis.frequencies, rtol=1e-9)
    with warnings.catch_warnings():  # told once
        warnings.simplefilter("error")
        iterative.reduce(np.sqrt(x))


def test_a_stall_where_no_factor_fits_is_told_with_the_remedy(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(multigrid, "MULTIGRID", replace(multigrid.MULTIGRID, max_iterations=2))
    monkeypatch.setattr(direct_solver, "agreed_memory", lambda *_: 10_000)
    _, iterative = pair(comm, 3)
    with pytest.raises(RuntimeError, match=r"in 2 iterations.* does not fit: .*more stiffness"):
        iterative.reduce(holes(iterative.domain))


@pytest.mark.parametrize("sign", [-1.0, np.nan])
def test_a_preconditioner_that_is_not_positive_is_no_convergence(
    comm: MPI.Intracomm, sign: float
) -> None:
    _, body = pair(comm, 2)
    solver = multigrid.MultigridSolver(body.elasticity, body.reduction.clamped, 1e-8)
    loads = np.ones((body.elasticity.n_dofs, 2))
    solution, iterations = solver._conjugate_gradients(
        lambda block, _: block, lambda block: sign * block, loads
    )
    assert solution is None and iterations == 0
    zero, _ = solver._conjugate_gradients(lambda block, _: block, lambda block: block, 0.0 * loads)
    assert zero is not None and not np.any(zero)
