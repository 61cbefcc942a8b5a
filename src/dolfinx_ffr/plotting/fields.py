# SPDX-License-Identifier: MIT
"""Fields on a body in the plane or in space: designs, selected elements, stress, shape functions.

Each picture is a page of panels. A panel is a view of one body, `_PlaneView` or `_SpaceView`, which
draw the same things in matplotlib and by PyVista.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import ListedColormap, Normalize
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array, Integers, Mask
from ..design import density_field
from ..fem import Domain, GatheredMesh, surface_of
from ..parallel import announce, on_every_rank
from ..part import Solid
from ..postprocessing import StressEnvelope
from ..reduction import FlexibleBody, ReducedBody
from . import rendering, style
from .mechanism_view import VOID
from .scene import DrawnMesh, gathered_mesh

if TYPE_CHECKING:
    import pyvista

#: Largest displacement that is drawn of a mode, relative to the extent of the body
_MODE_SIZE = 0.08
#: Percentage of the solid cells whose stress has a colour of its own; larger ones share the last
_STRESS_RANGE = 99.7
_SHADES = ScalarMappable(Normalize(0.0, 1.0), "gray_r")
#: Transparent orange over elements that are selected
_SELECTION = ScalarMappable(Normalize(0.0, 1.0), ListedColormap([(0.85, 0.51, 0.17, 0.45)]))


def plot_design(
    domain: Domain, x: ArrayLike | Mapping[str, ArrayLike], path: str | Path, *, title: str = ""
) -> Path:
    """Draw one design, or several under each other: solid is black, void is white.

    One sees the density of each cell in shades of gray, the outline of the body, and its rigid
    interfaces in colour. Of a body in space one sees the surface of the material.

    The ``domain`` has the mesh and the interfaces of the body; ``x`` is one density in [0, 1] for
    each cell owned by this rank, shape (cells,), or several designs by title. The file ``path``
    gets a ``title``.
    """
    path = style.writable(path, title)
    validation.instance("plot_design: domain", domain, Domain, "a Domain")
    announce(domain.comm, "the drawing of a body")
    by_title = x if isinstance(x, Mapping) else {"": x}
    designs = {
        name: domain.check_density(density, f"design {name!r}" if name else "x")
        for name, density in validation.by_name("plot_design: x", by_title, "densities").items()
    }
    if not designs:
        raise ValueError("plot_design: no design given")
    mesh = gathered_mesh(domain)
    if isinstance(mesh, GatheredMesh):
        fields = [density_field(domain, density) for density in designs.values()]
        solid_and_void = [domain.on_rank_0(c) for c in (domain.solid_cells, domain.void_cells)]

        def draw_surface(view: _SpaceView, panel: int) -> None:
            level = fields[panel](view.mesh.points)
            for cells, value in zip(solid_and_void, (0.5, -0.5), strict=True):
                level[np.unique(view.mesh.cells[cells])] = value
            view.grid.point_data["level"] = level
            material = view.grid.clip_scalar(scalars="level", value=0.0, invert=False)
            if material.n_cells:
                view.add_surface(surface_of(material).triangulate())

        return _write_page(path, mesh, list(designs), draw_surface, title, interfaces=True)
    densities = [domain.on_rank_0(density) for density in designs.values()]

    def draw(view: _PlaneView, panel: int) -> None:
        view.add_cells(densities[panel], _SHADES)

    return _write_page(path, mesh, list(designs), draw, title, interfaces=True)


def plot_gradient_elements(
    domain: Domain,
    selections: Mapping[str, tuple[ArrayLike, ArrayLike]],
    path: str | Path,
    *,
    title: str = "",
) -> Path:
    """Draw which elements get exact derivatives, over the designs for which they were selected.

    One sees each design in shades of gray, and the selected elements in orange.

    The ``selections`` are, by heading, a design (cells,) in [0, 1] and which elements are selected
    (cells,), both for the cells of the ``domain`` owned by this rank. The file ``path`` gets a
    ``title``.
    """
    path = style.writable(path, title)
    validation.instance("plot_gradient_elements: domain", domain, Domain, "a Domain")
    what, needed = "plot_gradient_elements: selections", "a design and a mask over its cells"
    by_heading = validation.by_name(what, selections, needed)
    if not by_heading:
        raise ValueError(f"{what}: no design given")
    with on_every_rank(domain.comm, "plot_gradient_elements"):
        pairs = {n: validation.listed(f"{what}: {n!r}", v, needed) for n, v in by_heading.items()}
        for name, pair in pairs.items():
            if len(pair) != 2 or np.shape(pair[1]) != (domain.n_cells,):
                raise ValueError(
                    f"{what}: {name!r} must be {needed}, one value of each for each of the "
                    f"{domain.n_cells} cells owned by rank {domain.comm.rank}"
                )
    panels = []
    for name, (x, selected) in pairs.items():
        density = domain.on_rank_0(domain.check_density(x, name))
        panels.append((density, domain.on_rank_0(np.asarray(selected, dtype=bool))))

    def draw(view: _PlaneView, panel: int) -> None:
        density, selected = panels[panel]
        view.add_cells(0.75 * density, _SHADES)
        view.add_cells(density, _SELECTION, shown=selected)

    return _write_page(path, DrawnMesh.of(domain), list(pairs), draw, title)


def plot_stress(
    domain: Domain,
    stress: StressEnvelope | ArrayLike,
    path: str | Path,
    *,
    solid: ArrayLike | None = None,
    title: str = "",
) -> Path:
    """Draw the von Mises stress in the undeformed body.

    One sees the stress of each cell in colour, with void left out, the outline of the body,
    and in the plane a ring where the stress is largest. The colours end where 0.3 % of the cells
    have a larger stress, so that a single corner does not hide all the rest.

    Args:
        domain: Mesh and interfaces of the body.
        stress: A worst case from `worst_stress`, or the stress of each cell owned by this rank,
            shape (cells,) [Pa].
        solid: Cells that are drawn, shape (cells,); by default those of the worst case, or all.
        path: File to write.
        title: Heading.
    """
    path = style.writable(path, title)
    validation.instance("plot_stress: domain", domain, Domain, "a Domain")
    instant = ""
    if isinstance(stress, StressEnvelope):
        instant = f" at t = {stress.largest_time:.3f} s"
        solid = stress.solid if solid is None else solid
        stress = stress.stress
    with on_every_rank(domain.comm, "plot_stress"):
        values = validation.numbers("plot_stress: stress", stress)
        shown = np.asarray(np.ones(domain.n_cells) if solid is None else solid, dtype=bool)
        for name, array in (("stress", values), ("solid", shown)):
            if array.shape != (domain.n_cells,) or not np.all(np.isfinite(array)):
                raise ValueError(f"plot_stress: {name} must have one finite value for each cell")
    if not any(domain.comm.allgather(bool(np.any(shown)))):
        raise ValueError("plot_stress: no cell is solid, there is nothing to draw")
    values, shown = domain.on_rank_0(values), domain.on_rank_0(shown)
    solid_values = values[shown] if shown.any() else np.zeros(1)  # on the other ranks
    unit, factor = style.prefixed(float(solid_values.max()), "Pa")
    values = values * factor
    top = float(np.percentile(solid_values, _STRESS_RANGE)) * factor or 1.0
    colors = ScalarMappable(Normalize(0.0, top), style.GLOW)

    def draw(view: _View, panel: int) -> None:
        view.add_cells(values, colors, shown)
        view.mark_cell(int(np.argmax(np.where(shown, values, -np.inf))))

    ring = "" if domain.dimension == 3 else "○ "
    heading = f"{ring}largest: {solid_values.max() * factor:.3g} {unit}{instant}"
    bar = colors, f"von Mises stress [{unit}]"
    return _write_page(path, gathered_mesh(domain), [heading], draw, title, color_bar=bar)


def plot_modes(
    body: FlexibleBody, reduced: ReducedBody, path: str | Path, *, title: str = ""
) -> Path:
    """Draw the shape functions of a body: static modes, then normal modes with their frequencies.

    One sees each mode as the deformed body, coloured by the amount of the displacement relative to
    the largest one of the mode, with the undeformed outline behind. Cells of density below 0.3 are
    left out. The sign of a mode has no meaning; it is chosen so that the picture is always the
    same. The shape functions are those of the ``reduced`` ``body``, from `FlexibleBody.reduce`; the
    file ``path`` gets a ``title``.
    """
    path = style.writable(path, title)
    validation.instance("plot_modes: body", body, FlexibleBody, "a FlexibleBody")
    needed = "what `FlexibleBody.reduce` returned"
    validation.instance("plot_modes: reduced", reduced, ReducedBody, needed)
    mesh = gathered_mesh(body.domain)
    shapes = mesh.displacements(reduced.basis.shapes)
    shown = body.domain.on_rank_0(reduced.density) >= VOID
    colors = ScalarMappable(Normalize(0.0, 1.0), "viridis")

    def draw(view: _View, panel: int) -> None:
        shape = shapes[:, :, panel]
        amount = np.linalg.norm(shape, axis=1)
        largest = float(amount.max()) or 1.0
        extent = float(np.max(np.ptp(mesh.points, axis=0)))
        scale = _sign(mesh.points, shape) * _MODE_SIZE * extent / largest
        view.add_cells(amount / largest, colors, shown, displacement=scale * shape)

    bar = colors, "displacement, relative to its maximum"
    page: dict[str, Any] = {"columns": 3, "margin": _MODE_SIZE, "color_bar": bar}
    return _write_page(path, mesh, _mode_names(body, reduced), draw, title, **page)


def draw_solid(solid: Solid, path: Path, title: str) -> Path:
    """Draw the surface of a solid, with the edges of the body and its interfaces."""
    heading = f"volume {1e6 * solid.volume:.4g} cm³"
    if solid.weighs:
        heading += f"   mass {solid.mass:.4g} kg"
    heading += f"   {solid.pieces} piece{'s' * (solid.pieces != 1)}"

    def draw(view: _SpaceView, panel: int) -> None:
        view.add_surface(solid.surface())

    mesh = GatheredMesh.of(solid.body)
    return _write_page(path, mesh, [heading], draw, title, interfaces=True)


def mesh_grid(domain: Domain, fields: Mapping[str, ArrayLike]) -> pyvista.UnstructuredGrid | None:
    """A body with values on its cells as a grid of PyVista, for interactive views and exports.

    Args:
        domain: The body.
        fields: By name, values of this rank's cells, shape (cells, ...).

    Returns:
        The grid on rank 0, with straight-sided cells; None elsewhere.

    Examples:
        >>> grid = mesh_grid(domain, {"density": x})
        >>> grid.plot(scalars="density", cmap="gray_r", cpos="xy")
        >>> grid.save("design.vtu")
    """
    validation.instance("mesh_grid: domain", domain, Domain, "a Domain")
    by_name = validation.by_name("mesh_grid: fields", fields, "values of the cells")
    mesh = gathered_mesh(domain)
    with on_every_rank(domain.comm, "mesh_grid"):
        arrays = {n: validation.numbers(f"mesh_grid: {n!r}", v) for n, v in by_name.items()}
        for name, array in arrays.items():
            if array.shape[:1] != (domain.n_cells,):
                raise ValueError(
                    f"mesh_grid: {name!r} must have one value for each cell owned by the rank; on "
                    f"rank {domain.comm.rank} it has the shape {array.shape} for {domain.n_cells} "
                    "cells"
                )
    values = {name: domain.on_rank_0(array) for name, array in arrays.items()}
    if domain.comm.rank > 0:
        return None
    grid = mesh.grid()
    for name, field in values.items():
        grid.cell_data[name] = field[mesh.parents] if isinstance(mesh, DrawnMesh) else field
    return grid


class _PlaneView:
    """A body in the plane, drawn into axes."""

    def __init__(self, axes: Axes, mesh: DrawnMesh, box: Array, width: int) -> None:
        self.axes, self.mesh = axes, mesh
        axes.set(xlim=box[:, 0], ylim=box[:, 1])
        self._add_lines(mesh.outline, style.GRAY, 1.0, order=0.5)

    def add_cells(
        self,
        values: Array,
        colors: ScalarMappable,
        shown: Mask | None = None,
        *,
        displacement: Array | None = None,
    ) -> None:
        """Draw cells in the colours of their values; with a displacement, of values at points."""
        mesh = self.mesh
        pieces = np.ones(len(mesh.parents), bool) if shown is None else shown[mesh.parents]
        corners = mesh.pieces[pieces]
        if displacement is None:
            points, values = mesh.points, values[mesh.parents[pieces]]
        else:
            points, values = mesh.points + displacement, values[corners].mean(axis=1)
        faces = colors.to_rgba(values)
        edges = {"edgecolors": "face", "linewidths": 0.4}
        self.axes.add_collection(PolyCollection(points[corners], facecolors=faces, **edges))

    def add_interfaces(self) -> None:
        """Draw the interfaces in colour."""
        for lines, color in zip(self.mesh.interfaces.values(), cycle(style.ACCENTS), strict=False):
            self._add_lines(lines, color, 4.0)

    def mark_cell(self, cell: int) -> None:
        """Draw a ring around a cell."""
        corners = self.mesh.pieces[self.mesh.parents == cell]
        center = self.mesh.points[corners].mean(axis=(0, 1))
        self.axes.plot(*center, "o", markersize=11, mfc="none", mec=style.DARK, mew=1.4)

    def finish(self) -> None:
        """Nothing is left to do."""

    def _add_lines(self, lines: Integers, color: str, width: float, order: float = 2.0) -> None:
        ends = self.mesh.points[lines]
        look: dict[str, Any] = {"clip_on": False, "zorder": order}
        self.axes.add_collection(LineCollection(ends, colors=color, linewidths=width, **look))


class _SpaceView:
    """A body in space, rendered into axes."""

    def __init__(self, axes: Axes, mesh: GatheredMesh, box: Array, width: int) -> None:
        self.axes, self.mesh = axes, mesh
        self.grid = mesh.grid()
        self._rendering = rendering.Rendering(_corners(box), width)
        self._rendering.add_lines(rendering.feature_edges(self.grid))

    def add_cells(
        self,
        values: Array,
        colors: ScalarMappable,
        shown: Mask,
        *,
        displacement: Array | None = None,
    ) -> None:
        """Draw cells in the colours of their values; with a displacement, of values at points."""
        surface, points, cells = rendering.surface_of_cells(self.grid, np.flatnonzero(shown))
        if displacement is None:
            data, values = surface.cell_data, values[cells]
        else:
            data, values = surface.point_data, values[points]
            surface.points = (self.mesh.points + displacement)[points]
        data["rgb"] = colors.to_rgba(values, bytes=True)[:, :3]
        self._rendering.add(surface, scalars="rgb", rgb=True)

    def add_surface(self, surface: Any) -> None:
        """Draw a surface in the colour of material."""
        self._rendering.add(surface, color=rendering.MATERIAL)

    def add_interfaces(self) -> None:
        """Draw the interfaces in colour."""
        surface = surface_of(self.grid)
        number = np.asarray(surface["vtkOriginalPointIds"])
        for points, color in zip(self.mesh.interfaces.values(), cycle(style.ACCENTS), strict=False):
            faces = surface.extract_points(np.flatnonzero(points[number]), adjacent_cells=False)
            if faces.n_cells:
                self._rendering.add(self._rendering.nearer(faces), color=color)

    def mark_cell(self, cell: int) -> None:
        """Nothing: the cell may be hidden."""

    def finish(self) -> None:
        """Render the view."""
        self.axes.imshow(self._rendering.picture(), interpolation="antialiased")
        self._rendering.close()


_View = _PlaneView | _SpaceView


def _write_page(
    path: Path,
    mesh: DrawnMesh | GatheredMesh,
    headings: Sequence[str],
    draw_panel: Callable[[Any, int], None],
    title: str,
    *,
    columns: int = 1,
    margin: float = 0.0,
    interfaces: bool = False,
    color_bar: tuple[ScalarMappable, str] | None = None,
) -> Path:
    """Write a page with a view of a body below each heading, drawn by ``draw_panel(view, panel)``.

    The ``margin`` around the body is relative to its extent.
    """

    def draw(file: Path) -> None:
        low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
        around = margin * float(np.max(high - low))
        box = np.array([low - around, high + around])
        view_of: Any = _PlaneView
        aspect = float(np.divide(*np.ptp(box, axis=0)[1::-1]))
        if isinstance(mesh, GatheredMesh):
            view_of, aspect = _SpaceView, rendering.aspect(_corners(box))
        below = 0.7 if color_bar or interfaces else 0.0
        page: dict[str, Any] = {"title": title, "columns": columns, "margin": below}
        with style.page(file, headings, aspect, **page) as panels:
            for panel, axes in enumerate(panels):
                view = view_of(axes, mesh, box, rendering.PIXELS // columns)
                draw_panel(view, panel)
                if interfaces:
                    view.add_interfaces()
                view.finish()
            if color_bar is not None:
                style.add_color_bar(panels, *color_bar)
            if interfaces:
                shades = {"void": "white", "solid": "black"} if view_of is _PlaneView else {}
                names = {**shades, **style.accents(mesh.interfaces)}
                style.add_legend(panels[-1], names, style.extent(mesh.points))

    return style.written(mesh.domain.comm, path, draw)


def _corners(box: Array) -> Array:
    """Corners of a box (2, 3), shape (8, 3)."""
    return np.array(np.meshgrid(*box.T)).reshape(3, -1).T


def _mode_names(body: FlexibleBody, reduced: ReducedBody) -> list[str]:
    """A heading for each shape function."""
    names = []
    for interface, motions in body.reduction.motions.items():
        translations = 2 if body.domain.dimension == 2 else 3
        for motion in motions:
            rotates = bool(np.any(motion[translations:]))
            if body.domain.dimension == 2:
                words = f"rotation of {interface!r}"
            else:
                axis = motion[3:] if rotates else motion[:3]
                words = f"rotation of {interface!r} about {_direction(axis)}"
            if not rotates:
                direction = _direction(motion[:translations])
                words = f"displacement of {interface!r} along {direction}"
            names.append(f"static: {words}")
    frequencies = reduced.basis.frequencies
    return names + [f"normal {i}: {f:.4g} Hz" for i, f in enumerate(frequencies, 1)]


def _direction(vector: Array) -> str:
    """An axis by its name, or the components of a direction."""
    k = int(np.argmax(np.abs(vector)))
    if abs(vector[k]) > (1.0 - 1e-9) * np.linalg.norm(vector):
        return "xyz"[k]
    return "(" + ", ".join(f"{x:.2f}" for x in vector) + ")"


def _sign(points: Array, shape: Array) -> float:
    """+1 or -1 so that the mode moves up, its left part counting most."""
    position = (points - points.min(axis=0)) / max(float(np.max(np.ptp(points, axis=0))), 1e-300)
    weight = 1.0 - 0.7 * position[:, 0] + 0.1 * position[:, 1]
    direction = np.array([0.5, 1.0, 0.7])[: points.shape[1]]
    return -1.0 if float(weight @ (shape @ direction)) < 0.0 else 1.0
