# SPDX-License-Identifier: MIT
"""Parts whose boundary was moved: from many starts, meshes and drawings, for psi and the stress.

Each part is one call of `optimize`, which ends with steps of the boundary; nothing is tuned from
row to row. psi is that of the densities, of the moved boundary, and of finer meshes of its part.
"""

import warnings
from collections.abc import Callable
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from drawn import PARTS
from jobs import Array, Job, Progress, Results
from report import Study, chosen
from scene import demo, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import polygon
from dolfinx_ffr.plotting.style import BLUE, GRAY

VOLUME = 0.5
#: Largest stress where the material is minimised [Pa], with a slider of this mass [kg], and the
#: distance from the rigid interfaces within which no stress counts [m]
STRESS, SLIDER, CLEAR = 4e6, 5.0, 3e-3
#: What a design is for, where it is not the least compliance
STRESSED = "stress limit"
#: What a design raises that is torn after its iterations: its row has no part
TORN = (ValueError, ffr.SimulationError)
#: Start designs: two without holes, regular and single holes, bars, and noise
STARTS = "even,full,one hole,6x2,6x3,10x3,12x2,16x2,strip,flanges,random 1,random 2,random 3".split(
    ","
)
#: Starts for the stress: those that are not far too soft
STIFF = "even,full,one hole,6x2,6x3,10x3,12x2,flanges,random 1,random 2".split(",")
#: Iterations and steps of the boundary, and twice the steps
STEPS: dict[str, Any] = {"iterations": 36, "boundary": 18}
MORE: dict[str, Any] = {"iterations": 36, "boundary": 36}
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
    rod: dict[str, Any] = {"elements": [200, 20], "cell": "quadrilateral", "steps": None}
    if quick:
        few = {"iterations": 8, "boundary": 1, "elements": [40, 4], "steps": 50}
        wanted = [{**few, "start": "10x3"}, {**few, "start": "even", "task": STRESSED}]
        wanted[1]["iterations"] = 12
        drawn = [{"name": "plate", "iterations": 4, "steps": 1}]
    else:
        wanted = [{**steps, "start": start} for steps in (STEPS, MORE) for start in STARTS]
        wanted += [{**MORE, **mesh, "member": MEMBER} for mesh in MESHES]
        fewer = {"elements": [100, 12], "steps": 2000, "task": STRESSED}
        wanted += [{**STEPS, **fewer, "start": start} for start in STIFF]
        drawn = [{"name": name} for name in PARTS]
    seconds = 6.0 if quick else 100.0
    return [
        *(Job("boundary", "design", seconds, {**rod, **own}) for own in wanted),
        *(Job("drawn", "moved", seconds, own) for own in drawn),
    ]


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
    if task != STRESSED:
        return problem
    heavy = demo("slider_crank").slider_crank(problem.integrator.end_time, SLIDER)
    peak = ffr.PeakStress("rod", clear=CLEAR)
    limit = ffr.Constraint(peak, upper=STRESS, name="stress")
    return ffr.Problem(problem.bodies, heavy, problem.integrator, ffr.Volume("rod"), [limit])


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

    def callback(iteration: int, *_: Any) -> None:
        progress(0.5 * iteration / iterations)
        clock.append(process_time())

    mesh = "x".join(map(str, elements)) + (" triangles" if rod_of["cell"] == "triangle" else "")
    mesh += f" of order {order}" if order > 1 else ""
    columns = 2.0 * np.ptp(domain.bounding_box[:, 0]) / elements[0]
    row: dict[str, Any] = {"start": start, "mesh": mesh, "task": task}
    row["ends"] = 1e3 * rod_of.get("solid_length", columns)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = ffr.optimize(
            problem,
            levelset,
            _start(levelset, start),
            volume=1.0 if task == STRESSED else VOLUME,
            iterations=iterations,
            boundary=boundary,
            progress=False,
            callback=callback,
        )
        row["grid"] = clock[-1] - began
        last_problem, evaluation = result.final
        rod = last_problem.flexible["rod"]
        whole = _problem(elements, task, **rod_of).with_modes({"rod": rod.modes})
        full = whole.value(np.ones(domain.n_cells)).psi
        row |= {"psi": result.evaluation.psi / full, "moved": evaluation.psi / full}
        row["modes"] = rod.modes
        try:
            part = result.part()
            verified = part.verify(last_problem, evaluation, progress=False)
        except TORN:
            return {**row, "seconds": process_time() - began}
    last, reported = verified.fitted[-1], verified.reported
    if task == STRESSED:
        row["stress_bounded_reported"] = 1e-6 * reported.constraints["stress"]
        row["stress_bounded"] = 1e-6 * last.constraints["stress"]
    return {
        **row,
        "part": last.psi / full,
        "difference": verified.difference,
        "volume": part.area / domain.area,
        "stress_reported": 1e-6 * reported.bodies["rod"].stress,
        "stress": 1e-6 * last.bodies["rod"].stress,
        "thinnest": 1e3 * part.thinnest_member.value if part.thinnest_member else np.nan,
        "gap": 1e3 * part.narrowest_gap.value if part.narrowest_gap else np.nan,
        "radius": 1e3 * result.moved.boundary.smallest_radius if result.moved else np.nan,
        "seconds": process_time() - began,
        "rings": [
            [polygon(loop, part.accuracy).round(6).tolist() for loop in loops]
            for loops in part.outlines
        ],
    }


def report_boundary(study: Study, results: Results) -> None:
    """Tables of starts, meshes, stress limits and drawn parts, and pictures of the parts."""
    jobs = [(job.parameters, row) for job, row in results if job.study == "boundary"]
    usual = {"start": "even", "task": "compliance", "member": None}

    def of(**wanted: Any) -> list[dict[str, Any]]:
        return [row for own, row in jobs if chosen([{**usual, **own}], **wanted)]

    steps = jobs[0][0]["boundary"]
    starts = of(task="compliance", member=None, boundary=steps)
    starts = [{**row, "inflections": _inflections(row)} for row in starts]
    study.table("boundary_starts", starts)
    if more := of(task="compliance", member=None, boundary=2 * steps):
        study.table("boundary_more", more)
    if meshes := of(member=MEMBER):
        study.table("boundary_meshes", meshes)
    study.table("boundary_stress_limit", limited := of(task=STRESSED))
    study.table("boundary_drawn", [row for job, row in results if job.study == "drawn"])
    _draw(study, "", "The parts of all starts", starts, "part")
    _draw(study, "boundary_stress", "Parts for a largest stress", limited, "stress_bounded")


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


def _draw(study: Study, name: str, caption: str, rows: list[dict[str, Any]], number: str) -> None:
    """A picture of parts with a number each."""
    shown = [row for row in rows if "rings" in row] or rows
    lines = -(-len(shown) // 2)
    size = (9.0, max(0.75 * lines + 0.5, 3.0))
    with study.picture(caption, lines, 2, size, name) as panels:
        for axes in panels:
            axes.set_axis_off()
        for axes, row in zip(panels, shown, strict=False):
            axes.set_aspect("equal")
            text = f"{row['start']}: {row.get(number, np.nan):.4g}"
            axes.set_title(text, fontsize=8, loc="left", pad=1.0)
            for loops in row.get("rings", []):
                for k, ring in enumerate(loops):
                    closed = np.array([*ring, ring[0]]).T
                    axes.fill(*closed, color="white" if k else GRAY, linewidth=0.0)
                    axes.plot(*closed, color=BLUE, linewidth=0.5)
