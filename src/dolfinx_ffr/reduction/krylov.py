# SPDX-License-Identifier: MIT
"""Block Krylov spaces of K^-1 M, in which modes and their adjoints are found.

With the interfaces clamped, T = K^-1 M is self-adjoint in the inner product u^T M v. Blocks of
fields V_0, V_1, ... are M-orthonormal with

    T V_k = V_{k-1} B_k^T + V_k A_k + V_{k+1} B_{k+1},

so that T is banded in their basis, and the last B gives the residual norms of the span of the first
blocks. One block takes one solution with several right-hand sides. All blocks are made orthogonal
to all others. In void and in clamped rows, which have no mass, the fields are those of K^-1.

References:
    G. H. Golub, R. Underwood, The block Lanczos method for computing eigenvalues, in: Mathematical
    Software III, Academic Press 1977, doi:10.1016/B978-0-12-587260-7.50018-2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas

from ..arrays import symmetric
from ..fem import Array, Block, Elasticity
from .factored_body import FactoredBody


@dataclass(frozen=True)
class BasisOptions:
    """Options for orthonormalising a block of fields."""

    #: Norm of a direction, relative to the largest of its block, from which it is taken at once,
    #: exact to round-off times the square of this; the rest is looked at again
    clear: float = 1e-3
    looks: int = 6  #: Looks at a block, each for directions that are smaller by `clear`
    #: Norm of a direction, relative to the fields from which it remains, that is round-off
    round_off: float = 1e-13
    room: int = 80  #: Fields of the first allocation: what is not written to takes no memory


BASIS = BasisOptions()


class KrylovSpace:
    """M-orthonormal basis of a growing block Krylov space, and K^-1 M in it.

    It begins with ``start`` (dofs, b), zero in clamped rows, but for directions of a norm by mass
    below ``floor``, in the M-complement of the M-orthonormal fields ``without``, given with M times
    them.
    """

    def __init__(
        self,
        factored: FactoredBody,
        start: Block,
        without: tuple[Block, Block] | None = None,
        *,
        floor: float = 0.0,
    ) -> None:
        self._factored = factored
        self._without = None if without is None else tuple(map(np.asfortranarray, without))
        self._basis = np.empty((len(start), BASIS.room), order="F")
        self._images: list[Block] = []  # K^-1 M times the blocks of the basis
        self.size = 0  # number of fields of the basis
        self._before = self._last = 0  # where the last two blocks begin
        self._projected = np.zeros((0, 0))
        #: V^T M times the fields of the start, shape (size, b), V their basis
        self.start = self._append(start.copy(order="F"), 0.0, floor)

    @property
    def complete(self) -> int:
        """Number of fields to which K^-1 M has been applied: all but the last block."""
        return self._last

    @property
    def invariant(self) -> bool:
        """Whether K^-1 M does not leave the space."""
        return self.size == self._last

    @property
    def basis(self) -> Block:
        """The complete part of the basis, shape (dofs, complete); not to be written to."""
        return self._basis[:, : self._last]

    @property
    def mass_last(self) -> Block:
        """M times the last block, not stored: all products would take as much as the basis."""
        last_block = self._basis[:, self._last : self.size]
        return self._factored.elasticity.apply(self._factored.clamped.mass, last_block)

    def image_of(self, coefficients: Array) -> Block:
        """K^-1 M times combinations of `basis` by coefficients (complete, k), shape (dofs, k)."""
        total = np.zeros((len(self._basis), coefficients.shape[1]), order="F")
        ends = np.cumsum([block.shape[1] for block in self._images])
        for block, coefficients_of_block in zip(
            self._images, np.split(-coefficients, ends[:-1]), strict=True
        ):
            _subtract(total, block, coefficients_of_block)
        return total

    @property
    def projected(self) -> Array:
        """V^T M K^-1 M V of the complete part V, shape (complete, complete)."""
        return self._projected[: self._last, : self._last]

    @property
    def coupling(self) -> Array:
        """W^T M K^-1 M V of the last block W, shape (size - complete, complete)."""
        return self._projected[self._last :, : self._last]

    def residual_norms(self, coefficients: Array) -> Array:
        """Norms by mass of K^-1 M V c outside the complete part V, for each column c."""
        return np.asarray(np.linalg.norm(self.coupling @ coefficients, axis=0))

    def join(self, fields: Block) -> Array:
        """Add ``fields`` (dofs, b) to the last block.

        Returned are their coefficients in that block, shape (its fields, b).
        """
        along_last = self._factored.elasticity.inner(self.mass_last, fields)
        return np.vstack([along_last, self._append(fields.copy(order="F"), 0.0)])

    def grow(self, image: Block | None = None) -> None:
        """Apply K^-1 M to the last block, and add a block of what leaves the space.

        The ``image``, K^-1 M times the last block, is computed if it is not given.
        """
        second_to_last, begin, size = self._before, self._last, self.size
        masses = self.mass_last
        image = self._factored.solve(masses) if image is None else image
        self._images.append(image)
        diagonal = self._factored.elasticity.inner(masses, image)
        self._projected[begin:, begin:] = symmetric(diagonal)
        recurrence = self._projected[second_to_last:, begin:]
        remainder = image.copy(order="F")
        _subtract(remainder, self._basis[:, second_to_last:size], recurrence)
        coupling = self._append(remainder, float(np.max(np.linalg.norm(recurrence, axis=0))))
        self._before, self._last = begin, size
        self._projected[size:, begin:size] = coupling
        self._projected[begin:size, size:] = coupling.T

    def _append(self, remainder: Block, scale: float, floor: float = 0.0) -> Array:
        """Add a block: an M-orthonormal basis of what fields have outside of the space so far.

        Directions whose norm by mass is round-off of ``scale``, or below ``floor``, are left out.

        Args:
            remainder: The fields (dofs, b), column by column in memory; it is overwritten. Parts in
                the last blocks may have been subtracted.
            scale: Largest norm by mass of these parts.
            floor: Norm below which a direction is left out.

        Returns:
            Coefficients of the ``remainder`` in the new block, shape (its fields, b).
        """
        elasticity, mass = self._factored.elasticity, self._factored.clamped.mass
        coefficients = [np.zeros((0, remainder.shape[1]))]
        for _ in range(BASIS.looks):
            # round-off along the fields of the space would grow
            if self._without is not None:
                fields, masses = self._without
                _subtract(remainder, fields, elasticity.inner(masses, remainder))
            basis = self._basis[:, : self.size]
            along = elasticity.inner(basis, elasticity.apply(mass, remainder))
            _subtract(remainder, basis, along)
            image = elasticity.apply(mass, remainder)
            gram, shares, directions, clear = self._directions(image, remainder, floor)
            largest = float(np.sqrt(shares[-1]))
            scale = max(scale, largest, float(np.linalg.norm(along)))
            if largest <= max(BASIS.round_off * scale, floor):
                break
            factors = directions[:, clear] / np.sqrt(shares[clear])
            coefficients.append(factors.T @ gram)
            new = self._store(remainder, factors)
            if np.all(clear):
                break
            _subtract(remainder, new, coefficients[-1])
        return np.vstack(coefficients)

    def _directions(self, image: Block, remainder: Block, floor: float) -> tuple[NDArray[Any], ...]:
        """Gram matrix of fields by mass, its eigenvalues and eigenvectors, and a mask of these.

        The mask has the directions that are clear of round-off, with a norm above ``floor``.
        """
        elasticity = self._factored.elasticity
        gram = symmetric(elasticity.inner(remainder, image))
        # all ranks must take the same directions
        shares, directions = elasticity.decided(np.linalg.eigh(gram))
        shares = np.maximum(shares, 0.0)
        return gram, shares, directions, shares > max(BASIS.clear**2 * shares[-1], floor**2)

    def _store(self, remainder: Block, factors: Array) -> Block:
        """Add the combinations of fields by ``factors`` (b, k) to the basis, and return them."""
        begin, size = self.size, self.size + factors.shape[1]
        if size > self._basis.shape[1]:
            self._basis = _longer(self._basis, begin, 2 * size)
        np.matmul(factors.T, remainder.T, out=self._basis[:, begin:size].T)
        projected, self._projected = self._projected, np.zeros((size, size))
        self._projected[:begin, :begin] = projected
        self.size = size
        return self._basis[:, begin:size]


def _longer(fields: Block, count: int, room: int) -> Block:
    """The first ``count`` fields with ``room`` for more, column by column in memory."""
    larger = np.empty((len(fields), room), order="F")
    larger[:, :count] = fields[:, :count]
    return larger


def projected(elasticity: Elasticity, matrix: PETSc.Mat, fields: Block) -> Array:
    """V^T A V of a symmetric matrix A and fields V (dofs, k), without round-off's asymmetry."""
    return symmetric(elasticity.inner(fields, elasticity.apply(matrix, fields)))


def _subtract(block: Block, fields: Block, coefficients: Array) -> None:
    """Take combinations of fields from a block where it is; both column by column in memory."""
    if block.size and coefficients.size:
        blas.dgemm(-1.0, fields, coefficients, 1.0, block, overwrite_c=True)
