# SPDX-License-Identifier: MIT
"""Which facets or cells of a mesh are meant: by a predicate, by their numbers, or by a mask."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from dolfinx import mesh
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..parallel import on_every_rank

__all__ = ["Predicate", "located", "located_cells"]

Predicate = Callable[[NDArray[np.float64]], NDArray[np.bool_]]


def located(
    domain: mesh.Mesh, what: str, where: Predicate | ArrayLike, dim: int
) -> NDArray[np.int32]:
    """Boundary facets or cells of this rank that are meant.

    Args:
        domain: The mesh.
        what: Who asks, for the message.
        where: A predicate on coordinates (those all of whose vertices fulfil it), numbers on this
            rank, or a mask over them.
        dim: Dimension of the cells, or one less for facets.

    Returns:
        Their numbers on this rank, shape (found,); ghosts may be among them.

    Raises:
        TypeError: On every rank, if it is something else.
        ValueError: On every rank, if a predicate does not say yes or no for each point, or a number
            does not exist.
    """
    facets = dim < domain.topology.dim
    if callable(where):
        points = domain.geometry.x.T
        with on_every_rank(domain.comm, what):
            _check_predicate(what, where, points)
        locate = mesh.locate_entities_boundary if facets else mesh.locate_entities
        return np.asarray(locate(domain, dim, where), dtype=np.int32)
    entities = domain.topology.index_map(dim)
    sizes = entities.size_local, entities.size_local + entities.num_ghosts
    kind = "facets" if facets else "cells"
    with on_every_rank(domain.comm, what):
        found = _numbers_of(what, where, kind, sizes)
    return found


def located_cells(
    domain: mesh.Mesh, what: str, where: Predicate | ArrayLike | None
) -> NDArray[np.bool_]:
    """Cells owned by this rank that are meant, shape (cells,).

    Args:
        domain: The mesh.
        what: Who asks, for the message.
        where: As for `located`; None stands for no cell.

    Raises:
        TypeError: As `located` does.
        ValueError: As `located` does.
    """
    dim = domain.topology.dim
    n = int(domain.topology.index_map(dim).size_local)
    chosen = np.zeros(n, dtype=bool)
    if where is not None:
        cells = located(domain, what, where, dim)
        chosen[cells[cells < n]] = True
    return chosen


def _check_predicate(what: str, predicate: Predicate, points: NDArray[np.float64]) -> None:
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
    """The numbers of facets or cells, or those where a mask is true.

    Args:
        what: Who asks, for the message.
        given: Numbers, or a mask.
        kind: "facets" or "cells".
        sizes: How many the rank owns, and with its ghosts.
    """
    array = np.asarray(given)
    if array.ndim == 1 and array.size == 0:  # a rank may have none
        return np.zeros(0, dtype=np.int32)
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
