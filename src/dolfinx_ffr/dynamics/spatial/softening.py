# SPDX-License-Identifier: MIT
"""Where a body in space loses its stiffness by its rotation, and bodies that turn far in a step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from .arrays import ModelArrays
from .integral_gradients import cross_matrices
from .metric import coordinates_of, moments_of
from .motion import rotations_of

Array = NDArray[np.float64]

#: Steps whose stiffness is looked at together.
_CHUNK = 2000
#: Change of the direction of an axis of rotation up to which it counts as fixed.
_FIXED = 1e-3


def softened(model: ModelArrays, body: int, y: Array, v: Array, w: Array) -> Iterator[int]:
    """Steps at which the stiffness of a body, with that by its own inertia, is indefinite.

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
        y: Coordinates over time, shape (instants, n).
        v: Velocities over time, shape (instants, n).
        w: Accelerations over time, shape (instants, n).
    """
    where, P, n = coordinates_of(model, body), moments_of(model, body), int(model.modes[body])
    G = np.einsum("abkk->ab", P[1:, 1:])
    # In the basis of the modes at rest, so that no unit hides a slip.
    squares, modes = scipy.linalg.eigh(model.K[body, :n, :n], G)
    W = cross_matrices(v[:, where.rotation])
    B = W @ W
    loads = B.reshape(len(y), 9)
    parts = P[1:, 1:].transpose(2, 3, 0, 1).reshape(9, n, n)
    if model.stiffened[body]:
        full = (cross_matrices(w[:, where.rotation]) + B).reshape(len(y), 9)
        fall = w[:, where.position] - model.gravity[: len(y)]
        f = np.einsum("tki,tk->ti", rotations_of(y[:, where.rotation]), fall)
        loads = np.hstack([loads, full, f])
        parts = np.concatenate([parts, model.stiffening[body, :, :n, :n]])
    parts = modes.T @ parts @ modes
    parts = 0.5 * (parts + parts.transpose(0, 2, 1))
    for start in range(0, len(y), _CHUNK):
        stiffness = np.diag(squares) + np.tensordot(loads[start : start + _CHUNK], parts, 1)
        soft = np.linalg.eigvalsh(stiffness)[:, 0] < min(0.0, -1e-12 * squares[-1])
        yield from start + np.flatnonzero(soft)


def largest_turn(model: ModelArrays, body: int, y: Array, v: Array, h: Array) -> float:
    """Largest angle by which a body turns in one step about an axis that moves [rad].

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
        y: Coordinates over time, shape (instants, n).
        v: Velocities over time, shape (instants, n).
        h: Length of the step that ends at each instant, shape (instants,) [s].
    """
    where = coordinates_of(model, body)
    omega = v[:, where.rotation]
    speed: Array = np.asarray(np.linalg.norm(omega, axis=1))
    turning = speed > 1e-6 * float(np.max(speed)) + float(np.finfo(np.float64).tiny)
    if not np.any(turning):
        return 0.0
    axes = np.einsum("tij,tj->ti", rotations_of(y[turning][:, where.rotation]), omega[turning])
    axes /= speed[turning, None]
    if np.max(np.linalg.norm(np.cross(axes, axes[0]), axis=1)) < _FIXED:
        return 0.0
    return float(np.max(speed * h))
