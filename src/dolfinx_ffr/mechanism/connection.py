# SPDX-License-Identifier: MIT
"""Base class of joints and forces: the markers that they connect, a name, checks, and symbols."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar, Literal

from .. import validation
from .marker import BodyPoint, Marker, Pair, Triple, check_marker, marker_name


@dataclass(frozen=True)
class Symbol:
    """A part of a picture, at two markers, or at one."""

    #: Sign at the first of its markers that is on a body, if there is one.
    sign: ClassVar[Literal["", "pin", "square"]] = ""

    markers: tuple[Marker, ...]  #: The markers at which it is drawn.


@dataclass(frozen=True)
class Pin(Symbol):
    """A pin, with a support under each marker on the ground."""

    sign = "pin"


@dataclass(frozen=True)
class Square(Symbol):
    """A square, with a support under each marker on the ground."""

    sign = "square"


@dataclass(frozen=True)
class Slider(Symbol):
    """A block with a pin at the first marker, on a guide through the second."""

    sign = "pin"

    #: Direction of the guide in the axes of the second marker, of any length.
    direction: Pair | Triple = (1.0, 0.0)


@dataclass(frozen=True)
class Line(Symbol):
    """A straight line between two markers."""


@dataclass(frozen=True)
class Spring(Symbol):
    """A wavy line between two markers."""


@dataclass(frozen=True)
class Connection:
    """A joint or a force; a TypeError refuses a field that is declared as a marker and is none."""

    kind: ClassVar[str]  #: "joint" or "force", for messages.

    def __post_init__(self) -> None:
        user = f"{self.kind} {type(self).__name__}"
        for marker in self.markers:
            check_marker(user, marker)
        validation.name(f"{user}: name", getattr(self, "name", ""))

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The markers that it connects, or on which it acts: its fields declared as markers."""
        kinds = (Marker, BodyPoint, "Marker", "BodyPoint")
        return tuple(getattr(self, f.name) for f in fields(self) if f.type in kinds)

    #: Kinds of symbols at its markers. Default: a pin for joints, nothing for forces.
    drawn: ClassVar[tuple[type[Symbol], ...]] = ()

    @property
    def symbols(self) -> tuple[Symbol, ...]:
        """Symbols to draw."""
        return tuple(kind(self.markers) for kind in self.drawn)

    #: Whether it is one in the plane only, or in space only; None where it is both.
    dimension: ClassVar[int | None] = None
    in_the_plane: ClassVar[str] = ""  #: What to use instead in the plane.

    @property
    def label(self) -> str:
        """Name given by the user, or one made from the kind and the markers."""
        name: str = getattr(self, "name", "")
        between = ", ".join(marker_name(marker) for marker in self.markers)
        return name or f"{type(self).__name__}({between})"

    def validate(self, label: str) -> None:
        """Refuse wrong kinds (TypeError) and numbers (ValueError), by the name ``label``."""
        user = f"{self.kind} {label!r}"
        if not any(isinstance(marker, tuple) for marker in self.markers):
            raise ValueError(
                f"{user} has no marker on a body; attach at least one of its markers to a body"
            )
        self._check(user)

    def _check(self, what: str) -> None:
        """Refuse wrong arguments of a joint or force; ``what`` is its name in errors."""
