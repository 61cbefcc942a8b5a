# SPDX-License-Identifier: MIT
"""Where a field is zero on a lattice: the segments between material and void.

Each triangle of a designed cell is material where the field, linear on its sides, is positive; its
corners on the zero line lie on the sides of the triangles, where the field itself is zero to
round-off. Triangles of solid cells are material. The sides of all pieces, directed with material on
the left, cancel where two pieces meet; what is left bounds the material. It is closed whatever the
field is, and follows the sides of the mesh to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .lattice import DESIGN, SOLID, VOID, Lattice

__all__ = ["Segments", "cut"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Field = Callable[[Array], Array]

#: Values of less than this distance from the zero line count as material, in units of the spacing
_SNAP = 1e-3
#: Shorter segments are contracted, in units of the longest side of a triangle
_SHORT = 0.02
#: Steps by which zeros on sides are found; each at least halves what two of them leave
_STEPS = 60
#: Points at which a field is evaluated at once
_BLOCK = 100_000


@dataclass(frozen=True, eq=False)
class Segments:
    """Directed segments between regions, material of the left kind on the left."""

    points: Array  #: (nodes, 2) [m]
    ends: Integers  #: (segments, 2) nodes
    left: Integers  #: (segments,) DESIGN or SOLID
    right: Integers  #: (segments,) VOID, or SOLID right of DESIGN
    edge: Integers  #: (segments,) edge of the mesh, -1 on the zero line of the field
    zero: NDArray[np.bool_]  #: (nodes,) where the field is zero to round-off


def evaluated(field: Field, points: Array) -> Array:
    """Values of a field given by a user, or one clear error.

    Args:
        field: Of positions (n, 2) [m].
        points: Shape (n, 2) [m].

    Raises:
        ValueError: If there is not one finite number for each point.
    """
    found = np.empty(len(points))
    for first in range(0, len(points), _BLOCK):
        part = points[first : first + _BLOCK]
        values = np.asarray(field(part), dtype=np.float64)
        if values.shape != (len(part),):
            raise ValueError(
                f"part: the field gives an array of shape {values.shape} for {len(part)} points; "
                "it must give one number for each"
            )
        found[first : first + _BLOCK] = values
    bad = ~np.isfinite(found)
    if np.any(bad):
        x, y = points[int(np.argmax(bad))]
        raise ValueError(
            f"part: the field is NaN or infinite at {int(np.count_nonzero(bad))} points, the first "
            f"({x:.6g}, {y:.6g}) m; it must be finite all over the body"
        )
    return found


def cut(lattice: Lattice, field: Field, spacing: float) -> Segments:
    """The segments between material and void, and between solid and designed cells.

    Args:
        lattice: Of the body.
        field: Positive in material, of positions (n, 2) [m].
        spacing: Length on which it varies [m].

    Raises:
        ValueError: If the field does not give one finite number for each point.
    """
    triangles, points = lattice.triangles, lattice.points
    values = evaluated(field, points)
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
    zeros = _zeros(field, points[p], points[q], values[p], values[q])
    nodes = np.vstack([points, zeros])

    side, edge = side.reshape(-1, 3), _edge_of(pairs, lattice)
    directed = [
        _directed(triangles[mine], root[side[mine]], edge[side[mine]], inside, kind)
        for kind in (DESIGN, SOLID)
        for mine in [lattice.kinds == kind]
    ]
    sides_left = _left_over(directed, len(nodes))
    # a mesh vertex, or else a point on the mesh, stays where a short segment is contracted
    rank = np.full(len(nodes), 3)
    rank[len(points) :][edge[crossed] >= 0] = 2
    rank[lattice.chains.ravel()] = 1
    rank[lattice.edges.ravel()] = 0
    name = _contracted(nodes, sides_left, rank, _SHORT * float(length.max()))
    again = []
    for pair, mark in sides_left:
        ends = name[pair]
        stays = ends[:, 0] != ends[:, 1]
        again.append((ends[stays], mark[stays]))
    zero = np.concatenate([np.zeros(len(points), dtype=bool), values[p] * values[q] < 0.0])
    return _joined(nodes, _left_over(again, len(nodes)), zero)


Directed = tuple[Integers, Integers]  # nodes (segments, 2), edge of the mesh (segments,)


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


def _directed(
    corner: Integers, on: Integers, edge: Integers, inside: NDArray[np.bool_], kind: int
) -> Directed:
    """The sides of the material in triangles of one kind, material on the left.

    Args:
        corner: Corners of the triangles, shape (triangles, 3).
        on: Zeros on their sides, -1 where there is none, shape (triangles, 3).
        edge: Edge of the mesh of each side, shape (triangles, 3).
        inside: Where the field is positive.
        kind: Of the cells.
    """
    full = inside[corner] if kind == DESIGN else np.ones(corner.shape, dtype=bool)
    found, marks = [], []
    for i in range(3):
        j = (i + 1) % 3
        p, q, r = corner[:, i], corner[:, j], on[:, i]
        parts = [
            (p, q, (r < 0) & full[:, i] & full[:, j]),
            (p, r, (r >= 0) & full[:, i]),
            (r, q, (r >= 0) & full[:, j]),
        ]
        for start, end, there in parts:
            found.append(np.column_stack([start, end])[there])
            marks.append(edge[there, i])
        if kind == DESIGN:
            # from where the zero line leaves the side of the material to where it comes back
            for back in (j, (i + 2) % 3):
                there = (r >= 0) & full[:, i] & ~full[:, j] & (on[:, back] >= 0)
                found.append(np.column_stack([r, on[:, back]])[there])
                marks.append(np.full(len(found[-1]), -1, dtype=np.int64))
    return np.vstack(found), np.concatenate(marks)


def _left_over(directed: list[Directed], count: int) -> list[Directed]:
    """What is left of directed sides, for each kind, where opposite ones cancel."""
    left = []
    for ends, marks in directed:
        keys, at = np.unique(_keys(ends, count), return_inverse=True)
        net = np.bincount(at, np.where(ends[:, 0] < ends[:, 1], 1, -1), len(keys)).astype(int)
        mark = np.full(len(keys), -1, dtype=np.int64)
        np.maximum.at(mark, at, marks)
        pairs = np.column_stack([keys // count, keys % count])
        pairs[net < 0] = pairs[net < 0][:, ::-1]
        left.append((pairs[net != 0], mark[net != 0]))
    return left


def _contracted(
    nodes: Array, directed: list[Directed], rank: Integers, shortest: float
) -> Integers:
    """The node that each node becomes where segments below a length are contracted."""
    ends = np.vstack([pair for pair, _ in directed])
    short = np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1) < shortest
    a, b = ends[short].T
    shape = (len(nodes), len(nodes))
    graph = coo_matrix((np.ones(len(a), dtype=bool), (a, b)), shape=shape)
    label = connected_components(graph, directed=False)[1]
    order = np.lexsort((np.arange(len(nodes)), rank, label))
    first = np.searchsorted(label[order], np.arange(label.max(initial=-1) + 1))
    return np.asarray(order[first][label])


def _joined(nodes: Array, directed: list[Directed], zero: NDArray[np.bool_]) -> Segments:
    """Segments of both kinds, each once: where both meet, the designed one stays."""
    (design, of_design), (solid, of_solid) = directed
    count = len(nodes)
    inner = np.isin(_keys(design, count), _keys(solid, count))
    outer = ~np.isin(_keys(solid, count), _keys(design, count))
    ends = np.vstack([design, solid[outer]])
    left = np.concatenate([np.full(len(design), DESIGN), np.full(np.count_nonzero(outer), SOLID)])
    right = np.concatenate([np.where(inner, SOLID, VOID), np.full(np.count_nonzero(outer), VOID)])
    return Segments(nodes, ends, left, right, np.concatenate([of_design, of_solid[outer]]), zero)


def _zeros(field: Field, a: Array, b: Array, at_a: Array, at_b: Array) -> Array:
    """Where a field is zero on straight lines, shape (lines, 2) [m].

    The method of Anderson and Bjoerck, BIT 13 (1973), doi:10.1007/BF01933951: regula falsi that
    shrinks the bracket from both sides. Without a change of sign it is the end nearer to zero.
    """
    s, t = np.zeros(len(a)), np.ones(len(a))
    f, g = at_a.copy(), at_b.copy()
    found = np.where(np.abs(f) <= np.abs(g), s, t)
    active = np.flatnonzero(f * g < 0.0)
    size = np.maximum(np.abs(f), np.abs(g))
    for step in range(_STEPS):
        if not len(active):
            break
        i = active
        u = t[i] - g[i] * (t[i] - s[i]) / (g[i] - f[i])
        if step % 4 == 3:  # whatever the field is, the bracket gets shorter
            u = 0.5 * (s[i] + t[i])
        value = evaluated(field, a[i] + u[:, None] * (b[i] - a[i]))
        turned = value * g[i] < 0.0
        shrink = 1.0 - value / np.where(g[i] == 0.0, 1.0, g[i])
        shrink = np.where(shrink > 0.0, shrink, 0.5)
        s[i], f[i] = np.where(turned, t[i], s[i]), np.where(turned, g[i], f[i] * shrink)
        t[i], g[i] = u, value
        found[i] = u
        done = (np.abs(value) <= 1e-14 * size[i]) | (np.abs(t[i] - s[i]) < 1e-14)
        active = i[~done]
    return np.asarray(a + found[:, None] * (b - a))
