# SPDX-License-Identifier: MIT
"""Error of psi by truncated normal modes, the number that an accuracy needs, and local modes.

With the displacements that the truncated modes would add under the loads of the motion
(`dolfinx_ffr.reduction.with_residual_modes`) psi changes by what is missing. That takes neither
further normal modes nor another finite-element solution.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import trapezoid

from .. import validation
from ..arrays import Array, Integers
from ..body import VolumeIntegrals
from ..dynamics import Integrator, SimulationError, TimeStepWarning, Trajectory
from ..fem import floating_cells
from ..parallel import announce
from ..problem import Evaluation, Problem
from ..reduction import CLUSTER, BodyStress, FlexibleBody, ReducedBody, with_residual_modes

#: Bodies by name, flexible ones with their shape functions.
Bodies = dict[str, ReducedBody | VolumeIntegrals]

#: How far above the squared frequency of a residual mode normal modes are counted, relative to it:
#: the one that it stands for lies below it, by Rayleigh and Ritz, but for round-off
ROOM = 1e-2
#: Error by the modes left out from which on it is asked whether it is one of the steps
DOUBTFUL = 1e-2
#: Density relative to the body's mean by mass below which a cell counts as almost void. At 0.3 of
#: the solid, SIMP with exponent 3 leaves a tenth of its stiffness by mass.
THIN = 0.3
#: Share of a mode's kinetic energy outside of what interfaces hold from which on it is local
MOST = 0.9


def mode_error(problem: Problem, evaluation: Evaluation) -> dict[str, float]:
    """Estimated relative error of psi by the truncated normal modes of each body.

    It takes a back-substitution and one simulation with some seven coordinates more. Where a body
    has been reduced at another density since, its matrices are assembled and factored first. The
    modes left out count by what they add statically; `model_report` takes a second term.

    The ``evaluation`` is what a `value` of the ``problem`` returned, at any time. By name of the
    flexible bodies, the result is the change of psi with what the other modes of this body would
    add, relative to psi; the same on every rank.

    Warns:
        TimeStepWarning: If shorter steps take half of an error or more away: of a body with much
            damping proportional to stiffness it is one of the steps.

    Raises:
        SimulationError: If the motion with more modes cannot be computed.
    """
    trajectories_of(problem, evaluation, "mode_error")
    complete = with_all_residual_modes(problem, evaluation, terms=1)
    evaluated, errors = own_bodies(problem, evaluation), {}
    for name in problem.flexible:
        bodies = {**evaluated, name: complete[name]}
        errors[name] = relative_change(evaluation.psi, psi_with(problem, evaluation, bodies))
        warn_of_stiff_damping(problem, evaluation, bodies, errors[name])
    return errors


def propose_modes(
    problem: Problem, evaluation: Evaluation, *, tolerance: float = 2e-3
) -> dict[str, int]:
    """Numbers of normal modes, more or fewer than the problem has, for an accuracy of psi.

    If the present ones are enough, the least number of them that holds the tolerance is sought by
    bisection. If not, bisection tells which of the residual modes must be there, and all normal
    modes up to its frequency are counted. More than the proposed number may be needed where the
    residual modes stand for many; `mode_error` tells at the next evaluation. A number within the
    present ones does not cut a cluster of frequencies. It goes to `Problem.with_modes`.

    Args:
        problem: The scene.
        evaluation: A result of the problem's `value`.
        tolerance: Relative error of psi that is allowed for each body.

    Warns:
        LocalModesWarning: If some of the present modes shake nothing but pieces that no material
            holds, and take the places of others.

    Raises:
        SimulationError: If the motion with another number of modes cannot be computed.
        RuntimeError: If modes cannot be counted.
    """
    tolerance = validation.number("propose_modes: tolerance", tolerance, above=0.0)
    trajectories_of(problem, evaluation, "propose_modes")
    complete = with_all_residual_modes(problem, evaluation)
    evaluated = own_bodies(problem, evaluation)
    warn_of_local_modes(problem, evaluation)
    proposed = {}
    for name, body in problem.flexible.items():
        reduced = evaluation.bodies[name]
        basis, residual = reduced.basis, integrals_of(complete[name])
        bodies, present = {**evaluated, name: complete[name]}, len(basis.eigenvalues)
        psi = psi_with(problem, evaluation, bodies)
        error = partial(_error, problem, evaluation, bodies, name, psi)

        def holds(number: int, error: Callable[[int], float] = error) -> bool:
            try:
                return error(number) <= tolerance
            except SimulationError:  # as of a torn design with too few
                return False

        number = _least(holds, residual.modes - basis.n_constraint, present)
        if number <= present:
            # the present number may itself cut a cluster, of which reduction warns
            uncut = [n for n in _uncut(reduced) if n >= number]
            proposed[name] = int(uncut[0]) if uncut else present
        else:
            index = basis.n_constraint + number - 1
            square = residual.K[index, index]
            count = body.count_below(reduced, (1.0 + ROOM) * square)
            proposed[name] = min(max(count, present + 1), body.reduction.most_modes)
    return proposed


@dataclass(frozen=True)
class ModeSelection:
    """Numbers of normal modes, and estimates of the error by the truncated ones.

    Attributes:
        modes: Chosen numbers of normal modes, by name of the body.
        errors: By name of the body, estimated relative error of psi with 0, 1, 2, ... and all its
            modes.
        error: Estimated relative error of psi with the chosen numbers of all bodies.
    """

    modes: dict[str, int]
    errors: dict[str, Array] = field(repr=False)
    error: float = 0.0


def select_modes(
    problem: Problem,
    x: ArrayLike | Mapping[str, ArrayLike] | None = None,
    *,
    tolerance: float = 1e-3,
) -> ModeSelection:
    """The least numbers of normal modes that an accuracy of psi needs.

    Shape functions are computed once. Simulations with fewer normal modes are compared with one
    that has all of the ``problem``, and residual modes for those beyond them. A number that would
    cut through a cluster of frequencies is passed over. Choose once, and keep the numbers while
    designing: `Problem.with_modes`.

    Args:
        problem: The problem with more modes than needed, for example 16 for each body.
        x: Densities, shape (cells,), by name if there are several bodies; full bodies by default.
        tolerance: Relative error of psi that is allowed for each body.

    Raises:
        ValueError: If even the modes of the problem are too few.
    """
    validation.instance("select_modes: problem", problem, Problem, "a Problem")
    validation.number("select_modes: tolerance", tolerance, above=0.0)
    if x is None:
        x = {name: np.ones(body.domain.n_cells) for name, body in problem.flexible.items()}
    evaluation = problem.value(x)
    complete = with_all_residual_modes(problem, evaluation)
    exact = psi_with(problem, evaluation, complete)
    chosen: dict[str, int] = {}
    errors: dict[str, Array] = {}
    for name in problem.flexible:
        basis = evaluation.bodies[name].basis
        n_modes = len(basis.eigenvalues)
        error = partial(_error, problem, evaluation, complete, name, exact)
        errors[name] = np.array([error(n) for n in range(n_modes + 1)])
        # all larger numbers must hold the tolerance as well
        holds = np.logical_and.accumulate((errors[name] <= tolerance)[::-1])[::-1]
        fits = [n for n in _uncut(evaluation.bodies[name]) if holds[n]]
        if not fits:
            raise ValueError(
                f"select_modes: with all {n_modes} normal modes of body {name!r} the estimated "
                f"error of psi is {errors[name][-1]:.1e}, and no number that keeps close "
                f"frequencies together reaches {tolerance:.1e}; give the problem more modes to "
                "choose from"
            )
        chosen[name] = int(fits[0])
    leading = {name: _with_modes(evaluation, complete, name, n) for name, n in chosen.items()}
    psi = psi_with(problem, evaluation, {**complete, **leading})
    return ModeSelection(chosen, errors, relative_change(psi, exact))


def with_all_residual_modes(problem: Problem, evaluation: Evaluation, *, terms: int = 2) -> Bodies:
    """All bodies, flexible ones with residual modes (1 or 2 terms), in the order given."""
    bodies = own_bodies(problem, evaluation)
    for name, body in problem.flexible.items():
        bodies[name] = with_residual_modes(body, evaluation.bodies[name], terms=terms)
    return bodies


def psi_with(
    problem: Problem,
    evaluation: Evaluation,
    bodies: Bodies,
    integrators: Mapping[str, Integrator] | None = None,
) -> float:
    """Psi at the densities of an evaluation with other bodies, all in order, or other steps."""
    reduced = {name: body for name, body in bodies.items() if isinstance(body, ReducedBody)}
    stresses = {name: BodyStress(problem.flexible[name], body) for name, body in reduced.items()}
    integrals = {name: integrals_of(body) for name, body in bodies.items()}
    return problem.psi_with(evaluation, integrals, stresses, integrators)


def warn_of_stiff_damping(
    problem: Problem, evaluation: Evaluation, bodies: Bodies, error: float
) -> None:
    """Warn where the change of psi by the truncated modes, which ``bodies`` have, is one by steps.

    With damping proportional to stiffness modes of high frequency are damped within a step. Long
    steps of generalised-alpha leave a share of psi in each of them then, however many there are.
    """
    load_cases = problem.load_cases.items()
    damped = any(d.beta > 0.0 for _, m in load_cases for d in m.mechanism.damping.values())
    if not damped or error < DOUBTFUL:
        return
    finer = {name: case.method.finer for name, case in load_cases if case.needs_trajectory}
    evaluated = own_bodies(problem, evaluation)
    psi_without, psi_with_modes = (
        psi_with(problem, evaluation, several, finer) for several in (evaluated, bodies)
    )
    shorter = relative_change(psi_without, psi_with_modes)
    if shorter < 0.5 * error:
        warnings.warn(
            f"the estimated error of psi by truncated modes is {error:.1e}, but {shorter:.1e} with "
            "shorter steps: the steps are too long for damping proportional to stiffness, which "
            "acts on high frequencies within a step; take shorter steps, RadauIIA, or "
            "TimeInterval(end_time, tolerance)",
            TimeStepWarning,
            stacklevel=3,
        )


def integrals_of(body: ReducedBody | VolumeIntegrals) -> VolumeIntegrals:
    """The integrals of a ``body``, reduced or given by them."""
    return body.integrals if isinstance(body, ReducedBody) else body


def own_bodies(problem: Problem, evaluation: Evaluation) -> Bodies:
    """All bodies as they were evaluated, in the order given."""
    bodies = problem.bodies.items()
    return {n: b if isinstance(b, VolumeIntegrals) else evaluation.bodies[n] for n, b in bodies}


def _with_modes(
    evaluation: Evaluation, bodies: Bodies, name: str, number: int
) -> ReducedBody | VolumeIntegrals:
    """One of the bodies with its first normal modes only."""
    return bodies[name].leading(evaluation.bodies[name].basis.n_constraint + number)


def _error(
    problem: Problem, evaluation: Evaluation, bodies: Bodies, name: str, exact: float, number: int
) -> float:
    """Relative error of psi with the first normal modes of one of the bodies only."""
    shorter = _with_modes(evaluation, bodies, name, number)
    if integrals_of(shorter).modes == 0:  # a flexible body without any shape function
        return math.inf
    return relative_change(psi_with(problem, evaluation, {**bodies, name: shorter}), exact)


def relative_change(value: float, exact: float) -> float:
    """Relative error of a ``value``; the absolute error where the ``exact`` value is zero."""
    return abs(value - exact) / abs(exact) if exact else abs(value)


def _least(holds: Callable[[int], bool], most: int, first: int) -> int:
    """The least number up to ``most``, which holds, if all above it hold; asks ``first`` first."""
    low, high, number = -1, most, first
    while high - low > 1:
        if holds(number):
            high = number
        else:
            low = number
        number = (low + high) // 2
    return high


def _uncut(reduced: ReducedBody) -> Integers:
    """The numbers of modes, of 0, 1, 2, ... and all, that keep close frequencies together."""
    eigenvalues = np.append(reduced.basis.eigenvalues, reduced.basis.first_truncated_eigenvalue)
    return np.flatnonzero(np.append(True, np.diff(eigenvalues) >= CLUSTER * eigenvalues[1:]))


class LocalModesWarning(UserWarning):
    """Normal modes of a body move only loose or nearly void pieces of it."""


@dataclass(frozen=True)
class LocalModes:
    """Normal modes of one body that are local, in ascending order.

    Attributes:
        numbers: (k,) of the modes, counted from 1.
        frequencies: (k,) [Hz].
        places: (k, dimension) centres of their kinetic energy in the mesh's coordinates [m].
        share: Their share of the body's strain energy over all load cases, in [0, 1].
    """

    numbers: Integers
    frequencies: Array
    places: Array
    share: float


def local_modes(problem: Problem, evaluation: Evaluation) -> dict[str, LocalModes]:
    """The normal modes that move only loose or nearly void pieces of their body.

    A mode is local if more than nine tenths of its kinetic energy lie outside the pieces that touch
    an interface and consist of cells of at least 0.3 of the mean density (by mass, so that void
    does not count): it swings on the void's own little stiffness, and takes the place of one that
    matters (N. L. Pedersen, Structural and Multidisciplinary Optimization 20 (2000),
    doi:10.1007/s001580050130). The ``evaluation`` is what a `value` of the ``problem`` returned, at
    any time; a ValueError if nothing was simulated. All flexible bodies are in the result, by name.
    """
    trajectories = trajectories_of(problem, evaluation, "local_modes").values()
    local = {}
    for name, body in problem.flexible.items():
        basis = evaluation.bodies[name].basis
        numbers, places = _local(body, evaluation.bodies[name])
        # normal modes do not share strain energy with each other, nor with constraint modes
        eigenvalues, columns = basis.eigenvalues[numbers], basis.n_constraint + numbers
        energies = [
            (0.5 * m.elastic(name)[:, columns] ** 2 @ eigenvalues, m.t) for m in trajectories
        ]
        of_modes = sum(trapezoid(energy, t) for energy, t in energies)
        total = sum(trapezoid(m.strain_energy(name), m.t) for m in trajectories)
        share = float(of_modes / total) if total > 0.0 else 0.0
        local[name] = LocalModes(numbers + 1, basis.frequencies[numbers], places, share)
    return local


def trajectories_of(problem: Problem, evaluation: Evaluation, call: str) -> dict[str, Trajectory]:
    """The trajectories of an evaluation by load case, or refuse arguments of a wrong kind."""
    validation.instance(f"{call}: problem", problem, Problem, "a Problem")
    validation.instance(f"{call}: evaluation", evaluation, Evaluation, "an Evaluation")
    evaluation.check_simulated()
    announce(problem.comm, call)
    problem.refuse_other_psi(evaluation)
    load_cases = evaluation.load_cases.items()
    return {name: m.trajectory for name, m in load_cases if m.trajectory is not None}


def warn_of_local_modes(problem: Problem, evaluation: Evaluation) -> None:
    """Warn of each body with local modes."""
    for name, local in local_modes(problem, evaluation).items():
        if not len(local.numbers):
            continue
        modes = evaluation.bodies[name].basis.eigenvalues
        examples = zip(local.numbers[:3], local.frequencies, local.places, strict=False)
        listed = ", ".join(
            f"mode {number} ({frequency:.4g} Hz) near ({', '.join(f'{x:.4g}' for x in place)}) m"
            for number, frequency, place in examples
        )
        ending = ", and others" if len(local.numbers) > 3 else ""
        warnings.warn(
            f"{len(local.numbers)} of {len(modes)} normal modes of body {name!r} move only loose "
            f"or nearly void pieces: {listed}{ending}. They replace modes that matter, and contain "
            f"{100.0 * local.share:.2g} % of the strain energy of the motion, in void cells: empty "
            "these cells or join them to the rest; if that share is negligible, take so many "
            "modes more",
            LocalModesWarning,
            stacklevel=3,
        )


def _local(body: FlexibleBody, reduced: ReducedBody) -> tuple[Integers, Array]:
    """Numbers of a body's local modes, from 0, and the centres of their kinetic energies."""
    domain, basis, x = body.domain, reduced.basis, reduced.density
    mass = x * domain.cell_volumes
    mean = domain.sum(mass * x) / domain.sum(mass)
    dense = x >= THIN * mean
    facets = [interface.facets for interface in domain.interfaces.values()]
    elsewhere = ~dense | floating_cells(domain.mesh, dense, facets)[0]
    numbers, places = [], []
    for i, mode in enumerate(basis.shapes[:, basis.n_constraint :].T):
        energy = body.elasticity.kinetic_energy(x, mode)
        total = domain.sum(energy)
        if domain.sum(energy * elsewhere) > MOST * total:
            numbers.append(i)
            places.append([domain.sum(energy * c) / total for c in domain.centroids.T])
    return np.array(numbers, dtype=np.int64), np.reshape(places, (-1, domain.dimension))
