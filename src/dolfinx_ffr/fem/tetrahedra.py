# SPDX-License-Identifier: MIT
"""A body in space on rank 0: its mesh as a grid of PyVista, and its tetrahedra.

They carry interfaces and regions, so that parts that are cut out of them have these, too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING

from mpi4py import MPI

import basix
import numpy as np

from ..arrays import Array, Integers, Mask
from ..parallel import announce
from . import _compat
from .curves import ShapeError
from .domain import Domain
from .mesh_arrays import MeshArrays, distribute, numbered

#: Regions of a body
DESIGNED, SOLID, VOID = 0, 1, 2
#: Corners of the faces of a hexahedron in the order of VTK
_FACES = np.array(
    [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [0, 3, 2, 1], [4, 5, 6, 7]]
)
#: Corners of the face opposite of each corner of a tetrahedron
_OPPOSITE = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
#: Corners of a hexahedron in the order of VTK
_CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)
#: The eight tetrahedra in one, by the pairs of corners in whose middles their corners are
_RED = np.array(
    [
        [[0, 0], [0, 1], [0, 2], [0, 3]],
        [[0, 1], [1, 1], [1, 2], [1, 3]],
        [[0, 2], [1, 2], [2, 2], [2, 3]],
        [[0, 3], [1, 3], [2, 3], [3, 3]],
        [[0, 1], [0, 2], [0, 3], [1, 3]],
        [[0, 1], [0, 2], [1, 2], [1, 3]],
        [[0, 2], [0, 3], [1, 3], [2, 3]],
        [[0, 2], [1, 2], [1, 3], [2, 3]],
    ]
)
if TYPE_CHECKING:
    import pyvista


@dataclass(frozen=True)
class CuttingOptions:
    """How cells are cut into tetrahedra."""

    #: Tetrahedra of a body, at most: a part that is cut out of them has fewer than 2^21 points, so
    #: that three numbers of points make one of 64 bits
    most: int = 8_000_000
    most_along: int = 100  #: Parts of a cell along an axis, at most
    alike: float = math.sqrt(2.0)  #: Ratio of a part's edges below which it is as long as wide
    #: How many times more tetrahedra than the one before it a finer division has, at least
    finer: float = 1.6


CUTTING = CuttingOptions()
#: Corners of a cell of DOLFINx in the order of VTK
CORNERS = {"tetrahedron": [0, 1, 2, 3], "hexahedron": [0, 1, 3, 2, 4, 5, 7, 6]}


@dataclass(frozen=True, eq=False)
class GatheredMesh:
    """Points and straight-sided cells, as the mesh was made, on rank 0."""

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
        on_interfaces = [np.isin(dofs, interface.dofs) for interface in domain.interfaces.values()]
        all_corners = domain.on_rank_0(domain.mesh.geometry.x[nodes]).reshape(-1, 3)
        first_corner, point_of_corner = numbered(all_corners)
        marks = domain.on_rank_0(np.stack(on_interfaces, axis=2)).reshape(
            len(all_corners), len(on_interfaces)
        )[first_corner]
        return GatheredMesh(
            points=all_corners[first_corner],
            cells=point_of_corner.reshape(-1, len(order)),
            interfaces=dict(zip(domain.interfaces, marks.T, strict=True)),
            domain=domain,
            _first=first_corner,
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


@dataclass(frozen=True, eq=False)
class Tetrahedra:
    """Tetrahedra with straight edges; everything on rank 0, empty arrays on the other ranks."""

    points: Array  #: (points, 3) [m]
    cells: Integers  #: (cells, 4) points of each
    #: (cells, 4) number of the interface of the face opposite of each corner, -1 where it is none
    facets: Integers
    regions: Integers  #: (cells,) `DESIGNED`, `SOLID` or `VOID`

    @staticmethod
    def of(domain: Domain, finer: int = 0) -> Tetrahedra:
        """A body in space, its cells cut into tetrahedra.

        With ``finer`` = 0, 1, 2, ... a cube becomes 12, 24, 96, 192, 324, ..., a tetrahedron 1, 8,
        64, ... of them. A hexahedron that is longer than wide is first divided along its length,
        if cells beside each other have the same axes: it becomes 12, 24, 48, ... of them.
        """
        Tetrahedra.check(domain, finer)
        mesh = GatheredMesh.of(domain)
        regions = np.where(domain.void_cells, VOID, np.where(domain.solid_cells, SOLID, DESIGNED))
        of_cells = map(domain.on_rank_0, (_facets(domain), regions))
        body = Tetrahedra(mesh.points, mesh.cells, *of_cells)
        if domain.comm.rank:
            none = np.zeros((0, 4), dtype=np.int64)
            return Tetrahedra(body.points, none, none, body.regions)
        if domain.cell == "tetrahedron":
            for _ in range(finer):
                body = _divided(body, np.mean(np.eye(4)[_RED], axis=2))
            return body
        counts, with_faces = _division(domain, finer)
        if max(counts) > 1:
            body = _divided(body, _boxes(counts))
        return _split(body, with_faces=with_faces)

    @staticmethod
    def size(domain: Domain, finer: int = 0) -> float:
        """Edge of the cube that six mean tetrahedra fill [m]."""
        return domain.cell_size * (6.0 / Tetrahedra.each(domain, finer)) ** (1.0 / 3.0)

    @staticmethod
    def finest(domain: Domain, enough: float, most: int) -> float:
        """The size of tetrahedra [m] that is small ``enough``, or as ``most`` of them allow."""
        finer = 0
        while Tetrahedra.size(domain, finer) > enough:
            if domain.n_cells_global * Tetrahedra.each(domain, finer + 1) > most:
                break
            finer += 1
        return Tetrahedra.size(domain, finer)

    @staticmethod
    def check(domain: Domain, finer: int) -> None:
        """Refuse more tetrahedra than can be cut."""
        count = domain.n_cells_global * Tetrahedra.each(domain, finer)
        if count > CUTTING.most:
            raise ShapeError(
                f"solid: {count:,} tetrahedra are more than the limit of {CUTTING.most:,}; take a "
                "larger size or fewer meshes"
            )

    @staticmethod
    def each(domain: Domain, finer: int) -> int:
        """Number of tetrahedra that a cell becomes."""
        if domain.cell == "tetrahedron":
            return int(8**finer)
        counts, with_faces = _division(domain, finer)
        return 12 * (1 + with_faces) * math.prod(counts)

    def domain(
        self,
        comm: MPI.Comm,
        names: Sequence[str],
        centers: Mapping[str, Sequence[float]],
        order: int,
    ) -> Domain:
        """The body of all cells that are not void; facets refer to places in ``names``."""
        arrays = None
        if comm.rank == 0:
            not_void = self.regions != VOID
            used, cells = np.unique(self.cells[not_void], return_inverse=True)
            cells = cells.reshape(-1, 4)
            tags, sides = self.facets[not_void], cells[:, _OPPOSITE]
            facets = {name: sides[tags == i] for i, name in enumerate(names) if i in tags}
            regions = {"solid": self.regions[not_void] == SOLID}
            arrays = MeshArrays("tetrahedron", 1, self.points[used], cells, facets, regions)
        mesh, facets_by_name, cells_by_name = distribute(comm, arrays)
        known_centers = {name: center for name, center in centers.items() if name in facets_by_name}
        # a part that stays solid everywhere has nothing that could be designed again
        all_solid = comm.bcast(arrays is not None and bool(np.all(arrays.regions["solid"])))
        solid = None if all_solid else cells_by_name["solid"]
        return Domain(mesh, facets_by_name, solid, order=order, centers=known_centers)


def _facets(domain: Domain) -> Integers:
    """Number of the interface, or -1, of each facet of this rank's cells, as `_FACES` has them."""
    topology = domain.mesh.topology
    facets = topology.index_map(2)
    tag = np.full(facets.size_local + facets.num_ghosts, -1, dtype=np.int64)
    for i, interface in enumerate(domain.interfaces.values()):
        tag[interface.facets] = i
    sides = [sorted(side) for side in basix.topology(getattr(basix.CellType, domain.cell))[2]]
    sides_in_order = np.array(CORNERS[domain.cell])[
        _OPPOSITE if domain.cell == "tetrahedron" else _FACES
    ]
    columns = [sides.index(side) for side in np.sort(sides_in_order, axis=1).tolist()]
    of_cells = np.asarray(topology.connectivity(3, 2).array).reshape(-1, len(sides))
    return np.asarray(tag[of_cells[: domain.n_cells][:, columns]])


def _division(domain: Domain, finer: int) -> tuple[tuple[int, int, int], bool]:
    """Parts of a hexahedron along its axes, and whether the middles of their faces are corners."""
    divisions = _divisions(tuple(domain.cell_edges))
    return divisions[min(finer, len(divisions) - 1)]  # the last has more than can be cut


@lru_cache(maxsize=64)
def _divisions(edges: tuple[float, ...]) -> list[tuple[tuple[int, int, int], bool]]:
    """All of them, the coarsest first, by the edges of cells.

    Cells are divided into parts as long as wide, as far as that goes.
    """
    longer = np.array(edges) / min(edges)
    ends = np.concatenate(
        [(np.arange(1, CUTTING.most_along) + 0.5) / edge_ratio for edge_ratio in longer]
    )
    scales = np.unique(np.round(ends, 9))
    counts = np.maximum(1, np.floor(scales[:, None] * longer + 0.5 + 1e-6)).astype(int)
    candidates = []
    for counts_of_cell in np.unique(np.vstack([np.ones((1, 3), dtype=int), counts]), axis=0):
        edges_of_part = longer / counts_of_cell
        aspect = float(edges_of_part.max() / edges_of_part.min())
        if np.all(counts_of_cell == 1) or aspect < CUTTING.alike:
            candidates += [
                (math.prod(counts_of_cell) * (1 + f), aspect, tuple(counts_of_cell.tolist()), f)
                for f in (0, 1)
            ]
    divisions, last_count = [], 0.0
    for count, _, counts_of_cell, with_faces in sorted(candidates):
        if count > CUTTING.finer * last_count:
            divisions.append((counts_of_cell, bool(with_faces)))
            last_count = count
    return divisions


def _boxes(counts: tuple[int, int, int]) -> Array:
    """Corners of so many parts of a cube by weights of its own corners, (parts, 8, 8)."""
    lower_corners = np.array(list(product(*map(range, counts))))
    positions = (lower_corners[:, None, :] + _CUBE) / counts
    factors = np.where(_CUBE == 1, positions[:, :, None, :], 1.0 - positions[:, :, None, :])
    return np.asarray(np.prod(factors, axis=3))


def _divided(body: Tetrahedra, weights: Array) -> Tetrahedra:
    """Cells, also hexahedra, divided into cells alike, by weights (parts, corners, corners)."""
    n_parts, corners = weights.shape[:2]
    positions = np.einsum("pkc,nci->npki", weights, body.points[body.cells])
    positions = positions.reshape(-1, 3)
    first_corner, number_of_corner = numbered(positions)
    sides = _FACES if corners == 8 else _OPPOSITE
    # a side of a part is on that side of the cell whose corners alone give its corners
    tags = np.full((len(body.cells), n_parts, len(sides)), -1, dtype=np.int64)
    for k, i in product(range(n_parts), range(len(sides))):
        needed = np.any(weights[k, sides[i]] > 1e-12, axis=0)
        for j, side in enumerate(sides):
            if not np.any(np.delete(needed, side)):
                tags[:, k, i] = body.facets[:, j]
    cells, facets = number_of_corner.reshape(-1, corners), tags.reshape(-1, len(sides))
    return Tetrahedra(positions[first_corner], cells, facets, np.repeat(body.regions, n_parts))


def _split(body: Tetrahedra, *, with_faces: bool) -> Tetrahedra:
    """Hexahedra as 12 tetrahedra about their middle, or as 24 with the middles of their faces."""
    points, cells = body.points, body.cells
    sides = cells[:, _FACES]
    middle = len(points) + np.arange(len(cells))
    all_points = [points, points[cells].mean(axis=1)]
    triangles: list[Integers] = []
    if with_faces:
        flat = np.sort(sides.reshape(-1, 4), axis=1)
        _, first_index, number_of_face = np.unique(
            flat, axis=0, return_index=True, return_inverse=True
        )
        all_points.append(points[flat[first_index]].mean(axis=1))
        top = len(points) + len(cells) + number_of_face.reshape(sides.shape[:2])
        for i in range(4):
            pair = sides[:, :, [(i + 1) % 4, i]]
            triangles.append(np.concatenate([pair, top[:, :, None]], axis=2))
    else:
        # the diagonal from the corner with the smallest number is the same from both sides
        start = np.argmin(sides, axis=2)[:, :, None]
        turned = np.take_along_axis(sides, (start + np.arange(4)) % 4, axis=2)
        triangles = [turned[:, :, [1, 0, 2]], turned[:, :, [2, 0, 3]]]
    tetrahedra, tags = [], []
    for triangle in triangles:
        inner = np.broadcast_to(middle[:, None, None], (*triangle.shape[:2], 1))
        tetrahedra.append(np.concatenate([triangle, inner], axis=2).reshape(-1, 4))
        tag = np.full((body.facets.size, 4), -1, dtype=np.int64)
        tag[:, 3] = body.facets.ravel()
        tags.append(tag)
    regions = np.tile(np.repeat(body.regions, 6), len(triangles))
    return Tetrahedra(
        np.vstack(all_points), np.concatenate(tetrahedra), np.concatenate(tags), regions
    )
