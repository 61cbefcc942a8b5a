# SPDX-License-Identifier: MIT
"""Derivatives of the shape functions with respect to the density of single elements.

With the interfaces clamped, and dK, dM the derivatives of the matrices by one element's density,

    constraint mode k:   K dpsi_k = -dK psi_k
    normal mode i:       (K - lambda_i M) z_i = -(dK - lambda_i dM) phi_i  on the complement of the
                         retained modes,   dphi_i = z_i - 1/2 sum_j phi_j (phi_j^T dM phi_i),

one system for each shape function and each element. The normal modes' systems are singular along
all modes with the same eigenvalue. Two ways around that:

- "bordered": the retained modes border the matrix,

      [ K - lambda_i M   M Phi ] [z_i]   [-(dK - lambda_i dM) phi_i]
      [ (M Phi)^T          0   ] [mu ] = [             0           ],

  which is regular for single, close and equal eigenvalues alike; it is factored once for each mode
  and solved directly for all elements (Nelson's method, who bordered with one mode);
- "deflated": conjugate gradients on the complement, preconditioned by the factor of K.

The derivatives belong to one smooth choice of an M-orthonormal basis of the span. For close and
equal eigenvalues single modes have no derivative, while any quantity that depends on the span alone
has, and gets it from these.

References:
    R. B. Nelson, Simplified calculation of eigenvector derivatives, AIAA Journal 14 (1976),
    doi:10.2514/3.7211.
    R. L. Dailey, Eigenvector derivatives with repeated eigenvalues, AIAA Journal 27 (1989),
    doi:10.2514/3.10137.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Literal, get_args

from petsc4py import PETSc

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Integers
from ..fem import Block, dense_matrix
from ..reduction import FactoredBody, FlexibleBody, ReducedBasis, ReducedBody, solved

#: Method that solves for the derivatives of normal modes
Solver = Literal["bordered", "deflated"]
SOLVERS: tuple[str, ...] = get_args(Solver)
#: Number of elements whose systems are solved at once, each in a few displacement fields
BATCH = 128


@dataclass(frozen=True)
class ModeDerivative:
    """Derivatives of one shape function with respect to the densities of a batch of elements.

    Attributes:
        shape: Number of the shape function, constraint modes first.
        cells: (k, 2) for the batch's elements on this rank: number among the cells asked for, and
            column.
        fields: (dofs of this rank, columns) one column an element of the batch.
    """

    shape: int
    cells: Integers
    fields: Block


def mode_derivatives(
    body: FlexibleBody,
    reduced: ReducedBody,
    cells: ArrayLike,
    *,
    solver: Solver = "bordered",
) -> Iterator[ModeDerivative]:
    """Derivatives of every shape function with respect to the density of each of some elements.

    Every rank goes through all batches. Meanwhile the body may be reduced at other densities; then
    its matrices are assembled again.

    Args:
        body: The body.
        reduced: The body, reduced by `FlexibleBody.reduce` at any time.
        cells: Elements owned by this rank, as a mask of shape (cells,) or as numbers; every rank
            gives its own.
        solver: Solver of the normal modes' systems: ``"bordered"`` solves directly, with a factor
            for each mode; ``"deflated"`` iterates and needs no factor but the one of K.

    Raises:
        RuntimeError: If a factor cannot be made, an iteration does not converge, or truncated modes
            have the frequency of a retained one.
    """
    check_reduced("mode derivatives", body, reduced)
    body.reduction.check_gap(body.factored(reduced), reduced.basis)
    validation.choice("mode derivatives: solver", solver, SOLVERS)
    cells = cell_numbers(body, cells)
    elasticity, reduction, basis = body.elasticity, body.reduction, reduced.basis
    n_constraint, normal = basis.n_constraint, basis.normal
    mass_forces, stiffness_forces = elasticity.cell_derivatives(
        reduced.density, normal, basis.shapes
    )
    mass_forces, stiffness_forces = mass_forces[cells], stiffness_forces[cells]
    stiffness_forces[..., n_constraint:] -= basis.eigenvalues * mass_forces
    # phi_j^T dM phi_i, which keeps the modes orthonormal
    normalisation = np.einsum("cndj,cndi->cji", elasticity.at_cells(normal)[cells], mass_forces)
    counts = elasticity.comm.allgather(len(cells))
    offset = sum(counts[: elasticity.comm.rank])  # of the cells of this rank among all of them
    for shape in range(basis.shapes.shape[1]):
        with _solver(body, reduced, shape, solver) as solve:
            for start in range(0, sum(counts), BATCH):
                width = min(BATCH, sum(counts) - start)
                numbers = np.arange(max(start - offset, 0), min(start + width - offset, len(cells)))
                columns = numbers + offset - start
                forces = -stiffness_forces[numbers, ..., shape]
                one_cell = (forces * (columns[:, None, None] == k) for k in range(width))
                right = elasticity.from_cells(cells[numbers], one_cell)
                right[reduction.clamped] = 0.0
                fields = solve(right)
                if shape >= n_constraint:
                    share = np.zeros((normal.shape[1], width))
                    share[:, columns] = -0.5 * normalisation[numbers, :, shape - n_constraint].T
                    fields += normal @ elasticity.sum(share)
                numbered = np.column_stack([numbers, columns]).astype(np.int64)
                yield ModeDerivative(shape, numbered, fields)


def check_reduced(what: str, body: FlexibleBody, reduced: ReducedBody) -> None:
    """Refuse anything but a body and the result of its `FlexibleBody.reduce`."""
    validation.instance(f"{what}: body", body, FlexibleBody, "a FlexibleBody")
    needed = "what `FlexibleBody.reduce` returned"
    validation.instance(f"{what}: reduced", reduced, ReducedBody, needed)


def cell_numbers(body: FlexibleBody, cells: ArrayLike | None) -> Integers:
    """Numbers of elements of this rank from numbers, from a mask, or from None for all."""
    domain = body.domain
    chosen = np.arange(domain.n_cells) if cells is None else np.asarray(cells)
    fits, numbers = False, np.zeros(0, dtype=np.int64)
    if chosen.dtype == bool:
        fits, numbers = chosen.shape == (domain.n_cells,), np.flatnonzero(chosen)
    elif chosen.dtype.kind in "iuf":
        numbers = chosen.astype(np.int64).ravel()
        fits = np.array_equal(numbers, chosen.ravel()) and len(np.unique(numbers)) == len(numbers)
        fits = fits and bool(np.all((numbers >= 0) & (numbers < domain.n_cells)))
    if not all(domain.comm.allgather(fits)):
        raise ValueError(
            f"element by element: elements must be a mask of shape ({domain.n_cells},) on rank "
            f"{domain.comm.rank}, or different whole numbers below {domain.n_cells}"
        )
    return numbers.astype(np.int64)


@contextmanager
def _solver(
    body: FlexibleBody, reduced: ReducedBody, shape: int, solver: Solver
) -> Iterator[Callable[[Block], Block]]:
    """A function that solves the systems of one shape function for right-hand sides."""
    basis = reduced.basis
    if shape < basis.n_constraint:
        yield lambda right: body.factored(reduced).solve(right)
        return
    shift = float(basis.eigenvalues[shape - basis.n_constraint])
    if solver == "bordered":
        with closing(_BorderedFactor(body.factored(reduced), basis, shift)) as factor:
            yield factor
        return

    def deflated(right: Block) -> Block:
        shifts = np.full(right.shape[1], shift)
        return body.reduction.solve_shifted(body.factored(reduced), basis, right, shifts)[0]

    yield deflated


class _BorderedFactor:
    """Factor of K - shift M, all interfaces clamped, bordered by the retained modes times M."""

    def __init__(self, factored: FactoredBody, basis: ReducedBasis, shift: float) -> None:
        elasticity, border = factored.elasticity, basis.mass_times_normal
        comm, n, size = elasticity.comm, elasticity.n_dofs, elasticity.n_dofs_global
        shifted = factored.clamped.stiffness.copy()
        shifted.axpy(-shift, factored.clamped.mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        indptr, indices, values = shifted.getValuesCSR()
        shifted.destroy()
        matrix = scipy.sparse.csr_matrix((values, indices, indptr), shape=(n, size))
        # makes the border as large as the matrix; any factor gives the same solution
        scale = elasticity.largest(np.abs(values)) / elasticity.largest(np.abs(border))
        blocks = [[matrix, scipy.sparse.csr_matrix(scale * border)]]
        borders = comm.gather(border, root=comm.size - 1)
        if borders is not None:  # the last rank owns the rows of the border
            blocks.append([scipy.sparse.csr_matrix(scale * np.vstack(borders).T), None])
        rows = scipy.sparse.bmat(blocks, format="csr")
        self._rows = rows.shape[0]
        csr = rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data
        self._matrix = PETSc.Mat().createAIJ((rows.shape, rows.shape), csr=csr, comm=comm)
        self._matrix.assemble()
        self._pc = PETSc.PC().create(comm)
        self._pc.setOperators(self._matrix)
        self._pc.setType("lu")
        self._pc.setFactorSolverType("mumps")
        try:
            self._pc.setUp()
        except PETSc.Error as error:
            self.close()
            raise RuntimeError(
                "mode derivatives: the bordered matrix of a normal mode is singular; the number "
                "of modes may cut through a cluster of equal frequencies"
            ) from error

    def __call__(self, right: Block) -> Block:
        """The solutions of several right-hand sides, orthogonal to the retained modes."""
        padded = np.pad(right, ((0, self._rows - len(right)), (0, 0)))
        return solved(self._pc, dense_matrix(self._matrix.comm, padded))[: len(right)]

    def close(self) -> None:
        """Free the memory on all ranks together."""
        self._pc.destroy()
        self._matrix.destroy()
