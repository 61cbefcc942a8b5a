# SPDX-License-Identifier: MIT
"""Time beside error: steps, tolerance; and the gradient against differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray
from report import Table, write_page
from scene import holes_design, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, DARK, GRAY, ORANGE, save, styled_figure, tidy

__all__ = [
    "accuracy_jobs",
    "against_reference",
    "central_differences",
    "label_point",
    "log_log",
    "number_of_steps",
    "report_accuracy",
    "seconds_axis",
    "solver_tolerance",
]

Results = list[tuple[Job, dict[str, Any]]]


def accuracy_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each choice that a user can make."""
    elements = [60, 6] if quick else [200, 20]
    repetitions = 1 if quick else 5
    common = {"elements": elements, "repetitions": repetitions}
    counts: list[int] = [500, 1000, 2000] if quick else [500, 1000, 2000, 4000, 8000, 16000]
    tolerances = [10.0**-k for k in ((4, 8, 11) if quick else range(4, 13))]
    sizes = [1e-2, 1e-3, 1e-4] if quick else [10.0 ** (-0.5 * k) for k in range(3, 13)]
    return [
        Job(
            "accuracy",
            "number_of_steps",
            4.0 if quick else 30.0,
            {**common, "settings": counts, "reference": 4 * counts[-1]},
        ),
        Job(
            "accuracy",
            "solver_tolerance",
            4.0 if quick else 20.0,
            {**common, "settings": tolerances, "reference": 1e-13},
        ),
        Job(
            "accuracy",
            "central_differences",
            4.0 if quick else 15.0,
            {"elements": elements, "settings": sizes},
        ),
    ]


# ---------------------------------------------------------------------- measurements


def number_of_steps(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: list[int],
    settings: list[int],
    reference: int,
    repetitions: int,
) -> dict[str, Any]:
    """Vary the number of time steps; parameters as in `against_reference`."""
    domain = slider_crank(comm, (elements[0], elements[1])).flexible["rod"].domain
    problems: dict[Any, ffr.Problem] = {
        n: slider_crank(comm, domain=domain, steps=n) for n in [*settings, reference]
    }
    return against_reference(problems, reference, repetitions, progress)


def solver_tolerance(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: list[int],
    settings: list[float],
    reference: float,
    repetitions: int,
) -> dict[str, Any]:
    """Vary the tolerance of eigenvalue problem and adjoint systems, as in `against_reference`."""
    domain = slider_crank(comm, (elements[0], elements[1])).flexible["rod"].domain
    problems = {t: slider_crank(comm, domain=domain, tolerance=t) for t in [*settings, reference]}
    return against_reference(problems, reference, repetitions, progress)


def against_reference(
    problems: Mapping[Any, ffr.Problem],
    reference: Any,
    repetitions: int,
    progress: Progress,
) -> dict[str, Any]:
    """Measure times and errors of each setting.

    Args:
        problems: By setting, on one mesh.
        reference: The setting that counts as exact.
        repetitions: Turns through all settings; the fastest of them counts.
        progress: Told the part that is done.

    Returns:
        A row for each setting, and what they are compared with.
    """
    x = holes_design(next(iter(problems.values())).flexible["rod"].domain)
    exact = problems[reference].gradient(x)
    exact_gradient = _gradient(exact)
    settings = [setting for setting in problems if setting != reference]
    times: dict[Any, list[tuple[float, float]]] = {setting: [] for setting in settings}
    psi, error, iterations, gap = {}, {}, {}, {}
    for repetition in range(repetitions):
        for place, setting in enumerate(settings):
            problem = problems[setting]
            if repetition == 0:
                problem.gradient(x)  # what is made once for each problem
            seconds_value = _seconds(problem, x)
            start = perf_counter()
            evaluation = problem.gradient(x)
            times[setting].append((seconds_value, perf_counter() - start))
            psi[setting] = evaluation.psi
            difference = _gradient(evaluation) - exact_gradient
            error[setting] = float(np.linalg.norm(difference) / np.linalg.norm(exact_gradient))
            gap[setting] = evaluation.outer_gap["rod"]
            iterations[setting] = evaluation.solver_iterations["rod"]
            progress((repetition + (place + 1) / len(settings)) / repetitions)
    return {
        "rows": [
            {
                "setting": setting,
                "value": min(t[0] for t in times[setting]),
                "gradient": min(t[1] for t in times[setting]),
                "psi": psi[setting],
                "error_psi": abs(psi[setting] / exact.psi - 1.0),
                "error_gradient": error[setting],
                "gap": gap[setting],
                "iterations": iterations[setting],
            }
            for setting in settings
        ],
        "reference": reference,
        "psi_reference": exact.psi,
        "elements": len(x),
    }


def _gradient(evaluation: ffr.Evaluation) -> NDArray[np.float64]:
    if evaluation.gradient is None:
        raise TypeError("only the value has been computed")
    return evaluation.gradient["rod"]


def _seconds(problem: ffr.Problem, x: NDArray[np.float64]) -> float:
    start = perf_counter()
    problem.value(x)
    return perf_counter() - start


def central_differences(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], settings: list[float]
) -> dict[str, Any]:
    """Compare the gradient along a random direction with central differences of several steps.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        elements: Along and across.
        settings: Steps of the differences, at most 0.05.
    """
    problem = slider_crank(comm, (elements[0], elements[1]))
    domain = problem.flexible["rod"].domain
    x = 0.05 + 0.9 * holes_design(domain)  # room for a step both ways
    direction = np.random.default_rng(0).uniform(-1.0, 1.0, domain.n_cells)
    slope = float(_gradient(problem.gradient(x)) @ direction)
    rows = []
    for place, step in enumerate(settings):
        ahead = problem.value(x + step * direction).psi
        behind = problem.value(x - step * direction).psi
        difference = (ahead - behind) / (2.0 * step)
        rows.append({"setting": step, "error_gradient": abs(difference / slope - 1.0)})
        progress((place + 1) / len(settings))
    return {"rows": rows, "slope": slope}


# ---------------------------------------------------------------------- tables and picture

MEASURED = {
    "value": "value [s]",
    "gradient": "gradient [s]",
    "error_psi": "error of psi",
    "error_gradient": "error of gradient",
}


def accuracy_tables(results: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """The tables, given the result of each measurement by its name."""
    steps, tolerance = results["number_of_steps"], results["solver_tolerance"]
    n = steps["elements"]
    measured = (
        f"Rod with 30 holes, {n:,} bilinear quadrilaterals. *Value* is the time for psi alone, "
        "*gradient* that for psi and its exact gradient, the fastest of several turns through all "
        "settings; errors are relative, that of the gradient in the Euclidean norm over all "
        "elements, against"
    )
    defaults = (
        "All else as in the demo (8 normal modes, 50 steps of Radau IIA, tolerance 1e-8); the "
        "steps that are varied are those of generalised-alpha."
    )
    return [
        Table(
            "accuracy_steps",
            "Number of time steps",
            f"{measured} {steps['reference']:,} steps. {defaults}",
            {"setting": "steps", **MEASURED},
            steps["rows"],
        ),
        Table(
            "accuracy_tolerance",
            "Tolerance of the solvers",
            f"{measured} a tolerance of {tolerance['reference']:g}. One tolerance for the relative "
            "residuals of the eigenvalue problem and of the adjoint systems, whose conjugate "
            "gradient iterations are the last column. An error of 0 means the same number to the "
            f"last digit: the eigenvalue solver reaches more than it is asked for. {defaults}",
            {"setting": "tolerance", **MEASURED, "iterations": "iterations"},
            tolerance["rows"],
        ),
        Table(
            "accuracy_differences",
            "The gradient against central differences",
            "Relative difference between the exact gradient along a random direction in the space "
            "of all densities and the central difference of psi, over the step of the difference. "
            "Large steps show the error of the difference, which falls with the square of the "
            "step, small ones the round-off in psi.",
            {"setting": "step", "error_gradient": "relative difference"},
            results["central_differences"]["rows"],
        ),
    ]


def report_accuracy(results: Results, directory: Path) -> list[Table]:
    """Write tables and picture.

    Args:
        results: Of `accuracy_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    by_name = {job.function: result for job, result in results}
    tables = accuracy_tables(by_name)
    _draw(by_name, directory / "accuracy.png")
    picture = "![Error over time for steps and tolerance](accuracy.png)"
    write_page(directory, "accuracy", "Time beside error", picture, tables)
    return tables


def _draw(results: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    with styled_figure(9.0, 8.0) as figure:
        axes = figure.subplots(2, 2)
        for place, (name, title, text) in zip(
            axes.flat,
            (
                ("number_of_steps", "Time steps", "{:,.0f}"),
                ("solver_tolerance", "Tolerance of the solvers", "{:.0e}"),
            ),
            strict=False,
        ):
            _draw_settings(place, results[name]["rows"], text)
            place.set_title(title)
        low, high = axes[0, 0].get_ylim()
        axes[0, 0].set_ylim(low, high * (high / low) ** 0.2)
        axes[0, 0].legend(loc="upper right")
        _draw_order(axes[1, 0], results["number_of_steps"]["rows"])
        _draw_differences(axes[1, 1], results["central_differences"]["rows"])
        figure.tight_layout(w_pad=2.0, h_pad=2.0)
        save(figure, path)


def log_log(axes: Axes, x_label: str, y_label: str) -> None:
    """Give a diagram two logarithmic axes with labels."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    tidy(axes)


def seconds_axis(axes: Axes) -> None:
    """Label 1, 2 and 5 of each decade, and leave room for words at the last point."""
    low, high = axes.get_xlim()
    room = max(2.0 / np.sqrt(high / low), 1.0)  # at least a factor of four, not the noise alone
    low, high = low / room, high * room
    axes.set_xlim(low, high * (high / low) ** 0.15)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda seconds, _: f"{seconds:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def label_point(axes: Axes, text: str, x: float, y: float, *, below: bool = False) -> None:
    """Write beside a point of a diagram."""
    axes.annotate(
        text.replace("e-0", "e-"),
        (x, y),
        (-5, -4) if below else (5, 3),
        textcoords="offset points",
        fontsize=8,
        color=DARK,
        ha="right" if below else "left",
        va="top" if below else "bottom",
    )


def _draw_settings(axes: Axes, rows: Sequence[Mapping[str, Any]], text: str) -> None:
    """Draw errors over the time that they cost, with the setting at each point."""
    log_log(axes, "seconds", "relative error")
    for time, error, color, label in (
        ("gradient", "error_gradient", ORANGE, "gradient (time of psi and gradient)"),
        ("value", "error_psi", BLUE, "psi (time of psi alone)"),
    ):
        chosen = [row for row in rows if row[error] > 0.0]
        x, y = [row[time] for row in chosen], [row[error] for row in chosen]
        axes.plot(x, y, "o-", color=color, label=label)
        for row, a, b in zip(chosen, x, y, strict=True):
            label_point(axes, text.format(row["setting"]), a, b, below=color == BLUE)
        if not chosen:
            axes.text(
                0.97, 0.75, "psi: the same\nnumber for all", color=color, ha="right",
                transform=axes.transAxes,
            )  # fmt: skip
    low, high = axes.get_xlim()
    axes.set_xlim(low / (high / low) ** 0.1, high)
    seconds_axis(axes)


def _draw_order(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    log_log(axes, "time steps", "relative error")
    n = np.array([row["setting"] for row in rows], dtype=float)
    for error, color, style, label in (
        ("error_gradient", ORANGE, "o-", "gradient"),
        ("error_psi", BLUE, "s--", "psi"),
    ):
        axes.plot(n, [row[error] for row in rows], style, color=color, label=label)
    slope = 0.4 * rows[0]["error_psi"] * (n / n[0]) ** -2.0
    axes.plot(n, slope, ":", color=GRAY, label="slope of order 2")
    axes.set_xticks(n, [f"{count:,.0f}" for count in n])
    axes.minorticks_off()
    axes.set_title("Order in time")
    axes.legend(loc="upper right")


def _draw_differences(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    log_log(axes, "step of the central difference", "relative difference")
    h = np.array([row["setting"] for row in rows])
    e = np.array([row["error_gradient"] for row in rows])
    largest = int(np.argmax(h))
    axes.plot(h, e, "o-", color=ORANGE, label="random direction")
    slope = h >= h[int(np.argmin(e))]
    axes.plot(
        h[slope], 0.3 * e[largest] * (h[slope] / h[largest]) ** 2, ":", color=GRAY,
        label="slope of order 2",
    )  # fmt: skip
    best = int(np.argmin(e))
    label_point(axes, f"{e[best]:.0e}", h[best], e[best], below=True)
    axes.set_ylim(min(e) / 10.0, max(e) * 3.0)
    axes.set_title("Exact gradient against differences")
    axes.legend(loc="upper center")
