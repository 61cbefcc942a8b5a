# SPDX-License-Identifier: MIT
"""The lowest eigenpairs of K phi = lambda M phi by an approximate inverse of K, for a whole block.

Each iteration minimises Rayleigh quotients over the present fields X, the last changes P and the
preconditioned residuals W of the fields that have not converged. [X, P] stays M-orthonormal, by
small matrices alone, and W is made orthogonal to it, so that no digits are lost. Each iteration
takes one product by K and one by M with W. SLEPc's method applies the inverse to one vector after
the other; with PETSc's cycles it takes as long for 10,000 unknowns, 1.7 times as long for 31,000
with 40 % void (eleven modes: 9.4 instead of 5.5 s of CPU), and 1.34 times for 70,000 without void.

References:
    A. V. Knyazev, Toward the optimal preconditioned eigensolver: locally optimal block
    preconditioned conjugate gradient method, SIAM Journal on Scientific Computing 23 (2001),
    doi:10.1137/S1064827500366124.
    J. A. Duersch, M. Shao, C. Yang, M. Gu, A robust and efficient implementation of LOBPCG, SIAM
    Journal on Scientific Computing 40 (2018), doi:10.1137/17M1129830.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ..arrays import Array, symmetric
from ..fem import Block, Elasticity


@dataclass(frozen=True)
class LobpcgOptions:
    """Limits of iterations, and tolerances for round-off."""

    max_iterations: int = 500
    nothing: float = 1e-13  #: Share of a direction, relative to the largest, that is round-off
    rows: int = 4096  #: Of blocks that are multiplied at a time


LOBPCG = LobpcgOptions()


def lobpcg(
    elasticity: Elasticity,
    products: tuple[Callable[[Block], Block], Callable[[Block], Block]],
    inverse: Callable[[Block], Block],
    starts: Block,
    number: int,
    *,
    deflated: tuple[Block, Block] | None,
    tolerance: float,
) -> tuple[Array, Block] | None:
    """At least ``number`` lowest eigenpairs, (k,) and (dofs, k), or None without convergence.

    ``products`` multiply by K and by M; ``inverse`` is positive definite and approximates the
    inverse of K; as many columns as ``starts`` has are iterated. The pairs are M-orthogonal to the
    ``deflated`` fields, which are given with M times these fields. The residual of each pair in the
    norm of ``inverse`` is at most ``tolerance`` times the norm of the field in K.
    """
    multiply_by_k, multiply_by_m = products
    inner, comm, width = elasticity.inner, elasticity.comm, starts.shape[1]
    # S = [X, P, W], K S and M S; W stands in the last columns
    basis, stiff_basis, mass_basis = bases = [
        np.empty((len(starts), 3 * width), order="F") for _ in range(3)
    ]
    size = 0  # columns of X and P
    active, values = np.arange(width), np.zeros(0)
    directions = starts
    for _ in range(LOBPCG.max_iterations):
        # W, M-orthonormal and M-orthogonal to X and P
        directions = _apart(elasticity, directions, deflated)
        directions = _apart(elasticity, directions, (basis[:, :size], mass_basis[:, :size]))
        mass_directions = multiply_by_m(directions)
        squares, vectors = comm.bcast(np.linalg.eigh(inner(directions, mass_directions)))
        independent = squares > LOBPCG.nothing * squares[-1]
        factors = vectors[:, independent] / np.sqrt(squares[independent])
        end = size + factors.shape[1]
        basis[:, size:end] = directions @ factors
        mass_basis[:, size:end] = mass_directions @ factors
        stiff_basis[:, size:end] = multiply_by_k(basis[:, size:end])

        # Ritz values and vectors in the span of S
        grams = [inner(basis[:, :end], b[:, :end]) for b in (stiff_basis, mass_basis)]
        stiff_gram, mass_gram = (symmetric(gram) for gram in grams)
        # all ranks must take the same
        ritz_values, ritz_vectors = comm.bcast(scipy.linalg.eigh(stiff_gram, mass_gram))
        width = min(width, len(ritz_values))  # fewer where starts depend on each other
        values, lowest = ritz_values[:width], ritz_vectors[:, :width]

        # changes of the active fields, orthogonal to all fields
        changes = lowest[:, active[active < width]]
        changes[: min(width, size)] = 0.0
        for _ in range(2):
            changes -= lowest @ (lowest.T @ (mass_gram @ changes))
        squares, vectors = comm.bcast(np.linalg.eigh(changes.T @ mass_gram @ changes))
        independent = squares > LOBPCG.nothing * max(squares[-1], LOBPCG.nothing)
        changes = changes @ (vectors[:, independent] / np.sqrt(squares[independent]))
        combined = np.hstack([lowest, changes if size else changes[:, :0]])
        size = combined.shape[1]
        for block in bases:  # in place: copies would take as much memory again
            for begin in range(0, len(block), LOBPCG.rows):
                rows = slice(begin, begin + LOBPCG.rows)
                block[rows, :size] = block[rows, :end] @ combined

        # preconditioned residuals of the fields that have not converged
        residual = stiff_basis[:, :width] - values * mass_basis[:, :width]
        directions = inverse(residual)
        residual_squares = elasticity.sum(np.einsum("ij,ij->j", residual, directions))
        is_open = ~(residual_squares <= tolerance**2 * values)  # NaN too
        if not np.any(is_open[:number]):
            n_converged = int(np.argmax(is_open)) if np.any(is_open) else width
            return values[:n_converged], basis[:, :n_converged].copy(order="F")
        active = np.flatnonzero(is_open)
        directions = directions[:, active]
    return None


def _apart(elasticity: Elasticity, block: Block, deflated: tuple[Block, Block] | None) -> Block:
    """The part of fields M-orthogonal to M-orthonormal ones, given with M times them."""
    if deflated is None or deflated[0].shape[1] == 0:
        return block
    for _ in range(2):  # the second time removes the round-off of the first
        block = block - deflated[0] @ elasticity.inner(deflated[1], block)
    return block
