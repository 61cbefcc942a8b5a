# SPDX-License-Identifier: MIT
"""Limits of memory and of the numbers of cells, points and curves.

A number that is mistyped, or a length in a wrong unit, would otherwise take hours, or all memory.
So what makes cells, points or curves estimates beforehand how many they are.
"""

from __future__ import annotations

import ctypes
import math
import os
import resource
from contextlib import suppress
from pathlib import Path

#: Environment variable that allows more cells, points or curves, whatever the machine
INSIST = "DOLFINX_FFR_MAX_CELLS"
#: Largest number of cells of a mesh: gmsh takes about ten minutes for as many triangles
MOST_CELLS = 4_000_000
#: Largest number of triangles of a drawn outline: a simulation with these takes minutes, and a
#: length in a wrong unit asks for hundreds of times as many as are meant
MOST_TRIANGLES = 100_000
#: Largest number of curves of a drawing, for which gmsh takes minutes
MOST_CURVES = 20_000
#: Largest number of pairs of points within a radius, which take a minute
MOST_PAIRS = 100_000_000
#: Memory that a pair of points takes, with temporary copies [bytes]
PAIR = 80
#: Files that hold a container's limit of memory, of both versions of control groups
_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


class LimitError(ValueError):
    """A call asks for more cells, points or curves than this machine handles in minutes."""


def available_memory(processes: int = 1) -> int:
    """The share of one process in the machine's memory, or its own limit if lower [bytes]."""
    of_machine = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    for file in _LIMITS:
        with suppress(OSError, ValueError):  # no such file, or "max"
            of_machine.append(int(Path(file).read_text()))
    limits = [resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]
    of_process = [soft for soft in limits if soft != resource.RLIM_INFINITY]
    return min([min(of_machine) // processes, *of_process])


def give_back_memory() -> None:
    """Give freed memory back to the system; glibc keeps pieces of it, which grow in time."""
    with suppress(AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def held_memory() -> int:
    """Memory of this process [bytes]; zero where the system does not say."""
    give_back_memory()
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def check_count(
    what: str,
    count: float,
    things: str,
    remedy: str,
    *,
    each: float = 0.0,
    most: float = MOST_CELLS,
    available: float | None = None,
    whose: str = "of this machine",
) -> None:
    """Refuse a ``count`` of things that exceeds the memory, at ``each`` bytes, or ``most``.

    The environment variable `INSIST` replaces both limits.
    """
    allowed = os.environ.get(INSIST, "").strip()
    limit, fit_in_memory = most, math.inf
    if allowed:
        try:
            limit = float(allowed)
        except ValueError:
            raise ValueError(
                f"the environment variable {INSIST} is {allowed!r}; give it a number"
            ) from None
    elif each:
        fit_in_memory = (available_memory() if available is None else available) / each
    if count <= min(limit, fit_in_memory):
        return

    reason = f"more than the {limit:,.0f} that are allowed by default"
    if fit_in_memory < limit:
        needed, free = count * each / 1e9, fit_in_memory * each / 1e9
        reason = f"some {needed:,.3g} GB, more than the {free:,.3g} GB {whose}"
    amount = f"{count:,.0f}" if count < 1e15 else f"{count:.3g}"
    raise LimitError(
        f"{what}: some {amount} {things} are {reason}; {remedy}, or allow more by the environment "
        f"variable {INSIST}"
    )


def check_pairs(
    what: str,
    counts: tuple[float, float],
    reach: float,
    dimension: int,
    remedy: str,
    available: float,
) -> None:
    """Refuse a sparse matrix between two sets of points with too many pairs within a radius.

    The radius is ``reach``, in units of the distance between neighbours in the second set.
    """
    unit_ball = math.pi if dimension == 2 else 4.0 * math.pi / 3.0
    radius = min(reach, counts[1])  # so that no power overflows
    neighbours = min(counts[1], 1.0 + unit_ball * radius**dimension)
    pairs = "pairs of points within the radius"
    check_count(
        what, counts[0] * neighbours, pairs, remedy, each=PAIR, most=MOST_PAIRS, available=available
    )
