# SPDX-License-Identifier: MIT
"""Diagrams over iterations and over time, and of radial basis functions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..design import Kernel
from ..dynamics import Trajectory
from ..io import read_history
from ..mechanism import Motion, Moving
from .style import (
    ACCENTS,
    BLUE,
    GRAY,
    KINDS,
    RED,
    prefixed,
    save,
    styled_figure,
    tidy,
    writable,
    written,
)

__all__ = [
    "plot_crank_motion",
    "plot_curves",
    "plot_gradient_histories",
    "plot_history",
    "plot_kernel",
]

Array = NDArray[np.float64]


def plot_history(
    history: Mapping[str, ArrayLike] | str | Path,
    path: str | Path,
    *,
    psi_solid: float | None = None,
    psi_unit: str = "J s",
    volume_bound: float | None = None,
    title: str = "",
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Draw how a design came about, over the iterations.

    One sees, each in a panel of its own as far as the history has it: the objective, with the line
    of the solid body where it is given; those of several motions, each relative to its value at the
    start; the volume with its bound, and the share that is neither void nor solid; the first
    frequency (interfaces held); the steepness of the projection; the number of normal modes and the
    estimated error by those left out; the size of the steps. The last value stands above each
    panel.

    Args:
        history: Columns by name, or a CSV file with a line of names: ``iteration`` and any of
            ``psi`` [J s], ``psi of fast`` and so on, ``volume`` [-] and beside it ``gray`` [-],
            ``frequency`` [Hz], ``sharpness`` [-], ``modes``, ``mode_error`` [-], ``step`` (explicit
            steps of a level set: knot spacings; else the largest change, as a share of the bounds).
        path: File to write, .png, .pdf or .svg.
        psi_solid: Objective of the solid body [J s]; the objective is then drawn relative to it.
        psi_unit: Unit of psi, where it is no compliance.
        volume_bound: Largest volume allowed, in [0, 1].
        title: Heading.
        comm: Ranks that call this together; rank 0 reads and writes.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: On every rank, if the history has none of these columns or no line, or the kind
            of file is not known.
    """
    path = writable(path, KINDS, title)
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
        motions = {n: v for n, v in columns.items() if n.startswith(_OF_MOTION)}
        chosen = [name for name in _COLUMNS if np.isfinite(columns.get(name, [])).any()]
        if motions:
            chosen.insert(chosen.index("psi") + 1 if "psi" in chosen else 0, _OF_MOTION)
        if not chosen:
            raise ValueError(
                f"plot_history: the history has the columns {sorted(columns)} and must have a line "
                f"and at least one of {list(_COLUMNS)}"
            )
        count = len(next(iter(columns.values())))
        iteration = columns.get("iteration", np.arange(count, dtype=np.float64))
        across = {1: 1, 2: 2, 3: 3}.get(len(chosen), 2)
        rows = -(-len(chosen) // across)
        size = ({1: 6.0, 2: 9.6, 3: 13.0}[across], 2.6 * rows + 0.8)
        with _panels(file, rows, across, size, title, "iteration") as panels:
            for axes in panels[len(chosen) :]:
                axes.remove()
            for axes, name in zip(panels, chosen, strict=False):
                if name == _OF_MOTION:
                    _draw_motions(axes, iteration, motions)
                    continue
                gray = columns.get("gray") if name == "volume" else None
                unit = psi_unit if name == "psi" else _COLUMNS[name][1]
                _draw_column(
                    axes, name, unit, iteration, columns[name], psi_solid, volume_bound, gray
                )

    return written(comm, path, draw)


def _numbers(what: str, history: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """The columns of a history, or refuse what is none."""
    given = validation.by_name(what, history, "columns")
    columns = {name: validation.numbers(f"{what}: {name!r}", v) for name, v in given.items()}
    for name, column in columns.items():
        if column.ndim != 1 or len(column) != len(next(iter(columns.values()))):
            raise ValueError(
                f"{what}: {name!r} must have one number for each iteration, as the other columns, "
                f"but it has the shape {column.shape}"
            )
    return columns


#: Heading and unit of each panel, by the name of the column
_COLUMNS = {
    "psi": ("objective ψ", ""),
    "volume": ("volume, share of the body", ""),
    "frequency": ("first frequency, interfaces held", "Hz"),
    "sharpness": ("steepness of the projection", ""),
    "modes": ("normal modes", ""),
    "mode_error": ("estimated error of ψ by the modes left out", "%"),
    "step": ("size of the step", ""),
}


#: How the columns begin that hold the objectives of several motions
_OF_MOTION = "psi of "


def _draw_motions(axes: Axes, iteration: Array, motions: Mapping[str, Array]) -> None:
    """Draw the objectives of several motions, each relative to its value at the start."""
    for (name, values), color in zip(motions.items(), cycle(ACCENTS), strict=False):
        own = values / values[0] if values[0] else values
        axes.plot(iteration, own, color=color, label=name.removeprefix(_OF_MOTION))
    axes.set_ylim(bottom=0.0)
    axes.set_xlim(iteration[0] - 0.5, max(iteration[-1], iteration[0] + 1) + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    axes.set_title("ψ of each motion / ψ at the start", loc="left")
    axes.legend(frameon=False, ncols=2 if len(motions) > 3 else 1, loc="upper right")


def _draw_column(
    axes: Axes,
    name: str,
    unit: str,
    iteration: Array,
    values: Array,
    psi_solid: float | None,
    volume_bound: float | None,
    gray: Array | None,
) -> None:
    """Draw one column of the history, its last value in the upper right corner."""
    heading = _COLUMNS[name][0]
    if name == "psi" and psi_solid is not None:
        values, unit = values / psi_solid, ""
        heading = "objective ψ / ψ of the solid body"
        _line(axes, 1.0, GRAY, "solid body")
    elif unit == "%":
        values = 100.0 * values
    elif unit:
        unit, factor = prefixed(float(np.nanmax(np.abs(values))), unit)
        values = values * factor
    if name == "volume" and volume_bound is not None:
        _line(axes, volume_bound, RED, "bound")
    axes.plot(
        iteration, values, color=BLUE, marker="o" if len(values) <= 60 else "", markersize=3.0
    )
    if gray is not None:
        axes.plot(iteration, gray, color=GRAY, linewidth=1.2)
        _name_line(axes, float(np.nanmax(gray)), GRAY, "between void and solid", left=True)
    top = float(np.nanmax(values))
    if name == "volume":
        axes.set_ylim(0.0, 1.08 * max(1.0, top))
    elif name == "step" and 0.0 < np.nanmin(values) < 0.05 * top:
        axes.set_yscale("log")
    else:
        reference = 1.0 if name == "psi" and psi_solid is not None else 0.0
        axes.set_ylim(0.0, 1.12 * max(top, reference) or 1.0)
    axes.set_xlim(iteration[0] - 0.5, max(iteration[-1], iteration[0] + 1) + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    axes.set_title(f"{heading} [{unit}]" if unit else heading, loc="left")
    axes.set_title(f"{values[-1]:.4g}", loc="right", color=BLUE)


def plot_crank_motion(
    source: Motion | Trajectory,
    path: str | Path,
    *,
    end_time: float | None = None,
    title: str = "",
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Draw angle, angular velocity and angular acceleration of a prescribed crank over time.

    Args:
        source: The motion of the angle [rad]; or a trajectory, of whose mechanism the first moving
            marker with a changing angle is taken.
        path: File to write, .png, .pdf or .svg.
        end_time: End of the diagrams [s]; by default that of the trajectory.
        title: Heading.
        comm: Ranks that call this together; rank 0 writes.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: On every rank, if there is no such marker, the end time is missing or not
            positive, or the kind of file is not known.
    """
    path = writable(path, KINDS, title)
    needed = "a Motion or a Trajectory"
    validation.instance("plot_crank_motion: source", source, (Motion, Trajectory), needed)
    if end_time is not None:
        validation.number("plot_crank_motion: end_time", end_time, above=0.0, unit="s")
    if isinstance(source, Trajectory):
        motion = _crank_angle(source)
        end = float(source.t[-1]) if end_time is None else end_time
    else:
        motion, end = source, float("nan") if end_time is None else end_time
    if not (np.isfinite(end) and end > 0.0):
        raise ValueError(
            f"plot_crank_motion: end_time = {end_time} must be given with a motion, and positive"
        )

    t = np.linspace(0.0, end, 801)
    headings = (
        "angle φ [rad]",
        "angular velocity dφ/dt [rad/s]",
        "angular acceleration d²φ/dt² [rad/s²]",
    )
    curves = {h: {"": (t, values)} for h, values in zip(headings, motion.tabulate(t), strict=True)}
    return plot_curves(curves, path, xlabel="time [s]", title=title, comm=comm)


def plot_curves(
    panels: Mapping[str, Mapping[str, tuple[ArrayLike, ArrayLike]]],
    path: str | Path,
    *,
    xlabel: str = "",
    logarithmic: bool = False,
    markers: bool = False,
    title: str = "",
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Draw curves in panels under each other.

    Args:
        panels: By heading with unit, curves by name, each an abscissa and values of the same size.
        path: File to write, .png, .pdf or .svg.
        xlabel: What the abscissa is, with unit.
        logarithmic: Both axes logarithmic, with a mark at each point.
        markers: A mark at each point of linear axes too.
        title: Heading of the picture.
        comm: Ranks that call this together; rank 0 writes.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: On every rank, if there is no panel, an abscissa does not fit its values, or the
            kind of file is not known.
    """
    path = writable(path, KINDS, title)
    validation.name("plot_curves: xlabel", xlabel)
    validation.flag("plot_curves: logarithmic", logarithmic)
    validation.flag("plot_curves: markers", markers)
    _check_panels(panels)

    def draw(file: Path) -> None:
        size = (7.2, 2.5 * len(panels) + 0.8)
        with _panels(file, len(panels), 1, size, title, xlabel) as rows:
            for axes, (heading, curves) in zip(rows, panels.items(), strict=True):
                for (name, (x, y)), color in zip(curves.items(), cycle(ACCENTS), strict=False):
                    marker = "o" if logarithmic or markers else ""
                    label = name if len(curves) > 1 else ""
                    axes.plot(x, y, color=color, label=label, marker=marker, markersize=4.0)
                if logarithmic:
                    axes.set_xscale("log")
                    axes.set_yscale("log")
                axes.set_title(heading, loc="left")

    return written(comm, path, draw)


def _check_panels(panels: Mapping[str, Mapping[str, tuple[ArrayLike, ArrayLike]]]) -> None:
    """Refuse what cannot be drawn as curves."""
    if not validation.by_name("plot_curves: panels", panels, "curves by name"):
        raise ValueError("plot_curves: no panels to draw")
    for heading, curves in panels.items():
        for name, curve in validation.by_name(
            f"plot_curves: {heading!r}", curves, "curves"
        ).items():
            what = f"plot_curves: {heading!r}, curve {name!r}"
            pair = validation.listed(what, curve, "an abscissa and values")
            sizes = [validation.numbers(what, part).shape for part in pair]
            if len(sizes) != 2 or sizes[0] != sizes[1] or len(sizes[0]) != 1:
                raise ValueError(
                    f"{what} must be an abscissa and as many values, but has the shapes {sizes}"
                )


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
        histories: By name of the run, the history of `optimize`.
        path: File to write, .png, .pdf or .svg.
        psi_solid: Objective of the solid body [J s].
        title: Heading.
        comm: Ranks that call this together; rank 0 writes.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: On every rank, if the kind of file is not known.
    """
    path = writable(path, KINDS, title)
    psi_solid = validation.number("plot_gradient_histories: psi_solid", psi_solid, above=0.0)
    given = validation.by_name("plot_gradient_histories: histories", histories, "histories")
    runs = {
        name: _numbers(f"plot_gradient_histories: {name!r}", history)
        for name, history in given.items()
    }
    for name, run in runs.items():
        missing = sorted({"iteration", "psi"} - set(run))
        if missing:
            raise ValueError(
                f"plot_gradient_histories: {name!r} has the columns {sorted(run)} and lacks "
                f"{' and '.join(missing)}"
            )

    def draw(file: Path) -> None:
        with _panels(file, 1, 3, (12.6, 4.0), title, "iteration") as panels:
            for (name, run), color, line in zip(
                runs.items(), cycle(ACCENTS), cycle(["-", "--", "-."]), strict=False
            ):
                i = run["iteration"]
                psi = run["psi"] / psi_solid
                panels[0].plot(i, psi, line, color=color, label=f"{name}: {psi[-1]:.3f}")
                if "gradient_elements" in run:
                    panels[1].plot(i, run["gradient_elements"], line, color=color, label=name)
                    _draw_errors(panels[2], run, color)
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

    return written(comm, path, draw)


def _draw_errors(axes: Axes, run: Mapping[str, Array], color: str) -> None:
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
        kernel: The function.
        path: File to write, .png, .pdf or .svg.
        extent: Half the side of the square that is drawn [m].
        title: Heading.
        comm: Ranks that call this together; rank 0 writes.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: On every rank, if the extent is not positive or the kind of file is not known.
    """
    path = writable(path, KINDS, title)
    validation.function("plot_kernel: kernel", kernel, "distances")
    extent = validation.number("plot_kernel: extent", extent, above=0.0, unit="m")

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


@contextmanager
def _panels(
    file: Path, rows: int, across: int, size: tuple[float, float], title: str, xlabel: str
) -> Iterator[list[Axes]]:
    """Give axes, and write them with a quiet grid, legends, heading and name of the abscissa."""
    with styled_figure(*size) as figure:
        panels = list(figure.subplots(rows, across, squeeze=False, sharex=across == 1).ravel())
        yield panels
        panels = list(figure.axes)
        for axes in panels:
            tidy(axes)
            if axes.get_legend_handles_labels()[0]:
                axes.legend(loc="best")
        for axes in panels[-across:]:
            axes.set_xlabel(xlabel)
        if title:
            figure.suptitle(title, fontsize=13)
        figure.tight_layout(w_pad=3.0, h_pad=1.5)
        save(figure, file)


def _line(axes: Axes, value: float, color: str, label: str) -> None:
    """Draw a level with its name."""
    axes.axhline(value, color=color, linewidth=1.2, linestyle=(0, (5, 3)))
    _name_line(axes, value, color, label)


def _name_line(axes: Axes, value: float, color: str, label: str, *, left: bool = False) -> None:
    """Write the name of a line over its right or its left end."""
    axes.annotate(
        label,
        (0.0 if left else 1.0, value),
        xycoords=("axes fraction", "data"),
        xytext=(6 if left else -2, 3),
        textcoords="offset points",
        ha="left" if left else "right",
        va="bottom",
        color=color,
        fontsize=9,
    )


def _crank_angle(trajectory: Trajectory) -> Motion:
    """The angle of the first moving marker that turns."""
    for joint in trajectory.model.mechanism.joints:
        for marker in joint.markers:
            if isinstance(marker, Moving) and np.ptp(marker.angle.tabulate(trajectory.t)[0]) > 0.0:
                return marker.angle
    raise ValueError(
        "plot_crank_motion: the mechanism has no moving marker with a changing angle; give the "
        "motion itself"
    )
