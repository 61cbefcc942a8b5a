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
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, TypeVar
from weakref import WeakSet

import numpy as np

from ..arrays import Array, Integers, Mask
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
    arrays: Mapping[str, Array]
    #: With respect to the integrals of the bodies with their point masses, markers left out.
    bodies: Bodies
    #: With respect to the coordinates at the start, shape (size,); in space, at the place of
    #: rotations, to turns about the body's axes.
    y: Array
    v: Array  #: And to the velocities there


class _Room(NamedTuple):
    """The room that a parameter leaves for steps of differences."""

    name: str
    width: float  #: Width of the range of the parameter.
    #: 0 if there is room on both sides of its value, else the side with more room, 1 or -1.
    side: int

    @staticmethod
    def beside(name: str, below: float, above: float) -> _Room:
        """The room of a parameter whose bounds are so far below and above its value."""
        width = below + above
        if 2.0 * OPTIONS.step * width <= min(below, above):
            return _Room(name, width, 0)
        return _Room(name, width, 1 if above >= below else -1)


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
    return _again(lambda: differences.by_parameters(bars))


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


class _Stencil(NamedTuple):
    """A formula for differences: offsets in steps, and weights of the changes there."""

    order: int
    offsets: tuple[int, ...]
    weights: tuple[float, ...]
    #: One end, and the point in the middle, among the points: the value itself, number 0, and those
    #: at the offsets, the last of which is the other end.
    begin: int
    middle: int


#: Differences of second and of fourth order
_CENTRAL = (
    _Stencil(2, (-1, 1), (-1 / 2, 1 / 2), begin=1, middle=0),
    _Stencil(4, (-1, 1, -2, 2), (-2 / 3, 2 / 3, 1 / 12, -1 / 12), begin=3, middle=0),
)
_ONE_SIDED = (
    _Stencil(2, (1, 2), (2.0, -1 / 2), begin=0, middle=1),
    _Stencil(4, (1, 2, 3, 4), (4.0, -3.0, 4 / 3, -1 / 4), begin=0, middle=2),
)


class _JumpedError(ValueError):
    """The start at shifted parameters is far from the start at their values."""


class _Differences:
    """Differences of what a mechanism says."""

    def __init__(self, model: FlatModel, start: tuple[Array, Array] | None = None) -> None:
        self.model, self.start, self.numbers = model, start, Numbers(model)
        self.rooms = [_Room.beside(*bounds) for bounds in parametric(model).parameters.ranges]

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

    def by_parameters(self, bars: Sequence[MechanismBars]) -> Array:
        """Derivatives (bars, parameters), from those by what the mechanism says."""
        by_numbers = np.array([self.numbers.bars(bar.arrays, bar.bodies) for bar in bars])
        count = len(self.rooms)
        derivatives, remaining = np.zeros((len(bars), count)), list(range(count))
        grouped = self._grouped()
        if grouped is not None:
            slopes, owner, remaining = grouped
            for row, bar in zip(derivatives, by_numbers, strict=True):
                # the first of the sums is of the numbers with owner -1
                row[:] = np.bincount(owner + 1, bar * slopes, count + 1)[1:]
        for k in remaining:
            derivatives[:, k] = 0.0
            for weight, state in self.around(k):
                change = by_numbers @ (state.numbers - self.numbers.values)
                derivatives[:, k] += weight * change
                if np.any(state.y) or np.any(state.v):
                    start_changes = [bar.y @ state.y + bar.v @ state.v for bar in bars]
                    derivatives[:, k] += weight * np.array(start_changes)
        return derivatives

    def _grouped(self) -> tuple[Array, Integers, list[int]] | None:
        """Slopes of the numbers by parameters that are shifted in groups.

        Returns the slopes (numbers,), the owner of each number (numbers,), which is the one
        parameter on which it depends or -1, and the parameters that must be shifted one by one:
        those on which the start depends, those that share a number with others, and those over
        whose steps slopes change. None where groups save nothing, or fail.
        """
        count, values = len(self.rooms), self.numbers.values
        groups = _groups(count)
        if groups.shape[1] + 1 >= 2 * count:
            return None

        # steps to one side where there is no room for both; no two alike, so that no changes cancel
        side, width = (np.array([getattr(room, name) for room in self.rooms])
                       for name in ("side", "width"))  # fmt: skip
        unlike = 0.5 + 0.5 * (np.arange(1, count + 1) * OPTIONS.golden % 1.0)
        steps = OPTIONS.short_step * width * unlike
        steps = np.where(side < 0, -steps, steps)
        central = side == 0
        try:
            states = [self.state(steps * group) for group in groups.T]
            back = self.state(np.where(central, -steps, 2.0 * steps))
        except ValueError:  # the parameter is found by shifting one by one
            return None

        changed = np.array([state.numbers != values for state in states])
        owner, ahead_values = self._owners(groups, states, changed)
        one_by_one = self._entangled(groups, states, changed, back, owner)

        step, one_sided = steps[owner], ~central[owner]
        ahead, behind = ahead_values - values, back.numbers - values
        slopes = np.where(one_sided, 2.0 * ahead - 0.5 * behind, 0.5 * (ahead - behind)) / step
        bend = np.where(one_sided, behind - 2.0 * ahead, ahead + behind)
        change = np.where(one_sided, behind, ahead - behind)
        for array in (slopes, bend, change):
            array[owner < 0] = 0.0
        group_count = int(self.numbers.group[-1]) + 1
        place = np.where(owner >= 0, owner * group_count + self.numbers.group, 0)
        bent = _bends(bend, change, values, place, count * group_count)
        one_by_one |= np.any(bent.reshape(count, group_count), axis=1)
        return slopes, owner, np.flatnonzero(one_by_one).tolist()

    def _owners(
        self, groups: Integers, states: Sequence[_State], changed: Mask
    ) -> tuple[Integers, Array]:
        """The one parameter on which each number depends or -1, and its value if that is shifted.

        It is the parameter whose groups (parameters, groups) are those with whose states the number
        has `changed`, (groups, numbers), always by the same amount.
        """
        values, shifted = self.numbers.values, np.array([state.numbers for state in states])
        shifted_value = shifted[np.argmax(changed, axis=0), np.arange(values.size)]
        consistent = np.all(shifted == np.where(changed, shifted_value, values), axis=0)
        bit = 2 ** np.arange(len(states))
        parameter_of_code = np.full(2 ** len(states), -1)
        parameter_of_code[groups @ bit] = np.arange(len(groups))
        return np.where(consistent, parameter_of_code[bit @ changed], -1), shifted_value

    def _entangled(
        self,
        groups: Integers,
        states: Sequence[_State],
        changed: Mask,
        back: _State,
        owner: Integers,
    ) -> Mask:
        """Mask of parameters on which the start depends, or that share a number with others."""
        bit = 2 ** np.arange(len(states))
        depends = np.any(changed, axis=0) | (back.numbers != self.numbers.values)
        shared = set((bit @ changed)[(owner < 0) & depends])
        if self.start is not None and np.any(starts := self._start_numbers):
            inputs = np.array([self._start_inputs(state.model)[starts] for state in states])
            shared |= set(bit @ (inputs != self._inputs[starts])) - {0}
        # a number with code 0 changes on one side only, and may depend on any of the parameters
        return np.array(
            [
                any(code_of_parameter & ~code == 0 or code == 0 for code in shared)
                for code_of_parameter in groups @ bit
            ]
        )

    def around(self, k: int) -> list[tuple[float, _State]]:
        """States beside the values of parameter k, and weights of their changes in derivatives.

        Two where the start stays, as tables and constants have no error but round-off. A start is
        solved for, so that steps are longer there, and of fourth order. Steps are shortened until
        slopes hardly change over them. A ValueError names a parameter without a derivative.
        """
        name, width, side = self.rooms[k]
        second_order, fourth_order = _CENTRAL if side == 0 else _ONE_SIDED
        attempts = [(OPTIONS.short_step, second_order)]
        for n in range(OPTIONS.most_steps):
            attempts.append((OPTIONS.step * OPTIONS.shorter**n, fourth_order))
        try:
            for step, stencil in attempts:
                try:
                    difference = self._difference(k, (side or 1) * step * width, stencil)
                except _JumpedError:
                    if step == attempts[-1][0]:
                        raise
                    continue
                if difference is not None:
                    return difference
            raise ValueError(
                "slopes of the mechanism from below and from above differ at this value, as with "
                "an `if`, a maximum or a rounding in the function that makes the mechanism: use a "
                "smooth function, or another value"
            )
        except ValueError as error:
            raise ValueError(f"parameter {name!r}: no derivative: {error}") from error

    def _difference(self, k: int, h: float, stencil: _Stencil) -> list[tuple[float, _State]] | None:
        """States and weights of the difference by parameter k with the step h.

        None where slopes change over the step, or where a difference of second order moves the
        start.
        """
        none = np.zeros(self.model.size)
        value = _State(self.model, self.numbers.values, none, none)
        direction = np.eye(k + 1)[k]
        states = [self.started(offset * h * direction) for offset in stencil.offsets]
        if stencil.order == 2 and any(np.any(state.y) or np.any(state.v) for state in states):
            return None

        points = [value, *states]
        if self._bent(points[stencil.begin], points[-1], points[stencil.middle]):
            return None
        pairs = zip(stencil.weights, states, strict=True)
        return [(weight / h, state) for weight, state in pairs]

    def _bent(self, begin: _State, end: _State, middle: _State) -> bool:
        """Whether slopes change from ``begin`` to ``end`` by more than a share and round-off."""
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
    """Ones where a parameter is in a group, (parameters, groups); each is in another half of them.

    There are so many groups that there are enough halves, of which none contains another one
    (E. Sperner, Mathematische Zeitschrift 27 (1928), doi:10.1007/BF01171114).
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
