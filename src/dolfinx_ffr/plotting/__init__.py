# SPDX-License-Identifier: MIT
"""Pictures of designs, modes, stress, diagrams and mechanisms in motion.

No screen is needed. All functions are collective: every rank calls them, rank 0 draws what it has
gathered and writes the file, and all return its path.
"""

from __future__ import annotations

from .diagrams import (
    plot_crank_motion,
    plot_curves,
    plot_gradient_histories,
    plot_history,
    plot_kernel,
)
from .fields import mesh_grid, plot_design, plot_gradient_elements, plot_modes, plot_stress
from .motion_pictures import animate_motion, plot_scene
from .part_view import plot_part
from .trade_off import plot_trade_off

__all__ = [
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
