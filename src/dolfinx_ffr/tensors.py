# SPDX-License-Identifier: MIT
"""Matrices and vectors of rigid rotations in space, for one matrix or a stack of them."""

from __future__ import annotations

import numpy as np

from .arrays import Array


def cross_matrix(x: Array) -> Array:
    """The matrix of the cross product with a vector x, shape (3, 3)."""
    return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])


def axial(Z: Array) -> Array:
    """The vectors of the antisymmetric parts of matrices (..., 3, 3), shape (..., 3)."""
    i, j = np.array([2, 0, 1]), np.array([1, 2, 0])
    return np.asarray(Z[..., i, j] - Z[..., j, i])


def theta(Z: Array) -> Array:
    """The inertia tr(Z) 1 - Z of second moments Z, shape (..., 3, 3)."""
    return np.trace(Z, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - Z


def of_theta(T: Array) -> Array:
    """The second moments Z whose inertia theta(Z) is T, shape (..., 3, 3)."""
    return 0.5 * np.trace(T, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - T
