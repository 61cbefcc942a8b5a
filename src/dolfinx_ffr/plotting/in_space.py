# SPDX-License-Identifier: MIT
"""Bodies and mechanisms in space, rendered without a screen, in pages of the package's style."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..arrays import Array, Mask
from ..design import density_field
from ..fem import Domain, GatheredMesh, surface_of
from ..mechanism import Joint, Line, Marker, Slider, Spring, Symbol
from ..part import Solid
from ..reduction import FlexibleBody, ReducedBody
from . import style
from .mechanism_view import VOID, MechanismView
from .scene import Arm, DrawnBody, across
from .style import DARK, GRAY, LIGHT, STEEL

#: Pixels of an inch of the page, twice those of the page for smooth edges
_PER_INCH = 220
#: Direction to the camera: in front, on the right and above
_BACK = np.array([0.45, -1.0, 0.5]) / np.linalg.norm([0.45, -1.0, 0.5])
_RIGHT = np.cross([0.0, 0.0, 1.0], _BACK) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], _BACK))
#: Directions to the right and upwards, shape (3, 2)
_ACROSS = np.column_stack([_RIGHT, np.cross(_BACK, _RIGHT)])
_MATERIAL = "#b9c0c8"
#: Largest displacement shown, relative to the body's extent
_SHOWN = 0.1


class Rendering:
    """A view from the front, the right and above that shows all ``points`` (n, 3).

    Width and height are in inches.
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
        """Height over width of ``points`` (n, 3) in the view."""
        wide, tall = np.ptp(points @ _ACROSS, axis=0)
        return float(tall / wide)

    def look(self) -> None:
        """Look at the middle of the points, z upwards, so that all of them fit."""
        flat = self._points @ _ACROSS
        low, high = flat.min(axis=0), flat.max(axis=0)
        middle = self._points.mean(axis=0)
        middle = middle + _ACROSS @ (0.5 * (low + high) - middle @ _ACROSS)
        camera = self.plotter.camera
        camera.position = tuple(middle + 4.0 * self.size * _BACK)
        camera.focal_point = tuple(middle)
        camera.up = tuple(_ACROSS[:, 1])
        wide, tall = high - low
        camera.parallel_scale = 0.53 * max(tall, wide / self._aspect)
        self.plotter.reset_camera_clipping_range()

    def add(self, mesh: Any, **how: Any) -> None:
        """Add a mesh, shaded in the same way everywhere."""
        # colours that mean a number must stay what they are
        dim = "scalars" in how
        style: dict[str, Any] = {"ambient": 0.6 if dim else 0.25, "diffuse": 0.5 if dim else 0.8}
        style |= {"smooth_shading": False, "show_scalar_bar": False}
        self.plotter.add_mesh(mesh, **{**style, **how})

    def span(self, point: Array, direction: Array) -> tuple[float, float]:
        """How far a line reaches from a point to both sides in the view."""
        low, high = -self.size, self.size
        box = self._points.min(axis=0), self._points.max(axis=0)
        for k in range(3):
            if abs(direction[k]) > 1e-9:
                a, b = sorted((side[k] - point[k]) / direction[k] for side in box)
                low, high = max(low, a), min(high, b)
        return (low, high) if low < high else (-0.1 * self.size, 0.1 * self.size)

    def nearer(self, mesh: Any) -> Any:
        """A mesh moved a little to the camera, so that it covers the surface on which it lies."""
        return mesh.translate(2e-3 * self.size * _BACK, inplace=False)

    def picture(self) -> NDArray[np.uint8]:
        """The view as pixels, shape (height, width, 3)."""
        self.plotter.render()
        return np.asarray(self.plotter.screenshot(return_img=True))[..., :3]

    def close(self) -> None:
        """Free the memory."""
        self.plotter.close()

    def show(self, axes: Axes) -> None:
        """Fill axes with the view."""
        axes.imshow(self.picture(), interpolation="antialiased", aspect="auto")
        axes.set_axis_off()


def feature_edges(grid: Any) -> Any:
    """The edges of a body where its faces meet at an angle."""
    return surface_of(grid).extract_feature_edges(
        feature_angle=40.0, boundary_edges=False, manifold_edges=False, non_manifold_edges=False
    )


def designs_in_space(domain: Domain, designs: Mapping[str, Array], path: Path, title: str) -> Path:
    """Draw designs, densities of this rank's cells by heading, as solids under each other."""
    mesh = GatheredMesh.of(domain)
    fields = {name: density_field(domain, x) for name, x in designs.items()}
    passive = [domain.on_rank_0(cells) for cells in (domain.solid_cells, domain.void_cells)]

    def show(view: Rendering, grid: Any, name: str) -> None:
        level = fields[name](mesh.points)
        for cells, value in zip(passive, (0.5, -0.5), strict=True):
            level[np.unique(mesh.cells[cells])] = value
        grid.point_data["level"] = level
        material = grid.clip_scalar(scalars="level", value=0.0, invert=False)
        if material.n_cells:
            view.add(surface_of(material).triangulate(), color=_MATERIAL)

    return _page(mesh, path, list(designs), title, show, interfaces=True)


def solid_in_space(solid: Solid, path: Path, title: str) -> Path:
    """Draw the surface of a solid, with the edges of the body and its interfaces."""
    heading = f"volume {1e6 * solid.volume:.4g} cm³"
    if solid.weighs:
        heading += f"   mass {solid.mass:.4g} kg"
    heading += f"   {solid.pieces} piece{'s' * (solid.pieces != 1)}"

    def show(view: Rendering, grid: Any, name: str) -> None:
        view.add(solid.surface(), color=_MATERIAL)

    return _page(GatheredMesh.of(solid.body), path, [heading], title, show, interfaces=True)


def stress_in_space(
    domain: Domain, stress: Array, solid: Mask, path: Path, title: str, note: str
) -> Path:
    """Draw the stress [Pa] of this rank's solid cells; the note says when it is largest."""
    mesh = GatheredMesh.of(domain)
    values, chosen = domain.on_rank_0(stress), domain.on_rank_0(solid)
    told = values[chosen] if np.any(chosen) else np.zeros(1)  # the other ranks have none
    largest = float(told.max())
    unit, factor = style.prefixed(largest, "Pa")
    top = float(np.percentile(told, 99.7)) * factor or 1.0

    def show(view: Rendering, grid: Any, name: str) -> None:
        grid.cell_data["stress"] = values * factor
        surface = surface_of(grid.extract_cells(np.flatnonzero(chosen)))
        view.add(surface, scalars="stress", cmap=style.GLOW, clim=(0.0, top))

    heading = f"{title}   largest: {largest * factor:.3g} {unit}{note}"
    bar = ScalarMappable(Normalize(0.0, top), style.GLOW), f"von Mises stress [{unit}]"
    return _page(mesh, path, [""], heading, show, bar=bar)


def modes_in_space(
    body: FlexibleBody, reduced: ReducedBody, names: list[str], path: Path, title: str
) -> Path:
    """Draw the shape functions as the deformed body, coloured by the amount of the displacement."""
    mesh = GatheredMesh.of(body.domain)
    shapes = mesh.displacements(reduced.basis.shapes)
    shown = np.flatnonzero(body.domain.on_rank_0(reduced.density) >= VOID)

    def show(view: Rendering, grid: Any, name: str) -> None:
        cells = grid.extract_cells(shown)
        moved = surface_of(cells)
        # extracted cells know of their points, and the surface of those of the extract
        of = np.asarray(cells["vtkOriginalPointIds"])[np.asarray(moved["vtkOriginalPointIds"])]
        field = shapes[of, :, names.index(name)]
        amount = np.linalg.norm(field, axis=1)
        largest = float(amount.max()) or 1.0
        sign = 1.0 if field[np.argmax(amount)] @ np.array([1.0, 1.2, 1.4]) >= 0.0 else -1.0
        size = float(np.max(np.ptp(mesh.points, axis=0)))
        moved.points = mesh.points[of] + sign * _SHOWN * size / largest * field
        moved.point_data["amount"] = amount / largest
        view.add(moved, scalars="amount", cmap="viridis", clim=(0.0, 1.0))

    bar = ScalarMappable(Normalize(0.0, 1.0), "viridis"), "displacement / its maximum"
    return _page(mesh, path, names, title, show, across=3, margin=_SHOWN, bar=bar)


def _page(
    mesh: GatheredMesh,
    path: Path,
    headings: Sequence[str],
    title: str,
    show: Callable[[Rendering, Any, str], None],
    *,
    across: int = 1,
    margin: float = 0.0,
    interfaces: bool = False,
    bar: tuple[ScalarMappable, str] | None = None,
) -> Path:
    """Write a page: under each heading the body's edges, and the meshes that ``show`` adds."""

    def draw(file: Path) -> None:
        grid = mesh.grid()
        low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
        around = margin * float(np.max(high - low))
        corners = np.array(np.meshgrid(*np.array([low - around, high + around]).T))
        seen = corners.reshape(3, -1).T
        width = 10.0 if across == 1 else 12.0
        wide = width / across - 0.3
        tall = wide * Rendering.shape_of(seen)
        head = (0.5 if title else 0.15) + (0.55 if bar else 0.0)
        row, foot = tall + (0.3 if any(headings) else 0.05), 0.55 if interfaces else 0.1
        height = head + -(-len(headings) // across) * row + foot
        with style.styled_figure(width, height, file) as figure:
            if title:
                figure.text(0.5, 1.0 - 0.27 / height, title, ha="center", va="center", fontsize=13)
            for k, name in enumerate(headings):
                i, j = divmod(k, across)
                left, bottom = j * width / across + 0.15, height - head - (i + 1) * row
                axes = style.axes_at(figure, left, bottom, wide, tall)
                axes.set_title(name, fontsize=10)
                with closing(Rendering(wide, tall, seen)) as view:
                    show(view, grid, name)
                    edges = feature_edges(grid)
                    look = {"color": style.GRAY, "line_width": 1.5, "lighting": False}
                    if edges.n_points:
                        view.plotter.add_mesh(edges, **look)
                    if interfaces:
                        _add_interfaces(view, mesh, grid)
                    view.look()
                    view.show(axes)
            if bar is not None:
                style.color_bar(figure, *bar, (0.34, 0.66, 0.85 if title else 0.5))
            if interfaces:
                _draw_legend(figure, mesh)

    return style.written(mesh.domain.comm, path, draw)


def _draw_legend(figure: Figure, mesh: GatheredMesh) -> None:
    """Name the interfaces and the extent in one line below."""
    axes = style.line_of_inches(figure, 0.1)
    style.name_accents(axes, mesh.interfaces, (0.1, 0.0), 10)
    sizes = np.ptp(mesh.points, axis=0)
    unit, factor = ("m", 1.0) if sizes.max() >= 1.0 else ("mm", 1e3)
    size = " x ".join(f"{factor * s:.4g}" for s in sizes) + f" {unit}"
    axes.text(axes.get_xlim()[1], 0.0, size, va="center", ha="right", color=style.DARK)


def _add_interfaces(view: Rendering, mesh: GatheredMesh, grid: Any) -> None:
    """Draw the interfaces, a little off the body, in colour."""
    surface = surface_of(grid)
    number = np.asarray(surface["vtkOriginalPointIds"])
    for points, color in zip(mesh.interfaces.values(), cycle(style.ACCENTS), strict=False):
        faces = surface.extract_points(np.flatnonzero(points[number]), adjacent_cells=False)
        if faces.n_cells:
            view.add(view.nearer(faces), color=color)


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
