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


class Rendering:
    """A view of things in space, from the front, the right and above.

    Args:
        width: In inches.
        height: In inches.
        box: Lower and upper corner of what is to be seen, shape (2, 3) [m].
    """

    def __init__(self, width: float, height: float, box: Array) -> None:
        import pyvista  # takes a while

        self.size = float(np.linalg.norm(np.ptp(box, axis=0)))
        pixels = [int(_PER_INCH * width), int(_PER_INCH * height)]
        self.plotter: Any = pyvista.Plotter(off_screen=True, window_size=pixels)
        self.plotter.background_color = "white"
        self.plotter.enable_parallel_projection()
        self._box = box
        self._aspect = width / height

    @staticmethod
    def shape_of(box: Array) -> float:
        """Height over width of what is seen of a ``box`` (2, 3)."""
        _, (low, high) = _projected(box)
        return float((high - low)[1] / (high - low)[0])

    def look(self) -> None:
        """Look at the middle of the box, z upwards, so that all of it fits."""
        axes, (low, high) = _projected(self._box)
        corners = np.array(np.meshgrid(*self._box.T)).reshape(3, -1).T
        middle = corners.mean(axis=0)
        middle = middle + axes @ (0.5 * (low + high) - middle @ axes)
        camera = self.plotter.camera
        camera.position = tuple(middle + 4.0 * self.size * _BACK)
        camera.focal_point = tuple(middle)
        camera.up = tuple(axes[:, 1])
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

    def nearer(self, mesh: Any) -> Any:
        """A mesh a little nearer to who looks, so that it covers what it lies on."""
        return mesh.translate(2e-3 * self.size * _BACK, inplace=False)

    def picture(self) -> NDArray[np.uint8]:
        """What is seen, shape (height, width, 3)."""
        return np.asarray(self.plotter.screenshot(return_img=True))[..., :3]

    def show(self, axes: Axes) -> None:
        """Put what is seen into axes, which it fills."""
        axes.imshow(self.picture(), interpolation="antialiased", aspect="auto")
        axes.set_axis_off()


def _projected(box: Array) -> tuple[Array, Array]:
    """Directions to the right and upwards, shape (3, 2), and what the box spans along them."""
    right = np.cross([0.0, 0.0, 1.0], _BACK)
    right /= np.linalg.norm(right)
    axes = np.column_stack([right, np.cross(_BACK, right)])
    flat = np.array(np.meshgrid(*box.T)).reshape(3, -1).T @ axes
    return axes, np.array([flat.min(axis=0), flat.max(axis=0)])


@contextmanager
def rendering(width: float, height: float, box: Array) -> Iterator[Rendering]:
    """Give a `Rendering`, whose memory is freed at the end."""
    view = Rendering(width, height, box)
    try:
        yield view
    finally:
        view.plotter.close()
