# SPDX-License-Identifier: MIT
"""Joints that have closed the other way round: perpendicular axes know no sign."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from .arrays import DOT, ModelArrays

Array = NDArray[np.float64]

#: Cosines below which two directions count as neither parallel nor opposite.
_CLEAR = 0.5


def reversed_row(model: ModelArrays, joints: Iterable[slice], before: Array, after: Array) -> int:
    """First row of a joint that holds an axis against where it was; -1 if there is none.

    An axis that two markers share is held by two rows: it is perpendicular to two directions of the
    other marker. A third row holds another one that is parallel to the second of them.

    Args:
        model: Flat arrays of the mechanism.
        joints: Rows of each joint.
        before: All vectors where axes are as they should be, shape (vectors, 3).
        after: All vectors, likewise.
    """
    for rows in joints:
        signs = zip(_signs(model, rows, before), _signs(model, rows, after), strict=True)
        for (row, here), (_, there) in signs:
            if abs(here) > _CLEAR and here * there < 0.0:
                return row
    return -1


def _signs(model: ModelArrays, rows: slice, vectors: Array) -> Iterator[tuple[int, float]]:
    """Rows of a joint that hold an axis, and numbers whose sign says which way round."""
    for i in range(rows.start, rows.stop - 1):
        (axis, first), (other, second) = model.side[i, :2], model.side[i + 1, :2]
        if model.kind[i] != DOT or model.kind[i + 1] != DOT or axis != other:
            continue
        yield i, float(vectors[axis] @ np.cross(vectors[first], vectors[second]))
        third = i + 2
        if third < rows.stop and model.kind[third] == DOT:
            yield third, float(vectors[model.side[third, 0]] @ vectors[second])
