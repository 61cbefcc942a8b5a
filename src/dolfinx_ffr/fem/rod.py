# SPDX-License-Identifier: MIT
"""Meshes of straight rods with rigid ends, in the plane and in space."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
from dolfinx import mesh

from .. import validation
from ..arrays import Mask
from ..limits import check_count
from ..parallel import agreed_memory, on_every_rank
from .interface import Predicate, located_cells

#: Memory that a body takes for a cell, at least [bytes]
_BYTES = 400
_CELLS = {2: ("quadrilateral", "triangle"), 3: ("hexahedron", "tetrahedron")}


def rod_mesh(
    what: str,
    comm: MPI.Comm,
    sizes: Sequence[float],
    elements: Sequence[int],
    cell: str,
    layers: int,
    solid: Predicate | None,
) -> tuple[mesh.Mesh, dict[str, Predicate], Mask]:
    """A rod along x: mesh, interfaces ``"left"`` and ``"right"``, mask of cells that stay solid."""
    dim = len(sizes)
    validation.instance(f"{what}: comm", comm, MPI.Comm, "an MPI communicator")
    for name, size in zip(("length", "height", "width"), sizes, strict=False):
        validation.number(f"{what}: {name}", size, above=0.0, unit="m")
    high = np.array(sizes, dtype=np.float64)
    expected = "two numbers" if dim == 2 else "three numbers"
    validation.real_array(f"{what}: elements", elements, (dim,), expected=expected)
    counts = [validation.integer(f"{what}: elements", n, least=1) for n in elements]
    pieces = "columns" if dim == 2 else "layers"
    name = f"{what}: solid_{pieces}"
    if 2 * validation.integer(name, layers) >= counts[0]:
        raise ValueError(
            f"{name} = {layers} leaves nothing to design among {counts[0]} element {pieces}; "
            f"take more elements along the rod or fewer solid {pieces}"
        )
    # of triangles each rectangle is cut into four, of tetrahedra each box into six
    count = math.prod(counts) * {"triangle": 4, "tetrahedron": 6}.get(cell, 1)
    room = agreed_memory(comm) * comm.size
    with on_every_rank(comm, what):
        check_count(what, count, "cells", "take fewer elements", each=_BYTES, available=room)
    kind = getattr(mesh.CellType, validation.choice(f"{what}: cell", cell, _CELLS[dim]))
    low = np.zeros(dim)
    high[1:] *= 0.5
    low[1:] = -high[1:]
    if dim == 2:
        options = {"diagonal": mesh.DiagonalType.crossed} if cell == "triangle" else {}
        domain = mesh.create_rectangle(comm, [low, high], counts, kind, **options)
    else:
        domain = mesh.create_box(comm, [low, high], counts, kind)
    length = float(high[0])
    eps = 1e-6 * length / counts[0]
    inner = layers * length / counts[0]
    kept = located_cells(domain, f"{what}: solid", solid)
    if layers:
        kept |= located_cells(
            domain, name, lambda x: (x[0] < inner + eps) | (x[0] > length - inner - eps)
        )
    return domain, {"left": lambda x: x[0] < eps, "right": lambda x: x[0] > length - eps}, kept
