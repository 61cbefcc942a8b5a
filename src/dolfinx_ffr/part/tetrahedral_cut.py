# SPDX-License-Identifier: MIT
"""Tetrahedra of a body cut along the zero surface of a field, without slivers.

What is left fits the surface, and is cells of finite elements at the same time: corners next to
the surface are moved onto it, then the tetrahedra that it passes are cut (isosurface stuffing,
F. Labelle and J. R. Shewchuk, doi:10.1145/1276377.1276448, on the tetrahedra of the body instead
of a lattice). Corners on the outline of the body, and of regions that are not designed, move within
it only: edges and interfaces stay where they are. So interfaces need not be found again, and a
topology that a mesher of surfaces could not follow is cut like any other.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components

from .. import validation
from ..fem import DESIGNED, SOLID, VOID, Tetrahedra

__all__ = ["SIDES", "cut_tetrahedra", "outer_faces", "pieces", "volumes"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

#: Corners closer than this to the surface are moved onto it, in units of the edge on which it is
_NEAR = 0.25
#: Corners that cannot move count as on the surface if they are closer than this
_ON_IT = 0.05
#: Smallest volume of a tetrahedron whose corners have moved, in units of what it was
_FLAT = 0.15
#: Steps in which the zero of the field on an edge is found
_STEPS = 8
#: Faces opposite of the corners, turned outwards
SIDES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def cut_tetrahedra(body: Tetrahedra, field: Callable[[Array], ArrayLike]) -> Tetrahedra:
    """The part of tetrahedra in which a field is positive, and those that stay solid.

    Args:
        body: All tetrahedra of a body.
        field: Positive in material: a function of positions (n, 3) [m] that gives (n,) numbers.

    Raises:
        ValueError: If the field is not finite.
    """

    def level_at(x: Array) -> Array:
        return validation.real_array("solid: field", field(x), (len(x),)).copy()

    points, cells = body.points.copy(), body.cells
    level = level_at(points)
    edges = _unique_edges(cells[body.regions != VOID])
    edges = edges[level[edges[:, 0]] * level[edges[:, 1]] < 0.0]
    share = _zeros(points, edges, level, level_at)
    places = points[edges[:, 0]] + share[:, None] * (points[edges[:, 1]] - points[edges[:, 0]])
    _move_near(points, level, edges, share, places, cells, _patches(body))
    still = level[edges[:, 0]] * level[edges[:, 1]] < 0.0
    edges, places = edges[still], places[still]
    return _cut(body, points, level, edges, places, level_at)


def volumes(points: Array, cells: Integers) -> Array:
    """Volume of tetrahedra, negative where the corners are turned, shape (cells,) [m^3].

    Args:
        points: Shape (points, 3) [m].
        cells: Shape (cells, 4).
    """
    a, b, c, d = np.moveaxis(points[cells], 1, 0)
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)) / 6.0


def outer_faces(cells: Integers) -> tuple[Integers, Integers, Integers]:
    """Faces that belong to one cell only, and which cells meet in a face.

    Args:
        cells: Corners of positive tetrahedra, shape (cells, 4).

    Returns:
        Corners of the faces, turned outwards, (faces, 3); the cell and the corner opposite of it of
        each, as 4 times the cell plus the corner, (faces,); pairs of cells, (pairs, 2).

    Raises:
        ValueError: If there are too many corners for their numbers to be told apart.
    """
    if cells.max(initial=0) >= 2**21:
        raise ValueError(
            f"solid: {cells.max() + 1:,} corners are more than the {2**21:,} that can be told "
            "apart; ask for a larger size or fewer meshes"
        )
    faces = cells[:, SIDES].reshape(-1, 3)
    key = np.sort(faces, axis=1) @ np.array([2**42, 2**21, 1])
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    twice = np.zeros(len(key), dtype=bool)
    twice[order[1:][same]] = True
    twice[order[:-1][same]] = True
    alone = np.flatnonzero(~twice)
    pairs = np.column_stack([order[:-1][same], order[1:][same]]) // 4
    return faces[alone], alone, pairs


def pieces(cells: Integers, pairs: Integers) -> Integers:
    """Number of the connected piece of each cell: cells hold together by faces, (cells,).

    Args:
        cells: Shape (cells, 4).
        pairs: Of cells that share a face, shape (pairs, 2).
    """
    n = len(cells)
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1])


def _unique_edges(cells: Integers) -> Integers:
    """Pairs of corners, the smaller number first, (edges, 2)."""
    key = np.unique(np.sort(cells[:, _EDGES].reshape(-1, 2), axis=1) @ np.array([2**32, 1]))
    return np.column_stack([key // 2**32, key % 2**32])


def _zeros(
    points: Array, edges: Integers, level: Array, level_at: Callable[[Array], Array]
) -> Array:
    """Where on each edge the field is zero, as a share of it: regula falsi, Illinois' way."""
    if not len(edges):
        return np.zeros(0)
    start, way = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    low, high = np.zeros(len(edges)), np.ones(len(edges))
    at_low, at_high = level[edges[:, 0]].copy(), level[edges[:, 1]].copy()
    share = at_low / (at_low - at_high)
    side = np.zeros(len(edges))
    for _ in range(_STEPS):
        value = level_at(start + share[:, None] * way)
        left = value * at_low > 0.0
        at_high = np.where(left, np.where(side > 0, 0.5 * at_high, at_high), value)
        at_low = np.where(left, value, np.where(side < 0, 0.5 * at_low, at_low))
        low, high = np.where(left, share, low), np.where(left, high, share)
        side = np.where(left, 1.0, -1.0)
        apart = at_low - at_high
        share = np.where(
            apart == 0.0,
            share,
            (at_low * high - at_high * low) / np.where(apart == 0.0, 1.0, apart),
        )
        share = np.clip(share, low, high)
    return np.asarray(share)


def _patches(body: Tetrahedra) -> csr_matrix:
    """On which flat pieces of the outline and of regions' boundaries each point lies."""
    corners, tags = [], []
    for region in (DESIGNED, SOLID, VOID):
        chosen = body.regions == region
        faces, of, _ = outer_faces(body.cells[chosen])
        corners.append(faces)
        tags.append(body.facets[chosen].ravel()[of])
    faces, tag = np.concatenate(corners), np.concatenate(tags)
    a, b, c = np.moveaxis(body.points[faces], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # either side of a region's boundary has the same plane
    largest = np.argmax(np.abs(normal), axis=1)[:, None]
    normal *= np.sign(np.take_along_axis(normal, largest, axis=1))
    extent = float(np.max(np.ptp(body.points, axis=0)))
    offset = np.einsum("ij,ij->i", normal, a - body.points.min(axis=0)) / extent
    plane = np.column_stack([normal, offset, tag])
    plane = np.floor(plane / 1e-7 + 0.3127).astype(np.int64)
    _, patch = np.unique(plane, axis=0, return_inverse=True)
    shape = len(body.points), int(patch.max(initial=-1)) + 1
    pair = faces.ravel(), np.repeat(patch, 3)
    found = coo_matrix((np.ones(faces.size, dtype=np.int32), pair), shape=shape).tocsr()
    found.data[:] = 1
    return found


def _move_near(
    points: Array,
    level: Array,
    edges: Integers,
    share: Array,
    places: Array,
    cells: Integers,
    patches: csr_matrix,
) -> None:
    """Move points next to the surface onto it, and set their level to zero."""
    if not len(edges):
        return
    # both directions of each edge
    point = np.concatenate([edges[:, 0], edges[:, 1]])
    other = np.concatenate([edges[:, 1], edges[:, 0]])
    away = np.concatenate([share, 1.0 - share])
    place = np.vstack([places, places])
    common = np.asarray(patches[point].multiply(patches[other]).sum(axis=1)).ravel()
    free = common == np.asarray(patches.sum(axis=1)).ravel()[point]
    before, given = points.copy(), level.copy()
    near = free & (away < _NEAR)
    # the nearest of its zeros
    order = np.flatnonzero(near)[np.argsort(away[near], kind="stable")]
    chosen, first = np.unique(point[order], return_index=True)
    points[chosen] = place[order[first]]
    level[chosen] = 0.0
    size = np.abs(volumes(before, cells))
    moved = np.zeros(len(points), dtype=bool)
    moved[chosen] = True
    turned = np.sign(volumes(before, cells))
    while True:
        flat = turned * volumes(points, cells) < _FLAT * size
        back = np.unique(cells[flat])
        back = back[moved[back]]
        if not len(back):
            break
        points[back], level[back], moved[back] = before[back], given[back], False
    stuck = away < _ON_IT
    level[point[stuck & ~moved[point]]] = 0.0


def _cut(
    body: Tetrahedra,
    points: Array,
    level: Array,
    edges: Integers,
    places: Array,
    level_at: Callable[[Array], Array],
) -> Tetrahedra:
    """What is left of the tetrahedra at given zeros of their edges."""
    every = np.vstack([points, places])
    sign = np.sign(level)
    cells, facets, regions = body.cells, body.facets, body.regions
    signs = sign[cells]
    flat = np.flatnonzero(np.all(signs == 0.0, axis=1))
    if len(flat):
        signs[flat] = np.sign(level_at(every[cells[flat]].mean(axis=1)))[:, None]
    above, below = np.any(signs > 0.0, axis=1), np.any(signs < 0.0, axis=1)
    passed = above & below & (regions != VOID)
    whole = np.where(regions == SOLID, ~passed, above & ~below & (regions == DESIGNED))
    found = [(cells[whole], facets[whole], regions[whole])]
    # of solid tetrahedra both sides stay: so they meet the designed ones in whole faces
    for region, side in ((DESIGNED, 1.0), (SOLID, 1.0), (SOLID, -1.0)):
        chosen = np.flatnonzero(passed & (regions == region))
        corners, tags = _one_side(
            cells[chosen], facets[chosen], side * signs[chosen], edges, len(points), every
        )
        found.append((corners, tags, np.full(len(corners), region)))
    cells, facets, regions = (np.concatenate(part) for part in zip(*found, strict=True))
    turned = volumes(every, cells) < 0.0
    cells[turned] = cells[turned][:, [1, 0, 2, 3]]
    facets[turned] = facets[turned][:, [1, 0, 2, 3]]
    used, cells = np.unique(cells, return_inverse=True)
    return Tetrahedra(every[used], cells.reshape(-1, 4), facets, regions)


def _one_side(
    cells: Integers, facets: Integers, signs: Array, edges: Integers, first: int, points: Array
) -> tuple[Integers, Integers]:
    """Tetrahedra on the positive side, and their interfaces, of ones with both signs.

    Args:
        cells: Shape (cells, 4).
        facets: Interfaces, shape (cells, 4).
        signs: Of the corners, shape (cells, 4).
        edges: That have a zero, sorted, shape (edges, 2).
        first: Number of the zero of the first edge.
        points: Of corners and zeros [m].
    """
    key = edges @ np.array([2**32, 1])
    found, tags = [np.zeros((0, 4), dtype=np.int64)], [np.zeros((0, 4), dtype=np.int64)]
    # corners inside first, then those on the surface, then those outside, by their numbers each:
    # quadrilaterals are then divided alike from both sides
    order = np.lexsort((cells, -signs), axis=1)
    cells, facets = np.take_along_axis(cells, order, 1), np.take_along_axis(facets, order, 1)
    signs = np.take_along_axis(signs, order, 1)
    inside, outside = np.sum(signs > 0.0, axis=1), np.sum(signs < 0.0, axis=1)

    def zero(chosen: Integers, i: int, j: int) -> Integers:
        pair = np.sort(cells[chosen][:, [i, j]], axis=1) @ np.array([2**32, 1])
        return first + np.searchsorted(key, pair)

    def add(chosen: Integers, corners: list[int | tuple[int, int]]) -> None:
        """Tetrahedra by corners of theirs, and zeros between an inner and an outer one."""
        new = [cells[chosen, c] if isinstance(c, int) else zero(chosen, *c) for c in corners]
        made_of = [{c} if isinstance(c, int) else set(c) for c in corners]
        tag = np.full((len(chosen), 4), -1, dtype=np.int64)
        for i in range(4):
            needed = set().union(*(made_of[j] for j in range(4) if j != i))
            if len(needed) == 3:
                tag[:, i] = facets[chosen, ({0, 1, 2, 3} - needed).pop()]
        found.append(np.column_stack(new))
        tags.append(tag)

    def where(p: int, n: int) -> Integers:
        return np.flatnonzero((inside == p) & (outside == n))

    add(where(1, 1), [0, 1, 2, (0, 3)])
    add(where(1, 2), [0, 1, (0, 2), (0, 3)])
    add(where(1, 3), [0, (0, 1), (0, 2), (0, 3)])
    pyramid = where(2, 1)
    add(pyramid, [0, 1, 2, (1, 3)])
    add(pyramid, [0, (0, 3), 2, (1, 3)])
    prism = where(3, 1)
    add(prism, [0, (0, 3), (1, 3), (2, 3)])
    add(prism, [0, 1, (1, 3), (2, 3)])
    add(prism, [0, 1, 2, (2, 3)])
    wedge = where(2, 2)
    add(wedge, [0, 1, (1, 2), (1, 3)])
    # of the quadrilateral on the surface the shorter diagonal
    one = points[zero(wedge, 0, 2)] - points[zero(wedge, 1, 3)]
    two = points[zero(wedge, 0, 3)] - points[zero(wedge, 1, 2)]
    shorter = np.einsum("ij,ij->i", one, one) < np.einsum("ij,ij->i", two, two)
    add(wedge[shorter], [0, (0, 2), (0, 3), (1, 3)])
    add(wedge[shorter], [0, (0, 2), (1, 3), (1, 2)])
    add(wedge[~shorter], [0, (0, 2), (0, 3), (1, 2)])
    add(wedge[~shorter], [0, (0, 3), (1, 3), (1, 2)])
    return np.concatenate(found), np.concatenate(tags)
