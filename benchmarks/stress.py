# SPDX-License-Identifier: MIT
"""The largest stress beside compliance: processor time of values and gradients, in turn."""

from functools import partial
from statistics import median
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress, Results, measure
from report import Study, chosen, line, plot
from scene import slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, ORANGE

#: Meshes as parts have, with the gradient by their nodes, and elements with that by densities
MESHES: dict[str, dict[str, Any]] = {
    "nodes": {"elements": [120, 6], "cell": "triangle", "order": 2},
    "densities": {"elements": [200, 20]},
}
STEPS = (500, 1000, 2000, 4000)


def stress_jobs(*, quick: bool) -> list[Job]:
    """The jobs, one for each mesh and number of steps."""
    kinds = [(kind, steps) for kind in MESHES for steps in (STEPS[:1] if quick else STEPS)]
    own = {"repetitions": 1, "elements": [20, 2]} if quick else {"repetitions": 9}
    each = [{**MESHES[kind], "kind": kind, "steps": steps, **own} for kind, steps in kinds]
    return [Job("stress", "cost", 1.0 if quick else 12.0, job) for job in each]


def cost(
    comm: MPI.Comm,
    progress: Progress,
    *,
    repetitions: int,
    kind: str,
    elements: list[int],
    **own: Any,
) -> dict[str, Any]:
    """Times of a full rod."""
    plain = slider_crank(comm, elements, **own)
    peak = ffr.PeakStress("rod")
    stressed = ffr.Problem(plain.bodies, plain.mechanism, plain.integrator, peak)
    cells = plain.flexible["rod"].domain.n_cells
    x, by = np.ones(cells), {"nodes": kind == "nodes", "densities": kind == "densities"}

    def both(problem: ffr.Problem) -> ffr.Evaluation:
        return problem.differentiate(problem.value(x), **by)

    calls: dict[str, Any] = {}
    for name, problem in (("compliance", plain), ("stress", stressed)):
        calls |= {f"{name}_value": partial(problem.value, x), name: partial(both, problem)}
    seconds, _ = measure(calls, repetitions, progress, process_time)
    found = {name: median(times) for name, times in seconds.items()}
    found["ratio_value"] = found["stress_value"] / found["compliance_value"]
    mesh = f"{cells:,} {own.get('cell', 'quadrilateral')}s"
    ratio = found["stress"] / found["compliance"]
    return {"mesh": mesh, "kind": kind, "steps": own["steps"], **found, "ratio": ratio}


def report_stress(study: Study, results: Results) -> None:
    """The table, and the ratios over the number of steps."""
    study.table("stress", rows := [row for _, row in results])
    title = "The largest stress over compliance"
    with study.picture(title, 1, 1, (9.0, 4.6)) as (axes,):
        for kind, color in zip(MESHES, (BLUE, ORANGE), strict=True):
            own = chosen(rows, kind=kind)
            label = f"{own[0]['mesh']}, by {kind}"
            line(axes, own, "steps", "ratio", "o-", color, label=f"{label}: value and gradient")
            line(axes, own, "steps", "ratio_value", "o--", color, label=f"{label}: value")
        y = "ratio of processor times"
        plot(axes, title, "time steps", y, scales="", room=0.4, legend="upper left")
