# SPDX-License-Identifier: MIT
"""Diagrams over iterations and over time."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from pathlib import Path

from mpi4py import MPI

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import ArrayLike, NDArray

from ..dynamics import Trajectory
from ..io import read_history
from ..mechanism import Moving
from ..motion import Motion
from .style import ACCENTS, BLUE, GRAY, RED, prefixed, save, styled_figure, tidy, writable, written

__all__ = ["plot_crank_motion", "plot_curves", "plot_history"]

Array = NDArray[np.float64]

_KINDS = (".png", ".pdf", ".svg")


def plot_history(
    history: Mapping[str, ArrayLike] | str | Path,
    path: str | Path,
    *,
    psi_solid: float | None = None,
    volume_bound: float | None = None,
    title: str = "",
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> Path:
    """Draw how a design came about, over the iterations.

    One sees, each in a panel of its own as far as the history has it: the objective, with the line
    of the solid body where it is given; the volume with its bound, and the share that is neither
    void nor solid; the first frequency (interfaces held); the size of the steps. The last value
    stands above each panel.

    Args:
        history: columns by name, or a CSV file with a line of names: ``iteration`` and any of
            ``psi`` [J s], ``volume`` [-] and beside it ``gray`` [-], ``frequency`` [Hz], ``step``
            [knot spacings].
        path: file to write, .png, .pdf or .svg.
        psi_solid: objective of the solid body [J s]; the objective is then drawn relative to it.
        volume_bound: largest volume allowed, in [0, 1].
        title: heading.
        comm: ranks that call this together; rank 0 reads and writes.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: on every rank, if the history has none of these columns or no line, or the kind
            of file is not known.
    """
    path = writable(path, _KINDS)

    def draw(file: Path) -> None:
        if isinstance(history, Mapping):
            columns = {name: np.asarray(v, dtype=np.float64) for name, v in history.items()}
        else:
            columns = read_history(history)
        chosen = [name for name in _PANELS if name in columns]
        if not chosen or not len(columns[chosen[0]]):
            raise ValueError(
                f"plot_history: the history has the columns {sorted(columns)} and must have a line "
                f"and at least one of {list(_PANELS)}"
            )
        count = len(columns[chosen[0]])
        iteration = columns.get("iteration", np.arange(count, dtype=np.float64))
        across = {1: 1, 2: 2, 3: 3}.get(len(chosen), 2)
        rows = -(-len(chosen) // across)
        with styled_figure({1: 6.0, 2: 9.6, 3: 13.0}[across], 2.6 * rows + 0.8) as figure:
            panels = figure.subplots(rows, across, squeeze=False).ravel()
            for axes, name in zip(panels, chosen, strict=True):
                gray = columns.get("gray") if name == "volume" else None
                _draw_column(axes, name, iteration, columns[name], psi_solid, volume_bound, gray)
            for axes in panels[-across:]:
                axes.set_xlabel("iteration")
            if title:
                figure.suptitle(title, fontsize=13)
            figure.tight_layout(w_pad=3.0, h_pad=1.5)
            save(figure, file)

    return written(comm, path, draw)


#: heading and unit of each panel, by the name of the column
_PANELS = {
    "psi": ("objective ψ", "J s"),
    "volume": ("volume, share of the body", ""),
    "frequency": ("first frequency", "Hz"),
    "step": ("size of the step / knot spacing", ""),
}


def _draw_column(
    axes: Axes,
    name: str,
    iteration: Array,
    values: Array,
    psi_solid: float | None,
    volume_bound: float | None,
    gray: Array | None,
) -> None:
    """Draw one column of the history, its last value in the upper right corner."""
    heading, unit = _PANELS[name]
    if name == "psi" and psi_solid is not None:
        values, unit = values / psi_solid, ""
        heading = "objective ψ / ψ of the solid body"
        _line(axes, 1.0, GRAY, "solid body")
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
    tidy(axes)


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
        source: the motion of the angle [rad]; or a trajectory, of whose mechanism the first moving
            marker with a changing angle is taken.
        path: file to write, .png, .pdf or .svg.
        end_time: end of the diagrams [s]; by default that of the trajectory.
        title: heading.
        comm: ranks that call this together; rank 0 writes.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: on every rank, if there is no such marker, the end time is missing or not
            positive, or the kind of file is not known.
    """
    path = writable(path, _KINDS)
    if isinstance(source, Trajectory):
        motion = _crank_angle(source)
        end = float(source.t[-1]) if end_time is None else end_time
    else:
        motion, end = source, float("nan") if end_time is None else end_time
    if not (np.isfinite(end) and end > 0.0):
        raise ValueError(
            f"plot_crank_motion: end_time = {end_time} must be given with a motion, and positive"
        )

    def draw(file: Path) -> None:
        t = np.linspace(0.0, end, 801)
        angle, velocity, acceleration = motion.tabulate(t)
        with styled_figure(6.4, 6.6) as figure:
            panels = figure.subplots(3, 1, sharex=True)
            rows = (
                (angle, "angle φ [rad]"),
                (velocity, "angular velocity dφ/dt [rad/s]"),
                (acceleration, "angular acceleration d²φ/dt² [rad/s²]"),
            )
            for axes, (values, heading) in zip(panels, rows, strict=True):
                tidy(axes)
                axes.axhline(0.0, color=GRAY, linewidth=0.8)
                axes.plot(t, values, color=BLUE)
                axes.set_title(heading, loc="left")
                axes.set_xlim(0.0, end)
            turns = panels[0].secondary_yaxis(
                "right", functions=(lambda a: a / (2.0 * np.pi), lambda n: n * (2.0 * np.pi))
            )
            turns.set_ylabel("revolutions")
            turns.spines["right"].set_visible(False)
            turns.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            panels[-1].set_xlabel("time [s]")
            if title:
                figure.suptitle(title, fontsize=13)
            figure.tight_layout(h_pad=1.2)
            save(figure, file)

    return written(comm, path, draw)


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
        panels: by heading with unit, curves by name, each an abscissa and values of the same size.
        path: file to write, .png, .pdf or .svg.
        xlabel: what the abscissa is, with unit.
        logarithmic: both axes logarithmic, with a mark at each point.
        markers: a mark at each point of linear axes too.
        title: heading of the picture.
        comm: ranks that call this together; rank 0 writes.

    Returns:
        The path, on every rank.

    Raises:
        ValueError: on every rank, if there is no panel, an abscissa does not fit its values, or the
            kind of file is not known.
    """
    path = writable(path, _KINDS)
    if not panels:
        raise ValueError("plot_curves: no panels to draw")

    def draw(file: Path) -> None:
        with styled_figure(7.2, 2.5 * len(panels) + 0.8) as figure:
            rows = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
            for axes, (heading, curves) in zip(rows, panels.items(), strict=True):
                for (name, (x, y)), color in zip(curves.items(), cycle(ACCENTS), strict=False):
                    marker = "o" if logarithmic or markers else ""
                    axes.plot(x, y, color=color, label=name, marker=marker, markersize=4.0)
                if logarithmic:
                    axes.set_xscale("log")
                    axes.set_yscale("log")
                axes.set_title(heading, loc="left")
                tidy(axes)
                if len(curves) > 1:
                    axes.legend(loc="best")
            rows[-1].set_xlabel(xlabel)
            if title:
                figure.suptitle(title, fontsize=13)
            figure.tight_layout(h_pad=1.2)
            save(figure, file)

    return written(comm, path, draw)


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
    """Return the angle of the first moving marker that turns."""
    for joint in trajectory.model.mechanism.joints:
        for marker in joint.markers:
            if isinstance(marker, Moving) and np.ptp(marker.angle.tabulate(trajectory.t)[0]) > 0.0:
                return marker.angle
    raise ValueError(
        "plot_crank_motion: the mechanism has no moving marker with a changing angle; give the "
        "motion itself"
    )
