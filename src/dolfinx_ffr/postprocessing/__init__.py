# SPDX-License-Identifier: MIT
"""Stresses of a body in motion, the error by truncated modes, and a report of the model."""

from __future__ import annotations

from ..documentation import explain_fields
from .local_modes import LocalModes, LocalModesWarning, local_modes
from .mode_truncation import ModeSelection, mode_error, modes_below, propose_modes, select_modes
from .model_report import BodyReport, ModelReport, model_report
from .stress import StressEnvelope, StressModes, von_mises, worst_stress

__all__ = [
    "BodyReport",
    "LocalModes",
    "LocalModesWarning",
    "ModeSelection",
    "ModelReport",
    "StressEnvelope",
    "StressModes",
    "local_modes",
    "mode_error",
    "model_report",
    "modes_below",
    "propose_modes",
    "select_modes",
    "von_mises",
    "worst_stress",
]

explain_fields(globals())
