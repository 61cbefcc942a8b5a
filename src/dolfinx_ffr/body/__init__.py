# SPDX-License-Identifier: MIT
"""A body as the mechanism sees it: mass, volume integrals and markers, from arrays or files."""

from __future__ import annotations

from ..documentation import explain_fields
from .marker import LOADS, BodyMarker
from .moments import axial, cross_matrix, theta
from .parametric import ParametricBody
from .volume_integrals import QUARTER_TURN, VolumeIntegrals

__all__ = [
    "LOADS",
    "QUARTER_TURN",
    "BodyMarker",
    "ParametricBody",
    "VolumeIntegrals",
    "axial",
    "cross_matrix",
    "theta",
]

explain_fields(globals())
