# SPDX-License-Identifier: MIT
"""Pictures of the shape functions of a body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from ..flexible_body import FlexibleBody, ReducedBody
from .drawn_mesh import DrawnMesh
from .mechanism_view import VOID
from .style import LIGHT, save, styled_figure, writable, written

__all__ = ["plot_modes"]

Array = NDArray[np.float64]

#: largest displacement shown, relative to the body's extent
_SHOWN = 0.07


def plot_modes(
    body: FlexibleBody, reduced: ReducedBody, path: str | Path, *, title: str = ""
) -> Path:
    """Draw the shape functions of a body: static modes, then normal modes with their frequencies.

    One sees each mode as the deformed body, coloured by the amount of the displacement relative to
    the largest one of the mode, with the undeformed outline behind. Cells of density below 0.3 are
    left out. The sign of a mode has no meaning; it is chosen so that the picture is always the
    same.

    Args:
        body: the body.
        reduced: its shape functions, from `FlexibleBody.reduce`.
        path: file to write, .png, .pdf or .svg.
        title: heading.

    Returns:
        The path. The function is collective; rank 0 writes.

    Raises:
        ValueError: on every rank, if the kind of file is not known.
    """
    path = writable(path, (".png", ".pdf", ".svg"))
    drawn = DrawnMesh.of(body.domain)
    shapes = drawn.displacements(reduced.basis.shapes)
    shown = drawn.cell_values(reduced.density)[drawn.parents] >= VOID
    names = _names(body, reduced)

    def draw(file: Path) -> None:
        low, size = drawn.points.min(axis=0), np.ptp(drawn.points, axis=0)
        extent = float(np.max(size))
        across = 3 if size[0] > 2.0 * size[1] else 4
        rows = -(-len(names) // across)
        margin = (_SHOWN + 0.02) * extent
        wide = 12.0 / across
        tall = float(
            np.clip((wide - 0.3) * (size[1] + 2 * margin) / (size[0] + 2 * margin), 0.6, 6)
        )
        head = 1.15 if title else 0.8
        height = head + rows * (tall + 0.35)
        with styled_figure(12.0, height) as figure:
            for k, name in enumerate(names):
                row, column = divmod(k, across)
                axes = figure.add_axes(
                    (
                        (column * wide + 0.15) / 12.0,
                        1.0 - (head + (row + 1) * (tall + 0.35) - 0.05) / height,
                        (wide - 0.3) / 12.0,
                        tall / height,
                    )
                )
                field = shapes[:, :, k]
                amount = np.linalg.norm(field, axis=1)
                largest = float(amount.max()) or 1.0
                sign = _sign(drawn.points, field)
                points = drawn.points + sign * _SHOWN * extent / largest * field
                axes.add_collection(
                    LineCollection(drawn.points[drawn.outline], colors=LIGHT, linewidths=1.0)
                )
                axes.add_collection(
                    PolyCollection(
                        points[drawn.pieces][shown],
                        array=(amount / largest)[drawn.pieces].mean(axis=1)[shown],
                        cmap="viridis",
                        norm=Normalize(0.0, 1.0),
                        edgecolors="face",
                        linewidths=0.4,
                    )
                )
                axes.set_xlim(low[0] - margin, low[0] + size[0] + margin)
                axes.set_ylim(low[1] - margin, low[1] + size[1] + margin)
                axes.set_aspect("equal")
                axes.set_axis_off()
                axes.set_title(name, fontsize=10, pad=3.0)
            if title:
                figure.text(0.5, 1.0 - 0.3 / height, title, ha="center", va="center", fontsize=13)
            bar = figure.add_axes(
                (0.5 - 1.6 / 12.0, 1.0 - (head - 0.32) / height, 3.2 / 12.0, 0.12 / height)
            )
            figure.colorbar(
                ScalarMappable(Normalize(0.0, 1.0), "viridis"), cax=bar, orientation="horizontal"
            )
            bar.set_title("displacement, relative to its maximum", fontsize=9, pad=3.0)
            bar.tick_params(labelsize=8, length=2.5, pad=2.0)
            save(figure, file)

    return written(body.domain.comm, path, draw)


def _names(body: FlexibleBody, reduced: ReducedBody) -> list[str]:
    """Return a title for each shape function."""
    names = []
    for interface, motions in body.reduction.motions.items():
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


def _sign(points: Array, field: Array) -> float:
    """Return +1 or -1 so that the mode moves up, its left part counting most."""
    position = (points - points.min(axis=0)) / max(float(np.max(np.ptp(points, axis=0))), 1e-300)
    weight = 1.0 - 0.7 * position[:, 0] + 0.1 * position[:, 1]
    return -1.0 if float(weight @ (field[:, 1] + 0.5 * field[:, 0])) < 0.0 else 1.0
