# SPDX-License-Identifier: MIT
"""Faces between directed curves in the plane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from ..arrays import Array
from .curves import Curve, enclosed, polygon

#: Share by which areas of the same loop differ by round-off
_ROUND_OFF = 1e-9


def directed_faces(
    curves: Sequence[Curve], nodes: Sequence[tuple[int, int]], tolerance: float
) -> list[list[list[int]]]:
    """Faces on the left of curves: numbers of curves along the outer loop of each, then its holes.

    The ``nodes`` are the numbers of the ends of each curve; one alone does not join faces. The
    ``tolerance`` is that of the polygons by which holes are found [m].
    """
    loops = _directed_loops(curves, nodes)
    nests = _nested([[curves[i] for i in loop] for loop in loops], tolerance)
    return [[loops[i] for i in nest] for nest in nests]


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


def _nested(closed: Sequence[Sequence[Curve]], tolerance: float) -> list[list[int]]:
    """Loops of faces by number: counterclockwise ones, each followed by the holes in it."""
    areas = [float(enclosed(loop)[0]) for loop in closed]
    shapes = [shapely.Polygon(ring(loop, tolerance)) for loop in closed]
    nests = {i: [i] for i, area in enumerate(areas) if area > 0.0}
    for i, area in enumerate(areas):
        if area > 0.0:
            continue
        inside = shapes[i].representative_point()
        # the same loop, walked forwards, is around another face
        larger = [j for j in nests if areas[j] > -area * (1.0 + _ROUND_OFF)]
        around = [j for j in larger if shapes[j].covers(inside)]
        if around:
            nests[min(around, key=lambda j: areas[j])].append(i)
    return list(nests.values())


def ring(loop: Sequence[Curve], tolerance: float) -> Array:
    """The vertices (n, 2) of a closed loop within ``tolerance`` [m], at least three of them."""
    vertices = polygon(loop, tolerance)
    if len(vertices) < 3:  # two curves that are almost straight
        vertices = np.concatenate([curve.at(np.linspace(0.0, 0.9, 10)) for curve in loop])
    return vertices
