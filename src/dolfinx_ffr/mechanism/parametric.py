# SPDX-License-Identifier: MIT
"""Named numbers of a mechanism, and the mechanism that a function of the user's makes of them."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array, Mask
from .mechanism import Mechanism

#: Part of its range by which a parameter of the twin differs
_TWIN_SHIFT = 1e-4
#: Part of its range within which a parameter stands at a bound
_AT_BOUND = 1e-3


class TopologyError(ValueError):
    """A function of parameters returns a machine of other joints or bodies for other values."""


class Parameter(NamedTuple):
    """A number between two bounds.

    Attributes:
        value: At the start, in the unit of the parameter.
        lower: Smallest value.
        upper: Largest value.
        unit: For history, summary and report.
        scale: "linear", or "log" for a positive number whose ratios count: an optimiser's steps are
            shares of the range, or of its logarithm.
    """

    value: float
    lower: float
    upper: float
    unit: str = ""
    scale: str = "linear"


class Parameters:
    """Numbers that make a mechanism, to be designed: names, values, bounds, units.

        ffr.Parameters(stiffness=(1e4, 1e3, 1e5), damping=(10.0, 0.0, 50.0, "N s/m"))

    Args:
        entries: By name (value, lower bound, upper bound), and optionally the unit, and the scale
            "linear" or "log" of the steps of an optimiser (`mechanism.Parameter`).

    Raises:
        ValueError: If none are given, or a value is not between its bounds, or these are not finite
            or not apart, or not positive with the scale "log".
    """

    def __init__(self, /, **entries: tuple[Any, ...]) -> None:
        if not entries:
            raise ValueError("parameters: none are given; give name=(value, lower, upper)")
        #: By name, in the order of the variables
        self.entries: dict[str, Parameter] = {}
        for name, entry in entries.items():
            label = f"parameter {name!r}"
            if not (isinstance(entry, tuple | list) and 3 <= len(entry) <= 5):
                raise TypeError(
                    f"{label} must be (value, lower, upper), optionally with unit and scale, but "
                    f"it is {validation.described(entry)}"
                )
            parameter = Parameter(*entry)
            validation.choice(f"{label}: scale", parameter.scale, ("linear", "log"))
            validation.instance(f"{label}: unit", parameter.unit, str, "a text")
            above = 0.0 if parameter.scale == "log" else -math.inf
            lower = validation.number(f"lower bound of {label}", parameter.lower, above=above)
            upper = validation.number(f"upper bound of {label}", parameter.upper, above=lower)
            value = validation.number(label, parameter.value, least=lower, most=upper)
            self.entries[name] = parameter._replace(value=value, lower=lower, upper=upper)

    def __repr__(self) -> str:
        arguments = ", ".join(f"{name}={tuple(entry)}" for name, entry in self.entries.items())
        return f"Parameters({arguments})"

    @property
    def names(self) -> list[str]:
        """Names of the parameters, in their order."""
        return list(self.entries)

    @property
    def values(self) -> dict[str, float]:
        """Values by name."""
        return {name: entry.value for name, entry in self.entries.items()}

    @property
    def array(self) -> Array:
        """Values, shape (size,)."""
        return np.array(list(self.values.values()))

    @property
    def ranges(self) -> list[tuple[str, float, float]]:
        """Name of each parameter, and its distances from the lower and from the upper bound."""
        return [(n, e.value - e.lower, e.upper - e.value) for n, e in self.entries.items()]

    @property
    def labels(self) -> dict[str, str]:
        """Names with units, by name."""
        return {n: f"{n} [{e.unit}]" if e.unit else n for n, e in self.entries.items()}

    @property
    def at_bounds(self) -> dict[str, str]:
        """Which parameters stand at a bound: "lower" or "upper"."""
        share = self.shares(self.array)
        ends = zip(self.names, share < _AT_BOUND, share > 1.0 - _AT_BOUND, strict=True)
        return {n: "lower" if low else "upper" for n, low, high in ends if low or high}

    def at(self, values: ArrayLike | Mapping[str, float]) -> Parameters:
        """The parameters at other values: by name, or all, shape (size,); those not named stay."""
        if isinstance(values, Mapping):
            for name in values:
                validation.choice("parameters: name", name, self.names)
            by_name = {**self.values, **values}
        else:
            vector = validation.real_array("parameters", values, (len(self.names),))
            by_name = dict(zip(self.names, vector.tolist(), strict=True))
        if by_name == self.values:
            return self
        return Parameters(**{n: e._replace(value=by_name[n]) for n, e in self.entries.items()})

    def fits(self, other: Parameters) -> bool:
        """Whether names, bounds, units and scales equal those of ``other`` parameters."""
        without_values, other_without_values = (
            [(n, e._replace(value=0.0)) for n, e in parameters.entries.items()]
            for parameters in (self, other)
        )
        return without_values == other_without_values

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Parameters) and self.entries == other.entries

    __hash__ = None  # type: ignore[assignment]

    # ------------------------------------------------------------------ shares of the ranges

    @property
    def bounds(self) -> Array:
        """Lower and upper bounds, shape (2, size)."""
        return np.array([(e.lower, e.upper) for e in self.entries.values()]).T

    @property
    def _log(self) -> Mask:
        return np.array([entry.scale == "log" for entry in self.entries.values()])

    def _scaled(self, values: Array) -> Array:
        """Values (..., size) on the scales of the parameters."""
        scaled = np.array(values, dtype=np.float64)
        scaled[..., self._log] = np.log(scaled[..., self._log])
        return scaled

    def shares(self, vector: Array) -> Array:
        """Values, a ``vector`` (size,), as shares of their ranges, on their scales."""
        low, high = self._scaled(self.bounds)
        return np.clip((self._scaled(vector) - low) / (high - low), 0.0, 1.0)

    def from_shares(self, shares: Array) -> tuple[Array, Array]:
        """Values at ``shares`` (size,) of their ranges, and their derivatives, (size,) each."""
        low, high = self._scaled(self.bounds)
        values = low + shares * (high - low)
        values[self._log] = np.exp(values[self._log])
        rates = np.where(self._log, values, 1.0) * (high - low)
        return np.clip(values, *self.bounds), rates

    # ------------------------------------------------------------------ the mechanism

    def mechanism(self, build: Callable[..., Any]) -> ParametricMechanism:
        """The mechanism that a function makes of the parameters.

        Args:
            build: A function of the parameters that it names as its arguments, or of all of them
                by ``**``. It returns a `Mechanism`, or a mechanism and a mapping of the
                `VolumeIntegrals` of bodies that depend on the parameters. Several functions of the
                same parameters may make several load cases.

        Raises:
            ValueError: If it has an argument that is no parameter, or there is no mechanism with
                these values; the message says them.
        """
        validation.function("parameters: what makes the mechanism", build, "the parameters")
        names, values = _arguments(build, self.names), self.values
        try:
            result = build(**{name: values[name] for name in names})
        except (ValueError, ArithmeticError) as error:
            numbers = ", ".join(f"{name} = {values[name]:.6g}" for name in names)
            raise ValueError(f"parameters: no mechanism with {numbers}: {error}") from error
        mechanism, bodies = result if isinstance(result, tuple) else (result, {})
        label = "parameters: what the function returns"
        needed = "a Mechanism, or a Mechanism and a mapping of VolumeIntegrals"
        validation.instance(label, mechanism, Mechanism, needed)
        validation.instance(label, bodies, Mapping, needed)
        # without a call of the class, as its fields have been validated
        parametric = object.__new__(ParametricMechanism)
        entries = {entry.name: getattr(mechanism, entry.name) for entry in fields(Mechanism)}
        vars(parametric).update(entries, build=build, parameters=self, own_bodies=bodies)
        return parametric


def _arguments(build: Callable[..., Any], names: list[str]) -> list[str]:
    """The parameters that a function takes as arguments."""
    arguments = inspect.signature(build).parameters.values()
    named = [p.name for p in arguments if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
    needed = {p.name for p in arguments if p.default is p.empty and p.name in named}
    if unknown := sorted(needed - set(names)):
        raise ValueError(
            f"parameters: the function takes {unknown[0]!r}, and the parameters are {names}"
        )
    takes_all = any(p.kind == p.VAR_KEYWORD for p in arguments)
    return [name for name in names if takes_all or name in named]


@dataclass(frozen=True)
class ParametricMechanism(Mechanism):
    """A mechanism at given values of its parameters; see `Parameters.mechanism`.

    Attributes:
        own_bodies: Integrals of bodies that depend on the parameters, by name.
        build: Maps the parameters, as keywords, to a mechanism, or to a mechanism and bodies that
            depend on them.
        parameters: The parameters with their values.
    """

    build: Callable[..., Any] = field(default=Mechanism, repr=False)
    parameters: Parameters = field(kw_only=True)
    own_bodies: Mapping[str, Any] = field(default_factory=dict)  # type: ignore[misc]

    def at(self, values: ArrayLike | Mapping[str, float]) -> ParametricMechanism:
        """The mechanism at other values of the parameters, see `Parameters.at`.

        Raises:
            TopologyError: If it has other joints, forces, point masses or bodies there.
            ValueError: As `Parameters.at`, and if there is no mechanism with these values.
        """
        parameters = self.parameters.at(values)
        return self if parameters is self.parameters else self._of(parameters)

    def _of(self, parameters: Parameters) -> ParametricMechanism:
        """The mechanism at other values; a TopologyError if its joints, forces or bodies differ."""
        mechanism = parameters.mechanism(self.build)
        for kind, expected, returned in (
            ("joints", self.joint_names, mechanism.joint_names),
            ("forces", self.force_names, mechanism.force_names),
            ("number of point masses", len(self.point_masses), len(mechanism.point_masses)),
            ("bodies", sorted(self.placements), sorted(mechanism.placements)),
            ("bodies", sorted(self.own_bodies), sorted(mechanism.own_bodies)),
            ("kind of start", type(self.start).__name__, type(mechanism.start).__name__),
        ):
            if expected != returned:
                numbers = ", ".join(f"{n} = {v:.6g}" for n, v in parameters.values.items())
                raise TopologyError(
                    f"parameters: the {kind} of a mechanism must not change with its parameters, "
                    f"but changed from {expected} to {returned} with {numbers}; return the same "
                    "for all values"
                )
        return mechanism

    def shifted(self, shift: Array) -> ParametricMechanism:
        """The mechanism at values that are shifted a little.

        The last numbers of a ``shift`` may be left out. The twin does not change, so that the same
        equalities hold by chance.
        """
        parameters = copy(self.parameters)
        parameters.entries = dict(parameters.entries)
        for (name, entry), step in zip(self.parameters.entries.items(), shift, strict=False):
            if step:
                parameters.entries[name] = entry._replace(value=entry.value + float(step))
        mechanism = self._of(parameters)
        mechanism.__dict__["twin"] = self.twin
        return mechanism

    @cached_property
    def twin(self) -> ParametricMechanism:  # type: ignore[override]
        """The mechanism at values close by, at which no two numbers are equal by chance."""
        steps = [
            _TWIN_SHIFT
            * (0.5 + 0.5 * ((k + 1) * 0.6180339887 % 1.0))
            * (high if high >= low else -low)
            for k, (_, low, high) in enumerate(self.parameters.ranges)
        ]
        return self.at(self.parameters.array + np.array(steps))
