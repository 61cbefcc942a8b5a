# SPDX-License-Identifier: MIT
"""Meshes of bodies as they are drawn: straight-sided pieces and lines, gathered on rank 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import basix
import numpy as np
from dolfinx import mesh
from numpy.typing import NDArray

from ..arrays import Array, Integers
from ..fem import Domain, GatheredMesh, _compat
from ..parallel import announce

if TYPE_CHECKING:
    import pyvista


def gathered_mesh(domain: Domain) -> DrawnMesh | GatheredMesh:
    """The mesh of a body in the plane or in space, gathered on rank 0."""
    return GatheredMesh.of(domain) if domain.dimension == 3 else DrawnMesh.of(domain)


@dataclass(frozen=True, eq=False)
class DrawnMesh:
    """Points, pieces and lines of a body; everything on rank 0, empty arrays on the other ranks.

    Each cell is cut into straight-sided pieces, n^2 where geometry or displacements have order n.
    The cells stand in the order in which the mesh was made, so that the picture does not depend on
    the number of ranks.
    """

    points: Array  #: (points, 2) undeformed [m]; cells do not share points
    pieces: Integers  #: (pieces, 3 or 4) points of each piece, in turn
    parents: Integers  #: (pieces,) cell of each piece
    outline: Integers  #: (lines, 2) ends of the lines on the boundary
    interfaces: dict[str, Integers]  #: (lines, 2) ends of the lines of each interface
    domain: Domain  #: The body

    @staticmethod
    def of(domain: Domain) -> DrawnMesh:
        """Gather a body in the plane."""
        announce(domain.comm, "the drawing of a body")
        cell_type, degree, lattice, pieces = _reference(domain)
        nodes = _compat.cell_geometry(domain.mesh)[: domain.n_cells]
        corners = domain.mesh.geometry.x[nodes][:, :, :2]
        table = _shape_functions(cell_type, degree, lattice)
        points = domain.on_rank_0(np.einsum("pn,cnd->cpd", table, corners))
        offsets = len(lattice) * np.arange(len(points), dtype=np.int64)

        n_sides = len(basix.topology(cell_type)[1])
        sides = [_points_on_facet(cell_type, side, lattice) for side in range(n_sides)]
        topology = domain.mesh.topology
        facets = topology.connectivity(2, 1).array.reshape(-1, n_sides)[: domain.n_cells]

        def lines_on(chosen: NDArray[Any]) -> Integers:
            """Lines along some facets."""
            marked = domain.on_rank_0(np.isin(facets, chosen))
            lines = [offsets[marked[:, i], None, None] + side for i, side in enumerate(sides)]
            return np.concatenate([line.reshape(-1, 2) for line in lines])

        return DrawnMesh(
            points=points.reshape(-1, 2),
            pieces=(offsets[:, None, None] + pieces).reshape(-1, pieces.shape[1]),
            parents=np.repeat(np.arange(len(points), dtype=np.int64), len(pieces)),
            outline=lines_on(mesh.exterior_facet_indices(topology)),
            interfaces={name: lines_on(i.facets) for name, i in domain.interfaces.items()},
            domain=domain,
        )

    def displacements(self, block: Array) -> Array:
        """Fields (owned dofs, columns) at the points on rank 0, shape (points, 2, columns)."""
        cell_type, _, lattice, _ = _reference(self.domain)
        table = _shape_functions(cell_type, self.domain.order, lattice)
        fields = np.einsum("pn,cndk->cpdk", table, self.domain.on_cells(block))
        return self.domain.on_rank_0(fields).reshape(-1, 2, block.shape[1])

    def grid(self) -> pyvista.UnstructuredGrid:
        """The pieces as a grid, on rank 0."""
        import pyvista  # takes a while

        cell_type = pyvista.CellType["TRIANGLE" if self.pieces.shape[1] == 3 else "QUAD"]
        points = np.column_stack([self.points, np.zeros(len(self.points))])
        return pyvista.UnstructuredGrid({cell_type: self.pieces}, points)


def _reference(domain: Domain) -> tuple[basix.CellType, int, Array, Integers]:
    """Kind and geometric degree of the cells, their lattice points and pieces."""
    kind = getattr(basix.CellType, _compat.cell_name(domain.mesh))
    degree = int(_compat.coordinate_element(domain.mesh).degree)
    return kind, degree, *_lattice(kind, max(degree, domain.order))


def _shape_functions(kind: basix.CellType, degree: int, points: Array) -> Array:
    """Values of the Lagrange shape functions of a cell, shape (points, functions)."""
    element = basix.create_element(
        basix.ElementFamily.P, kind, degree, basix.LagrangeVariant.gll_warped
    )
    return np.asarray(element.tabulate(0, points)).reshape(len(points), -1)


def _lattice(kind: basix.CellType, n: int) -> tuple[Array, Integers]:
    """Points that cut the sides of the reference cell into n, and the pieces between them.

    The points have the shape (points, 2); the pieces, triangles or quadrilaterals as the cell is,
    are the numbers of their corners, (pieces, 3) or (pieces, 4).
    """
    triangle = kind == basix.CellType.triangle
    points = [(i, j) for j in range(n + 1) for i in range(n + 1 - j if triangle else n + 1)]
    number = {point: k for k, point in enumerate(points)}

    pieces = []
    for i, j in points:
        right, opposite, above = (i + 1, j), (i + 1, j + 1), (i, j + 1)
        if not triangle and i < n and j < n:
            pieces.append([(i, j), right, opposite, above])
        elif triangle and i + j < n:
            pieces.append([(i, j), right, above])
            if i + j < n - 1:  # at the longest side of the cell nothing lies opposite
                pieces.append([right, opposite, above])
    corners = [[number[point] for point in piece] for piece in pieces]
    return np.array(points, dtype=np.float64) / n, np.array(corners, dtype=np.int64)


def _points_on_facet(kind: basix.CellType, facet: int, lattice: Array) -> Integers:
    """Lines between lattice points along a facet of the reference cell, (lines, 2)."""
    start, end = basix.geometry(kind)[basix.topology(kind)[1][facet]][:, :2]
    along = end - start
    normal = np.array([-along[1], along[0]])
    on_facet = np.flatnonzero(np.abs((lattice - start) @ normal) < 1e-9)
    chain = on_facet[np.argsort((lattice[on_facet] - start) @ along)]
    return np.column_stack([chain[:-1], chain[1:]]).astype(np.int64)
