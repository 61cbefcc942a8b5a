# SPDX-License-Identifier: MIT
"""The whole chain: from the densities of the bodies to one number, and its exact gradient back.

    density -> shape functions -> volume integrals -> trajectory -> psi
       x_bar <-   Phi_bar      <-   arrays_bar     <- discrete adjoint <-

The gradient is that of the number that was computed, mesh and time steps included: each room hands
on the transpose of the derivative of its forward map. Its cost does not depend on the number of
densities.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .body import VolumeIntegrals
from .dynamics import GeneralizedAlpha, Trajectory, adjoint, compile_kernels, simulate
from .flexible_body import FlexibleBody, ReducedBody
from .mechanism import Mechanism
from .objective import Objective

__all__ = ["Evaluation", "Problem"]

Densities = ArrayLike | Mapping[str, ArrayLike]


@dataclass(frozen=True)
class Evaluation:
    """A value of the objective, its gradient, and what was learnt on the way."""

    psi: float  #: value of the objective (integral compliance: [J s]), the same on every rank
    #: dpsi/dx by body, for each cell owned by this rank, shape (cells,); None where only the value
    #: was asked for
    gradient: dict[str, NDArray[np.float64]] | None
    trajectory: Trajectory = field(repr=False)  #: the motion, replicated on every rank
    bodies: dict[str, ReducedBody] = field(repr=False)  #: shape functions and integrals
    volume: dict[str, float]  #: share of each body's area that is filled, in [0, 1]
    frequencies: dict[str, NDArray[np.float64]]  #: fixed-interface frequencies [Hz]
    outer_gap: dict[str, float]  #: relative gap between the last mode kept and the next one
    solver_iterations: dict[str, int]  #: conjugate gradient iterations of the pullback
    seconds: dict[str, float]  #: time spent in each room [s]


class Problem:
    """Minimise psi(x): an objective of a mechanism's motion as a function of its bodies' densities.

        psi(x) = objective(trajectory),   the trajectory solves the equations of motion
                                          of the mechanism with bodies(x)

    Args:
        bodies: by the names that the mechanism uses; `FlexibleBody` for bodies with a density,
            `VolumeIntegrals` for given ones (rigid bodies, standard input data).
        mechanism: joints, motions, point masses, gravity.
        integrator: time interval and steps.
        objective: what is minimised.

    Raises:
        ValueError: if no body has a density.
    """

    def __init__(
        self,
        bodies: Mapping[str, FlexibleBody | VolumeIntegrals],
        mechanism: Mechanism,
        integrator: GeneralizedAlpha,
        objective: Objective,
    ) -> None:
        self.bodies = dict(bodies)
        self.mechanism = mechanism
        self.integrator = integrator
        self.objective = objective
        #: the bodies with a density
        self.flexible = {k: b for k, b in self.bodies.items() if isinstance(b, FlexibleBody)}
        if not self.flexible:
            raise ValueError(
                f"problem: none of the bodies {sorted(self.bodies)} has a density to design; give "
                "at least one FlexibleBody, or call simulate directly"
            )

        self._compile()

    def _compile(self) -> None:
        """Compile the time integration on one rank, for the others to find in the cache."""
        comm = next(iter(self.flexible.values())).domain.comm
        if comm.rank == 0:
            compile_kernels()
        comm.Barrier()
        compile_kernels(announce=lambda line: None)

    def value(self, x: Densities) -> Evaluation:
        """Return the objective at densities.

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
        integrals = self._integrals(reduced)
        start = perf_counter()
        trajectory = simulate(self.mechanism, integrals, self.integrator)
        psi = self.objective.value(trajectory, integrals)
        seconds["simulation"] = perf_counter() - start
        return Evaluation(
            psi=float(psi),
            gradient=None,
            trajectory=trajectory,
            bodies=reduced,
            volume={name: b.volume(densities[name])[0] for name, b in self.flexible.items()},
            frequencies={name: part.basis.frequencies for name, part in reduced.items()},
            outer_gap={name: part.basis.outer_gap for name, part in reduced.items()},
            solver_iterations={},
            seconds=seconds,
        )

    def gradient(self, x: Densities) -> Evaluation:
        """Return the objective and its exact gradient at densities.

        Args:
            x: as for `value`.

        Raises:
            ValueError: as `value` does.
            SimulationError: as `value` does.
            RuntimeError: on every rank, if an adjoint system cannot be solved.
        """
        return self.differentiate(self.value(x))

    def differentiate(self, evaluation: Evaluation) -> Evaluation:
        """Return an evaluation with the exact gradient added.

        So a design whose value is rejected need not be differentiated.

        Args:
            evaluation: what `value` returned last; the factors of an earlier one are gone.

        Raises:
            RuntimeError: on every rank, if another density has been evaluated since, or an adjoint
                system cannot be solved.
        """
        seconds = dict(evaluation.seconds)
        start = perf_counter()
        direct, bars = self.integral_gradients(evaluation)
        seconds["adjoint"] = perf_counter() - start
        iterations: dict[str, int] = {}
        gradient: dict[str, NDArray[np.float64]] = {}
        for name, body in self.flexible.items():
            bar = bars[name] + direct[name] if name in direct else bars[name]
            gradient[name], learnt = body.pullback(evaluation.bodies[name], bar)
            iterations[name] = int(learnt.pop("iterations"))
            _add(seconds, learnt)
        return replace(evaluation, gradient=gradient, solver_iterations=iterations, seconds=seconds)

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
        trajectory_bar, direct = self.objective.pullback(evaluation.trajectory, integrals)
        return direct, adjoint(evaluation.trajectory, trajectory_bar)

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
