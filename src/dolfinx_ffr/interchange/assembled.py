# SPDX-License-Identifier: MIT
"""Stiffness and mass of a body as another finite-element program has assembled them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components

from .. import validation
from ..arrays import Array, Integers

#: Largest error of a property of matrices, relative to their entries: files have at least seven
#: digits
_SAME = 1e-6
#: Largest depth of files that include each other
DEEPEST = 20
_MOTIONS = (
    *("translation along x", "translation along y", "translation along z"),
    *("rotation about x", "rotation about y", "rotation about z"),
)


@dataclass(frozen=True, eq=False)
class AssembledMatrices:
    """Matrices of a free elastic body in space, with its nodes.

    They come from solid elements: each node has three displacements, and a mass that is the same
    along all axes and does not couple them. `reduction.reduce_matrices` makes a body of it.

    Raises:
        ValueError: If sizes do not fit, a matrix is not symmetric, the mass couples axes or is not
            positive, rigid motions strain the body, it is in pieces, or a node set is not there.

    Attributes:
        stiffness: (3 nodes, 3 nodes), node by node [N/m].
        mass: (3 nodes, 3 nodes) [kg].
        nodes: Positions (nodes, 3) [m].
        node_sets: Nodes by name of the set, as rows of ``nodes``.
        faces: Triangles (k, 3) of nodes at the corners of elements, which cover the surface; by
            them the centers of node sets are found as on a mesh. Without them a center is the mean
            of the nodes.
    """

    stiffness: scipy.sparse.csr_matrix
    mass: scipy.sparse.csr_matrix
    nodes: Array
    node_sets: Mapping[str, Integers]
    faces: Integers = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))

    def __post_init__(self) -> None:
        nodes = validation.real_array("matrices: nodes", self.nodes, (None, 3))
        n = len(nodes)
        checked: dict[str, Any] = {"nodes": nodes}
        for key in ("stiffness", "mass"):
            checked[key] = _matrix(f"matrices: {key}", getattr(self, key), 3 * n)
        sets = validation.by_name("matrices: node_sets", self.node_sets, "nodes")
        checked["node_sets"] = {
            name: _nodes(f"node set {name!r}", members, n) for name, members in sets.items()
        }
        checked["faces"] = np.asarray(self.faces, dtype=np.int64).reshape(-1, 3)
        for key, value in checked.items():
            object.__setattr__(self, key, value)
        _check_mass(self.mass)
        _check_rigid(self.stiffness, nodes)
        pieces, _ = connected_components(abs(self.stiffness) + abs(self.mass), directed=False)
        if pieces > 1:
            raise ValueError(
                f"matrices: the body is in {pieces} pieces that no element joins; leave out nodes "
                "without an element, and parts that are only in contact"
            )

    @property
    def total_mass(self) -> float:
        """Mass [kg]."""
        return float(self.mass[0::3, 0::3].sum())


def _matrix(what: str, entries: Any, size: int) -> scipy.sparse.csr_matrix:
    """A symmetric matrix of finite numbers."""
    if not scipy.sparse.issparse(entries):
        entries = validation.real_array(what, entries, (size, size))
    matrix = scipy.sparse.csr_matrix(entries, dtype=np.float64)
    matrix.sum_duplicates()
    if matrix.shape != (size, size):
        raise ValueError(
            f"{what} must have three rows for each of {size // 3} nodes, but its shape is "
            f"{matrix.shape}"
        )
    if not np.all(np.isfinite(matrix.data)):
        raise ValueError(f"{what} has entries that are not finite")
    difference = abs(matrix - matrix.T)
    entry = int(np.argmax(difference.data)) if difference.nnz else 0
    if difference.nnz and difference.data[entry] > _SAME * np.max(np.abs(matrix.data)):
        row = int(np.searchsorted(difference.indptr, entry, side="right") - 1)
        raise ValueError(
            f"{what} must be symmetric, but rows {row} and {difference.indices[entry]} differ by "
            f"{difference.data[entry]:.2g}: is a triangle of it incomplete?"
        )
    return 0.5 * (matrix + matrix.T)


def _nodes(what: str, members: ArrayLike, n: int) -> Integers:
    """Different rows of the nodes, by their numbers from 0 or by a mask."""
    validation.refuse_masked(what, members)
    array = np.asarray(members)
    if array.dtype == np.bool_ and array.shape == (n,):
        array = np.flatnonzero(array)
    if array.dtype.kind not in "iu" and array.size:
        raise TypeError(
            f"{what} must hold rows of the nodes, but it is {validation.described(members)}"
        )
    rows = np.unique(array.astype(np.int64))
    if len(rows) and (rows[0] < 0 or rows[-1] >= n):
        hint = "; rows count from 0, take 1 from each" if rows[-1] == n and rows[0] > 0 else ""
        raise ValueError(
            f"{what} must name rows 0 to {n - 1} of the {n} nodes, but it names {rows[0]} to "
            f"{rows[-1]}{hint}"
        )
    if len(rows) < 3:
        raise ValueError(
            f"{what} must name at least three of the {n} nodes, to hold a body against rotation, "
            f"but it has {len(rows)}"
        )
    return rows


def _check_mass(mass: scipy.sparse.csr_matrix) -> None:
    """Refuse a mass that couples the axes, differs from axis to axis, or is not positive."""
    by_axis = [mass[k::3, k::3] for k in range(3)]
    coupling = max(abs(mass[k::3, j::3]).max() for k in range(3) for j in range(3) if j != k)
    difference = max(abs(by_axis[0] - matrix).max() for matrix in by_axis[1:])
    size, smallest = abs(mass).max(), mass.diagonal().min()
    if max(coupling, difference) > _SAME * size:
        raise ValueError(
            "matrices: the mass couples the axes or differs between them: only solid elements with "
            "three displacements at each node are possible, no shells, beams or added masses"
        )
    if not (smallest > 0.0 and by_axis[0].sum() > 0.0):
        row = int(np.argmin(mass.diagonal()))
        raise ValueError(
            f"matrices: the mass of node {row // 3} is not positive ({smallest:.2g} kg)"
        )


def _check_rigid(stiffness: scipy.sparse.csr_matrix, nodes: Array) -> None:
    """Refuse a stiffness that resists rigid motions, and name them."""
    offset = nodes - nodes.mean(axis=0)
    fields = np.zeros((len(nodes), 3, 6))
    fields[:, :, :3] = np.eye(3)
    for k, axis in enumerate(np.eye(3)):
        fields[:, :, 3 + k] = np.cross(axis, offset) / max(np.max(np.abs(offset)), 1e-300)
    block = fields.reshape(-1, 6)
    forces = np.max(np.abs(stiffness @ block), axis=0)
    bound = _SAME * max(abs(stiffness).max(), 0.0)
    resisted = [name for name, force in zip(_MOTIONS, forces, strict=True) if not force <= bound]
    if resisted:
        raise ValueError(
            "matrices: a body that nothing holds has six motions without strain, but the stiffness "
            f"resists {', '.join(resisted)}: leave out constraints and springs to the ground, and "
            "check the units and the order of the nodes"
        )
    if not stiffness.diagonal().min() > 0.0:
        row = int(np.argmin(stiffness.diagonal()))
        raise ValueError(f"matrices: node {row // 3} has no stiffness along axis {'xyz'[row % 3]}")


def from_entries(
    what: str, rows: Integers, columns: Integers, values: Array, n: int
) -> scipy.sparse.csr_matrix:
    """A symmetric matrix (n, n) from entries of one triangle or of both, counted from zero."""
    if len(rows) and (min(rows.min(), columns.min()) < 0 or max(rows.max(), columns.max()) >= n):
        raise ValueError(f"{what}: an entry lies outside of its {n} rows")
    matrix = scipy.sparse.csr_matrix((values, (rows, columns)), shape=(n, n))
    if matrix.nnz != len(values):
        raise ValueError(f"{what}: {len(values) - matrix.nnz} entries stand twice")
    if np.any(rows > columns) and np.any(rows < columns):
        return matrix
    return matrix + matrix.T - scipy.sparse.diags(matrix.diagonal())


def read_table(path: Path, columns: int | tuple[int, ...]) -> Array:
    """The numbers of a text file with some columns, (lines, columns)."""
    allowed = (columns,) if isinstance(columns, int) else columns
    try:
        with open(path) as file:  # a cut line has too few columns
            table = np.loadtxt(
                (line.replace(",", " ").replace("D", "E") for line in file if line[:1] != "*"),
                ndmin=2,
            )
    except (UnicodeDecodeError, ValueError) as error:
        raise ValueError(f"{path}: it is damaged, or not a table of numbers: {error}") from None
    if not len(table) or table.shape[1] not in allowed:
        raise ValueError(f"{path}: {allowed} columns are expected, and there are {table.shape[1]}")
    if not np.all(np.isfinite(table)):
        raise ValueError(f"{path}: it has entries that are not finite")
    return np.asarray(table)


def rows_of_labels(what: str, nodes: ArrayLike, labels: Integers, hint: str = "") -> Integers:
    """Rows of some nodes, given by their labels, among all sorted labels."""
    nodes = np.asarray(nodes, dtype=np.int64).ravel()
    if missing := np.setdiff1d(nodes, labels)[:5].tolist():
        raise ValueError(f"there are no nodes {missing}, which {what} names{hint}")
    return np.asarray(np.searchsorted(labels, nodes))


def whole_numbers(path: Path, table: Array) -> Integers:
    """Columns of a table as whole numbers."""
    if not np.all((table == np.round(table)) & (table >= 0) & (table < 2**53)):
        raise ValueError(f"{path}: numbers of rows, nodes or directions must be whole")
    return table.astype(np.int64)


#: Corners of the faces of elements by their number of corners: tetrahedra, wedges, hexahedra
_FACES: dict[int, Sequence[Sequence[int]]] = {
    4: ((0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
    6: ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    8: ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
#: Corners of solid elements by their number of nodes
_CORNERS = {4: 4, 10: 4, 6: 6, 15: 6, 8: 8, 20: 8, 27: 8}


def surface(elements: Sequence[Integers]) -> Integers:
    """Triangles (k, 3) that cover the surface of blocks of elements (m, nodes)."""
    triangles, keys = [], []
    for block in elements:
        for face in _FACES[_CORNERS[block.shape[1]]]:
            corners = block[:, list(face)]
            key = np.full((len(block), 4), -1, dtype=np.int64)
            key[:, : len(face)] = np.sort(corners, axis=1)
            for k in range(1, len(face) - 1):
                triangles.append(corners[:, [0, k, k + 1]])
                keys.append(key)
    if not triangles:
        return np.zeros((0, 3), dtype=np.int64)
    all_triangles, faces = np.vstack(triangles), np.vstack(keys)
    _, inverse, count = np.unique(faces, axis=0, return_inverse=True, return_counts=True)
    # a face of four corners has two triangles
    on_surface = count[inverse.ravel()] == np.where(faces[:, 3] < 0, 1, 2)
    return all_triangles[on_surface]


def solid_corners(nodes: int) -> bool:
    """Whether elements with this number of nodes are solid elements."""
    return nodes in _CORNERS
