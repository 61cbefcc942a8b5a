# SPDX-License-Identifier: MIT
"""Models of gmsh as DOLFINx takes them: complete cells, and no nodes but those of cells.

DOLFINx has no cells without nodes in their middles (S8, C3D20). Their shape functions are among
those of the complete cells of order 2 (S9, C3D27): with nodes added where a cell has its middle and
the middles of its faces, the body is the same to round-off. By nodes that belong to no cell, as the
centres of arcs that gmsh saves, DOLFINx 0.5 crashes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ..arrays import Array, Integers
from .plane_mesh import gmsh_model

#: Numbers that gmsh gives to cells: of the incomplete ones those of the complete cell of order 2
#: and of the cell of order 1
COMPLETE = {16: (10, 3), 17: (12, 5)}


def is_plain(model: Any, used: Integers) -> bool:
    """Whether DOLFINx takes a model of gmsh, whose cells have the nodes ``used``, as it is."""
    complete = COMPLETE.keys().isdisjoint(model.mesh.getElementTypes())
    return complete and len(used) == len(model.mesh.getNodes()[0])


@contextmanager
def plain(model: Any, used: Integers) -> Iterator[Any]:
    """A copy of gmsh's current model with complete cells, of its groups and the nodes ``used``.

    The nodes of the model are numbered from 1 without gaps.
    """
    tags, positions, _ = model.mesh.getNodes()
    points = np.reshape(positions, (-1, 3))[np.argsort(tags)]
    number = np.zeros(len(points) + 1, dtype=np.int64)
    number[used] = np.arange(1, len(used) + 1)
    completed = _Completed(model, points[used - 1])
    groups = [
        (dim, int(tag), model.getPhysicalName(dim, tag))
        for dim, tag in model.getPhysicalGroups()
        if dim > 0
    ]
    blocks: list[tuple[int, int, int, Integers]] = []
    members = []
    for dim, group, _ in groups:
        members.append([int(entity) for entity in model.getEntitiesForPhysicalGroup(dim, group)])
        for entity in members[-1]:
            kinds, _, nodes = model.mesh.getElements(dim, entity)
            for kind, node_tags in zip(kinds, nodes, strict=True):
                blocks.append(
                    (dim, entity, *completed.cells(kind, number[np.asarray(node_tags, np.int64)]))
                )
    with gmsh_model() as gmsh:
        copy = gmsh.model
        entity_tags = sorted({(dim, entity) for dim, entity, _, _ in blocks})
        for dim, entity in entity_tags:
            copy.addDiscreteEntity(dim, entity)
        points = completed.points()
        copy.mesh.addNodes(*entity_tags[-1], np.arange(1, len(points) + 1), points.ravel())
        first_element = 1
        for _, entity, kind, cells in blocks:
            copy.mesh.addElementsByType(
                entity, kind, np.arange(first_element, first_element + len(cells)), cells.ravel()
            )
            first_element += len(cells)
        for (dim, group, name), entities in zip(groups, members, strict=True):
            copy.addPhysicalGroup(dim, entities, group)
            copy.setPhysicalName(dim, group, name)
        yield copy


class _Completed:
    """Nodes of a mesh at ``points`` (nodes, 3), and those that complete cells add to them."""

    def __init__(self, model: Any, points: Array) -> None:
        self._mesh, self._points = model.mesh, points
        self._added: list[Array] = []
        # by the corners around a node, as neighbours share it
        self._numbers: dict[tuple[int, ...], int] = {}

    def points(self) -> Array:
        """All nodes, shape (nodes, 3) [m]."""
        return np.vstack([self._points, *self._added])

    def cells(self, kind: int, nodes: Any) -> tuple[int, Integers]:
        """The kind and the nodes (cells, nodes per cell) of the complete cells of a block."""
        nodes_of_cells = np.asarray(nodes, dtype=np.int64).reshape(-1, self._properties(kind)[3])
        if kind not in COMPLETE:
            return kind, nodes_of_cells
        complete, linear = COMPLETE[kind]
        _, dim, _, count, local, _ = self._properties(complete)
        new = np.zeros((count - nodes_of_cells.shape[1], 3))
        new[:, :dim] = np.reshape(local, (count, dim))[nodes_of_cells.shape[1] :]
        shapes, around = (self._shape_functions(element, new) for element in (kind, linear))
        middles = np.einsum("kn,cnd->ckd", shapes, self._points[nodes_of_cells - 1])
        added = np.empty((len(nodes_of_cells), len(new)), dtype=np.int64)
        for k, weights in enumerate(around):
            corners = np.sort(nodes_of_cells[:, : around.shape[1]][:, weights > 0.0], axis=1)
            for cell, key in enumerate(map(tuple, corners.tolist())):
                if key not in self._numbers:
                    self._numbers[key] = len(self._points) + len(self._numbers) + 1
                    self._added.append(middles[cell, k][None])
                added[cell, k] = self._numbers[key]
        return complete, np.hstack([nodes_of_cells, added])

    def _properties(self, kind: int) -> Any:
        return self._mesh.getElementProperties(kind)

    def _shape_functions(self, kind: int, local: Array) -> Array:
        """Values at local points (points, 3), shape (points, nodes of the kind)."""
        values = self._mesh.getBasisFunctions(kind, local.ravel(), "Lagrange")[1]
        return np.reshape(values, (len(local), -1))
