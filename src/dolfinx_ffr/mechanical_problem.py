# SPDX-License-Identifier: MIT
"""From the volume integrals of the bodies to numbers of the motion, and back; no mesh is needed.

    volume integrals -> trajectory -> psi and constraints
      integrals_bar  <- discrete adjoint <-

Several numbers share one simulation; each has an adjoint pass of its own. A number that does not
depend on the motion, such as a mass, causes neither.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from . import validation
from .body import VolumeIntegrals
from .dynamics import (
    Integrator,
    TimeInterval,
    Trajectory,
    TrajectoryBar,
    adjoint,
    coarser_run,
    integrate,
    run_to_tolerance,
    simulate,
)
from .mechanism import Mechanism
from .objective import (
    Constraint,
    DensityField,
    Derivatives,
    Objective,
    Response,
    StressField,
    check_objective,
)

__all__ = [
    "ConstraintValue",
    "MechanicalEvaluation",
    "MechanicalProblem",
    "parts_of_gradient",
    "through_motion",
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
    #: were asked for.
    integrals_gradient: dict[str, VolumeIntegrals] | None = field(default=None, repr=False)
    #: Derivative of g with respect to the densities of this rank's cells, shape (cells,), by name
    #: of the body; None where only values were asked for, or where no body has a density.
    gradient: dict[str, Array] | None = field(default=None, repr=False)
    #: The part of it at fixed integrals, likewise; a body that does not matter may be missing.
    density_gradient: dict[str, Array] | None = field(default=None, repr=False)
    #: Derivative of g with respect to the stress of bodies for unit coordinates, likewise, shape
    #: (cells, points, 3, coordinates).
    stress_gradient: dict[str, Array] | None = field(default=None, repr=False)


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
    #: Densities of the bodies that have one, by name.
    densities: Mapping[str, DensityField] = field(default_factory=dict, repr=False)
    #: Derivative of psi with respect to the densities at fixed integrals, shape (cells,) for the
    #: cells of this rank, by name of the body; a body that does not matter may be missing. None
    #: where only values were asked for.
    density_gradient: dict[str, Array] | None = field(default=None, repr=False)
    #: Stress of the bodies that have a mesh, by name.
    stresses: Mapping[str, StressField] = field(default_factory=dict, repr=False)
    #: Derivative of psi with respect to it, shape (cells, points, 3, coordinates), likewise.
    stress_gradient: dict[str, Array] | None = field(default=None, repr=False)

    @property
    def response(self) -> Response:
        """What the objectives are functions of."""
        return Response(self.trajectory, self.bodies, self.densities, self.stresses)


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
        TypeError: If an argument is of a wrong kind.
        ValueError: If two constraints have the same name.
    """

    #: Joints, motions, point masses, gravity.
    mechanism: Mechanism
    #: Time interval and steps; of a :class:`TimeInterval` they are chosen for the bodies at each
    #: call, or once by :meth:`settled`.
    integrator: Integrator
    #: What is minimised.
    objective: Objective
    #: Bounds on further objectives.
    constraints: Sequence[Constraint] = ()

    def __post_init__(self) -> None:
        """Check kinds and names."""
        validation.instance("problem: the mechanism", self.mechanism, Mechanism, "a Mechanism")
        needed = "GeneralizedAlpha(...), RadauIIA(...) or TimeInterval(...)"
        validation.instance("problem: the integrator", self.integrator, Integrator, needed)
        check_objective("problem: the objective", self.objective)
        constraints = validation.instances(
            "problem: constraints", self.constraints, Constraint, "constraints"
        )
        object.__setattr__(self, "constraints", constraints)
        labels = [constraint.label for constraint in constraints]
        twice = sorted({label for label in labels if labels.count(label) > 1})
        if twice:
            raise ValueError(f"two constraints have the name {twice[0]!r}; name them apart")

    @property
    def needs_trajectory(self) -> bool:
        """Whether the objective or a constraint depends on the motion."""
        objectives = [self.objective, *(c.objective for c in self.constraints)]
        return any(objective.needs_trajectory for objective in objectives)

    def value(
        self,
        bodies: Bodies,
        densities: Mapping[str, DensityField] | None = None,
        stresses: Mapping[str, StressField] | None = None,
    ) -> MechanicalEvaluation:
        """Objective and constraints; nothing is simulated if none depends on the motion.

        Args:
            bodies: Volume integrals of all bodies, by name.
            densities: Densities of the bodies that have one, for objectives that depend on them.
            stresses: Stress of the bodies that have a mesh, likewise.

        Raises:
            ValueError: If a name does not exist, integrals are not valid, or a body that must
                deform is rigid.
            SimulationError: If the motion cannot be computed.
        """
        start = perf_counter()
        self.validate_names({name: integrals.markers for name, integrals in bodies.items()})
        self.validate_modes({name: integrals.modes for name, integrals in bodies.items()})
        trajectory = self.settled(bodies, densities, stresses).motion(bodies)
        found = self.evaluated(Response(trajectory, dict(bodies), densities or {}, stresses or {}))
        return replace(found, seconds={"simulation": perf_counter() - start})

    def validate_names(self, markers: Mapping[str, Collection[str]]) -> None:
        """Refuse objectives and constraints of bodies, markers and joints that do not exist.

        Args:
            markers: Names of the markers by name of the body, of all bodies.

        Raises:
            ValueError: If a name does not exist; the message lists those that do.
        """
        for objective in self.objectives.values():
            objective.validate_names(markers, list(self.mechanism.joint_names))

    def validate_modes(self, modes: Mapping[str, int]) -> None:
        """Refuse objectives and constraints of bodies with too few elastic coordinates.

        Args:
            modes: Their number by name of the body, of all bodies; 0 of rigid ones.

        Raises:
            ValueError: If a body that must deform is rigid, or has too few coordinates.
        """
        for objective in self.objectives.values():
            objective.validate_modes(modes)

    def settled(
        self,
        bodies: Bodies,
        densities: Mapping[str, DensityField] | None = None,
        stresses: Mapping[str, StressField] | None = None,
    ) -> MechanicalProblem:
        """The same problem with the method and the steps that a :class:`TimeInterval` takes.

        Args:
            bodies: Volume integrals of all bodies, by name.
            densities: As for :meth:`value`.
            stresses: As for :meth:`value`.

        Returns:
            The problem itself where it has an integrator, or needs none.

        Raises:
            ValueError: If a name does not exist or integrals are not valid.
            SimulationError: If the motion cannot be computed, or the tolerance is not reached.
        """
        if not isinstance(self.integrator, TimeInterval) or not self.needs_trajectory:
            return self
        chosen = self.integrator.chosen(*self._judged(bodies, densities, stresses))
        return replace(self, integrator=chosen)

    def _judged(
        self,
        bodies: Bodies,
        densities: Mapping[str, DensityField] | None,
        stresses: Mapping[str, StressField] | None,
    ) -> tuple[Callable[[Integrator], Trajectory], Callable[[Trajectory, Trajectory], float]]:
        """What simulates with a method, and the change of the objectives between two motions."""

        def change(*motions: Trajectory) -> float:
            return self._change(
                *(Response(motion, bodies, densities or {}, stresses or {}) for motion in motions)
            )

        return lambda method: integrate(self.mechanism, bodies, method), change

    def motion(self, bodies: Bodies) -> Trajectory | None:
        """The motion; None if neither objective nor constraints depend on it.

        Args:
            bodies: Volume integrals of all bodies, by name.

        Raises:
            ValueError: As :meth:`value` does.
            SimulationError: As :meth:`value` does.
        """
        if self.needs_trajectory:
            return simulate(self.mechanism, bodies, self.integrator)
        for name, integrals in bodies.items():
            integrals.validate(name)
        return None

    def evaluated(self, response: Response) -> MechanicalEvaluation:
        """Objective and constraints of a motion that is known.

        Args:
            response: What they are functions of.

        Raises:
            ValueError: If a name does not exist.
        """
        constraints = {}
        for constraint in self.constraints:
            psi = constraint.objective.evaluate(response)
            constraints[constraint.label] = ConstraintValue(constraint.scaled(psi), psi)
        return MechanicalEvaluation(
            psi=self.objective.evaluate(response),
            integrals_gradient=None,
            constraints=constraints,
            trajectory=response.trajectory,
            bodies=dict(response.bodies),
            seconds={},
            densities=response.densities,
            stresses=response.stresses,
        )

    def calibrated(self, response: Response) -> MechanicalProblem:
        """The problem with objectives corrected at a design, see `Objective.calibrated`.

        Args:
            response: Of the design.

        Returns:
            The problem itself where none is to be corrected.
        """
        objective = self.objective.calibrated(response)
        constraints = [constraint.calibrated(response) for constraint in self.constraints]
        same = all(a is b for a, b in zip(constraints, self.constraints, strict=True))
        if objective is self.objective and same:
            return self
        return replace(self, objective=objective, constraints=constraints)

    def time_error(self, evaluation: MechanicalEvaluation) -> float:
        """An estimate of the relative error that the time steps make in psi.

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
            return integrate(self.mechanism, bodies, integrator)

        coarse = coarser_run(fine.integrator, fine, run)
        return self._change(evaluation.response, replace(evaluation.response, trajectory=coarse))

    def with_tolerance(
        self,
        bodies: Bodies,
        tolerance: float,
        densities: Mapping[str, DensityField] | None = None,
        stresses: Mapping[str, StressField] | None = None,
    ) -> MechanicalProblem:
        """The same problem with steps for an accuracy of psi.

        Fixed steps are halved and the tolerance of adaptive ones falls until :meth:`time_error`
        meets the tolerance and, with :class:`RadauIIA`, no single step adds a larger error. Choose
        once, and keep the steps while designing.

        Args:
            bodies: Volume integrals of all bodies, by name.
            tolerance: Largest relative error of the objective and of those that are bounded.
            densities: As for :meth:`value`.
            stresses: As for :meth:`value`.

        Raises:
            ValueError: If a name does not exist or a number is not valid.
            SimulationError: If the motion cannot be computed, or the tolerance is not reached; the
                message says what was.
        """
        if not self.needs_trajectory:
            return self
        if isinstance(self.integrator, TimeInterval):
            interval = TimeInterval(self.integrator.end_time, tolerance)
            return replace(self, integrator=interval).settled(bodies, densities, stresses)
        judged = self._judged(bodies, densities, stresses)
        integrator, _ = run_to_tolerance(self.integrator, tolerance, *judged, "the objective")
        return replace(self, integrator=integrator)

    def _change(self, fine: Response, coarse: Response) -> float:
        """The largest relative change of the objective and of those that are bounded."""
        changes = [0.0]
        for objective in (self.objective, *(c.objective for c in self.constraints)):
            if objective.needs_trajectory:
                here, there = (objective.evaluate(response) for response in (fine, coarse))
                changes.append(abs(here - there) / (abs(here) or 1.0))
        return max(changes)

    def gradient(self, bodies: Bodies) -> MechanicalEvaluation:
        """Objective and constraints with their exact derivatives.

        Args:
            bodies: Volume integrals of all bodies, by name.

        Raises:
            ValueError: As :meth:`value` does.
            SimulationError: As :meth:`value` does.
        """
        return self.differentiate(self.value(bodies))

    def differentiate(self, evaluation: MechanicalEvaluation) -> MechanicalEvaluation:
        """An evaluation with the exact derivatives added.

        So a design whose value is rejected need not be differentiated.

        Args:
            evaluation: What :meth:`value` returned.
        """
        start = perf_counter()
        parts = {}
        for label, objective in self.objectives.items():
            direct, motion = parts_of_gradient(objective, evaluation.response)
            parts[label] = replace(direct, trajectory=None), motion  # that is large, and done with
        found = self.differentiated(evaluation, parts)
        return replace(found, seconds={**evaluation.seconds, "adjoint": perf_counter() - start})

    @property
    def objectives(self) -> dict[str, Objective]:
        """Those of the constraints by their labels, and the one that is minimised as ""."""
        return {**{c.label: c.objective for c in self.constraints}, "": self.objective}

    def differentiated(
        self,
        evaluation: MechanicalEvaluation,
        parts: Mapping[str, tuple[Derivatives, Mapping[str, VolumeIntegrals]]],
    ) -> MechanicalEvaluation:
        """An evaluation with derivatives that are known.

        Args:
            evaluation: What :meth:`value` returned.
            parts: Of `objectives`, both parts of `parts_of_gradient`; that of the objective which
                is minimised may be missing.
        """
        constraints = {}
        for constraint in self.constraints:
            direct, motion = parts[constraint.label]
            bars, slope = _with_direct(motion, direct), constraint.slope
            constraints[constraint.label] = replace(
                evaluation.constraints[constraint.label],
                integrals_gradient={name: bar.scaled(slope) for name, bar in bars.items()},
                density_gradient={name: slope * bar for name, bar in direct.densities.items()},
                stress_gradient={name: slope * bar for name, bar in direct.stresses.items()},
            )
        found = replace(evaluation, constraints=constraints)
        if "" not in parts:
            return found
        direct, motion = parts[""]
        return replace(
            found,
            integrals_gradient=_with_direct(motion, direct),
            density_gradient=dict(direct.densities),
            stress_gradient=dict(direct.stresses),
        )


def _with_direct(
    motion: Mapping[str, VolumeIntegrals], direct: Derivatives
) -> dict[str, VolumeIntegrals]:
    """Derivatives with respect to all integrals, through the motion and at fixed motion."""
    own = direct.integrals
    return {name: own[name] + bar if name in own else bar for name, bar in motion.items()}


def parts_of_gradient(
    objective: Objective, response: Response
) -> tuple[Derivatives, dict[str, VolumeIntegrals]]:
    """The derivatives of an objective, in two parts.

    Args:
        objective: The objective.
        response: Motion, integrals and densities.

    Returns:
        The partial derivatives, and by name of the body those with respect to the integrals
        through the motion (all bodies).
    """
    direct = objective.derivatives(response)
    return direct, through_motion(direct.trajectory, response)


def through_motion(bar: TrajectoryBar | None, response: Response) -> dict[str, VolumeIntegrals]:
    """The derivatives of a number with respect to the integrals through the motion, by body.

    Args:
        bar: Its derivatives with respect to the motion; None where it does not matter.
        response: Motion and integrals.
    """
    trajectory = response.trajectory
    if trajectory is not None and bar is not None and _matters(bar):
        return adjoint(trajectory, bar)
    return {name: integrals.zeros_like() for name, integrals in response.bodies.items()}


def _matters(bar: TrajectoryBar) -> bool:
    """Whether an entry is not zero; NaN counts, so that it is reported."""
    return any(np.any(part) for part in (bar.y, bar.v, bar.w, bar.multipliers))
