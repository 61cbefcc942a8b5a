# SPDX-License-Identifier: MIT
"""Derivatives by the offsets of a boundary from derivatives by the nodes of a fitted mesh."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from ..arrays import Array, Integers, Mask
from ..fem import Domain, gathered_nodes, laplace
from .outline import Boundary

B = TypeVar("B")

#: Ends and middles of the sides of a triangle of order 2, by local number
_ENDS, _MIDDLES = ([1, 2], [0, 2], [0, 1]), (3, 4, 5)
#: Distance of a node from a curve on which it lies, in minimum members: gmsh places nodes on
#: curves to some 1e-7 of their length
_ON = 1e-5
#: Distance of points of a curve among which the one nearest to a node is looked for, likewise
_SAMPLE = 0.25


class NodeMotion(ABC, Generic[B]):
    """How the nodes of a mesh follow the boundary that it fits."""

    def __init__(self, boundary: B, domain: Domain) -> None:
        self._domain = domain
        x, cells, self._numbers = gathered_nodes(domain)
        self._shape = x.shape
        if domain.comm.rank == 0:
            self._prepare(boundary, x, cells)

    @abstractmethod
    def _prepare(self, boundary: B, x: Array, cells: Integers) -> None:
        """Prepare `_back` for all nodes (nodes, dimension) and cells; on rank 0."""

    @abstractmethod
    def _back(self, node_gradient: Array) -> Array:
        """The derivative by offsets from the one by all nodes (nodes, dimension); on rank 0."""

    def pullback(self, nodes: Array) -> Array:
        """From the derivative by nodes to that by the offsets, (offsets,), the same on every rank.

        Args:
            nodes: For each node of this rank, as `Evaluation.nodes` has it.
        """
        comm = self._domain.comm
        numbers, owned = self._numbers
        of_ranks = comm.gather((numbers[owned], nodes[owned]))
        gradient = None
        if of_ranks is not None:
            node_gradient = np.zeros(self._shape)
            for rank_numbers, rank_values in of_ranks:
                node_gradient[rank_numbers] = rank_values
            gradient = self._back(node_gradient)
        return np.asarray(comm.bcast(gradient))


class CurveMotion(NodeMotion[Boundary]):
    """Nodes of triangles of order 2 that follow curves.

    Nodes on a free curve move with it at fixed parameters, others on the outer edge stay. Vertices
    inside follow by Laplace's equation on the straight triangles, and middles of sides are in the
    middle of their ends where they are on no curve.
    """

    def _prepare(self, boundary: Boundary, x: Array, cells: Integers) -> None:
        self._normals, self._expansion = boundary.normals, boundary.expansion
        self._follow, on_curve = _followers(boundary, x)
        corners = cells[:, :3]
        sides = np.concatenate([cells[:, ends] for ends in _ENDS])
        middles = np.concatenate([cells[:, local] for local in _MIDDLES])
        side_keys = np.sort(sides, axis=1) @ np.array([len(x), 1])
        _, side, count = np.unique(side_keys, return_index=True, return_counts=True)

        # in pockets, whose floors are meshed, too, the curves run through the mesh
        outer_nodes = sides[side[count == 1]].ravel()
        corners_on_curves = corners[on_curve[corners]]
        edge = np.unique(np.concatenate([outer_nodes, corners_on_curves]))
        is_inside = np.zeros(len(x), dtype=bool)
        is_inside[np.unique(corners)] = True
        is_inside[edge] = False
        self._edge, self._inside = edge, np.flatnonzero(is_inside)

        middles = middles[side]
        is_straight = ~on_curve[middles]
        self._middles, self._ends = middles[is_straight], sides[side][is_straight]

        stiffness = laplace(x, corners)
        self._coupling = stiffness[edge][:, self._inside]
        self._factor = splu(stiffness[self._inside][:, self._inside].tocsc())

    def _back(self, node_gradient: Array) -> Array:
        by_controls = self.by_controls(node_gradient)
        by_offsets = np.einsum("kd,kd->k", by_controls, self._normals)
        return np.asarray(self._expansion.T @ by_offsets)

    def by_controls(self, node_gradient: Array) -> Array:
        """The derivative by controls (controls, 2) from the one by all nodes (nodes, 2)."""
        total = node_gradient.copy()
        for j in (0, 1):
            np.add.at(total, self._ends[:, j], 0.5 * node_gradient[self._middles])
        total[self._edge] -= self._coupling @ self._factor.solve(total[self._inside])
        return np.asarray(self._follow.T @ total)


def _followers(boundary: Boundary, x: Array) -> tuple[csr_matrix, Mask]:
    """Weights of the controls in nodes, (nodes, controls); which nodes are on free curves."""
    on_curve = np.zeros(len(x), dtype=bool)
    rows, columns, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
    sample_distance = _SAMPLE * boundary.member
    for key, curve in boundary.free.items():
        s = curve.sampled(sample_distance)
        distance, nearest = cKDTree(curve.at(s)).query(x)
        nodes = np.flatnonzero(distance < sample_distance)
        node_parameters = curve.nearest(x[nodes], s[nearest[nodes]])
        deviation = np.linalg.norm(curve.at(node_parameters) - x[nodes], axis=1)
        fits = (deviation < _ON * boundary.member) & ~on_curve[nodes]
        nodes = nodes[fits]
        on_curve[nodes] = True
        weights = curve.rows(node_parameters[fits]).tocoo()
        rows.append(nodes[weights.row])
        columns.append(boundary.first[key] + weights.col)
        values.append(weights.data)
    places = np.concatenate(rows), np.concatenate(columns)
    shape = len(x), boundary.n_controls
    return csr_matrix((np.concatenate(values), places), shape), on_curve
