# SPDX-License-Identifier: MIT
"""Files: histories, summaries, checkpoints, and fields for ParaView.

Files that a later run reads are written beside their place and then moved there in one stroke, so
that a run that is killed leaves the old file or the new one, never half of one. On several ranks
rank 0 writes, and an error there is raised on every rank.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from dolfinx.io import XDMFFile
from numpy.typing import ArrayLike, NDArray

from .domain import Domain

__all__ = [
    "CheckpointError",
    "HistoryFile",
    "load_checkpoint",
    "read_history",
    "save_checkpoint",
    "write_density",
    "write_fields",
    "write_summary",
]


class CheckpointError(RuntimeError):
    """A checkpoint that is damaged, or belongs to another problem."""


def on_rank_0(comm: MPI.Comm, action: Callable[[], Any]) -> Any:
    """Return what ``action`` returns on rank 0, on every rank of ``comm``; or raise what it raises.

    Raises:
        Exception: on every rank, whatever ``action`` raises on rank 0.
    """
    result, error = None, None
    if comm.rank == 0:
        try:
            result = action()
        except Exception as caught:
            error = caught
    result, error = comm.bcast((result, error), root=0)
    if error is not None:
        raise error
    return result


def _replace(path: Path, content: bytes) -> None:
    """Write a file in one stroke."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with open(beside, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def write_summary(comm: MPI.Comm, path: str | Path, summary: Mapping[str, Any]) -> None:
    """Write numbers and texts as a JSON file.

    Args:
        comm: all its ranks call; rank 0 writes.
        path: the file.
        summary: what rank 0 holds is written.

    Raises:
        OSError: on every rank, if the file cannot be written.
    """
    text = json.dumps(dict(summary), indent=2, default=_plain) + "\n"
    on_rank_0(comm, lambda: _replace(Path(path), text.encode()))


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"a summary cannot hold a {type(value).__name__}")


class HistoryFile:
    """A CSV file with one row an iteration, complete on the disk after each row.

    Args:
        comm: all its ranks call; rank 0 writes.
        path: the file.
        columns: names of the columns.
        rows: rows to begin with, for example of the run that is resumed.

    Raises:
        OSError: on every rank, if the file cannot be written.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        path: str | Path,
        columns: list[str],
        rows: Sequence[Mapping[str, float]] = (),
    ) -> None:
        self._comm = comm
        self._path = Path(path)
        self._columns = columns
        text = io.StringIO()
        writer = csv.DictWriter(text, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        on_rank_0(comm, lambda: _replace(self._path, text.getvalue().encode()))

    def append(self, row: Mapping[str, float]) -> None:
        """Add a ``row`` with a value for each column.

        Raises:
            OSError: on every rank, if it cannot be written.
        """

        def write() -> None:
            with open(self._path, "a", newline="") as file:
                csv.DictWriter(file, self._columns, lineterminator="\n").writerow(row)

        on_rank_0(self._comm, write)


def read_history(path: str | Path) -> dict[str, NDArray[np.float64]]:
    """Return the columns of a history file.

    Args:
        path: a file of `HistoryFile`.

    Returns:
        Arrays of shape (iterations,) by column.
    """
    with open(path, newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
        names = list(reader.fieldnames or [])
    return {name: np.array([float(row[name]) for row in rows]) for name in names}


def save_checkpoint(comm: MPI.Comm, path: str | Path, state: Mapping[str, Any]) -> None:
    """Write arrays and numbers with a checksum.

    Args:
        comm: all its ranks call; rank 0 writes what it holds.
        path: the file.
        state: arrays, numbers and texts by name.

    Raises:
        OSError: on every rank, if the file cannot be written; an older checkpoint stays as it was.
    """
    buffer = io.BytesIO()
    np.savez(buffer, **{key: np.asarray(value) for key, value in state.items()})
    content = buffer.getvalue()
    digest = hashlib.sha256(content).hexdigest().encode()
    on_rank_0(comm, lambda: _replace(Path(path), digest + b"\n" + content))


def load_checkpoint(comm: MPI.Comm, path: str | Path) -> dict[str, NDArray[Any]]:
    """Return what `save_checkpoint` wrote, on every rank.

    Args:
        comm: all its ranks call; rank 0 reads.
        path: the file.

    Raises:
        FileNotFoundError: on every rank, if there is no such file.
        CheckpointError: on every rank, if the file is damaged.
    """

    def read() -> dict[str, NDArray[Any]]:
        digest, _, content = Path(path).read_bytes().partition(b"\n")
        if hashlib.sha256(content).hexdigest().encode() != digest:
            raise CheckpointError(
                f"checkpoint {path} is damaged: its checksum does not fit its content. Delete it "
                "to start anew"
            )
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {key: arrays[key] for key in arrays.files}

    return on_rank_0(comm, read)


def write_density(domain: Domain, x: NDArray[np.float64], path: str | Path) -> None:
    """Write mesh and density as XDMF, which ParaView opens.

    Args:
        domain: the body.
        x: density of this rank's cells, shape (cells,).
        path: file that ends in ``.xdmf``; the numbers go into an ``.h5`` file beside it.

    Raises:
        OSError: on every rank, if the folder cannot be made.
    """
    write_fields(domain, {"density": domain.check_density(x)}, path)


def write_fields(domain: Domain, fields: Mapping[str, ArrayLike], path: str | Path) -> None:
    """Write a mesh and values on its cells as XDMF, which ParaView opens.

    Args:
        domain: the body.
        fields: by name, values of this rank's cells, shape (cells,).
        path: file that ends in ``.xdmf``; the numbers go into an ``.h5`` file beside it.

    Raises:
        ValueError: on every rank, if a field does not have one value a cell.
        OSError: on every rank, if the folder cannot be made.
    """
    functions = []
    for name, values in fields.items():
        given = np.asarray(values, dtype=np.float64)
        if not all(domain.comm.allgather(given.shape == (domain.n_cells,))):
            raise ValueError(
                f"write_fields: {name!r} must have one value for each cell owned by the rank; on "
                f"rank {domain.comm.rank} it has the shape {given.shape} for {domain.n_cells} cells"
            )
        function = fem.Function(domain.density_space, name=name)
        function.x.array[: domain.n_cells] = given
        function.x.scatter_forward()
        functions.append(function)
    on_rank_0(domain.comm, lambda: Path(path).parent.mkdir(parents=True, exist_ok=True))
    with XDMFFile(domain.comm, str(path), "w") as file:
        file.write_mesh(domain.mesh)
        for function in functions:
            file.write_function(function)
