# SPDX-License-Identifier: MIT
"""Mirror lines, in space planes: the symmetry of designs, found in bodies."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from .. import validation
from ..arrays import Integers
from ..fem import Array, Domain, _compat

#: Largest number of images of a point; lines need more if their angles have no common measure
MOST_IMAGES = 96
#: Largest distance of a point in a cell from the nearest centroid, in edges of a cube as large
NEAR = 0.75
#: Largest distance of the outline of a body from its image, in edges of a mean cell as a square
OUTLINE = 0.25
#: Angle below which principal axes differ from the coordinate axes only by the mesh [degrees]
ANGLE = 0.05
#: Radius of the means in which gradients are compared, in edges of a mean cell
MEAN = 2.5
#: Share of a body that may be without an image, and by which a gradient may differ from its image
SHARE = 0.02


@dataclass(frozen=True)
class Mirror:
    """A mirror line of a body in the plane, or a mirror plane of a body in space.

    Attributes:
        point: On the line or plane, shape (dimension,) [m].
        normal: Perpendicular to it, of any length, shape (dimension,).
    """

    point: tuple[float, ...]
    normal: tuple[float, ...]

    def __post_init__(self) -> None:
        d = 3 if np.shape(self.point) == (3,) else 2
        needed = "two components, in space three"
        validation.real_array("mirror: point", self.point, (d,), expected=needed)
        needed = "as many components as the point"
        validation.direction("mirror: normal", self.normal, d, expected=needed)

    @property
    def reflection(self) -> Isometry:
        """The map of points to the other side of the line or plane."""
        point, n = np.array([self.point, self.normal], dtype=np.float64)
        n /= np.linalg.norm(n)
        turn = np.eye(len(n)) - 2.0 * np.outer(n, n)
        return Isometry(turn, point - turn @ point)


@dataclass(frozen=True, eq=False)
class Isometry:
    """The map X -> turn X + shift, which preserves all distances."""

    turn: Array  #: Orthogonal, shape (d, d)
    shift: Array  #: (d,) [m]

    def __call__(self, points: Array) -> Array:
        """The images of ``points`` (n, d) [m]."""
        return np.asarray(points @ self.turn.T + self.shift)

    def after(self, other: Isometry) -> Isometry:
        """The map that applies the ``other`` one first, then this one."""
        return Isometry(self.turn @ other.turn, self.turn @ other.shift + self.shift)


def images(mirrors: Sequence[Mirror], dimension: int = 2) -> list[Isometry]:
    """All isometries that mirrors generate, the identity first; a ValueError if too many."""
    isometries = [Isometry(np.eye(dimension), np.zeros(dimension))]
    reflections = [mirror.reflection for mirror in mirrors]
    scale = max((float(np.max(np.abs(r.shift))) for r in reflections), default=0.0) or 1.0
    for isometry in isometries:  # which grows meanwhile
        for candidate in (r.after(isometry) for r in reflections):
            if not any(
                np.allclose(candidate.turn, image.turn, rtol=0.0, atol=1e-9)
                and np.allclose(candidate.shift, image.shift, rtol=0.0, atol=1e-9 * scale)
                for image in isometries
            ):
                isometries.append(candidate)
            if len(isometries) > MOST_IMAGES:
                raise ValueError(
                    f"mirrors: {list(mirrors)} have more than {MOST_IMAGES} images of a point: the "
                    "lines must meet in one point at angles that divide the circle; take fewer"
                )
    return isometries


class Symmetry:
    """Whether a body is its own image in mirrors.

    In the plane outlines are compared, whatever the mesh between them, in space cells.
    """

    def __init__(self, domain: Domain) -> None:
        self._domain = domain
        arrays = domain.centroids, domain.cell_volumes, domain.design_cells
        self._centroids, self._volumes, self._designed = map(domain.everywhere, arrays)
        self._tree = cKDTree(self._centroids)
        if domain.dimension == 2:
            cells = shapely.polygons(domain.everywhere(_corners(domain)))
            self._body = shapely.union_all(cells)
            self._of_design = shapely.union_all(cells[self._designed])

    def nearest(self, mirror: Mirror) -> tuple[Integers, Array]:
        """The nearest cell to the image of each cell of all ranks, (cells,), and its distance."""
        distance, nearest = self._tree.query(mirror.reflection(self._centroids))
        return np.asarray(nearest), np.asarray(distance)

    def reason(self, mirror: Mirror) -> str:
        """The reason why the body is not its own image, "" if it is."""
        return self._by_outline(mirror) if self._domain.dimension == 2 else self._by_cells(mirror)

    def difference(self, mirror: Mirror, gradient: Array) -> float:
        """Share by which a gradient (cells of this rank,) per area differs from its image.

        Means over some cells are compared, as single cells have no images.
        """
        density = self._domain.everywhere(gradient) * self._designed
        means = self._means(self._centroids, density)
        change = means - self._means(mirror.reflection(self._centroids), density)
        norm = np.sqrt(self._volumes @ means**2)
        return float(np.sqrt(self._volumes @ change**2) / max(norm, 1e-300))

    def _means(self, points: Array, sums: Array) -> Array:
        """Means per area around points (n, dimension) of the sums over each cell, (n,)."""
        radius = MEAN * self._domain.cell_size
        pairs = cKDTree(points).sparse_distance_matrix(self._tree, radius, output_type="coo_matrix")
        weight = (1.0 - pairs.data / radius) ** 2
        total, area = (
            np.bincount(pairs.row, weight * values[pairs.col], len(points))
            for values in (sums, self._volumes)
        )
        return np.asarray(total / np.maximum(area, 1e-300))

    def _by_outline(self, mirror: Mirror) -> str:
        size, area = self._domain.cell_size, self._body.area
        image = shapely.transform(self._body, mirror.reflection)
        mismatch = self._body.symmetric_difference(image)
        # chords of the same curve differ by less
        if not mismatch.buffer(-0.5 * OUTLINE * size).is_empty:
            points = shapely.points(shapely.get_coordinates(mismatch))
            common = self._body.intersection(image)
            distance = float(np.max(shapely.distance(points, common)))
            share = _percent(0.5 * mismatch.area / area)
            return f"{share} of it have no image, as far as {distance:.3g} m off"
        # edges of regions follow cells, up to half a cell
        image = shapely.transform(self._of_design, mirror.reflection)
        undesigned = 0.5 * self._of_design.symmetric_difference(image).area / area
        return f"{_percent(undesigned)} of it are designed and their image is not" * (
            undesigned > SHARE
        )

    def _by_cells(self, mirror: Mirror) -> str:
        volumes = self._volumes
        nearest, distance = self.nearest(mirror)
        size = np.maximum(volumes, volumes[nearest]) ** (1.0 / 3.0)
        # where tetrahedra are graded, the image of a few may be farther from all centroids
        without_image = float(volumes @ (distance > NEAR * size) / volumes.sum())
        if without_image > SHARE or np.any(distance > 2.0 * NEAR * size):
            largest = float(np.max(distance))
            return f"{_percent(without_image)} of it have no image, as far as {largest:.3g} m off"
        undesigned = float(volumes @ (self._designed != self._designed[nearest]) / volumes.sum())
        return f"{_percent(undesigned)} of it are designed and their image is not" * (
            undesigned > SHARE
        )


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def _corners(domain: Domain) -> Array:
    """The corners of this rank's cells, in order around each cell, (cells, corners, 2) [m]."""
    order = [0, 1, 2] if domain.cell == "triangle" else [0, 1, 3, 2]
    nodes = _compat.cell_geometry(domain.mesh)[: domain.n_cells, order]
    return np.asarray(domain.mesh.geometry.x[nodes][:, :, :2])


def mirror_lines(domain: Domain, gradient: Array | None = None) -> list[Mirror]:
    """The lines through the centroid of a body about which it is its own mirror image.

    Candidates are the axes of the coordinates and the principal axes of the area, and lines in
    steps of 15 degrees where those are not unique. The outlines of the body and of its designed
    region must be their own images, to less than a cell, whatever the mesh.

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
        principal = math.degrees(math.atan2(axes[1, 0], axes[0, 0])) % 90.0
        if ANGLE < principal < 90.0 - ANGLE:  # else it is an axis of coordinates, but for the mesh
            angles |= {round(principal, 6), round(principal + 90.0, 6)}
    turns = map(math.radians, sorted(angles))
    normals = [(-math.sin(turn), math.cos(turn)) for turn in turns]
    return _confirmed("mirror lines", domain, center, normals, gradient)


def mirror_planes(domain: Domain, gradient: Array | None = None) -> list[Mirror]:
    """The planes through the centroid of a body in space about which it is its own mirror image.

    Candidates are the planes across the axes of the coordinates and across the principal axes of
    the volume, and those between two axes of the coordinates with the same second moments.
    The image of each cell must lie on the body, to less than a cell, and be designed like the cell.
    ``domain`` and ``gradient``, result and warning are as for `mirror_lines`.
    """
    center, spread, axes = _principal_axes("mirror planes", domain, 3)
    normals = list(np.eye(3))
    for i, axis in enumerate(axes.T):
        is_unique = np.min(np.abs(np.delete(spread, i) - spread[i])) > 1e-3 * spread[i]
        if is_unique and all(abs(axis @ normal) < 1.0 - 1e-6 for normal in normals):
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
        function = "mirror_lines" if dimension == 3 else "mirror_planes"
        raise ValueError(f"{what}: the body has {domain.dimension} dimensions; take {function}")
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
    """The mirrors through a center for which body and gradient, if given, are their own images."""
    symmetry, mirrors, reasons = Symmetry(domain), list[Mirror](), list[str]()
    if gradient is not None:
        gradient = validation.real_array(f"{what}: gradient", gradient, (domain.n_cells,))
    for normal in normals:
        mirror = Mirror(tuple(center.tolist()), tuple(map(float, normal)))
        reason = symmetry.reason(mirror)
        if not reason and gradient is not None:
            difference = symmetry.difference(mirror, gradient)
            if difference > SHARE:
                reason = f"the gradient differs by {_percent(difference)} from its image"
        if reason:
            reasons.append(f"{mirror}: {reason}")
        else:
            mirrors.append(mirror)
    if not mirrors:
        meshed = "take a mesh with mirror images of its cells, or " * (domain.dimension == 3)
        warnings.warn(
            f"{what}: the body has no mirror symmetry through its centroid: {'; '.join(reasons)}; "
            f"{meshed}give other mirrors by hand",
            stacklevel=3,
        )
    return mirrors
