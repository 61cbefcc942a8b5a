# SPDX-License-Identifier: MIT
"""Chains of points in the plane: their turns and lengths."""

from __future__ import annotations

import numpy as np

from ..arrays import Array


def cross(a: Array, b: Array) -> Array:
    """The cross products of vectors (..., 2) in the plane."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def angles(a: Array, b: Array) -> Array:
    """The angles (n,) from vectors a to b, (n, 2) each, anticlockwise, in (-pi, pi] [rad]."""
    return np.asarray(np.arctan2(cross(a, b), np.einsum("ij,ij->i", a, b)))


def turns(sides: Array) -> Array:
    """The angles (n - 1,) between sides (n, 2) that follow each other, anticlockwise [rad]."""
    return angles(sides[:-1], sides[1:])


def chord_lengths(points: Array) -> Array:
    """Parameters (n,) of points (n, 2) in proportion to the chords between them, from 0 to 1."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.asarray(along / along[-1])
