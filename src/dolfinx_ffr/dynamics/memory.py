# SPDX-License-Identifier: MIT
"""Memory that a motion and its adjoint take, beside that of the machine."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterable
from pathlib import Path

from .trajectory import Integrator

__all__ = ["available_memory", "check_memory", "required_memory"]

#: Files in which a container's limit stands, of both versions of control groups.
_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


def available_memory(processes: int = 1) -> int:
    """Memory that a process may take: its share of the machine's, or less by a limit [bytes].

    Args:
        processes: Number of processes that share the memory of this machine.
    """
    shared = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    for file in _LIMITS:
        try:
            shared.append(int(Path(file).read_text()))
        except (OSError, ValueError):  # no such file, or "max"
            continue
    own = [resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]
    limits = [soft for soft in own if soft != resource.RLIM_INFINITY]
    return min([min(shared) // processes, *limits])


def required_memory(
    integrator: Integrator, modes: Iterable[int], *, adjoint: bool = False, space: bool = False
) -> int:
    """Memory that a motion with given steps takes, about [bytes].

    Args:
        integrator: Time integration; where its steps follow from a tolerance, the result is zero.
        modes: Number of elastic coordinates of each body.
        adjoint: Whether that of an adjoint pass counts, too.
        space: Whether the bodies are in space.
    """
    sizes = [(6 if space else 3) + number for number in modes]
    n, rows = sum(sizes), (6 if space else 3) * len(sizes)
    # Coordinates with three derivatives, multipliers of two kinds, tables of what is prescribed;
    # then stretches of a motion that are joined, or derivatives, their copies and adjoints.
    passing = 15 if adjoint else 9 if integrator.stages > 1 else 4
    numbers = (4 + passing) * n + 5 * rows + 10
    return 8 * numbers * integrator.instants


def check_memory(
    integrator: Integrator,
    modes: Iterable[int],
    available: int | None = None,
    *,
    adjoint: bool = False,
    space: bool = False,
) -> None:
    """Refuse what the machine cannot hold.

    Args:
        integrator: Time integration.
        modes: Number of elastic coordinates of each body.
        available: Memory that may be taken, by default that of this machine [bytes].
        adjoint: Whether derivatives are asked for as well.
        space: Whether the bodies are in space.

    Raises:
        MemoryError: If the motion, or its adjoint, would take more.
    """
    required = required_memory(integrator, modes, adjoint=adjoint, space=space)
    limit = available_memory() if available is None else available
    if required > limit:
        what = "a motion and its adjoint" if adjoint else "a motion"
        raise MemoryError(
            f"{what} of {integrator.instants:,} instants would take some "
            f"{required / 1e9:,.0f} GB, and there are {limit / 1e9:,.1f} GB on this machine for "
            "each process; take fewer steps, or RadauIIA with a tolerance, which takes as many as "
            "it needs"
        )
