# SPDX-License-Identifier: MIT
"""Rows and forces of the plane as the kernels take them: angles become rows POINT of spins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np

from ...arrays import Array
from ...body import BodyMarker
from ...mechanism import BodyVector, Ground, Load, Marker, Moving, Row, RowKind, VectorKind, is_zero
from .lowering import Lowering, same

_POINT, _DIRECTION = VectorKind.POINT, VectorKind.DIRECTION
#: Vectors of the rows that there are in the plane.
_IN_PLANE = {
    RowKind.POINT: (_POINT,) * 2,
    RowKind.PLANE: (_POINT, _POINT, _DIRECTION),
    RowKind.DISTANCE: (_POINT,) * 2,
    RowKind.ANGLE: (_DIRECTION,) * 3,
    RowKind.GEAR: (_DIRECTION,) * 6,
    RowKind.MESH: (_DIRECTION, _DIRECTION, _POINT, _POINT, _DIRECTION, _DIRECTION),
}
#: Largest difference by round-off of an angle of directions from the angle at the start [rad].
_ROUND_OFF = 1e-12


class PlaneLowering(Lowering):
    """Vectors, rows, springs and loads of a mechanism in the plane."""

    d, sides = 2, 4

    def _tabulated(
        self, marker: Ground | Moving, instants: Array, where: str
    ) -> tuple[Array, Array]:
        return marker.tabulate_in_plane(instants, where), np.zeros((1, 3))

    def _prescribed_vector(self, vector: BodyVector, table: Array) -> Array:
        angle = table[:, :, 2]
        if vector.kind == VectorKind.POINT:
            return table[:, :, :2]
        if vector.kind == VectorKind.SPIN:
            return np.stack([angle, 0.0 * angle], axis=2)
        (x, y, _), (c, s) = vector.components, (np.cos(angle[:, :1]), np.sin(angle[:, :1]))
        rate, growth = angle[:, 1:2], angle[:, 2:]
        along = np.hstack([x * c - y * s, x * s + y * c])
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        return np.stack([along, rate * across, growth * across - rate**2 * along], axis=1)

    def _components(self, load: Load, instants: Array, label: str) -> Array:
        table = load.tabulate(instants, label)
        return table[:, ::-1] if load.target.kind == VectorKind.SPIN else table

    def _set_shapes(self, vector: BodyVector, point: BodyMarker, shapes: Array) -> None:
        shapes[:, 0], shapes[0, 1:] = vector.components[:2], point.rotation

    def _check_load(self, load: Load, user: str) -> None:
        marker, (x, y, z) = load.target.marker, load.components
        if load.target.kind == VectorKind.SPIN:
            if not is_zero(x, y):
                raise ValueError(f"{user}: in the plane a moment acts about z; give one component")
            return
        if not is_zero(z):
            raise ValueError(f"{user}: there is no axis z in the plane")
        on_marker = all(same(axis.marker, marker) for axis in load.axes)
        components = [axis.components for axis in load.axes]
        if load.axes and not (on_marker and np.array_equal(components, np.eye(3))):
            raise ValueError(
                f"{user}: in the plane a force acts along the axes of its own marker; leave other "
                "axes out"
            )

    def _own_row(self, row: Row, user: str) -> tuple[Row, float]:
        kind, vectors = row.kind, row.vectors
        if _IN_PLANE.get(kind) != tuple(vector.kind for vector in vectors):
            _refuse_kind(user, row)
        if kind == RowKind.ANGLE:
            offset = self._offset(vectors, row.start_angle, user)
            return _difference_of_spins(row, *(vector.marker for vector in vectors[:2])), offset
        if kind == RowKind.GEAR:
            # Two angles in a ratio, which are zero in the placements.
            offset, halves = 0.0, (vectors[:3], vectors[3:])
            housing = vectors[1].marker
            if not same(housing, vectors[4].marker):
                _refuse_kind(user, row)
            markers = [vectors[0].marker, vectors[3].marker]
            if not isinstance(housing, Ground):
                markers.append(housing)
            for half, factor in zip(halves, (1.0, -row.ratio), strict=True):
                offset += factor * self._offset(half, 0.0, user)
                if isinstance(housing, Ground):
                    offset -= factor * housing.angle
            return _difference_of_spins(row, *markers), offset
        if kind == RowKind.MESH:
            return self._own_mesh(row)
        if kind == RowKind.PLANE and (
            vectors[2].components[2] or not same(vectors[1].marker, vectors[2].marker)
        ):
            _refuse_kind(user, row)
        if row.normal[2]:
            raise ValueError(f"{user}: there is no axis z in the plane")
        if kind == RowKind.POINT and row.normal not in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
            _refuse_kind(user, row)
        return row, 0.0

    def _own_mesh(self, row: Row) -> tuple[Row, float]:
        """Spins and centres of two wheels, and the value of the row minus the kernels' value.

        Angles count from the line of centres, whose own turn counts from the x axis.
        """
        centres = row.vectors[2:4]
        x, y, _ = self.undeformed.position(centres[0].marker) - self.undeformed.position(
            centres[1].marker
        )
        line, offset, spins = math.atan2(y, x), 0.0, []
        for wheel, factor in zip(row.vectors[:2], row.normal[:2], strict=True):
            spins.append(BodyVector(wheel.marker, VectorKind.SPIN))
            angle = self.undeformed.twist(wheel.marker, Ground(), (0.0, 0.0, 1.0)) - line
            from_line = math.atan2(wheel.components[1], wheel.components[0]) + angle
            offset += factor * (math.remainder(from_line, 2.0 * math.pi) - angle)
        return replace(row, vectors=(*spins, *centres), start_angle=line), offset

    def _offset(self, vectors: Sequence[BodyVector], start: float, user: str) -> float:
        """Angle of three vectors minus their markers' angle, with the start's full turns [rad]."""
        direction, first, second = vectors
        (x, y, _), (p, q, _), (r, s, _) = (vector.components for vector in vectors)
        upright = not any(vector.components[2] for vector in vectors)
        if not (upright and same(first.marker, second.marker) and p * s > q * r):
            raise ValueError(
                f"{user}: in the plane angles count about the axis (0, 0, 1); give this axis"
            )
        turns = start - self.undeformed.twist(direction.marker, first.marker, (0.0, 0.0, 1.0))
        angle = math.atan2(y, x) - math.atan2(q, p)
        difference = math.remainder(angle - turns, 2.0 * math.pi)
        return turns if abs(difference) < _ROUND_OFF else turns + difference


def _difference_of_spins(row: Row, *markers: Marker) -> Row:
    """A row that counts the angle of a marker minus ratio times the angle of another marker.

    Both are against a third marker, where there is one.
    """
    spins = tuple(BodyVector(marker, VectorKind.SPIN) for marker in markers)
    return replace(row, kind=RowKind.POINT, vectors=spins, normal=(1.0, 0.0, 0.0))


def _refuse_kind(user: str, row: Row) -> NoReturn:
    raise ValueError(
        f"{user}: a row {row.kind.name} of these vectors, or a spring against it, exists in space "
        "only; in the plane take POINT along x or y, PLANE and DISTANCE of points, ANGLE and GEAR "
        "of directions, or MESH"
    )
