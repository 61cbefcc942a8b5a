# SPDX-License-Identifier: MIT
"""Bodies and motions in space: beside the plane, with the mesh, and without a factor."""

from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from growth import ONCE, PARTS, Row, draw_both, draw_shares, floored, part_columns, rows_of_growth
from jobs import Job, Progress, Results, fits, measure, the
from report import Study, chosen, plot
from scene import holes_design, slider_crank

import dolfinx_ffr as ffr

DIRECT, ITERATIVE = "direct", "iterative"
#: Constraint modes of the rods in the plane and in space
CONSTRAINT = {2: 3, 3: 6}


def space_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each mesh and solver."""
    if quick:  # elements, repetitions, seconds with factors
        sizes = [((6, 2, 2), 1, 1.0), ((12, 3, 3), 1, 1.0)]
    else:
        sizes = [((20, 4, 4), 7, 5.0), ((40, 4, 4), 7, 8.0), ((40, 8, 8), 5, 12.0)]
        sizes += [((80, 8, 8), 5, 30.0), ((80, 16, 16), ONCE, 25.0), ((120, 24, 24), ONCE, 60.0)]
        sizes += [((160, 32, 32), ONCE, 150.0)]
    direct = sizes if quick or fits("space: 160x32x32 by a factor", 12e9) else sizes[:-1]
    iterative = sizes[1:2] if quick else [(n, ONCE, seconds) for n, _, seconds in sizes[3:]]
    steps = {"modes": [8] if quick else [8, 12, 16, 24], "repetitions": 1 if quick else 15}
    steps |= {"steps": [100, 1100] if quick else [2000, 6000]}
    jobs = [Job("space", "steps_beside_the_plane", 5.0 if quick else 60.0, steps)]
    for solver, some in ((DIRECT, direct), (ITERATIVE, iterative)):
        for elements, count, seconds in some:
            own = {"elements": list(elements), "repetitions": count, "solver": solver}
            jobs.append(Job("growth", "evaluation", seconds, own))
    return jobs


def steps_beside_the_plane(
    comm: MPI.Comm, progress: Progress, *, modes: list[int], steps: list[int], repetitions: int
) -> dict[str, Any]:
    """Measure simulation and adjoint of both slider-cranks at equal numbers of modes."""
    actions: dict[tuple[Any, ...], Any] = {}
    for number in modes:
        for dimension, elements in ((2, (60, 6)), (3, (20, 4, 4))):
            problem = slider_crank(comm, elements, modes=number - CONSTRAINT[dimension])
            body = problem.flexible["rod"]
            integrals = {"rod": body.reduce(holes_design(body.domain)).integrals}
            for n in steps:
                integrator = ffr.GeneralizedAlpha(problem.integrator.end_time, n)
                mechanical = ffr.MechanicalProblem(problem.mechanism, integrator, problem.objective)
                found: list[Any] = []

                def simulation(m: Any = mechanical, b: Any = integrals, f: Any = found) -> None:
                    f[:] = [m.value(b)]

                def adjoint(m: Any = mechanical, f: Any = found) -> None:
                    m.differentiate(f[0])

                actions[number, dimension, n, "simulation"] = simulation
                actions[number, dimension, n, "adjoint"] = adjoint
    seconds, _ = measure(actions, repetitions, progress, process_time)
    least = {key: min(times) for key, times in seconds.items()}
    few, many = steps

    def step(number: int, dimension: int, name: str) -> float:
        more, less = (least[number, dimension, n, name] for n in (many, few))
        return (more - less) / (many - few)

    names = [(name, dimension) for name in ("simulation", "adjoint") for dimension in (2, 3)]
    rows = []
    for n in modes:
        row = {f"{name}_{d}": 1e6 * step(n, d, name) for name, d in names}
        row |= {f"{name}_ratio": row[f"{name}_3"] / row[f"{name}_2"] for name, _ in names}
        rows.append({"modes": n, **row})
    return {"rows": rows, "few": few, "many": many}


def rows_of_space(results: Results) -> list[Row]:
    """One row for each mesh and solver: CPU times, and shares of the parts in per cent."""
    rows = []
    for pair in results:
        (row,) = rows_of_growth([pair], cpu=True)
        row |= {"solver": pair[0].parameters["solver"], "rest": 0.0}
        row["repetitions"] = max(row["repetitions"], 1)
        # by the clock: their shares alone are told
        whole = sum(row[name] for name in PARTS)
        row |= {name: 100.0 * row[name] / whole for name in PARTS}
        rows.append({**row, "slope": np.array(pair[1]["slope"])})
    return sorted(rows, key=lambda row: (row["solver"], row["dofs"]))


def rows_of_solvers(rows: list[Row]) -> list[Row]:
    """Conjugate gradients over factors, mesh by mesh."""
    found = []
    for row in chosen(rows, solver=ITERATIVE):
        for other in chosen(rows, solver=DIRECT, mesh=row["mesh"]):
            memory = [r["memory_gradient"] for r in floored([row, other])]
            difference = np.linalg.norm(row["slope"] - other["slope"])
            found.append(
                {
                    **{name: row[name] for name in ("mesh", "dofs", "iterations")},
                    "direct": other["gradient"],
                    "iterative": row["gradient"],
                    "time_ratio": row["gradient"] / other["gradient"],
                    "memory_direct": other["memory_gradient"],
                    "memory_iterative": row["memory_gradient"],
                    "memory_ratio": memory[0] / memory[1],
                    "difference_psi": abs(row["psi"] / other["psi"] - 1.0),
                    "difference_gradient": float(difference / np.linalg.norm(other["slope"])),
                }
            )
    return found


def report_space(study: Study, results: Results) -> None:
    """Tables and picture."""
    found = [pair for pair in results if pair[0].function == "evaluation"]
    rows = rows_of_space(found)
    study.table("space_steps", **the("steps_beside_the_plane", results))
    first = {name: found[0][1][name] for name in ("modes", "steps")}
    study.table("space", rows, **first)
    study.table("space_parts", rows, parts=part_columns("%"))
    study.table("space_solvers", rows_of_solvers(rows))
    direct, iterative = (chosen(floored(rows), solver=solver) for solver in (DIRECT, ITERATIVE))
    caption = "Time, shares and memory over the number of unknowns in space"
    with study.picture(caption, 1, 3, (14.0, 4.4)) as (times, shares, memory):
        for axes, unit, title in ((times, "", "Time"), (memory, "memory_", "Peak memory")):
            draw_both(axes, unit, direct, iterative, "dofs", "without a factor")
            y = "MB beyond the libraries" if unit else "seconds of CPU"
            plot(axes, title, "unknowns", y, room=0.35, legend="" if unit else "upper left")
        draw_shares(shares, direct)
        shares.set_xticks(range(len(direct)), [f"{row['dofs'] / 1000:,.3g}" for row in direct])
        shares.set_xlabel("thousands of unknowns")
