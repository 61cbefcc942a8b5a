# SPDX-License-Identifier: MIT
"""A study's page: tables, pictures, and the facts about the machine that stand above them."""

import csv
import os
import platform
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from dolfinx_ffr.plotting.style import DARK, styled_figure, tidy

#: One number or word for each column of a table; rows may hold more than the columns
Rows = Sequence[Mapping[str, Any]]
#: Words of the pages
PAGES = Path(__file__).resolve().parent / "pages"
#: Mean number of busy processes of others in the minute before this run began
LOAD_BEFORE = os.getloadavg()[0]
#: What else a reader of the pages must know of this run
NOTES: list[str] = []


@dataclass(frozen=True)
class Table:
    """Numbers in columns: the name of the CSV file, a title, what is measured and how."""

    name: str
    title: str
    text: str
    columns: dict[str, str]  #: Names in the CSV file and in print, both with units
    rows: Rows

    def write_csv(self, directory: Path) -> None:
        """Write the numbers with all their digits."""
        with (directory / f"{self.name}.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, list(self.columns), restval=np.nan, extrasaction="ignore")
            writer.writeheader()
            writer.writerows(self.rows)

    def markdown(self) -> str:
        """The table in Markdown, three digits a number."""
        lines = [
            f"## {self.title}\n",
            f"{self.text}\n",
            "| " + " | ".join(self.columns.values()) + " |",
            "|" + "---:|" * len(self.columns),
        ]
        for row in self.rows:
            cells = (_printed(row.get(key, np.nan)) for key in self.columns)
            lines.append(f"| {' | '.join(cells)} |")
        return "\n".join(lines) + "\n"


class Study:
    """A page in a directory, its tables (CSV files too) and its pictures.

    `pages/NAME.md` has its words: a title, and for each table a heading ``## name: title``, what is
    measured and how, and the columns, ``| mesh | value: value [s] |``, key and heading.
    """

    def __init__(self, directory: Path, name: str) -> None:
        self.directory, self.name = directory, name
        self.tables: list[Table] = []
        self.pictures: list[str] = []
        self.title, *sections = (PAGES / f"{name}.md").read_text().split("\n## ")
        self.words = {section.partition(": ")[0]: section for section in sections}

    def table(self, name: str, rows: Rows, like: str = "", **words: Any) -> None:
        """Add a table, described as ``like`` or by its own name; ``words`` fill the braces."""
        title, text, table = self.words[like or name].strip().format(**words).split("\n\n")
        cells = table.strip("| ").replace(" |\n| ", " | ").split(" | ")
        pairs = (cell.partition(": ") for cell in cells)
        columns = {key: heading or key for key, _, heading in pairs}
        text = " ".join(text.split("\n"))
        self.tables.append(Table(name, title.partition(": ")[2], text, columns, rows))

    @contextmanager
    def picture(
        self, caption: str, lines: int, columns: int, size: tuple[float, float], name: str = ""
    ) -> Iterator[list[Axes]]:
        """Panels to draw into, in rows; the picture is written afterwards."""
        file = f"{name or self.name}.png"
        with styled_figure(*size, self.directory / file) as figure:
            yield list(figure.subplots(lines, columns, squeeze=False).flat)
        self.pictures.append(f"![{caption}]({file})\n")

    def write(self) -> list[Table]:
        """Write the page, and return its tables."""
        for table in self.tables:
            table.write_csv(self.directory)
        parts = [f"{self.title.strip()}\n", facts(), *self.pictures]
        parts += [table.markdown() for table in self.tables]
        (self.directory / f"{self.name}.md").write_text("\n".join(parts))
        return self.tables


def chosen(rows: Rows, **wanted: Any) -> list[dict[str, Any]]:
    """The rows that have these values in these columns."""
    return [dict(row) for row in rows if all(row[name] == wanted[name] for name in wanted)]


def seconds_to_reach(rows: Rows, error: float, what: str) -> float:
    """The seconds to an error, interpolated in logarithms between runs from coarse to fine.

    They are those of the coarsest run, where even that is more accurate, and not a number where
    none is accurate enough. A run counts with the largest error of it and of all finer ones.
    """
    errors = np.maximum.accumulate([row[what] for row in rows][::-1])[::-1]
    found, wanted = -np.log(np.maximum(errors, 1e-300)), -np.log(error)
    seconds = np.log([row["seconds"] for row in rows])
    return float(np.exp(np.interp(wanted, found, seconds, right=np.nan)))


def line(
    axes: Axes,
    rows: Rows,
    x: str,
    y: str,
    style: str,
    color: str,
    *,
    hollow: bool = False,
    **more: Any,
) -> None:
    """Draw the positive numbers of column ``y`` over column ``x``; ``more`` is for `Axes.plot`."""
    shown = [row for row in rows if row[y] > 0.0]
    more = {"markersize": 5.0, "markerfacecolor": "white" if hollow else color, **more}
    axes.plot([row[x] for row in shown], [row[y] for row in shown], style, color=color, **more)


def plot(
    axes: Axes,
    title: str,
    x: str,
    y: str,
    *,
    scales: str = "xy",
    room: float = 0.0,
    legend: str = "",
) -> None:
    """Title, labels, logarithmic ``scales`` and legend of a diagram in which all is drawn.

    ``room`` for the legend is a share of the height; without a place there is no ``legend``.
    """
    axes.set(title=title, xlabel=x, ylabel=y)
    if "x" in scales:
        axes.set_xscale("log")
        if "seconds" in x or "[mm]" in x:  # 1, 2 and 5 of each decade
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axes.xaxis.set_minor_formatter(NullFormatter())
    if "y" in scales:
        axes.set_yscale("log")
    axes.autoscale_view()
    low, high = axes.get_ylim()
    if "y" not in scales:
        axes.set_ylim(low, high + room * (high - low))
    elif low > 0.0:  # not where nothing positive is drawn
        axes.set_ylim(low, high * (high / low) ** room)
    if legend:
        axes.legend(loc=legend, fontsize=8.5)
    tidy(axes)


def tick_labels(axes: Axes, rows: Rows, x: str, y: str, text: str, *, below: bool = False) -> None:
    """Write beside each point of a line, ``text`` with the row's columns in braces."""
    place = {"ha": "right", "va": "top"} if below else {"ha": "left", "va": "bottom"}
    offset = (-5, -4) if below else (5, 3)
    for row in rows:
        if row[y] > 0.0:
            words, point = text.format(**row).replace("e-0", "e-"), (row[x], row[y])
            look = {"textcoords": "offset points", "fontsize": 8, "color": DARK, **place}
            axes.annotate(words, point, offset, **look)


def facts() -> str:
    """What was measured on: machine and versions, as a Markdown list."""
    packages = ("fenics-dolfinx", "petsc4py", "slepc4py", "numba", "numpy")
    names = ("DOLFINx", "petsc4py", "slepc4py", "Numba", "NumPy")
    pairs = zip(names, packages, strict=True)
    versions = ", ".join(f"{name} {version(package)}" for name, package in pairs)
    busy = (
        "- **the machine was busy when the run began: times are longer than on a free machine, "
        "most of all on 2 ranks; ratios within a line suffer less**\n"
    )
    return (
        f"- machine: {_processor()}, {len(os.sched_getaffinity(0))} cores for this process, "
        f"load {LOAD_BEFORE:.1f} before the run and {os.getloadavg()[0]:.1f} at its end\n"
        f"{busy if LOAD_BEFORE > 0.5 else ''}"
        f"- {_system()}, Python {platform.python_version()}, {versions}\n"
        f"- one BLAS thread; 1 MPI rank unless stated otherwise; measured on "
        f"{time.strftime('%Y-%m-%d')}\n" + "".join(f"- **{note}**\n" for note in NOTES)
    )


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


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
