# SPDX-License-Identifier: MIT
"""How the nodes of a mesh follow the geometry that it was made of.

Nodes on a curve or a face of gmsh's model keep their parameters there while the model changes, as
shares of the range that the curve or face has. Within a face they move along it as smoothly as its
edges let them, and across it with the face; all other vertices follow by Laplace's equation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import basix
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu

from ..arrays import Integers, Mask
from ..fem import Array, laplace

#: Distance of a node from a curve or face on which it lies, in sizes of the body
_ON = 1e-7


class NodesOnGeometry:
    """Which nodes of a mesh lie on points, curves and faces of a gmsh model; made on rank 0."""

    def __init__(self, model: Any, x: Array, outer: Integers) -> None:
        """From all nodes (nodes, dimension) and the numbers of those on the boundary."""
        self.dimension = x.shape[1]
        points = np.pad(x, ((0, 0), (0, 3 - self.dimension)))
        self._near = _ON * float(np.max(np.ptp(points, axis=0)))
        #: Dimension, tag, numbers of the nodes there, and shares (nodes, dimension) of parameters
        self._places: list[tuple[int, int, Integers, Array]] = []
        left = np.zeros(len(x), dtype=bool)
        left[outer] = True
        for dim, tag in model.getEntities():  # points first
            if dim >= self.dimension:
                continue
            box = np.reshape(model.getBoundingBox(dim, tag), (2, 3))
            margin = 1e-3 * float(np.max(np.ptp(points, axis=0)))
            inside = np.all((points > box[0] - margin) & (points < box[1] + margin), axis=1)
            nodes = np.flatnonzero(left & inside)
            if not len(nodes):
                continue
            shares = np.zeros((len(nodes), dim))
            if dim:
                low, width = _range(model, dim, tag)
                found = model.getParametrization(dim, tag, points[nodes].ravel())
                shares = (np.reshape(found, (-1, dim)) - low) / width
            there = _at(model, dim, tag, shares)
            on = np.linalg.norm(there - points[nodes], axis=1) < self._near
            left[nodes[on]] = False
            self._places.append((dim, tag, nodes[on], shares[on]))

    @property
    def nodes(self) -> Integers:
        """The numbers of these nodes, as `positions` has them."""
        return np.concatenate([nodes for _, _, nodes, _ in self._places]).astype(np.int64)

    def positions(self, model: Any) -> Array:
        """Where they are in a model that is alike, shape (those nodes, dimension) [m]."""
        parts = [_at(model, dim, tag, shares) for dim, tag, _, shares in self._places]
        return np.concatenate(parts)[:, : self.dimension]

    def on_faces(self, model: Any) -> tuple[Integers, Array]:
        """Numbers of the nodes on faces of a body in space, and unit normals there (nodes, 3)."""
        nodes, normals = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
        for dim, tag, some, shares in self._places:
            if dim == 2 and len(some):
                low, width = _range(model, dim, tag)
                nodes.append(some)
                normals.append(
                    np.reshape(model.getNormal(tag, (low + shares * width).ravel()), (-1, 3))
                )
        return np.concatenate(nodes), np.concatenate(normals)


def _range(model: Any, dim: int, tag: int) -> tuple[Array, Array]:
    """Lowest parameters, and the extent of their range, shape (dim,) each."""
    low, high = (np.asarray(part) for part in model.getParametrizationBounds(dim, tag))
    return low, high - low


def _at(model: Any, dim: int, tag: int, shares: Array) -> Array:
    """Points (n, 3) at shares (n, dim) of the parameters [m]."""
    if not dim:
        return np.tile(model.getValue(0, tag, []), (len(shares), 1))
    low, width = _range(model, dim, tag)
    return np.reshape(model.getValue(dim, tag, (low + shares * width).ravel()), (-1, 3))


def extended(
    x: Array,
    cells: Integers,
    rates: Array,
    known: Mask,
    faces: tuple[Integers, Array] | None,
) -> Array:
    """Motions (nodes, dimension, k) of all nodes from those, in ``rates``, of the ``known`` ones.

    In space ``faces`` are nodes on faces with their normals: ``rates`` count across these alone.
    """
    d = x.shape[1]
    corners, rates, known = cells[:, : d + 1], rates.copy(), known.copy()
    outer = outer_facets(corners)
    if faces is not None:
        nodes, normals = faces
        across = np.einsum("ni,nik->nk", normals, rates[nodes])
        known[nodes] = False
        known[np.setdiff1d(np.unique(outer), np.union1d(nodes, np.flatnonzero(known)))] = True
        _fill(x, outer, rates, known)
        across -= np.einsum("ni,nik->nk", normals, rates[nodes])
        rates[nodes] += normals[:, :, None] * across[:, None, :]
    known[np.unique(outer)] = True
    _fill(x, corners, rates, known)
    kind = basix.CellType.triangle if d == 2 else basix.CellType.tetrahedron
    sides = basix.topology(kind)[1]
    for local in range(d + 1, cells.shape[1]):  # middles of sides
        middle = cells[:, local]
        loose = ~known[middle]
        ends = cells[:, sides[local - d - 1]]
        rates[middle[loose]] = rates[ends[loose]].mean(axis=1)
    return rates


def _fill(x: Array, simplices: Integers, rates: Array, known: Mask) -> None:
    """Solve Laplace's equation for the vertices of simplices that are not known yet."""
    there = np.unique(simplices)
    free, held = there[~known[there]], there[known[there]]
    if len(free):
        matrix: csr_matrix = laplace(x, simplices)
        given = matrix[free][:, held] @ rates[held].reshape(len(held), -1)
        found = splu(matrix[free][:, free].tocsc()).solve(-given)
        rates[free] = found.reshape(len(free), *rates.shape[1:])
        known[free] = True


def outer_facets(corners: Integers) -> Integers:
    """The facets, by their vertices, that belong to one simplex alone."""
    n = corners.shape[1]
    facets = np.concatenate([np.delete(corners, i, axis=1) for i in range(n)])
    _, first, count = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
    )
    return facets[first[count == 1]]


@dataclass(frozen=True, eq=False)
class DimensionMotion:
    """How nodes and centers of a domain move by a unit of each dimension."""

    comm: MPI.Comm
    nodes: Array  #: For each node of this rank, zero for ghosts, shape (nodes, dimension, k)
    centers: Array  #: Of interfaces, on every rank, shape (interfaces, dimension, k)

    def pullback(self, nodes: Array, centers: Array) -> Array:
        """From derivatives by nodes and centers to that by the dimensions, (k,), on every rank."""
        own = np.einsum("nd,ndk->k", nodes, self.nodes)
        through = np.einsum("id,idk->k", centers, self.centers)
        return np.asarray(sum(self.comm.allgather(own)) + through)
