# SPDX-License-Identifier: MIT
"""Bodies as superelements for Simscape and Nastran, and matrices that Nastran has assembled."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import scipy.io
import scipy.linalg
from interchange.test_files import damaged
from interchange.test_matrices import assert_near, bar
from numpy.typing import NDArray
from shared.rods import rod, solid
from shared.spatial_bodies import cloud

import dolfinx_ffr as ffr
from dolfinx_ffr.interchange import read_calculix, read_nastran

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def body() -> ffr.VolumeIntegrals:
    return solid(rod(MPI.COMM_SELF, (4, 1, 1), modes=3)).integrals


def assert_free_body(
    body: ffr.VolumeIntegrals, mass: Array, stiffness: Array, digits: float = 1e-9
) -> None:
    """Six motions without strain, the mass along all axes, and our frequencies of the free body."""
    mass_matrix, inner = body.mass_matrix(), np.zeros((6 + body.modes, 6 + body.modes))
    inner[6:, 6:] = body.K
    expected = scipy.linalg.eigh(inner, mass_matrix, eigvals_only=True)
    squares = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
    assert np.all(np.abs(squares[:6]) < 1e-8 * squares[6])
    np.testing.assert_allclose(squares[6:], expected[6:], rtol=digits)
    along = np.zeros((len(mass), 3))
    for k in range(2):
        along[6 * k : 6 * k + 3] = np.eye(3)
    np.testing.assert_allclose(along.T @ mass @ along, body.mass * np.eye(3), atol=10 * digits)


def test_simscape(body: ffr.VolumeIntegrals, tmp_path: Path) -> None:
    body.save(tmp_path / "rod.mat")
    arrays = scipy.io.loadmat(tmp_path / "rod.mat")
    np.testing.assert_allclose(arrays["origins"], [[0, 0, 0], [0.4, 0, 0]], atol=1e-12)
    assert arrays["K"].shape == (15, 15)
    assert_free_body(body, arrays["M"], arrays["K"])
    with pytest.raises(ValueError, match="do not determine a body that turns"):
        ffr.VolumeIntegrals.load(tmp_path / "rod.mat")
    with pytest.raises(ValueError, match="shape functions of a superelement"):
        cloud(2).save(tmp_path / "cloud.mat")


def test_nastran(body: ffr.VolumeIntegrals, tmp_path: Path) -> None:
    bdf = pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran needs an older NumPy")
    body.save(tmp_path / "rod.bdf")
    model = bdf.read_bdf(str(tmp_path / "rod.bdf"), punch=True, debug=None)
    matrices: list[Any] = [
        model.dmig[name].get_matrix(is_sparse=False)[0] for name in ("MAAX", "KAAX")
    ]
    assert_free_body(body, *matrices, digits=1e-7)  # fields of 16 characters
    np.testing.assert_allclose(model.nodes[2].xyz, [0.4, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("way", ["dmig", "op4"])
def test_matrices_of_nastran(tmp_path: Path, way: str) -> None:
    """Read as they were, and three hundred damaged files are refused or read as they were."""
    bdf = pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran needs an older NumPy")
    _, matrices = bar((2, 1, 1))
    model, path = bdf.BDF(debug=None), tmp_path / "bar.bdf"
    for k, place in enumerate(matrices.nodes):
        model.add_grid(2 * k + 1, place)
    settings = {"KAAX": matrices.stiffness, "MAAX": matrices.mass}
    for name, matrix in settings.items() if way == "dmig" else ():
        entries = np.argwhere(np.tril(matrix.toarray()))
        labels = [(int(2 * (k // 3) + 1), int(k % 3 + 1)) for k in range(matrices.nodes.size)]
        rows, columns = ([labels[k] for k in index] for index in entries.T)
        values = [float(matrix[i, j]) for i, j in entries]
        model.add_dmig(name, 6, 2, 0, 0, len(labels), columns, rows, values)
    model.write_bdf(str(path), size=16, is_double=True)
    options: dict[str, Any] = {"node_sets": {n: 2 * k + 1 for n, k in matrices.node_sets.items()}}
    if way == "op4":
        from pyNastran.op4.op4 import OP4

        options["op4"] = tmp_path / "bar.op4"
        mass_matrix = {name: (6, matrix.toarray()) for name, matrix in settings.items()}
        OP4(debug=False).write_op4(str(options["op4"]), mass_matrix, is_binary=False)
    matrices_read = read_nastran(path, **options)
    assert_near(matrices_read, matrices, 1e-9)
    assert matrices_read.node_sets.keys() == matrices.node_sets.keys()
    target, rng, refused = options.get("op4", path), np.random.default_rng(3), 0
    content = target.read_bytes()
    for _ in range(20):
        target.write_bytes(damaged(content, rng))
        try:
            assert_near(read_nastran(path, **options), matrices, 2e-6)
        except ValueError as error:
            assert str(target) in str(error)
            refused += 1
    assert refused > 10


#: A cube of one kilogram in the cards of Nastran, with a comment that pyNastran executes
CARDS = """$ pyNastran: code-block=open("executed", "w")
$ pyNastran: punch=true
BEGIN BULK
GRID,1,,0.,0.,0.
GRID           2              1.      0.      0.
CORD2R  1               x
DMIG    KAAX           0       6       2       0                       1
ENDDATA
"""


def test_nastran_files_are_not_executed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of its cards only those that count are read, and nothing of another program is printed."""
    pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran needs an older NumPy")
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "cube.bdf"
    for text, message in {
        CARDS: r"cube.bdf with cube.bdf: it has no matrix 'MAAX', but \['KAAX'\]",
        CARDS.replace("1.      0.", "x       0."): "must be a float or blank",
        CARDS.replace("BULK", "SUPER 111"): r"a superelement \(BEGIN SUPER\)",
        CARDS.replace("GRID,1,,", "GRID,1,7,"): "in basic coordinates",
        CARDS.replace("CORD2R  1               x", "GRDSET,,7"): "in basic coordinates",
    }.items():
        path.write_text(text)
        with pytest.raises(ValueError, match=message):
            read_nastran(path, node_sets={}, stiffness="KAAX")
    assert not Path("executed").exists() and capsys.readouterr() == ("", "")


@pytest.mark.parametrize("program", ["nastran", "calculix"])
def test_files_include_only_what_came_with_them(tmp_path: Path, program: str) -> None:
    if program == "nastran":
        pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran needs an older NumPy")
    secret, folder = tmp_path / "secret", tmp_path / "model"
    folder.mkdir()
    secret.write_text("GRID,1,,a secret\n*NODE\n1, a secret\n")
    (folder / "link").symlink_to(secret)
    (folder / "below").mkdir()
    (folder / "below" / "nodes").write_text("GRID,77,,0.,0.,0.\n*NODE\n77, 0, 0, 0\n")
    path = folder / "model.bdf"
    card = "INCLUDE '{}'\n" if program == "nastran" else "*INCLUDE, INPUT={}\n"

    def told(name: str) -> str:
        path.write_text(card.format(name))
        with pytest.raises((ValueError, OSError)) as caught:
            if program == "nastran":
                read_nastran(path, node_sets={"a": [1]}, op4=secret)
            else:
                read_calculix(path)
        return str(caught.value)

    for name in (str(secret), "/etc/passwd", "../secret", "below/../../secret", "link"):
        assert f"it includes {name!r}, which is outside of its folder" in told(name)
    # what is in a folder below is read, and misses other files or sets
    assert "is outside" not in told("below/nodes") and "a secret" not in told("below/nodes")
