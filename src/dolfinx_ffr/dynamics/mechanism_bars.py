# SPDX-License-Identifier: MIT
"""Derivatives by all that a mechanism says, and from there by the parameters of its description.

What a mechanism says to the equations of motion are a few tables and constants, and the start. The
adjoint gives the derivatives by these once. How they follow from parameters takes no simulation,
and is differenced.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..body import VolumeIntegrals
from ..mechanism import Mechanism, ParametricMechanism
from .initial import started
from .model import FlatModel
from .trajectory import Trajectory

Array = NDArray[np.float64]
Bodies = Mapping[str, VolumeIntegrals]

#: Fields of the arrays that a mechanism and the markers of its bodies set.
FIELDS = ("gravity", "alpha", "beta", "shapes", "vector_stiffening", "drive", "prescribed",
          "load_table", "law", "normal", "ratio")  # fmt: skip
#: Fields that make up the topology, which must stay.
_TOPOLOGY = ("first", "modes", "kind", "side", "vector_body", "vector_slot", "vector_kind",
             "vector_marker", "vector_stiffened", "load_vector", "load_axes")  # fmt: skip
#: Fields on which an assembled start depends, at the first instant; a static one on all.
_GEOMETRY = ("shapes", "vector_stiffening", "drive", "prescribed", "normal", "ratio")
_OVER_TIME = ("gravity", "drive", "prescribed", "load_table")
#: Step of differences as share of the range of a parameter; it is shortened by this factor, at most
#: so many times, until second differences are below this share of first ones. Of fourth order they
#: take steps so long that the tolerance of a static start does not show.
_STEP, _SHORTER, _TIMES, _BENT = 2e-4, 1 / 16, 5, 3e-3
#: Changes below this share of the size of an array are round-off.
_ROUND_OFF = 1e-12
#: Step where nothing is solved for
_SHORT = 3e-6
#: Change of the start by a step, in sizes of the start, beyond which it has jumped.
_JUMP = 1e-2


@dataclass(frozen=True, eq=False)
class MechanismBars:
    """Derivatives of a number with respect to all that the compiled mechanism says.

    The tables have one row for each instant of the trajectory, and one for the instant near
    the start.
    """

    #: By name of the field of the arrays: ``drive`` (instants, rows and springs, 3), right-hand
    #: sides of rows with two derivatives; ``prescribed`` (instants, vectors, 3, d) place, velocity
    #: and acceleration of vectors that move as prescribed; ``load_table`` (instants, loads, d);
    #: ``gravity`` (instants, d); ``law`` (springs, 2) stiffness and damping; ``alpha``, ``beta``
    #: (bodies,); ``shapes`` of vectors of bodies; ``normal`` and ``ratio`` of rows.
    arrays: Mapping[str, Array] = field(default_factory=dict)
    #: With respect to the integrals of the bodies with their point masses, markers left out.
    bodies: Bodies = field(default_factory=dict)
    #: With respect to the coordinates at the start, shape (size,); in space, at the place of
    #: rotations, to turns about the body's axes.
    y: Array = field(default_factory=lambda: np.zeros(0))
    v: Array = field(default_factory=lambda: np.zeros(0))  #: And to the velocities there

    def scaled(self, factor: float) -> MechanismBars:
        """The derivatives times a ``factor``."""
        arrays = {name: factor * bar for name, bar in self.arrays.items()}
        bodies = {name: bar.scaled(factor) for name, bar in self.bodies.items()}
        return MechanismBars(arrays, bodies, factor * self.y, factor * self.v)

    def __add__(self, other: MechanismBars) -> MechanismBars:
        def both(a: Mapping, b: Mapping) -> dict:
            return {**a, **b, **{name: a[name] + b[name] for name in a if name in b}}

        if not self.y.size or not other.y.size:
            y, v = (self.y, self.v) if self.y.size else (other.y, other.v)
        else:
            y, v = self.y + other.y, self.v + other.v
        return MechanismBars(both(self.arrays, other.arrays), both(self.bodies, other.bodies), y, v)


class _Stated(NamedTuple):
    """What a mechanism says at values of its parameters."""

    model: FlatModel
    arrays: dict[str, Array]
    effective: Bodies  #: With point masses
    y: Array  #: Shift from the start at the values themselves, shape (size,)
    v: Array

    def flat(self) -> list[Array]:
        """All numbers that may depend on parameters, as a list of arrays."""
        parts = [self.y, self.v, *self.arrays.values()]
        given = self.model.bodies
        changing = [body for name, body in self.effective.items() if body is not given[name]]
        for body in (*changing, *self.model.mechanism.own_bodies.values()):
            parts += [np.ravel(value) for value in _numbers(body)]
        return parts


def parameter_slopes(trajectory: Trajectory, bars: Sequence[MechanismBars]) -> Array:
    """Derivatives by the parameters of a mechanism, through the trajectory: (numbers, parameters).

    For each number its derivatives by what the mechanism says are given. They hold all but what
    depends on the parameters at a fixed trajectory, see `fixed_slopes`.

    Raises:
        ValueError: If the topology, a jump or the branch of the start depends on a parameter, or
            the mechanism cannot be built beside the values; the message names it.
    """
    own = _Differences(trajectory.model, (trajectory.y[0], trajectory.v[0]))
    return own.by_parameters(
        len(bars), lambda state: [_contracted(own.base, state, bar) for bar in bars]
    )


def fixed_slopes(model: FlatModel, numbers: Sequence[Callable[[FlatModel], float]]) -> Array:
    """The same of numbers of a model, at a fixed trajectory: shape (numbers, parameters).

    Each is a function of the model with other values of the parameters, as the power of a drive
    along a line, whose direction may be a parameter. The result is zero where none changes with
    all parameters at once. Errors are those of `parameter_slopes`.
    """
    mechanism, here = parametric(model), [number(model) for number in numbers]
    beside = model.stated_by(mechanism.twin)
    if [number(beside) for number in numbers] == here:
        return np.zeros((len(numbers), len(mechanism.parameters.names)))
    own = _Differences(model)
    return own.by_parameters(
        len(numbers),
        lambda state: [
            number(state.model) - old for number, old in zip(numbers, here, strict=True)
        ],
    )


def influence(model: FlatModel) -> list[str]:
    """Names of the parameters on which what the mechanism says does not depend."""
    mechanism, own, idle = parametric(model), _Differences(model), []
    here, start = own.base.flat(), _start_of(model.mechanism, model)
    for k, (name, below, above) in enumerate(mechanism.parameters.ranges):
        other = own.stated(_shift(k, 1e-3 * (above if above >= below else -below)))
        same = all(np.array_equal(a, b) for a, b in zip(here, other.flat(), strict=True))
        if same and start == _start_of(other.model.mechanism, model):
            idle.append(name)
    return idle


def parametric(model: FlatModel) -> ParametricMechanism:
    """The mechanism of a model, which has parameters."""
    assert isinstance(model.mechanism, ParametricMechanism)
    return model.mechanism


def _shift(k: int, step: float) -> Array:
    shift = np.zeros(k + 1)
    shift[k] = step
    return shift


def _start_of(mechanism: Mechanism, model: FlatModel) -> list[bytes]:
    """What the start is made of, beside the tables."""
    parts = []
    for name, body in model.bodies.items():
        placed = model.arrays.placed(mechanism.placements[name])
        parts += [*placed, *mechanism.start.elastic_state(name, body.modes)]
    return [np.asarray(part).tobytes() for part in parts]


class _JumpedError(ValueError):
    """The start is far from that at the values."""


class _Differences:
    """Differences of what a mechanism says."""

    def __init__(self, model: FlatModel, start: tuple[Array, Array] | None = None) -> None:
        self.model, self.start = model, start
        none = np.zeros(model.size)
        self.base = _stated(model, none, none)

    def by_parameters(self, count: int, change: Callable[[_Stated], Sequence[float]]) -> Array:
        """Derivatives (count, parameters) of numbers, of which ``change`` is that to a state."""
        ranges = parametric(self.model).parameters.ranges
        found = np.zeros((count, len(ranges)))
        for k, (name, below, above) in enumerate(ranges):
            try:
                for weight, state in self._around(k, below, above):
                    found[:, k] += weight * np.array(change(state))
            except ValueError as error:
                raise ValueError(f"parameter {name!r}: no derivative: {error}") from error
        return found

    def _around(self, k: int, below: float, above: float) -> list[tuple[float, _Stated]]:
        """States beside the values of parameter k, and weights of their changes in derivatives.

        Two where the start stays, as tables and constants have no error but round-off. A start is
        solved for, so that steps are longer there, and of fourth order. Steps are shortened until
        slopes hardly change over them.
        """
        central = 2.0 * _STEP * (below + above) <= min(below, above)
        side = 1 if central or above >= below else -1
        base, found, steps = self.base.flat(), list[tuple[float, _Stated]](), [_SHORT]
        steps += [_STEP * _SHORTER**n for n in range(_TIMES)]

        def at(h: float, offsets: Sequence[int]) -> list[_Stated]:
            return [self.stated(_shift(k, side * s * h)) for s in offsets]

        for h in (step * (below + above) for step in steps):
            try:
                states, two = at(h, (-1, 1) if central else (1, 2)), h == steps[0] * (below + above)
                if not two:
                    states += at(h, (-2, 2) if central else (3, 4))
            except _JumpedError:
                if h == steps[-1] * (below + above):
                    raise
                continue
            if two and any(np.any(state.y) or np.any(state.v) for state in states):
                continue
            if central:
                weights = [-1 / 2, 1 / 2] if two else [-2 / 3, 2 / 3, 1 / 12, -1 / 12]
            else:
                weights = [2.0, -1 / 2] if two else [4.0, -3.0, 4 / 3, -1 / 4]
            pairs = zip(weights, states, strict=True)
            found = [(side * weight / h, state) for weight, state in pairs]
            first, last = (states[-2].flat() if central else base), states[-1].flat()
            if not _bends(first, last, base if central else states[0 if two else 1].flat()):
                break
        return found

    def stated(self, shift: Array) -> _Stated:
        """What the mechanism says at a shift of its parameters; a shorter one ends in zeros."""
        model = self.model.stated_by(parametric(self.model).shifted(shift))
        _check_same(self.model, model)
        y, v = np.zeros(model.size), np.zeros(model.size)
        if self.start is not None and self._start_depends(model):
            _, there, rate = started(model)
            y, v = model.arrays.difference(there[None], self.start[0])[0], rate - self.start[1]
            size = float(np.max(np.abs(self.start[0]), initial=0.0)) or 1.0
            if float(np.max(np.abs(y))) > _JUMP * size:
                raise _JumpedError("the start jumps to another position by a small change of it")
        return _stated(model, y, v, self.base.arrays)

    def _start_depends(self, model: FlatModel) -> bool:
        """Whether the start may be another one."""
        old = self.model
        names = FIELDS if old.mechanism.start.in_equilibrium else _GEOMETRY
        for name in names:
            a, b = getattr(old.arrays, name), getattr(model.arrays, name)
            if name in _OVER_TIME:
                a, b = a[0], b[0]
            if not np.array_equal(a, b):
                return True
        if old.mechanism.start.in_equilibrium:
            # S, K and so on; the metric alone does not matter
            for name in ("mass", "S", "K"):
                if not np.array_equal(getattr(old.arrays, name), getattr(model.arrays, name)):
                    return True
        return _start_of(old.mechanism, old) != _start_of(model.mechanism, old)


def _stated(model: FlatModel, y: Array, v: Array, base: Mapping[str, Array] = {}) -> _Stated:
    """What a model says; arrays that are as at the ``base`` are those there."""
    arrays = {name: getattr(model.arrays, name) for name in FIELDS}
    same = {name: own for name, own in base.items() if np.array_equal(own, arrays[name])}
    return _Stated(model, {**arrays, **same}, model.effective, y, v)


def without_markers(body: VolumeIntegrals) -> VolumeIntegrals:
    """Integrals with markers of zero, which count with the vectors that are made of them."""
    return replace(body, markers={name: own.scaled(0.0) for name, own in body.markers.items()})


def _numbers(body: VolumeIntegrals) -> list[Array]:
    """All numbers of a body."""
    parts = [body.mass, body.S, body.G, body.N, body.P, body.K, *body.stiffening.values()]
    for marker in body.markers.values():
        parts += [marker.position, marker.displacement, marker.rotation]
    return [np.asarray(part, dtype=np.float64) for part in parts if part is not None]


def _bends(one: Sequence[Array], two: Sequence[Array], middle: Sequence[Array]) -> bool:
    """Whether slopes change between two ends by more than a share and round-off."""
    for a, b, at in zip(one, two, middle, strict=True):
        if a is b is at:
            continue
        bend = float(np.max(np.abs(a + b - 2.0 * at), initial=0.0))
        if bend > _ROUND_OFF:
            change = float(np.max(np.abs(a - b), initial=0.0))
            size = float(np.max(np.abs(at), initial=0.0))
            if bend > _BENT * change + _ROUND_OFF * (size + 1.0):
                return True
    return False


def _contracted(base: _Stated, state: _Stated, bars: MechanismBars) -> float:
    """Change of a number by the change of what a mechanism says."""
    total = float(state.y @ bars.y + state.v @ bars.v) if bars.y.size else 0.0
    for name, bar in bars.arrays.items():
        if state.arrays[name] is not base.arrays[name]:
            total += float(np.vdot(bar, state.arrays[name] - base.arrays[name]))
    for name, own in bars.bodies.items():
        mine, theirs = base.effective[name], state.effective[name]
        if theirs is not mine:
            total += own.dot(theirs + mine.scaled(-1.0))
    return total


def _check_same(old: FlatModel, new: FlatModel) -> None:
    """Refuse another topology, and other times of jumps."""
    for name in (*_TOPOLOGY, *FIELDS):
        a, b = getattr(old.arrays, name), getattr(new.arrays, name)
        if a.shape != b.shape or (name in _TOPOLOGY and not np.array_equal(a, b)):
            raise ValueError(
                "what the joints and forces are made of changes with it, as where a stiffness or a "
                "length becomes zero"
            )
    if np.any((old.arrays.beta > 0.0) != (new.arrays.beta > 0.0)):
        raise ValueError("stiffness-proportional damping appears with it; keep it above zero")
    if not np.array_equal(old.tables.jumps, new.tables.jumps):
        a, b = old.tables.jumps, new.tables.jumps
        raise ValueError(
            f"the times of jumps depend on it, {a} and {b} s; steps end there and stay where they "
            "are: keep these times, or give a motion without jumps, as Motion.polynomial"
        )
