# SPDX-License-Identifier: MIT
"""Finished designs and the parts that they enclose: starts, methods, scenes and meshes.

Each design is one call of `optimize` with its defaults; nothing is tuned from row to row. psi is
told by the densities and by a mesh that fits the part's boundary, both with as many modes as the
design needs and with the eight of the scene.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress
from matplotlib.axes import Axes
from numpy.typing import NDArray
from PIL import Image
from report import Table, write_page
from scene import demo, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.fem import polygon
from dolfinx_ffr.plotting.style import BLUE, GRAY, save, styled_figure

__all__ = [
    "EXPONENTS",
    "cut_elements",
    "design",
    "designs_jobs",
    "draw_parts",
    "report_designs",
    "rings",
    "shares",
]

Array = NDArray[np.float64]
Results = list[tuple[Job, dict[str, Any]]]

VOLUME = 0.5
#: Start designs: two without holes, regular and single holes, bars, and noise
STARTS = "even,full,one hole,6x2,6x3,10x3,12x2,16x2,strip,flanges,random 1,random 2,random 3".split(
    ","
)
#: Ways from the even density to a design
METHODS = ["level set, moving asymptotes", "level set, explicit steps", "densities"]
#: The same procedure elsewhere; meshes of the reference scene at one minimum size
SCENES = ["120x12", "200x20", "300x30", "triangles", "connecting rod", "four-bar"]
#: Thinnest member asked for on all meshes of the reference scene [m]: what the coarsest resolves
MEMBER = 0.0027
#: Exponents that are tried for cut elements
EXPONENTS = [1.0, 1.25, 1.5, 1.75, 2.0, 3.0]
#: In the plane that of linear quadrilaterals too
IN_PLANE = sorted([*EXPONENTS, 1.35])
#: Elements on which they are tried: cell and order
ELEMENTS = [("quadrilateral", 1), ("quadrilateral", 2), ("triangle", 1), ("triangle", 2)]


def designs_jobs(*, quick: bool) -> list[Job]:
    """The measurements."""
    common = {"iterations": 8, "steps": 200} if quick else {"iterations": 60, "steps": 2000}
    elements = [40, 4] if quick else [200, 20]
    seconds = 6.0 if quick else 60.0
    starts = STARTS[:2] if quick else STARTS
    methods = METHODS[:1] if quick else METHODS
    scenes = [] if quick else SCENES
    jobs = [
        Job("designs", "design", seconds, {**common, "start": start, "elements": elements})
        for start in starts
    ]
    jobs += [
        Job("designs", "design", seconds, {**common, "method": method, "elements": elements})
        for method in methods[1:]
    ]
    jobs += [Job("designs", "design", 2.0 * seconds, {**common, "scene": name}) for name in scenes]
    jobs += [Job("designs", "cut_elements", 2.0 * seconds, {**common, "elements": elements})]
    return jobs


@dataclass
class _Counting:
    """The exact gradient, counted."""

    exact = True
    calls: int = field(default=0, compare=False)

    def __call__(self, *arguments: Any) -> Any:
        self.calls += 1
        return ffr.ExactAdjoint()(*arguments)


def _problem(scene: str, elements: tuple[int, int], steps: int) -> ffr.Problem:
    """The scene by its name."""
    comm = MPI.COMM_SELF
    if scene == "four-bar":
        linkage = demo("four_bar")
        problem: ffr.Problem = linkage.four_bar(comm, steps=steps // 2)
        full = problem.value({n: np.ones(b.domain.n_cells) for n, b in problem.flexible.items()})
        weights = {name: 1.0 / psi for name, psi in linkage.compliances(full).items()}
        return linkage.four_bar(
            comm, steps=steps // 2, objective=ffr.IntegralCompliance(list(weights), weights)
        )
    if scene == "connecting rod":
        return slider_crank(
            comm, domain=demo("connecting_rod").ROD.domain(comm, 0.002), steps=steps
        )
    if scene == "triangles":
        problem = slider_crank(comm, elements, steps=steps)
        low, high = problem.flexible["rod"].domain.bounding_box
        rod = ffr.Domain.rectangle(comm, *(high - low), elements=elements, cell="triangle")
        return slider_crank(comm, domain=rod, steps=steps)
    if "x" in scene:
        elements = tuple(int(n) for n in scene.split("x"))  # type: ignore[assignment]
    return slider_crank(comm, elements, steps=steps)


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
    start: str = "even",
    method: str = METHODS[0],
    scene: str = "reference",
    elements: tuple[int, int] = (200, 20),
) -> dict[str, Any]:
    """One design from nothing to a verified part.

    Args:
        comm: Ignored: one rank.
        progress: Told the share that is done.
        iterations: Of the design.
        steps: Of the motion.
        start: Name of the start.
        method: Name of the method.
        scene: Name of the scene.
        elements: Of the reference scene.
    """
    began = process_time()
    problem = _problem(scene, tuple(elements), steps)  # type: ignore[arg-type]
    bodies = problem.flexible
    even = {name: np.full(body.domain.n_cells, 0.5) for name, body in bodies.items()}
    full = {name: np.ones(body.domain.n_cells) for name, body in bodies.items()}
    gradient = problem.gradient(_for(even)).gradient
    assert gradient is not None
    designs: dict[str, ffr.Design] = {}
    for name, body in bodies.items():
        if method == METHODS[2]:
            designs[name] = ffr.DensityDesign(body.domain)
            continue
        mirrors = ffr.mirror_lines(body.domain, gradient[name])
        member = MEMBER if scene in SCENES[:4] else None
        designs[name] = ffr.LevelSet(body.domain, mirrors=mirrors, minimum_member=member)
    explicit = method == METHODS[1]
    starts = {
        name: part.with_holes(10, 3, 0.008, margin=0.01)
        if explicit and isinstance(part, ffr.LevelSet)
        else _start(part, start)
        if isinstance(part, ffr.LevelSet)
        else part.even(VOLUME)
        for name, part in designs.items()
    }
    counting = _Counting()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        result = ffr.optimize(
            problem,
            designs,
            starts,
            optimizer=ffr.LevelSetEvolution() if explicit else ffr.MMA(),
            volume=VOLUME,
            gradient=counting,
            iterations=100 if explicit and iterations >= 60 else iterations,
            progress=False,
            callback=lambda i, *_: progress(0.8 * i / iterations),
        )
        seconds_design = process_time() - began
        try:
            told = _told(problem, result, full)
        except (ValueError, ffr.SimulationError) as error:
            told = {"part": float("nan"), "why": str(error).splitlines()[0]}
    return {
        "start": start,
        "method": method,
        "scene": scene,
        "elements": sum(body.domain.n_cells_global for body in bodies.values()),
        "gradients": counting.calls,
        "rejected": int(np.sum(result.history["accepted"] == 0)),
        "seconds_design": seconds_design,
        "seconds": process_time() - began,
        "volume": max(result.evaluation.volume.values()),
        "asymmetry": max(_asymmetry(result, name) for name in designs),
        "warnings": sorted({str(w.message).splitlines()[0] for w in said}),
        **told,
    }


def _told(problem: ffr.Problem, result: ffr.Result, full: Mapping[str, Array]) -> dict[str, Any]:
    """What the densities and the parts say."""
    x = _for(result.densities)
    parts = {
        name: ffr.Part.of(part, result.variables[name], material=problem.flexible[name].material)
        for name, part in result.designs.items()
    }
    enough = ffr.verify(result.problem, parts, result.evaluation)
    eight = problem.with_bodies(
        {
            name: result.problem.flexible[name].with_modes(body.modes)
            for name, body in problem.flexible.items()
        }
    )
    value = eight.value(x)
    fitted = ffr.verify(eight, parts, value)
    solid, solid_eight = result.problem.value(_for(full)).psi, eight.value(_for(full)).psi
    thin = [part.thinnest_member for part in parts.values()]
    gaps = [part.narrowest_gap for part in parts.values()]
    return {
        "told": result.psi / solid,
        "part": enough.psi / solid,
        "difference": enough.difference,
        "told_eight": value.psi / solid_eight,
        "part_eight": fitted.psi / solid_eight,
        "modes": max(body.modes for body in result.problem.flexible.values()),
        "mode_error": max(result.mode_errors.values(), default=float("nan")),
        "pieces": max(part.pieces for part in parts.values()),
        "loose": sum(len(part.loose) for part in parts.values()),
        "thinnest": min((1e3 * width.value for width in thin if width), default=float("nan")),
        "gap": min((1e3 * width.value for width in gaps if width), default=float("nan")),
        "asked": min(
            (
                1e3 * d.minimum_member
                for d in result.designs.values()
                if isinstance(d, ffr.LevelSet)
            ),
            default=float("nan"),
        ),
        "rings": rings(parts),
    }


def rings(parts: Mapping[str, ffr.Part]) -> dict[str, list[list[Any]]]:
    """Corners of the boundaries of parts, by name, piece and loop, the outer loop first.

    Args:
        parts: By name of the body.
    """
    return {
        name: [
            [polygon(loop, part.accuracy).round(6).tolist() for loop in loops]
            for loops in part.outlines
        ]
        for name, part in parts.items()
    }


def _for(by_name: Mapping[str, Array]) -> Any:
    """Densities as a problem takes them."""
    return dict(by_name) if len(by_name) > 1 else next(iter(by_name.values()))


def _asymmetry(result: ffr.Result, name: str) -> float:
    """The largest difference of the field from its mirror image; NaN without mirror lines."""
    part = result.designs[name]
    if not isinstance(part, ffr.LevelSet) or not part.mirrors:
        return float("nan")
    level = part.level(result.variables[name])
    points = part.domain.centroids
    return float(np.max(np.abs(level(points) - level(part.mirrors[0].reflection(points)))))


def cut_elements(
    comm: MPI.Comm,
    progress: Progress,
    *,
    iterations: int,
    steps: int,
    elements: tuple[int, int],
) -> dict[str, Any]:
    """Psi of one boundary by shares of cut elements, for exponents and kinds of elements.

    Truss-like boundaries, and that of a design, are laid over all meshes; each part is meshed to
    fit once.

    Args:
        comm: Ignored: one rank.
        progress: Told the share that is done.
        iterations: Of the design.
        steps: Of the motion.
        elements: Of the meshes.
    """
    rows, fine = [], 0.0
    reference = slider_crank(MPI.COMM_SELF, tuple(elements), steps=steps)
    levelset = ffr.LevelSet(reference.flexible["rod"].domain)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = ffr.optimize(
            reference, levelset, volume=VOLUME, iterations=iterations, progress=False
        )
    shapes = {**SHAPES, "design": levelset.level(result.coefficients)}
    for k, (cell, order) in enumerate(ELEMENTS):
        progress(k / len(ELEMENTS))
        rod = ffr.Domain.rectangle(
            MPI.COMM_SELF, 0.4, 0.04, elements=tuple(elements), cell=cell, order=order
        )
        problem = slider_crank(MPI.COMM_SELF, domain=rod, steps=steps, modes=16)
        body = problem.flexible["rod"]
        for shape, distance in shapes.items():
            part = ffr.Part(rod, distance, body.domain.area**0.5 / 64.0, material=body.material)
            x = shares(rod, distance, 24)
            evaluation = problem.value(x)
            fine = part.verify(problem, evaluation).psi
            row: dict[str, Any] = {"cell": cell, "order": order, "shape": shape}
            for exponent in IN_PLANE:
                law = problem.with_bodies(
                    {"rod": body.with_interpolation(ffr.SIMP(exponent=exponent))}
                )
                row[f"p {exponent:g}"] = law.value(x).psi / fine - 1.0
            rows.append(row)
    return {"rows": rows}


def shares(domain: ffr.Domain, distance: Callable[[Array], Array], count: int) -> Array:
    """The share of each element in which a signed distance is positive.

    Args:
        domain: The mesh.
        distance: Of positions (n, dimension) [m].
        count: Points in each direction, see `Domain.quadrature_points`.
    """
    points, weights = domain.quadrature_points(count)
    inside = (distance(points.reshape(-1, domain.dimension)) > 0.0).reshape(weights.shape)
    x = np.clip(np.einsum("cq,cq->c", weights, inside), 0.0, 1.0)
    return np.where(domain.design_cells, x, domain.passive_density)


def _frame(points: Array) -> Array:
    """Two flanges and slanted webs, positive inside [m]; no edge is an element's."""
    x, y = points[:, 0], points[:, 1]
    flange = np.abs(y) - 0.0127
    pitch = 0.05
    along = np.abs((x + 0.011) % pitch - 0.5 * pitch) - 0.5 * pitch * np.abs(y) / 0.02
    web = 0.0024 - np.abs(along) * 0.62
    return np.maximum(flange, web)


def _flanges(points: Array) -> Array:
    """Two flanges between whose edges and the outline no row of elements fits [m]."""
    return np.abs(points[:, 1]) - 0.0117


def _holes(points: Array) -> Array:
    """A rod with round holes [m]."""
    x = (points[:, 0] + 0.013) % 0.04 - 0.02
    return np.hypot(x, points[:, 1]) - 0.0123


SHAPES: dict[str, Callable[[Array], Array]] = {
    "frame": _frame,
    "flanges": _flanges,
    "holes": _holes,
}

# ---------------------------------------------------------------------- report

#: What all tables of designs show
COLUMNS = {
    "gradients": "gradients",
    "told_eight": "psi, 8 modes",
    "part_eight": "psi of the part, 8 modes",
    "told": "psi",
    "part": "psi of the part",
    "difference": "difference",
    "modes": "modes",
    "mode_error": "mode error",
    "volume": "volume",
    "pieces": "pieces",
    "thinnest": "thinnest member [mm]",
    "gap": "narrowest gap [mm]",
    "asymmetry": "asymmetry",
    "seconds": "processor time [s]",
}
NUMBERS = (
    "psi is relative to that of the full body on the same mesh with the same modes, *difference* "
    "is psi of the part over psi minus one. Both are told with the modes that the run ended with "
    "(estimated error below 0.2 %) and with eight. *Time* is that of the processor, one core, for "
    "all of it: design, part, both verifications."
)


def report_designs(results: Results, directory: Path) -> list[Table]:
    """Write tables and pictures.

    Args:
        results: Of `designs_jobs`.
        directory: Where to.

    Returns:
        The tables.
    """
    found = [result for job, result in results if job.function == "design"]
    for row in found:
        for name in COLUMNS:
            row.setdefault(name, float("nan"))
    starts = [r for r in found if r["scene"] == "reference" and r["method"] == METHODS[0]]
    methods = starts[:1] + [r for r in found if r["method"] != METHODS[0]]
    scenes = [r for r in found if r["scene"] != "reference"]
    law = [r for job, result in results if job.function == "cut_elements" for r in result["rows"]]
    tables = [
        Table(
            "designs_starts",
            f"{len(starts)} starts",
            f"Reference scene, {starts[0]['elements']:,} elements. {NUMBERS} {_spread(starts)}",
            {"start": "start", **COLUMNS},
            starts,
        ),
        Table(
            "designs_methods",
            "Methods",
            f"Reference scene; explicit steps begin with 30 holes. {NUMBERS}",
            {"method": "method", **COLUMNS},
            methods,
        ),
        Table(
            "designs_scenes",
            "Other scenes and meshes, the same procedure",
            f"Meshes of the reference rod at a minimum member of {1e3 * MEMBER:.2g} mm. {NUMBERS}",
            {"scene": "scene", "elements": "elements", **COLUMNS},
            scenes,
        ),
        Table(
            "designs_cut_elements",
            "What a cut element is worth",
            "psi of a given boundary by shares of elements with exponent p, over that of a mesh "
            "which fits the boundary, minus one; 16 modes.",
            {
                "shape": "boundary",
                "cell": "element",
                "order": "order",
                **{f"p {p:g}": f"p = {p:g}" for p in IN_PLANE},
            },
            law,
        ),
    ]
    tables = [table for table in tables if table.rows]
    _draw(starts, [*methods[1:], *scenes], directory / "designs.png")
    picture = "![The parts of all starts, methods and scenes](designs.png)"
    write_page(directory, "designs", "From starts to parts", picture, tables)
    return tables


def _spread(rows: list[dict[str, Any]]) -> str:
    """Median, largest and spread of psi of the parts."""
    text = []
    for name, what in (("part", "enough modes"), ("part_eight", "eight modes")):
        psi = np.array([row[name] for row in rows])
        text.append(
            f"With {what}: median {np.median(psi):.4f}, largest {np.max(psi):.4f}, largest over "
            f"smallest {np.max(psi) / np.min(psi):.4f}."
        )
    return " ".join(text)


def _draw(starts: list[dict[str, Any]], others: list[dict[str, Any]], path: Path) -> None:
    """All parts, one panel each."""
    rows = [row for row in (*starts, *others) if "rings" in row]
    columns = 2
    lines = -(-len(rows) // columns)
    with styled_figure(9.0, 0.75 * lines + 0.2, dpi=90.0) as figure:
        for k, row in enumerate(rows):
            axes = figure.add_subplot(lines, columns, k + 1)
            draw_parts(axes, row["rings"])
            name = row["start"] if row in starts else ""
            name = name or (row["scene"] if row["scene"] != "reference" else row["method"])
            axes.set_title(f"{name}: {row['part']:.4f}", fontsize=8, loc="left", pad=1.0)
        figure.subplots_adjust(0.01, 0.01, 0.99, 0.96, 0.04, 0.45)
        save(figure, path)
    with Image.open(path) as picture:  # few colours and many lines
        few = picture.convert("RGB").quantize(32)
    few.save(path, optimize=True)


def draw_parts(axes: Axes, by_name: Mapping[str, list[list[Any]]]) -> None:
    """Draw parts, one below the other.

    Args:
        axes: Where to.
        by_name: Of `rings`.
    """
    axes.set_axis_off()
    axes.set_aspect("equal")
    below = 0.0
    for pieces in by_name.values():
        points = np.vstack([np.array(ring) for loops in pieces for ring in loops])
        shift = np.array([0.0, below - points[:, 1].max()])
        for loops in pieces:
            for j, ring in enumerate(loops):
                corners = np.array(ring) + shift
                axes.fill(*corners.T, color="white" if j else GRAY, linewidth=0.0)
                axes.plot(*corners.T, color=BLUE, linewidth=0.5)
        below -= float(np.ptp(points[:, 1])) * 1.15
