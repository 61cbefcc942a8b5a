# SPDX-License-Identifier: MIT
"""Interpolation between nested boxes, for meshes whose nodes stand on a lattice.

Such are the meshes of `Domain.rectangle` and `Domain.box` but for crossed triangles. A coarse
lattice keeps every second plane of nodes and the last one, so its nodes are some of the finer ones,
on whose ranks they are. Between them displacements are linear along each axis, on any planes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ..arrays import Array, Integers, Mask
from ..fem import Elasticity


@dataclass(frozen=True)
class LatticeOptions:
    """Tolerances for recognising a lattice, and limits of coarsening."""

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
        # number in the coarse lattice of each plane of the finer one, or -1
        numbers = [np.full(len(p), -1) for p in planes]
        for number, k in zip(numbers, coarse_planes, strict=True):
            number[k] = np.arange(len(k))
        coarse = np.column_stack([n[p] for n, p in zip(numbers, places.T, strict=True)])
        coarse = coarse[free & np.all(coarse >= 0, axis=1)]
        whole = reduce(sparse.kron, map(_along_axis, planes, coarse_planes)).tocsr()
        # the coarse lattice in the order of the ranks, without what is clamped
        columns = comm.allgather(_number_in_lattice(coarse, coarse_planes))
        rows = _number_in_lattice(places, planes)
        interpolation = sparse.diags(free.astype(float)) @ whole[rows][:, np.concatenate(columns)]
        matrices.append(_for_displacements(elasticity, interpolation, len(coarse)))
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


def _number_in_lattice(places: Integers, planes: Sequence[NDArray[Any]]) -> Integers:
    return np.ravel_multi_index(tuple(places.T), tuple(map(len, planes)))


def _along_axis(x: Array, coarse: Integers) -> sparse.csr_matrix:
    """Linear interpolation, (planes, coarse planes), from the planes numbered ``coarse`` to all.

    The planes are at ``x`` [m].
    """
    plane = np.arange(len(x))
    right = np.clip(np.searchsorted(coarse, plane), 1, len(coarse) - 1)
    low, high = x[coarse[right - 1]], x[coarse[right]]
    share = (x - low) / (high - low)
    weights = np.concatenate([1.0 - share, share])
    places = np.tile(plane, 2), np.concatenate([right - 1, right])
    return sparse.csr_matrix((weights, places), shape=(len(x), len(coarse)))


def _for_displacements(
    elasticity: Elasticity, interpolation: sparse.csr_matrix, n_coarse: int
) -> PETSc.Mat:
    """Prolongation for all displacement components; this rank has ``n_coarse`` coarse nodes."""
    d = elasticity.dimension
    entries = sparse.kron(interpolation, sparse.identity(d)).tocsr()
    entries.eliminate_zeros()
    entries.sort_indices()
    matrix = PETSc.Mat().createAIJ(
        ((entries.shape[0], PETSc.DETERMINE), (d * n_coarse, PETSc.DETERMINE)),
        csr=(
            entries.indptr.astype(PETSc.IntType),
            entries.indices.astype(PETSc.IntType),
            entries.data,
        ),
        comm=elasticity.comm,
    )
    matrix.assemble()
    return matrix
