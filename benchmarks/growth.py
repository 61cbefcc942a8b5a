# SPDX-License-Identifier: MIT
"""Growth of time and memory with the number of elements, and the share of each part of it."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from jobs import Job, Progress
from matplotlib.axes import Axes
from memory import peak_memory, reset_peak_memory
from numpy.typing import NDArray
from report import Table, write_page
from scene import holes_design, slider_crank, warm_up

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, DARK, GRAY, ORANGE, save, styled_figure, tidy
from dolfinx_ffr.reduction import FactoredBody

__all__ = ["PARTS", "draw_shares", "evaluation_growth", "growth_jobs", "report_growth"]

#: Parts of an evaluation in the order of the chain, those of the value first
PARTS = (
    "assembly",
    "reduction",
    "integrals",
    "simulation",
    "adjoint",
    "reduction pullback",
    "integrals pullback",
)
VALUE_PARTS = 4
#: Repetitions that stand for the first evaluation alone
ONCE = 0
#: What the largest mesh takes with room to spare [bytes]; it is left out where less is free
MEMORY = 14e9
#: Gradient over value: what is aimed at, and for how many elements
TARGET, TARGET_ELEMENTS = 2.5, 16_000


def growth_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each mesh and number of ranks."""
    if quick:
        sizes = {(40, 4): 2, (80, 8): 2}
        seconds = {(40, 4): 5.0, (80, 8): 5.0}
    else:
        sizes = {(100, 10): 9, (200, 20): 9, (400, 40): 5, (800, 80): 3}
        sizes |= {(1600, 160): ONCE, (3200, 320): ONCE}
        if os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") < MEMORY:
            del sizes[3200, 320]
        seconds = {(100, 10): 6.0, (200, 20): 8.0, (400, 40): 15.0, (800, 80): 40.0}
        seconds |= {(1600, 160): 40.0, (3200, 320): 200.0}
    parallel = list(sizes)[:1] if quick else list(sizes)[3:5]
    return [
        Job(
            "growth",
            "evaluation_growth",
            seconds[size],
            {"elements": list(size), "repetitions": repetitions},
            ranks,
        )
        for ranks in (1, 2)
        for size, repetitions in sizes.items()
        if ranks == 1 or size in parallel
    ]


def evaluation_growth(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], repetitions: int
) -> dict[str, Any]:
    """Measure value, gradient and the lower bound on one mesh, side by side.

    Args:
        comm: The ranks.
        progress: Told the part that is done.
        elements: Along and across.
        repetitions: Of value, gradient and lower bounds, in turn; zero takes the times of the first
            evaluation, in which also what is made once for each mesh is made.
    """
    warm_up(comm)
    base = reset_peak_memory()
    problem = slider_crank(comm, (elements[0], elements[1]))
    rod = problem.flexible["rod"]
    x = holes_design(rod.domain)
    times: dict[str, list[float]] = {
        name: [] for name in ("value", "gradient", "cpu", "bound", "analysed")
    }
    parts: dict[str, list[float]] = {name: [] for name in PARTS}

    def told(evaluation: ffr.Evaluation, begin: float, cpu: float) -> int:
        times["gradient"].append(perf_counter() - begin)
        times["cpu"].append(comm.allreduce(process_time() - cpu, MPI.MAX))
        for name in PARTS:
            parts[name].append(evaluation.seconds[name])
        return evaluation.solver_iterations["rod"]

    comm.Barrier()
    begin, cpu = perf_counter(), process_time()
    first = problem.value(x)
    comm.Barrier()
    value = perf_counter() - begin
    memory_value = peak_memory() - base
    first = problem.differentiate(first)
    comm.Barrier()
    memory_gradient = peak_memory() - base
    if repetitions == ONCE:
        times["value"].append(value)
        iterations = told(first, begin, cpu)

    rng = np.random.default_rng(0)
    block = rng.standard_normal((rod.elasticity.n_dofs, rod.n_elastic))
    rows = np.flatnonzero(rod.reduction.held).astype(np.int32)
    for repetition in range(max(repetitions, 1)):
        if repetitions != ONCE:
            times["value"].append(_seconds(comm, lambda: problem.value(x))[0])
            begin, cpu = perf_counter(), process_time()
            first = problem.gradient(x)
            comm.Barrier()
            iterations = told(first, begin, cpu)
        factored = rod.factored(first.bodies["rod"])
        bound = partial(_bound, factored, rows, block)
        times["bound"].append(_seconds(comm, bound)[1])
        if repetitions != ONCE:
            analysed = partial(_analysed, factored, block)
            times["analysed"].append(_seconds(comm, analysed)[1])
        progress((repetition + 1) / max(repetitions, 1))
    return {
        "elements": rod.domain.n_cells_global,
        "dofs": rod.elasticity.n_dofs_global,
        "modes": rod.n_elastic,
        "steps": f"{problem.integrator.steps} steps of {type(problem.integrator).__name__}",
        "times": times,
        "parts": parts,
        "iterations": iterations,
        "memory_value": comm.allreduce(memory_value),
        "memory_gradient": comm.allreduce(memory_gradient),
        "memory_base": comm.allreduce(base),
    }


def _bound(factored: FactoredBody, rows: NDArray[np.int32], block: NDArray[np.float64]) -> None:
    """One numerical factor of the stiffness, and one solution for each mode, all at once."""
    factored.held.fill(factored.matrices, rows)
    factored.solve(block)


def _analysed(factored: FactoredBody, block: NDArray[np.float64]) -> None:
    """The same by MUMPS, and the search for an ordering."""
    ksp = PETSc.KSP().create(factored.elasticity.comm)
    ksp.setType("preonly")
    ksp.getPC().setType("cholesky")
    ksp.getPC().setFactorSolverType("mumps")
    ksp.setOperators(factored.held_stiffness)
    ksp.setUp()
    right = factored.elasticity.dense(block)
    left = right.duplicate()
    ksp.getPC().getFactorMatrix().matSolve(right, left)
    for item in (right, left, ksp):
        item.destroy()


def _seconds(comm: MPI.Comm, action: Callable[[], Any]) -> tuple[float, float]:
    """How long an action takes on the slowest rank, and the largest processor time of a rank."""
    comm.Barrier()
    start, cpu = perf_counter(), process_time()
    action()
    comm.Barrier()
    return perf_counter() - start, comm.allreduce(process_time() - cpu, MPI.MAX)


# ---------------------------------------------------------------------- tables and picture


def rows_of_growth(results: list[tuple[Job, dict[str, Any]]]) -> list[dict[str, Any]]:
    """One row for each measurement: medians, and what follows from them."""
    rows = []
    for job, result in sorted(results, key=lambda pair: (pair[1]["elements"], pair[0].ranks)):
        t = {name: np.array(values) for name, values in result["times"].items()}
        parts = {name: float(np.median(values)) for name, values in result["parts"].items()}
        gradient = float(np.median(t["gradient"]))
        analysed = t["analysed"] if len(t["analysed"]) else np.array([np.nan])
        rows.append(
            {
                "elements": result["elements"],
                "mesh": "x".join(map(str, job.parameters["elements"])),
                "dofs": result["dofs"],
                "ranks": job.ranks,
                "repetitions": job.parameters["repetitions"],
                "value": float(np.median(t["value"])),
                "gradient": gradient,
                "fastest_value": float(np.min(t["value"])),
                "fastest_gradient": float(np.min(t["gradient"])),
                # pair by pair, so that a busy moment of the machine counts on both sides
                "ratio": float(np.median(t["gradient"] / t["value"])),
                "cpu": float(np.median(t["cpu"])),
                "bound": float(np.median(t["bound"])),
                "over_bound": float(np.median(t["cpu"] / t["bound"])),
                "analysed": float(np.median(analysed)),
                "over_analysed": float(np.median(t["cpu"] / analysed)),
                "memory_value": result["memory_value"],
                "memory_gradient": result["memory_gradient"],
                "memory_base": result["memory_base"],
                "iterations": result["iterations"],
                **parts,
                "rest": max(gradient - sum(parts.values()), 0.0),
            }
        )
    for row in rows:
        alone = [r for r in rows if r["ranks"] == 1 and r["elements"] == row["elements"]]
        row["speedup"] = alone[0]["gradient"] / row["gradient"] if alone else np.nan
    return rows


def exponents(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """By which power of the number of elements time and memory grow from one mesh to the next.

    Args:
        rows: Of `rows_of_growth`.
    """
    found = []
    for ranks in sorted({row["ranks"] for row in rows}):
        for smaller, larger in pairwise(row for row in rows if row["ranks"] == ranks):
            scale = np.log(larger["elements"] / smaller["elements"])
            powers = {
                f"{name}_exponent": float(np.log(larger[name] / smaller[name]) / scale)
                for name in ("gradient", "bound", "memory_gradient")
            }
            found.append({"mesh": larger["mesh"], "ranks": ranks, **powers})
    return found


def report_growth(results: list[tuple[Job, dict[str, Any]]], directory: Path) -> list[Table]:
    """Write tables and picture.

    Args:
        results: Of `growth_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    rows = rows_of_growth(results)
    first = results[0][1]
    scene = (
        f"Slider-crank of the demo, rod with 30 holes, bilinear quadrilaterals, {first['modes']} "
        f"modes (3 constraint modes among them), {first['steps']}."
    )
    times = Table(
        "growth",
        "Time",
        f"{scene} *Value* is psi alone, *gradient* is psi and its exact derivative with respect to "
        "every element. Value, gradient and lower bound are measured in turn, again and again, in "
        "one process for each line; times are medians, the ratio is the median of the ratios of "
        "neighbours. *CPU*: of the busiest rank, waiting for the other included. "
        "*Times one rank*: its time over this one. The *lower bound* is one numerical factor of "
        "the stiffness, by the ordering that is there, and one solution for each mode, all at "
        "once. *With ordering*: the same by MUMPS, with its search for an ordering, which an "
        "evaluation does not make again; older pages called this the lower bound. Both are CPU "
        "times of the busiest rank, and so are the ratios. Lines without repetitions are those "
        "of the first evaluation, with all that is made once for a mesh.",
        {
            "mesh": "mesh",
            "elements": "elements",
            "dofs": "unknowns",
            "ranks": "ranks",
            "repetitions": "repetitions",
            "value": "value [s]",
            "gradient": "gradient [s]",
            "ratio": "gradient / value",
            "cpu": "CPU of the gradient [s]",
            "speedup": "times one rank",
            "bound": "lower bound, CPU [s]",
            "over_bound": "gradient / lower bound",
            "analysed": "with ordering, CPU [s]",
            "over_analysed": "gradient / that",
        },
        rows,
    )
    parts = Table(
        "growth_parts",
        "Share of each part",
        "Medians of the seconds that one evaluation of value and gradient spends in each of its "
        "parts; *rest* is what the whole evaluation takes beyond them. *Blocks* are those of the "
        "Krylov space of the reduction's pullback, which serves all modes.",
        {
            "mesh": "mesh",
            "ranks": "ranks",
            **{name: f"{name} [s]" for name in PARTS},
            "rest": "rest [s]",
            "iterations": "blocks",
        },
        rows,
    )
    powers = Table(
        "growth_exponents",
        "Exponents",
        "Powers of the number of elements by which time and memory grow from the mesh before.",
        {
            "mesh": "mesh",
            "ranks": "ranks",
            "gradient_exponent": "time of the gradient",
            "bound_exponent": "time of the lower bound",
            "memory_gradient_exponent": "memory of the gradient",
        },
        exponents(rows),
    )
    memory = Table(
        "growth_memory",
        "Memory",
        "Peak of the resident memory, each line in a process of its own, summed over its ranks, "
        "beyond what the process holds with all libraries loaded and a rod of 40 elements "
        "evaluated (*base*). *Value* includes mesh and matrices, *gradient* both.",
        {
            "mesh": "mesh",
            "elements": "elements",
            "ranks": "ranks",
            "memory_base": "base [MB]",
            "memory_value": "value [MB]",
            "memory_gradient": "gradient [MB]",
        },
        rows,
    )
    _draw(rows, directory / "growth.png")
    picture = "![Time, shares and memory over the number of elements](growth.png)"
    tables = [times, powers, parts, memory]
    write_page(directory, "growth", "Growth with the number of elements", picture, tables)
    return tables


def _draw(rows: list[dict[str, Any]], path: Path) -> None:
    serial = [row for row in rows if row["ranks"] == 1]
    parallel = [row for row in rows if row["ranks"] == 2]
    with styled_figure(13.0, 4.4) as figure:
        figure.set_constrained_layout(True)
        figure.set_constrained_layout_pads(w_pad=0.12, h_pad=0.08)
        time_axes, share_axes, memory_axes = figure.subplots(
            1, 3, gridspec_kw={"width_ratios": [1.1, 1.0, 1.0]}
        )
        _draw_times(time_axes, serial, parallel)
        draw_shares(share_axes, serial)
        _draw_memory(memory_axes, serial, parallel)
        save(figure, path)


def _column(rows: list[dict[str, Any]], name: str) -> NDArray[np.float64]:
    return np.array([row[name] for row in rows])


def _elements_axis(axes: Axes, rows: list[dict[str, Any]]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    ticks = sorted({row["elements"] for row in rows})
    axes.set_xticks(ticks, [f"{n / 1000:,.0f}" for n in ticks])
    axes.minorticks_off()
    axes.set_xlabel("thousands of elements")
    low, high = axes.get_xlim()
    axes.set_xlim(low, high * (high / low) ** 0.05)
    tidy(axes)


def _draw_times(axes: Axes, serial: list[dict[str, Any]], parallel: list[dict[str, Any]]) -> None:
    n = _column(serial, "elements")
    axes.plot(n, _column(serial, "gradient"), "o-", color=ORANGE, label="psi and exact gradient")
    axes.plot(n, _column(serial, "value"), "o-", color=BLUE, label="psi alone")
    axes.plot(
        n,
        _column(serial, "bound"),
        "o-",
        color=GRAY,
        label="lower bound: one factor,\none solution a mode (CPU)",
    )
    for name, color in (("gradient", ORANGE), ("value", BLUE)):
        axes.plot(
            _column(parallel, "elements"),
            _column(parallel, name),
            "s--",
            color=color,
            markerfacecolor="white",
            label="the same on 2 ranks" if name == "gradient" else None,
        )
    for row in serial:
        axes.annotate(
            f"{row['ratio']:.2f}x",
            (row["elements"], row["value"]),
            (5, -4),
            textcoords="offset points",
            va="top",
            fontsize=9,
            color=DARK,
        )
    _elements_axis(axes, serial)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.5)
    axes.set_ylabel("seconds")
    axes.set_title("Time (gradient / value at the points)")
    axes.legend(loc="upper left")


def draw_shares(axes: Axes, serial: list[dict[str, Any]]) -> None:
    """Draw the share of each part as bars, one for each mesh.

    Args:
        axes: Where to.
        serial: A row for each mesh with its number of elements, its parts and the rest.
    """
    # the value's parts in blues, the gradient's in oranges
    blues, oranges = ("#cfe3f2", "#0b62a4", "#7db5dc", "#073b63"), ("#f7d9b0", "#d9822b", "#8f4f12")
    colors = dict(zip(PARTS, blues + oranges, strict=True))
    total = np.array([sum(row[name] for name in (*PARTS, "rest")) for row in serial])
    bottom = np.zeros(len(serial))
    places = np.arange(len(serial))
    for name in (*PARTS, "rest"):
        share = 100.0 * _column(serial, name) / total
        axes.bar(
            places, share, 0.72, bottom, color=colors.get(name, "#c9d1d9"), edgecolor="white",
            linewidth=0.6, label=name,
        )  # fmt: skip
        for place, part, base in zip(places, share, bottom, strict=True):
            if part >= 6.0:
                dark = name in ("reduction", "simulation", "integrals pullback")
                axes.text(
                    place, base + 0.5 * part, f"{part:.0f}", ha="center", va="center", fontsize=8.5,
                    color="white" if dark else DARK,
                )  # fmt: skip
        bottom += share
    axes.set_xticks(places, [f"{row['elements'] / 1000:,.0f}" for row in serial])
    axes.set_ylim(0.0, 100.0)
    axes.set_xlabel("thousands of elements")
    axes.set_ylabel("share [%]")
    axes.set_title("Share of each part")
    tidy(axes, grid=False)
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(
        handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8.5
    )


def _draw_memory(axes: Axes, serial: list[dict[str, Any]], parallel: list[dict[str, Any]]) -> None:
    for name, color, label in (
        ("memory_gradient", ORANGE, "psi and exact gradient"),
        ("memory_value", BLUE, "psi alone"),
    ):
        axes.plot(
            _column(serial, "elements"), _column(serial, name), "o-", color=color, label=label
        )
        axes.plot(
            _column(parallel, "elements"),
            _column(parallel, name),
            "s--",
            color=color,
            markerfacecolor="white",
            label="the same on 2 ranks" if name == "memory_gradient" else None,
        )
    last = serial[-1]
    axes.annotate(
        f"{last['memory_gradient']:,.0f} MB",
        (last["elements"], last["memory_gradient"]),
        (-6, 6),
        textcoords="offset points",
        ha="right",
        fontsize=9,
    )
    _elements_axis(axes, serial)
    axes.set_ylabel("MB beyond the libraries")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.35)
    axes.set_title("Peak memory")
    axes.legend(loc="upper left")
