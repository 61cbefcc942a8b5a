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
from .options import SOLIDS

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
    all_edges = _unique_edges(cells[body.regions != VOID])
    edges = all_edges[level[all_edges[:, 0]] * level[all_edges[:, 1]] < 0.0]
    start, end = points[edges.T]
    share = zeros_between(field, start, end, *level[edges.T])
    zeros = start + share[:, None] * (end - start)
    _move_near(points, level, edges, share, zeros, cells, _patches(body))
    is_crossed = level[edges[:, 0]] * level[edges[:, 1]] < 0.0
    edges, zeros = edges[is_crossed], zeros[is_crossed]
    for _ in range(SOLIDS.rounds):
        solid, used = _cut(body, points, level, edges, zeros, field)
        corners = used[touching(outer_faces(solid.cells)[0])]
        corners = corners[corners < len(points)]
        corners = corners[level[corners] == 0.0]
        if not len(corners):
            break
        level[corners] = SOLIDS.outside
        is_outside = np.isin(all_edges, corners)
        is_new = np.any(is_outside, axis=1) & np.any(level[all_edges] > 0.0, axis=1)
        # from the corner to the one inside
        pairs, turned = all_edges[is_new], is_outside[is_new][:, 1:]
        start, end = points[np.where(turned, pairs[:, ::-1], pairs)].swapaxes(0, 1)
        edges = np.concatenate([edges, pairs])
        zeros = np.concatenate([zeros, start + SOLIDS.near * (end - start)])
        order = np.lexsort((edges[:, 1], edges[:, 0]))
        edges, zeros = edges[order], zeros[order]
    return solid


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
            f"solid: {cells.max() + 1:,} corners are more than the limit of {2**21:,}; take a "
            "larger size or fewer meshes"
        )
    faces = cells[:, SIDES].reshape(-1, 3)
    key = np.sort(faces, axis=1) @ np.array([2**42, 2**21, 1])
    order = np.argsort(key, kind="stable")
    is_repeated = key[order][1:] == key[order][:-1]
    first, second = order[:-1][is_repeated], order[1:][is_repeated]
    is_shared = np.zeros(len(key), dtype=bool)
    is_shared[first] = is_shared[second] = True
    outer = np.flatnonzero(~is_shared)
    return faces[outer], outer, np.column_stack([first, second]) // 4


def touching(triangles: Integers) -> Integers:
    """Vertices at which a closed surface touches itself: it is no 2-manifold there, (vertices,)."""
    # number 3 t + k is that of corner k of triangle t and of the edge from there to the next corner
    vertex = triangles.ravel()
    first_corner = np.repeat(np.arange(len(triangles)), 3) * 3
    corner_in_triangle = np.tile(np.arange(3), len(triangles))
    following = first_corner + (corner_in_triangle + 1) % 3

    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    key = edges @ np.array([2**32, 1])
    order = np.argsort(key, kind="stable")
    _, start, count = np.unique(key[order], return_index=True, return_counts=True)
    at_odd_edges = np.unique(edges[order[start[count != 2]]])
    a, b = order[start[count == 2]], order[start[count == 2] + 1]

    # corners of one vertex are in one fan if edges connect their triangles; the edge of the second
    # triangle runs backwards, so that it begins where that of the first one ends
    corners_of_first = np.concatenate([a, following[a]])
    corners_of_second = np.concatenate([following[b], b])
    fan = connected(np.column_stack([corners_of_first, corners_of_second]), len(vertex))

    # at a vertex of a 2-manifold there is one fan
    pairs = np.unique(np.column_stack([vertex, fan]), axis=0)
    vertices, fans = np.unique(pairs[:, 0], return_counts=True)
    return np.union1d(at_odd_edges, vertices[fans > 1])


def _unique_edges(cells: Integers) -> Integers:
    """Pairs of corners, the smaller number first, (edges, 2)."""
    key = np.unique(np.sort(cells[:, _EDGES].reshape(-1, 2), axis=1) @ np.array([2**32, 1]))
    return np.column_stack([key // 2**32, key % 2**32])


def _patches(body: Tetrahedra) -> csr_matrix:
    """On which flat pieces of the outline and of regions' boundaries each point lies."""
    corners, tags = [], []
    for region in (DESIGNED, SOLID, VOID):
        chosen = body.regions == region
        faces, numbers, _ = outer_faces(body.cells[chosen])
        corners.append(faces)
        tags.append(body.facets[chosen].ravel()[numbers])
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
    incidence = coo_matrix((np.ones(faces.size, dtype=np.int32), pair), shape=shape).tocsr()
    incidence.data[:] = 1
    return incidence


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
    point, opposite = edges.T.ravel(), edges.T[::-1].ravel()
    distance = np.concatenate([share, 1.0 - share])
    zero_of = np.vstack([zeros, zeros])
    common = np.asarray(patches[point].multiply(patches[opposite]).sum(axis=1)).ravel()
    # a point moves along edges that lie on all of its patches
    is_free = common == np.asarray(patches.sum(axis=1)).ravel()[point]
    unmoved, first_level = points.copy(), level.copy()
    is_near = is_free & (distance < SOLIDS.near)
    # the nearest of its zeros
    order = np.flatnonzero(is_near)[np.argsort(distance[is_near], kind="stable")]
    chosen, first = np.unique(point[order], return_index=True)
    points[chosen] = zero_of[order[first]]
    level[chosen] = 0.0
    volume = volumes(unmoved, cells)
    is_moved = np.zeros(len(points), dtype=bool)
    is_moved[chosen] = True
    while True:
        is_flat = np.sign(volume) * volumes(points, cells) < SOLIDS.flat * np.abs(volume)
        back = np.unique(cells[is_flat])
        back = back[is_moved[back]]
        if not len(back):
            break
        points[back], level[back], is_moved[back] = unmoved[back], first_level[back], False
    level[point[(distance < SOLIDS.on_it) & ~is_moved[point]]] = 0.0


def _cut(
    body: Tetrahedra, points: Array, level: Array, edges: Integers, zeros: Array, field: Field
) -> tuple[Tetrahedra, Integers]:
    """The tetrahedra cut at given zeros of their edges, and the old numbers of their points."""
    all_points = np.vstack([points, zeros])
    cells, facets, regions = body.cells, body.facets, body.regions
    signs = np.sign(level)[cells]
    # the corners of some tetrahedra are all on the surface: the middles tell their sides
    flat = np.flatnonzero(np.all(signs == 0.0, axis=1))
    if len(flat):
        middles = all_points[cells[flat]].mean(axis=1)
        signs[flat] = np.sign(evaluated(field, middles))[:, None]

    above, below = np.any(signs > 0.0, axis=1), np.any(signs < 0.0, axis=1)
    is_cut = above & below & (regions != VOID)
    is_whole = np.where(regions == SOLID, ~is_cut, above & ~below & (regions == DESIGNED))
    pieces = [(cells[is_whole], facets[is_whole], regions[is_whole])]

    # of solid tetrahedra both sides stay: so they meet the designed ones in whole faces
    for region, side in ((DESIGNED, 1.0), (SOLID, 1.0), (SOLID, -1.0)):
        chosen = np.flatnonzero(is_cut & (regions == region))
        corners, tags = _one_side(
            cells[chosen], facets[chosen], side * signs[chosen], edges, len(points), all_points
        )
        pieces.append((corners, tags, np.full(len(corners), region)))
    cells, facets, regions = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))

    is_inverted = volumes(all_points, cells) < 0.0
    cells[is_inverted] = cells[is_inverted][:, [1, 0, 2, 3]]
    facets[is_inverted] = facets[is_inverted][:, [1, 0, 2, 3]]

    used, cells = np.unique(cells, return_inverse=True)
    return Tetrahedra(all_points[used], cells.reshape(-1, 4), facets, regions), used


def _one_side(
    cells: Integers, facets: Integers, signs: Array, edges: Integers, first: int, points: Array
) -> tuple[Integers, Integers]:
    """Tetrahedra on the positive side of some with both signs, and their interfaces, (cells, 4).

    The ``first`` of the points is the zero of the first of the edges (edges, 2), which are sorted.
    """
    key = edges @ np.array([2**32, 1])
    tetrahedra, tags = [np.zeros((0, 4), dtype=np.int64)], [np.zeros((0, 4), dtype=np.int64)]

    # corners inside first, then those on the surface, then those outside, by their numbers each:
    # quadrilaterals are then divided alike from both sides
    order = np.lexsort((cells, -signs), axis=1)
    cells, facets = np.take_along_axis(cells, order, 1), np.take_along_axis(facets, order, 1)
    signs = np.take_along_axis(signs, order, 1)
    inside, outside = np.sum(signs > 0.0, axis=1), np.sum(signs < 0.0, axis=1)

    def zero(chosen: Integers, i: int, j: int) -> Integers:
        """Numbers of the points where the edges from corners i to j have their zeros."""
        pair = np.sort(cells[chosen][:, [i, j]], axis=1) @ np.array([2**32, 1])
        return first + np.searchsorted(key, pair)

    def add(chosen: Integers, corners: tuple[int | tuple[int, int], ...]) -> None:
        """Add a tetrahedron in each chosen cell, of its corners and of zeros of its edges."""
        new = [cells[chosen, c] if isinstance(c, int) else zero(chosen, *c) for c in corners]

        # a face lies in that of the cell if its corners and zeros are made of three of the cell's
        # corners; it is then opposite of the fourth, and has its interface
        made_of = [{c} if isinstance(c, int) else set(c) for c in corners]
        tag = np.full((len(chosen), 4), -1, dtype=np.int64)
        for i in range(4):
            corners_of_face = set().union(*(made_of[j] for j in range(4) if j != i))
            if len(corners_of_face) == 3:
                opposite = ({0, 1, 2, 3} - corners_of_face).pop()
                tag[:, i] = facets[chosen, opposite]

        tetrahedra.append(np.column_stack(new))
        tags.append(tag)

    def cells_with(p: int, n: int) -> Integers:
        """Numbers of cells with p corners inside and n outside."""
        return np.flatnonzero((inside == p) & (outside == n))

    for (p, n), templates in _TEMPLATES.items():
        for corners in templates:
            add(cells_with(p, n), corners)

    # the rest of a wedge, which depends on the shorter diagonal of its quadrilateral on the surface
    wedge = cells_with(2, 2)
    first_diagonal = points[zero(wedge, 0, 2)] - points[zero(wedge, 1, 3)]
    second_diagonal = points[zero(wedge, 0, 3)] - points[zero(wedge, 1, 2)]
    squares = [np.einsum("ij,ij->i", d, d) for d in (first_diagonal, second_diagonal)]
    is_first_shorter = squares[0] < squares[1]

    add(wedge[is_first_shorter], (0, (0, 2), (0, 3), (1, 3)))
    add(wedge[is_first_shorter], (0, (0, 2), (1, 3), (1, 2)))
    add(wedge[~is_first_shorter], (0, (0, 2), (0, 3), (1, 2)))
    add(wedge[~is_first_shorter], (0, (0, 3), (1, 3), (1, 2)))
    return np.concatenate(tetrahedra), np.concatenate(tags)
