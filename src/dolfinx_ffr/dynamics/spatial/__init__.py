# SPDX-License-Identifier: MIT
"""Kinematics in space: equations of motion of mechanisms in space, their Jacobians and transposes.

Bodies turn by rotation matrices, with their angular velocities in their own axes; see group.py for
the coordinates. What other folders use of it stands here; planar kinematics offer the same.
"""

from __future__ import annotations

from .arrays import ModelArrays
from .assembly import assemble
from .branches import reversed_row, tilts
from .coordinates import Coordinates
from .integral_gradients import integral_bars, marker_bar, metric_bars
from .kinematics import KIND, begin_turns, follow_turns, round_off_floor, turning_of
from .metric import coordinates_of, length_of, settled, settled_pullback, sizes_by_mass, ways
from .motion import (
    MarkerMotion,
    Momenta,
    marker_motion,
    marker_motion_pullback,
    momenta_of,
    rotations_of,
)
from .softening import largest_turn, softened

__all__ = [
    "KIND",
    "Coordinates",
    "MarkerMotion",
    "ModelArrays",
    "Momenta",
    "assemble",
    "begin_turns",
    "coordinates_of",
    "follow_turns",
    "integral_bars",
    "largest_turn",
    "length_of",
    "marker_bar",
    "marker_motion",
    "marker_motion_pullback",
    "metric_bars",
    "momenta_of",
    "reversed_row",
    "rotations_of",
    "round_off_floor",
    "settled",
    "settled_pullback",
    "sizes_by_mass",
    "softened",
    "tilts",
    "turning_of",
    "ways",
]
