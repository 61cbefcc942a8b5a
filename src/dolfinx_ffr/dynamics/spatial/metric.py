# SPDX-License-Identifier: MIT
"""Sizes of motions in space by mass, which do not depend on the basis of elastic coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .arrays import OF_POINT, ModelArrays
from .coordinates import Coordinates

Array = NDArray[np.float64]


def coordinates_of(model: ModelArrays, body: int) -> Coordinates:
    """Coordinates of a body by name.

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
    """
    return Coordinates(int(model.first[body]), int(model.modes[body]))


def moments_of(model: ModelArrays, body: int) -> Array:
    """Second moments P_ab of a body, shape (modes + 1, modes + 1, 3, 3) [kg m^2].

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
    """
    n, size = int(model.modes[body]) + 1, model.P.shape[1]
    P = model.P[body].reshape(size, 3, 3, size)[:n, :, :, :n]
    return P.transpose(3, 0, 1, 2)


def inertia_of(model: ModelArrays, body: int) -> Array:
    """Inertia tensor of an undeformed body about the origin of its frame, (3, 3) [kg m^2].

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
    """
    P = moments_of(model, body)[0, 0]
    return np.asarray(np.trace(P) * np.eye(3) - P)


def settled(model: ModelArrays, base: Array, y: Array) -> Array:
    """Coordinates after a shift y - base that turns bodies about their own axes, shape (n,).

    Args:
        model: Flat arrays of the mechanism.
        base: Coordinates before it, shape (n,).
        y: Their sum with the shift, shape (n,).
    """
    out = y.copy()
    for b in range(model.first.size):
        where = coordinates_of(model, b).rotation
        turn = Rotation.from_rotvec(base[where]) * Rotation.from_rotvec(y[where] - base[where])
        out[where] = turn.as_rotvec()
    return out


def settled_pullback(model: ModelArrays, shift: Array, bar: Array) -> tuple[Array, Array]:
    """Transpose of :func:`settled` with respect to the shift and to the coordinates.

    Args:
        model: Flat arrays of the mechanism.
        shift: The shift, shape (n,).
        bar: Derivative with respect to the coordinates after it, of rotations to dA = A [dth],
            shape (n,).
    """
    by_shift, by_y = bar.copy(), bar.copy()
    for b in range(model.first.size):
        where = coordinates_of(model, b).rotation
        u = shift[where]
        turn, T = Rotation.from_rotvec(u), tangent_of(u)
        by_shift[where] = T.T @ bar[where]
        by_y[where] = turn.apply(bar[where])
    return by_shift, by_y


def tangent_of(u: Array) -> Array:
    """Derivative T of a rotation with respect to its vector, dA = A [T du], shape (3, 3).

    Args:
        u: Rotation vector, shape (3,) [rad].
    """
    t = float(np.linalg.norm(u))
    matrix = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
    if t < 1e-3:
        b, c = 0.5 - t**2 / 24.0, 1.0 / 6.0 - t**2 / 120.0
    else:
        b, c = (1.0 - np.cos(t)) / t**2, (t - np.sin(t)) / t**3
    return np.asarray(np.eye(3) - b * matrix + c * matrix @ matrix)


def ways(model: ModelArrays, y: Array, start: Array) -> Array:
    """Shifts that lead from one motion to another, shape (instants, n).

    Args:
        model: Flat arrays of the mechanism.
        y: Coordinates over time, shape (instants, n).
        start: Coordinates from which, shape (n,) or (instants, n).
    """
    out = np.asarray(y - start)
    first = np.broadcast_to(start, y.shape).copy()
    for b in range(model.first.size):
        where = coordinates_of(model, b).rotation
        turn = Rotation.from_rotvec(first[:, where]).inv() * Rotation.from_rotvec(y[:, where])
        out[:, where] = turn.as_rotvec()
    return out


def sizes_by_mass(model: ModelArrays, shift: Array) -> Array:
    """Sizes of shifts of all material points, shape (instants,) [m sqrt(kg)].

    Args:
        model: Flat arrays of the mechanism.
        shift: Shifts of the coordinates, shape (instants, n).
    """
    total = np.zeros(len(shift))
    for b in range(model.first.size):
        where, J = coordinates_of(model, b), inertia_of(model, b)
        G = np.einsum("abkk->ab", moments_of(model, b))[1:, 1:]
        elastic, rotation = shift[:, where.elastic], shift[:, where.rotation]
        total += model.mass[b] * np.sum(shift[:, where.position] ** 2, axis=1)
        total += np.sum((rotation @ J) * rotation, axis=1)
        total += np.sum((elastic @ G) * elastic, axis=1)
    return np.sqrt(np.maximum(total, 0.0))


def length_of(model: ModelArrays) -> float:
    """Size of the bodies: largest distance of a marker from the origin of its body's frame [m].

    Where all markers are at the origins it is the largest radius of gyration.

    Args:
        model: Flat arrays of the mechanism.
    """
    used = (model.vector_body >= 0) & (model.vector_kind == OF_POINT)
    length = float(np.max(np.linalg.norm(model.shapes[used, :, 0], axis=1), initial=0.0))
    if length > 0.0:
        return length
    traces = [np.trace(inertia_of(model, b)) / model.mass[b] for b in range(model.first.size)]
    return float(np.sqrt(0.5 * max(traces)))
