# SPDX-License-Identifier: MIT
"""Mechanisms in space: their kernels, and all else that is not as in the plane, see plane.py.

What both classes have is explained here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from ...arrays import Array, symmetric
from ...body import BodyMarker, VolumeIntegrals
from ...mechanism import Placement
from . import bodies_space, moments_space, spins
from .algebra import add_cross, cross, nothing
from .arrays import OF_DIRECTION, OF_SPIN, Arrays, SpaceCoordinates, Work
from .lowering import Lowering

#: Change of the direction of an axis of rotation up to which it counts as fixed.
_FIXED = 1e-3


class SpaceArrays(Arrays):
    """A mechanism in space, where bodies turn by rotation vectors."""

    d, rigid, sides, carries = 3, 6, 6, moments_space.CARRIED
    own = OF_SPIN
    swing = torque = cross
    add_torque = add_cross
    add_combination = bodies_space.add_combination
    place_body = bodies_space.place_body
    place_own = spins.place_spin
    pull_velocity_own = nothing
    accelerate_own = nothing
    add_curvature_own = spins.add_spin_curvature
    pullback_own = spins.spin_pullback
    into_coordinates = bodies_space.into_coordinates
    body_equations = bodies_space.body_equations
    body_blocks = bodies_space.body_blocks
    body_slopes = bodies_space.body_blocks
    measure_body = bodies_space.measure_body

    #: Joints that hold less than others, in words.
    looser = (
        "in place of a Revolute, a Spherical leaves both rotations free, a Universal one, a "
        "Cylindrical the position along the axis"
    )
    #: Rows and forces as the kernels take them.
    lowering = Lowering
    set_moments = staticmethod(moments_space.set_moments)
    carried_bars = moments_space.carried_bars

    @property
    def turning(self) -> list[int]:
        return [int(first) + 3 for first in self.first]

    def coordinates(self, body: int) -> SpaceCoordinates:
        """Places of the coordinates of a body."""
        return SpaceCoordinates(int(self.first[body]), int(self.modes[body]))

    @staticmethod
    def placed(placement: Placement) -> tuple[Array, Array]:
        """Rigid coordinates and their velocities in a placement, shape (rigid,) each."""
        position, rotation, velocity, spin = placement.in_space
        return np.concatenate([position, rotation]), np.concatenate([velocity, spin])

    def moments(self, body: int, *, carried: bool = False) -> Array:
        """Second moments P_ab of a body, shape (fields + 1, fields + 1, d, d) [kg m^2].

        Fields are the modes, and those that elastic coordinates carry along if asked for.
        """
        n, size = int((self.fields if carried else self.modes)[body]) + 1, self.P.shape[1]
        return self.P[body].reshape(size, 3, 3, size)[:n, :, :, :n].transpose(3, 0, 1, 2)

    @staticmethod
    def integrals(
        mass: float, S: Array, P: Array, K: Array, markers: dict[str, BodyMarker]
    ) -> VolumeIntegrals:
        """Derivatives with respect to the volume integrals, with a symmetric P."""
        P = 0.5 * (P + P.transpose(1, 0, 3, 2))
        return VolumeIntegrals.in_space(mass, S, P, K, markers)

    @staticmethod
    def inertia(P: Array) -> Array:
        """Inertia of an undeformed body by P_00, shape (1, 1) or (3, 3) [kg m^2]."""
        return np.trace(P) * np.eye(3) - P

    @staticmethod
    def inertia_pullback(bar: Array) -> Array:
        """Transpose of :meth:`inertia`, shape (d, d)."""
        return np.trace(bar) * np.eye(3) - symmetric(bar)

    @staticmethod
    def rotations(vectors: Array) -> Array:
        """Matrices (n, d, d) of rotations by their coordinates, (n,) or (n, 3) [rad]."""
        return np.asarray(Rotation.from_rotvec(np.array(vectors)).as_matrix())

    @staticmethod
    def cross_matrices(x: Array) -> Array:
        """Matrices (n, d, d) of the cross product with angular velocities, (n,) or (n, 3)."""
        out = np.zeros((len(x), 3, 3))
        out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = x.T
        return out - out.transpose(0, 2, 1)

    @staticmethod
    def axial(Z: Array) -> Array:
        """Vectors of the antisymmetric parts of matrices (n, d, d), shape (n,) or (n, 3)."""
        pairs = ((2, 1), (0, 2), (1, 0))
        return np.stack([Z[:, k, i] - Z[:, i, k] for k, i in pairs], axis=1)

    def retract(self, base: Array, y: Array) -> Array:
        """Coordinates (n,) after a shift y - base, which in space turns bodies about their axes."""
        out = y.copy()
        for place in self.turning:
            columns = slice(place, place + 3)
            turn = Rotation.from_rotvec(base[columns]) * Rotation.from_rotvec(
                y[columns] - base[columns]
            )
            out[columns] = with_turns(turn.as_rotvec(), y[columns])
        return out

    def retract_pullback(self, shift: Array, bar: Array) -> tuple[Array, Array]:
        """Transpose of :meth:`retract` with respect to the shift and to the coordinates, (n,) each.

        bar is the derivative with respect to the coordinates after it, of rotations in space to
        turns dth, dA = A [dth].
        """
        by_shift, by_y = bar.copy(), bar.copy()
        for place in self.turning:
            columns = slice(place, place + 3)
            by_shift[columns] = _tangent(shift[columns]).T @ bar[columns]
            by_y[columns] = Rotation.from_rotvec(shift[columns]).apply(bar[columns])
        return by_shift, by_y

    def difference(self, y: Array, start: Array) -> Array:
        """Shifts that lead from coordinates start to y, shape (instants, n)."""
        out, reference = np.asarray(y - start), np.broadcast_to(start, y.shape).copy()
        for place in self.turning:
            columns = slice(place, place + 3)
            turn = Rotation.from_rotvec(reference[:, columns]).inv() * Rotation.from_rotvec(
                y[:, columns]
            )
            out[:, columns] = turn.as_rotvec()
        return out

    def rotation_bar(self, bars: Mapping[int, Array], modes: int) -> Array:
        """Derivative by the rotation shapes of a marker, (3, modes); in the plane (modes,).

        The mapping ``bars`` has, by number e of a direction or spin of the marker, the derivative
        by the shapes of this vector, (3, modes).
        """
        out = np.zeros((3, modes))
        for e, bar in bars.items():
            # psi_j x n, of which the derivative is n x bar_j
            direction = self.vector_kind[e] == OF_DIRECTION
            out += np.cross(self.shapes[e, :, 0], bar, axisb=0, axisc=0) if direction else bar
        return out

    def forces(self, work: Work) -> Array:
        """Forces and moments of springs and loads, shape (forces, 3), see `applied_forces`."""
        springs = np.zeros((len(work.tension), 3))
        springs[:, 0] = work.tension
        return np.concatenate([springs, work.loads])

    def force_of(self, parts: Array, numbers: Iterable[int]) -> Array:
        """Force of springs and loads of these numbers, (instants, numbers, 3), over time."""
        springs = all(number < len(self.law) for number in numbers)
        return np.asarray(parts[:, :, 0] if springs else parts[:, 0])

    @staticmethod
    def loads_of_rotation(omega: Array, alpha: Array) -> Array:
        """Loads of the geometric stiffness by rotation, (n, 2) or (n, 9), at angular velocities."""
        W = SpaceArrays.cross_matrices(omega)
        return (SpaceArrays.cross_matrices(alpha) + W @ W).reshape(len(W), 9)

    def largest_turn(self, body: int, y: Array, v: Array, h: Array) -> float:
        """Largest angle by which a body turns in one step about an axis that moves [rad].

        Coordinates y and velocities v are of shape (instants, n); h (instants,) is the length of
        the step that ends at each instant [s].
        """
        columns = self.coordinates(body)
        omega = v[:, columns.rotation]
        speed: Array = np.asarray(np.linalg.norm(omega, axis=1))
        turning = speed > 1e-6 * float(np.max(speed)) + float(np.finfo(np.float64).tiny)
        if not np.any(turning):
            return 0.0
        axes = np.einsum(
            "tij,tj->ti", self.rotations(y[turning][:, columns.rotation]), omega[turning]
        )
        axes /= speed[turning, None]
        if np.max(np.linalg.norm(np.cross(axes, axes[0]), axis=1)) < _FIXED:
            return 0.0
        return float(np.max(speed * h))


def with_turns(vector: Array, near: Array) -> Array:
    """The rotation vector closest to another one, of the same rotation; see group.py; (3,)."""
    axis = vector if np.linalg.norm(vector) > 0.0 else near
    length = np.linalg.norm(axis)
    if not length > 0.0:
        return vector
    axis = axis / length
    turns = np.round((near - vector) @ axis / (2.0 * np.pi))
    return np.asarray(vector + 2.0 * np.pi * turns * axis)


def _tangent(u: Array) -> Array:
    """Derivative T of a rotation with respect to its vector (3,), dA = A [T du], shape (3, 3)."""
    t = float(np.linalg.norm(u))
    matrix = SpaceArrays.cross_matrices(u[None])[0]
    if t < 1e-3:
        b, c = 0.5 - t**2 / 24.0, 1.0 / 6.0 - t**2 / 120.0
    else:
        b, c = (1.0 - np.cos(t)) / t**2, (t - np.sin(t)) / t**3
    return np.asarray(np.eye(3) - b * matrix + c * matrix @ matrix)
