# SPDX-License-Identifier: MIT
"""The curves of a part whose free boundary is the zero of a field.

The drawing of the full body has faces that stay solid and faces where the field decides. Of these
the material is found on a raster. Its sides along the body's drawing are pieces of the curves
there; all others are splines through points where the field is zero to round-off.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, Protocol

import contourpy
import numpy as np
import shapely

from ..arrays import Array, Integers
from ..fem import Curve, Drawing, Face, Line, ShapeError, Spline, connected, polygon
from .spline_grid import SplineGrid

#: Accuracy of polygons, level that counts as zero on the raster, distance of points that are one,
#: and distance of points of a spline at least, in steps of the raster
_FINE, _ZERO, _SAME, _APART = 1e-3, 1e-3, 0.05, 0.7
#: Share of the gradient along a curve from which on the end of a zero line slides to its zero
_STEEP = 0.3
#: Fewest points of a spline, and rounds of Newton's method
_FEWEST, _NEWTON = 4, 3
#: Turn of a spline from one of its points to the next at most [rad]: its radii then are those of
#: the zero within 1 %
_TURN = 0.25

#: Number of a curve of the body's drawing, or -1 for the zero of the field
_ZERO_LINE = -1


@dataclass(frozen=True, eq=False)
class BodyDrawing:
    """The drawing of a full body, its polygons, and the raster on which a field is looked at."""

    drawing: Drawing
    solid: list[int]  #: Numbers of the faces that stay
    kept: shapely.Geometry  #: Where material stays [m]
    designed: shapely.Geometry  #: Where the field decides [m]
    lines: Array  #: A polyline for each curve (curves,), of geometries
    parameters: list[Array]  #: Those of its points
    step: float  #: Of the raster [m]
    joined: bool  #: Whether a web joins all pieces of the material

    @staticmethod
    def of(
        drawing: Drawing, solid: shapely.Geometry, step: float, joined: bool = False
    ) -> BodyDrawing:
        """The body of a ``drawing`` with faces that are inside ``solid`` [m]."""
        fine = _FINE * step
        parameters = [curve.parameters(fine) for curve in drawing.curves]
        lines = np.array([shapely.LineString(c.points(fine)) for c in drawing.curves])
        faces = [_polygon_of(drawing, face, fine) for face in drawing.faces]
        inner = [solid.covers(face.representative_point()) for face in faces]
        stays = [number for number, inside in enumerate(inner) if inside]
        kept = shapely.union_all([faces[number] for number in stays])
        free = shapely.union_all([f for f, inside in zip(faces, inner, strict=True) if not inside])
        return BodyDrawing(drawing, stays, kept, free, lines, parameters, step, joined)

    def nearest(self, points: Array) -> tuple[Integers, Array]:
        """The curve nearest to each of ``points`` (n, 2), and its distance [m]."""
        place = shapely.points(points)[:, None]
        distance = shapely.distance(place, self.lines[None, :])
        number = np.argmin(distance, axis=1)
        return number, distance[np.arange(len(points)), number]

    def parameter(self, number: int, point: Array) -> float:
        """Where a curve comes nearest to a ``point`` (2,)."""
        curve, t = self.drawing.curves[number], self.parameters[number]
        points = curve.at(t)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        at = float(np.interp(self.lines[number].project(shapely.Point(point)), along, t))
        for _ in range(3):
            where = np.array([at])
            slope = curve.slope(where)[0]
            at += float((point - curve.at(where)[0]) @ slope / max(float(slope @ slope), 1e-300))
            at = min(max(at, 0.0), 1.0)
        return at


@dataclass
class _Run:
    """Sides of a face that follow each other along one curve of the body, or along the zero."""

    number: int  #: Of the curve, or the zero line
    points: Array  #: (n, 2) [m], the last one where the next run begins
    closed: bool = False  #: Whether it is all of a loop
    on: int = -1  #: Curve of the body on which it begins
    at: float = 0.0  #: Parameter of that curve where it begins


class _Side(NamedTuple):
    """A side of a face."""

    number: int  #: Curve of the body, or the zero line
    start: int  #: Node where it begins, of the zero line the number of the curve
    end: int  #: Node where it ends
    forward: bool  #: Whether it goes along the curve


class _Level(Protocol):
    """What a drawing needs of a field."""

    @property
    def on_raster(self) -> Array: ...

    def derivatives(self, points: Array) -> tuple[Array, Array]: ...


def designed_faces(field: _Level, grid: SplineGrid, body: BodyDrawing) -> list[shapely.Polygon]:
    """The faces of the material where the field decides, counterclockwise, between chords."""
    step = body.step
    x, y = (step * np.arange(-2 * n, 2 * n + 1) for n in grid.half)
    values = field.on_raster
    values = np.where(np.abs(values) < _ZERO * step, _ZERO * step, values)
    generator = contourpy.contour_generator(x, y, values.T, fill_type="OuterOffset")
    polygons = [
        shapely.Polygon(
            grid.center + ring[starts[0] : starts[1]] @ grid.axes,
            [grid.center + ring[a:b] @ grid.axes for a, b in pairwise(starts[1:].tolist())],
        )
        for ring, starts in zip(*generator.filled(0.0, np.inf), strict=True)
    ]
    material = shapely.union_all(polygons).intersection(body.designed)
    faces = [face for face in shapely.get_parts(material) if face.area > step**2]
    return [
        shapely.geometry.polygon.orient(
            shapely.Polygon(
                face.exterior,
                [hole for hole in face.interiors if shapely.Polygon(hole).area > step**2],
            )
        )
        for face in faces
        if isinstance(face, shapely.Polygon)
    ]


class FieldDrawing:
    """How the drawing of a field is made; `drawing` is the result.

    A ShapeError says that the material falls apart.
    """

    def __init__(self, field: _Level, grid: SplineGrid, body: BodyDrawing) -> None:
        self._field, self._grid, self._body = field, grid, body
        self._near = _SAME * body.step
        count = len(body.drawing.curves)
        #: Where curves of the body are cut: parameter, node and place
        self._cuts: list[list[tuple[float, int, Array]]] = [[] for _ in range(count)]
        self._next_node = 1 + max(max(ends) for ends in body.drawing.nodes)
        self._free: list[Curve] = []
        self._free_nodes: list[tuple[int, int]] = []

        faces = [
            [list(self._runs(ring)) for ring in (face.exterior, *face.interiors)]
            for face in designed_faces(field, grid, body)
        ]
        loops = [loop for rings in faces for loop in rings]
        zero_lines = [run for loop in loops for run in loop if run.number < 0]
        self._onto_zero(zero_lines)
        self._refine(zero_lines)
        self._slide_ends([loop for loop in loops if len(loop) > 1])
        self.drawing = self._drawn([[self._sides(loop) for loop in rings] for rings in faces])

    # ------------------------------------------------------------------ sides of faces

    def _runs(self, ring: shapely.LinearRing) -> Iterator[_Run]:
        """The sides of a ring in runs, each along one curve."""
        points = shapely.get_coordinates(ring)[:-1]
        after = np.roll(points, -1, axis=0)
        number, distance = self._body.nearest(0.5 * (points + after))
        number[distance > 1e-6 * self._body.step] = _ZERO_LINE
        starts = np.flatnonzero(number != np.roll(number, 1))
        if not len(starts):
            yield _Run(int(number[0]), np.vstack([points, points[:1]]), closed=True)
            return
        points, number = np.roll(points, -starts[0], axis=0), np.roll(number, -starts[0])
        starts = starts - starts[0]
        for first, last in pairwise([*starts.tolist(), len(points)]):
            chain = np.vstack([points[first:last], points[last % len(points)][None]])
            yield _Run(int(number[first]), chain)

    # ------------------------------------------------------------------ curves

    def _onto_zero(self, runs: list[_Run]) -> None:
        """Move all but the ends of runs along the zero of the field onto it, well apart."""
        inner = [run.points if run.closed else run.points[1:-1] for run in runs]
        if not inner:
            return
        moved = np.split(self._on_zero(np.vstack(inner)), np.cumsum([len(x) for x in inner])[:-1])
        apart = _APART * self._body.step
        for run, points in zip(runs, moved, strict=True):
            if run.closed:
                ring = _thinned(points[:-1], apart, closed=True)
                run.points = np.vstack([ring, ring[:1]])
            else:
                ends = run.points[[0]], points, run.points[[-1]]
                run.points = _thinned(np.vstack(ends), apart, closed=False)

    def _on_zero(self, points: Array) -> Array:
        """The places on the zero of the field beside ``points`` (n, 2)."""
        most = self._body.step
        for _ in range(_NEWTON):
            value, gradient = self._field.derivatives(points)
            square = np.maximum(np.sum(gradient**2, axis=1), 1e-12)
            way = np.clip(value / square, -most / np.sqrt(square), most / np.sqrt(square))
            points = points - way[:, None] * gradient
        # where the zero is a little beyond the outline, as at a notch of it, this is the boundary
        shapely.prepare(self._body.designed)
        beyond = np.flatnonzero(~shapely.intersects_xy(self._body.designed, *points.T))
        if len(beyond):
            lines = shapely.shortest_line(self._body.designed, shapely.points(points[beyond]))
            points[beyond] = shapely.get_coordinates(lines)[::2]
        return points

    def _refine(self, runs: list[_Run]) -> None:
        """Put more points of the zero between those of runs where it turns."""
        if not runs:
            return
        points = np.vstack([run.points for run in runs])
        normals = self._field.derivatives(points)[1]
        angles = np.arctan2(normals[:, 1], normals[:, 0])
        turns = np.abs((np.diff(angles) + np.pi) % (2.0 * np.pi) - np.pi)
        ends = np.cumsum([len(run.points) for run in runs])
        turns[ends[:-1] - 1] = 0.0  # from one run to the next
        extra = np.ceil(turns / _TURN).astype(np.int64) - 1
        where = np.repeat(np.arange(len(extra)), np.maximum(extra, 0))
        if not len(where):
            return
        first = np.searchsorted(where, where)
        share = (np.arange(len(where)) - first + 1.0) / (extra[where] + 1.0)
        between = points[where] + share[:, None] * (points[where + 1] - points[where])
        between = self._on_zero(between)
        for run, start, end in zip(runs, [0, *ends[:-1].tolist()], ends.tolist(), strict=True):
            of_run = (where >= start) & (where < end - 1)
            run.points = np.insert(run.points, where[of_run] + 1 - start, between[of_run], axis=0)

    def _slide_ends(self, loops: list[list[_Run]]) -> None:
        """Find where curves of the body meet the zero of the field, and other ends of runs."""
        ends = []
        for loop in loops:
            for before, after in zip([loop[-1], *loop[:-1]], loop, strict=True):
                number = before.number if before.number >= 0 else after.number
                after.on = number
                after.at = self._body.parameter(number, after.points[0])
                if min(before.number, after.number) < 0:
                    ends.append(after)
        if not ends:
            return
        curves = [self._body.drawing.curves[run.on] for run in ends]
        places = np.vstack([run.points[0] for run in ends])
        start = np.array([run.at for run in ends])
        t, steep = start.copy(), np.ones(len(ends), dtype=bool)
        for _ in range(_NEWTON):
            where = t[:, None]
            points = np.vstack([c.at(at) for c, at in zip(curves, where, strict=True)])
            slope = np.vstack([c.slope(at) for c, at in zip(curves, where, strict=True)])
            value, gradient = self._field.derivatives(points)
            rate = np.einsum("ni,ni->n", gradient, slope)
            size = np.linalg.norm(gradient, axis=1) * np.linalg.norm(slope, axis=1)
            steep &= np.abs(rate) > _STEEP * size
            change = value / np.where(steep, rate, 1.0)
            t = np.clip(np.where(steep, t - change, start), 0.0, 1.0)
        points = np.vstack([c.at(at) for c, at in zip(curves, t[:, None], strict=True)])
        near = np.linalg.norm(points - places, axis=1) < self._body.step
        for run, at in zip(ends, np.where(near, t, start), strict=True):
            run.at = float(at)

    def _sides(self, loop: list[_Run]) -> list[_Side]:
        """The sides of a loop of a face."""
        if len(loop) == 1:
            return [self._closed(loop[0])]
        nodes = [self._node(run) for run in loop]
        sides = []
        for run, start, end in zip(loop, nodes, [*nodes[1:], nodes[0]], strict=True):
            if run.number >= 0:
                # a run whose ends are one node is a speck, or goes around a closed curve
                if start[0] != end[0] or len(run.points) > _FEWEST:
                    sides.append(_Side(run.number, start[0], end[0], self._is_forward(run)))
            elif start[0] != end[0] or len(run.points) > _FEWEST:
                curve = self._through(run.points, start[1], end[1])
                sides.append(self._new_curve(curve, start[0], end[0]))
        return sides

    def _closed(self, run: _Run) -> _Side:
        if run.number >= 0:  # a closed curve of the body's drawing
            node = self._body.drawing.nodes[run.number][0]
            return _Side(run.number, node, node, self._is_forward(run))
        points = run.points[:-1]
        node, self._next_node = self._next_node, self._next_node + 1
        return self._new_curve(Spline.around(points), node, node)

    def _new_curve(self, curve: Curve, start: int, end: int) -> _Side:
        self._free.append(curve)
        self._free_nodes.append((start, end))
        return _Side(_ZERO_LINE, len(self._free) - 1, 0, True)

    def _is_forward(self, run: _Run) -> bool:
        middle = len(run.points) // 2
        at = 0.5 * (run.points[middle - 1] + run.points[middle])
        curve, t = self._body.drawing.curves[run.number], self._body.parameter(run.number, at)
        way = run.points[middle] - run.points[middle - 1]
        return bool(curve.slope(np.array([t]))[0] @ way > 0.0)

    def _node(self, run: _Run) -> tuple[int, Array]:
        """The node where a run begins and its place: one of the drawing if that is near."""
        curve, ends = self._body.drawing.curves[run.on], self._body.drawing.nodes[run.on]
        place = curve.at(np.array([run.at]))[0]
        known = [(ends[0], curve.start), (ends[1], curve.end)]
        known += [(node, at) for _, node, at in self._cuts[run.on]]
        for node, at in known:
            if np.hypot(*(place - at)) < self._near:
                return node, at
        node, self._next_node = self._next_node, self._next_node + 1
        self._cuts[run.on].append((run.at, node, place))
        return node, place

    def _through(self, points: Array, start: Array, end: Array) -> Curve:
        points = np.vstack([start, points[1:-1], end])
        return Spline.through(points) if len(points) >= _FEWEST else Line(start, end)

    # ------------------------------------------------------------------ the drawing

    def _drawn(self, faces: list[list[list[_Side]]]) -> Drawing:
        body = self._body.drawing
        curves: list[Curve] = []
        nodes: list[tuple[int, int]] = []
        groups: list[str] = []
        pieces: list[list[int]] = []  # of each curve of the body
        for number, cuts in enumerate(self._cuts):
            cuts.sort(key=lambda cut: cut[0])
            curve, ends = body.curves[number], body.nodes[number]
            places = [curve.start, *(place for _, _, place in cuts), curve.end]
            along = [ends[0], *(node for _, node, _ in cuts), ends[1]]
            parts = curve.cut([t for t, _, _ in cuts]) if cuts else [curve]
            pieces.append([len(curves) + k for k in range(len(parts))])
            curves += [c.moved(a, b) if cuts else c
                       for c, (a, b) in zip(parts, pairwise(places), strict=True)]  # fmt: skip
            nodes += pairwise(along)
            groups += [body.groups[number]] * len(parts)
        first = len(curves)
        curves += self._free
        nodes += self._free_nodes
        groups += [""] * len(self._free)

        def walked(side: _Side) -> list[tuple[int, bool]]:
            number, start, end, forward = side
            if number == _ZERO_LINE:
                return [(first + start, True)]
            own = pieces[number]
            along = [nodes[own[0]][0], *(nodes[k][1] for k in own)]
            if start == end and along[0] == along[-1]:  # all of a closed curve
                return [(k, forward) for k in (own if forward else own[::-1])]
            begin, stop = (start, end) if forward else (end, start)
            first_piece, last_piece = along.index(begin), _last(along, stop)
            if first_piece < last_piece:
                walk = own[first_piece:last_piece]
            elif along[0] == along[-1]:  # past the place where a closed curve begins
                walk = own[first_piece:] + own[:last_piece]
            else:
                walk = []
            return [(k, forward) for k in (walk if forward else walk[::-1])]

        drawn = [
            Face("design", [[each for side in loop for each in walked(side)] for loop in loops])
            for loops in faces
        ]
        for number in self._body.solid:
            loops = [
                [(k, way) for i, way in loop for k in (pieces[i] if way else pieces[i][::-1])]
                for loop in body.faces[number].loops
            ]
            drawn.append(Face("solid", loops))
        return _one_piece(Drawing(curves, nodes, groups, drawn), self._body.joined)


def _last(along: Sequence[int], node: int) -> int:
    return len(along) - 1 - list(along)[::-1].index(node)


def _one_piece(drawing: Drawing, joined: bool) -> Drawing:
    """The drawing without designed pieces that are loose, and without curves of no face.

    Where a web has ``joined`` all pieces, none is loose.
    """
    of_curve: dict[int, list[int]] = {}
    for number, face in enumerate(drawing.faces):
        for curve in {i for loop in face.loops for i, _ in loop}:
            of_curve.setdefault(curve, []).append(number)
    pairs = np.array([[faces[0], faces[-1]] for faces in of_curve.values()]).reshape(-1, 2)
    label = connected(pairs, len(drawing.faces))
    if joined:
        label = np.zeros_like(label)
    needed = {label[f] for f, face in enumerate(drawing.faces) if face.group == "solid"}
    needed |= {label[faces[0]] for curve, faces in of_curve.items() if drawing.groups[curve]}
    missing = {name for name in drawing.groups if name} - {
        drawing.groups[curve] for curve in of_curve
    }
    if len(needed) != 1 or missing:
        raise ShapeError("boundary: the material falls apart, or an interface has lost it")
    faces = [face for f, face in enumerate(drawing.faces) if label[f] in needed]
    used = sorted({i for face in faces for loop in face.loops for i, _ in loop})
    new_number = {old: new for new, old in enumerate(used)}
    return Drawing(
        [drawing.curves[i] for i in used],
        [drawing.nodes[i] for i in used],
        [drawing.groups[i] for i in used],
        [
            Face(f.group, [[(new_number[i], way) for i, way in loop] for loop in f.loops])
            for f in faces
        ],
    )


def _polygon_of(drawing: Drawing, face: Face, fine: float) -> shapely.Polygon:
    rings = [
        polygon(
            [drawing.curves[i] if way else drawing.curves[i].reversed() for i, way in loop], fine
        )
        for loop in face.loops
    ]
    return shapely.Polygon(rings[0], rings[1:])


def _thinned(points: Array, least: float, *, closed: bool) -> Array:
    """Points of a line that are at least some way apart, with its ends."""
    kept = [0]
    for i in range(1, len(points)):
        if np.hypot(*(points[i] - points[kept[-1]])) >= least:
            kept.append(i)
    if closed:
        if len(kept) > 3 and np.hypot(*(points[kept[-1]] - points[0])) < least:
            kept.pop()
    else:
        while len(kept) > 1 and np.hypot(*(points[kept[-1]] - points[-1])) < least:
            kept.pop()
        kept.append(len(points) - 1)
    return points[kept]
