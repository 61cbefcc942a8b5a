# SPDX-License-Identifier: MIT
"""The motions of the slider-cranks of the demos, in the plane and in space, by us and by Exudyn.

Both codes get the same reduced rod in the same floating frame, so that only the time integration is
left to differ.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
import scipy.sparse
from jobs import Progress
from memory import peak_memory, reset_peak_memory
from numpy.typing import NDArray
from peer_exudyn import (
    AddedNode,
    Crank,
    ExudynRod,
    Method,
    Simulation,
    rod_for_exudyn,
    save_rod,
    simulate,
)
from peer_report import ALPHA, EXUDYN, INSTANTS, OURS, RADAU, TRAPEZOIDAL
from scene import (
    demo,
    holes_design,
    slider_crank,
    slider_crank_numbers,
    spatial_slider_crank,
)

import dolfinx_ffr as ffr

__all__ = ["exudyn_rod", "memory_of_motion", "seconds_of", "slider_crank_times"]

Array = NDArray[np.float64]
#: Length of the fork of the universal joint for Exudyn [m]: any does
FORK = 0.05


def exudyn_rod(
    body: ffr.FlexibleBody, reduced: ffr.ReducedBody, point_mass: float, *, fork: float = FORK
) -> ExudynRod:
    """A reduced rod as Exudyn takes it, with a point mass at its interface ``"right"``.

    Args:
        body: On one rank.
        reduced: The body at one density.
        point_mass: [kg].
        fork: In space there is also a node without mass at this distance along the rod's y axis
            from the center of its interface ``"left"``, with which it moves: the node before the
            last [m].
    """
    markers, matrices = reduced.integrals.markers, body.factored(reduced).matrices
    mass, stiffness = (
        scipy.sparse.csr_matrix(matrix.getValuesCSR()[::-1], shape=matrix.getSize())
        for matrix in (matrices.mass, matrices.stiffness)
    )
    left, right = markers["left"], markers["right"]
    added = [AddedNode(right.position, right.displacement, point_mass)]
    if body.domain.dimension == 3:
        arm = fork * np.array([0.0, 1.0, 0.0])
        turned = np.cross(left.rotation, arm[:, None], axis=0)
        added.insert(0, AddedNode(left.position + arm, left.displacement + turned))
    return rod_for_exudyn(body.reduction.reference, mass, stiffness, reduced.basis.shapes, added)


def scene_of(comm: MPI.Comm, elements: list[int]) -> tuple[ffr.Problem, Crank, float]:
    """The slider-crank of the plane or of space, its crank for Exudyn, the slider's mass [kg].

    Args:
        comm: One rank.
        elements: Of the rod, along as many axes as the scene has.
    """
    if len(elements) == 2:
        radius, turns, duration, slider = slider_crank_numbers()
        return (
            slider_crank(comm, (elements[0], elements[1]), steps=2000),
            Crank(radius, turns, duration),
            slider,
        )
    problem = spatial_slider_crank(comm, (elements[0], elements[1], elements[2]))
    reference, placement = demo("spatial_slider_crank"), problem.mechanism.placements["rod"]
    crank = Crank(
        reference.CRANK,
        reference.TURNS,
        reference.DURATION,
        axes=(1, 2),
        held=(0,),
        place=tuple(placement.position),
        rotation=tuple(map(tuple, np.asarray(placement.rotation))),
        # the fork stays in the plane of the crank, the slider on its line
        guides=((-2, (1, 0, 0)), (-1, (0, 1, 1))),
    )
    return problem, crank, reference.SLIDER


def slider_crank_times(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: list[int],
    steps: list[int],
    stages: list[int],
    reference: int,
    repetitions: int,
    rod: str = "",
) -> dict[str, Any]:
    """Measure the slider-crank by both codes, method by method and step by step.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        elements: Along and across; three numbers for the slider-crank in space.
        steps: Of the methods of second order.
        stages: Steps of Radau IIA.
        reference: Steps of Radau IIA that count as exact.
        repetitions: Turns through all settings; the fastest of them counts, by CPU time.
        rod: File for the rod, for other processes.
    """
    problem, crank, slider = scene_of(comm, elements)
    body = problem.flexible["rod"]
    x = holes_design(body.domain)
    reduced = problem.gradient(x).bodies["rod"]
    given = exudyn_rod(body, reduced, slider)
    if rod:
        save_rod(Path(rod), given)
    K, middle = reduced.integrals.K, _middle(given)

    def ours(integrator: ffr.Integrator) -> tuple[float, float, Array]:
        mechanical = ffr.MechanicalProblem(problem.mechanism, integrator, problem.objective)
        start = process_time()
        found = mechanical.value({"rod": reduced.integrals})
        seconds = process_time() - start
        assert found.trajectory is not None
        q = found.trajectory.elastic("rod")
        q = q[:: found.trajectory.integrator.stages]  # the stages of Radau IIA left out
        return seconds, found.psi, q

    def exudyn(method: Method) -> tuple[float, float, Array]:
        found = simulate(given, crank, method)
        return found.seconds, _integral(found, K), found.q

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
    best: dict[int, float] = {}
    rows: list[dict[str, Any]] = []
    finest: list[Array] = []  # of Exudyn's trapezoidal rule
    for repetition in range(repetitions):
        for place, (code, method, n, run) in enumerate(runs):
            seconds, found, q = run()
            best[place] = min(seconds, best.get(place, np.inf))
            if repetition == 0:
                errors = {"error_psi": abs(found / psi - 1.0), "error_deflection": error(q)}
                rows.append({"code": code, "method": method, "steps": n, **errors})
                if (code, method) == (EXUDYN, TRAPEZOIDAL) and n in steps[-2:]:
                    finest.append(at_instants(q))
            progress((repetition + (place + 1) / len(runs)) / (repetitions + 1))
    for place, row in enumerate(rows):
        row["seconds"] = best[place]
    # of second order, with twice as many steps
    extrapolated = finest[1] + (finest[1] - finest[0]) / 3.0

    value, gradient, reduction, setup, motion = ([] for _ in range(5))
    for _ in range(repetitions):
        value.append(seconds_of(lambda: problem.value(x)))
        gradient.append(seconds_of(lambda: problem.gradient(x)))
        reduction.append(seconds_of(lambda: body.reduce(x)))
        simulation = simulate(given, crank, Method(problem.integrator.steps, 3))
        setup.append(simulation.seconds_model)
        motion.append(simulation.seconds)
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
        "value": min(value),
        "gradient": min(gradient),
        "steps": problem.integrator.steps,
        "exudyn_value": min(reduction) + min(setup) + min(motion),
        "reduction": min(reduction),
        "exudyn_setup": min(setup),
    }


def _integral(found: Simulation, K: Array) -> float:
    """The integral compliance by the trapezoidal rule."""
    compliance = np.sum((found.q @ K) * found.q, axis=1)
    return float(np.sum(np.diff(found.t) * 0.5 * (compliance[1:] + compliance[:-1])))


def _middle(rod: ExudynRod) -> Array:
    """The shape functions across the rod at the node nearest to its middle, shape (r,)."""
    target = np.array([0.5 * rod.positions[-1, 0], 0.0, 0.0])
    node = int(np.argmin(np.linalg.norm(rod.positions - target, axis=1)))
    return rod.modes[3 * node + 1]


def memory_of_motion(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], steps: int
) -> dict[str, float]:
    """Measure the peak of memory of one simulation of the reduced rod.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        elements: Along and across.
        steps: Of generalised-alpha.
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


def seconds_of(action: Callable[[], Any]) -> float:
    """The CPU time of an action [s]."""
    start = process_time()
    action()
    return process_time() - start
