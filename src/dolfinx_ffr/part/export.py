# SPDX-License-Identifier: MIT
"""Parts as files for CAD and machines.

* .svg: lines, arcs and cubic curves, y downwards; the path "part", and paths named as interfaces;
* .dxf (R2010): LINE, ARC, CIRCLE and SPLINE, on the layer "part" and on layers named as interfaces;
* .step: the extruded solid, by OpenCASCADE; in millimetres, as the file says;
* .stl: triangles, within the part's `accuracy` of the curves; its numbers are short floats.

Pockets are milled from both sides to the same depth. In drawings they are paths "pockets" or a
layer whose name tells the depth, and solids have them to their depth.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from mpi4py import MPI

import numpy as np
import shapely

from .. import validation
from ..arrays import Array
from ..fem import Arc, Curve, Drawing, Face, Line, Spline, gmsh_model, quiet, surfaces
from ..files import whole_file
from ..parallel import on_rank_0

#: Curves that follow each other, each with the interface that it is, "" for none
Loop = list[tuple[Curve, str]]

#: Units of drawings in metres, and their codes in DXF
UNITS = {"mm": 1e-3, "m": 1.0}
_INSUNITS = {"mm": 4, "m": 6}
#: Layer or path of curves outside interfaces
PART = "part"
_SVG = """<?xml version='1.0' encoding='utf-8'?>
<svg xmlns="http://www.w3.org/2000/svg" version="1.1" {size} viewBox="{box}">\
<path id="{part}" d="{outline}" fill="#c9d1d9" fill-rule="evenodd" stroke="#22272e" \
stroke-width="{line}" />{pockets}\
<g id="interfaces" fill="none" stroke="#0b62a4" stroke-width="{line}">{interfaces}</g></svg>"""
_SVG_POCKETS = """\
<path id="pockets" d="{outline}" fill="#eef1f4" fill-rule="evenodd" stroke="#22272e" \
stroke-width="{line}" />"""
#: What names of layers may not have
_FORBIDDEN = re.compile(r"[<>/\\\":;?*|=`',]")
#: A triangle of an STL file
_FACET = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]


@dataclass(frozen=True, eq=False)
class Sheet:
    """A part as files show it."""

    pieces: list[list[Loop]]  #: For each piece the outer loop, counterclockwise, then its holes
    interfaces: list[str]
    polygon: shapely.MultiPolygon  #: That stands for the curves where curves are not known
    thickness: Callable[[], float]  #: [m], or says that it is not known
    #: Of each pocket the outer loop, counterclockwise, then the loops around its islands
    pockets: list[list[Loop]] = field(default_factory=list)
    floors: Sequence[shapely.Polygon] = ()  #: That stand for their curves
    web: float = 0.0  #: Thickness of the floors as a share

    @property
    def loops(self) -> list[Loop]:
        """All loops, with splines that are straight as lines; curves that go on are joined."""
        return _whole_curves(self.pieces)

    @property
    def pocket_loops(self) -> list[Loop]:
        """All loops around the floors of pockets and their islands, made likewise."""
        return _whole_curves(self.pockets)

    @property
    def depth(self) -> float:
        """Depth of the pockets, from each of both sides [m]."""
        return 0.5 * (1.0 - self.web) * self.thickness()


def _whole_curves(pieces: Sequence[Sequence[Loop]]) -> list[Loop]:
    return [_joined(loop) for loops in pieces for loop in map(_with_lines, loops)]


def write(part: Sheet, path: str | Path, unit: str, comm: MPI.Comm) -> list[Path]:
    """Write a part, see `Enclosed.write`."""
    target = validation.path("part: file", path)
    validation.choice("part: unit", unit, UNITS)
    suffix = "" if on_rank_0(comm, target.is_dir) else target.suffix.lower()
    suffix = {".stp": ".step"}.get(suffix, suffix)
    if suffix and suffix not in _WRITERS:
        raise ValueError(
            f"part: {str(target)!r} ends in {target.suffix!r}; parts are written as "
            f"{', '.join(_WRITERS)}, or all of them into a folder, whose name has no ending"
        )
    files = {suffix: target} if suffix else {kind: target / f"part{kind}" for kind in _WRITERS}
    if {".step", ".stl"} & set(files) or part.pockets:
        part.thickness()  # says what is missing

    def on_disk() -> None:
        for kind, file in files.items():
            file.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(file) as beside:
                _WRITERS[kind](part, beside, unit)

    on_rank_0(comm, on_disk)
    return list(files.values())


def _with_lines(loop: Loop) -> Loop:
    """A loop of curves without vanishing derivatives, which CAD programs need for offsets."""
    return [
        (piece, interface)
        for curve, interface in loop
        for piece in (curve.with_lines() if isinstance(curve, Spline) else [curve])
    ]


def _joined(loop: Loop) -> Loop:
    """The loop with successive pieces of one line, or of one arc, joined to a single curve."""
    if len(loop) < 2:
        return loop
    # begin where a curve does not continue the one before it, if there is such a place
    first = next((i for i in range(len(loop)) if _common(loop[i - 1], loop[i]) is None), 0)
    joined = [loop[first]]
    for curve, interface in [*loop[first + 1 :], *loop[:first]]:
        common = _common(joined[-1], (curve, interface))
        if common is None:
            joined.append((curve, interface))
        else:
            joined[-1] = (common, interface)
    return joined


def _common(one: tuple[Curve, str], other: tuple[Curve, str]) -> Curve | None:
    """The single line or arc that two successive curves of a loop are pieces of, or None."""
    (a, interface_of_a), (b, interface_of_b) = one, other
    if interface_of_a != interface_of_b:
        return None
    if isinstance(a, Line) and isinstance(b, Line):
        d, e = a.end - a.start, b.end - b.start
        lengths = float(np.hypot(*d) * np.hypot(*e))
        is_parallel = abs(d[0] * e[1] - d[1] * e[0]) < 1e-9 * lengths
        if is_parallel and d @ e > 0.0:
            return Line(a.start, b.end)

    if isinstance(a, Arc) and isinstance(b, Arc) and a.sweep * b.sweep > 0.0:
        is_concentric = np.hypot(*(a.center - b.center)) < 1e-9 * a.radius
        is_one_circle = is_concentric and abs(a.radius - b.radius) < 1e-9 * a.radius
        sweep = a.sweep + b.sweep
        # both together may be less than a circle, as an arc has two ends
        if is_one_circle and abs(sweep) < 2 * np.pi - 1e-6:
            return Arc(a.start, b.end, a.center, sweep)
    return None


def _write_svg(part: Sheet, path: Path, unit: str) -> None:
    scale = 1.0 / UNITS[unit]
    x0, y0, x1, y1 = (scale * v for v in part.polygon.bounds)
    margin = 0.02 * max(x1 - x0, y1 - y0)
    width, height = x1 - x0 + 2 * margin, y1 - y0 + 2 * margin
    millimetres = 1e3 * UNITS[unit]
    loops, line = part.loops, f"{0.002 * width:.3g}"

    def path_of(loops: Sequence[Loop]) -> str:
        return " ".join(_svg_path([curve for curve, _ in loop], scale) + " Z" for loop in loops)

    milled = path_of(part.pocket_loops)
    marks = {}
    for name in part.interfaces:
        wall = [curve for loop in loops for curve, interface in loop if interface == name]
        marks[name] = " ".join(_svg_path([curve], scale) for curve in wall)
    paths = "".join(f"<path id={quoteattr(n)} d={quoteattr(d)} />" for n, d in marks.items() if d)
    path.write_text(
        _SVG.format(
            size=f'width="{millimetres * width:.12g}mm" height="{millimetres * height:.12g}mm"',
            box=f"{x0 - margin:.12g} {-y1 - margin:.12g} {width:.12g} {height:.12g}",
            part=PART,
            outline=path_of(loops),
            pockets=_SVG_POCKETS.format(outline=milled, line=line) if milled else "",
            line=line,
            interfaces=paths,
        ),
        encoding="utf-8",
    )


def _svg_path(curves: Sequence[Curve], scale: float) -> str:
    """Path data of curves that follow each other."""

    def at(*points: Array) -> str:
        return " ".join(f"{scale * x:.15g},{-scale * y:.15g}" for x, y in points)

    commands = [f"M {at(curves[0].start)}"]
    for curve in curves:
        if isinstance(curve, Line):
            commands.append(f"L {at(curve.end)}")
        elif isinstance(curve, Arc):
            for piece in curve.pieces():
                radius = f"{scale * piece.radius:.15g}"
                # counterclockwise with y upwards
                clockwise = int(piece.sweep < 0.0)
                commands.append(f"A {radius} {radius} 0 0 {clockwise} {at(piece.end)}")
        elif isinstance(curve, Spline):
            ends = curve.breaks()
            p, d = curve.at(ends), curve.slope(ends)
            p[-1] = curve.end
            third = np.diff(ends)[:, None] / 3.0
            first, second = p[:-1] + third * d[:-1], p[1:] - third * d[1:]
            controls = zip(first, second, p[1:], strict=True)
            commands += [f"C {at(*points)}" for points in controls]
    return " ".join(commands)


def layer(name: str) -> str:
    """The name of the layer of an interface: DXF forbids some characters."""
    return _FORBIDDEN.sub("_", name)


def _write_dxf(part: Sheet, path: Path, unit: str) -> None:
    import ezdxf

    scale = 1.0 / UNITS[unit]
    drawing = ezdxf.new("R2010")
    drawing.header["$INSUNITS"] = _INSUNITS[unit]
    drawing.header["$MEASUREMENT"] = 1
    drawing.layers.add(PART)
    for color, name in enumerate(part.interfaces, 1):
        drawing.layers.add(layer(name), color=color % 6 + 1)
    space = drawing.modelspace()
    drawn = [(c, layer(group) if group else PART) for loop in part.loops for c, group in loop]
    if part.pockets:
        # the depth stands in the unit of the drawing
        milled = layer(f"pockets {part.depth * scale:.6g} {unit} deep from both sides")
        drawing.layers.add(milled, color=8)
        drawn += [(curve, milled) for loop in part.pocket_loops for curve, _ in loop]
    for curve, name in drawn:
        attributes = {"layer": name}
        if isinstance(curve, Line):
            space.add_line(scale * curve.start, scale * curve.end, dxfattribs=attributes)
        elif isinstance(curve, Arc):
            center, radius = scale * curve.center, scale * curve.radius
            anticlockwise = curve if curve.sweep > 0.0 else curve.reversed()
            first_angle, sweep = anticlockwise.angle, anticlockwise.sweep
            if abs(sweep - 2.0 * np.pi) < 1e-9:
                space.add_circle(center, radius, dxfattribs=attributes)
            else:
                start, end = np.degrees([first_angle, first_angle + sweep])
                space.add_arc(center, radius, start, end, dxfattribs=attributes)
        elif isinstance(curve, Spline):
            spline = space.add_spline(degree=curve.degree, dxfattribs=attributes)
            spline.control_points = scale * np.pad(curve.control, ((0, 0), (0, 1)))
            spline.knots = curve.knots.tolist()
    drawing.saveas(path)


def _undivided_drawing(pieces: Sequence[Sequence[Loop]], *, whole_splines: bool = False) -> Drawing:
    """The pieces of a part, or its pockets, with one face for each, solid regions included.

    A spline becomes one curve for each of its polynomials: along a curve of several polynomials
    OpenCASCADE takes too few points for masses, and its offsets fail at random. With
    ``whole_splines`` a spline stays one curve, along which cells may be longer than a polynomial.
    """
    curves: list[Curve] = []
    faces: list[Face] = []
    nodes: list[tuple[int, int]] = []
    node_of_position: dict[bytes, int] = {}

    def node(position: Array) -> int:
        key = (np.asarray(position) + 0.0).tobytes()  # with 0 in place of -0, whose bytes differ
        return node_of_position.setdefault(key, len(node_of_position))

    for rings in pieces:
        loops = []
        for ring in rings:
            ring_curves: list[Curve] = []
            for curve, _ in _joined([(curve, "") for curve, _ in _with_lines(ring)]):
                if isinstance(curve, Spline) and not whole_splines:
                    ring_curves += curve.polynomials()
                else:
                    ring_curves.append(curve)
            loops.append([(len(curves) + i, True) for i in range(len(ring_curves))])
            curves += ring_curves
            nodes += [(node(curve.start), node(curve.end)) for curve in ring_curves]
        faces.append(Face(PART, loops))
    return Drawing(curves, nodes, [""] * len(curves), faces)


def _write_step(part: Sheet, path: Path, unit: str) -> None:
    millimetres = 1e3  # which stand in the file, whatever the unit of other drawings
    with gmsh_model() as gmsh:
        add_solid(gmsh, part, millimetres)
        with quiet():
            gmsh.write(str(path))


def add_solid(gmsh: Any, part: Sheet, scale: float, *, whole_splines: bool = False) -> None:
    """Make the solid of a part, times ``scale``, in gmsh's model, on 0 <= z <= its thickness.

    With ``whole_splines`` a spline is one curve, as meshes want it, and files do not.
    """
    occ = gmsh.model.occ

    def prisms(pieces: Sequence[Sequence[Loop]], begin: float, end: float) -> list[tuple[int, int]]:
        """The volumes over some pieces between two heights."""
        tags, _ = surfaces(gmsh, _undivided_drawing(pieces, whole_splines=whole_splines), scale)
        bases = [(2, tag) for tag in tags]
        occ.translate(bases, 0.0, 0.0, begin)
        return [entity for entity in occ.extrude(bases, 0.0, 0.0, end - begin) if entity[0] == 3]

    height = scale * part.thickness()
    plate = prisms(part.pieces, 0.0, height)
    if part.pockets:
        depth = scale * part.depth
        # beyond the plate, so that no face of a cutter lies in one of the plate
        below = prisms(part.pockets, -depth, depth)
        above = prisms(part.pockets, height - depth, height + depth)
        with quiet():
            occ.cut(plate, below + above)
    occ.synchronize()


def _write_stl(part: Sheet, path: Path, unit: str) -> None:
    scale, height = 1.0 / UNITS[unit], part.thickness()

    def flat(ring: shapely.Geometry) -> Array:
        return np.pad(shapely.get_coordinates(ring), ((0, 0), (0, 1)))

    def faces(shape: shapely.Geometry, low: float, high: float) -> list[Array]:
        """Triangles that look up at a height, and down at a lower one."""
        facets: list[Array] = []
        for piece in shapely.get_parts(shapely.orient_polygons(shape)):
            cells = shapely.get_parts(shapely.constrained_delaunay_triangles(piece))
            flats = np.array([flat(cell)[:3] for cell in shapely.orient_polygons(cells)])
            facets += [flats + np.array([0, 0, high]), flats[:, ::-1] + np.array([0, 0, low])]
        return facets

    def walls(rings: Sequence[shapely.Geometry], low: float, high: float) -> list[Array]:
        """Triangles on walls with the material on the left of their rings."""
        bottom, up = np.array([0.0, 0.0, low]), np.array([0.0, 0.0, high - low])
        facets: list[Array] = []
        for ring in rings:
            a, b = flat(ring)[:-1] + bottom, flat(ring)[1:] + bottom
            facets += [np.stack([a, b, b + up], axis=1), np.stack([a, b + up, a + up], axis=1)]
        return facets

    floors = shapely.MultiPolygon(list(part.floors))
    triangles = faces(part.polygon, 0.0, height)
    triangles += walls(_rings(shapely.union_all([part.polygon, floors])), 0.0, height)
    if part.pockets:
        depth = part.depth
        # around a pocket the material is on the other side
        milled = [ring.reverse() for ring in _rings(floors)]
        triangles += walls(milled, 0.0, depth) + walls(milled, height - depth, height)
        triangles += faces(floors, depth, height - depth)
    corners = scale * np.concatenate(triangles)
    facets = np.zeros(len(corners), dtype=_FACET)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    facets["normal"] = normals / np.where(lengths > 0.0, lengths, 1.0)
    facets["corners"] = corners
    head = f"{PART} [{unit}]".ljust(80).encode("ascii")
    path.write_bytes(head + len(facets).to_bytes(4, "little") + facets.tobytes())


def _rings(shape: shapely.Geometry) -> list[shapely.Geometry]:
    """The rings around polygons, with these on their left."""
    pieces = shapely.get_parts(shapely.orient_polygons(shape))
    return [ring for piece in pieces for ring in (piece.exterior, *piece.interiors)]


_WRITERS: dict[str, Callable[[Sheet, Path, str], None]] = {
    ".svg": _write_svg,
    ".dxf": _write_dxf,
    ".step": _write_step,
    ".stl": _write_stl,
}
