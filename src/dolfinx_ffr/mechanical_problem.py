# SPDX-License-Identifier: MIT
"""From the volume integrals of the bodies to numbers of the motion, and back; no mesh is needed.

    volume integrals -> trajectory -> psi and constraints
      integrals_bar  <- discrete adjoint <-

Several numbers share one simulation; each has an adjoint pass of its own. A number that does not
depend on the motion, such as a mass, causes neither.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from .body import VolumeIntegrals
from .dynamics import Integrator, Trajectory, TrajectoryBar, adjoint, simulate
from .dynamics.accuracy import coarser_run, run_to_tolerance
from .mechanism import Mechanism
from .objective import Constraint, Objective

__all__ = [
    "ConstraintValue",
    "MechanicalEvaluation",
    "MechanicalProblem",
    "parts_of_gradient",
]

Bodies = Mapping[str, VolumeIntegrals]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class ConstraintValue:
    """A constraint at one design: it holds where ``value`` is not positive."""

    #: g, the distance from the bound relative to the bound; at most zero where the bound holds.
    value: float
    #: The objective that is bounded, in its own unit.
    psi: float
    #: Derivative of g with respect to the integrals, by name of the body; None where only values
    #: were asked for, or where g is no function of the integrals.
    integrals_gradient: dict[str, VolumeIntegrals] | None = field(default=None, repr=False)
    #: Derivative of g with respect to the densities of this rank's cells, shape (cells,), by name
    #: of the body; None where only values were asked for, or where no body has a density.
    gradient: dict[str, Array] | None = field(default=None, repr=False)


@dataclass(frozen=True)
class MechanicalEvaluation:
    """Objective and constraints of a mechanism, and their derivatives."""

    #: Value of the objective, in its unit.
    psi: float
    #: Derivative of psi with respect to the integrals, by name of the body, markers included; None
    #: where only values were asked for.
    integrals_gradient: dict[str, VolumeIntegrals] | None = field(repr=False)
    #: Constraints by name.
    constraints: dict[str, ConstraintValue]
    #: The motion; None if neither objective nor constraints depend on it.
    trajectory: Trajectory | None = field(repr=False)
    #: The integrals at which this was computed.
    bodies: dict[str, VolumeIntegrals] = field(repr=False)
    #: Time spent by name of the part [s].
    seconds: dict[str, float]


@dataclass(frozen=True)
class MechanicalProblem:
    """An objective and constraints of a mechanism's motion, as functions of the volume integrals.

    It takes bodies that are given by arrays, from a file (:meth:`VolumeIntegrals.load`), from a
    formula (:class:`ParametricBody`) or from another code; neither a mesh nor DOLFINx is needed.

    Example:
        >>> problem = MechanicalProblem(mechanism, integrator, IntegralCompliance())
        >>> evaluation = problem.gradient({"rod": VolumeIntegrals.load("rod.npz")})
        >>> evaluation.psi, evaluation.integrals_gradient["rod"].K

    Raises:
        ValueError: If two constraints have the same name.
    """

    #: Joints, motions, point masses, gravity.
    mechanism: Mechanism
    #: Time interval and steps.
    integrator: Integrator
    #: What is minimised.
    objective: Objective
    #: Bounds on further objectives.
    constraints: Sequence[Constraint] = ()

    def __post_init__(self) -> None:
        """Check the names."""
        labels = [constraint.label for constraint in self.constraints]
        twice = sorted({label for label in labels if labels.count(label) > 1})
        if twice:
            raise ValueError(f"two constraints have the name {twice[0]!r}; name them apart")

    @property
    def needs_trajectory(self) -> bool:
        """Whether the objective or a constraint depends on the motion."""
        objectives = [self.objective, *(c.objective for c in self.constraints)]
        return any(objective.needs_trajectory for objective in objectives)

    def value(self, bodies: Bodies) -> MechanicalEvaluation:
        """Return objective and constraints; nothing is simulated if none depends on the motion.

        Args:
            bodies: Volume integrals of all bodies, by name.

        Raises:
            ValueError: If a name does not exist or integrals are not valid.
            SimulationError: If the motion cannot be computed.
        """
        start = perf_counter()
        trajectory = None
        if self.needs_trajectory:
            trajectory = simulate(self.mechanism, bodies, self.integrator)
        else:
            for name, integrals in bodies.items():
                integrals.validate(name)
        constraints = {}
        for constraint in self.constraints:
            psi = _value(constraint.objective, trajectory, bodies)
            constraints[constraint.label] = ConstraintValue(constraint.scaled(psi), psi)
        return MechanicalEvaluation(
            psi=_value(self.objective, trajectory, bodies),
            integrals_gradient=None,
            constraints=constraints,
            trajectory=trajectory,
            bodies=dict(bodies),
            seconds={"simulation": perf_counter() - start},
        )

    def time_error(self, evaluation: MechanicalEvaluation) -> float:
        """Return an estimate of the relative error that the time steps make in psi.

        It is the change with steps twice as long, the largest of the objective and of those that
        are bounded. The error itself is smaller: by 3 times with :class:`GeneralizedAlpha`, by up
        to 31 with :class:`RadauIIA`, where the steps resolve what matters to the objective.

        Args:
            evaluation: What :meth:`value` returned.

        Raises:
            SimulationError: If the steps are too long for that.
        """
        fine, bodies = evaluation.trajectory, evaluation.bodies
        if fine is None:
            return 0.0

        def run(integrator: Integrator) -> Trajectory:
            return simulate(self.mechanism, bodies, integrator)

        return self._change(bodies, fine, coarser_run(self.integrator, fine, run))

    def with_tolerance(self, bodies: Bodies, tolerance: float) -> MechanicalProblem:
        """Return the same problem with steps for an accuracy of psi.

        Fixed steps are halved and the tolerance of adaptive ones falls until :meth:`time_error`
        meets the tolerance and, with :class:`RadauIIA`, no single step adds a larger error. Choose
        once, and keep the steps while designing.

        Args:
            bodies: Volume integrals of all bodies, by name.
            tolerance: Largest relative error of the objective and of those that are bounded.

        Raises:
            ValueError: If a name does not exist or a number is not valid.
            SimulationError: If the motion cannot be computed, or the tolerance is not reached; the
                message says what was.
        """
        if not self.needs_trajectory:
            return self
        integrator, _ = run_to_tolerance(
            self.integrator,
            tolerance,
            lambda chosen: simulate(self.mechanism, bodies, chosen),
            lambda fine, coarse: self._change(bodies, fine, coarse),
            "the objective",
        )
        return replace(self, integrator=integrator)

    def _change(self, bodies: Bodies, fine: Trajectory, coarse: Trajectory) -> float:
        """Return the largest relative change of the objective and of those that are bounded."""
        changes = [0.0]
        for objective in (self.objective, *(c.objective for c in self.constraints)):
            if objective.needs_trajectory:
                here, there = (_value(objective, motion, bodies) for motion in (fine, coarse))
                changes.append(abs(here - there) / (abs(here) or 1.0))
        return max(changes)

    def gradient(self, bodies: Bodies) -> MechanicalEvaluation:
        """Return objective and constraints with their exact derivatives.

        Args:
            bodies: Volume integrals of all bodies, by name.

        Raises:
            ValueError: As :meth:`value` does.
            SimulationError: As :meth:`value` does.
        """
        return self.differentiate(self.value(bodies))

    def differentiate(self, evaluation: MechanicalEvaluation) -> MechanicalEvaluation:
        """Return an evaluation with the exact derivatives added.

        So a design whose value is rejected need not be differentiated.

        Args:
            evaluation: What :meth:`value` returned.
        """
        start = perf_counter()
        trajectory, bodies = evaluation.trajectory, evaluation.bodies
        constraints = {}
        for constraint in self.constraints:
            bars = _gradient(constraint.objective, trajectory, bodies)
            constraints[constraint.label] = replace(
                evaluation.constraints[constraint.label],
                integrals_gradient={k: bar.scaled(constraint.slope) for k, bar in bars.items()},
            )
        return replace(
            evaluation,
            integrals_gradient=_gradient(self.objective, trajectory, bodies),
            constraints=constraints,
            seconds={**evaluation.seconds, "adjoint": perf_counter() - start},
        )


def _value(objective: Objective, trajectory: Trajectory | None, bodies: Bodies) -> float:
    # An objective that is handed None has said that it does not look at the motion.
    return float(objective.value(trajectory, bodies))  # type: ignore[arg-type]


def _gradient(
    objective: Objective, trajectory: Trajectory | None, bodies: Bodies
) -> dict[str, VolumeIntegrals]:
    """Derivative of an objective with respect to all integrals."""
    direct, motion = parts_of_gradient(objective, trajectory, bodies)
    return {name: own + direct[name] if name in direct else own for name, own in motion.items()}


def parts_of_gradient(
    objective: Objective, trajectory: Trajectory | None, bodies: Bodies
) -> tuple[dict[str, VolumeIntegrals], dict[str, VolumeIntegrals]]:
    """Return the derivatives of an objective with respect to the integrals, in two parts.

    Args:
        objective: The objective.
        trajectory: The motion; None if the objective does not depend on it.
        bodies: Volume integrals of all bodies, by name.

    Returns:
        By name of the body, at fixed motion (bodies on which the objective does not depend directly
        may be missing), and through the motion (all bodies).
    """
    bar, direct = objective.pullback(trajectory, bodies)  # type: ignore[arg-type]
    if trajectory is not None and bar is not None and _matters(bar):
        return direct, adjoint(trajectory, bar)
    return direct, {name: integrals.zeros_like() for name, integrals in bodies.items()}


def _matters(bar: TrajectoryBar) -> bool:
    """Whether an entry is not zero; NaN counts, so that it is reported."""
    return any(np.any(part) for part in (bar.y, bar.v, bar.w, bar.multipliers))
