# SPDX-License-Identifier: MIT
"""What the normal modes that are left out of a body would do: modes of the residual flexibility.

Loads f act on the interior of a body. Kept modes Phi, with Phi^T M Phi = I and
Phi^T K Phi = Lambda, answer with the flexibility Phi Lambda^-1 Phi^T; what they miss is

    R f = (K^-1 - Phi Lambda^-1 Phi^T) f = (1 - Phi Phi^T M) K^-1 f,

the static displacement less its share along the kept modes, M-orthogonal to all of them. The loads
of a moving body are sums of a few fields with amplitudes that vary in time: the inertia of unit
accelerations and of unit angular velocity, M [e_x, e_y, w_0, J w_0] in the plane, that of the
constraint modes, and unit forces and couples at the points of the body. The fields R f, and those
of their own inertia R M R f, orthonormal by Rayleigh and Ritz, join the shape functions like modes
of higher frequency. A simulation with them differs from one without by the error of the truncation:
that of the static response exactly, that of the left-out modes' vibrations in two terms of a
series.

What the frame of reference or a missing constraint mode leaves out is not seen.

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

__all__ = ["with_residual_modes"]

#: Residual energy of a load relative to its whole energy below which it counts as round-off, and
#: share of a combination of loads in them below which they count as dependent.
NOTHING, DEPENDENT = 1e-14, 1e-12


def with_residual_modes(body: FlexibleBody, reduced: ReducedBody, *, terms: int = 2) -> ReducedBody:
    """A reduced body whose shape functions also answer what the left-out modes would.

    The cost is that of two back-substitutions with about ten right-hand sides each, and of the
    volume integrals; if the body has been reduced at another density since, that of assembling and
    factoring its matrices once more.

    Args:
        body: The body.
        reduced: What its `reduce` returned.
        terms: Of the series: 1 for static displacements alone, 2 for those under their own inertia
            as well.

    Returns:
        The same body with residual modes after its normal modes; not for a pullback.
    """
    residual, eigenvalues = _residual_modes(body, reduced, terms)
    basis = replace(
        reduced.basis,
        shapes=np.hstack([reduced.basis.shapes, residual]),
        eigenvalues=np.append(reduced.basis.eigenvalues, eigenvalues),
    )
    return replace(reduced, basis=basis, integrals=body.integrals(body.factored(reduced), basis))


def _residual_modes(body: FlexibleBody, reduced: ReducedBody, terms: int) -> tuple[Block, Block]:
    """M-orthonormal residual modes, (dofs, k), and their Rayleigh quotients, (k,)."""
    elasticity, reduction, basis = body.elasticity, body.reduction, reduced.basis
    factored = body.factored(reduced)
    stiffness, mass = factored.matrices.stiffness, factored.matrices.mass
    inner, k = elasticity.inner, basis.n_constraint
    normal = basis.shapes[:, k:]
    mass_normal = elasticity.apply(mass, normal) if normal.shape[1] else normal

    def left(fields: Block) -> Block:
        return fields - normal @ inner(mass_normal, fields)

    rigid = [reduction.unit_translations, reduction.unit_gradients]
    fields = np.hstack([*rigid, basis.shapes[:, :k]])
    loads = elasticity.apply(mass, fields)
    loads = np.hstack([loads, *(marker.rows.T.toarray() for marker in body.markers.values())])
    loads[reduction.held] = 0.0

    parts: list[Block] = []
    for _ in range(terms):
        whole = factored.solve(loads)
        found = left(left(whole))
        energy = np.diag(inner(found, elasticity.apply(stiffness, found)))
        matters = energy > NOTHING * np.abs(np.diag(inner(whole, loads)))
        parts.append(found[:, matters] / np.sqrt(energy[matters]))
        loads = elasticity.apply(mass, parts[-1])
        loads[reduction.held] = 0.0
    found = np.hstack(parts)
    if found.shape[1] == 0:
        return found, np.zeros(0)
    gram = inner(found, elasticity.apply(stiffness, found))
    # bases of repeated eigenvalues are arbitrary: all ranks must take the same
    shares, vectors = elasticity.comm.bcast(np.linalg.eigh(0.5 * (gram + gram.T)))
    apart = shares > DEPENDENT * shares[-1]
    found = left(found @ (vectors[:, apart] / np.sqrt(shares[apart])))
    projected = [inner(found, elasticity.apply(matrix, found)) for matrix in (mass, stiffness)]
    # the largest 1 / lambda first
    pairs = scipy.linalg.eigh(*(0.5 * (product + product.T) for product in projected))
    flexible, vectors = elasticity.comm.bcast(pairs)
    flexible, vectors = flexible[::-1], vectors[:, ::-1]
    return found @ (vectors / np.sqrt(flexible)), 1.0 / flexible
