# SPDX-License-Identifier: MIT
"""Rows between two markers that most joints consist of, in the plane and in space alike.

Where the plane has fewer rows than space, or others, this module knows it; joints do not.
"""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import ArrayLike

from .marker import Marker, Pair, Triple, perpendicular
from .rows import BodyVector, Row, RowKind, direction, point
from .undeformed import Undeformed

#: Axis of all rotations in the plane.
_UPRIGHT = (0.0, 0.0, 1.0)


def coincidence(a: Marker, b: Marker, undeformed: Undeformed) -> list[Row]:
    """Two markers at one point: two rows, in space three."""
    normals: tuple[Triple, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    ends = point(a), point(b)
    return [Row(RowKind.POINT, ends, n) for n in normals[: undeformed.dimension]]


def parallel(a: Marker, b: Marker, axis: Triple, undeformed: Undeformed) -> list[Row]:
    """An axis, in the axes of b, that both markers share as in the placements: two rows in space.

    With e_1 x e_2 the axis, the multipliers are moments about e_1 and e_2, as the axis of the first
    marker is kept perpendicular to -e_2 and e_1. The plane has no such rows; a ValueError refuses
    an axis that is not perpendicular to it.
    """
    axis = undeformed.axis(axis)
    if undeformed.dimension == 2:
        return []
    own, (first, second) = direction(a, undeformed.seen_from(a, b, axis)), perpendicular(axis)
    return [Row(RowKind.DOT, (own, direction(b, e))) for e in (-second, first)]


def aligned(
    a: Marker, b: Marker, axis: Triple, undeformed: Undeformed, angle: float | None = None
) -> list[Row]:
    """Markers that keep their relative rotation in the placements: one row, in space three.

    The multipliers are moments about e_1, e_2 and the axis (in the axes of b), in the plane about
    z. An angle, in the plane alone, takes the place of the angle in the placements [rad].
    """
    if undeformed.dimension == 2:
        constant = 0.0 if angle is None else angle
        return [relative_angle(a, b, _UPRIGHT, undeformed, angle is not None, constant=constant)]
    if angle is not None:
        raise ValueError(
            f"{undeformed.user}: in space the relative rotation is that of the placements; leave "
            "the angle out"
        )
    first, second = perpendicular(axis)
    own = direction(a, undeformed.seen_from(a, b, first))
    return [*parallel(a, b, axis, undeformed), Row(RowKind.DOT, (own, direction(b, second)))]


def on_plane(a: Marker, b: Marker, normal: ArrayLike) -> Row:
    """Marker a on a plane through b, in the plane on a line, with a normal in the axes of b."""
    return Row(RowKind.PLANE, (point(a), point(b), direction(b, normal)))


def on_line(a: Marker, b: Marker, line: Pair | Triple, undeformed: Undeformed) -> list[Row]:
    """Marker a on a line through b, its direction in the axes of b: one row, in space two."""
    along = undeformed.line(line)
    if undeformed.dimension == 2:
        return [on_plane(a, b, (-along[1], along[0], 0.0))]
    return [on_plane(a, b, e) for e in perpendicular(along)]


def turning(
    a: Marker, b: Marker, axis: Triple, undeformed: Undeformed, angle: float = 0.0
) -> tuple[BodyVector, BodyVector, BodyVector]:
    """Directions of an ANGLE row: marker a about an axis of b, at an angle in the placements [rad].

    In the plane a ValueError refuses an axis that is not perpendicular to it.
    """
    first, second = perpendicular(undeformed.axis(axis))
    now = math.cos(angle) * first + math.sin(angle) * second
    own = direction(a, undeformed.seen_from(a, b, now))
    return own, direction(b, first), direction(b, second)


def relative_angle(
    a: Marker,
    b: Marker,
    axis: Triple,
    undeformed: Undeformed,
    counted: bool = True,
    **right_hand_side: Any,
) -> Row:
    """The angle of marker a against b about an axis of b: one row, its right-hand side by keywords.

    If ``counted``, it is unwrapped, and zero where the axes of the markers agree but for a rotation
    about the axis; else it is zero in the placements.
    """
    angle = undeformed.twist(a, b, undeformed.axis(axis)) if counted else 0.0
    vectors = turning(a, b, axis, undeformed, angle)
    return Row(RowKind.ANGLE, vectors, start_angle=angle, **right_hand_side)
