# SPDX-License-Identifier: MIT
"""Stress of a flexible body in motion, recovered from its elastic coordinates.

The stress is linear in the displacement, so each shape function has a stress mode, and the stress
at time t is their sum: sigma(X, t) = sum_j q_j(t) sigma(phi_j)(X). The von Mises stress, as in
`objective.PeakStress`, is found at all points and time steps by matrix products.

**Where.** In the middle of cells of order 1, and from order 2 on at the corners of each cell, from
points in which derivatives converge faster than elsewhere (`fem.StressRecovery`). Cells of order 1
reach a peak on the boundary only as the mesh is refined.

**Static correction.** Normal modes that were left out still follow the inertia forces statically.
With b the acceleration of the body's points in its frame,

    b = A^T (a_R - g) + alpha J w + sum_j q''_j w_j - omega^2 w + 2 omega J sum_j q'_j w_j,

the displacement gets (K^-1 - sum_i phi_i phi_i^T / lambda_i) (-M b), interfaces held (the method of
mode accelerations, D. Rixen, AIAA 2001-1300, doi:10.2514/6.2001-1300). b combines a few fields that
do not depend on time: one more solution with several right-hand sides. The error falls from
O(omega^2 / lambda) to its square, with lambda the first eigenvalue left out. Forces on points of
the body other than interfaces are not corrected.

**Densities between void and solid.** Given is x^s times the stress of the solid at the element's
strain, s = 0 by default: the stress in the solid part of the material. s = p - q > 0 is the
relaxation of the stress constraint of the qp approach, with p the exponent of SIMP (M. Bruggi,
Structural and Multidisciplinary Optimization 36 (2008), doi:10.1007/s00158-007-0203-6); s = 1/2 is
that of C. Le et al., ibid. 41 (2010), doi:10.1007/s00158-009-0440-y. Void has no stress. The web of
a pocket has the stress of the solid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array, Integers, Mask
from ..documentation import Shown
from ..dynamics import Trajectory
from ..fem import PLATE, Domain
from ..objective import stress_coordinates, von_mises_root
from ..parallel import gathered, on_every_rank
from ..problem import Evaluation
from ..reduction import BodyStress, FlexibleBody, ReducedBody

#: Cells of less density are void
VOID = 0.3
#: Numbers of stresses at a time
_BLOCK = 2_000_000
#: Distance of the steps at which stresses are found first
_STRIDE = 16


@dataclass(frozen=True, repr=False)
class StressModes(Shown):
    """Stress of a body for unit coordinates, at points of each cell.

    The coordinates z are the elastic ones and, with static correction, those of inertia; see
    `coordinates`.

    Attributes:
        points: (cells, points, dimension) where the stress is given, undeformed, mesh coordinates
            [m].
        values: (cells, points, 3, coordinates) s_x, s_y, t_xy in the body's frame, in space (cells,
            points, 6, coordinates) s_x, s_y, s_z, t_xy, t_yz, t_xz [Pa].
        out_of_plane: s_z / (s_x + s_y) [-].
        solid: (cells,) cells that are not void; the others have no stress.
        n_elastic: Number of elastic coordinates.
        n_constraint: Number of constraint modes among them.
        domain: The body's mesh.
    """

    points: Array
    values: Array
    out_of_plane: float
    solid: Mask
    n_elastic: int
    n_constraint: int
    domain: Domain

    @staticmethod
    def of(
        body: FlexibleBody,
        reduced: ReducedBody,
        *,
        correction: bool = True,
        relaxation: float = 0.0,
        void: float = VOID,
        clear: float = 0.0,
    ) -> StressModes:
        """The stress modes of a body at one design.

        The shape functions of the ``body`` are those of the ``reduced`` one, from its `reduce` or
        an evaluation, at any time: if it has been reduced at another design since, its matrices are
        made again. With ``correction`` it has modes of the static correction. ``relaxation`` is the
        exponent s >= 0 of the density by which the stress of the solid is scaled; cells of less
        density than ``void``, in [0, 1], have no stress, nor has what is less than ``clear`` [m]
        away from an interface (`PeakStress`).
        """
        stress, solid, scale = _scaled(body, reduced, correction, relaxation, void, clear)
        values, normal = stress.modes(correction), body.material.out_of_plane
        if np.any(scale != 1.0):  # they may take gigabytes
            values = values * scale[:, :, None, None]
        basis = reduced.basis
        counts = basis.shapes.shape[1], basis.n_constraint
        return StressModes(stress.points, values, normal, solid, *counts, body.domain)

    def coordinates(self, trajectory: Trajectory, name: str) -> Array:
        """The coordinates z over time, shape (steps + 1, coordinates).

        These are the elastic coordinates of the body ``name`` in a ``trajectory`` and, with static
        correction, the factors of the fields of b, see `objective.stress_coordinates`.
        """
        corrected = self.values.shape[3] > self.n_elastic
        return stress_coordinates(trajectory, name, self.n_constraint, correction=corrected)

    def stress(self, z: ArrayLike) -> Array:
        """The stress at the points for coordinates ``z`` at one instant, shape (coordinates,).

        The elastic ones alone leave the static correction out; another number is a ValueError.
        The result has s_x, s_y, t_xy and s_z, shape (cells, points, 4) [Pa]; in space s_x, s_y,
        s_z, t_xy, t_yz and t_xz, shape (cells, points, 6).
        """
        vector = validation.real_array("stress: coordinates", z)
        if vector.shape not in ((self.n_elastic,), self.values.shape[3:]):
            raise ValueError(
                f"stress: coordinates of shape {vector.shape}, expected ({self.n_elastic},) "
                f"elastic ones or all {self.values.shape[3]} of StressModes.coordinates"
            )
        plane = self.values[..., : len(vector)] @ vector
        if plane.shape[2] == 6:
            return np.asarray(plane)
        normal = self.out_of_plane * (plane[..., 0] + plane[..., 1])
        return np.concatenate([plane, normal[..., None]], axis=-1)

    def von_mises(self, z: ArrayLike) -> Array:
        """The von Mises stress at the points for ``z`` as of `stress`, (cells, points) [Pa]."""
        components = self.values.shape[2]
        root = von_mises_root(self.out_of_plane, components)
        return np.linalg.norm(self.stress(z)[..., :components] @ root.T, axis=-1)

    def worst(self, z: Array, times: Array) -> StressEnvelope:
        """The largest von Mises stress of each cell over time.

        ``z`` are the `coordinates`, shape (steps, coordinates), at ``times``, shape (steps,) [s].
        """
        root = von_mises_root(self.out_of_plane, self.values.shape[2])
        envelope = np.zeros(len(self.values)), *np.zeros((2, len(self.values)), dtype=np.int64)
        for all_of, of_solid in zip(
            envelope, _worst(self.values[self.solid], root, z), strict=True
        ):
            all_of[self.solid] = of_solid
        return _envelope(self.domain, self.points, self.solid, envelope, times, "")


@dataclass(frozen=True, repr=False)
class StressEnvelope(Shown):
    """The largest von Mises stress of each cell over a motion, and where and when it is largest.

    Attributes:
        stress: (cells,) of the cells owned by this rank; 0 in void [Pa].
        step: (cells,) time step at which it occurs.
        time: (cells,) time at which it occurs [s].
        solid: (cells,) cells that are not void.
        largest: Largest stress of all cells, the same on every rank [Pa].
        largest_time: When it occurs [s].
        largest_step: Time step at which it occurs.
        largest_position: (dimension,) where it occurs, undeformed, mesh coordinates [m].
        load_case: In which load case, where it was found by `worst_stress`.
    """

    stress: Array
    step: Integers
    time: Array
    solid: Mask
    largest: float
    largest_time: float
    largest_step: int
    largest_position: Array
    load_case: str = ""


def von_mises(body: FlexibleBody, reduced: ReducedBody, q: ArrayLike) -> Array:
    """The von Mises stress of each cell for elastic coordinates, shape (cells,) [Pa].

    It is the largest one at the points of the cell, for elastic coordinates ``q``, shape (modes,),
    of the ``reduced`` ``body``. Inertia forces are not known here; for a body in motion
    `worst_stress` is more accurate. Void and relaxation have the defaults of `StressModes.of`.
    """
    modes = StressModes.of(body, reduced, correction=False)
    return np.asarray(np.max(modes.von_mises(q), axis=1))


def worst_stress(
    body: FlexibleBody,
    evaluation: Evaluation,
    name: str,
    *,
    correction: bool = True,
    relaxation: float = 0.0,
    void: float = VOID,
    clear: float = 0.0,
) -> StressEnvelope:
    """The largest von Mises stress of each cell over a motion, and when it occurs.

    The ``body`` has a ``name`` in the mechanism; the ``evaluation`` is what `Problem.value` or
    `Problem.gradient` returned, at any time. Of several load cases the result is the one with the
    largest stress; for the others give `Evaluation.alone`. ``correction``, ``relaxation``, ``void``
    and ``clear`` are arguments of `StressModes.of`. A ValueError if there is no such body, or a
    number is out of range.
    """
    validation.instance("worst_stress: evaluation", evaluation, Evaluation, "an Evaluation")
    validation.instance("worst_stress: body", body, FlexibleBody, "a FlexibleBody")
    domain = body.domain
    with on_every_rank(domain.comm, "worst_stress"):
        if name not in evaluation.bodies:
            names = sorted(evaluation.bodies)
            raise ValueError(f"worst_stress: no flexible body {name!r}; there are {names}")
        body.refuse_foreign(evaluation.bodies[name], name)
    reduced = evaluation.bodies[name]
    stress, solid, scale = _scaled(body, reduced, correction, relaxation, void, clear)
    evaluation.check_simulated()
    trajectories = {
        n: m.trajectory for n, m in evaluation.load_cases.items() if m.trajectory is not None
    }
    n_constraint, root = (
        reduced.basis.n_constraint,
        von_mises_root(stress.out_of_plane, stress.components),
    )
    z = [
        stress_coordinates(t, name, n_constraint, correction=correction)
        for t in trajectories.values()
    ]
    peaks = np.zeros((len(z), domain.n_cells))
    steps, places = np.zeros((2, len(z), domain.n_cells), dtype=np.int64)
    for block, values in stress.in_blocks(correction):
        chosen = np.arange(block.start, block.stop)[solid[block]]
        modes = values[solid[block]] * scale[chosen][:, :, None, None]
        for i, of_case in enumerate(z):
            peaks[i, chosen], steps[i, chosen], places[i, chosen] = _worst(modes, root, of_case)
    envelopes = [
        _envelope(domain, stress.points, solid, (peaks[i], steps[i], places[i]), t.t, case)
        for i, (case, t) in enumerate(trajectories.items())
    ]
    return max(envelopes, key=lambda worst: worst.largest)


def _envelope(
    domain: Domain,
    points: Array,
    solid: Mask,
    worst: tuple[Array, Integers, Integers],
    times: Array,
    case: str,
) -> StressEnvelope:
    """The envelope of stresses, steps and points (cells,) as of `_worst`."""
    stress, step, place = worst
    positions = points[np.arange(domain.n_cells), place]
    local_largest = (0.0, 0, np.zeros(domain.dimension))
    if domain.n_cells:
        i = int(np.argmax(stress))
        local_largest = (float(stress[i]), int(step[i]), positions[i])
    of_ranks = gathered(domain.comm, "the largest stress of a body", local_largest)
    largest, step_of_largest, position = max(of_ranks, key=lambda entry: entry[0])
    when = np.asarray(times)
    largest_fields = largest, float(when[step_of_largest]), step_of_largest, position, case
    return StressEnvelope(stress, step, when[step], solid, *largest_fields)


def _scaled(
    body: FlexibleBody,
    reduced: ReducedBody,
    correction: bool,
    relaxation: float,
    void: float,
    clear: float,
) -> tuple[BodyStress, Mask, Array]:
    """Stress of a body, which of its cells are solid, and factors (cells, points or 1)."""
    validation.instance("stress: body", body, FlexibleBody, "a FlexibleBody")
    validation.instance("stress: reduced", reduced, ReducedBody, "what its `reduce` returned")
    validation.flag("stress: correction", correction)
    validation.number("stress: relaxation", relaxation, least=0.0)
    validation.number("stress: void", void, least=0.0, most=1.0)
    # a mesh that fits a part has cells of its material alone, and the density of a milled plate
    # is its thickness: a web is thinner than what is void elsewhere, and bears stress
    material_alone = body.domain.whole is not None or body.interpolation == PLATE
    least = 0.0 if material_alone else void
    stress, solid = BodyStress(body, reduced), reduced.density >= least
    scale = np.where(solid, reduced.density**relaxation, 0.0)[:, None]
    if validation.number("stress: clear", clear, least=0.0, unit="m") > 0.0:
        scale = np.where(stress.interface_distance < clear, 0.0, scale)
    return stress, solid, scale


def _worst(values: Array, root: Array, z: Array) -> tuple[Array, Integers, Integers]:
    """The largest von Mises stress of some cells over time, its steps and points, (cells,) each.

    ``values`` have the shape (cells, points, components, n), the coordinates ``z`` (steps, n); the
    norm of the ``root`` (components, components) times a stress is its von Mises stress.
    Between two steps the stress is at most the larger of both and what the coordinates, where
    they are off the line between them, can add: few steps in between have to be looked at.
    """
    cells, points, components, n = values.shape
    stress = np.zeros(cells)
    step, place = np.zeros((2, cells), dtype=np.int64)

    # of each coordinate in each interval between two ends, the largest deviation from the line
    ends = np.unique([*range(0, len(z), _STRIDE), len(z) - 1])
    lines = [np.interp(np.arange(len(z)), ends, at_ends) for at_ends in z[ends].T]
    deviations = np.maximum.reduceat(np.abs(z.T - lines), ends, axis=1)

    several = max(1, _BLOCK // (components * points * max(n, len(ends))))
    for begin in range(0, cells, several):
        block = slice(begin, min(begin + several, cells))
        # of the modes, which are fewer than the steps; each point has its components first
        modes = np.tensordot(root, values[block], axes=(1, 2)).reshape(len(root), -1, n)
        norms = np.linalg.norm(modes @ z[ends].T, axis=0)
        peak, when = norms.max(axis=1), ends[norms.argmax(axis=1)]
        # only points whose bound exceeds the largest stress of their cell at the ends are looked at
        lower_bound = np.repeat(peak.reshape(-1, points).max(axis=1), points)
        bound = np.linalg.norm(modes, axis=0) @ deviations
        bound[:, :-1] += np.maximum(norms[:, :-1], norms[:, 1:])
        for k in np.flatnonzero(np.diff(ends) > 1):
            candidates = np.flatnonzero(bound[:, k] > lower_bound)
            between = np.arange(ends[k] + 1, ends[k + 1])
            inner = np.linalg.norm(modes[:, candidates] @ z[between].T, axis=0)
            higher = inner.max(axis=1) > peak[candidates]
            when[candidates[higher]] = between[inner.argmax(axis=1)[higher]]
            peak[candidates] = np.maximum(peak[candidates], inner.max(axis=1))

        points_of_peak = np.arange(0, len(peak), points) + peak.reshape(-1, points).argmax(axis=1)
        stress[block], step[block], place[block] = (
            peak[points_of_peak],
            when[points_of_peak],
            points_of_peak % points,
        )
    return stress, step, place
