# SPDX-License-Identifier: MIT
"""Loads of a body's struts, and first-order predictions for new struts and holes."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Integers
from ..fem import Block, Elasticity, FieldPairs, Matrices
from .craig_bampton import ReducedBasis

#: Energy that a hole in a plate takes away, in energies of the material there: exact for Poisson's
#: ratio 1/3 (A. A. Novotny, J. Sokolowski, Topological Derivatives in Shape Optimization, 2013,
#: doi:10.1007/978-3-642-35245-4)
_HOLE = 3.0


class Struts:
    """The derivatives of psi by struts of a full body, and by holes in it.

    A strut that is not there yet is a bar between two nodes, and moves as these do: it strains
    along itself, and its mass moves linearly from end to end.

    Args:
        elasticity: Elasticity of the body.
        matrices: At full density.
        pairs: Fields by which psi changes.
        basis: The shape functions.
    """

    def __init__(
        self,
        elasticity: Elasticity,
        matrices: Matrices,
        pairs: FieldPairs,
        basis: ReducedBasis,
    ) -> None:
        self._elasticity, self._pairs = elasticity, pairs
        self._density = matrices.density
        self.domain = elasticity.domain  #: Of the body
        self._normal = basis.shapes[:, basis.n_constraint :] / np.sqrt(basis.eigenvalues)
        self._matrices = matrices

    @cached_property
    def carried(self) -> Array:
        """Decrease of psi by the stiffness of each cell of this rank, shape (cells,)."""
        pairs = FieldPairs.in_stiffness(self._pairs.phi, self._pairs.kappa)
        return -self._elasticity.density_gradient(self._density, pairs)

    @cached_property
    def removed(self) -> Array:
        """Predicted change of psi by each cell of this rank if it became part of a hole.

        Shape (cells,). For small round holes through a plate it is exact to first order, but for
        Poisson's ratio in `_HOLE`.
        """
        w, y, phi, kappa = self._pairs
        pairs = FieldPairs.in_mass(w, y)
        mass = self._elasticity.density_gradient(self._density, pairs)
        works = self._elasticity.apply(self._matrices.stiffness, kappa)
        total = float(np.sum(np.diag(self._elasticity.inner(phi, works))))
        # as if stiffness were proportional to density
        share = self.carried * (-total / self.domain.sum(self.carried))
        return _HOLE * share - mass

    def changes(self, points: Array, ends: Integers, width: float) -> Array:
        """Change of psi by each strut, the same on every rank, shape (struts,).

        For thin ones it is exact to first order. Wider ones take force from the modes, so their
        stiffness counts less (Sherman and Morrison).

        Args:
            points: The nearest nodes to these can be ends, shape (points, 2) [m].
            ends: Numbers of the two points of each strut, shape (struts, 2).
            width: Width of the struts [m].
        """
        nodes = self._elasticity.coordinates().reshape(-1, 1)
        fields = *self._pairs, self._normal, nodes
        w, y, phi, kappa, normal, x = _at_nodes(self._elasticity, points, fields)
        i, j = ends.T
        offset = x[j, :, 0] - x[i, :, 0]
        length = np.linalg.norm(offset, axis=1)
        along = offset / length[:, None]

        # a unit force along a strut, as the resultants xx, yy, xy
        stress = np.column_stack([along**2, along[:, :1] * along[:, 1:]])
        mass_by_area, compliance = _solid(self._elasticity, self._matrices)
        stiffness = width / length / np.einsum("si,ij,sj->s", stress, compliance, stress)
        phi_stretch, kappa_stretch, modal_stretch = (
            np.einsum("sd,sdk->sk", along, f[j] - f[i]) for f in (phi, kappa, normal)
        )
        stretches = np.einsum("sk,sk->s", phi_stretch, kappa_stretch)
        resistance = 1.0 + stiffness * np.sum(modal_stretch**2, axis=1)

        # the consistent mass matrix of a bar
        moved = np.zeros(len(ends))
        for weight, a, b in ((2.0, i, i), (1.0, i, j), (1.0, j, i), (2.0, j, j)):
            moved += weight / 6.0 * np.einsum("sdk,sdk->s", w[a], y[b])

        by_stiffness = stiffness / resistance * stretches
        by_mass = width * mass_by_area * length * moved
        return np.asarray(by_stiffness + by_mass)


def _at_nodes(
    elasticity: Elasticity, points: Array, blocks: tuple[Block, ...]
) -> tuple[Array, ...]:
    """The fields of each block at the nodes nearest to points, (points, 2, columns) each."""
    comm, coordinates = elasticity.comm, elasticity.coordinates()
    distance, node = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
    if len(coordinates):
        distance, node = cKDTree(coordinates).query(points)
    mine = np.argmin(comm.allgather(distance), axis=0) == comm.rank
    at_points = []
    for block in blocks:
        values = np.zeros((len(points), 2, block.shape[1]))
        values[mine] = block.reshape(-1, 2, block.shape[1])[node[mine]]
        at_points.append(elasticity.sum(values))
    return tuple(at_points)


def _solid(elasticity: Elasticity, matrices: Matrices) -> tuple[float, Array]:
    """Homogenised mass by area [kg/m^2] and compliance (3, 3) of the body's material [m/N].

    The compliance takes the resultants xx, yy, xy to strains. Both are as if material of density
    one filled the area.
    """
    x = elasticity.coordinates()
    zeros = np.zeros(len(x))
    strain_fields = [
        np.column_stack([x[:, 0], zeros]),
        np.column_stack([zeros, x[:, 1]]),
        np.column_stack([0.5 * x[:, 1], 0.5 * x[:, 0]]),
    ]
    unit_strains = np.column_stack([field.ravel() for field in strain_fields])
    unit_translation = np.column_stack([zeros + 1.0, zeros]).reshape(-1, 1)

    area = elasticity.domain.sum(matrices.density * elasticity.domain.cell_volumes)
    stiffness = elasticity.inner(unit_strains, elasticity.apply(matrices.stiffness, unit_strains))
    mass = elasticity.inner(unit_translation, elasticity.apply(matrices.mass, unit_translation))
    return float(mass[0, 0]) / area, np.linalg.inv(stiffness / area)
