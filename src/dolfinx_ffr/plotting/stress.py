# SPDX-License-Identifier: MIT
"""Pictures of the stress in a body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from numpy.typing import ArrayLike, NDArray

from ..domain import Domain
from ..stress import StressEnvelope
from .drawn_mesh import DrawnMesh
from .style import DARK, GLOW, GRAY, prefixed, save, styled_figure, writable, written

__all__ = ["plot_stress"]

Array = NDArray[np.float64]

#: share of the solid cells whose stress the colours tell apart; the few above are at the end
_TOLD_APART = 99.7


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
        domain: mesh and interfaces of the body.
        stress: a worst case from `worst_stress`, or the stress of each cell owned by this rank,
            shape (cells,) [Pa].
        path: file to write, .png, .pdf or .svg.
        solid: cells that are drawn, shape (cells,); by default those of the worst case, or all.
        title: heading.

    Returns:
        The path. The function is collective; rank 0 writes.

    Raises:
        ValueError: on every rank, if an array does not have one finite value a cell, no cell is
            solid, or the kind of file is not known.
    """
    path = writable(path, (".png", ".pdf", ".svg"))
    note = ""
    if isinstance(stress, StressEnvelope):
        note = f" at t = {stress.largest_time:.3f} s"
        solid = stress.solid if solid is None else solid
        stress = stress.stress
    values = np.asarray(stress, dtype=np.float64)
    chosen = np.ones(domain.n_cells, dtype=bool) if solid is None else np.asarray(solid, dtype=bool)
    for name, array in (("stress", values), ("solid", chosen)):
        good = array.shape == (domain.n_cells,) and bool(np.all(np.isfinite(array)))
        if not all(domain.comm.allgather(good)):
            raise ValueError(f"plot_stress: {name} must have one finite value for each cell")
    if not any(domain.comm.allgather(bool(np.any(chosen)))):
        raise ValueError("plot_stress: no cell is solid, there is nothing to draw")
    drawn = DrawnMesh.of(domain)
    values, chosen = drawn.cell_values(values), drawn.cell_values(chosen)
    return written(domain.comm, path, lambda file: _draw(drawn, values, chosen, file, title, note))


def _draw(
    drawn: DrawnMesh, values: Array, solid: NDArray[np.bool_], path: Path, title: str, note: str
) -> None:
    low, size = drawn.points.min(axis=0), np.ptp(drawn.points, axis=0)
    margin = 0.02 * float(np.max(size))
    width, head = 9.0, 0.85
    tall = float(np.clip((width - 0.2) * (size[1] + 2 * margin) / (size[0] + 2 * margin), 0.6, 8))
    height = head + tall + 0.1
    largest = int(np.argmax(np.where(solid, values, -np.inf)))
    unit, factor = prefixed(float(values[largest]), "Pa")
    top = float(np.percentile(values[solid], _TOLD_APART)) * factor
    norm = Normalize(0.0, top if top > 0.0 else 1.0)
    shown = solid[drawn.parents]
    with styled_figure(width, height) as figure:
        axes = figure.add_axes((0.1 / width, 0.1 / height, (width - 0.2) / width, tall / height))
        axes.add_collection(
            PolyCollection(
                drawn.points[drawn.pieces][shown],
                array=(values * factor)[drawn.parents][shown],
                cmap=GLOW,
                norm=norm,
                edgecolors="face",
                linewidths=0.4,
            )
        )
        axes.add_collection(
            LineCollection(drawn.points[drawn.outline], colors=GRAY, linewidths=0.9)
        )
        for ends in drawn.interfaces.values():
            axes.add_collection(
                LineCollection(
                    drawn.points[ends], colors=DARK, linewidths=2.5, capstyle="projecting"
                )
            )
        at = drawn.points[drawn.pieces[drawn.parents == largest]].mean(axis=(0, 1))
        axes.plot(*at, "o", markersize=11, markerfacecolor="none", markeredgecolor=DARK, mew=1.4)
        axes.set_xlim(low[0] - margin, low[0] + size[0] + margin)
        axes.set_ylim(low[1] - margin, low[1] + size[1] + margin)
        axes.set_aspect("equal")
        axes.set_axis_off()
        if title:
            figure.text(0.2 / width, 1.0 - 0.28 / height, title, va="center", fontsize=11.5)
        figure.text(
            0.2 / width,
            1.0 - 0.58 / height,
            f"○ largest: {values[largest] * factor:.3g} {unit}{note}",
            va="center",
            fontsize=10,
        )
        bar = figure.add_axes((1.0 - 3.4 / width, 1.0 - 0.5 / height, 3.1 / width, 0.13 / height))
        figure.colorbar(
            ScalarMappable(norm, GLOW),
            cax=bar,
            orientation="horizontal",
            extend="max" if values[largest] * factor > top else "neither",
        )
        bar.set_title(f"von Mises stress [{unit}]", fontsize=9, pad=4.0, color=DARK)
        bar.tick_params(labelsize=8, length=2.5, pad=2.0)
        save(figure, path)
