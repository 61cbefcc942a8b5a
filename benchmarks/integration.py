# SPDX-License-Identifier: MIT
"""Both time integrations: time beside error of the objective and its gradient.

All runs of a scene share the rod's volume integrals, from a small mesh. Errors are those against a
run of Radau IIA with a far smaller tolerance, which is compared with extrapolated ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Array, Job, Progress, Results, the
from report import Study, chosen, duration, line, plot, seconds_to_reach
from scene import holes_design, slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, GRAY, ORANGE

SCENES = {
    "reference": "the slider-crank of the demo: 5 turns in 2 s from rest to rest",
    "fast": "the same turns so fast that the crank's speed reaches a third of the rod's first "
    "frequency",
    "stiff": "a rod 25 times as stiff, with 16 normal modes, some of them longitudinal",
    "long": "30 turns in 60 s",
}
CRANK = 0.1  # radius [m]
ALPHA, RADAU = "generalised alpha", "Radau IIA"
METHODS = {ALPHA: (BLUE, "o"), RADAU: (ORANGE, "s")}
RADII = {"elements": [20, 2], "radii": [0.0, 0.5, 0.8, 0.9, 1.0]}
#: Names of columns, and digits of psi whose cost is told.
TARGETS = {ALPHA: ("alpha", (2, 4, 6)), RADAU: ("radau", (2, 4, 6, 7, 8))}
#: Runs that take longer are measured once.
LONG = 0.25


def integration_jobs(*, quick: bool) -> list[Job]:
    """The jobs, one for each scene."""
    counts = [250 * 2**k for k in (range(2, 5) if quick else range(9))]
    tolerances = [10.0**-k for k in ((2, 4, 6) if quick else range(1, 11))]
    common = {
        "elements": [20, 2] if quick else [50, 5],
        "counts": counts,
        "tolerances": tolerances,
        "reference": 1e-7 if quick else 1e-12,
        "modes": 2 if quick else None,
        "repetitions": 0 if quick else 3,
    }
    jobs = []
    for scene in SCENES:
        own = {"scene": scene, **common}
        if scene == "stiff" and not quick:  # the modes are many, and their periods short
            own |= {"tolerances": tolerances[:-2], "reference": 1e-10}
        if scene == "long":  # more turns than the others, and one each two seconds
            own |= {"turns": 5 if quick else 30, "counts": [4 * count for count in counts[:-1]]}
            own |= {"tolerances": tolerances[: -1 if quick else -3]}
            own |= {"reference": 1e-6 if quick else 1e-9}
        jobs.append(Job("integration", "work_precision", 1.5 if quick else 35.0, own))
    own = {**RADII, "steps": 1000 if quick else 2000}
    return [*jobs, Job("integration", "damping", 1.0 if quick else 6.0, own)]


@dataclass(frozen=True)
class _Scene:
    mechanism: ffr.Mechanism
    bodies: dict[str, ffr.VolumeIntegrals]
    end_time: float


def _scene(
    comm: MPI.Comm, name: str, elements: Sequence[int], modes: int | None = None, turns: int = 5
) -> _Scene:
    modes = modes or (16 if name == "stiff" else None)
    problem = slider_crank(comm, elements, **({"modes": modes} if modes else {}))
    body = problem.flexible["rod"]
    rod = body.reduce(holes_design(body.domain)).integrals
    if name == "stiff":
        rod = replace(rod, K=25.0 * rod.K)
    end_time = 2.0 * turns if name == "long" else 2.0
    if name == "fast":
        eigenvalues = np.linalg.eigvals(np.linalg.solve(rod.G[1:, 1:], rod.K)).real
        peak = 1.875 * 2.0 * np.pi * turns  # of a smooth step, times its duration
        end_time = peak / (np.sqrt(eigenvalues.min()) / 3.0)
    angle = ffr.Motion.smooth_step(2.0 * np.pi * turns, end_time, name="crank angle")
    pin = ffr.Revolute(("rod", "left"), ffr.Moving.circle((0.0, 0.0), CRANK, angle), "crank pin")
    mechanism = replace(problem.mechanism, joints=[pin, problem.mechanism.joints[1]])
    return _Scene(mechanism, {"rod": rod}, end_time)


def _run(
    scene: _Scene, integrator: ffr.dynamics.Integrator
) -> tuple[tuple[float, float], float, Array, int]:
    """Seconds of value and of value and gradient, psi, its gradient, and the number of steps."""
    problem = ffr.MechanicalProblem(scene.mechanism, integrator, ffr.IntegralCompliance())
    begin = process_time()
    evaluation = problem.value(scene.bodies)
    value = process_time() - begin
    found = problem.differentiate(evaluation)
    seconds = value, process_time() - begin
    gradient = _by_size(found.integrals_gradient["rod"], scene.bodies["rod"])
    return seconds, found.psi, gradient, found.trajectory.step_ends.size - 1


def _by_size(bar: ffr.VolumeIntegrals, body: ffr.VolumeIntegrals) -> Array:
    """Derivatives times the sizes of what they are by, which makes them comparable."""
    g, k = np.sqrt(np.diag(body.G)), np.sqrt(np.diag(body.K))
    m = np.sqrt(body.mass)
    parts = [np.array([bar.mass * body.mass]), m * g[:, None] * bar.S, np.outer(g, g) * bar.G]
    parts += [np.outer(g, g) * bar.N, np.outer(k, k) * bar.K]
    return np.concatenate([part.ravel() for part in parts])


def _errors(psi: float, gradient: Array, exact: tuple[float, Array]) -> dict[str, float]:
    away = np.linalg.norm(gradient - exact[1]) / np.linalg.norm(exact[1])
    return {"error_psi": abs(psi / exact[0] - 1.0), "error_gradient": float(away)}


def work_precision(
    comm: MPI.Comm, progress: Progress, *, scene: str, reference: float, repetitions: int, **of: Any
) -> dict[str, Any]:
    """Measure time and error of both methods."""
    made = _scene(comm, scene, of["elements"], of["modes"], of.get("turns", 5))
    methods: list[tuple[str, float, ffr.dynamics.Integrator]] = [
        *((ALPHA, float(n), ffr.GeneralizedAlpha(made.end_time, n)) for n in of["counts"]),
        *((RADAU, t, ffr.RadauIIA(made.end_time, tolerance=t)) for t in of["tolerances"]),
    ]
    if repetitions:
        for _, _, integrator in (methods[0], methods[-1]):
            _run(made, integrator)  # compiled, loaded
    exact = _run(made, ffr.RadauIIA(made.end_time, tolerance=reference))[1:3]
    progress(0.4)
    rows: list[dict[str, Any]] = []
    for place, (method, setting, integrator) in enumerate(methods):
        seconds, psi, gradient, steps = _run(made, integrator)
        row = {"scene": scene, "method": method, "setting": setting, "steps": steps, "psi": psi}
        row |= {"seconds": seconds[0], "seconds_gradient": seconds[1]}
        rows.append(row | _errors(psi, gradient, exact))
        progress(0.4 + 0.6 * (place + 1) / len(methods))
    for _ in range(1, repetitions):  # in turn
        for (_, _, integrator), row in zip(methods, rows, strict=True):
            again = _run(made, integrator)[0] if row["seconds_gradient"] <= LONG else [np.inf] * 2
            for key, seconds in zip(("seconds", "seconds_gradient"), again, strict=True):
                row[key] = min(row[key], seconds)
    constant = [row["psi"] for row in chosen(rows, method=ALPHA)]
    return {
        "rows": rows,
        "end_time": made.end_time,
        "check": abs(_extrapolated(constant[-4:]) / exact[0] - 1.0),
        "coordinates": len(made.bodies["rod"].K) + 3,
    }


def _extrapolated(values: Sequence[float]) -> float:
    """Values with steps that halve each time, extrapolated to the step zero."""
    # the error is that of the method, h^2, then h^3
    for power in (2, 3)[: len(values) - 1]:
        factor = 2.0**power
        values = [(factor * fine - coarse) / (factor - 1.0) for coarse, fine in pairwise(values)]
    return values[-1]


def damping(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], radii: list[float], steps: int
) -> dict[str, Any]:
    """Measure errors of the generalised-alpha method with more or less numerical damping."""
    rows = []
    for scene in ("reference", "fast"):
        made = _scene(comm, scene, elements)
        exact = _run(made, ffr.RadauIIA(made.end_time, tolerance=1e-6))[1:3]
        for radius in radii:
            found = _run(made, ffr.GeneralizedAlpha(made.end_time, steps, radius))
            row = {"scene": scene, "radius_text": f"{radius:g}", "steps": steps}
            rows.append(row | _errors(*found[1:3], exact))
        progress(len(rows) / (2.0 * len(radii)))
    return {"rows": rows}


def report_integration(study: Study, results: Results) -> None:
    """Tables and picture."""
    runs = [pair for pair in results if pair[0].function == "work_precision"]
    found = {job.parameters["scene"]: result for job, result in runs}
    rows = [row for result in found.values() for row in result["rows"]]
    scenes = "; ".join(f"*{name}*: {text}" for name, text in SCENES.items())
    study.table("integration", rows, scenes=scenes)
    targets = " | ".join(
        f"{short}_{digit}_text: {method} 1e-{digit}"
        for method, (short, digits) in TARGETS.items()
        for digit in digits
    )
    costs = [{"scene": name, **_costs(result)} for name, result in found.items()]
    study.table("integration_summary", costs, targets=targets)
    study.table("integration_damping", the("damping", results)["rows"])
    caption = "Time beside error of both time integrations"
    with study.picture(caption, 2, 2, (11.0, 8.4)) as panels:
        for axes, (name, result) in zip(panels, found.items(), strict=True):
            for method, (color, marker) in METHODS.items():
                own = chosen(result["rows"], method=method)
                for what, time, style in (
                    ("psi", "seconds", "-"),
                    ("gradient", "seconds_gradient", "--"),
                ):
                    more = {"label": f"{method}: {what}", "hollow": what != "psi"}
                    line(axes, own, time, f"error_{what}", marker + style, color, **more)
            for target in (1e-4, 1e-8):
                axes.axhline(target, color=GRAY, linewidth=0.7, zorder=0)
            plot(axes, name, "seconds", "relative error")
            axes.set_ylim(1e-13, 1.0)
        panels[0].legend(loc="lower left", fontsize=8)


def _costs(result: dict[str, Any]) -> dict[str, Any]:
    costs = {}
    for method, (short, digits) in TARGETS.items():
        own = chosen(result["rows"], method=method)
        for digit in digits:
            costs[f"{short}_{digit}"] = seconds_to_reach(own, 10.0**-digit, "error_psi")
    ratio = costs["radau_8"] / costs["alpha_4"]
    texts = {f"{key}_text": duration(t) if np.isfinite(t) else "-" for key, t in costs.items()}
    texts["ratio_text"] = f"{ratio:.2g}" if np.isfinite(ratio) else "-"
    return {**texts, "check": result["check"]}
