# SPDX-License-Identifier: MIT
"""The parameters of a mechanism as design variables."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..fem import Array
from ..mechanism import Parameters
from .parametrization import Variables, finite_vector


class ParameterDesign(Variables):
    """Parameters of a mechanism; the variables are shares of their ranges, on their scales.

    So all of them are of one size, and steps are shares of the ranges.
    """

    each: ClassVar[str] = "parameter"

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.size = len(parameters.names)

    def even(self, value: float | None = None) -> Array:
        """The values of the start, shape (size,); or all at a share ``value`` of their range."""
        if value is None:
            return self.parameters.array
        return self.parameters.from_shares(super().even(value))[0]

    def begin(self, start: ArrayLike) -> Array:
        """The variables at values ``start`` of the parameters, shape (size,)."""
        values = finite_vector(start, self.size, "design", "values, one a parameter")
        return self.parameters.shares(self.parameters.at(values).array)

    def point(self, variables: Array) -> Array:
        return self.parameters.from_shares(variables)[0]

    def pullback(self, variables: Array, x_bar: Array) -> Array:
        bar = validation.real_array("design: the derivative by parameters", x_bar, (self.size,))
        return bar * self.parameters.from_shares(variables)[1]

    def identity(self) -> dict[str, Any]:
        scales = [entry.scale for entry in self.parameters.entries.values()]
        names = f"{self.parameters.names} {scales}"
        return {"parameters": names, "bounds": np.ravel(self.parameters.bounds)}
