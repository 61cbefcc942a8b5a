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
from ..mechanical_problem import MechanicalProblem, depends_on_motion, through_trajectory
from ..objective import Derivatives, Response
from ..parallel import gathered, on_every_rank
from .bodies import DesignedBodies

Key = TypeVar("Key", bound=Hashable)
Bodies = Mapping[str, VolumeIntegrals]
#: A load case, and the label of the number that is differentiated
Job = tuple[str, str]

Cases = Mapping[str, MechanicalProblem]

#: The name of the sections in messages
WORK = "the evaluation of a problem"
#: Assumed number of steps where they follow from a tolerance
INSTANTS = 2000
#: Densities of the designed elements at which time steps are chosen
FILLED = (0.5, 1.0)


def owners(costs: Mapping[Key, float], ranks: int) -> dict[Key, int]:
    """The rank that computes each load case, so that all ranks end at about the same time.

    In the order of their ``costs``, the largest first, each goes to the rank with the least load.
    This takes at most 4/3 of the least possible time (R. L. Graham, SIAM Journal on Applied
    Mathematics 17 (1969), doi:10.1137/0117039).
    """
    load, rank_of = [0.0] * ranks, dict.fromkeys(costs, 0)
    for key in sorted(costs, key=lambda key: -costs[key]):
        rank = min(range(ranks), key=lambda rank: load[rank])
        rank_of[key] = rank
        load[rank] += costs[key]
    return rank_of


def trajectories(
    comm: MPI.Comm, cases: Mapping[str, MechanicalProblem], bodies: Bodies, *, warn: bool = True
) -> dict[str, Trajectory | None]:
    """The trajectories of load cases of the same ``bodies``, alike on every rank.

    A trajectory is None where nothing depends on it. With ``warn`` its limits are warned of. Errors
    of the simulation are raised on every rank; of several load cases the first error counts.
    """
    several, by_case = len(cases) > 1, dict[str, Trajectory | None]()
    failed: dict[str, SimulationError] = {}
    recorded: dict[str, list[tuple[type[Warning], str]]] = {}
    costs = {name: _cost(case, bodies) for name, case in cases.items()}
    with on_every_rank(comm, WORK):
        for name in _mine(comm, costs) if several else cases:
            case = cases[name]
            with _recorded(name, recorded) if several else nullcontext():
                if not case.needs_trajectory:
                    by_case[name] = case.trajectory(bodies)
                    continue
                try:
                    simulated = integrate(case.mechanism, bodies, case.method)
                except SimulationError as error:
                    if warn:
                        warn_of_limits(error.trajectory, complete=False)
                    if not several:
                        raise
                    failed[name] = error
                else:
                    by_case[name] = simulated
                    if warn:
                        warn_of_limits(simulated)
    if not several:
        return by_case
    numbers = {name: trajectory and trajectory.numbers for name, trajectory in by_case.items()}
    texts = {name: str(error) for name, error in failed.items()}
    messages = gathered(comm, "the load cases of a problem", (numbers, recorded, texts))
    all_numbers, all_warnings, errors = (
        _joined([message[item] for message in messages]) for item in range(3)
    )
    with on_every_rank(comm, WORK):
        for name, case in cases.items():
            for category, text in all_warnings[name]:
                warnings.warn(f"load case {name!r}: {text}", category, stacklevel=4)
            if name in errors:
                trajectory = failed[name].trajectory if name in failed else None
                raise SimulationError(f"load case {name!r}: {errors[name]}", trajectory)  # type: ignore[arg-type]
            if name not in by_case:
                numbers_of_case = all_numbers[name]
                by_case[name] = numbers_of_case and restored(
                    case.mechanism, bodies, case.method, numbers_of_case
                )
    return {name: by_case[name] for name in cases}


def adjoints(
    comm: MPI.Comm, responses: Mapping[str, Response], direct: Mapping[Job, Derivatives]
) -> dict[Job, Derivatives]:
    """The derivatives by all integrals and by parameters through the trajectories.

    Args:
        comm: The ranks, among which the jobs are spread.
        responses: Responses by load case.
        direct: Partial derivatives by load case and label.
    """
    several = len(responses) > 1
    costs = {}
    for job, partial in direct.items():
        trajectory = responses[job[0]].simulated
        costs[job] = (
            0.0 if trajectory is None or partial.trajectory is None else float(trajectory.y.size)
        )
    by_job: dict[Job, Derivatives] = {}
    with on_every_rank(comm, WORK):
        jobs_of_rank = _mine(comm, costs) if several else list(direct)
        for case in dict.fromkeys(name for name, _ in jobs_of_rank):
            response, bars = responses[case], {}
            jobs_of_case = [job for job in jobs_of_rank if job[0] == case]
            with _named(case) if several else nullcontext():
                for job in jobs_of_case:
                    trajectory_bar = direct[job].trajectory
                    if trajectory_bar is not None and depends_on_motion(direct[job], response):
                        bars[job] = adjoint(response.trajectory, trajectory_bar)
                by_job |= through_trajectory(response, jobs_of_case, bars)
    if several:
        by_job = _joined(gathered(comm, "the adjoints of a problem", by_job))
    return {job: by_job[job] for job in direct}


def _mine(comm: MPI.Comm, costs: Mapping[Key, float]) -> list[Key]:
    """The keys that this rank works at."""
    return [key for key, rank in owners(costs, comm.size).items() if rank == comm.rank]


def _cost(case: MechanicalProblem, bodies: Bodies) -> float:
    """Steps times coordinates, to which the time of a simulation is about proportional."""
    if not case.needs_trajectory:
        return 0.0
    space = any(body.dimension == 3 for body in bodies.values())
    coordinates = sum((6 if space else 3) + body.modes for body in bodies.values())
    # most joints leave one coordinate of a body free, in the plane and in space
    size = coordinates + (5 if space else 2) * len(case.mechanism.joints)
    return float((case.method.instants or INSTANTS) * size)


def _joined(mappings: Sequence[Mapping[Key, Any]]) -> dict[Key, Any]:
    """One mapping with the entries of all."""
    return {key: value for mapping in mappings for key, value in mapping.items()}


@contextmanager
def _named(case: str) -> Iterator[None]:
    """A context in which the name of the load case is added to errors."""
    try:
        yield
    except Exception as error:
        error.add_note(f"in load case {case!r}")
        raise


@contextmanager
def _recorded(case: str, recorded: dict[str, list[tuple[type[Warning], str]]]) -> Iterator[None]:
    """A context in which warnings go into ``recorded[case]``, and errors name the load case."""
    with warnings.catch_warnings(record=True) as caught, _named(case):
        warnings.simplefilter("always")
        yield
    recorded[case] = [(entry.category, str(entry.message)) for entry in caught]


def checked_memory(bodies: DesignedBodies, cases: Cases, available: int, *, adjoint: bool) -> None:
    """Refuse trajectories that take more than the memory ``available`` [bytes].

    A `TimeInterval` is not checked before its steps are chosen.
    """
    modes, space = bodies.modes.values(), bodies.space
    integrators = {
        name: case.integrator
        for name, case in cases.items()
        if case.needs_trajectory and not isinstance(case.integrator, TimeInterval)
    }
    with on_every_rank(bodies.comm, WORK):
        memory = {
            name: required_memory(integrator, modes, space=space)
            for name, integrator in integrators.items()
        }
        for name, integrator in integrators.items():
            # all trajectories are stored, one adjoint is computed at a time
            remaining = available - sum(memory.values()) + memory[name]
            check_memory(integrator, modes, remaining, adjoint=adjoint, space=space)


def with_first_steps(bodies: DesignedBodies, cases: Cases) -> dict[str, MechanicalProblem]:
    """The load cases with method and steps in the place of time intervals.

    Steps are chosen for half filled and for full bodies, and the costlier choice is used.
    """
    intervals = {
        name: case.integrator
        for name, case in cases.items()
        if isinstance(case.integrator, TimeInterval) and case.needs_trajectory
    }
    choices: dict[str, StepChoice] = {}
    for share in FILLED if intervals else ():
        response = bodies.response(bodies.reduce(bodies.filled(share)))
        with on_every_rank(bodies.comm, "the choice of time steps"):
            for name, interval in intervals.items():
                choice = cases[name].choose_steps(response, interval)
                earlier = choices.get(name)
                if earlier is not None and earlier.cost >= choice.cost:
                    choice = replace(earlier, error=max(earlier.error, choice.error))
                choices[name] = choice
    return _with_choices(bodies.comm, cases, choices)


def with_better_steps(
    comm: MPI.Comm, cases: Cases, responses: Mapping[str, Response]
) -> dict[str, MechanicalProblem]:
    """The load cases, with steps chosen anew where the earlier choice does not suffice."""
    choices: dict[str, StepChoice] = {}
    with on_every_rank(comm, "the choice of time steps"):
        for name, case in cases.items():
            if responses[name].simulated is None:
                continue
            tolerance = case.method.chosen_for
            if tolerance is None:
                continue
            interval = TimeInterval(case.integrator.end_time, tolerance)
            choice = case.choose_steps(responses[name], interval)
            if choice.integrator != case.integrator:
                choices[name] = choice
    return _with_choices(comm, cases, choices)


def _with_choices(
    comm: MPI.Comm, cases: Cases, choices: Mapping[str, StepChoice]
) -> dict[str, MechanicalProblem]:
    """The load cases with the steps that rank 0 has chosen for some of them; it prints these."""
    changed = dict(cases)
    for name, choice in comm.bcast(dict(choices)).items():
        changed[name] = cases[name].with_steps(choice)
        if comm.rank == 0:
            prefix = "" if len(cases) == 1 else f"load case {name!r}: "
            print(f"dolfinx_ffr: {prefix}{choice}", file=sys.stderr)
    return changed
