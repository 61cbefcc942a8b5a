# SPDX-License-Identifier: MIT
"""Walls of a solid by the largest balls that touch its surface, and a field without thin ones.

Where a ball touches both sides of a wall its diameter is the thickness; in a post between sides
that are not opposite, it is that of the ball which touches them. Samples are those of the field,
not of a mesh that was cut by it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Integers, Mask
from ..fem import DESIGNED, SOLID, VOID, Domain, Tetrahedra, connected
from ..part import Balls, outer_faces, spread, tangent_balls
from .options import SURFACES, SurfaceOptions

Field = Callable[[Array], Array]

#: Times that the ball of a wall is moved off the sides of the body, of which three meet in a corner
_SIDES = 4


class Walls(NamedTuple):
    """Places where a solid is thin, the thinnest first, from points that move with the field."""

    points: Array  #: (n, 3) [m]
    inward: Array  #: Unit normals into the material there, (n, 3)
    ends: Array  #: On the other side, (n, 3) [m]
    across: Array  #: Unit normals into the material there, (n, 3)
    moving: Mask  #: Whether the other side moves, too, (n,)
    thickness: Array  #: (n,) [m]

    @property
    def middles(self) -> Array:
        """Centres of the balls, (n, 3) [m]."""
        side = np.where(self.moving[:, None], self.points, self.ends)
        return side + 0.5 * self.thickness[:, None] * self.normals

    @property
    def normals(self) -> Array:
        """Unit normals of the walls, (n, 3)."""
        return np.where(self.moving[:, None], self.inward, self.across)

    @property
    def least(self) -> float:
        """The least thickness [m]; infinite if there is none."""
        return float(np.min(self.thickness, initial=np.inf))

    def upto(self, thickness: float) -> Walls:
        """The balls that are no thicker [m]."""
        count = int(np.searchsorted(self.thickness, thickness))
        return Walls._make(part[:count] for part in self)


class Sides:
    """Samples of the sides of a body and of its regions, which do not move; on rank 0.

    Args:
        body: Its tetrahedra.
        spacing: Of the samples, about [m].
        options: Numbers of the method.
    """

    def __init__(
        self, body: Tetrahedra, spacing: float, options: SurfaceOptions = SURFACES
    ) -> None:
        import pyvista  # takes a while

        self.spacing, self.options = spacing, options
        self.low, self.high = body.points.min(axis=0), body.points.max(axis=0)
        #: Of the body, with normals inwards, (n, 3) each
        self.outline = _samples(body, body.regions != VOID, spacing)
        #: Of its solid region, likewise
        self.solid = _samples(body, body.regions == SOLID, spacing)
        #: Where the outline may have windows, (n,)
        self._free = ~_within(self.outline[0], self.solid[0], 1e-6 * spacing)
        cells = body.cells[body.regions == DESIGNED]
        table = np.column_stack([np.full(len(cells), 4), cells]).ravel()
        kinds = np.full(len(cells), pyvista.CellType.TETRA)
        self._designed = pyvista.UnstructuredGrid(table, kinds, body.points)

    @staticmethod
    def of(body: Domain, spacing: float, options: SurfaceOptions = SURFACES) -> Sides | None:
        """The sides of a ``body``, None on other ranks than 0."""
        tetrahedra = Tetrahedra.of(body)
        return None if body.comm.rank else Sides(tetrahedra, spacing, options)

    def surface(
        self, field: Field, slopes: Field, near: Array | None = None, reach: float = 0.0
    ) -> tuple[Array, Array]:
        """Samples of the zero surface of a field in the designed region, and normals inwards.

        All of them, or those up to a ``reach`` [m] from places ``near`` (n, 3).
        """
        x = contour(field, self.low, self.high, self.spacing)
        x = x[_within(x, near, reach)]
        for _ in range(2):
            slope = slopes(x)
            square = np.maximum(np.sum(slope**2, axis=1), 1e-300)
            step = (field(x) / square)[:, None] * slope
            long = np.linalg.norm(step, axis=1, keepdims=True)
            x = x - step * np.minimum(1.0, 0.5 * self.spacing / np.maximum(long, 1e-300))
        x = x[np.asarray(self._designed.find_containing_cell(x)).reshape(-1) >= 0]
        return x, _unit(slopes(x))

    def walls(
        self, field: Field, slopes: Field, least: float, widest: float, near: Array | None = None
    ) -> Walls:
        """Walls up to the ``widest``, and posts up to the ``least``, of where a field is positive.

        Thicknesses in [m]; a post has sides that are not opposite. Where places ``near`` (n, 3) are
        given, those around them only.
        """
        reach = self.options.near * least
        # balls of walls within the reach touch samples that are as far again
        sampled, inclined = 2.0 * reach, np.radians(self.options.inclined)
        x, inward = self.surface(field, slopes, near, sampled)
        there, bare = field(self.outline[0]) > 0.0, field(self.solid[0]) < 0.0
        still = ((self.outline, there), (self.solid, bare))
        parts = [(x, inward)]
        for (sides, way), chosen in still:
            chosen = chosen & _within(sides, near, sampled)
            parts.append((sides[chosen], way[chosen]))
        at, normals = (np.concatenate(part) for part in zip(*parts, strict=True))
        most = 0.5 * max(widest, self.options.seen * least)
        balls = Balls(
            at, normals, *tangent_balls(at, normals, at, normals, most), self.spacing, most
        )
        radius, end = balls.radius, balls.ends
        free = np.arange(len(at)) < len(x)
        walls = (balls.cosine < -np.cos(inclined)) & (end >= 0)
        walls[balls.thin(0.5 * least)] = True
        # of a post that which is amid it: those beside its edges are smaller
        posts = np.flatnonzero(walls & (balls.cosine >= -np.cos(inclined)))
        walls &= ~_beside(balls, posts, least, np.sin(0.5 * inclined))
        # at the tip of a hollow samples are inclined: below a face, but for rims of windows, the
        # ball is that which touches one of them
        tips = np.flatnonzero(~free & free[end] & ~walls & (end >= 0))
        walls &= free
        way = at[end[tips]] - at[tips]
        radius[tips] = 0.5 * np.sum(way**2, axis=1) / np.sum(way * normals[tips], axis=1)
        windows = self.outline[0][self._free & ~there]
        away = cKDTree(windows).query(at[tips])[0] if len(windows) else np.full(len(tips), np.inf)
        # a rim is a wedge that begins at a window
        rims = (away < least) | (radius[tips] > np.tan(0.5 * inclined) * away)
        walls[tips] = (2.0 * radius[tips] < least) & ~rims
        walls &= _within(at, near, reach)
        found = np.flatnonzero(walls & (2.0 * radius < widest))
        found = found[np.argsort(radius[found], kind="stable")]
        one, two = np.where(free[found], [found, end[found]], [end[found], found])
        return Walls(at[one], normals[one], at[two], normals[two], free[two], 2.0 * radius[found])

    def closed(self, field: Field, gap: float, thickness: float) -> Field | None:
        """A field without windows in which no disc of a diameter fits, None if there is none.

        They are filled by balls. The ``gap`` is the diameter of discs, the ``thickness`` that of
        balls [m].
        """
        x, inward = self.outline
        open_ = self._free & (field(x) < 0.0)
        holes = x[open_]
        pairs = cKDTree(holes).query_pairs(2.0 * self.spacing, output_type="ndarray")
        which = connected(pairs, len(holes))
        widest = np.zeros(len(holes))
        np.maximum.at(widest, which, cKDTree(x[~open_]).query(holes)[0])
        narrow = 2.0 * widest[which] < gap
        if not np.any(narrow):
            return None
        depth = 0.5 * thickness * inward[open_][narrow]
        # they reach beyond the outline, which balls within it only touch
        balls = cKDTree(np.concatenate([holes[narrow], holes[narrow] + depth]))
        return lambda x: np.maximum(field(x), 0.5 * thickness - balls.query(x)[0])

    def rounded(self, field: Field, diameter: float) -> Field:
        """A field whose void is where balls of a diameter [m] fit, outside the solid region.

        This is the opening of the void: slots, pockets and pinholes that are too narrow go. A
        window goes on beyond its face. The field is near the distance.
        """
        radius, still = 0.5 * diameter, cKDTree(self.solid[0])

        def level(x: Array) -> Array:
            x = np.clip(x, self.low, self.high)
            found = field(x)
            away, near = still.query(x, distance_upper_bound=2.0 * diameter)
            met = np.flatnonzero(np.isfinite(away))
            way, inward = x[met] - self.solid[0][near[met]], self.solid[1][near[met]]
            along = np.einsum("nd,nd->n", way, inward)
            # void ends before a solid region, so that they do not meet in an edge
            depth = np.where(along > 0.0, along, -away[met]) + self.spacing
            found[met] = np.maximum(found[met], depth)
            return found

        ends = self.low - diameter, self.high + diameter
        core = cKDTree(contour(level, *ends, self.spacing, -radius))
        beside = np.sqrt(0.5) * self.spacing

        def opened(x: Array) -> Array:
            inner = np.clip(x, self.low, self.high)
            beyond, found = field(x) - field(inner), level(inner)
            void = np.flatnonzero(np.abs(found) < radius)
            away = core.query(inner[void], distance_upper_bound=2.0 * diameter)[0]
            # at least, as the nearest sample may be to the side of the nearest place
            away = np.sqrt(np.maximum(np.minimum(away, 2.0 * diameter) ** 2 - beside**2, 0.0))
            found[void] = np.maximum(found[void], away - radius)
            return found + beyond

        return opened

    def blunted(self, field: Field, gap: float) -> Field | None:
        """A field `rounded` where windows end in points, None if there are none.

        There no disc of the diameter ``gap`` [m] fits in the window, but in other parts of it.
        """
        x = self.outline[0]
        open_ = self._free & (field(x) < 0.0)
        holes = x[open_]
        fits = cKDTree(x[~open_]).query(holes)[0] >= 0.5 * gap
        if not np.any(fits):
            return None
        ends = holes[cKDTree(holes[fits]).query(holes)[0] > 0.5 * gap + self.spacing]
        if not len(ends):
            return None
        tree, rounded = cKDTree(ends), self.rounded(field, gap)

        def ended(x: Array) -> Array:
            found = field(x)
            away = tree.query(x, distance_upper_bound=gap)[0]
            near = np.flatnonzero(np.isfinite(away))
            found[near] = np.maximum(found[near], np.minimum(rounded(x[near]), gap - away[near]))
            return found

        return ended

    def thickened(self, field: Field, centers: Array, thickness: float) -> Field:
        """A field with balls of a diameter [m] at centres (n, 3), moved off the body's sides."""
        tree = cKDTree(self.outline[0])
        for _ in range(_SIDES):
            near = tree.query(centers)[1]
            normal = self.outline[1][near]
            depth = np.einsum("nd,nd->n", centers - self.outline[0][near], normal)
            centers = centers + np.maximum(0.5 * thickness - depth, 0.0)[:, None] * normal
        balls = cKDTree(centers)
        return lambda x: np.maximum(field(x), 0.5 * thickness - balls.query(x)[0])


def contour(
    field: Field, low: Array, high: Array, spacing: float | Array, level: float = 0.0
) -> Array:
    """Points at which a field has a level, on a grid with at most a spacing, (n, 3) [m]."""
    import pyvista  # takes a while

    counts = np.ceil((high - low) / spacing - 1e-9).astype(int) + 1
    apart = (high - low) / (counts - 1)
    nodes = low + apart * np.indices(counts).reshape(3, -1).T
    grid = pyvista.ImageData(dimensions=tuple(counts), origin=low, spacing=apart)
    values = np.asarray(field(nodes)).reshape(counts).ravel(order="F")
    return np.asarray(grid.contour([level], scalars=values).points, dtype=np.float64)


def _beside(balls: Balls, chosen: Integers, reach: float, widens: float) -> Mask:
    """Mask of the chosen balls that are in a wedge: larger ones are near them, shape (n,).

    ``widens`` is the growth of the radii along a wedge.
    """
    found = np.zeros(len(balls.radius), dtype=bool)
    if not len(chosen):
        return found
    centers, tree = balls.centers, cKDTree(balls.centers)
    for number, near in zip(chosen, tree.query_ball_point(centers[chosen], reach), strict=True):
        away = np.linalg.norm(centers[near] - centers[number], axis=1)
        found[number] = np.any(
            balls.radius[near] - balls.radius[number] > widens * away + 1e-9 * reach
        )
    return found


def _within(x: Array, places: Array | None, distance: float) -> Mask:
    """Which points are up to a distance from any of some places, all if these are None."""
    if places is None or not len(x):
        return np.ones(len(x), dtype=bool)
    if not len(places):
        return np.zeros(len(x), dtype=bool)
    return np.asarray(np.isfinite(cKDTree(places).query(x, distance_upper_bound=distance)[0]))


def _samples(body: Tetrahedra, chosen: Mask, spacing: float) -> tuple[Array, Array]:
    """Points of the sides of chosen tetrahedra, and normals inwards, (n, 3) each."""
    faces, _, _ = outer_faces(body.cells[chosen])
    corners = body.points[faces]
    points, number = spread(corners, 2.0 * spacing)
    a, b, c = np.moveaxis(corners, 1, 0)
    return points, -_unit(np.cross(b - a, c - a))[number]


def _unit(vectors: Array) -> Any:
    """Vectors scaled to length one, (n, 3)."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
