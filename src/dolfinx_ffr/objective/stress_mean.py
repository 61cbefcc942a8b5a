# SPDX-License-Identifier: MIT
"""Power mean of a stress over points and instants, and its derivatives.

The stress is the length of a few numbers that are linear in coordinates z,

    m^p = sum_pt areas_p times_t s_pt^p,    s_pt = |M_p z_t|.

The sum is taken in tiles of points and instants that fit into the cache of a core, with three
savings:

- the coordinates of a nearly quasi-static motion depend on each other, so fewer combinations of
  them have the same stress but for round-off;
- with small steps s^p is smooth, and a polynomial through some instants gives it at all of them. If
  it does so within `SMOOTH` for the points of highest stress, about the accuracy of the equations
  of motion, the sum is over these instants only;
- vibrations that the steps hardly resolve, and round-off, are not smooth, but small. They are left
  out: z is replaced by the closest polynomial z~ in the mean over these times. As the slopes of the
  mean by z~ are polynomials, too, the error is of second order in z - z~, and below `SMOOTH`.
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

#: Numbers of points and instants of a tile
POINTS, INSTANTS = 384, 128
#: Largest size of coordinates that are left out, as a share of the largest one
ROUND_OFF = 1e-15
#: Largest error of s^p and s^(p-1) at instants that are left out, as a share of their largest value
SMOOTH = 1e-10
#: Shares of the instants of a span that are tried as nodes
_SHARES = (0.125, 0.1875, 0.25, 0.375)
#: Number of points of highest stress for which nodes are tried
_TRIED = 16
#: Distance of the instants, in steps, at which these points are found
_SAMPLED = 32
#: Degree of smooth coordinates, relative to the degree of powers of the stress
_DEGREE = 2 / 3
#: Least square of the stress of a point, as a share of the largest one, that is computed at all
#: instants
_CANDIDATE = 0.5


class Span(NamedTuple):
    """Successive instants, and nodes among them that represent all."""

    instants: slice  #: Among those that count
    shares: Array  #: (nodes,) share of each node in the time
    interpolation: Array | None  #: (instants, nodes); None if all instants are nodes
    smoothing: Array | None  #: (nodes, instants), from coordinates to smooth ones at the nodes


@dataclass(frozen=True, eq=False)
class Mean:
    """A power mean, and the largest values."""

    value: float  #: The mean [Pa]
    largest: float  #: Largest square of all points and instants, the same on every rank [Pa^2]
    highest: Array  #: Largest square of each point over the time that counts [Pa^2]
    spans: list[Span]


@dataclass(frozen=True, eq=False)
class Stresses:
    """Stress for unit coordinates, coordinates over time, and weights of points and instants."""

    modes: Array  #: M, (3 or 6, points, coordinates) [Pa]
    coordinates: Array  #: z, (instants, coordinates)
    areas: Array  #: (points,) share of each point in all of them
    times: Array  #: (instants,) share of each instant in the time; the start may have none

    def mean(self, power: float, gathered: Callable[[Any], list[Any]]) -> Mean:
        """The mean over the points of all ranks, whose values ``gathered`` collects."""
        half, counts, work = 0.5 * power, self.times > 0.0, _Work(len(self.modes))
        history, basis = self._compressed()
        spans = self._spans(half, history, basis, work)
        coordinates, shares = _thinned(spans, history)
        tiles, start = _tiles(coordinates), self.coordinates[~counts]
        highest = np.zeros(len(self.areas))
        # the largest value so far is divided out, so that no power overflows
        largest = reference = total = 0.0
        for points in self._parts():
            modes = self.modes[:, points]
            at_start = np.sum((start @ modes.swapaxes(1, 2)) ** 2, axis=0)
            largest = max(largest, float(np.max(at_start, initial=0.0)))
            compressed_modes = modes @ basis.T
            for tile in tiles:
                work.stress(coordinates[tile], compressed_modes)
                squared = work.squares()
                highest[points] = np.maximum(highest[points], np.max(squared, axis=0))
                highest_so_far = float(np.max(highest[points]))
                if highest_so_far > reference:
                    total *= (reference / highest_so_far) ** half
                    reference = highest_so_far
                if reference > 0.0:
                    squared /= reference
                    total += float(shares[tile] @ power_of(squared, half) @ self.areas[points])
        thinned = any(span.smoothing is not None for span in spans)
        candidates = np.flatnonzero(thinned & (highest > _CANDIDATE * reference))
        for batch in (candidates[i : i + POINTS] for i in range(0, len(candidates), POINTS)):
            compressed_modes, highest[batch] = self.modes[:, batch] @ basis.T, 0.0
            for tile in _tiles(history):
                work.stress(history[tile], compressed_modes)
                highest[batch] = np.maximum(highest[batch], np.max(work.squares(), axis=0))
        ranks = gathered((max(largest, float(np.max(highest, initial=0.0))), reference, total))
        largest, reference = (max(rank[i] for rank in ranks) for i in (0, 1))
        if reference == 0.0:
            return Mean(0.0, largest, highest, spans)
        total = sum(
            rank_total * (rank_reference / reference) ** half
            for _, rank_reference, rank_total in ranks
        )
        value = math.sqrt(reference) * total ** (1.0 / power)
        return Mean(value, largest, highest, spans)

    def slopes(self, mean: Mean, power: float) -> tuple[Array, Array]:
        """Derivatives of the ``mean`` by M and by z, by z only of this rank's points."""
        modes_bar, z_bar = np.zeros_like(self.modes), np.zeros_like(self.coordinates)
        if mean.value == 0.0:
            return modes_bar, z_bar
        counts, exponent, work = self.times > 0.0, 0.5 * power - 1.0, _Work(len(self.modes))
        history, basis = self._compressed()
        coordinates, shares = _thinned(mean.spans, history)
        # a product of two factors with this root of the area has the area itself
        scale = self.areas ** (1.0 / power) / mean.value
        by_time = np.zeros((len(coordinates), z_bar.shape[1]))
        for points in self._parts():
            modes = self.modes[:, points] * scale[points, None]
            compressed_modes = modes @ basis.T
            bar = np.zeros_like(compressed_modes)
            for tile in _tiles(coordinates):
                stress = work.stress(coordinates[tile], compressed_modes)
                stress *= power_of(work.squares(), exponent)
                bar += stress.swapaxes(1, 2) @ (shares[tile, None] * coordinates[tile])
                for component, component_modes in zip(stress, modes, strict=True):
                    by_time[tile] += component @ component_modes
            modes_bar[:, points] = bar @ basis
        modes_bar *= mean.value * scale[:, None]
        by_span = np.split(by_time, np.cumsum([len(span.shares) for span in mean.spans])[:-1])
        interpolations = (span.interpolation for span in mean.spans)
        by_instant = [
            b if interpolation is None else interpolation @ b
            for b, interpolation in zip(by_span, interpolations, strict=True)
        ]
        z_bar[counts] = mean.value * self.times[counts, None] * np.vstack(by_instant)
        return modes_bar, z_bar

    def _compressed(self) -> tuple[Array, Array]:
        """Fewer coordinates over the instants that count, and their vectors z, (fewer, n)."""
        size = np.sqrt(np.einsum("ipn,ipn->n", self.modes, self.modes))
        size[size == 0.0] = 1.0
        z = self.coordinates[self.times > 0.0] * size
        u, values, basis = np.linalg.svd(z, full_matrices=False)
        significant = values > ROUND_OFF * np.max(values, initial=0.0)
        return u[:, significant] * values[significant], basis[significant] / size

    def _spans(self, half: float, history: Array, basis: Array, work: _Work) -> list[Span]:
        """Spans of all instants, with the fewest nodes that represent them within `SMOOTH`."""
        sampled, all_spans = history[::_SAMPLED].copy(), list[Span]()
        largest_squares = np.zeros((math.ceil(len(history) / INSTANTS), len(self.areas)))
        per_span = INSTANTS // _SAMPLED
        for points in self._parts():
            compressed_modes = self.modes[:, points] @ basis.T
            for tile in _tiles(sampled):  # each has the instants of whole spans
                work.stress(sampled[tile], compressed_modes)
                begins = np.arange(0, len(sampled[tile]), per_span)
                spans = slice(tile.start // per_span, tile.start // per_span + len(begins))
                largest_squares[spans, points] = np.maximum.reduceat(work.squares(), begins, axis=0)
        top = float(np.max(largest_squares, initial=0.0))
        count = min(_TRIED, POINTS, len(self.areas))
        for begin in range(0, len(history), INSTANTS):
            instants = slice(begin, min(begin + INSTANTS, len(history)))
            span_history, times = history[instants], self.times[self.times > 0.0][instants]
            span = Span(instants, times, None, None)
            if top > 0.0 and half == int(half):
                highest = np.argpartition(largest_squares[len(all_spans)], -count)[-count:]
                modes = self.modes[:, highest] @ (basis.T / math.sqrt(top))
                work.stress(span_history, modes)
                exact = work.squares().copy()
                for nodes, powers, interpolation in _choices_of_nodes(len(times)):
                    from_all, to_all = _closest(powers, times)
                    smooth = to_all @ (from_all @ span_history)
                    work.stress(span_history - smooth, modes)
                    remainder = work.squares().copy()
                    work.stress(smooth, modes)
                    squared = work.squares()
                    # in the mean, and in the derivative
                    slope = power_of(squared.copy(), half - 1.0)
                    values = np.hstack([slope * squared, slope * math.sqrt(np.max(squared))])
                    error = interpolation @ values[nodes] - values
                    # without the first order of the remainder
                    error_of_mean = slope * (squared + half * (exact - squared - remainder))
                    error_of_mean -= power_of(exact.copy(), half)
                    if max(np.max(np.abs(error)), np.max(np.abs(error_of_mean))) <= SMOOTH:
                        smoothing = to_all[nodes] @ from_all
                        span = Span(instants, times @ interpolation, interpolation, smoothing)
                        break
            all_spans.append(span)
        return all_spans

    def _parts(self) -> list[slice]:
        """The points of each tile."""
        return [slice(i, i + POINTS) for i in range(0, len(self.areas), POINTS)]


class _Work:
    """Memory for the stresses of a tile; allocation would take as long as the products."""

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
        """The squares (instants, points) of the last stress."""
        total: Array = np.square(self._stress[0], out=self._squared)
        for component in self._stress[1:]:
            total += np.square(component, out=self._more)
        return total


@cache
def _choices_of_nodes(instants: int) -> list[tuple[Integers, Array, Array]]:
    """Choices of nodes, dense at the ends: nodes, polynomials and interpolation at all instants."""
    positions, choices = np.linspace(-1.0, 1.0, instants), []
    for count in (int(share * instants) for share in _SHARES if share * instants >= 2.0):
        chebyshev = 0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count)
        nodes = np.unique(np.round(chebyshev * (instants - 1)).astype(int))
        powers = chebvander(positions, len(nodes) - 1)
        choices.append((nodes, powers, np.linalg.solve(powers[nodes].T, powers.T).T))
    return choices


def _closest(powers: Array, times: Array) -> tuple[Array, Array]:
    """Matrices from values at instants, weighted by ``times``, to ``powers`` and back."""
    root = np.sqrt(times)[:, None]
    basis, _ = np.linalg.qr(root * powers[:, : int(_DEGREE * powers.shape[1])])
    return (root * basis).T, basis / root


def _thinned(spans: list[Span], history: Array) -> tuple[Array, Array]:
    """Coordinates at the nodes of all spans, and their shares in the time."""
    coordinates = [
        history[instants] if smoothing is None else smoothing @ history[instants]
        for instants, *_, smoothing in spans
    ]
    shares = [np.zeros(0), *(span.shares for span in spans)]
    return np.concatenate([history[:0], *coordinates]), np.concatenate(shares)


def _tiles(history: Array) -> list[slice]:
    """The instants of each tile."""
    return [slice(i, i + INSTANTS) for i in range(0, len(history), INSTANTS)]


def power_of(values: Array, exponent: float) -> Array:
    """Values to a power, by products if it is a whole number; the values are overwritten."""
    if exponent != int(exponent):
        return np.asarray(values**exponent)
    remaining, odd_factor = int(exponent), None
    while remaining > 1:
        if remaining % 2:
            odd_factor = (
                values.copy()
                if odd_factor is None
                else np.multiply(odd_factor, values, out=odd_factor)
            )
        values *= values
        remaining //= 2
    if remaining == 0:
        return np.ones_like(values)
    return values if odd_factor is None else np.multiply(odd_factor, values, out=odd_factor)
