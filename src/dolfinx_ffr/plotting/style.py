# SPDX-License-Identifier: MIT
"""Common to all pictures: fonts, colours, figures without a screen, files by rank 0."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from typing import Any

from mpi4py import MPI

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from .. import validation
from ..files import whole_file
from ..parallel import on_rank_0

#: Files that matplotlib writes here
KINDS = (".png", ".pdf", ".svg")
DARK, GRAY, LIGHT = "#22272e", "#7d8590", "#c9d1d9"
#: Of bodies without a mesh
STEEL = "#57606a"
BLUE, RED, GREEN, ORANGE = "#0b62a4", "#c8352b", "#2b8a4b", "#d9822b"
#: Told apart by readers with any colour vision, in this order (interfaces, bodies)
ACCENTS = (BLUE, ORANGE, GREEN, "#8250df", RED, "#1b9e9e")
#: From cool steel to glowing: legible on white, its lightness falls and its warmth grows
GLOW = LinearSegmentedColormap.from_list(
    "glow", ["#3b5b92", "#5fa8d3", "#a8d8b9", "#ffe28a", "#f79d4c", "#d7301f", "#7a0012"]
)
#: Background of what is written over a picture
LABEL = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none"}

#: Where it is not what matplotlib has by default
_STYLE: dict[str, Any] = {
    "axes.titlesize": 11.0,
    "axes.labelcolor": DARK,
    "axes.edgecolor": GRAY,
    "axes.titlecolor": DARK,
    "grid.color": "#e4e8ec",
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.8,
    "text.color": DARK,
    "xtick.color": DARK,
    "ytick.color": DARK,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
}


@contextmanager
def styled_figure(
    width: float, height: float, file: Path | None = None, *, dpi: float = 150.0
) -> Iterator[Figure]:
    """Give a figure (inches) without a screen, in the package's style, and write it at the end.

    The settings of matplotlib are put back.
    """
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure(figsize=(width, height), dpi=dpi)
        FigureCanvasAgg(figure)
        yield figure
        if file is not None:
            save(figure, file)


def axes_at(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """New axes of a figure at a place in inches."""
    x, y = figure.get_size_inches()
    return figure.add_axes((left / x, bottom / y, width / x, height / y))


def line_of_inches(figure: Figure, bottom: float) -> Axes:
    """Axes for one line across a figure, in inches from its left end, 0.2 up and down."""
    width = figure.get_figwidth() - 0.4
    axes = axes_at(figure, 0.2, bottom, width, 0.4)
    axes.set(xlim=(0.0, width), ylim=(-0.2, 0.2))
    axes.set_axis_off()
    return axes


def name_accents(
    axes: Axes, texts: Iterable[str], at: Sequence[float], size: float, inch: float = 1.0
) -> None:
    """Write texts in a row behind strokes of the `ACCENTS`; an inch is so long in the axes."""
    inch *= size / 10.0
    x, y = at
    for text, color in zip(texts, cycle(ACCENTS), strict=False):
        stroke = {"linewidth": 4.0, "solid_capstyle": "butt", "clip_on": False}
        axes.plot([x, x + 0.3 * inch], [y, y], color=color, **stroke)
        axes.text(x + 0.4 * inch, y, text, va="center", fontsize=size, clip_on=False)
        x += (0.75 + 0.09 * len(text)) * inch


def tidy(axes: Axes) -> None:
    """Leave only the left and lower spine of a diagram, with a quiet grid behind the lines."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_axisbelow(True)
    axes.grid(True)


def color_bar(
    figure: Figure,
    colors: ScalarMappable,
    label: str,
    place: tuple[float, float, float],
    **how: Any,
) -> None:
    """Draw a horizontal colour bar from left to right (shares), some inches below the top."""
    height = figure.get_figheight()
    left, right, below = place
    bar = figure.add_axes((left, 1.0 - below / height, right - left, 0.13 / height))
    figure.colorbar(colors, cax=bar, orientation="horizontal", **how)
    bar.set_title(label, fontsize=9, pad=4.0, color=DARK)
    bar.tick_params(labelsize=8, length=2.5, pad=2.0)
    if "ticks" not in how:
        bar.locator_params(nbins=5)


def save(figure: Figure, path: Path) -> None:
    """Write a figure; its size in pixels is that of the figure."""
    figure.savefig(path, dpi=figure.dpi)


def writable(path: str | Path, title: str = "", suffixes: tuple[str, ...] = KINDS) -> Path:
    """The path of a picture, or refuse its kind, and a title that is no text."""
    path = validation.path("picture", path)
    validation.name("picture: title", title)
    if path.suffix.lower() not in suffixes:
        raise ValueError(
            f"picture {str(path)!r}: the kind {path.suffix!r} is not known here; end the name in "
            f"{' or '.join(suffixes)}"
        )
    return path


def written(comm: MPI.Comm, path: Path, draw: Callable[[Path], None]) -> Path:
    """Let rank 0 write a picture, and make missing folders; errors are raised on all ranks."""
    validation.instance("picture: comm", comm, MPI.Comm, "an MPI communicator")

    def write() -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            draw(beside)

    on_rank_0(comm, write)
    return path


def nice_number(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed ``value``."""
    if not (np.isfinite(value) and value > 0.0):
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(m for m in (1.0, 2.0, 5.0) if m <= value / power * (1.0 + 1e-9)) * power)


def prefixed(value: float, unit: str) -> tuple[str, float]:
    """The unit with a prefix that suits a value, and the factor to it."""
    for prefix, size in (("M", 1e6), ("k", 1e3), ("", 1.0), ("m", 1e-3), ("µ", 1e-6)):
        if value >= size:
            return prefix + unit, 1.0 / size
    return unit, 1.0
