# SPDX-License-Identifier: MIT
"""Meshes as arrays on rank 0, with names of facets and regions, and how ranks share them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from dolfinx import mesh
from numpy.typing import NDArray

from ..arrays import Array, Integers, Mask
from . import _compat
from .mesh_checks import vertex_nodes

#: Steps in which coordinates are distinguished, over the size of a body, and factors by which three
#: of their numbers make one of 64 bits
_STEPS, _KEY = 2**20, np.array([2**42, 2**21, 1])
#: Facets, or cells, of this rank by name
Numbers = dict[str, NDArray[np.int32]]


@dataclass(frozen=True, eq=False)
class MeshArrays:
    """Cells of one kind, and facets and regions by name, on rank 0."""

    cell: str  #: Kind of the cells, as "triangle"
    order: int  #: Polynomial order of their map from the reference cell
    points: Array  #: (points, dimension) [m]
    cells: Integers  #: (cells, nodes per cell) numbers of points, in the order of DOLFINx
    facets: Mapping[str, Integers]  #: (facets, corners) numbers of the points at their corners
    regions: Mapping[str, Mask]  #: (cells,) whether each cell belongs to a region


def distribute(comm: MPI.Comm, arrays: MeshArrays | None) -> tuple[mesh.Mesh, Numbers, Numbers]:
    """The mesh over all ranks of ``arrays``, None but on rank 0, and its named facets and regions.

    Facets are those of this rank, ghosts included, cells those that it owns.
    """
    points, cells, head = np.zeros((0, 0)), np.zeros((0, 0), dtype=np.int64), None
    if arrays is not None:
        points, cells = arrays.points, arrays.cells
        widths = points.shape[1], cells.shape[1]
        head = arrays.cell, arrays.order, widths, arrays.facets, arrays.regions
    cell, order, (dim, width), facets, regions = comm.bcast(head)
    points, cells = points.reshape(-1, dim), cells.reshape(-1, width)
    domain = _compat.create_mesh(comm, cells, points, cell, order)

    number = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    node_of_vertex = vertex_nodes(domain)
    corners = number[node_of_vertex[_compat.entity_vertices(domain, dim - 1)]]
    n_cells = domain.topology.index_map(dim).size_local
    original_cells = np.asarray(domain.topology.original_cell_index)[:n_cells]
    return (
        domain,
        {name: _rows_among(corners, of_name) for name, of_name in facets.items()},
        {
            name: np.flatnonzero(of_name[original_cells]).astype(np.int32)
            for name, of_name in regions.items()
        },
    )


def _rows_among(rows: Integers, chosen: Integers) -> NDArray[np.int32]:
    """The places of rows that hold the same numbers, in any order, as one of the ``chosen``."""
    rows, chosen = np.sort(rows, axis=1), np.sort(chosen, axis=1)
    candidates = np.flatnonzero(np.isin(rows[:, 0], chosen[:, 0]))
    candidates_and_chosen = np.vstack([rows[candidates], chosen])
    number = np.unique(candidates_and_chosen, axis=0, return_inverse=True)[1].ravel()
    number_of_candidate, number_of_chosen = np.split(number, [len(candidates)])
    matches = np.isin(number_of_candidate, number_of_chosen)
    return candidates[matches].astype(np.int32)


def numbered(points: Array) -> tuple[Integers, Integers]:
    """Places of different points among points (n, 3), and the number of each given point."""
    if not len(points):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    low = points.min(axis=0)
    step = float(np.max(np.ptp(points, axis=0))) / _STEPS
    # off the round numbers: one and the same point would be rounded to either side of a half
    rounded = np.floor((points - low) / step + 0.3127).astype(np.int64)
    _, first, number = np.unique(rounded @ _KEY, return_index=True, return_inverse=True)
    return first, number
