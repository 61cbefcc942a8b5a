# SPDX-License-Identifier: MIT
"""A body as the mechanism sees it: mass, volume integrals and markers, from arrays or files."""

from __future__ import annotations

from ..tensors import axial as axial
from ..tensors import cross_matrix as cross_matrix
from ..tensors import theta as theta
from .marker import LOADS
from .marker import BodyMarker as BodyMarker
from .parametric import ParametricBody as ParametricBody
from .volume_integrals import QUARTER_TURN
from .volume_integrals import VolumeIntegrals as VolumeIntegrals
