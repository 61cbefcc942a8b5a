# SPDX-License-Identifier: MIT
"""Proof with a known small risk that a Krylov space has missed no eigenvalue.

A space that grows from b fields holds b copies of an eigenvalue at most. So fields of noise join
it, which do not depend on what it has found. Let C be the fields to which T = K^-1 M was applied
before, u the eigenvector of the largest eigenvalue theta of T in the M-complement of C, and A that
restriction of T, which the space goes on to project to H. The parts of u along its blocks follow
the recurrence of A, so that, with the last coupling B and theta above the eigenvalues of H,

    (parts along the first block) = E_1^T (theta - H)^-1 E_j B^T (parts along the next block),

and the latter have norm one at most. So if the right-hand side is small for all theta above a
bound, u is nearly orthogonal to the noise, or theta is below the bound. The noise is K^-1 f with
normally distributed forces f of a covariance that is at least M, so its part along u has a standard
deviation of theta at least in each of s columns, and is smaller than epsilon theta in all of them
with a probability of (epsilon^2 / 2)^(s / 2) / Gamma(s / 2 + 1) at most. With theta below the bound
the eigenvalues of T above are those of a small matrix, by Sylvester's law.

References:
    J. Kuczynski, H. Wozniakowski, Estimating the largest eigenvalue by the power and Lanczos
    algorithms with a random start, SIAM Journal on Matrix Analysis and Applications 13 (1992),
    doi:10.1137/0613066, for single vectors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import Mask, symmetric
from ..fem import Block
from .factored_body import FactoredBody
from .krylov import KrylovSpace


@dataclass(frozen=True)
class CertificateOptions:
    """Noise by which a missing mode is seen, and how its absence is proved."""

    columns: int = (
        3  #: Fields of noise: the space is done when its modes are accurate, as with four
    )
    risk: float = 1e-10  #: Probability with which a missing mode remains unseen, at most
    #: Distances from the eigenvalues of H at which theta is tried, relative to that of the bound,
    #: each sqrt(2) times the one before: the eigenvalues are poles, from which norms fall off
    #: smoothly
    distances: int = 24

    @property
    def small(self) -> float:
        """Noise along a mode, over its standard deviation, that has this probability."""
        s = self.columns
        return math.sqrt(2.0) * (self.risk * math.gamma(s / 2 + 1)) ** (1 / s)


CERTIFICATE = CertificateOptions()


class Certificate:
    """Noise that has joined a ``space``, by fields of forces such as `noise` makes."""

    def __init__(self, space: KrylovSpace, fields: Block) -> None:
        self._space = space
        self._first = space.complete  # fields of C
        self._shares = space.join(fields)

    def holds(self, limit: float, number: int) -> bool | None:
        """Whether T has no more than ``number`` eigenvalues above a ``limit``.

        None as long as the space is too small for an answer; False if some were outside of C.
        """
        space, n_before = self._space, self._first
        if space.complete == n_before:
            return True if space.invariant else None  # noise has added nothing
        projected = space.projected
        values, vectors = np.linalg.eigh(projected[n_before:, n_before:])
        if values[-1] >= limit:
            return False
        bound = 0.5 * (limit + values[-1])
        coupling = space.coupling
        noise_parts = self._shares.T @ vectors[: len(self._shares)]
        coupling_parts = vectors.T @ coupling[:, n_before:].T
        distances = 2.0 ** (0.5 * np.arange(CERTIFICATE.distances))
        for theta in values[-1] + distances * (bound - values[-1]):
            coupled = (noise_parts / (theta - values)) @ coupling_parts
            if np.linalg.norm(coupled) > CERTIFICATE.small * theta:
                return None
        # the most that the rest of T, whose eigenvalues are below the bound, adds by the coupling
        bounded = projected + symmetric(coupling.T @ coupling) / (limit - bound)
        return True if np.count_nonzero(np.linalg.eigvalsh(bounded) > limit) <= number else None


def noise(factored: FactoredBody, clamped: Mask, number: int) -> Block:
    """Normally distributed forces f of fields K^-1 f, others for each ``number``, (dofs, s)."""
    elasticity = factored.elasticity
    diagonal = factored.clamped.mass.getDiagonal()
    variances = elasticity.mass_over_diagonal * np.maximum(diagonal.getArray(readonly=True), 0.0)
    diagonal.destroy()
    generator = np.random.default_rng([number, elasticity.comm.rank])
    forces = generator.standard_normal((elasticity.n_dofs, CERTIFICATE.columns))
    forces *= np.where(clamped, 0.0, np.sqrt(variances))[:, None]
    return forces
