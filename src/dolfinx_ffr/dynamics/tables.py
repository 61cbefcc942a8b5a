# SPDX-License-Identifier: MIT
"""The prescribed motions, drives and loads of a mechanism, tabulated at instants."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np

from ..arrays import Array
from ..mechanism import Element, Mechanism, Motion, Moving, Row, sample
from .kinematics import Lowering

#: Relative distance from a jump at which the values on its sides are taken.
BESIDE_JUMP = 1e-15

Numbers = ParamSpec("Numbers")
Result = TypeVar("Result")


def once_for_a_mechanism(
    function: Callable[Concatenate[TimeTables, Numbers], Result],
) -> Callable[Concatenate[TimeTables, Numbers], Result]:
    """Decorator that keeps the result of a function of tables and numbers with the mechanism.

    A design loop simulates one mechanism with one body after another, whose loads and prescribed
    motions stay what they are.
    """
    results: dict[Any, tuple[weakref.ref[Mechanism], Result]] = {}

    @wraps(function)
    def once(tables: TimeTables, *args: Numbers.args, **kwargs: Numbers.kwargs) -> Result:
        key = (id(tables.mechanism), args, *kwargs.items())
        entry = results.get(key)
        if entry is not None and entry[0]() is tables.mechanism:
            return entry[1]
        result = function(tables, *args, **kwargs)
        results[key] = weakref.ref(tables.mechanism, lambda _: results.pop(key, None)), result
        return result

    return once


@dataclass(frozen=True, eq=False)
class TimeTables:
    """The prescribed motions, drives and loads of a mechanism, for any instants."""

    mechanism: Mechanism
    #: Rows of all joints, with the names of the joints.
    rows: Sequence[tuple[Row, str]]
    #: Forces, with their names.
    elements: Sequence[tuple[Element, str]]
    #: Rows and forces as the kernels take them.
    lowering: Lowering

    @cached_property
    def _motions(self) -> list[tuple[Motion, str]]:
        """Motions of markers, each once, with the users of these; the ground does not move."""
        moving: dict[int, tuple[Moving, str]] = {}
        for marker, user in self.lowering.prescribed:
            if isinstance(marker, Moving):
                moving.setdefault(id(marker), (marker, user))
        return [(motion, user) for marker, user in moving.values() for motion in marker.motions]

    @cached_property
    def jumps(self) -> Array:
        """Times after the start at which something prescribed is not smooth, in order [s]."""
        fields = (self.mechanism.gravity, self.mechanism.ground_acceleration)
        signals: list[object] = [signal for field in fields for signal in field]
        signals += [motion for motion, _ in self._motions]
        signals += [row.motion for row, _ in self.rows]
        for element, _ in self.elements:
            signals += [signal for load in element.loads for signal in load.components]
            signals += [spring.rest for spring in element.springs]
        of_motions = [t for signal in signals if isinstance(signal, Motion) for t in signal.jumps]
        jumps = np.unique(np.array([*of_motions, *self.mechanism.jumps], dtype=np.float64))
        return jumps[jumps > 0.0]

    @once_for_a_mechanism
    def check(self, start: float, end: float) -> None:
        """Refuse motions whose derivatives differ from differences between two times [s]."""
        motions = list(self._motions)
        motions += [(row.motion, f"joint {label!r}") for row, label in self.rows if row.motion]
        for motion, user in motions:
            if motion.stated()[1] is not None:  # by known formulas
                continue
            try:
                motion.check(start, end)
            except ValueError as error:
                raise ValueError(f"{user}: {error}") from error

    def beside_jumps(self, instants: Array) -> Array:
        """Times (instants,) [s]; the times of jumps are a little earlier."""
        if not self.jumps.size:
            return instants
        at_jump = np.isin(instants, self.jumps)
        return np.where(at_jump, instants * (1.0 - BESIDE_JUMP), instants)

    def tabulate(self, instants: Array) -> dict[str, Any]:
        """Tables at times (instants,) [s], by name of the field of ModelArrays.

        At the very time of a jump they hold the values before it: a step may end there, and the
        stages of the one that begins there lie behind it.
        """
        instants = self.beside_jumps(instants)
        # Gravity less the acceleration of the ground [m/s^2]
        d = self.lowering.d
        fall = np.zeros((instants.size, d))
        for field, sign in (("gravity", 1.0), ("ground_acceleration", -1.0)):
            for axis, signal in enumerate(getattr(self.mechanism, field)[:d]):
                fall[:, axis] += sign * sample(signal, instants, f"{field} along {'xyz'[axis]}")
        return {"gravity": fall, **self.lowering.tabulate(instants)}
