# SPDX-License-Identifier: MIT
"""A mechanism in space as a picture in matplotlib axes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ..arrays import Array
from ..fem import surface_of
from ..mechanism import Joint, Line, Marker, Slider, Spring, Symbol
from .mechanism_view import VOID, MechanismView
from .rendering import Rendering, feature_edges
from .scene import Arm, DrawnBody, across
from .style import DARK, GRAY, LIGHT, STEEL


class MechanismInSpace(MechanismView):
    """A picture of a mechanism in space."""

    def _begin(self, seen: Array) -> float:
        extent, dpi = self.axes.get_window_extent(), self.axes.figure.dpi
        self._view = Rendering(extent.width / dpi, extent.height / dpi, seen)
        return 0.014 * float(np.linalg.norm(np.ptp(seen, axis=0)))

    def _end(self, labels: bool) -> None:
        self._view.look()
        look: dict[str, Any] = {"font_size": 26, "text_color": DARK, "always_visible": True}
        look |= {"shape_color": "white", "shape_opacity": 0.75, "show_points": False}
        for body in self.scene.bodies.values() if labels else ():
            middle = body.points(0, self.magnification).mean(axis=0)
            self._view.plotter.add_point_labels(middle[None], [body.name], **look)
        empty = np.full((2, 2, 3), 255, dtype=np.uint8)
        self._image = self.axes.imshow(empty, aspect="auto", interpolation="antialiased")
        self.moving = [self._image]

    def show(self, instant: int) -> None:
        super().show(instant)
        picture = self._view.picture()
        self._image.set_data(picture)
        height, width = picture.shape[:2]
        self._image.set_extent((0.0, width, 0.0, height))
        self.axes.set_xlim(0.0, width)
        self.axes.set_ylim(0.0, height)

    def close(self) -> None:
        self._view.close()

    def _add_moving(self, mesh: Any, update: Callable[[int], None], **how: Any) -> None:
        """Add a mesh that an update moves to an instant."""
        update(0)
        self._view.add(mesh, **how)
        self._updates.append(update)

    def _add_mesh(self, body: DrawnBody, mesh: Any) -> None:
        grid = mesh.grid()
        edges = feature_edges(grid)
        of_edges = cKDTree(grid.points).query(edges.points)[1] if edges.n_points else []

        def move_edges(instant: int) -> None:
            edges.points = body.points(instant, self.magnification)[of_edges]

        if edges.n_points:
            flat = {"color": LIGHT, "line_width": 1.5, "lighting": False}
            self._add_moving(edges, move_edges, **flat)
        shown = np.flatnonzero(body.density >= VOID)
        if not len(shown):
            return
        cells = grid.extract_cells(shown)
        surface = surface_of(cells)
        of = np.asarray(cells["vtkOriginalPointIds"])[np.asarray(surface["vtkOriginalPointIds"])]
        cell = shown[np.asarray(surface["vtkOriginalCellIds"])]

        def move_surface(instant: int) -> None:
            surface.points = body.points(instant, self.magnification)[of]
            values = body.shades(instant)[cell]
            surface.cell_data["rgb"] = self._colors.to_rgba(values, bytes=True)[:, :3]

        self._add_moving(surface, move_surface, scalars="rgb", rgb=True)

    def _add_bar(self, body: DrawnBody) -> None:
        import pyvista

        poses = [self._pose((body.name, name)) for name in body.markers]
        for other in poses[1:]:
            self._add_rod(lambda i, b=other: (poses[0](i)[0], b(i)[0]), STEEL, 0.35)  # type: ignore[misc]
        if len(poses) == 1:
            ball = pyvista.Sphere(radius=self.unit)
            self._follow(ball, lambda i: (poses[0](i)[0], np.eye(3)), STEEL)

    def _follow(self, mesh: Any, pose: Callable[[int], tuple[Array, Array]], color: str) -> None:
        """Let a mesh move as a rigid body: its position, and its axes as columns."""
        still = np.array(mesh.points, dtype=np.float64)

        def move(instant: int) -> None:
            position, axes = pose(instant)
            mesh.points = position + still @ axes.T

        self._add_moving(mesh, move, color=color)

    def _add_rod(
        self, ends: Callable[[int], tuple[Array, Array]], color: str, radius: float
    ) -> None:
        """Draw a rod, with a radius in units of a pin, between two points that move."""
        import pyvista

        still = pyvista.Cylinder(
            center=(0.5, 0.0, 0.0), direction=(1.0, 0.0, 0.0), radius=radius * self.unit, height=1.0
        )

        def pose(instant: int) -> tuple[Array, Array]:
            first, last = ends(instant)
            along = last - first
            n = along / (float(np.linalg.norm(along)) or 1e-300)
            e = across(n)
            return first, np.column_stack([along, e, np.cross(n, e)])

        self._follow(still, pose, color)

    def _pose(self, marker: Marker) -> Callable[[int], tuple[Array, Array]]:
        """Position and axes of a marker at an instant."""
        scene = self.scene
        return lambda i: (scene.position(marker, i, self.magnification), scene.axes(marker, i))

    def _add_symbol(self, symbol: Symbol) -> None:
        import pyvista

        if isinstance(symbol, Line | Spring) and len(symbol.markers) == 2:
            a, b = (self._pose(marker) for marker in symbol.markers)
            color, radius = (GRAY, 0.12) if isinstance(symbol, Spring) else (DARK, 0.2)
            self._add_rod(lambda i: (a(i)[0], b(i)[0]), color, radius)
        if isinstance(symbol, Slider):
            direction = np.zeros(3)
            direction[: len(symbol.direction)] = symbol.direction
            self._add_along(symbol.markers[1], direction, LIGHT, 0.15)
        first = next((m for m in symbol.markers if isinstance(m, tuple)), symbol.markers[0])
        if symbol.sign == "pin":
            self._follow(pyvista.Sphere(radius=0.6 * self.unit), self._pose(first), DARK)
        elif symbol.sign == "square":
            cube = pyvista.Cube(x_length=self.unit, y_length=self.unit, z_length=self.unit)
            self._follow(cube, self._pose(first), DARK)

    def _add_along(
        self, marker: Marker, direction: Any, color: str, radius: float, reach: float | None = None
    ) -> None:
        """Draw a line in the axes of a marker, to a reach [m] or as far as the picture does."""
        n, pose = np.asarray(direction) / np.linalg.norm(direction), self._pose(marker)

        def ends(instant: int) -> tuple[Array, Array]:
            position, axes = pose(instant)
            along = axes @ n
            low, high = (-reach, reach) if reach else self._view.span(position, along)
            return position + low * along, position + high * along

        self._add_rod(ends, color, radius)

    def _add_axis(self, joint: Joint) -> None:
        """Draw the axis of a joint, which the last marker holds."""
        axis = getattr(joint, "axis", getattr(joint, "normal", None))
        if isinstance(axis, tuple):
            self._add_along(joint.markers[-1], axis, DARK, 0.22, 2.0 * self.unit)

    def _add_arm(self, arm: Arm) -> None:
        import pyvista

        line, pose = pyvista.lines_from_points(arm.ring), self._pose(arm.marker)
        self._view.plotter.add_mesh(line, color=LIGHT, line_width=3.0, lighting=False)
        self._add_rod(lambda i: (arm.center, pose(i)[0]), GRAY, 0.4)
