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
from dolfinx_ffr.interchange import read_nastran

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def body() -> ffr.VolumeIntegrals:
    return solid(rod(MPI.COMM_SELF, (4, 1, 1), modes=3)).integrals


def assert_free_body(
    body: ffr.VolumeIntegrals, mass: Array, stiffness: Array, digits: float = 1e-9
) -> None:
    """Six motions without strain, the mass along all axes, and our frequencies of the free body."""
    whole, inner = body.mass_matrix(), np.zeros((6 + body.modes, 6 + body.modes))
    inner[6:, 6:] = body.K
    wanted = scipy.linalg.eigh(inner, whole, eigvals_only=True)
    found = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
    assert np.all(np.abs(found[:6]) < 1e-8 * found[6])
    np.testing.assert_allclose(found[6:], wanted[6:], rtol=digits)
    along = np.zeros((len(mass), 3))
    for k in range(2):
        along[6 * k : 6 * k + 3] = np.eye(3)
    np.testing.assert_allclose(along.T @ mass @ along, body.mass * np.eye(3), atol=10 * digits)


def test_simscape(body: ffr.VolumeIntegrals, tmp_path: Path) -> None:
    body.save(tmp_path / "rod.mat")
    found = scipy.io.loadmat(tmp_path / "rod.mat")
    np.testing.assert_allclose(found["origins"], [[0, 0, 0], [0.4, 0, 0]], atol=1e-12)
    assert found["K"].shape == (15, 15)
    assert_free_body(body, found["M"], found["K"])
    with pytest.raises(ValueError, match="from which no body that turns can be made"):
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
    given = {"KAAX": matrices.stiffness, "MAAX": matrices.mass}
    for name, matrix in given.items() if way == "dmig" else ():
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
        whole = {name: (6, matrix.toarray()) for name, matrix in given.items()}
        OP4(debug=False).write_op4(str(options["op4"]), whole, is_binary=False)
    found = read_nastran(path, **options)
    assert_near(found, matrices, 1e-9)
    assert found.node_sets.keys() == matrices.node_sets.keys()
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
