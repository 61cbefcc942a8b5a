# SPDX-License-Identifier: MIT
"""Direct solutions, with one factor on all ranks and with one of each part."""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from shared.rods import rod

from dolfinx_ffr.fem import Elasticity
from dolfinx_ffr.reduction import direct_solver as module
from dolfinx_ffr.reduction.direct_solver import Between, LinearSolver, PartedFactor, SharedFactor


def parted(elasticity: Elasticity) -> PartedFactor:
    matrix = elasticity.new_matrix()
    solver = PartedFactor(elasticity, matrix, Between.of(elasticity, matrix))
    matrix.destroy()
    return solver


SOLVERS: dict[str, Callable[[Elasticity], LinearSolver]] = {
    "shared": lambda elasticity: SharedFactor(elasticity, "mumps"),
    "parted": parted,
}


def body(comm: MPI.Intracomm) -> Elasticity:
    return rod(comm, (12, 3)).elasticity


def positive(elasticity: Elasticity, density: float) -> PETSc.Mat:
    """A matrix that is positive definite: K + 1e6 M."""
    matrices = elasticity.assemble(np.full(elasticity.domain.n_cells, density))
    matrix = matrices.stiffness.copy()
    matrix.axpy(1e6, matrices.mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
    matrices.destroy()
    return matrix


@pytest.mark.mpi
@pytest.mark.parametrize("kind", SOLVERS)
def test_blocks_of_any_width(comm: MPI.Intracomm, kind: str) -> None:
    """With one matrix after the other, and fewer columns than ranks."""
    elasticity = body(comm)
    solver = SOLVERS[kind](elasticity)
    place = elasticity.coordinates().sum(axis=1).repeat(2)[:, None]
    for density in (1.0, 0.5):
        matrix = positive(elasticity, density)
        solver.factor(matrix)
        for columns in (0, 1, 5):
            right = np.cos(place * (10.0 + np.arange(columns)))
            solution = solver.solve(right)
            assert solution.shape == right.shape
            residual = elasticity.apply(matrix, solution) - right if columns else solution
            assert elasticity.largest(np.abs(residual)) < 1e-8
        matrix.destroy()
    solver.destroy()


@pytest.mark.mpi
def test_singular_matrix_is_refused_on_every_rank(comm: MPI.Intracomm) -> None:
    elasticity = body(comm)
    matrix = positive(elasticity, 1.0)
    matrix.zeroEntries()
    solver = parted(elasticity)
    with pytest.raises(PETSc.Error):
        solver.factor(matrix)
    for item in (solver, matrix):
        item.destroy()


@pytest.mark.skipif(not module.cholmod.is_known(), reason="PETSc is built without CHOLMOD")
def test_the_end_of_an_ordered_factor_is_that_of_the_schur_complement() -> None:
    """Unknowns in the midst of a chain; and what is not positive definite is refused."""
    n, diagonal = 30, np.eye(30)
    chain = 3.0 * diagonal - np.roll(diagonal, 1, axis=0) - np.roll(diagonal, -1, axis=0)
    rows, columns = np.nonzero(chain)
    begins = np.searchsorted(rows, np.arange(n + 1)).astype(PETSc.IntType)
    selected = np.isin(np.arange(n), [5, 17, 20])
    factor = module.cholmod.OrderedFactor(begins, columns.astype(PETSc.IntType), selected)
    assert factor.factor(chain[rows, columns])
    inverse = np.linalg.inv(chain)
    order = np.argsort(factor.places)[-3:]
    corner = factor.corner(3)
    assert np.allclose(np.linalg.inv(corner @ corner.T), inverse[np.ix_(order, order)], atol=1e-14)
    block = np.empty((n, 2), order="F")
    block[factor.places] = chain[:, :2]
    factor.forward(block)
    factor.backward(block)
    assert np.allclose(block[factor.places], diagonal[:, :2], atol=1e-14)
    assert not factor.factor(-chain[rows, columns])
    factor.destroy()


@pytest.mark.mpi
def test_a_part_without_memory_is_told_on_every_rank(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    elasticity, call = body(comm), module.cholmod._call
    solver, matrix = parted(elasticity), positive(elasticity, 1.0)

    def without(library: object, name: str, *given: object, **how: object) -> object:
        failing = comm.rank == comm.size - 1 and name in ("analyze_p", "factorize")
        return 0 if failing else call(library, name, *given, **how)

    monkeypatch.setattr(module.cholmod, "_call", without)
    for action in (lambda: solver.factor(matrix), lambda: parted(elasticity)):
        with pytest.raises(MemoryError, match=r"no memory .* take solver"):
            action()
    solver.destroy()
    matrix.destroy()


@pytest.mark.mpi
def test_parts_are_factored_where_little_is_between_them(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    elasticity = body(comm)
    matrix = elasticity.new_matrix()
    expected: type[LinearSolver] = SharedFactor if comm.size == 1 else PartedFactor
    little = module.direct_solver(elasticity, matrix)
    monkeypatch.setattr(module, "factor_entries", lambda *_: 100.0)
    much = module.direct_solver(elasticity, matrix)
    monkeypatch.setattr(module.cholmod, "is_known", lambda: False)
    unknown = module.direct_solver(elasticity, matrix)
    assert [*map(type, (little, much, unknown))] == [expected, SharedFactor, SharedFactor]
    for item in (little, much, unknown, matrix):
        item.destroy()


@pytest.mark.mpi
def test_a_factor_that_does_not_fit_is_refused_before_it_is_made(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the solver that would fit; a control group's limit counts as memory of the machine."""
    flexible = rod(comm, (12, 4, 4))
    monkeypatch.setattr(module, "agreed_memory", lambda *_: 10_000)
    expected = r'factor .* 975 unknowns: .*entries are some .*GB, more than .*solver="iterative"'
    with pytest.raises(ValueError, match=expected):
        flexible.reduce(np.ones(flexible.domain.n_cells))


def test_entries_of_a_factor_are_no_more_than_those_of_a_band() -> None:
    """Of a rod a hundred times as long as high, by its sections."""
    elasticity = rod(MPI.COMM_SELF, (400, 4, 4), (4.0, 0.04, 0.04)).elasticity
    matrix = elasticity.new_matrix()
    section = 3 * 5 * 5
    entries = module.factor_entries(elasticity, matrix)
    assert section <= entries / elasticity.n_dofs < 2 * section
    matrix.destroy()
