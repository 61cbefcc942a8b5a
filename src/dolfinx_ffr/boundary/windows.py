# SPDX-License-Identifier: MIT
"""Windows in the walls of a solid that may lower psi, as walls have a least thickness.

They are round holes through a wall, with wall all around them. What they change is predicted by the
topological derivative of a hole in a plate, summed over what would go.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array
from .fields import Field
from .options import SURFACES, SurfaceOptions
from .walls import Walls

#: Directions in which the wall around a window is looked at
_AROUND = 8

#: Images of points (n, 3) by an isometry
Image = Callable[[Array], Array]


class Window(NamedTuple):
    """A round hole through a wall."""

    center: Array  #: Amid the wall, (3,) [m]
    normal: Array  #: Of the wall, (3,)
    radius: float  #: [m]
    depth: float  #: On each side of the centre [m]

    def outside(self, x: Array) -> Array:
        """How far points (n, 3) are outside of the hole, or at least, (n,) [m]."""
        axial, radial = _axial_and_radial(x - self.center, self.normal)
        return np.maximum(radial - self.radius, np.abs(axial) - self.depth)


def promising(
    walls: Walls,
    images: Sequence[Image],
    member: float,
    places: Array,
    changes: Array,
    options: SurfaceOptions = SURFACES,
) -> list[Window]:
    """Windows that do not meet, those first that lower psi most.

    ``changes`` (cells,) are those of log psi if cells at ``places`` (cells, 3) went. Each of the
    windows stands for its ``images``, too.
    """
    candidates = list(_candidates(walls, member, places, changes, options))
    candidates.sort(key=lambda candidate: candidate[0])
    windows: list[Window] = []
    for _, window in candidates:
        centers = np.vstack([image(window.center[None]) for image in images])
        if _least_bridge(window, centers, windows) > options.bridge * member:
            windows.append(window)
    return windows


def _candidates(
    walls: Walls, member: float, places: Array, changes: Array, options: SurfaceOptions
) -> Iterator[tuple[float, Window]]:
    """Predicted changes of log psi, and windows with wall all around them."""
    middles, normals = walls.middles, walls.normals
    boxes = np.floor(middles / (options.places * member)).astype(int).reshape(-1, 3)
    first_of_boxes = np.sort(np.unique(boxes, axis=0, return_index=True)[1])
    wall_tree, cell_tree = cKDTree(middles.reshape(-1, 3)), cKDTree(places)
    for k in first_of_boxes:
        center, normal, half = middles[k], normals[k], 0.5 * walls.thickness[k]
        for radius in member * np.array(options.radii):
            rings = _rings(center, normal, [0.5 * radius, radius, radius + options.bridge * member])
            distance, nearest = wall_tree.query(rings)
            is_flat = np.abs(normals[nearest] @ normal) > options.flat
            if not np.all(is_flat & (distance < options.wall_near * member)):
                break  # nor has a larger one wall all around it
            cells = cell_tree.query_ball_point(center, np.hypot(radius, half))
            cells = np.array(cells, dtype=int)
            _, radial = _axial_and_radial(places[cells] - center, normal)
            change = float(np.sum(changes[cells[radial < radius]]))
            if change < -options.promised:
                depth = half + options.deeper * member
                yield change, Window(center, normal, float(radius), depth)


def _rings(center: Array, normal: Array, radii: Sequence[float]) -> Array:
    """Points on circles around a centre in the plane with a ``normal``, (n, 3) [m]."""
    in_plane = np.linalg.svd(normal[None])[2][1:]
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    circle = np.column_stack([np.cos(angle), np.sin(angle)]) @ in_plane
    return np.asarray((center + np.array(radii)[:, None, None] * circle).reshape(-1, 3))


def _least_bridge(window: Window, centers: Array, windows: Sequence[Window]) -> float:
    """Least width of the wall between a window with images at ``centers`` (n, 3) and others [m]."""

    def bridges(neighbour: Window) -> Array:
        distance = np.linalg.norm(centers - neighbour.center, axis=1)
        return np.asarray(distance - neighbour.radius - window.radius)

    to_images = bridges(window)
    # it may be its own image
    to_images[to_images < -(2.0 - 1e-6) * window.radius] = np.inf
    return float(np.min([*map(bridges, windows), to_images]))


def _axial_and_radial(x: Array, axis: Array) -> tuple[Array, Array]:
    """Components of vectors (n, 3) along a unit ``axis`` (3,), and lengths across it, (n,) each."""
    axial = x @ axis
    return axial, np.linalg.norm(x - axial[:, None] * axis, axis=1)


def with_openings(field: Field, windows: Sequence[Window], images: Sequence[Image]) -> Field:
    """A field with these windows and their images."""

    def opened(x: Array) -> Array:
        values = field(x)
        for image in images:
            at_image = image(x)
            for window in windows:
                values = np.minimum(values, window.outside(at_image))
        return values

    return opened
