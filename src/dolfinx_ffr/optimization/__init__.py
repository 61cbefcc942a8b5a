# SPDX-License-Identifier: MIT
"""The design loop: explicit steps of a level set, the method of moving asymptotes."""

from __future__ import annotations

from .arguments import default_steps
from .boundary_phase import move_boundary as move_boundary
from .level_set_evolution import LevelSetEvolution as LevelSetEvolution
from .loop import DesignLoop as DesignLoop
from .loop import Distance as Distance
from .loop import ExactAdjoint as ExactAdjoint
from .loop import GradientErrors as GradientErrors
from .loop import GradientMethod as GradientMethod
from .loop import GradientReport as GradientReport
from .loop import Iterate as Iterate
from .loop import Optimizer as Optimizer
from .mma import MMA as MMA
from .optimize import check_run
from .optimize import optimize as optimize
from .result import BoundaryResult as BoundaryResult
from .result import DesignWarning as DesignWarning
from .result import Result as Result
from .result import gray_fraction as gray_fraction
