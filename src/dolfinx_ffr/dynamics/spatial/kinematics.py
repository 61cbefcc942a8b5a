# SPDX-License-Identifier: MIT
"""Kinematics in space as Python sees them, see kinematics.py of the folder above."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..equations import CONSTRAINTS
from ..kind import Kind
from .arrays import ANGLE, GEAR, RIGID, ROTATION, ModelArrays, Work, constraints, size, work_arrays
from .evaluation import chart, evaluate, measure, pullback
from .stages import turn_stages

Array = NDArray[np.float64]


def _bars(work: Work) -> Array:
    return work.vector_bars


def _places(work: Work) -> Array:
    return work.s


def _forces(work: Work) -> Array:
    springs = np.zeros((work.tension.size, 3))
    springs[:, 0] = work.tension
    return np.concatenate([springs, work.loads])


#: Kinematics in space: positions, rotations and elastic coordinates of each body.
KIND: Kind[ModelArrays, Work] = Kind(
    evaluate,
    pullback,
    measure,
    chart,
    turn_stages,
    work_arrays,
    size,
    constraints,
    _bars,
    _places,
    _forces,
)


def round_off_floor(model: ModelArrays) -> Array:
    """Sizes of coordinates below which their round-off does not fall, shape (n,).

    That of a rotation is that of its matrix, whose entries are numbers up to one.

    Args:
        model: Flat arrays of the mechanism.
    """
    floor = np.zeros(size(model))
    for first in model.first:
        floor[first + ROTATION : first + RIGID] = 1.0
    return floor


def turning_of(model: ModelArrays) -> list[int]:
    """Places of the rotations of all bodies among the coordinates.

    Args:
        model: Flat arrays of the mechanism.
    """
    return [int(first) + ROTATION for first in model.first]


def begin_turns(kinematics: Any, y: Array, turns: Array | None = None) -> None:
    """Let angles of rows be those at the start of a motion.

    Args:
        kinematics: Equations of motion.
        y: Coordinates at the start, shape (n,).
        turns: Angles to which they are close, shape (rows and springs, 2); None is zero.
    """
    if turns is not None:
        kinematics.work.turns[:] = turns
    kinematics.set(y)
    kinematics.evaluate(0, CONSTRAINTS)
    kinematics.work.turns[:] = kinematics.work.angles


def follow_turns(kinematics: Any, y: Array) -> None:
    """Let angles of rows be those along a motion, turns counted.

    Args:
        kinematics: Equations of motion.
        y: Coordinates over time, shape (instants, n).
    """
    work, kind = kinematics.work, kinematics.model.kind
    if not np.any((kind == ANGLE) | (kind == GEAR)):
        return
    begin_turns(kinematics, y[0])
    for instant in range(min(len(y), len(work.turns))):
        kinematics.set(y[instant])
        kinematics.evaluate(instant, CONSTRAINTS)
        work.turns[instant] = work.angles
        if instant + 1 < len(work.turns) - 1:
            work.turns[instant + 1] = work.angles
