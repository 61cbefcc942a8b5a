# SPDX-License-Identifier: MIT
"""The holes of a body in space, found by the mesh alone.

A hole in space is a hollow of the surface around which plane sections of the body close rings:
bores, slots, hexagonal and tapered holes, through or blind, pockets and closed cavities. The gap of
a fork, a groove that is open at its side and a notch are none: the sections around them are open.

A hollow is a set of facets that meet in concave edges. Its sections are normal to the direction in
which its facets face least, the axis of a hole that goes through; and to the direction in which the
facets beside it face most, which are around the mouth of a hole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from dolfinx import mesh
from scipy.spatial import cKDTree

from ..arrays import Array, Integers, Mask
from ..parallel import on_rank_0
from .drawn_outline import CURVES, FlatHole, boundary_corners, flat_holes
from .interface import fit_cylinder
from .mesh_arrays import numbered
from .mesh_checks import connected


@dataclass(frozen=True)
class HoleOptions:
    """What counts as a hole in space, and how finely its walls are known."""

    #: Distance by which a point is moved off the surface, in sizes of the body: far above
    #: round-off, far below any facet
    off_surface: float = 1e-9
    flat: float = 1e-6  #: Angle by which facets of one plane may turn by round-off [rad]
    #: Cosine of the angle between directions that count as one axis, and along which a facet faces
    #: so nearly that a section does not cut it: 8 degrees
    along: float = 0.99
    #: Share of a hollow around which sections close a ring, if it is a hole: another hole that
    #: crosses it opens some, and around a fork, a groove or a notch there is none
    enclosed: float = 0.25
    #: Share of the trace by which the value of a principal direction is apart from others
    distinct: float = 0.01
    #: Share of a facet's height that is at least between its corners and a section that cuts it
    clear: float = 0.1
    #: Distance of the points that stand for a wall, in cells: rims are then within 0.2 % of a cell
    spacing: float = 1.0 / 12.0
    on_cylinder: float = 1e-3  #: Distance of points from the cylinder that they are on, in radii


HOLES = HoleOptions()


@dataclass(frozen=True, eq=False)
class SpatialHole:
    """A hole of a body in space, by its walls."""

    points: Array  #: Points on the walls, close to each other, shape (points, 3) [m]
    middles: Array  #: A point on each facet of the walls, shape (facets, 3) [m]
    outward: Array  #: Unit normals there, from the material into the hole, shape (facets, 3)
    radius: float  #: The smallest radius to which the walls are curved, infinite if flat [m]

    @property
    def center(self) -> Array:
        """Middle of the box around the walls, shape (3,) [m]."""
        return np.asarray(self.box.mean(axis=0))

    @cached_property
    def box(self) -> Array:
        """Lower and upper corner around the walls, shape (2, 3) [m]."""
        return np.array([self.points.min(axis=0), self.points.max(axis=0)])

    def distance(self, points: Array) -> Array:
        """The distance of ``points`` (n, 3) from the walls, (n,) [m]."""
        return np.asarray(self._tree.query(points)[0])

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)


def holes_in_space(domain: mesh.Mesh, cell_size: float) -> list[SpatialHole]:
    """The holes of a body in space with cells of a mean size [m], the same on every rank."""
    corners, outward = boundary_corners(domain)
    holes: list[SpatialHole] = on_rank_0(
        domain.comm, lambda: _Surface.of(corners, outward).holes(HOLES.spacing * cell_size)
    )
    return holes


@dataclass(frozen=True, eq=False)
class _Surface:
    """The surface of a body as triangles."""

    nodes: Array  #: Positions, shape (nodes, 3) [m]
    triangles: Integers  #: Nodes of each, shape (triangles, 3)
    outward: Array  #: Unit normals, shape (triangles, 3)
    pairs: Integers  #: Triangles that share an edge, shape (pairs, 2)
    lengths: Array  #: Of these edges, shape (pairs,) [m]

    @staticmethod
    def of(corners: Array, outward: Array) -> _Surface:
        """From the corners of facets (facets, 3 or 4, 3) and their outward normals (facets, 3)."""
        if corners.shape[1] == 4:  # numbered as a tensor product
            corners = corners[:, [[0, 1, 2], [1, 3, 2]]].reshape(-1, 3, 3)
            outward = np.repeat(outward, 2, axis=0)
        flat = corners.reshape(-1, 3)
        first, number = numbered(flat)
        triangles = number.reshape(-1, 3)

        # edges that come twice in lexical order are those of two triangles
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        order = np.lexsort((edges[:, 1], edges[:, 0]))
        edges = edges[order]
        triangle_of_edge = np.repeat(np.arange(len(triangles)), 3)[order]
        is_shared = np.all(edges[1:] == edges[:-1], axis=1)
        pairs = np.column_stack([triangle_of_edge[:-1][is_shared], triangle_of_edge[1:][is_shared]])
        nodes = flat[first]
        start, end = nodes[edges[:-1][is_shared]].swapaxes(0, 1)
        lengths = np.linalg.norm(start - end, axis=1)
        return _Surface(nodes, triangles, outward, pairs, lengths)

    @cached_property
    def middles(self) -> Array:
        return np.asarray(self.nodes[self.triangles].mean(axis=1))

    @cached_property
    def areas(self) -> Array:
        a, b, c = np.moveaxis(self.nodes[self.triangles], 1, 0)
        return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))

    @cached_property
    def turns(self) -> Array:
        """Angle between the triangles of each pair, (pairs,) [rad]."""
        one, other = self.outward[self.pairs[:, 0]], self.outward[self.pairs[:, 1]]
        half = 0.5 * np.linalg.norm(one - other, axis=1)
        return np.asarray(2.0 * np.arcsin(np.minimum(half, 1.0)))

    def holes(self, spacing: float) -> list[SpatialHole]:
        """The holes, with points at a distance from each other on their walls [m]."""
        hollows = list(self._hollows())
        is_enclosed = np.zeros(len(self.triangles), dtype=bool)
        for axis in self._axes(hollows):
            is_enclosed |= self._enclosed(np.concatenate(hollows), axis)

        is_wall, is_sure = is_enclosed.copy(), np.zeros(len(is_enclosed), dtype=bool)
        for hollow in hollows:
            share = self.areas[hollow] @ is_enclosed[hollow] / np.sum(self.areas[hollow])
            is_wall[hollow] = is_sure[hollow] = share > HOLES.enclosed
        pieces = self._connected(is_wall, np.inf)
        return [self._hole(walls, spacing) for walls in pieces if np.any(is_sure[walls])]

    def _connected(self, chosen: Mask, most: float) -> Iterator[Integers]:
        """Chosen triangles that hang together by edges which turn by ``most`` [rad]."""
        within = np.all(chosen[self.pairs], axis=1) & (self.turns <= most)
        piece = connected(self.pairs[within], len(chosen))
        for number in np.unique(piece[chosen]):
            yield np.flatnonzero(piece == number)

    def _hollows(self) -> Iterator[Integers]:
        """Sets of triangles that meet in concave edges, and turn by more than a coarse curve."""
        one, other = self.pairs.T
        rise = np.einsum("pi,pi->p", self.middles[other] - self.middles[one], self.outward[one])
        inward = np.where(rise > 0.0, self.turns, -self.turns)
        # a coarse round wall has some convex edges, between triangles that bend inward on the whole
        smooth = self.turns < CURVES.turn
        bend = (inward * self.lengths * smooth)[:, None] * np.ones(2)
        total = np.bincount(self.pairs.ravel(), bend.ravel(), minlength=len(self.triangles))
        inward_on_the_whole = np.all(total[self.pairs] > 0.0, axis=1)
        joined = (rise > 0.0) | (self.turns < HOLES.flat) | (smooth & inward_on_the_whole)
        piece = connected(self.pairs[joined], len(self.triangles))
        order = np.argsort(piece, kind="stable")
        for hollow in np.split(order, np.flatnonzero(np.diff(piece[order])) + 1):
            normals = self.outward[hollow]
            farthest = normals[np.argmin(normals @ normals[0])]
            # a coarse mesh of an outer curve has concave edges, too
            if np.min(normals @ farthest) < np.cos(CURVES.turn):
                yield hollow

    def _axes(self, hollows: list[Integers]) -> list[Array]:
        """Directions across which hollows may close a ring, unit vectors (3,)."""
        axes: list[Array] = []
        for hollow in hollows:
            in_hollow = np.zeros(len(self.triangles), dtype=bool)
            in_hollow[hollow] = True
            within = in_hollow[self.pairs]
            at_mouth = within[:, 0] != within[:, 1]
            beside = self.pairs[at_mouth][~within[at_mouth]]
            lengths = self.lengths[at_mouth]

            values, directions = _principal(self.outward[hollow], self.areas[hollow])
            candidates = []
            # a cavity is closed in all directions
            if values[1] - values[0] > HOLES.distinct * np.sum(values) or not len(beside):
                candidates.append(directions[:, 0])
            values, directions = _principal(self.outward[beside], lengths)
            if values[2] - values[1] > HOLES.distinct * np.sum(values):
                candidates.append(directions[:, 2])
            for candidate in candidates:
                if all(abs(candidate @ axis) < HOLES.along for axis in axes):
                    axes.append(candidate)
        return axes

    def _enclosed(self, hollow: Integers, axis: Array) -> Mask:
        """Which triangles bound holes of most sections that cut them, (triangles,).

        The sections are normal to an axis and cut all triangles of a hollow.
        """
        across = np.linalg.svd(axis[None, :])[2][1:]
        height, flat = self.nodes @ axis, self.nodes @ across.T
        low = np.min(height[self.triangles], axis=1)
        high = np.max(height[self.triangles], axis=1)
        facing = self.outward @ axis
        level = np.abs(facing) > HOLES.along
        cut = hollow[~level[hollow]]
        sections = _sections(low[cut], high[cut])

        votes = np.zeros(len(self.triangles), dtype=int)
        middle_height, middle = self.middles @ axis, self.middles @ across.T
        above = np.searchsorted(sections, middle_height)
        off = HOLES.off_surface * np.max(np.ptp(self.nodes, axis=0)) * (self.outward @ across.T)
        for number, section in enumerate(sections):
            triangles = np.flatnonzero((low < section) & (high >= section))
            ends = self._ends(triangles, height, flat, section)
            hole = shapely.union_all([ring.shape for ring in _holes_of_section(ends)])
            shapely.prepare(hole)
            in_hole = shapely.contains_xy(hole, ends.mean(axis=1) + off[triangles])
            votes[triangles] += np.where(in_hole, 1, -1)
            # the ends of holes, which face along the axis, are seen from the nearest section
            beside = np.flatnonzero(level & (above == np.where(facing > 0.0, number, number + 1)))
            votes[beside] = shapely.contains_xy(hole, middle[beside])
        return np.asarray(votes > 0)

    def _ends(self, triangles: Integers, height: Array, flat: Array, section: float) -> Array:
        """Both ends, (triangles, 2, 2), of the line in which a section cuts triangles."""
        nodes = self.triangles[triangles]
        is_above = height[nodes] >= section
        alone = np.argmax(is_above == (np.sum(is_above, axis=1) == 1)[:, None], axis=1)
        tip = nodes[np.arange(len(nodes)), alone]
        ends = []
        for step in (1, 2):
            base = nodes[np.arange(len(nodes)), (alone + step) % 3]
            # in one order of its nodes, the cut of an edge is the same point from both sides
            first, second = np.minimum(tip, base), np.maximum(tip, base)
            share = (section - height[first]) / (height[second] - height[first])
            ends.append(flat[first] + share[:, None] * (flat[second] - flat[first]))
        return np.stack(ends, axis=1)

    def _hole(self, walls: Integers, spacing: float) -> SpatialHole:
        """The hole whose walls are some triangles."""
        chosen = np.zeros(len(self.triangles), dtype=bool)
        chosen[walls] = True
        points, middles, normals, radii = [], [], [], []
        for patch in self._connected(chosen, CURVES.turn):
            on_patch, middle = self._points(patch, spacing), self.middles[patch]
            outward, radius = self.outward[patch], self._radius(patch)
            cylinder = self._cylinder(patch)
            if cylinder is not None:
                center, axis, radius = cylinder
                on_patch, _ = _onto(on_patch, center, axis, radius)
                middle, radial = _onto(middle, center, axis, radius)
                outward = np.sign(np.einsum("ti,ti->t", radial, outward))[:, None] * radial
            points.append(on_patch)
            middles.append(middle)
            normals.append(outward)
            radii.append(radius)
        return SpatialHole(
            np.concatenate(points), np.concatenate(middles), np.concatenate(normals), min(radii)
        )

    def _points(self, triangles: Integers, spacing: float) -> Array:
        """Points on triangles, as far from each other as said or nearer, (points, 3)."""
        corners = self.nodes[self.triangles[triangles]]
        longest = np.max(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2), axis=1)
        divisions = np.ceil(longest / spacing).astype(int)

        points = []
        for n in np.unique(divisions):
            # the lattice that cuts each side into n, by the shares of the corners in its points
            i, j = np.nonzero(np.add.outer(np.arange(n + 1), np.arange(n + 1)) <= n)
            shares = np.column_stack([i, j, n - i - j]) / n
            on_triangles = np.einsum("sc,tci->tsi", shares, corners[divisions == n])
            points.append(on_triangles.reshape(-1, 3))
        return np.concatenate(points)

    def _cylinder(self, patch: Integers) -> tuple[Array, Array, float] | None:
        """Center, axis and radius of the cylinder on which a patch is, or None."""
        points = self.nodes[np.unique(self.triangles[patch])]
        cylinder = fit_cylinder(points, np.linalg.svd(self.outward[patch])[2][2])
        if cylinder is None:
            return None
        center, axis = cylinder
        away = np.linalg.norm(np.cross(points - center, axis), axis=1)
        radius = float(away.mean())
        return (center, axis, radius) if np.ptp(away) < HOLES.on_cylinder * radius else None

    def _radius(self, patch: Integers) -> float:
        """Mean radius of the curved triangles of a patch, infinite where none is curved.

        The curvature of a surface is the sum of the angles of its edges times their lengths, by its
        area.
        """
        on_patch = np.zeros(len(self.triangles), dtype=bool)
        on_patch[patch] = True
        turned = np.all(on_patch[self.pairs], axis=1) & (self.turns > HOLES.flat)
        if not np.any(turned):
            return np.inf
        area = np.sum(self.areas[np.unique(self.pairs[turned])])
        return float(area / (self.turns[turned] @ self.lengths[turned]))


def _sections(low: Array, high: Array) -> Array:
    """Heights, in order, of which one at least is clearly between each ``low`` and ``high``."""
    order = np.argsort(high)
    low, high = low[order], high[order]
    heights = []
    while len(low):
        last = high[0] - HOLES.clear * (high[0] - low[0])
        together = low <= last
        heights.append(0.5 * (np.max(low[together]) + high[0]))
        low, high = low[~together], high[~together]
    return np.array(heights)


def _principal(normals: Array, weights: Array) -> tuple[Array, Array]:
    """Principal values in rising order, (3,), and directions, the columns of (3, 3)."""
    values, directions = np.linalg.eigh((weights[:, None] * normals).T @ normals)
    return values, directions


def _holes_of_section(ends: Array) -> list[FlatHole]:
    """The holes of the material that lines enclose, given their ends (lines, 2, 2)."""
    lines = shapely.multilinestrings(shapely.linestrings(ends))
    return flat_holes(shapely.build_area(lines))


def _onto(points: Array, center: Array, axis: Array, radius: float) -> tuple[Array, Array]:
    """Points (n, 3) moved straight onto a cylinder, and the directions from its axis, (n, 3)."""
    offset = points - center
    foot = center + (offset @ axis)[:, None] * axis
    radial = points - foot
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    return foot + radius * radial, radial
