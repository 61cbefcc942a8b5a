# SPDX-License-Identifier: MIT
"""Steps of boundaries after a design of densities."""

from __future__ import annotations

import traceback
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from shapely import GEOSException

from ..boundary import Boundary, Surface
from ..design import LEAST, SHARP, Design, LevelSet
from ..dynamics import SimulationError
from ..fem import CurveError
from ..io import CheckpointError
from ..parallel import on_every_rank
from ..part import LoosePieceWarning, Part, PartWarning, Solid
from .boundary_phase import moved
from .checkpoint import Checkpoint
from .part_checks import part_violations
from .result import Result, deny, ranks_of, warn
from .trial_failed import TrialFailed

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
    checkpoint: Checkpoint,
) -> Result:
    """The result of a run, and that of ``steps`` of the boundaries of its parts.

    Each step is stored in a ``checkpoint``, from which a resumed run continues. Errors of files are
    raised. After any other one, even a bug, the result of the densities is returned with a warning.
    """
    designs = {n: part for n, part in result.designs.items() if isinstance(part, Design)}
    bound = {name: result.bounds.get(name, 1.0) for name in designs}
    bodies = result.problem.flexible.items()
    # those by dimensions stay
    full = {n: 1.0 - body.domain.void_cells for n, body in bodies if n not in designs}
    free = {n: part for n, part in result.designs.items() if n not in designs}
    others = {n: part.point(result.variables[n]) for n, part in free.items()} | full
    options = tolerance, progress, checkpoint
    parts: dict[str, Part | Solid] = {}
    try:
        with on_every_rank(ranks_of(result.problem), "steps of the boundary"):
            boundaries = _drawn(result, designs, parts)
            moved_result = moved(result.problem, boundaries, bound, others, steps, None, *options)
    except (CheckpointError, OSError):
        raise
    except Exception as error:  # the densities are a result, whatever has failed after them
        over = f" and violates {list(result.violations)}" if result.violations else ""
        cause = _HAIRLINES if isinstance(error, CurveError) else _described(error)
        warn(
            f"optimize: the boundary was not moved and follows the edges of the elements{over}: "
            f"{cause}"
        )
        return with_checked_parts(result, parts, unmoved=True, progress=progress)
    # the part may keep bounds that the densities have missed
    mended = result.reason == "infeasible" and not moved_result.violations
    reason = "iterations" if mended else result.reason
    return replace(result, moved=moved_result, violations=moved_result.violations, reason=reason)


def _drawn(
    result: Result, designs: Mapping[str, Design], parts: dict[str, Part | Solid]
) -> dict[str, Boundary | Surface]:
    """The boundaries of the parts that designs enclose; the parts are added to ``parts``."""
    boundaries: dict[str, Boundary | Surface] = {}
    for name, design in designs.items():
        with warnings.catch_warnings():
            # the steps begin without loose pieces, and the psi of their result is without them
            warnings.simplefilter("ignore", LoosePieceWarning)
            part = parts[name] = _rough_part(result, name)
        mirrors = design.mirrors if isinstance(design, LevelSet) else ()
        member, gap = _sizes(design)
        options: dict[str, Any] = {"rim": design.hole_rim, "mirrors": mirrors}
        if isinstance(part, Part):
            # pockets have full thickness all around
            options["outline"] = not part.web
            boundaries[name] = Boundary.of(part, member, gap=gap, **options)
        else:
            boundaries[name] = Surface.of(part, member, **options)
    return boundaries


def _rough_part(result: Result, name: str) -> Part | Solid:
    """The part that a design encloses, its curves smoothed by more where it is flat."""
    flat = result.problem.flexible[name].domain.dimension == 2
    return result.enclosed(name, **_ROUGHLY) if flat else result.part(name)


def _described(error: Exception) -> str:
    """What an error says; of one that is not meant for users also its kind and its place."""
    if isinstance(error, ValueError | SimulationError | TrialFailed):
        return str(error)
    frame = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(frame.filename).name}, line {frame.lineno}"
    return f"{type(error).__name__}, {where}: {error}"


def with_checked_parts(
    result: Result,
    parts: Mapping[str, Part | Solid] | None = None,
    *,
    unmoved: bool = False,
    progress: bool = False,
) -> Result:
    """The result with a violation for each design that encloses no part, and for flaws of parts.

    Flaws are loose pieces, sizes and rims below the minimum that the user gave, struts that end
    free, and material outside of a body with drawn holes. A sharp level set may have loose pieces
    where elements are wider than the gaps beside them: they are not in the part, but psi counts
    them.

    Only sharp designs are looked at; gray ones have a warning of their own. Where boundaries could
    not be moved (``unmoved``) all are, and the parts are verified if the problem has constraints,
    as densities tell little of the stress of parts. ``parts`` that have been made already are given
    by body.
    """
    sharp = {
        name: design.sharpness >= min(SHARP, design.at(1.0).sharpness)
        for name, design in result.designs.items()
        if isinstance(design, Design)
    }
    torn = False
    for name, finished in sharp.items():
        if not (finished or unmoved):
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", PartWarning)
                enclosed = (parts or {}).get(name) or _rough_part(result, name)
        except (ValueError, GEOSException) as error:
            deny(result, [name], error, 5)
            torn = True
            continue
        if finished:
            _look_at(result, name, enclosed)
    if unmoved and result.problem.constraints and not torn:
        try:
            result.verify(most=2, progress=progress)
        except (ValueError, SimulationError) as error:
            deny(result, sharp, error, 5)
    if result.feasible or result.reason == "interrupted":
        return result
    return replace(result, reason="infeasible")


def _look_at(result: Result, name: str, part: Part | Solid) -> None:
    """Add to the violations of a result what a part of a finished design lacks."""
    design = result.designs[name]
    assert isinstance(design, Design)
    level_set = isinstance(part, Part) and isinstance(design, LevelSet)
    is_asked = isinstance(design, LevelSet) and level_set and design.sizes_asked
    sizes = {name: _sizes(design)} if is_asked else {}
    rims = {name: (design.hole_rim, _sizes(design)[0])}
    for what, violation in part_violations(result.problem, {name: part}, sizes, rims).items():
        result.violations[what] = violation.share
        warn(f"optimize: {name!r}: {violation.message}", 5)
    if not (level_set and isinstance(part, Part)):
        return
    share = sum(piece.area for piece in part.loose) / part.area
    if share > _LOOSE:
        result.violations[f"loose pieces of {name}"] = share
        warn(
            f"optimize: psi includes {len(part.loose)} loose pieces of {name!r} that touch no "
            "interface and are no part of it; take smaller elements, steps of the boundary, or "
            "another start",
            5,
        )


def _sizes(design: Design) -> tuple[float, float]:
    """Minimum member and gap of a design [m]."""
    if isinstance(design, LevelSet):
        return design.minimum_member, design.minimum_gap
    return LEAST * design.domain.cell_size, LEAST * design.domain.cell_size
