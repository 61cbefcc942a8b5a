# SPDX-License-Identifier: MIT
"""Error over the mesh: order of the displacements, kind and size of the cells; time beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

import gmsh
import numpy as np
from accuracy import log_log, seconds_axis
from jobs import Job, Progress
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray
from report import Table, write_page
from scene import block_design, block_numbers, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import ACCENTS, DARK, GRAY, save, styled_figure

__all__ = ["locking", "mesh_jobs", "refinement", "report_mesh", "smooth"]

Array = NDArray[np.float64]
Results = list[tuple[Job, dict[str, Any]]]

CELLS = ("quadrilateral", "triangle")
MESHES = ("structured", "gmsh")
ORDERS = (1, 2, 3)
#: Of the rods [m]: the reference one, a short one without corners that matter, a thin one
ROD, SHORT, THIN = (0.4, 0.04), (0.1, 0.05), (0.4, 0.004)
#: Below it a frequency shows the tolerance of the eigenvalue solver
ROUND_OFF = 1e-10


def mesh_jobs(*, quick: bool) -> list[Job]:
    """The measurements."""
    divisions = [[2, 4, 8], [2, 4], [2, 4]] if quick else [[2, 4, 8, 16], [2, 4, 8], [2, 4, 8]]
    return [
        Job(
            "mesh",
            "refinement",
            10.0 if quick else 110.0,
            {
                "blocks": [10, 1],
                "divisions": divisions,
                "finest": 8 if quick else 16,
                "steps": 200 if quick else 1000,
                "repetitions": 0 if quick else 3,
            },
        ),
        Job(
            "mesh",
            "smooth",
            3.0 if quick else 15.0,
            {"divisions": [[2, 4, 8], [2, 4, 8], [1, 2, 4]]},
        ),
        Job(
            "mesh",
            "locking",
            4.0 if quick else 20.0,
            {
                "divisions": [25, 50, 100] if quick else [25, 50, 100, 200, 400],
                "finest": 100 if quick else 400,
                "steps": 200 if quick else 1000,
                "repetitions": 0 if quick else 3,
            },
        ),
    ]


# ---------------------------------------------------------------------- meshes


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
    """A straight rod.

    Args:
        comm: One rank.
        size: Length and height [m].
        elements: Along and across; those of gmsh have about the same size.
        cell: ``"quadrilateral"`` or ``"triangle"``.
        mesh: ``"structured"`` or ``"gmsh"``, without any pattern.
        order: Of the displacements.
        blocks: Rectangles along and across whose edges the mesh follows.
    """
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


# ---------------------------------------------------------------------- measurements


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
    """Refine the slider-crank's rod of gray blocks, with cells of all kinds and orders.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        blocks: Along and across.
        divisions: For each order, elements along the side of a block.
        finest: Those of the reference, quadrilaterals of order 3; a power of two.
        steps: Number of time steps.
        repetitions: Turns through all meshes, after one that compiles; the fastest counts.
    """
    shape = (blocks[0], blocks[1])

    def problem(cell: str, mesh: str, order: int, n: int) -> ffr.Problem:
        elements = (n * shape[0], n * shape[1])
        domain = rod_domain(comm, ROD, elements, cell=cell, mesh=mesh, order=order, blocks=shape)
        return slider_crank(comm, domain=domain, steps=steps)

    cases = [
        (cell, mesh, order, n)
        for cell in CELLS
        for mesh in MESHES
        for order in ORDERS
        for n in _divisions(divisions[order - 1], cell, mesh)
    ]
    problems = {case: problem(*case) for case in cases}
    found: dict[Any, dict[str, Array]] = {}
    times: dict[Any, list[tuple[float, float]]] = {case: [] for case in cases}
    for turn in range(repetitions + 1):  # the first turn compiles
        for place, case in enumerate(cases):
            x = block_design(problems[case].flexible["rod"].domain, shape)
            begin = perf_counter()
            problems[case].value(x)
            middle = perf_counter()
            evaluation = problems[case].gradient(x)
            times[case].append((middle - begin, perf_counter() - middle))
            if turn == 0:
                found[case] = _quantities(problems[case], evaluation, shape)
            progress(0.9 * (turn + (place + 1) / len(cases)) / (repetitions + 1))
    limits = []
    for n in (finest // 4, finest // 2, finest):
        reference = problem("quadrilateral", "structured", 3, n)
        x = block_design(reference.flexible["rod"].domain, shape)
        limits.append(_quantities(reference, reference.gradient(x), shape))
    exact = {name: _limit([part[name] for part in limits]) for name in limits[0]}
    rows = []
    for case in cases:
        cell, mesh, order, n = case
        rod = problems[case].flexible["rod"]
        rows.append(
            {
                "cell": cell,
                "kind": mesh,
                "order": order,
                "size": rod.domain.cell_size,
                "elements": rod.domain.n_cells_global,
                "dofs": rod.elasticity.n_dofs_global,
                "value": min(t[0] for t in times[case][-max(repetitions, 1) :]),
                "gradient": min(t[1] for t in times[case][-max(repetitions, 1) :]),
                **{
                    f"error_{name}": float(np.linalg.norm(found[case][name] - limit))
                    / float(np.linalg.norm(limit))
                    for name, limit in exact.items()
                },
            }
        )
    uncertain = {
        name: float(np.linalg.norm(limits[-1][name] - limit) / np.linalg.norm(limit))
        for name, limit in exact.items()
    }
    return {"rows": rows, "finest": finest, "blocks": blocks, "uncertain": uncertain}


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
    assert evaluation.gradient is not None
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

    Args:
        comm: One rank.
        progress: Told the part that is done.
        divisions: For each order, elements across.
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
        rows.append(
            {
                "cell": cell,
                "kind": mesh,
                "order": order,
                "size": domain.cell_size,
                "elements": domain.n_cells_global,
                "error_frequency": abs(basis.frequencies[np.argmax(share)] / exact - 1.0),
            }
        )
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
    """Bend a thin rod, a hundred times as long as high, with one element across.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        divisions: Elements along.
        finest: Those of the reference, of order 3, with four elements across.
        steps: Number of time steps.
        repetitions: Turns through all meshes, after one that compiles; the fastest counts.
    """

    def problem(cell: str, order: int, elements: tuple[int, int]) -> ffr.Problem:
        domain = rod_domain(comm, THIN, elements, cell=cell, mesh="structured", order=order)
        return slider_crank(comm, domain=domain, steps=steps)

    cases = [(c, p, n) for c in CELLS for p in ORDERS for n in divisions if p * n <= 2 * finest]
    problems = {(c, p, n): problem(c, p, (n, 1)) for c, p, n in cases}
    times: dict[Any, list[float]] = {case: [] for case in cases}
    found = {}
    for turn in range(repetitions + 1):
        for place, case in enumerate(cases):
            x = np.ones(problems[case].flexible["rod"].domain.n_cells)
            begin = perf_counter()
            found[case] = problems[case].value(x)
            times[case].append(perf_counter() - begin)
            progress(0.9 * (turn + (place + 1) / len(cases)) / (repetitions + 1))
    reference = problem("quadrilateral", 3, (finest, 4))
    exact = reference.value(np.ones(reference.flexible["rod"].domain.n_cells))
    rows = [
        {
            "cell": cell,
            "order": order,
            "along": n,
            "aspect": THIN[0] / n / THIN[1],
            "dofs": problems[cell, order, n].flexible["rod"].elasticity.n_dofs_global,
            "value": min(times[cell, order, n][-max(repetitions, 1) :]),
            "error_frequency": abs(
                found[cell, order, n].fixed_interface_frequencies["rod"][0]
                / exact.fixed_interface_frequencies["rod"][0]
                - 1.0
            ),
            "error_psi": abs(found[cell, order, n].psi / exact.psi - 1.0),
        }
        for cell, order, n in cases
    ]
    return {"rows": rows, "finest": finest}


# ---------------------------------------------------------------------- tables


def observed_orders(
    rows: Sequence[Mapping[str, Any]], errors: Sequence[str], floor: float = 0.0
) -> list[dict[str, Any]]:
    """The slope of each error over the size of the elements, fitted for each family.

    Args:
        rows: With cell, kind, order, size and errors.
        errors: Names of the columns.
        floor: Errors below it are left out.
    """
    families = dict.fromkeys((row["cell"], row["kind"], row["order"]) for row in rows)
    found = []
    for cell, kind, order in families:
        own = [r for r in rows if (r["cell"], r["kind"], r["order"]) == (cell, kind, order)]
        slopes = {}
        for error in errors:
            chosen = [row for row in own if row[error] > floor]
            size, value = (np.log([row[key] for row in chosen]) for key in ("size", error))
            slopes[f"order_{error.removeprefix('error_')}"] = float(np.polyfit(size, value, 1)[0])
        found.append({"cell": cell, "kind": kind, "order": order, **slopes})
    return found


def report_mesh(results: Results, directory: Path) -> list[Table]:
    """Write tables and picture.

    Args:
        results: Of `mesh_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    by_name = {job.function: result for job, result in results}
    rod, short, thin = (by_name[name] for name in ("refinement", "smooth", "locking"))
    mesh = {"cell": "cells", "kind": "mesh", "order": "order p"}
    errors = ["error_psi", "error_gradient", "error_frequencies", "error_integrals"]
    tables = [
        Table(
            "mesh",
            "Cells, order and size on the reference rod",
            "A rod of gray blocks, the same on every mesh. *Value* is the time for psi alone, "
            "*gradient* that for psi and its exact gradient, the fastest of several turns through "
            "all meshes. Relative errors against Aitken's extrapolation of three structured "
            f"meshes of order 3, the finest with {rod['finest']} elements along the side of a "
            "block (it differs from its extrapolation by "
            + ", ".join(f"{value:.0e} in {name}" for name, value in rod["uncertain"].items())
            + "). The gradient is summed over each block, the norm is the Euclidean one over all "
            "blocks; frequencies are the four lowest ones, integrals those of the constraint "
            "modes.",
            {
                **mesh,
                "elements": "elements",
                "dofs": "unknowns",
                "value": "value [s]",
                "gradient": "gradient [s]",
                "error_psi": "error of psi",
                "error_gradient": "of gradient",
                "error_frequencies": "of frequencies",
                "error_integrals": "of integrals",
            },
            rod["rows"],
        ),
        Table(
            "mesh_orders",
            "Observed orders on the reference rod",
            "Slopes of these errors over the size of the elements. Corners between held ends and "
            "free edges, and corners of blocks, are singular: the order is theirs, and does not "
            "grow with p; the errors themselves do fall with it.",
            {
                **mesh,
                "order_psi": "psi",
                "order_gradient": "gradient",
                "order_frequencies": "frequencies",
                "order_integrals": "integrals",
            },
            observed_orders(rod["rows"], errors),
        ),
        Table(
            "mesh_smooth",
            "A smooth solution",
            "First longitudinal frequency of a short rod without Poisson's effect, whose mode is a "
            "sine that the held corners do not disturb, against sqrt(E / rho) / (2 L): the order "
            "is the full 2 p.",
            {
                **mesh,
                "size": "size of the elements [m]",
                "elements": "elements",
                "error_frequency": "error of the frequency",
            },
            short["rows"],
        ),
        Table(
            "mesh_smooth_orders",
            "Observed orders for a smooth solution",
            f"Slopes of these errors; those below {ROUND_OFF:g} are left out, which show the "
            "eigenvalue solver.",
            {**mesh, "order_frequency": "frequency"},
            observed_orders(short["rows"], ["error_frequency"], ROUND_OFF),
        ),
        Table(
            "mesh_locking",
            "A thin rod",
            "The slider-crank with a full rod that is a hundred times as long as high, one "
            "element across (triangles: four in each rectangle), against quadrilaterals of order "
            f"3, {thin['finest']} x 4. *Aspect* is that of the rectangles. Linear cells cannot "
            "bend without shear: they lock.",
            {
                "cell": "cells",
                "order": "order p",
                "along": "along",
                "aspect": "aspect",
                "dofs": "unknowns",
                "value": "value [s]",
                "error_frequency": "error of the first frequency",
                "error_psi": "error of psi",
            },
            thin["rows"],
        ),
    ]
    _draw(by_name, directory / "mesh.png")
    picture = "![Error over time and size for orders and cells](mesh.png)"
    write_page(directory, "mesh", "Mesh: cells, order, size", picture, tables)
    return tables


# ---------------------------------------------------------------------- picture


def _draw(results: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    rod, short, thin = (results[name]["rows"] for name in ("refinement", "smooth", "locking"))
    structured = [row for row in rod if row["kind"] == "structured"]
    unstructured = [row for row in rod if row["kind"] == "gmsh"]
    with styled_figure(14.0, 8.6) as figure:
        axes = figure.subplots(2, 3)
        for place, rows, time, error, title in (
            (axes[0, 0], structured, "value", "error_psi", "psi, structured meshes"),
            (axes[0, 1], unstructured, "value", "error_psi", "psi, meshes of gmsh"),
            (axes[0, 2], structured, "gradient", "error_gradient", "Gradient, structured meshes"),
        ):
            log_log(place, f"seconds for {time.replace('value', 'psi alone')}", "relative error")
            _draw_families(place, rows, time, error)
            seconds_axis(place)
            place.set_title(title)
        _draw_size(axes[1, 0], [row for row in structured if row["cell"] == CELLS[0]])
        _draw_smooth(axes[1, 1], short)
        _draw_locking(axes[1, 2], thin)
        _legend(axes[0, 1])
        figure.tight_layout(w_pad=2.0, h_pad=2.0)
        save(figure, path)


def _draw_families(axes: Axes, rows: Sequence[Mapping[str, Any]], across: str, error: str) -> None:
    """Draw one line for each order (colour) and cell (line)."""
    for cell, style in zip(CELLS, ("o-", "^--"), strict=True):
        for order, color in zip(ORDERS, ACCENTS, strict=False):
            own = [row for row in rows if row["cell"] == cell and row["order"] == order]
            face = color if cell == CELLS[0] else "white"
            axes.plot(
                [row[across] for row in own], [row[error] for row in own], style, color=color,
                markerfacecolor=face, ms=5.0,
            )  # fmt: skip


def _legend(axes: Axes) -> None:
    handles = [
        Line2D([], [], color=color, label=f"order {order}")
        for order, color in zip(ORDERS, ACCENTS, strict=False)
    ] + [
        Line2D([], [], color=DARK, ls=ls, marker=marker, markerfacecolor=face, label=f"{cell}s")
        for cell, ls, marker, face in zip(
            CELLS, ("-", "--"), ("o", "^"), (DARK, "white"), strict=True
        )
    ]
    axes.legend(handles=handles, loc="upper right", ncols=1)


def _draw_size(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    log_log(axes, "size of the elements [mm]", "relative error")
    for order, color in zip(ORDERS, ACCENTS, strict=False):
        own = [row for row in rows if row["order"] == order]
        for error, style in (("error_frequencies", "o-"), ("error_integrals", "D:")):
            axes.plot(
                [1e3 * row["size"] for row in own], [row[error] for row in own], style,
                color=color, ms=5.0,
            )  # fmt: skip
    handles = [
        Line2D([], [], color=DARK, ls="-", marker="o", label="frequencies"),
        Line2D([], [], color=DARK, ls=":", marker="D", label="volume integrals"),
    ]
    axes.legend(handles=handles, loc="upper left")
    _sizes_axis(axes)
    axes.set_title("Singular corners limit the order (quadrilaterals)")


def _draw_smooth(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    log_log(axes, "size of the elements [mm]", "relative error of the frequency")
    for kind, alpha in zip(MESHES, (1.0, 0.45), strict=True):
        for cell, style in zip(CELLS, ("o-", "^--"), strict=True):
            for order, color in zip(ORDERS, ACCENTS, strict=False):
                own = [
                    row
                    for row in rows
                    if (row["kind"], row["cell"], row["order"]) == (kind, cell, order)
                ]
                axes.plot(
                    [1e3 * row["size"] for row in own], [row["error_frequency"] for row in own],
                    style, color=color, alpha=alpha, ms=5.0, lw=1.2,
                    markerfacecolor=color if cell == CELLS[0] else "white",
                )  # fmt: skip
    for order in ORDERS:
        own = [r for r in rows if r["order"] == order and r["error_frequency"] > ROUND_OFF]
        size = np.array([min(r["size"] for r in own), max(r["size"] for r in own)])
        bound = max(r["error_frequency"] / r["size"] ** (2 * order) for r in own)
        axes.plot(1e3 * size, 3.0 * bound * size ** (2 * order), ":", color=GRAY, lw=1.2)
    handles = [Line2D([], [], color=GRAY, ls=":", lw=1.2, label="slopes 2, 4 and 6")]
    axes.legend(handles=handles, loc="lower right")
    _sizes_axis(axes)
    axes.set_title("Smooth solution: full order 2p (pale: gmsh)")


def _sizes_axis(axes: Axes) -> None:
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda size, _: f"{size:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _draw_locking(axes: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    log_log(axes, "elements along the rod, one across", "relative error of psi")
    _draw_families(axes, rows, "along", "error_psi")
    along = sorted({row["along"] for row in rows})
    axes.set_xticks(along, [str(n) for n in along])
    axes.minorticks_off()
    axes.set_title("A thin rod (1 : 100): linear cells lock")
