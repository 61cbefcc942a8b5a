# SPDX-License-Identifier: MIT
"""Derivatives by all that a mechanism says, and from there by the parameters of its description.

What a mechanism says to the equations of motion are a few tables and constants, and the start. The
adjoint gives the derivatives by these once. How they follow from parameters takes no simulation,
and is differenced.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeVar
from weakref import WeakSet

import numpy as np

from ..arrays import Array, Integers, Mask, summed
from ..body import VolumeIntegrals
from ..mechanism import Mechanism, ParametricMechanism
from .initial import started
from .model import FlatModel
from .stated import Numbers, OtherLawError
from .trajectory import Trajectory

Bodies = Mapping[str, VolumeIntegrals]
Result = TypeVar("Result")

#: Fields of the arrays that a mechanism and the markers of its bodies set.
FIELDS = ("gravity", "alpha", "beta", "shapes", "vector_stiffening", "drive", "prescribed",
          "load_table", "law", "normal", "ratio")  # fmt: skip
#: Fields that make up the topology, which must stay.
_TOPOLOGY = ("first", "modes", "kind", "side", "vector_body", "vector_slot", "vector_kind",
             "vector_marker", "vector_stiffened", "load_vector", "load_axes")  # fmt: skip
#: Fields beside tables on which an assembled start depends
_GEOMETRY = ("shapes", "vector_stiffening", "normal", "ratio")
#: Functions that have been seen to make the same machine twice, so that this is asked once each
_REPEATABLE: WeakSet[Callable[..., Any]] = WeakSet()


@dataclass(frozen=True)
class DifferenceOptions:
    """Steps of differences, and what counts as round-off."""

    #: Step as share of the range of a parameter where nothing is solved for.
    short_step: float = 3e-6
    #: Step where a start is solved for. Of fourth order, differences take steps so long that the
    #: tolerance of a static start does not show.
    step: float = 2e-4
    shorter: float = 1 / 16  #: Factor by which a step is shortened where slopes change over it.
    most_steps: int = 5  #: Most steps that are tried, each shorter than the one before.
    #: Second differences, in parts of first ones, up to which slopes hardly change over a step.
    bent: float = 3e-3
    round_off: float = 1e-12  #: Changes below this share of the size of an array are round-off.
    #: Difference of numbers of the same machine, relative to their size, that is no round-off.
    different: float = 1e-9
    #: Change of the start by a step, in sizes of the start, beyond which it has jumped.
    jump: float = 1e-2
    #: Golden ratio, whose multiples leave the least gaps between their fractions.
    golden: float = 0.6180339887
    #: Step at which it is looked whether anything depends on a parameter.
    step_of_a_look: float = 1e-3


OPTIONS = DifferenceOptions()


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
        if not self.y.size or not other.y.size:
            y, v = (self.y, self.v) if self.y.size else (other.y, other.v)
        else:
            y, v = self.y + other.y, self.v + other.v
        arrays, bodies = summed(self.arrays, other.arrays), summed(self.bodies, other.bodies)
        return MechanismBars(arrays, bodies, y, v)


class _State(NamedTuple):
    """The model of a mechanism at values of its parameters."""

    model: FlatModel
    numbers: Array  #: All of them, see `Numbers`, shape (numbers,)
    y: Array  #: Shift from the start at the values themselves, shape (size,)
    v: Array


def parameter_slopes(trajectory: Trajectory, bars: Sequence[MechanismBars]) -> Array:
    """Derivatives by the parameters of a mechanism, through the trajectory: (numbers, parameters).

    They hold all but what depends on the parameters at a fixed trajectory, see `fixed_slopes`. A
    ValueError names a parameter on which the topology, a jump or the branch of the start depends,
    or beside whose value there is no mechanism.
    """
    differences = _Differences(trajectory.model, (trajectory.y[0], trajectory.v[0]))
    _again(differences.check_repeatable)
    return _again(lambda: differences.contracted(bars))


def fixed_slopes(model: FlatModel, numbers: Sequence[Callable[[FlatModel], float]]) -> Array:
    """Derivatives of the model's numbers at a fixed trajectory: shape (numbers, parameters).

    Each is a function of the model with other values of the parameters, as the power of a drive
    along a line, whose direction may be a parameter. The result is zero where none changes with
    all parameters at once. Errors are those of `parameter_slopes`.
    """
    mechanism, values = parametric(model), [number(model) for number in numbers]
    twin = model.stated_by(mechanism.twin)
    if [number(twin) for number in numbers] == values:
        return np.zeros((len(numbers), len(mechanism.parameters.names)))
    differences = _Differences(model)
    _again(differences.check_repeatable)

    def slope(k: int) -> Array:
        slopes = np.zeros(len(numbers))
        for weight, state in differences.around(k):
            shifted = model.stated_by(state.model.mechanism)
            slopes += weight * (np.array([number(shifted) for number in numbers]) - values)
        return slopes

    count = range(len(mechanism.parameters.names))
    return np.array([_again(lambda k=k: slope(k)) for k in count]).T  # type: ignore[misc]


def _again(find: Callable[[], Result]) -> Result:
    """The result as soon as the kinds of all signals at other values are known."""
    while True:
        try:
            return find()
        except OtherLawError:
            continue


def influence(model: FlatModel) -> list[str]:
    """Names of the parameters on which what the mechanism says does not depend."""
    differences, idle = _Differences(model), list[str]()
    _again(differences.check_repeatable)
    start = _start_of(model.mechanism, model)
    for k, (name, below, above) in enumerate(parametric(model).parameters.ranges):
        shift = OPTIONS.step_of_a_look * (above if above >= below else -below) * np.eye(k + 1)[k]
        try:
            shifted = differences.state(shift)
        except OtherLawError:
            continue
        unchanged = np.array_equal(differences.numbers.values, shifted.numbers)
        if unchanged and np.array_equal(start, _start_of(shifted.model.mechanism, model)):
            idle.append(name)
    return idle


def parametric(model: FlatModel) -> ParametricMechanism:
    """The mechanism of a model, which has parameters."""
    assert isinstance(model.mechanism, ParametricMechanism)
    return model.mechanism


def _start_of(mechanism: Mechanism, model: FlatModel) -> Array:
    """What the start is made of, beside the tables."""
    states = []
    for name, body in model.bodies.items():
        placed = model.arrays.placed(mechanism.placements[name])
        states += [*placed, *mechanism.start.elastic_state(name, body.modes)]
    return np.concatenate([np.ravel(state) for state in states])


class _JumpedError(ValueError):
    """The start is far from that at the values."""


class _Differences:
    """Differences of what a mechanism says."""

    def __init__(self, model: FlatModel, start: tuple[Array, Array] | None = None) -> None:
        self.model, self.start, self.numbers = model, start, Numbers(model)
        self.ranges = parametric(model).parameters.ranges

    def check_repeatable(self) -> None:
        """Refuse, by a ValueError, a function that makes another machine of the same values."""
        build = parametric(self.model).build
        if build in _REPEATABLE:
            return
        rebuilt, group, values = self.state(np.zeros(0)), self.numbers.group, self.numbers.values
        sizes = np.zeros(int(group[-1]) + 1)
        np.maximum.at(sizes, group, np.abs(values))
        changed = np.abs(rebuilt.numbers - values) > OPTIONS.different * sizes[group]
        start = _start_of(self.model.mechanism, self.model)
        rebuilt_start = _start_of(rebuilt.model.mechanism, self.model)
        if np.any(changed) or not np.allclose(start, rebuilt_start, OPTIONS.different):
            raise ValueError(
                "parameters: the function returns different mechanisms for the same values, as it "
                "draws random numbers, counts its calls or reads a clock; let it depend on its "
                "arguments alone"
            )
        with suppress(TypeError):  # some callables take no weak references
            _REPEATABLE.add(build)

    def contracted(self, bars: Sequence[MechanismBars]) -> Array:
        """Derivatives (bars, parameters) of numbers from those by what the mechanism says."""
        by_numbers = np.array([self.numbers.bars(bar.arrays, bar.bodies) for bar in bars])
        count = len(self.ranges)
        derivatives, remaining = np.zeros((len(bars), count)), list(range(count))
        grouped = self._grouped()
        if grouped is not None:
            slopes, owner, remaining = grouped
            for row, bar in zip(derivatives, by_numbers, strict=True):
                row[:] = np.bincount(owner + 1, bar * slopes, count + 1)[1:]
        for k in remaining:
            derivatives[:, k] = 0.0
            for weight, state in self.around(k):
                change = by_numbers @ (state.numbers - self.numbers.values)
                derivatives[:, k] += weight * change
                if np.any(state.y) or np.any(state.v):
                    of_start = [bar.y @ state.y + bar.v @ state.v for bar in bars]
                    derivatives[:, k] += weight * np.array(of_start)
        return derivatives

    def _grouped(self) -> tuple[Array, Integers, list[int]] | None:
        """Slopes of the numbers by parameters that are shifted in groups.

        Returns the slopes, of each number the one parameter on which it depends or -1, (numbers,)
        each, and the parameters that must be shifted one by one: those on which the start depends
        or a number with others, and those over whose steps slopes change. None where groups save
        nothing, or fail.

        Parameters are shifted in groups, such that no parameter is in all groups of another one. A
        number that has changed with the very groups of one parameter depends on it alone.
        """
        count, values = len(self.ranges), self.numbers.values
        groups = _groups(count)
        if groups.shape[1] + 1 >= 2 * count:
            return None

        # steps to one side where there is no room for both
        sides = np.array([self._side(below, above) for _, below, above in self.ranges])
        widths = np.array([below + above for _, below, above in self.ranges])
        central = sides == 0
        # no two alike, so that no changes cancel
        steps = (
            OPTIONS.short_step
            * widths
            * (0.5 + 0.5 * (np.arange(1, count + 1) * OPTIONS.golden % 1.0))
        )
        steps = np.where(sides < 0, -steps, steps)
        try:
            states = [self.state(steps * group) for group in groups.T]
            back = self.state(np.where(central, -steps, 2.0 * steps))
        except ValueError:  # the parameter is found by shifting one by one
            return None

        # of each number the parameter whose groups have changed it, always by the same amount
        shifted = np.array([state.numbers for state in states])
        changed = shifted != values
        ahead_values = shifted[np.argmax(changed, axis=0), np.arange(values.size)]
        bit = 2 ** np.arange(len(states))
        code_of_parameter, code_of_number = groups @ bit, bit @ changed
        parameter_of_code = np.full(2 ** len(states), -1)
        parameter_of_code[code_of_parameter] = np.arange(count)
        alike = np.all(shifted == np.where(changed, ahead_values, values), axis=0)
        owner = np.where(alike, parameter_of_code[code_of_number], -1)
        owned = owner >= 0

        # parameters of which some number changes with others, or the start does
        depends = np.any(changed, axis=0) | (back.numbers != values)
        shared = set(code_of_number[~owned & depends])
        if self.start is not None and np.any(starts := self._start_numbers):
            inputs = np.array([self._start_inputs(s.model)[starts] for s in states])
            shared |= set(bit @ (inputs != self._inputs[starts])) - {0}
        # nothing is known where a number changes on one side only, code 0
        one_by_one = np.array(
            [any(bits & ~code == 0 or code == 0 for code in shared) for bits in code_of_parameter]
        )

        step, one_sided = steps[owner], ~central[owner]
        ahead, behind = ahead_values - values, back.numbers - values
        slopes = np.where(one_sided, 2.0 * ahead - 0.5 * behind, 0.5 * (ahead - behind)) / step
        bend = np.where(one_sided, behind - 2.0 * ahead, ahead + behind)
        change = np.where(one_sided, behind, ahead - behind)
        for array in (slopes, bend, change):
            array[~owned] = 0.0
        group_count = int(self.numbers.group[-1]) + 1
        place = np.where(owned, owner * group_count + self.numbers.group, 0)
        bent = _bends(bend, change, values, place, count * group_count)
        one_by_one |= np.any(bent.reshape(count, group_count), axis=1)
        return slopes, owner, np.flatnonzero(one_by_one).tolist()

    @staticmethod
    def _side(below: float, above: float) -> int:
        """0 if there is room for steps to both sides of a parameter, else 1 or -1."""
        if 2.0 * OPTIONS.step * (below + above) <= min(below, above):
            return 0
        return 1 if above >= below else -1

    def around(self, k: int) -> list[tuple[float, _State]]:
        """States beside the values of parameter k, and weights of their changes in derivatives.

        Two where the start stays, as tables and constants have no error but round-off. A start is
        solved for, so that steps are longer there, and of fourth order. Steps are shortened until
        slopes hardly change over them. A ValueError names a parameter without a derivative.
        """
        name, below, above = self.ranges[k]
        try:
            return self._around(k, below + above, self._side(below, above))
        except ValueError as error:
            raise ValueError(f"parameter {name!r}: no derivative: {error}") from error

    def _around(self, k: int, width: float, side: int) -> list[tuple[float, _State]]:
        central, side = side == 0, side or 1
        none = np.zeros(self.model.size)
        base = _State(self.model, self.numbers.values, none, none)
        steps = [OPTIONS.short_step]
        steps += [OPTIONS.step * OPTIONS.shorter**n for n in range(OPTIONS.most_steps)]

        def shifted(h: float, offsets: Sequence[int]) -> list[_State]:
            return [self.started(side * s * h * np.eye(k + 1)[k]) for s in offsets]

        for h in (step * width for step in steps):
            second_order = h == steps[0] * width
            try:
                states = shifted(h, (-1, 1) if central else (1, 2))
                if not second_order:
                    states += shifted(h, (-2, 2) if central else (3, 4))
            except _JumpedError:
                if h == steps[-1] * width:
                    raise
                continue
            if second_order and any(np.any(state.y) or np.any(state.v) for state in states):
                continue
            if central:
                weights = [-1 / 2, 1 / 2] if second_order else [-2 / 3, 2 / 3, 1 / 12, -1 / 12]
            else:
                weights = [2.0, -1 / 2] if second_order else [4.0, -3.0, 4 / 3, -1 / 4]
            ends = (states[-2] if central else base), states[-1]
            middle = base if central else states[0 if second_order else 1]
            if not self._bent(*ends, middle):
                pairs = zip(weights, states, strict=True)
                return [(side * weight / h, state) for weight, state in pairs]
        raise ValueError(
            "slopes of the mechanism from below and from above differ at this value, as with an "
            "`if`, a maximum or a rounding in the function that makes the mechanism: use a smooth "
            "function, or another value"
        )

    def _bent(self, begin: _State, end: _State, middle: _State) -> bool:
        """Whether slopes change between two ends by more than a share and round-off."""
        a, b, c = (np.concatenate([s.numbers, s.y, s.v]) for s in (begin, end, middle))
        count = int(self.numbers.group[-1]) + 1
        group = np.append(self.numbers.group, np.repeat([count, count + 1], self.model.size))
        return bool(np.any(_bends(a + b - 2.0 * c, a - b, c, group, count + 2)))

    def state(self, shift: Array) -> _State:
        """The mechanism's numbers at a shift of its parameters; a shorter shift ends in zeros."""
        mechanism, none = parametric(self.model).shifted(shift), np.zeros(self.model.size)
        model = self.model.stated_by(mechanism, tabulated=False)
        _check_same(self.model, model)
        return _State(model, self.numbers.of(model), none, none)

    def started(self, shift: Array) -> _State:
        """The mechanism's numbers including the start."""
        state = self.state(shift)
        depends = self.start is not None and np.any(starts := self._start_numbers)
        if not depends or np.array_equal(
            self._start_inputs(state.model)[starts], self._inputs[starts]
        ):
            return state
        assert self.start is not None
        _, position, velocity = started(state.model.at(self.model.times[:1]))
        y = self.model.arrays.difference(position[None], self.start[0])[0]
        size = float(np.max(np.abs(self.start[0]), initial=0.0)) or 1.0
        if float(np.max(np.abs(y))) > OPTIONS.jump * size:
            raise _JumpedError("the start jumps to another position by a small change of it")
        return state._replace(y=y, v=velocity - self.start[1])

    def _start_inputs(self, model: FlatModel) -> Array:
        """All on which the start depends, shape (inputs,)."""
        arrays = model.at(self.model.times[:1]).arrays
        inputs = [arrays.drive[0, :, :2], arrays.prescribed[0, :, :2]]
        inputs += [getattr(arrays, name) for name in _GEOMETRY]
        if model.mechanism.start.in_equilibrium:
            # S, K and so on; the metric alone does not matter
            inputs += [arrays.gravity[0], arrays.load_table[0], arrays.law]
            inputs += [arrays.mass, arrays.S, arrays.K]
        inputs.append(_start_of(model.mechanism, self.model))
        return np.concatenate([np.ravel(array) for array in inputs])

    @cached_property
    def _inputs(self) -> Array:
        return self._start_inputs(self.model)

    @cached_property
    def _start_numbers(self) -> Mask:
        """Which inputs of the start depend on parameters beyond round-off, shape (inputs,)."""
        twin = self.model.stated_by(parametric(self.model).twin, tabulated=False)
        arrays, allowed = self.model.arrays, np.zeros(self._inputs.size)
        of_drives = np.max(np.abs(arrays.drive[:, :, :2]), axis=0, initial=0.0)
        of_vectors = np.max(np.abs(arrays.prescribed[:, :, :2]), axis=(0, 3), initial=0.0)
        sizes = np.append(of_drives.ravel(), np.repeat(of_vectors.ravel(), arrays.d))
        allowed[: sizes.size] = OPTIONS.round_off * sizes
        return np.abs(self._start_inputs(twin) - self._inputs) > allowed


def _groups(count: int) -> Integers:
    """Which parameters are in which groups, (parameters, groups): each in another half of them.

    So many groups that there are enough halves; none is a part of another one (E. Sperner,
    Mathematische Zeitschrift 27 (1928), doi:10.1007/BF01171114).
    """
    number = next(m for m in itertools.count(1) if math.comb(m, m // 2) >= count)
    groups = np.zeros((count, number), dtype=np.int64)
    halves = itertools.combinations(range(number), number // 2)
    for row, half in zip(groups, halves, strict=False):
        row[list(half)] = 1
    return groups


def without_markers(body: VolumeIntegrals) -> VolumeIntegrals:
    """Integrals with markers of zero, which count with the vectors that are made of them."""
    markers = {name: marker.scaled(0.0) for name, marker in body.markers.items()}
    return replace(body, markers=markers)


def _bends(bend: Array, change: Array, values: Array, group: Integers, count: int) -> Mask:
    """Mask of groups whose second differences exceed a share of first ones and round-off."""

    def largest(array: Array) -> Array:
        by_group = np.zeros(count)
        np.maximum.at(by_group, group, np.abs(array))
        return by_group

    allowed = OPTIONS.bent * largest(change) + OPTIONS.round_off * (largest(values) + 1.0)
    bent: Mask = largest(bend) > allowed
    return bent


def _check_same(old: FlatModel, new: FlatModel) -> None:
    """Refuse another topology, and other times of jumps."""
    for name in (*_TOPOLOGY, *FIELDS):
        a, b = getattr(old.arrays, name), getattr(new.arrays, name)
        if a.shape != b.shape or (name in _TOPOLOGY and a.tobytes() != b.tobytes()):
            raise ValueError(
                "joints and forces depend on different quantities at a nearby value, as where a "
                "stiffness or a length becomes zero"
            )
    if np.any((old.arrays.beta > 0.0) != (new.arrays.beta > 0.0)):
        raise ValueError(
            "at zero it would add stiffness-proportional damping to a body without damping; keep "
            "it above zero"
        )
    if not np.array_equal(old.tables.jumps, new.tables.jumps):
        a, b = old.tables.jumps, new.tables.jumps
        raise ValueError(
            f"the times of jumps depend on it, {a} and {b} s, but steps end at fixed times: keep "
            "the times of jumps, or give a motion without jumps, as Motion.polynomial"
        )
