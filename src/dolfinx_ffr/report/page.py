# SPDX-License-Identifier: MIT
"""One HTML file of a run, which needs nothing else: no network, no scripts, no files beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import jinja2

from .. import validation
from ..files import replace_file
from ..parallel import on_rank_0
from .folder import Folder
from .sections import sections


def write_report(
    comm: MPI.Comm, folder: str | Path, *, output: str | Path | None = None, title: str = ""
) -> Path:
    """Write the report of a run as one HTML file; collective, rank 0 reads and writes.

    All that it shows stands in the folder: ``summary.json`` (`run_record` lists the keys),
    ``history.csv``, the pictures, and ``part.svg`` with the outline of the part. What is missing is
    left out, and named at the end of the page.

    Args:
        comm: All its ranks call.
        folder: What a run has written to.
        output: The file; by default ``report.html`` in the folder.
        title: Heading, by default the recorded one.

    Returns:
        The file, on every rank.

    Raises:
        FileNotFoundError: On every rank, if the folder holds no run.
        ValueError: On every rank, if summary or history are damaged.
        OSError: On every rank, if a file cannot be read or written.
    """
    validation.instance("write_report: comm", comm, MPI.Comm, "an MPI communicator")
    place = validation.path("write_report: folder", folder)
    validation.instance("write_report: title", title, str, "a text")
    file = place / "report.html"
    if output is not None:
        file = validation.path("write_report: output", output)

    def write() -> None:
        content = render(Folder.read(place), title).encode()
        file.parent.mkdir(parents=True, exist_ok=True)
        replace_file(file, content)

    on_rank_0(comm, write)
    return file


def render(folder: Folder, title: str = "") -> str:
    """The page of a run, with the recorded heading unless a title is given."""
    blocks: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True, "autoescape": True}
    loader = jinja2.PackageLoader("dolfinx_ffr.report")
    environment = jinja2.Environment(loader=loader, undefined=jinja2.StrictUndefined, **blocks)
    return environment.get_template("report.html").render(sections(folder, title))
