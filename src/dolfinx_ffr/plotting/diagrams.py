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
from ..dynamics import Trajectory
from ..io import read_history
from ..mechanism import Motion, Moving, Parameters
from . import style

#: Heading and unit of each panel, by the name of the column
_COLUMNS = {
    "psi": ("objective ψ", ""),
    "volume": ("volume, share of the body", ""),
    "frequency": ("first frequency, interfaces held", "Hz"),
    "sharpness": ("steepness of the projection", ""),
    "modes": ("normal modes", ""),
    "mode_error": ("estimated error, modes left out", "%"),
    "step": ("size of the step", ""),
}
#: Letters of a heading and of the value beside it that fit into one line
_HEADING = 42
#: How the columns begin that hold the objectives of several load cases
_OF_MOTION = "psi of "
#: The same with the values of a mechanism's parameters, and the most of them that a legend names
_OF_PARAMETER, _MOST_NAMED = "parameter ", 12


def plot_history(
    history: Mapping[str, ArrayLike] | str | Path,
    path: str | Path,
    *,
    psi_solid: float | None = None,
    psi_unit: str = "J s",
    volume_bound: float | None = None,
    parameters: Parameters | None = None,
    title: str = "",
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Draw how a design came about, over the iterations.

    Each column has a panel: the objective, with the line of the solid body where it is given; the
    objectives of several load cases, each relative to its value at the start; the parameters of a
    mechanism between their bounds, with their last values and units; the volume with its
    bound, and the share that is neither void nor solid; the first frequency (interfaces held); the
    steepness of the projection; the number of normal modes and the estimated error by the others;
    the size of the steps. The last value stands above each panel.

    Args:
        history: Columns by name, or a CSV file with a line of names: ``iteration`` and any of
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

    Raises:
        ValueError: If the history has none of these columns or no line.
    """
    path = style.writable(path, title)
    for what, bound in (("psi_solid", psi_solid), ("volume_bound", volume_bound)):
        if bound is not None:
            validation.number(f"plot_history: {what}", bound, above=0.0)
    if not isinstance(history, Mapping):
        validation.path("plot_history: history", history)

    def draw(file: Path) -> None:
        if isinstance(history, Mapping):
            columns = _numbers("plot_history", history)
        else:
            columns = read_history(history)
        load_cases = {n: v for n, v in columns.items() if n.startswith(_OF_MOTION)}
        chosen = [name for name in _COLUMNS if np.isfinite(columns.get(name, [])).any()]
        numbers = {n: v for n, v in columns.items() if n.startswith(_OF_PARAMETER)}
        for kind, several in ((_OF_PARAMETER, numbers), (_OF_MOTION, load_cases)):
            if several:
                chosen.insert(chosen.index("psi") + 1 if "psi" in chosen else 0, kind)
        if not chosen:
            raise ValueError(
                f"plot_history: the history has the columns {sorted(columns)} and must have a line "
                f"and at least one of {list(_COLUMNS)}"
            )
        count = len(next(iter(columns.values())))
        iteration = columns.get("iteration", np.arange(count, dtype=np.float64))
        across = len(chosen) if len(chosen) < 4 else 2
        rows = -(-len(chosen) // across)
        size = ((6.0, 9.6, 13.0)[across - 1], 2.6 * rows + 0.8)
        with _panels(file, rows, across, size, title, "iteration") as panels:
            for axes in panels[len(chosen) :]:
                axes.remove()
            for axes, name in zip(panels, chosen, strict=False):
                axes.set_xlim(iteration[0] - 0.5, max(iteration[-1], iteration[0] + 1) + 0.5)
                axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
                if name == _OF_MOTION:
                    _draw_load_cases(axes, iteration, load_cases)
                    continue
                if name == _OF_PARAMETER:
                    _draw_parameters(axes, iteration, numbers, parameters)
                    continue
                unit = psi_unit if name == "psi" else _COLUMNS[name][1]
                _draw_column(axes, name, unit, iteration, columns, psi_solid, volume_bound)

    return style.written(comm, path, draw)


def _numbers(what: str, history: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """The columns of a history as arrays, or an error."""
    given = validation.by_name(what, history, "columns")
    columns = {name: validation.numbers(f"{what}: {name!r}", v) for name, v in given.items()}
    for name, column in columns.items():
        if column.ndim != 1 or len(column) != len(next(iter(columns.values()))):
            raise ValueError(
                f"{what}: {name!r} must have one number for each iteration, as the other columns, "
                f"but it has the shape {column.shape}"
            )
    return columns


def _draw_load_cases(axes: Axes, iteration: Array, load_cases: Mapping[str, Array]) -> None:
    """Draw the objectives of several load cases, each relative to its value at the start."""
    for (name, values), color in zip(load_cases.items(), cycle(style.ACCENTS), strict=False):
        own = values / values[0] if values[0] else values
        axes.plot(iteration, own, color=color, label=name.removeprefix(_OF_MOTION))
    axes.set_ylim(bottom=0.0)
    axes.set_title("ψ of each load case / ψ at the start", loc="left")


def _draw_parameters(
    axes: Axes, iteration: Array, columns: Mapping[str, Array], parameters: Parameters | None
) -> None:
    """Draw parameters as shares of their ranges, or relative to the largest size of each."""
    if parameters is None:
        sizes = [float(np.max(np.abs(values))) or 1.0 for values in columns.values()]
        shares = np.array(list(columns.values())).T / sizes
        axes.set_title("parameters / their largest sizes", loc="left")
    else:
        columns = {
            _OF_PARAMETER + n: columns[_OF_PARAMETER + n] for n in parameters.labels.values()
        }
        shares = parameters.shares(np.array(list(columns.values())).T)
        axes.set_title("parameters between their bounds", loc="left")
        _line(axes, 0.0, style.GRAY, "lower bounds")
        _line(axes, 1.0, style.GRAY, "upper bounds")
    named = len(columns) if len(columns) <= _MOST_NAMED else 0
    curves = zip(columns.items(), shares.T, cycle(style.ACCENTS), strict=False)
    for (label, values), own, color in curves:
        name, _, unit = label.removeprefix(_OF_PARAMETER).partition(" [")
        said = f"{name} {values[-1]:.4g} {unit.removesuffix(']')}".rstrip()
        axes.plot(iteration, own, color=color, label=said if named else "")
    # The names stand above the curves
    axes.set_ylim(min(-0.08, 1.08 * float(np.min(shares))), 1.14 + 0.11 * (-(-named // 2)))
    if named:
        axes.legend(ncols=2, loc="upper center")


def _draw_column(
    axes: Axes,
    name: str,
    unit: str,
    iteration: Array,
    columns: Mapping[str, Array],
    psi_solid: float | None,
    volume_bound: float | None,
) -> None:
    """Draw one column of the history, its last value in the upper right corner."""
    heading, values = _COLUMNS[name][0], columns[name]
    if name == "psi" and psi_solid is not None:
        values, unit = values / psi_solid, ""
        heading = "objective ψ / ψ of the solid body"
        _line(axes, 1.0, style.GRAY, "solid body")
    elif unit == "%":
        values = 100.0 * values
    elif unit:
        unit, factor = style.prefixed(float(np.nanmax(np.abs(values))), unit)
        values = values * factor
    if name == "volume" and volume_bound is not None:
        _line(axes, volume_bound, style.RED, "bound")
    marker = "o" if len(values) <= 60 else ""
    axes.plot(iteration, values, color=style.BLUE, marker=marker, markersize=3.0)
    if name == "volume" and "gray" in columns:
        gray = columns["gray"]
        axes.plot(iteration, gray, color=style.GRAY, linewidth=1.2)
        _name_line(axes, float(np.nanmax(gray)), style.GRAY, "between void and solid", left=True)
    top = float(np.nanmax(values))
    if name == "volume":
        axes.set_ylim(0.0, 1.08 * max(1.0, top))
    elif name == "step" and 0.0 < np.nanmin(values) < 0.05 * top:
        axes.set_yscale("log")
    else:
        reference = 1.0 if name == "psi" and psi_solid is not None else 0.0
        axes.set_ylim(0.0, 1.12 * max(top, reference) or 1.0)
    title = f"{heading} [{unit}]" if unit else heading
    last = f"{values[-1]:.4g}"
    axes.set_title(textwrap.fill(title, _HEADING - len(last)), loc="left")
    axes.set_title(last, loc="right", color=style.BLUE)


def plot_crank_motion(
    source: Motion | Trajectory,
    path: str | Path,
    *,
    end_time: float | None = None,
    title: str = "",
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Draw angle, angular velocity and angular acceleration of a prescribed crank over time.

    The ``source`` is the motion of the angle [rad]; or a trajectory, of whose mechanism the first
    moving marker with a changing angle is taken. ``end_time`` is the end of the diagrams [s], by
    default that of the trajectory; ``path``, ``title`` and ``comm`` are as for `plot_curves`.

    Raises:
        ValueError: If there is no such marker, or no positive end time.
    """
    path = style.writable(path, title)
    needed = "a Motion or a Trajectory"
    validation.instance("plot_crank_motion: source", source, (Motion, Trajectory), needed)
    if isinstance(source, Trajectory):
        end_time = float(source.t[-1]) if end_time is None else end_time
        source = _crank_angle(source)
    if end_time is None:
        raise ValueError("plot_crank_motion: end_time = None must be given with a motion")
    end_time = validation.number("plot_crank_motion: end_time", end_time, above=0.0, unit="s")
    t = np.linspace(0.0, end_time, 801)
    names = ["angle φ [rad]", "angular velocity dφ/dt [rad/s]"]
    names.append("angular acceleration d²φ/dt² [rad/s²]")
    curves = {name: {"": (t, own)} for name, own in zip(names, source.tabulate(t), strict=True)}
    return plot_curves(curves, path, xlabel="time [s]", title=title, comm=comm)


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
        panels: By heading with unit, curves by name, each an abscissa and values of the same size.
        xlabel: What the abscissa is, with unit.
        markers: A mark at each point.
        path: File to write.
        title: Heading.
        comm: Ranks that call this together.

    Raises:
        ValueError: If there is no panel, or an abscissa does not fit its values.
    """
    path = style.writable(path, title)
    validation.name("plot_curves: xlabel", xlabel)
    validation.flag("plot_curves: markers", markers)
    _check_panels(panels)

    def draw(file: Path) -> None:
        size = (7.2, 2.5 * len(panels) + 0.8)
        with _panels(file, len(panels), 1, size, title, xlabel) as rows:
            for axes, (heading, curves) in zip(rows, panels.items(), strict=True):
                for (name, (x, y)), color in zip(
                    curves.items(), cycle(style.ACCENTS), strict=False
                ):
                    marker = "o" if markers else ""
                    label = name if len(curves) > 1 else ""
                    axes.plot(x, y, color=color, label=label, marker=marker, markersize=4.0)
                axes.set_title(heading, loc="left")

    return style.written(comm, path, draw)


def _check_panels(panels: Mapping[str, Mapping[str, tuple[ArrayLike, ArrayLike]]]) -> None:
    """Refuse panels that hold anything else than curves."""
    if not validation.by_name("plot_curves: panels", panels, "curves by name"):
        raise ValueError("plot_curves: no panels to draw")
    for heading, curves in panels.items():
        given = validation.by_name(f"plot_curves: {heading!r}", curves, "curves")
        for name, curve in given.items():
            what = f"plot_curves: {heading!r}, curve {name!r}"
            pair = validation.listed(what, curve, "an abscissa and values")
            sizes = [validation.numbers(what, part).shape for part in pair]
            if len(sizes) != 2 or sizes[0] != sizes[1] or len(sizes[0]) != 1:
                raise ValueError(
                    f"{what} must be an abscissa and as many values, but has the shapes {sizes}"
                )


@contextmanager
def _panels(
    file: Path, rows: int, across: int, size: tuple[float, float], title: str, xlabel: str
) -> Iterator[list[Axes]]:
    """Give axes, and write them with a quiet grid, legends, heading and name of the abscissa."""
    with style.styled_figure(*size, file) as figure:
        panels = list(figure.subplots(rows, across, squeeze=False, sharex=across == 1).ravel())
        yield panels
        panels = list(figure.axes)
        for axes in panels:
            style.tidy(axes)
            if axes.get_legend_handles_labels()[0] and axes.get_legend() is None:
                axes.legend(loc="best")
        for axes in panels[-across:]:
            axes.set_xlabel(xlabel)
        if title:
            figure.suptitle(title, fontsize=13)
        figure.tight_layout(w_pad=3.0, h_pad=1.5)


def _line(axes: Axes, value: float, color: str, label: str) -> None:
    """Draw a level with its name."""
    axes.axhline(value, color=color, linewidth=1.2, linestyle=(0, (5, 3)))
    _name_line(axes, value, color, label)


def _name_line(axes: Axes, value: float, color: str, label: str, *, left: bool = False) -> None:
    """Write the name of a line over its right or its left end."""
    x, aside, align = (0.0, 6, "left") if left else (1.0, -2, "right")
    place: dict[str, Any] = {"xycoords": ("axes fraction", "data"), "xytext": (aside, 3)}
    look: dict[str, Any] = {"ha": align, "va": "bottom", "color": color, "fontsize": 9}
    axes.annotate(label, (x, value), textcoords="offset points", **place, **look)


def _crank_angle(trajectory: Trajectory) -> Motion:
    """The angle of the first moving marker that turns."""
    for marker in (m for joint in trajectory.model.mechanism.joints for m in joint.markers):
        if isinstance(marker, Moving) and np.ptp(marker.angle.tabulate(trajectory.t)[0]) > 0.0:
            return marker.angle
    raise ValueError(
        "plot_crank_motion: the mechanism has no moving marker with a changing angle; give the "
        "motion itself"
    )
