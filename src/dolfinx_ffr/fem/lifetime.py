# SPDX-License-Identifier: MIT
"""When the memory of PETSc's objects is freed.

Freeing is collective, and Python's ranks do not let go of an object at the same time. So what
Python drops PETSc keeps until all ranks ask together for what all of them have dropped, or to the
end of the program. On one rank nobody has to wait.
"""

from __future__ import annotations

import weakref
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

__all__ = ["free_dropped", "kept_by"]


def kept_by(owner: object, comm: MPI.Comm) -> list[Any]:
    """An empty list for what an object keeps of PETSc's.

    Where there is one rank, what nobody else holds is freed when the object goes.

    Args:
        owner: Who keeps it.
        comm: The ranks that share it.
    """
    kept: list[Any] = []
    if comm.size == 1:
        # the end of the program comes after PETSc's
        weakref.finalize(owner, _drop, kept, comm).atexit = False
    return kept


def free_dropped(comm: MPI.Comm) -> None:
    """Free what all ranks of a communicator have dropped; collective.

    Args:
        comm: Their communicator.
    """
    PETSc.garbage_cleanup(comm)


def _drop(kept: list[Any], comm: MPI.Comm) -> None:
    kept.clear()
    free_dropped(comm)
