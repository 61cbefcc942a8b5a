# SPDX-License-Identifier: MIT
"""Thinnest member and narrowest gap of a solid, by balls that do not fit.

A member is what `widths` says, with balls for discs; a *finger* is farther than d from all balls
that fit and still as wide as 0.7 d.

The distance from the surface is sampled on a lattice, and how it hangs together is told by its
pieces and its Euler number. Where the member is, the way across it is measured on the surface
itself, which is more accurate than the lattice; where no way is near to the ball's diameter, that
stands, which is right to about a spacing.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from ..arrays import Array, Integers, Mask
from .widths import Width, least_width

#: Most points of a lattice
MOST_POINTS = 200_000
#: Least width that is looked for and accuracy of the search, in spacings
LEAST, ACCURACY = 1.0, 0.25
#: Ratio of the diameters among which the first one is looked for
_RATIO = 1.2
#: Width of a finger, in units of the ball's diameter
_FULL = 0.7
#: Spacings by which balls are smaller that show where a neck is
_PASSING = 1.0
#: Spacings by which the way across may differ from the ball's diameter, and points that are tried
_NEAR, _TRIED = 2.0, 64


def thinnest_in_space(
    points: Array, triangles: Integers, size: float, *, around: bool
) -> Width | None:
    """The thinnest member inside a closed surface, or the narrowest gap or hole around it.

    Members thinner than the lattice, whose spacing is ``size`` [m] or more, are not seen; None if
    there is none below the least extent.
    """
    return _Lattice(points, triangles, size, around=around).thinnest()


class _Lattice:
    """Distances from a surface, on a lattice inside it or around it, up to its least extent."""

    def __init__(self, points: Array, triangles: Integers, size: float, *, around: bool) -> None:
        self._corners = points[triangles]
        low, high = points.min(axis=0), points.max(axis=0)
        self.largest = float(np.min(high - low))  #: From which on members are of no interest [m]
        room = 0.75 * self.largest if around else 0.0
        low, high = low - room, high + room
        self.h = max(size, float(np.prod(high - low) / MOST_POINTS) ** (1.0 / 3.0))
        counts = np.ceil((high - low) / self.h).astype(int) + 1
        first = 0.5 * (low + high) - 0.5 * self.h * (counts - 1)
        axes = [a + self.h * np.arange(count) for a, count in zip(first, counts, strict=True)]
        self._positions = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        self.inside = self._enclosed(axes) != around
        samples = spread(self._corners, 0.5 * self.h)[0]
        tree = cKDTree(np.concatenate([samples, self._corners.reshape(-1, 3)]))
        self.distance = np.zeros(self.inside.shape)
        most = 0.5 * self.largest + self.h
        found = tree.query(self._positions[self.inside], distance_upper_bound=most)[0]
        self.distance[self.inside] = np.minimum(found, most)

    def _enclosed(self, axes: list[Array]) -> Mask:
        """Which points lie inside, by the crossings of lines along x with the surface."""
        x, y, z = axes
        # off the vertices, which often lie on planes of the lattice
        shift = 1e-6 * self.h * np.array([0.71, 0.53])
        crossings = np.zeros((len(x) + 1, len(y), len(z)), dtype=np.int32)
        for a, b, c in self._corners:
            flat = np.stack([a, b, c])[:, 1:] - shift
            (y0, z0), (y1, z1) = flat.min(axis=0), flat.max(axis=0)
            j = np.arange(*np.searchsorted(y, [y0, y1]))
            k = np.arange(*np.searchsorted(z, [z0, z1]))
            if not (len(j) and len(k)):
                continue
            (ay, az), (by, bz), (cy, cz) = flat
            area = (by - ay) * (cz - az) - (bz - az) * (cy - ay)
            if area == 0.0:
                continue
            Y, Z = np.meshgrid(y[j], z[k], indexing="ij")
            v = ((Y - ay) * (cz - az) - (Z - az) * (cy - ay)) / area
            w = ((by - ay) * (Z - az) - (bz - az) * (Y - ay)) / area
            hit = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0)
            at = a[0] + v * (b[0] - a[0]) + w * (c[0] - a[0])
            jj, kk = np.nonzero(hit)
            np.add.at(crossings, (np.searchsorted(x, at[hit]), j[jj], k[kk]), 1)
        return np.cumsum(crossings, axis=0)[:-1] % 2 == 1

    def thinnest(self) -> Width | None:
        """The thinnest member."""
        whole = _connected(self.distance > 0.5 * LEAST * self.h)
        # not more than the least extent, which edges and lattice would confound with a member
        thick, most = LEAST * self.h, self.largest - (_NEAR + 1.0) * self.h
        accurate = ACCURACY * self.h
        sizes = (thick, _RATIO * thick, most, _RATIO)
        thin = least_width(lambda d: self._member(d, whole), *sizes, lambda d: accurate)
        if thin is None:
            return None
        positions = self._member(thin, whole)
        assert positions is not None
        for position in positions:
            ends = self._across(position)
            if ends is not None and abs(_length(ends) - thin) < _NEAR * self.h:
                return Width(_length(ends), ends)
        # between edges no way leads straight from face to face
        return Width(thin, np.stack([positions[0], positions[0]]))

    def _member(self, d: float, whole: tuple[int, int]) -> Array | None:
        """Points (n, 3) amid a member thinner than a diameter, the likeliest first, or None."""
        fits = self.distance > 0.5 * d
        if not np.any(fits):
            return self._middle(self.inside)
        if _connected(fits) != whole:
            # centres of balls a little smaller get through where the distance is a ridge, as it is
            # along edges, too, where the way across is another
            passing = (self.distance > 0.5 * (d - _PASSING * self.h)) & ~fits
            slope = np.linalg.norm(np.gradient(self.distance, self.h), axis=0)
            ridge = np.argsort(np.where(passing, slope, np.inf), axis=None, kind="stable")
            return np.asarray(self._positions.reshape(-1, 3)[ridge[:_TRIED]])
        away = ndimage.distance_transform_edt(~fits) * self.h
        far = self.inside & (away > 1.5 * d) & (self.distance >= 0.5 * _FULL * d)
        return self._middle(far) if np.any(far) else None

    def _middle(self, region: Mask) -> Array:
        """The point of a region that is farthest from the surface, shape (1, 3)."""
        at = np.argmax(np.where(region, self.distance, -1.0))
        return np.asarray(self._positions.reshape(-1, 3)[at : at + 1])

    def _across(self, middle: Array) -> Array | None:
        """Two points of the surface on both sides of a point, along the shortest way; or None."""
        tree = cKDTree(self._corners.mean(axis=1))
        near = np.atleast_1d(tree.query(middle, k=min(12, len(self._corners)))[1])
        a, b, c = np.moveaxis(self._corners[near], 1, 0)
        normals = np.cross(b - a, c - a)
        best: Array | None = None
        for direction in normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]:
            there, back = self._hit(middle, direction), self._hit(middle, -direction)
            if np.isfinite(there + back) and (best is None or there + back < _length(best)):
                best = np.stack([middle + there * direction, middle - back * direction])
        return best

    def _hit(self, start: Array, direction: Array) -> float:
        """How far it is to the surface along a direction [m]."""
        a, b, c = np.moveaxis(self._corners, 1, 0)
        one, two = b - a, c - a
        p = np.cross(direction, two)
        size = np.sum(one * p, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            v = np.sum((start - a) * p, axis=1) / size
            q = np.cross(start - a, one)
            w, t = q @ direction / size, np.sum(two * q, axis=1) / size
            hit = (v >= -1e-9) & (w >= -1e-9) & (v + w <= 1.0 + 1e-9) & (t > 0.0)
        return float(np.min(t[hit], initial=np.inf))


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


def _length(ends: Array) -> float:
    return float(np.linalg.norm(ends[1] - ends[0]))


def _connected(mask: Mask) -> tuple[int, int]:
    """Number of pieces, and Euler number of the cubes, squares and edges between points."""
    euler = 0
    for steps in np.ndindex(2, 2, 2):
        part = mask
        for axis in np.flatnonzero(steps):
            along = np.moveaxis(part, axis, 0)
            part = np.moveaxis(along[:-1] & along[1:], 0, axis)
        euler += (-1) ** sum(steps) * int(np.count_nonzero(part))
    return int(ndimage.label(mask)[1]), euler
