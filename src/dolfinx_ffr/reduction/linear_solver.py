# SPDX-License-Identifier: MIT
"""What solves with the stiffness of a held body, at one density after the other."""

from __future__ import annotations

from abc import ABC, abstractmethod

from petsc4py import PETSc

from ..fem import Block

__all__ = ["DIRECT", "ITERATIVE", "SOLVERS", "LinearSolver"]

#: How bodies are solved: by factors, or by conjugate gradients with multigrid
SOLVERS = DIRECT, ITERATIVE = "direct", "iterative"


class LinearSolver(ABC):
    """Solution with one matrix after the other, all with the same entries."""

    @abstractmethod
    def factor(self, matrix: PETSc.Mat) -> None:
        """Make ready for a matrix; what depends on its entries' places alone is found once.

        Args:
            matrix: Symmetric and positive definite.

        Raises:
            petsc4py.PETSc.Error: On every rank, if it is found to be singular.
        """

    @abstractmethod
    def solve(self, block: Block) -> Block:
        """The inverse times a block.

        Args:
            block: Right-hand sides, shape (dofs of this rank, columns).
        """

    @abstractmethod
    def destroy(self) -> None:
        """Free the memory on all ranks together."""
