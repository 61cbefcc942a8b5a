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

#: Environment variable: how many cells, points or curves are allowed whatever the machine
INSIST = "DOLFINX_FFR_MAX_CELLS"
#: Most cells of a mesh: gmsh takes about ten minutes for as many triangles
MOST_CELLS = 4_000_000
#: Most triangles of an outline that is drawn: a length in a wrong unit asks for hundreds of times
#: as many as are meant, and a simulation with these already takes minutes
MOST_TRIANGLES = 100_000
#: Most curves of a drawing, for which gmsh takes minutes
MOST_CURVES = 20_000
#: Most pairs of points that see each other, which take a minute
MOST_PAIRS = 100_000_000
#: Memory that such a pair takes, with copies on the way [bytes]
PAIR = 80
#: Files in which a container's limit stands, of both versions of control groups.
_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


class LimitError(ValueError):
    """More of something was asked for than this machine takes in reasonable time."""


def available_memory(processes: int = 1) -> int:
    """One process's share of the memory of the machine, or less by a limit [bytes]."""
    of_machine = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    for file in _LIMITS:
        with suppress(OSError, ValueError):  # no such file, or "max"
            of_machine.append(int(Path(file).read_text()))
    limits = [resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]
    of_process = [soft for soft in limits if soft != resource.RLIM_INFINITY]
    return min([min(of_machine) // processes, *of_process])


def give_back_memory() -> None:
    """Give what was freed back to the system: glibc keeps pieces of it, which grow in time."""
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
    """Refuse more things than the memory holds, at ``each`` bytes, or than are made in minutes."""
    allowed = os.environ.get(INSIST, "").strip()
    if allowed:
        try:
            most = float(allowed)
        except ValueError:
            raise ValueError(
                f"the environment variable {INSIST} is {allowed!r}; give it a number"
            ) from None
    room = math.inf
    if each and not allowed:
        room = (available_memory() if available is None else available) / each
    if count <= min(most, room):
        return
    why = f"more than the {most:,.0f} that are made without being asked twice"
    if room < most:
        why = (
            f"some {count * each / 1e9:,.3g} GB, more than the {room * each / 1e9:,.3g} GB {whose}"
        )
    shown = f"{count:,.0f}" if count < 1e15 else f"{count:.3g}"
    raise LimitError(
        f"{what}: some {shown} {things} are {why}; {remedy}, or allow more by the environment "
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
    """Refuse a sparse matrix between two sets of points of which too many see each other.

    They see as far as ``reach``, in distances of the points of the second set.
    """
    unit_ball = math.pi if dimension == 2 else 4.0 * math.pi / 3.0
    side = min(reach, counts[1])  # so that no power overflows
    near = min(counts[1], 1.0 + unit_ball * side**dimension)
    pairs = "pairs of points within the radius"
    check_count(
        what, counts[0] * near, pairs, remedy, each=PAIR, most=MOST_PAIRS, available=available
    )
