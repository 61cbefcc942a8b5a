# SPDX-License-Identifier: MIT
"""A boundary that moves, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from .. import validation
from ..arrays import Array
from ..fem import Domain
from . import style
from .motion_pictures import check_film, write_film
from .part_view import STEEL, outline_of

#: Height of the curve below the part, and of the margins around both [inches]
_CURVE, _MARGIN = 0.75, 0.55


def animate_boundary(
    body: Domain,
    materials: Sequence[BaseGeometry],
    psi: ArrayLike,
    path: str | Path,
    *,
    frames_per_second: float = 5.0,
    title: str = "",
) -> Path:
    """Show how the boundary of a part moves, and psi with it.

    One sees the material of each step in steel blue, with the outline of the body in dashes and the
    boundary of the first step in red. Below, psi relative to that of the first step runs along.

    Args:
        body: That was designed, in the plane.
        materials: What the boundary encloses, of each step, as `BoundaryResult.materials` has it.
        psi: Of each step, shape (steps,).
        path: File to write, .gif, or .mp4 where ffmpeg is installed.
        frames_per_second: Of the film.
        title: Heading.

    Raises:
        ValueError: On every rank, if there are not as many numbers as steps, or a number is out of
            range, or ffmpeg is not there for .mp4.
    """
    path = check_film(path, title)
    validation.instance("animate_boundary: body", body, Domain, "a Domain")
    values = validation.real_array("animate_boundary: psi", psi, (len(materials),))
    rate = validation.number("animate_boundary: frames_per_second", frames_per_second, above=0.0)
    low, high = (corner[:2] for corner in body.bounding_box)

    def draw(file: Path) -> None:
        width = 9.0
        tall = float(np.clip((width - 0.4) * (high - low)[1] / (high - low)[0], 0.8, 6.0))
        height = round(100 * (tall + _CURVE + 3.0 * _MARGIN)) // 2 * 2 / 100
        pictures = []
        for step, material in enumerate(materials):
            with style.styled_figure(width, height, dpi=100.0) as figure:
                axes = style.axes_at(figure, 0.2, _CURVE + 2.0 * _MARGIN, width - 0.4, tall)
                axes.set_aspect("equal")
                axes.set_xlim(low[0], high[0])
                axes.set_ylim(low[1], high[1])
                axes.set_axis_off()
                box = {"facecolor": "none", "edgecolor": style.GRAY, "lw": 0.6, "ls": (0, (4, 3))}
                axes.add_patch(PathPatch(outline_of(shapely.box(*low, *high)), **box))
                own = {"facecolor": STEEL, "edgecolor": style.DARK, "lw": 0.8}
                axes.add_patch(PathPatch(outline_of(material), **own))
                before = {"facecolor": "none", "edgecolor": style.RED, "lw": 0.5, "alpha": 0.7}
                axes.add_patch(PathPatch(outline_of(materials[0]), **before))
                said = f"step {step}: psi {values[step] / values[0]:.4f} of the first one's"
                figure.text(0.02, 1.0 - 0.28 / height, f"{title}   {said}".strip(), fontsize=11)
                _curve(figure, values / values[0], step, width)
                canvas = figure.canvas
                canvas.draw()
                pictures.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        write_film([pictures[0]] * 3 + pictures + [pictures[-1]] * 6, file, rate)

    return style.written(body.comm, path, draw)


def _curve(figure: Figure, values: Array, step: int, width: float) -> None:
    """The history of psi, relative to its start, with a dot at a step."""
    axes = style.axes_at(figure, _MARGIN + 0.2, _MARGIN, width - 0.6 - _MARGIN, _CURVE)
    axes.plot(values, color=style.BLUE, linewidth=1.2)
    axes.plot([step], [values[step]], "o", color=style.RED, markersize=6.0, clip_on=False)
    axes.set_xlim(0.0, max(len(values) - 1.0, 1.0))
    axes.set_xlabel("step of the boundary", labelpad=1.0)
    axes.locator_params(axis="y", nbins=3)
    style.tidy(axes)
