# SPDX-License-Identifier: MIT
"""Tables, and the facts about the machine that stand above them."""

from __future__ import annotations

import csv
import os
import platform
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

__all__ = ["Table", "duration", "facts", "write_page"]


#: Mean number of busy processes in the last minute when this run began: those of others
LOAD_BEFORE = os.getloadavg()[0]
#: What else a reader of the pages must know of this run
NOTES: list[str] = []


@dataclass(frozen=True)
class Table:
    """Numbers in columns."""

    name: str  #: Of the CSV file
    title: str
    text: str  #: What is measured, and how
    columns: dict[str, str]  #: Names in the CSV file and in print, both with units
    rows: Sequence[dict[str, float | str]]  #: One number or word for each column

    def write_csv(self, directory: Path) -> Path:
        """Write the numbers with all their digits."""
        path = directory / f"{self.name}.csv"
        with path.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(self.columns))
            writer.writeheader()
            writer.writerows({key: row[key] for key in self.columns} for row in self.rows)
        return path

    def markdown(self) -> str:
        """The table in Markdown, three digits a number."""
        lines = [
            f"## {self.title}\n",
            f"{self.text}\n",
            "| " + " | ".join(self.columns.values()) + " |",
            "|" + "---:|" * len(self.columns),
        ]
        for row in self.rows:
            lines.append("| " + " | ".join(_printed(row[key]) for key in self.columns) + " |")
        return "\n".join(lines) + "\n"


def write_page(directory: Path, name: str, title: str, picture: str, tables: list[Table]) -> None:
    """Write tables as CSV files and as one page.

    Args:
        directory: Where to.
        name: Of the page.
        title: Its heading.
        picture: File of the picture beside it, and what the picture shows, as Markdown.
        tables: What is on it.
    """
    for table in tables:
        table.write_csv(directory)
    parts = [f"# {title}\n", facts(), f"{picture}\n", *(table.markdown() for table in tables)]
    (directory / f"{name}.md").write_text("\n".join(parts))


def facts() -> str:
    """What was measured on: machine and versions, as a Markdown list."""
    names = {
        "DOLFINx": "fenics-dolfinx",
        "petsc4py": "petsc4py",
        "slepc4py": "slepc4py",
        "Numba": "numba",
        "NumPy": "numpy",
    }
    versions = ", ".join(f"{name} {version(package)}" for name, package in names.items())
    cores = len(os.sched_getaffinity(0))
    busy = (
        "- **the machine was not free when the run began: the times are longer than they need be, "
        "those on 2 ranks most of all; ratios from one line suffer less**\n"
        if LOAD_BEFORE > 0.5
        else ""
    )
    return (
        f"- machine: {_processor()}, {cores} cores for this process, load {LOAD_BEFORE:.1f} before "
        f"the run and {os.getloadavg()[0]:.1f} at its end\n{busy}"
        f"- {_system()}, Python {platform.python_version()}, {versions}\n"
        f"- one BLAS thread; 1 MPI rank where nothing else is said; measured on "
        f"{time.strftime('%Y-%m-%d')}\n" + "".join(f"- **{note}**\n" for note in NOTES)
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _system() -> str:
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except OSError:
        return platform.platform()


def _printed(value: float | str) -> str:
    if isinstance(value, str):
        return value
    if value == 0:
        return "0"
    if isinstance(value, int) and abs(value) < 10**7:
        return f"{value:,}"
    if not np.isfinite(value):
        return "-"
    if 1e-3 <= abs(value) < 1e5:
        digits = max(0, 2 - int(np.floor(np.log10(abs(value)))))
        return f"{value:,.{digits}f}"
    return f"{value:.1e}"


def duration(seconds: float) -> str:
    """A duration in the unit that suits it."""
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0), ("s", 1.0)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{1e3 * seconds:.3g} ms" if seconds < 0.1 else f"{seconds:.2g} s"
