# SPDX-License-Identifier: MIT
"""The design loop: explicit steps of a level set, the method of moving asymptotes."""

from __future__ import annotations

from .level_set_evolution import LevelSetEvolution
from .loop import DesignLoop, Optimizer
from .mma import MMA
from .optimize import optimize
from .result import DesignWarning, Result, gray_fraction

__all__ = [
    "MMA",
    "DesignLoop",
    "DesignWarning",
    "LevelSetEvolution",
    "Optimizer",
    "Result",
    "gray_fraction",
    "optimize",
]
