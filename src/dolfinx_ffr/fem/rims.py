# SPDX-License-Identifier: MIT
"""Rims: the regions of an outline within a width of its interfaces.

The rim of a round bore is bounded by a circle, the rim of other curves by offset curves. A rim that
is wider than the material beside it ends at the outline.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
import shapely.ops
from scipy.optimize import minimize_scalar

from ..arrays import Array, Mask
from .curves import Arc, Curve, Line, Spline
from .drawing import CurveSide, Drawing, Face
from .interface import nearest_circle
from .polylines import turns


@dataclass(frozen=True)
class RimOptions:
    """Accuracy of rims, in widths of the rim where nothing else is said."""

    #: Width of material between a rim and the outline that still belongs to the rim
    leftover: float = 0.05
    shared_node: float = 0.01  #: Distance from a node of curves that end there
    #: Length of an offset curve from where it comes that near to the outline to where it crosses
    #: it, in leftovers: if it is longer, it runs along the outline
    crossing: float = 4.0
    fine: float = 1e-4  #: Accuracy of the polygons that stand for curves
    sides: int = 96  #: Sides of a quarter of the circle by which offset curves are found
    fewest: int = 10  #: Least number of vertices of a polygon that may be a circle
    round: float = 1e-5  #: Accuracy of such a circle [radii]
    corner: float = 0.2  #: Angle from which on an offset curve has a corner [rad]
    points: float = 8.0  #: Points of a spline along a width


RIM = RimOptions()


def with_rims(
    drawing: Drawing, vertices: Sequence[Array], is_held: Sequence[Mask], width: float
) -> Drawing:
    """The drawing with solid faces within a ``width`` [m] of interfaces, and designed ones beyond.

    The cells along each curve have the ``vertices`` (n + 1, 2) [m], and ``is_held`` (n,) is the
    mask of those along an interface.
    """
    fine = RIM.fine * width
    lines = [
        line
        for curve, x, on in zip(drawing.curves, vertices, is_held, strict=True)
        for line in _held(curve, x, on, fine)
    ]
    if not lines:
        return drawing
    zone = _zone(lines, width)
    body = shapely.union_all([drawing.polygon(face.loops, fine) for face in drawing.faces])
    divided = _DividedDrawing(drawing, width)
    for line in _inside(zone, body, RIM.leftover * width):
        divided.add(shapely.get_coordinates(line))
    return divided.drawing(zone)


def _held(curve: Curve, x: Array, on: Mask, fine: float) -> Iterator[shapely.LineString]:
    """The parts of a curve along interfaces: all of it, or runs of cells."""
    if np.all(on):
        yield shapely.LineString(curve.points(fine))
        return
    ends = np.flatnonzero(np.diff(np.r_[False, on, False]))
    for begin, end in ends.reshape(-1, 2):
        yield shapely.LineString(x[begin : end + 1])


def _zone(lines: Sequence[shapely.LineString], width: float) -> shapely.Geometry:
    """All points within a width of lines; one with vertices on a circle is this circle."""
    zones = []
    for line in shapely.get_parts(shapely.line_merge(shapely.MultiLineString(lines))):
        circle = _circle(shapely.get_coordinates(line)) if line.is_closed else None
        if circle is None:
            zones.append(line.buffer(width, quad_segs=RIM.sides))
            continue
        center, radius = shapely.Point(circle[0]), circle[1]
        around = center.buffer(radius + width, quad_segs=RIM.sides)
        if radius > width:
            around = around.difference(center.buffer(radius - width, quad_segs=RIM.sides))
        zones.append(around)
    return shapely.union_all(zones)


def _circle(x: Array) -> tuple[Array, float] | None:
    """Center (2,) and radius of the circle through points (n, 2), or None if there is none."""
    return nearest_circle(x, RIM.round) if len(x) > RIM.fewest else None


def _inside(
    zone: shapely.Geometry, body: shapely.Geometry, depth: float
) -> Iterator[shapely.LineString]:
    """The boundary of a zone in the body, where it does not run along the outline."""
    deep = body.buffer(-depth)
    for region in shapely.get_parts(zone):
        for edge in (region.exterior, *region.interiors):
            if deep.contains(edge):
                yield shapely.LineString(edge)
                continue
            edges_in_body = _lines(edge.intersection(body))
            for line in _lines(edge.intersection(deep)):
                if line.length > depth:
                    yield _to_the_outline(line, edges_in_body, RIM.crossing * depth)


def _lines(geometry: shapely.Geometry) -> list[shapely.LineString]:
    lines = [piece for piece in shapely.get_parts(geometry) if piece.length > 0.0]
    return list(shapely.get_parts(shapely.line_merge(shapely.MultiLineString(lines))))


def _to_the_outline(
    line: shapely.LineString, edges: Sequence[shapely.LineString], longest: float
) -> shapely.LineString:
    """A ``line``, lengthened to the outline at each end that is near to it.

    The ``edges`` of the zone end at the outline; the line is a part of the nearest one. An end of
    the line is moved to the end of that edge if the piece between them is shorter than ``longest``
    [m].
    """
    middle = line.interpolate(0.5, normalized=True)
    whole_edge = min(edges, key=middle.distance, default=line)
    if whole_edge.is_closed:
        return line
    # arc lengths along the edge
    start, end = (whole_edge.project(shapely.Point(line.coords[k])) for k in (0, -1))
    if start > end:
        whole_edge = whole_edge.reverse()
        start, end = whole_edge.length - start, whole_edge.length - end
    new_start = 0.0 if start < longest else start
    new_end = whole_edge.length if whole_edge.length - end < longest else end
    return shapely.ops.substring(whole_edge, new_start, new_end)


class _DividedDrawing:
    """A drawing whose faces are divided by further curves.

    Args:
        drawing: The drawing to be divided, whose curves are the outline.
        width: Width of the rims [m].
    """

    def __init__(self, drawing: Drawing, width: float) -> None:
        self._outline, self._width = drawing, width
        self._fine = RIM.fine * width  # largest deviation of points from a curve [m]
        self._near = RIM.shared_node * width  # nodes that are nearer than this are one [m]
        self._lines = [shapely.LineString(curve.points(self._fine)) for curve in drawing.curves]
        #: Cuts of each curve of the outline: parameter, number of the node, and its position (2,)
        self._cuts: list[list[tuple[float, int, Array]]] = [[] for _ in drawing.curves]

        # the curves that are added, and the nodes at both ends of each
        self._curves: list[Curve] = []
        self._nodes: list[tuple[int, int]] = []
        self._next_node = 1 + max(max(ends) for ends in drawing.nodes)

    def add(self, x: Array) -> None:
        """Divide faces by a smooth curve through points (n, 2), or by several between corners.

        A closed one repeats its first point; an open one ends at the outline.
        """
        if np.array_equal(x[0], x[-1]):
            # a closed curve with corners begins at the first one
            corners = _corners(np.vstack([x[-2:-1], x])) - 1
            if len(corners):
                x = np.vstack([x[corners[0] : -1], x[: corners[0] + 1]])
            first_node = last_node = self._new_node()
        else:
            first_node, start = self._node(x[0])
            last_node, end = self._node(x[-1])
            from_start = self._joined(x[0], start)
            to_end = self._joined(x[-1], end)[::-1]
            x = np.vstack([*from_start, x[1:-1], *to_end])

        cuts = [0, *_corners(x).tolist(), len(x) - 1]
        nodes = [first_node, *(self._new_node() for _ in cuts[1:-1]), last_node]
        for ends, (first, last) in zip(pairwise(nodes), pairwise(cuts), strict=True):
            self._curves.append(self._curve(x[first : last + 1]))
            self._nodes.append(ends)

    def _joined(self, point: Array, end: Array) -> list[Array]:
        """The end of a line at the outline, and the point before it where that is not near."""
        return [end] if np.hypot(*(point - end)) < 2.0 * self._near else [end, point]

    def _new_node(self) -> int:
        self._next_node += 1
        return self._next_node - 1

    def _node(self, point: Array) -> tuple[int, Array]:
        """The node of the outline near a point, else a new one, and the position of the node."""
        i = int(np.argmin(shapely.distance(shapely.Point(point), self._lines)))
        curve, ends = self._outline.curves[i], self._outline.nodes[i]
        t = _nearest(curve, point, self._fine)
        place = curve.at(np.array([t]))[0]
        node_positions = [(ends[0], curve.start), (ends[1], curve.end)]
        node_positions += [(node, position) for _, node, position in self._cuts[i]]
        for node, position in node_positions:
            if np.hypot(*(place - position)) < self._near:
                return node, position
        node = self._new_node()
        self._cuts[i].append((t, node, place))
        return node, place

    def _curve(self, x: Array) -> Curve:
        """A line, an arc or a spline along points (n, 2) of a smooth curve.

        It is the first of these that the points fit; its ends are the first and the last point.
        """
        chord = x[-1] - x[0]
        across = np.abs((x - x[0]) @ np.array([-chord[1], chord[0]]))
        if np.any(chord) and np.all(across <= self._fine * np.hypot(*chord)):
            return Line(x[0], x[-1])

        inner = x[1:-1] if len(x) > RIM.fewest + 2 else x
        circle = _circle(inner)
        if circle is not None:
            arc = Arc.along(x, circle[0])
            is_closed = np.array_equal(x[0], x[-1])
            if is_closed:
                return replace(arc, sweep=float(np.copysign(2.0 * np.pi, arc.sweep)))
            return arc.moved(x[0], x[-1])

        # a spline through points at equal distances, which are fewer than those of the curve
        arc_length = np.r_[0.0, np.cumsum(np.hypot(*np.diff(x, axis=0).T))]
        count = max(4, int(RIM.points * arc_length[-1] / self._width))
        samples = np.linspace(0.0, arc_length[-1], count)
        points = np.column_stack([np.interp(samples, arc_length, x[:, k]) for k in (0, 1)])
        points[0], points[-1] = x[0], x[-1]
        return Spline.through(points)

    def drawing(self, zone: shapely.Geometry) -> Drawing:
        """The drawing with all faces; the group "solid" has thin ones and those in the ``zone``."""
        outline = self._outline
        curves, nodes, groups = [*self._curves], [*self._nodes], [""] * len(self._curves)
        # the added curves have a face on both sides, and are walked in both directions
        sides: list[CurveSide] = [
            (i, forward) for forward in (True, False) for i in range(len(curves))
        ]
        pieces_of_curve: list[list[int]] = []
        for i, cuts in enumerate(self._cuts):
            cuts.sort(key=lambda cut: cut[0])
            cut_curves = outline.curves[i].cut([t for t, _, _ in cuts])
            cut_nodes = [node for _, node, _ in cuts]
            cut_points = [point for _, _, point in cuts]
            first_node, last_node = outline.nodes[i]
            first_point, last_point = outline.curves[i].start, outline.curves[i].end
            end_points = pairwise([first_point, *cut_points, last_point])
            pieces_of_curve.append([len(curves) + k for k in range(len(cut_curves))])
            for curve, (start, end) in zip(cut_curves, end_points, strict=True):
                curves.append(curve.moved(start, end) if cuts else curve)
            nodes += pairwise([first_node, *cut_nodes, last_node])
            groups += [outline.groups[i]] * len(cut_curves)
        for i, forward in (side for face in outline.faces for loop in face.loops for side in loop):
            pieces = pieces_of_curve[i] if forward else pieces_of_curve[i][::-1]
            sides += [(k, forward) for k in pieces]

        divided = Drawing(curves, nodes, groups, [])
        faces = []
        for loops in divided.faces_beside(sides, self._fine):
            shape = divided.polygon(loops, self._fine)
            is_thin = shape.buffer(-0.5 * RIM.leftover * self._width).is_empty
            is_solid = is_thin or shape.intersection(zone).area > 0.5 * shape.area
            faces.append(Face("solid" if is_solid else "design", loops))
        return replace(divided, faces=faces)


def _corners(x: Array) -> Array:
    """Numbers of the inner points at which a line through points (n, 2) has a corner."""
    return np.asarray(1 + np.flatnonzero(np.abs(turns(np.diff(x, axis=0))) > RIM.corner))


def _nearest(curve: Curve, point: Array, fine: float) -> float:
    """The parameter of the point of a curve that is nearest to a ``point``, shape (2,) [m].

    The curve is sampled with the accuracy ``fine`` [m], and the nearest samples are refined.
    """
    t = curve.parameters(fine)
    distance = np.hypot(*(curve.at(t) - point).T)
    candidates = []
    # the vertex nearest to a point on a long line may belong to another side
    for k in range(len(t) - 1) if len(t) < 8 else np.argsort(distance)[:3]:
        low, high = t[max(k - 1, 0)], t[min(k + 1, len(t) - 1)]

        def off(s: float) -> float:
            return float(np.sum((curve.at(np.array([s]))[0] - point) ** 2))

        best = minimize_scalar(off, bounds=(low, high), method="bounded", options={"xatol": 1e-12})
        candidates.append((best.fun, float(best.x)))
    return min(candidates)[1]
