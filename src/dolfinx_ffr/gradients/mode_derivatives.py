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
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal, get_args

from petsc4py import PETSc

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..fem import Block
from ..reduction import FactoredBody, FlexibleBody, ReducedBasis, ReducedBody

__all__ = ["ModeDerivative", "Solver", "mode_derivatives"]

Solver = Literal["bordered", "deflated"]
#: Ways to solve for the derivatives of normal modes.
SOLVERS: tuple[str, ...] = get_args(Solver)


@dataclass(frozen=True)
class ModeDerivative:
    """Derivatives of one shape function with respect to the densities of a batch of elements."""

    shape: int  #: Number of the shape function, constraint modes first
    #: (k, 2) number among the cells that were asked for on this rank, and its column, for those of
    #: the batch's elements that this rank owns
    cells: NDArray[np.int64]
    fields: Block  #: (dofs of this rank, columns) one column an element of the batch


def mode_derivatives(
    body: FlexibleBody,
    reduced: ReducedBody,
    cells: ArrayLike,
    *,
    solver: Solver = "bordered",
    batch: int = 128,
) -> Iterator[ModeDerivative]:
    """Derivatives of every shape function with respect to the density of each of some elements.

    Collective: every rank goes through all batches. Meanwhile the body may be reduced at other
    densities; its matrices are made again then.

    Args:
        body: The body.
        reduced: What its `FlexibleBody.reduce` returned, at any time.
        cells: Elements owned by this rank, as a mask of shape (cells,) or as numbers; every rank
            gives its own.
        solver: Of the normal modes' systems.
        batch: Elements whose systems are solved at once; the memory in use is a few times their
            number times that of one displacement field.

    Returns:
        Iterator over shape functions and batches of elements.

    Raises:
        ValueError: On every rank, for an unknown solver or a batch below one.
        RuntimeError: On every rank, if a factor cannot be made, an iteration does not converge, or
            modes left out have the frequency of one that is kept.
    """
    check_reduced("mode derivatives", body, reduced)
    body.reduction.check_gap(body.factored(reduced), reduced.basis)
    validation.choice("mode derivatives: solver", solver, SOLVERS)
    batch = validation.integer("mode derivatives: batch", batch, least=1)
    cells = cell_numbers(body, cells)
    elasticity, reduction, basis = body.elasticity, body.reduction, reduced.basis
    k = basis.n_constraint
    normal = basis.shapes[:, k:]
    mass_forces, stiffness_forces = elasticity.cell_derivatives(
        reduced.density, normal, basis.shapes
    )
    mass_forces, stiffness_forces = mass_forces[cells], stiffness_forces[cells]
    stiffness_forces[..., k:] -= basis.eigenvalues * mass_forces
    # phi_j^T dM phi_i, which keeps the modes orthonormal
    normalisation = np.einsum("cndj,cndi->cji", elasticity.at_cells(normal)[cells], mass_forces)
    counts = elasticity.comm.allgather(len(cells))
    first = sum(counts[: elasticity.comm.rank])
    for shape in range(basis.shapes.shape[1]):
        with _solver(body, reduced, shape, solver) as solve:
            for start in range(0, sum(counts), batch):
                columns = min(batch, sum(counts) - start)
                numbers = np.arange(max(start - first, 0), min(start + columns - first, len(cells)))
                where = np.column_stack([numbers, numbers + first - start]).astype(np.int64)
                places = np.column_stack([cells[numbers], where[:, 1]])
                forces = -stiffness_forces[numbers, ..., shape]
                right = elasticity.from_cells(places, forces, columns)
                right[reduction.held] = 0.0
                fields = solve(right)
                if shape >= k:
                    share = np.zeros((normal.shape[1], columns))
                    share[:, where[:, 1]] = -0.5 * normalisation[numbers, :, shape - k].T
                    fields += normal @ elasticity.sum(share)
                yield ModeDerivative(shape, where, fields)


def check_reduced(what: str, body: FlexibleBody, reduced: ReducedBody) -> None:
    """Refuse what is no body, or not what its `FlexibleBody.reduce` returned.

    Args:
        what: Who asks, for the message.
        body: The body.
        reduced: The reduced body.

    Raises:
        TypeError: If one is something else.
    """
    validation.instance(f"{what}: body", body, FlexibleBody, "a FlexibleBody")
    needed = "what `FlexibleBody.reduce` returned"
    validation.instance(f"{what}: reduced", reduced, ReducedBody, needed)


def cell_numbers(body: FlexibleBody, cells: ArrayLike | None) -> NDArray[np.int64]:
    """Numbers of elements of this rank.

    Args:
        body: The body.
        cells: A mask of shape (cells,) or numbers; None takes all.

    Raises:
        ValueError: On every rank, if they are neither.
    """
    domain = body.domain
    if cells is None:
        return np.arange(domain.n_cells)
    given = np.asarray(cells)
    if given.dtype.kind not in "biuf":
        numbers, fits = np.zeros(0, dtype=np.int64), False
    elif given.dtype == bool:
        fits = given.shape == (domain.n_cells,)
        numbers = np.flatnonzero(given)
    else:
        numbers = given.astype(np.int64).ravel()
        fits = (
            np.array_equal(numbers, given.ravel())
            and len(np.unique(numbers)) == len(numbers)
            and (len(numbers) == 0 or (numbers.min() >= 0 and numbers.max() < domain.n_cells))
        )
    if not all(domain.comm.allgather(bool(fits))):
        raise ValueError(
            f"element by element: elements must be a mask of shape ({domain.n_cells},) on rank "
            f"{domain.comm.rank}, or different whole numbers below {domain.n_cells}"
        )
    return np.asarray(numbers, dtype=np.int64)


@contextmanager
def _solver(
    body: FlexibleBody, reduced: ReducedBody, shape: int, solver: Solver
) -> Iterator[Callable[[Block], Block]]:
    """What solves the systems of one shape function for several right-hand sides."""
    basis = reduced.basis
    if shape < basis.n_constraint:
        yield lambda right: body.factored(reduced).solve(right)
        return
    shift = float(basis.eigenvalues[shape - basis.n_constraint])
    if solver == "bordered":
        factor = _BorderedFactor(body.factored(reduced), basis, shift)
        try:
            yield factor
        finally:
            factor.destroy()
        return

    def deflated(right: Block) -> Block:
        shifts = np.full(right.shape[1], shift)
        return body.reduction.solve_shifted(body.factored(reduced), basis, right, shifts)[0]

    yield deflated


class _BorderedFactor:
    """Factor of K - shift M, bordered by the retained modes times M.

    Args:
        factored: K and M with the interfaces held.
        basis: Retained modes.
        shift: One of their eigenvalues [rad^2/s^2].
    """

    def __init__(self, factored: FactoredBody, basis: ReducedBasis, shift: float) -> None:
        self.elasticity = factored.elasticity
        comm, n = self.elasticity.comm, self.elasticity.n_dofs
        size, border = self.elasticity.n_dofs_global, basis.mass_times_normal
        shifted = factored.held_stiffness.copy()
        shifted.axpy(-shift, factored.held_mass, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
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
            self.destroy()
            raise RuntimeError(
                "mode derivatives: the bordered matrix of a normal mode is singular; the number "
                "of modes may cut through a cluster of equal frequencies"
            ) from error

    def __call__(self, right: Block) -> Block:
        """The solutions of several right-hand sides, orthogonal to the retained modes."""
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

    def destroy(self) -> None:
        """Free the memory on all ranks together."""
        self._pc.destroy()
        self._matrix.destroy()
