# SPDX-License-Identifier: MIT
"""What a scene models, what it leaves out, and what that costs in accuracy.

Three choices of a model leave something out: the number of modes, the time step, and geometric
stiffening. None of the errors needs another finite-element solution to be estimated:

- with the displacements that the modes left out would add under the loads of the motion
  (:mod:`dolfinx_ffr.truncation`), psi changes by what is missing;
- with steps twice as long, psi changes by three times the error of a second-order method, by 31
  times that of a fifth-order one;
- a body's relative softening by its own rotation is the square of its angular velocity over that of
  its lowest frequency, or what geometric stiffening makes of it.

`select_modes` takes the least number of modes that an accuracy needs, `modes_below` those below a
frequency.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from .body import VolumeIntegrals
from .dynamics import Integrator, simulate
from .flexible_body import FlexibleBody
from .reduction import CLUSTER
from .sensitivity import Evaluation, Problem
from .start import Assembled
from .stiffening import MARKERS
from .truncation import with_residual_modes

__all__ = [
    "BodyReport",
    "ModeSelection",
    "ModelReport",
    "model_report",
    "modes_below",
    "select_modes",
]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BodyReport:
    """One body of a scene."""

    kind: str  #: "flexible" with a density, "given" by its integrals, or "rigid"
    constraint_modes: int  #: number of shape functions that move an interface
    normal_modes: int  #: number of fixed-interface normal modes
    highest_frequency: float  #: of the normal modes kept [Hz]; NaN if there are none
    next_frequency: float  #: the first one left out [Hz]; NaN if not known
    stiffening: tuple[str, ...]  #: loads whose geometric stiffness is modelled
    softening: float  #: largest relative softening by the body's own rotation; 1 is the limit
    elements: int  #: number of elements with a density


@dataclass(frozen=True)
class ModelReport:
    """What a scene models, what it leaves out, and estimates of the errors."""

    bodies: dict[str, BodyReport]  #: by name
    coordinates: int  #: number of coordinates of all bodies
    rows: int  #: number of scalar constraints of the joints
    left_out: list[str]  #: terms that nothing in the scene asks for, in words
    psi: float  #: the objective
    modes_error: float  #: estimated relative error of psi by the modes left out
    step_error: float  #: estimated relative error of psi by the time step

    def __str__(self) -> str:
        """Return the report as text."""
        lines = [
            f"{self.coordinates} coordinates, {self.rows} constraints; psi = {self.psi:.6g}",
        ]
        for name, body in self.bodies.items():
            text = f"  {name}: {body.kind}"
            if body.constraint_modes + body.normal_modes:
                text += f", {body.constraint_modes} constraint and {body.normal_modes} normal modes"
            if math.isfinite(body.highest_frequency):
                text += f" up to {body.highest_frequency:.4g} Hz"
            if math.isfinite(body.next_frequency):
                text += f" (next: {body.next_frequency:.4g} Hz)"
            if body.elements:
                text += f", {body.elements} elements"
            if body.stiffening:
                text += f", geometric stiffening by {', '.join(body.stiffening)}"
            elif body.softening:
                text += f", softened by its rotation by {100.0 * body.softening:.2g} %"
            lines.append(text)
        lines.append(f"  left out: {', '.join(self.left_out) or 'nothing'}")
        lines.append(
            f"  estimated relative error of psi: {self.modes_error:.1e} by modes, "
            f"{self.step_error:.1e} by the time step"
        )
        return "\n".join(lines)


def model_report(problem: Problem, evaluation: Evaluation) -> ModelReport:
    """Return what a scene models and how accurate that is.

    The cost is that of two simulations of the reduced bodies and of two back-substitutions;
    nothing is reduced again, unless other densities have been evaluated since.

    Args:
        problem: the scene.
        evaluation: what its `value` returned.

    Raises:
        ValueError: if nothing was simulated.
        SimulationError: if the motion with longer steps or more modes cannot be computed.
    """
    integrals = problem.integrals(evaluation)
    trajectory, psi = evaluation.motion, evaluation.psi
    bodies = {}
    for name, body in integrals.items():
        flexible = problem.flexible.get(name)
        basis = evaluation.bodies[name].basis if flexible else None
        frequencies = basis.frequencies if basis is not None else np.zeros(0)
        outer = basis.outer_eigenvalue if basis is not None else math.nan
        stiffened = any(marker.stiffening is not None for marker in body.markers.values())
        at_markers = (MARKERS,) if stiffened else ()
        bodies[name] = BodyReport(
            kind="flexible" if flexible else ("given" if body.modes else "rigid"),
            constraint_modes=basis.n_constraint if basis is not None else 0,
            normal_modes=len(frequencies) if basis is not None else body.modes,
            highest_frequency=float(frequencies[-1]) if len(frequencies) else math.nan,
            next_frequency=math.sqrt(outer) / (2.0 * math.pi) if math.isfinite(outer) else math.nan,
            stiffening=(*body.stiffening, *at_markers),
            softening=_softening(body, trajectory.v[:, trajectory.model.coordinates(name)][:, 2]),
            elements=flexible.domain.n_cells_global if flexible else 0,
        )
    mechanism = problem.mechanism
    left_out = []
    for what, there in (
        ("gravity", callable(mechanism.gravity) or np.any(np.asarray(mechanism.gravity) != 0.0)),
        ("damping", bool(mechanism.damping)),
        ("forces", bool(mechanism.forces)),
        ("geometric stiffening", any(b.stiffening for b in bodies.values())),
    ):
        if not there:
            left_out.append(what)
    coarse = problem.integrator.coarser
    exact = _psi(problem, _with_residual_modes(problem, evaluation))
    return ModelReport(
        bodies=bodies,
        coordinates=trajectory.model.size,
        rows=trajectory.model.rows,
        left_out=left_out,
        psi=psi,
        modes_error=_relative(psi, exact),
        step_error=_relative(_psi(problem, integrals, coarse), psi) / (2**coarse.order - 1),
    )


@dataclass(frozen=True)
class ModeSelection:
    """Numbers of normal modes, and estimates of what the others would add."""

    modes: dict[str, int]  #: chosen numbers of normal modes, by name of the body
    #: by name of the body, estimated relative error of psi with 0, 1, 2, ... and all its modes
    errors: dict[str, Array] = field(repr=False)
    error: float = 0.0  #: estimated relative error of psi with the chosen numbers of all bodies


def select_modes(
    problem: Problem,
    x: ArrayLike | Mapping[str, ArrayLike] | None = None,
    *,
    tolerance: float = 1e-3,
) -> ModeSelection:
    """Return the least numbers of normal modes that an accuracy of psi needs.

    Shape functions are computed once, as many as the problem has; simulations with fewer of them
    are compared with one that has them all, and residual modes for those that not even the problem
    has. A number that would cut through a cluster of frequencies is passed over. Choose once, for
    example at the full bodies, and keep the numbers while designing: `Problem.with_modes`.

    Args:
        problem: the scene, with as many modes as may be needed (16, say).
        x: densities, by default those of the full bodies.
        tolerance: relative error of psi that is allowed for each body.

    Raises:
        ValueError: if all modes of the problem together are too few for the tolerance.
    """
    if x is None:
        x = {name: np.ones(body.domain.n_cells) for name, body in problem.flexible.items()}
    evaluation = problem.value(x)
    whole = _with_residual_modes(problem, evaluation)
    exact = _psi(problem, whole)
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
            psi = _psi(problem, {**whole, name: whole[name].leading(k + modes)})
            found.append(_relative(psi, exact))
        errors[name] = np.array(found)
        eigenvalues = np.append(basis.eigenvalues, basis.outer_eigenvalue)
        wide = np.append(True, np.diff(eigenvalues) >= CLUSTER * eigenvalues[1:])
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
    return ModeSelection(chosen, errors, _relative(_psi(problem, together), exact))


def modes_below(body: FlexibleBody, frequency: float, x: ArrayLike | None = None) -> int:
    """Return how many fixed-interface normal modes lie below a frequency.

    Args:
        body: the body, with enough modes to reach the frequency.
        frequency: limit [Hz].
        x: density of the cells of this rank, by default of the full body.

    Raises:
        ValueError: on every rank, if all of the body's modes lie below the frequency.
    """
    basis = body.reduce(np.ones(body.domain.n_cells) if x is None else x).basis
    limit = (2.0 * math.pi * frequency) ** 2
    if basis.outer_eigenvalue <= limit:
        raise ValueError(
            f"modes_below: all {len(basis.eigenvalues)} modes and the next one lie below "
            f"{frequency:.4g} Hz; give the body more modes to choose from"
        )
    return int(np.count_nonzero(basis.eigenvalues < limit))


def _with_residual_modes(problem: Problem, evaluation: Evaluation) -> dict[str, VolumeIntegrals]:
    """Return all bodies, flexible ones with residual modes, in the order they were given."""
    return {
        name: with_residual_modes(body, evaluation.bodies[name]).integrals
        if isinstance(body, FlexibleBody)
        else body
        for name, body in problem.bodies.items()
    }


def _psi(
    problem: Problem,
    integrals: Mapping[str, VolumeIntegrals],
    integrator: Integrator | None = None,
) -> float:
    mechanism, start = problem.mechanism, problem.mechanism.start
    if isinstance(start, Assembled):
        # given elastic coordinates are those of the problem's own shape functions
        elastic, velocity = (
            {name: _sized(values, integrals[name].modes) for name, values in given.items()}
            for given in (start.elastic, start.elastic_velocity)
        )
        start = Assembled(elastic, velocity)
        mechanism = replace(mechanism, start=start)
    trajectory = simulate(mechanism, integrals, integrator or problem.integrator)
    return float(problem.objective.value(trajectory, integrals))


def _sized(values: ArrayLike, size: int) -> Array:
    """Return values cut off, or filled up with zeros, at a size."""
    array = np.asarray(values, dtype=np.float64)[:size]
    return np.append(array, np.zeros(size - len(array)))


def _relative(found: float, exact: float) -> float:
    return abs(found - exact) / abs(exact) if exact else abs(found)


def _softening(body: VolumeIntegrals, omega: Array) -> float:
    """Return omega^2 over the lowest squared frequency of the body in its frame."""
    if body.modes == 0:
        return 0.0
    K, G = body.K, body.G[1:, 1:]
    lowest = scipy.linalg.eigh(K, G, eigvals_only=True, subset_by_index=[0, 0])[0]
    return float(np.max(omega**2) / lowest) if lowest > 0.0 else math.inf
