# SPDX-License-Identifier: MIT
"""Files of gmsh: damaged ones are refused in words; gaps in numbers, regions by predicates."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_ffr import Domain
from dolfinx_ffr.fem import gmsh_model, mesh_file

#: A strip of 4 x 1 with four triangles to each square: nodes of the two rows, then of the middles
CORNERS = [(x, y, 0) for y in (0, 1) for x in range(5)]
NODES = [*CORNERS, *((x + 0.5, 0.5, 0) for x in range(4))]
TRIANGLES = [
    (a, b, 11 + k)
    for k in range(4)
    for a, b in ((1 + k, 2 + k), (2 + k, 7 + k), (7 + k, 6 + k), (6 + k, 1 + k))
]


def strip(skip: int = 0) -> bytes:
    """The strip as a file, with a number left out after each node."""
    number = [1 + (1 + skip) * i for i in range(len(NODES))]
    nodes = "\n".join(f"{n} {x} {y} {z}" for n, (x, y, z) in zip(number, NODES, strict=True))
    cells = [f"1 2 1 1 {number[0]} {number[5]}", f"1 2 2 2 {number[4]} {number[9]}"]
    cells += [f"2 2 3 3 {' '.join(str(number[i - 1]) for i in t)}" for t in TRIANGLES]
    elements = "\n".join(f"{i} {cell}" for i, cell in enumerate(cells, 1))
    text = (
        '$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n3\n1 1 "left"\n1 2 "right"\n'
        f'2 3 "part"\n$EndPhysicalNames\n$Nodes\n{len(NODES)}\n{nodes}\n$EndNodes\n'
        f"$Elements\n{len(cells)}\n{elements}\n$EndElements\n"
    )
    return text.encode()


def written(comm: MPI.Intracomm, folder: Path, data: bytes) -> Path:
    path = folder / "strip.msh"
    if comm.rank == 0:
        path.write_bytes(data)
    comm.Barrier()
    return path


@pytest.mark.mpi
@pytest.mark.parametrize("skip", [0, 2])
def test_regions_by_predicates(comm: MPI.Intracomm, shared_tmp_path: Path, skip: int) -> None:
    """Those of `Domain`, also where the nodes' numbers have gaps."""
    path = written(comm, shared_tmp_path, strip(skip))
    body = Domain.from_gmsh(comm, path, solid=lambda x: x[0] < 1.0 + 1e-9)
    assert body.area == pytest.approx(4.0, rel=1e-12)
    assert body.sum(body.cell_volumes * body.solid_cells) == pytest.approx(1.0, rel=1e-12)
    body = Domain.from_gmsh(comm, path, void=lambda x: np.abs(x[1] - 0.8) < 0.31)
    assert body.sum(body.cell_volumes * body.void_cells) == pytest.approx(1.0, rel=1e-12)
    with pytest.raises(ValueError, match="void: the predicate must give True or False"):
        Domain.from_gmsh(comm, path, void=lambda x: x[0])  # type: ignore[arg-type, return-value]


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("part", "damaged", "message"),
    [
        (b"\n13 2.5 0.5 0\n", b"\n13 2.5  .5\n", "is not a mesh that gmsh can read"),
        (b"\n5 2 2 3 3 7 6 11\n", b"\n5 2 2 3 3 1 2 11\n", "more than two cells share a side"),
        (b" 3 3 7 6 11\n", b" 3 3 7 7 11\n", "a cell has the same node twice"),
        (
            b"\n13 2.5 0.5 0\n",
            b"\n13 2.5 nan 0\n",
            "no finite position|is not a mesh that gmsh can read",
        ),
        (b"left", b"l\xf2ft", "a name that is no text"),
    ],
)
def test_damaged_files(
    comm: MPI.Intracomm, shared_tmp_path: Path, part: bytes, damaged: bytes, message: str
) -> None:
    """By the first gmsh itself dies, by the others DOLFINx did."""
    assert part in strip()
    path = written(comm, shared_tmp_path, strip().replace(part, damaged))
    with pytest.raises(ValueError, match=message):
        Domain.from_gmsh(comm, path)


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("while True: pass", "not done after 0 s"),
        ("import os; os.abort()", r"crashes \(signal 6\)"),
    ],
)
def test_a_reader_that_fails(
    comm: MPI.Intracomm,
    shared_tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    program: str,
    message: str,
) -> None:
    """It hangs or dies in a process of its own."""
    path = written(comm, shared_tmp_path, strip())
    monkeypatch.setattr(mesh_file, "_TRIAL", program)
    monkeypatch.setattr(mesh_file, "_PATIENCE", 0.4 if "while" in program else 60.0)
    with pytest.raises(ValueError, match=message):
        Domain.from_gmsh(comm, path)


def test_models_of_the_program_stay(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """A file is read while the program has a model in gmsh, which is the current one afterwards."""
    path = written(comm, shared_tmp_path, strip())
    with gmsh_model() as gmsh:
        before = gmsh.model.list(), gmsh.model.getCurrent()
        gmsh.model.occ.addPoint(0.0, 0.0, 0.0)
        gmsh.model.occ.synchronize()
        Domain.from_gmsh(comm, path)
        assert (gmsh.model.list(), gmsh.model.getCurrent()) == before
        assert len(gmsh.model.getEntities(0)) == 1
