# SPDX-License-Identifier: MIT
"""A mechanism made of named numbers by a function of the user's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from .mechanism import Mechanism

Array = NDArray[np.float64]

#: Share of the ranges by which the values differ at which vectors are compared a second time.
_APART = 1e-4


@dataclass(frozen=True)
class ParametricMechanism(Mechanism):
    """A mechanism at given values of its parameters; see :meth:`built`."""

    #: From the parameters, as keywords, to a mechanism, or to it and bodies that depend on them.
    build: Callable[..., Any] = field(default=Mechanism, repr=False)
    #: By name the value, the lower and the upper bound
    parameters: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    label: str = "parameters"  #: Name of the parameters among designs
    #: Integrals of bodies that depend on the parameters, by name
    own_bodies: Mapping[str, Any] = field(default_factory=dict)  # type: ignore[misc]

    @classmethod
    def built(
        cls,
        build: Callable[..., Any],
        parameters: Mapping[str, tuple[float, float, float]],
        label: str = "parameters",
    ) -> ParametricMechanism:
        """The mechanism that the function makes of the values.

        Raises:
            TypeError: If it returns no mechanism.
            ValueError: If a value is not between its bounds, or these are not apart, or there is
                no mechanism with these values; the message says them.
        """
        for name, (value, low, high) in parameters.items():
            validation.number(f"upper bound of parameter {name!r}", high, above=low)
            validation.number(f"parameter {name!r}", value, least=low, most=high)
        values = {name: value for name, (value, _, _) in parameters.items()}
        try:
            given = build(**values)
        except (ValueError, ArithmeticError) as error:
            said = ", ".join(f"{name} = {value:.6g}" for name, value in values.items())
            raise ValueError(f"parameters: no mechanism with {said}: {error}") from error
        mechanism, bodies = given if isinstance(given, tuple) else (given, {})
        what = "parameters: what the function returns"
        needed = "a Mechanism, or a Mechanism and a mapping of VolumeIntegrals"
        validation.instance(what, mechanism, Mechanism, needed)
        validation.instance(what, bodies, Mapping, needed)
        own = {part.name: getattr(mechanism, part.name) for part in fields(Mechanism)}
        return cls(**own, build=build, parameters=parameters, label=label, own_bodies=bodies)

    @property
    def names(self) -> list[str]:
        """Names of the parameters, in their order."""
        return list(self.parameters)

    @property
    def values(self) -> dict[str, float]:
        """Values of the parameters by name."""
        return {name: value for name, (value, _, _) in self.parameters.items()}

    def at(self, values: ArrayLike | Mapping[str, float]) -> ParametricMechanism:
        """The mechanism at other values: by name, those missing stay; or all, shape (size,).

        Raises:
            ValueError: If a name is not known, a number is not finite or out of its bounds, or
                there is no mechanism with these values.
        """
        if isinstance(values, Mapping):
            for name in values:
                validation.choice("parameters: name", name, self.names)
            given = {**self.values, **values}
        else:
            vector = validation.real_array("parameters", values, (len(self.names),))
            given = dict(zip(self.names, vector.tolist(), strict=True))
        if given == self.values:
            return self
        found = {}
        for name, (_, low, high) in self.parameters.items():
            value = validation.number(f"parameter {name!r}", given[name], least=low, most=high)
            found[name] = (value, low, high)
        return self.built(self.build, found, self.label)

    def shifted(self, shift: Array) -> ParametricMechanism:
        """The mechanism at values shifted by numbers, of which the last may be left out."""
        values = np.array(list(self.values.values()))
        values[: len(shift)] += shift
        return self.at(values)

    @property
    def ranges(self) -> list[tuple[str, float, float]]:
        """Of each parameter the name and the distances to its bounds."""
        return [(n, value - low, high - value) for n, (value, low, high) in self.parameters.items()]

    @cached_property
    def twin(self) -> ParametricMechanism:  # type: ignore[override]
        """The same at values close by, at which nothing is alike by chance."""
        steps = [
            _APART * (0.5 + 0.5 * ((k + 1) * 0.6180339887 % 1.0)) * (high if high >= low else -low)
            for k, (_, low, high) in enumerate(self.ranges)
        ]
        return self.shifted(np.array(steps))
