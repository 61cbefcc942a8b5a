# SPDX-License-Identifier: MIT
"""The design loop: explicit steps of a level set, the method of moving asymptotes."""

from __future__ import annotations

from ..documentation import explain_fields
from .boundary_steps import move_boundary
from .gradient import (
    Distance,
    ExactAdjoint,
    GradientErrors,
    GradientMethod,
    GradientReport,
    of_all_elements,
)
from .level_set_evolution import LevelSetEvolution
from .loop import DesignLoop, Optimizer
from .mma import MMA
from .optimize import optimize
from .result import BoundaryResult, DesignWarning, Result, gray_fraction

__all__ = [
    "MMA",
    "BoundaryResult",
    "DesignLoop",
    "DesignWarning",
    "Distance",
    "ExactAdjoint",
    "GradientErrors",
    "GradientMethod",
    "GradientReport",
    "LevelSetEvolution",
    "Optimizer",
    "Result",
    "gray_fraction",
    "move_boundary",
    "of_all_elements",
    "optimize",
]

explain_fields(globals())
