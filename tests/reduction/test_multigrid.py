# SPDX-License-Identifier: MIT
"""Bodies reduced by conjugate gradients with multigrid, beside those reduced by factors."""

from __future__ import annotations

from copy import copy

from mpi4py import MPI

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shared.body_compliance import body_compliance

import dolfinx_ffr as ffr
from dolfinx_ffr.reduction import multigrid

pytestmark = pytest.mark.mpi

PLATE = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)
STEEL = ffr.Isotropic(210e9, 0.3, 7850.0)


def pair(comm: MPI.Intracomm, dimension: int) -> tuple[ffr.FlexibleBody, ffr.FlexibleBody]:
    """The same rod by factors and by multigrid; in space of a square section, with equal pairs."""
    material: ffr.PlaneStress | ffr.Isotropic
    if dimension == 2:
        domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(24, 4))
        material, modes = PLATE, 3
    else:
        domain = ffr.Domain.box(comm, 0.4, 0.04, 0.04, elements=(14, 3, 3), solid_layers=1)
        material, modes = STEEL, 2
    frame = ffr.ChordFrame("left", "right")
    direct, iterative = (
        ffr.FlexibleBody(domain, material, frame=frame, modes=modes, solver=solver)
        for solver in ("direct", "iterative")
    )
    return direct, iterative


def holes(domain: ffr.Domain) -> np.ndarray:
    """Solid, gray and void, symmetric across the rod."""
    across = np.abs(domain.centroids[:, 1:]).max(axis=1)
    inside = (across < 0.01) & domain.design_cells
    return np.where(inside, np.where(np.sin(60.0 * domain.centroids[:, 0]) > 0.0, 0.0, 0.4), 1.0)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_same_as_by_factors(comm: MPI.Intracomm, dimension: int) -> None:
    """Frequencies with all copies, a compliance and its gradient, at one density and the next."""
    direct, iterative = pair(comm, dimension)
    domain = direct.domain
    for x in (np.where(domain.design_cells, 0.5, 1.0), holes(domain)):
        (psi, gradient), (other, found) = (body_compliance(b, x) for b in (direct, iterative))
        assert other == pytest.approx(psi, rel=1e-9)
        size = np.sqrt(domain.sum(gradient**2))
        assert np.sqrt(domain.sum((found - gradient) ** 2)) < 1e-8 * size
        frequencies = direct.reduce(x).basis.frequencies
        assert_allclose(iterative.reduce(x).basis.frequencies, frequencies, rtol=1e-9)
        if dimension == 3:  # bending in both planes
            assert frequencies[1] == pytest.approx(frequencies[0], rel=1e-6)


def test_the_solver_stays_with_the_body(comm: MPI.Intracomm) -> None:
    _, iterative = pair(comm, 2)
    for other in (iterative.with_modes(2), copy(iterative.reduction)):
        assert getattr(other, "reduction", other).solver == "iterative"


def test_no_convergence_is_told_with_the_remedy(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(multigrid, "MAX_ITERATIONS", 2)
    _, iterative = pair(comm, 2)
    with pytest.raises(RuntimeError, match=r'not converge in 2 iterations: .*solver="direct"'):
        iterative.reduce(holes(iterative.domain))


@pytest.mark.parametrize("sign", [-1.0, np.nan])
def test_a_preconditioner_that_is_not_positive_is_no_convergence(
    comm: MPI.Intracomm, sign: float
) -> None:
    _, body = pair(comm, 2)
    solver = multigrid.MultigridSolver(body.elasticity, body.reduction.held, 1e-8)
    loads = np.ones((body.elasticity.n_dofs, 2))
    found, iterations = solver._iterated(lambda block, _: block, lambda block: sign * block, loads)
    assert found is None and iterations == 0
    zero, _ = solver._iterated(lambda block, _: block, lambda block: block, 0.0 * loads)
    assert zero is not None and not np.any(zero)


@pytest.mark.parametrize("transposed", [False, True])
def test_products_by_columns(comm: MPI.Intracomm, transposed: bool) -> None:
    """Of ranks without rows, for which releases of PETSc have no product with a block."""
    _, body = pair(comm, 2)
    matrix = body.factored(body.reduce(holes(body.domain))).held_mass
    block = np.cos(np.arange(3.0 * body.elasticity.n_dofs)).reshape(-1, 3)
    found = multigrid._product_by_columns(matrix, block, transposed=transposed)
    exact = multigrid._product(matrix, block, transposed=transposed)
    assert_allclose(found, exact, atol=1e-14 * np.abs(exact).max())


def test_an_unknown_solver_is_refused(comm: MPI.Intracomm) -> None:
    direct, _ = pair(comm, 2)
    with pytest.raises(ValueError, match=r"body: solver must be 'direct' or 'iterative'"):
        ffr.FlexibleBody(direct.domain, PLATE, frame=direct.reduction.frame, solver="cg")
