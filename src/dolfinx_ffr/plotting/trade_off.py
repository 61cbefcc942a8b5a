# SPDX-License-Identifier: MIT
"""What designs for one motion are worth in the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from .. import validation
from .style import DARK, GLOW, KINDS, LIGHT, save, styled_figure, writable, written

__all__ = ["plot_trade_off"]

Array = NDArray[np.float64]

#: Excess over the best design from which on a field has the last colour
WORST = 1.0


def plot_trade_off(
    psi: Mapping[str, Mapping[str, float]],
    path: str | Path,
    *,
    images: Mapping[str, ArrayLike] | None = None,
    title: str = "",
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Draw a table of designs and motions.

    Each number is psi of a design in a motion relative to that of the design which is best in this
    motion; the last column is the largest of the row.

    Args:
        psi: By name of the design, values by name of the motion, infinite where it cannot be moved;
            all designs have the same motions.
        path: File to write, .png, .pdf or .svg.
        images: Pictures of the designs by name, shape (rows, columns), 1 for solid and 0 for void,
            drawn beside their rows.
        title: Heading.
        comm: Ranks that call this together; rank 0 writes.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: On every rank, if designs have other motions than the first, a value is not
            positive, an image is of another design, or the kind of file is not known.
    """
    path = writable(path, KINDS, title)
    what = "plot_trade_off"
    rows = {
        name: validation.by_name(f"{what}: {name!r}", values, "values of psi")
        for name, values in validation.by_name(what, psi, "values by motion").items()
    }
    motions = list(next(iter(rows.values()), {}))
    if not motions:
        raise ValueError(f"{what}: give values of at least one design in one motion")
    for name, values in rows.items():
        if list(values) != motions:
            raise ValueError(
                f"{what}: {name!r} has values of {list(values)}, and the first design of {motions}"
            )
        for motion, value in values.items():
            if not (validation.is_number(value) and value > 0.0):
                raise ValueError(
                    f"{what}: psi of {name!r} in {motion!r} must be positive, but it is {value!r}"
                )
    table = np.array([[values[motion] for motion in motions] for values in rows.values()])
    best = table.min(axis=0)
    table /= np.where(np.isfinite(best), best, 1.0)
    table = np.column_stack([table, table.max(axis=1)])
    pictures = {
        name: validation.real_array(
            f"{what}: image of {name!r}", image, (None, None), expected="rows and columns"
        )
        for name, image in validation.by_name(f"{what}: images", images or {}, "images").items()
    }
    if unknown := [name for name in pictures if name not in rows]:
        raise ValueError(f"{what}: an image of {unknown[0]!r}, but the designs are {list(rows)}")

    def draw(file: Path) -> None:
        # in inches: heading and names of motions, names of designs, their pictures, the table
        head, name_width, image_width, foot = 0.85, 1.35, 2.7 if pictures else 0.0, 0.1
        table_width, row_height = 0.8 * (len(motions) + 1.15), 0.46
        width = name_width + image_width + table_width + 0.15
        height = head + row_height * len(rows) + foot
        with styled_figure(width, height) as figure:
            left = name_width + image_width
            axes = figure.add_axes(
                (
                    left / width,
                    foot / height,
                    table_width / width,
                    row_height * len(rows) / height,
                )
            )
            _fill(axes, table, motions)
            for i, name in enumerate(rows):
                y = height - head - (i + 0.5) * row_height
                figure.text(0.1 / width, y / height, name, ha="left", va="center")
                if name in pictures:
                    bottom = y - 0.44 * row_height
                    size = (image_width - 0.2) / width, 0.88 * row_height / height
                    own = figure.add_axes((name_width / width, bottom / height, *size))
                    own.imshow(
                        1.0 - pictures[name], cmap="gray", vmin=0.0, vmax=1.0, origin="lower"
                    )
                    own.set_xticks([])
                    own.set_yticks([])
                    for spine in own.spines.values():
                        spine.set(color=LIGHT, linewidth=0.6)
            heading = title or "ψ over that of the design which is best in this motion"
            figure.text(0.1 / width, 1.0 - 0.1 / height, heading, va="top", fontsize=11.0)
            save(figure, file)

    return written(comm, path, draw)


def _fill(axes: Axes, table: Array, motions: Sequence[str]) -> None:
    """Draw numbers on coloured fields, the last column apart."""
    places = [*range(len(motions)), len(motions) + 0.15]
    colors = GLOW(0.1 + 0.8 * np.clip((table - 1.0) / WORST, 0.0, 1.0))
    for i, row in enumerate(table):
        for place, value, color in zip(places, row, colors[i], strict=True):
            axes.fill_between([place - 0.48, place + 0.48], i - 0.46, i + 0.46, color=color, lw=0)
            light = float(np.dot(color[:3], (0.299, 0.587, 0.114))) > 0.55
            axes.text(
                place,
                i,
                f"{value:.2f}" if np.isfinite(value) else "–",
                ha="center",
                va="center",
                color=DARK if light else "white",
            )
    axes.set_xlim(-0.5, places[-1] + 0.5)
    axes.set_ylim(len(table) - 0.5, -0.5)
    axes.set_xticks(places, [*(name.replace(", ", ",\n") for name in motions), "largest"])
    axes.set_yticks([])
    axes.tick_params(top=True, bottom=False, labeltop=True, labelbottom=False, length=0, pad=2)
    axes.spines[:].set_visible(False)
