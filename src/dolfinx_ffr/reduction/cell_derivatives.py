# SPDX-License-Identifier: MIT
"""Derivatives of every single volume integral of a body by the density of every cell.

The pullback serves quantities that do not depend on the choice of shape functions. Single integrals
do: they follow the modes, of modal mass one each. Where frequencies are apart, with dK and dM the
derivatives of the matrices by one density, all interfaces clamped,

    constraint mode k:   dpsi_k = -K^-1 dK psi_k
    normal mode i:       dphi_i = -(K - lambda_i M)^+ F_i + sum_j c_ji phi_j
                         F_i = (dK - lambda_i dM) phi_i
                         c_ji = phi_j . F_i / (lambda_i - lambda_j),  c_ii = -1/2 phi_i . dM phi_i

with the pseudo-inverse on the complement of the retained modes. All integrals are products of the
shape functions with a few fields y, as the components of M w_b. So the systems are solved for
these, and not for each density: y . dphi_i has the part -F_i . (K - lambda_i M)^+ y.

References:
    R. B. Nelson, Simplified calculation of eigenvector derivatives, AIAA Journal 14 (1976),
    doi:10.2514/3.7211.
    A. Held, On design sensitivities in the structural analysis and optimization of flexible
    multibody systems, Multibody System Dynamics 54 (2022), doi:10.1007/s11044-021-09800-1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..body import VolumeIntegrals
from ..fem import Array, Block, CellFields
from .craig_bampton import CraigBampton, ReducedBasis
from .factored_body import FactoredBody
from .point_marker import PointMarker

#: Fields y whose systems are solved at once; with their Krylov space they take ten times the memory
TOGETHER = 8


@dataclass(frozen=True)
class ShapeSlopes:
    """How the shape functions of a body follow the density of each cell of this rank."""

    reduction: CraigBampton
    factored: FactoredBody
    basis: ReducedBasis
    mass_forces: CellFields  #: dM/dx_e times the body's translation along x, w_0, and the shapes
    stiffness_forces: CellFields  #: dK/dx_e times the shapes
    at_cells: CellFields  #: The shapes

    @staticmethod
    def of(reduction: CraigBampton, factored: FactoredBody, basis: ReducedBasis) -> ShapeSlopes:
        """Those of a body; RuntimeError where two frequencies are not apart."""
        reduction.check_apart(factored, basis)
        elasticity, fields = reduction.elasticity, [reduction.unit_translations[:, :1]]
        fields += [reduction.reference[:, None], basis.shapes]
        density = factored.matrices.density
        forces = elasticity.cell_derivatives(density, np.hstack(fields), basis.shapes)
        at_cells = elasticity.at_cells(basis.shapes)
        return ShapeSlopes(reduction, factored, basis, *forces, at_cells)

    def stiffness(self) -> Array:
        """Derivatives of the reduced stiffness, (cells, r, r): of a block and of eigenvalues."""
        k = self.basis.n_constraint
        found = np.einsum("cnia,cnib->cab", self.at_cells[..., :k], self.stiffness_forces[..., :k])
        found = np.pad(found, ((0, 0), *[(0, self.basis.shapes.shape[1] - k)] * 2))
        diagonal = np.arange(k, found.shape[1])
        found[:, diagonal, diagonal] = np.einsum("cii->ci", self._mixed)
        return found

    @property
    def _forces(self) -> CellFields:
        """F_i of all shapes, dK psi_k of constraint modes."""
        k, forces = self.basis.n_constraint, self.stiffness_forces.copy()
        forces[..., k:] -= self.basis.eigenvalues * self.mass_forces[..., 2 + k :]
        return forces

    @property
    def _mixed(self) -> Array:
        """phi_j . F_i of the normal modes, shape (cells, modes j, modes i)."""
        k = self.basis.n_constraint
        return np.einsum("cnaj,cnai->cji", self.at_cells[..., k:], self._forces[..., k:])

    def along(self, against: Block) -> Array:
        """Derivatives of y . w_a at fixed fields y, ``against`` (dofs, y): shape (cells, r, y)."""
        basis, k = self.basis, self.basis.n_constraint
        elasticity, factored, m = self.reduction.elasticity, self.factored, len(basis.eigenvalues)
        apart = basis.eigenvalues - basis.eigenvalues[:, None] + np.eye(m)
        shares = self._mixed / apart
        shares[:, np.arange(m), np.arange(m)] = -0.5 * np.einsum(
            "cnai,cnai->ci", self.at_cells[..., k:], self.mass_forces[..., 2 + k :]
        )
        cells, nodes, d, _ = self.at_cells.shape
        forces = self._forces.reshape(cells, nodes * d, k + m)
        found = np.zeros((cells, k + m, against.shape[1]))
        found[:, k:] = np.einsum("cji,jy->ciy", shares, elasticity.inner(basis.normal, against))
        interior = np.where(self.reduction.clamped[:, None], 0.0, against)
        for first in range(0, against.shape[1], TOGETHER):
            columns = slice(first, first + TOGETHER)
            right = interior[:, columns]
            solution = factored.solve(right)
            # alike in size, as the error of a solution is relative to the largest one
            sizes = np.sqrt(elasticity.sum(np.einsum("ny,ny->y", right, solution)))
            right = right / np.where(sizes > 0.0, sizes, 1.0)
            n = right.shape[1]
            local = elasticity.at_cells(solution).reshape(cells, nodes * d, n)
            found[:, :k, columns] = -forces[..., :k].swapaxes(1, 2) @ local
            shifts = np.repeat(basis.eigenvalues, n)
            adjoint, _ = self.reduction.solve_shifted(factored, basis, np.tile(right, m), shifts)
            local = elasticity.at_cells(adjoint).reshape(cells, nodes * d, m, n)
            found[:, k:, columns] -= sizes * np.einsum("cui,cuiy->ciy", forces[..., k:], local)
        return found


@dataclass(frozen=True)
class CellDerivatives:
    """Derivatives of integrals by the densities of this rank's cells, all of shape (cells, ...)."""

    mass: Array  #: (cells,)
    S: Array  #: (cells, r + 1, d)
    P: Array  #: (cells, r + 1, r + 1, d, d), in the plane too
    K: Array  #: (cells, r, r)
    markers: dict[str, tuple[Array, Array]]  #: Displacement and rotation of those in the body
    #: Geometric stiffness by load, and by marker
    stiffening: tuple[dict[str, Array], dict[str, Array]] = field(default_factory=lambda: ({}, {}))

    @staticmethod
    def of(
        slopes: ShapeSlopes, markers: Mapping[str, PointMarker], *, moments: bool
    ) -> CellDerivatives:
        """Those of a body; without ``moments``, the dear part, P_ab of two shapes are not right."""
        elasticity, shapes = slopes.reduction.elasticity, slopes.basis.shapes
        d, r = elasticity.dimension, shapes.shape[1]
        reference, unit = slopes.reduction.reference[:, None], slopes.reduction.unit_translations
        # components of M times 1, w_0, and the shapes, each at each component
        factors = np.hstack([unit[:, :1], reference, shapes if moments else shapes[:, :0]])
        images = elasticity.apply(slopes.factored.matrices.mass, factors)
        parts = images.reshape(-1, d, factors.shape[1]).swapaxes(1, 2)
        n = factors.shape[1] - 1
        scalars = np.hstack([parts[:, 0, :1], parts[:, 1:].reshape(len(parts), n * d)])
        fields = np.einsum("nb,ki->nikb", scalars, np.eye(d)).reshape(len(images), d + n * d * d)
        rows = [marker.rows.T.toarray() for marker in markers.values()]
        found = slopes.along(np.hstack([fields, *rows]))
        of_moments = found[..., : fields.shape[1]].reshape(len(found), r, d, 1 + n * d)
        of_markers = np.split(found[..., fields.shape[1] :], len(rows) or 1, axis=-1)

        direct = slopes.mass_forces
        whole = np.concatenate([elasticity.at_cells(reference), slopes.at_cells], axis=-1)
        S = direct[..., 1:].sum(axis=1).swapaxes(1, 2)
        S[:, 1:] += of_moments[..., 0]
        P = np.einsum("cnka,cnlb->cabkl", whole, direct[..., 1:], optimize=True)
        through = of_moments[..., 1:].reshape(len(found), r, d, n, d).transpose(0, 1, 3, 2, 4)
        P[:, 1:, :n] += through
        P[:, :n, 1:] += through.transpose(0, 2, 1, 4, 3)
        at = {}
        for name, part in zip(markers, of_markers, strict=False):
            turned = part[..., d:].swapaxes(1, 2)
            at[name] = part[..., :d].swapaxes(1, 2), turned[:, 0] if d == 2 else turned
        return CellDerivatives(direct[:, :, 0, 0].sum(axis=1), S, P, slopes.stiffness(), at)

    def of_cell(self, cell: int, integrals: VolumeIntegrals) -> VolumeIntegrals:
        """Those by one density, for the ``integrals`` of the body."""
        by_load, by_force = self.stiffening
        loads, at = {load: array[cell] for load, array in by_load.items()}, {}
        for name, point in integrals.markers.items():
            shapes = point.scaled(0.0)  # interfaces are rigid
            if name in self.markers:
                phi, psi = (part[cell] for part in self.markers[name])
                shapes = replace(shapes, displacement=phi, rotation=psi)
            bent = by_force[name][cell] if name in by_force else None
            at[name] = replace(shapes, stiffening=bent)
        mass, S, P, K = float(self.mass[cell]), self.S[cell], self.P[cell], self.K[cell]
        if integrals.dimension == 3:
            return VolumeIntegrals.in_space(mass, S, P, K, at, loads)
        G, N = np.einsum("abkk->ab", P), P[..., 0, 1] - P[..., 1, 0]
        return VolumeIntegrals(mass, S, G, N, K, at, loads)
