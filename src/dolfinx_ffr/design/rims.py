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


class HoleRims:
    """The rims around all holes of a body's drawing.

    Args:
        domain: The body.
        width: Of each rim [m]; zero for no rims.
        outline: Whether there is a rim along the outline of a body in the plane, too.
    """

    def __init__(self, domain: Domain, width: float, *, outline: bool = False) -> None:
        self.width = validation.number("design: hole_rim", width, least=0.0, unit="m")
        self._holes = domain.holes if width else []
        self._outline = domain.outline.boundary if width and outline else None
        shapely.prepare(self._outline)
        self._cell = domain.cell_size

    def contain(self, points: Array) -> Mask:
        """Whether ``points`` (..., dimension) [m] are in a rim, shape (...,)."""
        inside = self.margin(points.reshape(-1, points.shape[-1])) > 0.0
        return np.asarray(inside.reshape(points.shape[:-1]))

    def margin(self, points: Array) -> Array:
        """How far ``points`` (n, dimension) [m] are inside a rim, negative outside, (n,) [m].

        More than a width outside of all rims it is minus infinity.
        """
        margin = np.full(len(points), -np.inf)
        for hole in self._holes:
            low, high = hole.box
            beyond = np.maximum(low - points, points - high).max(axis=1)
            near = np.flatnonzero(beyond < 2.0 * self.width)
            inside = self.width + self._cut_off(hole) - hole.distance(points[near])
            margin[near] = np.maximum(margin[near], inside)
        if self._outline is not None:
            corners = shapely.points(points)
            near = np.flatnonzero(shapely.dwithin(self._outline, corners, 2.0 * self.width))
            inside = self.width - shapely.distance(self._outline, corners[near])
            margin[near] = np.maximum(margin[near], inside)
        return margin

    def _cut_off(self, hole: FlatHole | SpatialHole) -> float:
        """By how much chords of two cells cut into a round rim in space, where solids have them."""
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
