# SPDX-License-Identifier: MIT
"""Derivatives by the nodes of a mesh that fits a part, taken back to the variables of its field.

Where phi(x) = 0 moves with the variables c, x moves by -B(x) dc grad phi / |grad phi|^2, and where
the boundary ends at a side that stays, along this side. Vertices inside follow by Laplace's
equation, and middles of sides of cells stand between their ends.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import splu

from ..arrays import Array, Integers, Mask
from ..fem import Domain, gathered_nodes, laplace
from .field import SYMMETRIC, BoundaryField

#: Ends and middles of the sides of a triangle of order 2, by local number
_ENDS, _MIDDLES = np.array([[1, 2], [0, 2], [0, 1]]), np.array([3, 4, 5])


class FittedNodes:
    """How the nodes of triangles of order 2 follow the variables of a field; collective."""

    def __init__(self, field: BoundaryField, domain: Domain) -> None:
        self._domain = domain
        points, cells, self._numbers = gathered_nodes(domain)
        self._shape = points.shape
        # in the order of those cells
        solid = domain.comm.gather(domain.solid_cells)
        full = domain.comm.gather(field.part.density(domain) == 1.0)
        if solid is not None:
            self._sides_of(points, cells, np.concatenate(full))
            self.motion = self._motion_of(field, points, cells[np.concatenate(solid)])
            self._inner_of(points, cells)

    def _sides_of(self, points: Array, cells: Integers, full: Mask) -> None:
        """Find every side of a cell once: its ends, its middle, whether it is on the boundary.

        There one of its cells has the full thickness, beside none or one of a pocket.
        """
        ends = cells[:, _ENDS].reshape(-1, 2)
        middles = cells[:, _MIDDLES].reshape(-1)
        key = np.sort(ends, axis=1) @ np.array([len(points), 1])
        _, first, number = np.unique(key, return_index=True, return_inverse=True)
        count = np.bincount(number.ravel(), np.repeat(full, 3))
        self._ends, self._middles, self._outer = ends[first], middles[first], count == 1

    def _motion_of(self, field: BoundaryField, points: Array, solid: Integers) -> list[csr_matrix]:
        """Motion of all nodes by the variables, (nodes, variables) for each component."""
        space, outer = field.space, self._outer
        sides = np.column_stack([self._ends[outer], self._middles[outer]])
        boundary = np.unique(sides)
        gradient = field.gradient(points[boundary])
        square = np.maximum(np.sum(gradient**2, axis=1), 1e-300)
        near = space.options.on_zero * space.grid.spacing
        on_zero = np.abs(field.spline(points[boundary])) < near * np.sqrt(square)
        on_zero &= space.rims.margin(points[boundary]) <= 1e-3 * near

        # sides of cells in solid regions stay, and so do the held variables of interfaces
        zero = np.zeros(len(points), dtype=bool)
        zero[boundary[on_zero]] = True
        in_solid = np.zeros(len(points), dtype=bool)
        in_solid[np.unique(solid)] = True
        follows = np.all(zero[sides], axis=1) & ~np.all(in_solid[sides], axis=1)
        moving = np.zeros(len(points), dtype=bool)
        moving[sides[follows]] = True

        way = np.zeros((len(points), 2))
        way[boundary] = -gradient / square[:, None]
        at_end = moving & _touched(sides[~follows], len(points))
        along = _along(points, sides[~follows])
        slope = np.zeros((len(points), 2))
        slope[boundary] = gradient
        rate = np.einsum("ni,ni->n", along, slope)
        # a boundary that is nearly along the side moves its end by no more than its normal
        steep = np.maximum(np.abs(rate), 0.3 * np.linalg.norm(slope, axis=1)) * np.sign(rate)
        share = np.divide(-1.0, steep, out=np.zeros(len(points)), where=steep != 0.0)
        way[at_end] = (share[:, None] * along)[at_end]

        self._moving = moving
        nodes = np.flatnonzero(moving)
        values = space.grid.rows(points[nodes])
        place = csr_matrix(
            (np.ones(len(nodes)), (nodes, np.arange(len(nodes)))), (len(points), len(nodes))
        )
        return [csr_matrix(place @ (diags(way[nodes, i]) @ values)) for i in (0, 1)]

    def _inner_of(self, points: Array, cells: Integers) -> None:
        corners = cells[:, :3]
        edge = np.unique(self._ends[self._outer])
        inside = np.zeros(len(points), dtype=bool)
        inside[np.unique(corners)] = True
        inside[edge] = False
        self._edge, self._inside = edge, np.flatnonzero(inside)
        stiffness = laplace(points, corners)
        self._coupling = stiffness[edge][:, self._inside]
        self._factor = splu(stiffness[self._inside][:, self._inside].tocsc(), **SYMMETRIC)

    def pullback(self, nodes: Array) -> Array:
        """The derivative by the variables, from that by the nodes of this rank (nodes, 2)."""
        comm, (numbers, owned) = self._domain.comm, self._numbers
        parts = comm.gather((numbers[owned], nodes[owned]))
        gradient = None
        if parts is not None:
            total = np.zeros(self._shape)
            for where, values in parts:
                total[where] = values
            gradient = self._back(total)
        return np.asarray(comm.bcast(gradient))

    def _back(self, total: Array) -> Array:
        straight = ~self._moving[self._middles]
        middles, ends = self._middles[straight], self._ends[straight]
        for k in (0, 1):
            np.add.at(total, ends[:, k], 0.5 * total[middles])
        total[self._edge] -= self._coupling @ self._factor.solve(total[self._inside])
        return np.asarray(sum(self.motion[i].T @ total[:, i] for i in (0, 1)))


def _touched(sides: Integers, count: int) -> Mask:
    """The nodes at the ends of some sides."""
    nodes = np.zeros(count, dtype=bool)
    nodes[sides[:, :2]] = True
    return nodes


def _along(points: Array, sides: Integers) -> Array:
    """The unit direction of the last of some sides at each of their ends, zero elsewhere."""
    way = points[sides[:, 1]] - points[sides[:, 0]]
    way = way / np.linalg.norm(way, axis=1, keepdims=True)
    found = np.zeros_like(points)
    found[sides[:, 0]] = way
    found[sides[:, 1]] = way
    return found
