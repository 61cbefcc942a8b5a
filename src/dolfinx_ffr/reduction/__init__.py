# SPDX-License-Identifier: MIT
"""Craig-Bampton reduction of an elastic body to volume integrals, and its pullback."""

from __future__ import annotations

from .craig_bampton import CraigBampton, ReducedBasis
from .direct_solver import agreed_memory
from .factored_body import FactoredBody
from .flexible_body import FlexibleBody, ReducedBody
from .frame import ChordFrame, TangentFrame
from .geometric_stiffness import MARKERS
from .integrals import RoundOffWarning
from .normal_modes import CLUSTER
from .residual_modes import with_residual_modes
from .static_correction import ShapesBar
from .stress import BodyStress

__all__ = [
    "CLUSTER",
    "MARKERS",
    "BodyStress",
    "ChordFrame",
    "CraigBampton",
    "FactoredBody",
    "FlexibleBody",
    "ReducedBasis",
    "ReducedBody",
    "RoundOffWarning",
    "ShapesBar",
    "TangentFrame",
    "agreed_memory",
    "with_residual_modes",
]
