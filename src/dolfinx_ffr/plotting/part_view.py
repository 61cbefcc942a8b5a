# SPDX-License-Identifier: MIT
"""A part, with its thinnest member and narrowest gap."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, PathPatch, Rectangle
from matplotlib.path import Path as Outline
from shapely import Polygon, get_coordinates, get_parts
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from .. import validation
from ..arrays import Array
from ..fem import polygon
from ..part import Part, Solid, Width
from . import style
from .drawn_mesh import DrawnMesh
from .fields import draw_solid

#: Color of the material
STEEL = "#8fa3b5"
#: Of the floors of pockets, which are thinner
WEB = "#dbe3ea"
#: Width and height of the picture of a detail, relative to its height
_DETAIL = np.array([1.92, 1.0])


def plot_part(part: Part | Solid, path: str | Path, *, title: str = "") -> Path:
    """Draw a part, with details of its thinnest member and narrowest gap.

    One sees the material in steel blue, floors of pockets lighter, the interfaces in colour,
    loose pieces that were left out in red, and framed the places that are enlarged below, each with
    its dimension and the disc that is as wide. Of a solid one sees the surface, the edges of the
    body and its interfaces. The file ``path`` gets a ``title``.
    """
    validation.instance("plot_part: part", part, (Part, Solid), "a Part or a Solid")
    path = style.writable(path, title)
    if isinstance(part, Solid):
        return draw_solid(part, path, title)
    body = DrawnMesh.of(part.body)
    low, high = part.body.bounding_box  # collective where it is asked for the first time

    def draw(file: Path) -> None:
        with style.styled_figure(style.PICTURES.width, 2.0 * style.PICTURES.width, file) as figure:
            if title:
                figure.suptitle(title)
            places = figure.subplot_mosaic("CC;AB")
            overview = places["C"]
            _draw(overview, part, body, (low, high))
            overview.set_title(_facts(part), fontsize=10)
            lost = part.lost_interfaces
            colors = style.accents(part.body.interfaces)
            names = {f"{n} (lost)" if n in lost else n: color for n, color in colors.items()}
            style.add_legend(overview, names, style.extent(np.array([low, high])))
            _draw_detail(places["A"], overview, part, body, "A", part.thinnest_member)
            _draw_detail(places["B"], overview, part, body, "B", part.narrowest_gap)
            style.fit_height(figure, [*places.values()])

    return style.written(part.body.comm, path, draw)


def outline_path(shape: BaseGeometry) -> Outline:
    """Boundary of polygons as one path."""
    polygons = [orient(polygon) for polygon in get_parts(shape)]
    rings = [ring for p in polygons for ring in (p.exterior, *p.interiors)]
    paths = [Outline(get_coordinates(ring), closed=True) for ring in rings]
    return Outline.make_compound_path(*paths)


def _facts(part: Part) -> str:
    """Numbers that describe the part."""
    facts = [f"area {1e6 * part.area:.5g} mm²"]
    if part.weighs:
        facts.append(f"mass {part.mass:.4g} kg")
    counts = {"piece": part.pieces, "hole": part.holes}
    if part.web:
        counts["pocket"] = len(part.pockets)
    facts.append(", ".join(f"{count} {name}{'s' * (count != 1)}" for name, count in counts.items()))
    if part.web and part.material is not None:
        facts.append(f"web {1e3 * part.web * part.thickness:.3g} mm")
    if part.loose:
        count = len(part.loose)
        facts.append(f"{count} loose piece{'s' * (count != 1)} left out, hatched in red")
    return "   ".join(facts)


def _draw(axes: Axes, part: Part, body: DrawnMesh, window: tuple[Array, Array]) -> None:
    """Draw material, outline of the body and interfaces into a window, two corners [m]."""
    (left, bottom), (right, top) = window
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    dashes: dict[str, Any] = {"colors": style.GRAY, "linewidths": 0.8, "linestyles": "dashed"}
    axes.add_collection(LineCollection(body.points[body.outline], **dashes))

    def add_area(shape: BaseGeometry, **look: Any) -> None:
        axes.add_patch(PathPatch(outline_path(shape), **look))

    add_area(part.polygon, facecolor=STEEL, edgecolor=style.DARK)
    for floor in part.floors:
        add_area(floor, facecolor=WEB, edgecolor=style.DARK)
    for piece in part.loose:
        outer, *holes = (polygon(loop, part.accuracy) for loop in piece.outline)
        add_area(Polygon(outer, holes), facecolor="none", edgecolor=style.RED, hatch="////")
    for name, color in style.accents(part.body.interfaces).items():
        for curve in part.interface(name):
            axes.plot(*curve.points(part.accuracy).T, color=color, lw=4.0)


def _draw_detail(
    axes: Axes, overview: Axes, part: Part, body: DrawnMesh, letter: str, width: Width | None
) -> None:
    """Draw an enlarged window around the thinnest member A or the narrowest gap B."""
    name = "thinnest member" if letter == "A" else "narrowest gap"
    if width is None:
        axes.set_axis_off()
        axes.set_box_aspect(_DETAIL[1] / _DETAIL[0])
        text = f"{name}: none below the size of the part"
        axes.text(0.5, 0.5, text, ha="center", color=style.GRAY)
        return
    low, high = part.body.bounding_box
    half = 0.5 * max(5.0 * width.value, 6.0 * part.spacing) * _DETAIL
    # no wider than the body: where all is wide, there is little to enlarge
    size = high - low
    half *= min(1.0, 0.3 * float(np.max(size) / half[0]), 0.7 * float(np.min(size)) / half[1])
    middle = width.ends.mean(axis=0)
    window = middle - half, middle + half
    _draw(axes, part, body, window)
    axes.spines[:].set_visible(True)
    axes.set_title(f"{letter}   {name}  {1e3 * width.value:.3g} mm", loc="left", fontsize=10.5)
    _draw_dimension(axes, width, half[1])

    corner, opposite = np.clip(window, low, high)
    frame = Rectangle(corner, *(opposite - corner), fill=False, ec=style.DARK, lw=0.9, zorder=3.0)
    overview.add_patch(frame)
    # windows in the same place still have their letters in different corners
    x, y, *sides = (
        (corner[0], opposite[1], "left", "top")
        if letter == "A"
        else (opposite[0], corner[1], "right", "bottom")
    )
    look: dict[str, Any] = {"fontweight": "bold", "bbox": style.LABEL, "zorder": 3.0}
    overview.text(x, y, letter, ha=sides[0], va=sides[1], **look)


def _draw_dimension(axes: Axes, width: Width, reach: float) -> None:
    """Draw arrows of some reach [m] from outside onto both ends of a width, and its value."""
    start, end = width.ends
    along = (end - start) / max(float(np.hypot(*(end - start))), 1e-300)

    arrow = {"arrowstyle": "-|>", "color": style.RED, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
    for tip, direction in ((start, -along), (end, along)):
        tail = tip + 0.35 * reach * direction
        axes.annotate("", xy=tuple(tip), xytext=tuple(tail), arrowprops=arrow, zorder=4.0)
    axes.plot(*width.ends.T, color=style.RED, lw=1.4, zorder=4.0)

    # the disc that the width is the diameter of
    dotted: dict[str, Any] = {"fill": False, "ec": style.RED, "lw": 1.0, "ls": ":", "zorder": 4.0}
    axes.add_patch(Circle(width.ends.mean(axis=0), 0.5 * width.value, **dotted))

    x, y = end + 0.5 * reach * along
    text: dict[str, Any] = {"ha": "center", "va": "center", "bbox": style.LABEL, "zorder": 5.0}
    axes.text(x, y, f"{1e3 * width.value:.3g} mm", color=style.RED, **text)
