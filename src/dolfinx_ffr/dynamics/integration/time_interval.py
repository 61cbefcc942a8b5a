# SPDX-License-Identifier: MIT
"""A duration and an accuracy, for which method and steps are found.

Steps that are the same for all designs make psi a smooth function of the design. Which method gives
an accuracy sooner, and with how many such steps, depends on the motion and on what is asked of it:
the Radau IIA method is of order 5 in what is smooth and damps vibrations that its steps do not
resolve, while generalised alpha is of order 2, cheaper by the step and follows what is rough, such
as forces of joints. So both are tried, with twice the steps again and again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ... import validation
from ..compilation import Compiled
from ..failures import SimulationError
from ..model import FlatModel
from ..trajectory import Integrator, Trajectory, TrajectoryBar, TrajectoryPullback
from .accuracy import LOOSEST, TIGHTEST
from .generalized_alpha import GeneralizedAlpha
from .radau import RadauIIA

__all__ = ["TimeInterval"]

Array = NDArray[np.float64]
Run = Callable[[Integrator], Trajectory]
Change = Callable[[Trajectory, Trajectory], float]

#: Steps to begin with. With fewer of Radau IIA, 25 or 35 in five turns of a crank, Newton's method
#: failed now and then at other designs than the one at which they are chosen.
FEWEST = {"radau": 50, "alpha": 250}
#: Time of a step of Radau IIA and its adjoint over that of generalised alpha: 5.7 to 8.6 were
#: measured with 4 to 80 normal modes. A number, so that the choice does not depend on the machine.
COST = 6
#: Most steps that are tried, of generalised alpha; of Radau IIA as many as cost the same
MOST_STEPS = 2**16


@dataclass(frozen=True)
class TimeInterval(Integrator):
    """Time interval of a motion, and the error of psi that its steps may make.

    In place of an integrator it leaves method and steps to :class:`Problem` and
    :class:`MechanicalProblem`: they take :class:`RadauIIA` or :class:`GeneralizedAlpha`, with the
    least number of equal steps, doubled again and again, at which the objective and all that are
    bounded differ by less than the tolerance from what four times as many steps give, and twice as
    many do so, too. Of both methods that is taken which is cheaper, its adjoint included. The
    choice is the same on every machine and rank, and told by ``problem.integrator``.

    :class:`Problem` chooses once, with every design element filled by one half, and keeps the steps
    for all designs. How large the error is at a design, ``model_report`` tells.

    Example:
        >>> problem = Problem({"rod": rod}, mechanism, TimeInterval(2.0), IntegralCompliance())
        >>> problem.integrator
        RadauIIA(end_time=2.0, ..., steps=50)

    Raises:
        ValueError: If a number is out of range.
    """

    order: ClassVar[int] = 2
    compiled: ClassVar[tuple[Compiled, ...]] = (*RadauIIA.compiled, *GeneralizedAlpha.compiled)

    #: Duration of the simulation, which starts at zero [s].
    end_time: float
    #: Largest relative error of the objective, and of those that are bounded, by the steps.
    tolerance: float = 1e-4

    def __post_init__(self) -> None:
        """Check the numbers."""
        validation.number("end_time", self.end_time, above=0.0, unit="s")
        validation.number("tolerance", self.tolerance, least=TIGHTEST, most=LOOSEST)

    def chosen(self, run: Run, change: Change) -> Integrator:
        """The cheaper method with the steps that the tolerance takes.

        Args:
            run: Simulates with a method.
            change: Relative change of what is asked for, from a motion and a coarser one.

        Raises:
            SimulationError: If the tolerance is out of reach with both, or no motion is found.
        """
        radau = self._settled(self._radau(), run, change)
        if isinstance(radau, SimulationError):
            alpha = self._settled(self._alpha(), run, change)
            if isinstance(alpha, SimulationError):
                raise alpha
            return alpha[0]
        method, exact = radau
        for cheaper in self._alpha():
            if cheaper.times.size > COST * method.times.size:
                break
            found = _tried(run, cheaper)
            if not isinstance(found, SimulationError) and change(exact, found) <= self.tolerance:
                return cheaper
        return method

    def _settled(
        self, methods: Iterator[Integrator], run: Run, change: Change
    ) -> tuple[Integrator, Trajectory] | SimulationError:
        """The first method that the two that follow confirm, and the motion of the last of them.

        Returns:
            What came in the way, if there is none.
        """
        tried: list[tuple[Integrator, Trajectory | SimulationError]] = []
        for method in methods:
            tried = [*tried, (method, _tried(run, method))][-3:]
            *before, exact = (found for _, found in tried)
            good = [found for found in before if not isinstance(found, SimulationError)]
            if (
                not isinstance(exact, SimulationError)
                and len(good) == 2
                and all(change(exact, found) <= self.tolerance for found in good)
            ):
                return tried[0][0], exact
        if isinstance(exact, SimulationError):
            return exact
        return SimulationError(
            f"the tolerance of {self.tolerance:.1e} is out of reach: the objective differs by "
            f"{change(exact, good[-1]) if good else np.inf:.1e} still between the motions with "
            f"most steps ({exact.step_ends.size - 1} of them); ask for less, name the times at "
            "which forces or motions jump (Mechanism.jumps), or give an integrator",
            exact,
        )

    def _radau(self) -> Iterator[Integrator]:
        steps = FEWEST["radau"]
        while COST * steps <= MOST_STEPS:
            yield RadauIIA(self.end_time, steps=steps, judged=True)
            steps *= 2

    def _alpha(self) -> Iterator[Integrator]:
        steps = FEWEST["alpha"]
        while steps <= MOST_STEPS:
            yield GeneralizedAlpha(self.end_time, steps, judged=True)
            steps *= 2

    @property
    def adaptive(self) -> bool:
        return True

    @property
    def times(self) -> Array:
        return np.array([0.0, self.end_time])

    @property
    def instants(self) -> int:
        return 0

    @property
    def coarser(self) -> Integrator:
        return TimeInterval(self.end_time, min(10.0 * self.tolerance, LOOSEST))

    @property
    def finer(self) -> Integrator:
        return TimeInterval(self.end_time, max(0.1 * self.tolerance, TIGHTEST))

    @property
    def remedy(self) -> str:
        return "ask for less, or give an integrator"

    def integrate(self, model: FlatModel, y0: Array, v0: Array) -> Trajectory:
        raise TypeError(_UNSETTLED)

    def pullback(self, trajectory: Trajectory, bar: TrajectoryBar) -> TrajectoryPullback:
        raise TypeError(_UNSETTLED)


#: What is said of a motion without steps
_UNSETTLED = (
    "a TimeInterval has no steps before they are chosen for an objective: give it to Problem or "
    "MechanicalProblem, or an integrator here"
)


def _tried(run: Run, method: Integrator) -> Trajectory | SimulationError:
    """A motion, or why there is none, as where steps are too long for it."""
    try:
        return run(method)
    except SimulationError as error:
        return error
