# SPDX-License-Identifier: MIT
"""Error over the mesh: order of the displacements, kind and size of the cells; time beside it."""

from collections.abc import Sequence
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Array, Job, Progress, Results, measure, the
from report import Rows, Study, chosen, line, plot
from scene import block_design, block_numbers, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import ACCENTS

CELLS = ("quadrilateral", "triangle")
ORDERS = (1, 2, 3)
#: Of the rods [m]: the reference one, a short one without corners that matter, a thin one
ROD, SHORT, THIN = (0.4, 0.04), (0.1, 0.05), (0.4, 0.004)
#: Of constant density, along and across the reference rod
BLOCKS = (10, 1)
#: Below it a frequency shows the tolerance of the eigenvalue solver
ROUND_OFF = 1e-10


def mesh_jobs(*, quick: bool) -> list[Job]:
    """The measurements."""
    how = {"steps": 50 if quick else 1000, "repetitions": 0 if quick else 3}
    divisions = [[2, 4]] * 3 if quick else [[2, 4, 8, 16], [2, 4, 8], [2, 4, 8]]
    rod = {"divisions": divisions, "finest": 8 if quick else 16, **how}
    short = {"divisions": [[2, 4, 8], [2, 4, 8], [1, 2, 4]]}
    along = [25, 50] if quick else [25, 50, 100, 200, 400]
    thin = {"divisions": along, "finest": 50 if quick else 400, **how}
    return [
        Job("mesh", "refinement", 10.0 if quick else 110.0, rod),
        Job("mesh", "smooth", 3.0 if quick else 15.0, short),
        Job("mesh", "locking", 4.0 if quick else 20.0, thin),
    ]


def rod_domain(
    comm: MPI.Comm, size: tuple[float, float], elements: tuple[int, int], *, cell: str, order: int
) -> ffr.Domain:
    """A straight rod without solid columns."""
    how = {"elements": elements, "cell": cell, "order": order, "solid_columns": 0}
    return ffr.Domain.rectangle(comm, *size, **how)


def refinement(
    comm: MPI.Comm, progress: Progress, *, divisions: list[list[int]], finest: int, **how: int
) -> dict[str, Any]:
    """Refine the slider-crank's rod of gray blocks, with cells of all kinds and orders."""

    def problem(cell: str, order: int, n: int) -> tuple[ffr.Problem, Array]:
        elements = (n * BLOCKS[0], n * BLOCKS[1])
        domain = rod_domain(comm, ROD, elements, cell=cell, order=order)
        return slider_crank(comm, domain=domain, steps=how["steps"]), block_design(domain, BLOCKS)

    def quantities(case: ffr.Problem, found: ffr.Evaluation) -> dict[str, Array]:
        numbers = block_numbers(case.flexible["rod"].domain, BLOCKS)
        gradient = np.bincount(numbers, found.gradient["rod"])
        return {"psi": np.array([found.psi]), "gradient": gradient}

    cases = [(cell, order, n) for cell in CELLS for order in ORDERS for n in divisions[order - 1]]
    problems = {case: problem(*case) for case in cases}
    actions: dict[Any, Any] = {}
    for case, (scene, x) in problems.items():
        actions["value", case] = partial(scene.value, x)
        actions["gradient", case] = partial(scene.gradient, x)
    seconds, found = measure(actions, how["repetitions"], lambda part: progress(0.9 * part))
    limits = []
    for n in (finest // 4, finest // 2, finest):
        scene, x = problem("quadrilateral", 3, n)
        limits.append(quantities(scene, scene.gradient(x)))
    exact = {name: _limit([part[name] for part in limits]) for name in limits[0]}
    rows = []
    for case in cases:
        rod = problems[case][0].flexible["rod"]
        numbers = quantities(problems[case][0], found["gradient", case])
        row = {"cell": case[0], "order": case[1], **_size_of(rod)}
        row |= {"dofs": rod.elasticity.n_dofs_global}
        row |= {name: min(seconds[name, case]) for name in ("value", "gradient")}
        rows.append(row | {f"error_{k}": _away(numbers[k], exact[k]) for k in exact})
    uncertain = {name: _away(limits[-1][name], limit) for name, limit in exact.items()}
    return {"rows": rows, "finest": finest, "uncertain": uncertain}


def _size_of(body: ffr.FlexibleBody) -> dict[str, Any]:
    return {"size": body.domain.cell_size, "elements": body.domain.n_cells_global}


def _away(found: Array, exact: Array) -> float:
    """The relative distance of two arrays."""
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def _limit(values: list[Array]) -> Array:
    """The limit of three meshes, each twice as fine as the one before (Aitken).

    Singular corners limit the order, so that it is not known beforehand.
    """
    coarse, middle, fine = values
    ratio = float(np.linalg.norm(middle - coarse) / np.linalg.norm(fine - middle))
    return fine + (fine - middle) / (ratio - 1.0)


def smooth(comm: MPI.Comm, progress: Progress, *, divisions: list[list[int]]) -> dict[str, Any]:
    """Refine a short rod without Poisson's effect, whose first longitudinal mode is a sine.

    Its frequency is sqrt(E / rho) / (2 L), and the held corners do not disturb it.
    """
    length, height = SHORT
    cork = ffr.PlaneStress(young=210e9, poisson=0.0, density=7850.0, thickness=0.01)
    exact = np.sqrt(cork.young / cork.density) / (2.0 * length)
    rows = []
    cases = [(c, p, n) for c in CELLS for p in ORDERS for n in divisions[p - 1]]
    chord = {"frame": ffr.ChordFrame("left", "right"), "modes": 8, "tolerance": 1e-12}
    for place, (cell, order, n) in enumerate(cases):
        elements = (round(n * length / height), n)
        domain = rod_domain(comm, SHORT, elements, cell=cell, order=order)
        body = ffr.FlexibleBody(domain, cork, **chord)
        basis = body.reduce(np.ones(domain.n_cells)).basis
        sine = np.zeros(body.elasticity.n_dofs)
        sine[0::2] = np.sin(np.pi * body.elasticity.coordinates()[:, 0] / length)
        share = np.abs(basis.mass_times_normal.T @ sine)[: len(basis.frequencies)]
        row = {"cell": cell, "order": order, **_size_of(body)}
        row["error_frequency"] = abs(basis.frequencies[np.argmax(share)] / exact - 1.0)
        rows.append(row)
        progress((place + 1) / len(cases))
    return {"rows": rows}


def locking(
    comm: MPI.Comm, progress: Progress, *, divisions: list[int], finest: int, **how: int
) -> dict[str, Any]:
    """Bend a thin rod, a hundred times as long as high, with one element across."""

    def problem(cell: str, order: int, elements: tuple[int, int]) -> tuple[ffr.Problem, Array]:
        domain = rod_domain(comm, THIN, elements, cell=cell, order=order)
        return slider_crank(comm, domain=domain, steps=how["steps"]), np.ones(domain.n_cells)

    cases = [(c, p, n) for c in CELLS for p in ORDERS for n in divisions if p * n <= 2 * finest]
    problems = {(c, p, n): problem(c, p, (n, 1)) for c, p, n in cases}
    actions = {case: partial(scene.value, x) for case, (scene, x) in problems.items()}
    seconds, found = measure(actions, how["repetitions"], lambda part: progress(0.9 * part))
    reference, x = problem("quadrilateral", 3, (finest, 4))
    exact = reference.value(x)

    def frequency(evaluation: ffr.Evaluation) -> float:
        return float(evaluation.fixed_interface_frequencies["rod"][0])

    rows = [
        {
            **{"cell": case[0], "order": case[1], "along": case[2]},
            "aspect": THIN[0] / case[2] / THIN[1],
            "dofs": problems[case][0].flexible["rod"].elasticity.n_dofs_global,
            "value": min(seconds[case]),
            "error_frequency": abs(frequency(found[case]) / frequency(exact) - 1.0),
            "error_psi": abs(found[case].psi / exact.psi - 1.0),
        }
        for case in cases
    ]
    return {"rows": rows, "finest": finest}


def observed_orders(rows: Rows, errors: Sequence[str], floor: float = 0.0) -> list[dict[str, Any]]:
    """The slope of each error over the size of the elements, fitted for each family."""
    found = []
    for cell, order in dict.fromkeys((row["cell"], row["order"]) for row in rows):
        family = {"cell": cell, "order": order}
        slopes = {}
        for error in errors:
            own = [row for row in chosen(rows, **family) if row[error] > floor]
            size, value = (np.log([row[key] for row in own]) for key in ("size", error))
            slopes[f"order_{error.removeprefix('error_')}"] = float(np.polyfit(size, value, 1)[0])
        found.append({**family, **slopes})
    return found


def report_mesh(study: Study, results: Results) -> None:
    """Tables and picture."""
    rod, short, thin = (the(name, results) for name in ("refinement", "smooth", "locking"))
    away = ", ".join(f"{value:.0e} in {name}" for name, value in rod["uncertain"].items())
    study.table("mesh", rod["rows"], finest=rod["finest"], uncertain=away)
    study.table("mesh_orders", observed_orders(rod["rows"], ["error_psi", "error_gradient"]))
    study.table("mesh_smooth", short["rows"])
    smooth_orders = observed_orders(short["rows"], ["error_frequency"], ROUND_OFF)
    study.table("mesh_smooth_orders", smooth_orders, least=ROUND_OFF)
    study.table("mesh_locking", **thin)
    for row in (*rod["rows"], *short["rows"]):
        row["mm"] = 1e3 * row["size"]
    caption = "Error over time and size for orders and cells"
    with study.picture(caption, 2, 2, (10.0, 8.6)) as (psi, gradient, smooth_axes, thin_axes):
        for axes, rows, x, name, title in (
            (psi, rod["rows"], "value", "psi", "psi"),
            (gradient, rod["rows"], "gradient", "gradient", "Gradient"),
            (smooth_axes, short["rows"], "mm", "frequency", "Smooth solution: full order 2p"),
            (thin_axes, thin["rows"], "along", "psi", "A thin rod (1 : 100): linear cells lock"),
        ):
            for cell, style in zip(CELLS, ("o-", "^--"), strict=True):
                for order, color in zip(ORDERS, ACCENTS, strict=False):
                    own = chosen(rows, cell=cell, order=order)
                    options = {"hollow": cell != CELLS[0], "label": f"{cell}s, order {order}"}
                    line(axes, own, x, f"error_{name}", style, color, **options)
            names = {"along": "elements along the rod, one across"}
            names |= {"mm": "size of the elements [mm]"}
            plot(axes, title, names.get(x, f"seconds for {name}"), "relative error")
        psi.legend(loc="upper right")
