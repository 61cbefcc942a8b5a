# SPDX-License-Identifier: MIT
"""The whole chain from the densities of the bodies to one number of one or several load cases."""

from __future__ import annotations

from .bodies import DesignedBodies, lengths_of_placements
from .evaluation import Evaluation as Evaluation
from .evaluation import LoadCaseEvaluation as LoadCaseEvaluation
from .problem import Change as Change
from .problem import Problem as Problem
