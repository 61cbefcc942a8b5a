# SPDX-License-Identifier: MIT
"""Curves of drawings: DXF by ezdxf, SVG by svgelements, rings of points."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from .. import validation
from .curves import Arc, Curve, Line, Spline

__all__ = ["UNITS", "Drawn", "read_outline"]

Array = NDArray[np.float64]

#: Units of drawings [m]
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
#: Codes of units in the header of DXF files
_INSUNITS = {1: "in", 4: "mm", 5: "cm", 6: "m"}
#: Physical units of SVG [mm]
_PHYSICAL = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72.0, "pc": 25.4 / 6.0}
#: Entities of DXF that draw no outline
_NOTES = {"TEXT", "MTEXT", "DIMENSION", "LEADER", "POINT", "HATCH", "ATTDEF", "VIEWPORT", "IMAGE"}
#: Points by which curves are taken that are neither lines, arcs nor B-splines, as ellipses
_POINTS = 65
#: Relative accuracy with which an ellipse is a circle
_ROUND = 1e-9


@dataclass(frozen=True, eq=False)
class Drawn:
    """A curve of a drawing."""

    curve: Curve  #: In metres
    names: frozenset[str]  #: Layer, id, label


def read_outline(outline: str | Path | Any, unit: str | None) -> list[Drawn]:
    """The curves of an outline, in metres.

    Args:
        outline: A .dxf or .svg file, rings of points (n, 2), or polygons of shapely.
        unit: Of the numbers, "mm", "cm", "m" or "in"; by default that of the file, or metres for
            points.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If the file cannot be read, has no unit or holds what is no curve.
    """
    if unit is not None:
        validation.choice("outline: unit", unit, UNITS)
    if isinstance(outline, str | Path):
        path = Path(outline)
        readers = {".dxf": _read_dxf, ".svg": _read_svg}
        if path.suffix.lower() not in readers:
            raise ValueError(f"outline {path}: give a file that ends in .dxf or .svg, or polygons")
        if not path.is_file():
            raise FileNotFoundError(f"outline {path} does not exist")
        found = readers[path.suffix.lower()](path, unit)
        if not found:
            raise ValueError(f"outline {path}: it holds no curves")
        return found
    scale = 1.0 if unit is None else UNITS[unit]
    return [each for ring in _rings(outline) for each in _polygon(scale * ring, frozenset())]


def _rings(outline: Any) -> list[Array]:
    """The rings of polygons of shapely, or given as points."""
    import shapely

    if isinstance(outline, shapely.Geometry):
        lines = shapely.get_parts(outline.boundary)
        return [shapely.get_coordinates(line) for line in lines]
    if isinstance(outline, np.ndarray) and outline.ndim == 2:
        outline = [outline]
    rings = validation.listed("outline", outline, "a file, or rings of points (n, 2)")
    return [validation.real_array("outline: a ring", r, (None, 2)) for r in rings]


def _polygon(points: Array, names: frozenset[str]) -> list[Drawn]:
    closed = points if np.array_equal(points[0], points[-1]) else np.vstack([points, points[:1]])
    sides = [Line(a, b) for a, b in pairwise(closed) if not np.array_equal(a, b)]
    return [Drawn(side, names) for side in sides]


def _through(points: Array) -> Spline:
    """A spline through points on a smooth curve."""
    t = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    found = make_interp_spline(t / t[-1], points, k=3)
    control = np.array(found.c)
    control[0], control[-1] = points[0], points[-1]
    return Spline(np.asarray(found.t), control, 3)


# ---------------------------------------------------------------------- DXF


def _read_dxf(path: Path, unit: str | None) -> list[Drawn]:
    import ezdxf

    try:
        drawing = ezdxf.readfile(path)
    except (ezdxf.DXFError, OSError, UnicodeError) as error:
        raise ValueError(f"outline {path}: no DXF file that can be read: {error}") from error
    code = int(drawing.header.get("$INSUNITS", 0))
    if unit is None and code not in _INSUNITS:
        raise ValueError(
            f"outline {path}: the file does not say its unit ($INSUNITS = {code}); give unit='mm'"
        )
    scale = UNITS[unit or _INSUNITS[code]]
    found: list[Drawn] = []
    for entity in _exploded(drawing.modelspace()):
        kind = entity.dxftype()
        if kind in _NOTES:
            continue
        curves = _of_entity(entity, scale)
        if curves is None:
            raise ValueError(
                f"outline {path}: the layer {entity.dxf.layer!r} holds a {kind}, which is no "
                "curve in the plane; delete it, or convert it to lines, arcs or splines"
            )
        found += [Drawn(curve, frozenset([entity.dxf.layer])) for curve in curves]
    return found


def _exploded(entities: Iterable[Any]) -> Iterable[Any]:
    """Entities, of blocks and polylines their parts."""
    for entity in entities:
        if entity.dxftype() in ("INSERT", "LWPOLYLINE", "POLYLINE"):
            layer = entity.dxf.layer
            for part in _exploded(entity.virtual_entities()):
                if part.dxf.layer == "0":  # of a block: as the block
                    part.dxf.layer = layer
                yield part
        else:
            yield entity


def _of_entity(entity: Any, scale: float) -> list[Curve] | None:
    """The curves of an entity, None where it is no curve in the plane."""
    kind = entity.dxftype()
    if kind == "LINE":
        ends = [np.array([*p]) for p in (entity.dxf.start, entity.dxf.end)]
        if _leaves_plane(ends):
            return None
        a, b = (scale * end[:2] for end in ends)
        return [] if np.array_equal(a, b) else [Line(a, b)]
    if kind in ("ARC", "CIRCLE"):
        upright = np.allclose([*entity.dxf.extrusion], [0.0, 0.0, 1.0], atol=1e-12)
        if upright:
            center = scale * np.array([*entity.dxf.center])[:2]
            radius = scale * float(entity.dxf.radius)
            first, sweep = 0.0, 2.0 * np.pi
            if kind == "ARC":
                first = np.radians(entity.dxf.start_angle)
                sweep = float(np.radians((entity.dxf.end_angle - entity.dxf.start_angle) % 360.0))
                sweep = sweep or 2.0 * np.pi
            return [_arc(center, radius, first, sweep)]
    if kind == "SPLINE":
        tool = entity.construction_tool()
        control = np.array([[*p] for p in tool.control_points])
        knots = np.array(tool.knots())
        k = tool.order - 1
        clamped = np.ptp(knots[: k + 1]) == 0.0 and np.ptp(knots[-k - 1 :]) == 0.0
        if clamped and not len(tool.weights()) and not _leaves_plane(control):
            span = knots[-1] - knots[0]
            return [Spline((knots - knots[0]) / span, scale * control[:, :2], k)]
        points = np.array([[*p] for p in tool.points(np.linspace(0.0, tool.max_t, 4 * _POINTS))])
        return None if _leaves_plane(points) else [_through(scale * points[:, :2])]
    if kind in ("ELLIPSE", "ARC", "CIRCLE"):
        ellipse = entity if kind == "ELLIPSE" else entity.to_ellipse(replace=False)
        tool = ellipse.construction_tool()
        angles = tool.start_param + np.linspace(0.0, 1.0, _POINTS) * tool.param_span
        points = np.array([[*p] for p in tool.vertices(angles)])
        return None if _leaves_plane(points) else [_through(scale * points[:, :2])]
    return None


def _leaves_plane(points: Sequence[Array] | Array) -> bool:
    """Whether points differ in z."""
    x = np.array(points)
    return bool(x.shape[1] > 2 and np.ptp(x[:, 2]) > 1e-9 * max(float(np.ptp(x[:, :2])), 1e-300))


def _arc(center: Array, radius: float, first: float, sweep: float) -> Arc:
    ends = [center + radius * np.array([np.cos(a), np.sin(a)]) for a in (first, first + sweep)]
    whole = abs(abs(sweep) - 2.0 * np.pi) < 1e-12
    return Arc(ends[0], ends[0] if whole else ends[1], center, sweep)


# ---------------------------------------------------------------------- SVG


def _read_svg(path: Path, unit: str | None) -> list[Drawn]:
    import io

    import svgelements

    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError, UnicodeError) as error:
        raise ValueError(f"outline {path}: no SVG file that can be read: {error}") from error
    scale = UNITS[unit] if unit else 1e-3 * _svg_millimetres(path, root)
    # numbers in the file's own coordinates, which the size of the page does not move
    for attribute in ("width", "height", "viewBox"):
        root.attrib.pop(attribute, None)
    text = io.StringIO(ElementTree.tostring(root, encoding="unicode"))
    svg = svgelements.SVG.parse(text, reify=True)
    found: list[Drawn] = []
    for shape, names in _shapes(svg, frozenset()):
        found += [Drawn(c, names) for c in _of_path(svgelements.Path(shape), scale)]
    return found


def _svg_millimetres(path: Path, root: ElementTree.Element) -> float:
    """The length of a unit of an SVG file's coordinates."""
    match = re.fullmatch(r"\s*([-+.\deE]+?)\s*([a-z]+)\s*", root.get("width", ""))
    if not match or match.group(2) not in _PHYSICAL:
        raise ValueError(
            f"outline {path}: the file does not say its unit (width = {root.get('width')!r}); give "
            "unit='mm'"
        )
    width = float(match.group(1)) * _PHYSICAL[match.group(2)]
    box = re.split(r"[\s,]+", root.get("viewBox", "").strip())
    return width / float(box[2]) if len(box) == 4 else 25.4 / 96.0


def _shapes(group: Any, names: frozenset[str]) -> Iterable[tuple[Any, frozenset[str]]]:
    """The shapes of a group, with the ids and labels of themselves and of groups around them."""
    import svgelements

    for element in group:
        own = {element.id} if element.id else set()
        values = getattr(element, "values", {})
        own |= {str(v) for k, v in values.items() if str(k).endswith("label") and v}
        inner = names | frozenset(map(str, own))
        if isinstance(element, svgelements.Group):
            yield from _shapes(element, inner)
        elif isinstance(element, svgelements.Shape):
            yield element, inner


def _of_path(path: Any, scale: float) -> list[Curve]:
    """The curves of a path; y points downwards there."""
    import svgelements

    def at(point: Any) -> Array:
        return scale * np.array([float(point.x), -float(point.y)])

    found: list[Curve] = []
    for segment in path:
        if isinstance(segment, svgelements.Move) or segment.start is None:
            continue
        a, b = at(segment.start), at(segment.end)
        if isinstance(segment, svgelements.Line | svgelements.Close):
            if not np.array_equal(a, b):
                found.append(Line(a, b))
        elif isinstance(segment, svgelements.Arc):
            rx, ry = float(segment.rx), float(segment.ry)
            if abs(rx - ry) <= _ROUND * rx:
                found.append(Arc(a, b, at(segment.center), -float(segment.sweep)))
            else:
                t = np.linspace(0.0, 1.0, _POINTS)
                found.append(_through(np.array([a, *map(at, map(segment.point, t[1:-1])), b])))
        else:
            inner = [segment.control] if hasattr(segment, "control") else []
            inner = inner or [segment.control1, segment.control2]
            control = np.array([a, *map(at, inner), b])
            degree = len(control) - 1
            ends = np.ones(degree + 1)
            found.append(Spline(np.concatenate([0.0 * ends, ends]), control, degree))
    return found
