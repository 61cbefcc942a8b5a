# SPDX-License-Identifier: MIT
"""Mirror lines: those that a design shall have, and those that a body has.

A design with mirror lines is the mean of a field over all of its mirror images, so that it is
symmetric exactly, whatever the mesh and the knots.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .. import validation
from ..fem import Domain

__all__ = ["Isometry", "Mirror", "image_cells", "images", "mirror_lines"]

Array = NDArray[np.float64]

#: Images of a point at most: more are needed only by lines whose angles have no common measure
MOST = 96


@dataclass(frozen=True)
class Mirror:
    """A line in the plane of the body.

    Args:
        point: On the line [m].
        direction: Along the line, of any length.

    Raises:
        ValueError: If the direction has no length, or a number is not finite.
    """

    point: tuple[float, float]
    direction: tuple[float, float]

    def __post_init__(self) -> None:
        """Check the numbers."""
        point = validation.real_array("mirror: point", self.point, (2,))
        direction = validation.real_array("mirror: direction", self.direction, (2,))
        if not np.all(np.isfinite([point, direction])) or not np.any(direction):
            raise ValueError(
                f"mirror: the line through {self.point} along {self.direction} must have finite "
                "coordinates and a direction"
            )

    @property
    def reflection(self) -> Isometry:
        """To the other side of the line."""
        along = np.asarray(self.direction, dtype=np.float64)
        along = along / np.linalg.norm(along)
        turn = 2.0 * np.outer(along, along) - np.eye(2)
        point = np.asarray(self.point, dtype=np.float64)
        return Isometry(turn, point - turn @ point)


@dataclass(frozen=True, eq=False)
class Isometry:
    """X -> turn X + shift, which leaves all distances."""

    turn: Array  #: Orthogonal, shape (2, 2)
    shift: Array  #: (2,) [m]

    def __call__(self, points: Array) -> Array:
        """The images of ``points`` (n, 2) [m]."""
        return np.asarray(points @ self.turn.T + self.shift)

    def after(self, other: Isometry) -> Isometry:
        """First the other one, then this one."""
        return Isometry(self.turn @ other.turn, self.turn @ other.shift + self.shift)


def images(mirrors: Sequence[Mirror]) -> list[Isometry]:
    """All isometries that mirror lines generate, the identity first.

    Args:
        mirrors: The lines.

    Raises:
        ValueError: If there is no end of them: parallel lines, lines without a common point, or
            lines at angles that do not divide the circle.
    """
    found = [Isometry(np.eye(2), np.zeros(2))]
    reflections = [mirror.reflection for mirror in mirrors]
    scale = max((float(np.max(np.abs(r.shift))) for r in reflections), default=0.0) or 1.0
    new = list(found)
    while new:
        candidates = [r.after(known) for known in new for r in reflections]
        new = []
        for candidate in candidates:
            if not any(
                np.allclose(candidate.turn, known.turn, rtol=0.0, atol=1e-9)
                and np.allclose(candidate.shift, known.shift, rtol=0.0, atol=1e-9 * scale)
                for known in found
            ):
                found.append(candidate)
                new.append(candidate)
            if len(found) > MOST:
                raise ValueError(
                    f"mirrors: {list(mirrors)} have more than {MOST} images of a point: the lines "
                    "must meet in one point at angles that divide the circle; take fewer"
                )
    return found


def image_cells(domain: Domain, mirror: Mirror) -> NDArray[np.int64] | None:
    """The cell nearest to the image of each cell, or None where that is not on the body.

    Args:
        domain: The body.
        mirror: The line.

    Returns:
        Shape (cells of all ranks,), in the order of `Domain.everywhere`, the same on every rank.
    """
    centroids = np.asarray(domain.everywhere(domain.centroids))
    volumes = np.asarray(domain.everywhere(domain.cell_volumes))
    designed = np.asarray(domain.everywhere(domain.design_cells))
    distance, nearest = cKDTree(centroids).query(mirror.reflection(centroids))
    if np.any(distance > 0.75 * np.sqrt(np.maximum(volumes, volumes[nearest]))):
        return None
    if volumes @ (designed != designed[nearest]) > 0.02 * volumes.sum():
        return None
    return np.asarray(nearest)


def mirror_lines(
    domain: Domain, gradient: Array | None = None, *, tolerance: float = 0.02
) -> list[Mirror]:
    """The axes through the centroid of a body about which it is its own mirror image.

    Looked for are the axes of the coordinates and the principal axes of the area, and lines in
    steps of 15 degrees where those are not unique. The image of each cell must lie on the body, to
    less than a cell, and what is not designed on what is not.

    A symmetric body has a symmetric best design only if its loads are symmetric too: give the
    gradient of an even density, which confirms it.

    Args:
        domain: The body.
        gradient: Derivative of the objective with respect to the densities of this rank's cells at
            a symmetric density, shape (cells,); None asks about the body alone.
        tolerance: By how much the gradient may differ from its image, relatively (Euclidean norm,
            per area).

    Returns:
        The lines that are confirmed, the same on every rank.
    """
    validation.instance("mirror lines: domain", domain, Domain, "a Domain")
    validation.number("mirror lines: tolerance", tolerance, least=0.0)
    centroids = np.asarray(domain.everywhere(domain.centroids))
    volumes = np.asarray(domain.everywhere(domain.cell_volumes))
    designed = np.asarray(domain.everywhere(domain.design_cells))
    center = volumes @ centroids / volumes.sum()
    offset = centroids - center
    moments = (offset * volumes[:, None]).T @ offset
    angles = {0.0, 90.0}
    spread, axes = np.linalg.eigh(moments)
    if spread[1] - spread[0] > 1e-3 * spread[1]:
        angles |= {
            float(round(math.degrees(math.atan2(*axis[::-1])) % 180.0, 6)) for axis in axes.T
        }
    else:
        angles |= {15.0 * k for k in range(12)}
    density = None
    if gradient is not None:
        given = validation.real_array("mirror lines: gradient", gradient, (domain.n_cells,))
        density = np.asarray(domain.everywhere(given)) / volumes * designed
    found = []
    for angle in sorted(angles):
        direction = (math.cos(math.radians(angle)), math.sin(math.radians(angle)))
        mirror = Mirror((float(center[0]), float(center[1])), direction)
        nearest = image_cells(domain, mirror)
        if nearest is None:
            continue
        if density is not None:
            difference = np.sqrt(volumes @ (density - density[nearest]) ** 2)
            if difference > tolerance * np.sqrt(volumes @ density**2):
                continue
        found.append(mirror)
    return found
