# SPDX-License-Identifier: MIT
"""Matrices of one body at one density with all interfaces held, and what their factors tell."""

from __future__ import annotations

from dataclasses import dataclass, field

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from ..fem import Block, Elasticity, Matrices
from .direct_solver import direct_solver
from .inertia import InertiaCount
from .linear_solver import ITERATIVE, LinearSolver
from .multigrid import MultigridSolver

__all__ = ["FactoredBody", "HeldMatrices"]


@dataclass(frozen=True, eq=False)
class HeldMatrices:
    """Matrices with all interfaces held, and what solves with the stiffness.

    One density after the other is written into them: their entries stay where they are, and the
    ordering of a factor is found once.
    """

    stiffness: PETSc.Mat  #: One on the diagonal of held rows
    mass: PETSc.Mat  #: Zero in held rows
    solver: LinearSolver  #: Holds the factor of the stiffness, or coarser systems

    @staticmethod
    def of(
        elasticity: Elasticity, held: NDArray[np.bool_], solver: str, tolerance: float
    ) -> HeldMatrices:
        """Matrices without values yet.

        Args:
            elasticity: The body.
            held: Whether a dof of this rank belongs to an interface, shape (dofs,).
            solver: ``"direct"`` or ``"iterative"``.
            tolerance: Of modes and adjoints.
        """
        stiffness, mass = elasticity.new_matrix(), elasticity.new_matrix()
        if solver == ITERATIVE:
            return HeldMatrices(stiffness, mass, MultigridSolver(elasticity, held, tolerance))
        return HeldMatrices(stiffness, mass, direct_solver(elasticity, stiffness))

    def fill(self, matrices: Matrices, rows: NDArray[np.int32]) -> None:
        """Write the matrices of a density, and make the solver ready for the stiffness.

        Args:
            matrices: Of the body that floats freely.
            rows: Local numbers of the dofs that are held, ghosts left out.

        Raises:
            petsc4py.PETSc.Error: If the stiffness is singular.
        """
        for source, target, diagonal in (
            (matrices.stiffness, self.stiffness, 1.0),
            (matrices.mass, self.mass, 0.0),
        ):
            source.copy(target, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            target.zeroRowsColumnsLocal(rows, diagonal)
        self.solver.factor(self.stiffness)

    def destroy(self) -> None:
        """Free the memory on all ranks together."""
        for item in (self.solver, self.stiffness, self.mass):
            item.destroy()


@dataclass(frozen=True, eq=False)
class FactoredBody:
    """Matrices of a body at one density, and the factor of its stiffness with interfaces held."""

    elasticity: Elasticity = field(repr=False)  #: The body
    matrices: Matrices  #: Of the body that floats freely
    inertia: InertiaCount = field(repr=False)  #: Of the body, at any density
    _held: list[HeldMatrices] = field(repr=False)  #: Those of this density, until they are freed
    _spare: list[HeldMatrices] = field(repr=False)  #: Where the next density finds them

    @property
    def held(self) -> HeldMatrices:
        """With all interfaces held.

        Raises:
            RuntimeError: If they have been freed.
        """
        if not self._held:
            raise RuntimeError(
                "reduction: the matrices of this density are freed, as the body has been worked at "
                "another one since; ask FlexibleBody.factored for them again"
            )
        return self._held[0]

    @property
    def held_stiffness(self) -> PETSc.Mat:
        """K with all interfaces held: one on the diagonal of held rows."""
        return self.held.stiffness

    @property
    def held_mass(self) -> PETSc.Mat:
        """M with all interfaces held: zero in held rows."""
        return self.held.mass

    def solve(self, block: Block) -> Block:
        """K^{-1} times block with all interfaces held, several right-hand sides at once."""
        return self.held.solver.solve(block)

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
        """Free the memory on all ranks together, or leave it to the next density."""
        while self._held:
            held = self._held.pop()
            if self._spare:
                held.destroy()
            else:
                self._spare.append(held)
        self.matrices.destroy()
