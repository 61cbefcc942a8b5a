# SPDX-License-Identifier: MIT
"""Equivalent static loads beside the gradient of the whole motion: what each ends with, and costs.

The three ways and both scenes are those of `demos/equivalent_static_loads.py`.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from mpi4py import MPI

from designs import draw_parts, rings
from jobs import Job, Progress
from report import Table, write_page
from scene import demo, warm_up

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import save, styled_figure

__all__ = ["report_static_loads", "static_loads_jobs", "three_ways"]

#: Words for the scenes of the demo
SCENES = {"slider_crank": "slider-crank", "four_bar": "four-bar linkage"}


def static_loads_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each scene."""
    numbers: dict[str, Any] = {"elements": [200, 20], "iterations": 60, "cycles": 6}
    if quick:
        numbers = {"elements": [30, 6], "iterations": 2, "cycles": 1, "parts": False}
    seconds = {"slider_crank": 150.0, "four_bar": 400.0}
    return [
        Job(
            "static_loads",
            "three_ways",
            10.0 if quick else seconds[scene],
            {"scene": scene, **numbers},
        )
        for scene in list(SCENES)[: 1 if quick else None]
    ]


def three_ways(
    comm: MPI.Comm,
    progress: Progress,
    *,
    scene: str,
    elements: list[int],
    iterations: int,
    cycles: int,
    parts: bool = True,
) -> dict[str, Any]:
    """Design in three ways from the same even gray, and move designs and parts with many modes.

    Args:
        comm: Communicator over which the meshes are distributed.
        progress: Told the part that is done.
        scene: Of the demo.
        elements: Along and across.
        iterations: Of each optimisation.
        cycles: Of frozen loads, at most.
        parts: Whether the parts are moved, too.
    """
    warm_up(comm)
    loads = demo("equivalent_static_loads")
    problem = loads.SCENES[scene](comm, (elements[0], elements[1]))
    full = loads.full_psi(problem)
    rows: list[dict[str, Any]] = []
    for name, way in loads.WAYS.items():
        found = way(problem, iterations, cycles)
        many, evaluation = loads.judged(problem, found)
        row = {
            "scene": SCENES[scene],
            "way": name,
            "psi": evaluation.psi / full,
            "part": float("nan"),
            "volume": max(evaluation.volume.values()),
            "simulations": found.simulations,
            "adjoints": found.adjoints,
            "static": found.static,
            "cpu": found.seconds,
            "cycles": [psi / full for psi in found.history],
        }
        if parts:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of loose pieces, which the picture shows
                row |= _part(many, evaluation, found.result, full)
        rows.append(row)
        progress(len(rows) / len(loads.WAYS))
    return {
        "rows": rows,
        "elements": sum(body.domain.n_cells_global for body in problem.flexible.values()),
        "modes": loads.JUDGE,
        "method": f"{problem.integrator.times.size - 1} steps of "
        f"{type(problem.integrator).__name__}",
        "iterations": iterations,
    }


def _part(
    problem: ffr.Problem, evaluation: ffr.Evaluation, result: ffr.Result, full: float
) -> dict[str, Any]:
    """What the boundary of a design encloses, and psi of that; nothing if it cannot be moved."""
    try:
        parts = {name: result.part(name) for name in problem.flexible}
        psi = ffr.verify(problem, parts, evaluation).psi
    except (ValueError, ffr.SimulationError):
        return {}
    return {"part": psi / full, "rings": rings(parts)}


# ---------------------------------------------------------------------- table and picture


def report_static_loads(results: list[tuple[Job, dict[str, Any]]], directory: Path) -> list[Table]:
    """Write table and picture.

    Args:
        results: Of `static_loads_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    rows = []
    for _, result in results:
        whole = result["rows"][0]
        rows += [
            {
                **row,
                "excess": row["psi"] / whole["psi"] - 1.0,
                "part_excess": row["part"] / whole["part"] - 1.0,
            }
            for row in result["rows"]
        ]
    first = results[0][1]
    sizes = "; ".join(
        f"{result['rows'][0]['scene']}: {result['elements']:,} elements, {result['method']}"
        for _, result in results
    )
    table = Table(
        "static_loads",
        "Three ways to a design",
        f"{sizes}. Each way begins with the same even gray and takes {first['iterations']} "
        "iterations of the method of moving asymptotes in each optimisation. *Whole motion* "
        "follows the exact gradient of the simulation; *renewed in cycles* freezes the loads of "
        "all instants, optimises statically and simulates again, until psi stands or six times, "
        "and the best of its designs counts; *renewed in iterations* simulates in each iteration "
        "and leaves out that the loads change with the design. psi is that of the motion, by the "
        "densities and by meshes that fit the boundary of the part, over that of the full bodies, "
        f"all with {first['modes']} normal modes. *More* is beside the whole motion. *CPU* is that "
        "of the design alone.",
        {
            "scene": "scene",
            "way": "way",
            "psi": "psi",
            "excess": "more",
            "part": "psi of the part",
            "part_excess": "more",
            "volume": "volume",
            "simulations": "simulations",
            "adjoints": "adjoints",
            "static": "static analyses",
            "cpu": "CPU [s]",
        },
        rows,
    )
    cycles = Table(
        "static_loads_cycles",
        "From cycle to cycle",
        "psi by the coupled simulation of the design at the end of each static optimisation, with "
        "the modes of the scene, over that of the full bodies.",
        {"scene": "scene", "cycle": "cycle", "psi": "psi"},
        [
            {"scene": row["scene"], "cycle": k + 1, "psi": psi}
            for row in rows
            for k, psi in enumerate(row["cycles"])
            if row["static"]
        ],
    )
    _draw(rows, directory / "static_loads.png")
    picture = "![The parts of three ways in two scenes](static_loads.png)"
    title = "Equivalent static loads"
    write_page(directory, "static_loads", title, picture, [table, cycles])
    return [table, cycles]


def _draw(rows: list[dict[str, Any]], path: Path) -> None:
    """All parts: a column for each scene, a line for each way."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    ways = list(dict.fromkeys(row["way"] for row in rows))
    with styled_figure(10.0, 4.8, dpi=90.0) as figure:
        for row in rows:
            place = ways.index(row["way"]) * len(scenes) + scenes.index(row["scene"])
            axes = figure.add_subplot(len(ways), len(scenes), place + 1)
            draw_parts(axes, row.get("rings", {}))
            what = f"psi {row['psi']:.3f}, of the part {row['part']:.3f}"
            axes.set_title(f"{row['scene']}, {row['way']}:\n{what}", fontsize=9, loc="left")
        figure.subplots_adjust(0.01, 0.01, 0.99, 0.93, 0.04, 0.32)
        save(figure, path)
