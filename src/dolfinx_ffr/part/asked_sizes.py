# SPDX-License-Identifier: MIT
"""Whether a finished part has the sizes that were asked for, whatever made it.

The thinnest member and the narrowest gap are measured; rims of bores are members like any other.
Holes and notches of the body's own drawing are no gaps, however narrow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from ..arrays import Array
from .enclosed import Enclosed
from .options import CHECKS
from .part import Part
from .solid import Solid
from .widths import Width, narrowest_gap


@dataclass(frozen=True)
class PartViolation:
    """A limit that a finished part does not satisfy."""

    name: str  #: Name of the limit, with the place
    share: float  #: By how much it is violated, relative to the limit
    message: str  #: A sentence with the remedy


def size_violations(part: Enclosed, member: float, gap: float | None = None) -> list[PartViolation]:
    """Members and gaps of a part that are more than 1 % below their minimum [m].

    Of a solid only members are looked at, and 3 % are allowed.
    """
    tolerance = CHECKS.tolerance_in_space if isinstance(part, Solid) else CHECKS.tolerance
    remedy = "take more steps of the boundary, smaller elements, or another start"
    violations = []

    def too_small(width: Width | None, minimum: float) -> Width | None:
        """The width if it is below its minimum."""
        return width if width and width.value < (1.0 - tolerance) * minimum else None

    if thinnest := too_small(part.thinnest_member, member):
        advice = remedy
        if isinstance(part, Part) and _is_beside_solid(part, thinnest):
            advice = (
                "it is along a solid region: draw the region wider there, or give a wider solid_rim"
            )
        violations.append(_violation("thinnest member", thinnest, member, advice))

    # the drawing's own gaps are looked for only where there is a narrow one, as this takes longer
    if gap is not None and isinstance(part, Part) and too_small(part.narrowest_gap, gap):
        if narrowest := too_small(_gap_of_design(part, gap), gap):
            violations.append(_violation("narrowest gap", narrowest, gap, remedy))
    return violations


def place(position: Array) -> str:
    """A position [m] in words."""
    return "(" + ", ".join(f"{1e3 * x:.4g}" for x in position) + ") mm"


def _violation(what: str, width: Width, minimum: float, remedy: str) -> PartViolation:
    where = place(width.ends.mean(axis=0))
    sentence = (
        f"the {what} is {1e3 * width.value:.3g} mm at {where}, below the minimum of "
        f"{1e3 * minimum:.3g} mm: {remedy}"
    )
    return PartViolation(f"{what} near {where}", 1.0 - width.value / minimum, sentence)


def _is_beside_solid(part: Part, member: Width) -> bool:
    """Whether the middle of a member is in or along a solid region."""
    middle = shapely.Point(member.ends.mean(axis=0))
    reach = CHECKS.beside * member.value
    return any(region.distance(middle) < reach for region in solid_regions(part))


def solid_regions(part: Part) -> list[shapely.Polygon]:
    """The regions of a part that stay solid, as polygons within its accuracy [m]."""
    drawing = part.drawing
    solid_faces = [face for face in drawing.faces if face.group == "solid"]
    return [drawing.polygon(face.loops, part.accuracy) for face in solid_faces]


def _gap_of_design(part: Part, gap: float) -> Width | None:
    """The narrowest gap that is none of the body's drawing, for a minimum gap [m]."""
    full_body = Part(part.body, lambda x: np.ones(len(x)), part.spacing, resolution=2).polygon
    bounds = shapely.box(*full_body.bounds).buffer(2.0 * gap, join_style="mitre")
    around = bounds.difference(full_body)

    # a disc of the minimum gap does not reach these regions
    narrow = around.difference(around.buffer(-0.5 * gap).buffer(0.505 * gap))
    least_area = CHECKS.corner_area * gap**2
    drawn_gaps = [region for region in shapely.get_parts(narrow) if region.area > least_area]

    filled = shapely.union_all([part.polygon, *drawn_gaps]).buffer(part.accuracy)
    low, high = np.reshape(filled.bounds, (2, 2))
    return narrowest_gap(filled, 10.0 * part.accuracy, float(np.min(high - low)))
