# SPDX-License-Identifier: MIT
"""The whole chain: from the densities of the bodies to one number, and its exact gradient back.

    density -> shape functions -> volume integrals -> trajectory -> psi
       x_bar <-   Phi_bar      <-   arrays_bar     <- discrete adjoint <-

The gradient belongs to the computed number, mesh and time steps included: each map applies the
transpose of its derivative. Its cost does not depend on the number of densities.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from time import perf_counter
from typing import Any, Self

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import summed
from ..body import VolumeIntegrals
from ..dynamics import (
    INTEGRATORS,
    Integrator,
    SimulationError,
    TimeInterval,
    Trajectory,
    check_names,
    compile_kernels,
)
from ..mechanical_problem import ConstraintValue, Gradients, MechanicalProblem
from ..mechanism import Mechanism, TopologyError
from ..objective import (
    Combination,
    Constraint,
    Derivatives,
    Objective,
    Response,
    StressField,
    WeightedSum,
    value_of,
)
from ..parallel import agreed_memory, alike, check_alike, on_every_rank
from .bodies import Body, Densities, DesignedBodies, Pullback
from .evaluation import Evaluation, LoadCaseEvaluation, only_case
from .load_cases import check_influence, parametric, shared, split_parameters, weighted
from .own_objectives import check_integrals, replicated
from .spread import (
    WORK,
    Job,
    adjoints,
    checked_memory,
    trajectories,
    with_better_steps,
    with_first_steps,
)

#: From a load case and its response to another load case
Change = Callable[[MechanicalProblem, Response], MechanicalProblem]
#: Name of a load case that is the only one
LOAD_CASE = "load case"
#: Relative difference above which two ranks have computed different numbers: round-off, magnified
#: by a simulation, stays far below
DIFFERS = 1e-6
#: Remedy for evaluations of other problems
GIVE_BOTH = "give a problem with its own evaluation, as result.problem and result.evaluation"


class Problem:
    """Minimise psi(x): an objective of a mechanism's motion as a function of its bodies' densities.

        psi(x) = objective(trajectory),   the trajectory solves the equations of motion
                                          of the mechanism with bodies(x)

    Constraints g_k(x) <= 0 come from the same simulation, each with an adjoint pass of its own
    where it depends on the trajectory. Without any flexible body use `MechanicalProblem`, or
    design the `Parameters` of the mechanism.

    Args:
        bodies: By the names that the mechanism uses; `FlexibleBody` for bodies with a density,
            `VolumeIntegrals` for given ones (rigid bodies, standard input data).
        mechanism: Joints, motions, point masses, gravity; made of `Parameters`, psi and
            constraints have derivatives by these, too.
        integrator: Time interval and steps, or a `TimeInterval` for which steps are chosen.
        objective: The objective to minimise.
        constraints: Bounds on further objectives, for optimisers that take several.

    Raises:
        ValueError: If there are neither densities nor parameters, two constraints have the same
            name, or an objective depends on the density of a body that has none.
        MemoryError: If the trajectory would take more memory than a machine has.
    """

    def __init__(
        self,
        bodies: Mapping[str, Body],
        mechanism: Mechanism,
        integrator: Integrator | TimeInterval,
        objective: Objective,
        constraints: Sequence[Constraint] = (),
    ) -> None:
        def cases() -> dict[str, MechanicalProblem]:
            return {LOAD_CASE: MechanicalProblem(mechanism, integrator, objective, constraints)}

        self._set(bodies, cases, WeightedSum())

    @classmethod
    def of_load_cases(
        cls,
        bodies: Mapping[str, Body],
        load_cases: Mapping[str, MechanicalProblem],
        combine: Combination | None = None,
    ) -> Self:
        """A problem of several load cases of the same bodies, whose objectives become one number.

            psi(x) = combine(psi_1(x), psi_2(x), ...)

        Bodies are reduced once a design, whatever the number of load cases, and the derivatives of
        all go back to the densities together. The load cases are spread over the ranks.

        Args:
            bodies: Bodies by the names that the mechanisms use.
            load_cases: By name, each with a mechanism, an integrator, an objective and
                constraints of its own; the constraints of all must hold.
            combine: How the objectives become one; by default their sum, `WeightedSum()`.

        Raises:
            ValueError: As for one load case; and if a mechanism names a body that is not there, or
                the weights do not fit the load cases.
            MemoryError: If the trajectories would take more memory than a machine has.
        """
        problem = cls.__new__(cls)
        problem._set(bodies, lambda: load_cases, WeightedSum() if combine is None else combine)
        return problem

    def _set(
        self,
        bodies: Mapping[str, Body],
        cases: Callable[[], Mapping[str, MechanicalProblem]],
        combine: Combination,
    ) -> None:
        """Check and set bodies and load cases; `cases` is called where errors reach all ranks."""
        self._designed = DesignedBodies(bodies)
        with on_every_rank(self.comm, WORK):
            #: Load cases by name
            self.load_cases = validation.instances_by_name(
                "problem: load cases", cases(), MechanicalProblem, "a MechanicalProblem"
            )
            if not self.load_cases:
                raise ValueError("problem: give at least one load case")
            needed = "WeightedSum(...), PowerMean(...) or WorstCase(...)"
            #: How the objectives of the load cases become one number
            self.combine = validation.instance("problem: combine", combine, Combination, needed)
            combine.check(self.load_cases)
            #: The parameters of the mechanisms, with their values, or None
            self.parameters = shared(self.load_cases)
            stated = [mechanism.own_bodies for mechanism in parametric(self.load_cases).values()]
            self._designed = DesignedBodies({k: b for m in (bodies, *stated) for k, b in m.items()})
            self.bodies = self._designed.every
            #: The bodies with a density
            self.flexible = self._designed.flexible
            if not self.flexible and self.parameters is None:
                raise ValueError(
                    f"problem: none of the bodies {sorted(bodies)} has a density to design; give "
                    "at least one FlexibleBody, or ffr.Parameters of the mechanism, or use "
                    "MechanicalProblem, which needs none"
                )
            inventory = self._designed.inventory()
            for name, case in self.load_cases.items():
                try:
                    check_names(case.mechanism, inventory.modes, inventory.markers)
                    case.validate(inventory)
                except ValueError as error:
                    if len(self.load_cases) == 1:
                        raise
                    raise ValueError(f"load case {name!r}: {error}") from error
        arguments = {
            "bodies": list(bodies),
            "load_cases": list(self.load_cases),
            "combine": combine,
        }
        integrators = {
            self._of("the integrator", name): case.integrator
            for name, case in self.load_cases.items()
        }
        check_alike(self.comm, "problem", arguments | integrators)
        self._memory = agreed_memory(self.comm)
        self._prepare()

    def _prepare(self) -> None:
        """Compile, choose the steps that are left open, and refuse more than the memory holds."""
        checked_memory(self._designed, self.load_cases, self._memory, adjoint=False)
        cases = self.load_cases.values()
        left_open = any(isinstance(case.integrator, TimeInterval) for case in cases)
        integrators = INTEGRATORS if left_open else tuple({type(case.method) for case in cases})
        if self.comm.rank == 0:  # the others load it from the cache
            compile_kernels(integrators=integrators)
        self.comm.Barrier()
        compile_kernels(lambda line: None, integrators=integrators)
        with_steps = with_first_steps(self._designed, self.load_cases)
        if any(with_steps[name] is not case for name, case in self.load_cases.items()):
            self.load_cases = with_steps
            checked_memory(self._designed, self.load_cases, self._memory, adjoint=False)

    def alone(self, load_case: str) -> Self:
        """The problem of one ``load_case``, by its name, for `Evaluation.alone`."""
        validation.choice("problem: load case", load_case, self.load_cases)
        return self.of_load_cases(self.bodies, {load_case: self.load_cases[load_case]})

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that evaluate the problem together."""
        return self._designed.comm

    @property
    def mechanism(self) -> Mechanism:
        """Mechanism of the only load case: joints, drives, point masses, loads.

        Raises:
            ValueError: If there are several load cases; so do `integrator` and `objective`.
        """
        return only_case(self.load_cases, "problem.load_cases[{!r}].mechanism").mechanism

    @property
    def integrator(self) -> Integrator | TimeInterval:
        """Time interval and steps of the only load case."""
        return only_case(self.load_cases, "problem.load_cases[{!r}].integrator").integrator

    @integrator.setter
    def integrator(self, integrator: Integrator | TimeInterval) -> None:
        self._change(integrator=integrator)

    @property
    def objective(self) -> Objective:
        """Objective of the only load case, which is minimised."""
        return only_case(self.load_cases, "problem.load_cases[{!r}].objective").objective

    @objective.setter
    def objective(self, objective: Objective) -> None:
        self._change(objective=objective)

    def _change(self, **fields: Any) -> None:
        """Replace fields of the only load case."""
        only_case(self.load_cases, "Problem.of_load_cases")
        self.load_cases = {name: replace(case, **fields) for name, case in self.load_cases.items()}
        self._prepare()

    @property
    def constraints(self) -> list[Constraint]:
        """The constraints of all load cases; with several cases named "load case: name"."""
        return [
            constraint
            if len(self.load_cases) == 1
            else replace(constraint, name=self._label(name, constraint.label))
            for name, case in self.load_cases.items()
            for constraint in case.constraints
        ]

    def _with(self, cases: Mapping[str, MechanicalProblem]) -> Self:
        """The same problem with other load cases, or itself if they are the same."""
        if all(cases[name] is case for name, case in self.load_cases.items()):
            return self
        return self.of_load_cases(self.bodies, cases, self.combine)

    def at(self, values: ArrayLike | Mapping[str, float]) -> Self:
        """The same problem at other values of its parameters, by name or all, shape (size,).

        Parameters that are not named stay. At its own values the problem itself is returned.

        Raises:
            ValueError: As `Parameters.at` and `Parameters.mechanism`; if a mechanism
                has other joints or forces at these values; or if there are no parameters.
        """
        with on_every_rank(self.comm, WORK):
            if self.parameters is None:
                raise ValueError("problem: its mechanism has no parameters; see ffr.Parameters")
            cases = {name: case.at(values) for name, case in self.load_cases.items()}
        return self._with(cases)

    def at_evaluation(self, evaluation: Evaluation) -> Self:
        """The same problem at the parameters of an ``evaluation``."""
        parameters = evaluation.mechanism_parameters
        evaluated = parameters.names if parameters else []
        names = self.parameters.names if self.parameters else []
        if evaluated != names:
            raise ValueError(
                f"problem: the evaluation is of another problem: its parameters are {evaluated}, "
                f"but this problem has {names}"
            )
        return self if parameters is None else self.at(parameters.values)

    def refuse_foreign(self, evaluation: Evaluation) -> None:
        """Raise a ValueError if an ``evaluation`` is of other bodies or mechanisms."""
        self._designed.refuse_foreign(evaluation.bodies)
        self.at_evaluation(evaluation)._refuse_foreign_load_cases(evaluation)

    def _refuse_foreign_load_cases(self, evaluation: Evaluation) -> None:
        """Raise a ValueError if an ``evaluation`` is of other load cases."""
        evaluated = {name: list(case.constraints) for name, case in evaluation.load_cases.items()}
        labels = {n: [c.label for c in case.constraints] for n, case in self.load_cases.items()}
        if evaluated != labels:
            raise ValueError(
                "problem: the evaluation is of another problem: its load cases and their "
                f"constraints are {evaluated}, but this problem has {labels}"
            )
        for name, case in self.load_cases.items():
            trajectory = evaluation.load_cases[name].trajectory
            if trajectory is None:
                continue
            for quantity, evaluated_with, expected in (
                ("mechanism", trajectory.model.mechanism, case.mechanism),
                ("end time", trajectory.integrator.end_time, case.integrator.end_time),
            ):
                if not alike(evaluated_with, expected):
                    raise ValueError(
                        "problem: the evaluation is of another problem: "
                        f"{self._of(f'its {quantity}', name)} differs"
                    )

    def refuse_other_psi(self, evaluation: Evaluation) -> None:
        """Refuse an ``evaluation`` whose steps, motion or psi differ from those of this problem.

        Nothing is simulated. Estimates that compare psi of an evaluation with others call it.
        """
        responses, problem = self._responses(evaluation), self.at_evaluation(evaluation)
        for name, case in problem.load_cases.items():
            trajectory = evaluation.load_cases[name].trajectory
            if trajectory is not None and not alike(trajectory.integrator, case.integrator):
                raise ValueError(
                    f"problem: the evaluation has other time steps than {self._of('this', name)}: "
                    f"{trajectory.integrator.in_words}, not {case.method.in_words}; {GIVE_BOTH}"
                )
        psi, _ = problem._evaluated(responses)
        if not abs(psi - evaluation.psi) <= DIFFERS * max(abs(psi), abs(evaluation.psi)):
            raise ValueError(
                "problem: the evaluation is of another objective: psi of the evaluation is "
                f"{evaluation.psi:.6g}, but this problem gives {psi:.6g} for the same motion; "
                f"{GIVE_BOTH}"
            )

    def check_influence(self) -> None:
        """Refuse parameters on which nothing depends; bodies are reduced once."""
        if self.parameters is not None:
            full = self._designed.response(self._designed.reduce(self._designed.filled(1.0)))
            with on_every_rank(self.comm, WORK):
                check_influence(self.load_cases, full)

    def with_modes(self, modes: Mapping[str, int]) -> Self:
        """The same problem with other numbers of normal ``modes``, by name of the body."""
        validation.by_name("problem: modes", modes, "numbers of modes")
        unknown = sorted(set(modes) - set(self.flexible))
        if unknown:
            raise ValueError(
                f"problem: no flexible body {unknown[0]!r}; there are {sorted(self.flexible)}"
            )
        return self.with_bodies(
            {name: self.flexible[name].with_modes(count) for name, count in modes.items()}
        )

    def with_bodies(self, bodies: Mapping[str, Body]) -> Self:
        """The same problem with other ``bodies`` under some of the names.

        Raises:
            ValueError: If there is no body of a name, or the mechanism lacks a marker of one.
        """
        validation.by_name("problem: bodies", bodies, "bodies")
        unknown = sorted(set(bodies) - set(self.bodies))
        if unknown:
            raise ValueError(
                f"problem: no body {unknown[0]!r} to replace; there are {sorted(self.bodies)}"
            )
        return self.of_load_cases({**self.bodies, **bodies}, self.load_cases, self.combine)

    def with_integrators(self, integrators: Mapping[str, Integrator]) -> Problem:
        """The same problem with other ``integrators``, by name of the load case."""
        validation.by_name("problem: integrators", integrators, "integrators")
        return self._with(
            {
                name: replace(case, integrator=integrators.get(name, case.integrator))
                for name, case in self.load_cases.items()
            }
        )

    def with_tolerance(self, x: Densities, tolerance: float) -> Problem:
        """The same problem with a method and time steps for an accuracy of psi at ``x``.

        See `MechanicalProblem.with_tolerance`.

        Args:
            x: Densities, as for `value`, which raises the same errors.
            tolerance: Largest relative error of the objective, and of bounded ones, by the steps.

        Warns:
            TimeStepWarning: If the tolerance is not reached; it says what was.
        """
        with on_every_rank(self.comm, WORK):
            densities = self._designed.checked(x)
        response = self._designed.response(self._designed.reduce(densities))
        with on_every_rank(self.comm, WORK):
            return self._with(
                {
                    name: case.with_tolerance(response, tolerance)
                    for name, case in self.load_cases.items()
                }
            )

    def with_steps_for(self, evaluation: Evaluation) -> Problem:
        """The same problem with time steps that suffice at an ``evaluation``.

        The steps that a `TimeInterval` left open were chosen for half filled and for full bodies.
        Where they do not suffice, new ones are chosen and printed, with a `TimeStepWarning` if
        these do not suffice, either. The steps of a user stay. Returns the problem itself where no
        step changes.
        """
        problem = self.at_evaluation(evaluation)
        responses = self._responses(evaluation)
        return problem._with(with_better_steps(self.comm, problem.load_cases, responses))

    def time_errors(self, evaluation: Evaluation) -> dict[str, float]:
        """Estimates of the relative errors by the time steps at an ``evaluation``, by load case.

        Each is the largest of the objective and of bounded ones, see
        `MechanicalProblem.time_error`; the same on every rank.
        """
        responses = self._responses(evaluation)
        with on_every_rank(self.comm, "the errors of time steps"):
            cases = self.at_evaluation(evaluation).load_cases
            errors = {name: case.time_error(responses[name]) for name, case in cases.items()}
        return dict(self.comm.bcast(errors))

    def calibrated(self, evaluation: Evaluation) -> tuple[Problem, Evaluation]:
        """The problem and an ``evaluation`` with objectives that are corrected at this design.

        `PeakStress` as objective, in sums and in constraints then equals the largest stress there.
        Nothing is simulated for it. The evaluation has values and no gradients; where no objective
        is corrected, problem and evaluation are returned unchanged.
        """
        return self.adapted(evaluation, MechanicalProblem.calibrated_at)

    def adapted(self, evaluation: Evaluation, change: Change) -> tuple[Problem, Evaluation]:
        """The problem with a ``change`` of each load case at an ``evaluation``, and its evaluation.

        Nothing is simulated, as the motion stays.
        """
        responses = self._responses(evaluation)
        with on_every_rank(self.comm, WORK):
            cases = {n: change(case, responses[n]) for n, case in self.load_cases.items()}
        problem = self._with(cases)
        if problem is self:
            return self, evaluation
        psi, evaluated = problem._evaluated(responses)
        return problem, replace(
            evaluation,
            psi=psi,
            constraints=problem._labelled(evaluated),
            gradient=None,
            integrals_gradient=None,
            load_cases=evaluated,
        )

    def value(self, x: Densities) -> Evaluation:
        """The objective and the constraints at densities.

        Args:
            x: Densities of the cells owned by this rank, shape (cells,), in [0, 1]; with more than
                one flexible body a mapping by name. The mapping may have values of the parameters,
                shape (parameters,), under a name that no body has; otherwise the values of the
                problem are used (see `at`).

        Raises:
            ValueError: If a density has the wrong size, is NaN or leaves [0, 1], or if a body has
                no mass.
            SimulationError: If the trajectory cannot be computed, or there is no mechanism with the
                parameters of ``x``.
        """
        designed = self._designed
        with on_every_rank(self.comm, WORK):
            label, values, by_body = split_parameters(x, self.flexible, self.parameters)
            densities = designed.checked(by_body)
        if values is not None:
            try:
                return replace(self.at(values).value(densities), label=label)
            except TopologyError:
                raise
            except ValueError as error:  # an optimiser takes this step back
                raise SimulationError(str(error), None) from error  # type: ignore[arg-type]
        reduced = designed.reduce(densities)
        begin, response = perf_counter(), designed.response(reduced)
        simulated = trajectories(self.comm, self.load_cases, response.bodies)
        psi, cases = self._evaluated(self._moving(response, simulated))
        seconds = {"simulation": perf_counter() - begin}
        return Evaluation(
            psi=psi,
            gradient=None,
            bodies=reduced,
            volume=designed.volume(reduced),
            fixed_interface_frequencies={n: body.basis.frequencies for n, body in reduced.items()},
            outer_gap={name: body.basis.spectral_gap for name, body in reduced.items()},
            solver_iterations={},
            seconds=reduce(summed, [*(body.seconds for body in reduced.values()), seconds]),
            constraints=self._labelled(cases),
            load_cases=cases,
            mechanism_parameters=self.parameters,
        )

    def gradient(self, x: Densities, *, nodes: bool = False) -> Evaluation:
        """Objective and constraints with their exact gradients at densities ``x``, as for `value`.

        With ``nodes`` also those with respect to the nodes of the meshes (`differentiate`). It
        raises what `value` and `differentiate` raise.
        """
        return self.differentiate(self.value(x), nodes=nodes)

    def differentiate(
        self,
        evaluation: Evaluation,
        *,
        by_load_case: bool = False,
        nodes: bool = False,
        densities: bool = True,
    ) -> Evaluation:
        """Add the exact gradients to an ``evaluation``.

        So a design whose value is rejected need not be differentiated. Bodies store the factor of
        the density at which they were reduced last; for an earlier evaluation their matrices are
        assembled and factored once more.

        Args:
            evaluation: The result of `value`, at any time.
            by_load_case: Give each of several load cases a gradient of its own, too, which takes as
                many adjoint solutions of the finite elements. With `WorstCase`, load cases near the
                largest value always have one.
            nodes: Whether to add derivatives with respect to the nodes of the meshes;
                `FlexibleBody.pullback` explains what moves with them.
            densities: Whether to add derivatives by densities; else ``gradient`` is None.

        Raises:
            MemoryError: If that would take more memory than a machine has.
            RuntimeError: If an adjoint system cannot be solved.
            ValueError: With ``nodes``, if a length that follows from placements depends on them.
        """
        if nodes:
            mechanisms = [case.mechanism for case in self.load_cases.values()]
            self._designed.refuse_lengths_of_placements(mechanisms)
        responses = self._responses(evaluation)
        checked_memory(self._designed, self.load_cases, self._memory, adjoint=True)

        psi = {name: case.psi for name, case in evaluation.load_cases.items()}
        weights = self._weights(psi)
        # load cases with a gradient of their own
        separate = set[str]()
        if len(psi) > 1:
            separate = set(psi if by_load_case else self.combine.near(psi))

        # from the trajectories to the volume integrals
        begin = perf_counter()
        jobs = [
            (name, label)
            for name, case in self.load_cases.items()
            for label in case.objectives
            if label or name in weights or name in separate
        ]
        direct = self._direct(responses, jobs)
        indirect = adjoints(self.comm, responses, direct)
        derivatives = {job: d.without_trajectory(indirect[job]) for job, d in direct.items()}
        seconds = {"adjoint": perf_counter() - begin}

        # and from there to the design
        pullback = Pullback(
            self.flexible, evaluation.bodies, evaluation.label, densities=densities, nodes=nodes
        )
        cases = {
            name: self._differentiated(
                name, case, derivatives, pullback, own_gradient=name in separate
            )
            for name, case in evaluation.load_cases.items()
        }
        total = weighted({name: derivatives[name, ""] for name in weights}, weights)
        if weights.keys() <= separate:
            gradients = Gradients.weighted_sum({name: cases[name] for name in weights}, weights)
        else:
            gradients = pullback(total)
        if len(cases) == 1:
            cases = {name: replace(case, **vars(gradients)) for name, case in cases.items()}
        return replace(
            evaluation,
            **vars(gradients),
            integrals_gradient=dict(total.integrals),
            constraints=self._labelled(cases),
            load_cases=cases,
            solver_iterations=pullback.iterations,
            seconds=reduce(summed, [evaluation.seconds, seconds, pullback.seconds]),
        )

    def _differentiated(
        self,
        name: str,
        values: LoadCaseEvaluation,
        derivatives: Mapping[Job, Derivatives],
        pullback: Pullback,
        *,
        own_gradient: bool,
    ) -> LoadCaseEvaluation:
        """The ``values`` of a load case with gradients of its constraints, and of its objective.

        The objective has an ``own_gradient`` if the gradient of all load cases does not suffice.
        """
        constraints = {}
        for constraint in self.load_cases[name].constraints:
            bars = derivatives[name, constraint.label].scaled(constraint.slope)
            constraints[constraint.label] = replace(
                values.constraints[constraint.label],
                derivatives=replace(bars, stresses={}),  # large, and no longer needed
                **vars(pullback(bars)),
            )
        of_objective = derivatives.get((name, ""))
        gradients = Gradients(parameters=values.parameters)
        if of_objective and own_gradient:
            gradients = pullback(of_objective)
        return replace(
            values,
            constraints=constraints,
            integrals_gradient=dict(of_objective.integrals) if of_objective else None,
            **vars(gradients),
        )

    def _weights(self, psi: Mapping[str, float]) -> dict[str, float]:
        """The derivatives of psi by the objectives of load cases, without those that are zero."""
        slopes = self._slopes(psi)
        compared = {"the slopes by the load cases": np.array(list(slopes.values()))}
        check_alike(self.comm, "problem", compared, DIFFERS)
        return {name: slope for name, slope in slopes.items() if slope}

    def _direct(
        self, responses: Mapping[str, Response], jobs: Collection[Job]
    ) -> dict[Job, Derivatives]:
        """Partial derivatives of objectives, by load case and label."""
        several, derivatives = len(self.load_cases) > 1, dict[Job, Derivatives]()
        with on_every_rank(self.comm, WORK):
            for name, case in self.load_cases.items():
                labels = [label for n, label in jobs if n == name]
                of_case = case.partial(responses[name], labels, f"{name}: " if several else "")
                derivatives |= {(name, label): partial for label, partial in of_case.items()}
                for label in labels:
                    check_integrals(case.objectives[label], responses[name], self.flexible)
        compared: dict[str, Any] = {}
        for (name, label), partial in derivatives.items() if self.comm.size > 1 else ():
            number = self._of(f"the constraint {label!r}" if label else "the objective", name)
            for by, array in replicated(partial, responses[name]).items():
                compared[f"the derivative of {number} {by}"] = array
        check_alike(self.comm, "problem", compared, DIFFERS)
        return {job: derivatives[job] for job in jobs}

    def _weighted_cases(
        self, evaluation: Evaluation
    ) -> tuple[dict[str, Response], dict[Job, Derivatives], dict[str, float]]:
        """Responses, partial derivatives of load cases with non-zero weight, and these weights."""
        responses = self._responses(evaluation)
        weights = self._weights({n: case.psi for n, case in evaluation.load_cases.items()})
        return responses, self._direct(responses, [(name, "") for name in weights]), weights

    def integral_gradients(
        self, evaluation: Evaluation
    ) -> tuple[dict[str, VolumeIntegrals], dict[str, VolumeIntegrals]]:
        """The derivatives of psi by the volume integrals at an ``evaluation``, by body.

        The first mapping is at fixed trajectory, for bodies on which the objective depends
        directly; the second one is through the trajectory. Both are the same on every rank.
        """
        responses, direct, weights = self._weighted_cases(evaluation)
        indirect = adjoints(self.comm, responses, direct)
        no_motion = Derivatives()
        fixed = weighted({n: direct[n, ""].without_trajectory(no_motion) for n in weights}, weights)
        by_motion = weighted({n: indirect[n, ""] for n in weights}, weights)
        return dict(fixed.integrals), dict(by_motion.integrals)

    def partial_derivatives(self, evaluation: Evaluation) -> Derivatives:
        """The partial derivatives of psi at an ``evaluation``.

        The derivative by the trajectory is None where there are several load cases.
        """
        _, derivatives, weights = self._weighted_cases(evaluation)
        if len(self.load_cases) > 1:
            derivatives = {
                j: partial.without_trajectory(Derivatives()) for j, partial in derivatives.items()
            }
        return weighted({name: derivatives[name, ""] for name in weights}, weights)

    def psi_with(
        self,
        evaluation: Evaluation,
        bodies: Mapping[str, VolumeIntegrals],
        stresses: Mapping[str, StressField],
        integrators: Mapping[str, Integrator] | None = None,
    ) -> float:
        """Psi at the densities of an ``evaluation``, with other integrals or other steps.

        Nothing is warned of. Start values of elastic coordinates belong to the first shape
        functions of a body.

        Args:
            evaluation: An evaluation of this problem, with its densities and parameters.
            bodies: Volume integrals of all bodies, by name.
            stresses: Stress of the bodies with a mesh, by name.
            integrators: Replace the problem's integrators, by load case.
        """
        modes = {name: body.modes for name, body in bodies.items()}
        cases = {
            name: replace(
                case,
                mechanism=replace(case.mechanism, start=case.mechanism.start.resized(modes)),
                integrator=(integrators or {}).get(name, case.integrator),
            )
            for name, case in self.at_evaluation(evaluation).load_cases.items()
        }
        simulated = trajectories(self.comm, cases, bodies, warn=False)
        fields = self._designed.response(evaluation.bodies).densities
        reduced = Response(None, bodies, fields, stresses)
        responses = {
            n: replace(case.response(reduced), simulated=simulated[n]) for n, case in cases.items()
        }
        with on_every_rank(self.comm, WORK):
            return self._combined(
                {n: value_of(case.objective, responses[n]) for n, case in cases.items()}
            )

    def integrals(self, evaluation: Evaluation) -> dict[str, VolumeIntegrals]:
        """The volume integrals of all bodies at an ``evaluation``, in the order of the bodies."""
        validation.instance("problem: the evaluation", evaluation, Evaluation, "an Evaluation")
        return dict(self._designed.response(evaluation.bodies).bodies)

    def response(self, evaluation: Evaluation) -> Response:
        """The response of the only load case at an ``evaluation``, the argument of objectives."""
        instead = "problem.alone({0!r}).response(evaluation.alone({0!r}))"
        return only_case(self._responses(evaluation), instead)

    def _responses(self, evaluation: Evaluation) -> dict[str, Response]:
        """The arguments of the objectives at an evaluation, by load case."""
        validation.instance("problem: the evaluation", evaluation, Evaluation, "an Evaluation")
        bodies = self._designed.response(evaluation.bodies)
        problem = self.at_evaluation(evaluation)
        problem._refuse_foreign_load_cases(evaluation)
        simulated = {name: case.trajectory for name, case in evaluation.load_cases.items()}
        responses = problem._moving(bodies, simulated)
        for name, response in responses.items():
            response.cache.update(evaluation.load_cases[name].cache)
        return responses

    def _moving(
        self, response: Response, simulated: Mapping[str, Trajectory | None]
    ) -> dict[str, Response]:
        """Responses by load case, with trajectories and the bodies of parametric mechanisms."""
        cases = self.load_cases.items()
        return {n: replace(case.response(response), simulated=simulated[n]) for n, case in cases}

    def _evaluated(
        self, responses: Mapping[str, Response]
    ) -> tuple[float, dict[str, LoadCaseEvaluation]]:
        """Psi, and the evaluation of each load case, with values of rank 0 on every rank."""
        with on_every_rank(self.comm, WORK):
            evaluations = {
                name: case.evaluated(responses[name]) for name, case in self.load_cases.items()
            }
        compared: dict[str, Any] = {}
        for name, case in self.load_cases.items():
            compared[self._of("integrator", name)] = case.integrator
            compared[self._of("the objective", name)] = float(evaluations[name].psi)
            for label, constraint in evaluations[name].constraints.items():
                compared[self._of(f"the constraint {label!r}", name)] = constraint.value
        check_alike(self.comm, "problem", compared, DIFFERS)
        # the last bits of a rank must not decide anything
        psi_of_cases = self.comm.bcast({name: case.psi for name, case in evaluations.items()})
        constraints = self.comm.bcast(
            {name: case.constraints for name, case in evaluations.items()}
        )
        with on_every_rank(self.comm, WORK):
            psi = self._combined(psi_of_cases)
        return psi, {
            name: LoadCaseEvaluation(
                psi_of_cases[name],
                responses[name].simulated,
                constraints[name],
                cache=responses[name].cache,
            )
            for name in self.load_cases
        }

    def _label(self, case: str, label: str) -> str:
        """The name of a load case's constraint among all constraints."""
        return label if len(self.load_cases) == 1 else f"{case}: {label}"

    def _of(self, name: str, case: str) -> str:
        """The name of a field of a load case in messages, with the case if there are several."""
        return name if len(self.load_cases) == 1 else f"{name} of load case {case!r}"

    def _labelled(self, cases: Mapping[str, LoadCaseEvaluation]) -> dict[str, ConstraintValue]:
        """The constraints of all load cases by their labels."""
        return {
            self._label(name, label): value
            for name, case in cases.items()
            for label, value in case.constraints.items()
        }

    def _combined(self, psi: Mapping[str, float]) -> float:
        """The one number from the objectives by load case."""
        kind = type(self.combine).__name__
        return validation.number(f"the value of {kind}", self.combine.value(psi))

    def _slopes(self, psi: Mapping[str, float]) -> dict[str, float]:
        """The derivatives of psi by the objectives of the load cases."""
        slopes, kind = self.combine.slopes(psi), type(self.combine).__name__
        return {n: validation.number(f"the slope of {kind} by {n!r}", slopes.get(n)) for n in psi}
