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
from scipy.integrate import trapezoid

from .. import validation
from ..arrays import Array, Integers
from ..dynamics import Trajectory
from ..fem import floating_cells
from ..parallel import announce
from ..problem import Evaluation, Problem
from ..reduction import FlexibleBody, ReducedBody

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

    numbers: Integers  #: (k,) of the modes, counted from 1
    frequencies: Array  #: (k,) [Hz]
    places: Array  #: (k, dimension) centres of their kinetic energy in the mesh's coordinates [m]
    share: float  #: Of the body's strain energy over all load cases that they hold, in [0, 1]


def local_modes(problem: Problem, evaluation: Evaluation) -> dict[str, LocalModes]:
    """The normal modes that move almost nothing but loose and almost void pieces of their body.

    A mode is local if more than nine tenths of its kinetic energy lie outside the pieces that touch
    an interface and consist of cells of at least 0.3 of the mean density (by mass, so that void
    does not count). The ``evaluation`` is what a `value` of the ``problem`` returned, at any time;
    a ValueError if nothing was simulated. All flexible bodies are in the result, by name.
    """
    moved = trajectories_of(problem, evaluation, "local_modes").values()
    found = {}
    for name, body in problem.flexible.items():
        basis = evaluation.bodies[name].basis
        numbers, places = _local(body, evaluation.bodies[name])
        # normal modes do not share strain energy with each other, nor with constraint modes
        eigenvalues, columns = basis.eigenvalues[numbers], basis.n_constraint + numbers
        energies = [(0.5 * m.elastic(name)[:, columns] ** 2 @ eigenvalues, m.t) for m in moved]
        own = sum(trapezoid(energy, t) for energy, t in energies)
        whole = sum(trapezoid(m.strain_energy(name), m.t) for m in moved)
        share = float(own / whole) if whole > 0.0 else 0.0
        found[name] = LocalModes(numbers + 1, basis.frequencies[numbers], places, share)
    return found


def trajectories_of(problem: Problem, evaluation: Evaluation, call: str) -> dict[str, Trajectory]:
    """The trajectories of an evaluation by load case, or refuse arguments of a wrong kind."""
    validation.instance(f"{call}: problem", problem, Problem, "a Problem")
    validation.instance(f"{call}: evaluation", evaluation, Evaluation, "an Evaluation")
    evaluation.check_simulated()
    announce(problem.comm, call)
    load_cases = evaluation.load_cases.items()
    return {name: m.trajectory for name, m in load_cases if m.trajectory is not None}


def warn_of_local_modes(problem: Problem, evaluation: Evaluation) -> None:
    """Warn of each body with local modes."""
    for name, local in local_modes(problem, evaluation).items():
        if not len(local.numbers):
            continue
        modes = evaluation.bodies[name].basis.eigenvalues
        first = zip(local.numbers[:3], local.frequencies, local.places, strict=False)
        listed = ", ".join(
            f"mode {number} ({frequency:.4g} Hz) near ({', '.join(f'{x:.4g}' for x in place)}) m"
            for number, frequency, place in first
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


def _local(body: FlexibleBody, reduced: ReducedBody) -> tuple[Integers, Array]:
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
    return np.array(numbers, dtype=np.int64), np.reshape(places, (-1, domain.dimension))
