# SPDX-License-Identifier: MIT
"""Both time integrations: time beside error of the objective, its gradient, positions and forces.

The mesh plays no part: the rod's volume integrals are computed once for each scene, on a small
mesh, and all runs share them. Errors are those against a run of Radau IIA with a far smaller
tolerance, which is itself compared with generalised-alpha runs extrapolated to the step zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress
from matplotlib.axes import Axes
from numpy.typing import NDArray
from report import Table, duration, write_page
from scene import holes_design, slider_crank
from scipy.interpolate import CubicSpline

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, DARK, GRAY, ORANGE, save, styled_figure, tidy

__all__ = ["damping", "integration_jobs", "orders", "report_integration", "work_precision"]

Array = NDArray[np.float64]
Results = list[tuple[Job, dict[str, Any]]]

SCENES = {
    "reference": "the slider-crank of the demo: 5 turns in 2 s from rest to rest",
    "fast": "the same turns so fast that the crank's speed reaches a third of the rod's first "
    "frequency",
    "stiff": "a rod 25 times as stiff, with 16 normal modes, some of them longitudinal",
    "long": "30 turns in 60 s",
}
CRANK = 0.1  # radius [m]
ERRORS = {
    "error_psi": "psi",
    "error_gradient": "gradient",
    "error_positions": "positions",
    "error_multipliers": "joint forces",
}
METHODS = {"generalised alpha": (BLUE, "o"), "Radau IIA": (ORANGE, "s")}
RADII = {"elements": [20, 2], "radii": [0.0, 0.5, 0.8, 0.9, 1.0]}
#: Names of columns, and digits of psi whose cost is told.
TARGETS = {"generalised alpha": ("alpha", (2, 4, 6)), "Radau IIA": ("radau", (2, 4, 6, 7, 8))}
#: Runs that take longer are measured once.
LONG = 0.25


def integration_jobs(*, quick: bool) -> list[Job]:
    """The jobs, one for each scene.

    Args:
        quick: Small meshes and few runs.
    """
    counts = [250 * 2**k for k in (range(2, 5) if quick else range(9))]
    tolerances = [10.0**-k for k in ((2, 4, 6) if quick else range(1, 11))]
    common = {
        "elements": [20, 2] if quick else [50, 5],
        "counts": counts,
        "tolerances": tolerances,
        "reference": 1e-7 if quick else 1e-12,
        "modes": 2 if quick else None,
        "repetitions": 1 if quick else 3,
    }
    jobs = []
    for scene in SCENES:
        own = dict(common)
        if scene == "stiff" and not quick:  # the modes are many, and their periods short
            own |= {"tolerances": tolerances[:-2], "reference": 1e-10}
        if scene == "long":  # six times as many turns
            own |= {"counts": [4 * count for count in counts[:-1]]}
            own |= {"tolerances": tolerances[:-1], "reference": 1e-6}
            if not quick:
                own |= {"tolerances": tolerances[:-3], "reference": 1e-9}
        jobs.append(
            Job("integration", "work_precision", 1.5 if quick else 35.0, {"scene": scene, **own})
        )
    jobs.append(Job("integration", "orders", 1.0 if quick else 4.0, {"elements": [20, 2]}))
    steps = 1000 if quick else 2000
    jobs.append(Job("integration", "damping", 1.0 if quick else 6.0, {**RADII, "steps": steps}))
    return jobs


# ---------------------------------------------------------------------- scenes


@dataclass(frozen=True)
class _Scene:
    mechanism: ffr.Mechanism
    bodies: dict[str, ffr.VolumeIntegrals]
    end_time: float


def _scene(comm: MPI.Comm, name: str, elements: Sequence[int], modes: int | None = None) -> _Scene:
    problem = slider_crank(
        comm, (elements[0], elements[1]), modes=modes or (16 if name == "stiff" else None)
    )
    design = holes_design(problem.flexible["rod"].domain)
    rod = problem.integrals(problem.value(design))["rod"]
    if name == "stiff":
        rod = replace(rod, K=25.0 * rod.K)
    turns, end_time = (30, 60.0) if name == "long" else (5, 2.0)
    if name == "fast":
        eigenvalues = np.linalg.eigvals(np.linalg.solve(rod.G[1:, 1:], rod.K)).real
        peak = 1.875 * 2.0 * np.pi * turns  # of a smooth step, times its duration
        end_time = peak / (np.sqrt(eigenvalues.min()) / 3.0)
    angle = ffr.Motion.smooth_step(2.0 * np.pi * turns, end_time, name="crank angle")
    pin = ffr.Revolute(("rod", "left"), ffr.Moving.circle((0.0, 0.0), CRANK, angle), "crank pin")
    mechanism = replace(problem.mechanism, joints=[pin, problem.mechanism.joints[1]])
    return _Scene(mechanism, {"rod": rod}, end_time)


@dataclass(frozen=True)
class _Numbers:
    """What is compared; positions and forces at the ends of all steps."""

    psi: float
    gradient: Array
    times: Array
    positions: Array
    velocities: Array
    accelerations: Array
    way: float
    multipliers: Array


def _run(
    scene: _Scene, integrator: ffr.GeneralizedAlpha | ffr.RadauIIA
) -> tuple[float, float, ffr.Trajectory, _Numbers]:
    """The seconds of value and of value and gradient, the motion and its numbers."""
    objective = ffr.IntegralCompliance()
    problem = ffr.MechanicalProblem(scene.mechanism, integrator, objective)
    begin = process_time()
    evaluation = problem.value(scene.bodies)
    value = process_time() - begin
    found = problem.differentiate(evaluation)
    both = process_time() - begin
    trajectory = found.trajectory
    assert trajectory is not None and found.integrals_gradient is not None
    at = np.searchsorted(trajectory.t, trajectory.step_ends)
    path = trajectory.marker_path("rod", "right")
    numbers = _Numbers(
        found.psi,
        _by_size(found.integrals_gradient["rod"], scene.bodies["rod"]),
        trajectory.t[at],
        *(_sizes(trajectory, part[at]) for part in (trajectory.y, trajectory.v, trajectory.w)),
        float(np.max(np.abs(path - path[0]))),
        trajectory.multipliers[at],
    )
    return value, both, trajectory, numbers


def _sizes(trajectory: ffr.Trajectory, coordinates: Array) -> Array:
    """Coordinates in metres, the elastic ones by the mass that they move."""
    body = trajectory.model.bodies["rod"]
    return coordinates * np.sqrt(np.concatenate([[body.mass] * 2, np.diag(body.G)]) / body.mass)


def _by_size(bar: ffr.VolumeIntegrals, body: ffr.VolumeIntegrals) -> Array:
    """Derivatives times the sizes of what they are by, which makes them comparable."""
    g, k = np.sqrt(np.diag(body.G)), np.sqrt(np.diag(body.K))
    m = np.sqrt(body.mass)
    parts = [np.array([bar.mass * body.mass]), m * g[:, None] * bar.S, np.outer(g, g) * bar.G]
    parts += [np.outer(g, g) * bar.N, np.outer(k, k) * bar.K]
    return np.concatenate([part.ravel() for part in parts])


def _violation(scene: _Scene, trajectory: ffr.Trajectory) -> float:
    """The largest distance of a pin from where it belongs [m]."""
    marker = scene.mechanism.joints[0].b
    assert isinstance(marker, ffr.Moving)
    pin = np.stack([motion.tabulate(trajectory.t)[0] for motion in (marker.x, marker.y)], axis=1)
    gap = np.max(np.abs(trajectory.marker_path("rod", "left") - pin))
    return float(max(gap, np.max(np.abs(trajectory.marker_path("rod", "right")[:, 1]))))


def _between(exact: _Numbers, times: Array) -> Array:
    """Positions between the steps, polynomials of degree 5 from those at both ends."""
    k = np.clip(np.searchsorted(exact.times, times, "right") - 1, 0, len(exact.times) - 2)
    h = (exact.times[k + 1] - exact.times[k])[:, None]
    x = (times - exact.times[k])[:, None] / h
    a, b = exact.positions[k], exact.positions[k + 1]
    va, vb = h * exact.velocities[k], h * exact.velocities[k + 1]
    wa, wb = 0.5 * h**2 * exact.accelerations[k], 0.5 * h**2 * exact.accelerations[k + 1]
    # what is left at the end by the parabola from the beginning
    p, q, r = b - a - va - wa, vb - va - 2.0 * wa, wb - wa
    cubic = 10.0 * p - 4.0 * q + r
    quartic = -15.0 * p + 7.0 * q - 2.0 * r
    quintic = 6.0 * p - 3.0 * q + r
    higher = x**3 * (cubic + x * (quartic + x * quintic))
    result: Array = a + x * (va + x * wa) + higher
    return result


def _errors(numbers: _Numbers, exact: _Numbers) -> dict[str, float]:
    def length(array: Array) -> float:
        return float(np.linalg.norm(array))

    there = _between(exact, numbers.times)
    forces = CubicSpline(exact.times, exact.multipliers)(numbers.times)
    force = float(np.max(np.abs(exact.multipliers)))
    return {
        "error_psi": abs(numbers.psi / exact.psi - 1.0),
        "error_gradient": length(numbers.gradient - exact.gradient) / length(exact.gradient),
        "error_positions": float(np.max(np.abs(numbers.positions - there))) / exact.way,
        "error_multipliers": float(np.max(np.abs(numbers.multipliers - forces))) / force,
    }


# ---------------------------------------------------------------------- measurements


def work_precision(
    comm: MPI.Comm,
    progress: Progress,
    *,
    scene: str,
    elements: Sequence[int],
    modes: int | None,
    counts: Sequence[int],
    tolerances: Sequence[float],
    reference: float,
    repetitions: int,
) -> dict[str, Any]:
    """Measure time and error of both methods.

    Args:
        comm: The ranks.
        progress: Told the part that is done.
        scene: Its name.
        elements: Along and across the rod.
        modes: Number of normal modes, by default that of the demo.
        counts: Numbers of steps of the generalised-alpha method.
        tolerances: Of Radau IIA.
        reference: Tolerance of the run that all are compared with.
        repetitions: Of the short runs, the shortest of which counts.
    """
    made = _scene(comm, scene, elements, modes)
    methods: list[tuple[str, float, ffr.GeneralizedAlpha | ffr.RadauIIA]] = [
        *(("generalised alpha", float(n), ffr.GeneralizedAlpha(made.end_time, n)) for n in counts),
        *(("Radau IIA", t, ffr.RadauIIA(made.end_time, tolerance=t)) for t in tolerances),
    ]
    for _, _, integrator in (methods[0], methods[-len(tolerances)]):
        _run(made, integrator)  # compiled, loaded
    exact = _run(made, ffr.RadauIIA(made.end_time, tolerance=reference))[3]
    progress(0.4)
    rows: list[dict[str, Any]] = []
    for repetition in range(repetitions):
        for place, (method, setting, integrator) in enumerate(methods):
            if repetition and rows[place]["seconds_gradient"] > LONG:
                continue  # measured once
            value, both, trajectory, numbers = _run(made, integrator)
            if repetition:
                row = rows[place]
                row["seconds"] = min(row["seconds"], value)
                row["seconds_gradient"] = min(row["seconds_gradient"], both)
                continue
            progress(0.4 + 0.6 * (place + 1) / len(methods))
            rows.append(
                {
                    "scene": scene,
                    "method": method,
                    "setting": setting,
                    "steps": trajectory.step_ends.size - 1,
                    "seconds": value,
                    "seconds_gradient": both,
                    **_errors(numbers, exact),
                    "psi": numbers.psi,
                    "violation": _violation(made, trajectory),
                }
            )
    constant = [row["psi"] for row in rows if row["method"] == "generalised alpha"]
    return {
        "rows": rows,
        "end_time": made.end_time,
        "check": abs(_extrapolated(constant[-4:]) / exact.psi - 1.0),
        "coordinates": len(made.bodies["rod"].K) + 3,
    }


def _extrapolated(values: Sequence[float]) -> float:
    """Values with steps that halve each time, extrapolated to the step zero."""
    # the error is that of the method, h^2, then h^3
    for power in (2, 3)[: len(values) - 1]:
        factor = 2.0**power
        values = [(factor * fine - coarse) / (factor - 1.0) for coarse, fine in pairwise(values)]
    return values[-1]


def orders(comm: MPI.Comm, progress: Progress, *, elements: Sequence[int]) -> dict[str, Any]:
    """Measure errors of both methods with fixed steps, on the fast scene with few slow modes.

    Args:
        comm: The ranks.
        progress: Told the part that is done.
        elements: Along and across the rod.
    """
    made = _scene(comm, "fast", elements)
    made = replace(made, bodies={"rod": made.bodies["rod"].leading(3)})
    exact = _run(made, ffr.RadauIIA(made.end_time, steps=3200))[3]
    rows = []
    for method, counts in (
        ("generalised alpha", (1600, 3200, 6400)),
        ("Radau IIA", (200, 400, 800)),
    ):
        for count in counts:
            integrator: ffr.GeneralizedAlpha | ffr.RadauIIA
            if method == "Radau IIA":
                integrator = ffr.RadauIIA(made.end_time, steps=count)
            else:
                integrator = ffr.GeneralizedAlpha(made.end_time, count)
            errors = _errors(_run(made, integrator)[3], exact)
            rows.append({"method": method, "steps": count, **errors})
    progress(1.0)
    return {"rows": rows}


def damping(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: Sequence[int],
    radii: Sequence[float],
    steps: int,
) -> dict[str, Any]:
    """Measure errors of the generalised-alpha method with more or less numerical damping.

    Args:
        comm: The ranks.
        progress: Told the part that is done.
        elements: Along and across the rod.
        radii: Spectral radii at infinite frequency.
        steps: Number of steps.
    """
    rows = []
    for scene in ("reference", "fast"):
        made = _scene(comm, scene, elements)
        exact = _run(made, ffr.RadauIIA(made.end_time, tolerance=1e-6))[3]
        for radius in radii:
            integrator = ffr.GeneralizedAlpha(made.end_time, steps, radius)
            errors = _errors(_run(made, integrator)[3], exact)
            rows.append({"scene": scene, "radius_text": f"{radius:g}", "steps": steps, **errors})
        progress(len(rows) / (2.0 * len(radii)))
    return {"rows": rows}


# ---------------------------------------------------------------------- report


def report_integration(results: Results, directory: Path) -> list[Table]:
    """Write tables and picture.

    Args:
        results: Of `integration_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    found = {
        job.parameters["scene"]: result
        for job, result in results
        if job.function == "work_precision"
    }
    rows = [row for result in found.values() for row in result["rows"]]
    columns = {"method": "method", "steps": "steps"}
    measured = {f"{key}": f"error of {name}" for key, name in ERRORS.items()}
    main = Table(
        "integration",
        "Time and error of each run",
        "Slider-crank with a rod full of holes, given by its volume integrals. "
        + "; ".join(f"*{name}*: {text}" for name, text in SCENES.items())
        + ". Setting: number of steps of the generalised-alpha method, tolerance of Radau IIA. "
        "Processor seconds: simulation and objective, and these with the gradient. Relative errors "
        "of psi; of its gradient with respect to all volume integrals, each times its size; of the "
        "positions and of the joint forces, the largest of all ends of steps, relative to the way "
        "of the slider and to the largest force. Gap: largest distance of a pin from its place.",
        {
            "scene": "scene",
            "method": "method",
            "setting": "setting",
            "steps": "steps",
            "seconds": "time [s]",
            "seconds_gradient": "with gradient [s]",
            **measured,
            "violation": "gap [m]",
        },
        rows,
    )
    summary = Table(
        "integration_summary",
        "What an accuracy of psi costs",
        "Processor time of one simulation to each relative error of psi, interpolated between the "
        "runs; runs that are as accurate only by chance, since finer ones are not, do not count; "
        "- where no run is as accurate. Ratio: Radau IIA to 1e-8 over "
        "generalised alpha to 1e-4. Reference: how far psi is from that of the generalised-alpha "
        "runs extrapolated to the step zero.",
        {
            "scene": "scene",
            **{
                f"{short}_{digit}_text": f"{method} 1e-{digit}"
                for method, (short, digits) in TARGETS.items()
                for digit in digits
            },
            "ratio_text": "ratio",
            "check": "reference",
        },
        [{"scene": name, **_costs(result)} for name, result in found.items()],
    )
    fixed = next(result for job, result in results if job.function == "orders")
    order = Table(
        "integration_orders",
        "Order of the errors with fixed steps",
        "The fast scene with the three slowest shape functions, whose vibrations all steps "
        "resolve.",
        {**columns, **measured},
        fixed["rows"],
    )
    damped = next(result for job, result in results if job.function == "damping")
    damping_table = Table(
        "integration_damping",
        "Numerical damping of the generalised-alpha method",
        "Spectral radius at infinite frequency: 1 damps no vibration, 0 removes those that the "
        "steps do not resolve.",
        {"scene": "scene", "radius_text": "spectral radius", "steps": "steps", **measured},
        damped["rows"],
    )
    tables = [summary, main, order, damping_table]
    _draw(found, directory / "integration.png")
    picture = "![Time beside error of both time integrations](integration.png)"
    write_page(directory, "integration", "Time integration", picture, tables)
    return tables


def _costs(result: dict[str, Any]) -> dict[str, Any]:
    costs = {}
    for method, (short, digits) in TARGETS.items():
        own = [row for row in result["rows"] if row["method"] == method]
        for digit in digits:
            costs[f"{short}_{digit}"] = _seconds(own, "error_psi", 10.0**-digit)
    ratio = costs["radau_8"] / costs["alpha_4"]
    texts = {f"{key}_text": duration(t) if np.isfinite(t) else "-" for key, t in costs.items()}
    return {
        **texts,
        "ratio_text": f"{ratio:.2g}" if np.isfinite(ratio) else "-",
        "check": result["check"],
    }


def _seconds(rows: Sequence[dict[str, Any]], error: str, target: float) -> float:
    """The seconds to an error, or NaN where no run is as accurate."""
    # the largest error of a run and of all finer ones
    errors = np.maximum.accumulate([row[error] for row in rows][::-1])[::-1]
    seconds = np.array([row["seconds"] for row in rows])
    reached = np.flatnonzero(errors <= target)
    if not len(reached):
        return float("nan")
    k = int(reached[0])
    if k == 0:
        return float(seconds[0])
    ends = np.log(np.maximum(errors[k - 1 : k + 1], 1e-300))
    share = (ends[0] - np.log(target)) / max(ends[0] - ends[1], 1e-12)
    return float(np.exp((1.0 - share) * np.log(seconds[k - 1]) + share * np.log(seconds[k])))


def _draw(found: dict[str, dict[str, Any]], path: Path) -> None:
    with styled_figure(11.0, 8.4) as figure:
        panels = figure.subplots(2, 2, sharey=True).ravel()
        for axes, (name, result) in zip(panels, found.items(), strict=True):
            for method, (color, marker) in METHODS.items():
                own = [row for row in result["rows"] if row["method"] == method]
                _curve(axes, own, "seconds", "error_psi", color, marker, "-", f"{method}: psi")
                _curve(
                    axes, own, "seconds_gradient", "error_gradient", color, marker, "--",
                    f"{method}: gradient",
                )  # fmt: skip
            for target in (1e-4, 1e-8):
                axes.axhline(target, color=GRAY, linewidth=0.7, zorder=0)
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_ylim(1e-13, 1.0)
            axes.set_title(name, loc="left", color=DARK)
            axes.set_xlabel("seconds")
            tidy(axes)
        for axes in panels[::2]:
            axes.set_ylabel("relative error")
        panels[0].legend(loc="lower left", fontsize=8)
        figure.tight_layout(w_pad=1.5, h_pad=1.5)
        save(figure, path)


def _curve(
    axes: Axes,
    rows: Sequence[dict[str, Any]],
    seconds: str,
    error: str,
    color: str,
    marker: str,
    style: str,
    label: str,
) -> None:
    axes.plot(
        [row[seconds] for row in rows],
        [max(row[error], 1e-13) for row in rows],
        linestyle=style,
        marker=marker,
        markersize=4 if style == "-" else 3,
        markerfacecolor=color if style == "-" else "white",
        color=color,
        linewidth=1.6 if style == "-" else 1.0,
        label=label,
    )
