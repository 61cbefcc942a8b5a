# SPDX-License-Identifier: MIT
"""What psi loses by the normal modes that are left out, and how many are enough.

With the displacements that the modes left out would add under the loads of the motion
(`dolfinx_ffr.reduction.with_residual_modes`) psi changes by what is missing. That takes neither
further normal modes nor another finite-element solution.

- `mode_error` estimates that from an evaluation, for about half the cost of a value: cheap enough
  for now and then in a design loop, as a design that becomes a truss needs more modes than the full
  body at its start;
- `propose_modes` proposes numbers of modes from the same, more or fewer;
- `select_modes` takes the least numbers and reports the error of each;
- `modes_below` counts those below a frequency.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..body import VolumeIntegrals
from ..dynamics import Integrator, SimulationError, TimeStepWarning
from ..parallel import announce
from ..problem import Evaluation, Problem
from ..reduction import (
    CLUSTER,
    BodyStress,
    FlexibleBody,
    ReducedBasis,
    ReducedBody,
    with_residual_modes,
)
from .local_modes import warn_of_local_modes

__all__ = [
    "ModeSelection",
    "integrals_of",
    "mode_error",
    "modes_below",
    "own_bodies",
    "propose_modes",
    "psi_with",
    "relative_change",
    "select_modes",
    "warn_of_stiff_damping",
    "with_all_residual_modes",
]

Array = NDArray[np.float64]
#: Bodies by name, flexible ones with their shape functions.
Bodies = dict[str, ReducedBody | VolumeIntegrals]

#: How far above the squared frequency of a residual mode normal modes are counted, relative to it:
#: the one that it stands for lies below it, by Rayleigh and Ritz, but for round-off
ROOM = 1e-2
#: Error by the modes left out from which on it is asked whether it is one of the steps
DOUBTFUL = 1e-2


def mode_error(problem: Problem, evaluation: Evaluation) -> dict[str, float]:
    """Estimated relative error of psi by the normal modes that each body leaves out.

    The bodies of the evaluation are used as they are. At the density at which a body was reduced
    last, the cost is that of a back-substitution and of one simulation with some seven coordinates
    more, about half that of the value of a body of 4,000 cells with eight modes; at another density
    its matrices are assembled and factored first. The modes left out count by what they add
    statically; `model_report` takes a second term of their series.

    Args:
        problem: The scene.
        evaluation: What its `value` returned, at any time.

    Returns:
        By name of the flexible bodies, the change of psi with what the other modes of this body
        would add, relative to psi; the same on every rank.

    Warns:
        TimeStepWarning: If shorter steps take half of an error or more away: of a body with much
            damping proportional to stiffness it is one of the steps.

    Raises:
        ValueError: If nothing was simulated.
        SimulationError: If the motion with more modes cannot be computed.
    """
    whole = _checked(problem, evaluation, "mode_error", terms=1)
    own, found = own_bodies(problem, evaluation), {}
    for name in problem.flexible:
        bodies = {**own, name: whole[name]}
        found[name] = relative_change(evaluation.psi, psi_with(problem, evaluation, bodies))
        warn_of_stiff_damping(problem, evaluation, bodies, found[name])
    return found


def propose_modes(
    problem: Problem, evaluation: Evaluation, *, tolerance: float = 2e-3
) -> dict[str, int]:
    """Numbers of normal modes, more or fewer than the problem has, for an accuracy of psi.

    If the present ones are enough, the least number of them that holds the tolerance is sought by
    bisection. If not, bisection tells which of the residual modes must be there, and all normal
    modes up to its frequency are counted: they include those that do not matter, but which a solver
    for the lowest ones finds first. More than the proposed number may be needed where the residual
    modes stand for many; `mode_error` tells at the next evaluation. A number within the present
    ones does not cut a cluster of frequencies. It goes to `Problem.with_modes`.

    Args:
        problem: The scene.
        evaluation: What its `value` returned, at any time.
        tolerance: Relative error of psi that is allowed for each body.

    Returns:
        By name of the flexible bodies.

    Warns:
        LocalModesWarning: If some of the present modes shake nothing but pieces that no material
            holds, and take the places of others.

    Raises:
        ValueError: If nothing was simulated, or the tolerance is out of range.
        SimulationError: If the motion with another number of modes cannot be computed.
        RuntimeError: On every rank, if modes cannot be counted.
    """
    tolerance = validation.number("propose_modes: tolerance", tolerance, above=0.0)
    whole = _checked(problem, evaluation, "propose_modes", terms=2)
    own = own_bodies(problem, evaluation)
    warn_of_local_modes(problem, evaluation)
    proposed = {}
    for name, body in problem.flexible.items():
        reduced = evaluation.bodies[name]
        basis, residual = reduced.basis, integrals_of(whole[name])
        exact = psi_with(problem, evaluation, {**own, name: whole[name]})

        def holds(number: int, name: str = name, exact: float = exact) -> bool:
            shorter = whole[name].leading(evaluation.bodies[name].basis.n_constraint + number)
            if integrals_of(shorter).modes == 0:  # a flexible body without any shape function
                return False
            try:
                psi = psi_with(problem, evaluation, {**own, name: shorter})
            except SimulationError:  # as of a torn design with too few
                return False
            return relative_change(psi, exact) <= tolerance

        number = _least(holds, residual.modes - basis.n_constraint, len(basis.eigenvalues))
        kept = len(basis.eigenvalues)
        if number <= kept:
            uncut = np.flatnonzero(_uncut(basis))
            # the present number may itself cut a cluster, of which reduction warns
            proposed[name] = int(uncut[uncut >= number][0]) if np.any(uncut >= number) else kept
        else:
            at = basis.n_constraint + number - 1
            square = residual.K[at, at]
            found = body.count_below(reduced, (1.0 + ROOM) * square)
            proposed[name] = min(max(found, kept + 1), body.reduction.most_modes)
    return proposed


@dataclass(frozen=True)
class ModeSelection:
    """Numbers of normal modes, and estimates of what the others would add."""

    modes: dict[str, int]  #: Chosen numbers of normal modes, by name of the body
    #: By name of the body, estimated relative error of psi with 0, 1, 2, ... and all its modes
    errors: dict[str, Array] = field(repr=False)
    error: float = 0.0  #: Estimated relative error of psi with the chosen numbers of all bodies


def select_modes(
    problem: Problem,
    x: ArrayLike | Mapping[str, ArrayLike] | None = None,
    *,
    tolerance: float = 1e-3,
) -> ModeSelection:
    """The least numbers of normal modes that an accuracy of psi needs.

    Shape functions are computed once, as many as the problem has; simulations with fewer of them
    are compared with one that has them all, and residual modes for those that not even the problem
    has. A number that would cut through a cluster of frequencies is passed over. Choose once, for
    example at the full bodies, and keep the numbers while designing: `Problem.with_modes`.

    Args:
        problem: The scene, with as many modes as may be needed (16, say).
        x: Densities, by default those of the full bodies.
        tolerance: Relative error of psi that is allowed for each body.

    Raises:
        ValueError: If all modes of the problem together are too few for the tolerance.
    """
    validation.instance("select_modes: problem", problem, Problem, "a Problem")
    validation.number("select_modes: tolerance", tolerance, above=0.0)
    if x is None:
        x = {name: np.ones(body.domain.n_cells) for name, body in problem.flexible.items()}
    evaluation = problem.value(x)
    whole = with_all_residual_modes(problem, evaluation)
    exact = psi_with(problem, evaluation, whole)
    chosen: dict[str, int] = {}
    errors: dict[str, Array] = {}
    for name in problem.flexible:
        basis = evaluation.bodies[name].basis
        k, last = basis.n_constraint, len(basis.eigenvalues)
        found = []
        for modes in range(last + 1):
            if k + modes == 0:
                found.append(math.inf)  # a flexible body without any shape function
                continue
            psi = psi_with(problem, evaluation, {**whole, name: whole[name].leading(k + modes)})
            found.append(relative_change(psi, exact))
        errors[name] = np.array(found)
        wide = _uncut(basis)
        # all larger numbers must hold the tolerance as well
        holds = np.logical_and.accumulate((errors[name] <= tolerance)[::-1])[::-1]
        fits = np.flatnonzero(holds & wide)
        if len(fits) == 0:
            raise ValueError(
                f"select_modes: with all {last} normal modes of body {name!r} the estimated error "
                f"of psi is {errors[name][-1]:.1e}, and {tolerance:.1e} is not held by a number "
                "that keeps close frequencies together; give the problem more modes to choose from"
            )
        chosen[name] = int(fits[0])
    together = {
        name: body.leading(evaluation.bodies[name].basis.n_constraint + chosen[name])
        if name in chosen
        else body
        for name, body in whole.items()
    }
    return ModeSelection(
        chosen, errors, relative_change(psi_with(problem, evaluation, together), exact)
    )


def modes_below(body: FlexibleBody, frequency: float, x: ArrayLike | None = None) -> int:
    """How many fixed-interface normal modes lie below a frequency.

    They are counted, not computed, copies of repeated frequencies included. A number that cuts a
    cluster of frequencies is reported where the body is reduced with it.

    Args:
        body: The body, with any number of modes.
        frequency: Limit [Hz].
        x: Density of the cells of this rank, by default of the full body.

    Raises:
        ValueError: On every rank, if the density has the wrong size, is NaN or leaves [0, 1].
        RuntimeError: On every rank, if the stiffness is singular.
    """
    validation.instance("modes_below: body", body, FlexibleBody, "a FlexibleBody")
    validation.number("modes_below: frequency", frequency, least=0.0, unit="Hz")
    domain = body.domain
    density = domain.check_density(np.ones(domain.n_cells) if x is None else x)
    matrices = body.elasticity.assemble(density)
    factored = body.reduction.factor(matrices)
    try:
        return factored.count_below((2.0 * math.pi * frequency) ** 2)
    finally:
        factored.destroy()


def with_all_residual_modes(problem: Problem, evaluation: Evaluation, *, terms: int = 2) -> Bodies:
    """All bodies, flexible ones with residual modes, in the order given.

    Args:
        problem: The scene.
        evaluation: What its `value` returned.
        terms: Of the series, 1 or 2.
    """
    return {
        name: with_residual_modes(body, evaluation.bodies[name], terms=terms)
        if isinstance(body, FlexibleBody)
        else body
        for name, body in problem.bodies.items()
    }


def psi_with(
    problem: Problem,
    evaluation: Evaluation,
    bodies: Bodies,
    integrators: Mapping[str, Integrator] | None = None,
) -> float:
    """The objective at the densities of an evaluation with other shape functions or other steps.

    Args:
        problem: The scene.
        evaluation: What its `value` returned.
        bodies: All bodies, in the order of the problem's.
        integrators: Other ones than the problem's, by motion.

    Raises:
        SimulationError: On every rank, if a motion cannot be computed.
    """
    stresses = {
        name: BodyStress(problem.flexible[name], body)
        for name, body in bodies.items()
        if isinstance(body, ReducedBody)
    }
    integrals = {name: integrals_of(body) for name, body in bodies.items()}
    return problem.psi_with(evaluation, integrals, stresses, integrators)


def warn_of_stiff_damping(
    problem: Problem, evaluation: Evaluation, bodies: Bodies, error: float
) -> None:
    """Warn where an error by modes is one of the steps.

    With damping proportional to stiffness modes of high frequency are damped within a step. Long
    steps of generalised-alpha leave a share of psi in each of them then, however many there are.

    Args:
        problem: The scene.
        evaluation: What its `value` returned.
        bodies: With the modes left out.
        error: The change of psi by them.
    """
    motions = problem.motions.items()
    damped = any(d.beta > 0.0 for _, m in motions for d in m.mechanism.damping.values())
    if not damped or error < DOUBTFUL:
        return
    finer = {name: motion.integrator.finer for name, motion in motions}
    own = own_bodies(problem, evaluation)
    less, more = (psi_with(problem, evaluation, some, finer) for some in (own, bodies))
    shorter = relative_change(less, more)
    if shorter < 0.5 * error:
        warnings.warn(
            f"the error of psi by modes, estimated at {error:.1e}, is {shorter:.1e} with shorter "
            "steps: not modes are missing, but the steps are too long for damping that is "
            "proportional to stiffness, which acts on high frequencies within a step; take "
            "shorter steps, RadauIIA, or TimeInterval(end_time, tolerance)",
            TimeStepWarning,
            stacklevel=3,
        )


def integrals_of(body: ReducedBody | VolumeIntegrals) -> VolumeIntegrals:
    """The integrals of a ``body``, reduced or given by them."""
    return body.integrals if isinstance(body, ReducedBody) else body


def own_bodies(problem: Problem, evaluation: Evaluation) -> Bodies:
    """All bodies as they were evaluated, in the order given.

    Args:
        problem: The scene.
        evaluation: What its `value` returned.
    """
    return {
        name: body if isinstance(body, VolumeIntegrals) else evaluation.bodies[name]
        for name, body in problem.bodies.items()
    }


def relative_change(found: float, exact: float) -> float:
    """How far a number is from the ``exact`` one, relative to it; as it is where that is zero."""
    return abs(found - exact) / abs(exact) if exact else abs(found)


def _checked(problem: Problem, evaluation: Evaluation, call: str, *, terms: int) -> Bodies:
    """The bodies with residual modes of a problem and its evaluation, or refuse them."""
    validation.instance(f"{call}: problem", problem, Problem, "a Problem")
    validation.instance(f"{call}: evaluation", evaluation, Evaluation, "an Evaluation")
    evaluation.check_motion()
    announce(problem.comm, call)
    return with_all_residual_modes(problem, evaluation, terms=terms)


def _least(holds: Callable[[int], bool], most: int, first: int) -> int:
    """The least number up to ``most``, which holds, if all above it hold; asks ``first`` first."""
    low, high, asked = -1, most, first
    while high - low > 1:
        if holds(asked):
            high = asked
        else:
            low = asked
        asked = (low + high) // 2
    return high


def _uncut(basis: ReducedBasis) -> NDArray[np.bool_]:
    """Whether 0, 1, 2, ... and all modes of a basis keep close frequencies together."""
    eigenvalues = np.append(basis.eigenvalues, basis.outer_eigenvalue)
    return np.append(True, np.diff(eigenvalues) >= CLUSTER * eigenvalues[1:])
