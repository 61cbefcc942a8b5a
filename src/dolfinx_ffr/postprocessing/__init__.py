# SPDX-License-Identifier: MIT
"""Stresses of a body in motion, the error by truncated modes, and a report of the model."""

from __future__ import annotations

from .mode_truncation import LocalModes as LocalModes
from .mode_truncation import LocalModesWarning as LocalModesWarning
from .mode_truncation import ModeSelection as ModeSelection
from .mode_truncation import local_modes as local_modes
from .mode_truncation import mode_error as mode_error
from .mode_truncation import propose_modes as propose_modes
from .mode_truncation import select_modes as select_modes
from .model_report import BodyReport as BodyReport
from .model_report import ModelReport as ModelReport
from .model_report import model_report as model_report
from .stress import StressEnvelope as StressEnvelope
from .stress import StressModes as StressModes
from .stress import von_mises as von_mises
from .stress import worst_stress as worst_stress
