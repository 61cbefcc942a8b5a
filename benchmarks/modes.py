# SPDX-License-Identifier: MIT
"""Error over number and kind of the shape functions, and the estimate of it beside the true one."""

from dataclasses import dataclass
from time import perf_counter
from typing import Any

from mpi4py import MPI

import numpy as np
from accuracy import against_reference, draw_settings
from jobs import Array, Job, Progress, Results, the
from matplotlib.ticker import MaxNLocator
from report import Study, chosen, line, plot
from scene import holes_design, slider_crank, with_rod

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import ACCENTS

#: The estimate is said to lie within this factor of the true error
FACTOR = 1.25
#: Kinds of shape functions: constraint modes that are kept of stretch and interface rotations
KINDS = {
    "stretch, rotations, normal modes": (True, True),
    "stretch, normal modes": (True, False),
    "normal modes alone": (False, False),
}
FULL = next(iter(KINDS))


def modes_jobs(*, quick: bool) -> list[Job]:
    """The measurements."""
    elements, steps = ([40, 4], 200) if quick else ([200, 20], 2000)
    settings = [0, 4, 16] if quick else [0, 1, 2, 3, 4, 6, 8, 12, 16, 24]
    number = {
        **{"elements": elements, "settings": settings, "reference": 40 if quick else 64},
        **{"repetitions": 0 if quick else 3, "steps": steps},
    }
    estimate = {
        "meshes": [[20, 3]] if quick else [[60, 6], [100, 10], [200, 20]],
        "settings": [0, 4] if quick else [0, 1, 2, 4, 6, 8, 12],
        **{"reference": 24 if quick else 60, "steps": steps},
    }
    return [
        Job("modes", "kinds", 5.0 if quick else 55.0, number),
        Job("modes", "estimates", 5.0 if quick else 45.0, estimate),
    ]


@dataclass(frozen=True)
class SomeMotions:
    """A chord frame that leaves out some of the interface motions that it could keep."""

    chord: ffr.ChordFrame
    stretch: bool  #: Keep the stretch of the chord
    rotations: bool  #: Keep the rotations of both interfaces

    def origin(self, domain: ffr.Domain) -> Array:
        """The frame's origin in the undeformed ``domain``, shape (2,) [m]."""
        return self.chord.origin(domain)

    def retained(self, domain: ffr.Domain) -> dict[str, Array]:
        """The elastic motions by interface of ``domain``."""
        rotates = {name: rows[:, 2] != 0.0 for name, rows in self.chord.retained(domain).items()}
        return {
            name: rows[np.where(rotates[name], self.rotations, self.stretch)]
            for name, rows in self.chord.retained(domain).items()
        }


def kinds(
    comm: MPI.Comm, progress: Progress, *, settings: list[int], reference: int, **how: Any
) -> dict[str, Any]:
    """Vary number and kind of the shape functions."""
    finest = slider_crank(comm, how["elements"], modes=reference, steps=how["steps"])
    chord = finest.flexible["rod"].reduction.frame
    problems: dict[Any, ffr.Problem] = {}
    for kind, (stretch, rotations) in KINDS.items():
        some = settings if kind == FULL else [n for n in settings if n == 0 or n % 4 == 0]
        for n in some:
            if stretch or n > 0:
                frame = SomeMotions(chord, stretch, rotations)
                problems[kind, n] = with_rod(finest, frame=frame, modes=n)
    exact = ("exact", reference)
    problems[exact] = finest
    measured = against_reference(
        problems, progress, reference=exact, repetitions=how["repetitions"]
    )
    for row in measured["rows"]:
        row["kind"], row["modes"] = row.pop("setting")
        row["functions"] = problems[row["kind"], row["modes"]].flexible["rod"].n_elastic
    return {**measured, "reference": reference}


def estimates(
    comm: MPI.Comm, progress: Progress, *, meshes: list[list[int]], settings: list[int], **how: int
) -> dict[str, Any]:
    """Compare the estimate of the error by the modes left out with the true one."""
    rows: list[dict[str, Any]] = []
    for turn, elements in enumerate(meshes):
        sizes = {"modes": how["reference"], "steps": how["steps"]}
        finest = slider_crank(comm, elements, **sizes)
        domain = finest.flexible["rod"].domain
        designs = _designs(domain)
        problems = {n: finest.with_modes({"rod": n}) for n in settings}
        for place, (name, x) in enumerate(designs.items()):
            exact = finest.value(x).psi
            for n, problem in problems.items():
                evaluation = problem.value(x)
                begin = perf_counter()
                estimate = ffr.model_report(problem, evaluation).modes_error
                seconds = perf_counter() - begin
                true = abs(evaluation.psi / exact - 1.0)
                row = {"mesh": f"{elements[0]}x{elements[1]}", "design": name, "modes": n}
                row |= {"error_psi": true, "estimate": estimate, "ratio": estimate / true}
                rows.append({**row, "seconds": seconds})
            progress((turn + (place + 1) / len(designs)) / len(meshes))
    return {"rows": rows, "reference": how["reference"]}


def _designs(domain: ffr.Domain) -> dict[str, Array]:
    random = np.random.default_rng(0).uniform(0.1, 1.0, domain.n_cells)
    one_sided = np.where(domain.centroids[:, 0] > 0.6 * domain.bounding_box[1, 0], 0.3, 1.0)
    strip = np.where(np.abs(domain.centroids[:, 1]) < 0.0095, 1.0, 0.0)  # of no centroid itself
    return {
        "full rod": np.ones(domain.n_cells),
        "holes": holes_design(domain),
        "random gray": np.where(domain.design_cells, random, 1.0),
        "one half gray": np.where(domain.design_cells, one_sided, 1.0),
        "strip in void": np.where(domain.design_cells, strip, 1.0),
    }


def report_modes(study: Study, results: Results) -> None:
    """Tables and picture."""
    kinds_, estimated = the("kinds", results), the("estimates", results)
    study.table("modes", **kinds_)
    study.table("modes_estimate", **estimated)
    rows, estimates = kinds_["rows"], estimated["rows"]
    caption = "Error over the number of shape functions, and its estimate"
    with study.picture(caption, 2, 2, (12.0, 8.6)) as (psi, gradient, time, estimate):
        for axes, error in ((psi, "psi"), (gradient, "gradient")):
            for kind, color, style in zip(KINDS, ACCENTS, ("o-", "s-", "^-"), strict=False):
                own = chosen(rows, kind=kind)
                line(axes, own, "functions", f"error_{error}", style, color, label=kind)
            title, x = f"Kinds of shape functions: {error}", "number of shape functions"
            options = {"scales": "y", "room": 0.35, "legend": "upper right"}
            plot(axes, title, x, f"relative error of {error}", **options)
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        full = chosen(rows, kind=FULL)
        draw_settings(time, full, "Error over time; numbers are normal modes", "{modes}")
        truth = [row["error_psi"] for row in estimates]
        ends = np.array([0.5 * min(truth), 2.0 * max(truth)])
        estimate.fill_between(ends, ends / FACTOR, ends * FACTOR, color="#e4e8ec", lw=0)
        for design, color, mark in zip(
            dict.fromkeys(row["design"] for row in estimates), ACCENTS, "osD^v", strict=False
        ):
            own = chosen(estimates, design=design)
            line(estimate, own, "error_psi", "estimate", mark, color, hollow=True, label=design)
        worst = max(max(row["ratio"], 1.0 / row["ratio"]) for row in estimates)
        title = f"Shaded: within a factor of {FACTOR:g}; worst here {worst:.3g}"
        y = "estimated relative error of psi"
        plot(estimate, title, "true relative error of psi", y, legend="upper left")
