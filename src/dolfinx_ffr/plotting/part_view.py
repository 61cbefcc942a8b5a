# SPDX-License-Identifier: MIT
"""A part over the field that it was drawn from, with its thinnest member and narrowest gap."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle, PathPatch, Rectangle
from matplotlib.path import Path as Outline
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from .. import validation
from ..fem import polygon
from ..part import Part, Solid, Width
from .body_in_space import solid_in_space
from .drawn_mesh import DrawnMesh
from .style import (
    ACCENTS,
    DARK,
    GRAY,
    KINDS,
    RED,
    nice_number,
    save,
    styled_figure,
    writable,
    written,
)

__all__ = ["plot_part"]

Array = NDArray[np.float64]

#: Void, zero line and material of the field
_FIELD = LinearSegmentedColormap.from_list("field", ["#f3efe6", "#ffffff", "#dbe7f3"])
#: Of the material
STEEL = "#8fa3b5"
#: Points of the field along the longer side of the body
_POINTS = 900
#: Width of the picture and height of the details [in]
_WIDTH, _DETAIL = 10.4, 2.6


def plot_part(part: Part | Solid, path: str | Path, *, title: str = "") -> Path:
    """Draw a part: its outline over the field, and details of where it is thinnest and tightest.

    One sees the material in steel blue over the field from which it was drawn (blue where it is
    positive) and the outline of the body, its interfaces in colour, loose pieces that were left out
    in red, and framed the places that are enlarged below, each with its dimension and the disc that
    is as wide. Of a solid one sees the surface, the edges of the body and its interfaces.

    Args:
        part: The part, or the solid.
        path: File to write, .png, .pdf or .svg.
        title: Heading.

    Returns:
        The path. The function is collective; rank 0 writes.

    Raises:
        TypeError: On every rank, if an argument is of a wrong kind.
        ValueError: On every rank, if the kind of file is not known.
    """
    validation.instance("plot_part: part", part, (Part, Solid), "a Part or a Solid")
    path = writable(path, KINDS)
    if isinstance(part, Solid):
        return solid_in_space(part, path, title)
    drawn = DrawnMesh.of(part.body)
    low, high = part.body.bounding_box  # collective where it is asked for the first time

    def draw(file: Path) -> None:
        size = high - low
        unit = (_WIDTH - 0.4) / max(size[0], 0.8 * size[1])
        head, gap, foot = (0.95 if title else 0.6), 0.45, 0.3
        height = head + unit * size[1] + gap + _DETAIL + foot
        with styled_figure(_WIDTH, height) as figure:
            if title:
                figure.text(0.02, 1.0 - 0.28 / height, title, va="center", fontsize=13)
            figure.text(0.02, 1.0 - (head - 0.33) / height, _facts(part), va="center", fontsize=10)
            left = 0.5 * (_WIDTH - unit * size[0])
            place = (left, gap + _DETAIL + foot, unit * size[0], unit * size[1])
            axes = _axes(figure, place, (low, high))
            body = _body(drawn)
            _draw(axes, part, drawn, body, 1.0)
            _measure(axes, part, low, high, unit)
            widths = [
                ("thinnest member", part.thinnest_member),
                ("narrowest gap", part.narrowest_gap),
            ]
            wide = 0.5 * (_WIDTH - 0.6)
            for k, (name, width) in enumerate(widths):
                at = (0.2 + k * (wide + 0.2), foot, wide, _DETAIL)
                _detail(figure, at, axes, part, drawn, body, name, width, "AB"[k])
            save(figure, file)

    return written(part.body.comm, path, draw)


def _facts(part: Part) -> str:
    mass = "" if part.material is None else f"   mass {part.mass:.4g} kg"
    loose = f"   {len(part.loose)} loose left out" if part.loose else ""
    several = "piece" if part.pieces == 1 else "pieces"
    holes = "hole" if part.holes == 1 else "holes"
    off = f"{1e6 * part.deviation:.2g} µm" if part.deviation > 1e-9 else "1 nm"
    return (
        f"area {1e6 * part.area:.5g} mm²{mass}   {part.pieces} {several}, {part.holes} {holes}"
        f"{loose}   within {off} of the zero line"
    )


def _axes(figure: Figure, place: Sequence[float], window: Sequence[Array]) -> Axes:
    """Axes at a place in inches that show a window of the body [m]."""
    width, height = figure.get_size_inches()
    x, y, w, h = place
    axes = figure.add_axes((x / width, y / height, w / width, h / height))
    axes.set_xlim(window[0][0], window[1][0])
    axes.set_ylim(window[0][1], window[1][1])
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)
    return axes


def _body(drawn: DrawnMesh) -> BaseGeometry:
    """The body as polygons."""
    lines = shapely.multilinestrings(shapely.linestrings(drawn.points[drawn.outline]))
    # cells share their corners but for round-off
    extent = float(np.max(np.ptp(drawn.points, axis=0)))
    return shapely.build_area(shapely.set_precision(lines, 1e-9 * extent))


def _path(rings: Sequence[Array]) -> Outline:
    """Closed rings as one path."""
    parts = []
    for ring in rings:
        closed = ring if np.array_equal(ring[0], ring[-1]) else np.vstack([ring, ring[:1]])
        parts.append(Outline(closed, closed=True))
    return Outline.make_compound_path(*parts)


def _draw(axes: Axes, part: Part, drawn: DrawnMesh, body: BaseGeometry, line: float) -> None:
    """Draw field, material, outline and interfaces into a window."""
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    step = max(x1 - x0, y1 - y0) / _POINTS
    x, y = np.arange(x0, x1 + step, step), np.arange(y0, y1 + step, step)
    points = np.column_stack([each.ravel() for each in np.meshgrid(x, y)])
    low, high = part.body.bounding_box
    # the field need not be known outside of the body
    values = part.field(np.clip(points, low, high))
    top = float(np.max(np.abs(values))) or 1.0
    values[~shapely.contains_xy(body, points)] = np.nan
    axes.imshow(
        values.reshape(len(y), len(x)),
        extent=(x[0], x[-1], y[0], y[-1]),
        origin="lower",
        cmap=_FIELD,
        norm=TwoSlopeNorm(0.0, -top, top),
        aspect="auto",
        zorder=0.1,
    )
    edge = _path([shapely.get_coordinates(ring) for ring in shapely.get_parts(body.boundary)])
    axes.add_patch(PathPatch(edge, facecolor="none", edgecolor=GRAY, lw=0.7 * line, ls=(0, (4, 3))))
    fine = 0.2 * part.accuracy
    rings = [polygon(loop, fine) for loops in part.outlines for loop in loops]
    axes.add_patch(PathPatch(_path(rings), facecolor=STEEL, edgecolor=DARK, lw=line, zorder=1.0))
    for piece in part.loose:
        lost = _path([polygon(loop, fine) for loop in piece.outline])
        axes.add_patch(
            PathPatch(lost, facecolor="none", edgecolor=RED, hatch="////", lw=line, zorder=1.1)
        )
    for name, color in zip(part.body.interfaces, cycle(ACCENTS), strict=False):
        for curve in part.interface(name):
            axes.plot(*curve.points(fine).T, color=color, lw=3.5 * line, zorder=1.5, clip_on=True)


def _measure(axes: Axes, part: Part, low: Array, high: Array, unit: float) -> None:
    """Below, the names of the interfaces on the left and a measure on the right."""
    at = float(low[0])
    y = low[1] - 0.16 / unit
    for name, color in zip(part.body.interfaces, cycle(ACCENTS), strict=False):
        axes.plot([at, at + 0.25 / unit], [y, y], color=color, lw=3.5, clip_on=False)
        lost = " (lost)" if name in part.lost_interfaces else ""
        text = f"{name}{lost}"
        axes.text(at + 0.33 / unit, y, text, va="center", fontsize=9, clip_on=False)
        at += (0.65 + 0.08 * len(text)) / unit
    length = nice_number(0.2 * float(high[0] - low[0]))
    ends = high[0] - np.array([length, 0.0])
    axes.plot(ends, [y, y], "|-", color=DARK, lw=1.3, ms=7.0, mew=1.3, clip_on=False)
    text = f"{1e3 * length:g} mm "
    axes.text(ends[0], y, text, ha="right", va="center", fontsize=9, clip_on=False)


def _detail(
    figure: Figure,
    place: Sequence[float],
    overview: Axes,
    part: Part,
    drawn: DrawnMesh,
    body: BaseGeometry,
    name: str,
    width: Width | None,
    letter: str,
) -> None:
    """An enlarged window around a width, with its dimension."""
    if width is None:
        axes = _axes(figure, place, (np.zeros(2), np.ones(2)))
        axes.text(0.5, 0.5, f"{name}: none below the size of the part", ha="center", color=GRAY)
        return
    low, high = part.body.bounding_box
    tall = max(5.0 * width.value, 6.0 * part.spacing)
    half = 0.5 * np.array([tall * place[2] / place[3], tall])
    # no wider than the body: where all is wide, there is little to enlarge
    half *= min(
        1.0,
        0.6 * float(np.max(high - low) / (2.0 * half[0])),
        0.7 * float(np.min(high - low)) / half[1],
    )
    middle = width.ends.mean(axis=0)
    axes = _axes(figure, place, (middle - half, middle + half))
    _draw(axes, part, drawn, body, 1.3)
    axes.spines[:].set_visible(True)
    corner, opposite = np.clip([middle - half, middle + half], low, high)
    size = opposite - corner
    overview.add_patch(Rectangle(corner, *size, fill=False, ec=DARK, lw=0.9, zorder=3.0))
    # windows that share an upper left corner still have letters apart
    first = letter == "A"
    overview.annotate(
        letter,
        xy=((corner if first else opposite)[0], opposite[1]),
        xytext=(3 if first else -3, -3),
        textcoords="offset points",
        ha="left" if first else "right",
        va="top",
        fontweight="bold",
        bbox={"boxstyle": "square,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.85},
        zorder=3.0,
    )
    _dimension(axes, width, half)
    text = f"{letter}   {name}  {1e3 * width.value:.3g} mm"
    axes.set_title(text, loc="left", fontsize=10.5, pad=4.0)


def _dimension(axes: Axes, width: Width, half: Array) -> None:
    """Arrows from outside onto both ends of a width, and its value."""
    a, b = width.ends
    along = (b - a) / max(float(np.hypot(*(b - a))), 1e-300)
    for end, way in ((a, -along), (b, along)):
        axes.annotate(
            "",
            xy=tuple(end),
            xytext=tuple(end + 0.35 * half[1] * way),
            arrowprops={"arrowstyle": "-|>", "color": RED, "lw": 1.4, "shrinkA": 0, "shrinkB": 0},
            zorder=4.0,
        )
    axes.plot(*width.ends.T, color=RED, lw=1.4, zorder=4.0)
    disc = Circle(
        width.ends.mean(axis=0), 0.5 * width.value, fill=False, ec=RED, lw=1.0, ls=":", zorder=4.0
    )
    axes.add_patch(disc)
    text = f"{1e3 * width.value:.3g} mm"
    axes.annotate(
        text,
        xy=tuple(b + 0.37 * half[1] * along),
        ha="center" if abs(along[0]) < 0.5 else ("left" if along[0] > 0 else "right"),
        va="center" if abs(along[1]) < 0.5 else ("bottom" if along[1] > 0 else "top"),
        color=RED,
        fontsize=10,
        bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.85},
        zorder=5.0,
    )
