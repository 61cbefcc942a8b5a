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

from typing import Any

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas

from ..fem import Array, Block, Elasticity
from .factored_body import FactoredBody

#: Norm of a direction, relative to the largest of its block, from which it is taken at once, exact
#: to round-off times the square of this; the rest is looked at again.
CLEAR = 1e-3
#: Norm of a direction, relative to the fields from which it remains, below which it is round-off
NOTHING = 1e-13
#: Part along the basis, relative to the smallest direction that is taken, up to which mass times
#: the directions is right without another product: round-off of such a product. A larger part grows
#: from block to block where void makes directions small
AGAIN = 1e-14
#: Looks at a block, each for directions that are smaller by `CLEAR`
LOOKS = 6


class KrylovSpace:
    """M-orthonormal basis of a growing block Krylov space, and K^-1 M in it.

    It begins with ``start`` (dofs, b), zero in clamped rows, but for directions of a norm by mass
    below ``floor``, in the M-complement of the M-orthonormal fields ``without``, given with M times
    them. ``images`` says whether K^-1 M V is kept.
    """

    def __init__(
        self,
        factored: FactoredBody,
        start: Block,
        without: tuple[Block, Block] | None = None,
        *,
        images: bool = False,
        floor: float = 0.0,
    ) -> None:
        self._factored = factored
        self._without = None if without is None else tuple(map(np.asfortranarray, without))
        self._basis = np.empty((len(start), 0), order="F")
        self._images: list[Block] | None = [] if images else None
        self.size = 0  # number of fields of the basis
        self._before = self._last = 0  # where the last two blocks begin
        self._projected = np.zeros((0, 0))
        self._mass_last = np.empty((len(start), 0))  # M times the last block
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
    def images(self) -> Block:
        """K^-1 M times `basis`, shape (dofs, complete)."""
        assert self._images is not None
        return np.asfortranarray(np.hstack(self._images))

    @property
    def projected(self) -> Array:
        """V^T M K^-1 M V of the complete part V, shape (complete, complete)."""
        return self._projected[: self._last, : self._last]

    @property
    def coupling(self) -> Array:
        """The same with the last block W, W^T M K^-1 M V, shape (size - complete, complete)."""
        return self._projected[self._last :, : self._last]

    def residual_norms(self, coefficients: Array) -> Array:
        """Norms by mass of K^-1 M V c outside the complete part V, for each column c."""
        return np.asarray(np.linalg.norm(self.coupling @ coefficients, axis=0))

    def join(self, fields: Block) -> Array:
        """Add ``fields`` (dofs, b) to the last block; their coefficients in it, (its fields, b)."""
        last = self._mass_last
        known = self._factored.elasticity.inner(last, fields)
        new = self._append(fields.copy(order="F"), 0.0)
        self._mass_last = np.hstack([last, self._mass_last])
        return np.vstack([known, new])

    def grow(self) -> None:
        """Apply K^-1 M to the last block, and add what is new."""
        before, last, size = self._before, self._last, self.size
        image = self._factored.solve(self._mass_last)
        if self._images is not None:
            self._images.append(image)
        diagonal = self._factored.elasticity.inner(self._mass_last, image)
        self._projected[last:, last:] = symmetric(diagonal)
        known = self._projected[before:, last:]
        rest = image.copy(order="F") if self._images is not None else image
        _subtract(rest, self._basis[:, before:size], known)
        coupling = self._append(rest, float(np.max(np.linalg.norm(known, axis=0))))
        self._before, self._last = last, size
        self._projected[size:, last:size] = coupling
        self._projected[last:size, size:] = coupling.T

    def _append(self, rest: Block, scale: float, floor: float = 0.0) -> Array:
        """Add an M-orthonormal basis of fields as the last block; their coefficients in it.

        The ``rest`` (dofs, b), column by column, of fields of norm ``scale`` is changed.
        """
        elasticity, mass = self._factored.elasticity, self._factored.clamped_mass
        images, coefficients = [self._mass_last[:, :0]], [np.zeros((0, rest.shape[1]))]
        for _ in range(LOOKS):
            # round-off along what is there would grow
            if self._without is not None:
                fields, masses = self._without
                _subtract(rest, fields, elasticity.inner(masses, rest))
            image = elasticity.apply(mass, rest)
            basis = self._basis[:, : self.size]
            along = elasticity.inner(basis, image)
            _subtract(rest, basis, along)
            gram, shares, directions, clear = self._directions(image, rest, floor)
            least = np.sqrt(np.min(shares[clear], initial=shares[-1]))
            if np.max(np.abs(along), initial=0.0) > AGAIN * least:
                image = elasticity.apply(mass, rest)
                gram, shares, directions, clear = self._directions(image, rest, floor)
            largest = float(np.sqrt(shares[-1]))
            scale = max(scale, largest, float(np.linalg.norm(along, 2)) if along.size else 0.0)
            if largest <= max(NOTHING * scale, floor):
                break
            factors = directions[:, clear] / np.sqrt(shares[clear])
            # column by column in memory
            new = (factors.T @ rest.T).T
            images.append((factors.T @ image.T).T)
            coefficients.append(factors.T @ gram)
            self._store(new)
            if np.all(clear):
                break
            _subtract(rest, new, coefficients[-1])
        self._mass_last = np.hstack(images)
        return np.vstack(coefficients)

    def _directions(self, image: Block, rest: Block, floor: float) -> tuple[NDArray[Any], ...]:
        """Products of fields by mass, their eigenvalues and -vectors, and which are taken."""
        elasticity = self._factored.elasticity
        gram = symmetric(elasticity.inner(rest, image))
        # all ranks must take the same directions
        shares, directions = elasticity.comm.bcast(np.linalg.eigh(gram))
        shares = np.maximum(shares, 0.0)
        return gram, shares, directions, shares > max(CLEAR**2 * shares[-1], floor**2)

    def _store(self, new: Block) -> None:
        size, room = self.size + new.shape[1], self._basis.shape[1]
        if size > room:
            larger = np.empty((len(new), max(size, 2 * room)), order="F")
            larger[:, : self.size] = self._basis[:, : self.size]
            self._basis = larger
        self._basis[:, self.size : size] = new
        self._projected = np.pad(self._projected, (0, new.shape[1]))
        self.size = size


def symmetric(matrix: Array) -> Array:
    """The symmetric part of a square matrix."""
    return 0.5 * (matrix + matrix.T)


def projected(elasticity: Elasticity, matrix: PETSc.Mat, fields: Block) -> Array:
    """V^T A V of a symmetric matrix A and fields V (dofs, k), without round-off's asymmetry."""
    return symmetric(elasticity.inner(fields, elasticity.apply(matrix, fields)))


def _subtract(block: Block, fields: Block, coefficients: Array) -> None:
    """Take combinations of fields from a block where it is; both column by column in memory."""
    if block.size and coefficients.size:
        blas.dgemm(-1.0, fields, coefficients, 1.0, block, overwrite_c=True)
