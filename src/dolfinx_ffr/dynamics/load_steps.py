# SPDX-License-Identifier: MIT
"""Steps that resolve loads and prescribed motions, which are sampled between the steps, too.

A method evaluates forces and motions at its own instants alone: it misses a blow between two of
them, and may miss it with twice as many steps. So they are sampled on a grid of its own, some
thousand times in each of a few equal cells. A cell whose samples are no cubic polynomial is
divided, as a step of Radau IIA follows about such a polynomial; where the samples jump, the jump is
located to round-off and a cell ends there.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice, pairwise, takewhile
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Mask
from .tables import BESIDE_JUMP, TimeTables, once_for_a_mechanism


@dataclass(frozen=True)
class Sampling:
    """Options for sampling loads and motions, and limits of smoothness."""

    #: Samples of all cells together. A blow that lasts less than a hundred thousandth of the motion
    #: may be missed: it must be named (`Mechanism.jumps`).
    samples: int = 2**17
    #: Samples for a look at steps that are given, or that follow from a tolerance.
    samples_of_a_look: int = 2**14
    fewest_samples: int = 64  #: Fewest samples of a cell.
    samples_again: int = 256  #: Samples of a cell that has been divided until it had too few.
    #: Samples that are taken at once: enough for a call, few beside what a motion holds.
    samples_at_once: int = 4096
    #: Cells to begin with. With fewer steps of Radau IIA, 25 or 35 in five turns of a crank,
    #: Newton's method failed now and then at other designs than the one at which they are chosen.
    fewest_cells: int = 50
    #: Most cells. Beyond, the load is noise, or longer than what can be followed.
    most_cells: int = 2**13
    #: Largest distance of a sample from the cubic polynomial of its cell, in parts of the range of
    #: the quantity: far more than a step of Radau IIA that follows the load leaves.
    resolved: float = 5e-3
    #: A change between two samples is a jump if it exceeds the usual one so many times.
    times_the_usual: float = 3.0
    #: Share of a jump that remains between two samples however near they are.
    sudden: float = 0.7
    #: Part of the duration by which a jump that nobody named may lie behind its time.
    just_before: float = 4.0 * BESIDE_JUMP
    #: Part of the duration below which no cell is divided.
    shortest_cell: float = 1e-12
    #: Columns whose range is below this share of the largest in their table are round-off.
    round_off: float = 1e-9


SAMPLING = Sampling()


@dataclass(frozen=True, eq=False)
class LoadSteps:
    """Ends of steps that resolve loads and prescribed motions."""

    ends: Array  #: Ends of the cells, from 0 to the end time, shape (cells + 1,) [s].
    #: Ends at which a load or motion jumps, or a derivative that was named, shape (corners,) [s].
    corners: Array
    #: Ends of the cells that were divided, and jumps that were not named, shape (special,) [s].
    special: Array
    fast: Mask  #: Cells that were divided because of fast changes, shape (cells,).
    #: Whether each cell resolves loads and motions; not where there would be too many.
    resolved: bool


class _Cell(NamedTuple):
    """A stretch of time in which loads are to be smooth."""

    begin: float
    end: float
    samples: Array | None = None  #: Shape (samples, quantities), where they have been taken.
    divided: bool = False  #: Whether it is a part of a cell that was not smooth.


@once_for_a_mechanism
def load_steps(tables: TimeTables, end_time: float, samples: int = SAMPLING.samples) -> LoadSteps:
    """Cells from 0 to the end time [s] in which loads and motions are smooth, by some samples."""
    return _Search(tables, end_time, samples).run()


def equal_steps(corners: Array, counts: Array, fewest: int) -> Array:
    """Corners and the ends of equal steps between them, about as many as the counts, or fewest."""
    steps = np.maximum(np.rint(counts).astype(int), fewest)
    stretches = zip(corners, corners[1:], steps, strict=False)
    return np.concatenate([corners[:1], *(np.linspace(a, b, n + 1)[1:] for a, b, n in stretches)])


class _Search:
    """Division of cells until all are smooth."""

    def __init__(self, tables: TimeTables, end_time: float, samples: int) -> None:
        self.tables, self.end_time = tables, end_time
        named = tables.jumps[tables.jumps < end_time * (1.0 - SAMPLING.shortest_cell)]
        self.corners: list[float] = list(named)
        walls = np.array([0.0, *named, end_time])
        self.equal = equal_steps(walls, np.diff(walls) * (SAMPLING.fewest_cells / end_time), 1)
        # a power of two, so that the halves of a cell have the samples of cells of their own
        count = max(samples // (self.equal.size - 1), SAMPLING.fewest_samples)
        self.count = 2 ** int(math.log2(count))
        times = np.linspace(0.0, end_time, 1025)
        self.scale = self._range(self._raw(0.5 * (times[1:] + times[:-1])))

    def _raw(self, times: Array) -> Array:
        """All loads and prescribed motions side by side, shape (instants, quantities)."""
        tables = [np.reshape(t, (times.size, -1)) for t in self.tables.tabulate(times).values()]
        self.widths = [table.shape[1] for table in tables]
        return np.concatenate(tables, axis=1)

    def _range(self, samples: Array) -> Array:
        """Range of each quantity; the largest value of its table if it is constant to round-off."""
        span = np.ptp(samples, axis=0)
        sizes = np.split(np.max(np.abs(samples), axis=0, initial=0.0), np.cumsum(self.widths)[:-1])
        largest = np.concatenate([np.full(s.size, np.max(s, initial=0.0)) for s in sizes])
        floor = np.where(largest > 0.0, largest, 1.0)
        return np.where(span > SAMPLING.round_off * floor, span, floor)

    def sampled(self, times: Array) -> Array:
        """All loads and prescribed motions over their ranges, shape (instants, quantities)."""
        return self._raw(times) / self.scale

    def run(self) -> LoadSteps:
        finished: list[_Cell] = []
        resolved = True
        # the long ones first, so that all are about as short where there would be too many
        pending, special = self._begun()
        while pending:
            cell = pending.popleft()
            begin, end, samples, divided = cell
            if samples is None:
                count = SAMPLING.samples_again if divided else self.count
                samples = self._samples_of(cell, pending, count)
            smooth = _distance_from_cubic(samples) <= SAMPLING.resolved
            too_many = len(finished) + len(pending) > SAMPLING.most_cells
            if smooth or too_many or end - begin <= SAMPLING.shortest_cell * self.end_time:
                resolved = resolved and smooth
                finished.append(cell)
                special += [begin, end] if divided else []
                continue

            jump = self._jump(begin, end, samples)
            if jump is not None:
                self.corners.append(jump)
                special.append(jump)
                pending += [_Cell(begin, jump, None, divided), _Cell(jump, end, None, divided)]
                continue

            half, middle = len(samples) // 2, 0.5 * (begin + end)
            enough = half >= SAMPLING.fewest_samples
            pending += [
                _Cell(begin, middle, samples[:half] if enough else None, True),
                _Cell(middle, end, samples[half:] if enough else None, True),
            ]
        return self._steps(finished, special, resolved)

    def _samples_of(self, cell: _Cell, pending: deque[_Cell], count: int) -> Array:
        """Samples of a cell; a call costs more than some hundred, so those of next cells, too."""
        if cell.divided:
            return self.sampled(_inside(cell.begin, cell.end, count))
        following = islice(pending, max(SAMPLING.samples_at_once // count, 1) - 1)
        fresh = takewhile(lambda c: c.samples is None and not c.divided, following)
        times = [_inside(c.begin, c.end, count) for c in (cell, *fresh)]
        samples, *of_next = np.split(self.sampled(np.concatenate(times)), len(times))
        for k, samples_of_cell in enumerate(of_next):
            pending[k] = pending[k]._replace(samples=samples_of_cell)
        return samples

    def _steps(self, cells: list[_Cell], special: list[float], resolved: bool) -> LoadSteps:
        """The cells in order of time."""
        cells.sort(key=lambda cell: (cell.end, cell.divided))
        ends = np.array([0.0, *(cell.end for cell in cells)])
        at_jump = np.isin(ends, self.corners)
        divided = np.array([cell.divided for cell in cells])
        return LoadSteps(
            ends,
            np.unique(self.corners),
            np.unique(np.array([t for t in special if 0.0 < t < self.end_time])),
            divided | (at_jump[:-1] & at_jump[1:]),
            resolved,
        )

    def _begun(self) -> tuple[deque[_Cell], list[float]]:
        """The equal cells, and the jumps where two of them meet, which neither of them sees."""
        ends = self.equal.copy()
        inner = np.flatnonzero(~np.isin(ends[1:-1], self.corners)) + 1
        # two samples on either side of where two cells meet, of all at once
        before, after = np.diff(ends)[inner - 1], np.diff(ends)[inner]
        spacings = np.stack([-1.5 * before, -0.5 * before, 0.5 * after, 1.5 * after], axis=1)
        times = ends[inner, None] + spacings / self.count
        samples = self.sampled(times.ravel()).reshape(*times.shape, -1)

        jumps = []
        for number, t, values in zip(inner, times, samples, strict=True):
            before_it, at_it, behind_it = _changes(values)
            if _may_jump(at_it, max(before_it, behind_it)):
                jump = self._located(t[1], t[2], values[1], values[2], at_it)
                if jump is not None:
                    ends[number] = jump
                    jumps.append(jump)
        self.corners += jumps
        return deque(_Cell(begin, end) for begin, end in pairwise(ends.tolist())), jumps

    def _jump(self, begin: float, end: float, samples: Array) -> float | None:
        """The time just before the largest jump within a cell, if there is one."""
        changes = _changes(samples)
        k = int(np.argmax(changes))
        # what changes as fast in many places is no jump
        if not _may_jump(changes[k], float(np.quantile(changes, 0.9))):
            return None
        low, high = _inside(begin, end, len(samples))[k : k + 2]
        jump = self._located(low, high, samples[k], samples[k + 1], changes[k])
        return jump if jump is not None and begin < jump < end else None

    def _located(
        self, low: float, high: float, left: Array, right: Array, change: float
    ) -> float | None:
        """The time just before a jump between two samples; None where they change smoothly."""
        while True:
            middle = 0.5 * (low + high)
            if high - low <= SAMPLING.just_before * self.end_time or not low < middle < high:
                # the tables hold at the very time of a jump the values before it
                return float(low)
            values = self.sampled(np.array([middle]))[0]
            from_left, to_right = np.max(np.abs(values - left)), np.max(np.abs(right - values))
            if max(from_left, to_right) < SAMPLING.sudden * change:
                return None
            if from_left > to_right:
                high, right = middle, values
            else:
                low, left = middle, values


def _changes(samples: Array) -> Array:
    """Largest change of any quantity from sample to sample, shape (samples - 1,)."""
    return np.asarray(np.max(np.abs(np.diff(samples, axis=0)), axis=1, initial=0.0))


def _may_jump(change: float, usual: float) -> bool:
    """Whether a change between two samples is so large beside the usual one that it may jump."""
    return change > max(SAMPLING.resolved, SAMPLING.times_the_usual * usual)


def _inside(a: float, b: float, count: int) -> Array:
    """Equally spaced times within a cell, none at its ends, shape (count,) [s]."""
    return a + (b - a) * ((np.arange(count) + 0.5) / count)


def _distance_from_cubic(samples: Array) -> float:
    """Largest distance of samples (count, quantities) from the nearest cubic polynomials."""
    basis = _cubics(len(samples))
    remainder = samples - basis @ (basis.T @ samples)
    return float(np.max(np.abs(remainder), initial=0.0))


@lru_cache
def _cubics(count: int) -> Array:
    """Orthonormal cubic polynomials at the samples of a cell, shape (count, 4)."""
    return np.linalg.qr(np.polynomial.legendre.legvander(_inside(-1.0, 1.0, count), 3))[0]
