# SPDX-License-Identifier: MIT
"""What a problem consists of: bodies with densities, and the motions that they are designed for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Self

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..body import VolumeIntegrals
from ..dynamics import (
    Integrator,
    TimeInterval,
    check_memory,
    check_names,
    compile_kernels,
    required_memory,
)
from ..fem import Domain
from ..mechanical_problem import MechanicalProblem
from ..mechanism import Mechanism
from ..objective import (
    Combination,
    Constraint,
    DensityField,
    Objective,
    Response,
    StressField,
    WeightedSum,
)
from ..parallel import check_alike, on_every_rank
from ..reduction import BodyStress, FlexibleBody, ReducedBody, agreed_memory
from .evaluation import Evaluation, only_motion

__all__ = ["Densities", "MovingBodies"]

Densities = ArrayLike | Mapping[str, ArrayLike]

#: Name of the motion where there is one
MOTION = "motion"
#: Density of design elements at which time steps are chosen
FILLED = 0.5


class MovingBodies:
    """Bodies with densities in one or several motions; `Problem` says what is made of them."""

    def __init__(
        self,
        bodies: Mapping[str, FlexibleBody | VolumeIntegrals],
        mechanism: Mechanism,
        integrator: Integrator,
        objective: Objective,
        constraints: Sequence[Constraint] = (),
    ) -> None:
        def motions() -> dict[str, MechanicalProblem]:
            return {MOTION: MechanicalProblem(mechanism, integrator, objective, constraints)}

        self._set(bodies, motions, WeightedSum())

    @classmethod
    def of_motions(
        cls,
        bodies: Mapping[str, FlexibleBody | VolumeIntegrals],
        motions: Mapping[str, MechanicalProblem],
        combine: Combination | None = None,
    ) -> Self:
        """A problem of several motions of the same bodies, whose objectives become one number.

            psi(x) = combine(psi_1(x), psi_2(x), ...)

        Bodies are reduced once a design, whatever the number of motions, and the derivatives of all
        motions go back to the densities together. The motions are spread over the ranks.

        Args:
            bodies: By the names that the mechanisms use.
            motions: By name, each with a mechanism, an integrator, an objective and constraints of
                its own; the constraints of all must hold.
            combine: How the objectives become one; by default their sum, `WeightedSum()`.

        Raises:
            TypeError: If an argument is of a wrong kind.
            ValueError: As for one motion; and if a mechanism names a body that is not there, or the
                weights do not fit the motions.
            MemoryError: On every rank, if the motions would take more memory than a machine has.

        Example:
            >>> Problem.of_motions(
            ...     {"rod": rod},
            ...     {
            ...         "slow": MechanicalProblem(slow, integrator, IntegralCompliance()),
            ...         "fast": MechanicalProblem(fast, integrator, IntegralCompliance()),
            ...     },
            ...     WorstCase({"slow": 3.0, "fast": 1.0}),
            ... )
        """
        problem = cls.__new__(cls)
        problem._set(bodies, lambda: motions, WeightedSum() if combine is None else combine)
        return problem

    def _set(
        self,
        bodies: Mapping[str, FlexibleBody | VolumeIntegrals],
        motions: Callable[[], Mapping[str, MechanicalProblem]],
        combine: Combination,
    ) -> None:
        kinds = (FlexibleBody, VolumeIntegrals)
        validation.instances_by_name(
            "problem: bodies", bodies, kinds, "a FlexibleBody or VolumeIntegrals"
        )
        self.bodies = dict(bodies)
        #: The bodies with a density
        self.flexible = {k: b for k, b in self.bodies.items() if isinstance(b, FlexibleBody)}
        if not self.flexible:
            raise ValueError(
                f"problem: none of the bodies {sorted(self.bodies)} has a density to design; give "
                "at least one FlexibleBody, or use MechanicalProblem, which needs none"
            )
        with on_every_rank(self.comm, "the evaluation of a problem"):
            #: By name
            self.motions = validation.instances_by_name(
                "problem: motions", motions(), MechanicalProblem, "a MechanicalProblem"
            )
            if not self.motions:
                raise ValueError("problem: give at least one motion")
            needed = "WeightedSum(...), PowerMean(...) or WorstCase(...)"
            #: How the objectives of the motions become one number
            self.combine = validation.instance("problem: combine", combine, Combination, needed)
            combine.check(self.motions)
            self._validate()
        integrators = {self._of("the integrator", n): m.integrator for n, m in self.motions.items()}
        check_alike(
            self.comm,
            "problem",
            {"bodies": list(self.bodies), "motions": list(self.motions), "combine": combine}
            | integrators,
        )
        self._memory = agreed_memory(self.comm)
        self._check_memory(adjoint=False)
        self._compile()
        self._settle()

    def _settle(self) -> None:
        """Choose method and steps of motions of which a time interval is given."""
        left_open = [
            name
            for name, motion in self.motions.items()
            if isinstance(motion.integrator, TimeInterval) and motion.needs_trajectory
        ]
        if not left_open:
            return
        reduced = {
            name: body.reduce(
                np.where(body.domain.design_cells, FILLED, body.domain.passive_density)
            )
            for name, body in self.flexible.items()
        }
        parts = self._integrals(reduced), self._fields(reduced), self._stresses(reduced)
        with on_every_rank(self.comm, "the choice of time steps"):
            settled = {n: self.motions[n].settled(*parts).integrator for n in left_open}
        chosen = self.comm.bcast(settled)
        self.motions = {
            name: replace(motion, integrator=chosen.get(name, motion.integrator))
            for name, motion in self.motions.items()
        }
        self._check_memory(adjoint=False)

    def _with(
        self,
        bodies: Mapping[str, FlexibleBody | VolumeIntegrals] | None = None,
        motions: Mapping[str, MechanicalProblem] | None = None,
    ) -> Self:
        """The same problem with other bodies or motions."""
        given = self.bodies if bodies is None else bodies
        return self.of_motions(given, self.motions if motions is None else motions, self.combine)

    def alone(self, motion: str) -> Self:
        """The problem of one of several motions; its evaluation is `Evaluation.alone`.

        Args:
            motion: Name of the motion.

        Raises:
            ValueError: If there is no motion of this name.
        """
        validation.choice("problem: motion", motion, self.motions)
        return self.of_motions(self.bodies, {motion: self.motions[motion]})

    @property
    def mechanism(self) -> Mechanism:
        """That of the only motion: joints, drives, point masses, loads.

        Raises:
            ValueError: If there are several motions; so do `integrator` and `objective`.
        """
        return only_motion(self.motions, "problem.motions[{!r}].mechanism").mechanism

    @property
    def integrator(self) -> Integrator:
        """That of the only motion: time interval and steps."""
        return only_motion(self.motions, "problem.motions[{!r}].integrator").integrator

    @integrator.setter
    def integrator(self, integrator: Integrator) -> None:
        self._change(integrator=integrator)

    @property
    def objective(self) -> Objective:
        """That of the only motion: what is minimised."""
        return only_motion(self.motions, "problem.motions[{!r}].objective").objective

    @objective.setter
    def objective(self, objective: Objective) -> None:
        self._change(objective=objective)

    def _change(self, **parts: Any) -> None:
        """Change parts of the only motion."""
        only_motion(self.motions, "Problem.of_motions")
        self.motions = {name: replace(motion, **parts) for name, motion in self.motions.items()}

    @property
    def constraints(self) -> list[Constraint]:
        """Those of all motions, of several with the name "motion: name"."""
        return [
            constraint
            if len(self.motions) == 1
            else replace(constraint, name=self._label(name, constraint.label))
            for name, motion in self.motions.items()
            for constraint in motion.constraints
        ]

    def _label(self, motion: str, label: str) -> str:
        """The name of a motion's constraint among those of all."""
        return label if len(self.motions) == 1 else f"{motion}: {label}"

    def _of(self, what: str, motion: str) -> str:
        """What a message calls a part of a motion."""
        return what if len(self.motions) == 1 else f"{what} of motion {motion!r}"

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that evaluate the problem together."""
        comm: MPI.Comm = next(iter(self.flexible.values())).domain.comm
        return comm

    def _validate(self) -> None:
        """Refuse objectives and mechanisms that lack a body, a density, a name or coordinates."""
        full = {
            name: _field(body, np.ones(body.domain.n_cells)) for name, body in self.flexible.items()
        }
        markers = {
            name: body.markers
            if isinstance(body, VolumeIntegrals)
            else [*body.domain.interfaces, *body.markers]
            for name, body in self.bodies.items()
        }
        modes = self._modes
        for name, motion in self.motions.items():
            try:
                check_names(motion.mechanism, modes, markers)
                motion.validate_names(markers)
                motion.validate_modes(modes)
                for used in motion.objectives.values():
                    used.validate(full)
            except ValueError as error:
                if len(self.motions) == 1:
                    raise
                raise ValueError(f"motion {name!r}: {error}") from error

    @property
    def _modes(self) -> dict[str, int]:
        """Number of elastic coordinates by body."""
        return {
            name: body.modes if isinstance(body, VolumeIntegrals) else body.n_elastic
            for name, body in self.bodies.items()
        }

    def with_modes(self, modes: Mapping[str, int]) -> Self:
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

    def with_bodies(self, bodies: Mapping[str, FlexibleBody | VolumeIntegrals]) -> Self:
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
        return self._with({**self.bodies, **bodies})

    def integrals(self, evaluation: Evaluation) -> dict[str, VolumeIntegrals]:
        """What the mechanism sees of all bodies, in the order in which they were given.

        Args:
            evaluation: What `value` returned.
        """
        validation.instance("problem: the evaluation", evaluation, Evaluation, "an Evaluation")
        return self._integrals(evaluation.bodies)

    def _check_memory(self, *, adjoint: bool) -> None:
        """Refuse, on every rank alike, what the machine with the least memory cannot hold."""
        moved = {n: m.integrator for n, m in self.motions.items() if m.needs_trajectory}
        with on_every_rank(self.comm, "the evaluation of a problem"):
            modes = self._modes.values()
            space = any(_dimension(body) == 3 for body in self.bodies.values())
            taken = {n: required_memory(each, modes, space=space) for n, each in moved.items()}
            for name, integrator in moved.items():
                # all motions are kept, one adjoint is computed at a time
                left = self._memory - sum(taken.values()) + taken[name]
                check_memory(integrator, modes, left, adjoint=adjoint, space=space)

    def _compile(self) -> None:
        """Compile the time integration on one rank, for the others to find in the cache."""
        integrators = list({type(motion.integrator) for motion in self.motions.values()})
        if self.comm.rank == 0:
            compile_kernels(integrators=integrators)
        self.comm.Barrier()
        compile_kernels(lambda line: None, integrators=integrators)

    def response(self, evaluation: Evaluation) -> Response:
        """What the objective of the only motion is a function of.

        Args:
            evaluation: What `value` returned.

        Raises:
            ValueError: If there are several motions.
        """
        instead = "problem.alone({0!r}).response(evaluation.alone({0!r}))"
        return only_motion(self._responses(evaluation), instead)

    def _responses(self, evaluation: Evaluation) -> dict[str, Response]:
        """What the objectives are functions of, by motion."""
        bodies = evaluation.bodies
        parts = self._integrals(bodies), self._fields(bodies), self._stresses(bodies)
        return {n: Response(motion.trajectory, *parts) for n, motion in evaluation.motions.items()}

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


def _dimension(body: FlexibleBody | VolumeIntegrals) -> int:
    """2 in the plane, 3 in space."""
    return body.dimension if isinstance(body, VolumeIntegrals) else body.domain.dimension


def _field(body: FlexibleBody, density: NDArray[np.float64]) -> DensityField:
    """A density as objectives see it."""

    def on(domain: Domain, values: NDArray[np.float64], whole: DensityField | None) -> DensityField:
        areas, gathered = domain.cell_volumes, domain.comm.allgather
        return DensityField(values, areas, domain.centroids, domain.sum, gathered, whole)

    whole = body.domain.whole
    return on(
        body.domain, density, None if whole is None else on(whole, np.ones(whole.n_cells), None)
    )
