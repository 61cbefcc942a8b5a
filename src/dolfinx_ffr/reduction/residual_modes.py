# SPDX-License-Identifier: MIT
"""The response of the truncated normal modes of a body: modes of the residual flexibility.

Loads f act on the interior of a body. Kept modes Phi, with Phi^T M Phi = I and
Phi^T K Phi = Lambda, answer with the flexibility Phi Lambda^-1 Phi^T; they miss

    R f = (K^-1 - Phi Lambda^-1 Phi^T) f = (1 - Phi Phi^T M) K^-1 f,

the static displacement less its share along the retained modes, M-orthogonal to all of them. The
loads of a moving body are sums of a few fields with amplitudes that vary in time: the inertia of
unit accelerations and of unit angular velocity, M [e_x, e_y, w_0, J w_0] in the plane, the inertia
of the constraint modes, and unit forces and couples at the points of the body. The fields R f, and
R M R f under their own inertia, orthonormal by Rayleigh and Ritz, join the shape functions like
modes of higher frequency. A simulation with them differs from one without by the error of the
truncation: exactly for the static response, in two terms of a series for the vibrations of the
truncated modes.

The error by the frame of reference or by a missing constraint mode is not seen.

References:
    J. M. Dickens, J. M. Nakagawa, M. J. Wittbrodt, A critique of mode acceleration and modal
    truncation augmentation methods for modal response analysis, Computers & Structures 62 (1997),
    doi:10.1016/S0045-7949(96)00315-X.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg

from ..fem import Block
from .flexible_body import FlexibleBody, ReducedBody
from .krylov import projected

#: Residual energy of a load relative to its whole energy below which it counts as round-off, and
#: share of a combination of loads below which they count as dependent
NOTHING, DEPENDENT = 1e-14, 1e-12


def with_residual_modes(body: FlexibleBody, reduced: ReducedBody, *, terms: int = 2) -> ReducedBody:
    """A ``reduced`` body with residual modes after its normal modes; not for a pullback.

    With one of the two ``terms`` of the series it has static displacements alone.
    """
    modes, eigenvalues = _residual_modes(body, reduced, terms)
    basis = replace(
        reduced.basis,
        shapes=np.hstack([reduced.basis.shapes, modes]),
        eigenvalues=np.append(reduced.basis.eigenvalues, eigenvalues),
    )
    return replace(reduced, basis=basis, integrals=body.integrals(body.factored(reduced), basis))


def _residual_modes(body: FlexibleBody, reduced: ReducedBody, terms: int) -> tuple[Block, Block]:
    """M-orthonormal residual modes, (dofs, k), and their Rayleigh quotients, (k,)."""
    elasticity, reduction, basis = body.elasticity, body.reduction, reduced.basis
    factored = body.factored(reduced)
    stiffness, mass = factored.matrices.stiffness, factored.matrices.mass
    inner, normal = elasticity.inner, basis.normal
    mass_normal = elasticity.apply(mass, normal) if normal.shape[1] else normal

    def residual(fields: Block) -> Block:
        return fields - normal @ inner(mass_normal, fields)

    rigid = [reduction.unit_translations, reduction.unit_gradients]
    loads = elasticity.apply(mass, np.hstack([*rigid, basis.constraint]))
    loads = np.hstack([loads, *(marker.rows.T.toarray() for marker in body.markers.values())])
    loads[reduction.clamped] = 0.0

    terms_of_series: list[Block] = []
    for _ in range(terms):
        static = factored.solve(loads)
        residuals = residual(residual(static))
        energy = np.diag(inner(residuals, elasticity.apply(stiffness, residuals)))
        matters = energy > NOTHING * np.abs(np.diag(inner(static, loads)))
        terms_of_series.append(residuals[:, matters] / np.sqrt(energy[matters]))
        loads = elasticity.apply(mass, terms_of_series[-1])
        loads[reduction.clamped] = 0.0
    residuals = np.hstack(terms_of_series)
    if residuals.shape[1] == 0:
        return residuals, np.zeros(0)
    # bases of repeated eigenvalues are arbitrary: all ranks must take the same
    pairs = np.linalg.eigh(projected(elasticity, stiffness, residuals))
    shares, vectors = elasticity.comm.bcast(pairs)
    independent = shares > DEPENDENT * shares[-1]
    residuals = residual(residuals @ (vectors[:, independent] / np.sqrt(shares[independent])))
    # the largest 1 / lambda first
    pairs = scipy.linalg.eigh(*(projected(elasticity, m, residuals) for m in (mass, stiffness)))
    flexible, vectors = elasticity.comm.bcast(pairs)
    flexible, vectors = flexible[::-1], vectors[:, ::-1]
    return residuals @ (vectors / np.sqrt(flexible)), 1.0 / flexible
