# SPDX-License-Identifier: MIT
"""Memory that a trajectory and its adjoint take, compared with that of the machine."""

from __future__ import annotations

from collections.abc import Iterable

from ..limits import available_memory
from .trajectory import Integrator


def required_memory(
    integrator: Integrator, modes: Iterable[int], *, adjoint: bool = False, space: bool = False
) -> int:
    """Estimate of the memory of a trajectory of bodies with so many modes each [bytes].

    With `adjoint` an adjoint pass is included. It is zero if the steps follow from a tolerance.
    """
    sizes = [(6 if space else 3) + number for number in modes]
    n, rows = sum(sizes), (6 if space else 3) * len(sizes)
    # Coordinates with three derivatives, multipliers of two kinds, tables of loads and of vectors
    # with two derivatives each, while they are made; then stretches of a trajectory that are
    # joined, or derivatives, their copies and adjoints.
    passing = 15 if adjoint else 9 if integrator.stages > 1 else 4
    numbers = (4 + passing) * n + 25 * rows + 10
    return 8 * numbers * integrator.instants


def check_memory(
    integrator: Integrator,
    modes: Iterable[int],
    available: int | None = None,
    *,
    adjoint: bool = False,
    space: bool = False,
) -> None:
    """Refuse, by a MemoryError, a trajectory beyond the available memory of the machine [bytes]."""
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
