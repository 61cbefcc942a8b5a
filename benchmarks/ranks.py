# SPDX-License-Identifier: MIT
"""What more ranks bring: a model from the parts of one rank, beside two ranks as measured.

The model needs nothing of two ranks but how much two runs on one rank each, at the same time, slow
each other down, by the memory that the cores share.
"""

import math
from collections.abc import Callable
from functools import wraps
from time import perf_counter
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from growth import PARTS, Row
from jobs import Job, Progress, Results, measure
from report import Study, line, plot
from scene import holes_design, slider_crank, warm_up
from scipy.sparse import kron

from dolfinx_ffr import FlexibleBody
from dolfinx_ffr.plotting.style import BLUE, DARK, GRAY, ORANGE
from dolfinx_ffr.reduction import FactoredBody
from dolfinx_ffr.reduction.cholmod import OrderedFactor
from dolfinx_ffr.reduction.direct_solver import parts_pay

#: Ranks for which the model is told
RANKS = 2, 4, 16, 64
#: Every rank does this for itself
ALONE = "simulation", "adjoint"


def ranks_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each mesh and number of ranks."""
    if quick:  # elements, repetitions, seconds
        sizes = [((20, 2), 1, 1.0)]
    else:
        sizes = [((200, 20), 9, 10.0), ((400, 40), 5, 15.0), ((800, 80), 3, 40.0)]
        sizes += [((80, 8, 8), 5, 30.0), ((80, 16, 16), 3, 60.0)]
    jobs = []
    for n, count, seconds in sizes:
        same = {"elements": list(n), "repetitions": count}
        jobs += [Job("ranks", "parts", seconds, same, ranks) for ranks in (1, 2)]
        jobs.append(Job("ranks", "parts", 2.0 * seconds, {**same, "apart": True}, 2))
    return jobs


def parts(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: list[int],
    repetitions: int,
    apart: bool = False,
) -> dict[str, Any]:
    """Seconds of value and gradient by part, and of what is between so many parts as `RANKS`.

    The least of the repetitions, of the slowest rank; if ``apart``, each has a rod of its own.
    """
    warm_up(comm, dimension=len(elements))
    problem = slider_crank(MPI.COMM_SELF if apart else comm, elements)
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
    least = {name: min(one[name] for one in own) for name in own[0]}
    least |= {"gradient": min(times["gradient"])}
    found = {name: comm.allreduce(value, MPI.MAX) for name, value in least.items()}
    found |= {"dofs": rod.elasticity.n_dofs_global, "cells": rod.domain.n_cells_global}
    if comm.size > 1:
        return found
    return {**found, "between": [_between(rod, elements, blocks, p) for p in RANKS]}


def _between(rod: FlexibleBody, elements: list[int], blocks: list[int], ranks: int) -> float:
    """Seconds with the factor of what is between so many parts; nan if MUMPS would be taken.

    The parts are cut by sections of the rod, each coupled to its neighbours. The factor and a
    solution for each of ``blocks``.
    """
    section = len(elements) * math.prod(n + 1 for n in elements[1:])
    matrix = rod.elasticity.new_matrix()
    # those of one section for both parts at the ends, of two for all others
    pays = parts_pay(rod.elasticity, matrix, (1.0 + 2.0 * (ranks - 2)) * section**2)
    matrix.destroy()
    if not pays:
        return math.nan
    cuts = np.arange(ranks - 1)
    neighbours = np.where(np.abs(cuts[:, None] - cuts) <= 1, 1.0, 0.0)
    chain = kron(neighbours, np.ones((section, section)), format="csr")
    begins, columns = (k.astype(PETSc.IntType) for k in (chain.indptr, chain.indices))
    rows = np.repeat(np.arange(len(begins) - 1), np.diff(begins))
    factor = OrderedFactor(begins, columns, np.zeros(len(begins) - 1, dtype=bool))
    values = np.where(rows == columns, 1.0, 0.0)
    sides = {k: np.ones((factor.size, k)) for k in blocks}

    def once() -> None:
        factor.factor(values)
        for k in blocks:
            factor.solve(sides[k])

    seconds, _ = measure({"once": once}, 3, lambda part: None)
    factor.destroy()
    return float(min(seconds["once"]))


def modelled(row: Row, place: int) -> float:
    """Seconds of value and gradient on ``RANKS[place]`` ranks, out of the parts of one.

    Factors and solutions go by parts, with what is between them on every rank, and what else the
    reduction does by rows of the mesh; simulation and adjoint are done by every rank. All of it
    takes as much longer as two runs at once slow each other down.
    """
    shared = (row["factor"] + row["solves"] + row["rows"]) / RANKS[place]
    return float(row["slower"] * (row["alone"] + shared + row["between"][place]))


def rows_of_ranks(results: Results) -> list[Row]:
    """One row for each mesh: parts of one rank, two ranks, and the model."""
    found = []
    two: dict[tuple[str, bool], float] = {}
    for job, result in results:
        mesh = "x".join(map(str, job.parameters["elements"]))
        if job.ranks == 2:
            two[mesh, job.parameters.get("apart", False)] = result["gradient"]
            continue
        alone = sum(result[name] for name in ALONE)
        whole = sum(result[name] for name in PARTS)
        alone += max(result["gradient"] - whole, 0.0)
        by_rows = whole - sum(result[name] for name in (*ALONE, "factor", "solves"))
        found.append({**result, "mesh": mesh, "alone": alone, "rows": by_rows})
    for row in found:
        gradient = row["gradient"]
        row["two"] = gradient / two.get((row["mesh"], False), np.nan)
        row["slower"] = two.get((row["mesh"], True), np.nan) / gradient
        row |= {f"on_{p}": gradient / modelled(row, k) for k, p in enumerate(RANKS)}
        names = ("factor", "solves", "rows", "alone")
        row |= {f"share_{name}": 100.0 * row[name] / gradient for name in names}
    return found


def report_ranks(study: Study, results: Results) -> None:
    """Table and picture."""
    rows = rows_of_ranks(results)
    study.table("ranks", rows)
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
