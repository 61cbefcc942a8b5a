# SPDX-License-Identifier: MIT
"""The boundary of a part as its design: curves that move, what they must keep, the best step."""

from __future__ import annotations

from ..documentation import explain_fields
from .derivative import NodeMotion
from .outline import Boundary
from .sizes import Rows, radius_rows, room_rows, size_rows
from .step import best_step
from .surface import Surface, SurfaceMotion
from .walls import no_rows, wall_rows

__all__ = [
    "Boundary",
    "NodeMotion",
    "Rows",
    "Surface",
    "SurfaceMotion",
    "best_step",
    "no_rows",
    "radius_rows",
    "room_rows",
    "size_rows",
    "wall_rows",
]

explain_fields(globals())
