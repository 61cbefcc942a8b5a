# SPDX-License-Identifier: MIT
"""Tetrahedra of a body cut along the zero surface of a field, without slivers.

Corners next to the surface are moved onto it, then the tetrahedra that it passes are cut
(isosurface stuffing, F. Labelle and J. R. Shewchuk, doi:10.1145/1276377.1276448, on the tetrahedra
of the body instead of a lattice). Corners on the outline of the body, and of regions that are not
designed, move within it only: edges and interfaces stay where they are.

A surface that runs through corners can touch itself in them, or in edges between them, where it is
no surface of a solid. Such corners are counted as outside, and what is around them is cut off at a
quarter of the edges: the zero surface of a field that is zero at no corner does not touch itself.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from ..arrays import Array, Integers
from ..fem import DESIGNED, SOLID, VOID, ShapeError, Tetrahedra, connected
from .field import Field, evaluated, refuse_zero, zeros_between

#: Corners closer than this to the surface are moved onto it, in units of the edge on which it is
_NEAR = 0.25
#: Level of corners that are counted as outside, which only its sign matters of
_SMALLEST = 1e-300
#: Corners that cannot move count as on the surface if they are closer than this
_ON_IT = 0.05
#: Smallest volume of a tetrahedron whose corners have moved, in units of what it was
_FLAT = 0.15
#: Times that corners are looked for at which the surface touches itself
_ROUNDS = 20
#: Faces opposite of the corners, turned outwards
SIDES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
#: By numbers of corners inside and outside, which are the first and the last, tetrahedra inside: of
#: corners, and of zeros between an inner and an outer one
_TEMPLATES: dict[tuple[int, int], list[tuple[int | tuple[int, int], ...]]] = {
    (1, 1): [(0, 1, 2, (0, 3))],
    (1, 2): [(0, 1, (0, 2), (0, 3))],
    (1, 3): [(0, (0, 1), (0, 2), (0, 3))],
    (2, 1): [(0, 1, 2, (1, 3)), (0, (0, 3), 2, (1, 3))],
    (3, 1): [(0, (0, 3), (1, 3), (2, 3)), (0, 1, (1, 3), (2, 3)), (0, 1, 2, (2, 3))],
    (2, 2): [(0, 1, (1, 2), (1, 3))],
}
_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def cut_tetrahedra(body: Tetrahedra, field: Field) -> Tetrahedra:
    """The part of a body's tetrahedra in which a field is positive, and those that stay solid."""
    points, cells = body.points.copy(), body.cells
    level = evaluated(field, points)
    refuse_zero("solid", level, cells[body.regions == DESIGNED])
    every = _unique_edges(cells[body.regions != VOID])
    edges = every[level[every[:, 0]] * level[every[:, 1]] < 0.0]
    start, end = points[edges.T]
    share = zeros_between(field, start, end, *level[edges.T])
    zeros = start + share[:, None] * (end - start)
    _move_near(points, level, edges, share, zeros, cells, _patches(body))
    still = level[edges[:, 0]] * level[edges[:, 1]] < 0.0
    edges, zeros = edges[still], zeros[still]
    for _ in range(_ROUNDS):
        found, used = _cut(body, points, level, edges, zeros, field)
        corners = used[touching(outer_faces(found.cells)[0])]
        corners = corners[corners < len(points)]
        corners = corners[level[corners] == 0.0]
        if not len(corners):
            break
        level[corners] = -_SMALLEST
        outside = np.isin(every, corners)
        new = np.any(outside, axis=1) & np.any(level[every] > 0.0, axis=1)
        # from the corner to the one inside
        pairs, turned = every[new], outside[new][:, 1:]
        start, end = points[np.where(turned, pairs[:, ::-1], pairs)].swapaxes(0, 1)
        edges = np.concatenate([edges, pairs])
        zeros = np.concatenate([zeros, start + _NEAR * (end - start)])
        order = np.lexsort((edges[:, 1], edges[:, 0]))
        edges, zeros = edges[order], zeros[order]
    return found


def volumes(points: Array, cells: Integers) -> Array:
    """Volume of tetrahedra (cells, 4), negative where the corners are turned, (cells,) [m^3]."""
    a, b, c, d = np.moveaxis(points[cells], 1, 0)
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)) / 6.0


def outer_faces(cells: Integers) -> tuple[Integers, Integers, Integers]:
    """Faces that belong to one of some tetrahedra (cells, 4) only, and which cells share a face.

    Corners of the faces, turned outwards, (faces, 3); for each 4 times its cell plus the corner
    opposite of it, (faces,); pairs of cells, (pairs, 2).
    """
    if cells.max(initial=0) >= 2**21:
        raise ShapeError(
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


def touching(triangles: Integers) -> Integers:
    """Vertices at which a closed surface touches itself: it is no 2-manifold there, (vertices,)."""
    # each corner of a triangle with both of its edges
    corner = triangles.ravel()
    first = np.repeat(np.arange(len(triangles)), 3) * 3
    zero_of = np.tile(np.arange(3), len(triangles))
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    key = sides @ np.array([2**32, 1])
    order = np.argsort(key, kind="stable")
    _, start, count = np.unique(key[order], return_index=True, return_counts=True)
    odd = np.unique(sides[order[start[count != 2]]])
    one, other = order[start[count == 2]], order[start[count == 2] + 1]
    # an edge of a corner and the next one, with the other triangle's, in which it runs backwards
    after = first + (zero_of + 1) % 3
    rows, columns = np.concatenate([one, after[one]]), np.concatenate([after[other], other])
    fan = connected(np.column_stack([rows, columns]), len(corner))
    pairs = np.unique(np.column_stack([corner, fan]), axis=0)
    vertices, fans = np.unique(pairs[:, 0], return_counts=True)
    return np.union1d(odd, vertices[fans > 1])


def _unique_edges(cells: Integers) -> Integers:
    """Pairs of corners, the smaller number first, (edges, 2)."""
    key = np.unique(np.sort(cells[:, _EDGES].reshape(-1, 2), axis=1) @ np.array([2**32, 1]))
    return np.column_stack([key // 2**32, key % 2**32])


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
    zeros: Array,
    cells: Integers,
    patches: csr_matrix,
) -> None:
    """Move points next to the surface onto it, and set their level to zero."""
    if not len(edges):
        return
    # both directions of each edge
    point, other = edges.T.ravel(), edges.T[::-1].ravel()
    away = np.concatenate([share, 1.0 - share])
    zero_of = np.vstack([zeros, zeros])
    common = np.asarray(patches[point].multiply(patches[other]).sum(axis=1)).ravel()
    free = common == np.asarray(patches.sum(axis=1)).ravel()[point]
    before, given = points.copy(), level.copy()
    near = free & (away < _NEAR)
    # the nearest of its zeros
    order = np.flatnonzero(near)[np.argsort(away[near], kind="stable")]
    chosen, first = np.unique(point[order], return_index=True)
    points[chosen] = zero_of[order[first]]
    level[chosen] = 0.0
    size = volumes(before, cells)
    moved = np.zeros(len(points), dtype=bool)
    moved[chosen] = True
    while True:
        flat = np.sign(size) * volumes(points, cells) < _FLAT * np.abs(size)
        back = np.unique(cells[flat])
        back = back[moved[back]]
        if not len(back):
            break
        points[back], level[back], moved[back] = before[back], given[back], False
    stuck = away < _ON_IT
    level[point[stuck & ~moved[point]]] = 0.0


def _cut(
    body: Tetrahedra, points: Array, level: Array, edges: Integers, zeros: Array, field: Field
) -> tuple[Tetrahedra, Integers]:
    """The tetrahedra cut at given zeros of their edges, and the old numbers of their points."""
    every = np.vstack([points, zeros])
    sign = np.sign(level)
    cells, facets, regions = body.cells, body.facets, body.regions
    signs = sign[cells]
    flat = np.flatnonzero(np.all(signs == 0.0, axis=1))
    if len(flat):
        signs[flat] = np.sign(evaluated(field, every[cells[flat]].mean(axis=1)))[:, None]
    above, below = np.any(signs > 0.0, axis=1), np.any(signs < 0.0, axis=1)
    passed = above & below & (regions != VOID)
    whole = np.where(regions == SOLID, ~passed, above & ~below & (regions == DESIGNED))
    found = [(cells[whole], facets[whole], regions[whole])]
    # of solid tetrahedra both sides stay: so they meet the designed ones in whole faces
    for region, side in ((DESIGNED, 1.0), (SOLID, 1.0), (SOLID, -1.0)):
        chosen = np.flatnonzero(passed & (regions == region))
        own = cells[chosen], facets[chosen], side * signs[chosen]
        corners, tags = _one_side(*own, edges, len(points), every)
        found.append((corners, tags, np.full(len(corners), region)))
    cells, facets, regions = (np.concatenate(part) for part in zip(*found, strict=True))
    turned = volumes(every, cells) < 0.0
    cells[turned] = cells[turned][:, [1, 0, 2, 3]]
    facets[turned] = facets[turned][:, [1, 0, 2, 3]]
    used, cells = np.unique(cells, return_inverse=True)
    return Tetrahedra(every[used], cells.reshape(-1, 4), facets, regions), used


def _one_side(
    cells: Integers, facets: Integers, signs: Array, edges: Integers, first: int, points: Array
) -> tuple[Integers, Integers]:
    """Tetrahedra on the positive side of some with both signs, and their interfaces, (cells, 4).

    The ``first`` of the points is the zero of the first of the edges (edges, 2), which are sorted.
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

    def add(chosen: Integers, corners: tuple[int | tuple[int, int], ...]) -> None:
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

    for (p, n), tetrahedra in _TEMPLATES.items():
        for corners in tetrahedra:
            add(where(p, n), corners)
    wedge = where(2, 2)
    # of the quadrilateral on the surface the shorter diagonal
    one = points[zero(wedge, 0, 2)] - points[zero(wedge, 1, 3)]
    two = points[zero(wedge, 0, 3)] - points[zero(wedge, 1, 2)]
    shorter = np.einsum("ij,ij->i", one, one) < np.einsum("ij,ij->i", two, two)
    add(wedge[shorter], (0, (0, 2), (0, 3), (1, 3)))
    add(wedge[shorter], (0, (0, 2), (1, 3), (1, 2)))
    add(wedge[~shorter], (0, (0, 2), (0, 3), (1, 2)))
    add(wedge[~shorter], (0, (0, 3), (1, 3), (1, 2)))
    return np.concatenate(found), np.concatenate(tags)
