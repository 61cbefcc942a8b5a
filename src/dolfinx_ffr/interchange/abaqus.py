# SPDX-License-Identifier: MIT
"""Matrices of Abaqus and CalculiX, and the nodes, elements and sets of their input files.

Abaqus writes them by ``*MATRIX GENERATE, STIFFNESS, MASS`` and ``*MATRIX OUTPUT``, as rows, columns
and values (``FORMAT=COORDINATE``; nodes in ascending order, three displacements each) or with the
labels of nodes and directions. CalculiX writes ``.sti``, ``.mas`` and ``.dof`` by ``*FREQUENCY,
SOLVER=MATRIXSTORAGE``: rows, columns and values of the upper triangles, and the node and direction
of each row. In both the model has solid elements and no boundary conditions.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..arrays import Array, Integers
from ..files import included_file
from .assembled import (
    DEEPEST,
    AssembledMatrices,
    from_entries,
    read_table,
    rows_of_labels,
    solid_corners,
    surface,
    whole_numbers,
)


class InputFile:
    """Nodes, solid elements and node sets of an input file at a ``path``."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._nodes: dict[int, list[float]] = {}
        self._elements: dict[int, list[list[int]]] = {}
        # labels, and ranges of labels whose length is not checked yet, by name in capitals
        self._sets: dict[str, dict[int | range, None]] = {}
        self._types: set[str] = set()  # of the solid elements
        self._names: dict[str, str] = {}  # names of sets as in the file, by name in capitals
        self._read(path, 0)
        if not self._nodes:
            raise ValueError(f"{path}: it has no *NODE")
        #: In ascending order
        self.labels = np.array(sorted(self._nodes), dtype=np.int64)
        #: (nodes, 3) [m]
        self.nodes = np.array([self._nodes[label] for label in self.labels])

    def _read(self, path: Path, depth: int) -> None:
        if depth > DEEPEST:
            raise ValueError(
                f"{path}: files include each other in a circle; remove one of the *INCLUDE lines"
            )
        keyword, options, unfinished = "", dict[str, str](), ""
        try:
            lines = path.read_text().splitlines()
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: it is damaged, or no text: {error}") from None
        for number, line in enumerate(lines, 1):
            if line.startswith("**") or not line.strip():
                continue
            try:
                if line.startswith("*"):
                    if unfinished:
                        raise ValueError("the line before it ends with a comma")
                    keyword, *arguments = (field.strip() for field in line.split(","))
                    keyword = keyword.upper()
                    options = {
                        key.strip().upper(): value.strip()
                        for key, _, value in (field.partition("=") for field in arguments)
                    }
                    if keyword == "*INCLUDE":
                        # by a name from the folder of the whole model, as the programs do
                        self._read(included_file(options["INPUT"], self.path.parent), depth + 1)
                    continue
                text = unfinished + line.strip()
                unfinished = text if keyword == "*ELEMENT" and text.endswith(",") else ""
                if not unfinished:
                    self._data(keyword, options, [x.strip() for x in text.split(",") if x.strip()])
            except (IndexError, KeyError, OverflowError, ValueError) as error:
                raise ValueError(f"{path}, line {number}: {line[:60]!r}: {error}") from None
        if unfinished:
            raise ValueError(f"{path}: it ends within an element: it was cut short")

    def _data(self, keyword: str, options: dict[str, str], fields: list[str]) -> None:
        if keyword == "*NODE":
            label, place = int(fields[0]), [float(x) for x in fields[1:]]
            if len(place) != 3 or label in self._nodes or not np.all(np.isfinite(place)):
                raise ValueError("a node needs a label of its own and three finite coordinates")
            self._nodes[label] = place
            if "NSET" in options:
                self._members(options["NSET"])[label] = None
        elif keyword == "*ELEMENT":
            _, *nodes = (int(x) for x in fields)
            if options["TYPE"].upper().startswith("C3D"):
                self._types.add(options["TYPE"].upper())
                if not solid_corners(len(nodes)):
                    raise ValueError(f"a solid element with {len(nodes)} nodes is not known")
                self._elements.setdefault(len(nodes), []).append(nodes)
        elif keyword == "*NSET":
            members = self._members(options["NSET"])
            if "GENERATE" in options:
                begin, end, *step = (int(x) for x in fields)
                members[range(begin, end + 1, *step)] = None
                return
            for x in fields:
                members |= {int(x): None} if x.lstrip("-").isdigit() else self._sets[x.upper()]

    def _members(self, name: str) -> dict[int | range, None]:
        self._names.setdefault(name.upper(), name)
        return self._sets.setdefault(name.upper(), {})

    def _labels_of(self, name: str) -> Integers:
        """The labels in a set; a ValueError if there are more than nodes."""
        labels: set[int] = set()
        for member in self._sets[name]:
            several = member if isinstance(member, range) else (member,)
            if len(several) > len(self.labels):
                raise ValueError(
                    f"{self.path}: set {name} names {len(several):,} nodes from {several[0]} to "
                    f"{several[-1]}, and there are {len(self.labels):,}"
                )
            labels.update(several)
        return np.array(sorted(labels), dtype=np.int64)

    def rows(self, what: str, labels: Integers) -> Integers:
        """The rows of nodes with some labels, to which ``what`` refers in messages."""
        hint = ""
        if "C3D8I" in self._types:
            hint = (
                ": the incompatible modes of elements of the type C3D8I have nodes of their own, "
                "and are not read; take C3D8, C3D20 or another type"
            )
        return rows_of_labels(f"{self.path}: {what}", labels, self.labels, hint)

    def matrices(
        self, stiffness: NDArray, mass: NDArray, sources: tuple[Path, Path]
    ) -> AssembledMatrices:
        """A body of rows, columns and values of two matrices, of all displacements in order."""
        n = 3 * len(self.labels)
        assembled = []
        for table, source in zip((stiffness, mass), sources, strict=True):
            index = whole_numbers(source, table[:, :2])
            assembled.append(from_entries(str(source), index[:, 0], index[:, 1], table[:, 2], n))
        members = {name: self._labels_of(name) for name in self._sets}
        sets = {
            self._names[name]: self.rows(f"set {name}", labels)
            for name, labels in members.items()
            if len(labels) > 2
        }
        elements = [
            self.rows("an element", np.array(block, dtype=np.int64).ravel()).reshape(-1, size)
            for size, block in self._elements.items()
        ]
        try:
            return AssembledMatrices(
                assembled[0], assembled[1], self.nodes, sets, surface(elements)
            )
        except ValueError as error:
            raise ValueError(f"{sources[0]} and {sources[1].name}: {error}") from error


def read_calculix(path: str | Path, model: str | Path | None = None) -> AssembledMatrices:
    """The matrices that CalculiX has written beside its input file.

    Args:
        path: The input file, ``NAME.inp``, beside which ``NAME.sti``, ``.mas`` and ``.dof`` are.
        model: The input file with the nodes, if that is another one, as if one was included.

    Raises:
        ValueError: If a file is damaged or cut short, or the matrices are not those of a body that
            nothing holds (`AssembledMatrices`); the message names the file.
        OSError: If a file cannot be read.
    """
    path = validation.path("read_calculix: path", path)
    source = path if model is None else validation.path("read_calculix: model", model)
    input_file = InputFile(source)
    place = path.with_suffix(".dof")
    try:
        labels = [line.split(".") for line in place.read_text().split()]
        dofs = np.array([(int(node), int(axis)) for node, axis in labels], dtype=np.int64)
    except (OverflowError, UnicodeDecodeError, ValueError) as error:
        raise ValueError(f"{place}: each line must be NODE.DIRECTION: {error}") from None
    dofs = dofs.reshape(-1, 2)
    if len(dofs) and not (dofs[:, 1].min() > 0 and dofs[:, 1].max() < 4):
        raise ValueError(f"{place}: directions must be 1, 2 or 3: only solid elements are possible")
    order = 3 * input_file.rows(place.name, dofs[:, 0]) + dofs[:, 1] - 1
    n = 3 * len(input_file.labels)
    if missing := np.setdiff1d(np.arange(n), order).tolist():
        examples = [f"{input_file.labels[k // 3]}.{k % 3 + 1}" for k in missing[:5]]
        raise ValueError(
            f"{place}: {len(missing)} of {n} displacements are missing, as {examples}: leave out "
            "boundary conditions and nodes that belong to no element"
        )
    if len(order) != n:
        raise ValueError(f"{place}: {len(order) - n} displacements stand twice")
    tables, sources = [], (path.with_suffix(".sti"), path.with_suffix(".mas"))
    for source_file in sources:
        table = read_table(source_file, 3)
        index = whole_numbers(source_file, table[:, :2])
        if index.min() < 1 or index.max() > n:
            raise ValueError(
                f"{source_file}: an entry lies outside of the {n} rows of {place.name}"
            )
        tables.append(np.column_stack([order[index - 1], table[:, 2]]))
        # both triangles, as the new order mixes them
        off = index[:, 0] != index[:, 1]
        tables[-1] = np.vstack([tables[-1], tables[-1][off][:, [1, 0, 2]]])
    return input_file.matrices(tables[0], tables[1], sources)


def read_abaqus(stiffness: str | Path, mass: str | Path, model: str | Path) -> AssembledMatrices:
    """The matrices that Abaqus has written.

    Args:
        stiffness: The file of the stiffness, ``_STIF1.mtx``.
        mass: The file of the mass, ``_MASS1.mtx``.
        model: The input file with nodes, solid elements and node sets, in flat form.

    Raises:
        ValueError: If a file is damaged or cut short, or the matrices are not those of a body that
            nothing holds (`AssembledMatrices`); the message names the file.
        OSError: If a file cannot be read.
    """
    input_file = InputFile(validation.path("read_abaqus: model", model))
    sources = (
        validation.path("read_abaqus: stiffness", stiffness),
        validation.path("read_abaqus: mass", mass),
    )
    tables: list[Array] = []
    for source in sources:
        table = read_table(source, (3, 5))
        if table.shape[1] == 5:  # node, direction, node, direction, value
            index = whole_numbers(source, table[:, :4])
            if index[:, 1::2].min() < 1 or index[:, 1::2].max() > 3:
                raise ValueError(f"{source}: directions must be 1, 2 or 3, as of solid elements")
            rows = input_file.rows(source.name, index[:, ::2].ravel()).reshape(-1, 2)
            table = np.column_stack([3 * rows + index[:, 1::2], table[:, 4]])
        tables.append(table - np.array([1.0, 1.0, 0.0]))
    return input_file.matrices(tables[0], tables[1], sources)
