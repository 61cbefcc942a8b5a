# SPDX-License-Identifier: MIT
"""Where a field is zero on a lattice: the segments between material and void.

Each triangle of a designed cell is material where the field, linear on its sides, is positive;
triangles of solid cells are material. The sides of all pieces, directed with material on the left,
cancel where two pieces meet; what is left bounds the material. It is closed whatever the field is,
and follows the sides of the mesh to the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mpi4py import MPI

import basix
import numpy as np

from ..arrays import Array, Integers, Mask
from ..fem import Domain, _compat, connected
from ..limits import check_count
from ..parallel import announce, on_every_rank
from .field import Field, cross, evaluated, refuse_zero, zeros_between

#: Values of less than this distance from the zero line count as material, in units of the spacing
_SNAP = 1e-3
#: Shorter segments are contracted, in units of the longest side of a triangle
_SHORT = 0.02
#: Most points, which take a minute without those of the field
MOST_POINTS = 20_000_000
#: Memory that a point takes, at least [bytes]
_BYTES = 300
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
            count = domain.n_cells_global * float(np.float64(longest / largest + 1.0) ** 2)
            what = f"points of a lattice of {largest:.4g} m"
            remedy = "give a larger spacing [m], or a smaller resolution"
            share = 0.5 if len(ends) == 3 else 1.0
            check_count("part", share * count, what, remedy, each=_BYTES, most=MOST_POINTS)
        facets = mesh.topology.connectivity(2, 1).array.reshape(-1, len(ends))[:n]
        interface = np.full(facets.shape, -1, dtype=np.int64)
        for i, part in enumerate(domain.interfaces.values()):
            interface[np.isin(facets, part.facets)] = i
        own = (
            np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)[nodes],
            x,
            np.select([domain.void_cells, domain.solid_cells], [VOID, SOLID], DESIGN),
            interface,
        )
        every = [domain.on_rank_0(values) for values in own]
        degree = int(_compat.coordinate_element(mesh).degree)
        return None if domain.comm.rank else _lattice(kind, degree, largest, *every)


def _lattice(
    kind: basix.CellType,
    degree: int,
    largest: float,
    nodes: Integers,
    x: Array,
    kinds: Integers,
    marks: Integers,
) -> Lattice:
    reference = basix.geometry(kind)[:, :2]
    corners, ends = len(reference), np.array(basix.topology(kind)[1])
    vertices = np.unique(nodes[:, :corners], return_inverse=True)[1].reshape(-1, corners)
    straight = np.linalg.norm(x[:, ends[:, 0]] - x[:, ends[:, 1]], axis=2)
    # an even number, so that the pattern of a quadrilateral is its own mirror image
    n = 2 * max(1, int(np.ceil(0.5 * float(straight.max()) / largest - 1e-9)))
    where, pattern = _pattern(corners, n)
    element = basix.create_element(
        basix.ElementFamily.P, kind, degree, basix.LagrangeVariant.gll_warped
    )
    table = np.asarray(element.tabulate(0, where / n)).reshape(len(where), -1)
    positions = np.einsum("pn,cnd->cpd", table, x)

    pairs = vertices[:, ends].reshape(-1, 2)
    turned = pairs[:, 0] > pairs[:, 1]
    edges, edge = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    edge, turned = edge.reshape(-1, len(ends)), turned.reshape(-1, len(ends))
    count = int(vertices.max()) + 1
    inner = count + np.arange(len(edges) * (n - 1)).reshape(len(edges), n - 1)
    chains = np.column_stack([edges[:, 0], inner, edges[:, 1]])
    numbers = np.full((len(nodes), len(where)), -1, dtype=np.int64)
    for i, (a, b) in enumerate(reference[ends]):
        steps = np.rint(n * (a + np.linspace(0.0, 1.0, n + 1)[:, None] * (b - a))).astype(int)
        on = [int(np.flatnonzero(np.all(where == step, axis=1))[0]) for step in steps]
        along = chains[edge[:, i]]
        numbers[:, on] = np.where(turned[:, i, None], along[:, ::-1], along)
    rest = np.flatnonzero(numbers[0] < 0)
    total = count + inner.size
    numbers[:, rest] = total + np.arange(len(nodes) * len(rest)).reshape(len(nodes), -1)
    points = np.empty((total + len(nodes) * len(rest), 2))
    points[numbers] = positions

    triangles = numbers[:, pattern]
    turn = cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]) < 0.0
    triangles[turn] = triangles[turn][:, :, ::-1]
    flat = edge.ravel()
    met = np.argsort(flat, kind="stable")
    first = np.searchsorted(flat[met], np.arange(len(edges)))
    sides = np.zeros((len(edges), 2), dtype=np.int64)
    sides[flat[met], np.arange(len(met)) - first[flat[met]]] = np.repeat(kinds, len(ends))[met]
    interface = np.full(len(edges), -1, dtype=np.int64)
    np.maximum.at(interface, flat, marks.ravel())
    triangles, kinds = triangles.reshape(-1, 3), np.repeat(kinds, len(pattern))
    return Lattice(points, triangles, kinds, edges, chains, sides, interface, degree > 1)


def _pattern(corners: int, n: int) -> tuple[Integers, Integers]:
    """Lattice points of the reference cell times n, and the triangles between them."""
    triangle = corners == 3
    where = [(i, j) for j in range(n + 1) for i in range(n + 1 - j if triangle else n + 1)]
    number = {place: k for k, place in enumerate(where)}
    found = []
    for i, j in where:
        square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        a, b, c, d = (number.get(place) for place in square)
        if triangle:
            found += [t for t in ([a, b, d], [b, c, d]) if None not in t]
        elif None not in (a, b, c, d):
            found += [[a, b, c], [a, c, d]] if (i + j) % 2 else [[a, b, d], [b, c, d]]
    return np.array(where, dtype=np.int64), np.array(found, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Segments:
    """Directed segments between regions, material of the left kind on the left."""

    points: Array  #: (nodes, 2) [m]
    ends: Integers  #: (segments, 2) nodes
    left: Integers  #: (segments,) DESIGN or SOLID
    right: Integers  #: (segments,) VOID, or SOLID right of DESIGN
    edge: Integers  #: (segments,) edge of the mesh, -1 on the zero line of the field
    zero: Mask  #: (nodes,) where the field is zero to round-off


class Directed(NamedTuple):
    """Sides of triangles with material on the left."""

    ends: Integers  #: (sides, 2) nodes
    edge: Integers  #: (sides,) edge of the mesh, -1 for none
    kind: Integers  #: (sides,) DESIGN or SOLID


def cut(lattice: Lattice, field: Field, spacing: float) -> Segments:
    """The segments between material and void, and between solid and designed cells.

    ``spacing`` is the length on which the field varies [m].
    """
    triangles, points = lattice.triangles, lattice.points
    values = evaluated(field, points)
    refuse_zero("part", values, triangles[lattice.kinds == DESIGN])
    # sides of all triangles, each once
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    pairs, side = np.unique(_keys(sides, len(points)), return_inverse=True)
    a, b = pairs // len(points), pairs % len(points)
    length = np.linalg.norm(points[b] - points[a], axis=1)
    slope = np.zeros(len(points))
    np.maximum.at(slope, a, np.abs(values[b] - values[a]) / length)
    np.maximum.at(slope, b, np.abs(values[b] - values[a]) / length)
    inside = values >= -_SNAP * spacing * slope

    crossed = inside[a] != inside[b]
    root = np.full(len(pairs), -1, dtype=np.int64)
    root[crossed] = len(points) + np.arange(np.count_nonzero(crossed))
    p, q = a[crossed], b[crossed]
    share = zeros_between(field, points[p], points[q], values[p], values[q])[:, None]
    nodes = np.vstack([points, points[p] + share * (points[q] - points[p])])

    side, edge = side.reshape(-1, 3), _edge_of(pairs, lattice)
    there = lattice.kinds != VOID
    around = _around(
        triangles[there], root[side[there]], edge[side[there]], inside, lattice.kinds[there]
    )
    left = _left_over(around, len(nodes))
    # a mesh vertex, or else a point on the mesh, stays where a short segment is contracted
    rank = np.full(len(nodes), 3)
    rank[len(points) :][edge[crossed] >= 0] = 2
    rank[lattice.chains.ravel()] = 1
    rank[lattice.edges.ravel()] = 0
    ends = _contracted(nodes, left.ends, rank, _SHORT * float(length.max()))[left.ends]
    stays = ends[:, 0] != ends[:, 1]
    left = _left_over(Directed(ends[stays], left.edge[stays], left.kind[stays]), len(nodes))
    # each once: where designed and solid cells meet, the designed one stays
    keys, design = _keys(left.ends, len(nodes)), left.kind == DESIGN
    stays = design | ~np.isin(keys, keys[design])
    right = np.where(design & np.isin(keys, keys[~design]), SOLID, VOID)
    zero = np.concatenate([np.zeros(len(points), dtype=bool), values[p] * values[q] < 0.0])
    return Segments(nodes, left.ends[stays], left.kind[stays], right[stays], left.edge[stays], zero)


def _keys(ends: Integers, count: int) -> Integers:
    """One number for the two nodes of a side, in whichever order."""
    return np.asarray(np.min(ends, axis=1) * count + np.max(ends, axis=1))


def _edge_of(pairs: Integers, lattice: Lattice) -> Integers:
    """The edge of the mesh on which sides of triangles lie, -1 where they lie within a cell."""
    count = len(lattice.points)
    along = np.stack([lattice.chains[:, :-1], lattice.chains[:, 1:]], axis=2)
    keys = _keys(along.reshape(-1, 2), count)
    order = np.argsort(keys)
    at = np.minimum(np.searchsorted(keys[order], pairs), len(keys) - 1)
    steps = along.shape[1]
    return np.where(keys[order][at] == pairs, order[at] // steps, -1)


def _around(
    corner: Integers, on: Integers, edge: Integers, inside: Mask, kind: Integers
) -> Directed:
    """The sides of the material in triangles of some kinds, material on the left.

    Corners, zeros on the sides (-1 for none) and edges of the mesh have the shape (triangles, 3);
    ``inside`` tells where the field is positive.
    """
    design = kind == DESIGN
    full = inside[corner] | ~design[:, None]
    found, marks, kinds = [], [], []
    for i in range(3):
        j = (i + 1) % 3
        p, q, r, edges = corner[:, i], corner[:, j], on[:, i], edge[:, i]
        parts = [
            (p, q, edges, (r < 0) & full[:, i] & full[:, j]),
            (p, r, edges, (r >= 0) & full[:, i]),
            (r, q, edges, (r >= 0) & full[:, j]),
        ]
        # from where the zero line leaves the side of the material to where it comes back
        leaves = design & (r >= 0) & full[:, i] & ~full[:, j]
        for back in (on[:, j], on[:, (i + 2) % 3]):
            parts.append((r, back, np.full_like(edges, -1), leaves & (back >= 0)))
        for start, end, mark, there in parts:
            found.append(np.column_stack([start, end])[there])
            marks.append(mark[there])
            kinds.append(kind[there])
    return Directed(np.vstack(found), np.concatenate(marks), np.concatenate(kinds))


def _left_over(directed: Directed, count: int) -> Directed:
    """Directed sides without opposite pairs of the same kind, which cancel."""
    ends = directed.ends
    keys = directed.kind * count**2 + _keys(ends, count)
    keys, at = np.unique(keys, return_inverse=True)
    net = np.bincount(at, np.where(ends[:, 0] < ends[:, 1], 1, -1), len(keys)).astype(int)
    edge = np.full(len(keys), -1, dtype=np.int64)
    np.maximum.at(edge, at, directed.edge)
    kind, pair = np.divmod(keys, count**2)
    pairs = np.column_stack(np.divmod(pair, count))
    pairs[net < 0] = pairs[net < 0][:, ::-1]
    return Directed(pairs[net != 0], edge[net != 0], kind[net != 0])


def _contracted(nodes: Array, ends: Integers, rank: Integers, shortest: float) -> Integers:
    """The node that each node becomes where segments below a length are contracted."""
    short = np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1) < shortest
    label = connected(ends[short], len(nodes))
    order = np.lexsort((np.arange(len(nodes)), rank, label))
    first = np.searchsorted(label[order], np.arange(label.max(initial=-1) + 1))
    return np.asarray(order[first][label])
