# SPDX-License-Identifier: MIT
"""Volume integrals of a reduced body, and their pullback to density and shape functions.

With W = [w_0, phi_1, ..., phi_r] (reference position and shape functions, a block of nodal fields)
all integrals are products of one block with the assembled matrices,

    G = W^T M W,   N = (J W)^T M W,   S = W^T M [e_x, e_y],   m = e_x^T M e_x,   K_e = Phi^T K Phi.

In space P_ab^kl = int rho w_a^k w_b^l takes the place of G and N. The mass does not couple the
axes, so that M W, taken component by component, serves all of it.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body import BodyMarker, VolumeIntegrals
from ..fem import Block, Matrices, rotated
from .craig_bampton import CraigBampton, ReducedBasis
from .point_marker import PointMarker

__all__ = [
    "IntegralsPullback",
    "RoundOffWarning",
    "volume_integrals",
    "volume_integrals_pullback",
]

#: Relative round-off of frequencies squared from which it is reported
ROUND_OFF = 1e-6


class RoundOffWarning(UserWarning):
    """The stiffness of a body is so ill-conditioned that round-off shows in the results."""


def volume_integrals(
    reduction: CraigBampton,
    matrices: Matrices,
    basis: ReducedBasis,
    markers: Mapping[str, PointMarker],
) -> VolumeIntegrals:
    """The volume integrals of a body at one density.

    Args:
        reduction: Gives the frame and the motion of the interfaces.
        matrices: Of the body at this density.
        basis: Shape functions; those after the constraint modes leave interfaces where they are.
        markers: Markers besides the interfaces.

    Returns:
        The integrals, bit-identical on every rank; markers are the interfaces' centers and
        ``markers``.

    Warns:
        RoundOffWarning: If the modes' energies and the eigenvalues differ by 1e-6 and more.
    """
    elasticity = reduction.elasticity
    fields, unit = _fields(reduction, basis), reduction.unit_translations
    mass_fields = elasticity.apply(matrices.mass, fields)
    mass_unit = elasticity.apply(matrices.mass, unit)
    stiffness_shapes = elasticity.apply(matrices.stiffness, basis.shapes)
    stiffness = elasticity.inner(basis.shapes, stiffness_shapes)
    _warn_of_round_off(basis, stiffness)
    at = {}
    n_normal = basis.shapes.shape[1] - basis.n_constraint
    for name, interface in elasticity.domain.interfaces.items():
        displacement, rotation = reduction.interface_motion(name)
        at[name] = BodyMarker(
            interface.center - reduction.origin,
            np.pad(displacement, ((0, 0), (0, n_normal))),
            np.pad(rotation, [(0, 0)] * (rotation.ndim - 1) + [(0, n_normal)]),
        )
    for name, marker in markers.items():
        at[name] = BodyMarker(marker.position - reduction.origin, *marker.motion(basis.shapes))
    mass = float(elasticity.inner(unit[:, :1], mass_unit[:, :1])[0, 0])
    S, K = elasticity.inner(fields, mass_unit), 0.5 * (stiffness + stiffness.T)
    if elasticity.dimension == 3:
        P = np.array(
            [
                [elasticity.inner(fields[k::3], mass_fields[j::3]) for j in range(3)]
                for k in range(3)
            ]
        ).transpose(2, 3, 0, 1)
        return VolumeIntegrals.in_space(mass, S, 0.5 * (P + P.transpose(1, 0, 3, 2)), K, at)
    gram = elasticity.inner(fields, mass_fields)
    turned = elasticity.inner(rotated(fields), mass_fields)
    G, N = 0.5 * (gram + gram.T), 0.5 * (turned - turned.T)
    return VolumeIntegrals(mass=mass, S=S, G=G, N=N, K=K, markers=at)


def _warn_of_round_off(basis: ReducedBasis, stiffness: NDArray[np.float64]) -> None:
    """Compare phi^T K phi with lambda: exactly they are the same, as phi^T M phi = 1."""
    energies = np.diag(stiffness)[basis.n_constraint :]
    found = float(np.max(np.abs(energies / basis.eigenvalues - 1.0), initial=0.0))
    if found > ROUND_OFF:
        warnings.warn(
            f"reduction: the stiffness is so ill-conditioned that round-off changes squares of "
            f"frequencies by {found:.0e} of their size, and psi by some ten times that; neither "
            "gradients nor differences are better. Bodies hundreds of times longer than high, and "
            "plane strain of nearly incompressible materials do that, on any mesh: give such a "
            "body by the volume integrals of a beam, or a Poisson's ratio further from one half",
            RoundOffWarning,
            stacklevel=4,
        )


@dataclass(frozen=True)
class IntegralsPullback:
    """Derivative of a number psi through the integrals, before that of the shape functions.

    At fixed shape functions psi changes by  sum_a m_dx(w_a, y_a) + sum_i k_dx(phi_i, kappa_i).
    """

    w: Block  #: (dofs, r + 2) reference position, shape functions, unit translation
    y: Block  #: (dofs, r + 2) partners of ``w``
    kappa: Block  #: (dofs, r) partners of the shape functions in the stiffness
    shapes: Block  #: (dofs, r) derivative with respect to the shape functions at fixed density


def volume_integrals_pullback(
    reduction: CraigBampton,
    matrices: Matrices,
    basis: ReducedBasis,
    markers: Mapping[str, PointMarker],
    bar: VolumeIntegrals,
) -> IntegralsPullback:
    """The transpose of the derivative of `volume_integrals`.

    Args:
        reduction: As in the forward map.
        matrices: As in the forward map.
        basis: As in the forward map.
        markers: As in the forward map.
        bar: Derivative of psi with respect to each integral.
    """
    elasticity = reduction.elasticity
    fields, unit = _fields(reduction, basis), reduction.unit_translations
    stiffness_bar = 0.5 * (bar.K + bar.K.T)
    half = _moments_pullback(fields, bar)
    moment = unit @ bar.S.T
    y = np.hstack([half + moment, bar.mass * unit[:, :1]])
    w = np.hstack([fields, unit[:, :1]])
    kappa = basis.shapes @ stiffness_bar
    shapes = elasticity.apply(matrices.mass, (2.0 * half + moment)[:, 1:])
    shapes += 2.0 * elasticity.apply(matrices.stiffness, kappa)
    for name, marker in markers.items():
        marker_bar = bar.markers[name]
        shapes += marker.pullback(marker_bar.displacement, marker_bar.rotation)
    return IntegralsPullback(w, y, kappa, shapes)


def _moments_pullback(fields: Block, bar: VolumeIntegrals) -> Block:
    """The fields y with  d psi = sum_a m_dx(w_a, y_a)  by G and N, or by P."""
    if bar.P is None:
        gram_bar = 0.5 * (bar.G + bar.G.T)
        turned_bar = 0.5 * (bar.N - bar.N.T)
        # J^T = -J; N is antisymmetric, so both of its slots add up
        return np.asarray(fields @ gram_bar - rotated(fields @ turned_bar.T))
    moments_bar = 0.5 * (bar.P + bar.P.transpose(1, 0, 3, 2))
    half = np.zeros_like(fields)
    for k in range(3):
        for j in range(3):
            half[k::3] += fields[j::3] @ moments_bar[:, :, k, j].T
    return half


def _fields(reduction: CraigBampton, basis: ReducedBasis) -> Block:
    return np.column_stack([reduction.reference, basis.shapes])
