# SPDX-License-Identifier: MIT
"""The whole chain from the densities of the bodies to one number of one or several motions."""

from __future__ import annotations

from .combination import Combination, PowerMean, WeightedSum, WorstCase
from .evaluation import Evaluation, MotionEvaluation
from .problem import Problem

__all__ = [
    "Combination",
    "Evaluation",
    "MotionEvaluation",
    "PowerMean",
    "Problem",
    "WeightedSum",
    "WorstCase",
]
