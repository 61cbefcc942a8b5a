# SPDX-License-Identifier: MIT
"""Forces as elements between two markers, of the kinds that the compiled kernels know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from .marker import Marker, Pair
from .motion import Signal, sample

__all__ = ["Element", "ElementKind"]

Array = NDArray[np.float64]


class ElementKind(IntEnum):
    """The law of a force; its table over time has up to three columns."""

    #: Force x, y and moment in the global axes.
    GLOBAL = 0
    #: Force x, y in the axes of the first marker.
    FOLLOWER = 1
    #: Spring and damper along the line between the markers, by its length without force.
    SPRING = 2
    #: Spring and damper against the difference of the positions.
    PLANE_SPRING = 3
    #: Spring and damper against the difference of the angles, by that without moment.
    TORSION = 4


@dataclass(frozen=True)
class Element:
    """One force between two markers, which may be the same."""

    #: Its law.
    kind: ElementKind
    #: First marker.
    a: Marker
    #: Second marker.
    b: Marker
    #: Columns of its table over time, by name.
    table: Mapping[str, Signal]
    #: Stiffness and damping.
    constants: Pair = (0.0, 0.0)

    @property
    def signals(self) -> tuple[Signal, ...]:
        """What is given over time."""
        return tuple(self.table.values())

    def tabulate(self, instants: Array, label: str) -> Array:
        """Table over time, shape (instants, 3).

        Args:
            instants: Times, shape (instants,) [s].
            label: Name of the force, for messages.

        Raises:
            ValueError: If an entry is NaN or infinite, or a length negative.
        """
        table = np.zeros((instants.size, 3))
        for column, (name, signal) in enumerate(self.table.items()):
            table[:, column] = sample(signal, instants, f"force {label!r}: {name}")
        if self.kind == ElementKind.SPRING and np.min(table[:, 0]) < 0.0:
            raise ValueError(
                f"force {label!r}: the length must not be negative, but it is "
                f"{table[:, 0].min():g} m"
            )
        return table
