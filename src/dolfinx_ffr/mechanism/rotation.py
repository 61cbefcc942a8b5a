# SPDX-License-Identifier: MIT
"""Rotations in space as users give them."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, TypeAlias, Union

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


#: A rotation: a vector along its axis whose length is the angle [rad], shape (3,); a matrix, shape
#: (3, 3), whose columns are the turned axes; or a rotation of SciPy.
# a union at run time, too, where type hints are read; SciPy's class is loaded later
RotationLike: TypeAlias = Union[ArrayLike, "Rotation"]


class PlacementWarning(UserWarning):
    """A placement is probably wrong.

    The joints close far from where the bodies were placed, so that a placement or a joint is wrong;
    up to 0.35 rad, and some half of the largest body's length, they are corrected without a word.
    Or an angle is more than a full turn, as degrees are.
    """


def ask_for_radians(what: str, angle: float) -> None:
    """Warn of an angle beyond a full turn, which may be one in degrees."""
    if abs(angle) > 2.0 * math.pi:
        warnings.warn(
            f"{what} is {angle:.6g} rad, more than a full turn: if the number is in degrees, give "
            f"np.deg2rad({angle:.6g}); otherwise ignore this PlacementWarning",
            PlacementWarning,
            stacklevel=5,
        )


def _plain(rotation: object) -> object:
    """A rotation of SciPy as its matrix, anything else as it is."""
    as_matrix = getattr(rotation, "as_matrix", None)
    return as_matrix() if callable(as_matrix) else rotation


def checked_rotation(what: str, rotation: object) -> RotationLike:
    """A rotation in tuples, which can be compared; anything else is a TypeError or ValueError.

    A vector longer than a full turn, as one in degrees is, is warned of.
    """
    numbers = validation.real_array(what, _plain(rotation))
    if numbers.shape == (3,):
        ask_for_radians(f"the length of {what}", math.hypot(*numbers))
        return tuple(numbers.tolist())
    needed = "shape (3,), a vector along the axis as long as the angle, or (3, 3), a matrix"
    validation.real_array(what, numbers, (3, 3), expected=needed)
    return tuple(tuple(row) for row in validation.rotation(what, numbers).tolist())


def rotation_matrix(rotation: RotationLike) -> Array:
    """The matrix of a rotation, shape (3, 3)."""
    from scipy.spatial.transform import Rotation

    numbers = np.array(_plain(rotation), dtype=np.float64)
    if numbers.shape == (3, 3):
        return validation.rotation("rotation", numbers)
    return np.asarray(Rotation.from_rotvec(numbers).as_matrix())


def upright_matrix(angle: float) -> Array:
    """The matrix of a rotation about z by an angle [rad], as in the plane, shape (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_vector(rotation: RotationLike) -> Array:
    """The vector along the axis of a rotation as long as its angle, shape (3,) [rad]."""
    from scipy.spatial.transform import Rotation

    numbers = np.array(_plain(rotation), dtype=np.float64)
    if numbers.shape == (3,):
        return numbers
    matrix = validation.rotation("rotation", numbers)
    return np.asarray(Rotation.from_matrix(matrix).as_rotvec())
