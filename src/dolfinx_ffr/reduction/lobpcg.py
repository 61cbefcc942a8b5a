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

    ``products`` multiply by K and by M; ``inverse`` is positive definite and approximates that of
    K; as many columns as ``starts`` has are iterated. The pairs are M-orthogonal to the
    ``deflated`` fields, which are given with M times them. The residual of each in the norm of
    ``inverse`` is at most ``tolerance`` times the norm of the field in K.
    """
    stiff, massive = products
    inner, comm, width = elasticity.inner, elasticity.comm, starts.shape[1]
    # S, K S, M S; W stands in the last columns
    bases = [np.empty((len(starts), 3 * width), order="F") for _ in range(3)]
    size = 0
    active, values = np.arange(width), np.zeros(0)
    directions = starts
    for _ in range(LOBPCG.max_iterations):
        directions = _apart(elasticity, directions, deflated)
        directions = _apart(elasticity, directions, (bases[0][:, :size], bases[2][:, :size]))
        image = massive(directions)
        shares, vectors = comm.bcast(np.linalg.eigh(inner(directions, image)))
        independent = shares > LOBPCG.nothing * shares[-1]
        factors = vectors[:, independent] / np.sqrt(shares[independent])
        end = size + factors.shape[1]
        bases[0][:, size:end] = directions @ factors
        bases[2][:, size:end] = image @ factors
        bases[1][:, size:end] = stiff(bases[0][:, size:end])
        grams = [inner(bases[0][:, :end], b[:, :end]) for b in bases[1:]]
        gram, metric = (symmetric(g) for g in grams)
        # all ranks must take the same
        ritz_values, vectors = comm.bcast(scipy.linalg.eigh(gram, metric))
        width = min(width, len(ritz_values))  # of starts that depend on each other
        values, chosen = ritz_values[:width], vectors[:, :width]
        # changes of the active fields, orthogonal to all fields
        changes = chosen[:, active[active < width]]
        changes[: min(width, size)] = 0.0
        for _ in range(2):
            changes -= chosen @ (chosen.T @ (metric @ changes))
        shares, vectors = comm.bcast(np.linalg.eigh(changes.T @ metric @ changes))
        independent = shares > LOBPCG.nothing * max(shares[-1], LOBPCG.nothing)
        changes = changes @ (vectors[:, independent] / np.sqrt(shares[independent]))
        combined = np.hstack([chosen, changes if size else changes[:, :0]])
        size = combined.shape[1]
        for basis in bases:  # where they are: copies would take as much memory again
            for begin in range(0, len(basis), LOBPCG.rows):
                rows = slice(begin, begin + LOBPCG.rows)
                basis[rows, :size] = basis[rows, :end] @ combined
        residual = bases[1][:, :width] - values * bases[2][:, :width]
        directions = inverse(residual)
        squares = elasticity.sum(np.einsum("ij,ij->j", residual, directions))
        open_ = ~(squares <= tolerance**2 * values)  # NaN too
        if not np.any(open_[:number]):
            n_converged = int(np.argmax(open_)) if np.any(open_) else width
            return values[:n_converged], bases[0][:, :n_converged].copy(order="F")
        active = np.flatnonzero(open_)
        directions = directions[:, active]
    return None


def _apart(elasticity: Elasticity, block: Block, deflated: tuple[Block, Block] | None) -> Block:
    """The part of fields M-orthogonal to M-orthonormal ones, given with M times them."""
    if deflated is None or deflated[0].shape[1] == 0:
        return block
    for _ in range(2):  # what remains of the first time is round-off
        block = block - deflated[0] @ elasticity.inner(deflated[1], block)
    return block
