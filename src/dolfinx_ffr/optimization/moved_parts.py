# SPDX-License-Identifier: MIT
"""Steps of boundaries after a design of densities."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

from ..boundary import Boundary, Surface
from ..design import LEAST, SHARP, Design, LevelSet
from ..dynamics import SimulationError
from ..fem import CurveError
from ..part import LoosePieceWarning, Part, PartWarning
from .boundary_steps import moved
from .part_checks import part_violations
from .result import Result, warn
from .steps_checkpoint import StepsCheckpoint

#: How parts are made whose curves are smoothed by more, or only looked at
_ROUGHLY: dict[str, Any] = {"tolerance": 1e-2, "resolution": 4}
#: What is said where curves cross, with what a user of `optimize` can do
_HAIRLINES = (
    "curves along its sides cross or almost touch, as members or gaps of the design are thinner "
    "than these can show; give a larger minimum_member, smaller elements or more iterations"
)
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
                boundaries[name] = Boundary.of(
                    part, member, gap=gap, rim=design.hole_rim, mirrors=mirrors
                )
            else:
                boundaries[name] = Surface.of(part, member, rim=design.hole_rim, mirrors=mirrors)
        options = others, steps, None, tolerance, progress, checkpoint
        found = moved(result.problem, boundaries, bound, *options)
    except (ValueError, SimulationError) as error:
        over = f" and violates {list(result.violations)}" if result.violations else ""
        why = _HAIRLINES if isinstance(error, CurveError) else str(error)
        warn(f"optimize: the boundary stays as the mesh has drawn it{over}: {why}")
        return _denied(with_checked_parts(result), progress)
    # the part may keep bounds that the densities have missed
    kept = result.reason == "infeasible" and not found.violations
    reason = "iterations" if kept else result.reason
    return replace(result, moved=found, violations=found.violations, reason=reason)


def _denied(result: Result, progress: bool) -> Result:
    """The result, not feasible if no part comes of it, or one that exceeds constraints; collective.

    Densities tell little of the stress of a part whose boundary could not be moved.
    """
    if result.reason == "interrupted":
        return result
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PartWarning)  # said where the part is asked for
            for name, design in result.designs.items():
                if isinstance(design, Design):
                    flat = design.domain.dimension == 2
                    result.enclosed(name, **(_ROUGHLY if flat else {}))
        if result.problem.constraints:
            result.verify(most=2, progress=progress)
    except (ValueError, SimulationError) as error:
        warn(f"optimize: no part comes of this design: {error}", 5)
        result.violations["no part"] = 1.0
    return result if result.feasible else replace(result, reason="infeasible")


def with_checked_parts(result: Result) -> Result:
    """The result, and as violations what its part lacks; collective.

    Loose pieces are not in the part, and psi counts them: a level set that is crisp may have them
    where elements are wider than the gaps beside them. Minimum sizes that were asked for are
    measured, and struts that end free are looked for. Of bodies with holes in their drawing, what
    lies outside of the body is a violation, and a rim of a hole that is thinner than asked for.

    Warns:
        DesignWarning: Of each, or if no part comes of the design.
    """
    found: dict[str, float] = {}
    for name, design in result.designs.items():
        if not isinstance(design, Design) or design.sharpness < SHARP:
            continue
        flat_level = isinstance(design, LevelSet) and design.domain.dimension == 2
        if not flat_level and not design.domain.holes:
            continue
        why = "nothing is held by its interfaces"
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", PartWarning)
                part = result.enclosed(name, **(_ROUGHLY if design.domain.dimension == 2 else {}))
        except ValueError as error:
            share, why = 1.0, str(error)
        else:
            share = 0.0
            if isinstance(part, Part):
                share = sum(piece.area for piece in part.loose) / part.area
                why = f"{len(part.loose)} loose pieces of it touch no interface"
            asked = isinstance(design, LevelSet) and flat_level and design.sizes_asked
            sizes = {name: _sizes(design)} if asked else {}
            rims = {name: (design.hole_rim, _sizes(design)[0])}
            for what, each in part_violations(result.problem, {name: part}, sizes, rims).items():
                found[what] = each.share
                warn(f"optimize: {name!r}: {each.said}")
        if share > _LOOSE and flat_level:
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
    return LEAST * design.domain.cell_size, LEAST * design.domain.cell_size
