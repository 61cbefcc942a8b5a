# SPDX-License-Identifier: MIT
"""Mirror lines, in space planes: the symmetry of designs, found in bodies."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Integers
from ..fem import Array, Domain

#: Images of a point at most: more are needed only by lines whose angles have no common measure
MOST = 96
#: Distance of a point in a cell from the nearest centroid at most, in edges of a square as large
NEAR = 0.75
#: Angle of principal axes with the axes of the coordinates that counts as none [degrees]
ANGLE = 0.05
#: Share of a body that may be without an image, and by which a gradient may differ from its image
SHARE = 0.02


@dataclass(frozen=True)
class Mirror:
    """A line in the plane of the body, in space a plane.

    Raises:
        ValueError: If the normal has no length, or a number is not finite.
    """

    point: tuple[float, ...]  #: On the line or plane, shape (dimension,) [m]
    normal: tuple[float, ...]  #: Perpendicular to it, of any length, shape (dimension,)

    def __post_init__(self) -> None:
        d = 3 if np.shape(self.point) == (3,) else 2
        needed = "two components, in space three"
        validation.real_array("mirror: point", self.point, (d,), expected=needed)
        needed = "as many components as the point"
        validation.direction("mirror: normal", self.normal, d, expected=needed)

    @property
    def reflection(self) -> Isometry:
        """To the other side of the line or plane."""
        point, n = np.array([self.point, self.normal], dtype=np.float64)
        n /= np.linalg.norm(n)
        turn = np.eye(len(n)) - 2.0 * np.outer(n, n)
        return Isometry(turn, point - turn @ point)


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


def images(mirrors: Sequence[Mirror], dimension: int = 2) -> list[Isometry]:
    """All isometries that mirrors generate, the identity first; ValueError if they have no end."""
    found = [Isometry(np.eye(dimension), np.zeros(dimension))]
    reflections = [mirror.reflection for mirror in mirrors]
    scale = max((float(np.max(np.abs(r.shift))) for r in reflections), default=0.0) or 1.0
    for known in found:  # which grows meanwhile
        for candidate in (r.after(known) for r in reflections):
            if not any(
                np.allclose(candidate.turn, other.turn, rtol=0.0, atol=1e-9)
                and np.allclose(candidate.shift, other.shift, rtol=0.0, atol=1e-9 * scale)
                for other in found
            ):
                found.append(candidate)
            if len(found) > MOST:
                raise ValueError(
                    f"mirrors: {list(mirrors)} have more than {MOST} images of a point: the lines "
                    "must meet in one point at angles that divide the circle; take fewer"
                )
    return found


def image_cells(domain: Domain, mirror: Mirror) -> Integers | str:
    """The cell nearest to the image of each, shape (cells of all ranks,), or why there is none."""
    found = domain.centroids, domain.cell_volumes, domain.design_cells
    centroids, volumes, designed = map(domain.everywhere, found)
    distance, nearest = cKDTree(centroids).query(mirror.reflection(centroids))
    size = np.maximum(volumes, volumes[nearest]) ** (1.0 / domain.dimension)
    # where triangles are graded, the image of a few may be farther from all centroids
    off = volumes @ (distance > NEAR * size)
    if off > SHARE * volumes.sum() or np.any(distance > 2.0 * NEAR * size):
        far = float(np.max(distance))
        return f"{100 * off / volumes.sum():.2g} % of it have no image, as far as {far:.3g} m off"
    other = volumes @ (designed != designed[nearest])
    if other > SHARE * volumes.sum():
        return f"{100 * other / volumes.sum():.2g} % of it are designed and their image is not"
    return np.asarray(nearest)


def mirror_lines(domain: Domain, gradient: Array | None = None) -> list[Mirror]:
    """The lines through the centroid of a body about which it is its own mirror image.

    Candidates are the axes of the coordinates and the principal axes of the area, and lines in
    steps of 15 degrees where those are not unique. The image of each cell must lie on the body, to
    less than a cell, and be designed like the cell.

    A symmetric body has a symmetric best design only if its loads are symmetric too: give the
    gradient of an even density, which confirms it.

    Args:
        domain: The body.
        gradient: Derivative of the objective with respect to the densities of this rank's cells at
            a symmetric density, shape (cells,); it may differ from its image by 2 % (Euclidean
            norm, per area). None asks about the body alone.

    Returns:
        The lines that are confirmed, the same on every rank.

    Warns:
        UserWarning: If there is none, with the reason for each candidate.
    """
    center, spread, axes = _principal_axes("mirror lines", domain, 2)
    angles = {15.0 * k for k in range(12)}
    if spread[1] - spread[0] > 1e-3 * spread[1]:
        angles = {0.0, 90.0}
        own = math.degrees(math.atan2(axes[1, 0], axes[0, 0])) % 90.0
        if ANGLE < own < 90.0 - ANGLE:  # else it is that of a coordinate, but for the mesh
            angles |= {round(own, 6), round(own + 90.0, 6)}
    turns = map(math.radians, sorted(angles))
    normals = [(-math.sin(turn), math.cos(turn)) for turn in turns]
    return _confirmed("mirror lines", domain, center, normals, gradient)


def mirror_planes(domain: Domain, gradient: Array | None = None) -> list[Mirror]:
    """The planes through the centroid of a body in space about which it is its own mirror image.

    Candidates are the planes across the axes of the coordinates and across the principal axes of
    the volume, and those between two axes of the coordinates with the same second moments.
    ``domain`` and ``gradient``, result and warning are as for `mirror_lines`.
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
    return _confirmed("mirror planes", domain, center, normals, gradient)


def _principal_axes(what: str, domain: Domain, dimension: int) -> tuple[Array, Array, Array]:
    """The centroid of a body, its second moments along its principal axes, and these."""
    validation.instance(f"{what}: domain", domain, Domain, "a Domain")
    if domain.dimension != dimension:
        other = "mirror_lines" if dimension == 3 else "mirror_planes"
        raise ValueError(f"{what}: the body has {domain.dimension} dimensions; take {other}")
    centroids, volumes = map(domain.everywhere, (domain.centroids, domain.cell_volumes))
    center = volumes @ centroids / volumes.sum()
    offset = centroids - center
    spread, axes = np.linalg.eigh((offset * volumes[:, None]).T @ offset)
    return center, spread, axes


def _confirmed(
    what: str,
    domain: Domain,
    center: Array,
    normals: Iterable[Iterable[float]],
    gradient: Array | None,
) -> list[Mirror]:
    """The mirrors through a center that the body has, and the gradient if there is one."""
    parts = domain.centroids, domain.cell_volumes, domain.design_cells
    centroids, volumes, designed = map(domain.everywhere, parts)
    density = None
    if gradient is not None:
        given = validation.real_array(f"{what}: gradient", gradient, (domain.n_cells,))
        density = domain.everywhere(given) / volumes * designed
        # the image of a cell of an unstructured mesh lies between others
        interpolated = LinearNDInterpolator(centroids, density)
    found, reasons = [], []
    for normal in normals:
        mirror = Mirror(tuple(center.tolist()), tuple(map(float, normal)))
        nearest, reason = image_cells(domain, mirror), ""
        if isinstance(nearest, str):
            reason = nearest
        elif density is not None:
            image = interpolated(mirror.reflection(centroids))
            image = np.where(np.isnan(image), density[nearest], image)  # beyond all centroids
            difference = np.sqrt(volumes @ (density - image) ** 2)
            whole = np.sqrt(volumes @ density**2)
            if difference > SHARE * whole:
                off = 100 * difference / whole
                reason = f"the gradient differs by {off:.2g} % from its image"
        if reason:
            reasons.append(f"{mirror}: {reason}")
        else:
            found.append(mirror)
    if not found:
        warnings.warn(
            f"{what}: none of the body through its centroid; looked for were "
            f"{'; '.join(reasons)}; a mesh with mirror images of its cells has them, and others "
            "than these can be given by hand",
            stacklevel=3,
        )
    return found
