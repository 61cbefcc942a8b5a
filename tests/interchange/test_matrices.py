# SPDX-License-Identifier: MIT
"""Matrices of other finite-element programs: the same body as from a mesh, and damaged files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse
from interchange.test_files import damaged
from shared.rods import rod, solid

import dolfinx_ffr as ffr
from dolfinx_ffr.interchange import AssembledMatrices, read_abaqus, read_calculix
from dolfinx_ffr.reduction import reduce_matrices

CHORD = {"frame": ffr.ChordFrame("left", "right"), "modes": 3}


def bar(elements: tuple[int, int, int]) -> tuple[ffr.FlexibleBody, AssembledMatrices]:
    """A bar of hexahedra, and its matrices with nodes and node sets."""
    body = rod(MPI.COMM_SELF, elements, cell="hexahedron", solid_layers=0, **CHORD)
    assembled = body.elasticity.assemble(np.ones(body.domain.n_cells))
    K, M = (
        scipy.sparse.csr_matrix(each.getValuesCSR()[::-1], shape=each.size)
        for each in (assembled.stiffness, assembled.mass)
    )
    assembled.destroy()
    sets = {name: part.dofs for name, part in body.domain.interfaces.items()}
    return body, AssembledMatrices(K, M, body.elasticity.coordinates(), sets)


def triangle(matrix: Any, order: np.ndarray) -> np.ndarray:
    """Rows, columns from one, and values of the upper triangle in an order of the rows."""
    upper = scipy.sparse.triu(matrix[order][:, order]).tocoo()
    return np.column_stack([upper.row + 1.0, upper.col + 1.0, upper.data])


def write_model(path: Path, body: AssembledMatrices) -> None:
    """Nodes and node sets as an input file, with labels that have gaps."""
    lines = ["** a comment", "*NODE, NSET=all"]
    lines += [
        f"{2 * k + 3}, {x:.16e}, {y:.16e}, {z:.16e}" for k, (x, y, z) in enumerate(body.nodes)
    ]
    for name, nodes in body.node_sets.items():
        lines += [f"*Nset, nset={name}", *(f"{2 * k + 3}," for k in nodes)]
    path.write_text("\n".join([*lines, "*STEP", ""]))


def write_calculix(folder: Path, body: AssembledMatrices) -> Path:
    write_model(folder / "bar.inp", body)
    order = np.random.default_rng(0).permutation(body.nodes.size)
    (folder / "bar.dof").write_text("".join(f"{2 * (k // 3) + 3}.{k % 3 + 1}\n" for k in order))
    for ending, matrix in ((".sti", body.stiffness), (".mas", body.mass)):
        np.savetxt(folder / f"bar{ending}", triangle(matrix, order), fmt="%d %d %.13e")
    return folder / "bar.inp"


def write_abaqus(folder: Path, body: AssembledMatrices, labels: bool) -> None:
    write_model(folder / "bar.inp", body)
    for name, matrix in (("STIF1", body.stiffness), ("MASS1", body.mass)):
        table = triangle(matrix, np.arange(body.nodes.size))
        kind = "%d %d %.13e"
        if labels:
            row, column = table[:, :2].T - 1
            table = np.column_stack(
                [
                    2 * (row // 3) + 3,
                    row % 3 + 1,
                    2 * (column // 3) + 3,
                    column % 3 + 1,
                    table[:, 2],
                ]
            )
            kind = "%d, %d, %d, %d, %.13e"
        np.savetxt(folder / f"bar_{name}.mtx", table, fmt=kind)


def read_mtx(folder: Path) -> AssembledMatrices:
    return read_abaqus(
        *(folder / f"bar_{name}.mtx" for name in ("STIF1", "MASS1")), folder / "bar.inp"
    )


def assert_near(found: AssembledMatrices, body: AssembledMatrices, share: float) -> None:
    for key in ("stiffness", "mass"):
        expected = getattr(body, key)
        assert abs(getattr(found, key) - expected).max() <= share * abs(expected).max()
    np.testing.assert_allclose(found.nodes, body.nodes, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("way", ["arrays", "calculix", "rows", "labels"])
def test_matrices_make_the_body_of_their_mesh(tmp_path: Path, way: str) -> None:
    body, matrices = bar((4, 2, 2))
    if way == "calculix":
        matrices = read_calculix(write_calculix(tmp_path, matrices))
    elif way != "arrays":
        write_abaqus(tmp_path, matrices, way == "labels")
        matrices = read_mtx(tmp_path)
    reduced = reduce_matrices(
        matrices, interfaces=["left", "right"], mass=7850 * 0.4 * 0.04 * 0.03, **CHORD
    )
    expected = solid(body).integrals
    np.testing.assert_allclose(np.diag(reduced.K)[-3:], np.diag(expected.K)[-3:], rtol=1e-9)
    # modes have no sign
    assert reduced.P is not None and expected.P is not None
    signs = np.array([1.0, *np.sign(np.einsum("jmn,jmn->j", reduced.P[1:, 0], expected.P[1:, 0]))])
    turned = signs[:, None, None, None] * signs[:, None, None] * reduced.P
    np.testing.assert_allclose(turned, expected.P, atol=1e-8 * np.abs(expected.P).max())
    for name, point in expected.markers.items():
        np.testing.assert_allclose(reduced.markers[name].position, point.position, atol=1e-12)
        shapes = reduced.markers[name].displacement
        np.testing.assert_allclose(shapes, point.displacement, atol=1e-12)


def test_matrices_that_are_no_body_are_refused() -> None:
    _, good = bar((2, 1, 1))
    K, M, nodes, sets = good.stiffness, good.mass, good.nodes, good.node_sets
    n = nodes.size
    springs = scipy.sparse.diags(np.where(np.arange(n) % 3 == 1, 1e9, 0.0))
    twice = scipy.sparse.block_diag([K, K]), scipy.sparse.block_diag([M, M])
    skew = scipy.sparse.csr_matrix(([1e9], ([0], [5])), shape=(n, n))
    line = {**sets, "left": [0, 1]}
    for message, change in {
        "resists translation along y, rotation about x, rotation about z": (
            K + springs,
            M,
            nodes,
            sets,
        ),
        "symmetric, but rows 0 and 5": (K + skew, M, nodes, sets),
        "couples the axes": (K, M + abs(skew) + abs(skew).T, nodes, sets),
        "mass of node 0 is not positive": (K, 0.0 * M, nodes, sets),
        "in 2 pieces": (*twice, np.vstack([nodes, nodes]), sets),
        "three rows for each of": (K[3:, 3:], M, nodes, sets),
        "at least three of the": (K, M, nodes, line),
        "rows count from 0, take 1": (K, M, nodes, {"a": np.arange(len(nodes)) + 1}),
        "name rows 0 to 11 of the 12 nodes, but it names -1": (K, M, nodes, {"a": [-1, 0, 1]}),
        "masked entries": (K, M, nodes, {"a": np.ma.masked_less(np.arange(4), 1)}),
        "not finite": (K * np.nan, M, nodes, sets),
        "resists rotation": (K, M, 1e3 * nodes[::-1], sets),
    }.items():
        with pytest.raises(ValueError, match=message):
            AssembledMatrices(*change)
    for message, options in {
        "no node set 'middle'": {"interfaces": ["left", "middle"]},
        "overlap: they share": {"interfaces": ["left", "right", "all"]},
        "is 3.768 and not 3768 kg": {"interfaces": ["left", "right"], "mass": 3768.0},
    }.items():
        with_all_nodes = AssembledMatrices(K, M, nodes, {**sets, "all": np.arange(len(nodes))})
        with pytest.raises(ValueError, match=message):
            reduce_matrices(with_all_nodes, **CHORD, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("program", ["calculix", "abaqus"])
def test_three_hundred_damaged_files(tmp_path: Path, program: str) -> None:
    """Each is an error that names a file, or gives the matrices as they were, to six digits."""
    _, matrices = bar((2, 1, 1))
    read: Callable[[], AssembledMatrices]
    if program == "abaqus":
        write_abaqus(tmp_path, matrices, labels=False)
        read = lambda: read_mtx(tmp_path)  # noqa: E731
    else:
        write_calculix(tmp_path, matrices)
        read = lambda: read_calculix(tmp_path / "bar.inp")  # noqa: E731
    contents = {path: path.read_bytes() for path in sorted(tmp_path.iterdir())}
    rng, refused = np.random.default_rng(7), 0
    for k in range(300):
        path, content = list(contents.items())[k % len(contents)]
        path.write_bytes(damaged(content, rng))
        try:
            assert_near(read(), matrices, 2e-6)
        except ValueError as error:
            assert str(tmp_path) in str(error)
            refused += 1
        path.write_bytes(content)
    assert refused > 150


def test_incompatible_modes_are_not_read(tmp_path: Path) -> None:
    """CalculiX gives them nodes of their own, which stand in no input file."""
    _, matrices = bar((2, 1, 1))
    path = write_calculix(tmp_path, matrices)
    corners = ", ".join(str(2 * k + 3) for k in range(8))
    text = path.read_text().replace("*STEP", f"*ELEMENT, TYPE=C3D8I\n1, {corners}\n*STEP")
    path.write_text(text)
    file = path.with_suffix(".dof")
    file.write_text(file.read_text() + "".join(f"99.{axis}\n" for axis in (1, 2, 3)))
    with pytest.raises(ValueError, match=r"no nodes \[99\].*C3D8I .* not read; take C3D8, C3D20"):
        read_calculix(path)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("*NSET, NSET=all, GENERATE\n1, 99999999\n", "names 99,999,999 nodes from 1 to 99999999"),
        ("*NSET, NSET=odd, GENERATE\n3, 25, 2\n", ""),
        # each set is twice the one before
        (
            "".join(f"*NSET, NSET=s{k + 1}\ns{k}, s{k}\n" for k in range(60)),
            "",
        ),
    ],
)
def test_sets_of_more_nodes_than_there_are(tmp_path: Path, lines: str, message: str) -> None:
    _, matrices = bar((2, 1, 1))
    path = write_calculix(tmp_path, matrices)
    first = "*NSET, NSET=s0\n3, 5, 7\n"
    path.write_text(path.read_text().replace("*STEP", f"{first}{lines}*STEP"))
    if message:
        with pytest.raises(ValueError, match=message):
            read_calculix(path)
        return
    node_sets = read_calculix(path).node_sets
    assert len(node_sets["s0"]) == 3
    assert len(node_sets.get("odd", range(12))) == 12 and len(node_sets.get("s60", range(3))) == 3
