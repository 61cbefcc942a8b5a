# SPDX-License-Identifier: MIT
"""How many eigenvalues lie below a limit, counted without computing any.

By Sylvester's law of inertia K - limit M has as many negative pivots as K phi = lambda M phi has
eigenvalues below the limit, copies included. It takes one factor by MUMPS, which pivots; CHOLMOD
does not. Which entries there are is the same at all densities and limits, so that MUMPS analyses
them once for a body: that takes as long as the factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from threading import Lock

from petsc4py import PETSc

from ..fem import Elasticity, kept_by

__all__ = ["InertiaCount"]


class InertiaCount:
    """Counts eigenvalues of one body, at any density.

    It keeps MUMPS's analysis and a matrix, and no factor. One thread at a time counts.

    Args:
        elasticity: The body.
    """

    def __init__(self, elasticity: Elasticity) -> None:
        self._elasticity = elasticity
        self._analysed: list[_Analysed] = kept_by(self, elasticity.comm)
        self._counting = Lock()

    def below(self, stiffness: PETSc.Mat, mass: PETSc.Mat, limit: float) -> int:
        """How many eigenvalues lie below a limit, copies included.

        Args:
            stiffness: K with all interfaces held, with the entries of `Elasticity.new_matrix`.
            mass: M, likewise.
            limit: Not an eigenvalue itself [rad^2/s^2].

        Returns:
            The number, the same on every rank.

        Raises:
            RuntimeError: On every rank, if MUMPS fails.
        """
        with self._counting:
            if not self._analysed:
                self._analysed.append(_Analysed.of(self._elasticity))
            analysed = self._analysed[0]
            shifted, pc, factor = analysed.shifted, analysed.pc, analysed.factor
            same = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
            stiffness.copy(shifted, same)
            shifted.axpy(-limit, mass, same)
            pc.setOperators(shifted)
            pc.setUp()
            state = factor.getMumpsInfog(1)  # PETSc goes on where MUMPS fails
            if state < 0:
                self._analysed.pop().destroy()
                raise RuntimeError(
                    f"reduction: MUMPS cannot factor the shifted stiffness (INFOG(1) = {state}, "
                    "see its manual), so that modes cannot be counted; is there too little memory?"
                )
            return int(factor.getInertia()[0])


@dataclass(frozen=True, eq=False)
class _Analysed:
    """A matrix with the entries of a body's, and MUMPS's analysis of it."""

    shifted: PETSc.Mat
    pc: PETSc.PC
    factor: PETSc.Mat

    @staticmethod
    def of(elasticity: Elasticity) -> _Analysed:
        shifted = elasticity.new_matrix()
        pc = PETSc.PC().create(elasticity.comm)
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        pc.setOperators(shifted)
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        factor.setMumpsIcntl(13, 1)  # no part of the matrix is left to ScaLAPACK, uncounted
        factor.setMumpsIcntl(14, 100)  # memory for pivots that are put off, in percent
        factor.setMumpsIcntl(24, 1)  # PETSc demands that zero pivots are looked for
        factor.setMumpsIcntl(31, 1)  # the factor is not kept: nothing is solved with it
        return _Analysed(shifted, pc, factor)

    def destroy(self) -> None:
        for item in (self.factor, self.pc, self.shifted):
            item.destroy()
