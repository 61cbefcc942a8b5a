# SPDX-License-Identifier: MIT
"""Craig-Bampton reduction of an elastic body to volume integrals, and its pullback."""

from __future__ import annotations

from ..documentation import explain_fields
from .craig_bampton import CraigBampton, ReducedBasis, ShapesBar
from .direct_solver import solved
from .factored_body import FactoredBody
from .flexible_body import BodyPullback, FlexibleBody, ReducedBody
from .frame import ChordFrame, TangentFrame
from .geometric_stiffness import MARKERS
from .integrals import RoundOffWarning
from .normal_modes import CLUSTER
from .residual_modes import with_residual_modes
from .stress import BodyStress

__all__ = [
    "CLUSTER",
    "MARKERS",
    "BodyPullback",
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
    "solved",
    "with_residual_modes",
]

explain_fields(globals())
