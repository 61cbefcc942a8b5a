# SPDX-License-Identifier: MIT
"""A body as the mechanism sees it: mass, volume integrals and markers, from arrays or files."""

from __future__ import annotations

from .marker import BodyMarker
from .moments import axial, cross_matrix, theta
from .parametric import ParametricBody
from .volume_integrals import QUARTER_TURN, VolumeIntegrals

__all__ = [
    "QUARTER_TURN",
    "BodyMarker",
    "ParametricBody",
    "VolumeIntegrals",
    "axial",
    "cross_matrix",
    "theta",
]
