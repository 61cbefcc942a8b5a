# SPDX-License-Identifier: MIT
"""Symbols of joints and forces in pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from .marker import Marker, Pair, Triple


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
