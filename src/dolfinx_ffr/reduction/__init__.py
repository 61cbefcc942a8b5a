# SPDX-License-Identifier: MIT
"""Craig-Bampton reduction of an elastic body to volume integrals, and its pullback."""

from __future__ import annotations

from .assembled_body import reduce_matrices as reduce_matrices
from .craig_bampton import CraigBampton as CraigBampton
from .craig_bampton import ReducedBasis as ReducedBasis
from .craig_bampton import ShapesBar as ShapesBar
from .direct_solver import solved as solved
from .factored_body import FactoredBody as FactoredBody
from .flexible_body import BodyPullback as BodyPullback
from .flexible_body import FlexibleBody as FlexibleBody
from .flexible_body import ReducedBody as ReducedBody
from .frame import ChordFrame as ChordFrame
from .frame import TangentFrame as TangentFrame
from .geometric_stiffness import MARKERS as MARKERS
from .integrals import RoundOffWarning as RoundOffWarning
from .normal_modes import CLUSTER as CLUSTER
from .residual_modes import with_residual_modes as with_residual_modes
from .stress import BodyStress as BodyStress
from .struts import Struts as Struts
