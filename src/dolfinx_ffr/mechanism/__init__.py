# SPDX-License-Identifier: MIT
"""Description of a mechanism: markers, motions, joints, forces and how the motion begins."""

from __future__ import annotations

from . import forces, joints
from .elements import Element, ElementKind
from .forces import *  # noqa: F403
from .initial_conditions import Assembled, Placement, Start, StaticEquilibrium
from .joints import *  # noqa: F403
from .marker import BodyPoint, Ground, Marker, Moving, Pair, marker_name
from .mechanism import Mechanism, PointMass, RayleighDamping
from .motion import Motion, Signal, check_signal, evaluated, sample, tabulated
from .rows import Row, RowKind, Undeformed
from .symbols import Line, Pin, Slider, Spring, Square, Symbol

__all__ = [
    "Assembled",
    "BodyPoint",
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
    "Row",
    "RowKind",
    "Signal",
    "Slider",
    "Spring",
    "Square",
    "Start",
    "StaticEquilibrium",
    "Symbol",
    "Undeformed",
    "check_signal",
    "evaluated",
    "marker_name",
    "sample",
    "tabulated",
]
__all__ += forces.__all__
__all__ += joints.__all__
