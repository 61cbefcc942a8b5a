# SPDX-License-Identifier: MIT
"""Coordinates of one body in space by name."""

from __future__ import annotations

from dataclasses import dataclass

from .arrays import RIGID, ROTATION


@dataclass(frozen=True)
class Coordinates:
    """Where the coordinates of a body stand among all coordinates, and velocities likewise."""

    #: Place of the first one.
    first: int
    #: Number of elastic coordinates.
    modes: int

    @property
    def position(self) -> slice:
        """Place of the position of the body's frame, three coordinates [m]."""
        return slice(self.first, self.first + ROTATION)

    @property
    def rotation(self) -> slice:
        """Place of the rotation vector of the body's frame [rad], and of its angular velocity."""
        return slice(self.first + ROTATION, self.first + RIGID)

    @property
    def rigid(self) -> slice:
        """Place of position and rotation vector, six coordinates."""
        return slice(self.first, self.first + RIGID)

    @property
    def elastic(self) -> slice:
        """Place of the elastic coordinates."""
        return slice(self.first + RIGID, self.first + RIGID + self.modes)

    @property
    def all(self) -> slice:
        """Place of all coordinates of the body."""
        return slice(self.first, self.first + RIGID + self.modes)
