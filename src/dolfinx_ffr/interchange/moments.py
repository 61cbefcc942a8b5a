# SPDX-License-Identifier: MIT
"""Contractions of second moments P_ab = int rho w_a w_b^T, and moments from their contractions."""

from __future__ import annotations

import numpy as np

from ..arrays import Array


def cross_matrix(x: Array) -> Array:
    """The matrix of the cross product with a vector x, shape (3, 3)."""
    return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])


def theta(Z: Array) -> Array:
    """The matrices tr(Z) 1 - Z, shape (..., 3, 3)."""
    return np.trace(Z, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - Z


def of_theta(T: Array) -> Array:
    """The matrices Z with theta(Z) = T, shape (..., 3, 3)."""
    return 0.5 * np.trace(T, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - T


def axial(Z: Array) -> Array:
    """The vectors of the antisymmetric parts of matrices (..., 3, 3), shape (..., 3)."""
    i, j = np.array([2, 0, 1]), np.array([1, 2, 0])
    return np.asarray(Z[..., i, j] - Z[..., j, i])


#: Pairs of axes of products 11, 22, 33, 12, 23, 13
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))


def centrifugal(Z: Array) -> Array:
    """Coefficients of w . Z w - w^2 tr Z by products of angular velocities (`PAIRS`), (..., 6)."""
    turned = -theta(Z)
    parts = [turned[..., i, j] + (turned[..., j, i] if i != j else 0.0) for i, j in PAIRS]
    return np.stack(parts, axis=-1)


def of_parts(coefficients: Array, vectors: Array) -> Array:
    """The matrices (..., 3, 3) with these `centrifugal` (..., 6) and `axial` (..., 3) parts."""
    Z = np.empty((*coefficients.shape[:-1], 3, 3))
    trace = -0.5 * coefficients[..., :3].sum(axis=-1)
    for c, (i, j) in zip(np.moveaxis(coefficients, -1, 0), PAIRS, strict=True):
        if i == j:
            Z[..., i, i] = c + trace
            continue
        # axial's component beside i and j is Z_ji - Z_ij for 12 and 23, and the negative for 13
        turn = vectors[..., 3 - i - j] * (1.0 if j == i + 1 else -1.0)
        Z[..., i, j], Z[..., j, i] = 0.5 * (c - turn), 0.5 * (c + turn)
    return Z
