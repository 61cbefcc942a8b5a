# SPDX-License-Identifier: MIT
"""The boundary of a part as its design: curves that move, what they must keep, the best step."""

from __future__ import annotations

from ..documentation import explain_fields
from .derivative import NodeMotion
from .outline import Boundary
from .sizes import Rows, radius_rows, room_rows, size_rows
from .step import best_step

__all__ = [
    "Boundary",
    "NodeMotion",
    "Rows",
    "best_step",
    "radius_rows",
    "room_rows",
    "size_rows",
]

explain_fields(globals())
