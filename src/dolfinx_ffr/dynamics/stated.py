# SPDX-License-Identifier: MIT
"""What a mechanism says as one vector of numbers, and derivatives by these from those by tables.

Tables over time have thousands of entries and follow from few numbers: from those of which motions
are made, and from the values of signals that do not change. Signals of functions that say nothing
about themselves are sampled.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..body import VolumeIntegrals
from ..mechanism import Ground, Motion, Moving, Signal, Triple, VectorKind, sample
from .model import FlatModel

#: Fields of the arrays that are numbers themselves
_CONSTANTS = ("alpha", "beta", "shapes", "vector_stiffening", "law", "normal", "ratio")
#: Differences up to this share are round-off.
_ROUND_OFF = 2e-15


class OtherLawError(Exception):
    """A signal is of another kind at other values of parameters."""


class _Entry(NamedTuple):
    """A signal and its place in the tables."""

    signal: Signal
    field: str  #: Of the arrays
    #: There of shape (instants,), or (instants, 3) with two derivatives
    place: tuple[int | slice, ...]
    sign: float = 1.0

    def stated(self) -> tuple[Array, Hashable]:
        """The numbers of the signal, and all else; None where it has to be sampled."""
        if isinstance(self.signal, Motion):
            return self.signal.stated()
        if callable(self.signal):
            return np.zeros(0), None
        return np.array([self.signal], dtype=np.float64), float

    def sampled(self, times: Array, rates: bool) -> Array:
        """The signal over time, with two derivatives where wanted, flat."""
        if rates and isinstance(self.signal, Motion):
            return self.signal.tabulate(times).ravel()
        values = sample(self.signal, times, self.field)
        return np.concatenate([values, np.zeros(2 * values.size)]) if rates else values


class Numbers:
    """The vector of all numbers of a mechanism, and where they stand in it."""

    def __init__(self, model: FlatModel) -> None:
        self.model = model
        instants = np.append(model.times, model.times[0] + model.offset)
        self.times = model.tables.beside_jumps(instants)
        self._entries = list(_entries(model))
        self._fixed = [entry.stated()[1] for entry in self._entries]
        of_mechanism = model.mechanism.own_bodies
        #: Bodies whose integrals may change, with their geometric stiffness by loads
        self._bodies = {
            name: body.stiffening
            for name, body in model.effective.items()
            if name in of_mechanism or body is not model.bodies[name]
        }
        self._renew()

    def _renew(self) -> None:
        """Set the numbers of the model itself."""
        self._groups: list[Array] = []
        self._groups = self._groups_of(self.model, self._entries)
        self.values = np.concatenate(self._groups)
        #: Group of numbers, as those of one signal, to which each belongs, shape (numbers,)
        sizes = [group.size for group in self._groups]
        self.group = np.repeat(np.arange(len(sizes)), sizes)

    def of(self, model: FlatModel) -> Array:
        """The numbers of another model, (numbers,); OtherLawError: a signal is of another kind."""
        entries = list(_entries(model))
        if len(entries) != len(self._entries):
            raise ValueError("the joints and forces depend on another number of vectors")
        return np.concatenate(self._groups_of(model, entries))

    def _groups_of(self, model: FlatModel, entries: list[_Entry]) -> list[Array]:
        arrays = model.arrays
        groups = [self._constants(model, entries)]
        groups += [getattr(arrays, name).ravel() for name in _CONSTANTS]
        for name, loads in self._bodies.items():
            groups.append(_numbers(model.effective[name], loads))
        for k, entry in enumerate(entries):
            if self._groups and entry.signal is self._entries[k].signal:
                groups.append(self._groups[len(groups)])
            elif self._fixed[k] is None:
                groups.append(entry.sampled(self.times, self._rates(entry)))
            else:
                numbers, fixed = entry.stated()
                if fixed != self._fixed[k]:
                    self._fixed[k] = None
                    self._renew()
                    raise OtherLawError
                groups.append(numbers)
        return groups

    def _constants(self, model: FlatModel, entries: list[_Entry]) -> Array:
        """What rows and springs have beside the motions that they follow, shape (rows,)."""
        tables, count = model.tables, model.arrays.kind.size
        springs = [spring.row for element, _ in tables.elements for spring in element.springs]
        rows = [row for row, _ in tables.rows]
        if not any(row.counts_angles for row in (*rows, *springs)):
            return np.array([row.constant for row in rows] + [0.0] * len(springs))

        # In the plane the angles of vectors differ from those of markers
        constants = tables.tabulate(model.times[:1])["drive"][0, :, 0]
        for r in range(count):
            start = float(sample(entries[r].signal, model.times[:1], "the start")[0])
            scale = abs(constants[r]) + abs(start)
            constants[r] = constants[r] - start
            # the difference has round-off, which must not count as a change of the constant
            if self._groups and abs(constants[r] - self._groups[0][r]) <= _ROUND_OFF * scale:
                constants[r] = self._groups[0][r]
        return constants

    def _rates(self, entry: _Entry) -> bool:
        """Whether the derivatives of a signal count."""
        return getattr(self.model.arrays, entry.field)[entry.place].ndim == 2

    def bars(self, arrays: Mapping[str, Array], bodies: Mapping[str, VolumeIntegrals]) -> Array:
        """Derivatives by the numbers from those by tables and bodies, shape (numbers,)."""
        groups = [np.sum(arrays["drive"][:, :, 0], axis=0)]
        for name in _CONSTANTS:
            size = getattr(self.model.arrays, name).size
            groups.append(np.ravel(arrays[name]) if name in arrays else np.zeros(size))
        groups += [_numbers(bodies[name], loads) for name, loads in self._bodies.items()]
        for entry, fixed in zip(self._entries, self._fixed, strict=True):
            bar = entry.sign * arrays[entry.field][entry.place].T
            if fixed is None:
                groups.append(bar.ravel())
            elif isinstance(entry.signal, Motion):
                bars = bar if bar.ndim == 2 else np.stack([bar, 0.0 * bar, 0.0 * bar])
                groups.append(entry.signal.pullback(self.times, bars))
            else:
                groups.append(np.array([np.sum(bar[0] if bar.ndim == 2 else bar)]))
        return np.concatenate(groups)


def _numbers(body: VolumeIntegrals, loads: Mapping[str, Array]) -> Array:
    """Numbers of a body, or of derivatives by it, without its markers; zeros for missing loads."""
    moments = (body.G, body.N) if body.P is None else (body.P,)
    integrals = [np.array(body.mass), body.S, body.K, *moments]
    integrals += [body.stiffening.get(load, 0.0 * zeros) for load, zeros in loads.items()]
    return np.concatenate([np.ravel(array) for array in integrals])


def _entries(model: FlatModel) -> Iterator[_Entry]:
    """Signals of rows, springs, loads and gravity, and of vectors that move as prescribed."""
    tables, arrays, instants, d = model.tables, model.arrays, slice(None), model.dimension
    rows = [row for row, _ in tables.rows]
    springs = [spring for element, _ in tables.elements for spring in element.springs]
    loads = [load for element, _ in tables.elements for load in element.loads]
    for r, row in enumerate(rows):
        yield _Entry(0.0 if row.motion is None else row.motion, "drive", (instants, r))
    for r, spring in enumerate(springs, len(rows)):
        yield _Entry(spring.rest, "drive", (instants, r, 0))
    for number, load in enumerate(loads):
        moment, turning = load.target.kind == VectorKind.SPIN, tables.lowering.undeformed.turning
        components = turning(load.components) if moment else load.components[:d]
        for k, signal in enumerate(components):
            yield _Entry(signal, "load_table", (instants, number, k))
    for field, sign in (("gravity", 1.0), ("ground_acceleration", -1.0)):
        for k, signal in enumerate(getattr(model.mechanism, field)[:d]):
            yield _Entry(signal, "gravity", (instants, k), sign)
    rows += [spring.row for spring in springs]
    numbers = np.flatnonzero(arrays.vector_body < 0)
    for slot, (number, (marker, _)) in enumerate(
        zip(numbers, tables.lowering.prescribed, strict=True)
    ):
        kind, components = arrays.vector_kind[number], (0.0, 0.0, 0.0)
        if kind == VectorKind.DIRECTION:
            sides, axes = (
                np.argwhere(arrays.side == number),
                np.argwhere(arrays.load_axes == number),
            )
            i, j = (sides if sides.size else axes)[0]
            vector = rows[i].vectors[j] if sides.size else loads[i].axes[j]
            components = vector.components
        for k, signal in enumerate(_coordinates(marker, kind, components, d)):
            yield _Entry(signal, "prescribed", (instants, slot, slice(None), k))


def _coordinates(
    marker: Ground | Moving, kind: int, components: Triple, d: int
) -> Sequence[Signal]:
    """Coordinates of a vector that is fixed to a marker of the ground or a moving one."""
    if kind == VectorKind.SPIN:
        return [marker.angle]  # in the plane alone
    if isinstance(marker, Ground):
        table = marker.tabulate_in_space(np.zeros(1), marker.name)[0, 0]
        vector = table[0] if kind == VectorKind.POINT else np.array(components) @ table[1:]
        return list(map(float, vector[:d]))
    if kind == VectorKind.POINT:
        return [marker.x, marker.y, *([] if marker.z is None else [marker.z])][:d]
    return marker.direction(components)[:d]
