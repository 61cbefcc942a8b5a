# SPDX-License-Identifier: MIT
"""Thin members of a solid, and narrow gaps around it, by the largest balls that touch its surface.

At a point of the surface the ball shrinks until nothing of the surface is in it (J. Ma, S. W. Bae,
S. Choi, 3D medial axis point approximation using nearest neighbors and the normal field, The Visual
Computer 28, 2012, doi:10.1007/s00371-011-0594-7). A ball of a radius below R is *thin* if the
centres of the balls of radius R that fit (the erosion) are not where they would be if it only stood
near an edge or a corner, and

* they are on both sides of it: it is in a neck or a post that joins thicker parts, or
* they are farther away than 3 R: it is in a plate, a bar, or a finger that is longer than wide.

So rims of holes, edges and small noses are no members. No lattice is needed, on which an erosion
falls into pieces by chance where it is as thin as the spacing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Integers, Mask
from .widths import Width, least_width

#: Most samples of a surface, which takes some seconds
MOST_SAMPLES = 100_000
#: Product of the normals of both sides, below which they are those of a wall, and no wedge: 20
#: degrees from opposite
OPPOSITE = -np.cos(np.radians(20.0))


@dataclass(frozen=True)
class BallOptions:
    """What decides whether a ball is thin, and how accurately."""

    most_shrinks: int = 30  #: Times at most that a ball shrinks
    least_shrinking: float = 1e-4  #: Share of its radius by which a ball shrinks, if it goes on
    #: Share of R below which a ball is thin: the surface is known by samples
    fitting_share: float = 0.97
    #: How much farther than in a wedge between two planes the erosion may be in a corner of three
    corner_reach: float = 2.0
    erosion_reach: float = 3.0  #: Distance in R from which on the erosion is out of reach
    #: Distance of a place of the erosion from that opposite of another one, at most, in the
    #: distances of both from the ball
    opposite_reach: float = 0.7
    #: Ratio of the radii of the larger balls that stand for the erosion
    erosion_ratio: float = 1.25
    erosion_levels: int = 5  #: Number of these radii
    center_spacing: float = 0.1  #: Distance in samples of centres that count once
    diameter_ratio: float = 1.15  #: Ratio of the diameters that are tried
    accuracy: float = 0.02  #: Accuracy of the diameter of the thinnest member
    wall_ratio: float = 1.2  #: Diameter for which walls are looked for that are thinner than one
    #: Ratio of two diameters, for both of which a neck has thicker parts on either side: a ripple
    #: of a rim is a neck for balls of one size only
    neck_ratio: float = 1.1
    edge_samples: int = 4  #: Directions between both normals of a re-entrant edge that have samples
    edge_angle: float = float(np.radians(20.0))  #: Least angle of a re-entrant edge [rad]


OPTIONS = BallOptions()


@dataclass(frozen=True, eq=False)
class Balls:
    """The largest ball at each sample of a surface, up to some radius."""

    points: Array  #: Samples, (n, 3) [m]
    normals: Array  #: Unit vectors to the side on which the balls are, (n, 3)
    radius: Array  #: (n,) [m]; zero where none is of interest
    ends: Integers  #: Numbers of the samples that they touch, too; -1 where none is that near, (n,)
    spacing: float  #: Of the samples, about [m]
    largest: float  #: That radius [m]
    _trees: dict[float, cKDTree | None] = field(default_factory=dict, init=False)

    @property
    def centers(self) -> Array:
        """(n, 3) [m]."""
        return self.points + self.radius[:, None] * self.normals

    @property
    def cosine(self) -> Array:
        """Product of the normals at both places that a ball touches, (n,)."""
        product = np.einsum("nd,nd->n", self.normals, self.normals[self.ends])
        return np.where(self.ends >= 0, product, 1.0)

    def fitting(self, radius: float) -> cKDTree | None:
        """A tree of the centres of balls that are as large, None where there are none."""
        if radius not in self._trees:
            fits = self.centers[self.radius >= 0.999 * radius]
            self._trees[radius] = (
                cKDTree(_apart(fits, OPTIONS.center_spacing * self.spacing)) if len(fits) else None
            )
        return self._trees[radius]

    def thin(self, radius: float) -> Integers:
        """Numbers of thin balls, see the module."""
        is_small = (self.radius < OPTIONS.fitting_share * radius) & (self.radius > self.spacing)
        numbers = np.flatnonzero((self.ends >= 0) & is_small)
        centers, cosine = self.centers[numbers], self.cosine[numbers]
        distance, nearest = self._erosion(centers, radius)

        sine = np.sqrt(0.5 * np.maximum(1.0 + cosine, 0.0))
        missing = radius - self.radius[numbers]
        in_wedge = OPTIONS.corner_reach * missing / np.maximum(sine, 1e-9) + self.spacing
        is_bare = (cosine < OPPOSITE) | (distance > in_wedge)
        is_far = distance > OPTIONS.erosion_reach * radius
        is_thin = is_far & is_bare
        close = np.flatnonzero(is_bare & ~is_far)
        if len(close):
            is_thin[close] = self._is_between(
                centers[close], nearest[close], distance[close], radius
            )
        return numbers[is_thin]

    def _erosion(self, centers: Array, radius: float) -> tuple[Array, Array]:
        """Distance (n,) of the erosion from centres (n, 3), and its nearest point (n, 3).

        All that is within a larger ball, and as far from its surface as the radius, belongs to the
        erosion. The distance is infinite where it is out of reach.
        """
        distance, nearest = np.full(len(centers), np.inf), np.full(centers.shape, np.inf)
        first = int(np.ceil(np.log(radius) / np.log(OPTIONS.erosion_ratio) + 1e-9))
        powers = range(first, first + OPTIONS.erosion_levels)
        for larger in (radius, *(OPTIONS.erosion_ratio**k for k in powers)):
            tree = self.fitting(larger)
            if tree is None:
                break
            reach = OPTIONS.erosion_reach * radius + larger
            to_center, number = tree.query(centers, distance_upper_bound=reach)
            share = np.minimum((larger - radius) / np.maximum(to_center, 1e-300), 1.0)
            outside = (1.0 - share) * to_center
            nearer = np.flatnonzero(outside < distance)
            distance[nearer] = outside[nearer]
            fitting = tree.data[number[nearer]]
            nearest[nearer] = fitting + share[nearer, None] * (centers[nearer] - fitting)
        return distance, nearest

    def _is_between(self, centers: Array, nearest: Array, distance: Array, radius: float) -> Mask:
        """Whether the erosion is also opposite of its nearest points, through the material."""
        tree = self.fitting(radius)
        assert tree is not None
        offset, number = tree.query(2.0 * centers - nearest)
        middle = 0.5 * (centers + tree.data[number])
        surface = cKDTree(self.points).query(middle)[1]
        from_surface = middle - self.points[surface]
        is_inside = np.einsum("nd,nd->n", from_surface, self.normals[surface]) > 0.0
        return np.asarray(is_inside & (offset < OPTIONS.opposite_reach * distance))

    def members(self, d: float) -> Integers | None:
        """Numbers of balls in members thinner than d [m], None if there are none."""
        thin = self.thin(0.5 * d)
        thin = np.intersect1d(thin, self.thin(0.5 * OPTIONS.neck_ratio * d)) if len(thin) else thin
        return thin if len(thin) else None

    def thinnest(self) -> Width | None:
        """The thinnest member, or the narrowest gap or hole; None if the largest balls fit.

        What is thinner than two spacings is not seen.
        """
        accuracy, below = OPTIONS.accuracy, OPTIONS.fitting_share
        least, largest = 2.0 * self.spacing, 2.0 * (1.0 - 2.0 * accuracy) * self.largest
        ratio = OPTIONS.diameter_ratio
        d = least_width(self.members, least, ratio * least, largest, ratio, lambda d: accuracy * d)
        if d is None:
            return None
        # beside edges balls are smaller than amid the member
        wider = self.thin(0.5 * (1.0 + 2.0 * accuracy) / below * d)
        members = self.members(d)
        thin = np.union1d(self.thin(0.5 * d) if members is None else members, wider)
        facing = thin[self.cosine[thin] < OPPOSITE]
        facing = facing[2.0 * self.radius[facing] > (1.0 - 2.0 * accuracy) * below * d]
        if len(facing):
            number = facing[np.argmin(self.radius[facing])]
        else:
            number = thin[np.argmax(self.radius[thin])]
        value, start = 2.0 * float(self.radius[number]), self.points[number]
        return Width(value, np.stack([start, start + value * self.normals[number]]))

    def thinner(self, d: float) -> Array:
        """Centres of balls in walls and other members thinner than d, (n, 3) [m]."""
        thin, members = (
            self.thin(0.5 * OPTIONS.wall_ratio * d),
            self.members(d / OPTIONS.fitting_share),
        )
        thin = thin[self.cosine[thin] < OPPOSITE]
        thin = thin if members is None else np.union1d(thin, members)
        return self.centers[thin[2.0 * self.radius[thin] < d]]


def _apart(points: Array, step: float) -> Array:
    """One of the points (n, 3) in each box of a size [m]: trees are slow with many alike."""
    box = np.floor((points - points.min(axis=0)) / step).astype(np.int64)
    sizes = box.max(axis=0) + 1
    key = (box[:, 0] * sizes[1] + box[:, 1]) * sizes[2] + box[:, 2]
    return np.asarray(points[np.unique(key, return_index=True)[1]])


def surface_balls(points: Array, triangles: Integers, size: float, *, around: bool) -> Balls:
    """The largest balls inside a closed surface, or around it, up to its least extent.

    Its surface has samples about a ``size`` [m] apart, or more if these were too many.
    """
    points = np.asarray(points, dtype=np.float64)
    corners = points[triangles]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    spacing = max(size, np.sqrt(0.5 * np.linalg.norm(sides, axis=1).sum() / MOST_SAMPLES))
    x, n = _samples(points, triangles, sides if around else -sides, spacing)
    largest = 0.5 * float(np.min(np.ptp(points, axis=0)))  # from which on they are of no interest
    return Balls(x, n, *tangent_balls(x, n, x, n, largest), spacing, largest)


def _samples(
    points: Array, triangles: Integers, sides: Array, spacing: float
) -> tuple[Array, Array]:
    """Samples of a surface, and of its edges that are re-entrant from ``sides``, with normals.

    Samples and normals are (samples, 3); ``sides`` (triangles, 3) are normals of any length.
    """
    normals = sides / np.maximum(np.linalg.norm(sides, axis=1), 1e-300)[:, None]
    x, triangle = spread(points[triangles], 2.0 * spacing)

    # the edge a of one triangle and b of the other are the same; edge 3 t + k is that of triangle t
    # from its corner k
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    order = np.lexsort(edges.T)
    pair = np.flatnonzero(np.all(np.diff(edges[order], axis=0) == 0, axis=1))
    a, b = order[pair], order[pair + 1]
    normal_a, normal_b = normals[a // 3], normals[b // 3]
    corner_off_edge = triangles[b // 3, (b % 3 + 2) % 3]
    beyond = points[corner_off_edge] - points[edges[a, 0]]
    # on the side of the normals the second triangle bends away from the first
    bends_away = np.einsum("ed,ed->e", beyond, normal_a) < 0.0
    is_sharp = np.einsum("ed,ed->e", normal_a, normal_b) < np.cos(OPTIONS.edge_angle)
    is_reentrant = bends_away & is_sharp
    a, normal_a, normal_b = a[is_reentrant], normal_a[is_reentrant], normal_b[is_reentrant]

    # samples a spacing apart, in the middles of the intervals into which they divide an edge
    start, end = points[edges[a]].swapaxes(0, 1)
    counts = np.ceil(np.linalg.norm(end - start, axis=1) / spacing).astype(int)
    edge = np.repeat(np.arange(len(a)), counts)
    first_of_edge = np.repeat(np.cumsum(counts) - counts, counts)
    interval = (np.arange(len(edge)) - first_of_edge + 0.5)[:, None]
    on_edges = start[edge] + interval / counts[edge][:, None] * (end - start)[edge]

    # each sample of an edge with several normals between those of both triangles
    turned = []
    for share in (np.arange(OPTIONS.edge_samples) + 0.5) / OPTIONS.edge_samples:
        between = ((1.0 - share) * normal_a + share * normal_b)[edge]
        turned.append(between / np.maximum(np.linalg.norm(between, axis=1), 1e-300)[:, None])
    samples = np.concatenate([x, *[on_edges] * OPTIONS.edge_samples])
    return samples, np.concatenate([normals[triangle], *turned])


def tangent_balls(
    points: Array, inward: Array, at: Array, normals: Array, largest: float
) -> tuple[Array, Integers]:
    """Largest balls that touch a surface at points (n, 3), and where else they touch it.

    The surface is known by samples ``at`` (m, 3) with ``normals``, all of them unit vectors into
    the material. Radii (n,) [m] are at most the ``largest``; numbers of samples (n,) are -1 where
    a ball as large as that fits.
    """
    tree = cKDTree(at)
    radius, end = np.full(len(points), largest), np.full(len(points), -1)
    shrinking = np.arange(len(points))
    for _ in range(OPTIONS.most_shrinks):
        x, n, r = points[shrinking], inward[shrinking], radius[shrinking]
        distance, nearest = tree.query(x + r[:, None] * n)
        chord = at[nearest] - x
        along = np.einsum("nd,nd->n", chord, n)
        is_inside = (distance < (1.0 - 1e-6) * r) & (along > 0.0)
        shrinking, nearest, r = shrinking[is_inside], nearest[is_inside], r[is_inside]
        smaller = 0.5 * np.sum(chord[is_inside] ** 2, axis=1) / along[is_inside]
        radius[shrinking], end[shrinking] = np.minimum(smaller, r), nearest
        shrinking = shrinking[smaller < (1.0 - OPTIONS.least_shrinking) * r]
        if not len(shrinking):
            break
    # the ball that touches the plane at the sample, which is more accurate than the sample
    touches = end >= 0
    n, m = inward[touches], normals[end[touches]]
    depth = np.einsum("nd,nd->n", points[touches] - at[end[touches]], m)
    cosine = np.einsum("nd,nd->n", n, m)
    radius[touches] = np.clip(depth / np.maximum(1.0 - cosine, 0.1), 0.0, largest)
    return radius, end


def spread(corners: Array, spacing: float) -> tuple[Array, Integers]:
    """Points of triangles (t, 3, 3), about a spacing apart, and which of them they lie in, (n,)."""
    number = np.arange(len(corners))
    points, numbers = [np.zeros((0, 3))], [number[:0]]
    while len(corners):
        # a small triangle has one point
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        small = np.max(edges, axis=1) <= spacing
        points.append(corners[small].mean(axis=1))
        numbers.append(number[small])

        # any other is quartered
        a, b, c = np.moveaxis(corners[~small], 1, 0)
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        corners = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
        number = np.tile(number[~small], len(quarters))
    return np.concatenate(points), np.concatenate(numbers)
