# SPDX-License-Identifier: MIT
"""Normal modes that shake nothing but pieces which no material holds.

A blob of material in void, or a patch of almost void, swings on the void's own little stiffness at
a low frequency. The solver finds the lowest modes first, so that such a mode takes the place of one
that matters; and the motion may excite it, in void that no real part has. It is told by where its
kinetic energy is.

References:
    N. L. Pedersen, Maximization of eigenvalues using topology optimization, Structural and
    Multidisciplinary Optimization 20 (2000), doi:10.1007/s001580050130.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from .. import validation
from ..dynamics import Trajectory
from ..fem import floating_cells
from ..parallel import announce
from ..problem import Evaluation, Problem
from ..reduction import FlexibleBody, ReducedBasis, ReducedBody

__all__ = ["LocalModes", "LocalModesWarning", "local_modes", "warn_of_local_modes"]

Array = NDArray[np.float64]

#: Density relative to the body's mean by mass below which a cell counts as almost void. At 0.3 of
#: the solid, SIMP with exponent 3 leaves a tenth of its stiffness by mass.
THIN = 0.3
#: Share of a mode's kinetic energy outside of what interfaces hold from which on it is local
MOST = 0.9


class LocalModesWarning(UserWarning):
    """Modes of a body shake nothing but loose or almost void pieces of it."""


@dataclass(frozen=True)
class LocalModes:
    """Normal modes of one body that are local, in ascending order."""

    numbers: NDArray[np.int64]  #: (k,) of the modes, counted from 1
    frequencies: Array  #: (k,) [Hz]
    places: Array  #: (k, 2) centres of their kinetic energy in the mesh's coordinates [m]
    share: float  #: Of the body's strain energy over all motions that they hold, in [0, 1]


def local_modes(problem: Problem, evaluation: Evaluation) -> dict[str, LocalModes]:
    """The normal modes that move almost nothing but loose and almost void pieces of their body.

    Held are pieces of cells that touch an interface, of at least 0.3 of the mean density (by mass,
    so that void does not count). A mode is local if more than nine tenths of its kinetic energy
    are elsewhere.

    Args:
        problem: The scene.
        evaluation: What its `value` returned, at any time.

    Returns:
        By name of the flexible bodies, those without local modes too; the same on every rank.

    Raises:
        ValueError: If nothing was simulated.
    """
    validation.instance("local_modes: problem", problem, Problem, "a Problem")
    validation.instance("local_modes: evaluation", evaluation, Evaluation, "an Evaluation")
    evaluation.check_motion()
    moved = [m.trajectory for m in evaluation.motions.values() if m.trajectory is not None]
    announce(problem.comm, "local_modes")
    found = {}
    for name, body in problem.flexible.items():
        reduced = evaluation.bodies[name]
        basis = reduced.basis
        numbers, places = _local(body, reduced)
        own, whole = (
            sum(parts)
            for parts in zip(
                *(_energies(each, name, basis, numbers) for each in moved), strict=True
            )
        )
        found[name] = LocalModes(
            numbers + 1,
            basis.frequencies[numbers],
            places,
            float(own / whole) if whole > 0.0 else 0.0,
        )
    return found


def warn_of_local_modes(problem: Problem, evaluation: Evaluation) -> None:
    """Warn of each body with local modes.

    Args:
        problem: The scene.
        evaluation: What its `value` returned.
    """
    for name, local in local_modes(problem, evaluation).items():
        if not len(local.numbers):
            continue
        modes = evaluation.bodies[name].basis.eigenvalues
        listed = ", ".join(
            f"mode {number} ({frequency:.4g} Hz) near ({x:.4g}, {y:.4g}) m"
            for number, frequency, (x, y) in zip(
                local.numbers[:3], local.frequencies, local.places, strict=False
            )
        )
        others = ", and others" if len(local.numbers) > 3 else ""
        warnings.warn(
            f"{len(local.numbers)} of {len(modes)} normal modes of body {name!r} shake nothing but "
            f"loose or almost void pieces: {listed}{others}. They take the places of modes that "
            f"matter, and hold {100.0 * local.share:.2g} % of the strain energy of the motion, in "
            "void: empty these cells or join them to the rest; where that share is negligible, so "
            "many modes more will do",
            LocalModesWarning,
            stacklevel=3,
        )


def _energies(
    trajectory: Trajectory, name: str, basis: ReducedBasis, numbers: NDArray[np.int64]
) -> tuple[float, float]:
    """Integrals over time of the strain energy of some normal modes, and of the whole body."""
    q = trajectory.elastic(name)[:, basis.n_constraint + numbers]
    # normal modes do not share strain energy with each other, nor with constraint modes
    own = trapezoid(0.5 * q**2 @ basis.eigenvalues[numbers], trajectory.t)
    return float(own), float(trapezoid(trajectory.strain_energy(name), trajectory.t))


def _local(body: FlexibleBody, reduced: ReducedBody) -> tuple[NDArray[np.int64], Array]:
    """Numbers of a body's local modes, from 0, and the centres of their kinetic energies."""
    domain, basis, x = body.domain, reduced.basis, reduced.density
    mass = x * domain.cell_volumes
    mean = domain.sum(mass * x) / domain.sum(mass)
    dense = x >= THIN * mean
    held = [interface.facets for interface in domain.interfaces.values()]
    elsewhere = ~dense | floating_cells(domain.mesh, dense, held)[0]
    numbers, places = [], []
    for i, field in enumerate(basis.shapes[:, basis.n_constraint :].T):
        energy = body.elasticity.kinetic_energy(x, field)
        whole = domain.sum(energy)
        if domain.sum(energy * elsewhere) > MOST * whole:
            numbers.append(i)
            places.append([domain.sum(energy * c) / whole for c in domain.centroids.T])
    return np.array(numbers, dtype=np.int64), np.reshape(places, (-1, 2))
