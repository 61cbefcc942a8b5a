# SPDX-License-Identifier: MIT
"""The boundary of a part as its design: curves that move, their constraints, the best step."""

from __future__ import annotations

from .geometry import BoundaryGeometry as BoundaryGeometry
from .geometry import PlaneGeometry as PlaneGeometry
from .geometry import SpatialGeometry as SpatialGeometry
from .geometry import StrutShares as StrutShares
from .options import PLANE_STEPS as PLANE_STEPS
from .options import StepOptions as StepOptions
from .outline import Boundary as Boundary
from .sizes import Rows as Rows
from .slide import slides as slides
from .step import best_step as best_step
from .step import curvature as curvature
from .step import secants as secants
from .surface import Surface as Surface
