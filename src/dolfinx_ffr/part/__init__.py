# SPDX-License-Identifier: MIT
"""From a finished design to a part that can be made: boundary, files for CAD, verification."""

from __future__ import annotations

from ..documentation import explain_fields
from .ball_widths import OPPOSITE as OPPOSITE
from .ball_widths import Balls as Balls
from .ball_widths import spread as spread
from .ball_widths import tangent_balls as tangent_balls
from .figures import BodyFigures as BodyFigures
from .figures import Figures as Figures
from .part import STRESSED as STRESSED
from .part import TURN as TURN
from .part import LoosePiece as LoosePiece
from .part import Part as Part
from .solid import Cavity as Cavity
from .solid import Solid as Solid
from .tetrahedral_cut import outer_faces as outer_faces
from .verify import Enclosed as Enclosed
from .verify import LoosePieceWarning as LoosePieceWarning
from .verify import PartWarning as PartWarning
from .verify import Verification as Verification
from .verify import verify as verify
from .widths import Width as Width

explain_fields(globals())
