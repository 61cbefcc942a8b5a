# SPDX-License-Identifier: MIT
"""Parts whose boundary was moved: from many starts and meshes, for psi and for the stress.

Each part is one call of `optimize`, which ends with steps of the boundary; nothing is tuned from
row to row. psi is that of the densities, of the moved boundary, and of finer meshes of its part.
"""

import json
import math
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Array, Job, Progress, Results
from report import Study, chosen
from scene import demo, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.design import SHARP_PROGRESS
from dolfinx_ffr.fem import polygon
from dolfinx_ffr.plotting.style import BLUE, GRAY

VOLUME = 0.5
#: Largest stress where the material is minimised [Pa], with a slider of this mass [kg], and the
#: distance from the rigid interfaces within which no stress counts [m]
STRESS, SLIDER, CLEAR = 4e6, 5.0, 3e-3
#: What a design raises that is torn after its iterations: its row has no part
TORN = (ValueError, ffr.SimulationError)
#: Start designs: two without holes, regular and single holes, bars, and noise
STARTS = "even,full,one hole,6x2,6x3,10x3,12x2,16x2,strip,flanges,random 1,random 2,random 3".split(
    ","
)
#: Starts for the stress: those that are not far too soft
STIFF = "even,full,one hole,6x2,6x3,10x3,12x2,flanges,random 1,random 2".split(",")
#: What is the least in a table of both
LEAST = "least compliance", "least stress"
#: Iterations, and steps of the boundary: elements only, boundary only, both
WAYS: list[dict[str, Any]] = [
    {"start": "10x3", "iterations": n, "boundary": steps}
    for n, steps in ((60, 0), (0, 40), (36, 18))
]
#: Iterations and steps of the boundary of a short run, with which every start is measured, too
SHORT = {"iterations": 30, "boundary": 8}
#: Minimum member of 200 x 20 elements, which other meshes have beside them, too [m]
MEMBER = 1.28e-3
#: Meshes from which the boundary starts: with the solid ends of 200 x 20 elements, and with others
ENDS = {"solid_length": 4e-3}
MESHES: list[dict[str, Any]] = [
    {"elements": [200, 20], **ENDS},
    {"elements": [120, 12], **ENDS},
    {"elements": [300, 30], **ENDS},
    {"elements": [200, 20], "cell": "triangle", **ENDS},
    {"elements": [150, 15], "cell": "triangle", **ENDS},
    {"elements": [100, 10], "cell": "triangle", "order": 2, **ENDS},
    {"elements": [120, 12]},
]


def boundary_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each design."""
    common: dict[str, Any] = {"iterations": 36, "steps": None, "boundary": 18}
    common |= {"elements": [200, 20], "cell": "quadrilateral"}
    if quick:
        common |= {"iterations": 8, "steps": 50, "boundary": 1, "elements": [40, 4]}
    kept = STARTS[5:6] if quick else [STARTS[0], STARTS[3], STARTS[5]]
    wanted: list[dict[str, Any]] = [{"start": start} for start in (kept if quick else STARTS)]
    wanted += [] if quick else [{"start": start, **SHORT} for start in STARTS]
    fewer = {"iterations": 12} if quick else {"elements": [100, 12], "steps": 2000}
    starts = STIFF[: 1 if quick else None]
    wanted += [{"task": "stress limit", "start": start, **fewer} for start in starts]
    wanted += [{"task": task, **fewer} for task in (() if quick else LEAST)]
    wanted += [] if quick else WAYS
    wanted += [{"start": start, "outline": False} for start in kept]
    wanted += [] if quick else [{**mesh, "member": MEMBER, "boundary": 36} for mesh in MESHES]
    every = {json.dumps({**common, **own}, sort_keys=True): None for own in wanted}
    seconds = 6.0 if quick else 70.0
    return [Job("boundary", "design", seconds, json.loads(own)) for own in every]


def _start(levelset: ffr.LevelSet, name: str) -> Array:
    """A start design by its name."""
    low, high = levelset.domain.bounding_box
    center, height = 0.5 * (low + high), float(high[1] - low[1])

    def offset(points: Array) -> Array:
        return np.abs(points[:, 1] - center[1])

    shapes: dict[str, Callable[[Array], Array]] = {
        "one hole": lambda p: np.linalg.norm(p - center, axis=1) - 0.25 * height,
        "strip": lambda p: 0.25 * height - offset(p),
        "flanges": lambda p: offset(p) - 0.25 * height,
    }
    if name in ("even", "full"):
        return levelset.even(0.5 if name == "even" else 1.0)
    if name in shapes:
        return levelset.from_distance(shapes[name])
    if name.startswith("random"):
        return np.random.default_rng(int(name.split()[1])).uniform(size=levelset.size)
    columns, rows = (int(n) for n in name.split("x"))
    return levelset.with_holes(columns, rows, 0.2 * height)


def _problem(elements: list[int], task: str, **rod: Any) -> ffr.Problem:
    """The rod of the slider-crank with what it is designed for."""
    problem = slider_crank(MPI.COMM_SELF, elements, **rod)
    if task == "compliance":
        return problem
    heavy = demo("slider_crank").slider_crank(problem.integrator.end_time, SLIDER)
    peak, compliance = ffr.PeakStress("rod", clear=CLEAR), ffr.IntegralCompliance()
    limit = ffr.Constraint(peak, upper=STRESS, name="stress")
    # the reported value beside the least of the other has a bound that does not matter
    wanted = {
        "stress limit": (ffr.Volume("rod"), limit),
        LEAST[0]: (compliance, replace(limit, upper=1e3 * STRESS)),
        LEAST[1]: (peak, ffr.Constraint(compliance, upper=1e3, name="compliance")),
    }
    objective, bound = wanted[task]
    return ffr.Problem(problem.bodies, heavy, problem.integrator, objective, [bound])


def _mirrors(elements: list[int], **rod: Any) -> list[ffr.design.Mirror]:
    """The lines about which the loads are symmetric."""
    problem = slider_crank(MPI.COMM_SELF, elements, **rod)
    domain = problem.flexible["rod"].domain
    found = problem.gradient(np.full(domain.n_cells, VOLUME)).gradient
    assert found is not None
    return ffr.mirror_lines(domain, found["rod"])


def design(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: list[int],
    iterations: int,
    boundary: int,
    start: str = "even",
    outline: bool = True,
    task: str = "compliance",
    **rod_of: Any,
) -> dict[str, Any]:
    """One design from nothing to a verified part, on one rank."""
    began, clock = process_time(), [process_time()]
    member, order = rod_of.pop("member", None), rod_of.get("order", 1)
    problem = _problem(elements, task, **rod_of)
    domain = problem.flexible["rod"].domain
    sizes = {"minimum_member": member, "minimum_gap": member}
    levelset = ffr.LevelSet(domain, **sizes, mirrors=_mirrors(elements, **rod_of))
    bound = {"volume": 1.0 if task == "stress limit" else VOLUME, "progress": False}

    def callback(iteration: int, *_: Any) -> None:
        progress(0.5 * iteration / iterations)
        clock.append(process_time())

    mesh = "x".join(map(str, elements)) + (" triangles" if rod_of["cell"] == "triangle" else "")
    mesh += f" of order {order}" if order > 1 else ""
    found: dict[str, Any] = {"start": start, "mesh": mesh, "task": task}
    columns = 2.0 * np.ptp(domain.bounding_box[:, 0]) / elements[0]
    found["ends"] = 1e3 * rod_of.get("solid_length", columns)
    found |= {"iterations": iterations, "boundary": boundary}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # the same design on the elements, whether all of its boundary moves or only holes
        own = {
            "optimizer": ffr.MMA(length=None if outline else math.ceil(iterations / SHARP_PROGRESS))
        }
        own |= {"iterations": iterations, "callback": callback, **bound}
        steps_of = {"boundary": boundary if outline else 0}
        result = ffr.optimize(problem, levelset, _start(levelset, start), **steps_of, **own)
        found["grid"] = clock[-1] - began
        told = moved = result.moved
        if not outline:
            how = {"outline": outline, "mirrors": levelset.mirrors}
            with suppress(*TORN):
                free = ffr.Boundary.of(result.part(), levelset.minimum_member, **how)
                told = moved = ffr.move_boundary(result.problem, free, iterations=boundary, **bound)
        told = told or result
        rod = told.problem.flexible["rod"]
        whole = _problem(elements, task, **rod_of).with_modes({"rod": rod.modes})
        solid = whole.value(np.ones(domain.n_cells))
        full = solid.psi
        found |= {"psi": result.evaluation.psi / full, "moved": told.evaluation.psi / full}
        found["modes"] = rod.modes
        try:
            part = moved.part("rod") if moved else result.part()
            verified = part.verify(told.problem, told.evaluation, progress=False)
        except TORN:
            return {**found, "seconds": process_time() - began}
    last, reported = verified.fitted[-1], verified.reported
    if task == "stress limit":
        peaks = [1e-6 * row.constraints["stress"] for row in (reported, last)]
        found |= {"told": peaks[0], "limited": peaks[1]}
    if task == LEAST[0]:
        found |= {"compliance": last.psi / full, "limited": 1e-6 * last.constraints["stress"]}
    if task == LEAST[1]:
        compliance = last.constraints["compliance"] / solid.constraints["compliance"].value
        found |= {"compliance": compliance, "limited": 1e-6 * last.psi}
    return {
        **found,
        "part": last.psi / full,
        "difference": verified.difference,
        "volume": part.area / domain.area,
        "stress_told": 1e-6 * reported.bodies["rod"].stress,
        "stress": 1e-6 * last.bodies["rod"].stress,
        "thinnest": 1e3 * part.thinnest_member.value if part.thinnest_member else np.nan,
        "gap": 1e3 * part.narrowest_gap.value if part.narrowest_gap else np.nan,
        "radius": 1e3 * moved.boundary.smallest_radius if moved else np.nan,
        "seconds": process_time() - began,
        "rings": [
            [polygon(loop, part.accuracy).round(6).tolist() for loop in loops]
            for loops in part.outlines
        ],
    }


def report_boundary(study: Study, results: Results) -> None:
    """Tables of starts, outlines, meshes and stress limits, and pictures of all parts."""
    jobs = [(job.parameters, row) for job, row in results]
    usual = {"start": "even", "outline": True, "task": "compliance"}

    def of(**wanted: Any) -> list[dict[str, Any]]:
        wanted = {"task": "compliance", "outline": True, **wanted}
        return [row for own, row in jobs if chosen([{**usual, **own}], **wanted)]

    steps = {key: jobs[0][0][key] for key in ("iterations", "boundary")}
    mesh = {key: jobs[0][0][key] for key in ("elements", "cell")}
    starts = [{**row, "inflections": _inflections(row)} for row in of(**mesh, **steps)]
    study.table("boundary_starts", starts)
    study.table("boundary_short", of(**mesh, **SHORT))
    study.table("boundary_outline", of(**mesh, **steps, outline=False))
    study.table("boundary_meshes", of(**{**steps, "boundary": 36}, start="even"))
    study.table("boundary_stress_limit", limited := of(task="stress limit"))
    if both := [row for task in LEAST for row in of(task=task)]:
        study.table("boundary_least", both)
    if ways := [row for way in WAYS for row in of(**mesh, **way)]:
        study.table("boundary_ways", ways)
    _draw(study, "", "The parts of all starts", starts, "part")
    _draw(study, "boundary_stress", "Parts for a largest stress", limited, "limited")


def _inflections(row: dict[str, Any]) -> float:
    """How often edges turn the other way [1/mm], where radii are below 25 mm."""
    changes = length = 0.0
    for ring in (np.array(ring) for loops in row.get("rings", []) for ring in loops):
        way = np.diff(ring, axis=0)
        way = way[(size := np.linalg.norm(way, axis=1)) > 1e-5]
        turn = np.diff(np.unwrap(np.arctan2(way[:, 1], way[:, 0])))
        sides = np.linalg.norm(way, axis=1)
        turn = turn[np.abs(turn) > 20.0 * (sides[1:] + sides[:-1])]
        changes += np.count_nonzero(np.diff(np.sign(turn)))
        length += float(size.sum())
    return 1e-3 * changes / length if length else np.nan


def _draw(study: Study, name: str, caption: str, rows: list[dict[str, Any]], told: str) -> None:
    """A picture of parts with a number each."""
    shown = [row for row in rows if "rings" in row] or rows
    lines = -(-len(shown) // 2)
    size = (9.0, max(0.75 * lines + 0.5, 3.0))
    with study.picture(caption, lines, 2, size, name) as panels:
        for axes in panels:
            axes.set_axis_off()
        for axes, row in zip(panels, shown, strict=False):
            axes.set_aspect("equal")
            text = f"{row['start']}: {row.get(told, np.nan):.4g}"
            axes.set_title(text, fontsize=8, loc="left", pad=1.0)
            for loops in row.get("rings", []):
                for k, ring in enumerate(loops):
                    closed = np.array([*ring, ring[0]]).T
                    axes.fill(*closed, color="white" if k else GRAY, linewidth=0.0)
                    axes.plot(*closed, color=BLUE, linewidth=0.5)
