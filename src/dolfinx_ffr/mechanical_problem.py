# SPDX-License-Identifier: MIT
"""From the volume integrals of the bodies to psi and constraints, and back; no mesh is needed.

    volume integrals -> trajectory -> psi and constraints
      integrals_bar  <- discrete adjoint <-

Several numbers share one simulation; each has an adjoint pass of its own. A number that does not
depend on the trajectory, such as a mass, causes neither.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from time import perf_counter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from . import validation
from .arrays import Array, summed
from .body import VolumeIntegrals
from .dynamics import (
    Bars,
    FlatModel,
    Integrator,
    StepChoice,
    StepSearch,
    TimeInterval,
    TimeStepWarning,
    Trajectory,
    adjoint,
    assemble_model,
    fixed_slopes,
    integrate,
    load_cells,
    parameter_slopes,
    simulate,
)
from .mechanism import Mechanism, ParametricMechanism
from .objective import (
    Constraint,
    Derivatives,
    Inventory,
    Objective,
    Response,
    check_objective,
    derivatives_of,
    value_of,
)

Bodies = Mapping[str, VolumeIntegrals]
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, kw_only=True)
class Gradients:
    """Derivatives of one number with respect to all that is designed.

    Attributes:
        gradient: By body for the density of each cell owned by this rank, shape (cells,), and by
            `Evaluation.label` for all parameters, shape (parameters,); None where it was not asked
            for.
        nodes: By body for each node of the mesh on this rank in the order of ``mesh.geometry.x``,
            ghosts included, shape (nodes, dimension); None where it was not asked for.
        centers: By body for the center of each interface, at fixed nodes, in the order of
            ``domain.interfaces``, shape (interfaces, dimension), the same on every rank; None where
            it was not asked for.
        parameters: By name for each parameter of the mechanism, the same on every rank.
    """

    gradient: dict[str, Array] | None = field(default=None, repr=False)
    nodes: dict[str, Array] | None = field(default=None, repr=False)
    centers: dict[str, Array] | None = field(default=None, repr=False)
    parameters: dict[str, float] = field(default_factory=dict, repr=False)

    @staticmethod
    def weighted_sum(terms: Mapping[str, Gradients], weights: Mapping[str, float]) -> Gradients:
        """The sum of ``terms`` times their ``weights``, both by name."""

        def total(name: str) -> dict[str, Any]:
            scaled = [
                {key: weights[term] * value for key, value in (getattr(g, name) or {}).items()}
                for term, g in terms.items()
            ]
            return reduce(summed, scaled, {})

        return Gradients(
            gradient=total("gradient") or None,
            nodes=total("nodes") or None,
            centers=total("centers") or None,
            parameters=total("parameters"),
        )


@dataclass(frozen=True)
class ConstraintValue(Gradients):
    """A constraint at one design, with the gradients of its violation.

    It is satisfied where ``violation`` is not positive.

    Attributes:
        value: The objective that is bounded, in its own unit.
        violation: g, the distance of the value from the bound relative to the bound; at most zero
            where the bound holds.
        derivatives: Derivatives of g as a function of the bodies, the trajectory eliminated; None
            where only values were asked for. The large one by the stress is left out where
            ``gradient`` is known.
    """

    value: float
    violation: float
    derivatives: Derivatives | None = field(default=None, repr=False)

    @property
    def integrals_gradient(self) -> dict[str, VolumeIntegrals] | None:
        """Derivative of g with respect to the integrals, by name of the body, or None."""
        return None if self.derivatives is None else dict(self.derivatives.integrals)


@dataclass(frozen=True)
class MechanicalEvaluation:
    """Objective and constraints of a mechanism, and their derivatives.

    Attributes:
        psi: Value of the objective, in its unit.
        constraints: Constraints by name.
        response: Trajectory and bodies.
        seconds: Time spent by name of the part [s].
        derivatives: Derivatives of psi as a function of the bodies, the trajectory eliminated; None
            where only values were asked for.
    """

    psi: float
    constraints: dict[str, ConstraintValue]
    response: Response = field(repr=False)
    seconds: dict[str, float] = field(default_factory=dict)
    derivatives: Derivatives | None = field(default=None, repr=False)

    @property
    def trajectory(self) -> Trajectory | None:
        """The trajectory; None if neither objective nor constraints depend on it."""
        return self.response.simulated

    @property
    def integrals_gradient(self) -> dict[str, VolumeIntegrals] | None:
        """Derivative of psi with respect to the integrals by name of the body, markers included."""
        return None if self.derivatives is None else dict(self.derivatives.integrals)

    @property
    def parameters(self) -> dict[str, float]:
        """Derivative of psi with respect to the parameters of the mechanism, by name."""
        return {} if self.derivatives is None else dict(self.derivatives.parameters)


@dataclass(frozen=True)
class MechanicalProblem:
    """An objective and constraints of a mechanism's motion, as functions of the volume integrals.

    It takes bodies that are given by arrays, from a file (:meth:`VolumeIntegrals.load`), from a
    formula (:class:`ParametricBody`) or from another code; neither a mesh nor DOLFINx is needed.
    The mechanism may have :class:`Parameters`, by which evaluations have derivatives, too.

    Example:
        >>> problem = MechanicalProblem(mechanism, integrator, IntegralCompliance())
        >>> evaluation = problem.gradient({"rod": VolumeIntegrals.load("rod.npz")})
        >>> evaluation.psi, evaluation.integrals_gradient["rod"].K

    Attributes:
        mechanism: Joints, motions, point masses, gravity.
        integrator: Time interval and steps; of a :class:`TimeInterval` they are chosen for the
            bodies at each call, or once by :meth:`with_chosen_steps`.
        objective: The objective to minimise.
        constraints: Bounds on further objectives.
    """

    mechanism: Mechanism
    integrator: Integrator | TimeInterval
    objective: Objective
    constraints: Sequence[Constraint] = ()

    def __post_init__(self) -> None:
        validation.instance("problem: the mechanism", self.mechanism, Mechanism, "a Mechanism")
        needed = "GeneralizedAlpha(...), RadauIIA(...) or TimeInterval(...)"
        kinds = (Integrator, TimeInterval)
        validation.instance("problem: the integrator", self.integrator, kinds, needed)
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
    def method(self) -> Integrator:
        """The time integration with its steps, which a :class:`TimeInterval` leaves open."""
        if isinstance(self.integrator, TimeInterval):
            raise TypeError(
                "a TimeInterval has no steps before they are chosen for an objective: call "
                "MechanicalProblem.with_chosen_steps(bodies), or give an integrator"
            )
        return self.integrator

    @property
    def needs_trajectory(self) -> bool:
        """Whether the objective or a constraint depends on the trajectory."""
        objectives = [self.objective, *(c.objective for c in self.constraints)]
        return any(objective.needs_trajectory for objective in objectives)

    @property
    def objectives(self) -> dict[str, Objective]:
        """All objectives: the bounded ones by constraint label, the minimised one under ''."""
        return {**{c.label: c.objective for c in self.constraints}, "": self.objective}

    def validate(self, inventory: Inventory) -> None:
        """Refuse, by a ValueError, an ``inventory`` that lacks what an objective names."""
        with_joints = replace(inventory, joints=list(self.mechanism.joint_names))
        for objective in self.objectives.values():
            objective.validate(with_joints)

    def value(self, bodies: Bodies | Response) -> MechanicalEvaluation:
        """Objective and constraints; nothing is simulated if none depends on the trajectory.

        Args:
            bodies: Volume integrals of all bodies, by name; or a `Response` without a trajectory,
                for objectives that depend on densities or stress.

        Raises:
            ValueError: If a name does not exist, integrals are not valid, or a body that must
                deform is rigid.
            SimulationError: If the trajectory cannot be computed.
        """
        start, response = perf_counter(), self.response(bodies)
        self.validate(response.inventory)
        trajectory = self.with_chosen_steps(response).trajectory(response.bodies)
        evaluation = self.evaluated(replace(response, simulated=trajectory))
        return replace(evaluation, seconds={"simulation": perf_counter() - start})

    def at(self, values: ArrayLike | Mapping[str, float]) -> MechanicalProblem:
        """The same problem at other values of the mechanism's parameters, see `Parameters.at`.

        It is the problem itself if the mechanism has none. It raises the errors of
        `Parameters.at` and `Parameters.mechanism`.
        """
        if not isinstance(self.mechanism, ParametricMechanism):
            return self
        mechanism = self.mechanism.at(values)
        return self if mechanism is self.mechanism else replace(self, mechanism=mechanism)

    def response(self, bodies: Bodies | Response) -> Response:
        """The arguments of the objectives before a simulation, the mechanism's bodies included."""
        response = bodies if isinstance(bodies, Response) else Response(None, dict(bodies))
        every_body = {**response.bodies, **self.mechanism.own_bodies}
        return replace(response, bodies=every_body, point_masses=self.mechanism.point_masses)

    def trajectory(self, bodies: Bodies) -> Trajectory | None:
        """The trajectory of ``bodies``, by name; None if nothing depends on it.

        It raises what :meth:`value` raises.
        """
        if self.needs_trajectory:
            return simulate(self.mechanism, bodies, self.integrator)
        for name, integrals in bodies.items():
            integrals.validate(name)
        return None

    def evaluated(self, response: Response) -> MechanicalEvaluation:
        """Objective and constraints of a ``response`` whose trajectory is known."""
        constraints = {}
        for constraint in self.constraints:
            psi = value_of(constraint.objective, response, f"constraint {constraint.label!r}: ")
            constraints[constraint.label] = ConstraintValue(psi, constraint.scaled(psi))
        return MechanicalEvaluation(value_of(self.objective, response), constraints, response)

    def gradient(self, bodies: Bodies | Response) -> MechanicalEvaluation:
        """Objective and constraints with exact derivatives; ``bodies`` as for :meth:`value`."""
        return self.differentiate(self.value(bodies))

    def differentiate(self, evaluation: MechanicalEvaluation) -> MechanicalEvaluation:
        """Add the exact derivatives to an ``evaluation``.

        So a design whose value is rejected need not be differentiated.
        """
        start, response = perf_counter(), evaluation.response
        direct = self.partial(response)
        adjoints = dict[str, Bars]()
        for label, partial in direct.items():
            if depends_on_motion(partial, response):
                adjoints[label] = adjoint(response.trajectory, partial.trajectory)  # type: ignore[arg-type]
        indirect = through_trajectory(response, direct, adjoints)
        total = {
            label: partial.without_trajectory(indirect[label]) for label, partial in direct.items()
        }
        constraints = {}
        for constraint in self.constraints:
            derivatives = total[constraint.label].scaled(constraint.slope)
            constraints[constraint.label] = replace(
                evaluation.constraints[constraint.label],
                derivatives=derivatives,
                parameters=dict(derivatives.parameters),
            )
        seconds = {**evaluation.seconds, "adjoint": perf_counter() - start}
        return replace(evaluation, constraints=constraints, derivatives=total[""], seconds=seconds)

    def partial(
        self, response: Response, labels: Collection[str] | None = None, of: str = ""
    ) -> dict[str, Derivatives]:
        """Partial derivatives of the objectives at a ``response``, by label; None means all labels.

        Derivatives by parameters, at fixed trajectory, are among them. Names of constraints begin
        with the text ``of`` in messages.
        """
        objectives = {n: o for n, o in self.objectives.items() if labels is None or n in labels}
        derivatives = {
            label: derivatives_of(
                objective, response, f"constraint {of + label!r}: " if label else ""
            )
            for label, objective in objectives.items()
        }
        mechanism, trajectory = self.mechanism, response.simulated
        if not isinstance(mechanism, ParametricMechanism) or not objectives:
            return derivatives

        times = np.array([0.0, self.integrator.end_time])
        model = (
            trajectory.model if trajectory else assemble_model(mechanism, response.bodies, times)
        )

        def as_function_of_model(objective: Objective) -> Callable[[FlatModel], float]:
            """The objective at fixed coordinates, as a function of the model."""

            def value(changed: FlatModel) -> float:
                return value_of(
                    objective,
                    replace(
                        response,
                        simulated=None
                        if trajectory is None
                        else replace(trajectory, model=changed),
                        bodies={name: changed.bodies[name] for name in response.bodies},
                        point_masses=changed.mechanism.point_masses,
                    ),
                )

            return value

        slopes = fixed_slopes(model, [as_function_of_model(o) for o in objectives.values()])
        for (label, partial), row in zip(derivatives.items(), slopes.tolist(), strict=True):
            by_parameter = dict(zip(mechanism.parameters.names, row, strict=True))
            derivatives[label] = replace(partial, parameters=by_parameter)
        return derivatives

    def calibrated(
        self, evaluation: MechanicalEvaluation
    ) -> tuple[MechanicalProblem, MechanicalEvaluation]:
        """The problem and an ``evaluation`` with objectives that are corrected at these bodies.

        As by `Problem.calibrated`, both are returned unchanged where no objective is corrected.
        """
        problem = self.calibrated_at(evaluation.response)
        if problem is self:
            return self, evaluation
        return problem, replace(
            problem.evaluated(evaluation.response), seconds=dict(evaluation.seconds)
        )

    def calibrated_at(self, response: Response) -> MechanicalProblem:
        """The problem with objectives corrected at a ``response``, see `Objective.calibrated`.

        The problem itself is returned where no objective is corrected.
        """
        objective = self.objective.calibrated(response)
        constraints = [constraint.calibrated(response) for constraint in self.constraints]
        unchanged = all(new is old for new, old in zip(constraints, self.constraints, strict=True))
        if objective is self.objective and unchanged:
            return self
        return replace(self, objective=objective, constraints=constraints)

    def parted(self, response: Response) -> MechanicalProblem:
        """The problem with `Constraint.parts` at a ``response`` in place of each constraint."""
        return self._split([constraint.parts(response) for constraint in self.constraints])

    def placed(self, response: Response) -> MechanicalProblem:
        """The problem with `Constraint.places` at a ``response`` in place of each constraint."""
        return self._split([constraint.places(response) for constraint in self.constraints])

    def _split(self, groups: list[list[Constraint]]) -> MechanicalProblem:
        """The problem with a group of constraints in place of each; itself if no group has two."""
        constraints = [constraint for group in groups for constraint in group]
        if len(constraints) == len(self.constraints):
            return self
        return replace(self, constraints=constraints)

    def with_chosen_steps(self, bodies: Bodies | Response) -> MechanicalProblem:
        """The same problem with a method and steps in the place of a :class:`TimeInterval`.

        They are chosen for ``bodies`` as for :meth:`value`, which raises the same errors. The
        problem itself is returned where it has an integrator, or needs none. A tolerance out of
        reach is a `TimeStepWarning`.
        """
        if not isinstance(self.integrator, TimeInterval) or not self.needs_trajectory:
            return self
        return self.with_steps(self.choose_steps(bodies, self.integrator))

    def with_steps(self, choice: StepChoice) -> MechanicalProblem:
        """The same problem with method and steps of a ``choice``; warns if they do not suffice."""
        if not choice.met:
            warnings.warn(choice.doubt, TimeStepWarning, stacklevel=3)
        return replace(self, integrator=choice.integrator)

    def choose_steps(self, bodies: Bodies | Response, interval: TimeInterval) -> StepChoice:
        """Method and steps that reach an accuracy, and an estimate of their error.

        Args:
            bodies: As for :meth:`value`; the method of a `Response` with a trajectory stays where
                it suffices.
            interval: The time interval and the accuracy.
        """
        response = self.response(bodies)
        search = self._step_search(response, interval.end_time)
        return search.chosen(interval.tolerance, response.simulated)

    def with_tolerance(self, bodies: Bodies | Response, tolerance: float) -> MechanicalProblem:
        """The same problem with a method and steps for an accuracy of psi.

        They are chosen at these ``bodies`` as a :class:`TimeInterval` chooses, whatever the present
        integrator is.

        Args:
            bodies: As for :meth:`value`.
            tolerance: Largest relative error of the objective and of bounded ones.

        Warns:
            TimeStepWarning: If the tolerance is not reached; it says what was.
        """
        if not self.needs_trajectory:
            return self
        interval = TimeInterval(self.integrator.end_time, tolerance)
        return self.with_steps(self.choose_steps(bodies, interval))

    def time_error(self, response: Response) -> float:
        """An estimate of the largest relative error by time steps, of psi and bounded objectives.

        They are computed once more, by two methods that treat vibrations in opposite ways, with
        shorter and shorter steps until both agree five times as well. So vibrations that the steps
        have lost are found, too, at the price of some simulations.

        Args:
            response: The `MechanicalEvaluation.response` of an evaluation.

        Raises:
            SimulationError: If no trajectory with other steps is found.
        """
        trajectory = response.simulated
        if trajectory is None:
            return 0.0
        return self._step_search(response, float(trajectory.t[-1])).error_of(trajectory)

    def _step_search(self, response: Response, end_time: float) -> StepSearch:
        """The search of steps for the objectives of a ``response`` that depend on the motion."""
        objectives = [o for o in self.objectives.values() if o.needs_trajectory]

        def run(method: Integrator) -> Trajectory:
            return integrate(self.mechanism, response.bodies, method)

        def judge(trajectory: Trajectory) -> Array:
            simulated = replace(response, simulated=trajectory)
            return np.array([value_of(objective, simulated) for objective in objectives])

        cells, damped = load_cells(self.mechanism, response.bodies, end_time)
        return StepSearch(run, judge, cells, damped=damped)


def through_trajectory(
    response: Response, keys: Collection[Key], adjoints: Mapping[Key, Bars]
) -> dict[Key, Derivatives]:
    """Derivatives through the trajectory of a ``response``: by all integrals, and by parameters.

    Each of the ``keys``, of any kind, stands for a number. Where it has no adjoint the derivatives
    are zero.
    """
    derivatives, by_parameters = dict[Key, Derivatives](), dict[Key, dict[str, float]]()
    if adjoints and isinstance(response.trajectory.model.mechanism, ParametricMechanism):
        names = response.trajectory.model.mechanism.parameters.names
        bars = [bar.mechanism for bar in adjoints.values()]
        for key, row in zip(adjoints, parameter_slopes(response.trajectory, bars), strict=True):
            by_parameters[key] = dict(zip(names, row.tolist(), strict=True))
    for key in keys:
        bodies = adjoints[key].bodies if key in adjoints else None
        zeros = {name: body.zeros_like() for name, body in response.bodies.items()}
        derivatives[key] = Derivatives(
            integrals=bodies or zeros, parameters=by_parameters.get(key, {})
        )
    return derivatives


def depends_on_motion(direct: Derivatives, response: Response) -> bool:
    """Whether a number depends on the trajectory of a ``response``, by its partial derivatives."""
    bar = direct.trajectory
    if response.simulated is None or bar is None:
        return False
    # NaN counts, so that it is reported
    return any(np.any(array) for array in (bar.y, bar.v, bar.w, bar.multipliers))
