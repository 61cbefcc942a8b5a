# SPDX-License-Identifier: MIT
"""Error over number and kind of the shape functions, and the estimate of it beside the true one."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.linalg
from accuracy import against_reference, draw_settings
from jobs import Job, Progress, Results
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from report import Study, Table, chosen, line, plot
from scene import holes_design, slider_crank, with_rod

import dolfinx_ffr as ffr
from dolfinx_ffr.body import BodyMarker
from dolfinx_ffr.plotting.style import ACCENTS

Array = NDArray[np.float64]

#: The estimate is said to lie within this factor of the true error
FACTOR = 1.25
#: Kinds of shape functions: constraint modes that are kept of stretch and interface rotations
KINDS = {
    "stretch, rotations, normal modes": (True, True),
    "stretch, normal modes": (True, False),
    "normal modes alone": (False, False),
}
FULL = next(iter(KINDS))
FREE = "modes of the free rod"


def modes_jobs(*, quick: bool) -> list[Job]:
    """The measurements."""
    elements, steps = ([40, 4], 200) if quick else ([200, 20], 2000)
    settings = [0, 2, 4, 8, 16] if quick else [0, 1, 2, 3, 4, 6, 8, 12, 16, 24]
    number = {
        **{"elements": elements, "settings": settings, "reference": 40 if quick else 64},
        **{"repetitions": 0 if quick else 3, "steps": steps},
    }
    free = {"elements": elements, "settings": [1, 3, 9, 27], "steps": steps}
    free["reference"] = 40 if quick else 100
    estimate = {
        "meshes": [[20, 2]] if quick else [[60, 6], [100, 10], [200, 20]],
        "settings": [0, 4] if quick else [0, 1, 2, 4, 6, 8, 12],
        "tolerances": [1e-3] if quick else [1e-2, 1e-3, 1e-4],
        **{"reference": 24 if quick else 60, "steps": steps},
    }
    return [
        Job("modes", "kinds", 5.0 if quick else 55.0, number),
        Job("modes", "free_modes", 2.0 if quick else 8.0, free),
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
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: list[int],
    settings: list[int],
    reference: int,
    repetitions: int,
    steps: int,
) -> dict[str, Any]:
    """Vary number and kind of the shape functions."""
    finest = slider_crank(comm, elements, modes=reference, steps=steps)
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
    measured = against_reference(problems, progress, reference=exact, repetitions=repetitions)
    for row in measured["rows"]:
        row["kind"], row["modes"] = row.pop("setting")
        row["functions"] = problems[row["kind"], row["modes"]].flexible["rod"].n_elastic
    return {**measured, "reference": reference}


def free_modes(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: list[int],
    settings: list[int],
    reference: int,
    steps: int,
) -> dict[str, Any]:
    """Take modes of the free rod as shape functions, without any constraint mode.

    They are combinations of constraint modes and many normal modes, which all together count as
    exact, for the full rod and the one with holes.
    """
    problem = slider_crank(comm, elements, modes=reference, steps=steps)
    domain = problem.flexible["rod"].domain
    designs = {"full rod": np.ones(domain.n_cells), "holes": holes_design(domain)}
    motion = ffr.MechanicalProblem(problem.mechanism, problem.integrator, problem.objective)
    rows = []
    for place, (name, x) in enumerate(designs.items()):
        exact = problem.value(x)
        for n in settings:
            free = modes_of_the_free_body(exact.bodies["rod"].integrals, n)
            error = abs(motion.value({"rod": free}).psi / exact.psi - 1.0)
            rows.append({"design": name, "modes": n, "error_psi": error})
        progress((place + 1) / len(designs))
    return {"rows": rows, "reference": reference}


def modes_of_the_free_body(integrals: ffr.VolumeIntegrals, modes: int) -> ffr.VolumeIntegrals:
    """A body whose shape functions are its elastic modes without any support."""
    mass = integrals.mass_matrix()
    # the rigid motions follow, so that momentum and angular momentum are zero
    free = mass[3:, 3:] - mass[3:, :3] @ np.linalg.solve(mass[:3, :3], mass[:3, 3:])
    vectors = scipy.linalg.eigh(integrals.K, free)[1][:, :modes]
    whole = scipy.linalg.block_diag(1.0, vectors)
    return replace(
        integrals,
        S=whole.T @ integrals.S,
        G=whole.T @ integrals.G @ whole,
        N=whole.T @ integrals.N @ whole,
        K=vectors.T @ integrals.K @ vectors,
        markers={
            name: BodyMarker(m.position, m.displacement @ vectors, m.rotation @ vectors)
            for name, m in integrals.markers.items()
        },
    )


def estimates(
    comm: MPI.Comm,
    progress: Progress,
    *,
    meshes: list[list[int]],
    settings: list[int],
    tolerances: list[float],
    reference: int,
    steps: int,
) -> dict[str, Any]:
    """Compare the estimate of the error by the modes left out with the true one."""
    rows: list[dict[str, Any]] = []
    chosen: list[dict[str, Any]] = []
    for turn, elements in enumerate(meshes):
        finest = slider_crank(comm, elements, modes=reference, steps=steps)
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
            if turn == len(meshes) - 1:
                choice = finest.with_modes({"rod": 20})
                chosen += _selections(choice, x, name, exact, tolerances)
    return {"rows": rows, "chosen": chosen, "reference": reference}


def _designs(domain: ffr.Domain) -> dict[str, Array]:
    random = np.random.default_rng(0).uniform(0.1, 1.0, domain.n_cells)
    one_sided = np.where(domain.centroids[:, 0] > 0.6 * domain.bounding_box[1, 0], 0.3, 1.0)
    strip = np.where(np.abs(domain.centroids[:, 1]) < 0.01, 1.0, 0.0)
    return {
        "full rod": np.ones(domain.n_cells),
        "holes": holes_design(domain),
        "random gray": np.where(domain.design_cells, random, 1.0),
        "one half gray": np.where(domain.design_cells, one_sided, 1.0),
        "strip in void": np.where(domain.design_cells, strip, 1.0),
    }


def _selections(
    problem: ffr.Problem, x: Array, design: str, exact: float, tolerances: list[float]
) -> list[dict[str, Any]]:
    rows = []
    for tolerance in tolerances:
        begin = perf_counter()
        with warnings.catch_warnings():  # all modes may end in a cluster: no gradient is asked for
            warnings.simplefilter("ignore", UserWarning)
            selection = ffr.select_modes(problem, x, tolerance=tolerance)
        seconds = perf_counter() - begin
        psi = problem.with_modes(selection.modes).value(x).psi
        row = {"design": design, "tolerance": tolerance, "modes": selection.modes["rod"]}
        row |= {"estimate": selection.error, "error_psi": abs(psi / exact - 1.0)}
        rows.append({**row, "seconds": seconds})
    return rows


def report_modes(results: Results, directory: Path) -> list[Table]:
    """Tables and picture."""
    study = Study(directory, "modes")
    by_name = {job.function: result for job, result in results}
    kinds_, free, estimated = (by_name[name] for name in ("kinds", "free_modes", "estimates"))
    study.table("modes", **kinds_)
    study.table("modes_free", **free)
    study.table("modes_estimate", **estimated)
    study.table("modes_selected", estimated["chosen"])
    rows, estimates = kinds_["rows"], estimated["rows"]
    caption = "Error over the number of shape functions, and its estimate"
    with study.picture(caption, 2, 2, (12.0, 8.6)) as (psi, gradient, time, estimate):
        for axes, error in ((psi, "psi"), (gradient, "gradient")):
            for kind, color, style in zip(KINDS, ACCENTS, ("o-", "s-", "^-"), strict=False):
                own = chosen(rows, kind=kind)
                line(axes, own, "functions", f"error_{error}", style, color, label=kind)
        holes = chosen(free["rows"], design="holes")
        line(psi, holes, "modes", "error_psi", "D-", ACCENTS[3], label=f"{FREE} alone")
        for axes, error in ((psi, "psi"), (gradient, "gradient")):
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
    return study.write()
