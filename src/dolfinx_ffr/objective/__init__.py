# SPDX-License-Identifier: MIT
"""Objectives: a number from a motion and from the bodies, and its exact derivatives.

Objectives can be weighted and added (``0.3 * a + b``), and bounded by a :class:`Constraint`.
"""

from __future__ import annotations

from .base import (
    Constraint,
    DensityField,
    Derivatives,
    Objective,
    Response,
    Sum,
    check_objective,
)
from .compliance import IntegralCompliance, PeakCompliance
from .joints import JointForce
from .markers import MarkerAcceleration, PathTracking
from .properties import Frequency, Mass, Volume

__all__ = [
    "Constraint",
    "DensityField",
    "Derivatives",
    "Frequency",
    "IntegralCompliance",
    "JointForce",
    "MarkerAcceleration",
    "Mass",
    "Objective",
    "PathTracking",
    "PeakCompliance",
    "Response",
    "Sum",
    "Volume",
    "check_objective",
]
