# SPDX-License-Identifier: MIT
"""Pictures of designs, modes, stress, diagrams and mechanisms in motion.

No screen is needed. All functions are collective: every rank calls them, rank 0 draws what it has
gathered and writes the file (.png, .pdf or .svg; films are .gif or .mp4), and all return its path.
Another kind of file is a ValueError on every rank, an argument of a wrong kind a TypeError.
"""

from __future__ import annotations

from ..documentation import explain_fields
from .boundary_film import animate_boundary
from .diagrams import (
    plot_crank_motion,
    plot_curves,
    plot_gradient_histories,
    plot_history,
    plot_kernel,
    plot_trade_off,
)
from .fields import mesh_grid, plot_design, plot_gradient_elements, plot_modes, plot_stress
from .motion_pictures import animate_motion, plot_scene
from .part_view import plot_part

__all__ = [
    "animate_boundary",
    "animate_motion",
    "mesh_grid",
    "plot_crank_motion",
    "plot_curves",
    "plot_design",
    "plot_gradient_elements",
    "plot_gradient_histories",
    "plot_history",
    "plot_kernel",
    "plot_modes",
    "plot_part",
    "plot_scene",
    "plot_stress",
    "plot_trade_off",
]

explain_fields(globals())
