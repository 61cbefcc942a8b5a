# SPDX-License-Identifier: MIT
"""Pictures of approximate gradients: basis functions, selected elements, histories side by side."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from numpy.typing import ArrayLike, NDArray

from ..domain import Domain
from ..rbf import Kernel
from .drawn_mesh import DrawnMesh
from .style import ACCENTS, GRAY, ORANGE, prefixed, save, styled_figure, tidy, writable, written

__all__ = ["plot_gradient_elements", "plot_gradient_histories", "plot_kernel"]

Array = NDArray[np.float64]

_KINDS = (".png", ".pdf", ".svg")


def plot_kernel(
    kernel: Kernel,
    path: str | Path,
    *,
    extent: float,
    title: str = "",
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Draw a radial basis function as a surface over the plane around its knot.

    Args:
        kernel: the function.
        path: file to write, .png, .pdf or .svg.
        extent: half the side of the square that is drawn [m].
        title: heading.
        comm: ranks that call this together; rank 0 writes.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: on every rank, if the extent is not positive or the kind of file is not known.
    """
    path = writable(path, _KINDS)
    if not (np.isfinite(extent) and extent > 0.0):
        raise ValueError(f"plot_kernel: extent = {extent} must be a positive length [m]")

    def draw(file: Path) -> None:
        side = np.linspace(-extent, extent, 101)
        x, y = np.meshgrid(side, side)
        unit, factor = prefixed(extent, "m")
        with styled_figure(6.0, 4.6) as figure:
            axes = figure.add_axes((0.0, 0.02, 0.92, 0.9), projection="3d")
            axes.plot_surface(
                factor * x, factor * y, kernel(np.hypot(x, y)), cmap="cividis", rcount=80, ccount=80
            )
            axes.set_xlabel(f"x [{unit}]")
            axes.set_ylabel(f"y [{unit}]")
            axes.set_title(title or repr(kernel), fontsize=11)
            axes.set_zlabel("g")
            axes.view_init(28, -55)
            save(figure, file)

    return written(comm, path, draw)


def plot_gradient_elements(
    domain: Domain,
    selections: Mapping[str, tuple[ArrayLike, ArrayLike]],
    path: str | Path,
    *,
    title: str = "",
) -> Path:
    """Draw which elements get exact derivatives, over the designs for which they were selected.

    One sees each design in shades of gray, and the selected elements in orange.

    Args:
        domain: the body.
        selections: by heading, a design (cells,) in [0, 1] and which elements are selected
            (cells,), both for the cells owned by this rank.
        path: file to write, .png, .pdf or .svg.
        title: heading of the picture.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: on every rank, if a design does not fit the domain or the kind of file is not
            known.
    """
    path = writable(path, _KINDS)
    drawn = DrawnMesh.of(domain)
    fields = {}
    for name, (x, selected) in selections.items():
        density = domain.check_density(x, name)
        chosen = drawn.cell_values(np.asarray(selected, dtype=bool))
        fields[name] = (drawn.cell_values(density), chosen)

    def draw(file: Path) -> None:
        low, size = drawn.points.min(axis=0), np.ptp(drawn.points, axis=0)
        width = 9.6
        tall = (width - 0.4) * size[1] / size[0]
        row = tall + 0.42
        with styled_figure(width, row * len(fields) + (0.5 if title else 0.1)) as figure:
            height = figure.get_figheight()
            if title:
                figure.text(0.5, 1.0 - 0.25 / height, title, ha="center", va="center", fontsize=13)
            for i, (name, (density, chosen)) in enumerate(fields.items()):
                bottom = (0.06 + row * (len(fields) - 1 - i)) / height
                axes = figure.add_axes((0.2 / width, bottom, 1.0 - 0.4 / width, tall / height))
                colors = np.repeat(1.0 - 0.75 * density[:, None], 3, axis=1)
                colors[chosen] = 0.55 * colors[chosen] + 0.45 * np.array(to_rgb(ORANGE))
                axes.add_collection(
                    PolyCollection(
                        drawn.points[drawn.pieces],
                        facecolors=colors[drawn.parents],
                        edgecolors="face",
                        linewidths=0.3,
                    )
                )
                axes.add_collection(
                    LineCollection(drawn.points[drawn.outline], colors=GRAY, linewidths=1.0)
                )
                axes.set_title(name, loc="left")
                axes.set_aspect("equal")
                axes.set_xlim(low[0], low[0] + size[0])
                axes.set_ylim(low[1], low[1] + size[1])
                axes.set_axis_off()
                axes.title.set_visible(True)
            save(figure, file)

    return written(domain.comm, path, draw)


def plot_gradient_histories(
    histories: Mapping[str, Mapping[str, ArrayLike]],
    path: str | Path,
    *,
    psi_solid: float,
    title: str = "",
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Draw what several gradients of one design problem have led to, over the iterations.

    One sees the objective of all runs together, the number of elements with exact derivatives, and
    the estimated and true errors of approximate gradients.

    Args:
        histories: by name of the run, the history of `optimize`.
        path: file to write, .png, .pdf or .svg.
        psi_solid: objective of the solid body [J s].
        title: heading.
        comm: ranks that call this together; rank 0 writes.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: on every rank, if the kind of file is not known.
    """
    path = writable(path, _KINDS)

    def draw(file: Path) -> None:
        runs = {
            name: {key: np.asarray(v, dtype=np.float64) for key, v in history.items()}
            for name, history in histories.items()
        }
        with styled_figure(12.6, 4.0) as figure:
            panels = figure.subplots(1, 3)
            for (name, run), color, line in zip(
                runs.items(), cycle(ACCENTS), cycle(["-", "--", "-."]), strict=False
            ):
                i = run["iteration"]
                psi = run["psi"] / psi_solid
                panels[0].plot(i, psi, line, color=color, label=f"{name}: {psi[-1]:.3f}")
                panels[1].plot(i, run["gradient_elements"], line, color=color, label=name)
                _draw_errors(panels[2], run, color, name)
            panels[0].set_title("objective ψ / ψ of the solid body", loc="left")
            panels[0].set_yscale("log")
            panels[0].yaxis.set_major_formatter(lambda value, _: f"{value:g}")
            panels[0].yaxis.set_minor_formatter(
                lambda value, _: f"{value:g}" if str(f"{value:e}")[0] in "25" else ""
            )
            panels[1].set_title("elements with exact derivatives", loc="left")
            panels[1].set_ylim(0.0, None)
            panels[2].set_title("relative error of the gradient", loc="left")
            panels[2].set_yscale("log")
            low, high = panels[2].get_ylim()
            panels[2].set_ylim(10.0 ** np.floor(np.log10(low)), 10.0 ** np.ceil(np.log10(high)))
            for axes in panels:
                axes.set_xlabel("iteration")
                tidy(axes)
                if axes.get_legend_handles_labels()[0]:
                    axes.legend(loc="best")
            if title:
                figure.suptitle(title, fontsize=13)
            figure.tight_layout(w_pad=2.0)
            save(figure, file)

    return written(comm, path, draw)


def _draw_errors(axes: Axes, run: Mapping[str, Array], color: str, name: str) -> None:
    """Draw the estimate as a line, true errors as points."""
    i = run["iteration"]
    if np.any(run["gradient_estimate"] > 0.0):
        axes.plot(i, run["gradient_estimate"], color=color, linewidth=1.2, label="estimate")
    for key, marker, label in (
        ("gradient_error", "o", "true"),
        ("band_error", "^", "true, near the boundary"),
    ):
        known = np.isfinite(run[key])
        if np.any(known):
            axes.plot(i[known], run[key][known], marker, color=color, markersize=4.0, label=label)
