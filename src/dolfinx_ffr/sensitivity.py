# SPDX-License-Identifier: MIT
"""The whole chain: from the densities of the bodies to one number, and its exact gradient back.

    density -> shape functions -> volume integrals -> trajectory -> psi
       x_bar <-   Phi_bar      <-   arrays_bar     <- discrete adjoint <-

The gradient is that of the number that was computed, mesh and time steps included: each room hands
on the transpose of the derivative of its forward map. Its cost does not depend on the number of
densities.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .body import VolumeIntegrals
from .dynamics import Integrator, RadauIIA, Trajectory, compile_kernels, compile_stage_kernels
from .flexible_body import FlexibleBody, ReducedBody
from .mechanical_problem import (
    ConstraintValue,
    MechanicalEvaluation,
    MechanicalProblem,
    parts_of_gradient,
)
from .mechanism import Mechanism
from .objective import Constraint, Objective, Volume
from .stiffening import MARKERS

__all__ = ["Evaluation", "Problem"]

Densities = ArrayLike | Mapping[str, ArrayLike]


@dataclass(frozen=True)
class Evaluation:
    """A value of the objective, its gradient, and what was learnt on the way."""

    psi: float  #: value of the objective (integral compliance: [J s]), the same on every rank
    #: dpsi/dx by body, for each cell owned by this rank, shape (cells,); None where only the value
    #: was asked for
    gradient: dict[str, NDArray[np.float64]] | None
    #: the motion, replicated on every rank; None if neither objective nor constraints depend on it
    trajectory: Trajectory | None = field(repr=False)
    bodies: dict[str, ReducedBody] = field(repr=False)  #: shape functions and integrals
    volume: dict[str, float]  #: share of each body's area that is filled, in [0, 1]
    frequencies: dict[str, NDArray[np.float64]]  #: fixed-interface frequencies [Hz]
    outer_gap: dict[str, float]  #: relative gap between the last mode kept and the next one
    solver_iterations: dict[str, int]  #: conjugate gradient iterations of all pullbacks
    seconds: dict[str, float]  #: time spent in each room [s]
    #: constraints by name, with their gradients where the gradient was asked for
    constraints: dict[str, ConstraintValue] = field(default_factory=dict)
    #: derivative of psi with respect to the integrals of every body, those of given bodies too, the
    #: same on every rank; None where only the value was asked for
    integrals_gradient: dict[str, VolumeIntegrals] | None = field(default=None, repr=False)

    @property
    def motion(self) -> Trajectory:
        """The trajectory, where there must be one.

        Raises:
            ValueError: on every rank, if nothing was simulated.
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
    those of mass, volume or a frequency need none. Without any flexible body use
    `MechanicalProblem`, on which this class is built.

    Args:
        bodies: by the names that the mechanism uses; `FlexibleBody` for bodies with a density,
            `VolumeIntegrals` for given ones (rigid bodies, standard input data).
        mechanism: joints, motions, point masses, gravity.
        integrator: time interval and steps.
        objective: what is minimised.
        constraints: bounds on further objectives, for optimisers that take several.

    Raises:
        ValueError: if no body has a density, two constraints have the same name, or one bounds the
            volume of a body without density.
    """

    def __init__(
        self,
        bodies: Mapping[str, FlexibleBody | VolumeIntegrals],
        mechanism: Mechanism,
        integrator: Integrator,
        objective: Objective,
        constraints: Sequence[Constraint] = (),
    ) -> None:
        self.bodies = dict(bodies)
        self.mechanism = mechanism
        self.integrator = integrator
        self.objective = objective
        self.constraints = list(constraints)
        #: the bodies with a density
        self.flexible = {k: b for k, b in self.bodies.items() if isinstance(b, FlexibleBody)}
        if not self.flexible:
            raise ValueError(
                f"problem: none of the bodies {sorted(self.bodies)} has a density to design; give "
                "at least one FlexibleBody, or use MechanicalProblem, which needs none"
            )
        MechanicalProblem(mechanism, integrator, objective, self.constraints)  # checks the names
        for constraint in self.constraints:
            bounded = constraint.objective
            if isinstance(bounded, Volume) and bounded.body not in self.flexible:
                raise ValueError(
                    f"problem: constraint {constraint.label!r} bounds the volume of body "
                    f"{bounded.body!r}, but the bodies with a density are {sorted(self.flexible)}"
                )
        self._compile()

    def with_modes(self, modes: Mapping[str, int]) -> Problem:
        """Return the same problem with other numbers of normal modes.

        Args:
            modes: number of normal modes by name of the body; other bodies stay as they are.

        Raises:
            ValueError: if a name is not that of a flexible body, or a number is out of range.
        """
        unknown = sorted(set(modes) - set(self.flexible))
        if unknown:
            raise ValueError(
                f"problem: no flexible body {unknown[0]!r}; there are {sorted(self.flexible)}"
            )
        bodies = {
            name: body.with_modes(modes[name])
            if isinstance(body, FlexibleBody) and name in modes
            else body
            for name, body in self.bodies.items()
        }
        return Problem(bodies, self.mechanism, self.integrator, self.objective, self.constraints)

    def with_tolerance(self, x: Densities, tolerance: float) -> Problem:
        """Return the same problem with time steps for an accuracy of psi.

        See `MechanicalProblem.with_tolerance`. Choose once, and keep the steps while designing.

        Args:
            x: densities, as for `value`.
            tolerance: largest relative error of the objective, and of bounded ones, by the steps.

        Raises:
            ValueError: as `value` does, or if the tolerance is out of range.
            SimulationError: on every rank, if the motion cannot be computed or the tolerance is not
                reached; the message says what was.
        """
        densities = self._by_name(x)
        reduced = {name: body.reduce(densities[name]) for name, body in self.flexible.items()}
        chosen = self._mechanical().with_tolerance(self._integrals(reduced), tolerance)
        return Problem(
            self.bodies, self.mechanism, chosen.integrator, self.objective, self.constraints
        )

    def integrals(self, evaluation: Evaluation) -> dict[str, VolumeIntegrals]:
        """Return what the mechanism sees of all bodies, in the order in which they were given.

        Args:
            evaluation: what `value` returned.
        """
        return self._integrals(evaluation.bodies)

    def _compile(self) -> None:
        """Compile the time integration on one rank, for the others to find in the cache."""
        comm = next(iter(self.flexible.values())).domain.comm
        stiffened = any(
            MARKERS in body.stiffening.loads
            if isinstance(body, FlexibleBody) and body.stiffening is not None
            else isinstance(body, VolumeIntegrals)
            and any(marker.stiffening is not None for marker in body.markers.values())
            for body in self.bodies.values()
        )
        loops = [compile_kernels]
        if isinstance(self.integrator, RadauIIA):
            loops.append(compile_stage_kernels)
        for compile_loops in loops:
            if comm.rank == 0:
                compile_loops(stiffened_markers=stiffened)
            comm.Barrier()
            compile_loops(announce=lambda line: None, stiffened_markers=stiffened)

    def value(self, x: Densities) -> Evaluation:
        """Return the objective and the constraints at densities.

        Args:
            x: densities of the cells owned by this rank, shape (cells,), in [0, 1]; with more than
                one flexible body a mapping by name.

        Raises:
            ValueError: on every rank, if a density has the wrong size, is NaN or leaves [0, 1].
            SimulationError: on every rank, if the motion cannot be computed.
        """
        densities = self._by_name(x)
        reduced = {name: body.reduce(densities[name]) for name, body in self.flexible.items()}
        seconds: dict[str, float] = {}
        for part in reduced.values():
            _add(seconds, part.seconds)
        found = self._mechanical().value(self._integrals(reduced))
        _add(seconds, found.seconds)
        volume = {name: b.volume(densities[name])[0] for name, b in self.flexible.items()}
        constraints = {}
        for bound in self.constraints:
            if isinstance(bound.objective, Volume):
                share = volume[bound.objective.body]
                constraints[bound.label] = ConstraintValue(bound.scaled(share), share)
            else:
                constraints[bound.label] = found.constraints[bound.label]
        return Evaluation(
            psi=found.psi,
            gradient=None,
            trajectory=found.trajectory,
            bodies=reduced,
            volume=volume,
            frequencies={name: part.basis.frequencies for name, part in reduced.items()},
            outer_gap={name: part.basis.outer_gap for name, part in reduced.items()},
            solver_iterations={},
            seconds=seconds,
            constraints=constraints,
        )

    def gradient(self, x: Densities) -> Evaluation:
        """Return objective and constraints with their exact gradients at densities.

        Args:
            x: as for `value`.

        Raises:
            ValueError: as `value` does.
            SimulationError: as `value` does.
            RuntimeError: on every rank, if an adjoint system cannot be solved.
        """
        return self.differentiate(self.value(x))

    def differentiate(self, evaluation: Evaluation) -> Evaluation:
        """Return an evaluation with the exact gradients added.

        So a design whose value is rejected need not be differentiated.

        Args:
            evaluation: what `value` returned last; the factors of an earlier one are gone.

        Raises:
            RuntimeError: on every rank, if another density has been evaluated since, or an adjoint
                system cannot be solved.
        """
        found = self._mechanical().differentiate(
            MechanicalEvaluation(
                psi=evaluation.psi,
                integrals_gradient=None,
                constraints=evaluation.constraints,
                trajectory=evaluation.trajectory,
                bodies=self._integrals(evaluation.bodies),
                seconds=evaluation.seconds,
            )
        )
        assert found.integrals_gradient is not None
        seconds = dict(found.seconds)
        iterations = dict.fromkeys(self.flexible, 0)
        constraints = {}
        for bound in self.constraints:
            value = found.constraints.get(bound.label, evaluation.constraints[bound.label])
            if isinstance(bound.objective, Volume):
                gradient = {k: np.zeros(b.domain.n_cells) for k, b in self.flexible.items()}
                body = bound.objective.body
                share = self.flexible[body].volume(evaluation.bodies[body].density)[1]
                gradient[body] = bound.slope * share
            else:
                assert value.integrals_gradient is not None
                gradient = self._to_densities(
                    evaluation, value.integrals_gradient, iterations, seconds
                )
            constraints[bound.label] = replace(value, gradient=gradient)
        return replace(
            evaluation,
            gradient=self._to_densities(evaluation, found.integrals_gradient, iterations, seconds),
            integrals_gradient=found.integrals_gradient,
            constraints=constraints,
            solver_iterations=iterations,
            seconds=seconds,
        )

    def _to_densities(
        self,
        evaluation: Evaluation,
        bars: Mapping[str, VolumeIntegrals],
        iterations: dict[str, int],
        seconds: dict[str, float],
    ) -> dict[str, NDArray[np.float64]]:
        """Return derivatives with respect to the densities from those to the integrals."""
        gradient: dict[str, NDArray[np.float64]] = {}
        for name, body in self.flexible.items():
            # the same on every rank, so all skip a body that does not matter, or none
            if bars[name].dot(bars[name]) == 0.0:
                gradient[name] = np.zeros(body.domain.n_cells)
                continue
            gradient[name], learnt = body.pullback(evaluation.bodies[name], bars[name])
            iterations[name] += int(learnt.pop("iterations"))
            _add(seconds, learnt)
        return gradient

    def integral_gradients(
        self, evaluation: Evaluation
    ) -> tuple[dict[str, VolumeIntegrals], dict[str, VolumeIntegrals]]:
        """Return the derivatives of psi with respect to the volume integrals of all bodies.

        Args:
            evaluation: what `value` returned.

        Returns:
            By name of the body, at fixed motion (only bodies on which the objective depends
            directly), and through the motion. The same on every rank.
        """
        integrals = self._integrals(evaluation.bodies)
        return parts_of_gradient(self.objective, evaluation.trajectory, integrals)

    def _mechanical(self) -> MechanicalProblem:
        """Return the part of the problem that sees only integrals."""
        bounds = [b for b in self.constraints if not isinstance(b.objective, Volume)]
        return MechanicalProblem(self.mechanism, self.integrator, self.objective, bounds)

    def _integrals(self, reduced: Mapping[str, ReducedBody]) -> dict[str, VolumeIntegrals]:
        """Return what the mechanism sees of all bodies, in the order in which they were given."""
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


def _add(total: dict[str, float], part: Mapping[str, float]) -> None:
    for key, value in part.items():
        total[key] = total.get(key, 0.0) + value
