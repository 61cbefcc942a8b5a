# SPDX-License-Identifier: MIT
"""Finished designs and their parts, from many starts and by each method.

Each design is one call of `optimize`, which ends with steps of the boundary; nothing is tuned from
row to row. psi is told by the densities, by the moved boundary, and by finer meshes of its part.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress, Results
from numpy.typing import NDArray
from report import Study, Table, chosen
from scene import slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import polygon
from dolfinx_ffr.plotting.style import BLUE, GRAY

Array = NDArray[np.float64]

VOLUME = 0.5
#: Start designs: two without holes, regular and single holes, bars, and noise
STARTS = "even,full,one hole,6x2,6x3,10x3,12x2,16x2,strip,flanges,random 1,random 2,random 3".split(
    ","
)
#: Ways from the even density to a design
METHODS = ["level set, moving asymptotes", "level set, explicit steps", "densities"]


def designs_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each design."""
    common = {"iterations": 60, "steps": 2000, "boundary": 25, "elements": [200, 20]}
    if quick:
        common = {"iterations": 8, "steps": 50, "boundary": 1, "elements": [40, 4]}
    wanted = [{"start": start} for start in (STARTS[:2] if quick else STARTS)]
    wanted += [{"method": method} for method in METHODS[1 : 1 if quick else None]]
    return [Job("designs", "design", 6.0 if quick else 60.0, {**common, **own}) for own in wanted]


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


def design(
    comm: MPI.Comm,
    progress: Progress,
    *,
    iterations: int,
    steps: int,
    elements: list[int],
    boundary: int,
    start: str = "even",
    method: str = METHODS[0],
) -> dict[str, Any]:
    """One design from nothing to a verified part, on one rank."""
    began, clock = process_time(), [process_time()]
    problem = slider_crank(MPI.COMM_SELF, elements, steps=steps)
    domain = problem.flexible["rod"].domain
    gradient = problem.gradient(np.full(domain.n_cells, VOLUME)).gradient
    levelset = ffr.LevelSet(domain, mirrors=ffr.mirror_lines(domain, gradient["rod"]))
    densities, explicit = ffr.DensityDesign(domain), method == METHODS[1]
    way: tuple[ffr.design.Design, Array] = (levelset, _start(levelset, start))
    if explicit:
        way = (levelset, levelset.with_holes(10, 3, 0.008, margin=0.01))
    elif method == METHODS[2]:
        way = (densities, densities.even(VOLUME))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = ffr.optimize(
            problem,
            *way,
            optimizer=ffr.LevelSetEvolution() if explicit else ffr.MMA(),
            volume=VOLUME,
            iterations=100 if explicit and iterations >= 60 else iterations,
            progress=False,
            callback=lambda i, *_: (progress(0.5 * i / iterations), clock.append(process_time())),
            boundary=boundary,
        )
        found = {"start": start, "method": method, "grid": clock[-1] - began}
        told = result.moved or result
        modes = {"rod": told.problem.flexible["rod"].modes}
        full = result.problem.with_modes(modes).value(np.ones(domain.n_cells)).psi
        found |= {"psi": result.psi / full, "moved": told.psi / full}
        try:
            part, verified = result.part(), result.verify()
        except (ValueError, ffr.SimulationError):  # torn after a few iterations
            return {**found, "seconds": process_time() - began}
    return {
        **found,
        "part": verified.psi / full,
        "difference": verified.difference,
        "modes": modes["rod"],
        "volume": part.area / domain.area,
        "stress": 1e-6 * verified.fitted[-1].bodies["rod"].stress,
        "thinnest": 1e3 * part.thinnest_member.value if part.thinnest_member else np.nan,
        "gap": 1e3 * part.narrowest_gap.value if part.narrowest_gap else np.nan,
        "radius": 1e3 * result.moved.boundary.smallest_radius if result.moved else np.nan,
        "seconds": process_time() - began,
        "rings": [
            [polygon(loop, part.accuracy).round(6).tolist() for loop in loops]
            for loops in part.outlines
        ],
    }


def report_designs(results: Results, directory: Path) -> list[Table]:
    """Tables of starts and methods, and a picture of all parts."""
    rows = [result for _, result in results]
    starts, methods = chosen(rows, method=METHODS[0]), chosen(rows, start="even")
    study = Study(directory, "designs")
    study.table("designs_starts", starts)
    study.table("designs_methods", methods)
    shown = [row for row in rows if "rings" in row] or rows
    lines = -(-len(shown) // 2)
    with study.picture(
        "The parts of all starts and methods", lines, 2, (9.0, max(0.75 * lines + 0.5, 3.0))
    ) as panels:
        for axes in panels:
            axes.set_axis_off()
        for axes, row in zip(panels, shown, strict=False):
            axes.set_aspect("equal")
            name = row["start"] if row["method"] == METHODS[0] else row["method"]
            title = f"{name}: {row.get('part', np.nan):.4f}"
            axes.set_title(title, fontsize=8, loc="left", pad=1.0)
            for loops in row.get("rings", []):
                for k, ring in enumerate(loops):
                    axes.fill(*np.array(ring).T, color="white" if k else GRAY, linewidth=0.0)
                    axes.plot(*np.array(ring).T, color=BLUE, linewidth=0.5)
    return study.write()
