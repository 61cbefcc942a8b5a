# SPDX-License-Identifier: MIT
"""Rotations in space as users give them."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

__all__ = ["RotationLike", "checked_rotation", "rotation_matrix", "rotation_vector"]

Array = NDArray[np.float64]

#: A rotation: a vector along its axis whose length is the angle [rad], shape (3,); a matrix, shape
#: (3, 3), whose columns are the turned axes; or a rotation of SciPy.
RotationLike: TypeAlias = "ArrayLike | Rotation"

#: Largest deviation of a matrix from one of a rotation.
_ORTHOGONAL = 1e-9


def _plain(rotation: object) -> object:
    """A rotation of SciPy as its matrix, anything else as it is."""
    as_matrix = getattr(rotation, "as_matrix", None)
    return as_matrix() if callable(as_matrix) else rotation


def checked_rotation(what: str, rotation: object) -> RotationLike:
    """A rotation in tuples, which can be compared; what is none is refused.

    Args:
        what: Name of the rotation, for the message.
        rotation: What is given for it.

    Raises:
        TypeError: If it holds something else than numbers.
        ValueError: If it has another shape, or is a matrix but none of a rotation.
    """
    given = validation.real_array(what, _plain(rotation))
    if given.shape == (3,):
        return tuple(given.tolist())
    needed = "shape (3,), a vector along the axis as long as the angle, or (3, 3), a matrix"
    validation.real_array(what, given, (3, 3), expected=needed)
    defect = float(np.max(np.abs(given.T @ given - np.eye(3))))
    if defect > _ORTHOGONAL or np.linalg.det(given) < 0.0:
        raise ValueError(
            f"{what} must be the matrix of a rotation, whose columns are perpendicular unit "
            f"vectors in a right-handed order, but it is {given.tolist()}"
        )
    return tuple(tuple(row) for row in given.tolist())


def rotation_matrix(rotation: RotationLike) -> Array:
    """The matrix of a rotation, shape (3, 3).

    Args:
        rotation: The rotation, see RotationLike.
    """
    from scipy.spatial.transform import Rotation

    given = np.array(_plain(rotation), dtype=np.float64)
    if given.shape == (3, 3):
        return given
    return np.asarray(Rotation.from_rotvec(given).as_matrix())


def rotation_vector(rotation: RotationLike) -> Array:
    """The vector along the axis of a rotation as long as its angle, shape (3,) [rad].

    Args:
        rotation: The rotation, see RotationLike.
    """
    from scipy.spatial.transform import Rotation

    given = np.array(_plain(rotation), dtype=np.float64)
    if given.shape == (3,):
        return given
    return np.asarray(Rotation.from_matrix(given).as_rotvec())
