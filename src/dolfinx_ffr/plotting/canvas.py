# SPDX-License-Identifier: MIT
"""Axes in which bodies are drawn: in the plane by matplotlib, in space as pictures by PyVista.

Both have the same methods. Whatever else a picture shows is drawn into the axes by matplotlib, at
points that `project` takes to the plane of the picture.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from ..arrays import Array, Mask
from ..fem import surface_of
from .drawn_mesh import DrawnMesh

#: Color of a solid without values
_MATERIAL = "#b9c0c8"
#: Light in which colours that mean something stay what they are
_FAITHFUL = {"ambient": 0.6, "diffuse": 0.5}
#: Direction to the camera: in front, on the right and above
_BACK = np.array([0.45, -1.0, 0.5]) / np.linalg.norm([0.45, -1.0, 0.5])
_RIGHT = np.cross([0.0, 0.0, 1.0], _BACK) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], _BACK))
#: Directions to the right and upwards, shape (3, 2)
_PROJECTION = np.column_stack([_RIGHT, np.cross(_BACK, _RIGHT)])

#: Moves what was drawn to new points of the mesh, shape (points, d)
Move = Callable[[Array], None]
#: Moves cells to new points, and gives them new colours, shape (cells, 4) or (points, 4)
MoveAndColor = Callable[[Array, Array], None]


class PlaneCanvas:
    """Axes that show all of some points (n, 2) [m], with a margin relative to their extent."""

    def __init__(self, axes: Axes, points: Array, margin: float = 0.0) -> None:
        self.axes = axes
        low, high = points.min(axis=0), points.max(axis=0)
        self.extent = float(np.max(high - low))  #: [m]
        self.low, self.high = low - margin * self.extent, high + margin * self.extent
        axes.set(xlim=(self.low[0], self.high[0]), ylim=(self.low[1], self.high[1]), aspect="equal")
        axes.set_axis_off()

    @staticmethod
    def project(points: Array) -> Array:
        """Points or directions (..., d) in the plane of the picture, shape (..., 2)."""
        return points

    def add_outline(self, mesh: DrawnMesh, color: str) -> Move:
        """Draw the boundary of a body as a line."""
        return self._add_lines(mesh, mesh.outline, color=color, linewidths=1.0, zorder=0.5)

    def add_cells(self, mesh: DrawnMesh, shown: Mask, *, at_points: bool = False) -> MoveAndColor:
        """Draw some cells of a body in colours of the cells or of the points."""
        is_shown = shown[mesh.parents]
        pieces, parents = mesh.pieces[is_shown], mesh.parents[is_shown]
        artist = PolyCollection([], edgecolors="face", linewidths=0.5, zorder=1.0)
        self.axes.add_collection(artist, autolim=False)

        def move(points: Array, colors: Array) -> None:
            artist.set_verts(points[pieces])
            artist.set_facecolor(colors[pieces].mean(axis=1) if at_points else colors[parents])

        return move

    def add_interfaces(self, mesh: DrawnMesh, colors: Mapping[str, str], width: float) -> Move:
        """Draw the interfaces in colours, by name, as lines of a width [points]."""
        look: dict[str, Any] = {"linewidths": width, "zorder": 1.5}
        moves = [
            self._add_lines(mesh, mesh.interfaces[name], color=color, **look)
            for name, color in colors.items()
        ]

        def move(points: Array) -> None:
            for move_lines in moves:
                move_lines(points)

        return move

    def _add_lines(self, mesh: DrawnMesh, lines: Any, **look: Any) -> Move:
        artist = LineCollection(mesh.points[lines], clip_on=False, **look)
        self.axes.add_collection(artist, autolim=False)
        return lambda points: artist.set_segments(points[lines])

    def refresh(self) -> None:
        """Show what was moved."""

    def close(self) -> None:
        """Free the memory."""


class SpaceCanvas(PlaneCanvas):
    """Axes with a view of solids from the front, the right and above, for points (n, 2) in it."""

    def __init__(self, axes: Axes, points: Array, margin: float = 0.0) -> None:
        import pyvista  # takes a while

        super().__init__(axes, points, margin)
        width, height = self.high - self.low
        # axes become somewhat wider by their layout, and edges smooth by a finer picture
        pixels = 2.0 * float(axes.bbox.width)
        size = [int(pixels), max(1, int(pixels * height / width))]
        self.plotter: Any = pyvista.Plotter(off_screen=True, window_size=size)
        self.plotter.enable_parallel_projection()
        place: dict[str, Any] = {"extent": (self.low[0], self.high[0], self.low[1], self.high[1])}
        blank = np.zeros((2, 2, 4), dtype=np.uint8)
        self._image = axes.imshow(blank, interpolation="antialiased", zorder=1.0, **place)

    @staticmethod
    def project(points: Array) -> Array:
        return np.asarray(points @ _PROJECTION)

    def add_outline(self, mesh: Any, color: str) -> Move:
        """Draw the edges of a body where its faces meet at an angle."""
        edges = surface_of(mesh.grid()).extract_feature_edges(
            feature_angle=40.0, boundary_edges=False, manifold_edges=False, non_manifold_edges=False
        )
        if not edges.n_points:
            return lambda points: None
        self.plotter.add_mesh(edges, color=color, line_width=1.5, lighting=False)
        return _mover(edges)

    def add_cells(self, mesh: Any, shown: Mask, *, at_points: bool = False) -> MoveAndColor:
        """Draw the surface of some cells in colours of the cells or of the points."""
        if not shown.any():
            return lambda points, colors: None
        # the surface keeps the numbers of points and cells of the grid from which it comes
        cells = np.flatnonzero(shown)
        solid = mesh.grid().extract_cells(cells)
        surface = surface_of(solid)
        of_points = np.asarray(solid["vtkOriginalPointIds"])[surface["vtkOriginalPointIds"]]
        of_cells = cells[np.asarray(surface["vtkOriginalCellIds"])]
        data = surface.point_data if at_points else surface.cell_data
        number = of_points if at_points else of_cells

        def move(points: Array, colors: Array) -> None:
            surface.points = points[of_points]
            data["rgb"] = np.round(255.0 * colors[number, :3]).astype(np.uint8)

        move(mesh.points, np.zeros((len(mesh.points) if at_points else len(shown), 4)))
        self._add(surface, scalars="rgb", rgb=True, **_FAITHFUL)
        return move

    def add_surface(self, surface: Any) -> None:
        """Draw a surface in the colour of material."""
        self._add(surface, color=_MATERIAL, ambient=0.25, diffuse=0.8)

    def add_interfaces(self, mesh: Any, colors: Mapping[str, str], width: float) -> Move:
        """Draw the interfaces in colours, by name."""
        surface = surface_of(mesh.grid())
        number = np.asarray(surface["vtkOriginalPointIds"])
        # a little nearer, so that they cover the surface on which they lie
        nearer = 2e-3 * self.extent * _BACK
        moves = []
        for name, color in colors.items():
            on_interface = np.flatnonzero(mesh.interfaces[name][number])
            faces = surface.extract_points(on_interface, adjacent_cells=False)
            if faces.n_cells:
                faces.point_data["vtkOriginalPointIds"] = number[faces["vtkOriginalPointIds"]]
                self._add(faces, color=color, **_FAITHFUL)
                moves.append(_mover(faces, nearer))

        def move(points: Array) -> None:
            for move_faces in moves:
                move_faces(points)

        move(mesh.points)
        return move

    def refresh(self) -> None:
        """Render the picture."""
        middle = 0.5 * (self.low + self.high) @ _PROJECTION.T
        camera = self.plotter.camera
        camera.focal_point = tuple(middle)
        camera.position = tuple(middle + 4.0 * self.extent * _BACK)
        camera.up = tuple(_PROJECTION[:, 1])
        camera.parallel_scale = 0.5 * (self.high - self.low)[1]
        self.plotter.reset_camera_clipping_range()
        self.plotter.render()
        self._image.set_data(self.plotter.screenshot(return_img=True, transparent_background=True))

    def close(self) -> None:
        self.plotter.close()

    def _add(self, mesh: Any, **look: Any) -> None:
        self.plotter.add_mesh(mesh, smooth_shading=False, show_scalar_bar=False, **look)


def canvas_class(dimension: int) -> type[PlaneCanvas]:
    """The canvas for bodies in the plane or in space."""
    return PlaneCanvas if dimension == 2 else SpaceCanvas


def _mover(polygons: Any, offset: Array | float = 0.0) -> Move:
    """A function that moves polygons to new points, plus an offset."""
    number = np.asarray(polygons["vtkOriginalPointIds"])

    def move(points: Array) -> None:
        polygons.points = points[number] + offset

    return move
