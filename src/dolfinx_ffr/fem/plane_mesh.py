# SPDX-License-Identifier: MIT
"""Faces between curves in the plane, handed to gmsh: to be meshed, or written for CAD programs.

Curves go to gmsh's OpenCASCADE kernel as what they are, lines, arcs and B-splines, so that cells of
order 2 fit them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .curves import Arc, Curve, Line, Spline, enclosed

__all__ = ["Drawing", "Face", "gmsh_model", "mesh_faces", "quiet", "surfaces"]

Array = NDArray[np.float64]

_numbers = count()
#: Smallest Jacobian determinant of a curved cell, in units of that of the straight one
_FLATTEST = 0.2
#: How often cells next to straightened ones are looked at again
_ROUNDS = 10


@dataclass(frozen=True)
class Face:
    """A connected region of a drawing."""

    group: str  #: Name of its physical surface
    #: Curves of each loop, in turn, the outer loop first: number, and whether it is walked forward
    loops: Sequence[Sequence[tuple[int, bool]]]


@dataclass(frozen=True, eq=False)
class Drawing:
    """Curves that meet in common ends, and the faces between them."""

    curves: Sequence[Curve]
    nodes: Sequence[tuple[int, int]]  #: Numbers of the ends; curves that meet share them
    groups: Sequence[str]  #: Name of the physical curve of each, "" where it is in none
    faces: Sequence[Face]


@contextmanager
def gmsh_model() -> Iterator[Any]:
    """Give gmsh with a new model, and leave it as it was.

    Raises:
        ImportError: If gmsh's Python module is missing.
    """
    try:
        import gmsh
    except ImportError as error:
        raise ImportError(
            "meshes of outlines and parts need gmsh's Python module (Debian: python3-gmsh)"
        ) from error
    running = _is_running(gmsh)
    if not running:
        gmsh.initialize()
    before = gmsh.model.getCurrent()
    terminal = gmsh.option.getNumber("General.Terminal")
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        gmsh.model.add(f"dolfinx_ffr {next(_numbers)}")
        yield gmsh
    finally:
        if running:
            gmsh.model.remove()
            gmsh.model.setCurrent(before)
            gmsh.option.setNumber("General.Terminal", terminal)
        else:
            gmsh.finalize()


def _is_running(gmsh: Any) -> bool:
    """Whether someone has initialised gmsh; older releases do not tell, but print an error."""
    if hasattr(gmsh, "isInitialized"):
        return bool(gmsh.isInitialized())
    try:
        with quiet():
            return bool(gmsh.option.getNumber("Mesh.Algorithm") > 0.0)
    except Exception:  # gmsh raises nothing more precise
        return False


@contextmanager
def quiet() -> Iterator[None]:
    """Keep a library from printing, as OpenCASCADE does where it writes."""
    sys.stdout.flush()
    kept = [os.dup(stream) for stream in (1, 2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for stream in (1, 2):
            os.dup2(nowhere, stream)
        yield
    finally:
        for stream, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
        os.close(nowhere)


def surfaces(gmsh: Any, drawing: Drawing, scale: float = 1.0) -> tuple[list[int], list[list[int]]]:
    """Make the faces of a drawing in gmsh's current model.

    Args:
        gmsh: The module.
        drawing: Curves and faces.
        scale: Factor from metres to the unit of the model.

    Returns:
        The surface of each face, and the curves of each curve of the drawing.
    """
    occ = gmsh.model.occ
    known: dict[int, int] = {}

    def point(where: Array, node: int | None = None) -> int:
        if node is not None and node in known:
            return known[node]
        tag = int(occ.addPoint(scale * where[0], scale * where[1], 0.0))
        if node is not None:
            known[node] = tag
        return tag

    turned, first = _directions(drawing)
    tags: list[list[int]] = []
    for i, nodes in enumerate(drawing.nodes):
        pieces = _pieces(drawing.curves[i].reversed() if turned[i] else drawing.curves[i])
        begin, end = nodes[::-1] if turned[i] else nodes
        ends = [point(pieces[0].start, begin)]
        ends += [point(piece.end) for piece in pieces[:-1]]
        ends += [point(pieces[-1].end, end)]
        tags.append([_add(occ, piece, ends[k : k + 2], point) for k, piece in enumerate(pieces)])
    found = []
    for f, face in enumerate(drawing.faces):
        around = []
        for n, loop in enumerate(face.loops):
            signed = []
            for i, forward in [*loop[first[f, n] :], *loop[: first[f, n]]]:
                along = forward != turned[i]
                signed += tags[i] if along else [-tag for tag in tags[i][::-1]]
            around.append(occ.addCurveLoop(signed))
        found.append(int(occ.addPlaneSurface(around)))
    occ.synchronize()
    return found, tags


def _directions(drawing: Drawing) -> tuple[list[bool], dict[tuple[int, int], int]]:
    """Which curves are made from their end to their start, and with which one each loop begins.

    Its first curve gives a loop of OpenCASCADE its direction, which must be counterclockwise, also
    around holes.
    """
    turned, settled = [False] * len(drawing.curves), set()
    first = {}
    numbered = [(f, n) for f, face in enumerate(drawing.faces) for n in range(len(face.loops))]
    for f, n in sorted(numbered, key=lambda at: len(drawing.faces[at[0]].loops[at[1]])):
        loop = drawing.faces[f].loops[n]
        fits = [(forward == (n == 0)) != turned[i] for i, forward in loop]
        free = [k for k, (i, _) in enumerate(loop) if fits[k] or i not in settled]
        # a curve that belongs to two short loops has one of them on each side, or both on one
        chosen = next((k for k in free if fits[k]), free[0] if free else 0)
        i = loop[chosen][0]
        turned[i] = turned[i] != (not fits[chosen])
        settled.add(i)
        first[f, n] = chosen
    return turned, first


def _pieces(curve: Curve) -> Sequence[Curve]:
    """The curve in as many parts as OpenCASCADE takes for sure."""
    if isinstance(curve, Arc):
        return curve.pieces()
    if isinstance(curve, Spline) and np.array_equal(curve.start, curve.end):
        return curve.halves()
    return [curve]


def _add(occ: Any, curve: Curve, ends: list[int], point: Callable[[Array], int]) -> int:
    if isinstance(curve, Line):
        return int(occ.addLine(*ends))
    if isinstance(curve, Arc):
        return int(occ.addCircleArc(ends[0], point(curve.center), ends[1]))
    assert isinstance(curve, Spline)
    inner = [point(where) for where in curve.control[1:-1]]
    knots, multiplicities = np.unique(curve.knots, return_counts=True)
    return int(
        occ.addBSpline(
            [ends[0], *inner, ends[1]],
            degree=curve.degree,
            knots=knots.tolist(),
            multiplicities=multiplicities.tolist(),
        )
    )


def _bend(model: Any) -> None:
    """Curve the cells at curves to order 2, but for those that would fold, as in tips of cusps."""
    model.mesh.setOrder(2)
    kind = model.mesh.getElementType("Triangle", 2)
    _, nodes = model.mesh.getElementsByType(kind)
    nodes = np.asarray(nodes, dtype=np.int64).reshape(-1, 6)
    tags, positions, _ = model.mesh.getNodes()
    x = np.zeros((int(np.max(tags)) + 1, 3))
    x[np.asarray(tags, dtype=np.int64)] = np.reshape(positions, (-1, 3))
    moved: set[int] = set()
    for _ in range(_ROUNDS):
        folded = _flattest(x[nodes][:, :, :2]) < _FLATTEST
        if not np.any(folded):
            break
        for i in range(3):
            middle = nodes[folded, 3 + i]
            x[middle] = 0.5 * (x[nodes[folded, i]] + x[nodes[folded, (i + 1) % 3]])
            moved.update(middle.tolist())
    for node in sorted(moved):
        model.mesh.setNode(node, x[node].tolist(), [])


def _flattest(x: Array) -> Array:
    """The smallest Jacobian determinant of triangles of order 2, in units of the straight one's.

    Args:
        x: Corners and middles of the sides, shape (cells, 6, 2).
    """
    corners = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5], [1 / 3, 1 / 3]])
    least = np.full(len(x), np.inf)
    for r, s in corners:
        t = 1.0 - r - s
        by_r = np.array([1 - 4 * t, 4 * r - 1, 0.0, 4 * (t - r), 4 * s, -4 * s])
        by_s = np.array([1 - 4 * t, 0.0, 4 * s - 1, -4 * r, 4 * r, 4 * (t - s)])
        a, b = by_r @ x, by_s @ x
        least = np.minimum(least, a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    e, f = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
    return np.asarray(least / (e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]))


def mesh_faces(
    gmsh: Any,
    drawing: Drawing,
    size: float,
    *,
    order: int = 1,
    local: Callable[[float, float], float] | None = None,
) -> None:
    """Mesh a drawing by triangles in gmsh's current model, with its physical groups.

    Args:
        gmsh: The module.
        drawing: Curves and faces.
        size: Of the triangles [m].
        order: Of their geometry, 1 or 2; cells that would fold, as in cusps, stay straight.
        local: Largest size at a place (x, y) [m], where it must be smaller.

    Raises:
        ValueError: If gmsh cannot mesh it.
    """
    found, tags = surfaces(gmsh, drawing)
    model = gmsh.model
    for group in dict.fromkeys(face.group for face in drawing.faces):
        members = [s for s, face in zip(found, drawing.faces, strict=True) if face.group == group]
        model.setPhysicalName(2, model.addPhysicalGroup(2, members), group)
    for group in dict.fromkeys(name for name in drawing.groups if name):
        chosen = [ts for ts, name in zip(tags, drawing.groups, strict=True) if name == group]
        members = [tag for ts in chosen for tag in ts]
        model.setPhysicalName(1, model.addPhysicalGroup(1, members), group)
    options = {
        "Mesh.MeshSizeMin": 0.0,
        "Mesh.MeshSizeMax": size,
        "Mesh.MeshSizeFromPoints": 0,
        "Mesh.MeshSizeExtendFromBoundary": 0,
        # along curves sizes are integrated to more digits than counts of cells need
        "Mesh.LcIntegrationPrecision": 1e-3,
        # an error would be thrown within a parallel loop of gmsh, which ends the program
        "General.AbortOnError": 0,
    }
    before = {name: gmsh.option.getNumber(name) for name in options}
    try:
        for name, value in options.items():
            gmsh.option.setNumber(name, value)
        if local is not None:
            # releases hand on different numbers of arguments: dimension, tag, x, y, z, size
            model.mesh.setSizeCallback(lambda *at: min(size, local(at[2], at[3])))
        with quiet():
            model.mesh.generate(2)
        _refuse_unmeshed(model, drawing, found, size)
        if order > 1:
            _bend(model)
    finally:
        for name, value in before.items():
            gmsh.option.setNumber(name, value)


def _refuse_unmeshed(model: Any, drawing: Drawing, found: Sequence[int], size: float) -> None:
    """Refuse a mesh that does not fill the faces, as gmsh leaves it where it fails."""
    tags, positions, _ = model.mesh.getNodes()
    x = np.zeros((int(np.max(tags, initial=0)) + 1, 2))
    x[np.asarray(tags, dtype=np.int64)] = np.reshape(positions, (-1, 3))[:, :2]
    for surface, face in zip(found, drawing.faces, strict=True):
        _, nodes = model.mesh.getElementsByType(2, surface)
        a, b, c = np.moveaxis(x[np.asarray(nodes, dtype=np.int64).reshape(-1, 3)], 1, 0)
        e, f = b - a, c - a
        covered = 0.5 * float(np.sum(np.abs(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0])))
        curves = [
            drawing.curves[i] if forward else drawing.curves[i].reversed()
            for loop in face.loops
            for i, forward in loop
        ]
        whole = float(enclosed(curves)[0])
        around = sum(curve.length for curve in curves)
        # chords of curves leave out, or add, less than a quarter of their length along them
        if abs(covered - whole) > 1e-6 * whole + 0.25 * size * around or not len(a):
            raise ValueError(
                f"gmsh cannot mesh the outline by triangles of {size:.4g} m; give a smaller size, "
                "or look for parts of the outline that almost touch"
            )
