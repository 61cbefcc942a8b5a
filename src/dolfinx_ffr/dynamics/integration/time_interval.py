# SPDX-License-Identifier: MIT
"""A time interval and a tolerance, in place of a method and its steps."""

from __future__ import annotations

from dataclasses import dataclass

from ... import validation
from .step_choice import CHOICE


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
    motion is fast, alike for all designs. The choice is the same on every machine and rank;
    ``problem.integrator`` is the result.

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
        validation.number("tolerance", self.tolerance, least=CHOICE.tightest, most=CHOICE.loosest)
