# SPDX-License-Identifier: MIT
"""Volume integrals of a reduced body, and their pullback to density and shape functions.

With W = [w_0, phi_1, ..., phi_r] (reference position and shape functions, a block of nodal fields)
all integrals are products of one block with the assembled matrices,

    G = W^T M W,   N = (J W)^T M W,   S = W^T M [e_x, e_y],   m = e_x^T M e_x,   K_e = Phi^T K Phi.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .body import BodyMarker, VolumeIntegrals
from .elasticity import Block, Elasticity, rotated
from .markers import PointMarker
from .reduction import CraigBampton, ReducedBasis

__all__ = [
    "IntegralsPullback",
    "RoundOffWarning",
    "volume_integrals",
    "volume_integrals_pullback",
]

#: relative round-off of frequencies squared from which it is reported
ROUND_OFF = 1e-6


class RoundOffWarning(UserWarning):
    """The stiffness of a body is so ill-conditioned that round-off shows in the results."""


def volume_integrals(
    elasticity: Elasticity,
    reduction: CraigBampton,
    basis: ReducedBasis,
    points: Mapping[str, PointMarker],
) -> VolumeIntegrals:
    """Return the volume integrals of a body at the density that is assembled.

    Args:
        elasticity: the body's matrices.
        reduction: gives the frame and the motion of the interfaces.
        basis: shape functions.
        points: markers besides the interfaces.

    Returns:
        The integrals, bit-identical on every rank; markers are the interfaces' centers and
        ``points``.

    Warns:
        RoundOffWarning: if the modes' energies and the eigenvalues differ by 1e-6 and more.
    """
    fields = _fields(reduction, basis)
    constants = _constants(elasticity)
    mass_fields = elasticity.apply(elasticity.mass, fields)
    mass_constants = elasticity.apply(elasticity.mass, constants)
    stiffness_shapes = elasticity.apply(elasticity.stiffness, basis.shapes)
    gram = elasticity.inner(fields, mass_fields)
    turned = elasticity.inner(rotated(fields), mass_fields)
    stiffness = elasticity.inner(basis.shapes, stiffness_shapes)
    _warn_of_round_off(basis, stiffness)
    markers = {
        name: BodyMarker(interface.center - reduction.origin, *reduction.interface_motion(name))
        for name, interface in elasticity.domain.interfaces.items()
    }
    for name, point in points.items():
        markers[name] = BodyMarker(point.position - reduction.origin, *point.motion(basis.shapes))
    return VolumeIntegrals(
        mass=float(elasticity.inner(constants[:, :1], mass_constants[:, :1])[0, 0]),
        S=elasticity.inner(fields, mass_constants),
        G=0.5 * (gram + gram.T),
        N=0.5 * (turned - turned.T),
        K=0.5 * (stiffness + stiffness.T),
        markers=markers,
    )


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
    elasticity: Elasticity,
    reduction: CraigBampton,
    basis: ReducedBasis,
    points: Mapping[str, PointMarker],
    bar: VolumeIntegrals,
) -> IntegralsPullback:
    """Return the transpose of the derivative of `volume_integrals`.

    Args:
        elasticity: the body's matrices at the density of the forward map.
        reduction: as in the forward map.
        basis: as in the forward map.
        points: as in the forward map.
        bar: derivative of psi with respect to each integral.
    """
    fields = _fields(reduction, basis)
    constants = _constants(elasticity)
    gram_bar = 0.5 * (bar.G + bar.G.T)
    turned_bar = 0.5 * (bar.N - bar.N.T)
    stiffness_bar = 0.5 * (bar.K + bar.K.T)
    # J^T = -J; N is antisymmetric, so both of its slots add up
    half = fields @ gram_bar - rotated(fields @ turned_bar.T)
    moment = constants @ bar.S.T
    y = np.hstack([half + moment, bar.mass * constants[:, :1]])
    w = np.hstack([fields, constants[:, :1]])
    kappa = basis.shapes @ stiffness_bar
    shapes = elasticity.apply(elasticity.mass, (2.0 * half + moment)[:, 1:])
    shapes += 2.0 * elasticity.apply(elasticity.stiffness, kappa)
    for name, point in points.items():
        marker = bar.markers[name]
        shapes += point.pullback(marker.displacement, marker.rotation)
    return IntegralsPullback(w, y, kappa, shapes)


def _fields(reduction: CraigBampton, basis: ReducedBasis) -> Block:
    return np.column_stack([reduction.reference, basis.shapes])


def _constants(elasticity: Elasticity) -> NDArray[np.float64]:
    constants = np.zeros((elasticity.n_dofs, 2))
    constants[0::2, 0] = 1.0
    constants[1::2, 1] = 1.0
    return constants
