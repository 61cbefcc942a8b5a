# SPDX-License-Identifier: MIT
"""Description of a mechanism: markers, motions, joints, forces and how the motion begins."""

from __future__ import annotations

from .connection import Line as Line
from .connection import Pin as Pin
from .connection import Slider as Slider
from .connection import Spring as Spring
from .connection import Square as Square
from .connection import Symbol as Symbol
from .forces import AppliedForce as AppliedForce
from .forces import Bushing as Bushing
from .forces import Force as Force
from .forces import SpringDamper as SpringDamper
from .forces import Torque as Torque
from .forces import TorsionalSpringDamper as TorsionalSpringDamper
from .initial_conditions import Assembled as Assembled
from .initial_conditions import Placement as Placement
from .initial_conditions import Start as Start
from .initial_conditions import StaticEquilibrium as StaticEquilibrium
from .joints import AngleCoupling as AngleCoupling
from .joints import Cylindrical as Cylindrical
from .joints import Distance as Distance
from .joints import Gear as Gear
from .joints import Joint as Joint
from .joints import LinearDrive as LinearDrive
from .joints import Planar as Planar
from .joints import PointOnLine as PointOnLine
from .joints import PointOnPlane as PointOnPlane
from .joints import PrescribedAngle as PrescribedAngle
from .joints import PrescribedPosition as PrescribedPosition
from .joints import Revolute as Revolute
from .joints import Spherical as Spherical
from .joints import Translational as Translational
from .joints import Universal as Universal
from .joints import Weld as Weld
from .marker import BodyPoint as BodyPoint
from .marker import Ground as Ground
from .marker import Marker as Marker
from .marker import Moving as Moving
from .marker import Pair as Pair
from .marker import Triple as Triple
from .marker import marker_name
from .mechanism import Mechanism as Mechanism
from .mechanism import PointMass as PointMass
from .mechanism import RayleighDamping as RayleighDamping
from .motion import Motion as Motion
from .motion import Signal as Signal
from .motion import check_signal, evaluated, is_zero, sample, tabulated
from .parametric import Parameter as Parameter
from .parametric import Parameters as Parameters
from .parametric import ParametricMechanism as ParametricMechanism
from .parametric import TopologyError as TopologyError
from .rotation import PlacementWarning as PlacementWarning
from .rotation import RotationLike as RotationLike
from .rotation import rotation_matrix, rotation_vector
from .rows import BodyVector as BodyVector
from .rows import Element as Element
from .rows import Load as Load
from .rows import Row as Row
from .rows import RowKind as RowKind
from .rows import SpringRow as SpringRow
from .rows import VectorKind as VectorKind
from .rows import direction as direction
from .rows import point as point
from .undeformed import Undeformed as Undeformed
from .undeformed import aligned as aligned
from .undeformed import coincidence as coincidence
from .undeformed import on_line as on_line
from .undeformed import on_plane as on_plane
from .undeformed import parallel as parallel
from .undeformed import relative_angle as relative_angle
from .undeformed import turning as turning
