# SPDX-License-Identifier: MIT
"""The mesh of a body on rank 0, cut into small triangles that fit it, curved sides included."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
from numpy.typing import NDArray

from ..fem import Domain, _compat
from ..parallel import announce

__all__ = ["DESIGN", "SOLID", "VOID", "Lattice"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: What a cell is: outside of the body or empty for ever, designed, material for ever
VOID, DESIGN, SOLID = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Lattice:
    """Points in and on all cells, triangles between them, and the edges of the mesh.

    Cells share the points on common edges. The cells stand in the order in which the mesh was made,
    so that nothing depends on the number of ranks.
    """

    points: Array  #: (points, 2) [m]
    triangles: Integers  #: (triangles, 3) points, counterclockwise
    kinds: Integers  #: (triangles,) VOID, DESIGN or SOLID
    edges: Integers  #: (edges, 2) points at the ends of each edge of the mesh
    chains: Integers  #: (edges, n + 1) points along each edge, from the first to the second end
    sides: Integers  #: (edges, 2) kinds of the cells at an edge, VOID where there is none
    interface: Integers  #: (edges,) number of the interface, -1 where there is none
    curved: bool  #: Whether the geometry of the mesh is of a higher order than 1

    @staticmethod
    def of(domain: Domain, largest: float) -> Lattice | None:
        """Gather a body; collective.

        Args:
            domain: Its mesh.
            largest: Length of the longest side of a triangle in straight cells [m].

        Returns:
            The lattice on rank 0, None on the other ranks.
        """
        announce(domain.comm, "the boundary of a part")
        kind = getattr(basix.CellType, _compat.cell_name(domain.mesh))
        sent = domain.comm.gather(_local(domain, kind))
        if sent is None:
            return None
        order = np.argsort(np.concatenate([part[0] for part in sent]), kind="stable")
        nodes, x, kinds, marks = (
            np.concatenate([part[i] for part in sent])[order] for i in range(1, 5)
        )
        degree = int(_compat.coordinate_element(domain.mesh).degree)
        return _lattice(kind, degree, nodes, x, kinds, marks, largest)


def _local(domain: Domain, kind: basix.CellType) -> tuple[Any, ...]:
    """Of the cells owned by this rank: order, nodes, positions, kinds, interfaces of the sides."""
    mesh, n = domain.mesh, domain.n_cells
    nodes = _compat.cell_geometry(mesh)[:n]
    sides = len(basix.topology(kind)[1])
    facets = mesh.topology.connectivity(2, 1).array.reshape(-1, sides)[:n]
    marks = np.full((n, sides), -1, dtype=np.int64)
    for i, part in enumerate(domain.interfaces.values()):
        marks[np.isin(facets, part.facets)] = i
    kinds = np.select([domain.void_cells, domain.solid_cells], [VOID, SOLID], DESIGN)
    number = np.asarray(mesh.topology.original_cell_index)[:n]
    names = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)[nodes]
    return number, names, mesh.geometry.x[nodes][:, :, :2], kinds, marks


def _lattice(
    kind: basix.CellType,
    degree: int,
    nodes: Integers,
    x: Array,
    kinds: Integers,
    marks: Integers,
    largest: float,
) -> Lattice:
    reference = basix.geometry(kind)[:, :2]
    corners, ends = len(reference), np.array(basix.topology(kind)[1])
    vertices = np.unique(nodes[:, :corners], return_inverse=True)[1].reshape(-1, corners)
    straight = np.linalg.norm(x[:, ends[:, 0]] - x[:, ends[:, 1]], axis=2)
    # an even number, so that the pattern of a quadrilateral is its own mirror image
    n = 2 * max(1, int(np.ceil(0.5 * float(straight.max()) / largest - 1e-9)))
    where, pattern = _pattern(corners, n)
    element = basix.create_element(
        basix.ElementFamily.P, kind, degree, basix.LagrangeVariant.gll_warped
    )
    table = np.asarray(element.tabulate(0, where / n)).reshape(len(where), -1)
    positions = np.einsum("pn,cnd->cpd", table, x)

    pairs = vertices[:, ends].reshape(-1, 2)
    turned = pairs[:, 0] > pairs[:, 1]
    edges, edge = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    edge, turned = edge.reshape(-1, len(ends)), turned.reshape(-1, len(ends))
    count = int(vertices.max()) + 1
    inner = count + np.arange(len(edges) * (n - 1)).reshape(len(edges), n - 1)
    chains = np.column_stack([edges[:, 0], inner, edges[:, 1]])
    numbers = np.full((len(nodes), len(where)), -1, dtype=np.int64)
    for i, (a, b) in enumerate(reference[ends]):
        steps = np.rint(n * (a + np.linspace(0.0, 1.0, n + 1)[:, None] * (b - a))).astype(int)
        on = [int(np.flatnonzero(np.all(where == step, axis=1))[0]) for step in steps]
        along = chains[edge[:, i]]
        numbers[:, on] = np.where(turned[:, i, None], along[:, ::-1], along)
    rest = np.flatnonzero(numbers[0] < 0)
    total = count + inner.size
    numbers[:, rest] = total + np.arange(len(nodes) * len(rest)).reshape(len(nodes), -1)
    points = np.empty((total + len(nodes) * len(rest), 2))
    points[numbers] = positions

    triangles = numbers[:, pattern]
    turn = _cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]) < 0.0
    triangles[turn] = triangles[turn][:, :, ::-1]
    flat = edge.ravel()
    met = np.argsort(flat, kind="stable")
    first = np.searchsorted(flat[met], np.arange(len(edges)))
    sides = np.zeros((len(edges), 2), dtype=np.int64)
    sides[flat[met], np.arange(len(met)) - first[flat[met]]] = np.repeat(kinds, len(ends))[met]
    interface = np.full(len(edges), -1, dtype=np.int64)
    np.maximum.at(interface, flat, marks.ravel())
    return Lattice(
        points=points,
        triangles=triangles.reshape(-1, 3),
        kinds=np.repeat(kinds, len(pattern)),
        edges=edges,
        chains=chains,
        sides=sides,
        interface=interface,
        curved=degree > 1,
    )


def _pattern(corners: int, n: int) -> tuple[Integers, Integers]:
    """Lattice points of the reference cell times n, and the triangles between them."""
    triangle = corners == 3
    where = [(i, j) for j in range(n + 1) for i in range(n + 1 - j if triangle else n + 1)]
    number = {place: k for k, place in enumerate(where)}
    found = []
    for i, j in where:
        square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        a, b, c, d = (number.get(place) for place in square)
        if triangle:
            found += [t for t in ([a, b, d], [b, c, d]) if None not in t]
        elif None not in (a, b, c, d):
            found += [[a, b, c], [a, c, d]] if (i + j) % 2 else [[a, b, d], [b, c, d]]
    return np.array(where, dtype=np.int64), np.array(found, dtype=np.int64)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
