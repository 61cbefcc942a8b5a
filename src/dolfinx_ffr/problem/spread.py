# SPDX-License-Identifier: MIT
"""Load cases spread over the ranks, each computed on one of them.

A reduced model is small and cannot be distributed, but several can be simulated side by side. All
ranks know the result, as if each had computed it itself: numbers, warnings, errors. A single load
case is computed on every rank, which is faster than to send it.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from typing import Any, TypeVar

from mpi4py import MPI

from ..body import VolumeIntegrals
from ..dynamics import (
    Bars,
    SimulationError,
    StepChoice,
    TimeInterval,
    Trajectory,
    adjoint,
    check_memory,
    integrate,
    required_memory,
    restored,
    warn_of_limits,
)
from ..mechanical_problem import MechanicalProblem, moves, through_trajectory
from ..objective import Derivatives, Response
from ..parallel import gathered, on_every_rank
from .bodies import DesignedBodies

Key = TypeVar("Key", bound=Hashable)
Bodies = Mapping[str, VolumeIntegrals]
#: A load case, and the label of the number that is differentiated
Job = tuple[str, str]

WORK = "the evaluation of a problem"  #: The name of the sections in messages
INSTANTS = 2000  #: Taken where the steps follow from a tolerance
Cases = Mapping[str, MechanicalProblem]

#: Densities of design elements at which time steps are chosen
FILLED = (0.5, 1.0)


def owners(costs: Mapping[Key, float], ranks: int) -> dict[Key, int]:
    """The rank that computes each load case, so that all ranks end at about the same time.

    The largest of the ``costs`` first, each to the rank that has least to do: at most 4/3 of the
    least time (R. L. Graham, SIAM Journal on Applied Mathematics 17 (1969), doi:10.1137/0117039).
    """
    load, found = [0.0] * ranks, dict.fromkeys(costs, 0)
    for key in sorted(costs, key=lambda key: -costs[key]):
        rank = min(range(ranks), key=lambda rank: load[rank])
        found[key] = rank
        load[rank] += costs[key]
    return found


def trajectories(
    comm: MPI.Comm, cases: Mapping[str, MechanicalProblem], bodies: Bodies, *, warn: bool = True
) -> dict[str, Trajectory | None]:
    """The trajectories of load cases of the same ``bodies``, alike on every rank.

    None where nothing depends on a trajectory. With ``warn`` their limits are warned of. Errors of
    the simulation are raised on every rank, of several load cases the first one's.
    """
    several, found = len(cases) > 1, dict[str, Trajectory | None]()
    failed: dict[str, SimulationError] = {}
    said: dict[str, list[tuple[type[Warning], str]]] = {}
    costs = {name: _cost(case, bodies) for name, case in cases.items()}
    with on_every_rank(comm, WORK):
        for name in _mine(comm, costs) if several else cases:
            case = cases[name]
            with _recorded(name, said) if several else nullcontext():
                if not case.needs_trajectory:
                    found[name] = case.trajectory(bodies)
                    continue
                try:
                    simulated = integrate(case.mechanism, bodies, case.integrator)
                except SimulationError as error:
                    if warn:
                        warn_of_limits(error.trajectory, complete=False)
                    if not several:
                        raise
                    failed[name] = error
                else:
                    found[name] = simulated
                    if warn:
                        warn_of_limits(simulated)
    if not several:
        return found
    numbers = {name: each and each.numbers for name, each in found.items()}
    texts = {name: str(error) for name, error in failed.items()}
    sent = gathered(comm, "the load cases of a problem", (numbers, said, texts))
    every, warned, errors = (_joined([each[part] for each in sent]) for part in range(3))
    with on_every_rank(comm, WORK):
        for name, case in cases.items():
            for category, text in warned[name]:
                warnings.warn(f"load case {name!r}: {text}", category, stacklevel=4)
            if name in errors:
                own = failed[name].trajectory if name in failed else None
                raise SimulationError(f"load case {name!r}: {errors[name]}", own)  # type: ignore[arg-type]
            if name not in found:
                given = every[name]
                found[name] = given and restored(case.mechanism, bodies, case.integrator, given)
    return {name: found[name] for name in cases}


def adjoints(
    comm: MPI.Comm, responses: Mapping[str, Response], direct: Mapping[Job, Derivatives]
) -> dict[Job, Derivatives]:
    """The derivatives by all integrals and by parameters through the trajectories.

    The ``responses`` are given by load case, the partial derivatives ``direct`` by load case and
    label.
    """
    several, found = len(responses) > 1, dict[Job, Derivatives]()
    costs = {}
    for job, part in direct.items():
        known = responses[job[0]].simulated
        costs[job] = 0.0 if known is None or part.trajectory is None else float(known.y.size)
    with on_every_rank(comm, WORK):
        mine = _mine(comm, costs) if several else list(direct)
        for case in dict.fromkeys(name for name, _ in mine):
            with _named(case) if several else nullcontext():
                own, pulled = [job for job in mine if job[0] == case], dict[Job, Bars]()
                for job in own:
                    response, bar = responses[case], direct[job].trajectory
                    if bar is not None and moves(direct[job], response):
                        pulled[job] = adjoint(response.trajectory, bar)
                found |= through_trajectory(responses[case], own, pulled)
    every = _joined(gathered(comm, "the adjoints of a problem", found)) if several else found
    return {job: every[job] for job in direct}


def _mine(comm: MPI.Comm, costs: Mapping[Key, float]) -> list[Key]:
    """The keys that this rank works at."""
    return [key for key, rank in owners(costs, comm.size).items() if rank == comm.rank]


def _cost(case: MechanicalProblem, bodies: Bodies) -> float:
    """Steps times coordinates, to which the time of a simulation is about proportional."""
    space = any(body.dimension == 3 for body in bodies.values())
    coordinates = sum((6 if space else 3) + body.modes for body in bodies.values())
    # most joints leave one coordinate of a body free, in the plane and in space
    size = coordinates + (5 if space else 2) * len(case.mechanism.joints)
    return float((case.integrator.instants or INSTANTS) * size) * case.needs_trajectory


def _joined(parts: Sequence[Mapping[Key, Any]]) -> dict[Key, Any]:
    return {key: value for part in parts for key, value in part.items()}


@contextmanager
def _named(case: str) -> Iterator[None]:
    """Add the name of the load case to errors raised within."""
    try:
        yield
    except Exception as error:
        error.add_note(f"in load case {case!r}")
        raise


@contextmanager
def _recorded(case: str, said: dict[str, list[tuple[type[Warning], str]]]) -> Iterator[None]:
    """Keep the warnings within for all ranks, and name the load case in errors."""
    with warnings.catch_warnings(record=True) as caught, _named(case):
        warnings.simplefilter("always")
        yield
    said[case] = [(entry.category, str(entry.message)) for entry in caught]


def checked_memory(bodies: DesignedBodies, cases: Cases, available: int, *, adjoint: bool) -> None:
    """Refuse trajectories that take more than the memory ``available`` [bytes]."""
    modes, space = bodies.modes.values(), bodies.space
    needed = {n: m.integrator for n, m in cases.items() if m.needs_trajectory}
    with on_every_rank(bodies.comm, WORK):
        taken = {n: required_memory(each, modes, space=space) for n, each in needed.items()}
        for name, integrator in needed.items():
            # all trajectories are kept, one adjoint is computed at a time
            left = available - sum(taken.values()) + taken[name]
            check_memory(integrator, modes, left, adjoint=adjoint, space=space)


def chosen_before(bodies: DesignedBodies, cases: Cases) -> dict[str, MechanicalProblem]:
    """The load cases with method and steps in the place of time intervals.

    Half filled and full bodies are judged, and the costlier choice counts.
    """
    asked = {
        name: case.integrator
        for name, case in cases.items()
        if isinstance(case.integrator, TimeInterval) and case.needs_trajectory
    }
    found: dict[str, StepChoice] = {}
    for share in FILLED if asked else ():
        given = bodies.response(bodies.reduce(bodies.filled(share)))
        with on_every_rank(bodies.comm, "the choice of time steps"):
            for name, interval in asked.items():
                choice = cases[name].choice(given, interval)
                before = found.get(name)
                if before is not None and before.cost >= choice.cost:
                    choice = replace(before, error=max(before.error, choice.error))
                found[name] = choice
    return _stepping(bodies.comm, cases, found)


def chosen_again(
    comm: MPI.Comm, cases: Cases, responses: Mapping[str, Response]
) -> dict[str, MechanicalProblem]:
    """The load cases, with steps chosen anew where those chosen before do not suffice."""
    found: dict[str, StepChoice] = {}
    with on_every_rank(comm, "the choice of time steps"):
        for name, case in cases.items():
            asked = case.integrator.chosen_for
            if asked is None or responses[name].simulated is None:
                continue
            interval = TimeInterval(case.integrator.end_time, asked)
            choice = case.choice(responses[name], interval)
            if choice.integrator != case.integrator:
                found[name] = choice
    return _stepping(comm, cases, found)


def _stepping(
    comm: MPI.Comm, cases: Cases, found: Mapping[str, StepChoice]
) -> dict[str, MechanicalProblem]:
    """The load cases with the steps that rank 0 has chosen for some of them, and prints."""
    stepping = dict(cases)
    for name, choice in comm.bcast(dict(found)).items():
        stepping[name] = cases[name].stepping(choice)
        if comm.rank == 0:
            of = "" if len(cases) == 1 else f"load case {name!r}: "
            print(f"dolfinx_ffr: {of}{choice}", file=sys.stderr)
    return stepping
