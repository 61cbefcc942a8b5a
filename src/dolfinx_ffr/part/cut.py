# SPDX-License-Identifier: MIT
"""Where a field is zero on a lattice: the segments between material and void.

Each triangle of a designed cell is material where the field, linear on its sides, is positive;
triangles of solid cells are material. The sides of all pieces, directed with material on the left,
cancel where two pieces meet; the others bound the material. Their line is closed whatever the field
is, and follows the sides of the mesh to the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Integers, Mask
from ..fem import connected
from .field import Field, evaluated, refuse_zero, zeros_between
from .lattice import DESIGN, SOLID, VOID, Lattice
from .options import CURVES


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

    # sides of all triangles, once each, from a to b
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    pairs, side = np.unique(_keys(sides, len(points)), return_inverse=True)
    a, b = pairs // len(points), pairs % len(points)
    length = np.linalg.norm(points[b] - points[a], axis=1)
    slope = np.zeros(len(points))
    np.maximum.at(slope, a, np.abs(values[b] - values[a]) / length)
    np.maximum.at(slope, b, np.abs(values[b] - values[a]) / length)
    is_inside = values >= -CURVES.snap * spacing * slope

    # zeros on the sides with one end inside
    is_crossed = is_inside[a] != is_inside[b]
    zero_on = np.full(len(pairs), -1, dtype=np.int64)
    zero_on[is_crossed] = len(points) + np.arange(np.count_nonzero(is_crossed))
    p, q = a[is_crossed], b[is_crossed]
    share = zeros_between(field, points[p], points[q], values[p], values[q])[:, None]
    nodes = np.vstack([points, points[p] + share * (points[q] - points[p])])

    side, edge = side.reshape(-1, 3), _edge_of(pairs, lattice)
    in_body = lattice.kinds != VOID
    around = _around(
        triangles[in_body],
        zero_on[side[in_body]],
        edge[side[in_body]],
        is_inside,
        lattice.kinds[in_body],
    )
    bounds = _without_opposites(around, len(nodes))

    # a mesh vertex, or else a point on the mesh, stays where a short segment is contracted
    rank = np.full(len(nodes), 3)
    rank[len(points) :][edge[is_crossed] >= 0] = 2
    rank[lattice.chains.ravel()] = 1
    rank[lattice.edges.ravel()] = 0
    ends = _contracted(nodes, bounds.ends, rank, CURVES.short * float(length.max()))[bounds.ends]
    stays = ends[:, 0] != ends[:, 1]
    contracted = Directed(ends[stays], bounds.edge[stays], bounds.kind[stays])
    bounds = _without_opposites(contracted, len(nodes))

    # where designed and solid cells meet, both have a segment, and the designed one stays
    keys, is_design = _keys(bounds.ends, len(nodes)), bounds.kind == DESIGN
    stays = is_design | ~np.isin(keys, keys[is_design])
    beside_solid = is_design & np.isin(keys, keys[~is_design])
    right = np.where(beside_solid, SOLID, VOID)
    is_zero = np.concatenate([np.zeros(len(points), dtype=bool), values[p] * values[q] < 0.0])
    return Segments(
        nodes, bounds.ends[stays], bounds.kind[stays], right[stays], bounds.edge[stays], is_zero
    )


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
    corner: Integers, zero_on: Integers, edge: Integers, is_inside: Mask, kind: Integers
) -> Directed:
    """The sides of the material in triangles of some kinds, material on the left.

    Corners, zeros on the sides (-1 for none) and edges of the mesh have the shape (triangles, 3);
    ``is_inside`` tells where the field is positive.
    """
    is_design = kind == DESIGN
    is_material = is_inside[corner] | ~is_design[:, None]
    ends, edges, kinds = [], [], []
    for i in range(3):
        j = (i + 1) % 3
        p, q, zero, on_edge = corner[:, i], corner[:, j], zero_on[:, i], edge[:, i]
        at_p, at_q, is_cut = is_material[:, i], is_material[:, j], zero >= 0
        parts_of_side = [
            (p, q, on_edge, ~is_cut & at_p & at_q),
            (p, zero, on_edge, is_cut & at_p),
            (zero, q, on_edge, is_cut & at_q),
        ]
        # from where the zero line leaves the side of the material to where it comes back
        leaves = is_design & is_cut & at_p & ~at_q
        for back in (zero_on[:, j], zero_on[:, (i + 2) % 3]):
            within = np.full_like(on_edge, -1)
            parts_of_side.append((zero, back, within, leaves & (back >= 0)))
        for start, end, mark, chosen in parts_of_side:
            ends.append(np.column_stack([start, end])[chosen])
            edges.append(mark[chosen])
            kinds.append(kind[chosen])
    return Directed(np.vstack(ends), np.concatenate(edges), np.concatenate(kinds))


def _without_opposites(directed: Directed, count: int) -> Directed:
    """Directed sides without opposite pairs of the same kind, which cancel.

    ``count`` is the number of points.
    """
    # one key for both directions of a side
    ends = directed.ends
    keys = directed.kind * count**2 + _keys(ends, count)
    keys, key_of_side = np.unique(keys, return_inverse=True)

    # how many go from the point of the lower number to the other one more than back
    direction = np.where(ends[:, 0] < ends[:, 1], 1, -1)
    net = np.bincount(key_of_side, direction, len(keys)).astype(int)
    edge = np.full(len(keys), -1, dtype=np.int64)
    np.maximum.at(edge, key_of_side, directed.edge)

    kind, pair = np.divmod(keys, count**2)
    pairs = np.column_stack(np.divmod(pair, count))
    pairs[net < 0] = pairs[net < 0][:, ::-1]
    return Directed(pairs[net != 0], edge[net != 0], kind[net != 0])


def _contracted(nodes: Array, ends: Integers, rank: Integers, shortest: float) -> Integers:
    """The node that each node becomes where segments below a length are contracted."""
    is_short = np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1) < shortest
    label = connected(ends[is_short], len(nodes))
    order = np.lexsort((np.arange(len(nodes)), rank, label))
    first = np.searchsorted(label[order], np.arange(label.max(initial=-1) + 1))
    return np.asarray(order[first][label])
