# SPDX-License-Identifier: MIT
"""Stress of the solid at points of each cell: a linear map of the displacement, and its transpose.

Derivatives converge faster than elsewhere in the middle of cells of order 1, the 2 x 2 Gauss points
of quadrilaterals of order 2, or the three points of the rule of degree 2 in triangles. From order 2
on they are continued from there to the corners of each cell, as the largest stress is on the
boundary of a body (E. Hinton, J. S. Campbell, International Journal for Numerical Methods in
Engineering 8 (1974), doi:10.1002/nme.1620080303).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import product

import basix
import numpy as np
import ufl
from dolfinx import fem

from ..arrays import Array
from . import _compat
from .domain import quadrature
from .elasticity import Block, Elasticity
from .material import ElasticMaterial

#: Components of the stress by dimension
COMPONENTS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}
#: How many numbers the maps or the stresses of a chunk of cells may have
_BLOCK = 16_000_000


class StressRecovery:
    """The solid's stress from a body's displacements at any density, and its exact transpose."""

    def __init__(self, elasticity: Elasticity, material: ElasticMaterial) -> None:
        domain, d = elasticity.domain, elasticity.dimension
        self.elasticity = elasticity
        simplex = domain.cell in ("triangle", "tetrahedron")
        degree = self._degree = max(1, 2 * domain.order - (2 if simplex else 1))
        self._material = material
        #: Where the stress is given, undeformed, shape (cells, points, dimension) [m]; area that
        #: each point stands for, in space volume, shape (cells, points) [m^2], [m^3]
        self._rule, self.points, self.weights = quadrature(domain, degree)
        reference = self._rule[0]
        #: Values at the points from those at the points of the rule, and the shares of their sizes
        self._continued = self._shares = np.eye(len(reference))
        if domain.order > 1:
            corners = basix.geometry(getattr(basix.CellType, domain.cell))
            self._continued = _continuation(reference, corners, domain.order - 1, simplex)
            self._shares = np.full(self._continued.shape, 1.0 / len(corners))
            vertices = _compat.cell_geometry(domain.mesh)[: domain.n_cells, : len(corners)]
            self.points = domain.mesh.geometry.x[vertices][:, :, :d]
            self.weights = self.weights @ self._shares.T
        # as cells share no dofs, all have the same displacement at once
        displacement = fem.Function(elasticity.cell_space)
        stress = material.on(domain.mesh).stress(displacement)
        evaluate = _compat.compiled_expression(
            ufl.as_vector([stress[i, j] for i, j in COMPONENTS[d]]), reference, domain.mesh
        )
        self._evaluate, self._displacement = evaluate, displacement
        unknowns = d * elasticity.cell_space.dofmap.dof_layout.num_dofs
        #: Of the map of each cell: points * components, dofs
        self._shape = len(COMPONENTS[d]) * len(self._continued), unknowns

    @cached_property
    def _matrices(self) -> Array:
        """Map of each cell, shape (cells, points * components, dofs) [Pa/m]."""
        return self._maps(slice(0, len(self.points)))

    def _maps(self, chunk: slice) -> Array:
        """The maps of some cells of this rank, (cells of the chunk, points * components, dofs)."""
        cells = np.arange(chunk.start, chunk.stop, dtype=np.int32)
        maps = np.empty((len(cells), *self._shape))
        for i, values in enumerate(np.eye(self._shape[1])):
            self.elasticity.set_cells(self._displacement, values, chunk)
            sampled = self._evaluate(cells)
            maps[..., i] = (self._continued @ sampled).reshape(len(cells), -1)
        maps /= self._material.thickness
        return maps

    def __call__(self, fields: Block) -> Array:
        """Stresses (cells, points, components, columns) of displacements (dofs, columns) [Pa]."""
        shape = (*self.points.shape[:2], len(COMPONENTS[self.elasticity.dimension]))
        stresses = np.empty((*shape, fields.shape[1]))
        for chunk, values in self.in_blocks(fields):
            stresses[chunk] = values
        return stresses

    def in_blocks(self, fields: Block) -> Iterator[tuple[slice, Array]]:
        """Stresses of displacements (dofs, columns), of some cells of this rank at a time.

        Those of all cells at once may take gigabytes.

        Yields:
            A slice of the cells, and their stresses (cells in it, points, components, columns)
            [Pa].
        """
        cells, (rows, unknowns) = len(self.points), self._shape
        d, columns = self.elasticity.dimension, fields.shape[1]
        at_nodes = self.elasticity.with_ghosts(fields).reshape(-1, d, columns)
        del fields
        nodes_of_cells = _compat.dofmap_array(self.elasticity.domain.space)

        # maps of all cells are stored if they are few, or exist already, as for a gradient
        stores_maps = "_matrices" in vars(self) or cells * rows * unknowns <= 2 * _BLOCK
        cells_of_chunk = max(1, _BLOCK // (rows * max(columns, unknowns)))
        for begin in range(0, cells, cells_of_chunk):
            chunk = slice(begin, min(begin + cells_of_chunk, cells))
            maps = self._matrices[chunk] if stores_maps else self._maps(chunk)
            displacements = at_nodes[nodes_of_cells[chunk]].reshape(-1, unknowns, columns)
            stresses = maps @ displacements
            yield chunk, stresses.reshape(len(stresses), -1, len(COMPONENTS[d]), columns)

    def transposed(self, bar: Array) -> Block:
        """The transpose: from ``bar`` (cells, points, components, columns) to (dofs, columns)."""
        cells, (rows, _) = len(self.points), self._shape
        local = np.swapaxes(self._matrices, 1, 2) @ bar.reshape(cells, rows, bar.shape[3])
        return self.elasticity.from_cells(np.arange(cells), np.moveaxis(local, 2, 0))

    @property
    def _metadata(self) -> dict[str, object]:
        return {"quadrature_degree": self._degree, "quadrature_rule": "default"}

    @cached_property
    def _node_form(self) -> tuple[fem.Form, fem.Function, list[fem.Function]]:
        """Derivative of sums of stresses at chosen points, each component by its own field.

        With it the factors of the points in the sum, and the field of each component.
        """
        domain, d = self.elasticity.domain, self.elasticity.dimension
        chosen = fem.Function(_compat.quadrature_space(domain.mesh, self._degree))
        fields = [fem.Function(self.elasticity.cell_space) for _ in COMPONENTS[d]]
        law = self._material.on(domain.mesh)
        components = [law.stress(u)[k] for u, k in zip(fields, COMPONENTS[d], strict=True)]

        # the measure's own share is divided out: a sum over points, not an integral
        size = abs(ufl.JacobianDeterminant(domain.mesh)) * self._material.thickness
        dx = ufl.Measure("dx", domain=domain.mesh, metadata=self._metadata)
        form = self.elasticity.nodes.form(chosen * sum(components) / size * dx)
        return form, chosen, fields

    @cached_property
    def _weights_form(self) -> tuple[fem.Form, fem.Function]:
        """Derivative of the sum over all points of a factor times its weight, and the factor."""
        domain = self.elasticity.domain
        factor = fem.Function(_compat.quadrature_space(domain.mesh, self._degree))
        dx = ufl.Measure("dx", domain=domain.mesh, metadata=self._metadata)
        return self.elasticity.nodes.form(factor * dx), factor

    def add_node_gradient(self, nodes: Array, fields: Block, bar: Array) -> None:
        """Add to ``nodes`` the derivative of sum ``bar`` . stress of ``fields`` (dofs, columns)."""
        form, chosen, component_fields = self._node_form
        bar = np.einsum("vq,cvkj->cqkj", self._continued, bar)
        cells, points, components, columns = bar.shape
        # of each number, the sum of all fields times its derivatives
        local = self.elasticity.at_cells(fields).reshape(cells, -1, columns).swapaxes(1, 2)
        sums = bar.reshape(cells, points * components, columns) @ local
        sums = sums.reshape(cells, points, components, local.shape[2])
        chosen_values = chosen.x.array.reshape(-1, points)
        for point, weight in enumerate(self._rule[1]):
            chosen_values[:] = 0.0
            chosen_values[:, point] = 1.0 / weight
            for component, field in enumerate(component_fields):
                self.elasticity.set_cells(field, sums[:, point, component])
            fem.assemble_vector(nodes, form)

    def add_weights_gradient(self, nodes: Array, bar: Array) -> None:
        """Add the derivative of sum bar . weights to a sum of `MeshNodes`, bar (cells, points)."""
        form, factor = self._weights_form
        factor.x.array.reshape(-1, len(self._rule[1]))[: len(bar)] = bar @ self._shares
        factor.x.scatter_forward()
        fem.assemble_vector(nodes, form)


def _continuation(sampled: Array, evaluated: Array, degree: int, simplex: bool) -> Array:
    """The matrix from values at ``sampled`` points to those of a polynomial at ``evaluated`` ones.

    Its shape is (evaluated, sampled).
    """
    powers = list(product(range(degree + 1), repeat=sampled.shape[1]))
    if simplex:
        powers = [exponents for exponents in powers if sum(exponents) <= degree]
    at_sampled, at_evaluated = (
        np.prod(points[:, None, :] ** np.array(powers), axis=2) for points in (sampled, evaluated)
    )
    return np.asarray(at_evaluated @ np.linalg.pinv(at_sampled))
