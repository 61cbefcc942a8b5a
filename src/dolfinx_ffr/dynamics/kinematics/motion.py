# SPDX-License-Identifier: MIT
"""Results of a motion: rotations, energies and momenta of bodies, and markers in space."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, RotationSpline

from ...arrays import Array, Integers, symmetric
from ...body import BodyMarker
from .arrays import SpaceCoordinates, carried_of
from .body_arrays import ModelArrays
from .carried import marked
from .space import SpaceArrays, with_turns

#: Coordinates, velocities and accelerations of a body over time
State = tuple[Array, Array, Array]
#: Columns of the coordinates of one body in space
IN_SPACE: Any = SimpleNamespace(position=slice(0, 3), rotation=slice(3, 6), elastic=slice(6, None))


class Momenta(NamedTuple):
    """Energies and momenta of a body over time."""

    #: Kinetic energy, shape (instants,) [J].
    kinetic: Array
    #: Linear momentum, shape (instants, d) [kg m/s].
    linear: Array
    #: Angular momentum about the origin of the global axes, shape (instants,), in space
    #: (instants, 3) [kg m^2/s].
    angular: Array
    #: Mass times position of the centre of mass, shape (instants, d) [kg m].
    first_moment: Array


def momenta_of(model: ModelArrays, body: int, y: Array, v: Array) -> Momenta:
    """Energies and momenta of a body; coordinates y and velocities v of shape (instants, n)."""
    columns, m, P = model.coordinates(body), model.mass[body], model.moments(body, carried=True)
    qh, vh = marked(carried_of(model, body), y[:, columns.elastic], v[:, columns.elastic])
    A, W = model.rotations(y[:, columns.rotation]), model.cross_matrices(v[:, columns.rotation])
    R, velocity, S = y[:, columns.position], v[:, columns.position], model.S[body, : len(P)]
    AT = A.transpose(0, 2, 1)
    Zq = np.einsum("ta,tb,abkl->tkl", qh, qh, P, optimize=True)
    Zv = np.einsum("ta,tb,abkl->tkl", vh, qh, P, optimize=True)
    arm = np.einsum("tij,tj->ti", A, qh @ S)
    drift = np.einsum("tij,tj->ti", A, np.einsum("tij,tj->ti", W, qh @ S) + vh @ S)
    linear, G = m * velocity + drift, np.einsum("abkk->ab", P)
    # Moments of momenta are the axial vectors of their products with the arms.
    moment = linear[:, :, None] * R[:, None] + velocity[:, :, None] * arm[:, None]
    moment += A @ (W @ Zq + Zv) @ AT
    kinetic = 0.5 * m * np.sum(velocity**2, axis=1) + np.sum(velocity * drift, axis=1)
    kinetic += np.sum(W * (0.5 * W @ Zq + Zv), axis=(1, 2)) + 0.5 * np.sum((vh @ G) * vh, axis=1)
    return Momenta(kinetic, linear, model.axial(moment), m * R + arm)


class MarkerMotion(NamedTuple):
    """A marker over time, and what its derivatives are made of."""

    #: Position, velocity and acceleration in the global axes, shape (instants, 3) each.
    position: Array
    velocity: Array
    acceleration: Array
    #: Rotation of the body, shape (instants, 3, 3).
    A: Array
    #: Place in the body's axes, its elastic rate, velocity and acceleration without the frame's.
    c: Array
    rate: Array
    c1: Array
    c2: Array
    #: Shape functions at the marker, shape (instants, 3, modes).
    shapes: Array


def marker_motion(
    where: SpaceCoordinates, marker: BodyMarker, y: Array, v: Array, w: Array
) -> MarkerMotion:
    """Motion of a marker of a body.

    Args:
        where: SpaceCoordinates of the body.
        marker: The marker.
        y: Coordinates over time, shape (instants, n).
        v: Velocities over time, shape (instants, n).
        w: Accelerations over time, shape (instants, n).
    """
    q, dq, ddq = (states[:, where.elastic] for states in (y, v, w))
    omega, alpha = v[:, where.rotation], w[:, where.rotation]
    A, shapes = SpaceArrays.rotations(y[:, where.rotation]), marker.shapes_at(q)
    c = marker.position + marker.shift(q)
    rate = np.einsum("tkj,tj->tk", shapes, dq)
    c1 = np.cross(omega, c) + rate
    c2 = np.cross(alpha, c) + np.cross(omega, c1 + rate) + np.einsum("tkj,tj->tk", shapes, ddq)
    if marker.stiffening is not None:
        c2 -= np.einsum("tj,kjl,tl->tk", dq, marker.stiffening, dq)

    def turned(x: Array) -> Array:
        return np.asarray(np.einsum("tij,tj->ti", A, x))

    return MarkerMotion(
        y[:, where.position] + turned(c),
        v[:, where.position] + turned(c1),
        w[:, where.position] + turned(c2),
        A,
        c,
        rate,
        c1,
        c2,
        shapes,
    )


def columns_in_space(size: int) -> Integers:
    """Places in space of a planar body's ``size`` coordinates: x, y, rotation about z, elastic."""
    return np.array([0, 1, 5, *range(6, size + 3)])


def motion_of_marker(
    marker: BodyMarker, y: Array, v: Array, w: Array
) -> tuple[BodyMarker, State, MarkerMotion]:
    """A marker, the state of its body and its motion, as if in space.

    A body in the plane is embedded in the plane z = 0, and turns about the z axis. Coordinates y,
    velocities v and accelerations w of the body have the shape (instants, n).
    """
    if not marker.planar:
        return marker, (y, v, w), marker_motion(IN_SPACE, marker, y, v, w)
    columns = columns_in_space(y.shape[1])

    def embedded(in_plane: Array) -> Array:
        in_space = np.zeros((len(in_plane), in_plane.shape[1] + 3))
        in_space[:, columns] = in_plane
        return in_space

    def padded(in_plane: Array) -> Array:
        return np.concatenate([in_plane, np.zeros((1, *in_plane.shape[1:]))])

    T = marker.stiffening
    marker = BodyMarker(
        padded(marker.position),
        padded(marker.displacement),
        np.zeros((3, marker.displacement.shape[1])),
        None if T is None else padded(T),
    )
    state = embedded(y), embedded(v), embedded(w)
    motion = marker_motion(IN_SPACE, marker, *state)
    # no round-off by rotation vectors
    angle = state[0][:, 5]
    A = np.zeros_like(motion.A)
    A[:, 0, 0] = A[:, 1, 1] = np.cos(angle)
    A[:, 1, 0] = np.sin(angle)
    A[:, 0, 1], A[:, 2, 2] = -A[:, 1, 0], 1.0
    position, velocity, acceleration = (
        of_frame[:, :3] + np.einsum("tij,tj->ti", A, local)
        for of_frame, local in zip(state, (motion.c, motion.c1, motion.c2), strict=True)
    )
    motion = motion._replace(position=position, velocity=velocity, acceleration=acceleration, A=A)
    return marker, state, motion


def turned_between(t: Array, vectors: Array, times: Array) -> tuple[Array, Array]:
    """Rotation vectors and angular velocities at times (n,) between instants t [s], (n, 3) each.

    A spline on the group of rotations passes through the vectors (instants, 3) at the instants,
    each less than half a turn from the next. Vectors keep the full turns of those before; angular
    velocities are those in the turned axes.
    """
    spline = RotationSpline(t, Rotation.from_rotvec(vectors))
    last_vectors = vectors[np.clip(np.searchsorted(t, times, "right") - 1, 0, t.size - 1)]
    shortest, unwrapped = np.asarray(spline(times).as_rotvec()), []
    for vector, last_vector in zip(shortest, last_vectors, strict=True):
        unwrapped.append(with_turns(vector, last_vector))
    return np.array(unwrapped), np.asarray(spline(times, 1))


class MarkerBars(NamedTuple):
    """Derivatives with respect to the coordinates of a body, and to the shapes of a marker."""

    #: With respect to its coordinates, rotations as dA = A [dth], shape (instants, 6 + modes).
    y: Array
    #: With respect to its velocities, likewise.
    v: Array
    #: With respect to its accelerations, likewise.
    w: Array
    #: With respect to position (3,), displacement (3, modes), geometric stiffness (3, modes, modes)
    position: Array
    displacement: Array
    stiffening: Array


def marker_motion_pullback(
    where: SpaceCoordinates,
    marker: BodyMarker,
    state: tuple[Array, Array, Array],
    motion: MarkerMotion,
    bars: tuple[Array, Array, Array],
) -> MarkerBars:
    """Transpose of :func:`marker_motion`.

    Args:
        where: SpaceCoordinates of the body.
        marker: The marker.
        state: Coordinates, velocities and accelerations over time, shape (instants, n) each.
        motion: The motion of the marker.
        bars: Derivatives of a number with respect to its position, velocity and acceleration, shape
            (instants, 3) each.
    """
    y, v, w = state
    q, dq, ddq = (states[:, where.elastic] for states in (y, v, w))
    omega, alpha = v[:, where.rotation], w[:, where.rotation]
    p, d, a = (np.einsum("tij,ti->tj", motion.A, bar) for bar in bars)
    swung, cross = np.cross(a, omega), np.cross
    s = p + cross(d, omega) + cross(a, alpha) + cross(swung, omega)
    u = d + 2.0 * swung

    def through(bar: Array) -> Array:
        return np.asarray(np.einsum("tk,tkj->tj", bar, motion.shapes))

    turn = cross(motion.c, p) + cross(motion.c1, d) + cross(motion.c2, a)
    spin = cross(motion.c, d) + cross(motion.c, swung) + cross(motion.c1 + motion.rate, a)
    by_y, by_v = through(s), through(u)
    displacement = s.T @ q + u.T @ dq + a.T @ ddq
    stiffening = np.zeros((3, q.shape[1], q.shape[1]))
    if marker.stiffening is not None:
        T = marker.stiffening
        by_v -= 2.0 * np.einsum("tk,kjl,tl->tj", a, T, dq)
        by_y -= np.einsum("tk,kjl,tl->tj", u, T, dq) + np.einsum("tk,kjl,tl->tj", a, T, ddq)
        for bar, one, two in ((0.5 * s, q, q), (u, dq, q), (a, ddq, q), (a, dq, dq)):
            stiffening -= np.einsum("tk,ti,tj->kij", bar, one, two, optimize=True)
        stiffening = symmetric(stiffening)
    return MarkerBars(
        np.hstack([bars[0], turn, by_y]),
        np.hstack([bars[1], spin, by_v]),
        np.hstack([bars[2], cross(motion.c, a), through(a)]),
        s.sum(axis=0),
        displacement,
        stiffening,
    )
