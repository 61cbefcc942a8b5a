# SPDX-License-Identifier: MIT
"""Sizes of motions by mass, which do not depend on the basis of the elastic coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .arrays import ModelArrays
from .coordinates import Coordinates

Array = NDArray[np.float64]


def coordinates_of(model: ModelArrays, body: int) -> Coordinates:
    """Coordinates of a body by name.

    Args:
        model: Flat arrays of the mechanism.
        body: Number of the body.
    """
    return Coordinates(int(model.first[body]), int(model.modes[body]))


def sizes_by_mass(model: ModelArrays, shift: Array) -> Array:
    """Sizes of shifts of all material points, shape (instants,) [m sqrt(kg)].

    Args:
        model: Flat arrays of the mechanism.
        shift: Shifts of the coordinates, shape (instants, n).
    """
    total = np.zeros(len(shift))
    for b in range(model.first.size):
        where, G = coordinates_of(model, b), model.G[b, : model.modes[b] + 1, : model.modes[b] + 1]
        position, rotation = shift[:, where.position], shift[:, where.rotation]
        elastic = shift[:, where.elastic]
        total += model.mass[b] * np.sum(position**2, axis=1) + G[0, 0] * rotation**2
        total += np.sum((elastic @ G[1:, 1:]) * elastic, axis=1)
    return np.sqrt(np.maximum(total, 0.0))


def length_of(model: ModelArrays) -> float:
    """Size of the bodies: largest distance of a marker from the origin of its body's frame [m].

    Where all markers are at the origins it is the largest radius of gyration.

    Args:
        model: Flat arrays of the mechanism.
    """
    used = model.marker_body >= 0
    length = float(np.max(np.linalg.norm(model.shapes[used, :, 0], axis=1), initial=0.0))
    return length or float(np.sqrt(np.max(model.G[:, 0, 0] / model.mass)))


def settled(model: ModelArrays, base: Array, y: Array) -> Array:
    """Coordinates after a shift y - base, shape (n,).

    Args:
        model: Flat arrays of the mechanism.
        base: Coordinates before it, shape (n,).
        y: Their sum with the shift, shape (n,).
    """
    return y


def settled_pullback(model: ModelArrays, shift: Array, bar: Array) -> tuple[Array, Array]:
    """Transpose of :func:`settled` with respect to the shift and to the coordinates.

    Args:
        model: Flat arrays of the mechanism.
        shift: The shift, shape (n,).
        bar: Derivative with respect to the coordinates after it, shape (n,).
    """
    return bar, bar


def ways(model: ModelArrays, y: Array, start: Array) -> Array:
    """Shifts that lead from one motion to another, shape (instants, n).

    Args:
        model: Flat arrays of the mechanism.
        y: Coordinates over time, shape (instants, n).
        start: Coordinates from which, shape (n,) or (instants, n).
    """
    return y - start
