# SPDX-License-Identifier: MIT
"""The mesh in a model of gmsh as arrays, with its physical groups; models are refused in words.

DOLFINx has no cells without nodes in their middles (S8, C3D20). Their shape functions are among
those of the complete cells of order 2 (S9, C3D27): with nodes added where a cell has its middle and
the middles of its faces, the body is the same to round-off.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import basix
import numpy as np

from ..arrays import Array, Integers
from . import _compat
from .mesh_arrays import MeshArrays

#: Largest distance from the plane, relative to the size of a surface, that counts as round-off
FLAT = 1e-6
#: Curves, surfaces and volumes by their dimension
KINDS = ("point", "curve", "surface", "volume")
#: Kind of cells and their order, by the number that gmsh gives to them
CELLS = {
    **{2: ("triangle", 1), 9: ("triangle", 2), 21: ("triangle", 3)},
    **{3: ("quadrilateral", 1), 10: ("quadrilateral", 2), 36: ("quadrilateral", 3)},
    **{4: ("tetrahedron", 1), 11: ("tetrahedron", 2), 29: ("tetrahedron", 3)},
    **{5: ("hexahedron", 1), 12: ("hexahedron", 2)},
}
#: Of incomplete cells the numbers of the complete cell of order 2 and of the cell of order 1
COMPLETE = {16: (10, 3), 17: (12, 5)}

#: Number of each physical group by dimension and name
Groups = dict[tuple[int, str], int]


def arrays_of_model(model: Any, source: str) -> tuple[MeshArrays, Groups]:
    """The mesh in gmsh's current model, which messages call ``source``, and its groups."""
    groups = _named_groups(model, source)
    dim = _checked_dimension(model, groups, source)
    tags, positions, _ = model.mesh.getNodes()
    if not np.all(np.isfinite(positions)):
        raise ValueError(f"{source}: a node has no finite position; mesh it again")
    position_of_tag = np.argsort(tags)
    tags = np.asarray(tags, dtype=np.int64)[position_of_tag]
    positions = np.reshape(positions, (-1, 3))[position_of_tag]

    kind, blocks = _blocks(model, dim, source)
    if dim == 2:
        for entity, _, nodes in blocks:
            _check_plane(positions[np.searchsorted(tags, nodes.ravel())], entity, source)
    # nodes that belong to no cell, as the centres of arcs that gmsh saves, are left out
    used, cells = np.unique(np.vstack([nodes for *_, nodes in blocks]), return_inverse=True)
    points = positions[np.searchsorted(tags, used), :dim]
    cells = cells.reshape(-1, blocks[0][2].shape[1])
    if kind in COMPLETE:
        kind, points, cells = _completed(model, kind, points, cells)

    cell, order = CELLS[kind]
    cells = cells[:, _compat.gmsh_order(cell, cells.shape[1])]
    sides = np.array(basix.topology(getattr(basix.CellType, cell))[dim - 1])
    _check_cells(cells[:, : sides.max() + 1], cells[:, sides].reshape(-1, sides.shape[1]), source)
    facets = _facets(model, dim, source, used, sides.shape[1])
    group_of_cell = np.repeat([name for _, name, _ in blocks], [len(n) for *_, n in blocks])
    regions = {name: group_of_cell == name for d, name in groups if d == dim}
    return MeshArrays(cell, order, points, cells, facets, regions), groups


def _named_groups(model: Any, source: str) -> Groups:
    """The numbers of the physical groups by dimension and name, which must be different names."""
    groups: Groups = {}
    for dim, tag in model.getPhysicalGroups():
        try:
            name = _name(model, dim, tag)
        except UnicodeDecodeError as error:
            raise ValueError(f"{source}: a physical group has a name that is no text") from error
        if (dim, name) in groups:
            raise ValueError(
                f"{source}: the physical {KINDS[dim]}s {groups[dim, name]} and {tag} are both "
                f"called {name!r} (one without a name is called by its number); give each a name "
                "of its own"
            )
        groups[dim, name] = int(tag)
    return groups


def _name(model: Any, dim: int, tag: int) -> str:
    """The name of a physical group, or its number where it has none."""
    return model.getPhysicalName(dim, tag) or str(tag)


def _parts(model: Any, dim: int) -> Iterator[tuple[int, str]]:
    """The entities in physical groups of a dimension, and the names of their groups."""
    for _, group in model.getPhysicalGroups(dim):
        for entity in model.getEntitiesForPhysicalGroup(dim, group):
            yield int(entity), _name(model, dim, group)


def _checked_dimension(model: Any, groups: Groups, source: str) -> int:
    """The dimension of a mesh; a model without groups, or with cells in several, is refused."""
    names = {dim: sorted(name for d, name in groups if d == dim) for dim in (1, 2, 3)}
    dim = 3 if names[3] else 2
    facet, cell = KINDS[dim - 1 : dim + 1]
    if not names[dim - 1] or not names[dim]:
        raise ValueError(
            f"{source}: needs physical groups of {facet}s (interfaces) and of {cell}s (material); "
            f"it has the {facet}s {names[dim - 1] or 'none'} and the {cell}s {names[dim] or 'none'}"
        )
    for _, entity in model.getEntities(dim):
        tags = model.getPhysicalGroupsForEntity(dim, entity)
        if len(tags) > 1:
            several = sorted(_name(model, dim, tag) for tag in tags)
            raise ValueError(
                f"{source}: {cell} {entity} belongs to the physical {cell}s {several}, and "
                "its cells would count more than once; leave it in one of them"
            )
        if len(tags) and not len(model.mesh.getElementTypes(dim, entity)):
            raise ValueError(
                f"{source}: {cell} {entity} has no mesh; call gmsh.model.mesh.generate({dim}) first"
            )
    return dim


def _blocks(model: Any, dim: int, source: str) -> tuple[int, list[tuple[int, str, Integers]]]:
    """The kind of all cells; number, group and nodes (cells, nodes per cell) of each entity."""
    group_of_kind: dict[int, str] = {}
    blocks = []
    for entity, group in _parts(model, dim):
        for kind, node_tags in zip(*model.mesh.getElements(dim, entity)[::2], strict=True):
            kind_name, _, order, width, *_ = model.mesh.getElementProperties(kind)
            if kind not in CELLS and kind not in COMPLETE:
                raise ValueError(
                    f"{source}: the cells of {group!r} are of the kind {kind_name}, of order "
                    f"{order}; supported are triangles, quadrilaterals and tetrahedra of order 1 "
                    "to 3 and hexahedra of order 1 and 2: mesh the body with order 2 "
                    "(Mesh.ElementOrder)"
                )
            group_of_kind.setdefault(int(kind), group)
            blocks.append((entity, group, np.asarray(node_tags, np.int64).reshape(-1, width)))
    if len(group_of_kind) > 1:
        names = {model.mesh.getElementProperties(k)[0]: g for k, g in group_of_kind.items()}
        mixed = " and ".join(f"{name} ({group!r})" for name, group in sorted(names.items()))
        raise ValueError(
            f"{source}: the mesh mixes {mixed}; mesh all {KINDS[dim]}s with cells of one kind and "
            "order"
        )
    return next(iter(group_of_kind)), blocks


def _check_cells(corners: Integers, sides: Integers, source: str) -> None:
    """Refuse cells of a damaged file, by the corners of cells and of their sides."""
    corners = np.sort(corners, axis=1)
    if np.any(corners[:, 1:] == corners[:, :-1]):
        raise ValueError(f"{source}: a cell has the same node twice; mesh it again")
    sides = np.sort(sides, axis=1)
    sides = sides[np.lexsort(sides.T)]
    repeated = np.all(sides[1:] == sides[:-1], axis=1)
    if np.any(repeated[1:] & repeated[:-1]):
        raise ValueError(
            f"{source}: more than two cells share a side, so some lie on each other; mesh it again"
        )


def _facets(model: Any, dim: int, source: str, used: Integers, width: int) -> dict[str, Integers]:
    """Corners (facets, width) of facets by group, as numbers among the ``used`` nodes."""
    facet, cell = KINDS[dim - 1 : dim + 1]
    facets: dict[str, Integers] = {}
    for entity, name in _parts(model, dim - 1):
        of_group = facets.setdefault(name, np.zeros((0, width), dtype=np.int64))
        for kind, node_tags in zip(*model.mesh.getElements(dim - 1, entity)[::2], strict=True):
            _, _, _, count, _, vertices = model.mesh.getElementProperties(kind)
            if vertices != width or not np.all(np.isin(node_tags, used)):
                raise ValueError(
                    f"{source}: {facet} {entity} of the physical {facet} {name!r} is no boundary "
                    f"of the physical {cell}s: a body is of {cell}s alone; leave it out, or join "
                    "it to them (fragment) before meshing"
                )
            corners = np.asarray(node_tags, np.int64).reshape(-1, count)[:, :vertices]
            of_group = np.vstack([of_group, np.searchsorted(used, corners)])
        facets[name] = of_group
    return facets


def _completed(
    model: Any, kind: int, points: Array, cells: Integers
) -> tuple[int, Array, Integers]:
    """Kind, nodes and cells with the nodes added by which incomplete cells become complete."""
    complete, linear = COMPLETE[kind]
    _, dim, _, count, local, _ = model.mesh.getElementProperties(complete)
    width = cells.shape[1]
    new = np.zeros((count - width, 3))
    new[:, :dim] = np.reshape(local, (count, dim))[width:]

    def shape_functions(element: int) -> Array:
        values = model.mesh.getBasisFunctions(element, new.ravel(), "Lagrange")[1]
        return np.reshape(values, (len(new), -1))

    middles = np.einsum("kn,cnd->ckd", shape_functions(kind), points[cells]).reshape(-1, dim)
    # by the corners around a new node, as neighbours share it
    around = shape_functions(linear) > 0.0
    corners = cells[:, None, : around.shape[1]]
    keys = np.sort(np.where(around, corners, -1).reshape(len(middles), -1), axis=1)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    added = len(points) + number.reshape(len(cells), len(new))
    return complete, np.vstack([points, middles[first]]), np.hstack([cells, added])


def _check_plane(points: Array, surface: int, source: str) -> None:
    """Refuse a surface that is not parallel to the x-y plane: its nodes would lose their z.

    The ``points`` are those of its cells, of shape (nodes, 3) [m].
    """
    extent = np.ptp(points, axis=0)
    if extent[2] > FLAT * max(extent):
        raise ValueError(
            f"{source}: surface {surface} leaves the x-y plane: its z spans {extent[2]:.4g} m; "
            "turn the part into the x-y plane; for a body in space mesh its volume, and make it a "
            "physical volume"
        )
