# SPDX-License-Identifier: MIT
"""Sizes of motions by mass, which do not depend on the basis of elastic coordinates."""

from __future__ import annotations

import numpy as np

from ...arrays import Array
from .arrays import DISTANCE, OF_POINT, PLANE, POINT
from .body_arrays import ModelArrays


def elastic_mass(model: ModelArrays, body: int) -> Array:
    """Mass matrix of the elastic coordinates, shape (modes, modes) [kg m^2]."""
    n = int(model.modes[body]) + 1
    return model.G[body, 1:n, 1:n]


def mass_norm(model: ModelArrays, shift: Array) -> Array:
    """Sizes of shifts (instants, n) of all material points, shape (instants,) [m sqrt(kg)]."""
    total = np.zeros(len(shift))
    for b in range(model.first.size):
        columns, G = model.coordinates(b), elastic_mass(model, b)
        J = model.inertia(model.moments(b)[0, 0])
        elastic = shift[:, columns.elastic]
        rotation = shift[:, columns.rotation].reshape(len(shift), len(J))
        total += model.mass[b] * np.sum(shift[:, columns.position] ** 2, axis=1)
        total += np.sum((rotation @ J) * rotation, axis=1)
        total += np.sum((elastic @ G) * elastic, axis=1)
    return np.sqrt(np.maximum(total, 0.0))


def length_of(model: ModelArrays) -> float:
    """Size of the bodies: largest distance of a marker from the origin of its body's frame [m].

    Where all markers are at the origins it is the largest radius of gyration.
    """
    used = (model.vector_body >= 0) & (model.vector_kind == OF_POINT)
    length = float(np.max(np.linalg.norm(model.shapes[used, :, 0], axis=1), initial=0.0))
    squares = [np.trace(model.moments(b)[0, 0]) for b in range(model.first.size)]
    return length or float(np.sqrt(np.max(np.array(squares) / model.mass)))


def largest_length(model: ModelArrays) -> float:
    """Largest length that constraints add up at the first instant [m].

    These lengths are arms of markers, prescribed positions, distances and displacements along
    lines.
    """
    of_point, ours = model.vector_kind == OF_POINT, model.vector_body >= 0
    arms = np.linalg.norm(model.shapes[of_point & ours, :, 0], axis=-1)
    places = model.prescribed[0, model.vector_slot[of_point & ~ours], 0]
    # the same kinds of rows hold angles, between spins
    kind, of_length = model.kind, of_point[model.side[:, 0]]
    of_length &= (kind == POINT) | (kind == PLANE) | (kind == DISTANCE)
    distances = model.drive[0, of_length, 0]
    return float(max(np.abs(lengths).max(initial=0.0) for lengths in (arms, places, distances)))


def norm_floors(model: ModelArrays, duration: float) -> Array:
    """Sizes below which a motion of a duration [s] counts as rest: far below what it usually does.

    Way and velocity by mass, elastic part by energy, forces by inverse mass, shape (4,).
    """
    least = 1e-6 * length_of(model) * float(np.sqrt(np.sum(model.mass)))
    return np.array([least, least / duration, 1e-6 * least / duration, least / duration**2])
