# SPDX-License-Identifier: MIT
"""What all pictures have in common: fonts, colours, figures without a screen, files by rank 0."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
from ..files import named_in_errors
from ..parallel import on_rank_0

__all__ = [
    "ACCENTS",
    "BLUE",
    "DARK",
    "GLOW",
    "GRAY",
    "KINDS",
    "LIGHT",
    "ORANGE",
    "RED",
    "color_bar",
    "nice_number",
    "prefixed",
    "save",
    "styled_figure",
    "tidy",
    "writable",
    "written",
]

#: Files that matplotlib writes here
KINDS = (".png", ".pdf", ".svg")
DARK, GRAY, LIGHT = "#22272e", "#7d8590", "#c9d1d9"
BLUE, RED, GREEN, ORANGE = "#0b62a4", "#c8352b", "#2b8a4b", "#d9822b"
#: Told apart by readers with any colour vision, in this order (interfaces, bodies)
ACCENTS = (BLUE, ORANGE, GREEN, "#8250df", RED, "#1b9e9e")
#: From cool steel to glowing: legible on white, its lightness falls and its warmth grows
GLOW = LinearSegmentedColormap.from_list(
    "glow", ["#3b5b92", "#5fa8d3", "#a8d8b9", "#ffe28a", "#f79d4c", "#d7301f", "#7a0012"]
)

_STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.labelsize": 10.0,
    "axes.labelcolor": DARK,
    "axes.edgecolor": GRAY,
    "axes.linewidth": 0.8,
    "axes.titlecolor": DARK,
    "axes.grid": False,
    "axes.facecolor": "white",
    "figure.facecolor": "white",
    "grid.color": "#e4e8ec",
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.8,
    "savefig.facecolor": "white",
    "text.color": DARK,
    "xtick.color": DARK,
    "ytick.color": DARK,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "mathtext.fontset": "dejavusans",
}


@contextmanager
def styled_figure(width: float, height: float, *, dpi: float = 150.0) -> Iterator[Figure]:
    """Give a figure that needs no screen, in the style of the package; settings are put back.

    Args:
        width: In inches.
        height: In inches.
        dpi: Pixels per inch.
    """
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure(figsize=(width, height), dpi=dpi)
        FigureCanvasAgg(figure)
        yield figure


def tidy(axes: Axes, *, grid: bool = True) -> None:
    """Leave only the left and lower spine of a diagram, with a quiet grid behind the lines."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_axisbelow(True)
    axes.grid(grid)


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


def writable(path: str | Path, suffixes: tuple[str, ...], title: str = "") -> Path:
    """The path of a picture, or refuse its kind.

    Args:
        path: Where to.
        suffixes: Those that are known.
        title: Its heading.

    Raises:
        TypeError: If it is no path, or the title no text.
        ValueError: If the suffix is not one of ``suffixes``.
    """
    path = validation.path("picture", path)
    validation.name("picture: title", title)
    if path.suffix.lower() not in suffixes:
        raise ValueError(
            f"picture {str(path)!r}: the kind {path.suffix!r} is not known here; end the name in "
            f"{' or '.join(suffixes)}"
        )
    return path


def written(comm: MPI.Comm, path: Path, draw: Callable[[Path], None]) -> Path:
    """Draw and write a picture on rank 0, while the others wait; an error is raised on all.

    Args:
        comm: The ranks that make the picture together.
        path: Where to; missing directories are made.
        draw: Writes the file, called on rank 0.

    Returns:
        The path, on every rank.
    """
    validation.instance("picture: comm", comm, MPI.Comm, "an MPI communicator")

    def write() -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        with named_in_errors(path):
            draw(path)

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
