# SPDX-License-Identifier: MIT
"""Matrices of one body at one density, with all interfaces clamped, and the factor of K."""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from ..arrays import Mask
from ..fem import Block, Elasticity, Matrices
from .direct_solver import ITERATIVE, LinearSolver, direct_solver
from .multigrid import MultigridSolver

_SAME = PETSc.Mat.Structure.SAME_NONZERO_PATTERN


@dataclass(frozen=True, eq=False)
class ClampedMatrices:
    """Matrices with all interfaces clamped, and the solver for the stiffness.

    One density after the other is written into them: pattern and ordering stay.
    """

    stiffness: PETSc.Mat  #: One on the diagonal of clamped rows
    mass: PETSc.Mat  #: Zero in clamped rows
    solver: LinearSolver  #: Holds the factor of the stiffness, or coarser systems

    @staticmethod
    def of(elasticity: Elasticity, clamped: Mask, solver: str, tolerance: float) -> ClampedMatrices:
        """Matrices without values yet; ``clamped`` has shape (dofs of this rank,)."""
        stiffness, mass = elasticity.new_matrix(), elasticity.new_matrix(mass=True)
        if solver == ITERATIVE:
            return ClampedMatrices(stiffness, mass, MultigridSolver(elasticity, clamped, tolerance))
        return ClampedMatrices(stiffness, mass, direct_solver(elasticity, stiffness))

    def fill(self, matrices: Matrices, rows: NDArray[np.int32]) -> None:
        """Write the matrices of a density, its owned ``rows`` clamped, and factor the stiffness."""
        for source, target, diagonal in (
            (matrices.stiffness, self.stiffness, 1.0),
            (matrices.mass, self.mass, 0.0),
        ):
            source.copy(target, _SAME)
            target.zeroRowsColumnsLocal(rows, diagonal)
        self.solver.factor(self.stiffness)

    def count_below(self, limit: float, *, last: bool = False) -> int:
        """The number of eigenvalues below a limit, copies included, the same on every rank.

        The ``last`` one takes the place of the solver and of the stiffness, which need the memory.
        """
        # by Sylvester's law the number of negative pivots of K - limit M; CHOLMOD has no pivoting
        if last:
            self.solver.destroy()
        shifted = self.stiffness if last else self.stiffness.copy()
        shifted.axpy(-limit, self.mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        pc = PETSc.PC().create(shifted.comm)
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        pc.setOperators(shifted)
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        factor.setMumpsIcntl(13, 1)  # no part of the matrix is left to ScaLAPACK, uncounted
        factor.setMumpsIcntl(14, 100)  # memory for pivots that are put off, in percent
        factor.setMumpsIcntl(24, 1)  # PETSc demands that zero pivots are looked for
        factor.setMumpsIcntl(31, 1)  # discard the factor: nothing is solved with it
        pc.setUp()
        state = factor.getMumpsInfog(1)  # PETSc goes on where MUMPS fails
        count = int(factor.getInertia()[0]) if state >= 0 else 0
        for item in (factor, pc, *([] if last else [shifted])):
            item.destroy()
        if state < 0:
            raise RuntimeError(
                f"reduction: MUMPS cannot factor the shifted stiffness (INFOG(1) = {state}, "
                "see its manual), so that modes cannot be counted; is there too little memory?"
            )
        return count

    def destroy(self) -> None:
        """Free the memory on all ranks together."""
        for item in (self.solver, self.stiffness, self.mass):
            item.destroy()


class FactoredBody:
    """Matrices of a body at one density, and the factor of its stiffness with clamped interfaces.

    `CraigBampton.factor` returns it. It belongs to whoever asked for it, and lives until it is
    destroyed or recycled for another density.

    Args:
        elasticity: The body.
        matrices: Stiffness and mass of the body that floats freely.
        clamped: Stiffness and mass with all interfaces clamped, and the factor.
    """

    def __init__(
        self, elasticity: Elasticity, matrices: Matrices, clamped: ClampedMatrices
    ) -> None:
        self.elasticity, self.matrices = elasticity, matrices
        self._clamped: ClampedMatrices | None = clamped

    @property
    def clamped(self) -> ClampedMatrices:
        """The matrices with all interfaces clamped; RuntimeError if they have been freed."""
        if self._clamped is None:
            raise RuntimeError(
                "reduction: the matrices of this density are freed, because the body was used at "
                "another density afterwards; call FlexibleBody.factored again"
            )
        return self._clamped

    def solve(self, block: Block) -> Block:
        """K^-1 times right-hand sides, shape (dofs, columns), all interfaces clamped."""
        return self.clamped.solver.solve(block)

    def count_below(self, limit: float) -> int:
        """The number of eigenvalues below a limit, copies included, the same on every rank."""
        return self.clamped.count_below(limit)

    def count_last(self, limit: float) -> int:
        """`count_below` in the end: factor and matrices are freed, as both take most memory."""
        clamped = self.recycle()
        try:
            return clamped.count_below(limit, last=True)
        finally:
            clamped.destroy()

    def recycle(self) -> ClampedMatrices:
        """Free the matrices of this density; return the clamped ones, to be filled by another."""
        clamped, self._clamped = self.clamped, None
        self.matrices.destroy()
        return clamped

    def destroy(self) -> None:
        """Free the memory on all ranks together, unless it has been freed."""
        if self._clamped is not None:
            self.recycle().destroy()
