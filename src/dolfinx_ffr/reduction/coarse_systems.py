# SPDX-License-Identifier: MIT
"""Coarser systems of a clamped body for multigrid: by nested boxes, or by aggregates of nodes.

Both are Galerkin's: coarse matrices are those of the finest between interpolated fields. Boxes know
the geometry and take half the iterations; aggregates know the matrix and fit every mesh.

References:
    P. Vanek, J. Mandel, M. Brezina, Algebraic multigrid by smoothed aggregation for second and
    fourth order elliptic problems, Computing 56 (1996), doi:10.1007/BF02238511.
    U. Trottenberg, C. W. Oosterlee, A. Schueller, Multigrid, Academic Press 2001.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from ..arrays import Integers, Mask
from ..fem import Block, Elasticity, rigid_fields
from .direct_solver import SharedFactor, factor_package
from .eigenpairs import by_columns, vectors
from .nested_boxes import interpolations

#: Prefix of the options of GAMG in PETSc's database, in which a user's own come first. Aggregates
#: that do not reach across the contrast of void and solid take a third of the iterations in void,
#: and two thirds elsewhere. The smoothers are not PETSc's own, whose bounds of eigenvalues break
#: down on that contrast.
PREFIX = "dolfinx_ffr_multigrid_"
OPTIONS = {
    "mg_levels_ksp_type": "richardson",
    "mg_levels_pc_type": "jacobi",
    "pc_gamg_threshold": "0.05",
}
#: Entry of a diagonal, relative to the largest, below which it is round-off of zero
NOTHING = 1e-14


class NestedBoxes:
    """Systems of boxes twice as large from level to level; the coarsest has a factor.

    They are made for one matrix after the other of the same pattern. Clamped dofs
    have no share in interpolated fields, so matrices are taken as they are.
    """

    rows: Integers | slice = slice(None)  #: Dofs of this rank that take part

    def __init__(self, elasticity: Elasticity, interpolations: list[PETSc.Mat]) -> None:
        self._interpolations = interpolations
        self._coarse: list[PETSc.Mat] = []
        self._factor = SharedFactor(elasticity, factor_package(elasticity.comm))

    def part(self, matrix: PETSc.Mat, previous: PETSc.Mat | None) -> PETSc.Mat:
        """The ``rows`` and columns of a clamped matrix, written into the ``previous`` part."""
        return matrix

    def levels(self, finest: PETSc.Mat) -> list[tuple[PETSc.Mat, PETSc.Mat]]:
        """Pairs of a level's matrix and of the interpolation to it from the next coarser level.

        They begin with the second coarsest level and end with the ``finest`` matrix; the coarsest
        one is factored for `solve`.
        """
        matrices, reusable = [finest], self._coarse
        for k, interpolation in enumerate(self._interpolations):
            matrices.append(matrices[-1].ptap(interpolation, reusable[k] if reusable else None))
        self._coarse = matrices[1:]
        self._factor.factor(matrices[-1])
        return list(zip(matrices[:-1], self._interpolations, strict=True))[::-1]

    def solve(self, block: Block) -> Block:
        """Solutions of the coarsest system, shape (its dofs of this rank, columns)."""
        return self._factor.solve(block)

    def destroy(self) -> None:
        """Free the memory on all ranks together, without matrices that were given."""
        for item in (self._factor, *self._coarse, *self._interpolations):
            item.destroy()


class Aggregates:
    """Smoothed aggregation by PETSc (GAMG) out of the rigid motions of the body.

    Nodes of interfaces, which are clamped, do not take part: alone in their aggregates they would
    make coarse systems singular.
    """

    def __init__(self, elasticity: Elasticity, clamped: Mask) -> None:
        self._elasticity = elasticity
        self.rows = self._rows = np.flatnonzero(~clamped)
        database = PETSc.Options()
        for name, value in OPTIONS.items():
            if not database.hasName(PREFIX + name):
                database[PREFIX + name] = value
        self._parts: list[PETSc.Mat] = []
        self._ksp = ksp = PETSc.KSP().create(elasticity.comm)
        ksp.setOptionsPrefix(PREFIX)
        ksp.setType("preonly")
        ksp.getPC().setType("gamg")
        ksp.setFromOptions()

    def part(self, matrix: PETSc.Mat, previous: PETSc.Mat | None) -> PETSc.Mat:
        rows = matrix.getOwnershipRange()[0] + self._rows
        index = PETSc.IS().createGeneral(rows.astype(PETSc.IntType), comm=self._elasticity.comm)
        index.setBlockSize(self._elasticity.dimension)
        interior = matrix.createSubMatrix(index, index, previous)
        index.destroy()
        if previous is None:
            interior.setBlockSize(self._elasticity.dimension)
            self._parts.append(interior)
        return interior

    def levels(self, finest: PETSc.Mat) -> list[tuple[PETSc.Mat, PETSc.Mat]]:
        if not finest.getNearNullSpace().handle:
            rigid = self._rigid(finest)
            finest.setNearNullSpace(rigid)
            rigid.destroy()
        self._ksp.setOperators(finest)
        self._ksp.setUp()
        self._fill_diagonals()
        pc = self._ksp.getPC()
        return [
            (pc.getMGSmoother(k).getOperators()[0], pc.getMGInterpolation(k))
            for k in range(1, pc.getMGLevels())
        ]

    def _fill_diagonals(self) -> None:
        """Give coarse systems a diagonal where an aggregate has fewer dofs than rigid motions."""
        # superfluous motions are zero on finer levels, but a smoother divides by the diagonal
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

    def _rigid(self, matrix: PETSc.Mat) -> PETSc.NullSpace:
        """The rigid motions, on the nodes that are not clamped."""
        elasticity = self._elasticity
        center = elasticity.domain.bounding_box.mean(axis=0)
        fields = rigid_fields(elasticity.coordinates(), center)[self._rows]
        for _ in range(2):  # orthonormal to round-off, as PETSc demands
            gram = elasticity.inner(fields, fields)
            fields = fields @ np.linalg.inv(np.linalg.cholesky(gram)).T
        template = matrix.createVecRight()
        columns = vectors(template, fields)
        space = PETSc.NullSpace().create(vectors=columns, comm=elasticity.comm)
        for vector in (template, *columns):
            vector.destroy()
        return space

    def solve(self, block: Block) -> Block:
        solver = self._ksp.getPC().getMGCoarseSolve()
        solution, right = solver.getOperators()[0].createVecs()
        return by_columns(solver.solve, right, solution, block)

    def destroy(self) -> None:
        for item in (self._ksp, *self._parts):
            item.destroy()


def coarse_systems(elasticity: Elasticity, clamped: Mask) -> NestedBoxes | Aggregates:
    """Systems of nested boxes where nodes stand on a lattice, else of aggregates."""
    matrices = interpolations(elasticity, clamped)
    return NestedBoxes(elasticity, matrices) if matrices else Aggregates(elasticity, clamped)
