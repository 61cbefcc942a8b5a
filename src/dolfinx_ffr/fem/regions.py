# SPDX-License-Identifier: MIT
"""Facets or cells of a mesh, selected by a predicate, by their numbers, or by a mask."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from dolfinx import mesh
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..arrays import Array, Mask
from ..parallel import on_every_rank

Predicate = Callable[[Array], Mask]


def located(
    domain: mesh.Mesh, what: str, where: Predicate | ArrayLike, dim: int
) -> NDArray[np.int32]:
    """Numbers of boundary facets, or of cells, by dimension: by a predicate, numbers or a mask."""
    facets = dim < domain.topology.dim
    entities = domain.topology.index_map(dim)
    sizes = entities.size_local, entities.size_local + entities.num_ghosts
    with on_every_rank(domain.comm, what):
        if not callable(where):
            found = _numbers_of(what, where, "facets" if facets else "cells", sizes)
        else:
            _check_predicate(what, where, domain.geometry.x.T)
    if callable(where):
        locate = mesh.locate_entities_boundary if facets else mesh.locate_entities
        found = np.asarray(locate(domain, dim, where), dtype=np.int32)
    return found


def located_cells(domain: mesh.Mesh, what: str, where: Predicate | ArrayLike | None) -> Mask:
    """Mask over the cells owned by this rank, true where they are selected; None selects none."""
    dim = domain.topology.dim
    n = int(domain.topology.index_map(dim).size_local)
    chosen = np.zeros(n, dtype=bool)
    if where is not None:
        cells = located(domain, what, where, dim)
        chosen[cells[cells < n]] = True
    return chosen


def _check_predicate(what: str, predicate: Predicate, points: Array) -> None:
    """Refuse a predicate that does not say yes or no for each point, shape (3, points)."""
    try:
        given = predicate(points)
    except Exception as error:
        raise ValueError(f"{what}: the predicate fails on an array of points: {error}") from error
    found = np.asarray(given)
    if found.dtype != np.bool_ or found.shape != points.shape[1:]:
        raise ValueError(
            f"{what}: the predicate must give True or False for each of {points.shape[1]} points, "
            f"but it gives an array of shape {found.shape} of {found.dtype}; write a comparison, "
            "as lambda x: x[0] < 0.01"
        )


def _numbers_of(
    what: str, given: ArrayLike, kind: str, sizes: tuple[int, int]
) -> NDArray[np.int32]:
    """The given numbers, or those where a mask is true; the sizes are without and with ghosts."""
    array = np.asarray(given)
    if array.shape == (0,):  # a rank may have none
        return array.astype(np.int32)
    if array.dtype == np.bool_ and array.ndim == 1:
        if array.size not in sizes:
            raise ValueError(
                f"{what}: a mask must have one entry for each of the rank's {sizes[0]} {kind} "
                f"({sizes[1]} with ghosts), but it has {array.size}"
            )
        return np.flatnonzero(array).astype(np.int32)
    if array.dtype.kind not in "iu" or array.ndim != 1:
        raise TypeError(
            f"{what} must be a predicate, numbers of {kind} or a mask over them, but it is "
            f"{validation.described(given)}"
        )
    outside = array[(array < 0) | (array >= sizes[1])]
    if outside.size:
        raise ValueError(
            f"{what}: {kind[:-1]} {outside[0]} does not exist; the rank has the {kind} 0 to "
            f"{sizes[1] - 1}"
        )
    return np.unique(array).astype(np.int32)
