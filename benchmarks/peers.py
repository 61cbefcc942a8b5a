# SPDX-License-Identifier: MIT
"""This package beside others from PyPI: Exudyn for the motion, pyMOTO for the static limit.

Each pair computes the same model: the same reduced rod in the same floating frame, the same plate
of the same elements with the same law of the density. What is left to differ is the time
integration and the solver, so that time can be read beside error. Measured side by side in one
process, in turns; memory in processes of their own.
"""

from __future__ import annotations

import atexit
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse
from jobs import Job, Progress
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from memory import peak_memory, reset_peak_memory
from numpy.typing import NDArray
from peer_exudyn import Crank, ExudynRod, Method, rod_for_exudyn, save_rod, simulate
from peer_packages import missing, versions
from peer_pymoto import FLOOR, SOLVERS, Plate, PymotoPlate, random_density
from report import Table, duration, write_page
from scene import holes_design, slider_crank, slider_crank_numbers

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, DARK, GRAY, ORANGE, RED, save, styled_figure, tidy

__all__ = [
    "exudyn_rod",
    "memory_of_motion",
    "memory_of_plate",
    "missing",
    "peers_jobs",
    "plate_designs",
    "plate_problem",
    "plate_times",
    "report_peers",
    "row_after_row",
    "slider_crank_times",
]

Array = NDArray[np.float64]
#: Instants at which deflections are compared.
INSTANTS = 50
#: Names of the codes and their methods, as in the tables.
OURS, EXUDYN, PYMOTO = "dolfinx_ffr", "Exudyn", "pyMOTO"
ALPHA, RADAU, TRAPEZOIDAL = "generalised-alpha", "Radau IIA", "trapezoidal, index 2"
#: Share of the plate that its design may fill, and radius of its filter in elements.
VOLUME, RADIUS = 0.5, 2.5


def peers_jobs(*, quick: bool) -> list[Job]:
    """Return the measurements.

    Args:
        quick: small meshes and few repetitions.
    """
    folder = tempfile.TemporaryDirectory(prefix="dolfinx_ffr-peers.")
    atexit.register(folder.cleanup)
    rod = str(Path(folder.name) / "rod.npz")
    elements = [60, 6] if quick else [200, 20]
    steps = [500, 1000, 2000] if quick else [500, 1000, 2000, 4000, 8000, 16000]
    stages = [50, 100] if quick else [50, 100, 200, 400, 800, 1600]
    plates = [[24, 8], [48, 16]] if quick else [[60, 20], [120, 40], [240, 80], [480, 160]]
    designed, iterations = ([24, 8], 10) if quick else ([180, 60], 60)
    return [
        Job(
            "peers",
            "slider_crank_times",
            6.0 if quick else 50.0,
            {
                "elements": elements,
                "steps": steps,
                "stages": stages,
                "reference": 1600 if quick else 16000,
                "repetitions": 1 if quick else 5,
                "rod": rod,
            },
        ),
        Job("peers", "memory_of_motion", 3.0, {"elements": elements, "steps": steps[-1]}),
        Job(
            "peer_exudyn",
            "memory_of_exudyn",
            2.0,
            {"rod": rod, "crank": list(slider_crank_numbers()[:3]), "steps": steps[-1]},
        ),
        *(
            Job(
                "peers",
                "plate_times",
                2.0 if quick else 3.0 + np.prod(size) / 4000.0,
                {"elements": size, "repetitions": 2 if quick else 5},
            )
            for size in plates
        ),
        Job("peers", "memory_of_plate", 3.0, {"elements": plates[-1]}),
        *(
            Job(
                "peer_pymoto",
                "memory_of_pymoto",
                2.0,
                {"elements": plates[-1], "solver": solver},
            )
            for solver in (SOLVERS[-1:] if quick else SOLVERS)
        ),
        Job(
            "peers",
            "plate_designs",
            4.0 if quick else 25.0,
            {"elements": designed, "iterations": iterations},
        ),
    ]


# ---------------------------------------------------------------------- the motion


def exudyn_rod(body: ffr.FlexibleBody, reduced: ffr.ReducedBody, point_mass: float) -> ExudynRod:
    """Return a reduced rod as Exudyn takes it, with a point mass at its interface ``"right"``.

    Args:
        body: on one rank; what is assembled is handed over.
        reduced: the body at the density that is assembled.
        point_mass: [kg].
    """
    marker = reduced.integrals.markers["right"]
    mass, stiffness = (
        scipy.sparse.csr_matrix(matrix.getValuesCSR()[::-1], shape=matrix.getSize())
        for matrix in (body.elasticity.mass, body.elasticity.stiffness)
    )
    return rod_for_exudyn(
        body.reduction.reference,
        mass,
        stiffness,
        reduced.basis.shapes,
        (marker.position, marker.displacement),
        point_mass,
    )


def slider_crank_times(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: list[int],
    steps: list[int],
    stages: list[int],
    reference: int,
    repetitions: int,
    rod: str,
) -> dict[str, Any]:
    """Measure the slider-crank by both codes, method by method and step by step.

    Args:
        comm: one rank.
        progress: told the part that is done.
        elements: along and across.
        steps: of the methods of second order.
        stages: steps of Radau IIA.
        reference: steps of Radau IIA that count as exact.
        repetitions: turns through all settings; the fastest of them counts.
        rod: file for the rod, for other processes.
    """
    problem = slider_crank(comm, (elements[0], elements[1]))
    body = problem.flexible["rod"]
    x = holes_design(body.domain)
    evaluation = problem.gradient(x)
    reduced = evaluation.bodies["rod"]
    radius, turns, duration_, slider = slider_crank_numbers()
    given = exudyn_rod(body, reduced, slider)
    save_rod(Path(rod), given)
    crank = Crank(radius, turns, duration_)
    K = reduced.integrals.K
    middle = _middle(given)

    def ours(integrator: ffr.Integrator) -> tuple[float, float, Array]:
        mechanical = ffr.MechanicalProblem(problem.mechanism, integrator, problem.objective)
        start = perf_counter()
        found = mechanical.value({"rod": reduced.integrals})
        seconds = perf_counter() - start
        assert found.trajectory is not None
        q = found.trajectory.elastic("rod")
        q = q if found.trajectory.method else q[::3]  # the stages of Radau IIA left out
        return seconds, found.psi, q @ middle

    def exudyn(method: Method) -> tuple[float, float, Array]:
        found = simulate(given, crank, method)
        compliance = np.sum((found.q @ K) * found.q, axis=1)
        psi = float(np.sum(np.diff(found.t) * 0.5 * (compliance[1:] + compliance[:-1])))
        return found.seconds, psi, found.q @ middle

    def at_instants(deflection: Array) -> Array:
        return deflection[:: (len(deflection) - 1) // INSTANTS]

    runs: list[tuple[str, str, int, Callable[[], tuple[float, float, Array]]]] = []
    for n in steps:
        runs += [
            (OURS, ALPHA, n, lambda n=n: ours(ffr.GeneralizedAlpha(duration_, n))),
            (EXUDYN, ALPHA, n, lambda n=n: exudyn(Method(n, 3))),
            (EXUDYN, TRAPEZOIDAL, n, lambda n=n: exudyn(Method(n, 2))),
        ]
    for n in stages:
        runs.append((OURS, RADAU, n, lambda n=n: ours(ffr.RadauIIA(duration_, steps=n))))

    _, psi, deflection = ours(ffr.RadauIIA(duration_, steps=reference))
    _, psi_half, deflection_half = ours(ffr.RadauIIA(duration_, steps=reference // 2))
    exact = at_instants(deflection)
    size = float(np.max(np.abs(exact)))
    for _, _, n, run in runs:
        if n in (steps[0], stages[0]):
            run()  # whatever is loaded once
    best: dict[int, float] = {}
    rows: list[dict[str, Any]] = []
    for repetition in range(repetitions):
        for place, (code, method, n, run) in enumerate(runs):
            seconds, found, w = run()
            best[place] = min(seconds, best.get(place, np.inf))
            if repetition == 0:
                rows.append(
                    {
                        "code": code,
                        "method": method,
                        "steps": n,
                        "error_psi": abs(found / psi - 1.0),
                        "error_deflection": float(np.max(np.abs(at_instants(w) - exact)) / size),
                    }
                )
            progress((repetition + (place + 1) / len(runs)) / (repetitions + 1))
    for place, row in enumerate(rows):
        row["seconds"] = best[place]

    value, gradient, reduction, setup, motion = ([] for _ in range(5))
    for _ in range(repetitions):
        value.append(_seconds(lambda: problem.value(x)))
        gradient.append(_seconds(lambda: problem.gradient(x)))
        reduction.append(_seconds(lambda: body.reduce(x)))
        simulation = simulate(given, crank, Method(problem.integrator.steps, 3))
        setup.append(simulation.seconds_model)
        motion.append(simulation.seconds)
    return {
        "rows": rows,
        "elements": body.domain.n_cells_global,
        "modes": body.modes,
        "psi": psi,
        "reference": reference,
        "reference_error_psi": abs(psi_half / psi - 1.0),
        "reference_error_deflection": float(
            np.max(np.abs(at_instants(deflection_half) - exact)) / size
        ),
        "deflection": size,
        "value": min(value),
        "gradient": min(gradient),
        "steps": problem.integrator.steps,
        "exudyn_value": min(reduction) + min(setup) + min(motion),
        "reduction": min(reduction),
        "exudyn_setup": min(setup),
    }


def _middle(rod: ExudynRod) -> Array:
    """Return the shape functions across the rod at the node nearest to its middle, shape (r,)."""
    target = np.array([0.5 * rod.positions[-1, 0], 0.0, 0.0])
    node = int(np.argmin(np.linalg.norm(rod.positions - target, axis=1)))
    return rod.modes[3 * node + 1]


def _seconds(action: Callable[[], Any]) -> float:
    start = perf_counter()
    action()
    return perf_counter() - start


def memory_of_motion(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], steps: int
) -> dict[str, float]:
    """Measure the peak of memory of one simulation of the reduced rod.

    Args:
        comm: one rank.
        progress: told the part that is done.
        elements: along and across.
        steps: of generalised-alpha.
    """
    problem = slider_crank(comm, (elements[0], elements[1]), steps=2)
    body = problem.flexible["rod"]
    integrals = {"rod": problem.value(holes_design(body.domain)).bodies["rod"].integrals}
    duration_ = problem.integrator.end_time
    base = reset_peak_memory()
    mechanical = ffr.MechanicalProblem(
        problem.mechanism, ffr.GeneralizedAlpha(duration_, steps), problem.objective
    )
    mechanical.value(integrals)
    return {"base": base, "beyond": peak_memory() - base}


# ---------------------------------------------------------------------- the static limit


def plate_problem(comm: MPI.Comm, plate: Plate) -> ffr.Problem:
    """Return the plate as a mechanism at rest: psi is its compliance during one second.

    The left interface is welded to the ground, the right one slides; the motion starts in the
    static equilibrium, and stays there. With constraint modes alone its displacement is exactly
    that of the finite elements, because nothing but the interfaces is loaded.

    Args:
        comm: one rank.
        plate: what is loaded.
    """
    nx, ny = plate.elements
    length = nx * plate.element
    domain = ffr.Domain.rectangle(comm, length, 1.0, elements=(nx, ny), solid_columns=0)
    material = ffr.PlaneStress(
        young=plate.young, poisson=plate.poisson, density=7850.0, thickness=plate.thickness
    )
    body = ffr.FlexibleBody(
        domain,
        material,
        frame=ffr.TangentFrame("left"),
        modes=0,
        interpolation=ffr.SIMP(floor=FLOOR),
    )
    mechanism = ffr.Mechanism(
        placements={"plate": ffr.Placement()},
        joints=[
            ffr.Weld(("plate", "left"), ffr.Ground()),
            ffr.Translational(("plate", "right"), ffr.Ground((length, 0.0)), direction=(0.0, 1.0)),
        ],
        forces=[ffr.Force(("plate", "right"), y=-plate.force)],
        start=ffr.StaticEquilibrium(),
    )
    integrator = ffr.GeneralizedAlpha(1.0, 1)
    return ffr.Problem({"plate": body}, mechanism, integrator, ffr.IntegralCompliance())


def row_after_row(plate: Plate, centroids: Array) -> NDArray[np.int64]:
    """Return the place of each cell in the order row after row."""
    nx = plate.elements[0]
    i, j = np.floor((centroids + np.array([0.0, 0.5])) / plate.element).astype(np.int64).T
    return i + nx * j


def plate_times(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], repetitions: int
) -> dict[str, Any]:
    """Measure compliance and gradient at a density by both codes, in turns.

    Args:
        comm: one rank.
        progress: told the part that is done.
        elements: along and across.
        repetitions: the fastest of them counts.
    """
    plate = Plate((elements[0], elements[1]))
    problem = plate_problem(comm, plate)
    place = row_after_row(plate, problem.flexible["plate"].domain.centroids)
    x = random_density(plate.elements)
    evaluation = problem.gradient(x[place])
    assert evaluation.gradient is not None
    exact = np.empty_like(x)
    exact[place] = evaluation.gradient["plate"]
    theirs = {solver: PymotoPlate(plate, solver) for solver in SOLVERS}
    differences = {}
    for solver, peer in theirs.items():
        c, g = peer.gradient(x)
        differences[solver] = (
            abs(c / evaluation.psi - 1.0),
            float(np.linalg.norm(g - exact) / np.linalg.norm(exact)),
        )
    times: dict[str, float] = dict.fromkeys((OURS, *SOLVERS), np.inf)
    for repetition in range(repetitions):
        times[OURS] = min(times[OURS], _seconds(lambda: problem.gradient(x[place])))
        for solver, peer in theirs.items():
            times[solver] = min(times[solver], _seconds(lambda peer=peer: peer.gradient(x)))
        progress((repetition + 1) / repetitions)
    return {
        "seconds": times,
        "differences": differences,
        "compliance": evaluation.psi,
        "unknowns": problem.flexible["plate"].elasticity.n_dofs_global,
    }


def memory_of_plate(comm: MPI.Comm, progress: Progress, *, elements: list[int]) -> dict[str, float]:
    """Measure the peak of memory of one compliance and its gradient.

    Args:
        comm: one rank.
        progress: told the part that is done.
        elements: along and across.
    """
    small = Plate((6, 2))
    plate_problem(comm, small).gradient(random_density(small.elements))
    base = reset_peak_memory()
    plate = Plate((elements[0], elements[1]))
    plate_problem(comm, plate).gradient(random_density(plate.elements))
    return {"base": base, "beyond": peak_memory() - base}


def plate_designs(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], iterations: int
) -> dict[str, Any]:
    """Design the plate by both codes: the same filter, each with its own moving asymptotes.

    Args:
        comm: one rank.
        progress: told the part that is done.
        elements: along and across.
        iterations: of each.
    """
    plate = Plate((elements[0], elements[1]))
    problem = plate_problem(comm, plate)
    domain = problem.flexible["plate"].domain
    # so flat a projection is the identity, to seven digits
    design = ffr.DensityDesign(domain, radius=RADIUS * plate.element, betas=(1e-3,))
    order = np.argsort(row_after_row(plate, domain.everywhere(domain.centroids)))
    kernel = design.filter.matrix[order][:, order]
    start = design.even(VOLUME)
    solid = problem.value(np.ones(domain.n_cells)).psi
    runs: dict[str, dict[str, Any]] = {}

    for approximation in ("reciprocal", "quadratic"):
        seconds: list[float] = []
        compliance: list[float] = []
        begin = perf_counter()

        def record(
            iteration: int,
            x: Any,
            evaluation: ffr.Evaluation,
            seconds: list[float] = seconds,
            compliance: list[float] = compliance,
            begin: float = begin,
        ) -> None:
            seconds.append(perf_counter() - begin)
            compliance.append(evaluation.psi)

        result = ffr.optimize(
            problem,
            design,
            start,
            optimizer=ffr.MMA(approximation, tolerance=0.0),  # type: ignore[arg-type]
            volume=VOLUME,
            iterations=iterations,
            progress=False,
            callback=record,
        )
        runs[f"{OURS}, {approximation}"] = {
            "seconds": seconds,
            "compliance": compliance,
            "volume": result.evaluation.volume["plate"],
        }
        progress(0.25 * (1 + len(runs)))

    peer = PymotoPlate(plate, "CHOLMOD", kernel)
    variables, compliance, seconds = peer.design(start, VOLUME, iterations, lambda part: None)
    runs[PYMOTO] = {
        "seconds": seconds,
        "compliance": compliance,
        "volume": float(np.mean(kernel @ variables)),
    }
    return {"runs": runs, "solid": solid, "mesh": "x".join(map(str, elements))}


# ---------------------------------------------------------------------- tables


def report_peers(results: list[tuple[Job, dict[str, Any]]], directory: Path) -> list[Table]:
    """Write tables and picture.

    Args:
        results: of `peers_jobs`.
        directory: where to.

    Returns:
        The tables.
    """
    by_name = {job.function: result for job, result in results}
    motion, designs = by_name["slider_crank_times"], by_name["plate_designs"]
    plates = [(job, result) for job, result in results if job.function == "plate_times"]
    plate_rows = rows_of_plates(plates)
    tables = [
        *_motion_tables(motion),
        *_plate_tables(plate_rows, designs),
        _memory_table(results),
    ]
    _draw(motion, plate_rows, designs, directory / "peers.png")
    picture = "![Time beside error, of this package and of others](peers.png)"
    names = {"exudyn": EXUDYN, "pymoto": PYMOTO, "cvxopt": "CVXOPT", "opt_einsum": "opt_einsum"}
    peers = ", ".join(f"{names[name]} {version}" for name, version in versions().items())
    text = f"Beside {peers}; the peers' NumPy and SciPy are those of the environment.\n\n{picture}"
    write_page(directory, "peers", "Beside other packages", text, tables)
    return tables


def seconds_to_reach(rows: Sequence[dict[str, Any]], error: float, what: str) -> float:
    """Return the time in which a method reaches an error, between its measured settings.

    Args:
        rows: of one method; time falls where the error grows.
        error: that is to be reached.
        what: name of the error.

    Returns:
        The time interpolated in logarithms [s]; that of the coarsest setting, where even that is
        more accurate; not a number where the finest is not accurate enough.
    """
    ordered = sorted(rows, key=lambda row: row[what])
    errors = np.log([row[what] for row in ordered])
    times = np.log([row["seconds"] for row in ordered])
    if np.log(error) < errors[0]:
        return float("nan")
    return float(np.exp(np.interp(np.log(error), errors, times)))


def rows_of_equal_error(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the times of each method at equal errors, and how many times longer Exudyn takes."""
    methods = {
        (code, method): [r for r in rows if (r["code"], r["method"]) == (code, method)]
        for code, method in {(row["code"], row["method"]): None for row in rows}
    }
    found = []
    for what, name in (("error_psi", "psi"), ("error_deflection", "deflection")):
        for error in (1e-3, 3e-4, 1e-4, 3e-5, 1e-5):
            t = {key: seconds_to_reach(own, error, what) for key, own in methods.items()}
            row = {
                "of": name,
                "error": error,
                "ours_alpha": t[OURS, ALPHA],
                "ours_radau": t[OURS, RADAU],
                "exudyn_alpha": t[EXUDYN, ALPHA],
                "exudyn_trapezoidal": t[EXUDYN, TRAPEZOIDAL],
            }
            ours = np.array([row["ours_alpha"], row["ours_radau"]])
            theirs = np.array([row["exudyn_alpha"], row["exudyn_trapezoidal"]])
            if np.isnan(ours).all() or np.isnan(theirs).all():
                continue
            row["ratio_alpha"] = row["exudyn_alpha"] / row["ours_alpha"]
            row["ratio_best_alpha"] = row["exudyn_alpha"] / np.nanmin(ours)
            row["ratio_best"] = np.nanmin(theirs) / np.nanmin(ours)
            found.append(row)
    return found


def _motion_tables(motion: dict[str, Any]) -> list[Table]:
    n = motion["elements"]
    scene = (
        f"Slider-crank of the demo, rod with 30 holes, {n:,} elements, {motion['modes']} modes, "
        "two seconds. Both codes get the same shape functions, mass and stiffness of the rod, and "
        "the same floating frame."
    )
    table = Table(
        "peers_motion",
        "Motion: time and error",
        f"{scene} *Seconds* are those of the solver, of the reduced rod, the fastest of several "
        "turns through all settings: of this package the model's compilation and psi included, of "
        "Exudyn without. *Error of psi* is relative; *error of deflection* is the largest one of "
        f"the rod's middle at {INSTANTS} instants over the largest deflection "
        f"({1e6 * motion['deflection']:.3g} micrometres). Exact is {RADAU} with "
        f"{motion['reference']:,} steps; half as many differ from it by "
        f"{motion['reference_error_psi']:.0e} and {motion['reference_error_deflection']:.0e}. "
        f"Spectral radius 0.8 in both; Exudyn's {ALPHA} has constraints of positions (index 3), "
        "its module is the one without range checks and its Newton method keeps the Jacobian. The "
        f"last {1e9 * 2e-4 * motion['deflection']:.0f} nm of the deflection, 2e-4 of it, are "
        "vibrations of more than 1 kHz from the start, whose phase no method of second order "
        "follows with so few steps.",
        {
            "code": "code",
            "method": "method",
            "steps": "steps",
            "seconds": "seconds",
            "error_psi": "error of psi",
            "error_deflection": "error of deflection",
        },
        sorted(motion["rows"], key=lambda r: (r["code"] != OURS, r["method"], r["steps"])),
    )
    equal = Table(
        "peers_equal_error",
        "Motion: time at equal error",
        "From the table above, interpolated in logarithms. Where even a method's coarsest setting "
        "is more accurate than asked, its time counts; a dash where the finest is not accurate "
        f"enough. *Best* is the faster method of each code. {RADAU} is of order 5, and far ahead "
        "where an objective hardly feels the vibrations, as psi does; where they count, as in the "
        "deflection, it is not.",
        {
            "of": "error of",
            "error": "error",
            "ours_alpha": f"{OURS}, {ALPHA} [s]",
            "ours_radau": f"{OURS}, {RADAU} [s]",
            "exudyn_alpha": f"{EXUDYN}, {ALPHA} [s]",
            "exudyn_trapezoidal": f"{EXUDYN}, {TRAPEZOIDAL} [s]",
            "ratio_alpha": f"{EXUDYN} / {OURS}, both {ALPHA}",
            "ratio_best_alpha": f"{EXUDYN}'s {ALPHA} / {OURS}'s best",
            "ratio_best": f"{EXUDYN}'s best / {OURS}'s best",
        },
        rows_of_equal_error(motion["rows"]),
    )
    difference = (n + 1) * motion["exudyn_value"]
    gradient = Table(
        "peers_gradient",
        "Motion: one gradient with respect to every element",
        f"{ALPHA.capitalize()} with {motion['steps']:,} steps. This package's exact gradient, with "
        f"the value, is measured. **Exudyn's is not: it has no derivatives, so its cost is "
        "extrapolated** as that of one-sided differences, the number of elements plus one times "
        f"one reduction of the rod (by this package, {1e3 * motion['reduction']:.0f} ms), "
        f"Exudyn's set-up of the body ({1e3 * motion['exudyn_setup']:.0f} ms) and one simulation, "
        "each measured.",
        {
            "code": "code",
            "how": "how",
            "value": "one value [s]",
            "gradient": "gradient [s]",
            "gradient_text": "that is",
            "ratio": "over this package's",
        },
        [
            {
                "code": OURS,
                "how": "exact, measured",
                "value": motion["value"],
                "gradient": motion["gradient"],
                "gradient_text": duration(motion["gradient"]),
                "ratio": 1.0,
            },
            {
                "code": EXUDYN,
                "how": "differences, extrapolated",
                "value": motion["exudyn_value"],
                "gradient": difference,
                "gradient_text": duration(difference),
                "ratio": difference / motion["gradient"],
            },
        ],
    )
    return [table, equal, gradient]


def rows_of_plates(plates: Sequence[tuple[Job, dict[str, Any]]]) -> list[dict[str, Any]]:
    """Return one row for each plate."""
    rows = []
    for job, result in plates:
        nx, ny = job.parameters["elements"]
        t, d = result["seconds"], result["differences"]
        rows.append(
            {
                "mesh": f"{nx}x{ny}",
                "elements": nx * ny,
                "unknowns": result["unknowns"],
                "ours": t[OURS],
                **{solver: t[solver] for solver in SOLVERS},
                **{f"ratio_{solver}": t[solver] / t[OURS] for solver in SOLVERS},
                "difference_compliance": max(d[solver][0] for solver in SOLVERS),
                "difference_gradient": max(d[solver][1] for solver in SOLVERS),
            }
        )
    return rows


def _plate_tables(rows: list[dict[str, Any]], designs: dict[str, Any]) -> list[Table]:
    times = Table(
        "peers_plate",
        "Static limit: compliance and gradient",
        "A plate of bilinear squares, clamped at the left, sliding at the right as a rigid piece "
        "under a force; a density of its own for each element, SIMP with exponent 3, no filter. "
        "Seconds of one compliance with its gradient, the fastest of several turns. Differences "
        "are relative, between this package and pyMOTO. SuperLU is SciPy's, which pyMOTO takes as "
        "it comes; CHOLMOD is CVXOPT's. This package assembles the mass too, and goes through its "
        "static equilibrium and adjoint of the motion, a fixed cost of some milliseconds.",
        {
            "mesh": "mesh",
            "elements": "elements",
            "unknowns": "unknowns",
            "ours": f"{OURS} [s]",
            **{solver: f"{PYMOTO}, {solver} [s]" for solver in SOLVERS},
            **{f"ratio_{solver}": f"{PYMOTO}, {solver} / {OURS}" for solver in SOLVERS},
            "difference_compliance": "difference of compliance",
            "difference_gradient": "difference of gradient",
        },
        rows,
    )
    found = []
    for name, run in designs["runs"].items():
        seconds, compliance = np.array(run["seconds"]), np.array(run["compliance"])
        best = np.minimum.accumulate(compliance)
        near = best <= 1.01 * min(min(r["compliance"]) for r in designs["runs"].values())
        found.append(
            {
                "code": name,
                "iterations": len(seconds),
                "each": float(seconds[-1] / len(seconds)),
                "total": float(seconds[-1]),
                "start": float(compliance[0] / designs["solid"]),
                "final": float(best[-1] / designs["solid"]),
                "near": float(seconds[np.argmax(near)]) if near.any() else float("nan"),
                "volume": run["volume"],
            }
        )
    design = Table(
        "peers_design",
        "Static limit: a whole design",
        f"The plate with {designs['mesh']} elements, at most half of it filled, one filter of "
        f"{RADIUS} elements for both, no projection, from an even start. Each code has its own "
        "method of moving asymptotes: this package NLopt's, which rejects steps that fail and "
        "counts them as iterations, with either of its two approximations; pyMOTO the one of 2007 "
        "with its defaults. Compliances are over that of the solid plate; *near* is the time until "
        "the design is within one per cent of the best of all.",
        {
            "code": "code",
            "iterations": "iterations",
            "each": "each [s]",
            "total": "all [s]",
            "start": "compliance at the start",
            "final": "at the end",
            "near": "near [s]",
            "volume": "volume",
        },
        found,
    )
    return [times, design]


def _memory_table(results: list[tuple[Job, dict[str, Any]]]) -> Table:
    rows = []
    for job, result in results:
        if not job.function.startswith("memory_of_"):
            continue
        solver = job.parameters.get("solver")
        code = {"memory_of_exudyn": EXUDYN, "memory_of_pymoto": f"{PYMOTO}, {solver}"}
        case = "motion" if job.function in ("memory_of_motion", "memory_of_exudyn") else "plate"
        if case == "plate":
            case += " of " + "x".join(map(str, job.parameters["elements"]))
        else:
            case += f", {job.parameters['steps']:,} steps"
        rows.append({"case": case, "code": code.get(job.function, OURS), **result})
    return Table(
        "peers_memory",
        "Memory",
        "Peak of the resident memory, each line in a process of its own: *beyond* what it holds "
        "(*base*) with all libraries loaded and a tiny case done; for the motion by this package "
        "with the rod reduced. The motion is that of the reduced rod, the plate one compliance "
        "with its gradient, mesh and matrices included.",
        {"case": "case", "code": "code", "base": "base [MB]", "beyond": "beyond [MB]"},
        rows,
    )


# ---------------------------------------------------------------------- picture


def _draw(
    motion: dict[str, Any], plates: list[dict[str, Any]], designs: dict[str, Any], path: Path
) -> None:
    with styled_figure(13.0, 8.6) as figure:
        (psi, deflection), (plate, design) = figure.subplots(2, 2)
        for axes, what, title in (
            (psi, "error_psi", "Slider-crank: psi"),
            (deflection, "error_deflection", "Slider-crank: deflection of the rod's middle"),
        ):
            _draw_motion(axes, motion["rows"], what)
            axes.set_title(title)
        low, high = psi.get_ylim()
        psi.set_ylim(low, high * (high / low) ** 0.15)
        psi.legend(loc="upper right")
        _draw_plates(plate, plates)
        _draw_designs(design, designs)
        figure.tight_layout(w_pad=2.0, h_pad=2.0)
        save(figure, path)


def _draw_motion(axes: Axes, rows: Sequence[dict[str, Any]], what: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for code, method, style, color in (
        (OURS, ALPHA, "o-", ORANGE),
        (OURS, RADAU, "s-", RED),
        (EXUDYN, ALPHA, "o--", BLUE),
        (EXUDYN, TRAPEZOIDAL, "s--", GRAY),
    ):
        own = [row for row in rows if (row["code"], row["method"]) == (code, method)]
        x, y = [row["seconds"] for row in own], [row[what] for row in own]
        face = color if style[1:] == "-" else "white"
        axes.plot(x, y, style, color=color, markerfacecolor=face, label=f"{code}, {method}")
        if not own:
            continue
        for row, above in ((own[0], True), (own[-1], False)):
            axes.annotate(
                f"{row['steps']:,}",
                (row["seconds"], row[what]),
                (0, 5 if above else -5),
                textcoords="offset points",
                ha="center",
                va="bottom" if above else "top",
                fontsize=8,
                color=DARK,
            )
    axes.margins(x=0.08, y=0.1)
    _label_seconds(axes.xaxis)
    axes.set_xlabel("seconds of the simulation (steps at the ends)")
    axes.set_ylabel("relative error")
    tidy(axes)


def _label_seconds(axis: Axis) -> None:
    """Label 1, 2 and 5 of each decade."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda seconds, _: f"{seconds:g}"))
    axis.set_minor_formatter(NullFormatter())


def _draw_plates(axes: Axes, rows: Sequence[dict[str, Any]]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    n = [row["elements"] for row in rows]
    for name, label, style, color in (
        ("SuperLU", f"{PYMOTO}, SuperLU", "s--", GRAY),
        ("CHOLMOD", f"{PYMOTO}, CHOLMOD", "o--", BLUE),
        ("ours", OURS, "o-", ORANGE),
    ):
        face = color if style[1:] == "-" else "white"
        axes.plot(
            n, [row[name] for row in rows], style, color=color, markerfacecolor=face, label=label
        )
    axes.set_xticks(n, [f"{count:,}" for count in n])
    axes.minorticks_off()
    axes.margins(x=0.08)
    _label_seconds(axes.yaxis)
    axes.set_xlabel("elements")
    axes.set_ylabel("seconds")
    worst = max(row["difference_gradient"] for row in rows)
    axes.set_title(f"Plate: compliance and gradient (equal to {worst:.0e})".replace("e-0", "e-"))
    axes.legend(loc="upper left")
    tidy(axes)


def _draw_designs(axes: Axes, designs: dict[str, Any]) -> None:
    for (name, run), (style, color) in zip(
        designs["runs"].items(), (("-", ORANGE), ("-", RED), ("--", BLUE)), strict=True
    ):
        best = np.minimum.accumulate(run["compliance"]) / designs["solid"]
        axes.plot(run["seconds"], best, style, color=color, label=f"{name}: {best[-1]:.3f}")
    low, high = axes.get_ylim()
    axes.set_ylim(low, min(high, 2.5 * low))  # the first steps are far above
    axes.set_xlim(left=0.0)
    axes.set_xlabel("seconds")
    axes.set_ylabel("compliance / that of the solid plate")
    axes.set_title("Plate: a whole design, half of it filled")
    axes.legend(loc="upper right")
    tidy(axes)
