# SPDX-License-Identifier: MIT
"""Solution of symmetric positive definite systems whose rows are shared by ranks.

CHOLMOD solves 1.6 to 3 times as fast as MUMPS, but runs on one rank only. So where the memory
suffices, a few ranks hold the whole factor each, and share the columns of a block. A body whose
factor is too large for that is factored by MUMPS, its rows on all ranks.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from ..arrays import Integers
from ..fem import Block, Elasticity, by_dense, dense_matrix
from ..limits import check_count
from ..parallel import agreed_memory

#: How bodies are solved: by factors, or by conjugate gradients with multigrid
SOLVERS = DIRECT, ITERATIVE = "direct", "iterative"
#: Most ranks that hold a whole factor: a block has few columns.
HOLDERS = 4
#: Share of the memory of a machine that copies of a factor may take
SHARE = 0.25
#: Names of CHOLMOD in PETSc, which depend on how that was built
CHOLMOD = ("cholmod", "suitesparse")
#: Options of CHOLMOD. Below so many operations for each entry of the factor its columns are taken
#: one by one: dense blocks of them, of which CHOLMOD makes some from 40 on, are then too small, and
#: at 55 take a quarter more time. By Cholesky's L L^T, which refuses what is not positive definite,
#: as CHOLMOD's L D L^T does not
_CHOLMOD = {"supernodal_switch": 64.0, "final_asis": False, "final_ll": True}
_PREFIX = "dolfinx_ffr_"


class LinearSolver(ABC):
    """Solution with one matrix after the other, all of the same sparsity pattern."""

    @abstractmethod
    def factor(self, matrix: PETSc.Mat) -> None:
        """Prepare for a symmetric positive definite matrix; PETSc.Error if it is singular."""

    @abstractmethod
    def solve(self, block: Block) -> Block:
        """The inverse times right-hand sides, shape (dofs of this rank, columns)."""

    @abstractmethod
    def destroy(self) -> None:
        """Free the memory on all ranks together."""


def direct_solver(elasticity: Elasticity, matrix: PETSc.Mat) -> LinearSolver:
    """The solver for the matrices of a body, all like ``matrix``; collective.

    Raises:
        ValueError: On every rank, if the memory of the machine does not hold a factor.
    """
    comm = elasticity.comm
    check_memory(elasticity, matrix, 'take solver="iterative" for the body, or fewer elements')
    if comm.size > 1 and _has_cholmod() and copies_fit(elasticity, matrix):
        return CopiedFactor(elasticity)
    return SharedFactor(elasticity, factor_package(comm))


def factor_package(comm: MPI.Comm) -> str:
    """The library for a factor whose rows all ranks share."""
    return "cholmod" if comm.size == 1 and _has_cholmod() else "mumps"


def _has_cholmod() -> bool:
    return any(map(PETSc.Sys.hasExternalPackage, CHOLMOD))


def factor_entries(elasticity: Elasticity, matrix: PETSc.Mat) -> float:
    """About how many entries a factor of a matrix of the body has."""
    n, entries = matrix.size[0], _entries(matrix)
    # By nested dissection a factor has more entries than the matrix in proportion to log n in the
    # plane and to n^(1/3) in space; 0.23 log2(n) times as many were seen with 130,000 unknowns.
    growth = math.log2(max(n, 2)) if elasticity.dimension == 2 else n ** (1.0 / 3.0)
    # of a slender body it has no more than the band that sections across it make
    domain = elasticity.domain
    length = float(np.ptp(domain.bounding_box, axis=0).max())
    band = n * domain.cell_size / (domain.order * length)
    return min(0.35 * entries * growth, n * max(band, entries / n))


def check_memory(elasticity: Elasticity, matrix: PETSc.Mat, remedy: str) -> None:
    """Refuse a factor that the memory of all ranks does not hold: ValueError on every rank."""
    comm = matrix.comm.tompi4py()
    check_count(
        f"reduction: a factor of the stiffness of a body with {matrix.size[0]:,} unknowns",
        factor_entries(elasticity, matrix),
        "entries",
        remedy,
        each=8.0,
        most=math.inf,
        available=comm.size * agreed_memory(comm),
    )


def copies_fit(elasticity: Elasticity, matrix: PETSc.Mat) -> bool:
    """Whether the memory lets a few ranks hold the whole factor each; the same on every rank."""
    largest = 16.0 * factor_entries(elasticity, matrix) + 12.0 * _entries(matrix)
    return bool(largest <= SHARE * agreed_memory(matrix.comm.tompi4py(), HOLDERS))


def _entries(matrix: PETSc.Mat) -> float:
    return float(matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_allocated"])


def _ksp(comm: MPI.Comm, package: str) -> PETSc.KSP:
    """A solver that holds a Cholesky factor made by ``package``, and raises where that fails."""
    ksp = PETSc.KSP().create(comm)
    ksp.setType("preonly")
    pc = ksp.getPC()
    pc.setType("cholesky")
    pc.setFactorSolverType(package)
    ksp.setErrorIfNotConverged(True)
    ksp.setOptionsPrefix(_PREFIX)
    options = PETSc.Options(f"{_PREFIX}mat_cholmod_")
    for name, value in _CHOLMOD.items():
        if not options.hasName(name):  # else it is the user's
            options[name] = value
    return ksp


def solved(pc: PETSc.PC, right: PETSc.Mat) -> Block:
    """The solution by a factor for a dense matrix of right-hand sides, which is destroyed."""

    def solution(right: PETSc.Mat) -> PETSc.Mat:
        left = right.duplicate()
        pc.getFactorMatrix().matSolve(right, left)
        return left

    return by_dense(solution, right)


class SharedFactor(LinearSolver):
    """One factor by a library (``package``), its rows on all ranks."""

    def __init__(self, elasticity: Elasticity, package: str) -> None:
        self._elasticity = elasticity
        self._ksp = _ksp(elasticity.comm, package)

    def factor(self, matrix: PETSc.Mat) -> None:
        self._ksp.setOperators(matrix)
        self._ksp.setUp()

    def solve(self, block: Block) -> Block:
        if block.shape[1] == 0:
            return np.zeros_like(block)
        return solved(self._ksp.getPC(), self._elasticity.dense(block))

    def destroy(self) -> None:
        self._ksp.destroy()


class CopiedFactor(LinearSolver):
    """The same factor on a few ranks, which share the columns of a block."""

    def __init__(self, elasticity: Elasticity) -> None:
        self._comm = comm = elasticity.comm
        self._holders = min(comm.size, HOLDERS)
        self._rows = np.array(comm.allgather(elasticity.n_dofs))  # of each rank
        self._size = int(self._rows.sum())
        self._ksp = _ksp(PETSc.COMM_SELF, "cholmod") if comm.rank < self._holders else None
        self._matrix: PETSc.Mat | None = None
        self._pattern: tuple[NDArray[np.int32], NDArray[np.int32]] | None = None
        self._entries = np.zeros(0, dtype=np.int64)  # of each rank

    def factor(self, matrix: PETSc.Mat) -> None:
        indptr, indices, values = matrix.getValuesCSR()
        if self._pattern is None:
            self._entries = np.array(self._comm.allgather(len(values)))
            lengths = self._gathered(np.diff(indptr).astype(np.int32), self._rows)
            columns = self._gathered(np.asarray(indices, dtype=np.int32), self._entries)
            begins = np.concatenate([[0], np.cumsum(lengths)]).astype(PETSc.IntType)
            self._pattern = begins, columns.astype(PETSc.IntType)
        values = self._gathered(values, self._entries)
        failed = 0
        if self._ksp is not None:
            try:
                if self._matrix is None:
                    self._matrix = PETSc.Mat().createAIJ(
                        (self._size, self._size), csr=(*self._pattern, values), comm=PETSc.COMM_SELF
                    )
                else:
                    self._matrix.setValuesCSR(*self._pattern, values)
                self._matrix.assemble()
                self._ksp.setOperators(self._matrix)
                self._ksp.setUp()
            except PETSc.Error as error:
                failed = error.ierr
        failed = self._comm.allreduce(failed, MPI.MAX)
        if failed:
            raise PETSc.Error(failed)

    def _gathered(self, part: NDArray, counts: Integers) -> NDArray:
        """The parts of all ranks, one after the other."""
        whole = np.empty(int(counts.sum()), dtype=part.dtype)
        self._comm.Allgatherv(np.ascontiguousarray(part), (whole, counts))
        return whole

    def solve(self, block: Block) -> Block:
        n, columns = block.shape
        # columns of each rank; the first ones get one more where they cannot have the same
        share = np.zeros(self._comm.size, dtype=np.int64)
        share[: self._holders] = (columns + np.arange(self._holders)[::-1]) // self._holders
        mine = int(share[self._comm.rank])
        # column by column in memory, what is sent to one rank stands together
        arrived = np.empty(self._size * mine)
        sent = np.asfortranarray(block, dtype=np.float64).ravel(order="F")
        self._comm.Alltoallv((sent, n * share), (arrived, self._rows * mine))
        found = np.empty_like(arrived)
        if mine and self._ksp is not None:
            ends = np.cumsum(self._rows)[:-1]
            parts = np.split(arrived, ends * mine)
            right = np.vstack([part.reshape(-1, mine, order="F") for part in parts])
            dense = dense_matrix(PETSc.COMM_SELF, right)
            left = np.split(solved(self._ksp.getPC(), dense), ends)
            found = np.concatenate([part.ravel(order="F") for part in left])
        result = np.empty(n * columns)
        self._comm.Alltoallv((found, self._rows * mine), (result, n * share))
        return result.reshape(n, columns, order="F")

    def destroy(self) -> None:
        for item in (self._ksp, self._matrix):
            if item is not None:
                item.destroy()
