# SPDX-License-Identifier: MIT
"""This package beside others from PyPI: Exudyn for the motion, pyMOTO for the static limit.

Each pair computes the same model, so that only time integration and solvers are left to differ, and
time can be read beside error. The codes take turns; memory is measured in processes of their own.
"""

import atexit
import tempfile
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Array, Job, Progress, beyond, measure
from numpy.typing import NDArray
from peer_pymoto import FLOOR, SOLVERS, Plate, PymotoPlate, random_density
from peer_report import OURS
from peer_report import report_peers as report_peers
from scene import demo

import dolfinx_ffr as ffr


def peers_jobs(*, quick: bool) -> list[Job]:
    """The measurements."""
    folder = tempfile.TemporaryDirectory(prefix="dolfinx_ffr-peers.")
    atexit.register(folder.cleanup)
    rod = str(Path(folder.name) / "rod.npz")
    elements = [60, 6] if quick else [200, 20]
    steps = [500, 1000, 2000] if quick else [500, 1000, 2000, 4000, 8000, 16000]
    stages = [50, 100] if quick else [50, 100, 200, 400, 800, 1600]
    plates = [[24, 8], [48, 16]] if quick else [[60, 20], [120, 40], [240, 80], [480, 160]]
    repetitions = 1 if quick else 5
    plane = {
        **{"elements": elements, "steps": steps, "stages": stages, "repetitions": repetitions},
        **{"reference": 1600 if quick else 16000, "rod": rod},
    }
    space = {**plane, "elements": [20, 2, 2] if quick else [80, 8, 8], "stages": stages[1:]}
    space |= {"reference": 400 if quick else 6400, "rod": str(Path(folder.name) / "space.npz")}
    scene = demo("slider_crank")
    crank = {"rod": rod, "crank": [scene.CRANK, scene.TURNS, scene.DURATION], "steps": steps[-1]}
    jobs = [
        Job("peer_motion", "slider_crank_times", 6.0 if quick else 50.0, plane),
        Job("peer_motion", "slider_crank_times", 10.0 if quick else 150.0, space),
        Job("peer_motion", "memory_of_motion", 3.0, {"elements": elements, "steps": steps[-1]}),
        Job("peer_exudyn", "memory_of_exudyn", 2.0, crank),
    ]
    for size in plates:
        seconds = 2.0 if quick else 3.0 + size[0] * size[1] / 4000.0
        own = {"elements": size, "repetitions": 2 if quick else 5}
        jobs.append(Job("peers", "plate_times", seconds, own))
    jobs.append(Job("peers", "memory_of_plate", 3.0, {"elements": plates[-1]}))
    for solver in SOLVERS[-1:] if quick else SOLVERS:
        own = {"elements": plates[-1], "solver": solver}
        jobs.append(Job("peer_pymoto", "memory_of_pymoto", 2.0, own))
    return jobs


def plate_problem(comm: MPI.Comm, plate: Plate) -> ffr.Problem:
    """The plate as a mechanism at rest: psi is its compliance during one second.

    The left interface is welded to the ground, the right one slides; the motion starts in the
    static equilibrium, and stays there. With constraint modes alone its displacement is exactly
    that of the finite elements, because nothing but the interfaces is loaded.
    """
    nx, ny = plate.elements
    length = nx * plate.element
    domain = ffr.Domain.rectangle(comm, length, 1.0, elements=(nx, ny), solid_columns=0)
    material = ffr.PlaneStress(
        young=plate.young, poisson=plate.poisson, density=7850.0, thickness=plate.thickness
    )
    simp, frame = ffr.SIMP(floor=FLOOR), ffr.TangentFrame("left")
    body = ffr.FlexibleBody(domain, material, frame=frame, modes=0, interpolation=simp)
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
    """The place of each cell in the order row after row."""
    nx = plate.elements[0]
    i, j = np.floor((centroids + np.array([0.0, 0.5])) / plate.element).astype(np.int64).T
    return i + nx * j


def plate_times(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], repetitions: int
) -> dict[str, Any]:
    """Measure compliance and gradient at a density by both codes, in turns."""
    plate = Plate((elements[0], elements[1]))
    problem = plate_problem(comm, plate)
    place = row_after_row(plate, problem.flexible["plate"].domain.centroids)
    x = random_density(plate.elements)
    evaluation = problem.gradient(x[place])
    exact = np.empty_like(x)
    exact[place] = evaluation.gradient["plate"]
    theirs = {solver: PymotoPlate(plate, solver) for solver in SOLVERS}
    differences = {}
    for solver, peer in theirs.items():
        c, g = peer.gradient(x)
        away = float(np.linalg.norm(g - exact) / np.linalg.norm(exact))
        differences[solver] = (abs(c / evaluation.psi - 1.0), away)
    actions: dict[str, Any] = {OURS: partial(problem.gradient, x[place])}
    actions |= {solver: partial(peer.gradient, x) for solver, peer in theirs.items()}
    seconds, _ = measure(actions, repetitions, progress, process_time, untimed=0)
    times = {name: min(spent) for name, spent in seconds.items()}
    unknowns = problem.flexible["plate"].elasticity.n_dofs_global
    return {"seconds": times, "differences": differences, "unknowns": unknowns}


def memory_of_plate(comm: MPI.Comm, progress: Progress, *, elements: list[int]) -> dict[str, float]:
    """Measure the peak of memory of one compliance and its gradient."""

    def run(nx: int, ny: int) -> None:
        plate_problem(comm, Plate((nx, ny))).gradient(random_density((nx, ny)))

    return beyond(lambda: run(6, 2), lambda: run(*elements))
