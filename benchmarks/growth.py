# SPDX-License-Identifier: MIT
"""Growth of time and memory with the number of elements, its parts, and differences instead."""

from functools import partial
from itertools import pairwise
from time import perf_counter, process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress, Results, fits, measure, peak_memory, reset_peak_memory
from matplotlib.axes import Axes
from numpy.typing import NDArray
from report import Rows, Study, chosen, duration, line, plot, tick_labels
from scene import holes_design, slider_crank, warm_up, with_rod

from dolfinx_ffr.plotting.style import BLUE, DARK, GRAY, ORANGE
from dolfinx_ffr.reduction import FactoredBody

Row = dict[str, Any]

#: Parts of an evaluation in the order of the chain, those of the value first, and their colors:
#: blues for the value, oranges for the gradient
PARTS = {
    "assembly": "#cfe3f2",
    "reduction": "#0b62a4",
    "integrals": "#7db5dc",
    "simulation": "#073b63",
    "adjoint": "#f7d9b0",
    "reduction pullback": "#d9822b",
    "integrals pullback": "#8f4f12",
}
#: Repetitions that stand for the first evaluation alone
ONCE = 0
#: Least memory that is seen [MB]
PAGE = 0.004
LABELS = {"gradient": "psi and exact gradient", "value": "psi alone"}


def growth_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each mesh and number of ranks."""
    if quick:  # elements, repetitions, seconds
        sizes = [((20, 2), 1, 1.0), ((40, 4), 1, 1.0)]
    else:
        sizes = [((100, 10), 9, 6.0), ((200, 20), 9, 8.0), ((400, 40), 5, 15.0)]
        sizes += [((800, 80), 3, 40.0), ((1600, 160), ONCE, 40.0), ((3200, 320), ONCE, 200.0)]
        sizes = sizes if fits("growth: 3200x320", 14e9) else sizes[:-1]
    parallel = sizes[:1] if quick else sizes[3:5]
    return [
        Job("growth", "evaluation", seconds, own | {"solver": "direct"}, ranks)
        for ranks, some in ((1, sizes), (2, parallel))
        for n, count, seconds in some
        if (own := {"elements": list(n), "repetitions": count})
    ]


def evaluation(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], repetitions: int, solver: str
) -> dict[str, Any]:
    """Measure value, gradient and the lower bound on one mesh, in the plane or in space."""
    options = {} if solver == "direct" else {"solver": solver}
    warm_up(comm, dimension=len(elements), **options)
    base = reset_peak_memory()
    problem = slider_crank(comm, elements)
    if options:
        problem = with_rod(problem, **options)
    rod = problem.flexible["rod"]
    x = holes_design(rod.domain)
    parts: dict[str, list[float]] = {name: [] for name in PARTS}

    def clock() -> NDArray[np.float64]:
        """Seconds by the clock when all ranks are here, and of this rank's processor."""
        comm.Barrier()
        return np.array([perf_counter(), process_time()])

    begin = clock()
    first = problem.value(x)
    middle = clock()
    memory_value = peak_memory() - base
    first = problem.differentiate(first)
    times = {"value": [middle - begin], "gradient": [clock() - begin]}
    memory_gradient = peak_memory() - base

    latest = [first]

    def gradient() -> None:
        latest[0] = problem.gradient(x)
        for name in PARTS:
            parts[name].append(latest[0].seconds[name])

    def factored() -> FactoredBody:
        return rod.factored(latest[0].bodies["rod"])  # there already

    actions: dict[str, Any] = {}
    if repetitions == ONCE:
        parts = {name: [first.seconds[name]] for name in PARTS}
    else:
        times = {}
        actions = {"value": partial(problem.value, x), "gradient": gradient}
    if len(elements) == 2:
        block = np.random.default_rng(0).standard_normal((rod.elasticity.n_dofs, rod.n_elastic))
        rows = np.flatnonzero(rod.reduction.clamped).astype(np.int32)
        actions["bound"] = lambda: _bound(factored(), rows, block)
    times |= measure(actions, repetitions, progress, clock, untimed=0)[0]
    slowest = {name: np.max(comm.allgather(np.array(t)), axis=0) for name, t in times.items()}
    memory = {"value": memory_value, "gradient": memory_gradient, "base": base}
    result = {
        **{"elements": rod.domain.n_cells_global, "dofs": rod.elasticity.n_dofs_global},
        **{"modes": rod.n_elastic, "steps": problem.integrator.steps},
        "method": type(problem.integrator).__name__,
        "times": {name: t.tolist() for name, t in slowest.items()},
        "parts": parts,
        "iterations": first.solver_iterations["rod"],
        **{f"memory_{name}": comm.allreduce(peak) for name, peak in memory.items()},
        "psi": first.psi,
    }
    return result if len(elements) == 2 else {**result, "slope": first.gradient["rod"].tolist()}


def _bound(factored: FactoredBody, rows: NDArray[np.int32], block: NDArray[np.float64]) -> None:
    """One numerical factor of the stiffness, and one solution for each mode, all at once."""
    factored.clamped.fill(factored.matrices, rows)
    factored.solve(block)


def rows_of_growth(results: Results, cpu: bool = False) -> list[Row]:
    """One row for each measurement: medians, and what follows from them."""
    rows = []
    for job, result in sorted(results, key=lambda pair: (pair[1]["elements"], pair[0].ranks)):
        clock, own = (
            {name: np.array(t)[:, k] for name, t in result["times"].items()} for k in (0, 1)
        )
        t = own if cpu else clock
        parts = {name: float(np.median(values)) for name, values in result["parts"].items()}
        gradient = float(np.median(t["gradient"]))
        row = {
            **{key: result[key] for key in ("elements", "dofs", "iterations", "psi")},
            **{key: value for key, value in result.items() if key.startswith("memory_")},
            "mesh": "x".join(map(str, job.parameters["elements"])),
            "ranks": job.ranks,
            "repetitions": job.parameters["repetitions"],
            "value": float(np.median(t["value"])),
            "gradient": gradient,
            # pair by pair, so that a busy moment of the machine counts on both sides
            "ratio": float(np.median(t["gradient"] / t["value"])),
            "cpu": float(np.median(own["gradient"])),
            **parts,
            "rest": max(gradient - sum(parts.values()), 0.0),
        }
        bound = own.get("bound", np.array([np.nan]))
        row["bound"] = float(np.median(bound))
        row["over_bound"] = float(np.median(own["gradient"] / bound))
        rows.append(row)
    for row in rows:
        alone = chosen(rows, ranks=1, elements=row["elements"])
        row["speedup"] = alone[0]["gradient"] / row["gradient"] if alone else np.nan
    return rows


def floored(rows: list[Row]) -> list[Row]:
    """Rows with a page of memory at least: small bodies may show none, and zero no logarithm."""
    names = ("memory_value", "memory_gradient")
    return [{**row, **{name: max(row[name], PAGE) for name in names}} for row in rows]


def exponents(rows: list[Row]) -> list[Row]:
    """By which power of the number of elements time and memory grow from one mesh to the next."""
    rows, found = floored(rows), []
    for ranks in sorted({row["ranks"] for row in rows}):
        for smaller, larger in pairwise(chosen(rows, ranks=ranks)):
            scale = np.log(larger["elements"] / smaller["elements"])
            powers = {
                f"{name}_exponent": float(np.log(larger[name] / smaller[name]) / scale)
                for name in ("gradient", "bound", "memory_gradient")
            }
            found.append({"mesh": larger["mesh"], "ranks": ranks, **powers})
    return found


def report_growth(study: Study, results: Results) -> None:
    """Tables and picture."""
    rows = rows_of_growth(results)
    first = {name: results[0][1][name] for name in ("modes", "steps", "method")}
    study.table("growth", rows, **first)
    study.table("growth_parts", rows, parts=part_columns("s"))
    study.table("growth_exponents", exponents(rows))
    study.table("growth_memory", rows)
    serial, parallel = (chosen(rows, ranks=ranks) for ranks in (1, 2))
    caption = "Time, shares and memory over the number of elements"
    with study.picture(caption, 1, 3, (14.0, 4.4)) as (times, shares, memory):
        for axes, unit in ((times, ""), (memory, "memory_")):
            draw_both(axes, unit, serial, parallel, "elements", "on 2 ranks")
        label = "lower bound: one factor,\none solution a mode (CPU)"
        line(times, serial, "elements", "bound", "o-", GRAY, label=label)
        tick_labels(times, serial, "elements", "value", "{ratio:.2f}x", below=True)
        tick_labels(memory, serial[-1:], "elements", "memory_gradient", "{memory_gradient:,.0f} MB")
        title = "Time (gradient / value at the points)"
        plot(times, title, "elements", "seconds", room=0.5, legend="upper left")
        y = "MB beyond the libraries"
        plot(memory, "Peak memory", "elements", y, room=0.35, legend="upper left")
        draw_shares(shares, serial)


def part_columns(unit: str) -> str:
    """Columns of the parts."""
    return " | ".join(f"{name}: {name} [{unit}]" for name in PARTS)


def draw_both(axes: Axes, unit: str, rows: Rows, others: Rows, x: str, what: str) -> None:
    """Draw value and gradient of rows, and dashed those of others, with ``what`` in their label."""
    for name, color in (("gradient", ORANGE), ("value", BLUE)):
        line(axes, rows, x, unit + name, "o-", color, label=LABELS[name])
        label = f"{LABELS[name]}, {what}"
        line(axes, others, x, unit + name, "s--", color, hollow=True, label=label)


def draw_shares(axes: Axes, serial: Rows) -> None:
    """Draw the share of each part as bars, one for each mesh."""
    colors = {**PARTS, "rest": "#c9d1d9"}
    total = np.array([sum(row[name] for name in colors) for row in serial])
    bottom = np.zeros(len(serial))
    places = np.arange(len(serial))
    for name, color in colors.items():
        share = np.array([100.0 * row[name] for row in serial]) / total
        look = {"color": color, "edgecolor": "white", "linewidth": 0.6, "label": name}
        axes.bar(places, share, 0.72, bottom, **look)
        dark = name in ("reduction", "simulation", "integrals pullback")
        text = {"ha": "center", "va": "center", "fontsize": 8.5, "color": "white" if dark else DARK}
        for place, part, base in zip(places, share, bottom, strict=True):
            if part >= 6.0:
                axes.text(place, base + 0.5 * part, f"{part:.0f}", **text)
        bottom += share
    axes.set_xticks(places, [f"{row['elements'] / 1000:,.0f}" for row in serial])
    axes.set(ylim=(0.0, 100.0), xlabel="thousands of elements", ylabel="share [%]")
    axes.set_title("Share of each part")
    axes.spines[["top", "right"]].set_visible(False)
    handles, labels = axes.get_legend_handles_labels()
    place = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
    axes.legend(handles[::-1], labels[::-1], fontsize=8.5, **place)


def report_differences(study: Study, results: Results) -> None:
    """The exact gradient beside finite differences for every element: table and picture."""
    rows = chosen(rows_of_growth(results), ranks=1)
    for row in rows:
        row["one_sided"] = (row["elements"] + 1) * row["value"]
        row["central"] = 2 * row["elements"] * row["value"]
        for name in ("one_sided", "central", "gradient"):
            row[f"{name}_text"] = duration(row[name])
        row["speedup"] = row["one_sided"] / row["gradient"]
    study.table("differences", rows)
    with study.picture("Cost of the exact gradient and of differences", 1, 1, (7, 4.6)) as (axes,):
        for name, style, color, label in (
            ("central", "o:", GRAY, "central differences (extrapolated)"),
            ("one_sided", "o--", BLUE, "one-sided differences (extrapolated)"),
            ("gradient", "o-", ORANGE, "exact gradient (measured)"),
        ):
            line(axes, rows, "elements", name, style, color, label=label, hollow=style != "o-")
            if name != "central":
                tick_labels(axes, rows, "elements", name, "{" + name + "_text}", below=True)
        title = "Derivative of psi with respect to every element"
        y = "time for a whole gradient [s]"
        plot(axes, title, "elements, each with a density", y, room=0.2, legend="upper left")
