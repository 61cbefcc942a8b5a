# SPDX-License-Identifier: MIT
"""Derivatives of the shape functions with respect to the density of single elements.

With the interfaces held, and dK, dM the derivatives of the matrices by one element's density,

    constraint mode k:   K dpsi_k = -dK psi_k
    normal mode i:       (K - lambda_i M) z_i = -(dK - lambda_i dM) phi_i  on the complement of the
                         retained modes,   dphi_i = z_i - 1/2 sum_j phi_j (phi_j^T dM phi_i),

one system for each shape function and each element. The normal modes' systems are singular along
phi_i, and along all modes with the same eigenvalue. Two ways around that:

- "bordered": the retained modes border the matrix,

      [ K - lambda_i M   M Phi ] [z_i]   [-(dK - lambda_i dM) phi_i]
      [ (M Phi)^T          0   ] [mu ] = [             0           ],

  which is regular for single, close and equal eigenvalues alike; it is factored once for each mode
  and solved directly for all elements (Nelson's method, who bordered with one mode);
- "deflated": conjugate gradients on the complement, preconditioned by the factor of K.

The derivatives are those of one smooth choice of an M-orthonormal basis of the span. For close and
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
from dataclasses import dataclass
from typing import Literal

from petsc4py import PETSc

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from .elasticity import Block
from .flexible_body import FlexibleBody, ReducedBody
from .reduction import CraigBampton, ReducedBasis

__all__ = ["ShapeDerivative", "Solver", "shape_derivatives"]

Solver = Literal["bordered", "deflated"]


@dataclass(frozen=True)
class ShapeDerivative:
    """Derivatives of one shape function with respect to the densities of a batch of elements."""

    shape: int  #: number of the shape function, constraint modes first
    #: (k, 2) number among the cells that were asked for on this rank, and its column, for those of
    #: the batch's elements that this rank owns
    cells: NDArray[np.int64]
    fields: Block  #: (dofs of this rank, columns) one column an element of the batch


def shape_derivatives(
    body: FlexibleBody,
    reduced: ReducedBody,
    cells: NDArray[np.int64],
    *,
    solver: Solver = "bordered",
    batch: int = 128,
) -> Iterator[ShapeDerivative]:
    """Give the derivative of every shape function by the density of each of some elements.

    Collective: every rank goes through all batches.

    Args:
        body: the body.
        reduced: what its `FlexibleBody.reduce` returned last.
        cells: elements owned by this rank, shape (cells,); every rank gives its own.
        solver: of the normal modes' systems.
        batch: elements whose systems are solved at once; the memory in use is a few times their
            number times that of one displacement field.

    Returns:
        Iterator over shape functions and batches of elements.

    Raises:
        ValueError: on every rank, for an unknown solver or a batch below one.
        RuntimeError: on every rank, if a factor cannot be made or an iteration does not converge.
    """
    if solver not in ("bordered", "deflated"):
        raise ValueError(f"shape derivatives: solver = {solver!r} must be 'bordered' or 'deflated'")
    if int(batch) != batch or batch < 1:
        raise ValueError(f"shape derivatives: batch = {batch} must be a whole number of at least 1")
    elasticity, reduction, basis = body.elasticity, body.reduction, reduced.basis
    k = basis.n_constraint
    normal = basis.shapes[:, k:]
    mass_forces, stiffness_forces = elasticity.cell_derivatives(normal, basis.shapes)
    mass_forces, stiffness_forces = mass_forces[cells], stiffness_forces[cells]
    stiffness_forces[..., k:] -= basis.eigenvalues * mass_forces
    # phi_j^T dM phi_i, which keeps the modes orthonormal
    normalisation = np.einsum("cndj,cndi->cji", elasticity.at_cells(normal)[cells], mass_forces)
    counts = elasticity.comm.allgather(len(cells))
    first = sum(counts[: elasticity.comm.rank])
    for shape in range(basis.shapes.shape[1]):
        solve = _solver(reduction, basis, shape, solver)
        for start in range(0, sum(counts), batch):
            columns = min(batch, sum(counts) - start)
            numbers = np.arange(max(start - first, 0), min(start + columns - first, len(cells)))
            where = np.column_stack([numbers, numbers + first - start]).astype(np.int64)
            places = np.column_stack([cells[numbers], where[:, 1]])
            right = elasticity.from_cells(places, -stiffness_forces[numbers, ..., shape], columns)
            right[reduction.held] = 0.0
            fields = solve(right)
            if shape >= k:
                share = np.zeros((normal.shape[1], columns))
                share[:, where[:, 1]] = -0.5 * normalisation[numbers, :, shape - k].T
                fields += normal @ elasticity.sum(share)
            yield ShapeDerivative(shape, where, fields)


def _solver(
    reduction: CraigBampton, basis: ReducedBasis, shape: int, solver: Solver
) -> Callable[[Block], Block]:
    """Return what solves the systems of one shape function for several right-hand sides."""
    if shape < basis.n_constraint:
        return reduction.solve
    shift = float(basis.eigenvalues[shape - basis.n_constraint])
    if solver == "bordered":
        return _BorderedFactor(reduction, basis, shift)
    return lambda right: reduction.solve_shifted(basis, right, np.full(right.shape[1], shift))[0]


class _BorderedFactor:
    """Factor of K - shift M, bordered by the retained modes times M.

    Args:
        reduction: holds K and M with the interfaces held.
        basis: retained modes.
        shift: one of their eigenvalues [rad^2/s^2].
    """

    def __init__(self, reduction: CraigBampton, basis: ReducedBasis, shift: float) -> None:
        self.elasticity = reduction.elasticity
        comm, n = self.elasticity.comm, self.elasticity.n_dofs
        size, border = self.elasticity.n_dofs_global, basis.mass_times_normal
        shifted = reduction.held_stiffness.copy()
        shifted.axpy(-shift, reduction.held_mass, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        indptr, indices, values = shifted.getValuesCSR()
        shifted.destroy()
        matrix = scipy.sparse.csr_matrix((values, indices, indptr), shape=(n, size))
        # of the size of the matrix's own entries; any factor gives the same solution
        largest = self.elasticity.largest
        scale = largest(np.abs(values)) / largest(np.abs(border))
        matrix = scipy.sparse.hstack([matrix, scipy.sparse.csr_matrix(scale * border)])
        # the last rank owns the rows of the border
        self._rows = border.shape[1] if comm.rank == comm.size - 1 else 0
        parts = comm.gather(border, root=comm.size - 1)
        if parts is not None:
            whole = scipy.sparse.csr_matrix(scale * np.vstack(parts).T)
            corner = scipy.sparse.csr_matrix((border.shape[1], border.shape[1]))
            lower = scipy.sparse.hstack([whole, corner])
            matrix = scipy.sparse.vstack([matrix, lower])
        rows = matrix.tocsr()
        total = size + border.shape[1]
        self._layout = (n + self._rows, total)
        self._matrix = PETSc.Mat().createAIJ(
            (self._layout, self._layout),
            csr=(
                rows.indptr.astype(PETSc.IntType),
                rows.indices.astype(PETSc.IntType),
                rows.data,
            ),
            comm=comm,
        )
        self._matrix.assemble()
        self._pc = PETSc.PC().create(comm)
        self._pc.setOperators(self._matrix)
        self._pc.setType("lu")
        self._pc.setFactorSolverType("mumps")
        try:
            self._pc.setUp()
        except PETSc.Error as error:
            raise RuntimeError(
                "shape derivatives: the bordered matrix of a normal mode is singular; the number "
                "of modes may cut through a cluster of equal frequencies"
            ) from error

    def __call__(self, right: Block) -> Block:
        """Return the solutions of several right-hand sides, orthogonal to the retained modes."""
        n, columns = right.shape
        padded = np.vstack([right, np.zeros((self._rows, columns))])
        dense, solution = (
            PETSc.Mat().createDense(
                (self._layout, (PETSc.DECIDE, columns)),
                array=np.asfortranarray(a).ravel(order="F"),
                comm=self.elasticity.comm,
            )
            for a in (padded, np.zeros_like(padded))
        )
        dense.assemble()
        solution.assemble()
        self._pc.getFactorMatrix().matSolve(dense, solution)
        result = np.array(solution.getDenseArray())[:n]
        dense.destroy()
        solution.destroy()
        return result
