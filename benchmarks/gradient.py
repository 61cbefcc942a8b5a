# SPDX-License-Identifier: MIT
"""The exact gradient, the paper's route element by element, and its approximation: time and error.

Designs along an optimisation with the exact gradient: its start, a state in the middle, its end.
"""

from functools import partial
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Array, Job, Progress, Results, measure, the
from report import Study, chosen, line, plot
from scene import holes_design, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import ACCENTS, DARK, GRAY

#: Lengths in metres, for a rod of 0.4 m with elements of 2 mm
KERNELS = {
    "exponential": ffr.ExponentialSpline(0.1),
    "Gaussian": ffr.Gaussian(0.003),
    "multiquadric": ffr.Multiquadric(0.002),
    "thin plate": ffr.ThinPlate(),
    "Wendland": ffr.Wendland(0.05),
}
VOLUME = 0.5
#: Of `optimize`
ITERATIONS, SHARPNESS = 100, (11.0, 19.0, 32.0, 56.0)


def gradient_jobs(*, quick: bool) -> list[Job]:
    """The jobs."""
    sizes = [(20, 2)] if quick else [(100, 10), (200, 20), (400, 40)]
    own = {
        "elements": (40, 4) if quick else (200, 20),
        "shares": [0.3] if quick else [0.05, 0.1, 0.2, 0.3, 0.4, 0.6],
        "iterations": 2 if quick else ITERATIONS,
    }
    jobs = [Job("gradient", "approximations", 10.0 if quick else 260.0, own)]
    for size in sizes:
        seconds = 2.0 if quick else 6.0 + size[0] * size[1] / 500.0
        own = {"elements": size, "sample": 32 if quick else 512}
        jobs.append(Job("gradient", "elementwise_growth", seconds, own))
    return jobs


def approximations(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], shares: list[float], iterations: int
) -> dict[str, Any]:
    """Measure exact, element-wise and approximate gradients at designs along an optimisation."""
    problem = slider_crank(comm, elements)
    domain = problem.flexible["rod"].domain
    levelset = ffr.LevelSet(domain)
    start = levelset.with_holes(10, 3, 0.008, margin=0.01)
    designs = _designs(problem, levelset, start, iterations)
    _warm_up(problem)
    solid = problem.value(np.ones(domain.n_cells)).psi
    rows: list[dict[str, Any]] = []
    for place, (name, (coefficients, sharpness)) in enumerate(designs.items()):
        levelset = levelset.with_sharpness(sharpness)
        found = _at_design(problem, levelset, coefficients, shares)
        for row in found:
            rows.append({**row, "design": name, "psi": row["psi"] / solid})
        progress((place + 1) / len(designs))
    return {"rows": rows, "elements": domain.n_cells_global}


def _at_design(
    problem: ffr.Problem, levelset: ffr.LevelSet, coefficients: Array, shares: list[float]
) -> list[dict[str, Any]]:
    """Time and errors of each gradient at one design."""
    domain = levelset.domain
    design = domain.design_cells
    x = levelset.density(coefficients)
    value_seconds, evaluation = _best(partial(problem.value, x), 3)
    exact_seconds, exact = _best(partial(problem.differentiate, evaluation), 3)
    g = exact.gradient["rod"]
    extend = ffr.design.VelocityExtension(levelset)
    g_knots = extend(levelset.pullback(coefficients, g))
    distance = levelset.distance(coefficients)
    band = design & (np.abs(distance) <= 2.0 * levelset.element)
    slope = np.abs(_slope(levelset, coefficients))
    read = design & (slope > 1e-3 * slope.max())
    rows = []

    def note(
        kernel: str, share: float, seconds: float, gradient: Array, estimate: float = 0.0
    ) -> None:
        whole = ffr.paper.gradient_errors(domain, gradient, g, design)
        knots = extend(levelset.pullback(coefficients, gradient))
        cosine = knots @ g_knots / (np.linalg.norm(knots) * np.linalg.norm(g_knots) or 1.0)
        rows.append(
            {
                "psi": evaluation.psi,
                "value": value_seconds,
                "exact": exact_seconds,
                "read": float(np.count_nonzero(read) / np.count_nonzero(design)),
                "peaks": _share_of_peaks(g[design]),
                "kernel": kernel,
                "share": share,
                "seconds": seconds,
                "ratio": seconds / exact_seconds,
                "error": whole.l2,
                "cosine": whole.cosine,
                "worst": whole.worst,
                "band_error": ffr.paper.gradient_errors(domain, gradient, g, band).l2,
                "levelset_cosine": float(cosine),
                "estimate": estimate,
            }
        )

    def elementwise(cells: Array) -> tuple[float, Array]:
        seconds, found = _best(partial(_elementwise, problem, evaluation, cells), 1)
        values = np.zeros(domain.n_cells)
        values[found.cells] = found.values
        return seconds, values

    note("exact adjoint", 1.0, exact_seconds, g)
    note("element by element", 1.0, *elementwise(design))
    for share in shares:
        selected = ffr.paper.GradientElements(share=share).select(domain, distance)
        known_seconds, values = elementwise(selected)
        for kernel_name, kernel in KERNELS.items():
            method = ffr.paper.ApproximateGradient(kernel=kernel)
            interpolate = partial(method._interpolate, domain, selected, values)
            seconds, (gradient, report) = _best(interpolate, 1)
            note(kernel_name, share, known_seconds + seconds, gradient, report.estimate)
    return rows


def elementwise_growth(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], sample: int
) -> dict[str, Any]:
    """Measure what one element costs, from two numbers of elements."""
    problem = slider_crank(comm, elements)
    domain = problem.flexible["rod"].domain
    _warm_up(problem)
    value, evaluation = _best(partial(problem.value, holes_design(domain)), 3)
    exact, _ = _best(partial(problem.differentiate, evaluation), 3)
    spread = np.linspace(0, domain.n_cells - 1, sample).astype(int)
    sparse = spread[:: sample // 8]
    few, _ = _best(partial(_elementwise, problem, evaluation, sparse), 2)
    progress(0.5)
    many, _ = _best(partial(_elementwise, problem, evaluation, spread), 2)
    # on a small mesh the difference may drown in what else the machine does
    each = max(many - few, 0.0) / (sample - len(sparse))
    found = {"elements": domain.n_cells_global, "value": value, "exact": exact, "each": each}
    return {**found, "fixed": max(few - len(sparse) * each, 0.0)}


def _designs(
    problem: ffr.Problem, levelset: ffr.LevelSet, start: Array, iterations: int
) -> dict[str, tuple[Array, float]]:
    """Coefficients and steepness of the projection at the start, middle and end."""
    evolution = ffr.design.Evolution(levelset, VOLUME).with_sharpness(SHARPNESS[0])
    designs = {"start": (evolution.variables(evolution.start(start)), SHARPNESS[0])}
    for name, last in (("middle", iterations // 4), ("final", iterations)):
        result = ffr.optimize(
            problem,
            levelset,
            start,
            volume=VOLUME,
            # the first of the four stages alone, and all of them
            optimizer=ffr.LevelSetEvolution(
                sharpness=SHARPNESS if name == "final" else SHARPNESS[:1]
            ),
            iterations=last,
            progress=False,
        )
        designs[name] = (result.coefficients, result.designs["rod"].sharpness)
    return designs


def _elementwise(problem: ffr.Problem, evaluation: ffr.Evaluation, cells: Array) -> Any:
    """The derivatives at some cells of the rod, by the paper's route."""
    return ffr.paper.elementwise_gradient(problem, evaluation, cells, progress=False)["rod"]


def _warm_up(problem: ffr.Problem) -> None:
    """Let whatever is compiled or loaded once be there."""
    evaluation = problem.gradient(np.ones(problem.flexible["rod"].domain.n_cells))
    _elementwise(problem, evaluation, np.arange(2))


def _slope(levelset: ffr.LevelSet, coefficients: Array) -> Array:
    """How much each element's density changes where the whole boundary moves outwards."""
    eps = 1e-6
    ahead, behind = (levelset.density(coefficients + s * eps) for s in (1, -1))
    return (ahead - behind) / (2.0 * eps)


def _share_of_peaks(gradient: Array) -> float:
    """The share of the sum of squares that the largest hundredth of the entries holds."""
    squares = np.sort(gradient**2)[::-1]
    return float(np.sum(squares[: max(len(squares) // 100, 1)]) / np.sum(squares))


def _best(call: Any, repetitions: int) -> tuple[float, Any]:
    """The shortest processor time of some calls, and what the last returned."""
    seconds, found = measure({"": call}, repetitions, lambda _: None, process_time, untimed=0)
    return min(seconds[""]), found[""]


def report_gradient(study: Study, results: Results) -> None:
    """Tables and picture."""
    found = the("approximations", results)
    growth = [{**result} for job, result in results if job.function == "elementwise_growth"]
    rows = [
        {
            **row,
            "percent": 100.0 * row["share"],
            **{f"percent_{name}": 100.0 * row[name] for name in ("read", "peaks")},
            "shown": max(row["error"], 1e-12),
        }
        for row in found["rows"]
    ]
    for row in growth:
        row["all"] = row["fixed"] + row["elements"] * row["each"]
        row |= {"each_ms": 1e3 * row["each"], "ratio": row["all"] / row["exact"]}
    first = rows[0]
    both = first["value"] + first["exact"]
    study.table("gradient", rows, elements=found["elements"], first=first, both=both)
    study.table("gradient_designs", chosen(rows, kernel="exact adjoint"))
    study.table("gradient_growth", growth)
    names = list(dict.fromkeys(row["design"] for row in rows))
    caption, size = "Time beside error of exact and approximate gradients", 4.3 * len(names) + 0.6
    with study.picture(caption, 1, len(names), (size, 4.8)) as panels:
        for axes, name in zip(panels, names, strict=True):
            for kernel, color, mark in (
                *zip(KERNELS, ACCENTS, ["o-"] * len(KERNELS), strict=False),
                ("exact adjoint", DARK, "*"),
                ("element by element", GRAY, "s"),
            ):
                own = chosen(rows, design=name, kernel=kernel)
                wide = 14.0 if mark == "*" else 5.0
                line(axes, own, "seconds", "shown", mark, color, label=kernel, markersize=wide)
            x = "processor seconds for one gradient"
            plot(axes, f"{name} design", x, "relative error (below 1e-12: at 1e-12)")
        panels[-1].legend(loc="center right", fontsize=8)
