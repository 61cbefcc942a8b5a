# SPDX-License-Identifier: MIT
"""Exactly symmetric curves: one control of each mirrored pair is independent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from ..arrays import Array, Integers
from ..design import Isometry
from ..fem import CurveError, connected
from .curve import FreeCurve
from .sides import Run


class ControlPairs(NamedTuple):
    """Controls of two curves, or of one, that are images of each other."""

    curve: int
    controls: Integers  #: Of that curve, (n,)
    image: int  #: Number of the other curve
    image_controls: Integers  #: Of the other curve, (n,)


def fitted(
    runs: Sequence[Run], spacing: float, isometries: Sequence[Isometry]
) -> tuple[dict[int, FreeCurve], dict[int, Integers]]:
    """Curves along the runs, and the number of the orbit of each of their controls.

    Controls of holes are the ``spacing`` [m] apart, those of outlines twice that. Controls of one
    orbit have the same offset along their normals. Raises a CurveError if a curve has no mirror
    image.
    """
    not_identity = isometries[1:]
    lines = np.array([_line(run) for run in runs])
    image_of = [_images(run, lines, not_identity, spacing) for run in runs]
    curves: dict[int, FreeCurve] = {}
    pairs: list[ControlPairs] = []
    for j, run in enumerate(runs):
        if j in curves:
            continue
        to_image = list(zip(not_identity, image_of[j], strict=True))
        onto_itself = [isometry for isometry, k in to_image if k == j]
        curves[j], permutations = _symmetric_curve(run, spacing, onto_itself)
        for controls in permutations:
            pairs.append(ControlPairs(j, np.arange(len(controls)), j, controls))
        for isometry, k in to_image:
            if k not in curves:
                curves[k], controls = _image(curves[j], isometry, runs[k])
                pairs.append(ControlPairs(j, np.arange(len(controls)), k, controls))
    curves = dict(sorted(curves.items()))
    return curves, _orbits(curves, pairs)


def _orbits(curves: dict[int, FreeCurve], pairs: Sequence[ControlPairs]) -> dict[int, Integers]:
    """The number of the orbit of each control, (controls,) by curve."""
    # controls are numbered through all curves
    counts = [len(curve.control) for curve in curves.values()]
    first_control = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)

    no_controls = np.zeros(0, int)  # without pairs there is nothing else to concatenate
    controls = [no_controls, *(first_control[pair.curve] + pair.controls for pair in pairs)]
    images = [no_controls, *(first_control[pair.image] + pair.image_controls for pair in pairs)]
    edges = np.column_stack([np.concatenate(controls), np.concatenate(images)])
    orbit = connected(edges, int(first_control[-1])).astype(np.int64)
    return {key: orbit[first_control[key] : first_control[key + 1]] for key in curves}


def _images(
    run: Run, lines: NDArray[np.object_], isometries: Sequence[Isometry], near: float
) -> list[int]:
    """The number of the run that is the image of this one by each isometry, up to ``near`` [m]."""
    numbers, boxes = [], shapely.bounds(lines)
    for isometry in isometries:
        image = _line(Run(isometry(run.points), run.nodes))
        # lines are no nearer to each other than the boxes around them, which cost next to nothing
        distance = np.max(np.abs(boxes - shapely.bounds(image)), axis=1)
        close = distance <= near
        distance[close] = shapely.hausdorff_distance(image, lines[close])
        nearest = int(np.argmin(distance))
        if distance[nearest] > near:
            x, y = 1e3 * np.mean(run.points, axis=0)
            raise CurveError(
                f"boundary: the curve near ({x:.4g}, {y:.4g}) mm has no mirror image within "
                f"{1e3 * near:.3g} mm; give a design with these mirrors, or leave the mirrors "
                "out"
            )
        numbers.append(nearest)
    return numbers


def _line(run: Run) -> shapely.LineString:
    """The points of a run joined by lines; a ring ends at its first point."""
    return shapely.LineString(run.points if run.nodes else np.vstack([run.points, run.points[:1]]))


def _symmetric_curve(
    run: Run, spacing: float, isometries: Sequence[Isometry]
) -> tuple[FreeCurve, list[Integers]]:
    """A curve that isometries map onto itself, and the images of its controls by each of them."""
    points, closed = run.points, run.nodes is None
    reflection = next((g for g in isometries if _is_reflection(g)), None)
    if closed and reflection is not None:
        points = _from_line(points, reflection)
    distance = spacing if closed else 2.0 * spacing
    multiple = 2 * len(isometries) if isometries else 1
    curve = FreeCurve.fit(points, distance, run.nodes, multiple=multiple)

    # each control becomes the mean of those that the isometries map to its place
    control = curve.control.copy()
    permutations = [_permutation(control, isometry, closed) for isometry in isometries]
    inner = ~curve.fixed
    for isometry, numbers in zip(isometries, permutations, strict=True):
        image = np.empty_like(control)
        image[numbers] = isometry(curve.control)
        control[inner] += image[inner]
    control[inner] /= 1.0 + len(isometries)
    return curve.moved(control), permutations


def _is_reflection(isometry: Isometry) -> bool:
    return bool(np.linalg.det(isometry.turn) < 0.0)


def _permutation(control: Array, isometry: Isometry, closed: bool) -> Integers:
    """The number of the control at the image of each."""
    n = len(control)
    order = np.arange(n)[::-1] if _is_reflection(isometry) else np.arange(n)
    if not closed:
        return order
    images = isometry(control)
    deviations = [np.sum((images - control[(order + shift) % n]) ** 2) for shift in range(n)]
    return np.asarray((order + int(np.argmin(deviations))) % n)


def _image(curve: FreeCurve, isometry: Isometry, run: Run) -> tuple[FreeCurve, Integers]:
    """The image of a curve, which ends where the run does, and the number of each control there."""
    control = isometry(curve.control)
    numbers = np.arange(len(control))
    if _is_reflection(isometry):  # the material stays on the left
        control, numbers = control[::-1], numbers[::-1]
    if run.nodes is not None:
        control = np.vstack([run.points[:1], control[1:-1], run.points[-1:]])
    return FreeCurve(np.ascontiguousarray(control), run.nodes), numbers


def _from_line(ring: Array, reflection: Isometry) -> Array:
    """A ring (n, 2) that begins on the line of a reflection, (n + 1, 2) [m]."""
    # a point and its image are apart across the line: the longest such vector is its normal
    across = ring - reflection(ring)
    normal = across[np.argmax(np.einsum("ij,ij->i", across, across))]
    side = across @ normal

    next_side = np.roll(side, -1)
    k = int(np.flatnonzero((side <= 0.0) & (next_side > 0.0))[0])
    share = side[k] / (side[k] - next_side[k])
    start = (1.0 - share) * ring[k] + share * ring[(k + 1) % len(ring)]
    return np.vstack([start, np.roll(ring, -(k + 1), axis=0)])
