# SPDX-License-Identifier: MIT
"""Whether a finished part has the sizes that were asked for, whatever made it.

The thinnest member and the narrowest gap are measured; rims of bores are members like any other.
Holes and notches of the body's own drawing are no gaps, however narrow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely

from ..fem import enclosed, polygon
from .enclosed import Enclosed
from .part import Part
from .solid import Solid
from .widths import Width, narrowest_gap

#: Share of a minimum by which a size may be below it; of a solid, whose surface is known by samples
_MISSED, _MISSED_IN_SPACE = 0.01, 0.03
#: Area from which on what of a drawing is narrower than a gap is a hole or a notch, and no corner,
#: in squares of the minimum gap
_CORNER = 0.1
#: Distance in widths of a member from a solid region at which it is one of that region
_BESIDE = 0.6


@dataclass(frozen=True)
class PartViolation:
    """What a finished part does not keep."""

    name: str  #: What, and where
    share: float  #: By how much, relative to what was asked for
    said: str  #: A sentence with the remedy


def size_violations(part: Enclosed, member: float, gap: float | None = None) -> list[PartViolation]:
    """Members and gaps of a part that are more than 1 % below the minimum [m].

    Of a solid members that are 3 % below it, as its surface is known by samples.
    """
    return list(_missed(part, member, gap))


def _missed(part: Enclosed, member: float, gap: float | None) -> Iterator[PartViolation]:
    most = _MISSED_IN_SPACE if isinstance(part, Solid) else _MISSED
    thin = part.thinnest_member
    if thin is not None and thin.value < (1.0 - most) * member:
        remedy = "take more steps of the boundary, smaller elements, or another start"
        if isinstance(part, Part) and _is_beside_solid(part, thin):
            remedy = (
                "it is along a region that stays solid: draw that wider there, or give a wider "
                "solid_rim"
            )
        yield _violation("thinnest member", thin, member, remedy)
    if gap is None or not isinstance(part, Part):
        return
    narrow = part.narrowest_gap
    if narrow is not None and narrow.value < (1.0 - most) * gap:
        narrow = _gap_of_design(part, gap)
    if narrow is not None and narrow.value < (1.0 - most) * gap:
        remedy = "take more steps of the boundary, smaller elements, or another start"
        yield _violation("narrowest gap", narrow, gap, remedy)


def _violation(what: str, found: Width, asked: float, remedy: str) -> PartViolation:
    at = ", ".join(f"{1e3 * x:.4g}" for x in found.ends.mean(axis=0))
    share = 1.0 - found.value / asked
    said = (
        f"the {what} is {1e3 * found.value:.3g} mm at ({at}) mm, where {1e3 * asked:.3g} mm were "
        f"asked for: {remedy}"
    )
    return PartViolation(f"{what} near ({at}) mm", share, said)


def _is_beside_solid(part: Part, member: Width) -> bool:
    """Whether the middle of a member is in or along a solid region."""
    middle = shapely.Point(member.ends.mean(axis=0))
    near = _BESIDE * member.value
    return any(shape.distance(middle) < near for shape in solid_regions(part))


def solid_regions(part: Part) -> list[shapely.Polygon]:
    """What of a part stays solid, as polygons within its accuracy [m]."""
    curves, found = part.drawing.curves, []
    for face in part.drawing.faces:
        if face.group == "solid":
            loops = [
                [curves[i] if way else curves[i].reversed() for i, way in ls] for ls in face.loops
            ]
            rings = [polygon(loop, part.accuracy) for loop in loops]
            outer = int(np.argmax([enclosed(loop)[0] for loop in loops]))
            holes = [ring for k, ring in enumerate(rings) if k != outer]
            found.append(shapely.Polygon(rings[outer], holes))
    return found


def _gap_of_design(part: Part, gap: float) -> Width | None:
    """The narrowest gap that is none of the body's drawing."""
    body = Part(part.body, lambda x: np.ones(len(x)), part.spacing, resolution=2).polygon
    around = shapely.box(*body.bounds).buffer(2.0 * gap, join_style="mitre").difference(body)
    # what a disc of the minimum gap does not reach
    narrow = around.difference(around.buffer(-0.5 * gap).buffer(0.505 * gap))
    drawn = [piece for piece in shapely.get_parts(narrow) if piece.area > _CORNER * gap**2]
    filled = shapely.union_all([part.polygon, *drawn]).buffer(part.accuracy)
    low, high = np.reshape(filled.bounds, (2, 2))
    return narrowest_gap(filled, 10.0 * part.accuracy, float(np.min(high - low)))
