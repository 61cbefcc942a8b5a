# SPDX-License-Identifier: MIT
"""Fields on a body in the plane or in space: designs, selected elements, stress, shape functions.

Each picture is a page of panels, and each panel a canvas with the body.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgba
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from ..design import density_field
from ..fem import Domain, GatheredMesh, surface_of
from ..parallel import announce, on_every_rank
from ..part import Solid
from ..postprocessing import StressEnvelope
from ..reduction import FlexibleBody, ReducedBody
from . import style
from .canvas import canvas_class
from .drawn_mesh import DrawnMesh, gathered_mesh

if TYPE_CHECKING:
    import pyvista

_SHADES = ScalarMappable(Normalize(0.0, 1.0), "gray_r")


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

        def draw(canvas: Any, panel: int) -> None:
            level = fields[panel](mesh.points)
            for cells, value in zip(solid_and_void, (0.5, -0.5), strict=True):
                level[np.unique(mesh.cells[cells])] = value
            grid = mesh.grid()
            grid.point_data["level"] = level
            material = grid.clip_scalar(scalars="level", value=0.0, invert=False)
            if material.n_cells:
                canvas.add_surface(surface_of(material).triangulate())
    else:
        densities = [domain.on_rank_0(density) for density in designs.values()]

        def draw(canvas: Any, panel: int) -> None:
            density = densities[panel]
            move = canvas.add_cells(mesh, np.ones(len(density), dtype=bool))
            move(mesh.points, _SHADES.to_rgba(density))

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

    mesh = gathered_mesh(domain)

    def draw(canvas: Any, panel: int) -> None:
        density, selected = panels[panel]
        colors = _SHADES.to_rgba(0.75 * density)
        colors[selected] += style.PICTURES.selected * (to_rgba(style.ORANGE) - colors[selected])
        canvas.add_cells(mesh, np.ones(len(density), dtype=bool))(mesh.points, colors)

    return _write_page(path, mesh, list(pairs), draw, title)


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
    top = float(np.percentile(solid_values, style.PICTURES.stress_range)) * factor or 1.0
    colors = ScalarMappable(Normalize(0.0, top), style.GLOW)

    mesh = gathered_mesh(domain)

    def draw(canvas: Any, panel: int) -> None:
        canvas.add_cells(mesh, shown)(mesh.points, colors.to_rgba(values))
        if isinstance(mesh, DrawnMesh):  # in space the cell may be hidden
            largest = int(np.argmax(np.where(shown, values, -np.inf)))
            x, y = mesh.points[mesh.pieces[mesh.parents == largest]].mean(axis=(0, 1))
            look: dict[str, Any] = {"markersize": 11, "mfc": "none", "mec": style.DARK, "mew": 1.4}
            canvas.axes.plot(x, y, "o", **look)

    ring = "" if domain.dimension == 3 else "○ "
    heading = f"{ring}largest: {solid_values.max() * factor:.3g} {unit}{instant}"
    bar = colors, f"von Mises stress [{unit}]"
    return _write_page(path, mesh, [heading], draw, title, color_bar=bar)


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
    shown = body.domain.on_rank_0(reduced.density) >= style.PICTURES.void
    colors = ScalarMappable(Normalize(0.0, 1.0), "viridis")

    def draw(canvas: Any, panel: int) -> None:
        shape = shapes[:, :, panel]
        amount = np.linalg.norm(shape, axis=1)
        largest = float(amount.max()) or 1.0
        extent = float(np.max(np.ptp(mesh.points, axis=0)))
        scale = _sign(mesh.points, shape) * style.PICTURES.mode_size * extent / largest
        move = canvas.add_cells(mesh, shown, at_points=True)
        move(mesh.points + scale * shape, colors.to_rgba(amount / largest))

    bar = colors, "displacement, relative to its maximum"
    page: dict[str, Any] = {"columns": 3, "margin": style.PICTURES.mode_size, "color_bar": bar}
    return _write_page(path, mesh, _mode_names(body, reduced), draw, title, **page)


def draw_solid(solid: Solid, path: Path, title: str) -> Path:
    """Draw the surface of a solid, with the edges of the body and its interfaces."""
    heading = f"volume {1e6 * solid.volume:.4g} cm³"
    if solid.weighs:
        heading += f"   mass {solid.mass:.4g} kg"
    heading += f"   {solid.pieces} piece{'s' * (solid.pieces != 1)}"

    def draw(canvas: Any, panel: int) -> None:
        canvas.add_surface(solid.surface())

    mesh = GatheredMesh.of(solid.body)
    return _write_page(path, mesh, [heading], draw, title, interfaces=True)


def mesh_grid(domain: Domain, fields: Mapping[str, ArrayLike]) -> pyvista.UnstructuredGrid | None:
    """A body with values on its cells as a grid of PyVista, for interactive views and exports.

    Args:
        domain: The body.
        fields: Values of this rank's cells by name of the field, shape (cells, ...).

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
    """Write a page with a body below each heading, drawn by ``draw_panel(canvas, panel)``.

    The ``margin`` around the body is relative to its extent.
    """
    canvas_of_body = canvas_class(mesh.domain.dimension)
    in_the_plane = mesh.domain.dimension == 2

    def draw(file: Path) -> None:
        width = style.PICTURES.width if columns == 1 else style.PICTURES.modes_width
        points = canvas_of_body.project(mesh.points)
        with style.page(file, headings, title=title, width=width, columns=columns) as panels:
            for panel, axes in enumerate(panels):
                canvas: Any = canvas_of_body(axes, points, margin)
                canvas.add_outline(mesh, style.GRAY)
                draw_panel(canvas, panel)
                if interfaces:
                    canvas.add_interfaces(mesh, style.accents(mesh.interfaces), 4.0)
                canvas.refresh()
                canvas.close()
            if color_bar is not None:
                style.add_color_bar(panels, *color_bar)
            if interfaces:
                shades = {"void": "white", "solid": "black"} if in_the_plane else {}
                names = {**shades, **style.accents(mesh.interfaces)}
                style.add_legend(panels[-1], names, style.extent(mesh.points))

    return style.written(mesh.domain.comm, path, draw)


def _mode_names(body: FlexibleBody, reduced: ReducedBody) -> list[str]:
    """A heading for each shape function."""
    names, d = [], body.domain.dimension
    for interface, motions in body.reduction.motions.items():
        for motion in motions:
            words = f"displacement of {interface!r} along {_direction(motion[:d])}"
            if np.any(motion[d:]):
                about = f" about {_direction(motion[d:])}" if d == 3 else ""
                words = f"rotation of {interface!r}{about}"
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
