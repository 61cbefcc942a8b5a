# SPDX-License-Identifier: MIT
"""Pictures of bodies in space: rendered without a screen, set in a page of the package's style."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ..arrays import Array
from ..fem import surface_of

#: Pixels of an inch of the page, twice those of the page for smooth edges
_PER_INCH = 220
#: Direction to the camera: in front, on the right and above
_BACK = np.array([0.45, -1.0, 0.5]) / np.linalg.norm([0.45, -1.0, 0.5])
_RIGHT = np.cross([0.0, 0.0, 1.0], _BACK) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], _BACK))
#: Directions to the right and upwards, shape (3, 2)
_ACROSS = np.column_stack([_RIGHT, np.cross(_BACK, _RIGHT)])


class Rendering:
    """A view from the front, the right and above that shows all ``points`` (n, 3).

    Width and height are in inches.
    """

    def __init__(self, width: float, height: float, points: Array) -> None:
        import pyvista  # takes a while

        self.size = float(np.linalg.norm(np.ptp(points, axis=0)))
        pixels = [int(_PER_INCH * width), int(_PER_INCH * height)]
        self.plotter: Any = pyvista.Plotter(off_screen=True, window_size=pixels)
        self.plotter.background_color = "white"
        self.plotter.enable_parallel_projection()
        self._points = points
        self._aspect = width / height

    @staticmethod
    def shape_of(points: Array) -> float:
        """Height over width of ``points`` (n, 3) in the view."""
        wide, tall = np.ptp(points @ _ACROSS, axis=0)
        return float(tall / wide)

    def look(self) -> None:
        """Look at the middle of the points, z upwards, so that all of them fit."""
        flat = self._points @ _ACROSS
        low, high = flat.min(axis=0), flat.max(axis=0)
        middle = self._points.mean(axis=0)
        middle = middle + _ACROSS @ (0.5 * (low + high) - middle @ _ACROSS)
        camera = self.plotter.camera
        camera.position = tuple(middle + 4.0 * self.size * _BACK)
        camera.focal_point = tuple(middle)
        camera.up = tuple(_ACROSS[:, 1])
        wide, tall = high - low
        camera.parallel_scale = 0.53 * max(tall, wide / self._aspect)
        self.plotter.reset_camera_clipping_range()

    def add(self, mesh: Any, **how: Any) -> None:
        """Add a mesh, shaded in the same way everywhere."""
        # colours that mean a number must stay what they are
        dim = "scalars" in how
        style: dict[str, Any] = {"ambient": 0.6 if dim else 0.25, "diffuse": 0.5 if dim else 0.8}
        style |= {"smooth_shading": False, "show_scalar_bar": False}
        self.plotter.add_mesh(mesh, **{**style, **how})

    def span(self, point: Array, direction: Array) -> tuple[float, float]:
        """How far a line reaches from a point to both sides in the view."""
        low, high = -self.size, self.size
        box = self._points.min(axis=0), self._points.max(axis=0)
        for k in range(3):
            if abs(direction[k]) > 1e-9:
                a, b = sorted((side[k] - point[k]) / direction[k] for side in box)
                low, high = max(low, a), min(high, b)
        return (low, high) if low < high else (-0.1 * self.size, 0.1 * self.size)

    def nearer(self, mesh: Any) -> Any:
        """A mesh moved a little to the camera, so that it covers the surface on which it lies."""
        return mesh.translate(2e-3 * self.size * _BACK, inplace=False)

    def picture(self) -> NDArray[np.uint8]:
        """The view as pixels, shape (height, width, 3)."""
        self.plotter.render()
        return np.asarray(self.plotter.screenshot(return_img=True))[..., :3]

    def close(self) -> None:
        """Free the memory."""
        self.plotter.close()

    def show(self, axes: Axes) -> None:
        """Fill axes with the view."""
        axes.imshow(self.picture(), interpolation="antialiased", aspect="auto")
        axes.set_axis_off()


def feature_edges(grid: Any) -> Any:
    """The edges of a body where its faces meet at an angle."""
    return surface_of(grid).extract_feature_edges(
        feature_angle=40.0, boundary_edges=False, manifold_edges=False, non_manifold_edges=False
    )
