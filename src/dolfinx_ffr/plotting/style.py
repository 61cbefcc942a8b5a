# SPDX-License-Identifier: MIT
"""Common to all pictures: fonts, colours, figures without a screen, files by rank 0."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
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
from matplotlib.patches import Patch

from .. import validation
from ..arrays import Array
from ..files import whole_file
from ..parallel import on_rank_0


@dataclass(frozen=True)
class PictureOptions:
    """Sizes and numbers that are chosen for pictures."""

    width: float = 10.4  #: Of a page [inches]
    scene_width: float = 9.0  #: Of scenes and films [inches]
    modes_width: float = 12.0  #: Of pages in columns [inches]
    pad: float = 0.1  #: Space around axes [inches]
    tallest: float = 1.25  #: Height of a panel divided by its width, at most

    # bodies
    void: float = 0.3  #: Cells of less density are not drawn
    #: Percentage of solid cells whose stress has a colour of its own; larger ones share the last
    stress_range: float = 99.7
    selected: float = 0.45  #: Share of orange in the colour of elements that are selected
    mode_size: float = 0.08  #: Largest displacement of a mode, relative to the extent of the body

    # mechanisms
    pin: float = 0.018  #: Size of a pin, relative to the extent of what is drawn
    margin: float = 0.06  #: Space around a mechanism, likewise
    letter: float = 0.7  #: Width of a letter, in pins
    line: float = 1.6  #: Height of a line of text, in pins
    deflection: float = 0.1  #: Largest one after magnification, relative to the largest body

    # films
    between: int = 10  #: Instants evaluated for each picture where time steps are few
    tallest_film: float = 1.7  #: Height of a film divided by its width, at most
    curve: float = 0.13  #: Height of the curve below, divided by its width
    glowing: int = 120  #: Colors that are those of energies, among 256
    white: int = 240  #: Parts of red, green and blue above which a color is white

    # diagrams
    heading: int = 42  #: Letters that a heading and the value beside it have in one line
    most_named: int = 12  #: Largest number of parameters that a legend names


PICTURES = PictureOptions()

#: Files that matplotlib writes here
KINDS = (".png", ".pdf", ".svg")
DARK, GRAY, LIGHT = "#22272e", "#7d8590", "#c9d1d9"
#: Color of bodies without a mesh
STEEL = "#57606a"
BLUE, RED, GREEN, ORANGE = "#0b62a4", "#c8352b", "#2b8a4b", "#d9822b"
#: Colors of interfaces and curves, in an order that readers with any colour vision can distinguish
ACCENTS = (BLUE, ORANGE, GREEN, "#8250df", RED, "#1b9e9e")
#: Colormap of stress and energy, legible on white: its lightness falls and its warmth grows
GLOW = LinearSegmentedColormap.from_list(
    "glow", ["#3b5b92", "#5fa8d3", "#a8d8b9", "#ffe28a", "#f79d4c", "#d7301f", "#7a0012"]
)
#: Background of text that is written over a picture
LABEL = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none"}

#: Settings that differ from matplotlib's defaults
_STYLE: dict[str, Any] = {
    "axes.titlesize": 11.0,
    "axes.labelcolor": DARK,
    "axes.edgecolor": GRAY,
    "axes.titlecolor": DARK,
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.h_pad": PICTURES.pad,
    "figure.constrained_layout.w_pad": PICTURES.pad,
    "figure.titlesize": 13.0,
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
    """Figure (inches) in the package's style, without a screen, laid out and written at the end.

    The settings of matplotlib are restored.
    """
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure(figsize=(width, height), dpi=dpi)
        FigureCanvasAgg(figure)
        yield figure
        if file is not None:
            figure.savefig(file)


@contextmanager
def page(
    file: Path,
    headings: Iterable[str],
    *,
    title: str = "",
    width: float = PICTURES.width,
    columns: int = 1,
) -> Iterator[list[Axes]]:
    """Axes of equal scales below each heading, in a figure that is as high as they need."""
    headings = list(headings)
    rows = -(-len(headings) // columns)
    with styled_figure(width, rows * PICTURES.tallest * width / columns, file) as figure:
        if title:
            figure.suptitle(title)
        panels = list(figure.subplots(rows, columns, squeeze=False).ravel())
        for axes in panels[len(headings) :]:
            axes.remove()
        for axes, heading in zip(panels, headings, strict=False):
            axes.set_title(heading)
        yield panels[: len(headings)]
        fit_height(figure, panels[: len(headings)])


def fit_height(figure: Figure, panels: Sequence[Axes]) -> None:
    """Make a figure with panels of equal scales as high as they need; before, it is too high."""
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()
    rows = [axes.get_subplotspec().rowspan.start for axes in panels]
    heights, heights_with_texts = np.zeros((2, max(rows) + 1))
    np.maximum.at(heights, rows, [axes.bbox.height for axes in panels])
    with_texts = [axes.get_tightbbox(renderer).height for axes in panels]
    np.maximum.at(heights_with_texts, rows, with_texts)
    panels[0].get_gridspec().set_height_ratios(heights)

    color_bars = [axes.get_tightbbox(renderer) for axes in figure.axes if axes not in panels]
    others = [*color_bars, *(text.get_window_extent(renderer) for text in figure.texts)]
    pixels = np.sum(heights_with_texts) + sum(box.height for box in others)
    pads = 2 * (len(heights) + len(others)) * PICTURES.pad
    figure.set_figheight(float(pixels) / figure.dpi + pads)


def add_color_bar(axes: list[Axes], colors: ScalarMappable, label: str, **options: Any) -> None:
    """Draw a horizontal colour bar below some axes."""
    figure: Any = axes[0].figure
    place: dict[str, Any] = {"location": "bottom", "shrink": 0.5, "aspect": 40, "pad": 0.03}
    figure.colorbar(colors, ax=axes, label=label, **place, **options)


def add_legend(axes: Axes, entries: Mapping[str, str], title: str = "") -> None:
    """Name colours in one row below some axes."""
    patches = [Patch(fc=color, ec=GRAY, lw=0.5, label=name) for name, color in entries.items()]
    place: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0)}
    axes.legend(handles=patches, ncol=len(patches), title=title, **place)


def accents(names: Iterable[str]) -> dict[str, str]:
    """One of the `ACCENTS` for each name."""
    return dict(zip(names, cycle(ACCENTS), strict=False))


def extent(points: Array) -> str:
    """Size of the bounding box of points (n, d) [m] in words."""
    sizes = np.ptp(points, axis=0)
    unit, factor = ("m", 1.0) if sizes.max() >= 1.0 else ("mm", 1e3)
    return " x ".join(f"{factor * size:.4g}" for size in sizes) + f" {unit}"


def tidy(axes: Axes) -> None:
    """Leave only the left and lower spine of a diagram, with a quiet grid behind the lines."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_axisbelow(True)
    axes.grid(True)


def writable(path: str | Path, title: str = "", suffixes: tuple[str, ...] = KINDS) -> Path:
    """Check the path and the title of a picture."""
    path = validation.path("picture", path)
    validation.name("picture: title", title)
    if path.suffix.lower() not in suffixes:
        raise ValueError(
            f"picture {str(path)!r}: the kind {path.suffix!r} is not known here; end the name in "
            f"{' or '.join(suffixes)}"
        )
    return path


def written(comm: MPI.Comm, path: Path, draw: Callable[[Path], None]) -> Path:
    """Let rank 0 write a picture, and make missing folders."""
    validation.instance("picture: comm", comm, MPI.Comm, "an MPI communicator")

    def write() -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            draw(beside)

    on_rank_0(comm, write)
    return path


def nice_number(value: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that does not exceed a positive ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(m for m in (1.0, 2.0, 5.0) if m <= value / power * (1.0 + 1e-9)) * power)


def prefixed(value: float, unit: str) -> tuple[str, float]:
    """Unit with a prefix that suits a value, and the factor to it."""
    for prefix, size in (("M", 1e6), ("k", 1e3), ("", 1.0), ("m", 1e-3), ("µ", 1e-6)):
        if value >= size:
            return prefix + unit, 1.0 / size
    return unit, 1.0
