# SPDX-License-Identifier: MIT
"""What joints in space consist of: rows between two markers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .marker import Marker, Pair, Triple, perpendicular
from .spatial_rows import (
    BodyVector,
    SpatialRow,
    SpatialRowKind,
    UndeformedInSpace,
    direction,
    point,
)

__all__ = ["aligned", "coincidence", "in_space", "on_line", "on_plane", "parallel", "turning"]

Array = NDArray[np.float64]


def in_space(components: Pair | Triple) -> Triple:
    """A direction with three components.

    Args:
        components: Two or three of them.
    """
    x, y, z = (*components, 0.0)[:3]
    return x, y, z


def coincidence(a: Marker, b: Marker) -> list[SpatialRow]:
    """Two markers at one point, three rows.

    Args:
        a: First marker.
        b: Second marker.
    """
    normals: tuple[Triple, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return [SpatialRow(SpatialRowKind.POINT, (point(a), point(b)), n) for n in normals]


def perpendicular_to(a: BodyVector, b: BodyVector) -> SpatialRow:
    """Two directions that stay perpendicular, one row.

    Args:
        a: First direction.
        b: Second direction.
    """
    return SpatialRow(SpatialRowKind.DOT, (a, b))


def parallel(
    a: Marker, b: Marker, axis: ArrayLike, undeformed: UndeformedInSpace
) -> list[SpatialRow]:
    """An axis that both markers share, in the placements and ever after: two rows.

    With e_1 x e_2 the axis, their multipliers are those of moments about e_1 and e_2, as the axis
    of the first marker is held perpendicular to -e_2 and e_1.

    Args:
        a: First marker.
        b: Second marker.
        axis: The axis, in the axes of the second marker, shape (3,).
        undeformed: The placements.
    """
    own, (first, second) = direction(a, undeformed.seen_from(a, b, axis)), perpendicular(axis)
    return [perpendicular_to(own, direction(b, e)) for e in (-second, first)]


def aligned(
    a: Marker, b: Marker, axis: ArrayLike, undeformed: UndeformedInSpace
) -> list[SpatialRow]:
    """Markers that keep the relative rotation of the placements: three rows.

    Multipliers are those of moments about e_1, e_2 and the axis.

    Args:
        a: First marker.
        b: Second marker.
        axis: The axis of the first two rows, in the axes of the second marker, shape (3,).
        undeformed: The placements.
    """
    first, second = perpendicular(axis)
    turned = perpendicular_to(direction(a, undeformed.seen_from(a, b, first)), direction(b, second))
    return [*parallel(a, b, axis, undeformed), turned]


def on_plane(a: Marker, b: Marker, normal: ArrayLike) -> SpatialRow:
    """A marker on a plane through another, one row.

    Args:
        a: The marker.
        b: The other one.
        normal: Normal of the plane, in the axes of the other marker, shape (3,).
    """
    return SpatialRow(SpatialRowKind.PLANE, (point(a), point(b), direction(b, normal)))


def on_line(a: Marker, b: Marker, line: ArrayLike) -> list[SpatialRow]:
    """A marker on a line through another, two rows.

    Args:
        a: The marker.
        b: The other one.
        line: Direction of the line, in the axes of the other marker, shape (3,).
    """
    return [on_plane(a, b, e) for e in perpendicular(line)]


def turning(
    a: Marker,
    b: Marker,
    axis: ArrayLike,
    undeformed: UndeformedInSpace,
    *,
    absolute: bool = False,
) -> tuple[BodyVector, BodyVector, BodyVector]:
    """Directions whose angle is that of a marker about an axis.

    Args:
        a: The marker.
        b: The marker against which the angle counts.
        axis: The axis, in the axes of the latter, shape (3,).
        undeformed: The placements.
        absolute: Whether the angle is that of the markers' axes; else it is zero in the placements.
    """
    first, second = perpendicular(axis)
    angle = undeformed.twist(a, b, axis) if absolute else 0.0
    now = math.cos(angle) * first + math.sin(angle) * second
    own = direction(a, undeformed.seen_from(a, b, now))
    return own, direction(b, first), direction(b, second)
