# SPDX-License-Identifier: MIT
"""Power mean of a stress over points and instants, and its derivatives.

The stress is the length of a few numbers that are linear in coordinates z,

    m^p = sum_pt areas_p times_t s_pt^p,    s_pt = |M_p z_t|.

Points and instants are gone through in tiles that stay in the cache of a core. Coordinates over a
motion that is nearly quasi-static depend on each other: fewer combinations of them have the same
stress but for round-off. Where steps are small s^p is smooth: a polynomial through some instants
gives it at all of them. Where it does so within `SMOOTH` for the points of highest stress, about as
well as the equations of motion are solved, only these instants are gone through. Vibrations that
the steps hardly resolve, and round-off, are not smooth, but small: the polynomial z~ closest to z
in the mean over these times takes its place. As the slopes of the mean by z~ are polynomials, too,
z - z~ adds to the mean by its square alone, and where that is below `SMOOTH` it is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from ..arrays import Array, Integers

#: Points and instants of a tile
POINTS, INSTANTS = 384, 128
#: Largest share of coordinates that are left out
ROUND_OFF = 1e-15
#: Largest error of s^p and s^(p-1) at instants that are left out, of their largest values
SMOOTH = 1e-10
#: Shares of instants that may tell of all, of how many points that is tried, and every so manieth
#: instant tells which ones
_SHARES, _TRIED, _LOOKED = (0.125, 0.1875, 0.25, 0.375), 16, 32
#: Powers that smooth coordinates have, as a share of those by which powers of stresses are told
_DEGREE = 2 / 3
#: Share of the largest square from which on that of a point is sought at all instants
_SOUGHT = 0.5


class Span(NamedTuple):
    """Instants that follow each other."""

    where: slice  #: In those that count
    shares: Array  #: In the time, of the instants that tell of all of them
    spread: Array | None  #: From values at those to values at all; None if they are all
    smooth: Array | None  #: From coordinates at all to smooth ones at those that tell


@dataclass(frozen=True, eq=False)
class Mean:
    """A power mean, and what else was seen on the way."""

    value: float  #: The mean [Pa]
    largest: float  #: Largest square of all points and instants, the same on every rank [Pa^2]
    highest: Array  #: Largest square of each point over the time that counts [Pa^2]
    spans: list[Span]


@dataclass(frozen=True, eq=False)
class Stresses:
    """Stress for unit coordinates, coordinates over time, and how much each point counts."""

    modes: Array  #: M, (3 or 6, points, coordinates) [Pa]
    coordinates: Array  #: z, (instants, coordinates)
    areas: Array  #: (points,) share of each point in all of them
    times: Array  #: (instants,) share of each instant in the time; the start may have none

    def mean(self, power: float, gathered: Callable[[Any], list[Any]]) -> Mean:
        """The mean over the points of all ranks, which are ``gathered``."""
        half, counts, work = 0.5 * power, self.times > 0.0, _Work(len(self.modes))
        history, basis = self._compressed()
        spans = self._spans(half, history, basis, work)
        told, shares = _told(spans, history)
        tiles, start = _tiles(told), self.coordinates[~counts]
        highest = np.zeros(len(self.areas))
        # the largest value so far is divided out, so that no power overflows
        largest = reference = total = 0.0
        for part in self._parts():
            modes = self.modes[:, part]
            rest = np.sum((start @ modes.swapaxes(1, 2)) ** 2, axis=0)
            largest = max(largest, float(np.max(rest, initial=0.0)))
            short = modes @ basis.T
            for tile in tiles:
                work.stress(told[tile], short)
                squared = work.squares()
                highest[part] = np.maximum(highest[part], np.max(squared, axis=0))
                now = float(np.max(highest[part]))
                if now > reference:
                    total *= (reference / now) ** half
                    reference = now
                if reference > 0.0:
                    squared /= reference
                    total += float(shares[tile] @ power_of(squared, half) @ self.areas[part])
        left_out = any(span.smooth is not None for span in spans)
        sought = np.flatnonzero(left_out & (highest > _SOUGHT * reference))
        for some in (sought[i : i + POINTS] for i in range(0, len(sought), POINTS)):
            short, highest[some] = self.modes[:, some] @ basis.T, 0.0
            for tile in _tiles(history):
                work.stress(history[tile], short)
                highest[some] = np.maximum(highest[some], np.max(work.squares(), axis=0))
        ranks = gathered((max(largest, float(np.max(highest, initial=0.0))), reference, total))
        largest, reference = (max(rank[i] for rank in ranks) for i in (0, 1))
        if reference == 0.0:
            return Mean(0.0, largest, highest, spans)
        total = sum(part * (own / reference) ** half for _, own, part in ranks)
        value = math.sqrt(reference) * total ** (1.0 / power)
        return Mean(value, largest, highest, spans)

    def slopes(self, mean: Mean, power: float) -> tuple[Array, Array]:
        """Derivatives of the ``mean`` by M and by z, the latter of this rank's points alone."""
        modes_bar, z_bar = np.zeros_like(self.modes), np.zeros_like(self.coordinates)
        if mean.value == 0.0:
            return modes_bar, z_bar
        counts, exponent, work = self.times > 0.0, 0.5 * power - 1.0, _Work(len(self.modes))
        history, basis = self._compressed()
        told, shares = _told(mean.spans, history)
        # with its root in both factors a product has the area in its power
        scale = self.areas ** (1.0 / power) / mean.value
        by_time = np.zeros((len(told), z_bar.shape[1]))
        for part in self._parts():
            modes = self.modes[:, part] * scale[part, None]
            short = modes @ basis.T
            bar = np.zeros_like(short)
            for tile in _tiles(told):
                stress = work.stress(told[tile], short)
                stress *= power_of(work.squares(), exponent)
                bar += stress.swapaxes(1, 2) @ (shares[tile, None] * told[tile])
                for each, of_each in zip(stress, modes, strict=True):
                    by_time[tile] += each @ of_each
            modes_bar[:, part] = bar @ basis
        modes_bar *= mean.value * scale[:, None]
        own = np.split(by_time, np.cumsum([len(span.shares) for span in mean.spans])[:-1])
        spreads = (span.spread for span in mean.spans)
        every = [b if to is None else to @ b for b, to in zip(own, spreads, strict=True)]
        z_bar[counts] = mean.value * self.times[counts, None] * np.vstack(every)
        return modes_bar, z_bar

    def _compressed(self) -> tuple[Array, Array]:
        """Fewer coordinates over the instants that count, and z for unit ones, (fewer, n)."""
        size = np.sqrt(np.einsum("ipn,ipn->n", self.modes, self.modes))
        size[size == 0.0] = 1.0
        z = self.coordinates[self.times > 0.0] * size
        u, values, basis = np.linalg.svd(z, full_matrices=False)
        kept = values > ROUND_OFF * np.max(values, initial=0.0)
        return u[:, kept] * values[kept], basis[kept] / size

    def _spans(self, half: float, history: Array, basis: Array, work: _Work) -> list[Span]:
        """All instants, and which of them tell of all."""
        every, found = history[::_LOOKED].copy(), list[Span]()
        seen = np.zeros((math.ceil(len(history) / INSTANTS), len(self.areas)))
        each = INSTANTS // _LOOKED
        for part in self._parts():
            short = self.modes[:, part] @ basis.T
            for tile in _tiles(every):  # each has the instants of whole spans
                work.stress(every[tile], short)
                begins = np.arange(0, len(every[tile]), each)
                spans = slice(tile.start // each, tile.start // each + len(begins))
                seen[spans, part] = np.maximum.reduceat(work.squares(), begins, axis=0)
        top, tried = float(np.max(seen, initial=0.0)), min(_TRIED, POINTS, len(self.areas))
        for first in range(0, len(history), INSTANTS):
            where = slice(first, min(first + INSTANTS, len(history)))
            own, times = history[where], self.times[self.times > 0.0][where]
            span = Span(where, times, None, None)
            if top > 0.0 and half == int(half):
                points = np.argpartition(seen[len(found)], -tried)[-tried:]
                modes = self.modes[:, points] @ (basis.T / math.sqrt(top))
                work.stress(own, modes)
                exact = work.squares().copy()
                for told, powers, spread in _spreads(len(times)):
                    from_all, to_all = _closest(powers, times)
                    smooth = to_all @ (from_all @ own)
                    work.stress(own - smooth, modes)
                    rest = work.squares().copy()
                    work.stress(smooth, modes)
                    squared = work.squares()
                    # in the mean, and in the derivative
                    below = power_of(squared.copy(), half - 1.0)
                    values = np.hstack([below * squared, below * math.sqrt(np.max(squared))])
                    error = spread @ values[told] - values
                    # beyond what the rest adds by the slopes
                    more = below * (squared + half * (exact - squared - rest))
                    more -= power_of(exact.copy(), half)
                    if max(np.max(np.abs(each)) for each in (error, more)) <= SMOOTH:
                        span = Span(where, times @ spread, spread, to_all[told] @ from_all)
                        break
            found.append(span)
        return found

    def _parts(self) -> list[slice]:
        """Points that are gone through at a time."""
        return [slice(i, i + POINTS) for i in range(0, len(self.areas), POINTS)]


class _Work:
    """Places for the stresses of a tile; new ones for each would take as long as the products."""

    def __init__(self, components: int) -> None:
        self._places = np.empty((components + 2, INSTANTS * POINTS))

    def stress(self, history: Array, short: Array) -> Array:
        """The stress (3 or 6, instants, points) of a history of coordinates."""
        shape = len(history), short.shape[1]
        places = self._places[:, : math.prod(shape)].reshape(len(self._places), *shape)
        *_, self._squared, self._more = places
        self._stress: Array = np.matmul(history, short.swapaxes(1, 2), out=places[:-2])
        return self._stress

    def squares(self) -> Array:
        """The squares (instants, points) of the last one."""
        total: Array = np.square(self._stress[0], out=self._squared)
        for each in self._stress[1:]:
            total += np.square(each, out=self._more)
        return total


@cache
def _spreads(instants: int) -> list[tuple[Integers, Array, Array]]:
    """Some of so many instants, dense at the ends; polynomials, and those through them, at all."""
    every, found = np.linspace(-1.0, 1.0, instants), []
    for count in (int(share * instants) for share in _SHARES if share * instants >= 2.0):
        nodes = 0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count)
        told = np.unique(np.round(nodes * (instants - 1)).astype(int))
        powers = chebvander(every, len(told) - 1)
        found.append((told, powers, np.linalg.solve(powers[told].T, powers.T).T))
    return found


def _closest(powers: Array, times: Array) -> tuple[Array, Array]:
    """From values at instants of so long ``times`` to the closest sum of ``powers``, and back."""
    root = np.sqrt(times)[:, None]
    basis, _ = np.linalg.qr(root * powers[:, : int(_DEGREE * powers.shape[1])])
    return (root * basis).T, basis / root


def _told(spans: list[Span], history: Array) -> tuple[Array, Array]:
    """Coordinates at the instants that tell of all that count, and their shares in the time."""
    own = [history[where] if to is None else to @ history[where] for where, *_, to in spans]
    shares = [np.zeros(0), *(span.shares for span in spans)]
    return np.concatenate([history[:0], *own]), np.concatenate(shares)


def _tiles(told: Array) -> list[slice]:
    """Instants that are gone through at a time."""
    return [slice(i, i + INSTANTS) for i in range(0, len(told), INSTANTS)]


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
