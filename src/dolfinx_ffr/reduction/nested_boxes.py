# SPDX-License-Identifier: MIT
"""Interpolation between nested boxes, for meshes whose nodes stand on a lattice.

Such are the meshes of `Domain.rectangle` and `Domain.box` but for crossed triangles. A coarse
lattice keeps every second plane of nodes and the last one, so its nodes are some of the finer ones,
on whose ranks they are. Between them displacements are linear along each axis, on any planes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np

from ..arrays import Array, Integers, Mask
from ..fem import Elasticity


@dataclass(frozen=True)
class LatticeOptions:
    """What is a lattice, and how far it is made coarser."""

    same_plane: float = 1e-8  #: Relative difference of coordinates of nodes on one plane
    #: Least number of planes across which is halved: with fewer the coarse boxes are too stiff in
    #: bending
    least_planes: int = 5
    alike_pitches: float = 1.5  #: Ratio of pitches up to which axes are halved together


LATTICE = LatticeOptions()


def interpolations(elasticity: Elasticity, clamped: Mask) -> list[PETSc.Mat] | None:
    """Matrices from the second finest lattice to the dofs of the body, and on, or None.

    Fields vanish at ``clamped`` dofs (dofs of this rank,); None is for nodes on no lattice.
    """
    planes = _planes(elasticity)
    if planes is None:
        return None
    comm = elasticity.comm
    places = _places(elasticity.coordinates(), planes)
    free = ~clamped[:: elasticity.dimension]
    matrices: list[PETSc.Mat] = []
    while True:
        # elements that are longer along an axis couple less there: first the others get as long
        pitches = np.array([np.ptp(p) / (len(p) - 1) for p in planes])
        halved = pitches <= LATTICE.alike_pitches * pitches.min()
        if any(len(p) < LATTICE.least_planes for p, h in zip(planes, halved, strict=True) if h):
            return matrices
        coarse_planes = [
            _halved(len(p)) if h else np.arange(len(p)) for p, h in zip(planes, halved, strict=True)
        ]
        shape = tuple(map(len, coarse_planes))
        # number in the coarse lattice of each plane of the finer one, or -1
        numbers = [np.full(len(p), -1) for p in planes]
        for number, k in zip(numbers, coarse_planes, strict=True):
            number[k] = np.arange(len(k))
        coarse = np.column_stack([n[p] for n, p in zip(numbers, places.T, strict=True)])
        coarse = coarse[free & np.all(coarse >= 0, axis=1)]
        # where each node of the coarse lattice stands among the rows; -1 where it is clamped
        rows = np.full(math.prod(shape), -1, dtype=np.int64)
        of_ranks = comm.allgather(np.ravel_multi_index(tuple(coarse.T), shape))
        order = np.concatenate(of_ranks)
        rows[order] = np.arange(len(order))
        matrices.append(
            _interpolation(elasticity, (planes, coarse_planes), places, free, rows, len(coarse))
        )
        places, planes = coarse, [p[k] for p, k in zip(planes, coarse_planes, strict=True)]
        free = np.ones(len(places), dtype=bool)


def _planes(elasticity: Elasticity) -> list[Array] | None:
    """The coordinates of the planes of nodes along each axis, or None if there is no lattice."""
    comm, coordinates = elasticity.comm, elasticity.coordinates()
    of_rank = [_distinct(x) for x in coordinates.T]
    nodes = elasticity.n_dofs_global // elasticity.dimension
    if comm.allreduce(int(math.prod(map(len, of_rank)) > nodes)):
        return None
    planes = [_distinct(np.concatenate(comm.allgather(x))) for x in of_rank]
    return planes if math.prod(map(len, planes)) == nodes else None


def _distinct(x: Array) -> Array:
    """Sorted numbers without those that equal the one before to round-off."""
    x = np.sort(x)
    return x[np.diff(x, prepend=-np.inf) > LATTICE.same_plane * np.ptp(x)] if len(x) else x


def _places(coordinates: Array, planes: list[Array]) -> Integers:
    """The numbers of the planes on which nodes stand, shape (nodes, dimension)."""
    between = [0.5 * (p[1:] + p[:-1]) for p in planes]
    return np.column_stack(
        [np.searchsorted(b, x) for b, x in zip(between, coordinates.T, strict=True)]
    )


def _halved(number: int) -> Integers:
    """Every second plane and the last one."""
    return np.union1d(np.arange(0, number, 2), [number - 1])


def _interpolation(
    elasticity: Elasticity,
    lattice: tuple[list[Array], list[Integers]],
    places: Integers,
    free: Mask,
    rows: Integers,
    n_coarse: int,
) -> PETSc.Mat:
    """Displacements at ``places`` of a lattice from those at the rows of the coarser one.

    The ``lattice`` has all planes and the coarse ones; this rank has ``n_coarse`` coarse nodes.
    """
    d, (planes, coarse_planes) = elasticity.dimension, lattice
    shape = tuple(map(len, coarse_planes))
    numbers, weights = np.zeros((len(places), 1), dtype=np.int64), np.ones((len(places), 1))
    for axis, (x, k) in enumerate(zip(planes, coarse_planes, strict=True)):
        place = places[:, axis]
        right = np.clip(np.searchsorted(k, place), 1, len(k) - 1)
        low, high = x[k[right - 1]], x[k[right]]
        share = (x[place] - low) / (high - low)
        neighbours, shares = (
            np.stack([right - 1, right], axis=1),
            np.stack([1.0 - share, share], axis=1),
        )
        numbers = (numbers[:, :, None] * shape[axis] + neighbours[:, None]).reshape(len(places), -1)
        weights = (weights[:, :, None] * shares[:, None]).reshape(len(places), -1)
    columns = rows[numbers]
    used = free[:, None] & (columns >= 0) & (weights > 0.0)
    # each node's row stands d times in turn, one time for each displacement
    ends = np.cumsum(np.repeat(np.count_nonzero(used, axis=1), d))
    columns = (d * columns[:, None] + np.arange(d)[:, None])[np.repeat(used[:, None], d, axis=1)]
    matrix = PETSc.Mat().createAIJ(
        ((d * len(places), PETSc.DETERMINE), (d * n_coarse, PETSc.DETERMINE)),
        csr=(
            np.concatenate([[0], ends]).astype(PETSc.IntType),
            columns.astype(PETSc.IntType),
            np.repeat(weights[:, None], d, axis=1)[np.repeat(used[:, None], d, axis=1)],
        ),
        comm=elasticity.comm,
    )
    matrix.assemble()
    return matrix
