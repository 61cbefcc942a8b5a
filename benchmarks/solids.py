# SPDX-License-Identifier: MIT
"""What a cut element is worth in space: psi by shares of elements, and on a mesh that fits."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from designs import EXPONENTS, shares
from jobs import Job, Progress
from numpy.typing import NDArray
from report import Table, write_page
from scene import demo

import dolfinx_ffr as ffr

__all__ = ["cut_solids", "report_solids", "solids_jobs"]

Array = NDArray[np.float64]

#: Elements on which exponents are tried: cell and order
ELEMENTS = [("hexahedron", 1), ("hexahedron", 2), ("tetrahedron", 1), ("tetrahedron", 2)]


def _plates(points: Array) -> Array:
    """Two plates above and below, positive inside [m]; no face is an element's."""
    return np.abs(points[:, 1]) - 0.0034


def _struts(points: Array) -> Array:
    """Four bars along the edges, and slanted struts between them [m]."""
    x, y, z = points.T
    bars = np.minimum(np.abs(y) - 0.0034, np.abs(z) - 0.0021)
    pitch = 0.05
    along = np.abs((x + 0.011) % pitch - 0.5 * pitch) - 0.5 * pitch * np.abs(y) / 0.01
    webs = np.minimum(0.0032 - 0.37 * np.abs(along), np.abs(z) - 0.0021)
    return np.maximum(bars, webs)


def _cavities(points: Array) -> Array:
    """Round cavities [m]."""
    x = (points[:, 0] + 0.013) % 0.03 - 0.015
    return np.sqrt(x**2 + points[:, 1] ** 2 + points[:, 2] ** 2) - 0.0067


SHAPES: dict[str, Callable[[Array], Array]] = {
    "plates": _plates,
    "struts": _struts,
    "cavities": _cavities,
}


def solids_jobs(*, quick: bool) -> list[Job]:
    """The measurements."""
    elements = [16, 3, 2] if quick else [60, 6, 5]
    return [
        Job(
            "solids",
            "cut_solids",
            6.0 if quick else 200.0,
            {"shape": shape, "elements": elements, "steps": 200 if quick else 400},
        )
        for shape in list(SHAPES)[: 1 if quick else None]
    ]


def cut_solids(
    comm: MPI.Comm, progress: Progress, *, shape: str, elements: tuple[int, int, int], steps: int
) -> dict[str, Any]:
    """Psi of one boundary by shares of cut elements, for exponents and kinds of elements.

    Args:
        comm: Ignored: one rank.
        progress: Told the share that is done.
        shape: Name of the boundary.
        elements: Of the meshes.
        steps: Of the motion.
    """
    crank, distance = demo("spatial_slider_crank"), SHAPES[shape]
    fine, change = 0.0, 0.0
    rows = []
    for k, (cell, order) in enumerate(ELEMENTS):
        rod = ffr.Domain.box(
            MPI.COMM_SELF,
            crank.ROD,
            *crank.SECTION,
            elements=tuple(elements),
            cell=cell,
            order=order,
        )
        problem = crank.spatial_problem(MPI.COMM_SELF, domain=rod, steps=steps, modes=16)
        body = problem.flexible["rod"]
        x = shares(rod, distance, 12 if cell == "hexahedron" else 8)
        if not k:
            solid = ffr.Solid(rod, distance, material=body.material)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ffr.PartWarning)
                found = solid.verify(
                    problem, problem.value(x), size=0.7 * rod.cell_size, tolerance=1e-9
                )
            fine, change = found.psi, found.change
        row: dict[str, Any] = {"shape": shape, "cell": cell, "order": order, "change": change}
        for exponent in EXPONENTS:
            law = problem.with_bodies({"rod": body.with_interpolation(ffr.SIMP(exponent=exponent))})
            row[f"p {exponent:g}"] = law.value(x).psi / fine - 1.0
        rows.append(row)
        progress((k + 1) / len(ELEMENTS))
    return {"rows": rows}


def report_solids(results: list[tuple[Job, dict[str, Any]]], directory: Path) -> list[Table]:
    """Write the table.

    Args:
        results: Of `solids_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    table = Table(
        "solids_cut_elements",
        "What a cut element is worth in space",
        "psi of the rod of the slider-crank in space, whose boundary is given, by shares of "
        "elements with exponent p, over that of tetrahedra of order 2 which fit the boundary, "
        "minus one. 60 x 6 x 5 hexahedra, or six tetrahedra in the place of each, so that members "
        "are two to three hexahedra wide; 16 modes. *Mesh* is the last change of the latter, by "
        "four times as many tetrahedra.",
        {
            "shape": "boundary",
            "cell": "element",
            "order": "order",
            **{f"p {p:g}": f"p = {p:g}" for p in EXPONENTS},
            "change": "mesh",
        },
        [row for _, result in results for row in result["rows"]],
    )
    write_page(directory, "solids", "Solids of designs in space", "", [table])
    return [table]
