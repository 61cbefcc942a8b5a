# SPDX-License-Identifier: MIT
"""Time beside error: steps, tolerance; and the gradient against differences."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress, Results, measure, the
from matplotlib.axes import Axes
from report import Rows, Study, line, plot, tick_labels
from scene import holes_design, slider_crank, with_rod

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, GRAY, ORANGE


def accuracy_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each choice that a user can make."""
    elements = [40, 4] if quick else [200, 20]
    common = {"elements": elements, "repetitions": 0 if quick else 5}
    counts: list[int] = [500, 1000] if quick else [500, 1000, 2000, 4000, 8000, 16000]
    tolerances = [10.0**-k for k in ((4, 8, 11) if quick else range(4, 13))]
    sizes = [1e-2, 1e-3, 1e-4] if quick else [10.0 ** (-0.5 * k) for k in range(3, 13)]
    own = {
        "number_of_steps": (30.0, {**common, "settings": counts, "reference": 4 * counts[-1]}),
        "solver_tolerance": (20.0, {**common, "settings": tolerances, "reference": 1e-13}),
        "central_differences": (15.0, {"elements": elements, "settings": sizes}),
    }
    return [
        Job("accuracy", name, 4.0 if quick else seconds, parameters)
        for name, (seconds, parameters) in own.items()
    ]


def number_of_steps(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], settings: list[int], **how: Any
) -> dict[str, Any]:
    """Vary the number of time steps; other parameters as in `against_reference`."""
    domain = slider_crank(comm, elements).flexible["rod"].domain
    every = [*settings, how["reference"]]
    problems = {n: slider_crank(comm, domain=domain, steps=n) for n in every}
    return against_reference(problems, progress, **how)


def solver_tolerance(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], settings: list[float], **how: Any
) -> dict[str, Any]:
    """Vary the tolerance of eigenvalue problem and adjoint systems, as in `against_reference`."""
    problem = slider_crank(comm, elements)
    problems = {t: with_rod(problem, tolerance=t) for t in [*settings, how["reference"]]}
    return against_reference(problems, progress, **how)


def against_reference(
    problems: Mapping[Any, ffr.Problem], progress: Progress, *, reference: Any, repetitions: int
) -> dict[str, Any]:
    """Measure times and errors: a row for each setting, and what they are compared with."""
    x = holes_design(next(iter(problems.values())).flexible["rod"].domain)
    exact = problems[reference].gradient(x)
    slope = exact.gradient["rod"]
    settings = [setting for setting in problems if setting != reference]
    actions: dict[Any, Any] = {}
    for setting in settings:
        actions["value", setting] = partial(problems[setting].value, x)
        actions["gradient", setting] = partial(problems[setting].gradient, x)
    seconds, found = measure(actions, repetitions, progress)
    rows = []
    for setting in settings:
        evaluation = found["gradient", setting]
        away = np.linalg.norm(evaluation.gradient["rod"] - slope) / np.linalg.norm(slope)
        rows.append(
            {
                "setting": setting,
                **{name: min(seconds[name, setting]) for name in ("value", "gradient")},
                "psi": evaluation.psi,
                "error_psi": abs(evaluation.psi / exact.psi - 1.0),
                "error_gradient": float(away),
                "gap": evaluation.outer_gap["rod"],
                "iterations": evaluation.solver_iterations["rod"],
            }
        )
    return {"rows": rows, "reference": reference, "elements": len(x)}


def central_differences(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], settings: list[float]
) -> dict[str, Any]:
    """Compare the gradient along a random direction with central differences of several steps."""
    problem = slider_crank(comm, elements)
    domain = problem.flexible["rod"].domain
    x = 0.05 + 0.9 * holes_design(domain)  # room for a step both ways
    direction = np.random.default_rng(0).uniform(-1.0, 1.0, domain.n_cells)
    slope = float(problem.gradient(x).gradient["rod"] @ direction)
    rows = []
    for place, step in enumerate(settings):
        ahead, behind = (problem.value(x + s * step * direction).psi for s in (1.0, -1.0))
        difference = (ahead - behind) / (2.0 * step)
        rows.append({"setting": step, "error_gradient": abs(difference / slope - 1.0)})
        progress((place + 1) / len(settings))
    return {"rows": rows, "slope": slope}


def report_accuracy(study: Study, results: Results) -> None:
    """Tables of steps, tolerances and differences, and a picture."""
    names = ("number_of_steps", "solver_tolerance", "central_differences")
    steps, tolerance, found = (the(name, results) for name in names)
    differences = found["rows"]
    study.table("accuracy_steps", **steps)
    study.table("accuracy_tolerance", **tolerance)
    study.table("accuracy_differences", differences)
    caption = "Error over time for steps and tolerance"
    with study.picture(caption, 2, 2, (9.0, 8.0)) as (left, right, order, step):
        draw_settings(left, steps["rows"], "Time steps", "{setting:,.0f}")
        draw_settings(right, tolerance["rows"], "Tolerance of the solvers", "{setting:.0e}")
        for error, color, style in (("gradient", ORANGE, "o-"), ("psi", BLUE, "s--")):
            line(order, steps["rows"], "setting", f"error_{error}", style, color, label=error)
        _slope(order, steps["rows"], "error_psi", -2)
        plot(order, "Order in time", "time steps", "relative error", legend="upper right")
        line(step, differences, "setting", "error_gradient", "o-", ORANGE, label="random direction")
        _slope(step, [row for row in differences if row["setting"] >= 1e-3], "error_gradient", 2)
        title, x = "Exact gradient against differences", "step of the central difference"
        plot(step, title, x, "relative difference", legend="upper center")


def draw_settings(axes: Axes, rows: Rows, title: str, text: str) -> None:
    """Draw errors over the time that they cost, with ``text`` of its row at each point."""
    for time, error, color, label in (
        ("gradient", "error_gradient", ORANGE, "gradient (time of psi and gradient)"),
        ("value", "error_psi", BLUE, "psi (time of psi alone)"),
    ):
        line(axes, rows, time, error, "o-", color, label=label)
        tick_labels(axes, rows, time, error, text, below=color == BLUE)
    plot(axes, title, "seconds", "relative error", room=0.2, legend="upper right")


def _slope(axes: Axes, rows: Rows, error: str, order: int) -> None:
    """Draw what an error of an order would be, below the measured one."""
    n = np.array([row["setting"] for row in rows], dtype=float)
    label = f"slope of order {abs(order)}"
    axes.plot(n, 0.4 * rows[0][error] * (n / n[0]) ** order, ":", color=GRAY, label=label)
