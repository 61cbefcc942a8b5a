# SPDX-License-Identifier: MIT
"""The boundary of a part as the zero of a spline field: its curves, sizes, steps and topology."""

from __future__ import annotations

from .field import BoundaryField as BoundaryField
from .field import FieldSpace as FieldSpace
from .fitted import FittedNodes as FittedNodes
from .moving import MovingBoundary as MovingBoundary
from .moving import split_by_boundary as split_by_boundary
from .options import FieldOptions as FieldOptions
from .plane import PlaneBoundary as PlaneBoundary
from .plane import first_field as first_field
from .projection import JoinedMotions as JoinedMotions
from .projection import Projection as Projection
from .projection import Secants as Secants
from .projection import SmoothMotion as SmoothMotion
from .projection import Step as Step
from .sizes import SizeRows as SizeRows
from .smoothing import free_variables as free_variables
from .smoothing import is_uneven as is_uneven
from .smoothing import mended as mended
from .smoothing import metric as metric
from .smoothing import redistanced as redistanced
from .spline_grid import SplineGrid as SplineGrid
