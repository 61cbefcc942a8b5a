# SPDX-License-Identifier: MIT
"""Views of meshes in space, rendered by PyVista without a screen."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Integers
from ..fem import surface_of
from .style import GRAY

#: Width of a rendered picture in pixels, twice that of the page for smooth edges
PIXELS = 2000
MATERIAL = "#b9c0c8"
#: Direction to the camera: in front, on the right and above
_BACK = np.array([0.45, -1.0, 0.5]) / np.linalg.norm([0.45, -1.0, 0.5])
_RIGHT = np.cross([0.0, 0.0, 1.0], _BACK) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], _BACK))
#: Directions to the right and upwards, shape (3, 2)
_PROJECTION = np.column_stack([_RIGHT, np.cross(_BACK, _RIGHT)])


class Rendering:
    """A view from the front, the right and above that shows all ``points`` (n, 3)."""

    def __init__(self, points: Array, width: int = PIXELS) -> None:
        import pyvista  # takes a while

        self.size = float(np.linalg.norm(np.ptp(points, axis=0)))
        self._points = points
        pixels = [width, max(1, int(width * aspect(points)))]
        self.plotter: Any = pyvista.Plotter(off_screen=True, window_size=pixels)
        self.plotter.background_color = "white"
        self.plotter.enable_parallel_projection()

    def add(self, mesh: Any, **options: Any) -> None:
        """Add a mesh, shaded in the same way everywhere."""
        # colours that mean a number must stay what they are
        light = {"ambient": 0.6, "diffuse": 0.5} if "rgb" in options else {"ambient": 0.25}
        flat = {"smooth_shading": False, "show_scalar_bar": False}
        self.plotter.add_mesh(mesh, **{"diffuse": 0.8, **light, **flat, **options})

    def add_lines(self, mesh: Any, color: str = GRAY, width: float = 1.5) -> None:
        """Add the lines of a mesh without shading."""
        if mesh.n_points:
            self.plotter.add_mesh(mesh, color=color, line_width=width, lighting=False)

    def nearer(self, mesh: Any) -> Any:
        """A mesh moved a little to the camera, so that it covers the surface on which it lies."""
        return mesh.translate(2e-3 * self.size * _BACK, inplace=False)

    def picture(self) -> NDArray[np.uint8]:
        """The view as pixels, shape (height, width, 3)."""
        flat = self._points @ _PROJECTION
        low, high = flat.min(axis=0), flat.max(axis=0)
        middle = self._points.mean(axis=0)
        middle = middle + _PROJECTION @ (0.5 * (low + high) - middle @ _PROJECTION)
        camera = self.plotter.camera
        camera.position = tuple(middle + 4.0 * self.size * _BACK)
        camera.focal_point = tuple(middle)
        camera.up = tuple(_PROJECTION[:, 1])
        camera.parallel_scale = 0.53 * (high - low)[1]
        self.plotter.reset_camera_clipping_range()
        self.plotter.render()
        return np.asarray(self.plotter.screenshot(return_img=True))[..., :3]

    def close(self) -> None:
        """Free the memory."""
        self.plotter.close()


def aspect(points: Array) -> float:
    """Height divided by width of ``points`` (n, 3) in the view."""
    width, height = np.ptp(points @ _PROJECTION, axis=0)
    return float(height / width)


def feature_edges(grid: Any) -> Any:
    """Edges of a body where its faces meet at an angle."""
    return surface_of(grid).extract_feature_edges(
        feature_angle=40.0, boundary_edges=False, manifold_edges=False, non_manifold_edges=False
    )


def surface_of_cells(grid: Any, cells: Integers) -> tuple[Any, Integers, Integers]:
    """Surface of some cells of a grid, with the point and the cell of each of its own."""
    solid = grid.extract_cells(cells)
    surface = surface_of(solid)
    points = np.asarray(solid["vtkOriginalPointIds"])[np.asarray(surface["vtkOriginalPointIds"])]
    return surface, points, cells[np.asarray(surface["vtkOriginalCellIds"])]
