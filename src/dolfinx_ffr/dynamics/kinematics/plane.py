# SPDX-License-Identifier: MIT
"""Mechanisms in the plane: their kernels, and all else that is not as in space, see space.py."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from ...arrays import Array
from ...body import QUARTER_TURN, BodyMarker, VolumeIntegrals
from ...mechanism import Placement
from . import bodies_plane, directions, moments_plane
from .algebra import nothing
from .arrays import OF_DIRECTION, OF_SPIN, Arrays, PlaneCoordinates, Work, constraints
from .lowering_plane import PlaneLowering


class PlaneArrays(Arrays):
    """A mechanism in the plane, where bodies turn by angles."""

    d, rigid, sides, carries = 2, 3, 4, moments_plane.CARRIED
    #: Directions have the angle of their marker and no more.
    own = OF_DIRECTION
    swing = bodies_plane.swing
    torque = bodies_plane.torque
    add_torque = bodies_plane.add_torque
    add_combination = bodies_plane.add_combination
    place_body = bodies_plane.place_body
    place_own = directions.place_direction
    pull_velocity_own = directions.pull_direction_velocity
    accelerate_own = directions.accelerate_direction
    add_curvature_own = directions.add_direction_curvature
    pullback_own = directions.direction_pullback
    into_coordinates = nothing
    body_equations = bodies_plane.body_equations
    body_blocks = bodies_plane.body_blocks
    body_slopes = bodies_plane.body_slopes
    measure_body = bodies_plane.measure_body

    looser = ""
    lowering = PlaneLowering
    set_moments = staticmethod(moments_plane.set_moments)
    carried_bars = moments_plane.carried_bars

    def coordinates(self, body: int) -> PlaneCoordinates:
        return PlaneCoordinates(int(self.first[body]), int(self.modes[body]))

    @staticmethod
    def placed(placement: Placement) -> tuple[Array, Array]:
        position, velocity = placement.position, placement.velocity
        rates = np.array([*velocity, placement.angular_velocity])
        return np.array([*position, placement.angle]), rates

    def moments(self, body: int, *, carried: bool = False) -> Array:
        # P_ab has the trace G_ab and the antisymmetric part N_ab, and no other part counts.
        n = int((self.fields if carried else self.modes)[body]) + 1
        G, N = self.G[body, :n, :n], self.N[body, :n, :n]
        return np.moveaxis(0.5 * np.array([[G, N], [-N, G]]), (0, 1), (2, 3))

    @staticmethod
    def integrals(
        mass: float, S: Array, P: Array, K: Array, markers: dict[str, BodyMarker]
    ) -> VolumeIntegrals:
        G, N = P[:, :, 0, 0] + P[:, :, 1, 1], 0.5 * (P[:, :, 0, 1] - P[:, :, 1, 0])
        G, N = 0.25 * (G + G.T), 0.5 * (N - N.T)
        return VolumeIntegrals(mass, S, G, N, K, markers)

    @staticmethod
    def inertia(P: Array) -> Array:
        return np.array([[np.trace(P)]])

    @staticmethod
    def inertia_pullback(bar: Array) -> Array:
        return float(bar.item()) * np.eye(2)

    @staticmethod
    def rotations(angles: Array) -> Array:
        c, s = np.cos(angles), np.sin(angles)
        return np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)

    @staticmethod
    def cross_matrices(x: Array) -> Array:
        return np.einsum("t,kl->tkl", x, QUARTER_TURN)

    @staticmethod
    def axial(Z: Array) -> Array:
        return np.asarray(Z[:, 1, 0] - Z[:, 0, 1])

    def retract(self, base: Array, y: Array) -> Array:
        return y

    def retract_pullback(self, shift: Array, bar: Array) -> tuple[Array, Array]:
        return bar.copy(), bar.copy()

    def difference(self, y: Array, start: Array) -> Array:
        return np.asarray(y - start)

    def rotation_bar(self, bars: Mapping[int, Array], modes: int) -> Array:
        return np.asarray(sum((bar[0] for bar in bars.values()), np.zeros(modes)))

    def forces(self, work: Work) -> Array:
        rows = constraints(self)
        springs = -work.tension[:, None] * work.g[rows:, :2]
        forces = np.pad(np.concatenate([springs, work.loads]), ((0, 0), (0, 1)))
        vectors = np.concatenate([self.side[rows:, 0], self.load_vector])
        spins = self.vector_kind[vectors] == OF_SPIN
        forces[spins] = np.roll(forces[spins], 2, axis=1)
        return forces

    def force_of(self, parts: Array, numbers: Iterable[int]) -> Array:
        return np.asarray(np.sum(parts, axis=1))

    @staticmethod
    def loads_of_rotation(omega: Array, alpha: Array) -> Array:
        return np.column_stack([omega**2, alpha])

    def largest_turn(self, body: int, y: Array, v: Array, h: Array) -> float:
        return 0.0  # the axis does not move
