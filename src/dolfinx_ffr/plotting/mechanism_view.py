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
_PALE = "#eef1f4"


class MechanismView:
    """Artists of a mechanism, which `show` moves to an instant.

    The ``colors`` are those of the `DrawnBody.shades` of cells; ``labels`` writes the names of
    bodies and joints. `MechanismInSpace` draws the same things in its own way.
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
        self._colors = colors
        self.moving: list[Artist] = []  #: Artists that `show` changes, from back to front
        self._updates: list[Callable[[int], None]] = []
        axes.set_axis_off()
        self.unit = self._begin(scene.seen(magnification))  #: Size of a pin [m]
        for i, joint in enumerate(scene.mechanism.joints):
            for symbol in joint.symbols:
                self._add_symbol(symbol)
            self._add_axis(joint)
            if i in scene.arms:
                self._add_arm(scene.arms[i])
        for symbol in (s for force in scene.mechanism.forces for s in force.symbols):
            self._add_symbol(symbol)
        for body in scene.bodies.values():
            if body.mesh is None:
                self._add_bar(body)
            else:
                self._add_mesh(body, body.mesh)
        self._end(labels)

    def _begin(self, seen: Array) -> float:
        """Show ``seen`` (n, d) [m] in the axes; returns the size of a pin [m]."""
        low, high = seen.min(axis=0), seen.max(axis=0)
        unit = 0.018 * float(np.max(high - low))
        margin = 3.2 * unit
        self.axes.set_xlim(low[0] - margin, high[0] + margin)
        self.axes.set_ylim(low[1] - margin, high[1] + margin)
        self.axes.set_aspect("equal")
        return unit

    def _add_symbol(self, symbol: Symbol) -> None:
        draw: dict[type[Symbol], Callable[[Any], None]] = {
            Slider: self._add_slider,
            Line: self._add_link,
            Spring: lambda spring: self._add_link(spring, waves=6),
        }
        draw.get(type(symbol), self._add_supports)(symbol)

    def _add_axis(self, joint: Joint) -> None:
        """Nothing: it points out of the picture."""

    def _end(self, labels: bool) -> None:
        self._add_pins()
        if labels:
            self._add_labels()

    def show(self, instant: int) -> None:
        """Move everything to an instant."""
        for update in self._updates:
            update(instant)

    def close(self) -> None:
        """Nothing is to be freed."""

    def _add(self, artist: Artist, update: Callable[[int], None] | None = None) -> None:
        """Add an artist; one with an update is drawn anew at every instant."""
        self.axes.add_artist(artist)
        if update is not None:
            self.moving.append(artist)
            self._updates.append(update)

    def _add_mesh(self, body: DrawnBody, mesh: Any) -> None:
        """Draw the cells that are not void, and the outline of the whole body."""
        colors = self._colors
        shown = body.density[mesh.parents] >= VOID
        pieces, parents = mesh.pieces[shown], mesh.parents[shown]
        rigid = np.concatenate([mesh.outline[:0], *mesh.interfaces.values()])
        outline = LineCollection([], colors=LIGHT, linewidths=1.0, zorder=4)
        look: dict[str, Any] = {"cmap": colors.cmap, "norm": colors.norm, "edgecolors": "face"}
        cells = PolyCollection([], linewidths=0.5, zorder=5, **look)
        ends = LineCollection([], colors=STEEL, linewidths=3.0, capstyle="projecting", zorder=5.5)

        def move(instant: int) -> None:
            points = body.points(instant, self.magnification)
            outline.set_segments(points[mesh.outline])
            cells.set_verts(points[pieces])
            cells.set_array(body.shades(instant)[parents])
            ends.set_segments(points[rigid])

        self._add(outline, move)
        self._add(cells, lambda instant: None)  # with the outline
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
        dashes = (0, (4, 3))
        self._add(Line2D(*arm.ring.T, color=LIGHT, linewidth=1.0, linestyle=dashes, zorder=1))
        self._add_support(arm.center)
        bar = Line2D([], [], color=STEEL, linewidth=9.0, solid_capstyle="round", zorder=3)

        def move(instant: int) -> None:
            bar.set_data(*np.array([arm.center, self.scene.position(arm.marker, instant)]).T)

        self._add(bar, move)

    def _add_supports(self, symbol: Symbol) -> None:
        for marker in symbol.markers:
            if isinstance(marker, Ground):
                self._add_support(self.scene.position(marker, 0))

    def _add_support(self, at: Array) -> None:
        """Draw the triangle that stands for the ground, hatched below."""
        u = self.unit
        triangle = at + u * np.array([[0.0, 0.0], [-1.1, -1.9], [1.1, -1.9]])
        self._add(Polygon(triangle, facecolor=_PALE, edgecolor=DARK, linewidth=1.2, zorder=2))
        self._add_hatching(at + u * np.array([-1.7, -1.9]), at + u * np.array([1.7, -1.9]))

    def _add_hatching(self, a: Array, b: Array) -> None:
        """Draw a line of the ground from a to b; the ground lies to the right of that way."""
        u = self.unit
        length = float(np.linalg.norm(b - a))
        along = (b - a) / length
        count = max(2, round(length / (0.55 * u)))
        starts = a + (np.arange(count)[:, None] + 0.8) / count * (b - a)
        down = np.array([along[1], -along[0]])
        strokes = np.stack([starts, starts + 0.55 * u * (down - along)], axis=1)
        self._add(LineCollection(strokes, colors=GRAY, linewidths=0.8, zorder=1.5))
        self._add(Line2D(*np.array([a, b]).T, color=DARK, linewidth=1.2, zorder=2))

    def _add_link(self, symbol: Symbol, waves: int = 0) -> None:
        """Draw a line between two markers, with waves if it is a spring."""
        scene, count = self.scene, 2 * waves
        a, b = symbol.markers
        way = np.r_[0.0, np.linspace(0.2, 0.8, count), 1.0]
        side = np.r_[0.0, 0.6 * self.unit * (-1.0) ** np.arange(count), 0.0]
        line = Line2D([], [], color=DARK, linewidth=1.2 if waves else 2.4, zorder=5)

        def move(instant: int) -> None:
            start = scene.position(a, instant, self.magnification)
            along = scene.position(b, instant, self.magnification) - start
            across = _unit(np.array([-along[1], along[0]]))
            line.set_data(*(start[:, None] + np.outer(along, way) + np.outer(across, side)))

        self._add(line, move)

    def _add_slider(self, slider: Slider) -> None:
        """Draw the block and, where the line stands still, the guide under it."""
        point, line = slider.markers
        scene, half = self.scene, np.array([2.6, 1.25]) * self.unit
        corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        block = Polygon(corners, facecolor="#b6bec8", edgecolor=DARK, linewidth=1.2, zorder=2.5)

        def along_at(instant: int) -> Array:
            return scene.axes(line, instant) @ _unit(np.array(slider.direction))

        def move(instant: int) -> None:
            along = along_at(instant)
            axes = np.array([along, [-along[1], along[0]]])
            block.set_xy(scene.position(point, instant, self.magnification) + corners @ axes)

        if isinstance(line, Ground):
            along = along_at(0)
            if along[0] < -1e-9:
                along = -along  # keeps the ground below
            origin = np.array(line.position)
            path = [scene.position(point, i) for i in range(len(scene.steps))]
            way = (np.array(path) - origin) @ along
            below = origin + half[1] * np.array([along[1], -along[0]])
            low, high = way.min() - 1.15 * half[0], way.max() + 1.15 * half[0]
            self._add_hatching(below + low * along, below + high * along)
        self._add(block, move)

    def _add_pins(self) -> None:
        """Draw the signs of joints, and point masses as discs."""
        scene, mechanism = self.scene, self.scene.mechanism
        symbols = [symbol for joint in mechanism.joints for symbol in joint.symbols]
        sliders = [symbol.markers[0] for symbol in symbols if isinstance(symbol, Slider)]
        masses = [(p.marker,) for p in mechanism.point_masses if p.marker not in sliders]
        pins = [symbol.markers for symbol in symbols if symbol.sign == "pin"]
        squares = [symbol.markers for symbol in symbols if symbol.sign == "square"]
        centers = [arm.center for arm in scene.arms.values()]
        for style, size, face, still, moving in (
            ("o", 15.0, STEEL, [], masses),
            ("o", 8.5, "white", centers, pins),
            ("s", 8.5, GRAY, [], squares),
        ):
            look = {"marker": style, "ms": size, "mfc": face, "mec": DARK, "mew": 1.4}
            signs = Line2D([], [], linestyle="none", zorder=6, **look)

            def move(i: int, signs: Any = signs, still: Any = still, on: Any = moving) -> None:
                at = [scene.on_body(markers, i, self.magnification) for markers in on]
                signs.set_data(*np.reshape([*still, *at], (-1, 2)).T)

            self._add(signs, move)

    def _add_labels(self) -> None:
        """Write names beside bodies and joints, at the first instant."""
        scene, u = self.scene, self.unit
        box = {**LABEL, "alpha": 0.8}

        def write(at: Array, text: str, horizontal: str = "center") -> None:
            x, y = at
            self.axes.text(x, y, text, ha=horizontal, va="center", bbox=box, zorder=7)

        middles = {}
        shapes = [(name, b.points(0, self.magnification)) for name, b in scene.bodies.items()]
        for name, points in shapes:
            middle = middles[name] = 0.5 * (points.min(axis=0) + points.max(axis=0))
            along = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
            across = np.array([-along[1], along[0]]) * (1.0 if along[0] >= 0.0 else -1.0)
            offset = points - middle
            near = np.abs(offset @ along) < 1.5 * u
            top = float(np.max((offset @ across)[near], initial=0.0))
            side = "center" if abs(across[0]) < 0.5 else "left" if across[0] > 0.0 else "right"
            write(middle + (top + 1.6 * u) * across, name, side)
        for i, joint in enumerate(scene.mechanism.joints):
            if not joint.symbols:
                continue
            at = scene.on_body(joint.markers, 0, self.magnification)
            name = getattr(joint, "name", "")
            slides = any(isinstance(symbol, Slider) for symbol in joint.symbols)
            if slides or any(isinstance(m, Ground) for m in joint.markers):
                write(at - [0.0, 3.3 * u], name)  # below the block or the support
                continue
            on_bodies = [m[0] for m in joint.markers if isinstance(m, tuple)]
            away = sum((_unit(at - middles[body]) for body in on_bodies), np.zeros(2))
            if i in scene.arms:
                away = away + _unit(at - scene.arms[i].center)
                name = name or scene.arms[i].marker.name
            if np.linalg.norm(away) < 0.1:
                away = np.array([0.0, 1.0])
            away = _unit(away)
            # clear of the eye that surrounds the pin
            offset = np.concatenate([points for _, points in shapes]) - at
            near = np.abs(offset @ [-away[1], away[0]]) < 1.5 * u
            reach = float(np.max((offset @ away)[near], initial=1.4 * u))
            write(at + (reach + 1.6 * u) * away, name)


def _unit(vector: Array) -> Array:
    """A vector of length one."""
    return vector / max(float(np.linalg.norm(vector)), 1e-300)
