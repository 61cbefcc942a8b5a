# SPDX-License-Identifier: MIT
"""Stress of the solid at points of each cell: a linear map of the displacement, and its transpose.

The points are those in which derivatives converge faster than elsewhere: the middle of cells of
order 1, the 2 x 2 Gauss points of quadrilaterals of order 2, the three points of the rule of degree
2 in triangles of order 2, and so on.
"""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

import basix
import numpy as np
import ufl
from dolfinx import fem
from numpy.typing import NDArray

from . import _compat
from .elasticity import Block, Elasticity
from .material import ElasticMaterial

__all__ = ["StressRecovery"]

Array = NDArray[np.float64]

#: Components of the stress by dimension
COMPONENTS = {
    2: ((0, 0), (1, 1), (0, 1)),
    3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)),
}


class StressRecovery:
    """From displacements of a body to the stress of its solid, and back by the exact transpose.

    It does not depend on the density, and holds a matrix of (3 points) x (2 nodes) for each cell,
    in space of (6 points) x (3 nodes).

    Args:
        elasticity: Of the body.
        material: The solid.
    """

    def __init__(self, elasticity: Elasticity, material: ElasticMaterial) -> None:
        domain = elasticity.domain
        self.elasticity = elasticity
        kind = getattr(basix.CellType, _compat.cell_name(domain.mesh))
        simplex = kind in (basix.CellType.triangle, basix.CellType.tetrahedron)
        degree = max(1, 2 * domain.order - (2 if simplex else 1))
        reference, weights = (np.asarray(a) for a in basix.make_quadrature(kind, degree))
        cells = np.arange(domain.n_cells, dtype=np.int32)

        def at_points(expression: Any) -> Array:
            return _compat.evaluate_expression(expression, reference, domain.mesh, cells)

        #: Where the stress is given, undeformed, shape (cells, points, dimension) [m]
        self.points = at_points(ufl.SpatialCoordinate(domain.mesh))
        jacobian = np.abs(at_points(ufl.JacobianDeterminant(domain.mesh))[:, :, 0])
        #: Area that each point stands for, in space volume, shape (cells, points) [m^2], [m^3]
        self.weights = weights * jacobian
        self._matrices = self._cell_matrices(material, reference, cells)

    def _cell_matrices(
        self, material: ElasticMaterial, reference: Array, cells: NDArray[np.int32]
    ) -> Array:
        """The map of each cell, shape (cells, points * components, dofs) [Pa/m]."""
        domain, d = self.elasticity.domain, self.elasticity.dimension
        # in a space whose cells share no nodes, all cells have the same displacement at once
        space = _compat.function_space(domain.mesh, "DG", domain.order, (d,))
        displacement = fem.Function(space)
        stress = material.on(domain.mesh).stress(displacement)
        evaluate = _compat.compiled_expression(
            ufl.as_vector([stress[i, j] for i, j in COMPONENTS[d]]), reference, domain.mesh
        )
        nodes = _compat.dofmap_array(space)
        rows = len(COMPONENTS[d]) * len(reference)
        found = np.empty((len(cells), rows, d * nodes.shape[1]))
        for i in range(found.shape[2]):
            displacement.x.array[:] = 0.0
            displacement.x.array[d * nodes[:, i // d] + i % d] = 1.0
            found[..., i] = evaluate(cells).reshape(len(cells), -1)
        return found / material.thickness

    def __call__(self, fields: Block) -> Array:
        """Stresses s_x, s_y, t_xy of displacements; in space s_x, s_y, s_z, t_xy, t_yz, t_xz.

        Args:
            fields: Displacements of this rank's dofs, shape (dofs, columns) [m].

        Returns:
            Of the cells owned by this rank, shape (cells, points, components, columns) [Pa].
        """
        cells, _, unknowns = self._matrices.shape
        local = self.elasticity.at_cells(fields).reshape(cells, unknowns, fields.shape[1])
        return (self._matrices @ local).reshape(
            cells, -1, len(COMPONENTS[self.elasticity.dimension]), fields.shape[1]
        )

    def transposed(self, bar: Array) -> Block:
        """The transpose: from derivatives with respect to stresses to those to displacements.

        Args:
            bar: Of the cells owned by this rank, shape (cells, points, components, columns).

        Returns:
            Of the dofs owned by this rank, shape (dofs, columns).
        """
        space, n = self.elasticity.domain.space, self.elasticity.n_dofs
        cells, rows, _ = self._matrices.shape
        columns = bar.shape[3]
        local = np.swapaxes(self._matrices, 1, 2) @ bar.reshape(cells, rows, columns)
        nodes = _compat.dofmap_array(space)[:cells]
        d = self.elasticity.dimension
        dofs = np.stack([d * nodes + i for i in range(d)], axis=2).ravel()
        gathered = fem.Function(space)
        total = np.empty((n, columns))
        for j in range(columns):
            array = gathered.x.array
            array[:] = np.bincount(dofs, local[..., j].ravel(), minlength=len(array))
            _compat.petsc_vector(gathered).ghostUpdate(
                addv=PETSc.InsertMode.ADD_VALUES, mode=PETSc.ScatterMode.REVERSE
            )
            total[:, j] = array[:n]
        return total
