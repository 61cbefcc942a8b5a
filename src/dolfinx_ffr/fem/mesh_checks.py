# SPDX-License-Identifier: MIT
"""Meshes that are refused before any long work: folded cells, hanging nodes, floating pieces."""

from __future__ import annotations

from collections.abc import Sequence

import basix
import numpy as np
import ufl
from dolfinx import mesh
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..arrays import Array, Integers, Mask
from . import _compat
from .curves import ShapeError

#: Sides of a facet by its number of corners; quadrilaterals are numbered as tensor products
_SIDES = {2: [(0, 1)], 3: [(0, 1), (1, 2), (0, 2)], 4: [(0, 1), (0, 2), (1, 3), (2, 3)]}


def check_cells(domain: mesh.Mesh) -> None:
    """Refuse cells of ``domain`` whose map from the reference cell folds over."""
    kind = getattr(basix.CellType, _compat.cell_name(domain))
    reference = np.vstack([basix.geometry(kind), basix.make_quadrature(kind, 3)[0]])
    dim = domain.topology.dim
    cells = np.arange(domain.topology.index_map(dim).size_local, dtype=np.int32)
    determinant = ufl.JacobianDeterminant(domain)
    jacobian = _compat.compiled_expression(determinant, reference, domain)(cells)[:, :, 0]
    scale = np.max(np.abs(jacobian), axis=1, initial=0.0)
    smallest = np.min(jacobian * np.sign(jacobian[:, :1]), axis=1, initial=np.inf)
    folded = smallest <= 1e-12 * scale
    bad = int(domain.comm.allreduce(int(np.count_nonzero(folded))))
    if bad:
        nodes = _compat.cell_geometry(domain)[cells[folded]]
        positions = [_point(p[:, :dim].mean(axis=0)) for p in domain.geometry.x[nodes[:3]]]
        positions = [p for of_rank in domain.comm.allgather(positions) for p in of_rank][:3]
        raise ShapeError(
            f"mesh: {bad} cells are inverted or without {'volume' if dim == 3 else 'area'}, the "
            f"first near {', '.join(positions)} m; "
            "repair the mesh (in gmsh: another algorithm, or straighter high-order cells)"
        )


def check_hanging_nodes(domain: mesh.Mesh) -> None:
    """Refuse a vertex in the middle of another cell's edge: the cells only seem to be joined."""
    segments = _boundary_segments(domain)
    middle = segments.mean(axis=1)
    direction = segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(direction, axis=1)
    vertices = segments.reshape(-1, segments.shape[2])
    neighbours = cKDTree(vertices).query_ball_point(middle, 0.499 * length)
    segment = np.repeat(np.arange(len(neighbours)), [len(numbers) for numbers in neighbours])
    nearby = vertices[np.concatenate([*neighbours, []]).astype(np.int64)]
    offset, along = nearby - middle[segment], (direction / length[:, None])[segment]
    off = offset - np.einsum("ij,ij->i", offset, along)[:, None] * along
    hits = np.flatnonzero(np.linalg.norm(off, axis=1) < 1e-9 * length[segment])
    if len(hits):
        raise ShapeError(
            f"mesh: hanging node at {_point(nearby[hits[0]])} m, in the middle of another cell's "
            "edge; refine so that neighbouring cells share whole edges"
        )


def check_held(
    domain: mesh.Mesh, facets: Sequence[NDArray[np.int32]], void: Mask | None = None
) -> None:
    """Refuse pieces of a mesh, without ``void`` cells, that touch no interface and would float."""
    n_cells = domain.topology.index_map(domain.topology.dim).size_local
    cells = np.ones(n_cells, dtype=bool) if void is None else ~void[:n_cells]
    _, floating, count = floating_cells(domain, cells, facets)
    if floating:
        remedy = (
            "give each piece an interface, merge coincident nodes, or choose one part of a drawing "
            "by inside=(x, y)"
        )
        if void is not None:
            remedy = "leave the cells that join them to the others out of the void region"
        raise ShapeError(
            f"mesh: {floating} of {count} separate pieces of the body touch no interface and "
            f"would float; {remedy}"
        )


def floating_cells(
    domain: mesh.Mesh, cells: Mask, facets: Sequence[NDArray[np.int32]]
) -> tuple[Mask, int, int]:
    """Mask of ``cells`` in pieces without an interface; numbers of such pieces and of all."""
    all_cells = _compat.entity_vertices(domain, domain.topology.dim)
    table = all_cells[: len(cells)][cells]
    vertex_map = domain.topology.index_map(0)
    n_local = int(all_cells.max(initial=-1)) + 1
    global_vertices = vertex_map.local_to_global(np.arange(n_local, dtype=np.int32))
    is_held = np.zeros(n_local, dtype=bool)
    facet_vertices = _compat.entity_vertices(domain, domain.topology.dim - 1)
    for facets_of_interface in facets:
        is_held[facet_vertices[facets_of_interface].ravel()] = True
    # within a rank by cells; across ranks by shared vertices, each joined to one of its piece
    rows = np.repeat(table[:, :1].ravel(), max(table.shape[1] - 1, 0))
    piece = connected(np.column_stack([rows, table[:, 1:].ravel()]), n_local)
    n = int(vertex_map.size_global)
    first_vertex = np.full(piece.max(initial=-1) + 1, n, dtype=np.int64)
    np.minimum.at(first_vertex, piece, global_vertices)
    comm = domain.comm
    edges = np.vstack(comm.allgather(np.column_stack([global_vertices, first_vertex[piece]])))
    label = connected(edges, n)
    # a vertex without any of the cells is a component of its own, and no piece
    piece_of_cell = label[global_vertices[table[:, :1].ravel()]]
    pieces = np.unique(np.concatenate(comm.allgather(np.unique(piece_of_cell))))
    held_pieces = label[np.concatenate(comm.allgather(global_vertices[is_held]))]
    floats = ~np.isin(pieces, held_pieces)
    result = np.zeros(len(cells), dtype=bool)
    result[cells] = np.isin(piece_of_cell, pieces[floats])
    return result, int(np.count_nonzero(floats)), len(pieces)


def connected(pairs: NDArray[np.integer], count: int) -> Integers:
    """Number of the connected component, from 0, of each of ``count`` things, by pairs (n, 2)."""
    ones = np.ones(len(pairs), dtype=bool)
    graph = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _boundary_segments(domain: mesh.Mesh) -> Array:
    """The ends of boundary edges, shape (edges, 2, dimension), some repeated; on every rank."""
    dim = domain.topology.dim
    domain.topology.create_connectivity(dim - 1, dim)
    corners = facet_nodes(domain, mesh.exterior_facet_indices(domain.topology))
    ends = corners[:, _SIDES[corners.shape[1]]].reshape(-1, 2)
    return np.vstack(domain.comm.allgather(domain.geometry.x[ends][:, :, :dim]))


def facet_points(domain: mesh.Mesh, facets: NDArray[np.int32]) -> Array:
    """The vertices of facets of all ranks, some repeated, shape (points, dimension) [m]."""
    points = domain.geometry.x[facet_nodes(domain, facets).ravel()][:, : domain.topology.dim]
    return np.vstack(domain.comm.allgather(points))


def vertex_nodes(domain: mesh.Mesh) -> NDArray[np.int32]:
    """The geometry node at each vertex of this rank."""
    vertices = _compat.entity_vertices(domain, domain.topology.dim)
    node = np.zeros(vertices.max(initial=-1) + 1, dtype=np.int32)
    # vertices come first among a cell's geometry nodes, in the same order
    node[vertices] = _compat.cell_geometry(domain)[:, : vertices.shape[1]]
    return node


def facet_nodes(domain: mesh.Mesh, facets: NDArray[np.int32]) -> NDArray[np.int32]:
    """The geometry nodes at the corners of facets, shape (facets, corners)."""
    dim, node = domain.topology.dim, vertex_nodes(domain)
    count = {"tetrahedron": 3, "hexahedron": 4}.get(_compat.cell_name(domain), 2)
    # a rank may hold none
    return node[_compat.entity_vertices(domain, dim - 1)[facets].reshape(-1, count)]


def _point(point: Array) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in point) + ")"
