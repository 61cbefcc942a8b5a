# SPDX-License-Identifier: MIT
"""Windows in the walls of a solid that may lower psi, as walls have a least thickness.

They are round holes through a wall, with wall all around them. What they change is told by the
topological derivative of a hole in a plate, summed over what would go.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array
from .options import SURFACES, SurfaceOptions
from .walls import Field, Walls

#: Directions in which the wall around a window is looked at
_AROUND = 8


class Window(NamedTuple):
    """A round hole through a wall."""

    place: Array  #: Amid the wall, (3,) [m]
    normal: Array  #: Of the wall, (3,)
    radius: float  #: [m]
    depth: float  #: On each side of the place [m]


def promising(
    walls: Walls,
    images: Sequence[Callable[[Array], Array]],
    member: float,
    places: Array,
    changes: Array,
    options: SurfaceOptions = SURFACES,
) -> list[Window]:
    """Windows that do not meet, those first that lower psi most.

    ``changes`` (cells,) are those of log psi if cells at ``places`` (cells, 3) went. Each of the
    windows stands for its ``images``, too.
    """
    middles, normals = walls.middles, walls.normals
    boxes = np.floor(middles / (options.places * member)).astype(int).reshape(-1, 3)
    around, cells = cKDTree(middles.reshape(-1, 3)), cKDTree(places)
    found: list[tuple[float, Window]] = []
    for k in np.sort(np.unique(boxes, axis=0, return_index=True)[1]):
        place, normal, half = middles[k], normals[k], 0.5 * walls.thickness[k]
        for radius in member * np.array(options.radii):
            if not _surrounded(place, normal, radius, member, around, normals, options):
                break  # nor is a larger one
            near = np.array(cells.query_ball_point(place, np.hypot(radius, half)), dtype=int)
            way = places[near] - place
            across = np.linalg.norm(way - (way @ normal)[:, None] * normal, axis=1)
            change = float(np.sum(changes[near[across < radius]]))
            if change < -options.promised:
                depth = half + options.deeper * member
                found.append((change, Window(place, normal, float(radius), depth)))
    taken: list[Window] = []
    for _, window in sorted(found, key=lambda each: each[0]):
        own = np.vstack([image(window.place[None]) for image in images])
        others = [*taken, window]
        away = [np.linalg.norm(own - o.place, axis=1) - o.radius - window.radius for o in others]
        # it may be its own image
        away[-1][away[-1] < -(2.0 - 1e-6) * window.radius] = np.inf
        if np.min(away) > options.bridge * member:
            taken.append(window)
    return taken


def pierced(
    field: Field, windows: Sequence[Window], images: Sequence[Callable[[Array], Array]]
) -> Field:
    """A field with these windows and their images."""

    def opened(x: Array) -> Array:
        found = field(x)
        for image in images:
            at = image(x)
            for window in windows:
                way = at - window.place
                along = way @ window.normal
                across = np.linalg.norm(way - along[:, None] * window.normal, axis=1)
                outside = np.maximum(across - window.radius, np.abs(along) - window.depth)
                found = np.minimum(found, outside)
        return found

    return opened


def _surrounded(
    place: Array,
    normal: Array,
    radius: float,
    member: float,
    around: cKDTree,
    normals: Array,
    options: SurfaceOptions,
) -> bool:
    """Whether a window would be within a wall, on all sides."""
    one = np.linalg.svd(normal[None])[2][1:]
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.column_stack([np.cos(angle), np.sin(angle)]) @ one
    reach = np.array([0.5 * radius, radius, radius + options.bridge * member])
    away, near = around.query((place + reach[:, None, None] * ring).reshape(-1, 3))
    flat = np.abs(normals[near] @ normal) > options.flat
    return bool(np.all(flat & (away < options.wall_near * member)))
