# SPDX-License-Identifier: MIT
"""Solution of symmetric positive definite systems whose rows are shared by ranks.

CHOLMOD is faster than MUMPS (CPU time in the plane, 33,000 unknowns: factor and solution 2.5 times;
in space, 20,000: solution 1.2 times), but runs on one rank only. So each rank factors the matrix of
its own unknowns and of those between the parts, which come last: of this L L^T the corner of the
last unknowns g is that of A_gg - A_gi A_ii^-1 A_ig. Nothing but the corners is left to be added up,
factored as one matrix, and solved with, which every rank does. Where so many ranks share a body
that the corners are much of it, MUMPS factors, its rows on all ranks. Value and gradient of the
slider-cranks on two ranks, CPU time of the busier one, with the same memory within 5 %; the last on
a machine that had other work, where ranks that wait for each other count, too:

    unknowns                parts [s]   MUMPS [s]
    8,442, in the plane       0.18        0.44
    19,683, in space          0.94        1.32
    70,227, in space          4.5        13.3
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.sparse import csr_array

from ..arrays import Integers
from ..fem import Block, Elasticity, dense_matrix
from ..limits import check_count
from ..parallel import agreed_memory, on_every_rank
from . import cholmod

#: How bodies are solved: by factors, or by conjugate gradients with multigrid
SOLVERS = DIRECT, ITERATIVE = "direct", "iterative"
#: Names of CHOLMOD in PETSc, which depend on how that was built
CHOLMOD = ("cholmod", "suitesparse")
#: PETSc's number of the error that a matrix is not positive definite
_SINGULAR = 81
#: Options of CHOLMOD on one rank. Below so many operations for each entry of the factor its columns
#: are taken one by one: dense blocks of them, of which CHOLMOD makes some from 40 on, are then too
#: small, and at 55 take a quarter more time. By L L^T, which refuses what is not positive definite,
#: as CHOLMOD's L D L^T does not
_CHOLMOD = {"supernodal_switch": 64.0, "final_asis": False, "final_ll": True}
_PREFIX = "dolfinx_ffr_"


@dataclass(frozen=True)
class FactorOptions:
    """When ranks factor parts of a body, and when the entries of a factor are counted."""

    #: Share of the entries of the whole factor that the factor between parts may have: every rank
    #: makes it, and solves with it
    most_between: float = 0.25
    hopeless: float = 5.0  #: Times the entries that fit from which on they are not counted


FACTOR = FactorOptions()


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
    """The solver for the matrices of a body, all like ``matrix``."""
    comm = elasticity.comm
    check_memory(elasticity, matrix, 'take solver="iterative" for the body, or fewer elements')
    if comm.size > 1 and cholmod.is_known():
        between = Between.of(elasticity, matrix)
        if parts_pay(elasticity, matrix, between.entries):
            return PartedFactor(elasticity, matrix, between)
    return SharedFactor(elasticity, factor_package(comm))


def factor_package(comm: MPI.Comm) -> str:
    """The library for a factor whose rows all ranks share."""
    has_cholmod = comm.size == 1 and any(map(PETSc.Sys.hasExternalPackage, CHOLMOD))
    return "cholmod" if has_cholmod else "mumps"


def factor_entries(elasticity: Elasticity, matrix: PETSc.Mat, most: float = math.inf) -> float:
    """About how many entries a factor of a matrix of the body has.

    Where that may be more than ``most``, they are counted if one rank has the body: solids with
    many windows have a third of what is estimated. Not where it is hopeless, as that takes minutes.
    """
    n, entries = matrix.size[0], _entries(matrix)
    # By nested dissection a factor has more entries than the matrix in proportion to log n in the
    # plane and to n^(1/3) in space; 0.23 log2(n) times as many were seen with 130,000 unknowns.
    growth = math.log2(max(n, 2)) if elasticity.dimension == 2 else n ** (1.0 / 3.0)
    # of a slender body it has no more than the band that sections across it make
    domain = elasticity.domain
    length = float(np.ptp(domain.bounding_box, axis=0).max())
    band = n * domain.cell_size / (domain.order * length)
    estimate = min(0.35 * entries * growth, n * max(band, entries / n))
    if (
        not most < estimate < FACTOR.hopeless * most
        or matrix.comm.size > 1
        or not cholmod.is_known()
    ):
        return estimate
    begins, columns, _ = matrix.getValuesCSR()
    try:
        factor = cholmod.OrderedFactor(begins, columns, np.zeros(n, dtype=bool))
    except MemoryError:  # nor is there any for the factor
        return estimate
    factor.destroy()
    return factor.entries


def check_memory(elasticity: Elasticity, matrix: PETSc.Mat, remedy: str) -> None:
    """Refuse a factor that the memory of all ranks does not hold: ValueError."""
    comm = matrix.comm.tompi4py()
    room = comm.size * agreed_memory(comm)
    check_count(
        f"reduction: a factor of the stiffness of a body with {matrix.size[0]:,} unknowns",
        factor_entries(elasticity, matrix, room / 8.0),
        "entries",
        remedy,
        each=8.0,
        most=math.inf,
        available=room,
    )


def parts_pay(elasticity: Elasticity, matrix: PETSc.Mat, between: float) -> bool:
    """Whether a factor with entries ``between`` parts, which every rank makes, is small enough."""
    return between <= FACTOR.most_between * factor_entries(elasticity, matrix)


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
    solution = np.empty((right.getLocalSize()[0], right.getSize()[1]), order="F")
    target = dense_matrix(right.getComm(), solution)  # of these entries
    pc.getFactorMatrix().matSolve(right, target)
    target.destroy()
    right.destroy()
    return solution


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


@dataclass(frozen=True, eq=False)
class Between:
    """Unknowns without which no rank's unknowns are coupled to another rank's."""

    every: Integers  #: Of all ranks, in the numbers of the matrix
    own: Integers  #: Of this rank
    beside: Integers  #: To which unknowns of this rank are coupled, its own ones included
    entries: float  #: Estimate for the factor between parts

    @staticmethod
    def of(elasticity: Elasticity, matrix: PETSc.Mat) -> Between:
        """Of each coupling the one with more of them, as is a node on a cut between elements.

        Each rank has some nodes of a cut; its other unknowns are coupled to them alone.
        """
        begin, end = matrix.getOwnershipRange()
        begins, coupled_to, _ = matrix.getValuesCSR()
        rows = np.repeat(np.arange(begin, end), np.diff(begins))
        across = (coupled_to < begin) | (coupled_to >= end)
        rows, columns = rows[across], coupled_to[across]
        separator, place, counts = np.unique(rows, return_inverse=True, return_counts=True)
        gathered = zip(*elasticity.comm.allgather((separator, counts)), strict=True)
        coupled, couplings = map(np.concatenate, gathered)
        couplings_of_row = counts[place]
        couplings_of_column = couplings[np.searchsorted(coupled, columns)]
        has_more = couplings_of_row > couplings_of_column
        is_first = (couplings_of_row == couplings_of_column) & (rows < columns)
        separator = np.unique(rows[has_more | is_first])
        of_all_ranks = np.concatenate(elasticity.comm.allgather(separator))
        beside = np.intersect1d(coupled_to, of_all_ranks)
        entries = elasticity.comm.allreduce(0.5 * len(beside) ** 2)
        return Between(of_all_ranks, separator, beside, entries)


class PartedFactor(LinearSolver):
    """A factor of its part of the body on each rank, and a factor of the cuts between the parts."""

    def __init__(self, elasticity: Elasticity, matrix: PETSc.Mat, between: Between) -> None:
        self._elasticity, comm = elasticity, elasticity.comm
        begin, end = matrix.getOwnershipRange()
        unknowns = np.union1d(np.arange(begin, end), between.beside).astype(PETSc.IntType)
        index = PETSc.IS().createGeneral(unknowns, PETSc.COMM_SELF)
        self._part, self._matrix = unknowns, matrix.createSubMatrices(index)[0]
        index.destroy()
        begins, columns, _ = self._matrix.getValuesCSR()
        is_between = np.isin(unknowns, between.every)
        with on_every_rank(comm, "the order of a factor"):
            self._factor = cholmod.OrderedFactor(begins, columns, is_between)
        places = self._factor.places
        order = np.argsort(places)
        #: Places in L of the last unknowns, and their numbers between the parts
        self._corner = np.sort(places[is_between])
        self._number = np.searchsorted(between.every, unknowns[order[self._corner]])
        #: Of each place in L the row of this rank, some row where it has none, and back
        self._rows = np.clip(unknowns[order] - begin, 0, max(end - begin - 1, 0))
        self._places = places[(unknowns >= begin) & (unknowns < end)]
        #: Rows of this rank between the parts, and their numbers there
        self._edge = between.own - begin, np.searchsorted(between.every, between.own)
        # how many ranks add to each entry of the matrix between parts
        pairs = [np.stack(np.broadcast_arrays(k[:, None], k)) for k in comm.allgather(self._number)]
        rows, columns_of_pairs = np.hstack([pair.reshape(2, -1) for pair in pairs])
        size = len(between.every)
        ranks = csr_array((np.ones(len(rows)), (rows, columns_of_pairs)), (size, size))
        ranks.sort_indices()
        begins_, columns_ = (k.astype(PETSc.IntType) for k in (ranks.indptr, ranks.indices))
        with on_every_rank(comm, "the order of what is between parts"):
            self._between = cholmod.OrderedFactor(begins_, columns_, np.zeros(size, dtype=bool))
        keys = np.repeat(np.arange(size), np.diff(ranks.indptr)) * size + ranks.indices
        places_of_pairs = self._number[:, None] * size + self._number
        #: Where this rank's corner adds to the entries, of so many
        self._added, self._count = np.searchsorted(keys, places_of_pairs), len(keys)
        # Entries between the parts, their rows and columns in the corner, which holds all of them,
        # and what is taken off: ranks add 1 / (number of ranks that have it) of each entry of A_gg
        number = np.full(len(unknowns), -1)
        number[order[self._corner]] = np.arange(len(self._corner))
        i, j = number[np.repeat(np.arange(len(unknowns)), np.diff(begins))], number[columns]
        entries = np.flatnonzero((i >= 0) & (j >= 0))
        self._entries = (
            entries,
            i[entries],
            j[entries],
            1.0 / ranks.data[self._added[i[entries], j[entries]]] - 1.0,
        )

    def factor(self, matrix: PETSc.Mat) -> None:
        index = PETSc.IS().createGeneral(self._part, PETSc.COMM_SELF)
        matrix.createSubMatrices(index, submats=[self._matrix])
        index.destroy()
        values = self._matrix.getValuesCSR()[2]
        with on_every_rank(self._elasticity.comm, "a factor"):
            positive = self._factor.factor(values)
        self._last = self._factor.corner(len(self._corner))
        corner = self._last @ self._last.T
        entries, i, j, share = self._entries
        corner[i, j] += share * values[entries]
        summed = np.zeros(self._count)
        summed[self._added] = corner
        with on_every_rank(self._elasticity.comm, "the factor between parts"):
            positive &= self._between.factor(self._elasticity.sum(summed))
        if not self._elasticity.comm.allreduce(positive, MPI.LAND):
            raise PETSc.Error(_SINGULAR)

    def solve(self, block: Block) -> Block:
        if block.shape[1] == 0:
            return np.zeros_like(block)
        local = _columns_at(block, self._rows)
        local[self._corner] = 0.0
        self._factor.forward(local)
        right = np.zeros((self._between.size, block.shape[1]))
        right[self._number] = self._last @ local[self._corner]
        rows, numbers = self._edge
        right[numbers] += block[rows]
        middle = self._between.solve(self._elasticity.sum(right))
        local[self._corner] = self._last.T @ middle[self._number]
        self._factor.backward(local)
        result = _columns_at(local, self._places)
        result[rows] = middle[numbers]
        return result

    def destroy(self) -> None:
        for item in (self._factor, self._between, self._matrix):
            item.destroy()


def _columns_at(block: Block, rows: Integers) -> Block:
    """Rows of a ``block``, column by column, which takes a third of the time."""
    result = np.empty((len(rows), block.shape[1]), order="F")
    for source, target in zip(block.T, result.T, strict=True):
        np.take(source, rows, out=target, mode="clip")
    return result
