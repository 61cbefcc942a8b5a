# SPDX-License-Identifier: MIT
"""Time steps of a problem's load cases: their memory, and their choice for an accuracy."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace

from mpi4py import MPI

from ..dynamics import StepChoice, TimeInterval, check_memory, required_memory
from ..mechanical_problem import MechanicalProblem
from ..objective import Response
from ..parallel import on_every_rank
from .bodies import DesignedBodies
from .spread import WORK

Cases = Mapping[str, MechanicalProblem]

#: Densities of design elements at which time steps are chosen
FILLED = (0.5, 1.0)


def checked_memory(bodies: DesignedBodies, cases: Cases, available: int, *, adjoint: bool) -> None:
    """Refuse, on every rank, trajectories that take more than the memory ``available`` [bytes]."""
    modes, space = bodies.modes.values(), bodies.space
    needed = {n: m.integrator for n, m in cases.items() if m.needs_trajectory}
    with on_every_rank(bodies.comm, WORK):
        taken = {n: required_memory(each, modes, space=space) for n, each in needed.items()}
        for name, integrator in needed.items():
            # all trajectories are kept, one adjoint is computed at a time
            left = available - sum(taken.values()) + taken[name]
            check_memory(integrator, modes, left, adjoint=adjoint, space=space)


def chosen_before(bodies: DesignedBodies, cases: Cases) -> dict[str, MechanicalProblem]:
    """The load cases with method and steps in the place of time intervals; collective.

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
