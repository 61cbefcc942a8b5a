# SPDX-License-Identifier: MIT
"""Exactly symmetric curves: one control of each mirrored pair is independent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from ..arrays import Array, Integers
from ..design import Isometry
from ..fem import CurveError, connected
from .curve import FreeCurve
from .sides import Run


def fitted(
    runs: Sequence[Run], spacing: float, isometries: Sequence[Isometry]
) -> tuple[dict[int, FreeCurve], dict[int, Integers]]:
    """Curves along the runs, and of each control the number of those that it moves with.

    Controls of holes are the ``spacing`` [m] apart, those of outlines twice that. Controls of one
    number have the same offset along their normals. ValueError if a curve has no mirror image.
    """
    others = isometries[1:]  # the first is the identity
    lines = np.array([_line(run) for run in runs])
    image = [_images(run, lines, others, spacing) for run in runs]
    curves: dict[int, FreeCurve] = {}
    pairs: list[tuple[int, Integers, int, Integers]] = []
    for j, run in enumerate(runs):
        if j in curves:
            continue
        own = [g for g, k in zip(others, image[j], strict=True) if k == j]
        curves[j], among = _alone(run, spacing, own)
        pairs += [(j, np.arange(len(to)), j, to) for to in among]
        for g, k in zip(others, image[j], strict=True):
            if k not in curves:
                curves[k], to = _image(curves[j], g, runs[k])
                pairs.append((j, np.arange(len(to)), k, to))
    curves = dict(sorted(curves.items()))
    sizes = [len(curve.control) for curve in curves.values()]
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    rows = np.concatenate([np.zeros(0, int), *(first[j] + a for j, a, _, _ in pairs)])
    columns = np.concatenate([np.zeros(0, int), *(first[k] + b for _, _, k, b in pairs)])
    n = int(first[-1])
    number = connected(np.column_stack([rows, columns]), n).astype(np.int64)
    return curves, {k: number[first[k] : first[k + 1]] for k in curves}


def _images(
    run: Run, lines: NDArray[np.object_], isometries: Sequence[Isometry], near: float
) -> list[int]:
    """The number of the run that each isometry makes of this one."""
    found, boxes = [], shapely.bounds(lines)
    for g in isometries:
        image = _line(Run(g(run.points), run.nodes))
        # lines are no nearer to each other than the boxes around them, which cost next to nothing
        far = np.max(np.abs(boxes - shapely.bounds(image)), axis=1)
        close = far <= near
        far[close] = shapely.hausdorff_distance(image, lines[close])
        k = int(np.argmin(far))
        if far[k] > near:
            x, y = 1e3 * np.mean(run.points, axis=0)
            raise CurveError(
                f"boundary: the curve near ({x:.4g}, {y:.4g}) mm has no mirror image within "
                f"{1e3 * near:.3g} mm; give a design with these mirrors, or leave the mirrors "
                "out"
            )
        found.append(k)
    return found


def _line(run: Run) -> shapely.LineString:
    """Its points joined by lines, a ring to its first one again."""
    return shapely.LineString(run.points if run.nodes else np.vstack([run.points, run.points[:1]]))


def _alone(run: Run, spacing: float, own: Sequence[Isometry]) -> tuple[FreeCurve, list[Integers]]:
    """A curve that these isometries leave, and where each takes its controls."""
    points, closed = run.points, run.nodes is None
    line = next((g for g in own if np.linalg.det(g.turn) < 0.0), None)
    if closed and line is not None:
        points = _from_line(points, line)
    step = spacing if closed else 2.0 * spacing
    curve = FreeCurve.fit(points, step, run.nodes, multiple=2 * len(own) if own else 1)
    control = curve.control.copy()
    taken = [_taken(control, g, closed) for g in own]
    inner = ~curve.fixed
    for g, to in zip(own, taken, strict=True):
        image = np.empty_like(control)
        image[to] = g(curve.control)
        control[inner] += image[inner]
    control[inner] /= 1.0 + len(own)
    return curve.moved(control), taken


def _taken(control: Array, g: Isometry, closed: bool) -> Integers:
    """The number of the control at the image of each."""
    n = len(control)
    turned = np.linalg.det(g.turn) < 0.0
    order = np.arange(n)[::-1] if turned else np.arange(n)
    if not closed:
        return order
    images = g(control)
    far = [np.sum((images - control[(order + s) % n]) ** 2) for s in range(n)]
    return np.asarray((order + int(np.argmin(far))) % n)


def _image(curve: FreeCurve, g: Isometry, run: Run) -> tuple[FreeCurve, Integers]:
    """The image of a curve, which ends where the run does, and the number of each control there."""
    turned = np.linalg.det(g.turn) < 0.0
    control = g(curve.control)
    to = np.arange(len(control))
    if turned:
        control, to = control[::-1], to[::-1]
    if run.nodes is not None:
        control = np.vstack([run.points[:1], control[1:-1], run.points[-1:]])
    return FreeCurve(np.ascontiguousarray(control), run.nodes), to


def _from_line(points: Array, reflection: Isometry) -> Array:
    """A ring from a place on the line of a reflection on."""
    across = points - reflection(points)
    normal = across[np.argmax(np.einsum("ij,ij->i", across, across))]
    side = across @ normal
    after = np.roll(side, -1)
    k = int(np.flatnonzero((side <= 0.0) & (after > 0.0))[0])
    share = side[k] / (side[k] - after[k])
    start = (1.0 - share) * points[k] + share * points[(k + 1) % len(points)]
    return np.vstack([start, np.roll(points, -(k + 1), axis=0)])
