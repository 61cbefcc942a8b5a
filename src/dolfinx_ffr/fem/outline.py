# SPDX-License-Identifier: MIT
"""Outlines of bodies: curves of files, rings or polygons, and the faces that they bound."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import shapely
from numpy.typing import NDArray

from .. import validation
from ..arrays import Array
from ..limits import MOST_CURVES, MOST_TRIANGLES, check_count
from .curves import Arc, Curve, Drawn, Line, Spline
from .drawing import Drawing
from .dxf_file import read_dxf
from .interface import Bore, Predicate, checked, whole_edge
from .loops import DRAWING, closed_outline, samples
from .mesh_file import GroupedMesh, read_gmsh_model
from .plane_mesh import built_on_rank_0, cells_along, check_size, mesh_faces
from .rims import with_rims

#: Units of drawings [m]
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
#: Name of the group of curves that are in no interface
_REST = "outline"


@dataclass(frozen=True)
class Sheet:
    """Options for reading a drawing: its unit, and the curves that form the outline."""

    unit: str | None = None  #: One of UNITS; None takes that of the file, or metres
    layers: Sequence[str] | None = None  #: Layers of the outline; None takes all
    inside: Sequence[float] | None = None  #: A point in the part that is meant, (2,) [m]
    gap: float | None = None  #: Largest distance between loose ends that are joined [m]


def mesh_outline(
    comm: MPI.Comm,
    outline: Any,
    interfaces: Mapping[str, Predicate | Bore | str],
    size: float,
    sheet: Sheet,
    order: int,
    rim: float = 0.0,
) -> tuple[GroupedMesh, dict[str, NDArray[np.int32]]]:
    """A mesh of triangles within a closed outline, see `Domain.from_outline`.

    Returned are also the facets of interfaces that are named by a layer or a bore. Cells within
    the width ``rim`` [m] of interfaces, however these are named, are the physical surface
    "solid"; their boundary is the offset curve of the interface.
    """
    validation.instance("from_outline: comm", comm, MPI.Comm, "an MPI communicator")
    validation.number("from_outline: size", size, above=0.0, unit="m")
    if rim:
        validation.number("domain: solid_rim", rim, least=DRAWING.thinnest_rim * size, unit="m")
    named = {name: place for name, place in interfaces.items() if isinstance(place, str | Bore)}
    source = f"outline {outline}" if isinstance(outline, str | Path) else "outline"
    messages: list[str] = []

    def build(gmsh: Any) -> None:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            drawing = _read(source, outline, named, sheet)
            if len(interfaces) == 1:
                _refuse_whole_edge(source, drawing)
            if rim > 0.0:
                drawing = _rimmed(drawing, interfaces, size, rim)
            sides = _sides(drawing)
            hint = f", or the right unit= of the drawing, which is {sides} now"
            check_size(source, drawing, size, largest=MOST_TRIANGLES, hint=hint)
            _warn_of_coarse_triangles(source, drawing, size)
        messages.extend(str(warning.message) for warning in caught)
        # gmsh's file needs a physical group of curves
        groups = [_group(name) if name else _REST for name in drawing.groups]
        mesh_faces(gmsh, replace(drawing, groups=groups), size, order=order)

    with built_on_rank_0(comm, build) as model:
        read = read_gmsh_model(comm, model)
    for message in comm.bcast(messages):
        warnings.warn(message, stacklevel=3)
    return read, {name: read.facets[_group(name)] for name in named}


def _group(interface: str) -> str:
    """The name of the physical group of an interface, which no other group has."""
    return f"interface {interface}"


def _read(source: str, outline: Any, named: Mapping[str, str | Bore], sheet: Sheet) -> Drawing:
    """The faces of an outline as a sheet says."""
    layers = sheet.layers
    if layers is not None:
        by_layer = [place for place in named.values() if isinstance(place, str)]
        layers = [*validation.names("from_outline: layers", layers), *by_layer]
    inside = None
    if sheet.inside is not None:
        inside = validation.real_array("from_outline: inside", sheet.inside, (2,))
    if sheet.gap is not None:
        validation.number("from_outline: gap", sheet.gap, least=0.0, unit="m")
    drawn = read_outline(outline, sheet.unit, layers)
    return closed_outline(source, drawn, named, inside=inside, gap=sheet.gap)


def _refuse_whole_edge(source: str, drawing: Drawing) -> None:
    """Refuse an interface, the only one of its body, that holds the outer edge of a face."""
    for face in drawing.faces:
        (name, *other_names) = {drawing.groups[i] for i, _ in face.loops[0]}
        if name and not other_names:
            raise ValueError(f"{source}: {whole_edge(name)}")


def _sides(drawing: Drawing) -> str:
    """The extent of a drawing in words."""
    return " x ".join(f"{side:.4g} m" for side in np.ptp(samples(drawing.curves), axis=0))


def _warn_of_coarse_triangles(source: str, drawing: Drawing, size: float) -> None:
    """Warn of triangles as large as a body is across, and refuse those larger than the body."""
    extent = np.ptp(samples(drawing.curves), axis=0)
    complaint = f"{source}: size = {size:.4g} m is larger than the outline of {_sides(drawing)}"
    advised = f"{0.1 * np.min(extent):.2g}"
    if size > np.max(extent):
        raise ValueError(
            f"{complaint}; give the size of the triangles in metres, {advised} or less"
        )
    if size > np.min(extent):
        why = "is across: with one triangle there it does not bend as it should"
        warnings.warn(f"{complaint} {why}; give {advised} m or less", stacklevel=2)


def read_outline(
    outline: str | Path | Any, unit: str | None, layers: Collection[str] | None = None
) -> list[Drawn]:
    """The curves [m] of a file, of rings of points (n, 2), or of polygons of shapely.

    Of a file only curves on some ``layers`` are read; None reads all.
    """
    scale = None if unit is None else UNITS[validation.choice("outline: unit", unit, UNITS)]
    if not isinstance(outline, str | Path):
        rings = [[piece * (scale or 1.0) for piece in ring] for ring in _rings(outline)]
        count = sum(len(piece) for ring in rings for piece in ring)
        remedy = "take fewer (shapely.simplify)"
        check_count("outline", count, "points", remedy, most=MOST_CURVES)
        drawn = [curve for ring in rings for curve in _curves(ring)]
        if not drawn:
            raise ValueError("outline: it is empty; give rings of at least three points")
        return drawn
    path = validation.path("outline", outline)
    if path.suffix.lower() != ".dxf":
        raise ValueError(
            f"outline {path}: give a file that ends in .dxf, or polygons; programs for vector "
            "drawings, as Inkscape, save .dxf, too"
        )
    if not path.is_file():
        raise FileNotFoundError(f"outline {path} does not exist")
    try:
        drawn = read_dxf(path, scale, layers)
    except RecursionError:
        raise ValueError(
            f"outline {path}: its blocks are nested too deeply to be read; explode them"
        ) from None
    if not drawn:
        on = "" if layers is None else f" on {', '.join(map(repr, layers))}"
        raise ValueError(
            f"outline {path}: it holds no curves that are drawn{on}; hidden ones, and those on "
            "layers that are off or frozen, do not count"
        )
    _check_numbers(path, drawn)
    return drawn


def _check_numbers(path: Path, drawn: Sequence[Drawn]) -> None:
    """Refuse coordinates that are no numbers, or beyond those that any body has."""
    with np.errstate(all="ignore"):
        points_of_curves = samples([curve.curve for curve in drawn]).reshape(len(drawn), -1)
    is_wrong = ~(np.abs(points_of_curves) < DRAWING.farthest)
    if np.any(is_wrong):
        first = int(np.argmax(np.any(is_wrong, axis=1)))
        layers = ", ".join(map(repr, sorted(drawn[first].names)))
        wrong = points_of_curves[first, is_wrong[first]]
        raise ValueError(
            f"outline {path}: a curve on {layers} has the coordinate {1e3 * wrong[0]:.3g} mm; the "
            "file is damaged there: delete the curve, or draw it anew"
        )


def _rings(outline: Any) -> list[list[Array]]:
    """The rings of polygons of shapely, of points, or of pieces; one of points is one piece."""
    if isinstance(outline, shapely.Geometry):
        return [[shapely.get_coordinates(line)] for line in shapely.get_parts(outline.boundary)]
    if isinstance(outline, np.ndarray) and outline.ndim == 2:
        outline = [outline]
    rings = validation.listed("outline", outline, "a file, or rings of points (n, 2)")
    result = []
    for ring in rings:
        pieces = isinstance(ring, list | tuple) and bool(ring) and np.ndim(ring[0]) == 2
        pieces_of_ring = [
            validation.real_array("outline: a ring", p, (None, 2)) for p in ring if pieces
        ]
        result.append(pieces_of_ring or [validation.real_array("outline: a ring", ring, (None, 2))])
    return result


def _curves(ring: list[Array]) -> list[Drawn]:
    """The sides of a ring of points that are not of length zero, or the curves of its pieces."""
    if len(ring) > 1:
        return [Drawn(_piece(points), frozenset()) for points in ring]
    points = ring[0]
    closed = points if np.array_equal(points[:1], points[-1:]) else np.vstack([points, points[:1]])
    sides = [Line(a, b) for a, b in pairwise(closed) if not np.array_equal(a, b)]
    return [Drawn(side, frozenset()) for side in sides]


def _piece(points: Array) -> Curve:
    """The line, the arc of a circle, or the spline through two, three or more points (n, 2)."""
    if len(points) < 2:
        raise ValueError("outline: a piece of a ring needs at least two points")
    if len(points) == 3:
        # the circle through the origin, a and b
        (ax, ay), (bx, by) = points[1] - points[0], points[2] - points[0]
        area = ax * by - ay * bx
        a, b = ax * ax + ay * ay, bx * bx + by * by
        if abs(area) > 1e-9 * b:
            center = points[0] + np.array([by * a - ay * b, ax * b - bx * a]) / (2.0 * area)
            start, end = (np.arctan2(*(p - center)[::-1]) for p in points[[0, 2]])
            sweep = (end - start) % (2.0 * np.pi)
            if area < 0.0:
                sweep -= 2.0 * np.pi
            return Arc(points[0], points[2], center, sweep)
    return Spline.through(points) if len(points) > 3 else Line(points[0], points[-1])


def _rimmed(
    drawing: Drawing, interfaces: Mapping[str, Predicate | Bore | str], size: float, width: float
) -> Drawing:
    """The drawing with rims along interfaces, by groups of curves and by predicates."""
    vertices = [cells_along(curve, size) for curve in drawing.curves]
    is_held = [
        np.full(len(x) - 1, bool(group)) for x, group in zip(vertices, drawing.groups, strict=True)
    ]
    points = np.vstack(vertices)
    ends = np.cumsum([len(x) for x in vertices])[:-1]
    for name, place in interfaces.items():
        if not isinstance(place, str | Bore):
            on = checked(f"interface {name!r}", place, np.vstack([points.T, np.zeros(len(points))]))
            for held_of_curve, on_curve in zip(is_held, np.split(on, ends), strict=True):
                held_of_curve |= on_curve[1:] & on_curve[:-1]
    return with_rims(drawing, vertices, is_held, width)
