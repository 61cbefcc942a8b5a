# SPDX-License-Identifier: MIT
"""The exact gradient, the paper's route element by element, and its approximation: time and error.

Designs along an optimisation with the exact gradient: its start, a state in the middle, its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress
from numpy.typing import NDArray
from report import Table, write_page
from scene import holes_design, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import ACCENTS, DARK, GRAY, save, styled_figure, tidy

__all__ = ["approximations", "elementwise_growth", "gradient_jobs", "report_gradient"]

#: Lengths in metres, for a rod of 0.4 m with elements of 2 mm
KERNELS: dict[str, ffr.rbf.Kernel] = {
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
    """The jobs.

    Args:
        quick: Small meshes and few repetitions.
    """
    sizes = [(40, 4)] if quick else [(100, 10), (200, 20), (400, 40)]
    elements = (60, 6) if quick else (200, 20)
    shares = [0.2, 0.4] if quick else [0.05, 0.1, 0.2, 0.3, 0.4, 0.6]
    iterations = 4 if quick else ITERATIONS
    jobs = [
        Job(
            "gradient",
            "approximations",
            10.0 if quick else 260.0,
            {"elements": elements, "shares": shares, "iterations": iterations},
        )
    ]
    for size in sizes:
        count = size[0] * size[1]
        jobs.append(
            Job(
                "gradient",
                "elementwise_growth",
                2.0 if quick else 6.0 + count / 500.0,
                {"elements": size, "sample": 64 if quick else 512},
            )
        )
    return jobs


def approximations(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: tuple[int, int],
    shares: Sequence[float],
    iterations: int,
) -> dict[str, Any]:
    """Measure exact, element-wise and approximate gradients at designs along an optimisation.

    Args:
        comm: The ranks.
        progress: Told the part that is done.
        elements: Along and across the rod.
        shares: Of the elements with exact derivatives.
        iterations: Of the optimisation, at most.
    """
    problem = slider_crank(comm, elements)
    domain = problem.flexible["rod"].domain
    levelset = ffr.LevelSet(domain)
    start = levelset.with_holes(10, 3, 0.008, margin=0.01)
    designs = _designs(problem, levelset, start, iterations)
    _warm_up(problem)
    solid = problem.value(np.ones(domain.n_cells)).psi
    design = domain.design_cells
    rows = []
    for place, (name, (coefficients, sharpness)) in enumerate(designs.items()):
        levelset = levelset.with_sharpness(sharpness)
        x = levelset.density(coefficients)
        value_seconds, evaluation = _best(lambda x=x: problem.value(x), 3)
        exact_seconds, exact = _best(lambda e=evaluation: problem.differentiate(e), 3)
        assert exact.gradient is not None
        g = exact.gradient["rod"]
        extend = ffr.VelocityExtension(levelset)
        g_knots = extend(levelset.pullback(coefficients, g))
        distance = levelset.distance(coefficients)
        slope = np.abs(_slope(levelset, coefficients))
        read = design & (slope > 1e-3 * slope.max())
        facts = {
            "design": name,
            "psi": evaluation.psi / solid,
            "value": value_seconds,
            "exact": exact_seconds,
            "read": float(np.count_nonzero(read) / np.count_nonzero(design)),
            "peaks": _share_of_peaks(g[design]),
        }

        def measured(
            kernel: str,
            share: float,
            seconds: float,
            gradient: NDArray[np.float64],
            estimate: float,
            g: NDArray[np.float64] = g,
            g_knots: NDArray[np.float64] = g_knots,
            coefficients: NDArray[np.float64] = coefficients,
            distance: NDArray[np.float64] = distance,
            facts: dict[str, Any] = facts,
            extend: ffr.VelocityExtension = extend,
            levelset: ffr.LevelSet = levelset,
        ) -> dict[str, Any]:
            band = design & (np.abs(distance) <= 2.0 * levelset.element)
            whole = ffr.gradient_errors(domain, gradient, g, design)
            near = ffr.gradient_errors(domain, gradient, g, band)
            knots = extend(levelset.pullback(coefficients, gradient))
            cosine = knots @ g_knots / (np.linalg.norm(knots) * np.linalg.norm(g_knots) or 1.0)
            return {
                **facts,
                "kernel": kernel,
                "share": share,
                "seconds": seconds,
                "ratio": seconds / facts["exact"],
                "error": whole.l2,
                "cosine": whole.cosine,
                "worst": whole.worst,
                "band_error": near.l2,
                "levelset_cosine": float(cosine),
                "estimate": estimate,
            }

        rows.append(measured("exact adjoint", 1.0, exact_seconds, g, 0.0))
        begin = process_time()
        whole = ffr.elementwise_gradient(problem, evaluation, design, progress=False)["rod"]
        everything = np.zeros(domain.n_cells)
        everything[whole.cells] = whole.values
        rows.append(measured("element by element", 1.0, process_time() - begin, everything, 0.0))
        for share in shares:
            chosen = ffr.GradientElements(share=share).select(domain, distance)
            begin = process_time()
            part = ffr.elementwise_gradient(problem, evaluation, chosen, progress=False)["rod"]
            known_seconds = process_time() - begin
            values = np.zeros(domain.n_cells)
            values[part.cells] = part.values
            for kernel_name, kernel in KERNELS.items():
                method = ffr.ApproximateGradient(kernel=kernel)
                begin = process_time()
                gradient, report = method.interpolate(domain, chosen, values)
                seconds = known_seconds + process_time() - begin
                rows.append(measured(kernel_name, share, seconds, gradient, report.estimate))
            progress((place + (shares.index(share) + 1) / len(shares)) / len(designs))
    return {"rows": rows, "elements": domain.n_cells_global}


def elementwise_growth(
    comm: MPI.Comm, progress: Progress, *, elements: tuple[int, int], sample: int
) -> dict[str, Any]:
    """Measure what one element costs, from two numbers of elements.

    Args:
        comm: The ranks.
        progress: Told the part that is done.
        elements: Along and across the rod.
        sample: Number of elements of the larger measurement.
    """
    problem = slider_crank(comm, elements)
    domain = problem.flexible["rod"].domain
    _warm_up(problem)
    value, evaluation = _best(lambda: problem.value(holes_design(domain)), 3)
    exact, _ = _best(lambda: problem.differentiate(evaluation), 3)
    spread = np.linspace(0, domain.n_cells - 1, sample).astype(int)
    few, _ = _best(
        lambda: ffr.elementwise_gradient(
            problem, evaluation, spread[:: sample // 8], progress=False
        ),
        2,
    )
    progress(0.5)
    many, _ = _best(
        lambda: ffr.elementwise_gradient(problem, evaluation, spread, progress=False), 2
    )
    count = len(spread[:: sample // 8])
    # on a small mesh the difference may drown in what else the machine does
    each = max(many - few, 0.0) / (sample - count)
    return {
        "elements": domain.n_cells_global,
        "value": value,
        "exact": exact,
        "fixed": max(few - count * each, 0.0),
        "each": each,
    }


def _designs(
    problem: ffr.Problem, levelset: ffr.LevelSet, start: NDArray[np.float64], iterations: int
) -> dict[str, tuple[NDArray[np.float64], float]]:
    """Coefficients and steepness of the projection at the start, middle and end."""
    evolution = ffr.Evolution(levelset, VOLUME).with_sharpness(SHARPNESS[0])
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


def _warm_up(problem: ffr.Problem) -> None:
    """Let whatever is compiled or loaded once be there."""
    evaluation = problem.gradient(np.ones(problem.flexible["rod"].domain.n_cells))
    ffr.elementwise_gradient(problem, evaluation, np.arange(2), progress=False)


def _slope(levelset: ffr.LevelSet, coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """How much each element's density changes where the whole boundary moves outwards."""
    eps = 1e-6
    ahead, behind = (levelset.density(coefficients + s * eps) for s in (1, -1))
    return (ahead - behind) / (2.0 * eps)


def _share_of_peaks(gradient: NDArray[np.float64]) -> float:
    """The share of the sum of squares that the largest hundredth of the entries holds."""
    squares = np.sort(gradient**2)[::-1]
    return float(np.sum(squares[: max(len(squares) // 100, 1)]) / np.sum(squares))


def _best(call: Any, repetitions: int) -> tuple[float, Any]:
    """The shortest time of some calls, and what the last returned."""
    times, result = [], None
    for _ in range(repetitions):
        begin = process_time()
        result = call()
        times.append(process_time() - begin)
    return min(times), result


# ---------------------------------------------------------------------- report


def report_gradient(results: list[tuple[Job, dict[str, Any]]], directory: Path) -> list[Table]:
    """Write tables and picture.

    Args:
        results: Of `gradient_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    study = next(result for job, result in results if job.function == "approximations")
    growth = [result for job, result in results if job.function == "elementwise_growth"]
    rows = [{**row, "percent": 100.0 * row["share"]} for row in study["rows"]]
    first = rows[0]
    main = Table(
        "gradient",
        "Time and error of each gradient",
        f"Slider-crank with {study['elements']:,} elements, at designs along an optimisation with "
        "the exact gradient. Processor times are those of the derivative alone, after the value "
        f"(value: {first['value']:.3g} s, value and exact gradient "
        f"{first['value'] + first['exact']:.3g} s at the start design). "
        "Errors: relative Euclidean norm over all designed elements; over "
        "those within two elements of the active boundary; estimate of the former by leaving out. "
        "Cosines: of the angle to the exact gradient with respect to the densities, and to the "
        "level set's values at the knots after smoothing, the direction in which the design moves.",
        {
            "design": "design",
            "kernel": "gradient",
            "percent": "elements [%]",
            "seconds": "time [s]",
            "ratio": "time / exact adjoint",
            "error": "error",
            "band_error": "error near boundary",
            "estimate": "estimate",
            "cosine": "cosine",
            "levelset_cosine": "cosine at knots",
        },
        rows,
    )
    designs = [row for row in rows if row["kernel"] == "exact adjoint"]
    state = Table(
        "gradient_designs",
        "The designs",
        "Elements that matter are those whose density changes by more than a thousandth of what "
        "the most sensitive one does when the boundary moves: the level set hardly reads the "
        "derivatives of the others. Peaks: share of the sum of squares of the "
        "exact gradient that the largest hundredth of the elements holds.",
        {
            "design": "design",
            "psi": "psi / full rod's",
            "percent_read": "elements that matter [%]",
            "percent_peaks": "peaks [%]",
        },
        [
            {**row, "percent_read": 100.0 * row["read"], "percent_peaks": 100.0 * row["peaks"]}
            for row in designs
        ],
    )
    costs = Table(
        "gradient_growth",
        "Growth with the number of elements",
        "Element by element: a fixed part, the factors of the modes, and a part for each element, "
        "measured on up to 512 elements. **The time for all elements is extrapolated from these** "
        "(where the table above has it measured, compare).",
        {
            "elements": "elements",
            "value": "value [s]",
            "exact": "exact adjoint [s]",
            "fixed": "fixed part [s]",
            "each_ms": "each element [ms]",
            "all": "all elements [s]",
            "ratio": "all / exact adjoint",
        },
        [
            {
                **row,
                "each_ms": 1e3 * row["each"],
                "all": row["fixed"] + row["elements"] * row["each"],
                "ratio": (row["fixed"] + row["elements"] * row["each"]) / row["exact"],
            }
            for row in growth
        ],
    )
    _draw(rows, directory / "gradient.png")
    picture = "![Time beside error of exact and approximate gradients](gradient.png)"
    write_page(
        directory, "gradient", "Exact and approximate gradients", picture, [main, state, costs]
    )
    return [main, state, costs]


def _draw(rows: list[dict[str, Any]], path: Path) -> None:
    names = list(dict.fromkeys(row["design"] for row in rows))
    floor = 1e-12
    with styled_figure(4.3 * len(names) + 0.6, 4.8) as figure:
        panels = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
        for axes, name in zip(panels, names, strict=True):
            own = [row for row in rows if row["design"] == name]
            for kernel, color in zip(KERNELS, ACCENTS, strict=False):
                line = [row for row in own if row["kernel"] == kernel]
                seconds, error = ([row[key] for row in line] for key in ("seconds", "error"))
                axes.plot(seconds, error, "o-", color=color, markersize=4, label=kernel)
            for kernel, marker, color in (
                ("exact adjoint", "*", DARK),
                ("element by element", "s", GRAY),
            ):
                row = next(row for row in own if row["kernel"] == kernel)
                axes.plot(
                    row["seconds"],
                    max(row["error"], floor),
                    marker,
                    color=color,
                    markersize=14 if marker == "*" else 8,
                    label=kernel,
                    linestyle="",
                )
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_ylim(0.3 * floor, 10.0)
            axes.set_title(f"{name} design", loc="left")
            axes.set_xlabel("processor seconds for one gradient")
            tidy(axes)
        panels[0].set_ylabel("relative error (below 1e-12: at 1e-12)")
        panels[-1].legend(loc="center right", fontsize=8)
        figure.tight_layout(w_pad=1.5)
        save(figure, path)
