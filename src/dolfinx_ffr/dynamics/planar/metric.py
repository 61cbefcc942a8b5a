# SPDX-License-Identifier: MIT
"""Sizes of motions by mass, which do not depend on the basis of the elastic coordinates."""

from __future__ import annotations

import math

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


def least_sizes(model: ModelArrays, duration: float) -> Array:
    """Sizes below which a motion counts as rest: far below what a machine of this size does.

    Args:
        model: Flat arrays of the mechanism.
        duration: Of the motion [s].

    Returns:
        Way and velocity by mass, elastic part by energy, shape (3,).
    """
    least = 1e-6 * length_of(model) * math.sqrt(float(np.sum(model.mass)))
    return np.array([least, least / duration, 1e-6 * least / duration])
