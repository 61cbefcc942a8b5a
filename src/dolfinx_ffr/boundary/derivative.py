# SPDX-License-Identifier: MIT
"""Derivatives by the controls from derivatives by the nodes of a fitted mesh."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Generic, TypeVar

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from ..arrays import Array, Integers, Mask
from ..fem import Domain, gathered_nodes, laplace
from .outline import Boundary

B = TypeVar("B", bound=Any)  # with n_controls

#: Ends and middles of the sides of a triangle of order 2, by local number
_ENDS, _MIDDLES = ([1, 2], [0, 2], [0, 1]), (3, 4, 5)
#: Distance of a node from a curve on which it lies, in minimum members: gmsh places nodes on
#: curves to some 1e-7 of their length
_ON = 1e-5


class NodeMotion(ABC, Generic[B]):
    """How the nodes of a mesh follow the controls of the boundary that it fits."""

    def __init__(self, boundary: B, domain: Domain) -> None:
        self._domain = domain
        self.n_controls = boundary.n_controls
        x, cells, self._numbers = gathered_nodes(domain)
        self._shape = x.shape
        if domain.comm.rank == 0:
            self._prepare(boundary, x, cells)

    @abstractmethod
    def _prepare(self, boundary: B, x: Array, cells: Integers) -> None:
        """What `_back` needs, from all nodes (nodes, dimension) and cells; on rank 0."""

    @abstractmethod
    def _back(self, bar: Array) -> Array:
        """The derivative by controls from the one by all nodes (nodes, dimension); on rank 0."""

    def pullback(self, nodes: Array) -> Array:
        """From the derivative by nodes to that by controls, (controls, k), the same on every rank.

        Args:
            nodes: For each node of this rank, as `Evaluation.nodes` has it.
        """
        comm = self._domain.comm
        numbers, own = self._numbers
        parts = comm.gather((numbers[own], nodes[own]))
        found = None
        if parts is not None:
            bar = np.zeros(self._shape)
            for where, values in parts:
                bar[where] = values
            found = self._back(bar)
        return np.asarray(comm.bcast(found))


class CurveMotion(NodeMotion[Boundary]):
    """Nodes of triangles of order 2 that follow curves: (controls, 2) of a `pullback`.

    Nodes on a free curve move with it at fixed parameters, others on the outer edge stay. Vertices
    inside follow by Laplace's equation on the straight triangles, and middles of sides are in the
    middle of their ends where they are on no curve.
    """

    def _prepare(self, boundary: Boundary, x: Array, cells: Integers) -> None:
        corners = cells[:, :3]
        sides = np.concatenate([cells[:, ends] for ends in _ENDS])
        key = np.sort(sides, axis=1) @ np.array([len(x), 1])
        _, first, count = np.unique(key, return_index=True, return_counts=True)
        outer = sides[first[count == 1]]
        middles = np.concatenate([cells[:, local] for local in _MIDDLES])[first]
        # of pockets, whose floors are meshed, too, the curves run through the mesh
        self._follow, on = _followers(boundary, x, np.arange(len(x)))
        edge = np.unique(np.concatenate([outer.ravel(), corners[on[corners]]]))
        loose = ~on[middles]
        self._middles, self._ends = middles[loose], sides[first][loose]
        self._edge = edge
        inside = np.zeros(len(x), dtype=bool)
        inside[np.unique(corners)] = True
        inside[edge] = False
        self._inside = np.flatnonzero(inside)
        stiffness = laplace(x, corners)
        self._coupling = stiffness[edge][:, self._inside]
        self._factor = splu(stiffness[self._inside][:, self._inside].tocsc())

    def _back(self, bar: Array) -> Array:
        total = bar.copy()
        for j in (0, 1):
            np.add.at(total, self._ends[:, j], 0.5 * bar[self._middles])
        total[self._edge] -= self._coupling @ self._factor.solve(total[self._inside])
        return np.asarray(self._follow.T @ total)


def _followers(boundary: Boundary, x: Array, candidates: Integers) -> tuple[csr_matrix, Mask]:
    """Shares of the controls in nodes, (nodes, controls); which nodes are on free curves."""
    on = np.zeros(len(x), dtype=bool)
    rows, columns, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
    near = 0.25 * boundary.member
    for key, curve in boundary.free.items():
        s = curve.sampled(near)
        distance, which = cKDTree(curve.at(s)).query(x[candidates])
        some = distance < near
        nodes = candidates[some]
        at = curve.nearest(x[nodes], s[which[some]])
        fit = np.linalg.norm(curve.at(at) - x[nodes], axis=1) < _ON * boundary.member
        fit &= ~on[nodes]
        on[nodes[fit]] = True
        own = curve.rows(at[fit]).tocoo()
        rows.append(nodes[fit][own.row])
        columns.append(boundary.first[key] + own.col)
        values.append(own.data)
    where = np.concatenate(rows), np.concatenate(columns)
    shares = csr_matrix((np.concatenate(values), where), (len(x), boundary.n_controls))
    return shares, on
