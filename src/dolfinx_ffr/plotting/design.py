# SPDX-License-Identifier: MIT
"""Pictures of designs: the density of a body, interfaces in colour."""

from __future__ import annotations

import ctypes.util
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from ..domain import Domain
from .drawn_mesh import DrawnMesh
from .style import ACCENTS, DARK, GRAY, nice_number, save, styled_figure, writable, written

__all__ = ["plot_design"]

Array = NDArray[np.float64]


def plot_design(
    domain: Domain,
    x: ArrayLike | Mapping[str, ArrayLike],
    path: str | Path,
    *,
    title: str = "",
    backend: str = "pyvista",
) -> Path:
    """Draw one design, or several under each other: solid is black, void is white.

    One sees the density of each cell in shades of gray, the outline of the body, its rigid
    interfaces in colour, and a measure. The scale is the same along both axes.

    Args:
        domain: mesh and interfaces of the body.
        x: one density for each cell owned by this rank, shape (cells,), in [0, 1]; or several
            designs by title.
        path: file to write, .png (with matplotlib also .pdf and .svg).
        title: heading; with several designs the heading of them all.
        backend: ``"pyvista"``, or ``"matplotlib"`` for axes with numbers.

    Returns:
        The path. The function is collective; rank 0 writes.

    Raises:
        ValueError: on every rank, if a density is not usable or the backend or the kind of file
            is not known.
    """
    if backend not in ("pyvista", "matplotlib"):
        raise ValueError(f"plot_design: backend = {backend!r} must be 'pyvista' or 'matplotlib'")
    path = writable(path, (".png",) if backend == "pyvista" else (".png", ".pdf", ".svg"))
    designs = dict(x) if isinstance(x, Mapping) else {"": x}
    if not designs:
        raise ValueError("plot_design: no design given")
    drawn = DrawnMesh.of(domain)
    values = {
        name: drawn.cell_values(domain.check_density(density, f"design {name!r}" if name else "x"))
        for name, density in designs.items()
    }
    draw = _draw_by_pyvista if backend == "pyvista" else _draw_by_matplotlib
    return written(domain.comm, path, lambda file: draw(drawn, values, file, title))


# ---------------------------------------------------------------------- pyvista

#: the fonts of the other pictures, which come with matplotlib and know Greek
_FONTS = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
#: width of the body, margin, height of a line of text [pixels]
_BODY, _MARGIN, _LINE = 1500.0, 50.0, 36.0


def _draw_by_pyvista(drawn: DrawnMesh, values: Mapping[str, Array], path: Path, title: str) -> None:
    """Lay the designs out on one sheet; a metre has the same number of pixels everywhere."""
    low, size = drawn.points.min(axis=0), np.ptp(drawn.points, axis=0)
    scale = _BODY / max(size[0], 0.8 * size[1])  # pixels per metre
    body = size * scale
    heading = 1.3 * _LINE if any(values) else 0.0
    head = _MARGIN + (1.9 * _LINE if title else 0.0)
    row = heading + body[1] + 0.9 * _LINE
    width = max(body[0], 900.0) + 2.0 * _MARGIN
    left = 0.5 * (width - body[0])
    sheet = _Sheet(width, head + row * len(values) + 1.6 * _LINE + _MARGIN)
    if title:
        sheet.text(title, 0.5 * width, _MARGIN + 0.5 * _LINE, 34.0, align="center", bold=True)
    for i, (name, density) in enumerate(values.items()):
        top = head + i * row
        sheet.text(name, left, top + 0.4 * heading, 28.0)

        def place(points: Array, base: float = top + heading + body[1]) -> Array:
            """Return points of the body on the sheet [pixels]."""
            return np.array([left, base]) + (points - low) * scale * np.array([1.0, -1.0])

        sheet.patches(place(drawn.points), drawn.pieces, density[drawn.parents])
        sheet.lines(place(drawn.points[drawn.outline]), "#57606a", 2.0)
        for (_, ends), color in zip(drawn.interfaces.items(), cycle(ACCENTS), strict=False):
            sheet.lines(place(drawn.points[ends]), color, 9.0)
    _draw_legend(sheet, drawn, left, body[0], head + row * len(values) + 0.8 * _LINE, scale)
    sheet.save(path)


def _draw_legend(
    sheet: _Sheet, drawn: DrawnMesh, left: float, width: float, y: float, scale: float
) -> None:
    """Draw shades of gray, interfaces and a measure in one line."""
    shades, long = 40, 220.0
    x = left + 90.0 + np.linspace(0.0, long, shades + 1)
    corners = np.array(
        [[x[:-1], x[1:], x[1:], x[:-1]], [[y - 12.0] * shades] * 2 + [[y + 12.0] * shades] * 2]
    )
    box = np.array([[x[0], y - 12], [x[-1], y - 12], [x[-1], y + 12], [x[0], y + 12]])
    sheet.text("void", left, y, 26.0)
    sheet.patches(
        corners.transpose(2, 1, 0).reshape(-1, 2),
        np.arange(4 * shades).reshape(-1, 4),
        (np.arange(shades) + 0.5) / shades,
    )
    sheet.lines(np.stack([box, np.roll(box, -1, axis=0)], axis=1), GRAY, 2.0)
    sheet.text("solid", x[-1] + 20.0, y, 26.0)
    at = x[-1] + 160.0
    for name, color in zip(drawn.interfaces, cycle(ACCENTS), strict=False):
        sheet.lines(np.array([[[at, y], [at + 46.0, y]]]), color, 9.0)
        sheet.text(name, at + 60.0, y, 26.0)
        at += 110.0 + 15.0 * len(name)
    measure = nice_number(0.3 * width / scale)
    right = left + width
    start = right - measure * scale
    ends = [[[start, y + 8], [right, y + 8]], *([[e, y - 2], [e, y + 18]] for e in (start, right))]
    sheet.lines(np.array(ends), DARK, 3.0)
    sheet.text(_length(measure), 0.5 * (start + right), y - 16.0, 26.0, align="center")


class _Sheet:
    """A drawing in pixels from the upper left corner, made by VTK without a screen."""

    #: pixels drawn for each pixel kept, along both axes: smooth edges
    oversampling = 2

    def __init__(self, width: float, height: float) -> None:
        import pyvista  # takes a while

        self._pyvista = pyvista
        self._size = (round(width), round(height))
        self._depth = 0.0
        with _without_screen():
            self._plotter = pyvista.Plotter(
                off_screen=True, window_size=[self.oversampling * n for n in self._size]
            )
        self._plotter.set_background("white")

    def _points(self, points: Array) -> Array:
        self._depth += 1e-3  # what comes later lies on top
        flipped = np.column_stack([points[:, 0], self._size[1] - points[:, 1]])
        return np.column_stack([flipped, np.full(len(points), self._depth)])

    def patches(self, points: Array, corners: NDArray[np.int64], shade: Array) -> None:
        """Fill triangles or quadrilaterals in shades from white (0) to black (1)."""
        n = corners.shape[1]
        kind = self._pyvista.CellType.TRIANGLE if n == 3 else self._pyvista.CellType.QUAD
        cells = np.column_stack([np.full(len(corners), n), corners])
        grid = self._pyvista.UnstructuredGrid(
            cells.ravel(), np.full(len(corners), kind), self._points(points)
        )
        gray = np.round(255.0 * (1.0 - shade)).astype(np.uint8)
        grid.cell_data["gray"] = np.repeat(gray[:, None], 3, axis=1)
        self._plotter.add_mesh(grid, scalars="gray", rgb=True, lighting=False)

    def lines(self, ends: Array, color: str, thickness: float) -> None:
        """Draw straight lines, shape (lines, 2, 2), each half a pixel longer at both ends."""
        along = ends[:, 1] - ends[:, 0]
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
        ends = ends + 0.5 * np.stack([-along, along], axis=1)
        mesh = self._pyvista.line_segments_from_points(self._points(ends.reshape(-1, 2)))
        self._plotter.add_mesh(
            mesh, color=color, line_width=self.oversampling * thickness, lighting=False
        )

    def text(
        self, text: str, x: float, y: float, size: float, *, align: str = "left", bold: bool = False
    ) -> None:
        """Write a line of text centred about the height y."""
        if not text:
            return
        actor = self._pyvista.Text(
            text,
            position=(self.oversampling * x, self.oversampling * (self._size[1] - y)),
        )
        actor.prop.set_font_file(str(_FONTS / f"DejaVuSans{'-Bold' if bold else ''}.ttf"))
        actor.prop.font_size = round(self.oversampling * size)
        actor.prop.justification_horizontal = align
        actor.prop.justification_vertical = "center"
        actor.prop.color = DARK
        self._plotter.add_actor(actor)

    def save(self, path: Path) -> None:
        """Write the picture."""
        width, height = self._size
        camera = self._plotter.camera
        camera.parallel_projection = True
        camera.focal_point = (width / 2, height / 2, 0.0)
        camera.position = (width / 2, height / 2, 100.0)
        camera.up = (0.0, 1.0, 0.0)
        camera.parallel_scale = height / 2
        camera.clipping_range = (1.0, 200.0)
        try:
            with _without_screen():
                pixels = self._plotter.screenshot(None, return_img=True)
        finally:
            self._plotter.close()
        Image.fromarray(pixels).reduce(self.oversampling).save(path)


@contextmanager
def _without_screen() -> Iterator[None]:
    """Let VTK draw in memory at once where there is no screen, rather than look for one first."""
    name = "VTK_DEFAULT_OPENGL_WINDOW"
    wanted = sys.platform == "linux" and not os.environ.get("DISPLAY") and name not in os.environ
    if wanted and ctypes.util.find_library("OSMesa"):
        os.environ[name] = "vtkOSOpenGLRenderWindow"
        try:
            yield
        finally:
            del os.environ[name]
    else:
        yield


# ---------------------------------------------------------------------- matplotlib


def _draw_by_matplotlib(
    drawn: DrawnMesh, values: Mapping[str, Array], path: Path, title: str
) -> None:
    """Draw each design in axes of its own, with numbers in metres."""
    low, size = drawn.points.min(axis=0), np.ptp(drawn.points, axis=0)
    width = 9.0
    tall = min(max((width - 1.9) * size[1] / size[0], 0.4), 8.0)
    row = tall + (0.35 if any(values) else 0.12)
    head, foot = 0.5 if title else 0.15, 0.85
    height = head + row * len(values) + foot
    with styled_figure(width, height) as figure:
        if title:
            figure.text(0.5, 1.0 - 0.3 / height, title, ha="center", va="center", fontsize=13)
        for i, (name, density) in enumerate(values.items()):
            bottom = (foot + row * (len(values) - 1 - i)) / height
            axes = figure.add_axes((0.9 / width, bottom, (width - 1.9) / width, tall / height))
            axes.set_title(name, loc="left")
            axes.add_collection(
                PolyCollection(
                    drawn.points[drawn.pieces],
                    facecolors=_gray(density)[drawn.parents],
                    edgecolors="face",
                    linewidths=0.5,
                )
            )
            axes.add_collection(
                LineCollection(drawn.points[drawn.outline], colors=GRAY, linewidths=1.0)
            )
            for ends, color in zip(drawn.interfaces.values(), cycle(ACCENTS), strict=False):
                axes.add_collection(
                    LineCollection(
                        drawn.points[ends],
                        colors=color,
                        linewidths=3.5,
                        capstyle="projecting",
                        clip_on=False,
                        zorder=3,
                    )
                )
            axes.set_aspect("equal")
            axes.set_xlim(low[0], low[0] + size[0])
            axes.set_ylim(low[1], low[1] + size[1])
            axes.spines[:].set_visible(False)
            axes.set_ylabel("y [m]")
            axes.locator_params(axis="y", nbins=4)
            axes.tick_params(labelbottom=i == len(values) - 1)
        axes.set_xlabel("x [m]")
        bar_height = min(row * len(values) - 0.3, 2.2)
        bar = figure.add_axes(
            (1.0 - 0.75 / width, foot / height, 0.14 / width, max(bar_height, 0.4) / height)
        )
        shades = ScalarMappable(Normalize(0.0, 1.0), "gray_r")
        figure.colorbar(shades, cax=bar, label="density", ticks=[0.0, 0.5, 1.0])
        handles = [
            Line2D([], [], color=color, linewidth=3.5, label=f"rigid interface {name}")
            for name, color in zip(drawn.interfaces, cycle(ACCENTS), strict=False)
        ]
        figure.legend(
            handles=handles,
            loc="lower right",
            ncol=min(len(handles), 4),
            bbox_to_anchor=(1.0 - 0.9 / width, 0.08 / height),
            borderaxespad=0.0,
        )
        save(figure, path)


def _gray(density: Array) -> Array:
    """Return colours from white (void) to black (solid), shape (cells, 3)."""
    return np.repeat(1.0 - density[:, None], 3, axis=1)


def _length(value: float) -> str:
    """Return a length in the unit that reads best."""
    return f"{value:g} m" if value >= 1.0 else f"{1e3 * value:g} mm"
