# SPDX-License-Identifier: MIT
"""Frames of reference: which rigid motions of interfaces are those of the whole body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..fem import Domain

__all__ = ["ChordFrame", "Frame", "TangentFrame"]


class Frame(Protocol):
    """Reference conditions: which rigid motions of interfaces the body's frame takes over."""

    def origin(self, domain: Domain) -> NDArray[np.float64]:
        """The frame's origin in the undeformed ``domain``, shape (2,) [m]."""
        ...

    def retained(self, domain: Domain) -> dict[str, NDArray[np.float64]]:
        """The elastic motions (u_x, u_y, rotation), (k, 3) by interface of ``domain``."""
        ...


def _interface(domain: Domain, name: str, frame: str) -> None:
    if validation.name(f"{frame}: interface", name) not in domain.interfaces:
        raise ValueError(
            f"{frame}: the body has no interface {name!r}; it has {sorted(domain.interfaces)}"
        )


@dataclass(frozen=True)
class TangentFrame:
    """Frame fixed to one interface, whose three rigid motions are dropped.

    Args:
        interface: Name of the interface.
    """

    interface: str

    def origin(self, domain: Domain) -> NDArray[np.float64]:
        """The center of the interface of ``domain``, shape (2,) [m]."""
        _interface(domain, self.interface, "tangent frame")
        return domain.interfaces[self.interface].center

    def retained(self, domain: Domain) -> dict[str, NDArray[np.float64]]:
        """All motions of the other interfaces of ``domain``."""
        _interface(domain, self.interface, "tangent frame")
        return {name: np.eye(3) for name in domain.interfaces if name != self.interface}


@dataclass(frozen=True)
class ChordFrame:
    """Frame with its origin in one interface and its axis through another.

    Dropped are both displacements of the first interface and the second one's displacement
    perpendicular to the chord.

    Args:
        start: Interface in the origin.
        end: Interface on the axis.
    """

    start: str
    end: str

    def origin(self, domain: Domain) -> NDArray[np.float64]:
        """The center of the first interface of ``domain``, shape (2,) [m]."""
        _interface(domain, self.start, "chord frame")
        return domain.interfaces[self.start].center

    def retained(self, domain: Domain) -> dict[str, NDArray[np.float64]]:
        """Rotations, the stretch of the chord, and all others of ``domain``."""
        for name in (self.start, self.end):
            _interface(domain, name, "chord frame")
        chord = domain.interfaces[self.end].center - domain.interfaces[self.start].center
        length = float(np.linalg.norm(chord))
        size = float(np.max(np.ptp(domain.bounding_box, axis=0)))
        if self.start == self.end or length <= 1e-9 * size:
            raise ValueError(
                f"chord frame: the interfaces {self.start!r} and {self.end!r} have the same "
                f"center, "
                "which leaves the angle of the frame undetermined; use TangentFrame or two "
                "interfaces apart"
            )
        motions = {name: np.eye(3) for name in domain.interfaces}
        motions[self.start] = np.array([[0.0, 0.0, 1.0]])
        direction = chord / length
        motions[self.end] = np.array([[direction[0], direction[1], 0.0], [0.0, 0.0, 1.0]])
        return motions
