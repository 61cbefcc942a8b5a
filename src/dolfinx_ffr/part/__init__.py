# SPDX-License-Identifier: MIT
"""From a finished design to a part that can be made: boundary, files for CAD, verification."""

from __future__ import annotations

from .part import Part
from .shape import LoosePiece, PartWarning, Shape
from .solid import Solid
from .verify import BodyFigures, Figures, Verification, verify
from .widths import Width

__all__ = [
    "BodyFigures",
    "Figures",
    "LoosePiece",
    "Part",
    "PartWarning",
    "Shape",
    "Solid",
    "Verification",
    "Width",
    "verify",
]
