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
        """The frame's origin in the undeformed ``domain``, shape (dimension,) [m]."""
        ...

    def retained(self, domain: Domain) -> dict[str, NDArray[np.float64]]:
        """The elastic motions, (k, 3) by interface of ``domain``, in space (k, 6).

        Their components are u_x, u_y and the rotation, in space u_x, u_y, u_z and the rotations
        about the axes.
        """
        ...


def _interface(domain: Domain, name: str, frame: str) -> None:
    if validation.name(f"{frame}: interface", name) not in domain.interfaces:
        raise ValueError(
            f"{frame}: the body has no interface {name!r}; it has {sorted(domain.interfaces)}"
        )


@dataclass(frozen=True)
class TangentFrame:
    """Frame fixed to one interface, whose rigid motions are dropped.

    Args:
        interface: Name of the interface.
    """

    interface: str

    def origin(self, domain: Domain) -> NDArray[np.float64]:
        """The center of the interface of ``domain``, shape (dimension,) [m]."""
        _interface(domain, self.interface, "tangent frame")
        return domain.interfaces[self.interface].center

    def retained(self, domain: Domain) -> dict[str, NDArray[np.float64]]:
        """All motions of the other interfaces of ``domain``."""
        _interface(domain, self.interface, "tangent frame")
        whole = np.eye(3 * domain.dimension - 3)
        return {name: whole for name in domain.interfaces if name != self.interface}


@dataclass(frozen=True)
class ChordFrame:
    """Frame with its origin in one interface and its axis through another.

    Dropped are the displacements of the first interface and the second one's displacements
    perpendicular to the chord; in space also the first one's rotation about the chord.

    Args:
        start: Interface in the origin.
        end: Interface on the axis.
    """

    start: str
    end: str

    def origin(self, domain: Domain) -> NDArray[np.float64]:
        """The center of the first interface of ``domain``, shape (dimension,) [m]."""
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
        d = domain.dimension
        rotations = np.eye(3 * d - 3)[d:]
        motions = {name: np.eye(3 * d - 3) for name in domain.interfaces}
        direction = chord / length
        stretch = np.append(direction, np.zeros(len(rotations)))
        motions[self.end] = np.vstack([stretch, rotations])
        # in space two rotations about axes perpendicular to the chord
        across = np.eye(1) if d == 2 else np.linalg.svd(direction[None, :])[2][1:]
        motions[self.start] = across @ rotations
        return motions
