# SPDX-License-Identifier: MIT
"""Matrices of one body at one density with all interfaces held, and what their factors tell."""

from __future__ import annotations

from dataclasses import dataclass, field

from petsc4py import PETSc

import numpy as np

from ..fem import Block, Elasticity, Matrices
from .inertia import InertiaCount

__all__ = ["FactoredBody", "direct_solver"]


@dataclass(frozen=True, eq=False)
class FactoredBody:
    """Matrices of a body at one density, and the factor of its stiffness with interfaces held."""

    elasticity: Elasticity = field(repr=False)  #: The body
    matrices: Matrices  #: Of the body that floats freely
    #: With all interfaces held: one on the diagonal of held rows of the stiffness, zero of the mass
    held_stiffness: PETSc.Mat = field(repr=False)
    held_mass: PETSc.Mat = field(repr=False)
    ksp: PETSc.KSP = field(repr=False)  #: Holds the factor
    inertia: InertiaCount = field(repr=False)  #: Of the body, at any density

    def solve(self, block: Block) -> Block:
        """K^{-1} times block with all interfaces held, several right-hand sides at once."""
        if block.shape[1] == 0:
            return np.zeros_like(block)
        right = self.elasticity.dense(block)
        left = self.elasticity.dense(np.zeros_like(block))
        self.ksp.getPC().getFactorMatrix().matSolve(right, left)
        result = np.array(left.getDenseArray())
        right.destroy()
        left.destroy()
        return result

    def count_below(self, limit: float) -> int:
        """How many eigenvalues of K phi = lambda M phi lie below a limit, copies included.

        Args:
            limit: Not an eigenvalue itself [rad^2/s^2].

        Returns:
            The number, the same on every rank.

        Raises:
            RuntimeError: On every rank, if MUMPS fails.
        """
        return self.inertia.below(self.held_stiffness, self.held_mass, limit)

    def destroy(self) -> None:
        """Free the memory on all ranks together."""
        self.ksp.destroy()
        self.held_stiffness.destroy()
        self.held_mass.destroy()
        self.matrices.destroy()


def direct_solver(ranks: int) -> str:
    """The library that factors K: CHOLMOD solves faster, but runs on one rank only.

    Args:
        ranks: Number of ranks that share the matrix.
    """
    packages = ("cholmod", "suitesparse")  # PETSc's name for it depends on how it was built
    if ranks == 1 and any(map(PETSc.Sys.hasExternalPackage, packages)):
        return "cholmod"
    return "mumps"
