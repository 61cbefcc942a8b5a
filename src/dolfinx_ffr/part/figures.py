# SPDX-License-Identifier: MIT
"""The figures of a problem whose bodies have certain meshes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ..arrays import Array
from ..reduction import FlexibleBody


@dataclass(frozen=True, eq=False)
class BodyFigures:
    """Measures and frequencies of one body."""

    cells: int  #: Of its mesh
    mass: float  #: [kg]
    volume: float  #: Material, as a share of the area of the body that was designed
    frequencies: Array  #: With all interfaces fixed [Hz]
    #: Largest von Mises stress over the trajectory [Pa]; None without a trajectory, and of meshes
    #: that are followed by a finer one
    stress: float | None = None
    place: Array | None = None  #: Where it is, in the mesh (dimension,) [m]

    def is_of(self, body: FlexibleBody, design: FlexibleBody) -> bool:
        """Whether these figures of a ``design`` equal the figures of a completely solid ``body``.

        They are if both have equal meshes, by their number of cells and their volume, and modes.
        """
        mesh, of_design = body.domain, design.domain
        is_as_fine = self.cells == mesh.n_cells_global and mesh.order == of_design.order
        filled = self.volume * (of_design.whole or of_design).area
        is_solid = math.isclose(filled, mesh.area, rel_tol=1e-10)
        return is_as_fine and is_solid and body.modes == design.modes


@dataclass(frozen=True, eq=False)
class Figures:
    """One line of the table: a problem with certain meshes."""

    size: float | None  #: Of the cells [m]; None for the design as it was reported
    #: Value of the objective; where that stands for another number (`PeakStress`), of that number
    psi: float
    constraints: dict[str, float]  #: Values of the constrained objectives, likewise
    bodies: dict[str, BodyFigures]  #: Of the designed bodies
    #: Value of the objective of each load case by its name; empty where there is one
    load_cases: dict[str, float] = field(default_factory=dict)
    #: By how much constraints and volumes ("volume of rod") exceed their bounds, relative to these;
    #: negative where they hold
    excesses: dict[str, float] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float]:
        """Constraints, and volumes as shares of the bodies that were designed, by name."""
        volumes = {f"volume of {name}": body.volume for name, body in self.bodies.items()}
        return volumes | self.constraints
