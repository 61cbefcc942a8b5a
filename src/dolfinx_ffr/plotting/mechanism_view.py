# SPDX-License-Identifier: MIT
"""A mechanism in the plane or in space, drawn at an instant: bodies, cranks, joints, supports.

Bodies are drawn by a canvas, and all signs by matplotlib at projected points, so that joints look
alike in the plane and in space.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from ..arrays import Array
from ..mechanism import Ground, Joint, Line, Marker, Slider, Spring, Symbol
from .canvas import canvas_class
from .scene import Arm, DrawnBody, Scene
from .style import DARK, GRAY, LABEL, LIGHT, PICTURES, STEEL


class MechanismView:
    """Artists of a mechanism, which `show` moves to an instant.

    The ``colors`` are those of the `DrawnBody.cell_values`; ``labels`` writes the names of bodies
    and joints.
    """

    def __init__(
        self,
        axes: Axes,
        scene: Scene,
        magnification: float,
        colors: ScalarMappable,
        *,
        labels: bool = False,
    ) -> None:
        self.axes, self.scene, self.magnification = axes, scene, magnification
        self.colors = colors
        self._updates: list[Callable[[int], None]] = []
        self._texts: list[tuple[Array, Array]] = []  # middles and sizes [m]
        canvas = canvas_class(scene.dimension)
        visible = scene.visible_points(magnification, canvas.project)
        self.canvas = canvas(axes, visible, PICTURES.margin)
        self.unit = PICTURES.pin * self.canvas.extent  #: Size of a pin [m]
        connections = (*scene.mechanism.joints, *scene.mechanism.forces)
        for symbol in (symbol for connection in connections for symbol in connection.symbols):
            self._add_symbol(symbol)
        for joint in scene.mechanism.joints:
            if scene.dimension == 3 and joint.symbols:
                self._add_axis(joint)
        for arm in scene.arms.values():
            self._add_arm(arm)
        for body in scene.bodies.values():
            if body.mesh is None:
                self._add_bar(body)
            else:
                self._add_mesh(body, body.mesh)
        self._add_signs()
        if labels:
            self._add_labels()

    def show(self, instant: int) -> None:
        """Move everything to an instant."""
        for update in self._updates:
            update(instant)
        self.canvas.refresh()

    def _place(self, marker: Marker, instant: int) -> Array:
        """Where a marker is drawn, in the plane of the picture, shape (2,) [m]."""
        position = self.scene.position(marker, instant, self.magnification)
        return self.canvas.project(position)

    def _points(self, body: DrawnBody, instant: int) -> Array:
        """Where the points of a body are drawn, in the plane of the picture, shape (n, 2) [m]."""
        return self.canvas.project(body.points(instant, self.magnification))

    def _direction(self, direction: Sequence[float], marker: Marker, instant: int) -> Array:
        """A direction in the axes of a marker, of length one in the picture, shape (2,)."""
        in_space = self.scene.axes(marker, instant)[:, : len(direction)] @ np.array(direction)
        return _unit(self.canvas.project(in_space))

    def _add(self, artist: Artist, update: Callable[[int], None] | None = None) -> None:
        """Add an artist, with an update that moves it to an instant."""
        self.axes.add_artist(artist)
        if update is not None:
            self._updates.append(update)

    def _add_symbol(self, symbol: Symbol) -> None:
        if isinstance(symbol, Slider):
            self._add_slider(symbol)
        elif isinstance(symbol, Line):
            self._add_link(symbol)
        elif isinstance(symbol, Spring):
            self._add_link(symbol, waves=6)
        else:
            for marker in symbol.markers:
                if isinstance(marker, Ground):
                    self._add_support(self._place(marker, 0))

    def _add_axis(self, joint: Joint) -> None:
        """Draw the axis of a joint in space, in the axes of its last marker, as a line."""
        axis, marker = getattr(joint, "axis", getattr(joint, "normal", None)), joint.markers[-1]
        if not isinstance(axis, tuple):
            return
        line = Line2D([], [], color=DARK, linewidth=2.0, linestyle=(0, (4, 1, 1, 1)), zorder=1.9)

        def move(instant: int) -> None:
            direction = np.array(axis) / np.linalg.norm(axis)
            half = (
                3.0 * self.unit * self.canvas.project(self.scene.axes(marker, instant) @ direction)
            )
            place = self._place(marker, instant)
            line.set_data(*np.array([place - half, place + half]).T)

        self._add(line, move)

    def _add_mesh(self, body: DrawnBody, mesh: Any) -> None:
        """Draw the cells that are not void, the outline of the whole body, and its interfaces."""
        move_outline = self.canvas.add_outline(mesh, LIGHT)
        move_cells = self.canvas.add_cells(mesh, body.density >= PICTURES.void)
        ends = dict.fromkeys(mesh.interfaces, STEEL)
        move_interfaces = self.canvas.add_interfaces(mesh, ends, 3.0)

        def move(instant: int) -> None:
            points = body.points(instant, self.magnification)
            move_outline(points)
            move_cells(points, self.colors.to_rgba(body.cell_values(instant)))
            move_interfaces(points)

        self._updates.append(move)

    def _add_bar(self, body: DrawnBody) -> None:
        """Draw a body without a mesh as a bar through its markers."""
        bar = Line2D([], [], color=STEEL, linewidth=7.0, solid_capstyle="round", zorder=0.9)

        def move(instant: int) -> None:
            points = self._points(body, instant)
            closed = np.vstack([points, points[:1]]) if len(points) > 2 else points
            bar.set_data(*closed.T)

        self._add(bar, move)

    def _add_arm(self, arm: Arm) -> None:
        ring, center = self.canvas.project(arm.ring), self.canvas.project(arm.center)
        self._add(Line2D(*ring.T, color=LIGHT, linewidth=1.0, linestyle="--", zorder=0.1))
        self._add_support(center)
        bar = Line2D([], [], color=STEEL, linewidth=9.0, solid_capstyle="round", zorder=0.8)

        def move(instant: int) -> None:
            bar.set_data(*np.array([center, self._place(arm.marker, instant)]).T)

        self._add(bar, move)

    def _add_support(self, top: Array) -> None:
        """Draw the triangle that stands for the ground, hatched below."""
        corners = top + self.unit * np.array([[0.0, 0.0], [-1.1, -1.9], [1.1, -1.9]])
        self._add(Polygon(corners, facecolor="#eef1f4", edgecolor=DARK, linewidth=1.2, zorder=0.4))
        self._add_hatching(*(top + self.unit * np.array([[-1.7, -1.9], [1.7, -1.9]])))

    def _add_hatching(self, start: Array, end: Array) -> None:
        """Draw a line of the ground, which lies to the right of the way from start to end."""
        length = float(np.linalg.norm(end - start))
        along = _unit(end - start)
        count = max(2, round(length / (0.55 * self.unit)))
        tops = start + (np.arange(count)[:, None] + 0.8) / count * (end - start)
        strokes = np.stack([tops, tops - 0.55 * self.unit * (_normal(along) + along)], axis=1)
        self._add(LineCollection(strokes, colors=GRAY, linewidths=0.8, zorder=0.3))
        self._add(Line2D(*np.array([start, end]).T, color=DARK, linewidth=1.2, zorder=0.4))

    def _add_link(self, symbol: Symbol, waves: int = 0) -> None:
        """Draw a line between two markers, with waves if it is a spring."""
        first, last = symbol.markers
        positions = np.r_[0.0, np.linspace(0.2, 0.8, 2 * waves), 1.0]  # shares of the length
        offsets = np.r_[0.0, 0.6 * self.unit * (-1.0) ** np.arange(2 * waves), 0.0]
        line = Line2D([], [], color=DARK, linewidth=1.2 if waves else 2.4, zorder=1.4)

        def move(instant: int) -> None:
            start = self._place(first, instant)
            along = self._place(last, instant) - start
            points = np.outer(along, positions) + np.outer(_normal(_unit(along)), offsets)
            line.set_data(*(start[:, None] + points))

        self._add(line, move)

    def _add_slider(self, slider: Slider) -> None:
        """Draw a block that slides along a line, and the guide if the line is on the ground."""
        point, line = slider.markers
        half = np.array([2.6, 1.25]) * self.unit
        corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        block = Polygon(corners, facecolor="#b6bec8", edgecolor=DARK, linewidth=1.2, zorder=0.5)

        def move(instant: int) -> None:
            along = self._direction(slider.direction, line, instant)
            block.set_xy(self._place(point, instant) + corners @ np.array([along, _normal(along)]))

        self._add(block, move)
        if not isinstance(line, Ground):
            return
        along = self._direction(slider.direction, line, 0)
        if along[0] < -1e-9:
            along = -along  # the ground lies below
        origin = self._place(line, 0)
        instants = range(len(self.scene.steps))
        distances = [(self._place(point, i) - origin) @ along for i in instants]
        start = origin - half[1] * _normal(along)
        low, high = min(distances) - 1.15 * half[0], max(distances) + 1.15 * half[0]
        self._add_hatching(start + low * along, start + high * along)

    def _add_signs(self) -> None:
        """Draw pins and squares of joints, and point masses as discs."""
        mechanism = self.scene.mechanism
        symbols = [symbol for joint in mechanism.joints for symbol in joint.symbols]
        on_sliders = [symbol.markers[0] for symbol in symbols if isinstance(symbol, Slider)]
        for mass in mechanism.point_masses:
            if mass.marker not in on_sliders:
                self._add_sign("o", 15.0, STEEL, (mass.marker,))
        for arm in self.scene.arms.values():
            self._add_sign("o", 8.5, "white", (Ground(tuple(arm.center)),))
        for symbol in symbols:
            if symbol.sign == "pin":
                self._add_sign("o", 8.5, "white", symbol.markers)
            elif symbol.sign == "square":
                self._add_sign("s", 8.5, GRAY, symbol.markers)

    def _add_sign(self, shape: str, size: float, color: str, markers: Sequence[Marker]) -> None:
        look: dict[str, Any] = {"marker": shape, "ms": size, "mfc": color, "mec": DARK, "mew": 1.4}
        sign = Line2D([], [], linestyle="none", zorder=2.0, **look)

        def move(instant: int) -> None:
            x, y = self._place(_marker_on_body(markers), instant)
            sign.set_data([x], [y])

        self._add(sign, move)

    def _add_labels(self) -> None:
        """Write names beside bodies and joints, clear of all bodies, at the first instant."""
        shapes = {name: self._points(body, 0) for name, body in self.scene.bodies.items()}
        points = np.concatenate(list(shapes.values()))
        for name, shape in shapes.items():
            middle = 0.5 * (shape.min(axis=0) + shape.max(axis=0))
            across = _normal(np.linalg.svd(shape - shape.mean(axis=0), full_matrices=False)[2][0])
            self._write(name, middle, across if across[1] >= 0.0 else -across, shape)
        for i, joint in enumerate(self.scene.mechanism.joints):
            name = getattr(joint, "name", "")
            if i in self.scene.arms:
                name = name or self.scene.arms[i].marker.name
            if not (joint.symbols and name):
                continue
            place = self._place(_marker_on_body(joint.markers), 0)
            slides = any(isinstance(symbol, Slider) for symbol in joint.symbols)
            if slides or any(isinstance(marker, Ground) for marker in joint.markers):
                below = place - [0.0, 1.7 * self.unit]  # the block or the support
                self._write(name, below, np.array([0.0, -1.0]), place[None])
            else:
                self._write(name, place, np.array([0.0, 1.0]), points)

    def _write(self, text: str, start: Array, direction: Array, points: Array) -> None:
        """Write a text in a direction from a place, beyond the points and texts that lie there."""
        offsets = points - start
        beside = np.abs(offsets @ _normal(direction)) < 1.5 * self.unit
        reach = float(np.max((offsets @ direction)[beside], initial=0.0))
        position = start + (reach + 1.6 * self.unit) * direction

        side = 0.0 if abs(direction[0]) < 0.5 else float(np.sign(direction[0]))
        size = self.unit * np.array([PICTURES.letter * len(text), PICTURES.line])
        middle = position + np.array([0.5 * side * size[0], 0.0])
        # line by line away from the points, until no other text is overlapped
        up = np.array([0.0, 1.0 if direction[1] >= 0.0 else -1.0])
        while any(
            np.all(np.abs(middle - other_middle) < 0.5 * (size + other_size))
            for other_middle, other_size in self._texts
        ):
            position, middle = position + size[1] * up, middle + size[1] * up
        self._texts.append((middle, size))

        look: dict[str, Any] = {"va": "center", "bbox": {**LABEL, "alpha": 0.8}, "zorder": 3.0}
        look["ha"] = {0.0: "center", 1.0: "left", -1.0: "right"}[side]
        self.axes.text(*position, text, **look)


def _marker_on_body(markers: Sequence[Marker]) -> Marker:
    """The first marker that is on a body, or else the first."""
    return next((marker for marker in markers if isinstance(marker, tuple)), markers[0])


def _unit(vector: Array) -> Array:
    """A vector of length one."""
    return vector / max(float(np.linalg.norm(vector)), 1e-300)


def _normal(vector: Array) -> Array:
    """A vector (2,) turned to the left by a right angle."""
    return np.array([-vector[1], vector[0]])
