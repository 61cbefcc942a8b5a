# SPDX-License-Identifier: MIT
"""Matrices of a body as the compiled kernels take them, in the plane and in space alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["inverse_mass", "padded_stiffening"]

Array = NDArray[np.float64]


def padded_stiffening(stiffening: Array, modes: int) -> Array:
    """Geometric stiffness (n, r, r), exactly symmetric, with rows and columns of zeros added.

    Args:
        stiffening: The geometric stiffness, shape (n, r, r).
        modes: Number of rows to have.
    """
    r = stiffening.shape[-1]
    out = np.zeros((len(stiffening), modes, modes))
    out[:, :r, :r] = 0.5 * (stiffening + stiffening.transpose(0, 2, 1))
    return out


def inverse_mass(G: Array) -> Array:
    """Inverse of a mass matrix, found at unit diagonal, where its units do not matter.

    Args:
        G: The mass matrix, shape (r, r).
    """
    scale = 1.0 / np.sqrt(np.diag(G))
    inverse = np.outer(scale, scale) * np.linalg.inv(G * np.outer(scale, scale))
    return 0.5 * (inverse + inverse.T)
