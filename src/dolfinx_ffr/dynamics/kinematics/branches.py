# SPDX-License-Identifier: MIT
"""Joints that have closed the other way round, and axes that nothing holds.

Perpendicular axes know no sign. An angle about an axis means what it says as long as both markers
share the axis, which another joint has to see to; and the rows of a bushing are sines of angles.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ...arrays import Array, Integers
from .arrays import ANGLE, DOT, GEAR, MESH, constraints
from .body_arrays import ModelArrays

#: Cosines below which two directions count as neither parallel nor opposite.
_CLEAR = 0.5
#: Instants that are looked at, at most
_LOOKS = 400


def reversed_row(model: ModelArrays, joints: Iterable[slice], before: Array, after: Array) -> int:
    """First row of a joint that holds an axis against where it was; -1 if there is none.

    An axis that two markers share is held by two rows: it is perpendicular to two directions of the
    other marker. A third row holds another one that is parallel to the second of them. Vectors
    (vectors, 3) are given where axes are as they should be, and after.
    """
    for rows in joints:
        signs = zip(_signs(model, rows, before), _signs(model, rows, after), strict=True)
        for (row, sign_before), (_, sign_after) in signs:
            if abs(sign_before) > _CLEAR and sign_before * sign_after < 0.0:
                return row
    return -1


def holds_axes(model: ModelArrays) -> bool:
    """Whether there are rows of joints that hold directions; in the plane there are none."""
    return bool(np.any(model.kind[: constraints(model)] == DOT))


def _signs(model: ModelArrays, rows: slice, vectors: Array) -> Iterator[tuple[int, float]]:
    """Rows of a joint that hold an axis, and numbers whose sign says which way round."""
    for i in range(rows.start, rows.stop - 1):
        (axis, direction), (next_axis, next_direction) = model.side[i, :2], model.side[i + 1, :2]
        if model.kind[i] != DOT or model.kind[i + 1] != DOT or axis != next_axis:
            continue
        yield i, float(vectors[axis] @ np.cross(vectors[direction], vectors[next_direction]))
        third = i + 2
        if third < rows.stop and model.kind[third] == DOT:
            yield third, float(vectors[model.side[third, 0]] @ vectors[next_direction])


def tilts(model: ModelArrays, y: Array) -> Array:
    """Largest sine of the angle by which the axis of each row tilts, shape (rows and springs,).

    For a spring of a bushing about an axis it is the sine of the spring's angle. It is zero for all
    other rows except angles about an axis, couplings and gears. Coordinates y are of shape
    (instants, n).
    """
    out, springs = np.zeros(model.kind.size), constraints(model)
    instants = np.unique(np.linspace(0, len(y) - 1, _LOOKS).astype(int))
    for i, kind in enumerate(model.kind):
        sides = model.side[i][model.side[i] >= 0]
        if kind not in (ANGLE, GEAR, MESH) and (kind != DOT or i < springs):
            continue
        if kind == MESH:
            if len(sides) < 6:
                continue  # in the plane angles are coordinates
            sides = sides[[0, 4, 5, 1, 4, 5]]  # without the centres of the wheels
        s = [_direction(model, int(e), y, instants) for e in sides]
        if kind == DOT:
            sines = [np.sum(s[0] * s[1], axis=1)]
        else:
            triples = zip(s[::3], s[1::3], s[2::3], strict=True)
            sines = [np.sum(direction * np.cross(a, b), axis=1) for direction, a, b in triples]
        out[i] = np.max(np.abs(sines))
    return out


def _direction(model: ModelArrays, e: int, y: Array, instants: Integers) -> Array:
    """A direction over time in the global axes, shape (instants, 3)."""
    b = int(model.vector_body[e])
    if b < 0:
        return np.asarray(model.prescribed[instants, model.vector_slot[e], 0])
    columns, shapes = model.coordinates(b), model.shapes[e]
    q = y[instants][:, columns.elastic]
    local = shapes[:, 0] + q @ shapes[:, 1 : q.shape[1] + 1].T
    return np.einsum("tij,tj->ti", model.rotations(y[instants][:, columns.rotation]), local)
