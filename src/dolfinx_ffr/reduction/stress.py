# SPDX-License-Identifier: MIT
"""Stress of a reduced body for unit coordinates, as objectives and pictures see it.

The stress is linear in the displacement, so each shape function has a stress mode, and each field
of the static correction another one.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..parallel import announce, gathered
from .flexible_body import FlexibleBody, ReducedBody

__all__ = ["BodyStress"]

Array = NDArray[np.float64]
Kept = TypeVar("Kept")


class BodyStress:
    """Stress of a body at one design for unit coordinates; each rank holds that of its own cells.

    All is computed when it is first asked for.

    Args:
        body: The body.
        reduced: Its shape functions, from `FlexibleBody.reduce`, at any time: if the body has been
            worked at another design since, its matrices are made again for the static correction.
    """

    def __init__(self, body: FlexibleBody, reduced: ReducedBody) -> None:
        self.body, self.reduced = body, reduced
        self._modes: dict[bool, Array] = {}

    @property
    def n_constraint(self) -> int:
        """Number of constraint modes."""
        return self.reduced.basis.n_constraint

    @property
    def out_of_plane(self) -> float:
        """The stress s_z / (s_x + s_y) [-]."""
        return self.body.material.out_of_plane

    @property
    def points(self) -> Array:
        """Where the stress is given, undeformed, shape (cells, points, dimension) [m]."""
        return self.body.stress_recovery.points

    @property
    def weights(self) -> Array:
        """Area that each point stands for, in space volume, shape (cells, points) [m^2], [m^3]."""
        return self.body.stress_recovery.weights

    def modes(self, correction: bool) -> Array:
        """Stress s_x, s_y, t_xy of the solid, in space all six, for unit coordinates; collective.

        Args:
            correction: Whether the fields of the static correction follow the shape functions.

        Returns:
            Shape (cells, points, 3 or 6, coordinates) [Pa].
        """
        if correction not in self._modes:
            announce(self.body.domain.comm, "the stress of a body")
            self._modes[correction] = self.body.stress_modes(self.reduced, correction=correction)
        return self._modes[correction]

    def sum(self, local: Array) -> Array:
        """The sum over the ranks of an array, bit-identical on every rank; collective."""
        announce(self.body.domain.comm, "a sum over the stresses of a body")
        return self.body.elasticity.sum(np.ascontiguousarray(local))

    def gathered(self, value: Kept) -> list[Kept]:
        """The values of all ranks, alike on every one of them; collective."""
        found: list[Any] = gathered(self.body.domain.comm, "the stresses of a body", value)
        return found
