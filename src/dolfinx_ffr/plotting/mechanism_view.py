# SPDX-License-Identifier: MIT
"""A mechanism in matplotlib axes: bodies, cranks, joints, supports."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Colormap, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from ..mechanism import Ground, Line, Pin, Slider, Spring, Square, Symbol
from .scene import Arm, DrawnBody, Scene
from .style import DARK, GRAY, LIGHT

__all__ = ["MechanismView"]

Array = NDArray[np.float64]

#: Cells of less density are not drawn
VOID = 0.3
_STEEL, _PALE = "#57606a", "#eef1f4"


class MechanismView:
    """Artists of a mechanism; `show` moves them to an instant.

    Args:
        axes: Where to draw; its limits and aspect are set here.
        scene: The mechanism.
        magnification: Of the deformation.
        colors: Gives the colour value of each cell of a body at an instant.
        cmap: Colours.
        norm: Range of the values.
        labels: Whether to write the names of bodies and joints.
    """

    def __init__(
        self,
        axes: Axes,
        scene: Scene,
        magnification: float,
        colors: Callable[[DrawnBody, int], Array],
        cmap: Colormap | str,
        norm: Normalize,
        *,
        labels: bool = False,
    ) -> None:
        self.axes, self.scene, self.magnification = axes, scene, magnification
        self.moving: list[Artist] = []  #: Artists that `show` changes, from back to front
        self._updates: list[Callable[[int], None]] = []
        low, high = scene.box(magnification)
        self.unit = 0.018 * float(np.max(high - low))  #: Size of a pin [m]
        self._set_limits(low, high)
        draw: dict[type[Symbol], Callable[[Any], None]] = {
            Pin: self._add_supports,
            Square: self._add_supports,
            Slider: self._add_slider,
            Line: self._add_link,
            Spring: self._add_spring,
        }
        for i, joint in enumerate(scene.mechanism.joints):
            for symbol in joint.symbols:
                draw[type(symbol)](symbol)
            if i in scene.arms:
                self._add_arm(i, scene.arms[i])
        for force in scene.mechanism.forces:
            for symbol in force.symbols:
                draw[type(symbol)](symbol)
        for body in scene.bodies.values():
            if body.drawn is None:
                self._add_bar(body)
            else:
                self._add_mesh(body, colors, cmap, norm)
        self._add_pins()
        if labels:
            self._add_labels()

    def show(self, instant: int) -> None:
        """Move everything to an instant."""
        for update in self._updates:
            update(instant)

    def close(self) -> None:
        """Nothing is to be freed."""

    # ------------------------------------------------------------------ parts

    def _set_limits(self, low: Array, high: Array) -> None:
        margin = 3.2 * self.unit
        self.axes.set_xlim(low[0] - margin, high[0] + margin)
        self.axes.set_ylim(low[1] - margin, high[1] + margin)
        self.axes.set_aspect("equal")
        self.axes.set_axis_off()

    def _add(self, artist: Artist, update: Callable[[int], None] | None = None) -> None:
        """Add an artist; one with an update is drawn anew at every instant."""
        if isinstance(artist, Line2D):
            self.axes.add_line(artist)
        elif isinstance(artist, Polygon):
            self.axes.add_patch(artist)
        else:
            self.axes.add_collection(artist, autolim=False)
        if update is not None:
            self.moving.append(artist)
            self._updates.append(update)

    def _add_mesh(
        self,
        body: DrawnBody,
        colors: Callable[[DrawnBody, int], Array],
        cmap: Colormap | str,
        norm: Normalize,
    ) -> None:
        drawn = body.drawn
        assert drawn is not None
        shown = body.density[drawn.parents] >= VOID
        pieces, parents = drawn.pieces[shown], drawn.parents[shown]
        rim = drawn.outline
        outline = LineCollection([], colors=LIGHT, linewidths=1.0, zorder=4)
        cells = PolyCollection(
            [], cmap=cmap, norm=norm, edgecolors="face", linewidths=0.5, zorder=5
        )
        rigid = np.concatenate([rim[:0], *drawn.interfaces.values()])
        ends = LineCollection([], colors=_STEEL, linewidths=3.0, capstyle="projecting", zorder=5.5)

        def update_outline(instant: int) -> None:
            points = body.points(instant, self.magnification)
            outline.set_segments(points[rim])
            ends.set_segments(points[rigid])

        def update_cells(instant: int) -> None:
            cells.set_verts(body.points(instant, self.magnification)[pieces])
            cells.set_array(colors(body, instant)[parents])

        self._add(outline, update_outline)
        self._add(cells, update_cells)
        self._add(ends, lambda instant: None)  # with the outline

    def _add_bar(self, body: DrawnBody) -> None:
        """Draw a body without a mesh as a bar through its markers."""
        bar = Line2D(
            [],
            [],
            color=_STEEL,
            linewidth=7.0,
            solid_capstyle="round",
            zorder=4,
            solid_joinstyle="round",
        )

        def update(instant: int) -> None:
            points = body.points(instant, self.magnification)
            closed = np.vstack([points, points[:1]]) if len(points) > 2 else points
            bar.set_data(*closed.T)

        self._add(bar, update)

    def _add_arm(self, number: int, arm: Arm) -> None:
        angles = np.linspace(0.0, 2.0 * np.pi, 181)
        circle = arm.center + arm.radius * np.column_stack([np.cos(angles), np.sin(angles)])
        self._add(Line2D(*circle.T, color=LIGHT, linewidth=1.0, linestyle=(0, (4, 3)), zorder=1))
        self._add_support(arm.center)
        bar = Line2D([], [], color=_STEEL, linewidth=9.0, solid_capstyle="round", zorder=3)
        joint = self.scene.mechanism.joints[number]
        moving = next(m for m in joint.markers if not isinstance(m, tuple))

        def update(instant: int) -> None:
            bar.set_data(*np.array([arm.center, self.scene.position(moving, instant)]).T)

        self._add(bar, update)

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

    def _add_spring(self, spring: Spring) -> None:
        self._add_link(spring, waves=6)

    def _add_link(self, symbol: Symbol, waves: int = 0) -> None:
        """Draw a line between two markers, with waves if it is a spring."""
        scene, count = self.scene, 2 * waves
        a, b = symbol.markers
        way = np.r_[0.0, np.linspace(0.2, 0.8, count), 1.0]
        side = np.r_[0.0, 0.6 * self.unit * (-1.0) ** np.arange(count), 0.0]
        line = Line2D([], [], color=DARK, linewidth=1.2 if waves else 2.4, zorder=5)

        def update(instant: int) -> None:
            start = scene.position(a, instant, self.magnification)
            along = scene.position(b, instant, self.magnification) - start
            across = _unit(np.array([-along[1], along[0]]))
            line.set_data(*(start[:, None] + np.outer(along, way) + np.outer(across, side)))

        self._add(line, update)

    def _add_slider(self, slider: Slider) -> None:
        """Draw the block and, where the line stands still, the guide under it."""
        point, line = slider.markers
        u, scene = self.unit, self.scene
        half = np.array([2.6, 1.25]) * u
        corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        own = float(np.arctan2(slider.direction[1], slider.direction[0]))
        block = Polygon(corners, facecolor="#b6bec8", edgecolor=DARK, linewidth=1.2, zorder=2.5)

        def update(instant: int) -> None:
            turn = scene.angle(line, instant) + own
            along = np.array([np.cos(turn), np.sin(turn)])
            axes = np.array([along, [-along[1], along[0]]])
            at = scene.position(point, instant, self.magnification)
            block.set_xy(at + corners @ axes)

        if isinstance(line, Ground):
            turn = line.angle + own
            along = np.array([np.cos(turn), np.sin(turn)])
            if along[0] < -1e-9:
                along = -along  # keeps the ground below
            origin = np.array(line.position)
            path = [scene.position(point, i) for i in range(len(scene.steps))]
            way = (np.array(path) - origin) @ along
            below = origin + half[1] * np.array([along[1], -along[0]])
            reach = 1.15 * half[0]
            self._add_hatching(
                below + (way.min() - reach) * along, below + (way.max() + reach) * along
            )
        self._add(block, update)

    def _add_pins(self) -> None:
        """Draw the signs of joints, and point masses as discs."""
        scene, mechanism = self.scene, self.scene.mechanism
        symbols = [symbol for joint in mechanism.joints for symbol in joint.symbols]
        sliders = [symbol.markers[0] for symbol in symbols if isinstance(symbol, Slider)]
        masses = [p.marker for p in mechanism.point_masses if p.marker not in sliders]

        def markers(style: str, size: float, face: str) -> Line2D:
            return Line2D(
                [],
                [],
                linestyle="none",
                marker=style,
                markersize=size,
                markerfacecolor=face,
                markeredgecolor=DARK,
                markeredgewidth=1.4,
                zorder=6,
            )

        discs, pins, squares = (
            markers("o", 15.0, _STEEL),
            markers("o", 8.5, "white"),
            markers("s", 8.5, GRAY),
        )

        def update_discs(instant: int) -> None:
            places = [scene.position(m, instant, self.magnification) for m in masses]
            discs.set_data(*np.reshape(places, (-1, 2)).T)

        def places(sign: str, instant: int) -> list[Array]:
            return [
                scene.on_body(symbol.markers, instant, self.magnification)
                for symbol in symbols
                if symbol.sign == sign
            ]

        def update_pins(instant: int) -> None:
            centers = [arm.center for arm in scene.arms.values()]
            pins.set_data(*np.reshape(centers + places("pin", instant), (-1, 2)).T)

        def update_squares(instant: int) -> None:
            squares.set_data(*np.reshape(places("square", instant), (-1, 2)).T)

        self._add(discs, update_discs)
        self._add(pins, update_pins)
        self._add(squares, update_squares)

    def _add_labels(self) -> None:
        """Write names beside bodies and joints, at the first instant."""
        scene, u = self.scene, self.unit
        box = {
            "boxstyle": "round,pad=0.15",
            "facecolor": "white",
            "edgecolor": "none",
            "alpha": 0.8,
        }

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
            away = sum(
                (_unit(at - middles[m[0]]) for m in joint.markers if isinstance(m, tuple)),
                np.zeros(2),
            )
            if i in scene.arms:
                away = away + _unit(at - scene.arms[i].center)
                name = name or scene.arms[i].name
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
