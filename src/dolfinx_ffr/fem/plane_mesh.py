# SPDX-License-Identifier: MIT
"""Faces between curves in the plane, handed to gmsh: to be meshed, or written for CAD programs.

For CAD programs curves go to gmsh's OpenCASCADE kernel as what they are: lines, arcs and B-splines.
To be meshed they go to gmsh as polygons with vertices on them, between which it meshes ten times as
fast; middles of the sides of cells of order 2 are put on the curves afterwards.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import count, pairwise
from typing import Any

from mpi4py import MPI

import numpy as np
import shapely
from scipy.spatial import cKDTree

from ..arrays import Array
from ..limits import MOST_CELLS, MOST_CURVES, check_count
from ..parallel import on_every_rank
from .curves import Arc, Curve, CurveError, Line, Spline
from .drawing import Drawing
from .polylines import turns

_numbers = count()


@dataclass(frozen=True)
class MeshingOptions:
    """Cells along curves, and sizes of triangles beside narrow members."""

    turn: float = 0.8  #: Largest turn of a curve along one cell [rad]
    #: Largest turn of an arc, fine enough to find the arc again in a mesh of straight cells [rad]
    turn_of_arcs: float = 0.6
    points: int = 16  #: Points along a curve for each of its breaks, by which its turn is known
    flattest: float = 0.2  #: Smallest Jacobian determinant of a curved cell over the straight one's
    rounds: int = 10  #: How often cells next to straightened ones are looked at again
    growth: float = 0.3  #: Growth of sizes by the distance from a narrow member [m/m]
    nearest: int = 8  #: Narrow members that are looked at for the size of a triangle
    memory: int = 800  #: That gmsh takes for a triangle, at least [bytes]


MESHING = MeshingOptions()


@contextmanager
def gmsh_model() -> Iterator[Any]:
    """Give gmsh with a new model, and leave it as it was."""
    try:
        import gmsh
    except ImportError as error:
        raise ImportError("gmsh's Python module is missing (Debian: python3-gmsh)") from error
    with ExitStack() as stack:
        if not _is_running(gmsh):
            # Options in the home directory, or where there is none in that of temporary files, are
            # programs in gmsh's language, and would change the meshes.
            gmsh.initialize(readConfigFiles=False)
            stack.callback(gmsh.finalize)
        stack.callback(gmsh.model.setCurrent, gmsh.model.getCurrent())
        stack.enter_context(gmsh_options(gmsh, {"General.Terminal": 0}))
        gmsh.model.add(f"dolfinx_ffr {next(_numbers)}")
        stack.callback(gmsh.model.remove)
        yield gmsh


@contextmanager
def gmsh_options(gmsh: Any, options: Mapping[str, float]) -> Iterator[None]:
    """Set numbers among gmsh's options, and leave them as they were."""
    with ExitStack() as stack:
        for name, value in options.items():
            stack.callback(gmsh.option.setNumber, name, gmsh.option.getNumber(name))
            gmsh.option.setNumber(name, value)
        yield


@contextmanager
def built_on_rank_0(comm: MPI.Comm, build: Callable[[Any], None]) -> Iterator[Any]:
    """Give gmsh's model after ``build``, a function of gmsh, on rank 0, and None on the others."""
    with ExitStack() as stack:
        model = None
        with on_every_rank(comm, "a mesh by gmsh"):
            if comm.rank == 0:
                gmsh = stack.enter_context(gmsh_model())
                build(gmsh)
                model = gmsh.model
        yield model


def _is_running(gmsh: Any) -> bool:
    """Whether someone has initialised gmsh; older releases only print an error."""
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
    with open(os.devnull, "wb") as nowhere, ExitStack() as stack:
        for stream in (1, 2):
            copy = os.dup(stream)
            stack.callback(os.close, copy)
            stack.callback(os.dup2, copy, stream)
            os.dup2(nowhere.fileno(), stream)
        yield


def surfaces(gmsh: Any, drawing: Drawing, scale: float = 1.0) -> tuple[list[int], list[list[int]]]:
    """Make a drawing, times ``scale``, in gmsh: a surface of each face, curves of each curve."""
    occ = gmsh.model.occ
    point_tags: dict[int, int] = {}

    def point(position: Array, node: int | None = None) -> int:
        if node is None:
            return int(occ.addPoint(scale * position[0], scale * position[1], 0.0))
        if node not in point_tags:
            point_tags[node] = point(position)
        return point_tags[node]

    turned, first_curve = _directions(drawing)
    tags: list[list[int]] = []
    for i, nodes in enumerate(drawing.nodes):
        curve = drawing.curves[i].reversed() if turned[i] else drawing.curves[i]
        pieces = curve.pieces()
        begin, end = nodes[::-1] if turned[i] else nodes
        ends = [point(pieces[0].start, begin), *(point(piece.end) for piece in pieces[:-1])]
        ends.append(point(pieces[-1].end, end))
        tags.append([_add(occ, piece, ends[k : k + 2], point) for k, piece in enumerate(pieces)])
    surface_tags = []
    for f, face in enumerate(drawing.faces):
        around = []
        for n, loop in enumerate(face.loops):
            signed = []
            for i, forward in [*loop[first_curve[f, n] :], *loop[: first_curve[f, n]]]:
                along = forward != turned[i]
                signed += tags[i] if along else [-tag for tag in tags[i][::-1]]
            around.append(occ.addCurveLoop(signed))
        surface_tags.append(int(occ.addPlaneSurface(around)))
    occ.synchronize()
    return surface_tags, tags


def _directions(drawing: Drawing) -> tuple[list[bool], dict[tuple[int, int], int]]:
    """Which curves are made backwards, and the first of each loop, which goes counterclockwise.

    The key of a loop is the number of its face, and its own in the face, where 0 is the outer one.
    """
    turned = [False] * len(drawing.curves)
    oriented: set[int] = set()  # curves that are the first of a loop already
    first_curve = {}

    # short loops choose first, as they have the fewest curves to choose from
    numbered = [(f, n) for f, face in enumerate(drawing.faces) for n in range(len(face.loops))]
    for f, n in sorted(numbered, key=lambda at: len(drawing.faces[at[0]].loops[at[1]])):
        loop = drawing.faces[f].loops[n]
        fits = [(forward == (n == 0)) != turned[i] for i, forward in loop]
        free = [k for k, (i, _) in enumerate(loop) if fits[k] or i not in oriented]

        # a curve that belongs to two short loops has one of them on each side, or both on one
        chosen = next((k for k in free if fits[k]), free[0] if free else 0)
        i = loop[chosen][0]
        if not fits[chosen]:
            turned[i] = not turned[i]
        oriented.add(i)
        first_curve[f, n] = chosen
    return turned, first_curve


def _add(occ: Any, curve: Curve, ends: list[int], point: Callable[[Array], int]) -> int:
    """Add a curve between points of Gmsh to its geometry ``occ``, and return its number.

    ``ends`` are the numbers of both points; ``point`` adds another one, (2,), and numbers it.
    """
    if isinstance(curve, Line):
        return int(occ.addLine(*ends))
    if isinstance(curve, Arc):
        return int(occ.addCircleArc(ends[0], point(curve.center), ends[1]))
    assert isinstance(curve, Spline)
    points = [ends[0], *map(point, curve.control[1:-1]), ends[1]]
    knots, counts = (values.tolist() for values in np.unique(curve.knots, return_counts=True))
    return int(occ.addBSpline(points, degree=curve.degree, knots=knots, multiplicities=counts))


@dataclass(frozen=True, eq=False)
class _CurveCells:
    """The cells along a curve."""

    vertices: Array  #: (n + 1, 2) [m]
    middles: Array  #: (n, 2) on the curve [m]


def _cells_of(curve: Curve, size: float, local: LocalSizes | None) -> _CurveCells:
    """A curve in cells of a size, or smaller, along each of which it turns little."""
    finest = size if local is None else min(size, float(np.min(local.sizes)))
    t, x = _samples(curve, finest)
    side = np.diff(x, axis=0)
    length = np.linalg.norm(side, axis=1)
    sizes = np.full(len(side), size)
    if local is not None:
        sizes = np.clip(local.at(0.5 * (x[1:] + x[:-1])), finest, size)

    # cells by length or by turn, whichever needs more, along each side of the samples
    bent = np.abs(turns(side))
    turn = 0.5 * (np.r_[bent, 0.0] + np.r_[0.0, bent])
    largest_turn = MESHING.turn_of_arcs if isinstance(curve, Arc) else MESHING.turn
    cells_of_side = np.maximum(length / sizes, turn / largest_turn)
    counted = np.cumsum(np.r_[0.0, cells_of_side])
    # two curves with the same ends do not become the same chord
    fewest = 1 if isinstance(curve, Line) else 3
    n = max(math.ceil(counted[-1] * (1.0 - 1e-9)), fewest)

    along = np.cumsum(np.r_[0.0, length])
    s = np.interp(np.linspace(0.0, counted[-1], n + 1), counted, along)
    vertices = curve.at(np.interp(s, along, t))
    vertices[[0, -1]] = curve.start, curve.end
    middles = curve.at(np.interp(0.5 * (s[1:] + s[:-1]), along, t))
    return _CurveCells(vertices, middles)


def _samples(curve: Curve, finest: float) -> tuple[Array, Array]:
    """Parameters (n,) and different points (n, 2) of a curve, several for each cell."""
    breaks = curve.breaks()
    length_of_span = curve.length / (len(breaks) - 1)
    per_span = math.ceil(MESHING.points + 2.0 * length_of_span / finest)
    spans = np.arange(len(breaks))
    t = np.interp(np.arange(spans[-1] * per_span + 1) / per_span, spans, breaks)
    moves_on = np.linalg.norm(np.diff(curve.at(t), axis=0), axis=1) > 0.0
    t = t[np.r_[True, moves_on]]
    return t, curve.at(t)


def cells_along(curve: Curve, size: float) -> Array:
    """The vertices (n + 1, 2) of the cells of a size, or smaller, along a curve [m]."""
    return _cells_of(curve, size, None).vertices


def _polygons(gmsh: Any, drawing: Drawing, divided: Sequence[_CurveCells]) -> list[list[int]]:
    """Make lines along the curves in gmsh, each for one cell, and the faces; the lines' tags."""
    geo = gmsh.model.geo
    point_tags: dict[int, int] = {}
    tags = []
    for (start, end), cells in zip(drawing.nodes, divided, strict=True):
        for node, position in ((start, cells.vertices[0]), (end, cells.vertices[-1])):
            if node not in point_tags:
                point_tags[node] = int(geo.addPoint(*position, 0.0))
        inner = [int(geo.addPoint(*position, 0.0)) for position in cells.vertices[1:-1]]
        points = [point_tags[start], *inner, point_tags[end]]
        tags.append([int(geo.addLine(*ends)) for ends in pairwise(points)])
    for face in drawing.faces:
        loops = [
            [
                s
                for i, forward in loop
                for s in (tags[i] if forward else [-k for k in tags[i][::-1]])
            ]
            for loop in face.loops
        ]
        geo.addPlaneSurface([geo.addCurveLoop(signed) for signed in loops])
    geo.synchronize()
    for tag in (tag for tags_of_curve in tags for tag in tags_of_curve):
        gmsh.model.mesh.setTransfiniteCurve(tag, 2)
    return tags


def _bend(model: Any, divided: Sequence[_CurveCells]) -> None:
    """Raise the mesh to order 2, and move the middles of edges along curves onto these curves.

    Triangles that this would fold, as in the tips of cusps, stay straight.
    """
    model.mesh.setOrder(2)
    mesh = model.mesh

    def nodes_of_cells(name: str, count: int) -> Any:
        _, node_tags = mesh.getElementsByType(mesh.getElementType(name, 2))
        return np.asarray(node_tags, dtype=np.int64).reshape(-1, count)

    triangles = nodes_of_cells("Triangle", 6)
    edge_middles = nodes_of_cells("Line", 3)[:, 2]
    tags, positions, _ = mesh.getNodes()
    # the row of a node is its tag
    x = np.zeros((int(np.max(tags)) + 1, 3))
    x[np.asarray(tags, dtype=np.int64)] = np.reshape(positions, (-1, 3))
    straight = x.copy()
    vertices_of_curves = [cells.vertices for cells in divided]
    on_chords = np.vstack([0.5 * (v[1:] + v[:-1]) for v in vertices_of_curves])
    on_curves = np.vstack([cells.middles for cells in divided])
    _, nearest = cKDTree(on_chords).query(x[edge_middles, :2])
    x[edge_middles, :2] = on_curves[nearest]
    # a triangle that is straightened changes its neighbours
    for _ in range(MESHING.rounds):
        folded = _flattest(x[triangles][:, :, :2]) < MESHING.flattest
        if not np.any(folded):
            break
        middles_of_folded = triangles[folded, 3:].ravel()
        x[middles_of_folded] = straight[middles_of_folded]
    is_moved = np.any(x[edge_middles] != straight[edge_middles], axis=1)
    for node in np.unique(edge_middles[is_moved]).tolist():
        mesh.setNode(node, x[node].tolist(), [])


def _flattest(x: Array) -> Array:
    """Smallest Jacobian determinant of triangles (cells, 6, 2), relative to straight ones."""
    # the nodes, in the order of Gmsh, and the center
    points = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5], [1 / 3, 1 / 3]])
    determinants = []
    for r, s in points:
        t = 1.0 - r - s
        # derivatives of the quadratic shape functions by r and by s
        slopes = [
            [1 - 4 * t, 4 * r - 1, 0.0, 4 * (t - r), 4 * s, -4 * s],
            [1 - 4 * t, 0.0, 4 * s - 1, -4 * r, 4 * r, 4 * (t - s)],
        ]
        determinants.append(np.linalg.det(np.array(slopes) @ x))

    straight_sides = x[:, 1:3] - x[:, :1]
    return np.asarray(np.min(determinants, axis=0) / np.linalg.det(straight_sides))


def check_size(
    subject: str, drawing: Drawing, size: float, *, largest: float = MOST_CELLS, hint: str = ""
) -> None:
    """Refuse more triangles of a ``size`` [m], or more curves, than gmsh can take in minutes.

    The ``hint`` is what the message says beside a larger size.
    """
    curves = len(drawing.curves)
    remedy = "leave out what does not bear, or take fewer points (shapely.simplify)"
    check_count(subject, curves, "curves", remedy, most=MOST_CURVES)
    area = sum(float(drawing.moments(face.loops)[0]) for face in drawing.faces)
    around = sum(curve.length for curve in drawing.curves)
    # equilateral ones, and at least one at each piece of the boundary
    count = 4.0 / math.sqrt(3.0) * (area / size / size) + around / size
    things, remedy = f"triangles of {size:.4g} m", f"give a larger size [m]{hint}"
    check_count(subject, count, things, remedy, each=MESHING.memory, most=largest)


@dataclass(frozen=True, eq=False)
class LocalSizes:
    """Points beside which triangles are smaller, and grow from there on."""

    points: Array  #: (n, 2) [m]
    sizes: Array  #: (n,) [m]

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    def at(self, points: Array) -> Array:
        """Sizes at points (n, 2), not yet bounded by the smallest and the largest one [m]."""
        nearest = np.arange(min(MESHING.nearest, len(self.sizes))) + 1
        distance, neighbours = self._tree.query(points, k=nearest)
        return np.asarray(np.min(self.sizes[neighbours] + MESHING.growth * distance, axis=1))


def mesh_faces(
    gmsh: Any,
    drawing: Drawing,
    size: float,
    *,
    order: int = 1,
    local: LocalSizes | None = None,
    grow: bool = False,
) -> None:
    """Mesh a drawing with its physical groups by triangles of a ``size``, or smaller [m].

    With ``grow`` they grow from the cells along the curves, whose sizes may be ``local``.
    """
    model = gmsh.model
    divided = [_cells_of(curve, size, local) for curve in drawing.curves]
    _refuse_crossed(drawing, divided, size)
    tags = _polygons(gmsh, drawing, divided)
    surface_tags = [tag for _, tag in model.getEntities(2)]
    for group in dict.fromkeys(face.group for face in drawing.faces):
        members = [
            s for s, face in zip(surface_tags, drawing.faces, strict=True) if face.group == group
        ]
        model.setPhysicalName(2, model.addPhysicalGroup(2, members), group)
    for group in dict.fromkeys(name for name in drawing.groups if name):
        chosen = [ts for ts, name in zip(tags, drawing.groups, strict=True) if name == group]
        members = [tag for ts in chosen for tag in ts]
        model.setPhysicalName(1, model.addPhysicalGroup(1, members), group)
    options = {
        "Mesh.MeshSizeMin": 0.0,
        "Mesh.MeshSizeMax": size,
        "Mesh.MeshSizeFromPoints": 0,
        "Mesh.MeshSizeExtendFromBoundary": int(grow),
        # an error would be thrown within a parallel loop of gmsh, which ends the program
        "General.AbortOnError": 0,
    }
    with gmsh_options(gmsh, options):
        with quiet():
            model.mesh.generate(2)
        _refuse_unmeshed(model, drawing, surface_tags, size)
        if order > 1:
            _bend(model, divided)


def _refuse_crossed(drawing: Drawing, divided: Sequence[_CurveCells], size: float) -> None:
    """Refuse cells along curves that cross, which gmsh (4.13) would divide without end."""
    ends = np.concatenate([cells_of_curve.vertices[[0, -1]] for cells_of_curve in divided])
    positions = dict(zip(np.ravel(drawing.nodes).tolist(), ends, strict=True))
    # where curves meet, their cells must share a point to the last bit
    chains = [
        np.vstack([positions[start], cells_of_curve.vertices[1:-1], positions[end]])
        for (start, end), cells_of_curve in zip(drawing.nodes, divided, strict=True)
    ]
    cells = shapely.linestrings(np.concatenate([np.stack([x[:-1], x[1:]], 1) for x in chains]))
    crossed = shapely.STRtree(cells).query(cells, predicate="crosses")
    if crossed.size:
        x, y = shapely.get_coordinates(shapely.intersection(*cells[crossed[:, 0]]))[0]
        raise CurveError(
            f"parts of the outline cross, or almost touch, near ({x:.4g}, {y:.4g}) m where cells "
            f"of {size:.4g} m follow it: give a smaller size, or move them apart"
        )


def _refuse_unmeshed(
    model: Any, drawing: Drawing, surface_tags: Sequence[int], size: float
) -> None:
    """Refuse a mesh that does not fill the faces, which gmsh returns without an error."""
    for surface, face in zip(surface_tags, drawing.faces, strict=True):
        # twice the area of each triangle
        doubled = model.mesh.getJacobians(2, [1 / 3, 1 / 3, 0.0], surface)[1]
        covered = 0.5 * float(np.sum(np.abs(doubled)))
        area = float(drawing.moments(face.loops)[0])
        around = sum(drawing.curves[i].length for loop in face.loops for i, _ in loop)
        # chords of curves leave out, or add, less than a quarter of their length along them
        if abs(covered - area) > 1e-6 * area + 0.25 * size * around or not len(doubled):
            raise CurveError(
                f"gmsh cannot mesh the outline by triangles of {size:.4g} m; give a smaller size, "
                "or look for parts of the outline that almost touch"
            )
