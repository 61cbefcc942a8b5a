# SPDX-License-Identifier: MIT
"""The whole chain: from the densities of the bodies to one number, and its exact gradient back.

    density -> shape functions -> volume integrals -> trajectory -> psi
       x_bar <-   Phi_bar      <-   arrays_bar     <- discrete adjoint <-

The gradient is that of the number that was computed, mesh and time steps included: each map hands
on the transpose of its derivative. Its cost does not depend on the number of densities.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import validation
from .body import VolumeIntegrals
from .dynamics import (
    Integrator,
    Trajectory,
    available_memory,
    check_memory,
    compile_kernels,
)
from .mechanical_problem import (
    ConstraintValue,
    MechanicalEvaluation,
    MechanicalProblem,
    parts_of_gradient,
)
from .mechanism import Mechanism
from .objective import Constraint, DensityField, Derivatives, Objective, Response, StressField
from .parallel import check_alike, on_every_rank
from .reduction import BodyStress, FlexibleBody, ReducedBody

__all__ = ["Evaluation", "Problem"]

Densities = ArrayLike | Mapping[str, ArrayLike]

#: Relative difference from which on two ranks have not computed the same number: a motion magnifies
#: round-off, and stays far below
DIFFERS = 1e-6


@dataclass(frozen=True)
class Evaluation:
    """A value of the objective, its gradient, and what was learnt on the way."""

    psi: float  #: Value of the objective (integral compliance: [J s]), the same on every rank
    #: dpsi/dx by body, for each cell owned by this rank, shape (cells,); None where only the value
    #: was asked for
    gradient: dict[str, NDArray[np.float64]] | None
    #: The motion, replicated on every rank; None if neither objective nor constraints depend on it
    trajectory: Trajectory | None = field(repr=False)
    bodies: dict[str, ReducedBody] = field(repr=False)  #: Shape functions and integrals
    volume: dict[str, float]  #: Share of each body's area that is filled, in [0, 1]
    #: Natural frequencies of each body with all interfaces held, those of its normal modes [Hz];
    #: the objective `Frequency` is another one, of the body on its supports or free
    fixed_interface_frequencies: dict[str, NDArray[np.float64]]
    outer_gap: dict[str, float]  #: Relative gap between the last mode kept and the next one
    solver_iterations: dict[str, int]  #: Conjugate gradient iterations of all pullbacks
    seconds: dict[str, float]  #: Time spent by name of the part [s]
    #: Constraints by name, with their gradients where the gradient was asked for
    constraints: dict[str, ConstraintValue] = field(default_factory=dict)
    #: Derivative of psi with respect to the integrals of every body, those of given bodies too, the
    #: same on every rank; None where only the value was asked for
    integrals_gradient: dict[str, VolumeIntegrals] | None = field(default=None, repr=False)

    @property
    def frequencies(self) -> dict[str, NDArray[np.float64]]:
        """The name of `fixed_interface_frequencies` in the release before."""
        warnings.warn(
            "Evaluation.frequencies is now called fixed_interface_frequencies; the old name goes "
            "with the next release",
            DeprecationWarning,
            stacklevel=2,
        )
        return self.fixed_interface_frequencies

    @property
    def motion(self) -> Trajectory:
        """The trajectory, where there must be one.

        Raises:
            ValueError: On every rank, if nothing was simulated.
        """
        if self.trajectory is None:
            raise ValueError(
                "there is no motion: nothing was simulated, because neither the objective nor the "
                "constraints of this problem depend on it"
            )
        return self.trajectory


class Problem:
    """Minimise psi(x): an objective of a mechanism's motion as a function of its bodies' densities.

        psi(x) = objective(trajectory),   the trajectory solves the equations of motion
                                          of the mechanism with bodies(x)

    Constraints g_k(x) <= 0 come from the same simulation, each with an adjoint pass of its own;
    those that do not depend on the motion need none. Without any flexible body use
    `MechanicalProblem`, on which this class is built.

    Args:
        bodies: By the names that the mechanism uses; `FlexibleBody` for bodies with a density,
            `VolumeIntegrals` for given ones (rigid bodies, standard input data).
        mechanism: Joints, motions, point masses, gravity.
        integrator: Time interval and steps.
        objective: What is minimised.
        constraints: Bounds on further objectives, for optimisers that take several.

    Raises:
        TypeError: If an argument is of a wrong kind.
        ValueError: If no body has a density, two constraints have the same name, or an objective
            depends on the density of a body that has none.
        MemoryError: On every rank, if the motion would take more memory than a machine has.
    """

    def __init__(
        self,
        bodies: Mapping[str, FlexibleBody | VolumeIntegrals],
        mechanism: Mechanism,
        integrator: Integrator,
        objective: Objective,
        constraints: Sequence[Constraint] = (),
    ) -> None:
        kinds = (FlexibleBody, VolumeIntegrals)
        validation.instances_by_name(
            "problem: bodies", bodies, kinds, "a FlexibleBody or VolumeIntegrals"
        )
        self.bodies = dict(bodies)
        self.mechanism = mechanism
        self.integrator = integrator
        self.objective = objective
        #: The bodies with a density
        self.flexible = {k: b for k, b in self.bodies.items() if isinstance(b, FlexibleBody)}
        if not self.flexible:
            raise ValueError(
                f"problem: none of the bodies {sorted(self.bodies)} has a density to design; give "
                "at least one FlexibleBody, or use MechanicalProblem, which needs none"
            )
        with on_every_rank(self.comm, "the evaluation of a problem"):
            MechanicalProblem(mechanism, integrator, objective, constraints)  # checks them
            self.constraints = list(constraints)
            self._validate()
        check_alike(
            self.comm, "problem", {"bodies": list(self.bodies), "integrator": self.integrator}
        )
        self._memory = _agreed_memory(self.comm)
        self._check_memory(adjoint=False)
        self._compile()

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that evaluate the problem together."""
        comm: MPI.Comm = next(iter(self.flexible.values())).domain.comm
        return comm

    def _validate(self) -> None:
        """Refuse objectives that lack a density."""
        full = {
            name: _field(body, np.ones(body.domain.n_cells)) for name, body in self.flexible.items()
        }
        for used in (self.objective, *(constraint.objective for constraint in self.constraints)):
            used.validate(full)

    def with_modes(self, modes: Mapping[str, int]) -> Problem:
        """The same problem with other numbers of normal modes.

        Args:
            modes: Number of normal modes by name of the body; other bodies stay as they are.

        Raises:
            ValueError: If a name is not that of a flexible body, or a number is out of range.
        """
        validation.by_name("problem: modes", modes, "numbers of modes")
        unknown = sorted(set(modes) - set(self.flexible))
        if unknown:
            raise ValueError(
                f"problem: no flexible body {unknown[0]!r}; there are {sorted(self.flexible)}"
            )
        return self.with_bodies(
            {name: self.flexible[name].with_modes(count) for name, count in modes.items()}
        )

    def with_bodies(self, bodies: Mapping[str, FlexibleBody | VolumeIntegrals]) -> Problem:
        """The same problem with other bodies under some of the names.

        Args:
            bodies: By name; those that are not named stay as they are.

        Raises:
            ValueError: If there is no body of a name, or the mechanism lacks a marker of one.
        """
        validation.by_name("problem: bodies", bodies, "bodies")
        unknown = sorted(set(bodies) - set(self.bodies))
        if unknown:
            raise ValueError(
                f"problem: no body {unknown[0]!r} to replace; there are {sorted(self.bodies)}"
            )
        return Problem(
            {**self.bodies, **bodies},
            self.mechanism,
            self.integrator,
            self.objective,
            self.constraints,
        )

    def with_tolerance(self, x: Densities, tolerance: float) -> Problem:
        """The same problem with time steps for an accuracy of psi.

        See `MechanicalProblem.with_tolerance`. Choose once, and keep the steps while designing.

        Args:
            x: Densities, as for `value`.
            tolerance: Largest relative error of the objective, and of bounded ones, by the steps.

        Raises:
            ValueError: As `value` does, or if the tolerance is out of range.
            SimulationError: On every rank, if the motion cannot be computed or the tolerance is not
                reached; the message says what was.
        """
        with on_every_rank(self.comm, "the evaluation of a problem"):
            densities = self._by_name(x)
        reduced = {
            name: body.reduce_checked(densities[name]) for name, body in self.flexible.items()
        }
        with on_every_rank(self.comm, "the evaluation of a problem"):
            chosen = self._mechanical().with_tolerance(
                self._integrals(reduced), tolerance, self._fields(reduced), self._stresses(reduced)
            )
        return Problem(
            self.bodies, self.mechanism, chosen.integrator, self.objective, self.constraints
        )

    def calibrated(self, evaluation: Evaluation) -> tuple[Problem, Evaluation]:
        """The same problem with objectives that stand for other numbers corrected at a design.

        Those are `PeakStress` as objective, in sums and in constraints, which then equals the
        largest stress there. Nothing is simulated for it.

        Args:
            evaluation: What `value` returned.

        Returns:
            The problem, and the evaluation with its values, without gradients. Both are those
            given, where no objective is to be corrected.
        """
        validation.instance("problem: the evaluation", evaluation, Evaluation, "an Evaluation")
        with on_every_rank(self.comm, "the evaluation of a problem"):
            response = self.response(evaluation)
            objective = self.objective.calibrated(response)
            constraints = [constraint.calibrated(response) for constraint in self.constraints]
        same = all(a is b for a, b in zip(constraints, self.constraints, strict=True))
        if objective is self.objective and same:
            return self, evaluation
        problem = Problem(self.bodies, self.mechanism, self.integrator, objective, constraints)
        with on_every_rank(self.comm, "the evaluation of a problem"):
            psi = objective.evaluate(response)
            values = {
                c.label: ConstraintValue(c.scaled(told), told)
                for c in constraints
                for told in [c.objective.evaluate(response)]
            }
        psi, values = self.comm.bcast((psi, values), root=0)
        return problem, replace(
            evaluation, psi=psi, constraints=values, gradient=None, integrals_gradient=None
        )

    def integrals(self, evaluation: Evaluation) -> dict[str, VolumeIntegrals]:
        """What the mechanism sees of all bodies, in the order in which they were given.

        Args:
            evaluation: What `value` returned.
        """
        validation.instance("problem: the evaluation", evaluation, Evaluation, "an Evaluation")
        return self._integrals(evaluation.bodies)

    def _check_memory(self, *, adjoint: bool) -> None:
        """Refuse, on every rank alike, what the machine with the least memory cannot hold."""
        with on_every_rank(self.comm, "the evaluation of a problem"):
            if self._mechanical().needs_trajectory:
                modes = [
                    body.modes if isinstance(body, VolumeIntegrals) else body.n_elastic
                    for body in self.bodies.values()
                ]
                check_memory(self.integrator, modes, self._memory, adjoint=adjoint)

    def _compile(self) -> None:
        """Compile the time integration on one rank, for the others to find in the cache."""
        integrators = [type(self.integrator)]
        if self.comm.rank == 0:
            compile_kernels(integrators=integrators)
        self.comm.Barrier()
        compile_kernels(lambda line: None, integrators=integrators)

    def value(self, x: Densities) -> Evaluation:
        """The objective and the constraints at densities.

        Args:
            x: Densities of the cells owned by this rank, shape (cells,), in [0, 1]; with more than
                one flexible body a mapping by name.

        Raises:
            TypeError: On every rank, if a density holds something else than real numbers.
            ValueError: On every rank, if a density has the wrong size, is NaN or leaves [0, 1], or
                if a body has no mass.
            SimulationError: On every rank, if the motion cannot be computed.
        """
        with on_every_rank(self.comm, "the evaluation of a problem"):
            densities = self._by_name(x)
        reduced = {
            name: body.reduce_checked(densities[name]) for name, body in self.flexible.items()
        }
        seconds: dict[str, float] = {}
        for part in reduced.values():
            _add(seconds, part.seconds)
        with on_every_rank(self.comm, "the evaluation of a problem"):
            found = self._mechanical().value(
                self._integrals(reduced), self._fields(reduced), self._stresses(reduced)
            )
        psi, constraints = self._agreed(found)
        _add(seconds, found.seconds)
        volume = {name: _filled(b, densities[name]) for name, b in self.flexible.items()}
        return Evaluation(
            psi=psi,
            gradient=None,
            trajectory=found.trajectory,
            bodies=reduced,
            volume=volume,
            fixed_interface_frequencies={
                name: part.basis.frequencies for name, part in reduced.items()
            },
            outer_gap={name: part.basis.outer_gap for name, part in reduced.items()},
            solver_iterations={},
            seconds=seconds,
            constraints=constraints,
        )

    def gradient(self, x: Densities) -> Evaluation:
        """Objective and constraints with their exact gradients at densities.

        Args:
            x: As for `value`.

        Raises:
            ValueError: As `value` does.
            SimulationError: As `value` does.
            RuntimeError: On every rank, if an adjoint system cannot be solved.
        """
        return self.differentiate(self.value(x))

    def differentiate(self, evaluation: Evaluation) -> Evaluation:
        """An evaluation with the exact gradients added.

        So a design whose value is rejected need not be differentiated. Bodies keep the factor of
        the density that they were reduced at last; for an earlier evaluation their matrices are
        assembled and factored once more.

        Args:
            evaluation: What `value` returned, at any time.

        Raises:
            MemoryError: On every rank, if that would take more memory than a machine has.
            RuntimeError: On every rank, if an adjoint system cannot be solved.
        """
        validation.instance("problem: the evaluation", evaluation, Evaluation, "an Evaluation")
        self._check_memory(adjoint=True)
        bare = MechanicalEvaluation(
            psi=evaluation.psi,
            integrals_gradient=None,
            constraints=evaluation.constraints,
            trajectory=evaluation.trajectory,
            bodies=self._integrals(evaluation.bodies),
            seconds=evaluation.seconds,
            densities=self._fields(evaluation.bodies),
            stresses=self._stresses(evaluation.bodies),
        )
        with on_every_rank(self.comm, "the evaluation of a problem"):
            found = self._mechanical().differentiate(bare)
        seconds = dict(found.seconds)
        iterations = dict.fromkeys(self.flexible, 0)
        constraints = {}
        for name, value in found.constraints.items():
            gradient = self._to_densities(evaluation, value, iterations, seconds)
            # that by stress is large, and its work is done
            constraints[name] = replace(value, gradient=gradient, stress_gradient=None)
        return replace(
            evaluation,
            gradient=self._to_densities(evaluation, found, iterations, seconds),
            integrals_gradient=found.integrals_gradient,
            constraints=constraints,
            solver_iterations=iterations,
            seconds=seconds,
        )

    def _to_densities(
        self,
        evaluation: Evaluation,
        found: MechanicalEvaluation | ConstraintValue,
        iterations: dict[str, int],
        seconds: dict[str, float],
    ) -> dict[str, NDArray[np.float64]]:
        """Derivatives with respect to the densities, through the reduction and at fixed one."""
        bars, direct = found.integrals_gradient, found.density_gradient
        stresses = found.stress_gradient
        assert bars is not None and direct is not None and stresses is not None
        gradient: dict[str, NDArray[np.float64]] = {}
        for name, body in self.flexible.items():
            gradient[name] = np.zeros(body.domain.n_cells)
            # the same on every rank, so all skip a body that does not matter, or none
            if name in stresses or bars[name].dot(bars[name]) != 0.0:
                reduced, shapes = evaluation.bodies[name], None
                if name in stresses:
                    shapes = body.stress_pullback(reduced, stresses[name])
                gradient[name], learnt = body.pullback(reduced, bars[name], shapes)
                iterations[name] += int(learnt.pop("iterations"))
                _add(seconds, learnt)
            if name in direct:
                gradient[name] = gradient[name] + direct[name]
        return gradient

    def integral_gradients(
        self, evaluation: Evaluation
    ) -> tuple[dict[str, VolumeIntegrals], dict[str, VolumeIntegrals]]:
        """The derivatives of psi with respect to the volume integrals of all bodies.

        Args:
            evaluation: What `value` returned.

        Returns:
            By name of the body, at fixed motion (only bodies on which the objective depends
            directly), and through the motion. The same on every rank.
        """
        with on_every_rank(self.comm, "the evaluation of a problem"):
            direct, motion = parts_of_gradient(self.objective, self.response(evaluation))
        return dict(direct.integrals), motion

    def partial_derivatives(self, evaluation: Evaluation) -> Derivatives:
        """The derivatives of psi with respect to trajectory, integrals and densities, each alone.

        Args:
            evaluation: What `value` returned.
        """
        with on_every_rank(self.comm, "the evaluation of a problem"):
            found = self.objective.derivatives(self.response(evaluation))
        return found

    def response(self, evaluation: Evaluation) -> Response:
        """What the objective is a function of.

        Args:
            evaluation: What `value` returned.
        """
        bodies = evaluation.bodies
        return Response(
            evaluation.trajectory,
            self._integrals(bodies),
            self._fields(bodies),
            self._stresses(bodies),
        )

    def _agreed(self, found: MechanicalEvaluation) -> tuple[float, dict[str, ConstraintValue]]:
        """Objective and constraints of rank 0, or refuse them where those of others differ.

        Every rank computes the motion, and its own last bits may decide nothing.
        """
        said = {"integrator": self.integrator, "the objective": float(found.psi)}
        said |= {f"the constraint {name!r}": c.psi for name, c in found.constraints.items()}
        check_alike(self.comm, "problem", said, DIFFERS)
        return self.comm.bcast((found.psi, found.constraints), root=0)

    def _mechanical(self) -> MechanicalProblem:
        """The part of the problem that sees only integrals and what the objective takes."""
        return MechanicalProblem(self.mechanism, self.integrator, self.objective, self.constraints)

    def _fields(self, reduced: Mapping[str, ReducedBody]) -> dict[str, DensityField]:
        """The densities as objectives see them."""
        return {name: _field(self.flexible[name], part.density) for name, part in reduced.items()}

    def _stresses(self, reduced: Mapping[str, ReducedBody]) -> dict[str, StressField]:
        """The stresses as objectives see them; none is computed before it is asked for."""
        return {name: BodyStress(self.flexible[name], part) for name, part in reduced.items()}

    def _integrals(self, reduced: Mapping[str, ReducedBody]) -> dict[str, VolumeIntegrals]:
        """What the mechanism sees of all bodies, in the order in which they were given."""
        return {
            name: body if isinstance(body, VolumeIntegrals) else reduced[name].integrals
            for name, body in self.bodies.items()
        }

    def _by_name(self, x: Densities) -> dict[str, NDArray[np.float64]]:
        if isinstance(x, Mapping):
            if set(x) != set(self.flexible):
                raise ValueError(
                    f"problem: densities given for {sorted(x)}, but the flexible bodies are "
                    f"{sorted(self.flexible)}"
                )
            given = dict(x)
        elif len(self.flexible) > 1:
            raise ValueError(
                f"problem: {len(self.flexible)} bodies have densities ({sorted(self.flexible)}); "
                "give a mapping from name to density"
            )
        else:
            given = {next(iter(self.flexible)): x}
        return {
            name: body.domain.check_density(given[name], f"density of {name!r}")
            for name, body in self.flexible.items()
        }


def _field(body: FlexibleBody, density: NDArray[np.float64]) -> DensityField:
    """A density as objectives see it."""
    domain = body.domain
    return DensityField(density, domain.cell_volumes, domain.centroids, domain.sum)


def _filled(body: FlexibleBody, density: NDArray[np.float64]) -> float:
    """The filled share of a body's area at a density that has been checked."""
    domain = body.domain
    return domain.sum(density * (domain.cell_volumes / domain.area))


def _agreed_memory(comm: MPI.Comm) -> int:
    """Least memory that a rank may take, where those of a machine share its memory [bytes]."""
    neighbours = comm.Split_type(MPI.COMM_TYPE_SHARED)
    own = available_memory(neighbours.size)
    neighbours.Free()
    return int(comm.allreduce(own, MPI.MIN))


def _add(total: dict[str, float], part: Mapping[str, float]) -> None:
    for key, value in part.items():
        total[key] = total.get(key, 0.0) + value
