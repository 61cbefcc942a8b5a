# SPDX-License-Identifier: MIT
"""Files: histories, summaries, checkpoints, and fields for ParaView.

Files that a later run reads are written beside their place and then moved there in one stroke, so
that a run that is killed leaves the old file or the new one, never half of one. On several ranks
rank 0 writes.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from dolfinx.io import XDMFFile
from numpy.typing import ArrayLike, NDArray

from . import validation
from .archive import Archive
from .arrays import Array
from .fem import Domain
from .files import check_room, named_in_errors, replace_file, whole_file
from .parallel import check_alike, on_every_rank, on_rank_0


class CheckpointError(RuntimeError):
    """A checkpoint that is damaged, or belongs to another problem."""


def _replace(path: Path, content: bytes) -> None:
    """Write a file in one stroke, in a directory that is made if need be."""
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, content)


def write_summary(comm: MPI.Comm, path: str | Path, summary: Mapping[str, Any]) -> None:
    """Write numbers and texts as a JSON file.

    Args:
        comm: All its ranks call; rank 0 writes.
        path: The file.
        summary: Numbers and texts of rank 0 by name; NaN and infinity are written as null.

    Raises:
        TypeError: If an argument is of a wrong kind, or rank 0 holds something else than numbers
            and texts.
        ValueError: If the summary holds itself.
        OSError: If the file cannot be written.
    """
    validation.instance("write_summary: comm", comm, MPI.Comm, "an MPI communicator")
    file = validation.path("write_summary: path", path)

    def write() -> None:
        needed = "a mapping from names to numbers and texts"
        validation.instance("write_summary: summary", summary, Mapping, needed)
        try:
            text = json.dumps(plain(summary), indent=2)
        except (RecursionError, ValueError) as error:
            raise ValueError(
                "write_summary: the summary contains itself, or is nested too deeply for a file: "
                f"{error}; leave out references to a list or mapping that contains them"
            ) from None
        _replace(file, f"{text}\n".encode())

    on_rank_0(comm, write)


def plain(value: Any) -> Any:
    """A value as JSON holds it: NaN and infinity, for which JSON has no word, become None."""
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, str | int | float):
        return value
    raise TypeError(f"a summary cannot hold a {type(value).__name__}")


def write_history(
    comm: MPI.Comm, path: Path, columns: Sequence[str], rows: Sequence[Mapping[str, float]]
) -> None:
    """Write a CSV file with one row an iteration, from rank 0."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    on_rank_0(comm, lambda: _replace(path, text.getvalue().encode()))


def read_history(path: str | Path) -> dict[str, Array]:
    """The columns of the history file at a ``path``, arrays of shape (iterations,) by name.

    Raises:
        FileNotFoundError: If there is no such file.
    """
    with open(validation.path("read_history: path", path), newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    return {n: np.array([float(row[n]) for row in rows]) for n in reader.fieldnames or ()}


def save_checkpoint(comm: MPI.Comm, path: Path, state: Mapping[str, Any]) -> None:
    """Write arrays, numbers and texts that rank 0 holds by name, with a checksum.

    An optimizer of one's own may hold other things, which are refused with a TypeError.
    """
    arrays = {name: np.asarray(value) for name, value in state.items()}
    for name, array in arrays.items():
        if array.dtype.hasobject:
            raise TypeError(
                f"save_checkpoint: {name!r} must be an array, a number or a text, but it is "
                f"{validation.described(state[name])}"
            )
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    content = buffer.getvalue()
    digest = hashlib.sha256(content).hexdigest().encode()
    on_rank_0(comm, lambda: _replace(path, digest + b"\n" + content))


def load_checkpoint(comm: MPI.Comm, path: Path) -> dict[str, NDArray[Any]]:
    """The arrays that `save_checkpoint` wrote, on every rank."""

    def read() -> dict[str, NDArray[Any]]:
        digest, _, content = path.read_bytes().partition(b"\n")
        try:
            if hashlib.sha256(content).hexdigest().encode() != digest:
                raise ValueError("its checksum does not fit its content")
            return Archive.of(content, packed=False).read()
        except ValueError as error:
            raise CheckpointError(
                f"checkpoint {path} is damaged: {error}. Delete it to start anew"
            ) from error

    return on_rank_0(comm, read)


def _xdmf_path(path: str | Path) -> Path:
    """The path of an XDMF file, whose ending may be left out."""
    place = validation.path("write_fields: path", path)
    if place.suffix.lower() == ".xdmf":
        return place
    if place.suffix or not place.name:
        raise ValueError(
            f"write_fields: {place} must end in .xdmf, the format of the file, which ParaView opens"
        )
    return place.with_suffix(".xdmf")


def write_density(domain: Domain, x: Array, path: str | Path) -> None:
    """Write mesh and density ``x`` (cells,) of a ``domain`` to a ``path``, see `write_fields`.

    Raises:
        OSError: With the name of the file that cannot be written.
    """
    validation.instance("write_density: domain", domain, Domain, "a Domain")
    write_fields(domain, {"density": domain.check_density(x)}, path)


def write_fields(domain: Domain, fields: Mapping[str, ArrayLike], path: str | Path) -> None:
    """Write a mesh and values on its cells as XDMF, which ParaView opens.

    Args:
        domain: The body.
        fields: Values of this rank's cells by name of the field, shape (cells,).
        path: File that ends in ``.xdmf``, which is added where the path has no ending; the numbers
            go into an ``.h5`` file beside it.

    Raises:
        ValueError: If a field does not have one value a cell, or the path has another ending.
        OSError: With the name of the file that cannot be written.
    """
    validation.instance("write_fields: domain", domain, Domain, "a Domain")
    place = _xdmf_path(path)
    with on_every_rank(domain.comm, "write_fields"):
        validation.by_name("write_fields: fields", fields, "values of the cells")
        check_alike(domain.comm, "write_fields", {"fields": list(fields)})
        arrays = {
            name: validation.numbers(f"write_fields: {name!r}", values)
            for name, values in fields.items()
        }
        for name, values in arrays.items():
            if values.shape != (domain.n_cells,):
                raise ValueError(
                    f"write_fields: {name!r} must have one value for each cell owned by the rank; "
                    f"on rank {domain.comm.rank} it has the shape {values.shape} for "
                    f"{domain.n_cells} cells"
                )
    functions = []
    for name, values in arrays.items():
        function = fem.Function(domain.density_space, name=name)
        function.x.array[: domain.n_cells] = values
        function.x.scatter_forward()
        functions.append(function)
    mesh, cells = domain.mesh, domain.n_cells_global
    numbers = 3 * mesh.geometry.index_map().size_global + (len(arrays) + 30) * cells
    # the two files name each other: they get their names in a folder beside, and are moved together
    folder = place.with_name(f".{place.stem}.{os.getpid()}")

    def make() -> Path:
        place.parent.mkdir(parents=True, exist_ok=True)
        with named_in_errors(place, folder):  # HDF5 takes the process with it on a full disk
            check_room(folder, 100_000 + 8 * numbers)
        folder.mkdir()
        return folder

    def move() -> None:
        for file in sorted(folder.iterdir()):
            with whole_file(place.with_name(file.name)) as beside:
                file.replace(beside)

    folder = on_rank_0(domain.comm, make)
    try:
        with XDMFFile(domain.comm, str(folder / place.name), "w") as file:
            file.write_mesh(mesh)
            for function in functions:
                file.write_function(function)
        on_rank_0(domain.comm, move)
    finally:
        if domain.comm.rank == 0:
            shutil.rmtree(folder, ignore_errors=True)
