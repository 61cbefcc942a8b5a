# SPDX-License-Identifier: MIT
"""Which sides of a drawing stay, and along which points those run that may move."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from ..fem import Drawing

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Side:
    """A curve of a loop: number among those that stay or those that move, and its direction."""

    free: bool
    number: int
    forward: bool = True


Loops = tuple[tuple[str, tuple[tuple[Side, ...], ...]], ...]


@dataclass(frozen=True, eq=False)
class Run:
    """Points along sides that may move: a closed ring, or from one curve that stays to another."""

    points: Array  #: (n, 2), the first point of a ring is not repeated [m]
    nodes: tuple[int, int] | None  #: Of the drawing at both ends, None of a ring


def sides_of(
    given: Drawing, edge: shapely.Geometry, near: float, outline: bool = True
) -> tuple[list[Run], Loops]:
    """The runs that may move, by number, and all faces by their sides.

    Interfaces, solid regions and what lies between them stay. A void beside a solid region becomes
    a hole of its own. ``edge`` is the outline of the whole body, found to a distance ``near`` [m]:
    what lies on it moves only where the ``outline`` is free.
    """
    groups: list[set[str]] = [set() for _ in given.curves]
    for face in given.faces:
        for loop in face.loops:
            for i, _ in loop:
                groups[i].add(face.group)
    middles = shapely.points([curve.at(np.array([0.5]))[0] for curve in given.curves])
    within = shapely.distance(middles, edge) > near
    of = [next(iter(group)) if len(group) == 1 else "" for group in groups]
    free = [
        a == "design" and not name and (outline or deep)
        for a, name, deep in zip(of, given.groups, within, strict=True)
    ]
    inside = [
        a == "solid" and not name and deep
        for a, name, deep in zip(of, given.groups, within, strict=True)
    ]
    ends = _Ends(given)
    beside = {}  # runs of a solid region beside void, by their ends
    for face in given.faces:
        if face.group == "solid":
            for loop in face.loops:
                for run, chosen in _runs(loop, inside):
                    if chosen:
                        beside[ends.first(run), ends.last(run)] = run
    runs: list[Run] = []

    def added(points: Array, nodes: tuple[int, int] | None = None) -> Side:
        runs.append(Run(points, nodes))
        return Side(True, len(runs) - 1)

    faces: list[tuple[str, tuple[tuple[Side, ...], ...]]] = []
    for face in given.faces:
        if face.group == "solid":
            stay = tuple(tuple(Side(False, i, way) for i, way in loop) for loop in face.loops)
            faces.append((face.group, stay))
            continue
        loops: list[tuple[Side, ...]] = []
        for loop in face.loops:
            if all(free[i] for i, _ in loop):
                loops.append((added(ends.points(loop)),))
                continue
            around: list[Side] = []
            for run, chosen in _runs(loop, free):
                pair = ends.first(run), ends.last(run)
                if not chosen:
                    around += [Side(False, i, way) for i, way in run]
                elif pair[::-1] in beside:
                    other = beside[pair[::-1]]
                    ring = np.vstack([ends.points(run), ends.points(other)])
                    loops.append((added(ring),))
                    around += [Side(False, i, not way) for i, way in other[::-1]]
                else:
                    whole = np.vstack([ends.points(run), ends.end(run)[None]])
                    around.append(added(whole, pair))
            loops.insert(0, tuple(around))
        faces.append((face.group, tuple(loops)))
    return runs, tuple(faces)


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
