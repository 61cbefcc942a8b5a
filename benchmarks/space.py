# SPDX-License-Identifier: MIT
"""Bodies and motions in space: beside the plane, with the mesh, and without a factor."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from growth import PARTS, draw_shares
from jobs import Job, Progress
from matplotlib.axes import Axes
from memory import peak_memory, reset_peak_memory
from report import Table, write_page
from scene import holes_design, slider_crank, spatial_slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, ORANGE, save, styled_figure, tidy

__all__ = ["evaluation_in_space", "report_space", "space_jobs", "steps_beside_the_plane"]

#: Repetitions that stand for the first evaluation alone
ONCE = 0
DIRECT, ITERATIVE = "direct", "iterative"
#: Least memory that is seen [MB]
PAGE = 0.004
#: Memories for which the largest body is told [GiB]
GIB = 16, 24, 64
#: Constraint modes of both rods: of the plane, of space
CONSTRAINT = 3, 6


def space_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each mesh and solver."""
    if quick:
        sizes, iterative = {(8, 2, 2): 1, (12, 3, 3): 1}, [(12, 3, 3)]
        seconds = {(8, 2, 2): 1.0, (12, 3, 3): 1.0}
    else:
        sizes = {(20, 4, 4): 7, (40, 4, 4): 7, (40, 8, 8): 5, (80, 8, 8): 5}
        sizes |= {(80, 16, 16): ONCE, (120, 24, 24): ONCE}
        seconds = {(20, 4, 4): 5.0, (40, 4, 4): 8.0, (40, 8, 8): 12.0, (80, 8, 8): 30.0}
        seconds |= {(80, 16, 16): 40.0, (120, 24, 24): 200.0}
        iterative = [(40, 4, 4), (80, 8, 8), (80, 16, 16), (120, 24, 24)]
    steps = {
        "modes": [8] if quick else [8, 12, 16, 24],
        "steps": [300, 1500] if quick else [2000, 6000],
        "repetitions": 3 if quick else 15,
    }
    return [
        Job("space", "steps_beside_the_plane", 5.0 if quick else 60.0, steps),
        *(
            Job(
                "space",
                "evaluation_in_space",
                (1.0 if solver == DIRECT else 5.0) * seconds[size],
                {
                    "elements": list(size),
                    "repetitions": count if solver == DIRECT else ONCE,
                    "solver": solver,
                },
            )
            for solver in (DIRECT, ITERATIVE)
            for size, count in sizes.items()
            if solver == DIRECT or size in iterative
        ),
    ]


# ---------------------------------------------------------------------- time steps


def steps_beside_the_plane(
    comm: MPI.Comm, progress: Progress, *, modes: list[int], steps: list[int], repetitions: int
) -> dict[str, Any]:
    """Measure simulation and adjoint of both slider-cranks at equal numbers of modes.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        modes: Numbers of shape functions, constraint modes among them.
        steps: Two numbers of time steps, of whose times the difference is taken.
        repetitions: Turns through all of it; the least time of each counts.
    """
    runs: dict[tuple[int, int, int], tuple[ffr.MechanicalProblem, Any]] = {}
    for number in modes:
        scenes = (
            slider_crank(comm, (60, 6), modes=number - CONSTRAINT[0]),
            spatial_slider_crank(comm, (20, 4, 4), modes=number - CONSTRAINT[1]),
        )
        for dimension, problem in zip((2, 3), scenes, strict=True):
            body = problem.flexible["rod"]
            integrals = {"rod": body.reduce(holes_design(body.domain)).integrals}
            for n in steps:
                integrator = ffr.GeneralizedAlpha(problem.integrator.end_time, n)
                mechanical = ffr.MechanicalProblem(problem.mechanism, integrator, problem.objective)
                mechanical.gradient(integrals)  # whatever is compiled or loaded once
                runs[number, dimension, n] = mechanical, integrals
    least: dict[tuple[int, int, int, str], float] = {}
    for repetition in range(repetitions):
        for key, (mechanical, integrals) in runs.items():
            begin = process_time()
            evaluation = mechanical.value(integrals)
            middle = process_time()
            mechanical.differentiate(evaluation)
            spent = {"simulation": middle - begin, "adjoint": process_time() - middle}
            for name, seconds in spent.items():
                least[*key, name] = min(seconds, least.get((*key, name), np.inf))
        progress((repetition + 1) / repetitions)
    few, many = steps
    return {
        "rows": [
            {
                "modes": number,
                **{
                    f"{name}_{dimension}": (
                        least[number, dimension, many, name] - least[number, dimension, few, name]
                    )
                    / (many - few)
                    for name in ("simulation", "adjoint")
                    for dimension in (2, 3)
                },
            }
            for number in modes
        ],
        "steps": steps,
    }


# ---------------------------------------------------------------------- value and gradient


def evaluation_in_space(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], repetitions: int, solver: str
) -> dict[str, Any]:
    """Measure value and gradient of the slider-crank in space on one mesh, side by side.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        elements: Along and across.
        repetitions: Of value and gradient, in turn; zero takes the times of the first evaluation,
            in which also what is made once for each mesh is made.
        solver: ``"direct"`` or ``"iterative"``.
    """
    warm_up(comm, solver)
    base = reset_peak_memory()
    problem = spatial_slider_crank(comm, (elements[0], elements[1], elements[2]))
    if solver == ITERATIVE:
        problem = without_factor(problem)
    rod = problem.flexible["rod"]
    x = holes_design(rod.domain)
    times: dict[str, list[float]] = {"value": [], "gradient": []}
    parts: dict[str, list[float]] = {name: [] for name in PARTS}

    begin = process_time()
    evaluation = problem.value(x)
    value = process_time() - begin
    memory_value = peak_memory() - base
    evaluation = problem.differentiate(evaluation)
    gradient = process_time() - begin
    memory_gradient = peak_memory() - base

    def told(value: float, gradient: float, found: ffr.Evaluation) -> None:
        times["value"].append(value)
        times["gradient"].append(gradient)
        for name in PARTS:
            parts[name].append(found.seconds[name])

    if repetitions == ONCE:
        told(value, gradient, evaluation)
    for repetition in range(repetitions):
        value = _cpu(partial(problem.value, x))
        begin = process_time()
        evaluation = problem.gradient(x)
        told(value, process_time() - begin, evaluation)
        progress((repetition + 1) / repetitions)
    assert evaluation.gradient is not None
    return {
        "elements": rod.domain.n_cells_global,
        "dofs": rod.elasticity.n_dofs_global,
        "modes": rod.n_elastic,
        "steps": problem.integrator.steps,
        "times": times,
        "parts": parts,
        "iterations": evaluation.solver_iterations["rod"],
        "memory_value": memory_value,
        "memory_gradient": memory_gradient,
        "memory_base": base,
        "psi": evaluation.psi,
        "derivative": evaluation.gradient["rod"].tolist(),
    }


def warm_up(comm: MPI.Comm, solver: str) -> None:
    """Evaluate a tiny rod, so that whatever is compiled or loaded once is there.

    Args:
        comm: One rank.
        solver: ``"direct"`` or ``"iterative"``.
    """
    problem = spatial_slider_crank(comm, (8, 2, 2), modes=2, steps=400)
    if solver == ITERATIVE:
        problem = without_factor(problem)
    problem.gradient(np.ones(problem.flexible["rod"].domain.n_cells))


def without_factor(problem: ffr.Problem) -> ffr.Problem:
    """The problem with a rod that is solved by conjugate gradients."""
    rod = problem.flexible["rod"]
    iterative = ffr.FlexibleBody(
        rod.domain,
        rod.material,
        frame=rod.reduction.frame,
        modes=rod.modes,
        interpolation=rod.interpolation,
        solver=ITERATIVE,
    )
    return ffr.Problem({"rod": iterative}, problem.mechanism, problem.integrator, problem.objective)


def _cpu(action: Callable[[], Any]) -> float:
    """The CPU time of an action [s]."""
    start = process_time()
    action()
    return process_time() - start


# ---------------------------------------------------------------------- tables and picture


def rows_of_space(results: list[tuple[Job, dict[str, Any]]]) -> list[dict[str, Any]]:
    """One row for each mesh and solver: medians, and what follows from them."""
    rows = []
    for job, result in results:
        t = {name: np.array(values) for name, values in result["times"].items()}
        # medians of the clock's time: their shares alone are told
        parts = {name: float(np.median(values)) for name, values in result["parts"].items()}
        whole = sum(parts.values())
        gradient = float(np.median(t["gradient"]))
        rows.append(
            {
                **{key: result[key] for key in ("elements", "dofs", "psi", "iterations")},
                **{key: value for key, value in result.items() if key.startswith("memory_")},
                "mesh": "x".join(map(str, job.parameters["elements"])),
                "solver": job.parameters["solver"],
                "repetitions": len(t["value"]),
                "value": float(np.median(t["value"])),
                "gradient": gradient,
                # pair by pair, so that a busy moment of the machine counts on both sides
                "ratio": float(np.median(t["gradient"] / t["value"])),
                **{name: 100.0 * seconds / whole for name, seconds in parts.items()},
                "rest": 0.0,
                "derivative": np.array(result["derivative"]),
            }
        )
    return sorted(rows, key=lambda row: (row["solver"], row["dofs"]))


def rows_of_solvers(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Conjugate gradients over factors, mesh by mesh.

    Args:
        rows: Of `rows_of_space`.
    """
    found = []
    for row in rows:
        same = [r for r in rows if r["solver"] == DIRECT and r["mesh"] == row["mesh"]]
        if row["solver"] == DIRECT or not same:
            continue
        other = same[0]
        memory = [max(r["memory_gradient"], PAGE) for r in (row, other)]
        difference = np.linalg.norm(row["derivative"] - other["derivative"])
        found.append(
            {
                "mesh": row["mesh"],
                "dofs": row["dofs"],
                "direct": other["gradient"],
                "iterative": row["gradient"],
                "time_ratio": row["gradient"] / other["gradient"],
                "memory_direct": other["memory_gradient"],
                "memory_iterative": row["memory_gradient"],
                "memory_ratio": memory[0] / memory[1],
                "iterations": row["iterations"],
                "difference_psi": abs(row["psi"] / other["psi"] - 1.0),
                "difference_gradient": float(difference / np.linalg.norm(other["derivative"])),
            }
        )
    return found


def crossing(rows: list[dict[str, Any]], ratio: str) -> float:
    """Where the last two of some ratios, extrapolated in logarithms, come to one [dofs].

    Args:
        rows: Of `rows_of_solvers`.
        ratio: Name of the ratio.
    """
    if len(rows) < 2:
        return float("nan")
    dofs, ratios = (np.log([row[name] for row in rows[-2:]]) for name in ("dofs", ratio))
    slope = (ratios[1] - ratios[0]) / (dofs[1] - dofs[0])
    return float(np.exp(dofs[1] - ratios[1] / slope)) if slope < 0.0 else float("inf")


def report_space(results: list[tuple[Job, dict[str, Any]]], directory: Path) -> list[Table]:
    """Write tables and picture.

    Args:
        results: Of `space_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    steps = next(result for job, result in results if job.function == "steps_beside_the_plane")
    found = [pair for pair in results if pair[0].function == "evaluation_in_space"]
    rows, first = rows_of_space(found), found[0][1]
    solvers = rows_of_solvers(rows)
    scene = (
        f"Slider-crank of the demo in space, rod with 30 holes, trilinear hexahedra, "
        f"{first['modes']} modes (6 constraint modes among them), {first['steps']:,} time steps."
    )
    tables = [
        _steps_table(steps),
        Table(
            "space",
            "Value and gradient",
            f"{scene} *Value* is psi alone, *gradient* is psi and its exact derivative with "
            "respect to every element: CPU times, measured in turn in one process for each line; "
            "medians, and the median of the ratios of neighbours. Lines with one repetition are "
            "first evaluations, with all that is made once for a mesh. *Memory* is the peak "
            "beyond what the process holds with all libraries loaded and a tiny rod evaluated.",
            {
                "mesh": "mesh",
                "elements": "elements",
                "dofs": "unknowns",
                "solver": "solver",
                "repetitions": "repetitions",
                "value": "value [s]",
                "gradient": "gradient [s]",
                "ratio": "gradient / value",
                "memory_value": "memory of the value [MB]",
                "memory_gradient": "of the gradient [MB]",
            },
            rows,
        ),
        Table(
            "space_parts",
            "Share of each part",
            "In per cent of the parts of value and gradient, by the clock. *Blocks* are those of "
            "the Krylov space of the reduction's pullback; of the iterative solver they are "
            "iterations of conjugate gradients.",
            {
                "mesh": "mesh",
                "solver": "solver",
                **{name: f"{name} [%]" for name in PARTS},
                "iterations": "blocks",
            },
            rows,
        ),
        Table(
            "space_solvers",
            "Without a factor",
            "Value and gradient by conjugate gradients with algebraic multigrid "
            '(`solver="iterative"`) beside factors of CHOLMOD: CPU times, peaks of memory, and the '
            f"relative differences of psi and gradient. {_crossings(solvers)}",
            {
                "mesh": "mesh",
                "dofs": "unknowns",
                "direct": "direct [s]",
                "iterative": "iterative [s]",
                "time_ratio": "iterative / direct",
                "memory_direct": "direct [MB]",
                "memory_iterative": "iterative [MB]",
                "memory_ratio": "iterative / direct",
                "difference_psi": "difference of psi",
                "difference_gradient": "of the gradient",
            },
            solvers,
        ),
    ]
    _draw(rows, directory / "space.png")
    picture = "![Time, shares and memory over the number of unknowns in space](space.png)"
    write_page(directory, "space", "In space", picture, tables)
    return tables


def _crossings(solvers: list[dict[str, Any]]) -> str:
    """Where conjugate gradients would be better, in words."""
    if not solvers:
        return ""
    parts = []
    for name, what in (("time_ratio", "time"), ("memory_ratio", "memory")):
        better = [row["dofs"] for row in solvers if row[name] < 1.0]
        if better:
            parts.append(f"in {what} they are better from {min(better):,} unknowns on")
        else:
            where = crossing(solvers, name)
            tail = f", extrapolated from the last two near {where:.1g}" if where < 1e9 else ""
            parts.append(f"in {what} nowhere{tail}")
    return f"Of these meshes: {', '.join(parts)}. {_reach(solvers)}"


def _reach(solvers: list[dict[str, Any]]) -> str:
    """What memories hold, extrapolated from the last two meshes in logarithms, in words."""
    if len(solvers) < 2:
        return ""
    dofs = np.log([row["dofs"] for row in solvers[-2:]])
    parts = []
    for name, what in (("memory_direct", "factors"), ("memory_iterative", "conjugate gradients")):
        memory = np.log([row[name] for row in solvers[-2:]])
        slope = (memory[1] - memory[0]) / (dofs[1] - dofs[0])
        held = [
            f"{float(f'{np.exp(dofs[1] + (np.log(1024.0 * gib) - memory[1]) / slope):.2g}'):,.0f}"
            for gib in GIB
        ]
        parts.append(f"{what} (growth n^{slope:.2f}) {', '.join(held)}")
    sizes = ", ".join(map(str, GIB))
    return (
        f"Extrapolated from the last two meshes, {sizes} GiB hold so many unknowns: by "
        f"{'; by '.join(parts)}."
    )


def _steps_table(result: dict[str, Any]) -> Table:
    few, many = result["steps"]
    rows = []
    for row in result["rows"]:
        micro = {name: 1e6 * value for name, value in row.items() if name != "modes"}
        ratios = {
            f"{name}_ratio": row[f"{name}_3"] / row[f"{name}_2"]
            for name in ("simulation", "adjoint")
        }
        rows.append({"modes": row["modes"], **micro, **ratios})
    return Table(
        "space_steps",
        "Time steps beside the plane",
        "One rod, the slider-cranks of both demos with the same number of shape functions: CPU "
        "time of a step of generalised-alpha and of its adjoint, psi included, from the "
        f"difference of {many:,} and {few:,} steps; the least of many, in turn. A body in space "
        "has six coordinates besides its modes, one in the plane three; the joints have six rows "
        "here, three there.",
        {
            "modes": "modes",
            "simulation_2": "simulation, plane [us]",
            "simulation_3": "space [us]",
            "simulation_ratio": "space / plane",
            "adjoint_2": "adjoint, plane [us]",
            "adjoint_3": "space [us]",
            "adjoint_ratio": "space / plane",
        },
        rows,
    )


def _draw(rows: list[dict[str, Any]], path: Path) -> None:
    direct, iterative = (
        [row for row in rows if row["solver"] == solver] for solver in (DIRECT, ITERATIVE)
    )
    with styled_figure(13.0, 4.4) as figure:
        figure.set_constrained_layout(True)
        figure.set_constrained_layout_pads(w_pad=0.12, h_pad=0.08)
        times, shares, memory = figure.subplots(1, 3, gridspec_kw={"width_ratios": [1.1, 1.0, 1.0]})
        for axes, names in (
            (times, ("gradient", "value")),
            (memory, ("memory_gradient", "memory_value")),
        ):
            for name, color, label in zip(
                names, (ORANGE, BLUE), ("psi and exact gradient", "psi alone"), strict=True
            ):
                for own, style, face in ((direct, "o-", color), (iterative, "s--", "white")):
                    axes.plot(
                        [row["dofs"] for row in own],
                        [row[name] for row in own],
                        style,
                        color=color,
                        markerfacecolor=face,
                        label=label + (", without a factor" if own is iterative else ""),
                    )
            _dofs_axis(axes, direct)
        times.set_ylabel("seconds of CPU")
        times.set_title("Time")
        times.legend(loc="upper left")
        memory.set_ylabel("MB beyond the libraries")
        memory.set_title("Peak memory")
        draw_shares(shares, direct)
        shares.set_xticks(range(len(direct)), [_thousands(row["dofs"]) for row in direct])
        shares.set_xlabel("thousands of unknowns")
        save(figure, path)


def _dofs_axis(axes: Axes, rows: list[dict[str, Any]]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    ticks = [row["dofs"] for row in rows]
    axes.set_xticks(ticks, [_thousands(n) for n in ticks])
    axes.minorticks_off()
    axes.set_xlabel("thousands of unknowns")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.35)
    tidy(axes)


def _thousands(dofs: int) -> str:
    return f"{dofs / 1000:,.{0 if dofs >= 9500 else 1}f}"
