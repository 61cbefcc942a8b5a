# SPDX-License-Identifier: MIT
"""States along a motion at which forces were evaluated, with the adjoint there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Samples"]

Array = NDArray[np.float64]


class Samples(NamedTuple):
    """States at some instants, and the adjoint of the forces there."""

    #: Numbers of the instants in the tables of the mechanism, shape (samples,).
    instants: NDArray[np.int64]
    #: Coordinates, shape (samples, n).
    y: Array
    #: Velocities, shape (samples, n).
    v: Array
    #: Accelerations, shape (samples, n).
    w: Array
    #: Adjoint of the forces, shape (samples, n).
    adjoint: Array

    def __add__(self, other: Samples) -> Samples:  # type: ignore[override]
        """The samples of both."""
        return Samples(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))
