# SPDX-License-Identifier: MIT
"""What a scene models, what it leaves out, and what that costs in accuracy.

Three choices of a model leave something out: the number of modes, the time step, and geometric
stiffening. None of the errors needs another finite-element solution to be estimated:

- with the displacements that the modes left out would add under the loads of the motion
  (`dolfinx_ffr.reduction.with_residual_modes`), psi changes by what is missing;
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

from .. import validation
from ..body import VolumeIntegrals
from ..dynamics import Integrator, integrate
from ..fem import Domain
from ..parallel import announce, on_every_rank
from ..problem import Evaluation, Problem
from ..reduction import CLUSTER, MARKERS, FlexibleBody, with_residual_modes

__all__ = [
    "BodyReport",
    "ModeSelection",
    "ModelReport",
    "model_report",
    "modes_below",
    "select_modes",
]

Array = NDArray[np.float64]

#: Share of a body's extent above which an interface is reported as long
LONG_INTERFACE = 0.25


@dataclass(frozen=True)
class BodyReport:
    """One body of a scene."""

    kind: str  #: "flexible" with a density, "given" by its integrals, or "rigid"
    constraint_modes: int  #: Number of shape functions that move an interface
    normal_modes: int  #: Number of fixed-interface normal modes
    highest_frequency: float  #: Of the normal modes kept [Hz]; NaN if there are none
    next_frequency: float  #: The first one left out [Hz]; NaN if not known
    stiffening: tuple[str, ...]  #: Loads whose geometric stiffness is modelled
    softening: float  #: Largest relative softening by the body's own rotation; 1 is the limit
    elements: int  #: Number of elements with a density
    #: Interfaces that span more than a quarter of the body, which they make rigid there, each with
    #: its extent over the body's
    long_interfaces: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ModelReport:
    """What a scene models, what it leaves out, and estimates of the errors."""

    bodies: dict[str, BodyReport]  #: By name
    coordinates: int  #: Number of coordinates of all bodies
    rows: int  #: Number of scalar constraints of the joints
    left_out: list[str]  #: Terms that nothing in the scene asks for, in words
    psi: float  #: The objective
    modes_error: float  #: Estimated relative error of psi by the modes left out
    step_error: float  #: Estimated relative error of psi by the time step

    def __str__(self) -> str:
        """The report as text."""
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
            for interface, share in body.long_interfaces.items():
                lines.append(
                    f"    interface {interface!r} spans {100.0 * share:.0f} % of {name} and makes "
                    "this part of it rigid; a shorter one, or a marker, lets it bend"
                )
        lines.append(f"  left out: {', '.join(self.left_out) or 'nothing'}")
        lines.append(
            f"  estimated relative error of psi: {self.modes_error:.1e} by modes, "
            f"{self.step_error:.1e} by the time step"
        )
        return "\n".join(lines)


def model_report(problem: Problem, evaluation: Evaluation) -> ModelReport:
    """What a scene models and how accurate that is.

    The cost is that of two simulations of the reduced bodies and of two back-substitutions; nothing
    is reduced again. Matrices of bodies at which other densities have been evaluated since are
    assembled and factored once more.

    Args:
        problem: The scene.
        evaluation: What its `value` returned, at any time.

    Raises:
        ValueError: If nothing was simulated.
        SimulationError: If the motion with longer steps or more modes cannot be computed.
    """
    validation.instance("model_report: problem", problem, Problem, "a Problem")
    validation.instance("model_report: evaluation", evaluation, Evaluation, "an Evaluation")
    announce(problem.comm, "model_report")
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
        omega = trajectory.v[:, trajectory.model.coordinates(name).rotation]
        bodies[name] = BodyReport(
            kind="flexible" if flexible else ("given" if body.modes else "rigid"),
            constraint_modes=basis.n_constraint if basis is not None else 0,
            normal_modes=len(frequencies) if basis is not None else body.modes,
            highest_frequency=float(frequencies[-1]) if len(frequencies) else math.nan,
            next_frequency=math.sqrt(outer) / (2.0 * math.pi) if math.isfinite(outer) else math.nan,
            stiffening=(*body.stiffening, *at_markers),
            softening=_softening(body, omega),
            elements=flexible.domain.n_cells_global if flexible else 0,
            long_interfaces=_long_interfaces(flexible.domain) if flexible else {},
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
    exact = _psi(problem, evaluation, _with_residual_modes(problem, evaluation))
    longer = _psi(problem, evaluation, integrals, coarse)
    return ModelReport(
        bodies=bodies,
        coordinates=trajectory.model.size,
        rows=trajectory.model.rows,
        left_out=left_out,
        psi=psi,
        modes_error=_relative(psi, exact),
        step_error=_relative(longer, psi) / (2**coarse.order - 1),
    )


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
    whole = _with_residual_modes(problem, evaluation)
    exact = _psi(problem, evaluation, whole)
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
            psi = _psi(problem, evaluation, {**whole, name: whole[name].leading(k + modes)})
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
    return ModeSelection(chosen, errors, _relative(_psi(problem, evaluation, together), exact))


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
    matrices = body.elasticity.assemble(np.ones(body.domain.n_cells) if x is None else x)
    factored = body.reduction.factor(matrices)
    try:
        return factored.count_below((2.0 * math.pi * frequency) ** 2)
    finally:
        factored.destroy()


def _with_residual_modes(problem: Problem, evaluation: Evaluation) -> dict[str, VolumeIntegrals]:
    """All bodies, flexible ones with residual modes, in the order they were given."""
    return {
        name: with_residual_modes(body, evaluation.bodies[name]).integrals
        if isinstance(body, FlexibleBody)
        else body
        for name, body in problem.bodies.items()
    }


def _psi(
    problem: Problem,
    evaluation: Evaluation,
    integrals: Mapping[str, VolumeIntegrals],
    integrator: Integrator | None = None,
) -> float:
    # given elastic coordinates are those of the problem's own shape functions
    modes = {name: body.modes for name, body in integrals.items()}
    mechanism = replace(problem.mechanism, start=problem.mechanism.start.resized(modes))
    with on_every_rank(problem.comm, "the evaluation of a problem"):
        trajectory = integrate(mechanism, integrals, integrator or problem.integrator)
        response = replace(problem.response(evaluation), trajectory=trajectory, bodies=integrals)
        psi = problem.objective.evaluate(response)
    return psi


def _relative(found: float, exact: float) -> float:
    return abs(found - exact) / abs(exact) if exact else abs(found)


def _long_interfaces(domain: Domain) -> dict[str, float]:
    """Extents of the long interfaces over that of the body, by name."""
    extent = float(np.linalg.norm(np.ptp(domain.bounding_box, axis=0)))
    shares = {name: part.extent / extent for name, part in domain.interfaces.items()}
    return {name: share for name, share in shares.items() if share > LONG_INTERFACE}


def _softening(body: VolumeIntegrals, omega: Array) -> float:
    """omega^2 over the lowest squared frequency of the body in its frame."""
    if body.modes == 0:
        return 0.0
    K, G = body.K, body.G[1:, 1:]
    lowest = scipy.linalg.eigh(K, G, eigvals_only=True, subset_by_index=[0, 0])[0]
    return float(np.max(omega**2) / lowest) if lowest > 0.0 else math.inf
