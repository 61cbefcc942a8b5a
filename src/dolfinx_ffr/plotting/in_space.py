# SPDX-License-Identifier: MIT
"""A mechanism in space, rendered without a screen into matplotlib axes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array
from ..mechanism import Joint, Line, Marker, Slider, Spring, Symbol
from .mechanism_view import VOID, MechanismView
from .rendering import Rendering, aspect, feature_edges, surface_of_cells
from .scene import Arm, DrawnBody, across
from .style import DARK, GRAY, LIGHT, STEEL

#: Position (3,) and axes (3, 3), as columns, at an instant
_Pose = Callable[[int], tuple[Array, Array]]


class MechanismInSpace(MechanismView):
    """A picture of a mechanism in space."""

    @staticmethod
    def aspect(points: Array) -> float:
        return aspect(points)

    def show(self, instant: int) -> None:
        super().show(instant)
        self._image.set_data(self._view.picture())

    def close(self) -> None:
        self._view.close()

    def _begin(self, points: Array) -> float:
        self._view = Rendering(points)
        return 0.014 * self._view.size

    def _end(self, labels: bool) -> None:
        look: dict[str, Any] = {"font_size": 26, "text_color": DARK, "always_visible": True}
        look |= {"shape_color": "white", "shape_opacity": 0.75, "show_points": False}
        for body in self.scene.bodies.values() if labels else ():
            middle = body.points(0, self.magnification).mean(axis=0)
            self._view.plotter.add_point_labels(middle[None], [body.name], **look)
        self._image = self.axes.imshow(self._view.picture(), interpolation="antialiased")
        self.moving = [self._image]

    def _add_moving(self, mesh: Any, update: Callable[[int], None], **options: Any) -> None:
        """Add a mesh that an update moves to an instant."""
        update(0)
        self._view.add(mesh, **options)
        self._updates.append(update)

    def _add_mesh(self, body: DrawnBody, mesh: Any) -> None:
        grid = mesh.grid()
        edges = feature_edges(grid)
        if edges.n_points:
            _, points_of_edges = cKDTree(grid.points).query(edges.points)

            def move_edges(instant: int) -> None:
                edges.points = body.points(instant, self.magnification)[points_of_edges]

            self._view.add_lines(edges, LIGHT)
            self._updates.append(move_edges)
        shown = np.flatnonzero(body.density >= VOID)
        if not len(shown):
            return
        surface, points, cells = surface_of_cells(grid, shown)

        def move_surface(instant: int) -> None:
            surface.points = body.points(instant, self.magnification)[points]
            values = body.cell_values(instant)[cells]
            surface.cell_data["rgb"] = self.colors.to_rgba(values, bytes=True)[:, :3]

        self._add_moving(surface, move_surface, scalars="rgb", rgb=True)

    def _add_bar(self, body: DrawnBody) -> None:
        import pyvista

        hub, *others = [self._pose((body.name, name)) for name in body.markers]
        for other in others:
            self._add_rod(hub, other, STEEL, 0.35)
        if not others:
            self._add_rigid(pyvista.Sphere(radius=self.unit), hub, STEEL)

    def _add_symbol(self, symbol: Symbol) -> None:
        import pyvista

        if isinstance(symbol, Line | Spring) and len(symbol.markers) == 2:
            color, radius = (GRAY, 0.12) if isinstance(symbol, Spring) else (DARK, 0.2)
            start, end = map(self._pose, symbol.markers)
            self._add_rod(start, end, color, radius)
        if isinstance(symbol, Slider):
            direction = np.zeros(3)
            direction[: len(symbol.direction)] = symbol.direction
            self._add_line(symbol.markers[1], direction, LIGHT, 0.15, self._view.size)
        marker = next((m for m in symbol.markers if isinstance(m, tuple)), symbol.markers[0])
        if symbol.sign == "pin":
            self._add_rigid(pyvista.Sphere(radius=0.6 * self.unit), self._pose(marker), DARK)
        elif symbol.sign == "square":
            cube = pyvista.Cube(x_length=self.unit, y_length=self.unit, z_length=self.unit)
            self._add_rigid(cube, self._pose(marker), DARK)

    def _add_axis(self, joint: Joint) -> None:
        """Draw the axis of a joint in the axes of its last marker."""
        axis = getattr(joint, "axis", getattr(joint, "normal", None))
        if isinstance(axis, tuple):
            self._add_line(joint.markers[-1], axis, DARK, 0.22, 2.0 * self.unit)

    def _add_arm(self, arm: Arm) -> None:
        import pyvista

        self._view.add_lines(pyvista.lines_from_points(arm.ring), LIGHT, 3.0)
        self._add_rod(lambda i: (arm.center, np.eye(3)), self._pose(arm.marker), GRAY, 0.4)

    def _pose(self, marker: Marker) -> _Pose:
        scene = self.scene
        return lambda i: (scene.position(marker, i, self.magnification), scene.axes(marker, i))

    def _add_rigid(self, mesh: Any, pose: _Pose, color: str) -> None:
        """Let a mesh move as a rigid body."""
        reference = np.array(mesh.points, dtype=np.float64)

        def move(instant: int) -> None:
            position, axes = pose(instant)
            mesh.points = position + reference @ axes.T

        self._add_moving(mesh, move, color=color)

    def _add_rod(self, start: _Pose, end: _Pose, color: str, radius: float) -> None:
        """Draw a rod, with a radius in units of a pin, between two points that move."""
        import pyvista

        size: dict[str, Any] = {"radius": radius * self.unit, "height": 1.0}
        rod = pyvista.Cylinder(center=(0.5, 0.0, 0.0), direction=(1.0, 0.0, 0.0), **size)

        def pose(instant: int) -> tuple[Array, Array]:
            origin, _ = start(instant)
            along = end(instant)[0] - origin
            direction = along / (float(np.linalg.norm(along)) or 1e-300)
            normal = across(direction)
            axes = np.column_stack([along, normal, np.cross(direction, normal)])
            return origin, axes

        self._add_rigid(rod, pose, color)

    def _add_line(
        self, marker: Marker, direction: Any, color: str, radius: float, reach: float
    ) -> None:
        """Draw a line in the axes of a marker, to a reach [m] on both sides."""
        unit, pose = np.asarray(direction) / np.linalg.norm(direction), self._pose(marker)

        def end(sign: float) -> _Pose:
            def point(instant: int) -> tuple[Array, Array]:
                position, axes = pose(instant)
                return position + sign * reach * (axes @ unit), axes

            return point

        self._add_rod(end(-1.0), end(1.0), color, radius)
