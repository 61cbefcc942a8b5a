# SPDX-License-Identifier: MIT
"""Error over number and kind of the shape functions, and the estimate of it beside the true one."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.linalg
from accuracy import against_reference, label_point, log_log, seconds_axis
from jobs import Job, Progress
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from report import Table, write_page
from scene import holes_design, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.body import BodyMarker
from dolfinx_ffr.plotting.style import ACCENTS, BLUE, DARK, GRAY, ORANGE, save, styled_figure, tidy

__all__ = ["SomeMotions", "estimates", "free_modes", "kinds", "modes_jobs", "report_modes"]

Array = NDArray[np.float64]
Results = list[tuple[Job, dict[str, Any]]]

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
    elements = [60, 6] if quick else [200, 20]
    settings = [0, 2, 4, 8, 16] if quick else [0, 1, 2, 3, 4, 6, 8, 12, 16, 24]
    return [
        Job(
            "modes",
            "kinds",
            5.0 if quick else 55.0,
            {
                "elements": elements,
                "settings": settings,
                "reference": 40 if quick else 64,
                "repetitions": 1 if quick else 3,
                "steps": 200 if quick else 2000,
            },
        ),
        Job(
            "modes",
            "free_modes",
            2.0 if quick else 8.0,
            {
                "elements": elements,
                "settings": [1, 3, 9, 27],
                "reference": 40 if quick else 100,
                "steps": 500 if quick else 2000,
            },
        ),
        Job(
            "modes",
            "estimates",
            5.0 if quick else 45.0,
            {
                "meshes": [[40, 4]] if quick else [[60, 6], [100, 10], [200, 20]],
                "settings": [0, 4] if quick else [0, 1, 2, 4, 6, 8, 12],
                "tolerances": [1e-3] if quick else [1e-2, 1e-3, 1e-4],
                "reference": 40 if quick else 60,
                "steps": 500 if quick else 2000,
            },
        ),
    ]


# ---------------------------------------------------------------------- measurements


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
    """Vary number and kind of the shape functions.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        elements: Along and across.
        settings: Numbers of normal modes.
        reference: The number that counts as exact, of all kinds of modes.
        repetitions: Turns through all settings; the fastest of them counts.
        steps: Number of time steps.
    """
    finest = slider_crank(comm, (elements[0], elements[1]), modes=reference, steps=steps)
    rod = finest.flexible["rod"]
    problems: dict[Any, ffr.Problem] = {}
    for kind, (stretch, rotations) in KINDS.items():
        chosen = settings if kind == FULL else [n for n in settings if n == 0 or n % 4 == 0]
        for n in chosen:
            if stretch or n > 0:
                problems[kind, n] = _with_frame(
                    finest, SomeMotions(_chord(rod), stretch, rotations), n
                )
    problems["exact", reference] = finest
    measured = against_reference(problems, ("exact", reference), repetitions, progress)
    for row in measured["rows"]:
        row["kind"], row["modes"] = row.pop("setting")
        row["functions"] = problems[row["kind"], row["modes"]].flexible["rod"].n_elastic
    return {**measured, "reference": reference}


def _chord(rod: ffr.FlexibleBody) -> ffr.ChordFrame:
    frame = rod.reduction.frame
    assert isinstance(frame, ffr.ChordFrame)
    return frame


def _with_frame(problem: ffr.Problem, frame: SomeMotions, modes: int) -> ffr.Problem:
    old = problem.flexible["rod"]
    rod = ffr.FlexibleBody(
        old.domain, old.material, frame=frame, modes=modes, interpolation=old.interpolation
    )
    return ffr.Problem({"rod": rod}, problem.mechanism, problem.integrator, problem.objective)


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

    Args:
        comm: One rank.
        progress: Told the part that is done.
        elements: Along and across.
        settings: Numbers of modes.
        reference: Number of normal modes beside the constraint modes.
        steps: Number of time steps.
    """
    problem = slider_crank(comm, (elements[0], elements[1]), modes=reference, steps=steps)
    domain = problem.flexible["rod"].domain
    designs = {"full rod": np.ones(domain.n_cells), "holes": holes_design(domain)}
    motion = ffr.MechanicalProblem(problem.mechanism, problem.integrator, problem.objective)
    rows = []
    for place, (name, x) in enumerate(designs.items()):
        exact = problem.value(x)
        integrals = exact.bodies["rod"].integrals
        rows += [
            {
                "design": name,
                "modes": n,
                "error_psi": abs(
                    motion.value({"rod": modes_of_the_free_body(integrals, n)}).psi / exact.psi
                    - 1.0
                ),
            }
            for n in settings
        ]
        progress((place + 1) / len(designs))
    return {"rows": rows, "reference": reference}


def modes_of_the_free_body(integrals: ffr.VolumeIntegrals, modes: int) -> ffr.VolumeIntegrals:
    """A body whose shape functions are its elastic modes without any support.

    Args:
        integrals: Of a body whose frame holds all three rigid motions.
        modes: Number of modes, those of lowest frequency.
    """
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
    """Compare the estimate of the error by the modes left out with the true one.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        meshes: Elements along and across.
        settings: Numbers of normal modes.
        tolerances: For which a number of modes is chosen, on the last mesh.
        reference: The number that counts as exact.
        steps: Number of time steps.
    """
    rows: list[dict[str, Any]] = []
    chosen: list[dict[str, Any]] = []
    for turn, elements in enumerate(meshes):
        finest = slider_crank(comm, (elements[0], elements[1]), modes=reference, steps=steps)
        domain = finest.flexible["rod"].domain
        designs = _designs(domain)
        problems = {n: finest.with_modes({"rod": n}) for n in settings}
        for place, (name, x) in enumerate(designs.items()):
            exact = finest.value(x).psi
            for n, problem in problems.items():
                evaluation = problem.value(x)
                begin = perf_counter()
                report = ffr.model_report(problem, evaluation)
                seconds = perf_counter() - begin
                true = abs(evaluation.psi / exact - 1.0)
                rows.append(
                    {
                        "mesh": f"{elements[0]}x{elements[1]}",
                        "design": name,
                        "modes": n,
                        "error_psi": true,
                        "estimate": report.modes_error,
                        "ratio": report.modes_error / true,
                        "seconds": seconds,
                    }
                )
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
        rows.append(
            {
                "design": design,
                "tolerance": tolerance,
                "modes": selection.modes["rod"],
                "estimate": selection.error,
                "error_psi": abs(psi / exact - 1.0),
                "seconds": seconds,
            }
        )
    return rows


# ---------------------------------------------------------------------- tables and picture


def report_modes(results: Results, directory: Path) -> list[Table]:
    """Write tables and picture.

    Args:
        results: Of `modes_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    by_name = {job.function: result for job, result in results}
    kinds_, free, estimated = (by_name[name] for name in ("kinds", "free_modes", "estimates"))
    tables = [
        Table(
            "modes",
            "Number and kind of shape functions",
            f"Rod with 30 holes, {kinds_['elements']:,} bilinear quadrilaterals, chord frame. "
            "*Stretch* and *rotations* are constraint modes: the interfaces' motion along the "
            "chord and their rotations; without rotations the ends of the rod are clamped to the "
            "chord. *Value* is the time for psi alone, *gradient* that for psi and its exact "
            "gradient, the fastest of several turns through all settings; errors are relative, "
            "that of the gradient in the Euclidean norm over all elements, against all "
            f"constraint modes and {kinds_['reference']} normal modes. Where the last mode kept is "
            "close in frequency to the first one left out, the gradient feels how the two turn "
            "into each other, and its error may rise with one mode more.",
            {
                "kind": "shape functions",
                "modes": "normal modes",
                "functions": "all shape functions",
                "value": "value [s]",
                "gradient": "gradient [s]",
                "error_psi": "error of psi",
                "error_gradient": "error of gradient",
            },
            kinds_["rows"],
        ),
        Table(
            "modes_free",
            "Modes of the free rod alone",
            "Elastic modes of the rod without any support as the only shape functions, against "
            f"constraint modes and {free['reference']} normal modes.",
            {"design": "design", "modes": "modes", "error_psi": "error of psi"},
            free["rows"],
        ),
        Table(
            "modes_estimate",
            "The estimated error beside the true one",
            "What `model_report` says of the modes left out, for a rod with constraint modes, "
            f"against {estimated['reference']} normal modes. *Seconds* is the time of the whole "
            "report, the error of the time steps included.",
            {
                "mesh": "mesh",
                "design": "design",
                "modes": "normal modes",
                "error_psi": "error of psi",
                "estimate": "estimated error",
                "ratio": "estimated / true",
                "seconds": "time [s]",
            },
            estimated["rows"],
        ),
        Table(
            "modes_selected",
            "The number of modes that `select_modes` takes",
            "Chosen among 20 normal modes on the finest mesh of the table before; the true error "
            "is measured afterwards.",
            {
                "design": "design",
                "tolerance": "tolerance",
                "modes": "normal modes",
                "estimate": "estimated error",
                "error_psi": "error of psi",
                "seconds": "time [s]",
            },
            estimated["chosen"],
        ),
    ]
    _draw(by_name, directory / "modes.png")
    picture = "![Error over the number of shape functions, and its estimate](modes.png)"
    write_page(
        directory, "modes", "Shape functions: number, kind, estimated error", picture, tables
    )
    return tables


def _draw(results: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    rows = results["kinds"]["rows"]
    with styled_figure(12.0, 8.6) as figure:
        axes = figure.subplots(2, 2)
        _draw_kinds(axes[0, 0], rows, "error_psi", "relative error of psi")
        free = [r for r in results["free_modes"]["rows"] if r["design"] == "holes"]
        axes[0, 0].plot(
            [r["modes"] for r in free], [r["error_psi"] for r in free], "D-",
            color=ACCENTS[3], label=f"{FREE} alone",
        )  # fmt: skip
        axes[0, 0].set_title("Kinds of shape functions: psi")
        _draw_kinds(axes[0, 1], rows, "error_gradient", "relative error of the gradient")
        axes[0, 1].set_title("Kinds of shape functions: gradient")
        for place in axes[0]:
            low, high = place.get_ylim()
            place.set_ylim(low, high * (high / low) ** 0.35)
            place.xaxis.set_major_locator(MaxNLocator(integer=True))
            place.legend(loc="upper right")
        _draw_time(axes[1, 0], [row for row in rows if row["kind"] == FULL])
        _draw_estimates(axes[1, 1], results["estimates"]["rows"])
        figure.tight_layout(w_pad=2.5, h_pad=2.0)
        save(figure, path)


def _draw_kinds(axes: Axes, rows: Sequence[Mapping[str, Any]], error: str, label: str) -> None:
    for kind, color, style in zip(KINDS, ACCENTS, ("o-", "s-", "^-"), strict=False):
        chosen = [row for row in rows if row["kind"] == kind]
        axes.plot(
            [row["functions"] for row in chosen], [row[error] for row in chosen], style,
            color=color, label=kind,
        )  # fmt: skip
    axes.set_yscale("log")
    axes.set_xlabel("number of shape functions")
    axes.set_ylabel(label)
    tidy(axes)


def _draw_time(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    log_log(axes, "seconds", "relative error")
    for time, error, color, label in (
        ("gradient", "error_gradient", ORANGE, "gradient (time of psi and gradient)"),
        ("value", "error_psi", BLUE, "psi (time of psi alone)"),
    ):
        x, y = [row[time] for row in rows], [row[error] for row in rows]
        axes.plot(x, y, "o-", color=color, label=label)
        for row, a, b in zip(rows, x, y, strict=True):
            label_point(axes, str(row["modes"]), a, b, below=color == BLUE)
    seconds_axis(axes)
    axes.set_title("Error over time; numbers are normal modes")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.2)
    axes.legend(loc="upper right")


def _draw_estimates(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    log_log(axes, "true relative error of psi", "estimated relative error of psi")
    designs = list(dict.fromkeys(row["design"] for row in rows))
    ends = np.array([0.5, 2.0]) * [f([row["error_psi"] for row in rows]) for f in (min, max)]
    axes.fill_between(ends, ends / FACTOR, ends * FACTOR, color="#e4e8ec", lw=0, zorder=0)
    axes.plot(ends, ends, "-", color=GRAY, lw=1.0, zorder=1)
    for design, color, marker in zip(designs, ACCENTS, "osD^v", strict=False):
        chosen = [row for row in rows if row["design"] == design]
        axes.plot(
            [row["error_psi"] for row in chosen], [row["estimate"] for row in chosen], marker,
            color=color, label=design, ms=5.0, markerfacecolor="none",
        )  # fmt: skip
    worst = max(max(row["ratio"], 1.0 / row["ratio"]) for row in rows)
    axes.text(
        0.97, 0.05, f"shaded: within a factor of {FACTOR:g}\nworst here: {worst:.3g}",
        transform=axes.transAxes, ha="right", color=DARK, fontsize=9,
    )  # fmt: skip
    axes.set_title("Estimate over truth: designs, meshes, numbers of modes")
    axes.legend(loc="upper left")
