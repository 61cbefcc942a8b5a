# SPDX-License-Identifier: MIT
"""Time steps that are chosen for an accuracy, on scenes that hide vibrations from them.

A steel rod of 200 mm, full, with four normal modes, in five scenes: its integral compliance by
Radau IIA and by the trapezoidal rule over the number of steps, and what `TimeInterval` makes of
each. Errors are those against a run that resolves everything.
"""

from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Array, Job, Progress, Results
from report import Study, line, plot

import dolfinx_ffr as ffr
from dolfinx_ffr.dynamics import integrate
from dolfinx_ffr.plotting.style import BLUE, GRAY, ORANGE

SCENES = {
    "sudden weight": "a cantilever that feels its weight from t = 0 on",
    "crank at speed": "on a crank of 50 mm that turns at 15 rad/s from the start",
    "smooth drive": "on the same crank from rest to rest: nothing vibrates",
    "blow": "a cantilever with damping 5/s that a pulse of 1 ms hits, which nobody names",
    "from equilibrium": "the cantilever that has sagged before it is let go: nothing moves",
}
END, LENGTH, CRANK = 0.2, 0.2, 0.05  # [s], [m]
METHODS = {
    "Radau IIA": (ORANGE, "s", lambda n: ffr.RadauIIA(END, steps=n)),
    "trapezoidal rule": (BLUE, "o", lambda n: ffr.GeneralizedAlpha(END, n, 1.0)),
    "generalised alpha, radius 0.8": (GRAY, "^", lambda n: ffr.GeneralizedAlpha(END, n)),
}


def time_steps_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each scene."""
    scenes = list(SCENES)[::2] if quick else list(SCENES)
    steps = [50, 200] if quick else [50, 100, 200, 400, 800, 1600, 3200, 6400, 12800]
    tolerances = [1e-2] if quick else [1e-2, 1e-4, 1e-6]
    common = {"steps": steps, "tolerances": tolerances, "resolved": 2000 if quick else 160000}
    seconds = 5.0 if quick else 60.0
    return [Job("time_steps", "choices", seconds, {"scene": name, **common}) for name in scenes]


def blow(t: Array) -> Array:
    """A pulse of 100 N that lasts a millisecond."""
    return 100.0 * np.sin(np.pi * np.clip((np.asarray(t) - 0.1003) / 1e-3, 0.0, 1.0)) ** 2


def problem_of(name: str, comm: MPI.Comm) -> tuple[ffr.MechanicalProblem, dict[str, Any]]:
    """The problem of a scene, with a method to be replaced, and its body."""
    held = name not in ("crank at speed", "smooth drive")
    domain = ffr.Domain.rectangle(comm, LENGTH, 0.02, elements=(40, 4))
    frame = ffr.TangentFrame("left") if held else ffr.ChordFrame("left", "right")
    steel = ffr.PlaneStress(210e9, 0.3, 7850.0, 0.01)
    body = ffr.FlexibleBody(domain, steel, frame=frame, modes=4)
    bodies = {"rod": body.reduce(np.ones(domain.n_cells)).integrals}
    if held:
        parts: dict[str, Any] = {
            "placements": {"rod": ffr.Placement((0.0, 0.0))},
            "joints": [ffr.Weld(("rod", "left"), ffr.Ground(), name="clamp")],
        }
        if name == "blow":
            parts["forces"] = [ffr.Force(("rod", "right"), 0.0, blow)]
            parts["damping"] = {"rod": ffr.RayleighDamping(5.0)}
        else:
            parts["gravity"] = (0.0, -9.81)
        if name == "from equilibrium":
            parts["start"] = ffr.StaticEquilibrium()
    else:
        turn = ffr.Motion.polynomial([0.0, 15.0])
        drive = turn if name == "crank at speed" else ffr.Motion.smooth_step(np.pi, END)
        pin = ffr.Moving.circle((0.0, 0.0), CRANK, drive)
        parts = {
            "placements": {"rod": ffr.Placement((CRANK, 0.0))},
            "joints": [
                ffr.Revolute(("rod", "left"), pin, name="pin"),
                ffr.PointOnLine(("rod", "right"), ffr.Ground(), name="slider"),
            ],
            "point_masses": [ffr.PointMass(("rod", "right"), 0.3)],
        }
    method = ffr.RadauIIA(END, steps=50)
    mechanism = ffr.Mechanism(**parts)
    return ffr.MechanicalProblem(mechanism, method, ffr.IntegralCompliance()), bodies


def choices(
    comm: MPI.Comm, progress: Progress, *, scene: str, steps: list[int], **how: Any
) -> dict[str, Any]:
    """Errors over steps, and what is chosen for each tolerance."""
    problem, bodies = problem_of(scene, comm)

    def psi(method: ffr.dynamics.Integrator) -> float:
        motion = integrate(problem.mechanism, bodies, method)
        return float(problem.objective.evaluate(ffr.Response(motion, bodies)))

    ends = np.union1d(np.linspace(0.0, END, how["resolved"] + 1), [0.1003, 0.1013])
    exact = psi(ffr.RadauIIA(END, steps=ends))
    progress(0.3)
    curves = {
        name: [abs(psi(make(n)) / exact - 1.0) for n in steps]
        for name, (_, _, make) in METHODS.items()
    }
    progress(0.5)
    rows = []
    for tolerance in how["tolerances"]:
        began = process_time()
        choice = problem.choose_steps(bodies, ffr.TimeInterval(END, tolerance))
        took = process_time() - began
        method = choice.integrator
        evaluated = ffr.MechanicalProblem(problem.mechanism, method, problem.objective)
        began = process_time()
        evaluated.differentiate(evaluated.value(bodies))
        seconds = process_time() - began
        row = {"scene": scene, "tolerance": tolerance, "chosen_text": method.in_words}
        row |= {"estimated": choice.error, "error_psi": abs(psi(method) / exact - 1.0)}
        row |= {"met_text": "yes" if choice.met else "no, warned"}
        rows.append({**row, "choosing": took, "seconds": seconds, "ratio": took / seconds})
        progress(0.5 + 0.5 * len(rows) / len(how["tolerances"]))
    return {"scene": scene, "steps": steps, "curves": curves, "rows": rows}


def report_time_steps(study: Study, results: Results) -> None:
    """Table and picture."""
    found = [result for _, result in results]
    rows = [row for result in found for row in result["rows"]]
    scenes = "; ".join(f"{name}: {text}" for name, text in SCENES.items())
    study.table("time_steps", rows, scenes=scenes)
    caption = "Error over steps of three methods on scenes that vibrate"
    with study.picture(caption, 1, len(found), (3.4 * len(found), 3.4)) as panels:
        for axes, result in zip(panels, found, strict=True):
            for name, (color, mark, _) in METHODS.items():
                errors = np.maximum(result["curves"][name], 1e-16)
                rows = [{"n": n, "e": e} for n, e in zip(result["steps"], errors, strict=True)]
                line(axes, rows, "n", "e", f"{mark}-", color, label=name, markersize=4)
            plot(axes, result["scene"], "steps", "relative error of the compliance")
        panels[0].legend()
