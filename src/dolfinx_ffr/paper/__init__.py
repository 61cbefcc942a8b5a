# SPDX-License-Identifier: MIT
"""The gradient of the paper, element by element and approximate.

It is here to be measured beside the exact adjoint, which is faster and exact, and which
`dolfinx_ffr.optimize` takes where nothing else is given.
"""

from __future__ import annotations

from .approximate import ApproximateGradient as ApproximateGradient
from .approximate import GradientElements as GradientElements
from .approximate import gradient_errors as gradient_errors
from .elementwise import ElementGradient as ElementGradient
from .elementwise import IntegralDerivatives as IntegralDerivatives
from .elementwise import elementwise_gradient as elementwise_gradient
from .elementwise import integral_derivatives as integral_derivatives
from .mode_derivatives import ModeDerivative as ModeDerivative
from .mode_derivatives import Solver as Solver
from .mode_derivatives import mode_derivatives as mode_derivatives
from .rbf_interpolation import IllConditionedWarning as IllConditionedWarning
from .rbf_interpolation import ScatteredInterpolation as ScatteredInterpolation
from .rbf_interpolation import best_length as best_length
