# SPDX-License-Identifier: MIT
"""Elastic displacement and rotation at points of a mesh, as rows on the nodal displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from mpi4py import MPI

import basix
import numpy as np
from scipy.sparse import csr_matrix

from .. import validation
from ..body import BodyMarker
from ..fem import Array, Block, Domain, Elasticity, ShapeError, _compat, summed

#: How far outside the reference cell a point may lie, to be found in spite of round-off
SLACK = 1e-8
#: Pairs of axes in whose planes the rotations are, by dimension
PLANES = {2: ((0, 1),), 3: ((1, 2), (2, 0), (0, 1))}


@dataclass(frozen=True)
class PointMarker:
    """Displacement and rotation of the body at a point, Phi_P and Psi_P of the paper's eq. (1).

    The rotation is half the curl of the displacement; both are means over the cells of the point.
    """

    position: Array  #: (dimension,) in the coordinates of the mesh [m]
    #: (3, dofs of this rank) u_x, u_y, rotation; in space (6, dofs of this rank) u_x, u_y, u_z and
    #: the rotations about the axes; each rank has its share of the sum
    rows: csr_matrix
    comm: MPI.Comm
    #: Cells of this rank that contain the point, with the point in the reference cell
    cells: tuple[tuple[int, Array], ...] = field(repr=False)
    count: int  #: Number of these cells on all ranks

    @staticmethod
    def at(domain: Domain, position: Sequence[float], name: str = "marker") -> PointMarker:
        """The marker at a point (dimension,) [m] of the mesh; ValueError outside."""
        d = domain.dimension
        expected = "two components" if d == 2 else "three components"
        argument = f"marker {name!r}: position"
        point = np.array(validation.real_array(argument, position, (d,), expected=expected))
        cells = _cells_at(domain, point)
        count = domain.comm.allreduce(len(cells))
        if count == 0:
            low, high = domain.bounding_box
            raise ShapeError(
                f"marker {name!r} at {tuple(point)} m lies outside the body, which spans "
                f"{tuple(np.round(low, 6))} to {tuple(np.round(high, 6))} m"
            )
        index_map, dofs = domain.space.dofmap.index_map, _compat.dofmap_array(domain.space)
        by_cell = []
        for cell, reference in cells:
            values, gradients, _ = _shape_functions(domain, cell, reference)
            weights = np.zeros((3 * d - 3, len(values), d))
            for i in range(d):
                weights[i, :, i] = values
            for row, (i, j) in enumerate(PLANES[d], start=d):
                weights[row, :, i] = -0.5 * gradients[j]
                weights[row, :, j] = 0.5 * gradients[i]
            nodes = np.asarray(index_map.local_to_global(dofs[cell].astype(np.int32)))
            by_cell.append((nodes, weights / count))

        first, end = index_map.local_range
        rows = np.zeros((3 * d - 3, end - first, d))
        for cells_of_rank in domain.comm.allgather(by_cell):
            for nodes, weights in cells_of_rank:
                mine = (first <= nodes) & (nodes < end)
                rows[:, nodes[mine] - first] += weights[:, mine]
        own_rows = csr_matrix(rows.reshape(len(rows), -1))
        return PointMarker(point, own_rows, domain.comm, tuple(cells), count)

    def motion(self, block: Block) -> tuple[Array, Array]:
        """Displacement (2, columns) and rotation (columns,) of a block, in space (3, columns)."""
        total, d = summed(self.comm, np.ascontiguousarray(self.rows @ block)), len(self.position)
        return total[:d], total[2] if d == 2 else total[d:]

    def pullback(self, displacement: Array, rotation: Array) -> Block:
        """The transpose of `motion`: the derivative with respect to the block."""
        return np.asarray(self.rows.T @ np.vstack([displacement, rotation]))

    def add_node_gradient(
        self, nodes: Array, elasticity: Elasticity, shapes: Block, bar: BodyMarker
    ) -> None:
        """Add the derivative by nodes at fixed ``shapes`` (dofs, r), from ``bar`` by the marker."""
        domain, d = elasticity.domain, elasticity.dimension
        # one displacement for each rotation: the shape functions weighted by its derivatives
        at_cells = elasticity.at_cells(shapes @ np.atleast_2d(bar.rotation).T)
        dofs, total = _compat.dofmap_array(elasticity.nodes.space), nodes.reshape(-1, d)
        for cell, reference in self.cells:
            _, gradients, (weights, slopes) = _shape_functions(domain, cell, reference)
            moved = weights[:, None] * bar.position
            for k, (i, j) in enumerate(PLANES[d]):
                # d(grad u) = -grad u grad V for a motion V of the nodes at fixed nodal values
                slope = np.einsum("an,nu->ua", gradients, at_cells[cell, :, :, k])
                moved -= 0.5 * (np.outer(slopes[i], slope[j]) - np.outer(slopes[j], slope[i]))
            total[dofs[cell]] += moved / self.count


def _cells_at(domain: Domain, point: Array) -> list[tuple[int, Array]]:
    """The cells of this rank that contain the point, with its reference coordinates."""
    nodes = _compat.cell_geometry(domain.mesh)[: domain.n_cells]
    x = domain.mesh.geometry.x[nodes][:, :, : domain.dimension]
    low, high = x.min(axis=1), x.max(axis=1)
    room = 0.1 * (high - low).max(axis=1, keepdims=True)
    is_near = np.all((point >= low - room) & (point <= high + room), axis=1)

    pull_back = _compat.coordinate_element(domain.mesh).pull_back
    largest = np.sum if domain.cell in ("triangle", "tetrahedron") else np.max
    cells = []
    for cell in np.flatnonzero(is_near).tolist():
        reference = pull_back(point[None, :], np.ascontiguousarray(x[cell]))[0]
        if reference.min() >= -SLACK and largest(reference) <= 1.0 + SLACK:
            cells.append((cell, reference))
    return cells


def _shape_functions(
    domain: Domain, cell: int, reference: Array
) -> tuple[Array, Array, tuple[Array, Array]]:
    """Shape functions (n,) and gradients (d, n) at a point of a cell, and those of the geometry.

    The first two are of displacements; the ``reference`` (d,) is the point in the reference cell.
    """
    kind = getattr(basix.CellType, domain.cell)
    gll = basix.LagrangeVariant.gll_warped
    displacement_element = basix.create_element(basix.ElementFamily.P, kind, domain.order, gll)
    geometry_element = _compat.geometry_element(domain.mesh)
    # values and derivatives in the reference cell, (1 + d, n) each
    geometry, displacements = (
        np.asarray(element.tabulate(1, reference[None, :])).reshape(1 + domain.dimension, -1)
        for element in (geometry_element, displacement_element)
    )

    nodes = _compat.cell_geometry(domain.mesh)[cell]
    x = domain.mesh.geometry.x[nodes][:, : domain.dimension]
    jacobian = x.T @ geometry[1:].T
    geometry_gradients = np.linalg.solve(jacobian.T, geometry[1:])
    displacement_gradients = np.linalg.solve(jacobian.T, displacements[1:])
    return displacements[0], displacement_gradients, (geometry[0], geometry_gradients)
