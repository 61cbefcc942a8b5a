# SPDX-License-Identifier: MIT
"""Diagrams over iterations and over time."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from ..mechanism import Parameters
from . import style

#: Heading and unit of the panel of each column
_COLUMNS = {
    "psi": ("objective ψ", ""),
    "volume": ("volume, share of the body", ""),
    "frequency": ("first frequency, interfaces held", "Hz"),
    "sharpness": ("steepness of the projection", ""),
    "modes": ("normal modes", ""),
    "mode_error": ("estimated error, modes left out", "%"),
    "step": ("size of the step", ""),
}
#: Prefixes of the columns of load cases and of parameters
_LOAD_CASE, _PARAMETER = "psi of ", "parameter "


def plot_history(
    history: Mapping[str, ArrayLike],
    path: str | Path,
    *,
    psi_solid: float | None = None,
    psi_unit: str = "J s",
    volume_bound: float | None = None,
    parameters: Parameters | None = None,
    title: str = "",
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Draw the history of a design over the iterations.

    Each column has a panel: the objective, with the line of the solid body where it is given; the
    objectives of several load cases, each relative to its value at the start; the parameters of a
    mechanism between their bounds, with their last values and units; the volume with its
    bound, and the share that is neither void nor solid; the first frequency (interfaces held); the
    steepness of the projection; the number of normal modes and the estimated error by the others;
    the size of the steps. The last value stands above each panel.

    Args:
        history: Columns by name, as `read_history` reads them: ``iteration`` and any of
            ``psi`` [J s], ``psi of fast`` and so on, ``parameter radius [m]`` and so on, ``volume``
            [-] and beside it ``gray`` [-], ``frequency`` [Hz], ``sharpness`` [-], ``modes``,
            ``mode_error`` [-], ``step`` (explicit steps of a level set: knot spacings; else the
            largest change, as a share of the bounds).
        psi_solid: Objective of the solid body [J s]; the objective is then drawn relative to it.
        psi_unit: Unit of psi, where it is no compliance.
        volume_bound: Largest volume allowed, in [0, 1].
        parameters: Parameters with their bounds, ``result.problem.parameters``; without them those
            of the history are drawn relative to the largest size of each.
        path: File to write.
        title: Heading.
        comm: Ranks that call this together.
    """
    path = style.writable(path, title)
    for what, bound in (("psi_solid", psi_solid), ("volume_bound", volume_bound)):
        if bound is not None:
            validation.number(f"plot_history: {what}", bound, above=0.0)

    def draw(file: Path) -> None:
        columns = _columns(history)
        panels = [name for name in _COLUMNS if np.isfinite(columns.get(name, [])).any()]
        for prefix in (_PARAMETER, _LOAD_CASE):
            if any(name.startswith(prefix) for name in columns):
                panels.insert(1 if "psi" in panels else 0, prefix)
        if not panels:
            raise ValueError(
                f"plot_history: the history has the columns {sorted(columns)}; it needs a line and "
                f"at least one of {list(_COLUMNS)}"
            )
        count = len(next(iter(columns.values())))
        iteration = columns.get("iteration", np.arange(count, dtype=np.float64))
        across = len(panels) if len(panels) < 4 else 2
        with _diagrams(file, len(panels), across, title, "iteration") as diagrams:
            for axes, name in zip(diagrams, panels, strict=True):
                axes.set_xlim(iteration[0] - 0.5, max(iteration[-1], iteration[0] + 1) + 0.5)
                axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
                if name == _LOAD_CASE:
                    _draw_load_cases(axes, iteration, columns)
                elif name == _PARAMETER:
                    _draw_parameters(axes, iteration, columns, parameters)
                else:
                    _draw_column(axes, name, psi_unit, iteration, columns, psi_solid, volume_bound)

    return style.written(comm, path, draw)


def _columns(history: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Columns of a history as arrays of one length."""
    what = "plot_history"
    by_name = validation.by_name(what, history, "columns")
    columns = {name: validation.numbers(f"{what}: {name!r}", v) for name, v in by_name.items()}
    for name, column in columns.items():
        if column.ndim != 1 or len(column) != len(next(iter(columns.values()))):
            raise ValueError(
                f"{what}: {name!r} must have one number for each iteration, as the other columns, "
                f"but it has the shape {column.shape}"
            )
    return columns


def _draw_load_cases(axes: Axes, iteration: Array, columns: Mapping[str, Array]) -> None:
    """Draw the objective of each load case, relative to its value at the start."""
    names = [name for name in columns if name.startswith(_LOAD_CASE)]
    for name, color in style.accents(names).items():
        relative = columns[name] / (columns[name][0] or 1.0)
        axes.plot(iteration, relative, color=color, label=name.removeprefix(_LOAD_CASE))
    axes.set_ylim(bottom=0.0)
    axes.set_title("ψ of each load case / ψ at the start", loc="left")


def _draw_parameters(
    axes: Axes, iteration: Array, columns: Mapping[str, Array], parameters: Parameters | None
) -> None:
    """Draw parameters as shares of their ranges, or relative to the largest size of each."""
    if parameters is None:
        labels = [name for name in columns if name.startswith(_PARAMETER)]
        values = np.array([columns[label] for label in labels])
        largest = np.max(np.abs(values), axis=1, keepdims=True)
        shares = values / np.where(largest > 0.0, largest, 1.0)
        axes.set_title("parameters / their largest sizes", loc="left")
    else:
        labels = [_PARAMETER + label for label in parameters.labels.values()]
        values = np.array([columns[label] for label in labels])
        shares = parameters.shares(values.T).T
        axes.set_title("parameters between their bounds", loc="left")
        _draw_level(axes, 0.0, style.GRAY, "lower bounds")
        _draw_level(axes, 1.0, style.GRAY, "upper bounds")
    with_legend = len(labels) <= style.PICTURES.most_named
    for label, curve, last, color in zip(labels, shares, values[:, -1], cycle(style.ACCENTS)):
        name, _, unit = label.removeprefix(_PARAMETER).removesuffix("]").partition(" [")
        text = f"{name} {last:.4g} {unit}".rstrip() if with_legend else ""
        axes.plot(iteration, curve, color=color, label=text)
    # room for the legend above the curves
    lines = -(-len(labels) // 2) if with_legend else 0
    axes.set_ylim(min(-0.08, 1.08 * float(np.min(shares))), 1.14 + 0.11 * lines)
    if with_legend:
        axes.legend(ncol=2, loc="upper center")


def _draw_column(
    axes: Axes,
    name: str,
    psi_unit: str,
    iteration: Array,
    columns: Mapping[str, Array],
    psi_solid: float | None,
    volume_bound: float | None,
) -> None:
    """Draw one column of the history, its last value in the upper right corner."""
    heading, unit = _COLUMNS[name]
    values, reference = columns[name], 0.0
    if name == "psi" and psi_solid is not None:
        values, reference = values / psi_solid, 1.0
        heading = "objective ψ / ψ of the solid body"
        _draw_level(axes, 1.0, style.GRAY, "solid body")
    elif unit == "%":
        values = 100.0 * values
    elif unit := psi_unit if name == "psi" else unit:
        unit, factor = style.prefixed(float(np.nanmax(np.abs(values))), unit)
        values = values * factor
    marker = "o" if len(values) <= 60 else ""
    axes.plot(iteration, values, color=style.BLUE, marker=marker, markersize=3.0)
    top = float(np.nanmax(values))
    if name == "step" and 0.0 < np.nanmin(values) < 0.05 * top:
        axes.set_yscale("log")
    else:
        axes.set_ylim(0.0, 1.12 * max(top, reference) or 1.0)
    if name == "volume":
        axes.set_ylim(0.0, 1.08 * max(1.0, top))
        if volume_bound is not None:
            _draw_level(axes, volume_bound, style.RED, "bound")
        if "gray" in columns:
            gray = columns["gray"]
            axes.plot(iteration, gray, color=style.GRAY, linewidth=1.2)
            _name_level(axes, float(np.nanmax(gray)), style.GRAY, "between void and solid", 0.02)
    last = f"{values[-1]:.4g}"
    title = f"{heading} [{unit}]" if unit else heading
    axes.set_title(textwrap.fill(title, style.PICTURES.heading - len(last)), loc="left")
    axes.set_title(last, loc="right", color=style.BLUE)


def plot_curves(
    panels: Mapping[str, Mapping[str, tuple[ArrayLike, ArrayLike]]],
    path: str | Path,
    *,
    xlabel: str = "",
    markers: bool = False,
    title: str = "",
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Draw curves in panels under each other.

    Args:
        panels: Curves by name, by heading with unit; a curve is an abscissa and as many values.
        xlabel: Name of the abscissa, with unit.
        markers: A mark at each point.
        path: File to write.
        title: Heading.
        comm: Ranks that call this together.
    """
    path = style.writable(path, title)
    validation.name("plot_curves: xlabel", xlabel)
    validation.flag("plot_curves: markers", markers)
    _check_panels(panels)

    def draw(file: Path) -> None:
        with _diagrams(file, len(panels), 1, title, xlabel) as diagrams:
            for axes, (heading, curves) in zip(diagrams, panels.items(), strict=True):
                for name, color in style.accents(curves).items():
                    label = name if len(curves) > 1 else ""
                    look: dict[str, Any] = {"marker": "o" if markers else "", "markersize": 4.0}
                    axes.plot(*curves[name], color=color, label=label, **look)
                axes.set_title(heading, loc="left")

    return style.written(comm, path, draw)


def _check_panels(panels: Mapping[str, Mapping[str, tuple[ArrayLike, ArrayLike]]]) -> None:
    """Refuse panels that hold anything else than curves."""
    if not validation.by_name("plot_curves: panels", panels, "curves by name"):
        raise ValueError("plot_curves: no panels to draw")
    for heading, curves in panels.items():
        by_name = validation.by_name(f"plot_curves: {heading!r}", curves, "curves")
        for name, curve in by_name.items():
            what = f"plot_curves: {heading!r}, curve {name!r}"
            pair = validation.listed(what, curve, "an abscissa and values")
            shapes = [validation.numbers(what, array).shape for array in pair]
            if len(shapes) != 2 or shapes[0] != shapes[1] or len(shapes[0]) != 1:
                raise ValueError(
                    f"{what} must be an abscissa and as many values, but has the shapes {shapes}"
                )


@contextmanager
def _diagrams(file: Path, count: int, across: int, title: str, xlabel: str) -> Iterator[list[Axes]]:
    """Axes of diagrams in rows, which are written with a grid, legends and a heading."""
    rows = -(-count // across)
    with style.styled_figure((7.2, 9.6, 13.0)[across - 1], 2.6 * rows + 0.6, file) as figure:
        figure.suptitle(title)
        diagrams = list(figure.subplots(rows, across, squeeze=False, sharex=across == 1).ravel())
        for axes in diagrams[count:]:
            axes.remove()
        yield diagrams[:count]
        for axes in diagrams[:count]:
            style.tidy(axes)
            if axes.get_legend_handles_labels()[0] and axes.get_legend() is None:
                axes.legend(loc="best")
        for axes in diagrams[:count][-across:]:
            axes.set_xlabel(xlabel)


def _draw_level(axes: Axes, value: float, color: str, label: str) -> None:
    """Draw a dashed level with its name over its right end."""
    axes.axhline(value, color=color, linewidth=1.2, linestyle=(0, (5, 3)))
    _name_level(axes, value, color, label, 0.99)


def _name_level(axes: Axes, value: float, color: str, label: str, x: float) -> None:
    """Write the name of a level at x, a share of the width of the axes."""
    place: dict[str, Any] = {"ha": "left" if x < 0.5 else "right", "va": "bottom"}
    transform = axes.get_yaxis_transform()
    axes.text(x, value, label, color=color, fontsize=9, transform=transform, **place)
