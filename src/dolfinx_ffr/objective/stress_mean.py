# SPDX-License-Identifier: MIT
"""Power mean of a stress over points and instants, and its derivatives.

The stress is the length of a few numbers that are linear in coordinates z,

    m^p = sum_pt areas_p times_t s_pt^p,    s_pt = |M_p z_t|.

Points and instants are gone through in tiles that stay in the cache of a core. Coordinates over a
motion that is nearly quasi-static depend on each other: fewer combinations of them have the same
stress but for round-off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, Mask

#: Numbers in one tile of stresses, and instants
TILE, INSTANTS = 150_000, 128
#: Largest shares of the derivative, where stresses are small, and of coordinates that are left out
NEGLIGIBLE, ROUND_OFF = 1e-12, 1e-16


@dataclass(frozen=True, eq=False)
class Mean:
    """A power mean, and what else was seen on the way."""

    value: float  #: The mean [Pa]
    largest: float  #: Largest square of all points and instants, the same on every rank [Pa^2]
    highest: Array  #: Largest square of each point over the time that counts [Pa^2]
    matters: Mask  #: (points, tiles) where in time the derivative is more than round-off


@dataclass(frozen=True, eq=False)
class Stresses:
    """Stress for unit coordinates, coordinates over time, and how much each point counts."""

    modes: Array  #: M, (3 or 6, points, coordinates) [Pa]
    coordinates: Array  #: z, (instants, coordinates)
    areas: Array  #: (points,) share of each point in all of them
    times: Array  #: (instants,) share of each instant in the time; the start may have none

    def mean(self, power: float, gathered: Callable[[Any], list[Any]]) -> Mean:
        """The mean over the points of all ranks, which are ``gathered``; collective."""
        half, counts = 0.5 * power, self.times > 0.0
        times, (history, basis) = self.times[counts], self._compressed()
        tiles, start = _tiles(times), self.coordinates[~counts]
        highest = np.zeros((len(self.areas), len(tiles)))
        # the largest value so far is divided out, so that no power overflows
        largest = reference = total = 0.0
        for part in self._parts():
            modes = self.modes[:, part]
            rest = _squared(start @ modes.swapaxes(1, 2))
            largest = max(largest, float(np.max(rest, initial=0.0)))
            short = (modes @ basis.T).swapaxes(1, 2)
            for k, tile in enumerate(tiles):
                squared = _squared(history[tile] @ short)
                highest[part, k] = np.max(squared, axis=0)
                now = float(np.max(highest[part, k]))
                if now > reference:
                    total *= (reference / now) ** half
                    reference = now
                if reference > 0.0:
                    squared /= reference
                    total += float(times[tile] @ power_of(squared, half) @ self.areas[part])
        ranks = gathered((max(largest, reference), reference, total))
        largest, reference = (max(rank[i] for rank in ranks) for i in (0, 1))
        if reference == 0.0:
            return Mean(0.0, largest, np.max(highest, axis=1), highest > 0.0)
        total = sum(part * (own / reference) ** half for _, own, part in ranks)
        value = math.sqrt(reference) * total ** (1.0 / power)
        least = value * NEGLIGIBLE ** (1.0 / (power - 1.0))
        return Mean(value, largest, np.max(highest, axis=1), highest > least**2)

    def slopes(self, mean: Mean, power: float) -> tuple[Array, Array]:
        """Derivatives of the ``mean`` by M and by z, the latter of this rank's points alone."""
        modes_bar, z_bar = np.zeros_like(self.modes), np.zeros_like(self.coordinates)
        if mean.value == 0.0:
            return modes_bar, z_bar
        counts, exponent = self.times > 0.0, 0.5 * power - 1.0
        history, basis = self._compressed()
        # with their roots in both factors a product has the weights in its power
        lasting = self.times[counts, None] ** (1.0 / power)
        history *= lasting
        scale = self.areas ** (1.0 / power) / mean.value
        by_time = np.zeros((len(history), basis.shape[1]))
        for part in self._parts():
            modes = self.modes[:, part] * scale[part, None]
            short = modes @ basis.T
            bar = np.zeros_like(short)
            for k, tile in enumerate(_tiles(lasting)):
                of = np.flatnonzero(mean.matters[part, k])
                if not len(of):
                    continue
                at = slice(None) if len(of) == modes.shape[1] else of
                stress = history[tile] @ short[:, at].swapaxes(1, 2)
                stress *= power_of(_squared(stress), exponent)
                bar[:, at] += stress.swapaxes(1, 2) @ history[tile]
                for each, of_each in zip(stress, modes[:, at], strict=True):
                    by_time[tile] += each @ of_each
            modes_bar[:, part] = bar @ basis
        modes_bar *= mean.value * scale[:, None]
        z_bar[counts] = mean.value * lasting * by_time
        return modes_bar, z_bar

    def _compressed(self) -> tuple[Array, Array]:
        """Fewer coordinates over the instants that count, and z for unit ones, (fewer, n)."""
        size = np.sqrt(np.einsum("ipn,ipn->n", self.modes, self.modes))
        size[size == 0.0] = 1.0
        z = self.coordinates[self.times > 0.0] * size
        u, values, basis = np.linalg.svd(z, full_matrices=False)
        kept = values > ROUND_OFF * np.max(values, initial=0.0)
        return u[:, kept] * values[kept], basis[kept] / size

    def _parts(self) -> list[slice]:
        """Points that are gone through at a time."""
        several = max(1, TILE // (len(self.modes) * INSTANTS))
        return [slice(i, i + several) for i in range(0, len(self.areas), several)]


def _squared(stress: Array) -> Array:
    """The squares (instants, points) of components (3 or 6, instants, points)."""
    total, more = np.square(stress[0]), np.empty_like(stress[0])
    for each in stress[1:]:
        total += np.square(each, out=more)
    return np.asarray(total)


def _tiles(times: Array) -> list[slice]:
    """Instants that are gone through at a time."""
    return [slice(i, i + INSTANTS) for i in range(0, len(times), INSTANTS)]


def power_of(values: Array, exponent: float) -> Array:
    """Values to a power, by products where it is a whole number; the values are overwritten."""
    if exponent != int(exponent):
        return np.asarray(values**exponent)
    left, rest = int(exponent), None
    while left > 1:
        if left % 2:
            rest = values.copy() if rest is None else np.multiply(rest, values, out=rest)
        values *= values
        left //= 2
    if left == 0:
        return np.ones_like(values)
    return values if rest is None else np.multiply(rest, values, out=rest)
