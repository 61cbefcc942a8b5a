# SPDX-License-Identifier: MIT
"""Outlines of bodies: curves of files, rings or polygons, and the faces that they bound."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import shapely
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Array
from ..limits import MOST_CURVES, check_count
from ..parallel import on_rank_0
from .curves import Arc, Curve, Drawn, Line, Spline, enclosed, polygon
from .dxf_file import read_dxf
from .interface import Predicate, checked
from .mesh_checks import connected
from .mesh_file import TaggedMesh, read_gmsh_model
from .plane_mesh import (
    Drawing,
    Face,
    cells_along,
    check_size,
    gmsh_model,
    mesh_faces,
    walked,
)
from .rims import with_rims
from .svg_file import read_svg

#: Units of drawings [m]
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
_READERS = {".dxf": read_dxf, ".svg": read_svg}
#: Name of the curves that are in no other group
_REST = "outline"
#: Ends nearer to each other than this are one, in units of the drawing's extent
JOINED = 1e-6
#: Accuracy of the polygons by which crossings are found, in units of the drawing's extent
_FINE = 1e-4
#: Least width of a rim, in sizes of triangles
_THINNEST = 0.5


def mesh_outline(
    comm: MPI.Comm,
    outline: Any,
    interfaces: Mapping[str, Predicate | str],
    size: float,
    unit: str | None,
    order: int,
    rim: float = 0.0,
) -> TaggedMesh:
    """A mesh of triangles within a closed outline, see `Domain.from_outline`; collective.

    Cells within the width ``rim`` [m] of interfaces, whether predicates or names of curves tell
    them, are the physical surface "solid"; their boundary is the offset curve of the interface.
    """
    validation.instance("from_outline: comm", comm, MPI.Comm, "an MPI communicator")
    validation.number("from_outline: size", size, above=0.0, unit="m")
    if rim:
        validation.number("domain: solid_rim", rim, least=_THINNEST * size, unit="m")
    named = [where for where in interfaces.values() if isinstance(where, str)]
    source = f"outline {outline}" if isinstance(outline, str | Path) else "outline"
    gmsh = None
    with ExitStack() as stack:

        def build() -> str:
            nonlocal gmsh
            drawing = closed_outline(source, read_outline(outline, unit), named)
            if rim > 0.0:
                drawing = _rimmed(drawing, interfaces, size, rim)
            check_size(source, drawing, size)
            coarse = _coarse(source, drawing, size)
            gmsh = stack.enter_context(gmsh_model())
            # gmsh's file needs a physical group of curves
            groups = [group or _REST for group in drawing.groups]
            mesh_faces(gmsh, replace(drawing, groups=groups), size, order=order)
            return coarse

        coarse = on_rank_0(comm, build)
        if coarse:
            warnings.warn(coarse, stacklevel=3)
        return read_gmsh_model(comm, gmsh.model if gmsh is not None else None)


def _coarse(source: str, drawing: Drawing, size: float) -> str:
    """A warning of triangles as large as a body across, "" if they are smaller; or an error."""
    extent = np.ptp(_samples(drawing.curves), axis=0)
    sides = " x ".join(f"{side:.4g} m" for side in extent)
    what = f"{source}: size = {size:.4g} m is larger than the outline of {sides}"
    advised = f"{0.1 * np.min(extent):.2g}"
    if size > np.max(extent):
        raise ValueError(f"{what}; give the size of the triangles in metres, {advised} or less")
    why = f" is across: with one triangle there it does not bend as it should; give {advised} m"
    return f"{what}{why} or less" if size > np.min(extent) else ""


def _samples(curves: Sequence[Curve]) -> Array:
    """Five points of each curve, one after the other, shape (n, 2) [m]."""
    return np.concatenate([curve.at(np.linspace(0.0, 1.0, 5)) for curve in curves])


def read_outline(outline: str | Path | Any, unit: str | None) -> list[Drawn]:
    """The curves [m] of a file, of rings of points (n, 2), or of polygons of shapely."""
    scale = None if unit is None else UNITS[validation.choice("outline: unit", unit, UNITS)]
    if not isinstance(outline, str | Path):
        rings = [[piece * (scale or 1.0) for piece in ring] for ring in _rings(outline)]
        count = sum(len(piece) for ring in rings for piece in ring)
        remedy = "take fewer (shapely.simplify)"
        check_count("outline", count, "points", remedy, most=MOST_CURVES)
        found = [each for ring in rings for each in _curves(ring)]
        if not found:
            raise ValueError("outline: it is empty; give rings of at least three points")
        return found
    path = Path(outline)
    if path.suffix.lower() not in _READERS:
        raise ValueError(f"outline {path}: give a file that ends in .dxf or .svg, or polygons")
    if not path.is_file():
        raise FileNotFoundError(f"outline {path} does not exist")
    try:
        found = _READERS[path.suffix.lower()](path, scale)
    except RecursionError:
        raise ValueError(
            f"outline {path}: its groups or blocks are nested too deeply to be read; ungroup them"
        ) from None
    if not found:
        raise ValueError(
            f"outline {path}: it holds no curves that are drawn; hidden ones, and those on layers "
            "that are off or frozen, do not count"
        )
    return found


def _rings(outline: Any) -> list[list[Array]]:
    """The rings of polygons of shapely, of points, or of pieces; one of points is one piece."""
    if isinstance(outline, shapely.Geometry):
        return [[shapely.get_coordinates(line)] for line in shapely.get_parts(outline.boundary)]
    if isinstance(outline, np.ndarray) and outline.ndim == 2:
        outline = [outline]
    rings = validation.listed("outline", outline, "a file, or rings of points (n, 2)")
    found = []
    for ring in rings:
        pieces = isinstance(ring, list | tuple) and bool(ring) and np.ndim(ring[0]) == 2
        parts = [validation.real_array("outline: a ring", p, (None, 2)) for p in ring if pieces]
        found.append(parts or [validation.real_array("outline: a ring", ring, (None, 2))])
    return found


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
        (ax, ay), (bx, by) = points[1] - points[0], points[2] - points[0]
        area = ax * by - ay * bx
        if abs(area) > 1e-9 * (bx * bx + by * by):
            a, b = ax * ax + ay * ay, bx * bx + by * by
            center = points[0] + np.array([by * a - ay * b, ax * b - bx * a]) / (2.0 * area)
            start, end = (np.arctan2(*(p - center)[::-1]) for p in points[[0, 2]])
            sweep = (end - start) % (2.0 * np.pi)
            return Arc(points[0], points[2], center, sweep - (2.0 * np.pi if area < 0.0 else 0.0))
    return Spline.through(points) if len(points) > 3 else Line(points[0], points[-1])


def closed_outline(source: str, drawn: Sequence[Drawn], named: Collection[str]) -> Drawing:
    """The faces that closed curves bound, each curve once: outer loops, holes, islands in holes."""
    known = frozenset[str]().union(*(each.names for each in drawn))
    missing = [name for name in named if name not in known]
    if missing:
        raise ValueError(
            f"{source}: no curve has the name {', '.join(map(repr, missing))}; its layers, ids and "
            f"labels are {sorted(known) or 'none'}"
        )
    extent = float(np.max(np.ptp(_samples([each.curve for each in drawn]), axis=0)))
    near = JOINED * extent
    once = _once([each for each in drawn if each.curve.length > near], near)
    curves, nodes = _joined([each.curve for each in once], near)
    groups = [next((name for name in named if name in each.names), "") for each in once]
    _refuse_open(source, curves, nodes)
    faces = _faces(source, curves, _loops(nodes), _FINE * extent)
    return Drawing(curves, nodes, groups, faces)


def _rimmed(
    drawing: Drawing, interfaces: Mapping[str, Predicate | str], size: float, width: float
) -> Drawing:
    """The drawing with rims along interfaces, which predicates or names of curves tell."""
    names = [where for where in interfaces.values() if isinstance(where, str)]
    vertices = [cells_along(curve, size) for curve in drawing.curves]
    held = [np.full(len(x) - 1, g in names) for x, g in zip(vertices, drawing.groups, strict=True)]
    points = np.vstack(vertices)
    ends = np.cumsum([len(x) for x in vertices])[:-1]
    for name, where in interfaces.items():
        if not isinstance(where, str):
            on = checked(f"interface {name!r}", where, np.vstack([points.T, np.zeros(len(points))]))
            for of, own in zip(held, np.split(on, ends), strict=True):
                of |= own[1:] & own[:-1]
    return with_rims(drawing, vertices, held, width)


def _once(drawn: Sequence[Drawn], near: float) -> list[Drawn]:
    """Curves without those that lie on others, whose names go to these."""
    marks = _samples([each.curve for each in drawn]).reshape(-1, 5, 2)
    tree = cKDTree(marks[:, 2])
    found: list[Drawn | None] = list(drawn)
    for i, j in sorted(tree.query_pairs(2.0 * near)):
        one, other = found[i], found[j]
        if one is None or other is None:
            continue
        gaps = [np.max(np.abs(marks[i] - mark)) for mark in (marks[j], marks[j][::-1])]
        if min(gaps) < 2.0 * near:
            found[i], found[j] = replace(one, names=one.names | other.names), None
    return [each for each in found if each is not None]


def _joined(curves: Sequence[Curve], near: float) -> tuple[list[Curve], list[tuple[int, int]]]:
    """The curves with common ends, and the numbers of the ends."""
    ends = np.array([end for curve in curves for end in (curve.start, curve.end)])
    pairs = cKDTree(ends).query_pairs(near, output_type="ndarray").reshape(-1, 2)
    label = connected(pairs, len(ends))
    positions = ends[np.unique(label, return_index=True)[1]]
    nodes = [(a, b) for a, b in label.reshape(-1, 2).tolist()]
    found = [c.moved(*positions[[*ns]]) for c, ns in zip(curves, nodes, strict=True)]
    return found, nodes


def _refuse_open(source: str, curves: Sequence[Curve], nodes: Sequence[tuple[int, int]]) -> None:
    counts = np.bincount(np.array(nodes).ravel())
    where = {}
    for curve, (start, end) in zip(curves, nodes, strict=True):
        where[start], where[end] = curve.start, curve.end
    loose = np.array([where[n] for n in where if counts[n] == 1])
    if len(loose):
        gap = ""
        if len(loose) > 1:
            distance = float(cKDTree(loose).query(loose[0], k=2)[0][1])
            gap = f", {1e3 * distance:.3g} mm from the nearest other end"
        raise ValueError(
            f"{source}: the outline is open: {len(loose)} curves end where no other begins, the "
            f"first at {_point(loose[0])}{gap}; close it"
        )
    several = [n for n in where if counts[n] > 2]
    if several:
        raise ValueError(
            f"{source}: {counts[several[0]]} curves meet at {_point(where[several[0]])}, where an "
            "outline has two; delete what is no outline, as inner lines and axes"
        )


def _loops(nodes: Sequence[tuple[int, int]]) -> list[list[tuple[int, bool]]]:
    """Closed loops: numbers of the curves, and whether each is walked forward."""
    at: dict[int, list[int]] = {}
    for i, pair in enumerate(nodes):
        for node in pair:
            at.setdefault(node, []).append(i)
    left, found = set(range(len(nodes))), []
    for here, (node, _) in enumerate(nodes):
        loop = []
        while here in left:
            left.discard(here)
            forward = nodes[here][0] == node
            loop.append((here, forward))
            node = nodes[here][1 if forward else 0]
            here = next((i for i in at[node] if i in left), -1)
        found += [loop] if loop else []
    return found


def _faces(
    source: str, curves: Sequence[Curve], loops: list[list[tuple[int, bool]]], fine: float
) -> list[Face]:
    """Loops at even depth with the holes right in them, all with the face on the left."""
    directed = [walked(curves, loop) for loop in loops]
    shapes = [_shape(source, polygon(loop, fine)) for loop in directed]
    rings = [shape.exterior for shape in shapes]
    for i, j in shapely.STRtree(rings).query(rings, predicate="intersects").T:
        if i != j:
            where = shapely.get_coordinates(rings[i].intersection(rings[j]))[0]
            raise ValueError(
                f"{source}: two closed curves of the outline cross or touch at "
                f"{_point(where)}; trim them to one boundary"
            )
    inner, outer = shapely.STRtree(shapes).query(shapes, predicate="within")
    other = inner != outer
    depth = np.bincount(inner[other], minlength=len(shapes))
    holes: dict[int, list[int]] = {i: [] for i in range(len(shapes)) if depth[i] % 2 == 0}
    for j, i in zip(inner[other], outer[other], strict=True):
        if i in holes and depth[j] == depth[i] + 1:
            holes[i].append(j)

    def turned(i: int, hole: bool) -> list[tuple[int, bool]]:
        """A loop counterclockwise, or clockwise around a hole."""
        if (enclosed(directed[i])[0] > 0.0) != hole:
            return loops[i]
        return [(curve, not forward) for curve, forward in reversed(loops[i])]

    return [
        Face("design", [turned(i, False), *(turned(j, True) for j in sorted(inside))])
        for i, inside in holes.items()
    ]


def _shape(source: str, ring: Array) -> shapely.Polygon:
    """The polygon within a ring, which must not cross itself."""
    shape = shapely.Polygon(ring) if len(ring) > 2 else shapely.Polygon()
    fault = "has a closed curve without area" if shape.is_empty else ""
    if not fault and not shape.is_valid:
        reason = shapely.is_valid_reason(shape)  # "Self-intersection[x y]"
        numbers = reason.partition("[")[2].strip("]").split()
        where = _point(np.array(numbers, dtype=float)) if len(numbers) == 2 else reason
        fault = f"crosses itself at {where}"
    if fault:
        raise ValueError(f"{source}: the outline {fault}; repair it in the drawing")
    return shape


def _point(where: Array) -> str:
    return f"({1e3 * where[0]:.6g}, {1e3 * where[1]:.6g}) mm"
