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
from collections.abc import Iterator
from copy import copy
from pathlib import Path
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from jobs import Job, Progress
from memory import peak_memory, reset_peak_memory
from numpy.typing import NDArray
from peer_motion import exudyn_rod, seconds_of
from peer_pymoto import FLOOR, SOLVERS, Plate, PymotoPlate, random_density
from peer_report import (
    OURS,
    PYMOTO,
    RADIUS,
    report_peers,
)
from scene import slider_crank_numbers

import dolfinx_ffr as ffr

__all__ = [
    "exudyn_rod",
    "memory_of_plate",
    "peers_jobs",
    "plate_designs",
    "plate_problem",
    "plate_times",
    "report_peers",
    "row_after_row",
]

Array = NDArray[np.float64]
#: Share of the plate that its design may fill.
VOLUME = 0.5


def peers_jobs(*, quick: bool) -> list[Job]:
    """The measurements.

    Args:
        quick: Small meshes and few repetitions.
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
            "peer_motion",
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
        Job(
            "peer_motion",
            "slider_crank_times",
            10.0 if quick else 150.0,
            {
                "elements": [20, 2, 2] if quick else [80, 8, 8],
                "steps": steps,
                "stages": stages[1:],
                "reference": 400 if quick else 6400,
                "repetitions": 1 if quick else 5,
            },
        ),
        Job("peer_motion", "memory_of_motion", 3.0, {"elements": elements, "steps": steps[-1]}),
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


# ---------------------------------------------------------------------- the static limit


def plate_problem(comm: MPI.Comm, plate: Plate) -> ffr.Problem:
    """The plate as a mechanism at rest: psi is its compliance during one second.

    The left interface is welded to the ground, the right one slides; the motion starts in the
    static equilibrium, and stays there. With constraint modes alone its displacement is exactly
    that of the finite elements, because nothing but the interfaces is loaded.

    Args:
        comm: One rank.
        plate: What is loaded.
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
    """The place of each cell in the order row after row."""
    nx = plate.elements[0]
    i, j = np.floor((centroids + np.array([0.0, 0.5])) / plate.element).astype(np.int64).T
    return i + nx * j


def plate_times(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], repetitions: int
) -> dict[str, Any]:
    """Measure compliance and gradient at a density by both codes, in turns.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        elements: Along and across.
        repetitions: The fastest of them counts.
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
        times[OURS] = min(times[OURS], seconds_of(lambda: problem.gradient(x[place])))
        for solver, peer in theirs.items():
            times[solver] = min(times[solver], seconds_of(lambda peer=peer: peer.gradient(x)))
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
        comm: One rank.
        progress: Told the part that is done.
        elements: Along and across.
    """
    small = Plate((6, 2))
    plate_problem(comm, small).gradient(random_density(small.elements))
    base = reset_peak_memory()
    plate = Plate((elements[0], elements[1]))
    plate_problem(comm, plate).gradient(random_density(plate.elements))
    return {"base": base, "beyond": peak_memory() - base}


class _Race:
    """Lets pyMOTO do an iteration after each of ours, and keeps the time of each apart.

    Args:
        peer: pyMOTO's iterations.
    """

    def __init__(self, peer: Iterator[tuple[Array, float]]) -> None:
        self._peer = peer
        self.ours: dict[str, list[float]] = {"seconds": [], "compliance": []}
        self.theirs: dict[str, list[float]] = {"seconds": [], "compliance": []}
        self.variables: Array = np.zeros(0)
        self._mark = process_time()

    def __call__(self, iteration: int, x: Any, evaluation: ffr.Evaluation) -> None:
        """Note our iteration, and do one of pyMOTO's."""
        self._note(self.ours, evaluation.psi)
        self.variables, compliance = next(self._peer)
        self._note(self.theirs, compliance)

    def _note(self, run: dict[str, list[float]], compliance: float) -> None:
        now = process_time()
        run["seconds"].append((run["seconds"] or [0.0])[-1] + now - self._mark)
        run["compliance"].append(compliance)
        self._mark = now


class _Flat(ffr.DensityDesign):
    """A filtered density whose projection is the identity, to seven digits, all along a run."""

    def at(self, progress: float) -> _Flat:
        other = copy(self)
        other.projection = ffr.HeavisideProjection(1e-3)
        return other


def plate_designs(
    comm: MPI.Comm, progress: Progress, *, elements: list[int], iterations: int
) -> dict[str, Any]:
    """Design the plate by both codes: the same filter, each with its own moving asymptotes.

    Args:
        comm: One rank.
        progress: Told the part that is done.
        elements: Along and across.
        iterations: Of each.
    """
    plate = Plate((elements[0], elements[1]))
    problem = plate_problem(comm, plate)
    domain = problem.flexible["plate"].domain
    design = _Flat(domain, radius=RADIUS * plate.element)
    order = np.argsort(row_after_row(plate, domain.everywhere(domain.centroids)))
    kernel = design.filter.matrix[order][:, order]
    start = design.even(VOLUME)
    solid = problem.value(np.ones(domain.n_cells)).psi
    race = _Race(PymotoPlate(plate, "CHOLMOD", kernel).design(start, VOLUME))
    result = ffr.optimize(
        problem,
        design,
        start,
        optimizer=ffr.MMA(tolerance=0.0),
        volume=VOLUME,
        iterations=iterations,
        progress=False,
        callback=race,
    )
    runs = {
        OURS: {**race.ours, "volume": result.evaluation.volume["plate"]},
        PYMOTO: {**race.theirs, "volume": float(np.mean(kernel @ race.variables))},
    }
    progress(1.0)
    return {"runs": runs, "solid": solid, "mesh": "x".join(map(str, elements))}
