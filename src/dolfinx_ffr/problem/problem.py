# SPDX-License-Identifier: MIT
"""The whole chain: from the densities of the bodies to one number, and its exact gradient back.

    density -> shape functions -> volume integrals -> trajectory -> psi
       x_bar <-   Phi_bar      <-   arrays_bar     <- discrete adjoint <-

The gradient is that of the number that was computed, mesh and time steps included: each map hands
on the transpose of its derivative. Its cost does not depend on the number of densities.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..body import VolumeIntegrals
from ..dynamics import Integrator
from ..mechanical_problem import ConstraintValue, MechanicalEvaluation
from ..objective import Derivatives, Response, StressField
from ..parallel import check_alike, on_every_rank
from ..reduction import FlexibleBody
from .definition import Densities, MovingBodies
from .evaluation import Evaluation, MotionEvaluation
from .spread import Job, adjoints, trajectories

__all__ = ["Problem"]

#: Objective and constraints of a motion
Values = tuple[float, dict[str, ConstraintValue]]

#: Relative difference from which on two ranks have not computed the same number: a motion magnifies
#: round-off, and stays far below
DIFFERS = 1e-6


class Problem(MovingBodies):
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
        integrator: Time interval and steps, or a `TimeInterval` for which steps are chosen.
        objective: What is minimised.
        constraints: Bounds on further objectives, for optimisers that take several.

    Raises:
        TypeError: If an argument is of a wrong kind.
        ValueError: If no body has a density, two constraints have the same name, or an objective
            depends on the density of a body that has none.
        MemoryError: On every rank, if the motion would take more memory than a machine has.
    """

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
        of_bodies = self._fields(reduced), self._stresses(reduced)
        with on_every_rank(self.comm, "the evaluation of a problem"):
            chosen = {
                name: motion.with_tolerance(self._integrals(reduced), tolerance, *of_bodies)
                for name, motion in self.motions.items()
            }
        return self._with(motions=chosen)

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
        responses = self._responses(evaluation)
        with on_every_rank(self.comm, "the evaluation of a problem"):
            motions = {n: m.calibrated(responses[n]) for n, m in self.motions.items()}
        if all(motions[name] is motion for name, motion in self.motions.items()):
            return self, evaluation
        problem = self._with(motions=motions)
        with on_every_rank(self.comm, "the evaluation of a problem"):
            found = {n: m.evaluated(responses[n]) for n, m in motions.items()}
        psi, values, constraints = problem._shared(found)
        changed = {
            name: replace(
                motion,
                psi=values[name][0],
                constraints=values[name][1],
                gradient=None,
                integrals_gradient=None,
            )
            for name, motion in evaluation.motions.items()
        }
        return problem, replace(
            evaluation,
            psi=psi,
            constraints=constraints,
            gradient=None,
            integrals_gradient=None,
            motions=changed,
        )

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
        begin = perf_counter()
        integrals, fields = self._integrals(reduced), self._fields(reduced)
        stresses = self._stresses(reduced)
        moved = trajectories(self.comm, self.motions, integrals)
        with on_every_rank(self.comm, "the evaluation of a problem"):
            found = {
                name: motion.evaluated(Response(moved[name], integrals, fields, stresses))
                for name, motion in self.motions.items()
            }
        self._check_agreement(found)
        psi, values, constraints = self._shared(found)
        _add(seconds, {"simulation": perf_counter() - begin})
        volume = {name: _filled(b, densities[name]) for name, b in self.flexible.items()}
        return Evaluation(
            psi=psi,
            gradient=None,
            bodies=reduced,
            volume=volume,
            fixed_interface_frequencies={
                name: part.basis.frequencies for name, part in reduced.items()
            },
            outer_gap={name: part.basis.outer_gap for name, part in reduced.items()},
            solver_iterations={},
            seconds=seconds,
            constraints=constraints,
            motions={
                name: MotionEvaluation(values[name][0], moved[name], values[name][1])
                for name in self.motions
            },
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

    def differentiate(self, evaluation: Evaluation, *, by_motion: bool = False) -> Evaluation:
        """An evaluation with the exact gradients added.

        So a design whose value is rejected need not be differentiated. Bodies keep the factor of
        the density that they were reduced at last; for an earlier evaluation their matrices are
        assembled and factored once more.

        Args:
            evaluation: What `value` returned, at any time.
            by_motion: Give each of several motions a gradient of its own, too, which takes as many
                adjoint solutions of the finite elements. With `WorstCase`, those near the largest
                value always have one.

        Raises:
            MemoryError: On every rank, if that would take more memory than a machine has.
            RuntimeError: On every rank, if an adjoint system cannot be solved.
        """
        validation.instance("problem: the evaluation", evaluation, Evaluation, "an Evaluation")
        self._check_memory(adjoint=True)
        psis = {name: motion.psi for name, motion in evaluation.motions.items()}
        slopes = self.combine.slopes(psis)
        apart = list(psis) if by_motion else self.combine.near(psis)
        begin = perf_counter()
        found = self._differentiated(evaluation, {n for n in psis if slopes[n] or n in apart})
        seconds = {**evaluation.seconds, "adjoint": perf_counter() - begin}
        iterations = dict.fromkeys(self.flexible, 0)
        motions, constraints = {}, {}
        for name, part in found.items():
            own = {}
            for label, value in part.constraints.items():
                pulled = self._to_densities(evaluation, _bars(value), iterations, seconds)
                # that by stress is large, and its work is done
                own[label] = replace(value, gradient=pulled, stress_gradient=None)
                constraints[self._label(name, label)] = own[label]
            apart_gradient = None
            if name in apart and len(found) > 1:
                apart_gradient = self._to_densities(evaluation, _bars(part), iterations, seconds)
            motions[name] = replace(
                evaluation.motions[name],
                constraints=own,
                gradient=apart_gradient,
                integrals_gradient=part.integrals_gradient,
            )
        counting = {name: slope for name, slope in slopes.items() if slope}
        total = _weighted({name: _bars(found[name]) for name in counting}, counting)
        apart_already = [Derivatives(densities=motions[n].gradient or {}) for n in counting]
        if all(part.densities for part in apart_already):
            own_parts = dict(zip(counting, apart_already, strict=True))
            gradient = dict(_weighted(own_parts, counting).densities)
        else:
            gradient = self._to_densities(evaluation, total, iterations, seconds)
        if len(motions) == 1:
            motions = {n: replace(motion, gradient=gradient) for n, motion in motions.items()}
        return replace(
            evaluation,
            gradient=gradient,
            integrals_gradient=dict(total.integrals),
            constraints=constraints,
            motions=motions,
            solver_iterations=iterations,
            seconds=seconds,
        )

    def _differentiated(
        self, evaluation: Evaluation, wanted: Collection[str]
    ) -> dict[str, MechanicalEvaluation]:
        """Values with their derivatives by integrals, densities and stress, by motion.

        Args:
            evaluation: What `value` returned.
            wanted: Motions whose objective is to be differentiated; constraints always are.
        """
        responses = self._responses(evaluation)
        bare = {
            name: MechanicalEvaluation(
                psi=evaluation.motions[name].psi,
                integrals_gradient=None,
                constraints=evaluation.motions[name].constraints,
                trajectory=response.trajectory,
                bodies=dict(response.bodies),
                seconds={},
                densities=response.densities,
                stresses=response.stresses,
            )
            for name, response in responses.items()
        }
        if len(self.motions) == 1:
            with on_every_rank(self.comm, "the evaluation of a problem"):
                return {
                    name: motion.differentiate(bare[name]) for name, motion in self.motions.items()
                }
        direct, through = self._parts(responses, wanted)
        return {
            name: motion.differentiated(
                bare[name],
                {
                    label: (direct[name, label], through[name, label])
                    for label in motion.objectives
                    if (name, label) in direct
                },
            )
            for name, motion in self.motions.items()
        }

    def _parts(
        self,
        responses: Mapping[str, Response],
        wanted: Collection[str],
        *,
        constraints: bool = True,
    ) -> tuple[dict[Job, Derivatives], dict[Job, dict[str, VolumeIntegrals]]]:
        """Derivatives at fixed motion, and those by integrals through it, by motion and label."""
        with on_every_rank(self.comm, "the evaluation of a problem"):
            direct = {
                (name, label): objective.derivatives(responses[name])
                for name, motion in self.motions.items()
                for label, objective in motion.objectives.items()
                if (constraints if label else name in wanted)
            }
        through = adjoints(self.comm, responses, {k: d.trajectory for k, d in direct.items()})
        return {k: replace(part, trajectory=None) for k, part in direct.items()}, through

    def _to_densities(
        self,
        evaluation: Evaluation,
        found: Derivatives,
        iterations: dict[str, int],
        seconds: dict[str, float],
    ) -> dict[str, NDArray[np.float64]]:
        """Derivatives with respect to the densities, through the reduction and at fixed one."""
        bars, direct, stresses = found.integrals, found.densities, found.stresses
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
        direct, through, slopes = self._parts_of_psi(evaluation)
        motion = _weighted({n: Derivatives(integrals=bars) for n, bars in through.items()}, slopes)
        return dict(_weighted(direct, slopes).integrals), dict(motion.integrals)

    def _parts_of_psi(
        self, evaluation: Evaluation
    ) -> tuple[dict[str, Derivatives], dict[str, dict[str, VolumeIntegrals]], dict[str, float]]:
        """Of each motion that counts both parts of its derivatives, and its weight in psi."""
        slopes = self.combine.slopes({n: motion.psi for n, motion in evaluation.motions.items()})
        counting = {name: slope for name, slope in slopes.items() if slope}
        direct, through = self._parts(self._responses(evaluation), counting, constraints=False)
        return (
            {name: direct[name, ""] for name in counting},
            {name: through[name, ""] for name in counting},
            counting,
        )

    def partial_derivatives(self, evaluation: Evaluation) -> Derivatives:
        """The derivatives of psi with respect to trajectory, integrals and densities, each alone.

        Args:
            evaluation: What `value` returned.

        Returns:
            That with respect to the trajectory is None where there are several motions.
        """
        responses = self._responses(evaluation)
        slopes = self.combine.slopes({n: motion.psi for n, motion in evaluation.motions.items()})
        counting = {name: slope for name, slope in slopes.items() if slope}
        with on_every_rank(self.comm, "the evaluation of a problem"):
            found = {
                name: self.motions[name].objective.derivatives(responses[name]) for name in counting
            }
        if len(self.motions) > 1:
            found = {name: replace(part, trajectory=None) for name, part in found.items()}
        return _weighted(found, counting)

    def psi_with(
        self,
        evaluation: Evaluation,
        bodies: Mapping[str, VolumeIntegrals],
        stresses: Mapping[str, StressField],
        integrators: Mapping[str, Integrator] | None = None,
    ) -> float:
        """The objective at the densities of an evaluation, with other integrals or other steps.

        Nothing is warned of. Elastic coordinates at the start are those of the bodies' first shape
        functions.

        Args:
            evaluation: What `value` returned.
            bodies: Volume integrals of all bodies, by name.
            stresses: Stress of the bodies that have a mesh, by name.
            integrators: Other ones than the problem's, by motion.

        Raises:
            SimulationError: On every rank, if a motion cannot be computed.
        """
        modes = {name: body.modes for name, body in bodies.items()}
        motions = {
            name: replace(
                motion,
                mechanism=replace(motion.mechanism, start=motion.mechanism.start.resized(modes)),
                integrator=(integrators or {}).get(name, motion.integrator),
            )
            for name, motion in self.motions.items()
        }
        found = trajectories(self.comm, motions, bodies, warn=False)
        fields = self._fields(evaluation.bodies)
        with on_every_rank(self.comm, "the evaluation of a problem"):
            return self.combine.value(
                {
                    name: motion.objective.evaluate(Response(found[name], bodies, fields, stresses))
                    for name, motion in motions.items()
                }
            )

    def _check_agreement(self, found: Mapping[str, MechanicalEvaluation]) -> None:
        """Refuse objectives and constraints that differ between the ranks."""
        said: dict[str, Any] = {}
        for name, motion in self.motions.items():
            said[self._of("integrator", name)] = motion.integrator
            said[self._of("the objective", name)] = float(found[name].psi)
            for label, value in found[name].constraints.items():
                said[self._of(f"the constraint {label!r}", name)] = value.psi
        check_alike(self.comm, "problem", said, DIFFERS)

    def _shared(
        self, found: Mapping[str, MechanicalEvaluation]
    ) -> tuple[float, dict[str, Values], dict[str, ConstraintValue]]:
        """Psi, objective and constraints of each motion, and all constraints, those of rank 0.

        Every rank computes them, and its own last bits may decide nothing.
        """
        own = {name: (part.psi, part.constraints) for name, part in found.items()}
        values: dict[str, Values] = self.comm.bcast(own, root=0)
        with on_every_rank(self.comm, "the evaluation of a problem"):
            psi = self.combine.value({name: value for name, (value, _) in values.items()})
        constraints = {
            self._label(name, label): value
            for name, (_, of_motion) in values.items()
            for label, value in of_motion.items()
        }
        return psi, values, constraints


def _filled(body: FlexibleBody, density: NDArray[np.float64]) -> float:
    """The filled share of a body's area at a density that has been checked."""
    domain = body.domain
    return domain.sum(density * (domain.cell_volumes / domain.area))


def _bars(found: MechanicalEvaluation | ConstraintValue) -> Derivatives:
    """The derivatives of an objective or a constraint through its motion and at fixed motion."""
    by_integrals, by_densities = found.integrals_gradient, found.density_gradient
    by_stress = found.stress_gradient
    assert by_integrals is not None and by_densities is not None and by_stress is not None
    return Derivatives(None, by_integrals, by_densities, by_stress)


def _weighted(parts: Mapping[str, Derivatives], weights: Mapping[str, float]) -> Derivatives:
    """Their sum with weights."""
    scaled = [p if weights[n] == 1.0 else p.scaled(weights[n]) for n, p in parts.items()]
    return sum(scaled[1:], scaled[0])


def _add(total: dict[str, float], part: Mapping[str, float]) -> None:
    for key, value in part.items():
        total[key] = total.get(key, 0.0) + value
