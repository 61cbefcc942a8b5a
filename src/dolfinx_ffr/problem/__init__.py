# SPDX-License-Identifier: MIT
"""The whole chain from the densities of the bodies to one number of one or several motions."""

from __future__ import annotations

from .evaluation import Evaluation, MotionEvaluation
from .problem import Problem

__all__ = ["Evaluation", "MotionEvaluation", "Problem"]
