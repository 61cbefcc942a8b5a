# SPDX-License-Identifier: MIT
"""Choice of a method and its steps for a time interval and a tolerance."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from time import perf_counter

from ... import validation
from ..failures import SimulationError
from ..load_steps import LoadSteps
from ..trajectory import Integrator, Trajectory
from .accuracy import ACCURACY
from .certificate import (
    CHOICE,
    Certificate,
    Judge,
    Run,
    certified,
    graded_cells,
    radau_in,
    relative_change,
)
from .generalized_alpha import GeneralizedAlpha
from .radau import RadauIIA


@dataclass(frozen=True)
class StepChoice:
    """Method and steps for an accuracy, and how far they can be trusted."""

    integrator: Integrator  #: Method with its steps.
    error: float  #: Estimate of the largest relative error of all objectives.
    tolerance: float  #: Relative error that was asked for.
    #: Whether vibrations contribute that steps as long as the motion allows would lose.
    rings: bool
    resolved: bool  #: Whether all changes of loads and prescribed motions could be followed.
    seconds: float  #: Time that the choice took [s].

    @property
    def met(self) -> bool:
        """Whether the steps meet the tolerance."""
        return self.resolved and self.error <= self.tolerance

    @property
    def cost(self) -> int:
        """Time of a trajectory and its adjoint, in steps of generalised alpha."""
        return _cost(self.integrator)

    def __str__(self) -> str:
        """One line for a log."""
        method, error = self.integrator.in_words, f"{self.error:.1e}"
        text = f"time steps: {method}, estimated relative error of psi {error}"
        if self.rings:
            text += ", vibrations contribute to it"
        return f"{text} (chosen in {self.seconds:.2g} s)"

    @property
    def doubt(self) -> str:
        """Warning where the tolerance is not met."""
        if not self.resolved:
            reason = (
                ", and a load or a motion changes faster than any steps follow; give it as a "
                "smooth function of time"
            )
        elif self.rings:
            reason = (
                ", as vibrations contribute that the motion itself excites (a load or a drive that "
                "sets in suddenly, a spring out of balance); damp them, let loads and drives begin "
                "smoothly, begin in StaticEquilibrium(), or ask for less"
            )
        else:
            reason = (
                "; name the times at which forces or motions jump (Mechanism.jumps), or ask for "
                "less"
            )
        return (
            f"the time steps are too long for the relative error of {self.tolerance:.1e} that was "
            f"asked for: with {self.integrator.in_words} the estimated error is {self.error:.1e}"
            f"{reason}"
        )


@dataclass(frozen=True)
class TimeInterval:
    """The simulated time, and the error of psi that the time steps may cause.

    In place of an integrator it leaves method and steps to :class:`Problem` and
    :class:`MechanicalProblem`. The objective and all bounded objectives are computed by two methods
    that treat vibrations in opposite ways, Radau IIA and the trapezoidal rule, until both agree:
    so a vibration that matters is found even where it is far faster than the steps. Loads and
    prescribed motions are sampled between the steps, too. Then the cheapest method and steps are
    taken, adjoint included, that agree with these numbers to the tolerance, and still do with twice
    as many steps: :class:`RadauIIA`, or :class:`GeneralizedAlpha`, without numerical damping where
    vibrations matter. Where equal steps would be too many, Radau IIA takes short ones where the
    motion is fast, alike for all designs. The choice is the same on every machine and rank, and
    told by ``problem.integrator``.

    :class:`Problem` chooses with every design element filled by one half, and by the full bodies,
    and keeps the steps for all designs; :func:`optimize` looks at them again where psi has changed
    by much, and at the end. A `TimeStepWarning` tells of a design between them whose resonance the
    steps do not follow as nearly; how large the error is at a design, ``model_report`` tells.

    Example:
        >>> problem = Problem({"rod": rod}, mechanism, TimeInterval(2.0), IntegralCompliance())
        >>> problem.integrator
        RadauIIA(end_time=2.0, ..., steps=50)

    Attributes:
        end_time: Duration of the simulation, which starts at zero [s].
        tolerance: Largest relative error of all objectives by the steps.
    """

    end_time: float
    tolerance: float = 1e-4

    def __post_init__(self) -> None:
        validation.number("end_time", self.end_time, above=0.0, unit="s")
        validation.number(
            "tolerance", self.tolerance, least=ACCURACY.tightest, most=ACCURACY.loosest
        )

    def chosen(
        self,
        run: Run,
        judge: Judge,
        cells: LoadSteps,
        *,
        damped: bool,
        present: Trajectory | None = None,
    ) -> StepChoice:
        """The cheapest method and number of steps that meet the tolerance.

        Args:
            run: Simulates with a method.
            judge: Computes the objective and the constraints of a trajectory.
            cells: Steps that resolve loads and prescribed motions.
            damped: Whether anything in the machine damps vibrations.
            present: A trajectory whose method and steps are reused if they meet the tolerance.
        """
        start, tolerance = perf_counter(), self.tolerance
        exact = certified(run, judge, cells, CHOICE.share_of_certificate * tolerance, damped=damped)

        def choice(method: Integrator, error: float) -> StepChoice:
            seconds = perf_counter() - start
            return StepChoice(method, error, tolerance, exact.rings, cells.resolved, seconds)

        if present is not None:
            error = relative_change(exact.values, judge(present)) + exact.error
            if error <= tolerance:
                return choice(present.integrator, error)
        families = [self._radau(exact.cells), self._alpha(GeneralizedAlpha.spectral_radius)]
        if not cells.corners.size and not damped:
            families.append(self._alpha(1.0))
        method, error = _cheapest(families, run, judge, exact, tolerance)
        if error > tolerance and exact.cells is cells:
            graded = graded_cells(run, cells)
            if graded is not None:
                in_graded_cells = _cheapest([self._radau(graded)], run, judge, exact, tolerance)
                if in_graded_cells[1] < error:
                    method, error = in_graded_cells
        return choice(method, error)

    def _radau(self, cells: LoadSteps) -> Iterator[Integrator]:
        steps_of_cell, count = 1, cells.ends.size - 1
        while steps_of_cell == 1 or CHOICE.cost * count * steps_of_cell <= CHOICE.most_steps:
            yield replace(radau_in(cells, steps_of_cell), chosen_for=self.tolerance)
            steps_of_cell *= 2

    def _alpha(self, spectral_radius: float) -> Iterator[Integrator]:
        steps = CHOICE.fewest_steps
        while steps <= CHOICE.most_steps:
            yield GeneralizedAlpha(self.end_time, steps, spectral_radius, chosen_for=self.tolerance)
            steps *= 2


def recorded(integrator: Integrator) -> str:
    """Method and steps as a text, from which :func:`restored_method` makes them again."""
    return json.dumps({"method": type(integrator).__name__, **asdict(integrator)})


def restored_method(text: str) -> Integrator:
    """Method and steps from the text that :func:`recorded` gave."""
    numbers = json.loads(text)
    kinds: dict[str, type[Integrator]] = {k.__name__: k for k in (RadauIIA, GeneralizedAlpha)}
    return kinds[numbers.pop("method")](**numbers)


def refined(
    integrators: Sequence[Integrator], run: Run, judge: Judge, exact: Certificate, tolerance: float
) -> StepChoice:
    """The cheapest of some methods with steps divided, or tolerance lowered, to an accuracy."""
    start, most_cost = perf_counter(), CHOICE.cost * CHOICE.most_steps
    begun = [integrator.toward(tolerance) for integrator in integrators]
    for method in begun:
        if not method.adaptive and _cost(method) > most_cost:
            most_steps = most_cost * (method.times.size - 1) // _cost(method)
            raise ValueError(
                f"time steps: {method.in_words} are more than the {most_steps:,} from which "
                "steps are still divided for a tolerance: begin with fewer, or give "
                "TimeInterval(end_time, tolerance)"
            )

    def finer(method: Integrator) -> Iterator[Integrator]:
        while method.adaptive or _cost(method) <= most_cost:
            yield method
            if method.adaptive and method.finest:
                return
            method = method.finer

    method, error = _cheapest([finer(method) for method in begun], run, judge, exact, tolerance)
    return StepChoice(method, error, tolerance, exact.rings, True, perf_counter() - start)


def _cost(method: Integrator) -> int:
    """Time of a trajectory and its adjoint, in steps of generalised alpha."""
    return (CHOICE.cost if method.stages > 1 else 1) * (method.times.size - 1)


def _cheapest(
    families: list[Iterator[Integrator]],
    run: Run,
    judge: Judge,
    exact: Certificate,
    tolerance: float,
) -> tuple[Integrator, float]:
    """The cheapest method near enough to certain numbers, and its estimated error.

    Each family is gone through from the longest steps on, the cheapest next step of all first. A
    method is taken if the next one of its family is near enough, too. If there is none, the
    cheapest of the methods with about the least error is taken.
    """
    computed = dict(exact.tried)
    tried: list[list[tuple[Integrator, float]]] = [[] for _ in families]
    begun = {number: next(family, None) for number, family in enumerate(families)}
    waiting = {number: method for number, method in begun.items() if method is not None}
    failure: Exception | None = None
    cheapest: tuple[Integrator, float] | None = None
    while waiting:
        number = min(waiting, key=lambda number: (_cost(waiting[number]), number))
        method, of_family = waiting.pop(number), tried[number]
        if cheapest is not None and _cost(method) >= 2 * _cost(cheapest[0]):
            break
        try:
            values = computed[method] if method in computed else judge(run(method))
            error = relative_change(exact.values, values) + exact.error
        except (SimulationError, MemoryError) as caught:
            failure, error = caught, math.inf
        of_family.append((method, error))
        if len(of_family) > 1 and max(of_family[-2][1], error) <= tolerance:
            if cheapest is None or _cost(of_family[-2][0]) < _cost(cheapest[0]):
                cheapest = of_family[-2]
        elif (finer := next(families[number], None)) is not None:
            waiting[number] = finer
    if cheapest is not None:
        return cheapest

    pairs = [pair for of_family in tried for pair in of_family]
    least = min((error for _, error in pairs), default=math.inf)
    if not math.isfinite(least):
        assert failure is not None
        raise failure
    good = [pair for pair in pairs if pair[1] <= CHOICE.as_good * least]
    method, error = min(good, key=lambda pair: _cost(pair[0]))
    # Far from the tolerance the larger part of the error tells more than the sum of both.
    larger = max(error - exact.error, exact.estimate)
    return method, larger if larger > tolerance else error
