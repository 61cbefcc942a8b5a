# SPDX-License-Identifier: MIT
"""What a kind of kinematics offers to Python, beside sizes and derivatives of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from .compilation import Compiled

__all__ = ["Kind"]

Array = NDArray[np.float64]
#: Arrays of a mechanism, and work arrays.
M = TypeVar("M", bound=Any)
W = TypeVar("W", bound=Any)


@dataclass(frozen=True)
class Kind(Generic[M, W]):
    """Compiled functions of a kind of kinematics, and the arrays that they take."""

    #: Equations of motion at one instant.
    evaluate: Compiled
    #: Their transpose.
    pullback: Compiled
    #: Sizes of a motion.
    measure: Compiled
    #: Changes of coordinates; None where the velocities are their derivatives.
    chart: Compiled | None
    #: Rotations through the stages of a step; None likewise.
    turn_stages: Compiled | None
    #: Work arrays of a mechanism.
    work_arrays: Callable[[M], W]
    #: Number of coordinates.
    size: Callable[[M], int]
    #: Number of scalar constraints.
    rows: Callable[[M], int]
    #: Derivatives with respect to shape functions of markers, to which transposes add.
    marker_bars: Callable[[W], Array]
    #: Places of all markers after an evaluation, shape (markers, components).
    places: Callable[[W], Array]
    #: Forces after an evaluation, shape (forces, components).
    forces: Callable[[W], Array]

    @property
    def compiled(self) -> tuple[Compiled, ...]:
        """All compiled functions."""
        every = (self.evaluate, self.pullback, self.measure, self.chart, self.turn_stages)
        return tuple(function for function in every if function is not None)
