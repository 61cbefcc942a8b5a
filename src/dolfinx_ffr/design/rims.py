# SPDX-License-Identifier: MIT
"""Rims around the holes and along the outline of a body's drawing, which designs keep solid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array, Mask
from ..fem import Domain, FlatHole, SpatialHole

#: Segments of a quarter of a circle in the polygon of a rim
_SEGMENTS = 96


class HoleRims:
    """The rims around all holes of a body's drawing: the points within a width of a hole.

    Args:
        domain: The body.
        width: Width of each rim [m]; zero for no rims.
        outline: Whether there is a rim along the outline of a body in the plane, too.
    """

    def __init__(self, domain: Domain, width: float, *, outline: bool = False) -> None:
        self.width = validation.number("design: hole_rim", width, least=0.0, unit="m")
        self._domain = domain
        self._holes = domain.holes if width else []
        self._outline = domain.outline.boundary if width and outline else None
        shapely.prepare(self._outline)
        self._cell = domain.cell_size

    @property
    def regions(self) -> list[tuple[FlatHole, shapely.Geometry]]:
        """Each hole of a body in the plane, and its rim in the body, which may be cut off [m]."""
        outline = self._domain.outline if self._holes else None
        return [
            (hole, hole.shape.buffer(self.width, quad_segs=_SEGMENTS).intersection(outline))
            for hole in self._holes
            if isinstance(hole, FlatHole)
        ]

    def contain(self, points: Array) -> Mask:
        """Whether ``points`` (..., dimension) [m] are in a rim, shape (...,)."""
        in_rim = self.margin(points.reshape(-1, points.shape[-1])) > 0.0
        return np.asarray(in_rim.reshape(points.shape[:-1]))

    def margin(self, points: Array) -> Array:
        """Depth of ``points`` (n, dimension) [m] in a rim, negative outside, shape (n,) [m].

        More than a width outside of all rims it is minus infinity.
        """
        margin = np.full(len(points), -np.inf)
        for hole in self._holes:
            low, high = hole.box
            beyond_box = np.maximum(low - points, points - high).max(axis=1)
            close = np.flatnonzero(beyond_box < 2.0 * self.width)
            depth = self.width + self._chord_depth(hole) - hole.distance(points[close])
            margin[close] = np.maximum(margin[close], depth)
        if self._outline is not None:
            positions = shapely.points(points)
            close = np.flatnonzero(shapely.dwithin(self._outline, positions, 2.0 * self.width))
            depth = self.width - shapely.distance(self._outline, positions[close])
            margin[close] = np.maximum(margin[close], depth)
        return margin

    def _chord_depth(self, hole: FlatHole | SpatialHole) -> float:
        """Depth to which flat faces of a solid, over two cells, cut into a round rim [m]."""
        if isinstance(hole, FlatHole):
            return 0.0
        return min(0.5 * self._cell**2 / (hole.radius + self.width), 0.5 * self._cell)

    def added_to(self, level: Callable[[ArrayLike], Array]) -> Callable[[ArrayLike], Array]:
        """The field ``level``, of values up to one half, made positive in the rims as well."""
        if not self._holes and self._outline is None:
            return level

        def with_rims(points: ArrayLike) -> Array:
            margin = self.margin(np.asarray(points, dtype=np.float64))
            return np.maximum(level(points), 0.5 * margin / self.width)

        return with_rims
