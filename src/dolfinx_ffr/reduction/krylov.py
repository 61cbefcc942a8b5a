# SPDX-License-Identifier: MIT
"""Block Krylov spaces of K^-1 M, in which modes and their adjoints are found.

With the interfaces held, T = K^-1 M is self-adjoint in the inner product u^T M v. Blocks of fields
V_0, V_1, ... are M-orthonormal with

    T V_k = V_{k-1} B_k^T + V_k A_k + V_{k+1} B_{k+1},

so that T is banded in their basis, and what leaves the span of the first blocks is known by the
last B. One block takes one solution with several right-hand sides, which costs little more than a
single one, and whose columns ranks can share. All blocks are made orthogonal to all others. Fields
in void and in held rows, which have no mass, are those of K^-1.

References:
    G. H. Golub, R. Underwood, The block Lanczos method for computing eigenvalues, in: Mathematical
    Software III, Academic Press 1977, doi:10.1016/B978-0-12-587260-7.50018-2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas

from ..fem import Block
from .factored_body import FactoredBody

__all__ = ["KrylovSpace"]

#: Norm of a direction, relative to the largest of its block, from which it is taken at once, exact
#: to round-off times the square of this; what is left is looked at again.
CLEAR = 1e-3
#: Norm of a direction, relative to what it is the rest of, below which it is round-off
NOTHING = 1e-13
#: Part along the basis, relative to the smallest direction that is taken, up to which mass times
#: the directions is right without another product: round-off of such a product. What is more grows
#: from block to block where void makes directions small
AGAIN = 1e-14
#: Looks at a block, each for directions that are smaller by `CLEAR`
LOOKS = 6


class KrylovSpace:
    """M-orthonormal basis of a growing block Krylov space, and K^-1 M in it.

    Args:
        factored: The body at one density.
        start: Fields that the space begins with, zero where the body is held, shape (dofs, b).
        without: M-orthonormal fields to whose complement the space belongs, and M times them,
            shape (dofs, k) each.
        answers: Whether K^-1 M times the basis is kept.
        floor: Norm by mass below which directions of the start are left out.
    """

    def __init__(
        self,
        factored: FactoredBody,
        start: Block,
        without: tuple[Block, Block] | None = None,
        *,
        answers: bool = False,
        floor: float = 0.0,
    ) -> None:
        self._factored = factored
        self._without = None if without is None else tuple(map(np.asfortranarray, without))
        self._basis = np.empty((len(start), 0), order="F")
        self._answers: list[Block] | None = [] if answers else None
        self.size = 0  #: Number of fields of the basis
        self._before = self._last = 0  # where the last two blocks begin
        self._projected = np.zeros((0, 0))
        self._images = np.empty((len(start), 0))
        #: V^T M times the fields of the start, shape (size, b), V their basis
        self.start = self._append(start.copy(order="F"), 0.0, floor)

    @property
    def complete(self) -> int:
        """Number of fields to which K^-1 M has been applied: all but those of the last block."""
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
    def answers(self) -> Block:
        """K^-1 M times `basis`, shape (dofs, complete)."""
        assert self._answers is not None
        return np.asfortranarray(np.hstack(self._answers))

    @property
    def projected(self) -> NDArray[np.float64]:
        """V^T M K^-1 M V of the complete part V, shape (complete, complete)."""
        return self._projected[: self._last, : self._last]

    def leaving(self, coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
        """Norms of what K^-1 M has outside the complete part for fields of it.

        Args:
            coefficients: Of the fields in `basis`, shape (complete, columns).

        Returns:
            Norms by mass, shape (columns,).
        """
        coupling = self._projected[self._last :, : self._last]
        return np.asarray(np.linalg.norm(coupling @ coefficients, axis=0))

    def grow(self) -> None:
        """Apply K^-1 M to the last block, and add what is new."""
        before, last, size = self._before, self._last, self.size
        answer = self._factored.solve(self._images)
        if self._answers is not None:
            self._answers.append(answer)
        diagonal = self._factored.elasticity.inner(self._images, answer)
        self._projected[last:, last:] = 0.5 * (diagonal + diagonal.T)
        known = self._projected[before:, last:]
        rest = answer.copy(order="F") if self._answers is not None else answer
        _subtract(rest, self._basis[:, before:size], known)
        coupling = self._append(rest, float(np.max(np.linalg.norm(known, axis=0))))
        self._before, self._last = last, size
        self._projected[size:, last:size] = coupling
        self._projected[last:size, size:] = coupling.T

    def _append(self, rest: Block, scale: float, floor: float = 0.0) -> NDArray[np.float64]:
        """Add an M-orthonormal basis of fields as the last block.

        Args:
            rest: The fields, shape (dofs, b), column by column in memory; changed.
            scale: Norm of what they are the rest of.
            floor: Norm below which directions are left out.

        Returns:
            Their coefficients in the new fields, shape (new fields, b).
        """
        elasticity, mass = self._factored.elasticity, self._factored.held_mass
        images, coefficients = [self._images[:, :0]], [np.zeros((0, rest.shape[1]))]
        for _ in range(LOOKS):
            # round-off along what is there would grow
            if self._without is not None:
                fields, masses = self._without
                _subtract(rest, fields, elasticity.inner(masses, rest))
            image = elasticity.apply(mass, rest)
            basis = self._basis[:, : self.size]
            along = elasticity.inner(basis, image)
            _subtract(rest, basis, along)
            gram, shares, directions = self._directions(rest, image)
            clear = shares > max(CLEAR**2 * shares[-1], floor**2)
            least = np.sqrt(np.min(shares[clear], initial=shares[-1]))
            if np.max(np.abs(along), initial=0.0) > AGAIN * least:
                image = elasticity.apply(mass, rest)
                gram, shares, directions = self._directions(rest, image)
                clear = shares > max(CLEAR**2 * shares[-1], floor**2)
            largest = float(np.sqrt(shares[-1]))
            scale = max(scale, largest)
            if largest <= max(NOTHING * scale, floor):
                break
            factors = directions[:, clear] / np.sqrt(shares[clear])
            new = _product(rest, factors)
            images.append(_product(image, factors))
            coefficients.append(factors.T @ gram)
            self._store(new)
            if np.all(clear):
                break
            _subtract(rest, new, coefficients[-1])
        self._images = np.hstack(images)
        return np.vstack(coefficients)

    def _directions(self, rest: Block, image: Block) -> tuple[NDArray[np.float64], ...]:
        """Products of fields by mass, their eigenvalues, not negative, and eigenvectors."""
        elasticity = self._factored.elasticity
        gram = elasticity.inner(rest, image)
        gram = 0.5 * (gram + gram.T)
        # all ranks must take the same directions
        shares, directions = elasticity.comm.bcast(np.linalg.eigh(gram))
        return gram, np.maximum(shares, 0.0), directions

    def _store(self, new: Block) -> None:
        size = self.size + new.shape[1]
        if size > self._basis.shape[1]:
            larger = np.empty((len(new), max(size, 2 * self._basis.shape[1])), order="F")
            larger[:, : self.size] = self._basis[:, : self.size]
            self._basis = larger
        self._basis[:, self.size : size] = new
        self._projected = np.pad(self._projected, (0, new.shape[1]))
        self.size = size


def _product(fields: Block, factors: NDArray[np.float64]) -> Block:
    """Combinations of fields, column by column in memory."""
    return (factors.T @ fields.T).T


def _subtract(block: Block, fields: Block, coefficients: NDArray[np.float64]) -> None:
    """Take combinations of fields from a block where it is; both column by column in memory."""
    if block.size and coefficients.size:
        blas.dgemm(-1.0, fields, coefficients, 1.0, block, overwrite_c=True)
