# SPDX-License-Identifier: MIT
"""What more ranks bring: a model from the parts of one rank, beside two ranks as measured."""

from collections.abc import Callable
from functools import wraps
from time import perf_counter
from typing import Any

from mpi4py import MPI

import numpy as np
from growth import PARTS, Row
from jobs import Job, Progress, Results, measure
from report import Study, line, plot
from scene import holes_design, slider_crank, warm_up

from dolfinx_ffr.plotting.style import BLUE, DARK, GRAY, ORANGE
from dolfinx_ffr.reduction import FactoredBody
from dolfinx_ffr.reduction.direct_solver import HOLDERS

#: Ranks for which the model is told
RANKS = 2, 4, 16, 64
#: Every rank does this for itself
ALONE = "simulation", "adjoint"
#: Widths of blocks by which the time of a solution is measured
WIDTHS = 1, 2, 4, 8, 16


def ranks_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each mesh and number of ranks."""
    if quick:  # elements, repetitions, seconds
        sizes = [((20, 2), 1, 1.0)]
    else:
        sizes = [((200, 20), 9, 10.0), ((400, 40), 5, 15.0), ((800, 80), 3, 40.0)]
        sizes += [((80, 8, 8), 5, 30.0), ((80, 16, 16), 3, 60.0)]
    return [
        Job("ranks", "parts", seconds, {"elements": list(n), "repetitions": count}, ranks)
        for ranks in (1, 2)
        for n, count, seconds in sizes
    ]


def parts(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], repetitions: int
) -> dict[str, Any]:
    """Seconds of value and gradient by part, and of solutions by the width of the block.

    The least of the repetitions, of the slowest rank.
    """
    warm_up(comm, dimension=len(elements))
    problem = slider_crank(comm, elements)
    rod = problem.flexible["rod"]
    x = holes_design(rod.domain)
    inside: dict[str, float] = {}
    blocks: list[int] = []

    def timed(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def run(*arguments: Any) -> Any:
            begin = perf_counter()
            found = function(*arguments)
            inside[name] = inside.get(name, 0.0) + perf_counter() - begin
            if name == "solves":
                blocks.append(arguments[1].shape[1])
            return found

        return run

    def clock() -> float:
        comm.Barrier()
        return perf_counter()

    own: list[dict[str, float]] = []

    def gradient() -> None:
        inside.clear()
        blocks.clear()
        found = problem.gradient(x)
        own.append({name: found.seconds[name] for name in PARTS} | inside)

    before = FactoredBody.solve, rod.reduction.factor
    FactoredBody.solve = timed("solves", FactoredBody.solve)  # type: ignore[method-assign]
    rod.reduction.factor = timed("factor", rod.reduction.factor)  # type: ignore[method-assign]
    try:
        times, _ = measure({"gradient": gradient}, repetitions, progress, clock)
    finally:
        FactoredBody.solve = before[0]  # type: ignore[method-assign]
        rod.reduction.factor = before[1]  # type: ignore[method-assign]
    widths = blocks.copy()
    factored = rod.factored(problem.value(x).bodies["rod"])
    generator = np.random.default_rng(0)
    sides = {w: generator.standard_normal((rod.elasticity.n_dofs, w)) for w in WIDTHS}
    solutions = {w: (lambda side=side: factored.solve(side)) for w, side in sides.items()}
    solved, _ = measure(solutions, max(repetitions, 3), lambda part: None, clock)
    least = {name: min(one[name] for one in own) for name in own[0]}
    least |= {"gradient": min(times["gradient"])}
    found = {name: comm.allreduce(value, MPI.MAX) for name, value in least.items()}
    found |= {"dofs": rod.elasticity.n_dofs_global, "cells": rod.domain.n_cells_global}
    return {**found, "blocks": widths, "widths": [min(solved[w]) for w in WIDTHS]}


def modelled(row: Row, ranks: int) -> float:
    """Seconds of value and gradient on some ranks, out of the parts of one.

    Each of the first ranks has the whole factor, and solves for its columns of a block; what else
    the reduction does goes by rows of the mesh; simulation and adjoint are done by every rank.
    """

    def solution(columns: float) -> float:
        return float(np.interp(columns, WIDTHS, row["widths"]))

    holders = min(ranks, HOLDERS)
    before = sum(solution(width) for width in row["blocks"])
    after = sum(solution(int(np.ceil(width / holders))) for width in row["blocks"])
    solves = row["solves"] * after / before
    return float(row["factor"] + row["alone"] + solves + row["rows"] / ranks)


def rows_of_ranks(results: Results) -> list[Row]:
    """One row for each mesh: parts of one rank, two ranks, and the model."""
    found, two = [], {}
    for job, result in results:
        mesh = "x".join(map(str, job.parameters["elements"]))
        if job.ranks == 2:
            two[mesh] = result["gradient"]
            continue
        alone = sum(result[name] for name in ALONE)
        whole = sum(result[name] for name in PARTS)
        alone += max(result["gradient"] - whole, 0.0)
        by_rows = whole - sum(result[name] for name in (*ALONE, "factor", "solves"))
        found.append({**result, "mesh": mesh, "alone": alone, "rows": by_rows})
    for row in found:
        gradient = row["gradient"]
        row["two"] = gradient / two.get(row["mesh"], np.nan)
        row |= {f"on_{p}": gradient / modelled(row, p) for p in RANKS}
        names = ("factor", "solves", "rows", "alone")
        row |= {f"share_{name}": 100.0 * row[name] / gradient for name in names}
    return found


def report_ranks(study: Study, results: Results) -> None:
    """Table and picture."""
    rows = rows_of_ranks(results)
    study.table("ranks", rows, holders=HOLDERS)
    with study.picture("Times faster over the number of ranks", 1, 1, (9.0, 4.6)) as (axes,):
        for row, color in zip(rows, (BLUE, ORANGE, GRAY, DARK, "#0b8043"), strict=False):
            model = [{"ranks": p, "faster": row[f"on_{p}"]} for p in RANKS]
            label = f"{row['mesh']}, by the model"
            of_model = [{"ranks": 1, "faster": 1.0}, *model]
            line(axes, of_model, "ranks", "faster", "o-", color, label=label)
            measured = [{"ranks": 2, "faster": row["two"]}]
            line(axes, measured, "ranks", "faster", "D", color, hollow=True, label="measured")
        title = "Value and gradient, one rank over several"
        plot(axes, title, "ranks", "times faster", scales="x", room=0.4, legend="upper left")
