# SPDX-License-Identifier: MIT
"""Closed outlines out of loose curves: what bounds a body, and what is wrong with a drawing."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from .. import validation
from ..parallel import on_rank_0
from .curves import Arc, Curve, Line, Spline, enclosed, polygon
from .mesh_file import TaggedMesh, read_gmsh_model
from .outline_file import Drawn, read_outline
from .plane_mesh import Drawing, Face, gmsh_model, mesh_faces

__all__ = ["closed_outline", "mesh_outline"]

Array = NDArray[np.float64]

#: Name of the curves that are in no other group
_REST = "outline"
#: Ends nearer to each other than this are one, in units of the drawing's extent
JOINED = 1e-6
#: Accuracy of the polygons by which crossings are found, in units of the drawing's extent
_FINE = 1e-4


def mesh_outline(
    comm: MPI.Comm, outline: Any, named: Sequence[str], size: float, unit: str | None, order: int
) -> TaggedMesh:
    """A mesh of triangles within a closed outline; collective.

    Args:
        comm: Communicator over which the mesh is distributed; rank 0 reads and meshes.
        outline: As for `read_outline`.
        named: Names of curves that become physical curves.
        size: Of the triangles [m].
        unit: As for `read_outline`.
        order: Of the geometry.

    Raises:
        ValueError: On every rank, as for `Domain.from_outline`.
    """
    validation.instance("from_outline: comm", comm, MPI.Comm, "an MPI communicator")
    validation.number("from_outline: size", size, above=0.0, unit="m")
    source = f"outline {outline}" if isinstance(outline, str | Path) else "outline"
    with gmsh_model() if comm.rank == 0 else nullcontext() as gmsh:

        def build() -> None:
            drawing = closed_outline(source, read_outline(outline, unit), named)
            # gmsh's file needs a physical group of curves
            groups = [group or _REST for group in drawing.groups]
            mesh_faces(gmsh, replace(drawing, groups=groups), size, order=order)

        on_rank_0(comm, build)
        return read_gmsh_model(comm, gmsh.model if gmsh is not None else None)


def closed_outline(source: str, drawn: Sequence[Drawn], named: Collection[str]) -> Drawing:
    """The faces that closed curves bound: outer loops, holes in them, islands in the holes.

    Args:
        source: What error messages call the drawing.
        drawn: Its curves; one that is drawn twice counts once, with the names of both.
        named: Names of interfaces among those of the curves.

    Raises:
        ValueError: If curves are open, cross or touch, or a name is not there.
    """
    known = set().union(*(each.names for each in drawn)) if drawn else set()
    missing = [name for name in named if name not in known]
    if missing:
        raise ValueError(
            f"{source}: no curve has the name {', '.join(map(repr, missing))}; its layers, ids and "
            f"labels are {sorted(known) or 'none'}"
        )
    points = np.vstack([each.curve.at(np.linspace(0.0, 1.0, 5)) for each in drawn])
    extent = float(np.max(np.ptp(points, axis=0)))
    near = JOINED * extent
    once = _once([each for each in drawn if each.curve.length > near], near)
    curves, nodes = _joined(source, [each.curve for each in once], near)
    groups = [next((name for name in named if name in each.names), "") for each in once]
    _refuse_open(source, curves, nodes)
    loops = _loops(nodes)
    faces = _faces(source, curves, loops, _FINE * extent)
    return Drawing(curves, nodes, groups, faces)


def _once(drawn: Sequence[Drawn], near: float) -> list[Drawn]:
    """Curves without those that lie on others, whose names go to these."""
    t = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    marks = [each.curve.at(t) for each in drawn]
    tree = cKDTree(np.array([mark[2] for mark in marks]))
    found: list[Drawn | None] = list(drawn)
    for i, j in sorted(tree.query_pairs(2.0 * near)):
        one, other = found[i], found[j]
        if one is None or other is None:
            continue
        gaps = [np.max(np.abs(marks[i] - mark)) for mark in (marks[j], marks[j][::-1])]
        if min(gaps) < 2.0 * near:
            found[i], found[j] = replace(one, names=one.names | other.names), None
    return [each for each in found if each is not None]


def _joined(
    source: str, curves: Sequence[Curve], near: float
) -> tuple[list[Curve], list[tuple[int, int]]]:
    """The curves with common ends, and the numbers of the ends."""
    ends = np.array([end for curve in curves for end in (curve.start, curve.end)])
    pairs = cKDTree(ends).query_pairs(near, output_type="ndarray").reshape(-1, 2)
    ones = np.ones(len(pairs), dtype=bool)
    graph = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(ends), len(ends)))
    label = connected_components(graph, directed=False)[1]
    first = np.unique(label, return_index=True)[1]
    found, nodes = [], []
    for i, curve in enumerate(curves):
        a, b = label[2 * i], label[2 * i + 1]
        found.append(_between(curve, ends[first[a]], ends[first[b]]))
        nodes.append((int(a), int(b)))
    return found, nodes


def _between(curve: Curve, start: Array, end: Array) -> Curve:
    """A curve moved a little, so that it begins and ends in given points."""
    if isinstance(curve, Line):
        return Line(start, end)
    if isinstance(curve, Spline):
        control = np.array(curve.control)
        control[0], control[-1] = start, end
        return Spline(curve.knots, control, curve.degree)
    assert isinstance(curve, Arc)
    if np.array_equal(start, end):
        return Arc(start, end, curve.center + start - curve.start, curve.sweep)
    # the circle through both ends on which they are as far apart as before
    half = 0.5 * (end - start)
    away = np.array([-half[1], half[0]]) / np.tan(0.5 * curve.sweep)
    return Arc(start, end, start + half + away, curve.sweep)


def _refuse_open(source: str, curves: Sequence[Curve], nodes: Sequence[tuple[int, int]]) -> None:
    counts = np.bincount(np.array(nodes).ravel())
    where = {
        n: p
        for c, ns in zip(curves, nodes, strict=True)
        for n, p in zip(ns, (c.start, c.end), strict=True)
    }
    loose = [n for n in where if counts[n] == 1]
    if loose:
        ends = np.array([where[n] for n in loose])
        gap = ""
        if len(ends) > 1:
            distance = float(cKDTree(ends).query(ends[0], k=2)[0][1])
            gap = f", {1e3 * distance:.3g} mm from the nearest other end"
        raise ValueError(
            f"{source}: the outline is open: {len(loose)} curves end where no other begins, the "
            f"first at {_point(ends[0])}{gap}; close it"
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
    for first in range(len(nodes)):
        if first not in left:
            continue
        loop, here = [], first
        node = nodes[first][0]
        while here in left:
            left.discard(here)
            forward = nodes[here][0] == node
            loop.append((here, forward))
            node = nodes[here][1 if forward else 0]
            here = next((i for i in at[node] if i in left), -1)
        found.append(loop)
    return found


def _faces(
    source: str, curves: Sequence[Curve], loops: list[list[tuple[int, bool]]], fine: float
) -> list[Face]:
    """Loops at even depth with the holes right in them, all with the face on the left."""
    directed = [[_way(curves[i], forward) for i, forward in loop] for loop in loops]
    shapes = []
    for loop in directed:
        ring = polygon(loop, fine)
        shape = shapely.Polygon(ring) if len(ring) > 2 else shapely.Polygon()
        if not shape.is_valid or shape.is_empty:
            raise ValueError(f"{source}: the outline {_fault(shape)}; repair it in the drawing")
        shapes.append(shape)
    for i, one in enumerate(shapes):
        for j in shapely.STRtree(shapes).query(one.exterior, predicate="intersects"):
            crossing = one.exterior.intersection(shapes[j].exterior) if j != i else None
            if crossing is not None and not crossing.is_empty:
                where = shapely.get_coordinates(crossing)[0]
                raise ValueError(
                    f"{source}: two closed curves of the outline cross or touch at "
                    f"{_point(where)}; trim them to one boundary"
                )
    # each contains itself
    depth = [sum(other.contains(one) for other in shapes) - 1 for one in shapes]
    faces = []
    for i, outer in enumerate(shapes):
        if depth[i] % 2:
            continue
        holes = [j for j in range(len(shapes)) if depth[j] == depth[i] + 1]
        inside = [i, *(j for j in holes if outer.contains(shapes[j]))]
        faces.append(Face("design", [_turned(loops[j], directed[j], hole=j != i) for j in inside]))
    return faces


def _way(curve: Curve, forward: bool) -> Curve:
    return curve if forward else curve.reversed()


def _turned(
    loop: list[tuple[int, bool]], curves: list[Curve], *, hole: bool
) -> list[tuple[int, bool]]:
    """A loop counterclockwise, or clockwise around a hole."""
    if (enclosed(curves)[0] > 0.0) != hole:
        return loop
    return [(i, not forward) for i, forward in reversed(loop)]


def _fault(shape: shapely.Polygon) -> str:
    if shape.is_empty:
        return "has a closed curve without area"
    reason = shapely.is_valid_reason(shape)  # "Self-intersection[x y]"
    numbers = reason.partition("[")[2].strip("]").split()
    where = _point(np.array(numbers, dtype=float)) if len(numbers) == 2 else reason
    return f"crosses itself at {where}"


def _point(where: Array) -> str:
    return f"({1e3 * where[0]:.6g}, {1e3 * where[1]:.6g}) mm"
