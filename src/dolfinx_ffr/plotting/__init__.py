# SPDX-License-Identifier: MIT
"""Pictures of designs, modes, stress, diagrams and mechanisms in motion.

No screen is needed. All functions are collective: every rank calls them, rank 0 draws what it has
gathered and writes the file, and all return its path.
"""

from __future__ import annotations

from .design import plot_design
from .diagrams import plot_crank_motion, plot_curves, plot_history
from .gradients import plot_gradient_elements, plot_gradient_histories, plot_kernel
from .modes import plot_modes
from .motion_pictures import animate_motion, plot_scene
from .stress import plot_stress

__all__ = [
    "animate_motion",
    "plot_crank_motion",
    "plot_curves",
    "plot_design",
    "plot_gradient_elements",
    "plot_gradient_histories",
    "plot_history",
    "plot_kernel",
    "plot_modes",
    "plot_scene",
    "plot_stress",
]
