# SPDX-License-Identifier: MIT
"""A part over the field that it was drawn from, with its thinnest member and narrowest gap."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle, PathPatch, Rectangle
from matplotlib.path import Path as Outline
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from .. import validation
from ..arrays import Array
from ..fem import polygon
from ..part import Part, Solid, Width
from . import style
from .in_space import solid_in_space
from .scene import DrawnMesh

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
    The file ``path`` gets a ``title``.
    """
    validation.instance("plot_part: part", part, (Part, Solid), "a Part or a Solid")
    path = style.writable(path, title)
    if isinstance(part, Solid):
        return solid_in_space(part, path, title)
    drawn = DrawnMesh.of(part.body)
    low, high = part.body.bounding_box  # collective where it is asked for the first time

    def draw(file: Path) -> None:
        size = high - low
        unit = (_WIDTH - 0.4) / max(size[0], 0.8 * size[1])
        head, gap, foot = (0.95 if title else 0.6), 0.45, 0.3
        height = head + unit * size[1] + gap + _DETAIL + foot
        with style.styled_figure(_WIDTH, height, file) as figure:
            if title:
                figure.text(0.02, 1.0 - 0.28 / height, title, va="center", fontsize=13)
            figure.text(0.02, 1.0 - (head - 0.33) / height, _facts(part), va="center", fontsize=10)
            left = 0.5 * (_WIDTH - unit * size[0])
            place = (left, gap + _DETAIL + foot, unit * size[0], unit * size[1])
            axes = _axes(figure, place, (low, high))
            body = _body(drawn)
            _draw(axes, part, body, 1.0)
            _measure(axes, part, low, high, unit)
            wide = 0.5 * (_WIDTH - 0.6)
            for k, letter in enumerate("AB"):
                at = (0.2 + k * (wide + 0.2), foot, wide, _DETAIL)
                _detail(at, axes, part, body, letter)

    return style.written(part.body.comm, path, draw)


def _facts(part: Part) -> str:
    said = f"area {1e6 * part.area:.5g} mm²"
    said += f"   mass {part.mass:.4g} kg" if part.weighs else ""
    said += f"   {part.pieces} piece{'s' * (part.pieces != 1)}"
    said += f", {part.holes} hole{'s' * (part.holes != 1)}"
    said += f"   {len(part.loose)} loose left out" if part.loose else ""
    off = f"{max(1e6 * part.deviation, 1e-3):.2g} µm"  # none of moved boundaries
    return said + (f"   within {off} of the zero line" if part.deviation else "")


def _axes(figure: Figure, place: Sequence[float], window: Sequence[Array]) -> Axes:
    """Axes at a place in inches that show a window of the body [m]."""
    axes = style.axes_at(figure, *place)
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


def outline_of(shape: BaseGeometry) -> Outline:
    """The boundary of polygons as one path."""
    polygons = [orient(polygon) for polygon in shapely.get_parts(shape)]
    rings = [ring for p in polygons for ring in (p.exterior, *p.interiors)]
    return _path([shapely.get_coordinates(ring) for ring in rings])


def _path(rings: Sequence[Array]) -> Outline:
    """Closed rings as one path."""
    closed = [r if np.array_equal(r[0], r[-1]) else np.vstack([r, r[:1]]) for r in rings]
    return Outline.make_compound_path(*(Outline(ring, closed=True) for ring in closed))


def _draw(axes: Axes, part: Part, body: BaseGeometry, line: float) -> None:
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
    colors: dict[str, Any] = {"cmap": _FIELD, "norm": TwoSlopeNorm(0.0, -top, top)}
    place: dict[str, Any] = {"extent": (x[0], x[-1], y[0], y[-1]), "origin": "lower"}
    axes.imshow(values.reshape(len(y), len(x)), aspect="auto", zorder=0.1, **colors, **place)
    axes.add_patch(
        PathPatch(
            outline_of(body), facecolor="none", edgecolor=style.GRAY, lw=0.7 * line, ls=(0, (4, 3))
        )
    )
    fine = 0.2 * part.accuracy
    rings = [polygon(loop, fine) for loops in part.outlines for loop in loops]
    axes.add_patch(
        PathPatch(_path(rings), facecolor=STEEL, edgecolor=style.DARK, lw=line, zorder=1.0)
    )
    lost = {"facecolor": "none", "edgecolor": style.RED, "hatch": "////", "zorder": 1.1}
    for piece in part.loose:
        outline = _path([polygon(loop, fine) for loop in piece.outline])
        axes.add_patch(PathPatch(outline, lw=line, **lost))
    for name, color in zip(part.body.interfaces, cycle(style.ACCENTS), strict=False):
        for curve in part.interface(name):
            axes.plot(*curve.points(fine).T, color=color, lw=3.5 * line, zorder=1.5, clip_on=True)


def _measure(axes: Axes, part: Part, low: Array, high: Array, unit: float) -> None:
    """Below, the names of the interfaces on the left and a measure on the right."""
    y = low[1] - 0.16 / unit
    lost = part.lost_interfaces
    names = [f"{name} (lost)" if name in lost else name for name in part.body.interfaces]
    style.name_accents(axes, names, (low[0], y), 9, 1.0 / unit)
    length = style.nice_number(0.2 * float(high[0] - low[0]))
    ends = high[0] - np.array([length, 0.0])
    axes.plot(ends, [y, y], "|-", color=style.DARK, lw=1.3, ms=7.0, mew=1.3, clip_on=False)
    text = f"{1e3 * length:g} mm "
    axes.text(ends[0], y, text, ha="right", va="center", fontsize=9, clip_on=False)


def _detail(
    place: Sequence[float], overview: Axes, part: Part, body: BaseGeometry, letter: str
) -> None:
    """An enlarged window around the thinnest member A or the narrowest gap B, with its size."""
    name = "thinnest member" if letter == "A" else "narrowest gap"
    figure, width = overview.figure, part.thinnest_member if letter == "A" else part.narrowest_gap
    if width is None:
        axes, none = _axes(figure, place, (np.zeros(2), np.ones(2))), "none below the size"
        axes.text(0.5, 0.5, f"{name}: {none} of the part", ha="center", color=style.GRAY)
        return
    low, high = part.body.bounding_box
    tall = max(5.0 * width.value, 6.0 * part.spacing)
    half = 0.5 * np.array([tall * place[2] / place[3], tall])
    # no wider than the body: where all is wide, there is little to enlarge
    size = high - low
    half *= min(1.0, 0.3 * float(np.max(size) / half[0]), 0.7 * float(np.min(size)) / half[1])
    middle = width.ends.mean(axis=0)
    axes = _axes(figure, place, (middle - half, middle + half))
    _draw(axes, part, body, 1.3)
    axes.spines[:].set_visible(True)
    corner, opposite = np.clip([middle - half, middle + half], low, high)
    size = opposite - corner
    overview.add_patch(Rectangle(corner, *size, fill=False, ec=style.DARK, lw=0.9, zorder=3.0))
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
        bbox={**style.LABEL, "boxstyle": "square,pad=0.15", "alpha": 0.85},
        zorder=3.0,
    )
    _dimension(axes, width, half)
    heading = f"{letter}   {name}  {1e3 * width.value:.3g} mm"
    axes.set_title(heading, loc="left", fontsize=10.5, pad=4.0)


def _dimension(axes: Axes, width: Width, half: Array) -> None:
    """Arrows from outside onto both ends of a width, and its value."""
    a, b = width.ends
    along = (b - a) / max(float(np.hypot(*(b - a))), 1e-300)
    arrow = {"arrowstyle": "-|>", "color": style.RED, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    for end, way in ((a, -along), (b, along)):
        tail = tuple(end + 0.35 * half[1] * way)
        axes.annotate("", xy=tuple(end), xytext=tail, arrowprops=arrow, zorder=4.0)
    axes.plot(*width.ends.T, color=style.RED, lw=1.4, zorder=4.0)
    look: dict[str, Any] = {"fill": False, "ec": style.RED, "lw": 1.0, "ls": ":", "zorder": 4.0}
    axes.add_patch(Circle(width.ends.mean(axis=0), 0.5 * width.value, **look))
    axes.annotate(
        f"{1e3 * width.value:.3g} mm",
        xy=tuple(b + 0.37 * half[1] * along),
        ha="center" if abs(along[0]) < 0.5 else ("left" if along[0] > 0 else "right"),
        va="center" if abs(along[1]) < 0.5 else ("bottom" if along[1] > 0 else "top"),
        **{"color": style.RED, "fontsize": 10, "zorder": 5.0},
        bbox={**style.LABEL, "alpha": 0.85},
    )
