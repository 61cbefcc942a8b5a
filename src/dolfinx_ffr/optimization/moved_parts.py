# SPDX-License-Identifier: MIT
"""Steps of boundaries after a design of densities."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

from ..boundary import Boundary, Surface
from ..design import SHARP, Design, LevelSet
from ..dynamics import SimulationError
from ..part import LoosePieceWarning, Part, PartWarning
from .boundary_steps import moved
from .result import Result, warn
from .steps_checkpoint import StepsCheckpoint

#: Minimum member and gap of densities, in mean elements: those of a level set by default
_LEAST = 0.64
#: How parts are made whose curves are smoothed by more, or only looked at
_ROUGHLY: dict[str, Any] = {"tolerance": 1e-2, "resolution": 4}
#: Share of the material that may be in loose pieces, which the densities count and the part has not
_LOOSE = 1e-3


def with_moved_boundaries(
    result: Result,
    steps: int,
    tolerance: float | None,
    progress: bool,
    checkpoint: StepsCheckpoint,
) -> Result:
    """The result of a run, and that of ``steps`` of the boundaries of its parts; collective.

    They are kept in a ``checkpoint``, from which a run that is resumed goes on.

    Warns:
        DesignWarning: If there are no such steps, with the reason.
    """
    designs = {n: part for n, part in result.designs.items() if isinstance(part, Design)}
    bound = {name: result.bounds.get(name, 1.0) for name in designs}
    bodies = result.problem.flexible.items()
    # those by dimensions stay
    full = {n: 1.0 - body.domain.void_cells for n, body in bodies if n not in designs}
    free = {n: part for n, part in result.designs.items() if n not in designs}
    others = {n: part.point(result.variables[n]) for n, part in free.items()} | full
    try:
        boundaries: dict[str, Boundary | Surface] = {}
        for name, design in designs.items():
            flat = design.domain.dimension == 2
            with warnings.catch_warnings():
                # the steps begin without loose pieces, and psi that is told is without them
                warnings.simplefilter("ignore", LoosePieceWarning)
                part = result.enclosed(name, **(_ROUGHLY if flat else {}))
            mirrors = design.mirrors if isinstance(design, LevelSet) else ()
            member, gap = _sizes(design)
            if isinstance(part, Part):
                boundaries[name] = Boundary.of(part, member, gap=gap, mirrors=mirrors)
            else:
                boundaries[name] = Surface.of(part, member, mirrors=mirrors)
        options = others, steps, None, tolerance, progress, checkpoint
        found = moved(result.problem, boundaries, bound, *options)
    except (ValueError, SimulationError) as error:
        over = f" and violates {list(result.violations)}" if result.violations else ""
        warn(f"optimize: the boundary stays as the mesh has drawn it{over} ({error})")
        return result
    # the part may keep bounds that the densities have missed
    kept = result.reason == "infeasible" and not found.violations
    reason = "iterations" if kept else result.reason
    return replace(result, moved=found, violations=found.violations, reason=reason)


def with_loose_pieces(result: Result) -> Result:
    """The result, its loose pieces a violation: the part has not what its psi counts; collective.

    A level set that is crisp may have them where elements are wider than the gaps beside them.

    Warns:
        DesignWarning: Of loose pieces, or if no part comes of the design.
    """
    found = {}
    for name, design in result.designs.items():
        if not isinstance(design, LevelSet) or design.domain.dimension != 2:
            continue
        if design.sharpness < SHARP:
            continue
        why = "nothing is held by its interfaces"
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", PartWarning)
                part = result.enclosed(name, **_ROUGHLY)
        except ValueError as error:
            share, why = 1.0, str(error)
        else:
            assert isinstance(part, Part)
            share = sum(piece.area for piece in part.loose) / part.area
            why = f"{len(part.loose)} loose pieces of it touch no interface"
        if share > _LOOSE:
            found[f"loose pieces of {name}"] = share
            warn(
                f"optimize: psi is not that of a part of {name!r}: {why}; take smaller elements, "
                "steps of the boundary, or another start"
            )
    if not found:
        return result
    reason = "infeasible" if result.reason != "interrupted" else result.reason
    return replace(result, violations={**result.violations, **found}, reason=reason)


def _sizes(design: Design) -> tuple[float, float]:
    """Minimum member and gap of a design [m]."""
    if isinstance(design, LevelSet):
        return design.minimum_member, design.minimum_gap
    return _LEAST * design.domain.cell_size, _LEAST * design.domain.cell_size
