# SPDX-License-Identifier: MIT
"""The lower bound of psi over meshes: how near it comes to the best sheet, and what it takes."""

from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress, Results
from report import Study, line, plot
from scene import slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, ORANGE

LENGTH, HEIGHT = 0.4, 0.04  # of the demo's rod, whose ends need not be solid here [m]


def bound_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each mesh."""
    meshes = [(20, 2), (40, 4)] if quick else [(50, 5), (100, 10), (200, 20), (400, 40)]
    return [Job("bound", "bounded", 1e-4 * n * m + 3.0, {"elements": (n, m)}) for n, m in meshes]


def bounded(comm: MPI.Comm, progress: Progress, *, elements: list[int]) -> dict[str, Any]:
    """The bound on one mesh beside the time of one value and gradient of a design."""
    nx, ny = elements
    rod = ffr.Domain.rectangle(comm, LENGTH, HEIGHT, elements=(nx, ny), solid_columns=0)
    problem = slider_crank(comm, (nx, ny), domain=rod)
    problem.gradient(np.full(rod.n_cells, 0.5))  # compiled, and all that is made once
    began = process_time()
    problem.gradient(np.full(rod.n_cells, 0.5))
    gradient = process_time() - began
    progress(0.3)
    ffr.bound(problem)
    began = process_time()
    found = ffr.bound(problem)
    seconds = process_time() - began
    return {
        "mesh": f"{nx} × {ny}",
        "cells": nx * ny,
        "sheet": found.sheet_psi / found.full,
        "bound": found.psi / found.full,
        "apart": found.sheet_psi / found.psi - 1.0,
        "volume": found.sheet_volume["rod"],
        "seconds": seconds,
        "ratio": seconds / gradient,
    }


def report_bound(study: Study, results: Results) -> None:
    """Table and picture."""
    rows = [result for _, result in results]
    study.table("bound", rows)
    with study.picture("Best sheet and bound over meshes", 1, 2, (8.0, 3.4)) as panels:
        line(panels[0], rows, "cells", "sheet", "s-", ORANGE, label="best sheet")
        line(panels[0], rows, "cells", "bound", "o-", BLUE, label="no part has less")
        plot(
            panels[0],
            "psi relative to that of the full rod",
            "elements",
            "",
            scales="x",
            legend="upper right",
        )
        line(panels[1], rows, "cells", "seconds", "o-", BLUE)
        plot(panels[1], "processor time", "elements", "seconds")
