# SPDX-License-Identifier: MIT
"""The whole chain from the densities of the bodies to one number of one or several load cases."""

from __future__ import annotations

from ..documentation import explain_fields
from .evaluation import Evaluation, LoadCaseEvaluation
from .problem import Problem

__all__ = ["Evaluation", "LoadCaseEvaluation", "Problem"]

explain_fields(globals())
