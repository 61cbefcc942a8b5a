# SPDX-License-Identifier: MIT
"""Gradients by other routes than the exact adjoint: element by element, approximate."""

from __future__ import annotations

from .approximate import ApproximateGradient
from .elementwise import (
    ElementGradient,
    IntegralDerivatives,
    elementwise_gradient,
    integral_derivatives,
)
from .method import (
    Distance,
    ElementByElement,
    ExactAdjoint,
    GradientErrors,
    GradientMethod,
    GradientReport,
    gradient_errors,
)
from .mode_derivatives import ModeDerivative, Solver, mode_derivatives
from .rbf_interpolation import IllConditionedWarning, ScatteredInterpolation, best_length
from .sampling import GradientElements

__all__ = [
    "ApproximateGradient",
    "Distance",
    "ElementByElement",
    "ElementGradient",
    "ExactAdjoint",
    "GradientElements",
    "GradientErrors",
    "GradientMethod",
    "GradientReport",
    "IllConditionedWarning",
    "IntegralDerivatives",
    "ModeDerivative",
    "ScatteredInterpolation",
    "Solver",
    "best_length",
    "elementwise_gradient",
    "gradient_errors",
    "integral_derivatives",
    "mode_derivatives",
]
