# SPDX-License-Identifier: MIT
"""The lattice on which zero lines are looked for: points and triangles in all cells of a body."""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import basix
import numpy as np

from ..arrays import Array, Integers
from ..fem import Domain, _compat, cross
from ..limits import check_count
from ..parallel import announce, on_every_rank
from .options import CURVES

#: What a cell is: outside of the body or empty for ever, designed, material for ever
VOID, DESIGN, SOLID = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Lattice:
    """Points in and on all cells, triangles between them, and the edges of the mesh.

    Cells share the points on common edges. The cells stand in the order in which the mesh was made,
    so that nothing depends on the number of ranks.
    """

    points: Array  #: (points, 2) [m]
    triangles: Integers  #: (triangles, 3) points, counterclockwise
    kinds: Integers  #: (triangles,) VOID, DESIGN or SOLID
    edges: Integers  #: (edges, 2) points at the ends of each edge of the mesh
    chains: Integers  #: (edges, n + 1) points along each edge, from the first to the second end
    sides: Integers  #: (edges, 2) kinds of the cells at an edge, VOID where there is none
    interface: Integers  #: (edges,) number of the interface, -1 where there is none
    curved: bool  #: Whether the geometry of the mesh is of a higher order than 1

    @staticmethod
    def of(domain: Domain, largest: float) -> Lattice | None:
        """The lattice of a body on rank 0, None elsewhere.

        ``largest`` is the length of the longest side of a triangle in straight cells [m].
        """
        announce(domain.comm, "the boundary of a part")
        mesh, n = domain.mesh, domain.n_cells
        kind = getattr(basix.CellType, _compat.cell_name(mesh))
        ends = np.array(basix.topology(kind)[1])
        nodes = _compat.cell_geometry(mesh)[:n]
        x = mesh.geometry.x[nodes][:, :, :2]
        sides = np.linalg.norm(x[:, ends[:, 0]] - x[:, ends[:, 1]], axis=2)
        longest = domain.comm.allreduce(float(np.max(sides, initial=0.0)), MPI.MAX)
        with on_every_rank(domain.comm, "part"), np.errstate(over="ignore"):
            in_square = float(np.float64(longest / largest + 1.0) ** 2)
            in_cell = 0.5 * in_square if len(ends) == 3 else in_square
            check_count(
                "part",
                domain.n_cells_global * in_cell,
                f"points of a lattice of {largest:.4g} m",
                "give a larger spacing [m], or a smaller resolution",
                each=CURVES.bytes_of_point,
                most=CURVES.most_points,
            )
        facets = mesh.topology.connectivity(2, 1).array.reshape(-1, len(ends))[:n]
        interface = np.full(facets.shape, -1, dtype=np.int64)
        for number, named in enumerate(domain.interfaces.values()):
            interface[np.isin(facets, named.facets)] = number
        of_cells = (
            np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)[nodes],
            x,
            np.select([domain.void_cells, domain.solid_cells], [VOID, SOLID], DESIGN),
            interface,
        )
        of_all_ranks = [domain.on_rank_0(values) for values in of_cells]
        degree = int(_compat.coordinate_element(mesh).degree)
        return None if domain.comm.rank else _lattice(kind, degree, largest, *of_all_ranks)


def _lattice(
    kind: basix.CellType,
    degree: int,
    largest: float,
    nodes: Integers,
    x: Array,
    kinds: Integers,
    marks: Integers,
) -> Lattice:
    """The lattice of cells of one shape.

    Args:
        kind: Shape of the cells.
        degree: Of their geometry.
        largest: Length of the longest side of a triangle in straight cells [m].
        nodes: Numbers of the nodes of each cell, shape (cells, nodes).
        x: Their positions, shape (cells, nodes, 2) [m].
        kinds: VOID, DESIGN or SOLID, shape (cells,).
        marks: Number of the interface on each side, -1 where there is none, shape (cells, sides).
    """
    reference = basix.geometry(kind)[:, :2]
    corners, ends = len(reference), np.array(basix.topology(kind)[1])
    vertices = np.unique(nodes[:, :corners], return_inverse=True)[1].reshape(-1, corners)

    straight = np.linalg.norm(x[:, ends[:, 0]] - x[:, ends[:, 1]], axis=2)
    # an even number, so that the pattern of a quadrilateral is its own mirror image
    n = 2 * max(1, int(np.ceil(0.5 * float(straight.max()) / largest - 1e-9)))
    places, pattern = _pattern(corners, n)
    element = basix.create_element(
        basix.ElementFamily.P, kind, degree, basix.LagrangeVariant.gll_warped
    )
    table = np.asarray(element.tabulate(0, places / n)).reshape(len(places), -1)
    positions = np.einsum("pn,cnd->cpd", table, x)

    # the edge on each side of each cell, and whether the side runs against it
    pairs = vertices[:, ends].reshape(-1, 2)
    is_against = (pairs[:, 0] > pairs[:, 1]).reshape(-1, len(ends))
    edges, edge = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    edge = edge.reshape(-1, len(ends))

    # points have numbers: first the vertices, then those along edges, then those within cells
    n_vertices = int(vertices.max()) + 1
    inner = n_vertices + np.arange(len(edges) * (n - 1)).reshape(len(edges), n - 1)
    chains = np.column_stack([edges[:, 0], inner, edges[:, 1]])
    numbers = np.full((len(nodes), len(places)), -1, dtype=np.int64)
    for i, (a, b) in enumerate(reference[ends]):
        steps = np.rint(n * (a + np.linspace(0.0, 1.0, n + 1)[:, None] * (b - a))).astype(int)
        on_side = [int(np.flatnonzero(np.all(places == step, axis=1))[0]) for step in steps]
        along = chains[edge[:, i]]
        numbers[:, on_side] = np.where(is_against[:, i, None], along[:, ::-1], along)
    within = np.flatnonzero(numbers[0] < 0)
    n_shared = n_vertices + inner.size
    n_within = len(nodes) * len(within)
    numbers[:, within] = n_shared + np.arange(n_within).reshape(len(nodes), -1)
    points = np.empty((n_shared + n_within, 2))
    points[numbers] = positions

    triangles = numbers[:, pattern]
    clockwise = cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]) < 0.0
    triangles[clockwise] = triangles[clockwise][:, :, ::-1]

    # the cells at each edge, one or two: the sides of cells in the order of their edges
    flat = edge.ravel()
    order = np.argsort(flat, kind="stable")
    in_order = flat[order]
    first = np.searchsorted(in_order, np.arange(len(edges)))
    position_at_edge = np.arange(len(order)) - first[in_order]
    sides = np.zeros((len(edges), 2), dtype=np.int64)
    sides[in_order, position_at_edge] = np.repeat(kinds, len(ends))[order]
    interface = np.full(len(edges), -1, dtype=np.int64)
    np.maximum.at(interface, flat, marks.ravel())

    triangles, kinds = triangles.reshape(-1, 3), np.repeat(kinds, len(pattern))
    return Lattice(points, triangles, kinds, edges, chains, sides, interface, degree > 1)


def _pattern(corners: int, n: int) -> tuple[Integers, Integers]:
    """Lattice points of the reference cell times n (points, 2), and triangles between them.

    The triangles (triangles, 3) are numbers of lattice points. The reference cell is a triangle or
    a quadrilateral, as it has 3 or 4 ``corners``.
    """
    is_triangle = corners == 3
    rows = [range(n + 1 - j if is_triangle else n + 1) for j in range(n + 1)]
    places = [(i, j) for j, row in enumerate(rows) for i in row]
    number = {place: k for k, place in enumerate(places)}

    triangles = []
    for i, j in places:
        square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        a, b, c, d = (number.get(place) for place in square)  # None beyond the reference cell
        if is_triangle:
            triangles += [t for t in ([a, b, d], [b, c, d]) if None not in t]
        elif None not in (a, b, c, d):
            # diagonals alternate like the fields of a chessboard, so that no direction is preferred
            triangles += [[a, b, c], [a, c, d]] if (i + j) % 2 else [[a, b, d], [b, c, d]]
    return np.array(places, dtype=np.int64), np.array(triangles, dtype=np.int64)
