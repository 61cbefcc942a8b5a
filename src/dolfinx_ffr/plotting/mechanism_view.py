# SPDX-License-Identifier: MIT
"""A mechanism in the plane in matplotlib axes: bodies, cranks, joints, supports."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from ..arrays import Array
from ..mechanism import Ground, Joint, Line, Slider, Spring, Symbol
from .scene import Arm, DrawnBody, Scene
from .style import DARK, GRAY, LABEL, LIGHT, STEEL

#: Cells of less density are not drawn
VOID = 0.3
#: Size of a pin, and margin around the mechanism, relative to the extent of what is drawn
_PIN, _MARGIN = 0.018, 0.06


class MechanismView:
    """Artists of a mechanism, which `show` moves to an instant.

    The ``colors`` are those of the `DrawnBody.cell_values`; ``labels`` writes the names of bodies
    and joints. `MechanismInSpace` draws the same things by PyVista.
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
        self.moving: list[Artist] = []  #: Artists that `show` changes, from back to front
        self._updates: list[Callable[[int], None]] = []
        axes.set_axis_off()
        self.unit = self._begin(scene.visible_points(magnification))  #: Size of a pin [m]
        for i, joint in enumerate(scene.mechanism.joints):
            for symbol in joint.symbols:
                self._add_symbol(symbol)
            self._add_axis(joint)
            if i in scene.arms:
                self._add_arm(scene.arms[i])
        for force in scene.mechanism.forces:
            for symbol in force.symbols:
                self._add_symbol(symbol)
        for body in scene.bodies.values():
            if body.mesh is None:
                self._add_bar(body)
            else:
                self._add_mesh(body, body.mesh)
        self._end(labels)
        self.moving.sort(key=lambda artist: artist.get_zorder())

    @staticmethod
    def aspect(points: Array) -> float:
        """Height of the axes divided by their width, where all ``points`` are shown."""
        extent = np.ptp(points, axis=0)
        width, height = extent + 2.0 * _MARGIN * np.max(extent)
        return float(height / width)

    def show(self, instant: int) -> None:
        """Move everything to an instant."""
        for update in self._updates:
            update(instant)

    def close(self) -> None:
        """Nothing is to be freed."""

    def _begin(self, points: Array) -> float:
        """Show all points (n, d) [m] in the axes; returns the size of a pin [m]."""
        low, high = points.min(axis=0), points.max(axis=0)
        extent = float(np.max(high - low))
        low, high = low - _MARGIN * extent, high + _MARGIN * extent
        self.axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        return _PIN * extent

    def _end(self, labels: bool) -> None:
        self._add_pins()
        if labels:
            self._add_labels()

    def _add(self, artist: Artist, update: Callable[[int], None] | None = None) -> None:
        """Add an artist; one with an update is drawn anew at every instant."""
        self.axes.add_artist(artist)
        if update is not None:
            self.moving.append(artist)
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
                    self._add_support(self.scene.position(marker, 0))

    def _add_axis(self, joint: Joint) -> None:
        """Nothing: the axis points out of the picture."""

    def _add_mesh(self, body: DrawnBody, mesh: Any) -> None:
        """Draw the cells that are not void, and the outline of the whole body."""
        shown = body.density[mesh.parents] >= VOID
        pieces, parents = mesh.pieces[shown], mesh.parents[shown]
        rigid = np.concatenate([mesh.outline[:0], *mesh.interfaces.values()])
        colors: dict[str, Any] = {"cmap": self.colors.cmap, "norm": self.colors.norm}
        look: dict[str, Any] = {"edgecolors": "face", "linewidths": 0.5, "zorder": 5}
        outline = LineCollection([], colors=LIGHT, linewidths=1.0, zorder=4)
        cells = PolyCollection([], **colors, **look)
        ends = LineCollection([], colors=STEEL, linewidths=3.0, capstyle="projecting", zorder=5.5)

        def move(instant: int) -> None:
            points = body.points(instant, self.magnification)
            outline.set_segments(points[mesh.outline])
            cells.set_verts(points[pieces])
            cells.set_array(body.cell_values(instant)[parents])
            ends.set_segments(points[rigid])

        self._add(outline, move)
        self._add(cells, lambda instant: None)  # moved with the outline
        self._add(ends, lambda instant: None)

    def _add_bar(self, body: DrawnBody) -> None:
        """Draw a body without a mesh as a bar through its markers."""
        bar = Line2D([], [], color=STEEL, linewidth=7.0, solid_capstyle="round", zorder=4)

        def move(instant: int) -> None:
            points = body.points(instant, self.magnification)
            closed = np.vstack([points, points[:1]]) if len(points) > 2 else points
            bar.set_data(*closed.T)

        self._add(bar, move)

    def _add_arm(self, arm: Arm) -> None:
        self._add(Line2D(*arm.ring.T, color=LIGHT, linewidth=1.0, linestyle="--", zorder=1))
        self._add_support(arm.center)
        bar = Line2D([], [], color=STEEL, linewidth=9.0, solid_capstyle="round", zorder=3)

        def move(instant: int) -> None:
            bar.set_data(*np.array([arm.center, self.scene.position(arm.marker, instant)]).T)

        self._add(bar, move)

    def _add_support(self, top: Array) -> None:
        """Draw the triangle that stands for the ground, hatched below."""
        corners = top + self.unit * np.array([[0.0, 0.0], [-1.1, -1.9], [1.1, -1.9]])
        self._add(Polygon(corners, facecolor="#eef1f4", edgecolor=DARK, linewidth=1.2, zorder=2))
        self._add_hatching(*(top + self.unit * np.array([[-1.7, -1.9], [1.7, -1.9]])))

    def _add_hatching(self, start: Array, end: Array) -> None:
        """Draw a line of the ground, which lies to the right of the way from start to end."""
        length = float(np.linalg.norm(end - start))
        along = (end - start) / length
        count = max(2, round(length / (0.55 * self.unit)))
        tops = start + (np.arange(count)[:, None] + 0.8) / count * (end - start)
        down = np.array([along[1], -along[0]])
        strokes = np.stack([tops, tops + 0.55 * self.unit * (down - along)], axis=1)
        self._add(LineCollection(strokes, colors=GRAY, linewidths=0.8, zorder=1.5))
        self._add(Line2D(*np.array([start, end]).T, color=DARK, linewidth=1.2, zorder=2))

    def _add_link(self, symbol: Symbol, waves: int = 0) -> None:
        """Draw a line between two markers, with waves if it is a spring."""
        first, last = symbol.markers
        positions = np.r_[0.0, np.linspace(0.2, 0.8, 2 * waves), 1.0]  # shares of the length
        offsets = np.r_[0.0, 0.6 * self.unit * (-1.0) ** np.arange(2 * waves), 0.0]
        line = Line2D([], [], color=DARK, linewidth=1.2 if waves else 2.4, zorder=5)

        def move(instant: int) -> None:
            start = self.scene.position(first, instant, self.magnification)
            along = self.scene.position(last, instant, self.magnification) - start
            points = np.outer(along, positions) + np.outer(_normal(_unit(along)), offsets)
            line.set_data(*(start[:, None] + points))

        self._add(line, move)

    def _add_slider(self, slider: Slider) -> None:
        """Draw the block and, where the line stands still, the guide under it."""
        point, line = slider.markers
        half = np.array([2.6, 1.25]) * self.unit
        corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        block = Polygon(corners, facecolor="#b6bec8", edgecolor=DARK, linewidth=1.2, zorder=2.5)

        def direction(instant: int) -> Array:
            return self.scene.axes(line, instant) @ _unit(np.array(slider.direction))

        def move(instant: int) -> None:
            along = direction(instant)
            center = self.scene.position(point, instant, self.magnification)
            block.set_xy(center + corners @ np.array([along, _normal(along)]))

        if isinstance(line, Ground):
            along = direction(0)
            if along[0] < -1e-9:
                along = -along  # the ground lies below
            origin = np.array(line.position)
            path = [self.scene.position(point, i) for i in range(len(self.scene.steps))]
            distances = (np.array(path) - origin) @ along
            start = origin - half[1] * _normal(along)
            low, high = distances.min() - 1.15 * half[0], distances.max() + 1.15 * half[0]
            self._add_hatching(start + low * along, start + high * along)
        self._add(block, move)

    def _add_pins(self) -> None:
        """Draw the signs of joints, and point masses as discs."""
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

    def _add_sign(self, shape: str, size: float, color: str, markers: Any) -> None:
        look: dict[str, Any] = {"marker": shape, "ms": size, "mfc": color, "mec": DARK, "mew": 1.4}
        sign = Line2D([], [], linestyle="none", zorder=6, **look)

        def move(instant: int) -> None:
            x, y = self.scene.place_of(markers, instant, self.magnification)
            sign.set_data([x], [y])

        self._add(sign, move)

    def _add_labels(self) -> None:
        """Write names beside bodies and joints, clear of all bodies, at the first instant."""
        shapes = {name: b.points(0, self.magnification) for name, b in self.scene.bodies.items()}
        points = np.concatenate(list(shapes.values()))
        for name, shape in shapes.items():
            middle = 0.5 * (shape.min(axis=0) + shape.max(axis=0))
            across = _normal(np.linalg.svd(shape - shape.mean(axis=0), full_matrices=False)[2][0])
            self._write(name, middle, across if across[1] >= 0.0 else -across, shape)
        for i, joint in enumerate(self.scene.mechanism.joints):
            if not joint.symbols:
                continue
            name = getattr(joint, "name", "")
            if i in self.scene.arms:
                name = name or self.scene.arms[i].marker.name
            place = self.scene.place_of(joint.markers, 0, self.magnification)
            slides = any(isinstance(symbol, Slider) for symbol in joint.symbols)
            if slides or any(isinstance(marker, Ground) for marker in joint.markers):
                # below the block or the support
                self._write(
                    name, place - [0.0, 1.7 * self.unit], np.array([0.0, -1.0]), place[None]
                )
            else:
                self._write(name, place, np.array([0.0, 1.0]), points)

    def _write(self, text: str, start: Array, direction: Array, points: Array) -> None:
        """Write a text in a direction from a place, beyond the points that lie there."""
        offsets = points - start
        beside = np.abs(offsets @ _normal(direction)) < 1.5 * self.unit
        reach = float(np.max((offsets @ direction)[beside], initial=0.0))
        x, y = start + (reach + 1.6 * self.unit) * direction
        side = "center" if abs(direction[0]) < 0.5 else "left" if direction[0] > 0.0 else "right"
        look: dict[str, Any] = {"ha": side, "va": "center", "bbox": {**LABEL, "alpha": 0.8}}
        self.axes.text(x, y, text, zorder=7, **look)


def _unit(vector: Array) -> Array:
    """A vector of length one."""
    return vector / max(float(np.linalg.norm(vector)), 1e-300)


def _normal(vector: Array) -> Array:
    """A vector (2,) turned to the left by a right angle."""
    return np.array([-vector[1], vector[0]])
