# SPDX-License-Identifier: MIT
"""Derivatives with respect to the positions of a mesh's nodes.

A number that is a sum of integrals over the cells changes with the nodes of the mesh at fixed nodal
values of all fields. UFL derives each integral by the spatial coordinate; what is left are fields
whose nodal values are positions themselves, and the transposed interpolation takes them to nodes.

References:
    D. A. Ham, L. Mitchell, A. Paganini, F. Wechsung, Automated shape differentiation in the Unified
    Form Language, Structural and Multidisciplinary Optimization 60 (2019),
    doi:10.1007/s00158-019-02281-z.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, mesh
from scipy.sparse import csr_matrix

from ..arrays import Array, Integers, Mask
from . import _compat


class MeshNodes:
    """The nodes of a mesh, by its space of displacements, and sums of derivatives by positions."""

    def __init__(self, displacements: Any) -> None:
        self.mesh: mesh.Mesh = displacements.mesh
        #: The Lagrange space to which the positions of the mesh belong
        self.space = _compat.coordinate_space(self.mesh)
        self.dimension = int(self.mesh.geometry.dim)
        self._displacements = displacements
        self._collector = fem.Function(self.space)
        #: Node of `space` for each node of the mesh's geometry on this rank, ghosts included
        self._numbers = np.zeros(len(self.mesh.geometry.x), dtype=np.int32)
        self._numbers[_compat.cell_geometry(self.mesh)] = _compat.dofmap_array(self.space)

    def form(self, integral: ufl.Form) -> fem.Form:
        """The compiled derivative of an ``integral`` with respect to the nodes."""
        motion = ufl.TestFunction(self.space)
        return fem.form(ufl.derivative(integral, ufl.SpatialCoordinate(self.mesh), motion))

    def zeros(self) -> Array:
        """A sum to which this rank's cells add, shape (dofs of `space`, ghosts included)."""
        return np.zeros_like(self._collector.x.array)

    @cached_property
    def interpolation(self) -> csr_matrix:
        """From nodes of `space` to the displacements' nodes of this rank, (own nodes, nodes)."""
        space = self._displacements
        count = space.dofmap.index_map.size_local
        points = np.asarray(_compat.interpolation_points(space))
        table = _compat.geometry_element(self.mesh).tabulate(0, points)
        weights = np.asarray(table).reshape(len(points), -1)  # (points, nodes of `space` in a cell)

        # one cell of each own node, and the node's number there: all its cells give it the same
        # position
        nodes = _compat.dofmap_array(space)
        cell_of_node = np.zeros(count, dtype=np.int64)
        number_in_cell = np.zeros(count, dtype=np.int64)
        for i in range(nodes.shape[1]):
            cells = np.flatnonzero(nodes[:, i] < count)
            cell_of_node[nodes[cells, i]] = cells
            number_in_cell[nodes[cells, i]] = i

        columns = _compat.dofmap_array(self.space)[cell_of_node]
        rows = np.repeat(np.arange(count), columns.shape[1])
        shape = (count, len(self._collector.x.array) // self.dimension)
        return csr_matrix((weights[number_in_cell].ravel(), (rows, columns.ravel())), shape=shape)

    def add_positions(self, total: Array, bar: Array) -> None:
        """Add ``bar`` (dofs of this rank,), by the positions of the displacements' nodes."""
        moved = self.interpolation.T @ bar.reshape(-1, self.dimension)
        total += np.asarray(moved).ravel()

    def collected(self, total: Array) -> Array:
        """The ``total`` over all ranks for each row of ``mesh.geometry.x``, (nodes, dimension)."""
        function = self._collector
        function.x.array[:] = total
        add_ghosts(function)
        function.x.scatter_forward()
        return np.array(function.x.array.reshape(-1, self.dimension)[self._numbers])

    def inner(self, a: Array, b: Array) -> float:
        """The sum over all nodes of a . b, each (nodes of this rank, dimension)."""
        count = int(self.space.dofmap.index_map.size_local)
        owned = self._numbers < count
        comm: MPI.Comm = self.mesh.comm
        return float(comm.allreduce(float(np.sum(a[owned] * b[owned])), MPI.SUM))


def add_ghosts(function: fem.Function) -> None:
    """Add the values of ghosts to the values of their owners."""
    add, reverse = PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE
    _compat.petsc_vector(function).ghostUpdate(addv=add, mode=reverse)


def gathered_nodes(
    domain: Any,
) -> tuple[Array, Integers, tuple[Integers, Mask]]:
    """All nodes (nodes, dimension) and cells (cells, nodes per cell) of a mesh, on rank 0 alone.

    The last pair has the number there of each node of this rank, and whether this rank owns it.
    """
    geometry, comm = domain.mesh.geometry, domain.mesh.comm
    index_map = geometry.index_map()
    count = int(index_map.size_local)
    local = np.arange(len(geometry.x), dtype=np.int32)
    numbers = np.asarray(index_map.local_to_global(local), dtype=np.int64)
    cells = numbers[_compat.cell_geometry(domain.mesh)[: domain.n_cells]]
    x = geometry.x[:count, : geometry.dim]
    gathered = comm.gather((x, cells))
    of_ranks = [(x[:0], cells[:0])] if gathered is None else gathered
    nodes, all_cells = (np.concatenate(arrays) for arrays in zip(*of_ranks, strict=True))
    return nodes, all_cells, (numbers, local < count)


def laplace(x: Array, simplices: Integers) -> csr_matrix:
    """The matrix of Laplace's equation on straight simplices, shape (nodes, nodes).

    Each of the ``simplices`` (elements, vertices) is a triangle or a tetrahedron, by the numbers of
    its vertices among the nodes ``x`` (nodes, dimension). The triangles may be those of a surface
    in space.
    """
    vertices = simplices.shape[1]
    edges = x[simplices[:, 1:]] - x[simplices[:, :1]]
    gram = np.einsum("eid,ejd->eij", edges, edges)
    sizes = np.sqrt(np.linalg.det(gram)) / math.factorial(vertices - 1)

    # derivatives of the barycentric coordinates by coordinates along the edges from vertex 0: the
    # products of the gradients need the inverse of the Gram matrix only, also on a surface
    slopes = np.vstack([-np.ones(vertices - 1), np.eye(vertices - 1)])
    local = sizes[:, None, None] * (slopes @ np.linalg.inv(gram) @ slopes.T)

    rows = np.repeat(simplices, vertices, axis=1).ravel()
    columns = np.tile(simplices, (1, vertices)).ravel()
    return csr_matrix((local.ravel(), (rows, columns)), shape=(len(x), len(x)))
