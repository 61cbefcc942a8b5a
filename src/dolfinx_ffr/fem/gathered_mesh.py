# SPDX-License-Identifier: MIT
"""The mesh of a body in space on rank 0, as a grid of PyVista."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from dolfinx import fem
from numpy.typing import NDArray

from ..parallel import announce, on_every_rank
from . import _compat
from .domain import Domain

if TYPE_CHECKING:
    import pyvista

__all__ = ["GatheredMesh", "gathered_cells", "surface_of"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Corners of a cell of DOLFINx in the order of VTK
CORNERS = {"tetrahedron": [0, 1, 2, 3], "hexahedron": [0, 1, 3, 2, 4, 5, 7, 6]}
#: Distance of points that are one, relative to the size of the body
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class GatheredMesh:
    """Points and straight-sided cells; everything on rank 0, empty arrays on the other ranks.

    The cells stand in the order in which the mesh was made, so that nothing depends on the number
    of ranks. All methods are collective.
    """

    points: Array  #: (points, 3) undeformed [m]
    cells: Integers  #: (cells, 4 or 8) points of each cell, in the order of VTK
    interfaces: dict[str, NDArray[np.bool_]]  #: (points,) points of each interface
    domain: Domain  #: The body
    _order: Integers  #: (cells,) where each cell stands among those sent by the ranks
    _first: Integers  #: (points,) a corner of the cells, in this order, for each point

    @staticmethod
    def of(domain: Domain) -> GatheredMesh:
        """Gather a body.

        Args:
            domain: Its mesh and interfaces.
        """
        announce(domain.comm, "gathering a mesh")
        order = CORNERS[domain.cell]
        nodes = _compat.cell_geometry(domain.mesh)[: domain.n_cells, order]
        corners = domain.mesh.geometry.x[nodes]
        dofs = _compat.dofmap_array(domain.space)[: domain.n_cells, order]
        held = {name: np.isin(dofs, part.dofs) for name, part in domain.interfaces.items()}
        number = np.asarray(domain.mesh.topology.original_cell_index)[: domain.n_cells]
        sent = domain.comm.gather((number, corners, held))
        if sent is None:
            none = np.zeros(0, dtype=np.int64)
            nothing = {name: np.zeros(0, dtype=bool) for name in held}
            cells = np.zeros((0, len(order)), dtype=np.int64)
            return GatheredMesh(np.zeros((0, 3)), cells, nothing, domain, none, none)
        rank_order = np.argsort(np.concatenate([part[0] for part in sent]), kind="stable")
        every = np.concatenate([part[1] for part in sent])[rank_order].reshape(-1, 3)
        tolerance = _SAME * float(np.max(np.ptp(every, axis=0)))
        _, first, which = np.unique(
            np.round(every / tolerance), axis=0, return_index=True, return_inverse=True
        )
        marked = {}
        for name in held:
            of_cells = np.concatenate([part[2][name] for part in sent])[rank_order]
            marked[name] = of_cells.ravel()[first]
        return GatheredMesh(
            points=every[first],
            cells=which.reshape(-1, len(order)),
            interfaces=marked,
            domain=domain,
            _order=rank_order,
            _first=first,
        )

    def cell_values(self, values: NDArray) -> NDArray:
        """Values of all cells on rank 0.

        Args:
            values: Of the cells owned by this rank, shape (cells, ...).

        Returns:
            Shape (cells of all ranks, ...) on rank 0, (0, ...) elsewhere.

        Raises:
            ValueError: On every rank, if one does not give a value for each of its cells.
        """
        return gathered_cells(self.domain, values, self._order)

    def displacements(self, block: Array) -> Array:
        """Displacement fields at the points on rank 0.

        Args:
            block: Fields on the displacement dofs owned by this rank, shape (dofs, columns).

        Returns:
            Shape (points, 3, columns) on rank 0, (0, 3, columns) elsewhere.
        """
        domain = self.domain
        # the dofs of vertices come first among those of a cell
        dofs = _compat.dofmap_array(domain.space)[: domain.n_cells, CORNERS[domain.cell]]
        field = fem.Function(domain.space)
        values = np.empty((*dofs.shape, 3, block.shape[1]))
        for i, column in enumerate(block.T):
            field.x.array[: len(column)] = column
            field.x.scatter_forward()
            values[..., i] = field.x.array.reshape(-1, 3)[dofs]
        return self.cell_values(values).reshape(-1, 3, block.shape[1])[self._first]

    def grid(self) -> pyvista.UnstructuredGrid:
        """The cells as a grid, on rank 0."""
        import pyvista  # takes a while

        count, corners = self.cells.shape
        kind = pyvista.CellType.TETRA if corners == 4 else pyvista.CellType.HEXAHEDRON
        return pyvista.UnstructuredGrid(
            np.column_stack([np.full(count, corners), self.cells]).ravel(),
            np.full(count, kind),
            self.points,
        )


def gathered_cells(domain: Domain, values: NDArray, order: Integers) -> NDArray:
    """Values of all cells on rank 0; collective.

    Args:
        domain: The body.
        values: Of the cells owned by this rank, shape (cells, ...).
        order: On rank 0, where each cell stands among those sent by the ranks.

    Returns:
        Shape (cells of all ranks, ...) on rank 0, (0, ...) elsewhere.

    Raises:
        ValueError: On every rank, if one does not give a value for each of its cells.
    """
    with on_every_rank(domain.comm, "gathering values"):
        if len(values) != domain.n_cells:
            raise ValueError(
                f"gathering: {len(values)} values on rank {domain.comm.rank}, which owns "
                f"{domain.n_cells} cells; give one for each"
            )
    sent = domain.comm.gather(values)
    return values[:0] if sent is None else np.concatenate(sent)[order]


def surface_of(grid: pyvista.UnstructuredGrid) -> pyvista.PolyData:
    """The surface of some cells, turned outwards.

    Its cells know of which cell they are by ``"vtkOriginalCellIds"``, its points of which point by
    ``"vtkOriginalPointIds"``.

    Args:
        grid: The cells.
    """
    # by VTK itself: PyVista's name for it changes from release to release
    import pyvista
    from vtkmodules.vtkFiltersGeometry import vtkGeometryFilter

    filter_ = vtkGeometryFilter()
    filter_.SetInputData(grid)
    filter_.PassThroughCellIdsOn()
    filter_.PassThroughPointIdsOn()
    filter_.Update()
    return pyvista.wrap(filter_.GetOutput())
