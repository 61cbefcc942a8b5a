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
from ..mechanism import Mechanism
from .initial import started
from .model import FlatModel, effective_bodies

Array = NDArray[np.float64]
Bodies = Mapping[str, VolumeIntegrals]
#: From the shifts of all parameters to the mechanism and all bodies there.
Built = Callable[[Array], tuple[Mechanism, Bodies]]

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

    arrays: dict[str, Array]
    effective: Bodies  #: With point masses, markers zero
    bodies: Bodies
    y: Array  #: Shift from the start at the values themselves, shape (size,)
    v: Array

    def flat(self) -> list[Array]:
        """All numbers, as a list of arrays."""
        parts = [self.y, self.v, *self.arrays.values()]
        for body in (*self.effective.values(), *self.bodies.values()):
            parts += [np.ravel(value) for value in _numbers(body)]
        return parts


def parameter_slopes(
    model: FlatModel,
    start: tuple[Array, Array],
    built: Built,
    ranges: Sequence[tuple[str, float, float]],
    bars: Sequence[tuple[MechanismBars, Bodies]],
) -> Array:
    """Derivatives by parameters of a mechanism, shape (numbers, parameters).

    They are those through the trajectory and the bodies. Of a number that takes what the mechanism
    says at a fixed trajectory, too, as the power of a drive along a distance with a moving anchor,
    this share is missing.

    Args:
        model: The compiled mechanism at the values.
        start: Coordinates and velocities at the start, shape (size,) each.
        built: The mechanism and all bodies at shifts from the values, shape (parameters,).
        ranges: For each parameter its name, and its distances to the lower and the upper bound.
        bars: For each number its derivatives by what the mechanism says, and the partial ones by
            the integrals of the bodies.

    Raises:
        ValueError: If the topology, a jump or the branch of the start depends on a parameter, or
            the mechanism cannot be built beside the values; the message names it.
    """
    own = _Differences(model, start, built)
    found = np.zeros((len(bars), len(ranges)))
    for k, (name, below, above) in enumerate(ranges):
        try:
            found[:, k] = own.slopes(k, below, above, bars)
        except ValueError as error:
            raise ValueError(f"parameter {name!r}: no derivative: {error}") from error
    return found


def influence(
    model: FlatModel, built: Built, ranges: Sequence[tuple[str, float, float]]
) -> list[str]:
    """Names of the parameters on which what the mechanism says does not depend."""
    none = (np.zeros(model.size), np.zeros(model.size))
    own, idle = _Differences(model, none, built, with_start=False), []
    for k, (name, below, above) in enumerate(ranges):
        step = 1e-3 * (above if above >= below else -below)
        shift = np.zeros(len(ranges))
        shift[k] = step
        here, there = own.base.flat(), own.stated(shift).flat()
        start, other = own.model.mechanism, built(shift)[0]
        same = all(np.array_equal(a, b) for a, b in zip(here, there, strict=True))
        if same and _start_of(start, model) == _start_of(other, model):
            idle.append(name)
    return idle


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

    def __init__(
        self, model: FlatModel, start: tuple[Array, Array], built: Built, with_start: bool = True
    ) -> None:
        self.model, self.start, self.built, self.with_start = model, start, built, with_start
        none = np.zeros(model.size)
        self.base = _stated(model, model.bodies, none, none)

    def slopes(
        self, k: int, below: float, above: float, bars: Sequence[tuple[MechanismBars, Bodies]]
    ) -> Array:
        """Derivatives of all numbers by parameter k, shape (numbers,)."""
        h, states = _STEP / _SHORTER * (below + above), list[_Stated]()
        for left in reversed(range(_TIMES)):
            h *= _SHORTER
            offsets, weights = _stencil(h, below, above)
            try:
                states = [self.stated(self._shift(k, s * h)) if s else self.base for s in offsets]
            except _JumpedError:
                if left:
                    continue
                raise
            if not _bends(states, offsets, self.base):
                break
        total = np.zeros(len(bars))
        for weight, state in zip(weights, states, strict=True):
            total += weight / h * np.array([_contracted(self.base, state, *bar) for bar in bars])
        return total

    def _shift(self, k: int, step: float) -> Array:
        shift = np.zeros(k + 1)
        shift[k] = step
        return shift

    def stated(self, shift: Array) -> _Stated:
        """What the mechanism says at a shift of its parameters; a shorter one ends in zeros."""
        mechanism, bodies = self.built(shift)
        model = self.model.stated_by(mechanism, bodies)
        _check_same(self.model, model)
        y, v = np.zeros(model.size), np.zeros(model.size)
        if self.with_start and self._start_depends(model):
            _, there, rate = started(model)
            y, v = model.arrays.difference(there[None], self.start[0])[0], rate - self.start[1]
            size = float(np.max(np.abs(self.start[0]), initial=0.0)) or 1.0
            if float(np.max(np.abs(y))) > _JUMP * size:
                raise _JumpedError("the start jumps to another position by a small change of it")
        return _stated(model, bodies, y, v)

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


def _stated(model: FlatModel, bodies: Bodies, y: Array, v: Array) -> _Stated:
    arrays = {name: getattr(model.arrays, name) for name in FIELDS}
    effective = effective_bodies(model.mechanism, bodies)
    return _Stated(arrays, {n: without_markers(b) for n, b in effective.items()}, bodies, y, v)


def without_markers(body: VolumeIntegrals) -> VolumeIntegrals:
    """Integrals with markers of zero, which count with the vectors that are made of them."""
    return replace(body, markers={name: own.scaled(0.0) for name, own in body.markers.items()})


def _numbers(body: VolumeIntegrals) -> list[Array]:
    """All numbers of a body."""
    parts = [body.mass, body.S, body.G, body.N, body.P, body.K, *body.stiffening.values()]
    for marker in body.markers.values():
        parts += [marker.position, marker.displacement, marker.rotation]
    return [np.asarray(part, dtype=np.float64) for part in parts if part is not None]


def _stencil(h: float, below: float, above: float) -> tuple[list[int], list[float]]:
    """Offsets in steps, and weights of fourth order, of a derivative between two bounds."""
    if 2.0 * h <= min(below, above):
        return [-2, -1, 1, 2], [1 / 12, -2 / 3, 2 / 3, -1 / 12]
    side = 1 if above >= below else -1
    weights = (-25 / 12, 4.0, -3.0, 4 / 3, -1 / 4)
    return [side * k for k in range(5)], [side * weight for weight in weights]


def _bends(states: Sequence[_Stated], offsets: Sequence[int], base: _Stated) -> bool:
    """Whether a step is so long that slopes change on its way."""
    middle = states[2] if 0 in offsets else base
    for at, one, two in zip(middle.flat(), states[0].flat(), states[-1].flat(), strict=True):
        change = float(np.max(np.abs(one - two), initial=0.0))
        size = float(np.max(np.abs(at), initial=0.0))
        bend = float(np.max(np.abs(one + two - 2.0 * at), initial=0.0))
        if bend > _BENT * change + _ROUND_OFF * (size + 1.0):
            return True
    return False


def _contracted(base: _Stated, state: _Stated, bars: MechanismBars, direct: Bodies) -> float:
    """Change of a number by the change of what a mechanism says."""
    total = float(state.y @ bars.y + state.v @ bars.v) if bars.y.size else 0.0
    for name, bar in bars.arrays.items():
        total += float(np.sum(bar * (state.arrays[name] - base.arrays[name])))
    for mine, theirs, by in (
        (base.effective, state.effective, bars.bodies),
        (base.bodies, state.bodies, direct),
    ):
        for name, own in by.items():
            if theirs[name] is not mine[name]:
                total += own.dot(theirs[name] + mine[name].scaled(-1.0))
    return total


def _check_same(old: FlatModel, new: FlatModel) -> None:
    """Refuse another topology, and other times of jumps."""
    for what, before, after in (
        ("joints", old.mechanism.joint_names, new.mechanism.joint_names),
        ("forces", old.mechanism.force_names, new.mechanism.force_names),
    ):
        if before != after:
            raise ValueError(f"the {what} change with it, from {before} to {after}")
    same = len(old.mechanism.point_masses) == len(new.mechanism.point_masses)
    if old.mechanism.start.in_equilibrium != new.mechanism.start.in_equilibrium or not same:
        raise ValueError("the kind of start or the number of point masses changes with it")
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
