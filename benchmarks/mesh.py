# SPDX-License-Identifier: MIT
"""Error over the mesh: order of the displacements, kind and size of the cells; time beside it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import gmsh
import numpy as np
from jobs import Job, Progress, Results, measure
from matplotlib.axes import Axes
from numpy.typing import NDArray
from report import Rows, Study, Table, chosen, line, plot
from scene import block_design, block_numbers, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import ACCENTS

Array = NDArray[np.float64]

CELLS = ("quadrilateral", "triangle")
MESHES = ("structured", "gmsh")
ORDERS = (1, 2, 3)
#: Of the rods [m]: the reference one, a short one without corners that matter, a thin one
ROD, SHORT, THIN = (0.4, 0.04), (0.1, 0.05), (0.4, 0.004)
#: Below it a frequency shows the tolerance of the eigenvalue solver
ROUND_OFF = 1e-10


def mesh_jobs(*, quick: bool) -> list[Job]:
    """The measurements."""
    how = {"steps": 50 if quick else 1000, "repetitions": 0 if quick else 3}
    divisions = [[2, 4, 8], [2, 4], [2, 4]] if quick else [[2, 4, 8, 16], [2, 4, 8], [2, 4, 8]]
    rod = {"blocks": [10, 1], "divisions": divisions, "finest": 8 if quick else 16, **how}
    short = {"divisions": [[2, 4, 8], [2, 4, 8], [1, 2, 4]]}
    along = [25, 50, 100] if quick else [25, 50, 100, 200, 400]
    thin = {"divisions": along, "finest": 100 if quick else 400, **how}
    return [
        Job("mesh", "refinement", 10.0 if quick else 110.0, rod),
        Job("mesh", "smooth", 3.0 if quick else 15.0, short),
        Job("mesh", "locking", 4.0 if quick else 20.0, thin),
    ]


def rod_domain(
    comm: MPI.Comm,
    size: tuple[float, float],
    elements: tuple[int, int],
    *,
    cell: str,
    mesh: str,
    order: int,
    blocks: tuple[int, int] = (1, 1),
) -> ffr.Domain:
    """A straight rod."""
    if mesh == "structured":
        return ffr.Domain.rectangle(
            comm, *size, elements=elements, cell=cell, order=order, solid_columns=0
        )
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        _draw_blocks(size, blocks)
        # quadrilaterals come from cutting cells of twice the size
        element = size[1] / elements[1] * (2.0 if cell == "quadrilateral" else 1.0)
        gmsh.option.setNumber("Mesh.MeshSizeMin", element)
        gmsh.option.setNumber("Mesh.MeshSizeMax", element)
        if cell == "quadrilateral":
            gmsh.option.setNumber("Mesh.RecombineAll", 1)
            gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 1)
        gmsh.model.mesh.generate(2)
        return ffr.Domain.from_gmsh_model(comm, gmsh.model, order=order)
    finally:
        gmsh.finalize()


def _draw_blocks(size: tuple[float, float], blocks: tuple[int, int]) -> None:
    """Draw a rod of rectangles, with the groups that `Domain` wants."""
    (length, height), (nx, ny) = size, blocks
    occ = gmsh.model.occ
    rectangles = [
        (2, occ.addRectangle(i * length / nx, (j / ny - 0.5) * height, 0, length / nx, height / ny))
        for i in range(nx)
        for j in range(ny)
    ]
    if len(rectangles) > 1:
        occ.fragment(rectangles[:1], rectangles[1:])
    occ.synchronize()
    surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
    for name, x in (("left", 0.0), ("right", length)):
        eps = 1e-6 * length
        found = gmsh.model.getEntitiesInBoundingBox(x - eps, -height, -eps, x + eps, height, eps, 1)
        group = gmsh.model.addPhysicalGroup(1, [tag for _, tag in found])
        gmsh.model.setPhysicalName(1, group, name)
    gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, surfaces), "design")


def refinement(
    comm: MPI.Comm,
    progress: Progress,
    *,
    blocks: list[int],
    divisions: list[list[int]],
    finest: int,
    steps: int,
    repetitions: int,
) -> dict[str, Any]:
    """Refine the slider-crank's rod of gray blocks, with cells of all kinds and orders."""
    shape = (blocks[0], blocks[1])

    def problem(cell: str, mesh: str, order: int, n: int) -> tuple[ffr.Problem, Array]:
        elements = (n * shape[0], n * shape[1])
        domain = rod_domain(comm, ROD, elements, cell=cell, mesh=mesh, order=order, blocks=shape)
        return slider_crank(comm, domain=domain, steps=steps), block_design(domain, shape)

    cases = [
        (cell, mesh, order, n)
        for cell in CELLS
        for mesh in MESHES
        for order in ORDERS
        for n in _divisions(divisions[order - 1], cell, mesh)
    ]
    problems = {case: problem(*case) for case in cases}
    actions: dict[Any, Any] = {}
    for case, (scene, x) in problems.items():
        actions["value", case] = partial(scene.value, x)
        actions["gradient", case] = partial(scene.gradient, x)
    seconds, found = measure(actions, repetitions, lambda part: progress(0.9 * part))
    limits = []
    for n in (finest // 4, finest // 2, finest):
        scene, x = problem("quadrilateral", "structured", 3, n)
        limits.append(_quantities(scene, scene.gradient(x), shape))
    exact = {name: _limit([part[name] for part in limits]) for name in limits[0]}
    rows = []
    for case in cases:
        rod = problems[case][0].flexible["rod"]
        numbers = _quantities(problems[case][0], found["gradient", case], shape)
        rows.append(
            {
                **dict(zip(("cell", "kind", "order"), case, strict=False)),
                **_size_of(rod),
                "dofs": rod.elasticity.n_dofs_global,
                **{name: min(seconds[name, case]) for name in ("value", "gradient")},
                **{f"error_{k}": _away(numbers[k], limit) for k, limit in exact.items()},
            }
        )
    uncertain = {name: _away(limits[-1][name], limit) for name, limit in exact.items()}
    return {"rows": rows, "finest": finest, "blocks": blocks, "uncertain": uncertain}


def _size_of(body: ffr.FlexibleBody) -> dict[str, Any]:
    return {"size": body.domain.cell_size, "elements": body.domain.n_cells_global}


def _away(found: Array, exact: Array) -> float:
    """The relative distance of two arrays."""
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def _divisions(divisions: list[int], cell: str, mesh: str) -> list[int]:
    """Those that gmsh can do: its quadrilaterals do not get coarser than four a side."""
    if (cell, mesh) == ("quadrilateral", "gmsh"):
        return sorted({max(n, 4) for n in divisions} | {8})
    return divisions


def _quantities(
    problem: ffr.Problem, evaluation: ffr.Evaluation, blocks: tuple[int, int]
) -> dict[str, Array]:
    """What does not depend on the mesh but for its errors."""
    (name,) = problem.flexible
    reduced = evaluation.bodies[name]
    k, integrals = 1 + reduced.basis.n_constraint, reduced.integrals
    numbers = block_numbers(problem.flexible[name].domain, blocks)
    return {
        "psi": np.array([evaluation.psi]),
        "gradient": np.bincount(numbers, evaluation.gradient[name]),
        "frequencies": reduced.basis.frequencies[:4],
        "integrals": np.append(
            integrals.G[1:k, 1:k] / np.linalg.norm(integrals.G[1:k, 1:k]),
            [np.log(np.diag(integrals.K)[: k - 1]), np.log(np.diag(integrals.G)[1:k])],
        ),
    }


def _limit(values: Sequence[Array]) -> Array:
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
    cases = [(c, m, p, n) for c in CELLS for m in MESHES for p in ORDERS for n in divisions[p - 1]]
    for place, (cell, mesh, order, n) in enumerate(cases):
        across = n if mesh == "structured" else 2 * n  # gmsh has no mesh as coarse as the others
        elements = (round(across * length / height), across)
        domain = rod_domain(comm, SHORT, elements, cell=cell, mesh=mesh, order=order)
        body = ffr.FlexibleBody(
            domain, cork, frame=ffr.ChordFrame("left", "right"), modes=8, tolerance=1e-12
        )
        basis = body.reduce(np.ones(domain.n_cells)).basis
        sine = np.zeros(body.elasticity.n_dofs)
        sine[0::2] = np.sin(np.pi * body.elasticity.coordinates()[:, 0] / length)
        share = np.abs(basis.mass_times_normal.T @ sine)[: len(basis.frequencies)]
        row = {"cell": cell, "kind": mesh, "order": order, **_size_of(body)}
        row["error_frequency"] = abs(basis.frequencies[np.argmax(share)] / exact - 1.0)
        rows.append(row)
        progress((place + 1) / len(cases))
    return {"rows": rows}


def locking(
    comm: MPI.Comm,
    progress: Progress,
    *,
    divisions: list[int],
    finest: int,
    steps: int,
    repetitions: int,
) -> dict[str, Any]:
    """Bend a thin rod, a hundred times as long as high, with one element across."""

    def problem(cell: str, order: int, elements: tuple[int, int]) -> tuple[ffr.Problem, Array]:
        domain = rod_domain(comm, THIN, elements, cell=cell, mesh="structured", order=order)
        return slider_crank(comm, domain=domain, steps=steps), np.ones(domain.n_cells)

    cases = [(c, p, n) for c in CELLS for p in ORDERS for n in divisions if p * n <= 2 * finest]
    problems = {(c, p, n): problem(c, p, (n, 1)) for c, p, n in cases}
    actions = {case: partial(scene.value, x) for case, (scene, x) in problems.items()}
    seconds, found = measure(actions, repetitions, lambda part: progress(0.9 * part))
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
    families = dict.fromkeys((row["cell"], row["kind"], row["order"]) for row in rows)
    found = []
    for cell, kind, order in families:
        family = {"cell": cell, "kind": kind, "order": order}
        slopes = {}
        for error in errors:
            own = [row for row in chosen(rows, **family) if row[error] > floor]
            size, value = (np.log([row[key] for row in own]) for key in ("size", error))
            slopes[f"order_{error.removeprefix('error_')}"] = float(np.polyfit(size, value, 1)[0])
        found.append({**family, **slopes})
    return found


def report_mesh(results: Results, directory: Path) -> list[Table]:
    """Tables and picture."""
    study = Study(directory, "mesh")
    by_name = {job.function: result for job, result in results}
    rod, short, thin = (by_name[name] for name in ("refinement", "smooth", "locking"))
    errors = ["error_psi", "error_gradient", "error_frequencies", "error_integrals"]
    away = ", ".join(f"{value:.0e} in {name}" for name, value in rod["uncertain"].items())
    study.table("mesh", rod["rows"], finest=rod["finest"], uncertain=away)
    study.table("mesh_orders", observed_orders(rod["rows"], errors))
    study.table("mesh_smooth", short["rows"])
    smooth_orders = observed_orders(short["rows"], ["error_frequency"], ROUND_OFF)
    study.table("mesh_smooth_orders", smooth_orders, least=ROUND_OFF)
    study.table("mesh_locking", **thin)
    for row in (*rod["rows"], *short["rows"]):
        row["mm"] = 1e3 * row["size"]
    structured, unstructured = (chosen(rod["rows"], kind=kind) for kind in MESHES)
    caption = "Error over time and size for orders and cells"
    with study.picture(caption, 2, 3, (14.0, 8.6)) as panels:
        psi, other, gradient, size, smooth_axes, thin_axes = panels
        for axes, rows, x, name, title in (
            (psi, structured, "value", "psi", "psi, structured meshes"),
            (other, unstructured, "value", "psi", "psi, meshes of gmsh"),
            (gradient, structured, "gradient", "gradient", "Gradient, structured meshes"),
            (thin_axes, thin["rows"], "along", "psi", "A thin rod (1 : 100): linear cells lock"),
        ):
            _draw_families(axes, rows, x, f"error_{name}")
            what = "elements along the rod, one across" if x == "along" else f"seconds for {name}"
            plot(axes, title, what, "relative error")
        for name, style in (("frequencies", "-"), ("integrals", ":")):
            own = chosen(structured, cell=CELLS[0])
            _draw_families(size, own, "mm", f"error_{name}", style, f"{name}, ")
        title, x = "Singular corners limit the order (quadrilaterals)", "size of the elements [mm]"
        plot(size, title, x, "relative error", room=0.6, legend="upper left")
        for kind, alpha in zip(MESHES, (1.0, 0.45), strict=True):
            own = chosen(short["rows"], kind=kind)
            _draw_families(smooth_axes, own, "mm", "error_frequency", alpha=alpha)
        title = "Smooth solution: full order 2p (pale: gmsh)"
        plot(smooth_axes, title, x, "relative error of the frequency")
        other.legend(loc="upper right")
    return study.write()


def _draw_families(
    axes: Axes, rows: Rows, x: str, error: str, style: str = "", text: str = "", **more: Any
) -> None:
    """Draw one line for each order (colour) and cell (line)."""
    for cell, own_style in zip(CELLS, ("o-", "^--"), strict=True):
        for order, color in zip(ORDERS, ACCENTS, strict=False):
            own = chosen(rows, cell=cell, order=order)
            label = f"{text}{cell}s, order {order}" if own else None
            options = {"hollow": cell != CELLS[0], "label": label, **more}
            line(axes, own, x, error, own_style[0] + (style or own_style[1:]), color, **options)
