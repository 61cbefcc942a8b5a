# SPDX-License-Identifier: MIT
"""The mesh of a body in space on rank 0, as a grid of PyVista."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Integers, Mask
from ..parallel import announce
from . import _compat
from .domain import Domain

if TYPE_CHECKING:
    import pyvista


#: Corners of a cell of DOLFINx in the order of VTK
CORNERS = {"tetrahedron": [0, 1, 2, 3], "hexahedron": [0, 1, 3, 2, 4, 5, 7, 6]}
#: Distance of points that are one, relative to the size of the body
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class GatheredMesh:
    """Points and straight-sided cells, as the mesh was made, on rank 0; methods are collective."""

    points: Array  #: (points, 3) undeformed [m]
    cells: Integers  #: (cells, 4 or 8) points of each cell, in the order of VTK
    interfaces: dict[str, Mask]  #: (points,) points of each interface
    domain: Domain  #: The body
    _first: Integers  #: (points,) one of the corners of the ordered cells for each point

    @staticmethod
    def of(domain: Domain) -> GatheredMesh:
        """Gather the mesh of a body."""
        announce(domain.comm, "gathering a mesh")
        order = CORNERS[domain.cell]
        nodes = _compat.cell_geometry(domain.mesh)[: domain.n_cells, order]
        dofs = _compat.dofmap_array(domain.space)[: domain.n_cells, order]
        held = [np.isin(dofs, part.dofs) for part in domain.interfaces.values()]
        every = domain.on_rank_0(domain.mesh.geometry.x[nodes]).reshape(-1, 3)
        tolerance = _SAME * float(np.max(np.ptp(domain.bounding_box, axis=0)))
        _, first, which = np.unique(
            np.round(every / tolerance), axis=0, return_index=True, return_inverse=True
        )
        marks = domain.on_rank_0(np.stack(held, axis=2)).reshape(len(every), len(held))[first]
        return GatheredMesh(
            points=every[first],
            cells=which.reshape(-1, len(order)),
            interfaces=dict(zip(domain.interfaces, marks.T, strict=True)),
            domain=domain,
            _first=first,
        )

    def displacements(self, block: Array) -> Array:
        """Displacements at the points on rank 0, shape (points, 3, columns), empty elsewhere."""
        # vertices have the first dofs of a cell
        corners = self.domain.on_cells(block)[:, CORNERS[self.domain.cell]]
        return self.domain.on_rank_0(corners).reshape(-1, 3, block.shape[1])[self._first]

    def grid(self) -> pyvista.UnstructuredGrid:
        """The cells as a grid, on rank 0."""
        import pyvista  # takes a while

        kind = pyvista.CellType["TETRA" if self.cells.shape[1] == 4 else "HEXAHEDRON"]
        return pyvista.UnstructuredGrid({kind: self.cells}, self.points)


def surface_of(grid: pyvista.UnstructuredGrid) -> pyvista.PolyData:
    """The surface of cells, outwards, with "vtkOriginalCellIds" and "vtkOriginalPointIds"."""
    # by VTK itself: PyVista's name for it changes from release to release
    import pyvista
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter

    filter_ = vtkGeometryFilter()
    filter_.SetInputData(grid)
    filter_.PassThroughCellIdsOn()
    filter_.PassThroughPointIdsOn()
    filter_.Update()
    return pyvista.wrap(filter_.GetOutput())
