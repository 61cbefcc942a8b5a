# SPDX-License-Identifier: MIT
"""The boundary of a part as its design: curves that move, what they must keep, the best step."""

from __future__ import annotations

from ..documentation import explain_fields
from .kinds import Costs, InSpace, InThePlane, Kind
from .outline import Boundary
from .sizes import Rows
from .step import best_step
from .surface import Surface

__all__ = [
    "Boundary",
    "Costs",
    "InSpace",
    "InThePlane",
    "Kind",
    "Rows",
    "Surface",
    "best_step",
]

explain_fields(globals())
