# SPDX-License-Identifier: MIT
"""Work on several motions, spread over the ranks: one motion is worked at on one rank.

A reduced motion is small and cannot be distributed, but several can be computed side by side. All
ranks know the result, as if each had computed it itself: numbers, warnings, errors.
"""

from __future__ import annotations

import warnings
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from mpi4py import MPI

from ..body import VolumeIntegrals
from ..dynamics import SimulationError, Trajectory, TrajectoryBar, integrate, restored
from ..mechanical_problem import MechanicalProblem, through_motion
from ..objective import Response
from ..parallel import gathered, on_every_rank

__all__ = ["adjoints", "owners", "trajectories"]

Key = TypeVar("Key", bound=Hashable)
Bodies = Mapping[str, VolumeIntegrals]
#: Of a motion that is worked at: the motion and the label of the number that is differentiated
Job = tuple[str, str]

#: Instants that a motion is taken to have whose steps follow from a tolerance
INSTANTS = 2000


def owners(costs: Mapping[Key, float], ranks: int) -> dict[Key, int]:
    """Which rank works at what, so that all are done at about the same time.

    The largest first, each to the rank that has least to do: at most 4/3 of the least time (R. L.
    Graham, SIAM Journal on Applied Mathematics 17 (1969), doi:10.1137/0117039).

    Args:
        costs: Of each piece of work, in any unit.
        ranks: Their number.
    """
    load, found = [0.0] * ranks, dict.fromkeys(costs, 0)
    for key in sorted(costs, key=lambda key: -costs[key]):
        rank = min(range(ranks), key=lambda rank: load[rank])
        found[key] = rank
        load[rank] += costs[key]
    return found


def trajectories(
    comm: MPI.Comm,
    motions: Mapping[str, MechanicalProblem],
    bodies: Bodies,
    *,
    warn: bool = True,
) -> dict[str, Trajectory | None]:
    """The motions of the same bodies; collective.

    A single one is computed on every rank, which is faster than to send it.

    Args:
        comm: All its ranks call.
        motions: By name.
        bodies: Volume integrals of all bodies, by name.
        warn: Whether to warn of the limits of each motion.

    Returns:
        By name of the motion, alike on every rank; None where nothing depends on it.

    Raises:
        SimulationError: On every rank, if a motion cannot be computed; of several the first.
        Exception: On every rank, what the simulation raises else.
    """

    def run(name: str) -> Trajectory | None:
        motion = motions[name]
        if warn or not motion.needs_trajectory:
            return motion.motion(bodies)
        return integrate(motion.mechanism, bodies, motion.integrator)

    if len(motions) == 1:
        with on_every_rank(comm, "the evaluation of a problem"):
            return {name: run(name) for name in motions}
    found: dict[str, Trajectory | None] = {}
    failed: dict[str, SimulationError] = {}
    said: dict[str, list[tuple[type[Warning], str]]] = {}
    with on_every_rank(comm, "the evaluation of a problem"):
        for name in _mine(comm, {name: _cost(motion, bodies) for name, motion in motions.items()}):
            with warnings.catch_warnings(record=True) as caught, _named(name):
                warnings.simplefilter("always")
                try:
                    found[name] = run(name)
                except SimulationError as error:
                    failed[name] = error
            said[name] = [(entry.category, str(entry.message)) for entry in caught]
    numbers = {name: None if motion is None else motion.numbers for name, motion in found.items()}
    texts = {name: str(error) for name, error in failed.items()}
    sent = gathered(comm, "the motions of a problem", (numbers, said, texts))
    every, warned, errors = (_joined([each[part] for each in sent]) for part in range(3))
    with on_every_rank(comm, "the evaluation of a problem"):
        for name, motion in motions.items():
            for category, text in warned[name]:
                warnings.warn(f"motion {name!r}: {text}", category, stacklevel=4)
            if name in errors:
                own = failed[name].trajectory if name in failed else None
                raise SimulationError(f"motion {name!r}: {errors[name]}", own)  # type: ignore[arg-type]
            if name not in found:
                given = every[name]
                found[name] = None
                if given is not None:
                    found[name] = restored(motion.mechanism, bodies, motion.integrator, given)
    return {name: found[name] for name in motions}


def adjoints(
    comm: MPI.Comm,
    responses: Mapping[str, Response],
    bars: Mapping[Job, TrajectoryBar | None],
) -> dict[Job, dict[str, VolumeIntegrals]]:
    """The derivatives of numbers with respect to all integrals through their motions; collective.

    Args:
        comm: All its ranks call.
        responses: Motions and integrals, by name of the motion.
        bars: Derivatives of the numbers with respect to their motions, by motion and label.

    Raises:
        RuntimeError: On every rank, if an adjoint system cannot be solved.
    """
    costs = {}
    for job, bar in bars.items():
        moved = responses[job[0]].trajectory
        costs[job] = 0.0 if moved is None or bar is None else float(moved.y.size)
    found = {}
    with on_every_rank(comm, "the evaluation of a problem"):
        for job in _mine(comm, costs):
            with _named(job[0]):
                found[job] = through_motion(bars[job], responses[job[0]])
    every = _joined(gathered(comm, "the adjoints of a problem", found))
    return {job: every[job] for job in bars}


def _mine(comm: MPI.Comm, costs: Mapping[Key, float]) -> list[Key]:
    """What this rank works at."""
    return [key for key, rank in owners(costs, comm.size).items() if rank == comm.rank]


def _cost(motion: MechanicalProblem, bodies: Bodies) -> float:
    """About proportional to the time that a motion takes: steps times size."""
    coordinates = sum(3 + body.modes for body in bodies.values())
    size = coordinates + 2 * len(motion.mechanism.joints)
    return float((motion.integrator.instants or INSTANTS) * size) * motion.needs_trajectory


def _joined(parts: Sequence[Mapping[Key, Any]]) -> dict[Key, Any]:
    return {key: value for part in parts for key, value in part.items()}


@contextmanager
def _named(motion: str) -> Iterator[None]:
    """Errors raised within say of which motion they are."""
    try:
        yield
    except Exception as error:
        error.add_note(f"in motion {motion!r}")
        raise
