# SPDX-License-Identifier: MIT
"""Volume integrals of a reduced body, and their pullback to density and shape functions.

With W = [w_0, phi_1, ..., phi_r] (reference position and shape functions),

    G = W^T M W,   N = (J W)^T M W,   S = W^T M [e_x, e_y],   m = e_x^T M e_x,   K_e = Phi^T K Phi.

In space P_ab^kl = int rho w_a^k w_b^l takes the place of G and N. The mass does not couple the
axes, so that M W, taken component by component, serves all of it.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np

from ..arrays import symmetric
from ..body import BodyMarker, VolumeIntegrals
from ..fem import Array, Block, Elasticity, FieldPairs, Matrices, rotated
from .craig_bampton import CraigBampton, ReducedBasis, ShapesBar
from .krylov import projected
from .point_marker import PointMarker

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
    """The volume integrals of a body at one density, bit-identical on every rank."""
    elasticity = reduction.elasticity
    fields, unit = _fields(reduction, basis), reduction.unit_translations
    mass_fields = elasticity.apply(matrices.mass, fields)
    mass_unit = elasticity.apply(matrices.mass, unit)
    K = projected(elasticity, matrices.stiffness, basis.shapes)
    _warn_of_round_off(basis, K)
    at_markers = {}
    n_normal = basis.shapes.shape[1] - basis.n_constraint
    for name, interface in elasticity.domain.interfaces.items():
        displacement, rotation = reduction.interface_motion(name)
        at_markers[name] = BodyMarker(
            interface.center - reduction.origin,
            np.pad(displacement, ((0, 0), (0, n_normal))),
            np.pad(rotation, [(0, 0)] * (rotation.ndim - 1) + [(0, n_normal)]),
        )
    for name, marker in markers.items():
        at_markers[name] = BodyMarker(
            marker.position - reduction.origin, *marker.motion(basis.shapes)
        )
    mass = float(elasticity.inner(unit[:, :1], mass_unit[:, :1])[0, 0])
    S = elasticity.inner(fields, mass_unit)
    if elasticity.dimension == 3:
        P = _second_moments(elasticity, fields, mass_fields)
        return VolumeIntegrals.in_space(mass, S, P, K, at_markers)
    G = symmetric(elasticity.inner(fields, mass_fields))
    turned = elasticity.inner(rotated(fields), mass_fields)
    N = 0.5 * (turned - turned.T)
    return VolumeIntegrals(mass=mass, S=S, G=G, N=N, K=K, markers=at_markers)


def _second_moments(elasticity: Elasticity, fields: Block, mass_fields: Block) -> Array:
    """Int rho w_a w_b^T, shape (a, a, d, d), of fields and their products with the mass."""
    d = elasticity.dimension
    moments = [elasticity.inner(fields[k::d], mass_fields[j::d]) for k, j in np.ndindex(d, d)]
    P = np.stack(moments, axis=-1).reshape(*moments[0].shape, d, d)
    return 0.5 * (P + P.transpose(1, 0, 3, 2))


def second_moments(reduction: CraigBampton, matrices: Matrices, basis: ReducedBasis) -> Array:
    """Int rho w_a w_b^T of a body at one density, (r + 1, r + 1, d, d), all of it in the plane."""
    fields = _fields(reduction, basis)
    mass_fields = reduction.elasticity.apply(matrices.mass, fields)
    return _second_moments(reduction.elasticity, fields, mass_fields)


def _warn_of_round_off(basis: ReducedBasis, stiffness: Array) -> None:
    """Warn if phi^T K phi is not lambda, as it is exactly where phi^T M phi = 1."""
    energies = np.diag(stiffness)[basis.n_constraint :]
    error = float(np.max(np.abs(energies / basis.eigenvalues - 1.0), initial=0.0))
    if error > ROUND_OFF:
        warnings.warn(
            "reduction: the stiffness is so ill-conditioned that round-off changes squares of "
            f"frequencies by {error:.0e} of their size, and psi by about ten times as much, in "
            "gradients and differences too, on any mesh. This happens in bodies hundreds of times "
            "longer than high, and in plane strain of nearly incompressible materials: give such "
            "a body by the volume integrals of a beam, or take a smaller Poisson's ratio",
            RoundOffWarning,
            stacklevel=4,
        )


def volume_integrals_pullback(
    reduction: CraigBampton,
    matrices: Matrices,
    basis: ReducedBasis,
    markers: Mapping[str, PointMarker],
    bar: VolumeIntegrals,
) -> ShapesBar:
    """The transpose of the derivative of `volume_integrals`."""
    elasticity = reduction.elasticity
    fields, unit = _fields(reduction, basis), reduction.unit_translations
    half = _moments_pullback(fields, bar)
    moment = unit @ bar.S.T
    w = np.hstack([fields, unit[:, :1]])
    y = np.hstack([half + moment, bar.mass * unit[:, :1]])
    kappa = basis.shapes @ symmetric(bar.K)
    fields_bar = elasticity.apply(matrices.mass, 2.0 * half + moment)
    shapes = fields_bar[:, 1:]
    shapes += 2.0 * elasticity.apply(matrices.stiffness, kappa)
    for name, marker in markers.items():
        marker_bar = bar.markers[name]
        shapes += marker.pullback(marker_bar.displacement, marker_bar.rotation)
    pairs = FieldPairs(w, y, basis.shapes, kappa)
    return ShapesBar(shapes, pairs=pairs, reference=fields_bar[:, 0])


def _moments_pullback(fields: Block, bar: VolumeIntegrals) -> Block:
    """The fields y with  d psi = sum_a m_dx(w_a, y_a)  by G and N, or by P, (dofs, fields)."""
    if bar.P is None:  # J^T = -J; N is antisymmetric, so both of its slots add up
        turned = rotated(fields @ (0.5 * (bar.N - bar.N.T)).T)
        return np.asarray(fields @ symmetric(bar.G) - turned)

    # the moment P_abkj of the components k of w_a and j of w_b is also P_bajk
    moments_bar = 0.5 * (bar.P + bar.P.transpose(1, 0, 3, 2))
    half = np.zeros_like(fields)
    for k, j in np.ndindex(3, 3):
        half[k::3] += fields[j::3] @ moments_bar[:, :, k, j].T
    return half


def _fields(reduction: CraigBampton, basis: ReducedBasis) -> Block:
    return np.column_stack([reduction.reference, basis.shapes])
