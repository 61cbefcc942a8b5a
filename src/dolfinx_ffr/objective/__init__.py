# SPDX-License-Identifier: MIT
"""Objectives: numbers of a trajectory and of the bodies, and their exact derivatives.

Objectives can be weighted and added (``0.3 * a + b``), and bounded by a :class:`Constraint`. Those
of several motions become one number by a :class:`Combination`.
"""

from __future__ import annotations

from ..documentation import explain_fields
from .base import (
    Constraint,
    DensityField,
    Derivatives,
    Inventory,
    Objective,
    Response,
    StressField,
    Sum,
    check_objective,
    derivatives_of,
    value_of,
)
from .combination import Combination, PowerMean, WeightedSum, WorstCase
from .compliance import IntegralCompliance, PeakCompliance
from .drives import DrivePower, DriveWork
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
    "DrivePower",
    "DriveWork",
    "Frequency",
    "IntegralCompliance",
    "Inventory",
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
    "derivatives_of",
    "stress_coordinates",
    "value_of",
    "von_mises_root",
]

explain_fields(globals())
