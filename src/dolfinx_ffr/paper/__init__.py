# SPDX-License-Identifier: MIT
"""The gradient of the paper, element by element and approximate.

It is here to be measured beside the exact adjoint, which is faster and exact, and which
`dolfinx_ffr.optimize` takes where nothing else is given.
"""

from __future__ import annotations

from ..documentation import explain_fields
from .approximate import ApproximateGradient, gradient_errors
from .elementwise import (
    ElementByElement,
    ElementGradient,
    IntegralDerivatives,
    elementwise_gradient,
    integral_derivatives,
)
from .mode_derivatives import ModeDerivative, Solver, mode_derivatives
from .rbf_interpolation import IllConditionedWarning, ScatteredInterpolation, best_length
from .sampling import GradientElements

__all__ = [
    "ApproximateGradient",
    "ElementByElement",
    "ElementGradient",
    "GradientElements",
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

explain_fields(globals())
