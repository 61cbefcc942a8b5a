# SPDX-License-Identifier: MIT
"""From a finished design to a part that can be made: boundary, files for CAD, verification."""

from __future__ import annotations

from ..documentation import explain_fields
from .part import LoosePiece, Part
from .solid import Cavity, Solid
from .verify import BodyFigures, Enclosed, Figures, PartWarning, Verification, verify
from .widths import Width

__all__ = [
    "BodyFigures",
    "Cavity",
    "Enclosed",
    "Figures",
    "LoosePiece",
    "Part",
    "PartWarning",
    "Solid",
    "Verification",
    "Width",
    "verify",
]

explain_fields(globals())
