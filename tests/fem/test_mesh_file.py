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


def strip(skip: int = 0, names: bool = True, alone: int = 0) -> bytes:
    """The strip as a file.

    Numbers are left out after each node by ``skip``, groups have no names without ``names``, and
    so many nodes are ``alone``, without cells, before the others.
    """
    number = [1 + alone + (1 + skip) * i for i in range(len(NODES))]
    every = [*((n, (9, 9, 0)) for n in range(1, 1 + alone)), *zip(number, NODES, strict=True)]
    nodes = "\n".join(f"{n} {x} {y} {z}" for n, (x, y, z) in every)
    cells = [f"1 2 1 1 {number[0]} {number[5]}", f"1 2 2 2 {number[4]} {number[9]}"]
    cells += [f"2 2 3 3 {' '.join(str(number[i - 1]) for i in t)}" for t in TRIANGLES]
    elements = "\n".join(f"{i} {cell}" for i, cell in enumerate(cells, 1))
    groups = '$PhysicalNames\n3\n1 1 "left"\n1 2 "right"\n2 3 "part"\n$EndPhysicalNames\n'
    text = (
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n{groups if names else ''}"
        f"$Nodes\n{len(every)}\n{nodes}\n$EndNodes\n"
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


def test_groups_by_their_numbers(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """A group without a name is called by its number; names that stand twice are refused."""
    path = written(comm, shared_tmp_path, strip(names=False))
    body = Domain.from_gmsh(comm, path, interfaces=["1", 2], centers={"2": (4.0, 0.0)})
    assert list(body.interfaces) == ["1", "2"] and body.interfaces["2"].center[1] == 0.0
    with pytest.raises(ValueError, match=r"no physical curve named '7'; .* curves \['1', '2'\]"):
        Domain.from_gmsh(comm, path, interfaces=[7])
    with pytest.raises(TypeError, match="interfaces must be a list of texts"):
        Domain.from_gmsh(comm, path, interfaces=[True, 2.5])
    path = written(comm, shared_tmp_path, strip())
    assert list(Domain.from_gmsh(comm, path, interfaces=[2, 1]).interfaces) == ["right", "left"]
    old, new = b'3\n1 1 "left"\n1 2 "right"', b'2\n1 1 "2"'
    assert old in strip()
    path = written(comm, shared_tmp_path, strip().replace(old, new))
    with pytest.raises(ValueError, match="curves 1 and 2 are both called '2'"):
        Domain.from_gmsh(comm, path)


def test_nodes_that_all_lie_on_named_curves(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """In files of format 2 gmsh gives a node to the curve alone, and the surface has none."""
    path, again = shared_tmp_path / "square.msh", shared_tmp_path / "again.msh"
    with gmsh_model() as gmsh:
        gmsh.model.occ.addRectangle(0.0, 0.0, 0.0, 2.0, 1.0)
        gmsh.model.occ.synchronize()
        for dim, tag, name in (
            (1, 4, "left"),
            (1, 2, "right"),
            (1, 1, "a"),
            (1, 3, "b"),
            (2, 1, "p"),
        ):
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [tag]), name)
        gmsh.option.setNumber("Mesh.MeshSizeMin", 2.0)
        gmsh.model.mesh.generate(2)
        gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
        gmsh.write(str(path))
        gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    assert Domain.from_gmsh(comm, path).area == pytest.approx(2.0, rel=1e-12)
    again.write_text(path.read_text().replace(" 1 0\n", " 1 0.5\n"))
    with pytest.raises(ValueError, match="leaves the x-y plane: its z spans"):
        Domain.from_gmsh(comm, again)


@pytest.mark.mpi
def test_nodes_without_cells(comm: MPI.Intracomm, shared_tmp_path: Path) -> None:
    """As the centres of arcs: DOLFINx 0.5 dies of them where nodes with cells come after them."""
    path = written(comm, shared_tmp_path, strip(alone=20))
    body = Domain.from_gmsh(comm, path)
    assert body.area == pytest.approx(4.0, rel=1e-12)
    np.testing.assert_allclose(body.interfaces["right"].center, [4.0, 0.5], atol=1e-12)


#: Dimension, order, whether incomplete, whether of quadrilaterals or hexahedra, error of the area
KINDS = {
    "S8": (2, 2, 1, 1, -0.0003659489620955),
    "C3D20": (3, 2, 1, 1, -0.0003659489620955),
    "order 3": (2, 3, 0, 1, 0.0000536334173282),
    "T9": (2, 3, 1, 0, "are of the kind Triangle 9, of order 3; supported are"),
    "order 4": (2, 4, 0, 1, "are of the kind Quadrilateral 25, of order 4"),
    "triangles of order 4": (2, 4, 0, 0, "are of the kind Triangle 15, of order 4"),
    "hexahedra of order 3": (
        3,
        3,
        0,
        1,
        "supported are .* hexahedra of order 1 and 2: mesh the body with",
    ),
}


@pytest.mark.mpi
@pytest.mark.parametrize("case", KINDS)
def test_kinds_of_cells(comm: MPI.Intracomm, shared_tmp_path: Path, case: str) -> None:
    """A quarter of a ring, with the area of the complete cells, or refused in words."""
    d, order, incomplete, recombined, expected = KINDS[case]
    path = shared_tmp_path / "ring.msh"
    if comm.rank == 0:
        write_ring(path, d, order, incomplete, recombined)
    comm.Barrier()
    if isinstance(expected, str):
        with pytest.raises(ValueError, match=expected):
            Domain.from_gmsh(comm, path)
        return
    body = Domain.from_gmsh(comm, path)
    assert body.area / 0.5 ** (d - 2) - 0.75 * np.pi == pytest.approx(expected, rel=1e-6)
    np.testing.assert_allclose(body.interfaces["left"].center[:2], [1.5, 0.0], atol=1e-12)


def write_ring(path: Path, d: int, order: int, incomplete: int, recombined: int) -> None:
    """Mesh a quarter of a ring of radii 1 and 2, in space of height 0.5."""
    with gmsh_model() as gmsh:
        occ, mesh = gmsh.model.occ, gmsh.model.mesh
        p = [occ.addPoint(x, y, 0.0) for x, y in ((0, 0), (1, 0), (2, 0), (0, 2), (0, 1))]
        arcs = [occ.addCircleArc(p[2], p[0], p[3]), occ.addCircleArc(p[4], p[0], p[1])]
        curves = [occ.addLine(p[1], p[2]), arcs[0], occ.addLine(p[3], p[4]), arcs[1]]
        surface = occ.addPlaneSurface([occ.addCurveLoop(curves)])
        occ.synchronize()
        for curve in curves:
            mesh.setTransfiniteCurve(curve, 4)
        mesh.setTransfiniteSurface(surface)
        if recombined:
            mesh.setRecombine(2, surface)
        held, body = [[curves[0]], [curves[2]]], [surface]
        if d == 3:
            extruded = occ.extrude([(2, surface)], 0, 0, 0.5, [2], recombine=bool(recombined))
            occ.synchronize()
            # the top, the volume, and the sides in the order of the curves
            body, held = [extruded[1][1]], [[extruded[2][1]], [extruded[4][1]]]
        groups = (d, body, "part"), (d - 1, held[0], "left"), (d - 1, held[1], "right")
        for dim, tags, name in groups:
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, tags), name)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", incomplete)
        mesh.generate(d)
        mesh.setOrder(order)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0)
        gmsh.write(str(path))
