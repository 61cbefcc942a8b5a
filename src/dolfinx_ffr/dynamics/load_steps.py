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

import numpy as np

from ..arrays import Array, Mask
from .tables import BESIDE_JUMP, TimeTables, once_for_a_mechanism

#: Samples of all cells together, and of one cell at least. A blow that lasts less than a hundred
#: thousandth of the motion may be missed: it must be named (`Mechanism.jumps`).
SAMPLES, FEWEST_SAMPLES = 2**17, 64
#: Samples of a cell that has been divided until it had too few
_AGAIN = 256
#: Samples for a look at steps that are given, or that follow from a tolerance
FEWER_SAMPLES = 2**14
#: Samples that are taken at once: enough for a call, few beside what a motion holds
_AT_ONCE = 4096
#: Cells to begin with. With fewer steps of Radau IIA, 25 or 35 in five turns of a crank, Newton's
#: method failed now and then at other designs than the one at which they are chosen.
FEWEST_CELLS = 50
#: Largest distance of a sample from the cubic polynomial of its cell, in parts of the range of the
#: quantity: half a percent is far more than a step of Radau IIA that follows the load leaves
RESOLVED = 5e-3
#: Most cells. Beyond, the load is noise, or longer than what can be followed
MOST_CELLS = 2**13
#: Part of the duration by which a jump that nobody named may lie behind its time
JUST_BEFORE = 4.0 * BESIDE_JUMP
#: Columns whose range is below this share of the largest in their table are round-off
_ROUND_OFF = 1e-9


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


@once_for_a_mechanism
def load_steps(tables: TimeTables, end_time: float, samples: int = SAMPLES) -> LoadSteps:
    """Cells from 0 to the end time [s] in which loads and motions are smooth, by some samples."""
    return _Search(tables, end_time, samples).found()


def equal_steps(corners: Array, counts: Array, fewest: int) -> Array:
    """Corners and the ends of equal steps between them, about as many as the counts, or fewest."""
    steps = np.maximum(np.rint(counts).astype(int), fewest)
    stretches = zip(corners, corners[1:], steps, strict=False)
    return np.concatenate([corners[:1], *(np.linspace(a, b, n + 1)[1:] for a, b, n in stretches)])


class _Search:
    """Division of cells, with the samples that have been taken of each."""

    def __init__(self, tables: TimeTables, end_time: float, samples: int) -> None:
        self.tables, self.end_time = tables, end_time
        named = tables.jumps[tables.jumps < end_time * (1.0 - 1e-12)]
        self.corners: list[float] = list(named)
        walls = np.array([0.0, *named, end_time])
        self.equal = equal_steps(walls, np.diff(walls) * (FEWEST_CELLS / end_time), 1)
        # a power of two, so that the halves of a cell have the samples of cells of their own
        each = max(samples // (self.equal.size - 1), FEWEST_SAMPLES)
        self.count = 2 ** int(math.log2(each))
        few = np.linspace(0.0, end_time, 1025)
        self.scale = self._range(self._raw(0.5 * (few[1:] + few[:-1])))

    def _raw(self, times: Array) -> Array:
        """All loads and prescribed motions side by side, shape (instants, quantities)."""
        tables = self.tables.tabulate(times).values()
        parts = [np.reshape(table, (times.size, -1)) for table in tables]
        self.widths = [part.shape[1] for part in parts]
        return np.concatenate(parts, axis=1)

    def _range(self, samples: Array) -> Array:
        """Range of each quantity; the largest value of its table if it is constant to round-off."""
        span = np.ptp(samples, axis=0)
        size = np.max(np.abs(samples), axis=0, initial=0.0)
        largest = np.concatenate(
            [
                np.full(part.size, np.max(part, initial=0.0))
                for part in np.split(size, np.cumsum(self.widths)[:-1])
            ]
        )
        floor = np.where(largest > 0.0, largest, 1.0)
        return np.where(span > _ROUND_OFF * floor, span, floor)

    def sampled(self, times: Array) -> Array:
        """All loads and prescribed motions over their ranges, shape (instants, quantities)."""
        return self._raw(times) / self.scale

    def found(self) -> LoadSteps:
        done: list[tuple[float, bool]] = []
        resolved = True
        # the long ones first, so that all are about as short where there would be too many
        pending, special = self._begun()
        while pending:
            a, b, samples, divided = pending.popleft()
            if samples is None and not divided:
                # a call costs more than some hundred samples: those of the next cells, too
                at_once = max(_AT_ONCE // self.count, 1)
                following = islice(pending, at_once - 1)
                fresh = takewhile(lambda cell: cell[2] is None and not cell[3], following)
                cells = [(a, b), *(cell[:2] for cell in fresh)]
                times = [_inside(*cell, self.count) for cell in cells]
                samples, *others = np.split(self.sampled(np.concatenate(times)), len(times))
                for k, own in enumerate(others):
                    pending[k] = (*pending[k][:2], own, False)
            elif samples is None:
                samples = self.sampled(_inside(a, b, _AGAIN))
            smooth = _distance_from_cubic(samples) <= RESOLVED
            if smooth or b - a <= 1e-12 * self.end_time or len(done) + len(pending) > MOST_CELLS:
                resolved = resolved and smooth
                done.append((b, divided))
                special += [a, b] if divided else []
                continue
            jump = self._jump(a, b, samples)
            if jump is not None:
                self.corners.append(jump)
                special.append(jump)
                pending += [(a, jump, None, divided), (jump, b, None, divided)]
                continue
            half, middle = len(samples) // 2, 0.5 * (a + b)
            few = half < FEWEST_SAMPLES
            pending += [
                (a, middle, None if few else samples[:half], True),
                (middle, b, None if few else samples[half:], True),
            ]
        inner = [t for t in special if 0.0 < t < self.end_time]
        done.sort()
        ends = np.array([0.0, *(end for end, _ in done)])
        at_jump = np.isin(ends, self.corners)
        return LoadSteps(
            ends,
            np.unique(self.corners),
            np.unique(np.array(inner)),
            np.array([divided for _, divided in done]) | (at_jump[:-1] & at_jump[1:]),
            resolved,
        )

    def _begun(self) -> tuple[deque[tuple[float, float, Array | None, bool]], list[float]]:
        """The equal cells, and the jumps where two of them meet."""
        ends = [float(end) for end in self.equal]
        jumps = []
        inner = np.array([end for end in ends[1:-1] if end not in self.corners])
        # two samples on either side of where two cells meet, of all at once
        at = np.searchsorted(self.equal, inner)
        before, after = inner - self.equal[at - 1], self.equal[at + 1] - inner
        steps = np.stack([-1.5 * before, -0.5 * before, 0.5 * after, 1.5 * after], axis=1)
        around = inner[:, None] + steps / self.count
        found = self.sampled(around.ravel()).reshape(*around.shape, -1)
        for k, times, samples in zip(at, around, found, strict=True):
            usual, change, other = np.max(np.abs(np.diff(samples, axis=0)), axis=1, initial=0.0)
            if change > max(RESOLVED, 3.0 * usual, 3.0 * other):
                jump = self._located(times[1], times[2], samples[1], samples[2], change)
                if jump is not None:
                    ends[k] = jump
                    jumps.append(jump)
        self.corners += jumps
        pending: deque[tuple[float, float, Array | None, bool]] = deque(
            (a, b, None, False) for a, b in pairwise(ends)
        )
        return pending, jumps

    def _jump(self, a: float, b: float, samples: Array) -> float | None:
        """The time just before the largest jump within a cell, if there is one."""
        changes = np.max(np.abs(np.diff(samples, axis=0)), axis=1, initial=0.0)
        k = int(np.argmax(changes))
        change = changes[k]
        # what changes as fast in many places is no jump
        if change <= max(RESOLVED, 3.0 * float(np.quantile(changes, 0.9))):
            return None
        low, high = _inside(a, b, len(samples))[k : k + 2]
        jump = self._located(low, high, samples[k], samples[k + 1], change)
        return jump if jump is not None and a < jump < b else None

    def _located(
        self, low: float, high: float, left: Array, right: Array, change: float
    ) -> float | None:
        """The time just before a jump between two samples; None where they change smoothly."""
        while True:
            middle = 0.5 * (low + high)
            if high - low <= JUST_BEFORE * self.end_time or not low < middle < high:
                # the tables hold at the very time of a jump the values before it
                return float(low)
            here = self.sampled(np.array([middle]))[0]
            before, after = np.max(np.abs(here - left)), np.max(np.abs(right - here))
            if max(before, after) < 0.7 * change:
                return None
            if before > after:
                high, right = middle, here
            else:
                low, left = middle, here


def _inside(a: float, b: float, count: int) -> Array:
    """Equally spaced times within a cell, none at its ends, shape (count,) [s]."""
    return a + (b - a) * ((np.arange(count) + 0.5) / count)


def _distance_from_cubic(samples: Array) -> float:
    """Largest distance of samples (count, quantities) from the nearest cubic polynomials."""
    basis = _cubics(len(samples))
    rest = samples - basis @ (basis.T @ samples)
    return float(np.max(np.abs(rest), initial=0.0))


@lru_cache
def _cubics(count: int) -> Array:
    """Orthonormal cubic polynomials at the samples of a cell, shape (count, 4)."""
    return np.linalg.qr(np.polynomial.legendre.legvander(_inside(-1.0, 1.0, count), 3))[0]
