# SPDX-License-Identifier: MIT
"""Planar kinematics: equations of motion of planar mechanisms, their Jacobians and transposes.

What other folders use of it stands here; another kind of kinematics would offer the same.
"""

from __future__ import annotations

from .arrays import ModelArrays
from .coordinates import Coordinates
from .integral_gradients import Samples, integral_bars, marker_bar, metric_bars
from .kinematics import (
    COMPILED,
    Evaluation,
    Kinematics,
    applied_forces,
    equations_pullback,
    evaluate_equations,
    place_markers,
)
from .metric import coordinates_of, least_sizes, length_of, sizes_by_mass

__all__ = [
    "COMPILED",
    "Coordinates",
    "Evaluation",
    "Kinematics",
    "ModelArrays",
    "Samples",
    "applied_forces",
    "coordinates_of",
    "equations_pullback",
    "evaluate_equations",
    "integral_bars",
    "least_sizes",
    "length_of",
    "marker_bar",
    "metric_bars",
    "place_markers",
    "sizes_by_mass",
]
