# SPDX-License-Identifier: MIT
"""Where linear elasticity in a floating frame ends: beside full nonlinear finite elements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from accuracy import label_point, log_log
from jobs import Job, Progress
from matplotlib.axes import Axes
from numpy.typing import NDArray
from report import Table, write_page
from scene import demo

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, DARK, GRAY, ORANGE, RED, save, styled_figure

__all__ = ["deformation", "model_jobs", "report_model"]

Array = NDArray[np.float64]
Results = list[tuple[Job, dict[str, Any]]]

LINEAR, STIFFENED, FULL = "linear", "with geometric stiffening", "full nonlinear"
MODELS = {LINEAR: BLUE, STIFFENED: ORANGE}


def model_jobs(*, quick: bool) -> list[Job]:
    """The measurement."""
    moduli = [2e9, 2e7, 1e6] if quick else [4e9, 1e9, 2e8, 5e7, 2e7, 1e7, 5e6, 2e6, 1e6, 5e5]
    return [
        Job(
            "model",
            "deformation",
            10.0 if quick else 130.0,
            {
                "elements": [10, 1] if quick else [20, 1],
                "moduli": moduli,
                "steps": 200 if quick else 800,
                "modes": 8,
                "repetitions": 1 if quick else 5,
            },
        )
    ]


# ---------------------------------------------------------------------- measurements


def deformation(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: list[int],
    moduli: list[float],
    steps: int,
    modes: int,
    repetitions: int,
) -> dict[str, Any]:
    """Let the demo's pendulum fall, softer and softer, in all three models.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        elements: Along and across, biquadratic ones.
        moduli: Young's moduli [Pa].
        steps: Number of time steps.
        modes: Normal modes of the floating frame.
        repetitions: Of the floating frame; the fastest counts.
    """
    pendulum = demo("pendulum")
    size = (elements[0], elements[1])
    domain = pendulum.pendulum(comm, size)
    for stiffening in (False, True):  # whatever is compiled once
        pendulum.floating_frame(domain, 1, 10, stiffening=stiffening)
    rows: list[dict[str, Any]] = []
    failed: list[dict[str, Any]] = []
    for place, young in enumerate(moduli):
        material = replace(pendulum.RUBBER, young=young)
        tip, middle, seconds = pendulum.full_model(steps, size, material=material)
        bending = _bending(tip, middle)
        largest = float(np.abs(bending).max())
        common = {"young": young, "deflection": largest / pendulum.LENGTH}
        for model in MODELS:
            try:
                runs = [
                    pendulum.floating_frame(
                        domain, modes, steps, stiffening=model == STIFFENED, material=material
                    )
                    for _ in range(repetitions)
                ]
            except ffr.SimulationError:
                failed.append({**common, "model": model})
                continue
            _, evaluation, _ = runs[0]
            trajectory = evaluation.trajectory
            own_tip = trajectory.marker_path("bar", "right")
            own = _bending(own_tip, trajectory.marker_path("bar", "middle"))
            rows.append(
                {
                    **common,
                    "model": model,
                    "error_tip": float(np.linalg.norm(own_tip - tip, axis=1).max())
                    / pendulum.LENGTH,
                    "error_deflection": float(np.abs(own - bending).max()) / largest,
                    "seconds": min(run[2] for run in runs),
                    "seconds_full": seconds,
                }
            )
        progress((place + 1) / len(moduli))
    return {"rows": rows, "failed": failed, "steps": steps, "modes": modes, "elements": elements}


def _bending(tip: Array, middle: Array) -> Array:
    """The distance of the middle from the chord, which begins in the origin."""
    normal = np.column_stack([-tip[:, 1], tip[:, 0]])
    result: Array = np.sum(middle * normal, axis=1) / np.linalg.norm(tip, axis=1)
    return result


# ---------------------------------------------------------------------- table and picture


def report_model(results: Results, directory: Path) -> list[Table]:
    """Write table and picture.

    Args:
        results: Of `model_jobs`.
        directory: Where to.

    Returns:
        The table.
    """
    ((_, result),) = results
    failures = "; ".join(
        f"{row['model']} at E = {row['young']:.0e} Pa (deflection {row['deflection']:.2f})"
        for row in result["failed"]
    )
    table = Table(
        "model",
        "Size of the deformation",
        "A bar of 1 m, hinged at one end, falls from the horizontal for one second; "
        f"{result['elements'][0]} x {result['elements'][1]} biquadratic quadrilaterals and "
        f"{result['steps']:,} steps of generalised-alpha in both models, {result['modes']} normal "
        "and three constraint modes in the floating frame. *Deflection* is the largest distance of "
        "the middle from the chord over the length, in the full model (St Venant-Kirchhoff, all "
        "nodes, large rotations exact). Errors are the largest distance of the tips over the "
        "length, and the largest difference of the deflections over the largest deflection: the "
        "bar rings, and a wrong frequency soon shows. Times are those of the motion, "
        "the reduction included; the full model is a plain Newton method with DOLFINx's assembly "
        "and SciPy's sparse solver. For the stiffest bars the errors are those of the time step. "
        + (f"No motion was found: {failures}." if failures else "All motions were found."),
        {
            "young": "Young's modulus [Pa]",
            "deflection": "deflection / length",
            "model": "floating frame",
            "error_tip": "error of the tip / length",
            "error_deflection": "relative error of the deflection",
            "seconds": "floating frame [s]",
            "seconds_full": "full model [s]",
        },
        result["rows"],
    )
    _draw(result, directory / "model.png")
    picture = "![Errors of the floating frame over the size of the deformation](model.png)"
    write_page(directory, "model", "Floating frame beside full finite elements", picture, [table])
    return [table]


def _draw(result: Mapping[str, Any], path: Path) -> None:
    rows, failed = result["rows"], result["failed"]
    with styled_figure(13.5, 4.6) as figure:
        axes = figure.subplots(1, 3)
        for place, error, title in (
            (axes[0], "error_tip", "Distance of the tips / length"),
            (axes[1], "error_deflection", "Relative error of the deflection"),
        ):
            log_log(place, "largest deflection / length", "error")
            _draw_errors(place, rows, failed, error)
            place.set_title(title)
        axes[0].legend(loc="upper left")
        _draw_times(axes[2], rows)
        figure.tight_layout(w_pad=2.0)
        save(figure, path)


def _draw_errors(
    axes: Axes, rows: Sequence[Mapping[str, Any]], failed: Sequence[Mapping[str, Any]], error: str
) -> None:
    top = max(row[error] for row in rows)
    for model, color in MODELS.items():
        own = sorted((r for r in rows if r["model"] == model), key=lambda r: r["young"])
        # softer bars do not bend further in the same second: the line follows the modulus
        axes.plot(
            [row["deflection"] for row in own], [row[error] for row in own], "o-", color=color,
            label=model, ms=5.0,
        )  # fmt: skip
        lost = [row["deflection"] for row in failed if row["model"] == model]
        axes.plot(lost, [2.0 * top] * len(lost), "x", color=color, ms=8.0, mew=2.0)
    if failed:
        axes.plot([], [], "x", color=DARK, label="no motion found")
    axes.axhline(1e-2, color=GRAY, lw=1.0, ls=":")
    label_point(axes, "1 %", axes.get_xlim()[0], 1e-2)


def _draw_times(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    log_log(axes, "largest deflection / length", "seconds")
    for model, color in MODELS.items():
        own = sorted((r for r in rows if r["model"] == model), key=lambda r: r["young"])
        axes.plot(
            [row["deflection"] for row in own], [row["seconds"] for row in own], "o-",
            color=color, label=f"floating frame, {model}", ms=5.0,
        )  # fmt: skip
    full = {row["young"]: row for row in rows}
    own = [full[young] for young in sorted(full)]
    axes.plot(
        [row["deflection"] for row in own], [row["seconds_full"] for row in own], "s-", color=RED,
        label=FULL, ms=5.0,
    )  # fmt: skip
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.35)
    axes.set_title("Time of one motion")
    axes.legend(loc="upper left")
