# SPDX-License-Identifier: MIT
"""Meshes of straight rods with rigid ends, in the plane and in space."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
from dolfinx import mesh
from numpy.typing import NDArray

from .. import validation
from .regions import Predicate, located_cells

__all__ = ["rod_mesh"]

_CELLS = {
    2: {"quadrilateral": mesh.CellType.quadrilateral, "triangle": mesh.CellType.triangle},
    3: {"hexahedron": mesh.CellType.hexahedron, "tetrahedron": mesh.CellType.tetrahedron},
}


def rod_mesh(
    what: str,
    comm: MPI.Comm,
    sizes: Sequence[float],
    elements: Sequence[int],
    cell: str,
    layers: int,
    solid: Predicate | None,
) -> tuple[mesh.Mesh, dict[str, Predicate], NDArray[np.bool_]]:
    """A rod along x from x = 0, symmetric about the other axes.

    Args:
        what: Who asks, for messages.
        comm: Communicator over which the mesh is distributed.
        sizes: Length, height and in space width [m].
        elements: Numbers of elements along each.
        cell: Name of the cells.
        layers: Layers of elements at each end that are not designed.
        solid: Further cells that stay solid.

    Returns:
        The mesh, the interfaces ``"left"`` and ``"right"``, and the cells of this rank that stay
        solid.

    Raises:
        TypeError: If an argument is of a wrong kind.
        ValueError: If a number is out of range.
    """
    dim = len(sizes)
    validation.instance(f"{what}: comm", comm, MPI.Comm, "an MPI communicator")
    high = np.array(
        [
            validation.number(f"{what}: {name}", size, above=0.0, unit="m")
            for name, size in zip(("length", "height", "width"), sizes, strict=False)
        ]
    )
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
    kind = _CELLS[dim][validation.choice(f"{what}: cell", cell, _CELLS[dim])]
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

    def at_the_ends(x: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.asarray((x[0] < inner + eps) | (x[0] > length - inner - eps))

    kept = located_cells(domain, f"{what}: solid", solid)
    if layers:
        kept |= located_cells(domain, name, at_the_ends)
    ends: dict[str, Predicate] = {
        "left": lambda x: x[0] < eps,
        "right": lambda x: x[0] > length - eps,
    }
    return domain, ends, kept
