# SPDX-License-Identifier: MIT
"""Planar kinematics: equations of motion of planar mechanisms, their Jacobians and transposes.

What other folders use of it stands here; kinematics in space offer the same.
"""

from __future__ import annotations

from .arrays import ModelArrays
from .coordinates import Coordinates
from .integral_gradients import integral_bars, marker_bar, metric_bars
from .kinematics import KIND
from .metric import coordinates_of, length_of, settled, settled_pullback, sizes_by_mass, ways

__all__ = [
    "KIND",
    "Coordinates",
    "ModelArrays",
    "coordinates_of",
    "integral_bars",
    "length_of",
    "marker_bar",
    "metric_bars",
    "settled",
    "settled_pullback",
    "sizes_by_mass",
    "ways",
]
