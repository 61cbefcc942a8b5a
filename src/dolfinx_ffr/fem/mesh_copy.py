# SPDX-License-Identifier: MIT
"""A mesh as arrays, from which the same mesh is made in another process."""

from __future__ import annotations

import pickle
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from dolfinx import mesh
from numpy.typing import NDArray

from ..arrays import Array, Integers
from . import _compat
from .form_cache import claim_form_cache


@dataclass(frozen=True, eq=False)
class MeshCopy:
    """A serial mesh in input numbering, with the permutation that DOLFINx applied to it."""

    cells: Integers  #: (cells, nodes per cell) in input numbering
    points: Array  #: (nodes, dimension) in input numbering [m]
    cell: str  #: Name of the cells, "triangle" and so on
    degree: int  #: Of the geometry
    order: Integers  #: (cells,) input number of each cell of DOLFINx
    corners: NDArray[np.int32]  #: (cells, vertices per cell) of the cells of DOLFINx

    @staticmethod
    def of(domain: mesh.Mesh) -> MeshCopy:
        """The arrays of a mesh, which must be on one rank."""
        if domain.comm.size > 1:
            raise pickle.PicklingError(
                f"a Domain on {domain.comm.size} ranks cannot be pickled, as each rank holds a "
                "part of its mesh; make it on MPI.COMM_SELF to hand it to other processes, or "
                "pickle the densities and the history of a Result alone"
            )
        order = np.asarray(domain.topology.original_cell_index, dtype=np.int64)
        number = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
        nodes = number[_compat.cell_geometry(domain)]
        cells = np.empty_like(nodes)
        cells[order] = nodes
        dim = domain.topology.dim
        points = np.zeros((int(number.max(initial=-1)) + 1, dim))
        points[number] = domain.geometry.x[:, :dim]
        degree = int(_compat.coordinate_element(domain).degree)
        corners = np.array(_compat.entity_vertices(domain, dim))
        return MeshCopy(cells, points, _compat.cell_name(domain), degree, order, corners)

    def build(self) -> mesh.Mesh:
        """The mesh, with the same numbers of cells and vertices, on this process alone."""
        comm = MPI.COMM_SELF
        claim_form_cache(comm)
        domain = _compat.create_mesh(comm, self.cells, self.points, self.cell, self.degree)
        dim = domain.topology.dim
        same = np.array_equal(domain.topology.original_cell_index, self.order)
        if not (same and np.array_equal(_compat.entity_vertices(domain, dim), self.corners)):
            raise RuntimeError(
                "mesh: this release of DOLFINx numbers cells otherwise than that which has pickled "
                "the mesh; make the Domain anew, as it was made there"
            )
        return domain
