# SPDX-License-Identifier: MIT
"""Solution by conjugate gradients with algebraic multigrid, for bodies whose factor is too large.

A factor of a body in space has some n^(4/3) entries, a hierarchy of coarser systems has as many as
the matrix. PETSc's smoothed aggregation (GAMG) builds it out of the rigid motions of the body,
which are nearly free on a coarse scale. Nodes of interfaces, which are held, do not take part:
alone in their aggregates they would make coarse systems singular.

All columns of a block are worked on at once, by products of sparse and dense matrices, which are
several times faster than one vector after the other: so the cycles are done here, with PETSc's
hierarchy, and smoothed by polynomials in the matrix.

References:
    P. Vanek, J. Mandel, M. Brezina, Algebraic multigrid by smoothed aggregation for second and
    fourth order elliptic problems, Computing 56 (1996), doi:10.1007/BF02238511.
    A. V. Knyazev, Toward the optimal preconditioned eigensolver: locally optimal block
    preconditioned conjugate gradient method, SIAM Journal on Scientific Computing 23 (2001),
    doi:10.1137/S1064827500366124.
    J. Lottes, Optimal polynomial smoothers for multigrid V-cycles, Numerical Linear Algebra with
    Applications 30 (2023), doi:10.1002/nla.2518.
"""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray
from slepc4py import SLEPc

from ..fem import Block, Elasticity, rigid_fields
from .linear_solver import LinearSolver

__all__ = ["MultigridSolver"]

#: Prefix of the solver's options in PETSc's database, in which a user's own come first. Aggregates
#: that do not reach across the contrast of void and solid take a third of the iterations in void,
#: and two thirds elsewhere. The smoothers are not PETSc's own, whose bounds of eigenvalues break
#: down on that contrast.
PREFIX = "dolfinx_ffr_multigrid_"
OPTIONS = {
    "mg_levels_ksp_type": "richardson",
    "mg_levels_pc_type": "jacobi",
    "pc_gamg_threshold": "0.05",
}
#: Degree of a smoother's polynomial
DEGREE = 3
#: Iterations for the largest eigenvalue of the scaled matrix of a level, and what is added to it
POWER_ITERATIONS, MARGIN = 15, 1.1
#: Iterations after which conjugate gradients and the eigenvalue solver give up
MAX_ITERATIONS, MAX_EIGEN_ITERATIONS = 2000, 500
#: Entry of a diagonal, relative to the largest, below which it is round-off of zero
NOTHING = 1e-14
#: What solutions are exact to, relative to what is asked of modes and adjoints
SHARE = 1e-2


class MultigridSolver(LinearSolver):
    """Solution and lowest modes of a held body without a factor.

    Args:
        elasticity: The body.
        held: Whether a dof of this rank belongs to an interface, shape (dofs,).
        tolerance: Of modes and adjoints. Solutions are exact to a hundredth of it, relative in the
            norm of energy.
    """

    def __init__(self, elasticity: Elasticity, held: NDArray[np.bool_], tolerance: float) -> None:
        self._elasticity = elasticity
        self._tolerance = SHARE * tolerance
        self._free = np.flatnonzero(~held)
        self._stiffness: PETSc.Mat | None = None
        self._mass: PETSc.Mat | None = None
        database = PETSc.Options()
        for name, value in OPTIONS.items():
            if not database.hasName(PREFIX + name):
                database[PREFIX + name] = value
        #: From the coarsest
        self._levels: list[_Level] = []
        self._ksp = ksp = PETSc.KSP().create(elasticity.comm)
        ksp.setOptionsPrefix(PREFIX)
        ksp.setType("preonly")
        ksp.getPC().setType("gamg")
        ksp.setFromOptions()

    def factor(self, matrix: PETSc.Mat) -> None:
        """Build the hierarchy for a matrix."""
        first = self._stiffness is None
        self._stiffness = self._interior(matrix, self._stiffness)
        if first:
            rigid = self._rigid()
            self._stiffness.setNearNullSpace(rigid)
            rigid.destroy()
        self._ksp.setOperators(self._stiffness)
        self._ksp.setUp()
        self._fill_diagonals()
        pc, sum_ = self._ksp.getPC(), self._elasticity.sum
        self._levels = [
            _Level(pc.getMGSmoother(k).getOperators()[0], pc.getMGInterpolation(k), sum_)
            for k in range(1, pc.getMGLevels())
        ]

    def _fill_diagonals(self) -> None:
        """Give coarse systems a diagonal where an aggregate has fewer dofs than rigid motions.

        What is left over of the motions is zero on finer levels: neither load nor solution comes
        there, but a smoother divides by the diagonal.
        """
        pc = self._ksp.getPC()
        for level in range(pc.getMGLevels() - 1):
            matrix = pc.getMGSmoother(level).getOperators()[0]
            diagonal = matrix.getDiagonal()
            largest = diagonal.max()[1]
            values = diagonal.getArray()
            empty = values <= NOTHING * largest
            if self._elasticity.comm.allreduce(int(np.count_nonzero(empty))):
                values[empty] = largest
                matrix.setDiagonal(diagonal)
            diagonal.destroy()

    def _interior(self, matrix: PETSc.Mat, before: PETSc.Mat | None) -> PETSc.Mat:
        """The rows and columns that are not held, in the matrix of the density before."""
        d = self._elasticity.dimension
        rows = matrix.getOwnershipRange()[0] + self._free
        index = PETSc.IS().createGeneral(rows.astype(PETSc.IntType), comm=self._elasticity.comm)
        index.setBlockSize(d)
        interior = matrix.createSubMatrix(index, index, before)
        index.destroy()
        if before is None:
            interior.setBlockSize(d)
        return interior

    def _rigid(self) -> PETSc.NullSpace:
        """The rigid motions, on the nodes that are not held."""
        assert self._stiffness is not None
        elasticity = self._elasticity
        coordinates = elasticity.coordinates()
        center = elasticity.domain.bounding_box.mean(axis=0)
        fields = rigid_fields(coordinates, center)[self._free]
        # orthonormal, as PETSc demands
        gram = elasticity.inner(fields, fields)
        fields = fields @ np.linalg.inv(np.linalg.cholesky(gram)).T
        fields = fields @ np.linalg.inv(np.linalg.cholesky(elasticity.inner(fields, fields))).T
        vectors = [self._vector(column) for column in fields.T]
        space = PETSc.NullSpace().create(vectors=vectors, comm=elasticity.comm)
        for vector in vectors:
            vector.destroy()
        return space

    def _vector(self, column: NDArray[np.float64]) -> PETSc.Vec:
        assert self._stiffness is not None
        vector = self._stiffness.createVecRight()
        vector.setArray(column)
        return vector

    def solve(self, block: Block) -> Block:
        """The inverse times a block.

        Args:
            block: Right-hand sides, shape (dofs of this rank, columns).

        Raises:
            RuntimeError: On every rank, if the iteration does not converge.
        """
        result = np.array(block, dtype=np.float64)  # one on the diagonal of held rows
        if block.shape[1] == 0:
            return result
        found, iterations = self._iterated(
            lambda fields, _: _product(self._stiffness, fields), self._cycle, result[self._free]
        )
        if found is None:
            raise RuntimeError(
                "reduction: conjugate gradients with multigrid did not converge in "
                f"{iterations} iterations: the body is too ill-conditioned for them; take "
                'solver="direct", or a void with more stiffness'
            )
        result[self._free] = found
        return result

    def _iterated(
        self,
        image_of: Callable[[Block, NDArray[np.int64]], Block],
        preconditioned: Callable[[Block], Block],
        loads: Block,
    ) -> tuple[Block | None, int]:
        """Conjugate gradients for each column, all at once, and the number of iterations."""

        def products(a: Block, b: Block) -> NDArray[np.float64]:
            return self._elasticity.sum(np.einsum("ij,ij->j", a, b))

        solution, residual = np.zeros_like(loads), loads.copy()
        going = np.arange(loads.shape[1])
        direction = preconditioned(residual)
        size = products(residual, direction)
        enough = self._tolerance**2 * size
        for iteration in range(MAX_ITERATIONS):
            if not np.all(size >= -enough):  # NaN, or no positive definite preconditioner
                return None, iteration
            keep = size > enough
            if not np.any(keep):
                return solution, iteration
            if not np.all(keep):
                going, direction = going[keep], direction[:, keep]
                residual, size, enough = residual[:, keep], size[keep], enough[keep]
            image = image_of(direction, going)
            step = size / products(direction, image)
            solution[:, going] += step * direction
            residual -= step * image
            cycled = preconditioned(residual)
            before, size = size, products(residual, cycled)
            direction *= size / before
            direction += cycled
        return None, MAX_ITERATIONS

    def solve_shifted(
        self,
        matrices: tuple[PETSc.Mat, PETSc.Mat],
        loads: Block,
        shifts: NDArray[np.float64],
        modes: tuple[Block, Block],
    ) -> tuple[Block, int]:
        """Solve (K - shift_j M) z_j = load_j on the complement of modes.

        There the matrices are positive definite, and multigrid for K serves them all.

        Args:
            matrices: K and M with all interfaces held.
            loads: Orthogonal to the modes, zero where the body is held, shape (dofs, columns).
            shifts: Below the first eigenvalue that does not belong to the modes, shape (columns,).
            modes: Eigenvectors Phi, and M Phi, shape (dofs, k).

        Returns:
            Solutions, M-orthogonal to the modes, shape (dofs, columns), and the number of
            iterations.

        Raises:
            RuntimeError: On every rank, if the iteration does not converge.
        """
        (stiffness, mass), (fields, images) = matrices, modes
        elasticity = self._elasticity

        def image_of(block: Block, columns: NDArray[np.int64]) -> Block:
            image = elasticity.apply(stiffness, block)
            image -= shifts[columns] * elasticity.apply(mass, block)
            return image

        def preconditioned(block: Block) -> Block:
            found = np.zeros_like(block)
            found[self._free] = self._cycle(block[self._free])
            found -= fields @ elasticity.inner(images, found)
            return found

        solution, iterations = self._iterated(image_of, preconditioned, loads)
        if solution is None:
            raise RuntimeError(
                "reduction: the adjoint of the normal modes did not converge in "
                f"{iterations} iterations with multigrid; choose a number of modes that does not "
                'cut through close frequencies, or take solver="direct"'
            )
        return solution, iterations

    def _cycle(self, block: Block) -> Block:
        """One cycle of multigrid, a symmetric approximation of the inverse, on free dofs."""
        return self._cycle_from(len(self._levels) - 1, block)

    def _cycle_from(self, k: int, block: Block) -> Block:
        if k < 0:
            return self._coarse(block)
        level = self._levels[k]
        found, residual = level.smooth(None, block)
        coarse = _product(level.interpolation, residual, transposed=True)
        correction = _product(level.interpolation, self._cycle_from(k - 1, coarse))
        found += correction
        residual -= _product(level.matrix, correction)
        return level.smooth(found, residual, last=True)[0]

    def _coarse(self, block: Block) -> Block:
        """The inverse of the coarsest system, which is small."""
        solver, result = self._ksp.getPC().getMGCoarseSolve(), np.empty_like(block, order="F")
        right = solver.getOperators()[0].createVecRight()
        solution = right.duplicate()
        for i in range(block.shape[1]):
            right.setArray(block[:, i])
            solver.solve(right, solution)
            result[:, i] = solution.getArray(readonly=True)
        right.destroy()
        solution.destroy()
        return result

    def modes(
        self, mass: PETSc.Mat, starts: Block, number: int, known: Block | None
    ) -> tuple[NDArray[np.float64], Block]:
        """The lowest eigenpairs, by the locally optimal block preconditioned conjugate gradients.

        Args:
            mass: M with all interfaces held.
            starts: Fields that the iteration begins with, as many as it takes at a time, shape
                (dofs, b).
            number: How many are asked for.
            known: Eigenvectors to whose M-complement the others belong, shape (dofs, k).

        Returns:
            Eigenvalues as they were found, at least ``number``, and M-orthonormal eigenvectors,
            shape (dofs, found).

        Raises:
            RuntimeError: On every rank, if they do not converge.
        """
        assert self._stiffness is not None
        self._mass = self._interior(mass, self._mass)
        eps = SLEPc.EPS().create(self._elasticity.comm)
        transform = eps.getST()
        ksp = transform.getKSP()
        begin = [self._vector(column[self._free]) for column in starts.T]
        deflated = [] if known is None else [self._vector(c[self._free]) for c in known.T]
        vector = self._stiffness.createVecRight()
        try:
            eps.setOperators(self._stiffness, self._mass)
            eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
            eps.setType(SLEPc.EPS.Type.LOBPCG)
            eps.setWhichEigenpairs(SLEPc.EPS.Which.SMALLEST_REAL)
            eps.setDimensions(number)
            eps.setLOBPCGBlockSize(starts.shape[1])
            eps.setTolerances(self._tolerance, MAX_EIGEN_ITERATIONS)
            transform.setType(SLEPc.ST.Type.PRECOND)
            ksp.setType("preonly")
            ksp.getPC().setType("python")
            ksp.getPC().setPythonContext(_Cycle(self._cycle))
            # all at once: one by one, each inner product by mass takes a product with the matrix
            eps.getBV().setOrthogonalization(block=SLEPc.BV.OrthogBlockType.SVQB)
            eps.setInitialSpace(begin)
            if deflated:
                eps.setDeflationSpace(deflated)
            eps.solve()
            converged = eps.getConverged()
            if converged < number:
                raise RuntimeError(
                    f"reduction: only {converged} of {number} normal modes converged in "
                    f"{eps.getIterationNumber()} iterations with multigrid; take solver="
                    '"direct"; or the mesh is too coarse for so many modes, or the design has '
                    "fallen apart"
                )
            eigenvalues = np.empty(converged)
            fields = np.zeros((len(starts), converged))
            for i in range(converged):
                eigenvalues[i] = eps.getEigenpair(i, vector).real
                fields[self._free, i] = vector.getArray(readonly=True)
        finally:
            for item in (ksp, transform, eps, vector, *begin, *deflated):
                item.destroy()
        return eigenvalues, fields

    def destroy(self) -> None:
        for item in (self._ksp, self._stiffness, self._mass):
            if item is not None:
                item.destroy()


class _Level:
    """A level of the hierarchy but the coarsest, with its smoother.

    The smoother is Chebyshev's polynomial of the fourth kind in the matrix scaled by its diagonal,
    of which only the largest eigenvalue need be known.

    Args:
        matrix: Of the level.
        interpolation: To it from the coarser one.
        sum_: The sum over the ranks of an array.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        interpolation: PETSc.Mat,
        sum_: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    ) -> None:
        self.matrix, self.interpolation = matrix, interpolation
        diagonal = matrix.getDiagonal()
        self._scale = 1.0 / diagonal.getArray(readonly=True)[:, None]
        diagonal.destroy()
        rows = np.arange(*matrix.getOwnershipRange())[:, None]
        fields, largest = np.sin(rows * np.array([1.0, 2.6])) + 0.1, np.ones(1)
        for _ in range(POWER_ITERATIONS):
            fields = self._scale * _product(matrix, fields)
            largest = np.sqrt(sum_(np.einsum("ij,ij->j", fields, fields)))
            fields = fields / largest
        self._largest = MARGIN * float(np.max(largest))

    def smooth(
        self, found: Block | None, residual: Block, *, last: bool = False
    ) -> tuple[Block, Block]:
        """Better solutions, and their residuals unless these are the last.

        Args:
            found: Solutions so far, None for zero.
            residual: Of them.
            last: Whether the residuals are not needed.
        """
        change = np.zeros_like(residual)
        found = np.zeros_like(residual) if found is None else found.copy(order="F")
        for k in range(1, DEGREE + 1):
            change *= (2 * k - 3) / (2 * k + 1)
            change += (8 * k - 4) / (2 * k + 1) / self._largest * self._scale * residual
            found += change
            if k < DEGREE or not last:
                residual = residual - _product(self.matrix, change)
        return found, residual


class _Cycle:
    """One cycle of multigrid as a preconditioner of PETSc's.

    Args:
        cycle: Of a block.
    """

    def __init__(self, cycle: Callable[[Block], Block]) -> None:
        self._cycle = cycle

    def apply(self, _: PETSc.PC, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        solution.setArray(self._cycle(right.getArray(readonly=True)[:, None])[:, 0])

    def matApply(self, _: PETSc.PC, right: PETSc.Mat, solution: PETSc.Mat) -> None:
        """The same for many vectors, by the name that PETSc looks for."""
        solution.getDenseArray()[:] = self._cycle(right.getDenseArray(readonly=True))


def _product(matrix: PETSc.Mat, block: Block, *, transposed: bool = False) -> Block:
    """A matrix times the part of a block on this rank."""
    ranges = matrix.getOwnershipRanges() if transposed else matrix.getOwnershipRangesColumn()
    if np.any(np.diff(ranges) == 0):  # PETSc 3.25 fails on blocks of which a rank has no rows
        return _product_by_columns(matrix, block, transposed=transposed)
    rows = matrix.getLocalSize()[0 if transposed else 1]
    dense = PETSc.Mat().createDense(
        ((rows, PETSc.DETERMINE), (PETSc.DECIDE, block.shape[1])),
        array=np.asfortranarray(block, dtype=PETSc.ScalarType).ravel(order="F"),
        comm=matrix.getComm(),
    )
    dense.assemble()
    product = matrix.transposeMatMult(dense) if transposed else matrix.matMult(dense)
    result = np.array(product.getDenseArray(), order="F")
    product.destroy()
    dense.destroy()
    return result


def _product_by_columns(matrix: PETSc.Mat, block: Block, *, transposed: bool) -> Block:
    """The same by one vector after the other."""
    right, left = matrix.createVecs()
    source, target = (left, right) if transposed else (right, left)
    multiply = matrix.multTranspose if transposed else matrix.mult
    result = np.empty((target.getLocalSize(), block.shape[1]), order="F")
    for i in range(block.shape[1]):
        source.setArray(block[:, i])
        multiply(source, target)
        result[:, i] = target.getArray(readonly=True)
    left.destroy()
    right.destroy()
    return result
