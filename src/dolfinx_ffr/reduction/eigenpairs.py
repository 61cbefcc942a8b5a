# SPDX-License-Identifier: MIT
"""The lowest eigenpairs of K phi = lambda M phi by SLEPc."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from petsc4py import PETSc

import numpy as np
from slepc4py import SLEPc

from ..arrays import Array
from ..fem import Block

#: Iterations after which the solver gives up
MAX_ITERATIONS = 200


class _Preconditioner:
    """A function of blocks, by the method names that PETSc looks for."""

    def __init__(self, function: Callable[[Block], Block]) -> None:
        self._function = function

    def apply(self, _: PETSc.PC, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        solution.setArray(self._function(right.getArray(readonly=True)[:, None])[:, 0])


def lowest_eigenpairs(
    stiffness: PETSc.Mat,
    mass: PETSc.Mat,
    number: int,
    *,
    starts: Block,
    known: Block | None,
    inverse: Callable[[Block], Block],
    tolerance: float,
) -> tuple[Array, Block]:
    """At least ``number`` lowest eigenpairs, (k,) and (dofs, k), M-orthogonal to ``known`` ones."""
    eps = SLEPc.EPS().create(stiffness.comm)
    transform = eps.getST()
    ksp = transform.getKSP()
    vector = stiffness.createVecRight()
    begin, deflated = vectors(vector, starts), [] if known is None else vectors(vector, known)
    try:
        eps.setOperators(stiffness, mass)
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setDimensions(number)
        eps.setTolerances(tolerance, MAX_ITERATIONS)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        eps.setTarget(0.0)
        transform.setType(SLEPc.ST.Type.SINVERT)
        transform.setShift(0.0)
        eps.setPurify(False)  # left to the caller, who does it for all at once
        ksp.setType("preonly")
        ksp.getPC().setType("python")
        ksp.getPC().setPythonContext(_Preconditioner(inverse))
        eps.setInitialSpace(begin)
        if deflated:
            eps.setDeflationSpace(deflated)
        eps.solve()
        converged = eps.getConverged()
        if converged < number:
            n_known = len(deflated)
            raise RuntimeError(
                f"reduction: only {n_known + converged} of {n_known + number} normal modes "
                f"converged in {eps.getIterationNumber()} iterations; the mesh may be too coarse "
                "for so many modes, or the design may have fallen apart"
            )
        eigenvalues, fields = np.empty(converged), np.empty((len(starts), converged))
        for i in range(converged):
            eigenvalues[i] = eps.getEigenpair(i, vector).real
            fields[:, i] = vector.getArray(readonly=True)
    finally:
        # by name, as PETSc keeps what Python drops last until the end of the program
        for item in (ksp, transform, eps, vector, *begin, *deflated):
            item.destroy()
    # all ranks decide by the same numbers, to the last bit
    eigenvalues = stiffness.comm.tompi4py().bcast(eigenvalues)
    order = np.argsort(eigenvalues, kind="stable")
    return eigenvalues[order], fields[:, order]


def vectors(template: PETSc.Vec, block: Block) -> list[PETSc.Vec]:
    """The columns of a block."""
    copies = [template.duplicate() for _ in block.T]
    for vector, column in zip(copies, block.T, strict=True):
        vector.setArray(column)
    return copies


def by_columns(
    function: Callable[[Any, Any], None], right: PETSc.Vec, image: PETSc.Vec, block: Block
) -> Block:
    """A function of one vector for each column; the vectors that it works with are destroyed."""
    result = np.empty((image.getLocalSize(), block.shape[1]), order="F")
    for i in range(block.shape[1]):
        right.setArray(block[:, i])
        function(right, image)
        result[:, i] = image.getArray(readonly=True)
    image.destroy()
    right.destroy()
    return result
