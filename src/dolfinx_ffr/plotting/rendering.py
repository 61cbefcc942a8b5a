# SPDX-License-Identifier: MIT
"""Pictures of bodies in space: rendered without a screen, set in a page of the package's style."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

__all__ = ["Rendering", "rendering"]

Array = NDArray[np.float64]

#: Pixels of an inch of the page, twice those of the page for smooth edges
_PER_INCH = 220
#: From what is seen to who looks: from the front, the right and above
_BACK = np.array([0.45, -1.0, 0.5]) / np.linalg.norm([0.45, -1.0, 0.5])
_RIGHT = np.cross([0.0, 0.0, 1.0], _BACK) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], _BACK))
#: Directions to the right and upwards, shape (3, 2)
_ACROSS = np.column_stack([_RIGHT, np.cross(_BACK, _RIGHT)])


class Rendering:
    """A view of things in space, from the front, the right and above.

    Args:
        width: In inches.
        height: In inches.
        points: All that is to be seen, shape (n, 3) [m].
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
        """Height over width of what is seen of ``points`` (n, 3)."""
        low, high = _projected(points)
        return float((high - low)[1] / (high - low)[0])

    def look(self) -> None:
        """Look at the middle of the points, z upwards, so that all of them fit."""
        low, high = _projected(self._points)
        middle = self._points.mean(axis=0)
        middle = middle + _ACROSS @ (0.5 * (low + high) - middle @ _ACROSS)
        camera = self.plotter.camera
        camera.position = tuple(middle + 4.0 * self.size * _BACK)
        camera.focal_point = tuple(middle)
        camera.up = tuple(_ACROSS[:, 1])
        wide, tall = high - low
        camera.parallel_scale = 0.53 * max(tall, wide / self._aspect)
        self.plotter.reset_camera_clipping_range()

    def add(self, mesh: Any, **how: Any) -> Any:
        """Add a mesh, shaded in the same way everywhere."""
        # colours that mean a number must stay what they are
        dim = "scalars" in how
        style: dict[str, Any] = {"ambient": 0.6 if dim else 0.25, "diffuse": 0.5 if dim else 0.8}
        style |= {"smooth_shading": False, "show_scalar_bar": False}
        return self.plotter.add_mesh(mesh, **{**style, **how})

    def span(self, point: Array, direction: Array, reach: float) -> tuple[float, float]:
        """How far a line goes from a point to both sides in what is seen, ``reach`` at most."""
        low, high = -reach, reach
        box = self._points.min(axis=0), self._points.max(axis=0)
        for k in range(3):
            if abs(direction[k]) > 1e-9:
                a, b = sorted((side[k] - point[k]) / direction[k] for side in box)
                low, high = max(low, a), min(high, b)
        return (low, high) if low < high else (-0.1 * reach, 0.1 * reach)

    def nearer(self, mesh: Any) -> Any:
        """A mesh a little nearer to who looks, so that it covers what it lies on."""
        return mesh.translate(2e-3 * self.size * _BACK, inplace=False)

    def picture(self) -> NDArray[np.uint8]:
        """What is seen, shape (height, width, 3)."""
        self.plotter.render()
        return np.asarray(self.plotter.screenshot(return_img=True))[..., :3]

    def show(self, axes: Axes) -> None:
        """Put what is seen into axes, which it fills."""
        axes.imshow(self.picture(), interpolation="antialiased", aspect="auto")
        axes.set_axis_off()


def _projected(points: Array) -> tuple[Array, Array]:
    """Least and largest coordinates of points to the right and upwards, shape (2,) each."""
    flat = points @ _ACROSS
    return flat.min(axis=0), flat.max(axis=0)


@contextmanager
def rendering(width: float, height: float, points: Array) -> Iterator[Rendering]:
    """Give a `Rendering`, whose memory is freed at the end."""
    view = Rendering(width, height, points)
    try:
        yield view
    finally:
        view.plotter.close()
