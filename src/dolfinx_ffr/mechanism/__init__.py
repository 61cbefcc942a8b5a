# SPDX-License-Identifier: MIT
"""Description of a mechanism: markers, motions, joints, forces and how the motion begins."""

from __future__ import annotations

from . import forces, joints, spatial_joints
from .elements import Element, ElementKind
from .forces import *  # noqa: F403
from .initial_conditions import Assembled, Placement, Start, StaticEquilibrium
from .joints import *  # noqa: F403
from .marker import BodyPoint, Ground, Marker, Moving, Pair, Triple, marker_name
from .mechanism import Mechanism, PointMass, RayleighDamping
from .motion import Motion, Signal, check_signal, evaluated, sample, tabulated
from .rotation import RotationLike, rotation_matrix, rotation_vector
from .rows import Row, RowKind, Undeformed
from .spatial_joints import *  # noqa: F403
from .spatial_rows import (
    ANGULAR,
    BodyVector,
    SpatialElement,
    SpatialLoad,
    SpatialRow,
    SpatialRowKind,
    SpatialSpring,
    UndeformedInSpace,
    VectorKind,
)
from .symbols import Line, Pin, Slider, Spring, Square, Symbol

__all__ = [
    "ANGULAR",
    "Assembled",
    "BodyPoint",
    "BodyVector",
    "Element",
    "ElementKind",
    "Ground",
    "Line",
    "Marker",
    "Mechanism",
    "Motion",
    "Moving",
    "Pair",
    "Pin",
    "Placement",
    "PointMass",
    "RayleighDamping",
    "RotationLike",
    "Row",
    "RowKind",
    "Signal",
    "Slider",
    "SpatialElement",
    "SpatialLoad",
    "SpatialRow",
    "SpatialRowKind",
    "SpatialSpring",
    "Spring",
    "Square",
    "Start",
    "StaticEquilibrium",
    "Symbol",
    "Triple",
    "Undeformed",
    "UndeformedInSpace",
    "VectorKind",
    "check_signal",
    "evaluated",
    "marker_name",
    "rotation_matrix",
    "rotation_vector",
    "sample",
    "tabulated",
]
__all__ += forces.__all__
__all__ += joints.__all__
__all__ += spatial_joints.__all__
