# SPDX-License-Identifier: MIT
"""The motions of the slider-cranks of the demos, in the plane and in space, by us and by Exudyn.

Both codes get the same reduced rod in the same floating frame, so that only the time integration is
left to differ.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Array, Progress, beyond, measure
from peer_exudyn import Crank, Method, simulate
from peer_report import ALPHA, EXUDYN, INSTANTS, OURS, RADAU, TRAPEZOIDAL
from scene import demo, holes_design, slider_crank
from scipy.integrate import trapezoid

import dolfinx_ffr as ffr


def hand_over(
    path: Path, body: ffr.FlexibleBody, reduced: ffr.reduction.ReducedBody, point_mass: float
) -> None:
    """Write a reduced rod for Exudyn, with a point mass [kg] at its right interface."""
    rod = body.in_space(reduced)
    w = rod.markers["right"].basis
    heavy = {"mass": rod.mass + point_mass, "S": rod.S + point_mass * w.T}
    heavy["P"] = rod.P + point_mass * np.einsum("ka,lb->abkl", w, w)
    replace(rod, **heavy).save(path, format="exudyn")


def scene_of(comm: MPI.Comm, elements: list[int]) -> tuple[ffr.Problem, Crank, float]:
    """The slider-crank of the plane or of space, its crank for Exudyn, the slider's mass [kg]."""
    if len(elements) == 2:
        scene = demo("slider_crank")
        crank = Crank(scene.CRANK, scene.TURNS, scene.DURATION)
        return slider_crank(comm, elements, steps=2000), crank, scene.SLIDER
    problem = slider_crank(comm, elements)
    reference, placement = demo("spatial_slider_crank"), problem.mechanism.placements["rod"]
    crank = Crank(
        reference.CRANK,
        reference.TURNS,
        reference.DURATION,
        axes=(1, 2),
        held=(0,),
        place=tuple(placement.position),
        rotation=tuple(map(tuple, np.asarray(placement.rotation))),
        # the rod's y axis stays in the plane of the crank, the slider on its line
        guides=((2, (1, 0, 0)), (4, (0, 1, 1))),
    )
    return problem, crank, reference.SLIDER


def slider_crank_times(
    comm: MPI.Comm, progress: Progress, *, steps: list[int], stages: list[int], **how: Any
) -> dict[str, Any]:
    """Measure the slider-crank by both codes, method by method and step by step."""
    reference, repetitions = how["reference"], how["repetitions"]
    problem, crank, slider = scene_of(comm, how["elements"])
    body = problem.flexible["rod"]
    x = holes_design(body.domain)
    reduced = problem.gradient(x).bodies["rod"]
    given, K = Path(how["rod"]), reduced.integrals.K
    hand_over(given, body, reduced, slider)
    # the shape functions across the rod at the node nearest to its middle
    d, shapes = body.domain.dimension, reduced.basis.shapes
    places = body.reduction.reference.reshape(-1, d)
    away = places - 0.5 * reduced.integrals.markers["right"].position
    middle = shapes.reshape(-1, d, shapes.shape[1])[np.argmin(np.linalg.norm(away, axis=1)), 1]

    def ours(integrator: ffr.dynamics.Integrator) -> tuple[float, float, Array]:
        mechanical = ffr.MechanicalProblem(problem.mechanism, integrator, problem.objective)
        start = process_time()
        found = mechanical.value({"rod": reduced.integrals})
        seconds = process_time() - start
        q = found.trajectory.elastic("rod")
        q = q[:: found.trajectory.integrator.stages]  # the stages of Radau IIA left out
        return seconds, found.psi, q

    def exudyn(method: Method) -> tuple[float, float, Array]:
        found = simulate(given, crank, method)
        compliance = np.sum((found.q @ K) * found.q, axis=1)
        return found.seconds, float(trapezoid(compliance, found.t)), found.q

    def at_instants(q: Array) -> Array:
        return q[:: (len(q) - 1) // INSTANTS]

    runs: list[tuple[str, str, int, Callable[[], tuple[float, float, Array]]]] = []
    for n in steps:
        runs += [
            (OURS, ALPHA, n, lambda n=n: ours(ffr.GeneralizedAlpha(crank.duration, n))),
            (EXUDYN, ALPHA, n, lambda n=n: exudyn(Method(n, 3))),
            (EXUDYN, TRAPEZOIDAL, n, lambda n=n: exudyn(Method(n, 2))),
        ]
    for n in stages:
        runs.append((OURS, RADAU, n, lambda n=n: ours(ffr.RadauIIA(crank.duration, steps=n))))

    _, psi, q = ours(ffr.RadauIIA(crank.duration, steps=reference))
    _, psi_half, q_half = ours(ffr.RadauIIA(crank.duration, steps=reference // 2))
    exact = at_instants(q)
    size = float(np.max(np.abs(exact @ middle)))

    def error(q: Array) -> float:
        return float(np.max(np.abs((at_instants(q) - exact) @ middle)) / size)

    for _, _, n, run in runs:
        if n in (steps[0], stages[0]):
            run()  # whatever is loaded once
    rows: list[dict[str, Any]] = []
    last: dict[Any, Array] = {}  # deflections of each run
    for repetition in range(repetitions):
        for place, (code, method, n, run) in enumerate(runs):
            seconds, found, last[code, method, n] = run()
            if repetition == 0:
                row = {"code": code, "method": method, "steps": n, "seconds": seconds}
                row |= {"error_psi": abs(found / psi - 1.0)}
                rows.append({**row, "error_deflection": error(last[code, method, n])})
            rows[place]["seconds"] = min(seconds, rows[place]["seconds"])
            progress((repetition + (place + 1) / len(runs)) / (repetitions + 1))
    finest = [at_instants(last[EXUDYN, TRAPEZOIDAL, n]) for n in steps[-2:]]
    # of second order, with twice as many steps
    extrapolated = finest[1] + (finest[1] - finest[0]) / 3.0

    method = Method(problem.integrator.steps, 3)
    actions: dict[str, Any] = {
        "value": partial(problem.value, x),
        "gradient": partial(problem.gradient, x),
        "reduction": partial(body.reduce, x),
    }
    times, _ = measure(actions, repetitions, lambda _: None, process_time, untimed=0)
    value, gradient, reduction = (min(spent) for spent in times.values())
    simulations = [simulate(given, crank, method) for _ in range(repetitions)]
    setup = min(simulation.seconds_model for simulation in simulations)
    motion = min(simulation.seconds for simulation in simulations)
    return {
        "rows": rows,
        "elements": body.domain.n_cells_global,
        "modes": body.n_elastic,
        "duration": crank.duration,
        "psi": psi,
        "reference": reference,
        "reference_error_psi": abs(psi_half / psi - 1.0),
        "reference_error_deflection": error(q_half),
        "deflection": size,
        "agreement": float(np.max(np.abs(extrapolated - exact)) / np.max(np.abs(exact))),
        "value": value,
        "gradient": gradient,
        "steps": problem.integrator.steps,
        "exudyn_value": reduction + setup + motion,
        "reduction": reduction,
        "exudyn_setup": setup,
    }


def memory_of_motion(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], steps: int
) -> dict[str, float]:
    """Measure the peak of memory of one simulation of the reduced rod."""
    problem = slider_crank(comm, elements, steps=2)
    body = problem.flexible["rod"]
    integrals = {"rod": problem.value(holes_design(body.domain)).bodies["rod"].integrals}

    def run(steps: int) -> None:
        method = ffr.GeneralizedAlpha(problem.integrator.end_time, steps)
        ffr.MechanicalProblem(problem.mechanism, method, problem.objective).value(integrals)

    return beyond(lambda: run(2), lambda: run(steps))
