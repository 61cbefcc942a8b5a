# SPDX-License-Identifier: MIT
"""Frames of reference: which rigid motions of interfaces count as motions of the whole body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .. import validation
from ..fem import Array, Domain, ShapeError


class Frame(Protocol):
    """Reference conditions: which rigid motions of interfaces the body's frame takes over."""

    def origin(self, domain: Domain) -> Array:
        """The frame's origin in the undeformed ``domain``, shape (dimension,) [m]."""
        ...

    def retained(self, domain: Domain) -> dict[str, Array]:
        """The k elastic motions of each interface of ``domain``, by its name.

        Shape (k, 3): u_x, u_y and the rotation; in space (k, 6): u_x, u_y, u_z and the rotations
        about the axes.
        """
        ...


def _center(domain: Domain, name: str, frame: str) -> Array:
    if validation.name(f"{frame}: interface", name) not in domain.interfaces:
        raise ValueError(
            f"{frame}: the body has no interface {name!r}; it has {sorted(domain.interfaces)}"
        )
    return domain.interfaces[name].center


@dataclass(frozen=True)
class TangentFrame(Frame):
    """Frame fixed to one interface, whose rigid motions are dropped.

    Attributes:
        interface: Name of the interface.
    """

    interface: str

    def origin(self, domain: Domain) -> Array:
        return _center(domain, self.interface, "tangent frame")

    def retained(self, domain: Domain) -> dict[str, Array]:
        _center(domain, self.interface, "tangent frame")
        all_motions = np.eye(3 * domain.dimension - 3)
        return {name: all_motions for name in domain.interfaces if name != self.interface}


@dataclass(frozen=True)
class ChordFrame(Frame):
    """Frame with its origin in one interface and its axis through another.

    It drops the displacements of the first interface and the second one's displacements
    perpendicular to the chord; in space also the first one's rotation about the chord.

    Attributes:
        start: Interface in the origin.
        end: Interface on the axis.
    """

    start: str
    end: str

    def origin(self, domain: Domain) -> Array:
        return _center(domain, self.start, "chord frame")

    def retained(self, domain: Domain) -> dict[str, Array]:
        start, end = (_center(domain, name, "chord frame") for name in (self.start, self.end))
        chord = end - start
        length = float(np.linalg.norm(chord))
        size = float(np.max(np.ptp(domain.bounding_box, axis=0)))
        if self.start == self.end or length <= 1e-9 * size:
            raise ShapeError(
                f"chord frame: the interfaces {self.start!r} and {self.end!r} have the same "
                "center, which leaves the angle of the frame undetermined; use TangentFrame or two "
                "interfaces apart"
            )
        d = domain.dimension
        rotations = np.eye(3 * d - 3)[d:]
        motions = {name: np.eye(3 * d - 3) for name in domain.interfaces}
        direction = chord / length
        motions[self.end] = np.vstack([np.append(direction, np.zeros(len(rotations))), rotations])
        # in space two rotations about axes perpendicular to the chord
        across = np.eye(1) if d == 2 else np.linalg.svd(direction[None, :])[2][1:]
        motions[self.start] = across @ rotations
        return motions
