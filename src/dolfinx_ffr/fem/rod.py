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
    shape: str,
    comm: MPI.Comm,
    sizes: Sequence[float],
    elements: Sequence[int],
    cell: str,
    solid_ends: tuple[int, float | None],
    solid: Predicate | None,
) -> tuple[mesh.Mesh, dict[str, Predicate], Mask]:
    """A rod along x: mesh, interfaces ``"left"`` and ``"right"``, mask of cells that stay solid."""
    dim = len(sizes)
    validation.instance(f"{shape}: comm", comm, MPI.Comm, "an MPI communicator")
    for name, size in zip(("length", "height", "width"), sizes, strict=False):
        validation.number(f"{shape}: {name}", size, above=0.0, unit="m")
    high = np.array(sizes, dtype=np.float64)
    expected = "two numbers" if dim == 2 else "three numbers"
    validation.real_array(f"{shape}: elements", elements, (dim,), expected=expected)
    counts = [validation.integer(f"{shape}: elements", n, least=1) for n in elements]
    pieces = "columns" if dim == 2 else "layers"
    name, length = f"{shape}: solid_{pieces}", float(high[0])
    layers, solid_length = solid_ends
    if solid_length is not None:
        name, half = f"{shape}: solid_length", 0.5 * length
        solid_length = validation.number(name, solid_length, above=0.0, below=half, unit="m")
        layers = max(1, round(solid_length * counts[0] / length))
    if 2 * validation.integer(name, layers) >= counts[0]:
        raise ValueError(
            f"{name} = {layers} leaves nothing to design among {counts[0]} element {pieces}; take "
            f"more elements along the rod, or a smaller {name}"
        )
    # of triangles each rectangle is cut into four, of tetrahedra each box into six
    count = math.prod(counts) * {"triangle": 4, "tetrahedron": 6}.get(cell, 1)
    room = agreed_memory(comm) * comm.size
    with on_every_rank(comm, shape):
        check_count(shape, count, "cells", "take fewer elements", each=_BYTES, available=room)
    kind = getattr(mesh.CellType, validation.choice(f"{shape}: cell", cell, _CELLS[dim]))
    low = np.array([0.0, *-0.5 * high[1:]])
    make = mesh.create_rectangle if dim == 2 else mesh.create_box
    options = {"diagonal": mesh.DiagonalType.crossed} if cell == "triangle" else {}
    domain = make(comm, [low, low + high], counts, kind, **options)
    eps, inner = 1e-6 * length / counts[0], layers * length / counts[0]
    if solid_length is not None:  # the columns, and those between, are fitted
        ends, fitted = ([0.0, a, length - a, length] for a in (inner, solid_length))
        domain.geometry.x[:, 0] = np.interp(domain.geometry.x[:, 0], ends, fitted)
        inner = solid_length
    solid_cells = located_cells(domain, f"{shape}: solid", solid)
    if layers:
        # one end after the other: a single layer between both has all its nodes in one of them
        solid_cells |= located_cells(domain, name, lambda x: x[0] < inner + eps)
        solid_cells |= located_cells(domain, name, lambda x: x[0] > length - inner - eps)
    return (
        domain,
        {"left": lambda x: x[0] < eps, "right": lambda x: x[0] > length - eps},
        solid_cells,
    )
