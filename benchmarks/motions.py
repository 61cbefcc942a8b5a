# SPDX-License-Identifier: MIT
"""Several motions of one rod: as one problem beside as many problems, on 1 and on 2 ranks."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress
from report import Table, write_page
from scene import holes_design, slider_crank, slider_crank_numbers, warm_up

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import restored
from dolfinx_ffr.plotting.style import BLUE, GRAY, ORANGE, save, styled_figure, tidy
from dolfinx_ffr.problem.spread import adjoints, owners, trajectories

__all__ = ["motions_jobs", "report_motions", "several"]


def motions_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each number of ranks."""
    numbers = {
        "elements": [40, 4] if quick else [200, 20],
        "counts": [1, 4] if quick else [1, 2, 4, 8],
        "repetitions": 2 if quick else 9,
        "steps": 200 if quick else 2000,
    }
    return [Job("motions", "several", 8.0 if quick else 60.0, numbers, ranks) for ranks in (1, 2)]


def several(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: list[int],
    counts: list[int],
    repetitions: int,
    steps: int,
) -> dict[str, Any]:
    """Measure value and gradient of some motions as one problem, and as problems of their own.

    Args:
        comm: The ranks.
        progress: Told the part that is done.
        elements: Along and across.
        counts: Numbers of motions.
        repetitions: Of each, in turn.
        steps: Number of time steps of each motion.
    """
    warm_up(comm)
    reference = slider_crank(comm, (elements[0], elements[1]), steps=steps)
    x = holes_design(reference.flexible["rod"].domain)
    motions = {
        f"motion {k}": ffr.MechanicalProblem(
            at_speed(reference.mechanism, 1.0 + 0.05 * k), reference.integrator, reference.objective
        )
        for k in range(max(counts))
    }
    problems = {
        count: ffr.Problem.of_motions(reference.bodies, dict(list(motions.items())[:count]))
        for count in counts
    }
    rows: dict[int, list[dict[str, float]]] = {count: [] for count in counts}
    for repetition in range(repetitions + 1):
        for count, problem in problems.items():
            evaluation = problem.value(x)
            spread = _seconds(comm, partial(_spread, problem, evaluation))
            gradient = _seconds(comm, partial(problem.gradient, x))
            alone = [problem.alone(name) for name in problem.motions]
            apart = _seconds(comm, lambda alone=alone: [own.gradient(x) for own in alone])
            if repetition:  # the first one warms up
                found = {"spread": spread}
                if comm.size == 1:
                    found["share"] = _seconds(comm, partial(_share, problem, evaluation))
                rows[count].append({**found, "gradient": gradient, "apart": apart})
        progress((repetition + 1) / (repetitions + 1))
    psi = {count: [m.psi for m in p.value(x).motions.values()] for count, p in problems.items()}
    return {"elements": elements, "steps": steps, "rows": rows, "psi": psi}


def _spread(problem: ffr.Problem, evaluation: ffr.Evaluation) -> None:
    """The part of value and gradient that the ranks share."""
    moved = trajectories(problem.comm, problem.motions, problem.integrals(evaluation))
    bodies = problem.integrals(evaluation)
    responses = {name: ffr.Response(motion, bodies) for name, motion in moved.items()}
    bars = {}
    for name, motion in problem.motions.items():
        motion.evaluated(responses[name])
        bars[name, ""] = motion.objective.derivatives(responses[name]).trajectory
    adjoints(problem.comm, responses, bars)


def _share(problem: ffr.Problem, evaluation: ffr.Evaluation) -> None:
    """What the busier of two ranks does of it, without waiting for the other one."""
    bodies, moved = problem.integrals(evaluation), evaluation.motions
    costs = {n: float(m.trajectory.y.size) for n, m in moved.items() if m.trajectory is not None}
    own = [name for name, rank in owners(costs, 2).items() if rank == 0]
    sent = pickle.dumps({n: moved[n].trajectory.numbers for n in moved if n not in own})
    found = trajectories(problem.comm, {name: problem.motions[name] for name in own}, bodies)
    pickle.dumps({name: motion.numbers for name, motion in found.items() if motion is not None})
    for name, numbers in pickle.loads(sent).items():
        motion = problem.motions[name]
        found[name] = restored(motion.mechanism, bodies, motion.integrator, numbers)
    responses = {name: ffr.Response(motion, bodies) for name, motion in found.items()}
    bars = {}
    for name, motion in problem.motions.items():
        motion.evaluated(responses[name])
        bars[name, ""] = motion.objective.derivatives(responses[name]).trajectory
    adjoints(problem.comm, responses, {(name, ""): bars[name, ""] for name in own})


def _seconds(comm: MPI.Comm, action: Callable[[], Any]) -> float:
    """The largest processor time that an action takes on a rank, waiting for others included."""
    comm.Barrier()
    begin = process_time()
    action()
    return float(comm.allreduce(process_time() - begin, MPI.MAX))


def at_speed(mechanism: ffr.Mechanism, factor: float) -> ffr.Mechanism:
    """The scene with a crank that turns by more in the same time."""
    radius, turns, duration, _ = slider_crank_numbers()
    angle = ffr.Motion.smooth_step(2.0 * np.pi * turns * factor, duration)
    crank = ffr.Revolute(("rod", "left"), ffr.Moving.circle((0.0, 0.0), radius, angle))
    return replace(mechanism, joints=[crank, mechanism.joints[1]])


# ---------------------------------------------------------------------- tables and picture


def rows_of_motions(results: list[tuple[Job, dict[str, Any]]]) -> list[dict[str, Any]]:
    """One row for each number of motions and of ranks."""
    least: dict[tuple[int, int], dict[str, float]] = {}
    psi: dict[tuple[int, int], list[float]] = {}
    for job, result in results:
        for count, measured in result["rows"].items():
            key = int(count), job.ranks
            # others work on the machine: the fastest of many is nearest to its own time
            parts = {name: [row[name] for row in measured] for name in measured[0]}
            least[key] = {name: float(np.min(values)) for name, values in parts.items()}
            psi[key] = result["psi"][count]
    rows = []
    for (count, ranks), found in sorted(least.items()):
        one = least.get((count, 1), found)
        there = psi.get((count, 1), psi[count, ranks])
        difference = np.max(np.abs(np.divide(psi[count, ranks], there) - 1.0))
        rows.append(
            {
                "motions": count,
                "ranks": ranks,
                **found,
                "spread_ratio": one["spread"] / found["spread"],
                "share": one["share"],
                "share_ratio": one["spread"] / (one["share"] if ranks > 1 else one["spread"]),
                "gradient_ratio": one["gradient"] / found["gradient"],
                "apart_ratio": found["apart"] / found["gradient"],
                "difference": float(difference),
            }
        )
    return rows


def report_motions(results: list[tuple[Job, dict[str, Any]]], directory: Path) -> list[Table]:
    """Write table and picture.

    Args:
        results: Of `motions_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    rows, first = rows_of_motions(results), results[0][1]
    table = Table(
        "motions",
        "Several motions of one rod",
        "Value and gradient of the sum of the integral compliances; rod of the demo with 30 holes, "
        f"{first['elements'][0]} x {first['elements'][1]} quadrilaterals, speeds from the demo's "
        f"to more, {first['steps']} steps each. *Spread* is what the ranks share: simulations, "
        "objectives and adjoints of all motions, with what the ranks tell each other. *Apart* are "
        "as many problems of one motion, one after the other, each with its own reduction and "
        "pullback. Times are processor times of the rank with the larger one, waiting included, "
        "the least of all repetitions, which are made in turn. *Without waiting* is what the "
        "busier of two ranks has to do, measured alone. *Less* is beside 1 rank; the difference is "
        "that of psi, the largest of all motions, from 1 rank.",
        {
            "motions": "motions",
            "ranks": "ranks",
            "spread": "spread [s]",
            "spread_ratio": "less by",
            "share_ratio": "less by, without waiting",
            "gradient": "gradient [s]",
            "gradient_ratio": "less by",
            "apart": "apart [s]",
            "apart_ratio": "apart / gradient",
            "difference": "difference of psi",
        },
        rows,
    )
    _draw(rows, directory / "motions.png")
    picture = "![Time over the number of motions](motions.png)"
    write_page(directory, "motions", "Several motions", picture, [table])
    return [table]


def _draw(rows: list[dict[str, Any]], path: Path) -> None:
    with styled_figure(9.6, 4.0) as figure:
        figure.set_constrained_layout(True)
        times, ratios = figure.subplots(1, 2)
        for ranks, color in ((1, BLUE), (2, ORANGE)):
            own = [row for row in rows if row["ranks"] == ranks]
            count = [row["motions"] for row in own]
            label = f"{ranks} rank{'s' * (ranks > 1)}"
            times.plot(count, [row["gradient"] for row in own], "o-", color=color, label=label)
            if ranks == 1:
                apart = [row["apart"] for row in own]
                times.plot(count, apart, "o--", color=GRAY, label="as many problems, 1 rank")
            else:
                for name, style, what in (
                    ("share_ratio", "o-", "simulations and adjoints, work of a rank"),
                    ("spread_ratio", "o:", "the same with waiting"),
                    ("gradient_ratio", "o--", "the whole gradient, with waiting"),
                ):
                    ratios.plot(count, [row[name] for row in own], style, color=color, label=what)
        times.set_title("Value and gradient, processor time of a rank [s]", loc="left")
        ratios.set_title("2 ranks: less than 1 rank by", loc="left")
        ratios.axhline(1.0, color=GRAY, linewidth=0.8)
        for axes in (times, ratios):
            tidy(axes)
            axes.set_ylim(bottom=0.0)
            axes.set_xlabel("motions")
            axes.set_xticks(sorted({row["motions"] for row in rows}))
            axes.legend()
        save(figure, path)
