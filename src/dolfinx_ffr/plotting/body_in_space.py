# SPDX-License-Identifier: MIT
"""Designs, stress and shape functions of a body in space."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from ..design import density_field
from ..fem import Domain, GatheredMesh, surface_of
from ..part import Solid
from ..reduction import FlexibleBody, ReducedBody
from .mechanism_view import VOID
from .rendering import Rendering, rendering
from .style import (
    ACCENTS,
    DARK,
    GLOW,
    GRAY,
    color_bar,
    prefixed,
    save,
    styled_figure,
    written,
)

__all__ = ["designs_in_space", "modes_in_space", "solid_in_space", "stress_in_space"]

Array = NDArray[np.float64]

_STEEL = "#b9c0c8"
#: Largest displacement shown, relative to the body's extent
_SHOWN = 0.1


def designs_in_space(domain: Domain, designs: Mapping[str, Array], path: Path, title: str) -> Path:
    """Draw designs under each other as solids, with the edges of the body and its interfaces.

    Args:
        domain: The body.
        designs: Densities of this rank's cells by heading.
        path: File to write.
        title: Heading of them all.
    """
    mesh = GatheredMesh.of(domain)
    fields = {name: density_field(domain, x) for name, x in designs.items()}
    passive = [mesh.cell_values(cells) for cells in (domain.solid_cells, domain.void_cells)]

    def draw(file: Path) -> None:
        grid = mesh.grid()

        def solid(field: Callable[[Array], Array]) -> Any:
            level = field(mesh.points)
            for cells, value in zip(passive, (0.5, -0.5), strict=True):
                level[np.unique(mesh.cells[cells])] = value
            grid.point_data["level"] = level
            return grid.clip_scalar(scalars="level", value=0.0, invert=False)

        def show(view: Rendering, name: str) -> None:
            material = solid(fields[name])
            if material.n_cells:
                view.add(surface_of(material).triangulate(), color=_STEEL)
            _add_body(view, grid)
            _add_interfaces(view, mesh, grid)

        _page(file, mesh, list(designs), title, show, legend=True)

    return written(domain.comm, path, draw)


def solid_in_space(solid: Solid, path: Path, title: str) -> Path:
    """Draw the surface of a solid, with the edges of the body and its interfaces.

    Args:
        solid: The solid.
        path: File to write.
        title: Heading.
    """
    mesh = GatheredMesh.of(solid.body)
    heading = f"volume {1e6 * solid.volume:.4g} cm³"
    if getattr(solid.material, "density", None) is not None:
        heading += f"   mass {solid.mass:.4g} kg"
    heading += f"   {solid.pieces} piece{'s' * (solid.pieces != 1)}"

    def draw(file: Path) -> None:
        grid = mesh.grid()

        def show(view: Rendering, name: str) -> None:
            view.add(solid.surface(), color=_STEEL)
            _add_body(view, grid)
            _add_interfaces(view, mesh, grid)

        _page(file, mesh, [heading], title, show, legend=True)

    return written(solid.body.comm, path, draw)


def stress_in_space(
    domain: Domain, stress: Array, solid: NDArray[np.bool_], path: Path, title: str, note: str
) -> Path:
    """Draw the stress of the solid cells in colour.

    Args:
        domain: The body.
        stress: Of this rank's cells, shape (cells,) [Pa].
        solid: Cells that are drawn, shape (cells,).
        path: File to write.
        title: Heading.
        note: When it is largest.
    """
    mesh = GatheredMesh.of(domain)
    values, chosen = mesh.cell_values(stress), mesh.cell_values(solid)

    def draw(file: Path) -> None:
        grid = mesh.grid()
        largest = float(values[chosen].max())
        unit, factor = prefixed(largest, "Pa")
        top = float(np.percentile(values[chosen], 99.7)) * factor or 1.0
        grid.cell_data["stress"] = values * factor
        surface = surface_of(grid.extract_cells(np.flatnonzero(chosen)))

        def show(view: Rendering, name: str) -> None:
            view.add(surface, scalars="stress", cmap=GLOW, clim=(0.0, top))
            _add_body(view, grid)

        heading = f"{title}   largest: {largest * factor:.3g} {unit}{note}"
        bar = ScalarMappable(Normalize(0.0, top), GLOW), f"von Mises stress [{unit}]"
        _page(file, mesh, [""], heading, show, bar=bar)

    return written(domain.comm, path, draw)


def modes_in_space(
    body: FlexibleBody, reduced: ReducedBody, names: list[str], path: Path, title: str
) -> Path:
    """Draw the shape functions as the deformed body, coloured by the amount of the displacement.

    Args:
        body: The body.
        reduced: Its shape functions.
        names: Of the shape functions.
        path: File to write.
        title: Heading.
    """
    mesh = GatheredMesh.of(body.domain)
    shapes = mesh.displacements(reduced.basis.shapes)
    shown = mesh.cell_values(reduced.density) >= VOID

    def draw(file: Path) -> None:
        grid = mesh.grid()
        surface = surface_of(grid.extract_cells(np.flatnonzero(shown)))
        # extracted cells know of their points, and the surface of those of the extract
        points = np.asarray(grid.extract_cells(np.flatnonzero(shown))["vtkOriginalPointIds"])
        of = points[np.asarray(surface["vtkOriginalPointIds"])]
        size = float(np.max(np.ptp(mesh.points, axis=0)))
        still = mesh.points[of]

        def show(view: Rendering, name: str) -> None:
            field = shapes[of, :, names.index(name)]
            amount = np.linalg.norm(field, axis=1)
            largest = float(amount.max()) or 1.0
            sign = 1.0 if field[np.argmax(amount)] @ np.array([1.0, 1.2, 1.4]) >= 0.0 else -1.0
            moved = surface.copy()
            moved.points = still + sign * _SHOWN * size / largest * field
            moved.point_data["amount"] = amount / largest
            view.add(moved, scalars="amount", cmap="viridis", clim=(0.0, 1.0))
            _add_body(view, grid)

        bar = ScalarMappable(Normalize(0.0, 1.0), "viridis"), "displacement / its maximum"
        _page(file, mesh, names, title, show, across=3, margin=_SHOWN, bar=bar)

    return written(body.domain.comm, path, draw)


# ---------------------------------------------------------------------- parts


def _page(
    file: Path,
    mesh: GatheredMesh,
    headings: list[str],
    title: str,
    show: Callable[[Rendering, str], None],
    *,
    across: int = 1,
    margin: float = 0.0,
    legend: bool = False,
    bar: tuple[ScalarMappable, str] | None = None,
) -> None:
    """Draw a view of the body under each heading."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    around = margin * float(np.max(high - low))
    corners = np.array(np.meshgrid(*np.array([low - around, high + around]).T))
    seen = corners.reshape(3, -1).T
    width = 10.0 if across == 1 else 12.0
    wide = width / across - 0.3
    tall = wide * Rendering.shape_of(seen)
    head = (0.5 if title else 0.15) + (0.55 if bar else 0.0)
    row, foot = tall + (0.3 if any(headings) else 0.05), 0.55 if legend else 0.1
    rows = -(-len(headings) // across)
    height = head + rows * row + foot
    with styled_figure(width, height) as figure:
        if title:
            figure.text(0.5, 1.0 - 0.27 / height, title, ha="center", va="center", fontsize=13)
        for k, name in enumerate(headings):
            i, j = divmod(k, across)
            left, bottom = j * width / across + 0.15, height - head - (i + 1) * row
            place = (left / width, bottom / height, wide / width, tall / height)
            axes = figure.add_axes(place)
            axes.set_title(name, fontsize=10)
            with rendering(wide, tall, seen) as view:
                show(view, name)
                view.look()
                view.show(axes)
        if bar is not None:
            below = 0.85 if title else 0.5
            color_bar(figure, bar[0], bar[1], (0.34, 0.66, below))
        if legend:
            _draw_legend(figure, mesh, width, height)
        save(figure, file)


def _draw_legend(figure: Any, mesh: GatheredMesh, width: float, height: float) -> None:
    """Name the interfaces and the extent in one line below."""
    axes = figure.add_axes((0.2 / width, 0.1 / height, 1.0 - 0.4 / width, 0.35 / height))
    axes.set_xlim(0.0, width - 0.4)
    axes.set_ylim(-0.2, 0.2)
    axes.set_axis_off()
    at = 0.1
    for name, color in zip(mesh.interfaces, cycle(ACCENTS), strict=False):
        axes.plot([at, at + 0.3], [0.0, 0.0], color=color, linewidth=5.0, solid_capstyle="butt")
        axes.text(at + 0.4, 0.0, name, va="center", fontsize=10)
        at += 0.8 + 0.09 * len(name)
    sizes = np.ptp(mesh.points, axis=0)
    unit, factor = ("m", 1.0) if sizes.max() >= 1.0 else ("mm", 1e3)
    size = " x ".join(f"{factor * s:.4g}" for s in sizes)
    axes.text(width - 0.4, 0.0, f"{size} {unit}", va="center", ha="right", color=DARK)


def _add_body(view: Rendering, grid: Any) -> None:
    """Draw the edges of the whole body."""
    edges = surface_of(grid).extract_feature_edges(
        feature_angle=40.0, boundary_edges=False, manifold_edges=False, non_manifold_edges=False
    )
    if edges.n_points:
        view.plotter.add_mesh(edges, color=GRAY, line_width=1.5, lighting=False)


def _add_interfaces(view: Rendering, mesh: GatheredMesh, grid: Any) -> None:
    """Draw the interfaces, a little off the body, in colour."""
    surface = surface_of(grid)
    number = np.asarray(surface["vtkOriginalPointIds"])
    for points, color in zip(mesh.interfaces.values(), cycle(ACCENTS), strict=False):
        faces = surface.extract_points(np.flatnonzero(points[number]), adjacent_cells=False)
        if faces.n_cells:
            view.add(view.nearer(faces), color=color)
