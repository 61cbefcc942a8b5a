# SPDX-License-Identifier: MIT
"""Pictures of designs, modes, stress, diagrams and mechanisms in motion.

No screen is needed. All functions are collective: every rank calls them, rank 0 draws what it has
gathered and writes the file (.png, .pdf or .svg; films are .gif or .mp4), and all return its path.
Another kind of file is a ValueError, an argument of a wrong kind a TypeError.
"""

from __future__ import annotations

from .diagrams import plot_curves as plot_curves
from .diagrams import plot_history as plot_history
from .fields import mesh_grid as mesh_grid
from .fields import plot_design as plot_design
from .fields import plot_gradient_elements as plot_gradient_elements
from .fields import plot_modes as plot_modes
from .fields import plot_stress as plot_stress
from .motion_pictures import animate_boundary as animate_boundary
from .motion_pictures import animate_motion as animate_motion
from .motion_pictures import plot_scene as plot_scene
from .part_view import plot_part as plot_part
