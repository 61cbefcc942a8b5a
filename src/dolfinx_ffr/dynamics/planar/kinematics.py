# SPDX-License-Identifier: MIT
"""Planar kinematics as Python sees it, see kinematics.py."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kind import Kind
from .arrays import ModelArrays, Work, size, work_arrays
from .evaluation import evaluate, measure, pullback

Array = NDArray[np.float64]


def _rows(model: ModelArrays) -> int:
    return int(model.kind.size)


def _bars(work: Work) -> Array:
    return work.marker_bars


def _places(work: Work) -> Array:
    return work.z


def _forces(work: Work) -> Array:
    return work.loads


#: Planar kinematics: positions, an angle and elastic coordinates of each body, whose derivatives
#: are the velocities.
KIND: Kind[ModelArrays, Work] = Kind(
    evaluate, pullback, measure, None, None, work_arrays, size, _rows, _bars, _places, _forces
)
