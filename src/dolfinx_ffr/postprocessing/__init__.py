# SPDX-License-Identifier: MIT
"""Stresses of a body in motion; what a scene models and leaves out."""

from __future__ import annotations

from .model_report import (
    BodyReport,
    ModelReport,
    ModeSelection,
    model_report,
    modes_below,
    select_modes,
)
from .stress import StressEnvelope, StressModes, von_mises, worst_stress

__all__ = [
    "BodyReport",
    "ModeSelection",
    "ModelReport",
    "StressEnvelope",
    "StressModes",
    "model_report",
    "modes_below",
    "select_modes",
    "von_mises",
    "worst_stress",
]
