# SPDX-License-Identifier: MIT
"""Memory of a motion and of its adjoint: estimated, and refused beyond what the machine has."""

from __future__ import annotations

from dataclasses import replace

from mpi4py import MPI

import pytest
from shared.problems import slider_crank
from shared.scenes import SCENES

import dolfinx_ffr as ffr
from dolfinx_ffr import parallel
from dolfinx_ffr.dynamics import required_memory
from dolfinx_ffr.dynamics.trajectory import Integrator
from dolfinx_ffr.limits import available_memory

METHODS = [ffr.GeneralizedAlpha(0.01, 1200), ffr.RadauIIA(0.01, steps=400)]


@pytest.mark.parametrize("integrator", [replace(method, steps=10**9) for method in METHODS])
def test_what_no_machine_holds_is_refused(integrator: Integrator) -> None:
    """The message says what it would take."""
    scene = SCENES["slider-crank"]()
    with pytest.raises(MemoryError, match=r",001 instants would take some \S+ GB, and there are"):
        ffr.simulate(scene.mechanism, scene.bodies, integrator)


def test_limits_of_a_process_are_not_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of `ulimit` hold for each process, the machine's memory for all together."""
    machine = available_memory()
    assert available_memory(4) == machine // 4
    monkeypatch.setattr("resource.getrlimit", lambda kind: (machine // 8, machine))
    values = [available_memory(processes) for processes in (1, 4, 16)]
    assert values == [machine // 8, machine // 8, machine // 16]


@pytest.mark.mpi
def test_all_ranks_refuse_where_one_lacks_memory(
    comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rank with the least memory decides, for the motion and for its adjoint."""
    problem = slider_crank(comm, (10, 2), modes=1)
    last = comm.rank == comm.size - 1
    # Enough for the motion, too little for its adjoint.
    modes = [problem.flexible["rod"].n_elastic]
    motion = required_memory(problem.integrator, modes)
    for memory, adjoint in ((motion - 1, False), (motion, True)):
        monkeypatch.setattr(
            parallel, "available_memory", lambda ranks, memory=memory: memory if last else 2**50
        )
        with pytest.raises(MemoryError, match="its adjoint" if adjoint else "a motion of"):
            again = problem.with_modes({})
            again.gradient([1.0] * again.flexible["rod"].domain.n_cells)
