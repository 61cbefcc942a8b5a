# SPDX-License-Identifier: MIT
"""Ways in which the motion of a mechanism begins.

Either way the joints close at the start: positions hold C(y, 0) = 0 and velocities dC/dt = 0, and
the accelerations follow from the equations of motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["Assembled", "Start", "StaticEquilibrium"]


@dataclass(frozen=True)
class Assembled:
    """The placements, corrected so that the joints close; elastic coordinates zero or given.

    The corrections of position and angle, and of their velocities, are the smallest ones. First
    the undeformed bodies are put together, then the given deformation is made up for.

    Raises:
        ValueError: If an elastic coordinate is not a finite number.
    """

    #: Elastic coordinates at the start, shape (modes,), by name of the body; zero where not given.
    elastic: Mapping[str, ArrayLike] = field(default_factory=dict)
    #: Their velocities, shape (modes,) [1/s times the unit of the coordinates], likewise.
    elastic_velocity: Mapping[str, ArrayLike] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the numbers."""
        for what in ("elastic", "elastic_velocity"):
            for name, values in getattr(self, what).items():
                if not np.all(np.isfinite(np.asarray(values, dtype=np.float64))):
                    raise ValueError(f"start: {what} of body {name!r} holds NaN or infinity")


@dataclass(frozen=True)
class StaticEquilibrium:
    """The static equilibrium under gravity and the forces at t = 0, the bodies deformed by them.

    It holds r(y, 0, 0) + C_y^T lambda = 0 and C(y, 0) = 0, dampers and inertia left aside, and is
    sought from the placements downhill, so that a pendulum comes to hang. The velocities are those
    of the placements, corrected so that the joints close; the elastic coordinates start at rest.
    Its dependence on the bodies counts in the gradient.
    """


#: The ways to begin.
Start = Assembled | StaticEquilibrium
