# SPDX-License-Identifier: MIT
"""The contents of a model, the terms that it leaves out, and estimates of its errors.

None of the errors needs another finite-element solution (`mode_error`, `Problem.time_errors`). The
relative softening of a body by its rotation is the square of its angular velocity over that of its
lowest frequency.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg

from ..arrays import Array
from ..body import VolumeIntegrals
from ..fem import Domain
from ..problem import Evaluation, Problem
from ..reduction import MARKERS
from .mode_truncation import (
    psi_with,
    relative_change,
    trajectories_of,
    warn_of_stiff_damping,
    with_all_residual_modes,
)

#: Share of a body's extent above which an interface is reported as long
LONG_INTERFACE = 0.25


@dataclass(frozen=True)
class BodyReport:
    """One body of a scene.

    Attributes:
        kind: "flexible" with a density, "given" by its integrals, or "rigid".
        constraint_modes: Number of shape functions that move an interface.
        normal_modes: Number of fixed-interface normal modes.
        highest_frequency: Highest frequency of the retained normal modes [Hz]; NaN without modes.
        next_frequency: The first one left out [Hz]; NaN if not known.
        stiffening: Loads whose geometric stiffness is modelled.
        softening: Largest relative softening by the body's own rotation; 1 is the limit.
        elements: Number of elements with a density.
        long_interfaces: Interfaces that span more than a quarter of the body, which they make rigid
            there, each with its extent over the body's.
        order: Order of the elements; 0 for a body without elements.
    """

    kind: str
    constraint_modes: int
    normal_modes: int
    highest_frequency: float
    next_frequency: float
    stiffening: tuple[str, ...]
    softening: float
    elements: int
    long_interfaces: Mapping[str, float] = field(default_factory=dict)
    order: int = 0


@dataclass(frozen=True)
class ModelReport:
    """The contents of a model, the terms that it leaves out, and estimates of its errors.

    Attributes:
        bodies: Figures of each body by name.
        coordinates: Number of coordinates of all bodies.
        rows: Number of scalar constraints of the joints, of several load cases the largest.
        left_out: Terms that nothing in the scene asks for, in any load case, in words.
        psi: The objective.
        modes_error: Estimated relative error of psi by the modes left out.
        step_error: Estimated relative error of psi and of the constraints by the time step.
    """

    bodies: dict[str, BodyReport]
    coordinates: int
    rows: int
    left_out: list[str]
    psi: float
    modes_error: float
    step_error: float

    def __str__(self) -> str:
        """The report as text."""
        lines = [f"{self.coordinates} coordinates, {self.rows} constraints; psi = {self.psi:.6g}"]
        for name, body in self.bodies.items():
            text = f"  {name}: {body.kind}"
            if body.constraint_modes + body.normal_modes:
                text += f", {body.constraint_modes} constraint and {body.normal_modes} normal modes"
            if math.isfinite(body.highest_frequency):
                text += f" up to {body.highest_frequency:.4g} Hz"
            if math.isfinite(body.next_frequency):
                text += f" (next: {body.next_frequency:.4g} Hz)"
            if body.elements:
                text += f", {body.elements} elements of order {body.order}"
            if body.stiffening:
                text += f", geometric stiffening by {', '.join(body.stiffening)}"
            elif body.softening:
                text += f", softened by its rotation by {100.0 * body.softening:.2g} %"
            lines.append(text)
            if body.order == 1:
                lines.append(
                    f"    elements of order 1 lock: where few of them are across, {name} is too "
                    "stiff in bending, and psi too low"
                )
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
        if any(body.elements for body in self.bodies.values()):
            lines.append(
                "  the error by the mesh is not estimated: compare with a higher order, or with "
                "elements half as large"
            )
        return "\n".join(lines)


def model_report(problem: Problem, evaluation: Evaluation) -> ModelReport:
    """Report the contents of a model and estimates of its errors.

    It takes some simulations of the reduced bodies and two back-substitutions; nothing is reduced
    again. The ``evaluation`` is what a `value` of the ``problem`` returned, at any time; matrices
    of bodies that were reduced at other densities since are factored once more. Errors and warnings
    are those of `mode_error`, and a SimulationError if there is no motion with other steps.
    """
    moved = list(trajectories_of(problem, evaluation, "model_report").values())
    psi, bodies = evaluation.psi, {}
    for name, body in problem.integrals(evaluation).items():
        flexible = problem.flexible.get(name)
        basis = evaluation.bodies[name].basis if flexible else None
        frequencies = np.zeros(0) if basis is None else basis.frequencies
        outer = math.nan if basis is None else basis.first_truncated_eigenvalue
        stiffened = any(marker.stiffening is not None for marker in body.markers.values())
        at_markers = (MARKERS,) if stiffened else ()
        omega = np.concatenate([m.v[:, m.model.coordinates(name).rotation] for m in moved])
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
            order=flexible.domain.order if flexible else 0,
        )
    mechanisms = [case.mechanism for case in problem.load_cases.values()]
    modelled = {
        "gravity": any(callable(m.gravity) or np.any(np.asarray(m.gravity)) for m in mechanisms),
        "damping": any(m.damping for m in mechanisms),
        "forces": any(m.forces for m in mechanisms),
        "geometric stiffening": any(b.stiffening for b in bodies.values()),
    }
    whole = with_all_residual_modes(problem, evaluation)
    error = relative_change(psi, psi_with(problem, evaluation, whole))
    warn_of_stiff_damping(problem, evaluation, whole, error)
    return ModelReport(
        bodies=bodies,
        coordinates=moved[0].model.size,
        rows=max(m.model.rows for m in moved),
        left_out=[what for what, there in modelled.items() if not there],
        psi=psi,
        modes_error=error,
        step_error=max(problem.time_errors(evaluation).values()),
    )


def _long_interfaces(domain: Domain) -> dict[str, float]:
    """Extents of the long interfaces divided by the extent of the body, by name."""
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
