# SPDX-License-Identifier: MIT
"""A body as the mechanism sees it: mass, volume integrals and markers, from arrays or files."""

from __future__ import annotations

from ..documentation import explain_fields
from .marker import LOADS as LOADS
from .marker import BodyMarker as BodyMarker
from .moments import axial as axial
from .moments import cross_matrix as cross_matrix
from .moments import theta as theta
from .parametric import ParametricBody as ParametricBody
from .volume_integrals import QUARTER_TURN as QUARTER_TURN
from .volume_integrals import VolumeIntegrals as VolumeIntegrals

explain_fields(globals())
