# SPDX-License-Identifier: MIT
"""Matrices of Nastran by pyNastran: a body as DMIG out, assembled matrices as DMIG or OP4 in.

Out, a GRID stands for each interface and an SPOINT for each mode, and the symmetric matrices KAAX
and MAAX for their stiffness and mass, to the nine digits of a field of 16 characters; Nastran takes
them by ``K2GG = KAAX`` and ``M2GG = MAAX``.
In, Nastran writes them by ``PARAM,EXTOUT,DMIGPCH``, or as matrices of an OP4 file whose rows are
the three displacements of the nodes in ascending order.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Integers
from ..files import included_file, replace_file
from .assembled import DEEPEST, AssembledMatrices, from_entries, rows_of_labels
from .format import Arrays
from .superelement import superelement

#: Numbers of Nastran for symmetric matrices and for double precision
_SYMMETRIC, _DOUBLE = 6, 2
#: Cards that are read
_CARDS = ("GRID", "GRDSET", "DMIG")


def _pynastran(what: str) -> tuple[Any, Any]:
    """The modules of bulk data and of matrices, without their warnings of new libraries."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import pyNastran.bdf.bdf as bdf
            import pyNastran.op4.op4 as op4
    except ImportError:
        raise ImportError(
            f"{what} needs pyNastran, which is not installed: pip install pyNastran (for NumPy 1)"
        ) from None
    return bdf, op4


class Nastran:
    """Bulk data with DMIG."""

    name = "nastran"
    endings: tuple[str, ...] = (".bdf", ".pch")
    holds: tuple[str, ...] = ("rotations of markers",)

    def write(self, path: Path, arrays: Arrays) -> None:
        bdf, _ = _pynastran("a body file of Nastran")
        body = superelement(arrays)
        n, size = len(body.names), len(body.mass)
        model = bdf.BDF(debug=None)
        for k, (name, position) in enumerate(zip(body.names, body.positions, strict=True), 1):
            model.add_grid(k, position, comment=f"interface {name}")
        points = list(range(n + 1, n + 1 + size - 6 * n))
        if points:
            model.add_spoint(points)
        labels = [(k, axis) for k in range(1, n + 1) for axis in range(1, 7)]
        labels += [(k, 0) for k in points]
        for name, matrix in (("KAAX", body.stiffness), ("MAAX", body.mass)):
            rows, columns = np.nonzero(np.tril(matrix))
            model.add_dmig(
                name,
                _SYMMETRIC,
                _DOUBLE,
                0,
                0,
                size,
                [labels[j] for j in columns],
                [labels[i] for i in rows],
                matrix[rows, columns].tolist(),
            )
        text = io.StringIO()
        model.write_bdf(text, size=16, is_double=True, enddata=True, close=False)
        replace_file(path, text.getvalue().encode())


def read_nastran(
    model: str | Path,
    *,
    node_sets: Mapping[str, ArrayLike],
    op4: str | Path | None = None,
    stiffness: str = "KAAX",
    mass: str = "MAAX",
) -> AssembledMatrices:
    """The matrices that Nastran has written, by pyNastran.

    Args:
        model: Bulk data with the GRIDs, in basic coordinates, and without ``op4`` with the DMIGs.
        node_sets: Labels of GRIDs by name of the set.
        op4: A file of matrices, OUTPUT4.
        stiffness: Name of the stiffness.
        mass: Name of the mass.

    Raises:
        ImportError: If pyNastran is not installed.
        ValueError: If a file is damaged, or the matrices are not those of a body that nothing
            holds (`AssembledMatrices`); the message names the file.
        OSError: If a file cannot be read.
    """
    bdf, module = _pynastran("read_nastran")
    path = validation.path("read_nastran: model", model)
    source = path if op4 is None else validation.path("read_nastran: op4", op4)
    for file in (path, source):
        file.read_bytes()  # an error of its own where there is no such file
    try:
        bulk_data = _bulk_data(bdf, path)
        grids, defaults = bulk_data.nodes, bulk_data.grdset
        labels = np.array(sorted(grids), dtype=np.int64)
        nodes = np.array([grids[label].xyz for label in labels]).reshape(-1, 3)
        n = 3 * len(labels)
        if any(grid.Cp() for grid in grids.values()) or (defaults and defaults.Cp()):
            raise ValueError("GRIDs must be given in basic coordinates")
        matrices = bulk_data.dmig
        if op4 is not None:
            with redirect_stdout(io.StringIO()):
                matrices = module.read_op4(str(op4), debug=False)

        def matrix(name: str) -> scipy.sparse.csr_matrix:
            if name not in matrices:
                raise ValueError(f"it has no matrix {name!r}, but {sorted(matrices) or 'none'}")
            entries = matrices[name]
            return _of_dmig(entries, labels, n) if op4 is None else _of_op4(name, entries, n)

        by_name = validation.by_name("node_sets", node_sets, "labels")
        sets = {name: rows_of_labels(name, members, labels) for name, members in by_name.items()}
        return AssembledMatrices(matrix(stiffness), matrix(mass), nodes, sets)
    except Exception as error:  # pyNastran raises anything on damaged files
        kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        raise ValueError(f"{source} with {path.name}: {kind}{error}") from error


def _bulk_data(bdf: Any, path: Path) -> Any:
    """The model of pyNastran with the cards that are needed here.

    pyNastran executes comments of a file ("$ pyNastran: code-block = ..."), reads all files that it
    includes, and prints pages of errors about other cards. So it gets only these cards.
    """
    cards = "\n".join(_cards(path, path.parent, 0))
    model = bdf.BDF(debug=None)
    with redirect_stdout(io.StringIO()):
        model.read_bdf(io.StringIO(f"{cards}\n"), punch=True, xref=False)
    return model


def _cards(path: Path, folder: Path, depth: int) -> Iterator[str]:
    """The lines of the `_CARDS` in a file and in the files that it includes."""
    if depth > DEEPEST:
        raise ValueError(
            f"{path}: files include each other in a circle; remove one of the INCLUDE lines"
        )
    is_read = False  # whether the lines belong to a card that is read
    text = path.read_text(encoding="utf-8", errors="replace")
    lines = iter(text.splitlines())
    for line in lines:
        line = line.partition("$")[0].rstrip()
        if not line:
            continue
        name = re.match(r"[A-Za-z][A-Za-z0-9]*", line)
        card = name[0].upper() if name else ""
        if card == "INCLUDE":
            # the name may go on in further lines, up to the second quotation mark
            included = line[len(card) :].strip()
            while included[:1] in ("'", '"') and included.count(included[0]) < 2:
                included += next(lines, included[0]).strip()
            yield from _cards(included_file(included.strip("'\""), folder), folder, depth + 1)
            is_read = False
        elif card == "ENDDATA":
            return
        elif re.match(r"BEGIN\s+SUPER", line, re.IGNORECASE):
            raise ValueError(
                f"{path}: the file holds a superelement (BEGIN SUPER), which has matrices of its "
                "interfaces only; write the matrices of all nodes by PARAM,EXTOUT,DMIGPCH"
            )
        else:
            is_read = card in _CARDS if card else is_read  # lines without a name go on with a card
            if is_read:
                yield line


def _of_op4(name: str, entries: Any, n: int) -> scipy.sparse.csr_matrix:
    """A matrix (n, n) of an OP4 file."""
    matrix = entries[1] if isinstance(entries, tuple) else entries.data
    if matrix.shape != (n, n):  # before anything is made of it, as a file may promise any size
        raise ValueError(f"{name} must have the shape {(n, n)}, but it has {matrix.shape}")
    return scipy.sparse.csr_matrix(matrix)


def _of_dmig(dmig: Any, labels: Integers, n: int) -> scipy.sparse.csr_matrix:
    """A matrix in the order of the nodes."""
    indices = []
    for pairs in (dmig.GCi, dmig.GCj):
        node, axis = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        if len(axis) and not (axis.min() >= 1 and axis.max() <= 3):
            raise ValueError(f"{dmig.name}: components must be 1, 2 or 3, as of solid elements")
        indices.append(3 * rows_of_labels(dmig.name, node, labels) + axis - 1)
    rows, columns = indices
    return from_entries(dmig.name, rows, columns, np.array(dmig.Real, dtype=np.float64), n)
