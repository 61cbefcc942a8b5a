# SPDX-License-Identifier: MIT
"""The trapezoidal rule as a second method, with which another one's trajectory is compared.

Radau IIA and generalised alpha with numerical damping lose a vibration that their steps do not
resolve, and with twice as many steps they lose it again: that both agree proves nothing. The
trapezoidal rule, which is generalised alpha with a spectral radius of one, keeps its amplitude
whatever the step: it conserves the energy of a linear vibration exactly, at a wrong frequency
(T. J. R. Hughes, The Finite Element Method, Prentice-Hall 1987, section 9.1). Means over time of
quadratic functions of the coordinates are right therefore, while the steps are still far too long.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar, NoReturn

import numpy as np

from ...arrays import Array
from ..compilation import Compiled
from ..failures import SimulationError
from ..load_steps import LoadSteps
from ..model import FlatModel
from ..tables import BESIDE_JUMP
from ..trajectory import Integrator, Trajectory, TrajectoryBar, joined
from .generalized_alpha import GeneralizedAlpha


@dataclass(frozen=True)
class TrapezoidalWitness(Integrator):
    """Trapezoidal rule in steps that change from cell to cell, begun anew behind each jump.

    With a spectral radius of one the method's own accelerations are those of the equations of
    motion, so that a stretch may begin where the one before has ended. It has no adjoint.
    """

    order: ClassVar[int] = 2
    compiled: ClassVar[tuple[Compiled, ...]] = GeneralizedAlpha.compiled

    cells: LoadSteps  #: Cells that resolve loads and prescribed motions.
    steps_of_cell: int

    @property
    def instants(self) -> int:
        return self.steps_of_cell * (self.cells.ends.size - 1) + self.cells.corners.size + 1

    def amplification(self, phase: float) -> float:
        return 1.0

    def integrate(self, model: FlatModel, y0: Array, v0: Array) -> Trajectory:
        stretches: list[Trajectory] = []
        for begin, end, steps in self._stretches():
            method = GeneralizedAlpha(end - begin, steps, 1.0)
            model = model.at(np.linspace(begin, end, steps + 1))
            try:
                stretch = method.integrate(model, y0, v0)
            except SimulationError as error:
                so_far = self._joined([*stretches, error.trajectory])
                raise SimulationError(str(error), so_far) from error
            y0, v0 = stretch.y[-1], stretch.v[-1]
            model = model.counting_from(stretch.turns[-1:])
            stretches.append(stretch)
        return self._joined(stretches)

    def _stretches(self) -> Iterator[tuple[float, float, int]]:
        """Begin, end and number of equal steps of each stretch; none goes over a jump."""
        ends, corners = self.cells.ends, self.cells.corners
        lengths = np.diff(ends)
        equal = np.isclose(lengths[1:], lengths[:-1], rtol=1e-9, atol=0.0)
        changes = np.flatnonzero(~equal | np.isin(ends[1:-1], corners)) + 1
        for from_cell, to_cell in pairwise([0, *changes, ends.size - 1]):
            begin, end = float(ends[from_cell]), float(ends[to_cell])
            if ends[from_cell] in corners:
                begin *= 1.0 + BESIDE_JUMP
            yield begin, end, int(to_cell - from_cell) * self.steps_of_cell

    def _joined(self, stretches: list[Trajectory]) -> Trajectory:
        """One trajectory of all stretches.

        The last row of a stretch is the first of the next one. But behind a jump, where
        accelerations differ, it begins later than the end of a cell, and its first row stays.
        """
        first_rows = [int(np.isin(stretch.t[0], self.cells.ends)) for stretch in stretches[1:]]
        trajectory = joined(stretches, [0, *first_rows])
        model = trajectory.model.at(trajectory.t)
        return replace(trajectory, model=model, integrator=self)

    @property
    def finer(self) -> TrapezoidalWitness:
        return replace(self, steps_of_cell=2 * self.steps_of_cell)

    def pullback(self, trajectory: Trajectory, bar: TrajectoryBar) -> NoReturn:
        raise TypeError("the trapezoidal witness has no adjoint; take GeneralizedAlpha")
