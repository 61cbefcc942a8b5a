# SPDX-License-Identifier: MIT
"""Mirror lines, in space planes: those that a design shall have, and those that a body has.

A design with mirror lines is the mean of a field over all of its mirror images, so that it is
symmetric exactly, whatever the mesh and the knots.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import cKDTree

from .. import validation
from ..fem import Domain

__all__ = [
    "Isometry",
    "Mirror",
    "MirrorPlane",
    "image_cells",
    "images",
    "mirror_lines",
    "mirror_planes",
]

Array = NDArray[np.float64]

#: Images of a point at most: more are needed only by lines whose angles have no common measure
MOST = 96
#: Distance of a point in a cell from the nearest centroid at most, in edges of a square as large
NEAR = 0.75
#: Angle of principal axes with those of the coordinates that counts as none [degrees]
ANGLE = 0.05
#: Share of a body that may be without an image
SHARE = 0.02


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
        where = f"mirror: the line through {self.point} along {self.direction}"
        _check(where, "mirror", "direction", self.point, self.direction, 2)

    @property
    def reflection(self) -> Isometry:
        """To the other side of the line."""
        return _reflection(self.point, (-self.direction[1], self.direction[0]))


@dataclass(frozen=True)
class MirrorPlane:
    """A plane in space.

    Args:
        point: On the plane [m].
        normal: Perpendicular to it, of any length.

    Raises:
        ValueError: If the normal has no length, or a number is not finite.
    """

    point: tuple[float, float, float]
    normal: tuple[float, float, float]

    def __post_init__(self) -> None:
        """Check the numbers."""
        where = f"mirror plane: the plane through {self.point} across {self.normal}"
        _check(where, "mirror plane", "normal", self.point, self.normal, 3)

    @property
    def reflection(self) -> Isometry:
        """To the other side of the plane."""
        return _reflection(self.point, self.normal)


@dataclass(frozen=True, eq=False)
class Isometry:
    """X -> turn X + shift, which leaves all distances."""

    turn: Array  #: Orthogonal, shape (d, d)
    shift: Array  #: (d,) [m]

    def __call__(self, points: Array) -> Array:
        """The images of ``points`` (n, d) [m]."""
        return np.asarray(points @ self.turn.T + self.shift)

    def after(self, other: Isometry) -> Isometry:
        """First the other one, then this one."""
        return Isometry(self.turn @ other.turn, self.turn @ other.shift + self.shift)


def _check(
    where: str, what: str, kind: str, point: Sequence[float], vector: Sequence[float], d: int
) -> None:
    """Refuse a mirror without a place or a direction."""
    place = validation.real_array(f"{what}: point", point, (d,))
    axis = validation.real_array(f"{what}: {kind}", vector, (d,))
    if not np.all(np.isfinite([place, axis])) or not np.any(axis):
        raise ValueError(f"{where} must have finite coordinates and a {kind}")


def _reflection(point: Sequence[float], normal: Sequence[float]) -> Isometry:
    """To the other side of the line or plane through a point across a normal."""
    n = np.asarray(normal, dtype=np.float64)
    n = n / np.linalg.norm(n)
    turn = np.eye(len(n)) - 2.0 * np.outer(n, n)
    place = np.asarray(point, dtype=np.float64)
    return Isometry(turn, place - turn @ place)


def images(mirrors: Sequence[Mirror | MirrorPlane], dimension: int = 2) -> list[Isometry]:
    """All isometries that mirror lines or planes generate, the identity first.

    Args:
        mirrors: The lines, in space the planes.
        dimension: 2 in the plane, 3 in space.

    Raises:
        ValueError: If there is no end of them: parallel lines, lines without a common point, or
            lines at angles that do not divide the circle.
    """
    found = [Isometry(np.eye(dimension), np.zeros(dimension))]
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


def image_cells(domain: Domain, mirror: Mirror | MirrorPlane) -> NDArray[np.int64] | None:
    """The cell nearest to the image of each cell, or None where that is not on the body.

    Args:
        domain: The body.
        mirror: The line or plane.

    Returns:
        Shape (cells of all ranks,), in the order of `Domain.everywhere`, the same on every rank.
    """
    centroids = np.asarray(domain.everywhere(domain.centroids))
    volumes = np.asarray(domain.everywhere(domain.cell_volumes))
    designed = np.asarray(domain.everywhere(domain.design_cells))
    distance, nearest = cKDTree(centroids).query(mirror.reflection(centroids))
    size = np.maximum(volumes, volumes[nearest]) ** (1.0 / domain.dimension)
    # where triangles are graded, the image of a few may be farther from all centroids
    off = volumes @ (distance > NEAR * size)
    if off > SHARE * volumes.sum() or np.any(distance > 2.0 * NEAR * size):
        return None
    if volumes @ (designed != designed[nearest]) > SHARE * volumes.sum():
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
    center, spread, axes = _principal_axes("mirror lines", domain, 2)
    angles = {0.0, 90.0}
    if spread[1] - spread[0] > 1e-3 * spread[1]:
        own = math.degrees(math.atan2(axes[1, 0], axes[0, 0])) % 90.0
        if ANGLE < own < 90.0 - ANGLE:  # else it is that of a coordinate, but for the mesh
            angles |= {round(own, 6), round(own + 90.0, 6)}
    else:
        angles |= {15.0 * k for k in range(12)}
    middle = (float(center[0]), float(center[1]))
    candidates = [
        Mirror(middle, (math.cos(math.radians(angle)), math.sin(math.radians(angle))))
        for angle in sorted(angles)
    ]
    return _confirmed("mirror lines", domain, candidates, gradient, tolerance)


def mirror_planes(
    domain: Domain, gradient: Array | None = None, *, tolerance: float = 0.02
) -> list[MirrorPlane]:
    """The planes through the centroid of a body in space about which it is its own mirror image.

    Looked for are the planes across the axes of the coordinates and across the principal axes of
    the volume, and those between two axes of the coordinates about which the second moments are the
    same. All else is as for `mirror_lines`.

    Args:
        domain: The body.
        gradient: Derivative of the objective with respect to the densities of this rank's cells at
            a symmetric density, shape (cells,); None asks about the body alone.
        tolerance: By how much the gradient may differ from its image, relatively (Euclidean norm,
            per volume).

    Returns:
        The planes that are confirmed, the same on every rank.
    """
    center, spread, axes = _principal_axes("mirror planes", domain, 3)
    normals = list(np.eye(3))
    for i, axis in enumerate(axes.T):
        alone = np.min(np.abs(np.delete(spread, i) - spread[i])) > 1e-3 * spread[i]
        if alone and all(abs(axis @ normal) < 1.0 - 1e-6 for normal in normals):
            normals.append(axis)
    moments = np.diag((axes * spread) @ axes.T)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        if abs(moments[i] - moments[j]) < 1e-3 * moments[i]:  # as of a square section
            normals += [np.eye(3)[i] + np.eye(3)[j], np.eye(3)[i] - np.eye(3)[j]]
    x, y, z = (float(value) for value in center)
    candidates = [MirrorPlane((x, y, z), (float(n[0]), float(n[1]), float(n[2]))) for n in normals]
    return _confirmed("mirror planes", domain, candidates, gradient, tolerance)


def _principal_axes(what: str, domain: Domain, dimension: int) -> tuple[Array, Array, Array]:
    """The centroid of a body, its second moments along its principal axes, and these."""
    validation.instance(f"{what}: domain", domain, Domain, "a Domain")
    if domain.dimension != dimension:
        other = "mirror_lines" if dimension == 3 else "mirror_planes"
        raise ValueError(f"{what}: the body has {domain.dimension} dimensions; take {other}")
    centroids = np.asarray(domain.everywhere(domain.centroids))
    volumes = np.asarray(domain.everywhere(domain.cell_volumes))
    center = volumes @ centroids / volumes.sum()
    offset = centroids - center
    spread, axes = np.linalg.eigh((offset * volumes[:, None]).T @ offset)
    return center, spread, axes


AnyMirror = TypeVar("AnyMirror", Mirror, MirrorPlane)


def _confirmed(
    what: str, domain: Domain, candidates: list[AnyMirror], gradient: Array | None, tolerance: float
) -> list[AnyMirror]:
    """Those of some mirrors that the body has, and the gradient if there is one."""
    validation.number(f"{what}: tolerance", tolerance, least=0.0)
    volumes = np.asarray(domain.everywhere(domain.cell_volumes))
    density = None
    if gradient is not None:
        designed = np.asarray(domain.everywhere(domain.design_cells))
        given = validation.real_array(f"{what}: gradient", gradient, (domain.n_cells,))
        density = np.asarray(domain.everywhere(given)) / volumes * designed
        centroids = np.asarray(domain.everywhere(domain.centroids))
        # the image of a cell of an unstructured mesh lies between others
        interpolated = LinearNDInterpolator(centroids, density)
    found = []
    for mirror in candidates:
        nearest = image_cells(domain, mirror)
        if nearest is None:
            continue
        if density is not None:
            image = interpolated(mirror.reflection(centroids))
            image = np.where(np.isnan(image), density[nearest], image)  # beyond all centroids
            difference = np.sqrt(volumes @ (density - image) ** 2)
            if difference > tolerance * np.sqrt(volumes @ density**2):
                continue
        found.append(mirror)
    return found
