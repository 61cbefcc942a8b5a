# SPDX-License-Identifier: MIT
"""Which sides of a drawing stay, and along which points those run that may move."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from ..arrays import Array
from ..fem import CurveError, Drawing
from .spurs import cross


@dataclass(frozen=True)
class Side:
    """A curve of a loop: number among those that stay or those that move, and its direction."""

    free: bool
    number: int
    forward: bool = True


Loops = tuple[tuple[str, tuple[tuple[Side, ...], ...]], ...]
#: Curves of a drawing one after the other, by number and whether they run forwards
Curves = list[tuple[int, bool]]


@dataclass(frozen=True, eq=False)
class Run:
    """Points along sides that may move: a closed ring, or from one curve that stays to another."""

    points: Array  #: (n, 2), the first point of a ring is not repeated [m]
    nodes: tuple[int, int] | None  #: Of the drawing at both ends, None of a ring


def sides_of(
    given: Drawing,
    edge: shapely.Geometry,
    near: float,
    outline: bool = True,
    holes: shapely.Geometry | None = None,
) -> tuple[list[Run], Loops]:
    """The runs that may move, by number, and all faces by their sides.

    Interfaces, solid regions and what lies between them stay. A void beside a solid region becomes
    a hole of its own, and a run that meets the side of a solid region goes on along it to where it
    ends: so there is no notch without a radius, where stress would have no limit. ``edge`` is the
    outline of the whole body, found to a distance ``near`` [m]: what lies on it moves only where
    the ``outline`` is free. What lies on drawn ``holes`` stays.
    """
    groups: list[set[str]] = [set() for _ in given.curves]
    for face in given.faces:
        for loop in face.loops:
            for i, _ in loop:
                groups[i].add(face.group)
    middles = shapely.points([curve.at(np.array([0.5]))[0] for curve in given.curves])
    within = shapely.distance(middles, edge) > near
    of = [next(iter(group)) if len(group) == 1 else "" for group in groups]
    drawn = shapely.intersects(middles, holes or shapely.MultiPolygon())
    may_move = within | (outline & ~drawn)
    free = [
        a == "design" and not name and may
        for a, name, may in zip(of, given.groups, may_move, strict=True)
    ]
    inside = [
        a == "solid" and not name and deep
        for a, name, deep in zip(of, given.groups, within, strict=True)
    ]
    ends = _Ends(given)
    runs: list[Run] = []

    def added(points: Array, nodes: tuple[int, int] | None = None) -> Side:
        runs.append(Run(points, nodes))
        return Side(True, len(runs) - 1)

    faces: list[tuple[str, tuple[tuple[Side, ...], ...]]] = []
    # sides of solid regions beside void, and all others of designed regions, by their first node
    solid: dict[int, Curves] = {}
    moving: dict[int, Curves] = {}
    staying: list[Curves] = []
    loops: list[tuple[tuple[Side, ...], Array]] = []
    for face in given.faces:
        for loop in face.loops:
            if face.group == "solid":
                solid |= {ends.first(run): run for run, chosen in _runs(loop, inside) if chosen}
            elif all(free[i] for i, _ in loop):
                points = ends.points(loop)
                loops.append(((added(points),), points))
            else:
                for run, chosen in _runs(loop, free):
                    if chosen:
                        moving[ends.first(run)] = run
                    else:
                        staying.append(run)
        if face.group == "solid":
            stay = tuple(tuple(Side(False, i, way) for i, way in loop) for loop in face.loops)
            faces.append((face.group, stay))
    for first in list(moving):
        if chain := _chain(first, moving, solid, ends):
            staying += [ends.back(run) for run in chain if run is not moving[first]]
            del moving[first]
            moving[ends.first(chain[0])] = [side for run in chain for side in run]
        elif ring := _ring(first, moving, solid, ends):
            points = np.vstack([ends.points(run) for run in ring])
            loops.append(((added(points),), points))
            for run in ring[::2]:
                del moving[ends.first(run)]
            staying += map(ends.back, ring[1::2])
    whole = {ends.first(run): run for run in [*staying, *moving.values()]}
    while whole:
        around: list[Side] = []
        drawn, node = [], next(iter(whole))
        while node in whole:
            run = whole.pop(node)
            drawn.append(ends.points(run))
            if moving.get(node) is run:
                pair = node, ends.last(run)
                around.append(added(np.vstack([drawn[-1], ends.end(run)[None]]), pair))
            else:
                around += [Side(False, i, way) for i, way in run]
            node = ends.last(run)
        loops.append((tuple(around), np.vstack(drawn)))
    return runs, (*faces, *_faces(loops))


def _ring(
    first: int, moving: dict[int, Curves], solid: dict[int, Curves], ends: _Ends
) -> list[Curves]:
    """Around a void between designed and solid regions, runs of both in turn, or nothing."""
    ring: list[Curves] = []
    node = first
    for beside in (moving, solid) * len(moving):
        if node not in beside or beside[node] in ring:
            return []
        ring.append(beside[node])
        node = ends.last(beside[node])
        if node == first and beside is solid:
            return ring
    return []


def _chain(
    first: int, moving: dict[int, Curves], solid: dict[int, Curves], ends: _Ends
) -> list[Curves]:
    """A run with those along solid regions before and after it that are beside no other run."""
    if first not in moving:
        return []
    starts, stops = (set(map(end, moving.values())) for end in (ends.first, ends.last))
    before = next((run for run in solid.values() if ends.last(run) == first), None)
    after = solid.get(ends.last(moving[first]))
    chain = [before] if before and ends.first(before) not in stops else []
    chain.append(moving[first])
    chain += [after] if after and ends.last(after) not in starts else []
    return chain if len(chain) > 1 else []


def _faces(
    loops: Sequence[tuple[tuple[Side, ...], Array]],
) -> Iterator[tuple[str, tuple[tuple[Side, ...], ...]]]:
    """Loops around designed regions, counterclockwise, each with the holes in it, clockwise."""
    # runs that go on along a solid region go back there
    rings = [points if len(points) > 2 else np.zeros((0, 2)) for _, points in loops]
    shapes = [shapely.Polygon(points).buffer(0.0) for points in rings]
    outer = [k for k, (_, x) in enumerate(loops) if np.sum(cross(x, np.roll(x, -1, axis=0))) > 0.0]
    within: dict[int, list[int]] = {k: [] for k in sorted(outer, key=lambda k: shapes[k].area)}
    for k in range(len(loops)):
        if k not in within:
            # one along the rim of a bore may touch the outline, and leave it by round-off
            half = 0.5 * shapes[k].area
            around = next((j for j in within if shapes[j].intersection(shapes[k]).area >= half), -1)
            if around < 0:
                raise CurveError("boundary: a hole lies in no face, because curves cross")
            within[around].append(k)
    for k in outer:
        yield "design", tuple(loops[j][0] for j in (k, *within[k]))


class _Ends:
    """Ends and points of runs of a drawing's curves."""

    def __init__(self, drawing: Drawing) -> None:
        self.drawing = drawing

    def first(self, run: Sequence[tuple[int, bool]]) -> int:
        i, forward = run[0]
        return self.drawing.nodes[i][0 if forward else 1]

    def last(self, run: Sequence[tuple[int, bool]]) -> int:
        i, forward = run[-1]
        return self.drawing.nodes[i][1 if forward else 0]

    def end(self, run: Sequence[tuple[int, bool]]) -> Array:
        i, forward = run[-1]
        curve = self.drawing.curves[i]
        return curve.end if forward else curve.start

    def back(self, run: Curves) -> Curves:
        return [(i, not forward) for i, forward in run[::-1]]

    def points(self, run: Sequence[tuple[int, bool]]) -> Array:
        """Vertices of a fine polygon along a run, its last one left out, shape (n, 2) [m]."""
        found = []
        for i, forward in run:
            points = self.drawing.curves[i].points(2e-5)
            found.append((points if forward else points[::-1])[:-1])
        return np.vstack(found)


def _runs(
    loop: Sequence[tuple[int, bool]], chosen: Sequence[bool]
) -> Iterator[tuple[list[tuple[int, bool]], bool]]:
    """The loop in runs of curves that are chosen and of others, each as long as can be."""
    start = next((k for k, (i, _) in enumerate(loop) if chosen[i] != chosen[loop[k - 1][0]]), 0)
    run: list[tuple[int, bool]] = []
    for i, forward in [*loop[start:], *loop[:start]]:
        if run and chosen[run[-1][0]] != chosen[i]:
            yield run, chosen[run[-1][0]]
            run = []
        run.append((i, forward))
    yield run, chosen[run[-1][0]]
