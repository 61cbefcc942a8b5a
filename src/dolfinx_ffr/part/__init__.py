# SPDX-License-Identifier: MIT
"""From a finished design to a part that can be made: boundary, files for CAD, verification."""

from __future__ import annotations

from .asked_sizes import PartViolation as PartViolation
from .asked_sizes import size_violations as size_violations
from .asked_sizes import solid_regions as solid_regions
from .ball_widths import OPPOSITE, Balls, spread, tangent_balls
from .enclosed import Enclosed as Enclosed
from .enclosed import LoosePieceWarning as LoosePieceWarning
from .enclosed import PartWarning as PartWarning
from .figures import BodyFigures as BodyFigures
from .figures import Figures as Figures
from .free_ends import free_ends as free_ends
from .options import STRESSED, TURN
from .outline_limit import outline_violations as outline_violations
from .part import LoosePiece as LoosePiece
from .part import Part as Part
from .solid import Cavity
from .solid import Solid as Solid
from .tetrahedral_cut import outer_faces
from .verify import Verification as Verification
from .verify import verify as verify
from .widths import Width as Width
