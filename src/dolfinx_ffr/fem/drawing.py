# SPDX-License-Identifier: MIT
"""Drawings: curves in the plane that meet in common ends, and the faces between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from ..arrays import Array
from .curves import Curve, enclosed, polygon

#: Number of a curve, and whether it is walked forward
CurveSide = tuple[int, bool]
#: Sides of curves that follow each other
CurveLoop = Sequence[CurveSide]
#: Share by which areas of the same loop differ by round-off
_ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Face:
    """A connected region of a drawing, on the left of its loops."""

    group: str  #: Name of its physical surface
    loops: Sequence[CurveLoop]  #: The outer loop first


@dataclass(frozen=True, eq=False)
class Drawing:
    """Curves that meet in common ends, and the faces between them."""

    curves: Sequence[Curve]
    nodes: Sequence[tuple[int, int]]  #: Numbers of the ends; curves that meet share them
    groups: Sequence[str]  #: Name of the physical curve of each, "" where it is in none
    faces: Sequence[Face]

    def walked(self, loop: CurveLoop) -> list[Curve]:
        """The curves of a loop in the direction in which it is walked."""
        return [self.curves[i] if forward else self.curves[i].reversed() for i, forward in loop]

    def selected(self, numbers: Sequence[int], faces: Sequence[Face]) -> Drawing:
        """The curves of some ``numbers``, in this order, and ``faces`` between them."""
        place = {number: k for k, number in enumerate(numbers)}
        renumbered = [
            Face(face.group, [[(place[i], forward) for i, forward in loop] for loop in face.loops])
            for face in faces
        ]
        return Drawing(
            curves=[self.curves[i] for i in numbers],
            nodes=[self.nodes[i] for i in numbers],
            groups=[self.groups[i] for i in numbers],
            faces=renumbered,
        )

    def grouped(self, loop: CurveLoop) -> list[tuple[Curve, str]]:
        """The curves of a loop, as it is walked, each with its group."""
        return list(zip(self.walked(loop), (self.groups[i] for i, _ in loop), strict=True))

    def moments(self, loops: Sequence[CurveLoop]) -> Array:
        """Area within loops, counterclockwise positive, and its moments, (3,) [m^2], [m^3]."""
        return np.sum([enclosed(self.walked(loop)) for loop in loops], axis=0)

    def polygon(self, loops: Sequence[CurveLoop], tolerance: float) -> shapely.Polygon:
        """The polygon of a face within ``tolerance`` [m], the outer one of its loops first."""
        outer, *holes = (ring(self.walked(loop), tolerance) for loop in loops)
        return shapely.Polygon(outer, holes)

    def faces_beside(
        self, sides: Sequence[CurveSide], tolerance: float
    ) -> list[list[list[CurveSide]]]:
        """The faces on the left of some sides: of each the outer loop, then its holes.

        Curves of which one end is no end of another side do not close. The ``tolerance`` is that of
        the polygons by which holes are found [m].
        """
        curves = self.walked(sides)
        ends = [self.nodes[i] if forward else self.nodes[i][::-1] for i, forward in sides]
        loops = _directed_loops(curves, ends)
        nests = _nested([[curves[k] for k in loop] for loop in loops], tolerance)
        return [[[sides[k] for k in loops[number]] for number in nest] for nest in nests]

    def outlines(self, faces: Sequence[Face], tolerance: float) -> list[list[list[CurveSide]]]:
        """The boundary of some faces together: for each piece the outer loop, then its holes.

        The faces are on the left of the loops; the ``tolerance`` is that of `faces_beside`.
        """
        return self.faces_beside(outer_sides(faces), tolerance)


def outer_sides(faces: Sequence[Face]) -> list[CurveSide]:
    """The sides that bound one of some faces alone; forward where it is on the left."""
    around = [side for face in faces for loop in face.loops for side in loop]
    walked_both_ways = set(around)
    return [(i, forward) for i, forward in around if (i, not forward) not in walked_both_ways]


def _directed_loops(curves: Sequence[Curve], nodes: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Numbers of curves along each closed loop."""
    leaving: dict[int, list[int]] = {}
    for i, (start, _) in enumerate(nodes):
        leaving.setdefault(start, []).append(i)
    unused, loops = set(range(len(curves))), []
    for begin in range(len(curves)):
        if begin not in unused:
            continue
        loop = [begin]
        unused.discard(begin)
        while True:
            current = loop[-1]
            options = [i for i in leaving.get(nodes[current][1], []) if i in unused or i == begin]
            if not options:
                raise RuntimeError("outline: a boundary does not close; please report this")
            back = -curves[current].slope(np.array([1.0]))[0]
            if len(options) > 1:
                options.sort(key=lambda i: _clockwise(back, curves[i].slope(np.zeros(1))[0]))
            if options[0] == begin:
                break
            loop.append(options[0])
            unused.discard(options[0])
        loops.append(loop)
    return loops


def _clockwise(a: Array, b: Array) -> float:
    """The clockwise angle from one direction to another, in (0, 2 pi]."""
    angle = -np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)
    return float(angle if angle > 1e-9 else angle + 2.0 * np.pi)


def _nested(loops: Sequence[Sequence[Curve]], tolerance: float) -> list[list[int]]:
    """Numbers of the loops of each face: a counterclockwise one, then the holes in it."""
    areas = np.array([enclosed(loop)[0] for loop in loops])
    shapes = np.array([shapely.Polygon(ring(loop, tolerance)) for loop in loops], dtype=object)
    outer, holes = np.flatnonzero(areas > 0.0), np.flatnonzero(areas <= 0.0)
    points_in_holes = shapely.point_on_surface(shapes[holes])
    pairs = shapely.STRtree(shapes[outer]).query(points_in_holes, predicate="intersects")
    hole, around = holes[pairs[0]], outer[pairs[1]]

    # a face that fills a hole has the hole's loop, walked the other way, and is not around it
    is_larger = areas[around] > -areas[hole] * (1.0 + _ROUND_OFF)
    hole, around = hole[is_larger], around[is_larger]

    # a hole lies in the smallest of the faces around it
    order = np.lexsort((areas[around], hole))
    hole, around = hole[order], around[order]
    smallest = np.unique(hole, return_index=True)[1]
    loops_of_face = {i: [i] for i in outer.tolist()}
    for face, hole_in_face in zip(around[smallest].tolist(), hole[smallest].tolist(), strict=True):
        loops_of_face[face].append(hole_in_face)
    return list(loops_of_face.values())


def ring(loop: Sequence[Curve], tolerance: float) -> Array:
    """The vertices (n, 2) of a closed loop within ``tolerance`` [m], at least three of them."""
    vertices = polygon(loop, tolerance)
    if len(vertices) < 3:  # two curves that are almost straight
        vertices = np.concatenate([curve.at(np.linspace(0.0, 0.9, 10)) for curve in loop])
    return vertices
