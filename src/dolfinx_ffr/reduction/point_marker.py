# SPDX-License-Identifier: MIT
"""Elastic displacement and rotation at points of a mesh, as rows on the nodal displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import basix
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from .. import validation
from ..fem import Block, Domain, _compat

__all__ = ["PointMarker"]

#: How far outside the reference cell a point may lie, to be found in spite of round-off
SLACK = 1e-8


@dataclass(frozen=True)
class PointMarker:
    """Displacement and rotation of the body at a point, Phi_P and Psi_P of the paper's eq. (1).

    The rotation is that of the deformation gradient, half the curl of the displacement. Where the
    point belongs to several cells, both are means over these cells.
    """

    position: NDArray[np.float64]  #: (dimension,) in the coordinates of the mesh [m]
    #: (3, dofs of this rank) u_x, u_y, rotation, in space (6, dofs of this rank) u_x, u_y, u_z and
    #: the rotations about the axes; sums over ranks
    rows: csr_matrix
    comm: MPI.Comm

    @staticmethod
    def at(domain: Domain, position: Sequence[float], name: str = "marker") -> PointMarker:
        """Find the point in the mesh.

        Args:
            domain: The body.
            position: In the coordinates of the mesh, shape (dimension,) [m].
            name: What error messages call the marker.

        Raises:
            ValueError: On every rank, if the point lies outside the body.
        """
        d = domain.dimension
        expected = "two components" if d == 2 else "three components"
        what = f"marker {name!r}: position"
        point = np.array(validation.real_array(what, position, (d,), expected=expected))
        index_map = domain.space.dofmap.index_map
        n_owned, n_local = index_map.size_local, index_map.size_local + index_map.num_ghosts
        dofs = _compat.dofmap_array(domain.space)
        found = _cells_at(domain, point)
        count = domain.comm.allreduce(len(found))
        if count == 0:
            low, high = domain.bounding_box
            raise ValueError(
                f"marker {name!r} at {tuple(point)} m lies outside the body, which spans "
                f"{tuple(np.round(low, 6))} to {tuple(np.round(high, 6))} m"
            )
        local = np.zeros((3 * d - 3, d * n_local))
        # pairs of axes about whose plane the rotations are
        planes = [(0, 1)] if d == 2 else [(1, 2), (2, 0), (0, 1)]
        for cell, reference in found:
            values, gradients = _shape_functions(domain, cell, reference)
            of = d * dofs[cell]
            for i in range(d):
                local[i, of + i] += values / count
            for row, (i, j) in enumerate(planes, start=d):
                local[row, of + i] -= 0.5 * gradients[j] / count
                local[row, of + j] += 0.5 * gradients[i] / count
        # rows on ghost nodes belong to their owners
        columns = np.arange(n_local, dtype=np.int32)
        global_nodes = np.asarray(index_map.local_to_global(columns))
        ghost = local[:, d * n_owned :].reshape(len(local), -1, d)
        sent = [part for part in domain.comm.allgather((global_nodes[n_owned:], ghost))]
        first = int(index_map.local_range[0])
        for nodes, weights in sent:
            mine = (nodes >= first) & (nodes < first + n_owned)
            for component in range(d):
                # a rank sends each of its ghosts once
                local[:, d * (nodes[mine] - first) + component] += weights[:, mine, component]
        return PointMarker(point, csr_matrix(local[:, : d * n_owned]), domain.comm)

    def motion(self, block: Block) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Displacement (2, columns) and rotation (columns,) of each field of a block.

        In space both have the shape (3, columns).
        """
        local = np.ascontiguousarray(self.rows @ block)
        total = np.empty_like(local)
        self.comm.Reduce(local, total, root=0)
        self.comm.Bcast(total, root=0)
        d = len(self.position)
        return total[:d], total[2] if d == 2 else total[d:]

    def pullback(self, displacement: NDArray[np.float64], rotation: NDArray[np.float64]) -> Block:
        """The transpose of `motion`: the derivative with respect to the block."""
        return np.asarray(self.rows.T @ np.vstack([displacement, rotation]))


def _cells_at(domain: Domain, point: NDArray[np.float64]) -> list[tuple[int, NDArray[np.float64]]]:
    """The cells of this rank that contain the point, with its reference coordinates."""
    nodes = _compat.cell_geometry(domain.mesh)[: domain.n_cells]
    x = domain.mesh.geometry.x[nodes][:, :, : domain.dimension]
    low, high = x.min(axis=1), x.max(axis=1)
    size = (high - low).max(axis=1, keepdims=True)
    near = np.all((point >= low - 0.1 * size) & (point <= high + 0.1 * size), axis=1)
    element = _compat.coordinate_element(domain.mesh)
    found = []
    for cell in np.flatnonzero(near):
        reference = element.pull_back(point[None, :], np.ascontiguousarray(x[cell]))[0]
        inside = np.all(reference >= -SLACK)
        if domain.cell in ("triangle", "tetrahedron"):
            inside = inside and reference.sum() <= 1.0 + SLACK
        else:
            inside = inside and np.all(reference <= 1.0 + SLACK)
        if inside:
            found.append((int(cell), np.asarray(reference)))
    return found


def _shape_functions(
    domain: Domain, cell: int, reference: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values (n,) and physical gradients (dimension, n) of a cell's scalar shape functions."""
    kind = getattr(basix.CellType, _compat.cell_name(domain.mesh))

    def tabulate(degree: int) -> NDArray[np.float64]:
        element = basix.create_element(
            basix.ElementFamily.P, kind, degree, basix.LagrangeVariant.gll_warped
        )
        return np.asarray(element.tabulate(1, reference[None, :])).reshape(1 + domain.dimension, -1)

    geometry = tabulate(_compat.coordinate_element(domain.mesh).degree)
    x = domain.mesh.geometry.x[_compat.cell_geometry(domain.mesh)[cell]][:, : domain.dimension]
    jacobian = x.T @ geometry[1:].T
    table = tabulate(domain.order)
    return table[0], np.linalg.solve(jacobian.T, table[1:])
