# SPDX-License-Identifier: MIT
"""Description of a mechanism: markers, motions, joints, forces and how the motion begins."""

from __future__ import annotations

from ..documentation import explain_fields
from .forces import AppliedForce, Bushing, Force, SpringDamper, Torque, TorsionalSpringDamper
from .initial_conditions import Assembled, Placement, Start, StaticEquilibrium
from .joints import (
    Cylindrical,
    Distance,
    Gear,
    Joint,
    LinearDrive,
    Planar,
    PointOnLine,
    PointOnPlane,
    PrescribedAngle,
    PrescribedPosition,
    Revolute,
    Spherical,
    Translational,
    Universal,
    Weld,
)
from .marker import BodyPoint, Ground, Marker, Moving, Pair, Triple, marker_name
from .mechanism import Mechanism, PointMass, RayleighDamping
from .motion import Motion, Signal, check_signal, evaluated, is_zero, sample, tabulated
from .parametric import ParametricMechanism
from .parts import aligned, coincidence, on_line, on_plane, parallel, relative_angle, turning
from .rotation import PlacementWarning, RotationLike, rotation_matrix, rotation_vector
from .rows import BodyVector, Element, Load, Row, RowKind, SpringRow, VectorKind, direction, point
from .symbols import Line, Pin, Slider, Spring, Square, Symbol
from .undeformed import Undeformed

__all__ = [
    "AppliedForce",
    "Assembled",
    "BodyPoint",
    "BodyVector",
    "Bushing",
    "Cylindrical",
    "Distance",
    "Element",
    "Force",
    "Gear",
    "Ground",
    "Joint",
    "Line",
    "LinearDrive",
    "Load",
    "Marker",
    "Mechanism",
    "Motion",
    "Moving",
    "Pair",
    "ParametricMechanism",
    "Pin",
    "Placement",
    "PlacementWarning",
    "Planar",
    "PointMass",
    "PointOnLine",
    "PointOnPlane",
    "PrescribedAngle",
    "PrescribedPosition",
    "RayleighDamping",
    "Revolute",
    "RotationLike",
    "Row",
    "RowKind",
    "Signal",
    "Slider",
    "Spherical",
    "Spring",
    "SpringDamper",
    "SpringRow",
    "Square",
    "Start",
    "StaticEquilibrium",
    "Symbol",
    "Torque",
    "TorsionalSpringDamper",
    "Translational",
    "Triple",
    "Undeformed",
    "Universal",
    "VectorKind",
    "Weld",
    "aligned",
    "check_signal",
    "coincidence",
    "direction",
    "evaluated",
    "is_zero",
    "marker_name",
    "on_line",
    "on_plane",
    "parallel",
    "point",
    "relative_angle",
    "rotation_matrix",
    "rotation_vector",
    "sample",
    "tabulated",
    "turning",
]

explain_fields(globals())
