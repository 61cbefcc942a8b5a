# SPDX-License-Identifier: MIT
"""Solution by conjugate gradients with multigrid, for bodies whose factor is too large.

A factor of a body in space has some n^(4/3) entries, a hierarchy of coarser systems has as many as
the matrix (`coarse_systems`). The cycles are done here, for all columns of a block at once, as the
time to read a matrix hardly depends on their number. PETSc's cycles with the same levels, Chebyshev
polynomials and number of iterations take one vector after the other, in CPU time:

    six columns to 1e-10          here [s]   PETSc [s]
    10,000 unknowns, gray           0.16       0.19
    70,000 unknowns, gray           1.5        4.7
    70,000 unknowns, 40 % void      8.2       24.7

References:
    J. Lottes, Optimal polynomial smoothers for multigrid V-cycles, Numerical Linear Algebra with
    Applications 30 (2023), doi:10.1002/nla.2518.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from petsc4py import PETSc

import numpy as np

from ..arrays import Integers, Mask
from ..fem import Array, Block, Elasticity, by_dense, dense_matrix
from .coarse_systems import coarse_systems
from .direct_solver import LinearSolver, SharedFactor, check_memory, factor_package
from .eigenpairs import by_columns
from .lobpcg import lobpcg


@dataclass(frozen=True)
class MultigridOptions:
    """Cycles of multigrid, and conjugate gradients with them."""

    degree: int = 3  #: Of a smoother's polynomial
    power_iterations: int = 15  #: For the largest eigenvalue of the scaled matrix of a level
    margin: float = 1.1  #: Factor of safety of this eigenvalue
    #: Iterations after which conjugate gradients give up: a factor, if it fits, takes less time
    max_iterations: int = 500
    tolerance_share: float = 1e-2  #: Tolerance of solutions, relative to that of modes and adjoints


MULTIGRID = MultigridOptions()


class MultigridSolver(LinearSolver):
    """Solution and lowest modes of a clamped body without a factor, by a tolerance of energy."""

    def __init__(self, elasticity: Elasticity, clamped: Mask, tolerance: float) -> None:
        self._elasticity = elasticity
        self._tolerance = MULTIGRID.tolerance_share * tolerance
        self._systems = coarse_systems(elasticity, clamped)
        self._free = self._systems.rows
        self._stiffness: PETSc.Mat | None = None
        self._mass: PETSc.Mat | None = None
        self._levels: list[_Level] = []  # from the coarsest
        #: In the place of cycles, once these have stalled
        self._direct: LinearSolver | None = None

    def factor(self, matrix: PETSc.Mat) -> None:
        self._stiffness = self._systems.part(matrix, self._stiffness)
        if self._direct is not None:
            self._direct.factor(self._stiffness)
            return
        levels = self._systems.levels(self._stiffness)
        self._levels = [_Level(*level, self._elasticity.sum) for level in levels]

    def solve(self, block: Block) -> Block:
        """The inverse times right-hand sides, or RuntimeError."""
        result = np.array(block, dtype=np.float64)  # one on the diagonal of clamped rows
        if block.shape[1] == 0:
            return result
        solution, iterations = self._conjugate_gradients(
            lambda fields, _: _product(self._stiffness, fields), self._cycle, result[self._free]
        )
        if solution is None:
            self._fall_back(f"conjugate gradients did not converge in {iterations} iterations")
            return self.solve(block)
        result[self._free] = solution
        return result

    def _fall_back(self, why: str) -> None:
        """Go on with a factor in the place of cycles; RuntimeError where that fails, too."""
        stall = (
            f"reduction: multigrid stalls ({why}): the body is too ill-conditioned for it, as very "
            "slender elements and void of next to no stiffness are"
        )
        remedy = "take a void with more stiffness, or elements whose edges are more alike"
        if self._direct is not None:
            raise RuntimeError(f"{stall}, and for a factor as well; {remedy}")
        assert self._stiffness is not None
        try:
            check_memory(self._elasticity, self._stiffness, remedy)
        except ValueError as error:
            raise RuntimeError(f"{stall}. A factor does not fit: {error}") from error
        warnings.warn(
            f'{stall}; the run continues with a factor, as with solver="direct"', stacklevel=2
        )
        self._direct = SharedFactor(self._elasticity, factor_package(self._elasticity.comm))
        self._direct.factor(self._stiffness)

    def _conjugate_gradients(
        self,
        image_of: Callable[[Block, Integers], Block],
        preconditioned: Callable[[Block], Block],
        loads: Block,
    ) -> tuple[Block | None, int]:
        """Solutions or None, and iterations; ``image_of`` gets fields and their columns."""

        def products(a: Block, b: Block) -> Array:
            return self._elasticity.sum(np.einsum("ij,ij->j", a, b))

        solution, residual = np.zeros_like(loads), loads.copy()
        going = np.arange(loads.shape[1])
        direction = preconditioned(residual)
        size = products(residual, direction)
        enough = self._tolerance**2 * size
        for iteration in range(MULTIGRID.max_iterations):
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
            previous_size, size = size, products(residual, cycled)
            direction *= size / previous_size
            direction += cycled
        return None, MULTIGRID.max_iterations

    def solve_shifted(
        self,
        matrices: tuple[PETSc.Mat, PETSc.Mat],
        loads: Block,
        shifts: Array,
        modes: tuple[Block, Block],
    ) -> tuple[Block, int]:
        """Solve (K - shift_j M) z_j = load_j on the complement of ``modes`` Phi and M Phi.

        The loads (dofs, columns) are orthogonal to the modes, zero in clamped rows. RuntimeError
        without convergence.
        """
        (stiffness, mass), (fields, images) = matrices, modes
        elasticity = self._elasticity

        def image_of(block: Block, columns: Integers) -> Block:
            image = elasticity.apply(stiffness, block)
            image -= shifts[columns] * elasticity.apply(mass, block)
            return image

        def preconditioned(block: Block) -> Block:
            cycled = np.zeros_like(block)
            cycled[self._free] = self._cycle(block[self._free])
            cycled -= fields @ elasticity.inner(images, cycled)
            return cycled

        solution, iterations = self._conjugate_gradients(image_of, preconditioned, loads)
        if solution is None and self._direct is None:
            self._fall_back(f"the adjoint did not converge in {iterations} iterations")
            return self.solve_shifted(matrices, loads, shifts, modes)
        if solution is None:
            raise RuntimeError(
                "reduction: the adjoint of the normal modes did not converge in "
                f"{iterations} iterations; choose a number of modes that does not cut through "
                "close frequencies"
            )
        return solution, iterations

    def _cycle(self, block: Block) -> Block:
        """One cycle of multigrid, a symmetric approximation of the inverse, on free dofs."""
        if self._direct is not None:
            return self._direct.solve(block)
        return self._cycle_from(len(self._levels) - 1, block)

    def _cycle_from(self, k: int, block: Block) -> Block:
        """A V-cycle for the right-hand sides ``block`` of level k; level -1 is the coarsest."""
        if k < 0:  # the coarsest system, which is small
            return self._systems.solve(block)
        level = self._levels[k]
        solution, residual = level.smooth(None, block)
        coarse = _product(level.interpolation, residual, transposed=True)
        correction = _product(level.interpolation, self._cycle_from(k - 1, coarse))
        solution += correction
        residual -= _product(level.matrix, correction)
        return level.smooth(solution, residual, last=True)[0]

    def modes(
        self, mass: PETSc.Mat, number: int, starts: Block, known: Block | None
    ) -> tuple[Array, Block]:
        """At least ``number`` lowest eigenpairs, M-orthogonal to known ones, (k,) and (dofs, k)."""
        assert self._stiffness is not None
        self._mass = self._systems.part(mass, self._mass)
        products = partial(_product, self._stiffness), partial(_product, self._mass)
        deflated = None
        if known is not None:
            deflated = known[self._free], products[1](known[self._free])
        pairs = lobpcg(
            self._elasticity,
            products,
            self._cycle,
            starts[self._free],
            number,
            deflated=deflated,
            tolerance=self._tolerance,
        )
        if pairs is None and self._direct is None:
            self._fall_back(f"{number} normal modes did not converge")
            return self.modes(mass, number, starts, known)
        if pairs is None:
            raise RuntimeError(
                f"reduction: {number} normal modes did not converge; the mesh may be too coarse "
                "for so many modes, or the design may have fallen apart"
            )
        eigenvalues, free_fields = pairs
        fields = np.zeros((len(starts), len(eigenvalues)))
        fields[self._free] = free_fields
        return eigenvalues, fields

    def destroy(self) -> None:
        self._systems.destroy()
        if self._direct is not None:
            self._direct.destroy()


class _Level:
    """A level of the hierarchy above the coarsest, smoothed by Chebyshev's polynomial of 4th kind.

    Of the matrix scaled by its diagonal only the largest eigenvalue need be known.
    """

    def __init__(
        self, matrix: PETSc.Mat, interpolation: PETSc.Mat, sum_: Callable[[Array], Array]
    ) -> None:
        self.matrix, self.interpolation = matrix, interpolation
        diagonal = matrix.getDiagonal()
        self._scale = 1.0 / diagonal.getArray(readonly=True)[:, None]
        diagonal.destroy()
        rows = np.arange(*matrix.getOwnershipRange())[:, None]
        fields, largest = np.sin(rows * np.array([1.0, 2.6])) + 0.1, np.ones(1)
        for _ in range(MULTIGRID.power_iterations):
            fields = self._scale * _product(matrix, fields)
            largest = np.sqrt(sum_(np.einsum("ij,ij->j", fields, fields)))
            fields = fields / largest
        self._largest = MULTIGRID.margin * float(np.max(largest))

    def smooth(
        self, solution: Block | None, residual: Block, *, last: bool = False
    ) -> tuple[Block, Block]:
        """Better solutions than ``solution`` (None: zero), and their residuals unless ``last``."""
        change = np.zeros_like(residual)
        solution = np.zeros_like(residual) if solution is None else solution.copy(order="F")
        for k in range(1, MULTIGRID.degree + 1):
            change *= (2 * k - 3) / (2 * k + 1)
            change += (8 * k - 4) / (2 * k + 1) / self._largest * self._scale * residual
            solution += change
            if k < MULTIGRID.degree or not last:
                residual = residual - _product(self.matrix, change)
        return solution, residual


def _product(matrix: PETSc.Mat, block: Block, *, transposed: bool = False) -> Block:
    """A matrix times the part of a block on this rank."""
    ranges = matrix.getOwnershipRanges() if transposed else matrix.getOwnershipRangesColumn()
    if np.any(np.diff(ranges) == 0):  # PETSc 3.25 fails on blocks of which a rank has no rows
        return _product_by_columns(matrix, block, transposed=transposed)
    function = matrix.transposeMatMult if transposed else matrix.matMult
    return by_dense(function, dense_matrix(matrix.getComm(), block))


def _product_by_columns(matrix: PETSc.Mat, block: Block, *, transposed: bool) -> Block:
    """A matrix times a block, one vector after the other."""
    right, image = matrix.createVecs()
    if transposed:
        return by_columns(matrix.multTranspose, image, right, block)
    return by_columns(matrix.mult, right, image, block)
