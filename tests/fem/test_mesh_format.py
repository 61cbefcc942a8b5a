# SPDX-License-Identifier: MIT
"""Files of strangers where a mesh belongs: nothing in them or beside them is executed."""

from __future__ import annotations

import gzip
import importlib
import struct
from collections.abc import Callable
from pathlib import Path

from mpi4py import MPI

import pytest
from fem.test_mesh_file import strip

from dolfinx_ffr import Domain
from dolfinx_ffr.__main__ import main
from dolfinx_ffr.fem import gmsh_model, mesh_file

#: A program of gmsh that leaves a file
PROGRAM = b'SystemCall "id > executed";\nPrintf("x") > "executed";\n'
BINARY = b"$MeshFormat\n4.1 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n"


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., None]:
    """Demand that a file is refused, and executed by nobody, by each way in."""
    monkeypatch.chdir(tmp_path)

    def demand(name: str, content: bytes, message: str) -> None:
        Path(name).write_bytes(content)
        with pytest.raises(ValueError, match=message):
            Domain.from_gmsh(MPI.COMM_SELF, name)
        assert not Path("executed").exists()

    return demand


@pytest.mark.parametrize("name", ["rod.msh", "rod.geo", "rod", "rod.step"])
def test_programs_of_gmsh_are_not_executed(refused: Callable[..., None], name: str) -> None:
    refused(name, PROGRAM, "begins with 'SystemCall .*execute such a file as a program")


#: Name, content, message
NO_MESHES = {
    "gzip": ("rod.msh.gz", gzip.compress(strip()), r"compressed by gzip; unpack it \(gunzip\)"),
    "a name for the shell": ("rod; touch executed; .gz", PROGRAM, "begins with"),
    "STEP": ("rod.step", b"ISO-10303-21;\nHEADER;\n", "a STEP file, a geometry without a mesh"),
    "BREP": ("rod.brep", b"DBRep_DrawableShape\n", "a BREP file"),
    "format 1": ("rod.msh", b"$NOD\n1\n1 0 0 0\n$ENDNOD\n", "a mesh in format 1"),
    "comments": ("rod.msh", b"$Comments\nx\n$EndComments\n" + strip(), "begins with"),
    "the head alone": ("rod.msh", b"$MeshFormat\n" + PROGRAM, "only the formats 2 and 4"),
    "empty": ("rod.msh", b"", "it is empty"),
}


@pytest.mark.parametrize("case", NO_MESHES)
def test_files_that_are_no_meshes(refused: Callable[..., None], case: str) -> None:
    """Neither does gmsh ask on the terminal whether to unpack them."""
    refused(*NO_MESHES[case])


@pytest.mark.parametrize("name", ["rod.msh", "rod.geo", "$(id > executed).gz"])
def test_a_mesh_is_one_by_its_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Options beside it, in the home directory, and modules beside it are not looked at."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GMSH_HOME", str(tmp_path))
    Path(name).write_bytes(strip())
    for other in (f"{name}.opt", "mesh.msh.opt", ".gmshrc", ".gmsh-options"):
        Path(other).write_bytes(PROGRAM)
    for module in ("gmsh", "numpy", "ctypes", "resource"):
        Path(f"{module}.py").write_text("open('executed', 'w')")
    assert Domain.from_gmsh(MPI.COMM_SELF, name).n_cells == 16
    assert not Path("executed").exists()


def test_gmsh_starts_without_options_of_the_home_directory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import gmsh

    read, initialize = [], gmsh.initialize

    def told(*arguments: object, readConfigFiles: bool = True, **options: object) -> None:
        read.append(readConfigFiles)
        initialize(*arguments, readConfigFiles=readConfigFiles, **options)

    monkeypatch.setattr(gmsh, "initialize", told)
    with gmsh_model():
        pass
    assert read == [False]
    assert "readConfigFiles=False" in mesh_file._TRIAL


@pytest.mark.parametrize("way", ["check", "demo"])
def test_commands_and_demos_execute_no_mesh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], way: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rod.msh").write_bytes(PROGRAM)
    if way == "demo":
        with pytest.raises((ValueError, SystemExit)) as caught:
            importlib.import_module("connecting_rod").main(["--mesh", "rod.msh", "--output", "out"])
    else:
        main(["new", "slider_crank"])
        scene = Path("slider_crank.toml")
        old = scene.read_text().partition("domain = ")[2].partition("\n")[0]
        new = scene.read_text().replace(old, '{ kind = "from_gmsh", path = "rod.msh" }', 1)
        scene.write_text(new)
        with pytest.raises((ValueError, SystemExit)) as caught:
            main([way, "slider_crank.toml"])
    message = f"{caught.value}{capsys.readouterr().err}"
    assert "would execute such a file" in message
    assert not list(tmp_path.rglob("executed"))


MANY = 4 * 10**12
TOO_MANY = {
    "nodes": strip().replace(b"$Nodes\n14\n", b"$Nodes\n%d\n" % MANY),
    "elements": strip().replace(b"$Elements\n", b"$Elements\n9"),
    "a word": strip().replace(b"$Nodes\n14\n", b"$Nodes\nmany\n"),
    "format 4": b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 %d 1 %d\n" % (MANY, MANY),
    "binary": BINARY + b"$Nodes\n" + struct.pack("<4Q", 1, MANY, 1, MANY),
    "the first block": (
        BINARY + b"$Nodes\n" + struct.pack("<4Q3iQ", 1, 4, 1, MANY, 2, 1, 0, MANY) + bytes(200)
    ),
}


@pytest.mark.parametrize("case", TOO_MANY)
def test_more_nodes_than_a_file_can_hold(tmp_path: Path, case: str) -> None:
    """Another process finds out, whose memory is limited."""
    path = tmp_path / "rod.msh"
    path.write_bytes(TOO_MANY[case])
    with pytest.raises(ValueError, match=r"not a mesh that gmsh can read: .* write it again"):
        Domain.from_gmsh(MPI.COMM_SELF, path)


@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("version", [2.2, 4.1])
def test_formats_that_are_read(tmp_path: Path, version: float, binary: int) -> None:
    path, again = tmp_path / "strip.msh", tmp_path / "again.msh"
    path.write_bytes(strip())
    with gmsh_model() as gmsh:
        gmsh.merge(str(path))
        for option, value in {"MshFileVersion": version, "Binary": binary}.items():
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.write(str(again))
    assert Domain.from_gmsh(MPI.COMM_SELF, again).area == pytest.approx(4.0)
