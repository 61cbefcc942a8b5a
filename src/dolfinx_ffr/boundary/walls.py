# SPDX-License-Identifier: MIT
"""Walls of a solid by the largest balls that touch its surface, and a field without thin ones.

Where a ball touches both sides of a wall its diameter is the thickness; in a post between sides
that are not opposite, it is that of the ball which touches them. Samples are those of the field,
not of a mesh that was cut by it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array, Integers, Mask
from ..fem import DESIGNED, SOLID, VOID, Domain, Tetrahedra, connected
from ..part import Balls, outer_faces, spread, tangent_balls
from .fields import Field, contour
from .options import SURFACES, SurfaceOptions

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
        touched = np.where(self.moving[:, None], self.points, self.ends)
        return touched + 0.5 * self.thickness[:, None] * self.normals

    @property
    def normals(self) -> Array:
        """Unit normals of the walls, (n, 3)."""
        return np.where(self.moving[:, None], self.inward, self.across)

    @property
    def least(self) -> float:
        """The least thickness [m]; infinite if there is none."""
        return float(np.min(self.thickness, initial=np.inf))

    def upto(self, thickness: float) -> Walls:
        """The walls that are no thicker [m]."""
        count = int(np.searchsorted(self.thickness, thickness))
        return Walls._make(values[:count] for values in self)


class Samples(NamedTuple):
    """Points of a surface, and unit normals into the material, (n, 3) each."""

    points: Array  #: [m]
    normals: Array

    def where(self, chosen: Mask) -> Samples:
        """The samples that are chosen by a mask (n,)."""
        return Samples(self.points[chosen], self.normals[chosen])


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
        #: Of the body
        self.outline = _samples(body, body.regions != VOID, spacing)
        #: Of its solid region
        self.solid = _samples(body, body.regions == SOLID, spacing)
        #: Where the outline may have windows, (n,)
        self._may_open = ~_is_near(self.outline.points, self.solid.points, 1e-6 * spacing)
        cells = body.cells[body.regions == DESIGNED]
        table = np.column_stack([np.full(len(cells), 4), cells]).ravel()
        cell_types = np.full(len(cells), pyvista.CellType.TETRA)
        self._designed = pyvista.UnstructuredGrid(table, cell_types, body.points)

    @staticmethod
    def of(body: Domain, spacing: float, options: SurfaceOptions = SURFACES) -> Sides | None:
        """The sides of a ``body``, None on other ranks than 0."""
        tetrahedra = Tetrahedra.of(body)
        return None if body.comm.rank else Sides(tetrahedra, spacing, options)

    def surface(
        self, field: Field, slopes: Field, near: Array | None = None, reach: float = 0.0
    ) -> Samples:
        """Samples of the zero surface of a field, with ``slopes``, in the designed region.

        All of them, or those up to a ``reach`` [m] from places ``near`` (n, 3).
        """
        x = contour(field, self.low, self.high, self.spacing)
        x = x[_is_near(x, near, reach)]

        # steps of Newton's method onto the surface, along the slope, of at most half a spacing
        for _ in range(2):
            slope = slopes(x)
            square = np.maximum(np.sum(slope**2, axis=1), 1e-300)
            step = (field(x) / square)[:, None] * slope
            length = np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-300)
            x = x - step * np.minimum(1.0, 0.5 * self.spacing / length)

        x = x[np.asarray(self._designed.find_containing_cell(x)).reshape(-1) >= 0]
        return Samples(x, _unit(slopes(x)))

    # ------------------------------------------------------------------ walls

    def walls(
        self, field: Field, slopes: Field, least: float, widest: float, near: Array | None = None
    ) -> Walls:
        """Walls up to the ``widest``, and posts up to the ``least``, of where a field is positive.

        Thicknesses in [m]; a post has sides that are not opposite. Where places ``near`` (n, 3) are
        given, those around them only.
        """
        reach = self.options.near * least
        # balls of walls within the reach touch samples that are as far again
        moving = self.surface(field, slopes, near, 2.0 * reach)
        is_material = field(self.outline.points) > 0.0
        is_bare = field(self.solid.points) < 0.0
        samples = _joined(
            moving,
            self.outline.where(is_material & _is_near(self.outline.points, near, 2.0 * reach)),
            self.solid.where(is_bare & _is_near(self.solid.points, near, 2.0 * reach)),
        )
        largest = 0.5 * max(widest, self.options.constrained * least)
        balls = Balls(
            *samples,
            *tangent_balls(*samples, *samples, largest),
            self.spacing,
            largest,
        )
        moves = np.arange(len(samples.points)) < len(moving.points)
        is_wall = self._is_amid_wall(balls, least)
        windows = self.outline.points[self._may_open & ~is_material]
        tips, tip_radii = self._tips_of_hollows(balls, moves, is_wall, windows, least)

        radius = balls.radius.copy()
        radius[tips] = tip_radii
        is_wall &= moves
        is_wall[tips] = True
        is_wall &= _is_near(samples.points, near, reach) & (2.0 * radius < widest)
        numbers = np.flatnonzero(is_wall)
        numbers = numbers[np.argsort(radius[numbers], kind="stable")]
        return _as_walls(balls, radius, moves, numbers)

    @property
    def _inclined(self) -> float:
        """Angle between the sides of a wall up to which they count as opposite [rad]."""
        return float(np.radians(self.options.inclined))

    def _is_amid_wall(self, balls: Balls, least: float) -> Mask:
        """Mask of the balls between opposite sides, and amid posts thinner than ``least``, (n,)."""
        is_opposite = balls.cosine < -np.cos(self._inclined)
        is_wall = is_opposite & (balls.ends >= 0)
        is_wall[balls.thin(0.5 * least)] = True
        # of a post the ball amid it counts: those beside its edges are smaller
        posts = np.flatnonzero(is_wall & ~is_opposite)
        return np.asarray(
            is_wall & ~_is_in_wedge(balls, posts, least, np.sin(0.5 * self._inclined))
        )

    def _tips_of_hollows(
        self, balls: Balls, moves: Mask, is_wall: Mask, windows: Array, least: float
    ) -> tuple[Integers, Array]:
        """Samples of a face below which a hollow ends in a thin wall, and radii of the balls there.

        At the tip of a hollow all samples are inclined, so the ball is that which touches one of
        them. Given are masks (n,) of samples that move and of walls, and places of ``windows``
        (k, 3) [m].
        """
        ends = balls.ends
        tips = np.flatnonzero(~moves & moves[ends] & ~is_wall & (ends >= 0))
        to_end = balls.points[ends[tips]] - balls.points[tips]
        depth = np.sum(to_end * balls.normals[tips], axis=1)
        radius = 0.5 * np.sum(to_end**2, axis=1) / depth

        # the rim of a window is a wedge that begins at the window, and no wall
        to_window = np.full(len(tips), np.inf)
        if len(windows):
            to_window = cKDTree(windows).query(balls.points[tips])[0]
        in_wedge = radius > np.tan(0.5 * self._inclined) * to_window
        is_thin = (2.0 * radius < least) & (to_window >= least) & ~in_wedge
        return tips[is_thin], radius[is_thin]

    # ------------------------------------------------------------------ fields

    def _windows(self, field: Field) -> tuple[Mask, cKDTree]:
        """Mask of the outline's samples that are in windows, and a tree of the others."""
        points = self.outline.points
        is_open = self._may_open & (field(points) < 0.0)
        return is_open, cKDTree(points[~is_open])

    def closed(self, field: Field, gap: float, thickness: float) -> Field | None:
        """A field without windows in which no disc of a diameter fits, None if there is none.

        They are filled by balls. The ``gap`` is the diameter of discs, the ``thickness`` that of
        balls [m].
        """
        is_open, around = self._windows(field)
        openings = self.outline.where(is_open)
        pairs = cKDTree(openings.points).query_pairs(2.0 * self.spacing, output_type="ndarray")
        window = connected(pairs, len(openings.points))
        largest_radius = np.zeros(len(openings.points))
        np.maximum.at(largest_radius, window, around.query(openings.points)[0])
        is_narrow = 2.0 * largest_radius[window] < gap
        if not np.any(is_narrow):
            return None
        narrow = openings.where(is_narrow)
        # balls reach beyond the outline, which those within it only touch
        inside = narrow.points + 0.5 * thickness * narrow.normals
        return _with_balls(field, np.concatenate([narrow.points, inside]), thickness)

    def blunted(self, field: Field, gap: float) -> Field | None:
        """A field `rounded` where windows end in points, None if there are none.

        There no disc of the diameter ``gap`` [m] fits in the window, but in other parts of it.
        """
        is_open, around = self._windows(field)
        openings = self.outline.points[is_open]
        fits = around.query(openings)[0] >= 0.5 * gap
        if not np.any(fits):
            return None
        to_fitting = cKDTree(openings[fits]).query(openings)[0]
        ends = openings[to_fitting > 0.5 * gap + self.spacing]
        if not len(ends):
            return None
        tree, rounded = cKDTree(ends), self.rounded(field, gap)

        def blunted_field(x: Array) -> Array:
            values = field(x)
            distance = tree.query(x, distance_upper_bound=gap)[0]
            band = np.flatnonzero(np.isfinite(distance))
            at_ends = np.minimum(rounded(x[band]), gap - distance[band])
            values[band] = np.maximum(values[band], at_ends)
            return values

        return blunted_field

    def rounded(self, field: Field, diameter: float) -> Field:
        """A field whose void is where balls of a diameter [m] fit, outside the solid region.

        This is the opening of the void: slots, pockets and pinholes that are too narrow go. A
        window goes on beyond its face. The field is near the distance.
        """
        radius = 0.5 * diameter
        solid_tree = cKDTree(self.solid.points)

        def off_solid(x: Array) -> Array:
            """The field, and positive near the solid region."""
            x = np.clip(x, self.low, self.high)
            values = field(x)
            distance, nearest = solid_tree.query(x, distance_upper_bound=2.0 * diameter)
            band = np.flatnonzero(np.isfinite(distance))
            to_point = x[band] - self.solid.points[nearest[band]]
            inward = self.solid.normals[nearest[band]]
            depth = np.einsum("nd,nd->n", to_point, inward)
            # void ends before a solid region, so that they do not meet in an edge
            margin = np.where(depth > 0.0, depth, -distance[band]) + self.spacing
            values[band] = np.maximum(values[band], margin)
            return values

        low, high = self.low - diameter, self.high + diameter
        # centres of balls that fit are within the level at minus their radius
        eroded = cKDTree(contour(off_solid, low, high, self.spacing, -radius))
        half_diagonal = np.sqrt(0.5) * self.spacing

        def opened(x: Array) -> Array:
            inside = np.clip(x, self.low, self.high)
            values = off_solid(inside)
            band = np.flatnonzero(np.abs(values) < radius)
            distance = eroded.query(inside[band], distance_upper_bound=2.0 * diameter)[0]
            # at least, as the nearest sample may be to the side of the nearest place
            squares = np.minimum(distance, 2.0 * diameter) ** 2 - half_diagonal**2
            distance = np.sqrt(np.maximum(squares, 0.0))
            values[band] = np.maximum(values[band], distance - radius)
            beyond_faces = field(x) - field(inside)
            return values + beyond_faces

        return opened

    def thickened(self, field: Field, centers: Array, thickness: float) -> Field:
        """A field with balls of a diameter [m] at centres (n, 3), moved off the body's sides."""
        tree = cKDTree(self.outline.points)
        for _ in range(_SIDES):
            nearest = tree.query(centers)[1]
            normals = self.outline.normals[nearest]
            depth = np.einsum("nd,nd->n", centers - self.outline.points[nearest], normals)
            missing_depth = np.maximum(0.5 * thickness - depth, 0.0)
            centers = centers + missing_depth[:, None] * normals
        return _with_balls(field, centers, thickness)


def _with_balls(field: Field, centers: Array, diameter: float) -> Field:
    """A field that is positive in balls of a diameter [m] at centres (n, 3), too."""
    tree = cKDTree(centers)
    return lambda x: np.maximum(field(x), 0.5 * diameter - tree.query(x)[0])


def _as_walls(balls: Balls, radius: Array, moves: Mask, numbers: Integers) -> Walls:
    """The walls of some balls with these radii (n,) [m], each from a sample that ``moves`` (n,)."""
    ends = balls.ends[numbers]
    point_numbers = np.where(moves[numbers], numbers, ends)
    end_numbers = np.where(moves[numbers], ends, numbers)
    return Walls(
        points=balls.points[point_numbers],
        inward=balls.normals[point_numbers],
        ends=balls.points[end_numbers],
        across=balls.normals[end_numbers],
        moving=moves[end_numbers],
        thickness=2.0 * radius[numbers],
    )


def _is_in_wedge(balls: Balls, chosen: Integers, reach: float, widens: float) -> Mask:
    """Mask of the chosen balls that are in a wedge: larger ones are near them, shape (n,).

    ``widens`` is the growth of the radii along a wedge, the ``reach`` how near those are [m].
    """
    in_wedge = np.zeros(len(balls.radius), dtype=bool)
    if not len(chosen):
        return in_wedge
    centers, tree = balls.centers, cKDTree(balls.centers)
    neighbours_of_chosen = tree.query_ball_point(centers[chosen], reach)
    for number, neighbours in zip(chosen, neighbours_of_chosen, strict=True):
        distance = np.linalg.norm(centers[neighbours] - centers[number], axis=1)
        growth = balls.radius[neighbours] - balls.radius[number]
        in_wedge[number] = np.any(growth > widens * distance + 1e-9 * reach)
    return in_wedge


def _is_near(x: Array, places: Array | None, distance: float) -> Mask:
    """Whether points are up to a distance from any of some places, all if these are None."""
    if places is None or not len(x):
        return np.ones(len(x), dtype=bool)
    if not len(places):
        return np.zeros(len(x), dtype=bool)
    return np.asarray(np.isfinite(cKDTree(places).query(x, distance_upper_bound=distance)[0]))


def _samples(body: Tetrahedra, chosen: Mask, spacing: float) -> Samples:
    """Samples of the sides of the chosen tetrahedra."""
    faces, _, _ = outer_faces(body.cells[chosen])
    corners = body.points[faces]
    points, face = spread(corners, 2.0 * spacing)
    a, b, c = np.moveaxis(corners, 1, 0)
    return Samples(points, -_unit(np.cross(b - a, c - a))[face])


def _joined(*samples: Samples) -> Samples:
    points, normals = (np.concatenate(arrays) for arrays in zip(*samples, strict=True))
    return Samples(points, normals)


def _unit(vectors: Array) -> Array:
    """Vectors scaled to length one, (n, 3)."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, 1e-300))
