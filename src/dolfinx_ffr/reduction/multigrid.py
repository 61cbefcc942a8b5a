# SPDX-License-Identifier: MIT
"""Solution by conjugate gradients with algebraic multigrid, for bodies whose factor is too large.

A factor of a body in space has some n^(4/3) entries, a hierarchy of coarser systems has as many as
the matrix. PETSc's smoothed aggregation (GAMG) builds it out of the rigid motions of the body,
which are nearly free on a coarse scale. Nodes of interfaces, which are held, do not take part:
alone in their aggregates they would make coarse systems singular.

References:
    P. Vanek, J. Mandel, M. Brezina, Algebraic multigrid by smoothed aggregation for second and
    fourth order elliptic problems, Computing 56 (1996), doi:10.1007/BF02238511.
    A. V. Knyazev, Toward the optimal preconditioned eigensolver: locally optimal block
    preconditioned conjugate gradient method, SIAM Journal on Scientific Computing 23 (2001),
    doi:10.1137/S1064827500366124.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray
from slepc4py import SLEPc

from ..fem import Block, Elasticity, rigid_fields
from .linear_solver import LinearSolver

__all__ = ["MultigridSolver"]

#: Prefix of the solver's options in PETSc's database, in which a user's own come first. A sweep of
#: SOR bears the contrast of void and solid, on which the default, Chebyshev's polynomial with
#: Jacobi's method, breaks down; aggregates that do not reach across it take a third of the
#: iterations in void, and two thirds elsewhere.
PREFIX = "dolfinx_ffr_multigrid_"
OPTIONS = {
    "mg_levels_ksp_type": "richardson",
    "mg_levels_pc_type": "sor",
    "pc_gamg_threshold": "0.05",
}
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
        self._ksp = ksp = PETSc.KSP().create(elasticity.comm)
        ksp.setOptionsPrefix(PREFIX)
        ksp.setType("cg")
        ksp.setNormType(PETSc.KSP.NormType.NATURAL)
        ksp.setTolerances(rtol=self._tolerance, atol=0.0, max_it=MAX_ITERATIONS)
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
        right = self._vector(block[self._free, 0])
        solution = right.duplicate()
        try:
            for i in range(block.shape[1]):
                right.setArray(block[self._free, i])
                self._ksp.solve(right, solution)
                reason = self._ksp.getConvergedReason()
                if reason < 0:
                    raise RuntimeError(
                        "reduction: conjugate gradients with multigrid did not converge in "
                        f"{self._ksp.getIterationNumber()} iterations (PETSc's reason {reason}): "
                        'the body is too ill-conditioned for them; take solver="direct", or a void '
                        "with more stiffness"
                    )
                result[self._free, i] = solution.getArray(readonly=True)
        finally:
            right.destroy()
            solution.destroy()
        return result

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
        elasticity, count = self._elasticity, loads.shape[1]

        def products(a: Block, b: Block) -> NDArray[np.float64]:
            return elasticity.sum(np.einsum("ij,ij->j", a, b))

        def preconditioned(block: Block) -> Block:
            found = self._cycles(block)
            return np.asarray(found - fields @ elasticity.inner(images, found))

        solution, residual = np.zeros_like(loads), loads.copy()
        going = np.arange(count)
        direction = preconditioned(residual)
        size = products(residual, direction)
        enough = self._tolerance**2 * size
        for iteration in range(MAX_ITERATIONS):
            keep = size > enough
            if not np.any(keep):
                return solution, iteration
            going, direction = going[keep], direction[:, keep]
            residual, size, enough = residual[:, keep], size[keep], enough[keep]
            image = elasticity.apply(stiffness, direction)
            image -= shifts[going] * elasticity.apply(mass, direction)
            step = size / products(direction, image)
            solution[:, going] += step * direction
            residual -= step * image
            cycled = preconditioned(residual)
            before, size = size, products(residual, cycled)
            direction = cycled + size / before * direction
        raise RuntimeError(
            "reduction: the adjoint of the normal modes did not converge in "
            f"{MAX_ITERATIONS} iterations with multigrid; choose a number of modes that does not "
            'cut through close frequencies, or take solver="direct"'
        )

    def _cycles(self, block: Block) -> Block:
        """One cycle of multigrid for each column, zero where the body is held."""
        result = np.zeros_like(block)
        right = self._vector(block[self._free, 0])
        solution = right.duplicate()
        for i in range(block.shape[1]):
            right.setArray(block[self._free, i])
            self._ksp.getPC().apply(right, solution)
            result[self._free, i] = solution.getArray(readonly=True)
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
            ksp.getPC().setPythonContext(_Cycle(self._ksp.getPC()))
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


class _Cycle:
    """One cycle of multigrid as a preconditioner.

    Args:
        multigrid: That of the solver.
    """

    def __init__(self, multigrid: PETSc.PC) -> None:
        self._multigrid = multigrid

    def apply(self, _: PETSc.PC, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        self._multigrid.apply(right, solution)
