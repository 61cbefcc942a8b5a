# SPDX-License-Identifier: MIT
"""Designs, stress and shape functions of a body in space, and solids."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ..arrays import Array, Mask
from ..design import density_field
from ..fem import Domain, GatheredMesh, surface_of
from ..part import Solid
from ..reduction import FlexibleBody, ReducedBody
from . import style
from .mechanism_view import VOID
from .rendering import Rendering, feature_edges

_MATERIAL = "#b9c0c8"
#: Largest displacement shown, relative to the body's extent
_SHOWN = 0.1


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
