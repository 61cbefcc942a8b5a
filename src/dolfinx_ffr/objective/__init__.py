# SPDX-License-Identifier: MIT
"""Objectives: a number from a motion and from the bodies, and its exact derivatives.

Objectives can be weighted and added (``0.3 * a + b``), and bounded by a :class:`Constraint`. Those
of several motions become one number by a :class:`Combination`.
"""

from __future__ import annotations

from .base import (
    Constraint,
    DensityField,
    Derivatives,
    Objective,
    Response,
    StressField,
    Sum,
    check_objective,
)
from .combination import Combination, PowerMean, WeightedSum, WorstCase
from .compliance import IntegralCompliance, PeakCompliance
from .joints import JointForce
from .markers import MarkerAcceleration, MarkerVelocity, PathTracking
from .properties import Frequency, Mass, Volume
from .stress import PeakStress, von_mises_root
from .stress_coordinates import stress_coordinates

__all__ = [
    "Combination",
    "Constraint",
    "DensityField",
    "Derivatives",
    "Frequency",
    "IntegralCompliance",
    "JointForce",
    "MarkerAcceleration",
    "MarkerVelocity",
    "Mass",
    "Objective",
    "PathTracking",
    "PeakCompliance",
    "PeakStress",
    "PowerMean",
    "Response",
    "StressField",
    "Sum",
    "Volume",
    "WeightedSum",
    "WorstCase",
    "check_objective",
    "stress_coordinates",
    "von_mises_root",
]
