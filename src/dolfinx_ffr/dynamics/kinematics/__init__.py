# SPDX-License-Identifier: MIT
"""Equations of motion of mechanisms in the plane and in space, their Jacobians and transposes.

The kernels for vectors, rows and forces are written once for d = 2 and 3, d being a constant when
they are compiled. Bodies turn by an angle in the plane and by rotation matrices in space, with
angular velocities in the bodies' axes, see group.py. Code that differs between plane and space is a
kernel or a method of both classes of arrays, PlaneArrays (plane.py) and SpaceArrays (space.py).
"""

from __future__ import annotations

from .arrays import Coordinates, SpaceCoordinates
from .body_arrays import KINDS, ModelArrays, body_arrays, is_spatial
from .branches import holds_axes, reversed_row, tilts
from .gradients import Samples, field_bars, integral_bars, marker_bar, metric_bars, vector_bars
from .instant import (
    Evaluation,
    Kinematics,
    applied_forces,
    compiled_kinematics,
    equations_pullback,
    evaluate_equations,
    place_vectors,
)
from .lowering import Lowering
from .metric import elastic_mass, largest_length, length_of, mass_norm, norm_floors
from .motion import (
    IN_SPACE,
    MarkerMotion,
    Momenta,
    State,
    columns_in_space,
    marker_motion_pullback,
    momenta_of,
    motion_of_marker,
    turned_between,
)

__all__ = [
    "IN_SPACE",
    "KINDS",
    "Coordinates",
    "Evaluation",
    "Kinematics",
    "Lowering",
    "MarkerMotion",
    "ModelArrays",
    "Momenta",
    "Samples",
    "SpaceCoordinates",
    "State",
    "applied_forces",
    "body_arrays",
    "columns_in_space",
    "compiled_kinematics",
    "elastic_mass",
    "equations_pullback",
    "evaluate_equations",
    "field_bars",
    "holds_axes",
    "integral_bars",
    "is_spatial",
    "largest_length",
    "length_of",
    "marker_bar",
    "marker_motion_pullback",
    "mass_norm",
    "metric_bars",
    "momenta_of",
    "motion_of_marker",
    "norm_floors",
    "place_vectors",
    "reversed_row",
    "tilts",
    "turned_between",
    "vector_bars",
]
