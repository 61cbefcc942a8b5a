# SPDX-License-Identifier: MIT
"""A body in space as tetrahedra, all of them on rank 0, and a body made of such tetrahedra.

They know which of their faces are interfaces and which of them are not designed, so that what is
cut out of them knows it too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

from mpi4py import MPI

import basix
import numpy as np
from numpy.typing import NDArray

from ..parallel import on_every_rank
from . import _compat
from .domain import Domain
from .gathered_mesh import CORNERS, GatheredMesh

__all__ = ["DESIGNED", "SOLID", "VOID", "Tetrahedra", "numbered"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Regions of a body
DESIGNED, SOLID, VOID = 0, 1, 2
#: Corners of the faces of a hexahedron in the order of VTK
_FACES = np.array(
    [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [0, 3, 2, 1], [4, 5, 6, 7]]
)
#: Corners of a hexahedron in the order of VTK
_CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)
#: The eight tetrahedra in one, by the pairs of corners in whose middles their corners are
_RED = np.array(
    [
        [[0, 0], [0, 1], [0, 2], [0, 3]],
        [[0, 1], [1, 1], [1, 2], [1, 3]],
        [[0, 2], [1, 2], [2, 2], [2, 3]],
        [[0, 3], [1, 3], [2, 3], [3, 3]],
        [[0, 1], [0, 2], [0, 3], [1, 3]],
        [[0, 1], [0, 2], [1, 2], [1, 3]],
        [[0, 2], [0, 3], [1, 3], [2, 3]],
        [[0, 2], [1, 2], [1, 3], [2, 3]],
    ]
)
#: Most tetrahedra of a body: what is cut out of them has fewer than 2^21 points, below which three
#: numbers of points make one of 64 bits
_MOST = 4_000_000
#: Steps in which coordinates are told apart, over the size of the body
_STEPS = 2**20


@dataclass(frozen=True, eq=False)
class Tetrahedra:
    """Tetrahedra with straight edges; everything on rank 0, empty arrays on the other ranks."""

    points: Array  #: (points, 3) [m]
    cells: Integers  #: (cells, 4) points of each
    #: (cells, 4) number of the interface of the face opposite of each corner, -1 where it is none
    facets: Integers
    regions: Integers  #: (cells,) `DESIGNED`, `SOLID` or `VOID`

    @staticmethod
    def of(domain: Domain, finer: int = 0) -> Tetrahedra:
        """A body in space, its cells cut into tetrahedra; collective.

        Faces between cells are cut in the same way from both sides.

        Args:
            domain: Of hexahedra or tetrahedra; curved cells are taken to be straight.
            finer: 0, 1, 2, ... for ever smaller tetrahedra. Hexahedra become 12, 24, 96, 192, 324,
                ... of them, tetrahedra 1, 8, 64, ...

        Raises:
            ValueError: On every rank, if they would be more than four millions.
        """
        Tetrahedra.check(domain, finer)
        mesh = GatheredMesh.of(domain)
        regions = np.where(domain.void_cells, VOID, np.where(domain.solid_cells, SOLID, DESIGNED))
        regions, facets = mesh.cell_values(regions), mesh.cell_values(_facets(domain))
        if domain.comm.rank:
            none = np.zeros((0, 4), dtype=np.int64)
            return Tetrahedra(mesh.points, none, none, np.zeros(0, dtype=np.int64))
        points, cells = mesh.points, mesh.cells
        if cells.shape[1] == 4:
            for _ in range(finer):
                weights = np.mean(np.eye(4)[_RED], axis=2)
                points, cells, facets, regions = _divided(points, cells, facets, regions, weights)
            return Tetrahedra(points, cells, facets, regions)
        if finer > 1:
            weights = _cubes(finer // 2 + 1)
            points, cells, facets, regions = _divided(points, cells, facets, regions, weights)
        return _split(points, cells, facets, regions, with_faces=finer % 2 == 1)

    @staticmethod
    def size(domain: Domain, finer: int = 0) -> float:
        """Edge of the cube that six mean tetrahedra fill [m].

        Args:
            domain: As for `of`.
            finer: As for `of`.
        """
        return domain.cell_size * (6.0 / Tetrahedra.each(domain, finer)) ** (1.0 / 3.0)

    @staticmethod
    def check(domain: Domain, finer: int) -> None:
        """Refuse more tetrahedra than can be cut.

        Args:
            domain: As for `of`.
            finer: As for `of`.

        Raises:
            ValueError: On every rank, if they would be more than four millions.
        """
        count = domain.n_cells_global * Tetrahedra.each(domain, finer)
        if count > _MOST:
            raise ValueError(
                f"solid: {count:,} tetrahedra are more than the {_MOST:,} that can be cut; ask for "
                "a larger size or fewer meshes"
            )

    @staticmethod
    def each(domain: Domain, finer: int) -> int:
        """Number of tetrahedra that a cell becomes.

        Args:
            domain: As for `of`.
            finer: As for `of`.
        """
        if domain.cell == "tetrahedron":
            return int(8**finer)
        return 12 * (1 + finer % 2) * (finer // 2 + 1) ** 3

    def domain(
        self,
        comm: MPI.Comm,
        names: Sequence[str],
        centers: Mapping[str, Sequence[float]],
        order: int,
    ) -> Domain:
        """A body of these tetrahedra; collective. Void ones are left out.

        Args:
            comm: Communicator over which it is distributed.
            names: Of the interfaces, by their numbers; those without a facet are left out.
            centers: Reference points of the interfaces [m].
            order: Polynomial order of the displacements.

        Raises:
            ValueError: On every rank, as `Domain`.
        """
        with on_every_rank(comm, "a body of tetrahedra"):
            there = self.regions != VOID
            used, cells = np.unique(self.cells[there], return_inverse=True)
            cells = cells.reshape(-1, 4)
            tags, solid = self.facets[there], self.regions[there] == SOLID
            sides = cells[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]]
            triples = {n: np.sort(sides[tags == i], axis=1) for i, n in enumerate(names)}
        triples, solid = comm.bcast((triples, solid))
        mesh = _compat.create_mesh(comm, cells, self.points[used], "tetrahedron", 1)
        corners = _compat.entity_vertices(mesh, 3)
        node = np.zeros(int(corners.max(initial=-1)) + 1, dtype=np.int64)
        number = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
        node[corners] = number[_compat.cell_geometry(mesh)]
        sides = np.sort(node[_compat.entity_vertices(mesh, 2)], axis=1)
        held = {
            name: np.flatnonzero(_among(sides, triple)).astype(np.int32)
            for name, triple in triples.items()
            if len(triple)
        }
        mine = np.asarray(mesh.topology.original_cell_index)
        chosen = solid[mine[: mesh.topology.index_map(3).size_local]]
        kept = {name: center for name, center in centers.items() if name in held}
        # a part all of which stays solid has nothing that could be designed again
        return Domain(mesh, held, None if np.all(solid) else chosen, order=order, centers=kept)


def _among(rows: Integers, of: Integers) -> NDArray[np.bool_]:
    """Which rows of three numbers below two millions are among others."""
    scale = np.array([2**42, 2**21, 1])
    return np.isin(rows @ scale, of @ scale)


def _facets(domain: Domain) -> Integers:
    """Number of the interface of each facet of the cells of this rank, -1 where it is none.

    Facets of tetrahedra are numbered by the corner opposite of them, those of hexahedra as above.
    """
    topology = domain.mesh.topology
    tag = np.full(
        topology.index_map(2).size_local + topology.index_map(2).num_ghosts, -1, dtype=np.int64
    )
    for i, part in enumerate(domain.interfaces.values()):
        tag[part.facets] = i
    sides = [list(side) for side in basix.topology(getattr(basix.CellType, domain.cell))[2]]
    order = CORNERS[domain.cell]
    if domain.cell == "tetrahedron":
        wanted = [{0, 1, 2, 3} - {i} for i in range(4)]
    else:
        wanted = [{order[i] for i in side} for side in _FACES]
    columns = [next(k for k, side in enumerate(sides) if set(side) == w) for w in wanted]
    of_cells = np.asarray(topology.connectivity(3, 2).array).reshape(-1, len(sides))
    return np.asarray(tag[of_cells[: domain.n_cells][:, columns]])


def numbered(points: Array) -> tuple[Array, Integers]:
    """Points that are told apart, and the number of each given one among them.

    Args:
        points: Shape (n, 3) [m].
    """
    low = points.min(axis=0)
    step = float(np.max(np.ptp(points, axis=0))) / _STEPS
    # off the round numbers: one and the same point would be rounded to either side of a half
    whole = np.floor((points - low) / step + 0.3127).astype(np.int64)
    _, first, which = np.unique(
        whole @ np.array([2**42, 2**21, 1]), return_index=True, return_inverse=True
    )
    return points[first], which


def _cubes(n: int) -> Array:
    """Corners of n^3 parts of a cube by weights of its own corners, (parts, 8, 8)."""
    parts = np.array(list(product(range(n), repeat=3)))
    where = (parts[:, None, :] + _CUBE) / n
    factors = np.where(_CUBE == 1, where[:, :, None, :], 1.0 - where[:, :, None, :])
    return np.asarray(np.prod(factors, axis=3))


def _divided(
    points: Array, cells: Integers, facets: Integers, regions: Integers, weights: Array
) -> tuple[Array, Integers, Integers, Integers]:
    """Cells divided into ones of the same kind, by weights (parts, corners, corners)."""
    parts, corners = weights.shape[:2]
    places = np.einsum("pkc,nci->npki", weights, points[cells])
    points, which = numbered(places.reshape(-1, 3))
    sides = _FACES if corners == 8 else np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    # a side of a part is on that side of the cell whose corners alone give its corners
    tags = np.full((len(cells), parts, len(sides)), -1, dtype=np.int64)
    for part, i in product(range(parts), range(len(sides))):
        needed = np.any(weights[part, sides[i]] > 1e-12, axis=0)
        for j, side in enumerate(sides):
            if not np.any(np.delete(needed, side)):
                tags[:, part, i] = facets[:, j]
    return (
        points,
        which.reshape(-1, corners),
        tags.reshape(-1, len(sides)),
        np.repeat(regions, parts),
    )


def _split(
    points: Array, cells: Integers, facets: Integers, regions: Integers, *, with_faces: bool
) -> Tetrahedra:
    """Hexahedra as 12 tetrahedra about their middle, or as 24 with those of their faces."""
    sides = cells[:, _FACES]
    middle = len(points) + np.arange(len(cells))
    every = [points, points[cells].mean(axis=1)]
    triangles: list[Integers] = []
    if with_faces:
        flat = np.sort(sides.reshape(-1, 4), axis=1)
        _, first, of = np.unique(flat, axis=0, return_index=True, return_inverse=True)
        every.append(points[flat[first]].mean(axis=1))
        top = len(points) + len(cells) + of.reshape(sides.shape[:2])
        for i in range(4):
            pair = sides[:, :, [(i + 1) % 4, i]]
            triangles.append(np.concatenate([pair, top[:, :, None]], axis=2))
    else:
        # the diagonal from the corner with the smallest number is the same from both sides
        start = np.argmin(sides, axis=2)[:, :, None]
        turned = np.take_along_axis(sides, (start + np.arange(4)) % 4, axis=2)
        triangles = [turned[:, :, [1, 0, 2]], turned[:, :, [2, 0, 3]]]
    found, tags = [], []
    for triangle in triangles:
        inner = np.broadcast_to(middle[:, None, None], (*triangle.shape[:2], 1))
        found.append(np.concatenate([triangle, inner], axis=2).reshape(-1, 4))
        tag = np.full((facets.size, 4), -1, dtype=np.int64)
        tag[:, 3] = facets.ravel()
        tags.append(tag)
    count = len(triangles)
    return Tetrahedra(
        np.vstack(every),
        np.concatenate(found),
        np.concatenate(tags),
        np.tile(np.repeat(regions, 6), count),
    )
