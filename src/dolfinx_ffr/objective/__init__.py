# SPDX-License-Identifier: MIT
"""Objectives: a number from a motion and from the bodies, and its exact derivatives.

Objectives can be weighted and added (``0.3 * a + b``), and bounded by a :class:`Constraint`.
"""

from __future__ import annotations

from .base import Constraint, Objective, Sum
from .compliance import IntegralCompliance, PeakCompliance
from .joints import JointForce
from .markers import MarkerAcceleration, PathTracking
from .properties import Frequency, Mass, Volume

__all__ = [
    "Constraint",
    "Frequency",
    "IntegralCompliance",
    "JointForce",
    "MarkerAcceleration",
    "Mass",
    "Objective",
    "PathTracking",
    "PeakCompliance",
    "Sum",
    "Volume",
]
