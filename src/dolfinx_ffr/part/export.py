# SPDX-License-Identifier: MIT
"""Parts as files for CAD and machines.

* .svg: lines, arcs and cubic curves, y downwards; the path "part", and paths named as interfaces;
* .dxf (R2010): LINE, ARC, CIRCLE and SPLINE, on the layer "part" and on layers named as interfaces;
* .step: the extruded solid, by OpenCASCADE; in millimetres, as the file says;
* .stl: triangles, within the part's `accuracy` of the curves; its numbers are short floats.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import shapely
from numpy.typing import NDArray

from .. import validation
from ..fem import Arc, Curve, Drawing, Face, Line, Spline, gmsh_model, quiet, surfaces
from ..parallel import on_rank_0
from .shape import Shape

__all__ = ["write"]

Array = NDArray[np.float64]

#: Units of drawings in metres, and their codes in DXF
UNITS = {"mm": 1e-3, "m": 1.0}
_INSUNITS = {"mm": 4, "m": 6}
#: Layer or path of what is no interface
PART = "part"
_SVG = "http://www.w3.org/2000/svg"
#: What names of layers may not have
_FORBIDDEN = re.compile(r"[<>/\\\":;?*|=`',]")


def write(part: Shape, path: str | Path, *, unit: str = "mm") -> list[Path]:
    """Write a part for CAD and machines; collective, rank 0 writes.

    Args:
        part: The part; .step and .stl need its thickness.
        path: A file ending in .svg, .dxf, .step or .stl, or a folder for all four, "part.svg" and
            so on.
        unit: Of .svg, .dxf and .stl, "mm" or "m".

    Returns:
        The files, on every rank.

    Raises:
        TypeError: On every rank, if an argument is of a wrong kind.
        ValueError: On every rank, if the kind of file or the unit is not known, or the part has no
            thickness.
    """
    given = validation.path("part: file", path)
    validation.choice("part: unit", unit, UNITS)
    suffix = given.suffix.lower()
    suffix = {".stp": ".step"}.get(suffix, suffix)
    if suffix and suffix not in _WRITERS:
        raise ValueError(
            f"part: {str(given)!r} ends in {given.suffix!r}; parts are written as "
            f"{', '.join(_WRITERS)}, or all of them into a folder, whose name has no ending"
        )
    files = {suffix: given} if suffix else {kind: given / f"part{kind}" for kind in _WRITERS}
    if {".step", ".stl"} & set(files):
        _ = part.thickness  # says what is missing

    def on_disk() -> None:
        for kind, file in files.items():
            file.parent.mkdir(parents=True, exist_ok=True)
            _WRITERS[kind](part, file, unit)

    on_rank_0(part.body.comm, on_disk)
    return list(files.values())


def _loops(part: Shape) -> list[list[tuple[Curve, str]]]:
    """All loops with the interface of each curve; curves that go on are joined."""
    return [_joined([(c, part.group(c)) for c in loop]) for ls in part.outlines for loop in ls]


def _joined(loop: list[tuple[Curve, str]]) -> list[tuple[Curve, str]]:
    """A loop in which lines and arcs that go on are one."""
    if len(loop) < 2:
        return loop
    first = next((i for i in range(len(loop)) if _common(loop[i - 1], loop[i]) is None), 0)
    found = [loop[first]]
    for each in [*loop[first + 1 :], *loop[:first]]:
        both = _common(found[-1], each)
        if both is None:
            found.append(each)
        else:
            found[-1] = (both, each[1])
    return found


def _common(one: tuple[Curve, str], other: tuple[Curve, str]) -> Curve | None:
    """The line or arc that two that follow each other make up, if they do."""
    (a, group), (b, of_b) = one, other
    if group != of_b:
        return None
    if isinstance(a, Line) and isinstance(b, Line):
        d, e = a.end - a.start, b.end - b.start
        along = float(np.hypot(*d) * np.hypot(*e))
        if abs(d[0] * e[1] - d[1] * e[0]) < 1e-9 * along and d @ e > 0.0:
            return Line(a.start, b.end)
    if isinstance(a, Arc) and isinstance(b, Arc) and a.sweep * b.sweep > 0.0:
        same = np.hypot(*(a.center - b.center)) < 1e-9 * a.radius
        sweep = a.sweep + b.sweep
        if same and abs(a.radius - b.radius) < 1e-9 * a.radius and abs(sweep) < 2 * np.pi - 1e-6:
            return Arc(a.start, b.end, a.center, sweep)
    return None


# ---------------------------------------------------------------------- SVG


def _write_svg(part: Shape, path: Path, unit: str) -> None:
    scale = 1.0 / UNITS[unit]
    x0, y0, x1, y1 = (scale * v for v in part.polygon.bounds)
    margin = 0.02 * max(x1 - x0, y1 - y0)
    width, height = x1 - x0 + 2 * margin, y1 - y0 + 2 * margin
    real = width * UNITS[unit] * 1e3, height * UNITS[unit] * 1e3
    root = ElementTree.Element(
        "svg",
        xmlns=_SVG,
        version="1.1",
        width=f"{real[0]:.12g}mm",
        height=f"{real[1]:.12g}mm",
        viewBox=f"{x0 - margin:.12g} {-y1 - margin:.12g} {width:.12g} {height:.12g}",
    )
    line = f"{0.002 * width:.3g}"
    loops = _loops(part)
    texts = [_svg_path([curve for curve, _ in loop], scale) + " Z" for loop in loops]
    ElementTree.SubElement(
        root,
        "path",
        {
            "id": PART,
            "d": " ".join(texts),
            "fill": "#c9d1d9",
            "fill-rule": "evenodd",
            "stroke": "#22272e",
            "stroke-width": line,
        },
    )
    marks = ElementTree.SubElement(
        root, "g", {"id": "interfaces", "fill": "none", "stroke": "#0b62a4", "stroke-width": line}
    )
    for name in part.body.interfaces:
        own = [curve for loop in loops for curve, group in loop if group == name]
        if own:
            text = " ".join(_svg_path([curve], scale) for curve in own)
            ElementTree.SubElement(marks, "path", {"id": name, "d": text})
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _svg_path(curves: Sequence[Curve], scale: float) -> str:
    """Path data of curves that follow each other."""

    def at(*points: Array) -> str:
        return " ".join(f"{scale * x:.15g},{-scale * y:.15g}" for x, y in points)

    found = [f"M {at(curves[0].start)}"]
    for curve in curves:
        if isinstance(curve, Line):
            found.append(f"L {at(curve.end)}")
        elif isinstance(curve, Arc):
            for piece in curve.pieces():
                radius = f"{scale * piece.radius:.15g}"
                # counterclockwise with y upwards
                found.append(f"A {radius} {radius} 0 0 {int(piece.sweep < 0.0)} {at(piece.end)}")
        elif isinstance(curve, Spline):
            ends = curve.breaks()
            p, d = curve.at(ends), curve.slope(ends)
            p[-1] = curve.end
            third = np.diff(ends)[:, None] / 3.0
            after, before = p[:-1] + third * d[:-1], p[1:] - third * d[1:]
            found += [f"C {at(*each)}" for each in zip(after, before, p[1:], strict=True)]
    return " ".join(found)


# ---------------------------------------------------------------------- DXF


def layer(name: str) -> str:
    """The name of the layer of an interface: DXF forbids some characters.

    Args:
        name: Of the interface.
    """
    return _FORBIDDEN.sub("_", name)


def _write_dxf(part: Shape, path: Path, unit: str) -> None:
    import ezdxf

    scale = 1.0 / UNITS[unit]
    drawing = ezdxf.new("R2010")
    drawing.header["$INSUNITS"] = _INSUNITS[unit]
    drawing.header["$MEASUREMENT"] = 1
    drawing.layers.add(PART)
    for color, name in enumerate(part.body.interfaces, 1):
        drawing.layers.add(layer(name), color=color % 6 + 1)
    space = drawing.modelspace()
    for loop in _loops(part):
        for curve, group in loop:
            how = {"layer": layer(group) if group else PART}
            if isinstance(curve, Line):
                space.add_line(scale * curve.start, scale * curve.end, dxfattribs=how)
            elif isinstance(curve, Arc):
                _add_arc(space, curve, scale, how)
            elif isinstance(curve, Spline):
                spline = space.add_spline(degree=curve.degree, dxfattribs=how)
                spline.control_points = scale * np.column_stack(
                    [curve.control, np.zeros(len(curve.control))]
                )
                spline.knots = curve.knots.tolist()
    drawing.saveas(path)


def _add_arc(space: object, curve: Arc, scale: float, how: dict[str, str]) -> None:
    center, radius = scale * curve.center, scale * curve.radius
    if abs(abs(curve.sweep) - 2.0 * np.pi) < 1e-9:
        space.add_circle(center, radius, dxfattribs=how)  # type: ignore[attr-defined]
        return
    first = curve if curve.sweep > 0.0 else curve.reversed()
    angles = np.degrees([first.angle, first.angle + first.sweep])
    space.add_arc(center, radius, *angles, dxfattribs=how)  # type: ignore[attr-defined]


# ---------------------------------------------------------------------- solids


def _whole(part: Shape) -> Drawing:
    """The pieces of the part as faces, solid regions not told apart."""
    curves: list[Curve] = []
    faces: list[Face] = []
    nodes: list[tuple[int, int]] = []
    known: dict[bytes, int] = {}

    def node(where: Array) -> int:
        return known.setdefault((np.asarray(where) + 0.0).tobytes(), len(known))

    for rings in part.outlines:
        loops = []
        for ring in rings:
            joined = [curve for curve, _ in _joined([(curve, "") for curve in ring])]
            loops.append([(len(curves) + i, True) for i in range(len(joined))])
            curves += joined
            nodes += [(node(curve.start), node(curve.end)) for curve in joined]
        faces.append(Face(PART, loops))
    return Drawing(curves, nodes, [""] * len(curves), faces)


def _write_step(part: Shape, path: Path, unit: str) -> None:
    millimetres = 1e3  # which stand in the file, whatever the unit of other drawings
    with gmsh_model() as gmsh:
        found, _ = surfaces(gmsh, _whole(part), millimetres)
        below = [(2, tag) for tag in found]
        gmsh.model.occ.extrude(below, 0.0, 0.0, millimetres * part.thickness)
        gmsh.model.occ.synchronize()
        with quiet():
            gmsh.write(str(path))


def _write_stl(part: Shape, path: Path, unit: str) -> None:
    import pyvista  # takes a while

    scale, thickness = 1.0 / UNITS[unit], part.thickness
    triangles = []
    for piece in part.polygon.geoms:
        flat = shapely.get_parts(shapely.constrained_delaunay_triangles(piece))
        corners = np.array([shapely.get_coordinates(shapely.orient_polygons(t))[:3] for t in flat])
        zero = np.zeros((*corners.shape[:2], 1))
        triangles.append(np.concatenate([corners, zero + thickness], axis=2))
        triangles.append(np.concatenate([corners, zero], axis=2)[:, ::-1])
        turned = shapely.orient_polygons(piece)
        for ring in (turned.exterior, *turned.interiors):
            x = shapely.get_coordinates(ring)
            a, b = (np.column_stack([p, np.zeros(len(p))]) for p in (x[:-1], x[1:]))
            up = np.array([0.0, 0.0, thickness])
            triangles.append(np.stack([a, b, b + up], axis=1))
            triangles.append(np.stack([a, b + up, a + up], axis=1))
    corners = scale * np.concatenate(triangles)
    faces = np.column_stack([np.full(len(corners), 3), np.arange(3 * len(corners)).reshape(-1, 3)])
    pyvista.PolyData(corners.reshape(-1, 3), faces.ravel()).clean().save(path)


_WRITERS: dict[str, Callable[[Shape, Path, str], None]] = {
    ".svg": _write_svg,
    ".dxf": _write_dxf,
    ".step": _write_step,
    ".stl": _write_stl,
}
