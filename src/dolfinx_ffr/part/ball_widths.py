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

from ..arrays import Array, Integers
from .widths import Width, least_width

#: Most samples of a surface
MOST_SAMPLES = 100_000
#: Product of the normals of both sides, below which they are those of a wall, and no wedge
OPPOSITE = -np.cos(np.radians(20.0))
#: Most times that balls shrink, and by which share at least
_SHRINKS, _SHRUNK = 30, 1e-4
#: Share of R below which a ball is thin: the surface is known by samples
_BELOW = 0.97
#: How much farther than in a wedge between two planes the erosion may be in a corner of three
_CORNER = 2.0
#: Distance in R from which the erosion is out of reach, and of a place opposite of it, in distances
_FAR, _ACROSS = 3.0, 0.7
#: Ratio of the radii of the balls whose inner parts stand for the erosion, and their number
_LARGER, _LEVELS = 1.25, 5
#: Distance in samples of centres that count once
_SAME = 0.1
#: Ratio of the diameters that are tried, and accuracy of the one above that of the member
_RATIO, _ACCURACY = 1.15, 0.02
#: Diameter for which walls are looked for that are thinner than one
_WALLS = 1.2
#: Ratio of diameters for both of which a neck has thicker parts on either side
_STAYS = 1.1
#: Samples of a re-entrant edge in the directions between both normals; least angle of it
_TURNS, _EDGE = 4, np.radians(20.0)


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
        found = np.einsum("nd,nd->n", self.normals, self.normals[self.ends])
        return np.where(self.ends >= 0, found, 1.0)

    def fitting(self, radius: float) -> cKDTree | None:
        """A tree of the centres of balls that are as large, None where there are none."""
        if radius not in self._trees:
            fits = self.centers[self.radius >= 0.999 * radius]
            self._trees[radius] = cKDTree(_apart(fits, _SAME * self.spacing)) if len(fits) else None
        return self._trees[radius]

    def thin(self, radius: float) -> Integers:
        """Numbers of thin balls, see the module."""
        own, spacing = self.radius, self.spacing
        numbers = np.flatnonzero((self.ends >= 0) & (own < _BELOW * radius) & (own > spacing))
        at, cosine = self.centers[numbers], self.cosine[numbers]
        away, near = np.full(len(at), np.inf), np.full(at.shape, np.inf)
        first = int(np.ceil(np.log(radius) / np.log(_LARGER) + 1e-9))
        for larger in (radius, *(_LARGER**k for k in range(first, first + _LEVELS))):
            tree = self.fitting(larger)
            if tree is None:
                break
            # all within the larger ball that is that much off its surface belongs to the erosion
            found, which = tree.query(at, distance_upper_bound=_FAR * radius + larger)
            share = np.minimum((larger - radius) / np.maximum(found, 1e-300), 1.0)
            better = np.flatnonzero((1.0 - share) * found < away)
            away[better] = ((1.0 - share) * found)[better]
            there = tree.data[which[better]]
            near[better] = there + share[better, None] * (at[better] - there)
        sine = np.sqrt(0.5 * np.maximum(1.0 + cosine, 0.0))
        wedge = _CORNER * (radius - own[numbers]) / np.maximum(sine, 1e-9) + spacing
        bare = (cosine < OPPOSITE) | (away > wedge)
        far = away > _FAR * radius
        thin = far & bare
        close = np.flatnonzero(bare & ~far)
        if len(close):
            tree = self.fitting(radius)
            assert tree is not None
            found, which = tree.query(2.0 * at[close] - near[close])
            # the way there is in the material
            middle = 0.5 * (at[close] + tree.data[which])
            surface = cKDTree(self.points).query(middle)[1]
            way = middle - self.points[surface]
            inside = np.einsum("nd,nd->n", way, self.normals[surface]) > 0.0
            thin[close] = inside & (found < _ACROSS * away[close])
        return numbers[thin]

    def members(self, d: float) -> Integers | None:
        """Numbers of balls in members thinner than d [m], None if there are none."""
        # a ripple of a rim is a neck for balls of one size only
        thin = self.thin(0.5 * d)
        thin = np.intersect1d(thin, self.thin(0.5 * _STAYS * d)) if len(thin) else thin
        return thin if len(thin) else None

    def thinnest(self) -> Width | None:
        """The thinnest member, or the narrowest gap or hole; None if the largest balls fit.

        What is thinner than two spacings is not seen.
        """
        first, most = 2.0 * self.spacing, 2.0 * (1.0 - 2.0 * _ACCURACY) * self.largest
        d = least_width(self.members, first, _RATIO * first, most, _RATIO, lambda d: _ACCURACY * d)
        if d is None:
            return None
        # beside edges balls are smaller than amid the member
        wider = self.thin(0.5 * (1.0 + 2.0 * _ACCURACY) / _BELOW * d)
        sure = self.members(d)
        thin = np.union1d(self.thin(0.5 * d) if sure is None else sure, wider)
        facing = thin[self.cosine[thin] < OPPOSITE]
        facing = facing[2.0 * self.radius[facing] > (1.0 - 2.0 * _ACCURACY) * _BELOW * d]
        known = len(facing) > 0
        at = facing[np.argmin(self.radius[facing])] if known else thin[np.argmax(self.radius[thin])]
        value = 2.0 * float(self.radius[at])
        return Width(value, np.stack([self.points[at], self.points[at] + value * self.normals[at]]))

    def thinner(self, d: float) -> Array:
        """Centres of balls in walls and other members thinner than d, (n, 3) [m]."""
        found, members = self.thin(0.5 * _WALLS * d), self.members(d / _BELOW)
        found = found[self.cosine[found] < OPPOSITE]
        found = found if members is None else np.union1d(found, members)
        return self.centers[found[2.0 * self.radius[found] < d]]


def _apart(points: Array, step: float) -> Array:
    """One of the points (n, 3) in each box of a size [m]: trees are slow with many alike."""
    whole = np.floor((points - points.min(axis=0)) / step).astype(np.int64)
    sizes = whole.max(axis=0) + 1
    key = (whole[:, 0] * sizes[1] + whole[:, 1]) * sizes[2] + whole[:, 2]
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
    """Samples of a surface, and of its edges that are re-entrant from ``sides``, with normals."""
    normals = sides / np.maximum(np.linalg.norm(sides, axis=1), 1e-300)[:, None]
    x, which = spread(points[triangles], 2.0 * spacing)
    # both triangles at each edge, and the corner of the second that is not on it
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    order = np.lexsort(edges.T)
    pair = np.flatnonzero(np.all(np.diff(edges[order], axis=0) == 0, axis=1))
    a, b = order[pair], order[pair + 1]
    one, two = normals[a // 3], normals[b // 3]
    other = points[triangles[b // 3, (b % 3 + 2) % 3]] - points[edges[a, 0]]
    # seen from there, the second one bends away
    bent = np.einsum("ed,ed->e", other, one) < 0.0
    bent &= np.einsum("ed,ed->e", one, two) < np.cos(_EDGE)
    a, one, two = a[bent], one[bent], two[bent]
    start, end = points[edges[a]].swapaxes(0, 1)
    counts = np.ceil(np.linalg.norm(end - start, axis=1) / spacing).astype(int)
    number = np.repeat(np.arange(len(a)), counts)
    place = (np.arange(len(number)) - np.repeat(np.cumsum(counts) - counts, counts) + 0.5)[:, None]
    along = start[number] + place / counts[number][:, None] * (end - start)[number]
    found, turned = [x, *[along] * _TURNS], [normals[which]]
    for share in (np.arange(_TURNS) + 0.5) / _TURNS:
        between = ((1.0 - share) * one + share * two)[number]
        turned.append(between / np.maximum(np.linalg.norm(between, axis=1), 1e-300)[:, None])
    return np.concatenate(found), np.concatenate(turned)


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
    live = np.arange(len(points))
    for _ in range(_SHRINKS):
        x, n, r = points[live], inward[live], radius[live]
        away, near = tree.query(x + r[:, None] * n)
        way = at[near] - x
        along = np.einsum("nd,nd->n", way, n)
        inside = (away < (1.0 - 1e-6) * r) & (along > 0.0)
        live, near, before = live[inside], near[inside], r[inside]
        new = 0.5 * np.sum(way[inside] ** 2, axis=1) / along[inside]
        radius[live], end[live] = np.minimum(new, before), near
        live = live[new < (1.0 - _SHRUNK) * before]
        if not len(live):
            break
    # that which touches the plane at the sample, which is more accurate than the sample
    met = end >= 0
    n, m = inward[met], normals[end[met]]
    deep = np.einsum("nd,nd->n", points[met] - at[end[met]], m)
    cosine = np.einsum("nd,nd->n", n, m)
    radius[met] = np.clip(deep / np.maximum(1.0 - cosine, 0.1), 0.0, largest)
    return radius, end


def spread(corners: Array, spacing: float) -> tuple[Array, Integers]:
    """Points of triangles (t, 3, 3), about a spacing apart, and which of them they lie in, (n,)."""
    number = np.arange(len(corners))
    points, numbers = [np.zeros((0, 3))], [number[:0]]
    while len(corners):
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        small = np.max(edges, axis=1) <= spacing
        points.append(corners[small].mean(axis=1))
        numbers.append(number[small])
        a, b, c = np.moveaxis(corners[~small], 1, 0)
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        corners = np.concatenate([np.stack(part, axis=1) for part in parts])
        number = np.tile(number[~small], len(parts))
    return np.concatenate(points), np.concatenate(numbers)
