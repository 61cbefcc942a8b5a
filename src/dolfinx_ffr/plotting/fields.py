# SPDX-License-Identifier: MIT
"""Fields on a body: designs, selected elements, stress, shape functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array, Mask
from ..fem import Domain
from ..parallel import announce, on_every_rank
from ..postprocessing import StressEnvelope
from ..reduction import FlexibleBody, ReducedBody
from . import style
from .in_space import designs_in_space, modes_in_space, stress_in_space
from .mechanism_view import VOID
from .scene import DrawnMesh, gathered_mesh

if TYPE_CHECKING:
    import pyvista

#: Largest displacement shown, relative to the body's extent
_SHOWN = 0.07
#: Share of the solid cells whose stress the colours tell apart; the few above are at the end
_TOLD_APART = 99.7


def plot_design(
    domain: Domain, x: ArrayLike | Mapping[str, ArrayLike], path: str | Path, *, title: str = ""
) -> Path:
    """Draw one design, or several under each other: solid is black, void is white.

    One sees the density of each cell in shades of gray, the outline of the body, its rigid
    interfaces in colour, and a measure. The scale is the same along both axes.

    The ``domain`` has the mesh and the interfaces of the body; ``x`` is one density in [0, 1] for
    each cell owned by this rank, shape (cells,), or several designs by title. The file ``path``
    gets a ``title``.

    Raises:
        ValueError: If a density is not usable.
    """
    path = style.writable(path, title)
    validation.instance("plot_design: domain", domain, Domain, "a Domain")
    announce(domain.comm, "the drawing of a body")
    given = x if isinstance(x, Mapping) else {"": x}
    designs = {
        name: domain.check_density(density, f"design {name!r}" if name else "x")
        for name, density in validation.by_name("plot_design: x", given, "densities").items()
    }
    if not designs:
        raise ValueError("plot_design: no design given")
    if domain.dimension == 3:
        return designs_in_space(domain, designs, path, title)
    drawn = DrawnMesh.of(domain)
    shades = {name: _gray(drawn, density) for name, density in designs.items()}

    def fill(figure: Figure, panels: list[Axes], inches: float) -> None:
        for axes, colors in zip(panels, shades.values(), strict=True):
            _draw_body(axes, drawn, facecolors=colors[drawn.parents])
            for ends, color in zip(drawn.interfaces.values(), cycle(style.ACCENTS), strict=False):
                _draw_lines(axes, drawn.points[ends], color, 4.0)
        _draw_legend(figure, drawn, inches)

    return _page(path, drawn, list(shades), fill, title, width=10.4, foot=0.75)


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

    Raises:
        ValueError: If a design does not fit the domain.
    """
    path = style.writable(path, title)
    validation.instance("plot_gradient_elements: domain", domain, Domain, "a Domain")
    what, needed = "plot_gradient_elements: selections", "a design and a mask over its cells"
    given = validation.by_name(what, selections, needed)
    if not given:
        raise ValueError(f"{what}: no design given")
    with on_every_rank(domain.comm, "plot_gradient_elements"):
        pairs = {n: validation.listed(f"{what}: {n!r}", v, needed) for n, v in given.items()}
        for name, pair in pairs.items():
            if len(pair) != 2 or np.shape(pair[1]) != (domain.n_cells,):
                raise ValueError(
                    f"{what}: {name!r} must be {needed}, one value of each for each of the "
                    f"{domain.n_cells} cells owned by rank {domain.comm.rank}"
                )
    drawn, shades = DrawnMesh.of(domain), {}
    for name, (x, selected) in pairs.items():
        shades[name] = _gray(drawn, 0.75 * domain.check_density(x, name))
        chosen = domain.on_rank_0(np.asarray(selected, dtype=bool))
        shades[name][chosen] = 0.55 * shades[name][chosen] + 0.45 * np.array(to_rgb(style.ORANGE))

    def fill(figure: Figure, panels: list[Axes], inches: float) -> None:
        for axes, colors in zip(panels, shades.values(), strict=True):
            _draw_body(axes, drawn, facecolors=colors[drawn.parents])

    return _page(path, drawn, list(shades), fill, title, width=9.6)


def plot_stress(
    domain: Domain,
    stress: StressEnvelope | ArrayLike,
    path: str | Path,
    *,
    solid: ArrayLike | None = None,
    title: str = "",
) -> Path:
    """Draw the von Mises stress in the undeformed body.

    One sees the stress of each cell in colour, with void left out, the outline of the body, its
    rigid interfaces, and a ring where the stress is largest. The colours end where 0.3 % of the
    cells have a larger stress, so that a single corner does not hide all the rest.

    Args:
        domain: Mesh and interfaces of the body.
        stress: A worst case from `worst_stress`, or the stress of each cell owned by this rank,
            shape (cells,) [Pa].
        solid: Cells that are drawn, shape (cells,); by default those of the worst case, or all.
        path: File to write.
        title: Heading.

    Raises:
        ValueError: If an array does not have one finite value a cell, or no cell is solid.
    """
    path = style.writable(path, title)
    validation.instance("plot_stress: domain", domain, Domain, "a Domain")
    note = ""
    if isinstance(stress, StressEnvelope):
        note = f" at t = {stress.largest_time:.3f} s"
        solid = stress.solid if solid is None else solid
        stress = stress.stress
    with on_every_rank(domain.comm, "plot_stress"):
        own = validation.numbers("plot_stress: stress", stress)
        chosen = np.asarray(np.ones(domain.n_cells) if solid is None else solid, dtype=bool)
        for name, array in (("stress", own), ("solid", chosen)):
            if array.shape != (domain.n_cells,) or not np.all(np.isfinite(array)):
                raise ValueError(f"plot_stress: {name} must have one finite value for each cell")
    if not any(domain.comm.allgather(bool(np.any(chosen)))):
        raise ValueError("plot_stress: no cell is solid, there is nothing to draw")
    if domain.dimension == 3:
        return stress_in_space(domain, own, chosen, path, title, note)
    drawn = DrawnMesh.of(domain)
    values, chosen = domain.on_rank_0(own), domain.on_rank_0(chosen)

    def fill(figure: Figure, panels: list[Axes], inches: float) -> None:
        (axes,) = panels
        largest = int(np.argmax(np.where(chosen, values, -np.inf)))
        unit, factor = style.prefixed(float(values[largest]), "Pa")
        top = float(np.percentile(values[chosen], _TOLD_APART)) * factor
        norm = Normalize(0.0, top if top > 0.0 else 1.0)
        shown, array = chosen[drawn.parents], (values * factor)[drawn.parents]
        _draw_body(axes, drawn, shown=shown, array=array, cmap=style.GLOW, norm=norm)
        for ends in drawn.interfaces.values():
            _draw_lines(axes, drawn.points[ends], style.DARK, 2.5)
        at = drawn.points[drawn.pieces[drawn.parents == largest]].mean(axis=(0, 1))
        axes.plot(*at, "o", markersize=11, mfc="none", mec=style.DARK, mew=1.4)
        found = f"○ largest: {values[largest] * factor:.3g} {unit}{note}"
        for text, below, size in ((title, 0.28, 11.5), (found, 0.58, 10)):
            y = 1.0 - below / figure.get_figheight()
            figure.text(0.022, y, text, va="center", fontsize=size)
        extend = "max" if values[largest] * factor > top else "neither"
        label, colors = f"von Mises stress [{unit}]", ScalarMappable(norm, style.GLOW)
        style.color_bar(figure, colors, label, (0.62, 0.98, 0.5), extend=extend)

    return _page(path, drawn, [""], fill, margin=0.02, head=0.85)


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
    names = _names(body, reduced)
    if body.domain.dimension == 3:
        return modes_in_space(body, reduced, names, path, title)
    drawn = DrawnMesh.of(body.domain)
    shapes = drawn.displacements(reduced.basis.shapes)
    shown = body.domain.on_rank_0(reduced.density)[drawn.parents] >= VOID

    low, high = body.domain.bounding_box
    size = high - low
    colors = ScalarMappable(Normalize(0.0, 1.0), "viridis")

    def fill(figure: Figure, panels: list[Axes], inches: float) -> None:
        for axes, field in zip(panels, np.moveaxis(shapes, 2, 0), strict=True):
            amount = np.linalg.norm(field, axis=1)
            largest = float(amount.max()) or 1.0
            scale = _sign(drawn.points, field) * _SHOWN * float(np.max(size)) / largest
            how: dict[str, Any] = {"cmap": colors.cmap, "norm": colors.norm}
            how["array"] = (amount / largest)[drawn.pieces].mean(axis=1)
            moved = drawn.points + scale * field
            _draw_body(axes, drawn, points=moved, shown=shown, outline=style.LIGHT, **how)
        label = "displacement, relative to its maximum"
        style.color_bar(figure, colors, label, (0.365, 0.635, 0.82 if title else 0.47))

    across, head = 3 if size[0] > 2.0 * size[1] else 4, 1.15 if title else 0.8
    layout: dict[str, Any] = {"across": across, "margin": _SHOWN + 0.02, "head": head}
    return _page(path, drawn, names, fill, title, width=12.0, **layout)


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
    given = validation.by_name("mesh_grid: fields", fields, "values of the cells")
    drawn = gathered_mesh(domain)
    with on_every_rank(domain.comm, "mesh_grid"):
        arrays = {name: validation.numbers(f"mesh_grid: {name!r}", v) for name, v in given.items()}
        for name, array in arrays.items():
            if array.shape[:1] != (domain.n_cells,):
                here = f"on rank {domain.comm.rank} it has the shape {array.shape}"
                raise ValueError(
                    f"mesh_grid: {name!r} must have one value for each cell owned by the rank; "
                    f"{here} for {domain.n_cells} cells"
                )
    values = {name: domain.on_rank_0(array) for name, array in arrays.items()}
    if domain.comm.rank > 0:
        return None
    grid = drawn.grid()
    for name, field in values.items():
        grid.cell_data[name] = field[drawn.parents] if isinstance(drawn, DrawnMesh) else field
    return grid


def _page(
    path: Path,
    drawn: DrawnMesh,
    headings: Sequence[str],
    fill: Callable[[Figure, list[Axes], float], None],
    title: str = "",
    *,
    across: int = 1,
    width: float = 9.0,
    margin: float = 0.0,
    head: float | None = None,
    foot: float = 0.1,
) -> Path:
    """Write a page that is filled, given the axes below each heading, and the inches of a metre.

    A metre has the same length everywhere; the margin is a share of the body's extent, all other
    lengths are inches.
    """

    def draw(file: Path) -> None:
        low, size = drawn.points.min(axis=0), np.ptp(drawn.points, axis=0)
        around = margin * float(np.max(size))
        low, size = low - around, size + 2.0 * around
        wide = width / across
        inches = (wide - 0.4) / max(size[0], 0.8 * size[1])
        row = inches * size[1] + (0.42 if any(headings) else 0.1)
        top = (0.55 if title else 0.15) if head is None else head
        height = top + row * -(-len(headings) // across) + foot
        with style.styled_figure(width, height, file) as figure:
            if title:
                figure.text(0.5, 1.0 - 0.3 / height, title, ha="center", va="center", fontsize=13)
            panels = []
            for k, heading in enumerate(headings):
                i, j = divmod(k, across)
                left = (j + 0.5) * wide - 0.5 * inches * size[0]
                axes = style.axes_at(figure, left, height - top - (i + 1) * row, *(inches * size))
                axes.set_title(heading, **({"loc": "left"} if across == 1 else {"fontsize": 10}))
                axes.set_xlim(low[0], low[0] + size[0])
                axes.set_ylim(low[1], low[1] + size[1])
                axes.set_axis_off()
                panels.append(axes)
            fill(figure, panels, inches)

    return style.written(drawn.domain.comm, path, draw)


def _draw_body(
    axes: Axes,
    drawn: DrawnMesh,
    *,
    points: Array | None = None,
    shown: Mask | None = None,
    outline: str = style.GRAY,
    **colors: Any,
) -> None:
    """Draw the pieces that are shown, with colours of each, and the undeformed outline."""
    pieces = (drawn.points if points is None else points)[drawn.pieces]
    if shown is not None:
        pieces, colors["array"] = pieces[shown], colors["array"][shown]
    _draw_lines(axes, drawn.points[drawn.outline], outline, 1.0, above=points is None)
    axes.add_collection(PolyCollection(pieces, edgecolors="face", linewidths=0.4, **colors))


def _draw_lines(axes: Axes, ends: Array, color: str, width: float, *, above: bool = True) -> None:
    """Draw straight lines, shape (lines, 2, 2), above or below the cells."""
    how: dict[str, Any] = {"clip_on": False, "zorder": 2.0 if above else 0.5}
    axes.add_collection(LineCollection(ends, colors=color, linewidths=width, **how))


def _draw_legend(figure: Figure, drawn: DrawnMesh, inches: float) -> None:
    """Draw shades of gray, interfaces and a measure in one line below, in inches."""
    width, axes = figure.get_figwidth(), style.line_of_inches(figure, 0.15)
    text = {"va": "center", "fontsize": 11}
    axes.text(0.0, 0.0, "void", **text)
    box = (0.55, 1.95, -0.08, 0.08)
    axes.imshow(np.linspace(0.0, 1.0, 40)[None], cmap="gray_r", extent=box, aspect="auto")
    axes.plot(
        np.take(box, [0, 1, 1, 0, 0]), np.take(box, [2, 2, 3, 3, 2]), color=style.GRAY, lw=1.0
    )
    axes.text(2.05, 0.0, "solid", **text)
    style.name_accents(axes, drawn.interfaces, (3.0, 0.0), 11)
    measure = style.nice_number(0.3 * float(np.ptp(drawn.points[:, 0])))
    ends = width - 0.4 - np.array([measure * inches, 0.0])
    axes.plot(ends, [-0.06, -0.06], "|-", color=style.DARK, linewidth=1.5, markersize=9.0, mew=1.5)
    length = f"{measure:g} m" if measure >= 1.0 else f"{1e3 * measure:g} mm"
    axes.text(ends.mean(), 0.1, length, ha="center", **text)


def _gray(drawn: DrawnMesh, density: Array) -> Array:
    """Colours from white (0) to black (1) on rank 0, shape (cells, 3)."""
    return np.repeat(1.0 - drawn.domain.on_rank_0(density)[:, None], 3, axis=1)


def _names(body: FlexibleBody, reduced: ReducedBody) -> list[str]:
    """A title for each shape function."""
    names = []
    for interface, motions in body.reduction.motions.items():
        if body.domain.dimension == 3:
            for motion in motions:
                turns = np.any(motion[3:])
                kind, word = ("rotation", "about") if turns else ("displacement", "along")
                axis = _direction(motion[3:] if turns else motion[:3])
                names.append(f"static: {kind} of {interface!r} {word} {axis}")
            continue
        for x, y, angle in motions:
            if angle:
                kind = "rotation"
            elif abs(y) < 1e-9:
                kind = "x displacement"
            elif abs(x) < 1e-9:
                kind = "y displacement"
            else:
                kind = "displacement along the chord"
            names.append(f"static: {kind} of {interface!r}")
    frequencies = reduced.basis.frequencies
    return names + [f"normal {i}: {f:.4g} Hz" for i, f in enumerate(frequencies, 1)]


def _direction(vector: Array) -> str:
    """An axis by its name, or the components of a direction."""
    k = int(np.argmax(np.abs(vector)))
    if abs(vector[k]) > (1.0 - 1e-9) * np.linalg.norm(vector):
        return "xyz"[k]
    return "(" + ", ".join(f"{x:.2f}" for x in vector) + ")"


def _sign(points: Array, field: Array) -> float:
    """+1 or -1 so that the mode moves up, its left part counting most."""
    position = (points - points.min(axis=0)) / max(float(np.max(np.ptp(points, axis=0))), 1e-300)
    weight = 1.0 - 0.7 * position[:, 0] + 0.1 * position[:, 1]
    return -1.0 if float(weight @ (field[:, 1] + 0.5 * field[:, 0])) < 0.0 else 1.0
