# SPDX-License-Identifier: MIT
"""Loads on the bodies of a machine whose drives leave no freedom, while nothing deforms.

Its rigid motion does not depend on the masses of its bodies, and the forces in its joints follow
from these: they are affine in the density of every body. With the virtual displacement u of a body
in its own axes its quasi-static load does the work

    - int rho a . u dX  +  sum_markers F . u,        F = F_0 + sum_bodies H int rho a . E dX

where a is the acceleration of its points less gravity, F are forces and moments at its markers, and
E unit motions of a rigid body. The same H takes displacements of markers to rigid motions of all
bodies that keep the joints closed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..body import BodyMarker, VolumeIntegrals
from ..dynamics import (
    ACCELERATIONS,
    CONSTRAINTS,
    FORCES,
    FlatModel,
    Integrator,
    Kinematics,
    Trajectory,
    assemble_model,
    integrate,
)
from ..mechanism import Mechanism

#: Largest condition of the joints' equations, their rows of unit length, at which the forces in
#: them keep six digits: beyond it a machine stands in a singular position
_SINGULAR = 1e-6 / float(np.finfo(float).eps)
#: Share of its mass that a designed body keeps where forces without it are wanted, as no body is
#: without mass and moments of inertia: so much of its own forces is left in them. With 1e-9, and in
#: the plane with 1e-15, the bound of a rod is the same to six digits.
_MASSLESS = 1e-12


@dataclass(frozen=True, eq=False)
class DrivenLoads:
    """Loads on one body of a driven machine over time, in the axes of the body.

    Attributes:
        accelerations: Factors of the fields of acceleration (`rigid_motions`) in the acceleration
            less gravity, shape (instants, 4), in space (instants, 12) [m/s^2, 1/s^2].
        forces: Forces and moments at the markers, one marker after the other, that do not depend
            on the designed bodies, shape (instants, 3 markers), in space (instants, 6 markers)
            [N, N m].
        reactions: H by designed body, of what its inertia adds to these forces, shape (instants,
            3 markers, 3), in space (instants, 6 markers, 6).
    """

    accelerations: Array
    forces: Array
    reactions: dict[str, Array]


def rigid_motions(dimension: int) -> Array:
    """Unit motions of a rigid body as sums of the fields of its acceleration.

    These fields are unit translations, and in the plane w_0 and J w_0, in space the products
    w_0^l e_k, k first; the motions are translations and rotations. Shape (4, 3), in space (12, 6).
    """
    if dimension == 2:
        return np.eye(4)[:, [0, 1, 3]]
    motions = np.zeros((12, 6))
    motions[:3, :3] = np.eye(3)
    for axis in range(3):  # e_axis x w_0, by the matrix of the cross product
        motions[3:, 3 + axis] = np.cross(np.eye(3)[axis], np.eye(3)).T.ravel()
    return motions


def rigid_trajectory(
    mechanism: Mechanism, bodies: Mapping[str, VolumeIntegrals], integrator: Integrator
) -> Trajectory:
    """The motion of the ``mechanism`` with all ``bodies`` rigid; errors as in `simulate`."""
    rigid = {name: body.leading(0) for name, body in bodies.items()}
    return integrate(_of_rigid_bodies(mechanism, rigid), rigid, integrator)


def driven_loads(trajectory: Trajectory, designed: Sequence[str]) -> dict[str, DrivenLoads]:
    """Loads on the ``designed`` bodies of a `rigid_trajectory`, by name.

    Raises:
        ValueError: If the drives leave a freedom, or the machine passes a singular position.
    """
    model = trajectory.model
    if model.rows != model.size:
        raise ValueError(
            f"bound: the rigid motion depends on the parts, because {model.rows} rows of joints "
            f"and drives are fewer than the {model.size} coordinates of the bodies; give every "
            "motion of the machine a drive"
        )
    probing = _probing(model, designed)
    kinematics = Kinematics(probing.arrays, trajectory.turns)
    eq, rigid = kinematics.equations, probing.rigid
    places = {name: probing.coordinates(name) for name in designed}
    states = []
    for k in range(trajectory.t.size):
        y, v, w = np.zeros((3, probing.size))
        y[rigid], v[rigid] = trajectory.y[k], trajectory.v[k]
        kinematics.set(y, v)
        kinematics.evaluate(k, CONSTRAINTS | ACCELERATIONS)
        across = eq.C[:, rigid].copy()
        _refuse_singular(model, across, trajectory.t[k])
        w[rigid] = np.linalg.solve(across, -eq.acceleration)
        kinematics.set(y, v, w)
        kinematics.evaluate(k, CONSTRAINTS | FORCES)
        carried = np.linalg.solve(across.T, np.eye(model.rows))  # multipliers by forces
        states.append((w[rigid], eq.r.copy(), eq.C.copy(), carried))
    w, forces, rows, carried = (np.array(each) for each in zip(*states, strict=True))

    multipliers = -np.einsum("trc,tc->tr", carried, forces[:, rigid])
    loads = {}
    for name in designed:
        elastic = places[name].elastic
        probes = rows[:, :, elastic]
        fixed = -forces[:, elastic] - np.einsum("trp,tr->tp", probes, multipliers)
        reactions = {}
        for mover in designed:
            of_rigid = model.coordinates(mover).rigid
            by_force = np.einsum("trp,trc->tpc", probes, carried[:, :, of_rigid])
            d, turn = model.dimension, trajectory.rotation(mover)
            by_force[..., :d] = by_force[..., :d] @ turn  # forces in the axes of the body
            reactions[mover] = by_force
        loads[name] = DrivenLoads(_accelerations(trajectory, w, name), fixed, reactions)
    return loads


def _of_rigid_bodies(mechanism: Mechanism, rigid: Mapping[str, VolumeIntegrals]) -> Mechanism:
    """The ``mechanism`` of ``rigid`` bodies, which have no deformation to begin with or to damp."""
    start = mechanism.start.resized({name: 0 for name in rigid})
    return replace(mechanism, start=start, damping={})


def _probing(model: FlatModel, designed: Sequence[str]) -> FlatModel:
    """The ``model`` with one shape function without inertia for each motion of each marker.

    So the forces of these elastic coordinates are those at the markers.
    """
    bodies = {n: _probed(b) if n in designed else b for n, b in model.bodies.items()}
    probing = assemble_model(model.mechanism, bodies, model.times, checked=True)
    return replace(probing, arrays=probing.arrays._replace(start_angles=model.arrays.start_angles))


def _probed(body: VolumeIntegrals) -> VolumeIntegrals:
    """A body all but without mass, with a shape function for each motion of each marker."""
    d = body.dimension
    motions = 3 * d - 3  # of a marker: translations, then rotations
    n = motions * len(body.markers)
    mass = _MASSLESS * body.mass
    S = np.vstack([_MASSLESS * body.S[:1], np.zeros((n, d))])

    markers = {}
    for number, (name, point) in enumerate(body.markers.items()):
        shapes = np.eye(motions, n, motions * number)
        rotation = shapes[d] if d == 2 else shapes[d:]
        markers[name] = BodyMarker(point.position, shapes[:d], rotation, None, point.axes)

    # the shape functions have unit generalised masses, and no coupling to the rigid motion
    if body.P is not None:
        P = np.zeros((n + 1, n + 1, d, d))
        P[0, 0] = _MASSLESS * body.P[0, 0]
        P[range(1, n + 1), range(1, n + 1)] = np.eye(d)
        return VolumeIntegrals.in_space(mass, S, P, np.eye(n), markers)
    G = np.eye(n + 1)
    G[0, 0] = _MASSLESS * body.G[0, 0]
    return VolumeIntegrals(mass, S, G, np.zeros((n + 1, n + 1)), np.eye(n), markers)


def _refuse_singular(model: FlatModel, rows: Array, time: float) -> None:
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    if not np.linalg.cond(rows / np.maximum(lengths, np.finfo(float).tiny)) < _SINGULAR:
        raise ValueError(
            f"bound: the machine is in a singular position at t = {time:.6g} s, where its drives "
            "do not determine the forces on the parts"
        )


def _accelerations(trajectory: Trajectory, w: Array, name: str) -> Array:
    """Factors of the fields of acceleration less gravity of a body, shape (instants, fields)."""
    model = trajectory.model
    place, d = model.coordinates(name), model.dimension
    gravity = model.arrays.gravity[: trajectory.t.size]
    turn = trajectory.rotation(name)
    moved = np.einsum("tji,tj->ti", turn, w[:, place.position] - gravity)
    speed, growth = trajectory.v[:, place.rotation], w[:, place.rotation]
    if d == 2:
        return np.column_stack([moved, -(speed**2), growth])
    spins = np.cross(np.eye(3), speed[:, None, :])  # rows of the matrix of the cross product
    gradient = np.cross(np.eye(3), growth[:, None, :]) + spins @ spins
    return np.column_stack([moved, gradient.reshape(len(moved), 9)])
