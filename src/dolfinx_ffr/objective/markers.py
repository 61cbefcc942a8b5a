# SPDX-License-Identifier: MIT
"""Objectives of the motion of a marker: distance from a path, velocity, acceleration.

A marker P with the reference position X and the shape functions Phi is at r = R + A(theta) w with
w = X + Phi q; J is the rotation by a quarter turn, omega and alpha are the angular velocity and
acceleration. Its velocity and acceleration are

    v = R' + A (omega J w + Phi q'),
    a = R'' + A b,     b = alpha J w + Phi q'' - omega^2 w + 2 omega J Phi q'.

Of a marker with geometric stiffness T, w = X + Phi q - 1/2 q . T q; Phi - T q stands for Phi in b,
which gains -q' . T q'. In space [omega] and [alpha] take the places of omega J and alpha J, see
:func:`marker_motion`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from ..body import BodyMarker, VolumeIntegrals
from ..dynamics import (
    MarkerMotion,
    Trajectory,
    TrajectoryBar,
    marker_motion,
    marker_motion_pullback,
)
from ..mechanism import Motion, check_signal, evaluated
from .base import Bodies, Objective, no_body
from .time_average import check_window, time_weights

__all__ = ["MarkerAcceleration", "MarkerVelocity", "PathTracking"]

Array = NDArray[np.float64]

#: A coordinate over time: a motion, a function of an array of times, or a constant.
Coordinate: TypeAlias = Motion | Callable[[Array], ArrayLike] | float


@dataclass(frozen=True, eq=False)
class _MarkerObjective(Objective):
    """A marker of a body, and the part of the motion that counts."""

    #: Name of the body.
    body: str
    #: Name of the marker.
    marker: str

    #: Name for messages.
    _what: ClassVar[str]

    def _check_names(self) -> None:
        validation.name(f"{self._what}: body", self.body)
        validation.name(f"{self._what}: marker", self.marker)

    def validate_names(self, markers: Mapping[str, Collection[str]], joints: list[str]) -> None:
        if self.body not in markers:
            raise no_body(self._what, self.body, markers)
        if self.marker not in markers[self.body]:
            raise ValueError(
                f"{self._what} of marker {self.marker!r}, but the markers of body {self.body!r} "
                f"are {list(markers[self.body])}"
            )

    def _body_marker(self, bodies: Bodies) -> BodyMarker:
        self.validate_names({name: body.markers for name, body in bodies.items()}, [])
        return bodies[self.body].markers[self.marker]

    def _in_space(self, trajectory: Trajectory, marker: BodyMarker) -> MarkerMotion:
        """Motion of the marker in space."""
        where = trajectory.model.coordinates_in_space(self.body)
        return marker_motion(where, marker, trajectory.y, trajectory.v, trajectory.w)

    def _in_space_pullback(
        self,
        trajectory: Trajectory,
        bodies: Bodies,
        motion: MarkerMotion,
        bars: tuple[Array, Array, Array],
    ) -> tuple[TrajectoryBar, dict[str, VolumeIntegrals]]:
        """Transpose of the motion of the marker in space: of position, velocity, acceleration."""
        where = trajectory.model.coordinates_in_space(self.body)
        marker = bodies[self.body].markers[self.marker]
        state = trajectory.y, trajectory.v, trajectory.w
        found = marker_motion_pullback(where, marker, state, motion, bars)
        bar = TrajectoryBar.zeros(trajectory)
        bar.y[:, where.all], bar.v[:, where.all], bar.w[:, where.all] = found[:3]
        return bar, self._bars(bodies, found.displacement, found.stiffening)

    def _bars(
        self, bodies: Bodies, displacement: Array, stiffening: Array
    ) -> dict[str, VolumeIntegrals]:
        """Derivatives with respect to the integrals, of which only those of the marker matter."""
        bars = {name: integrals.zeros_like() for name, integrals in bodies.items()}
        markers = bars[self.body].markers
        old = markers[self.marker]
        symmetric = 0.5 * (stiffening + stiffening.transpose(0, 2, 1))
        markers[self.marker] = replace(
            old,
            displacement=displacement,
            stiffening=None if old.stiffening is None else symmetric,
        )
        return bars


@dataclass(frozen=True, eq=False)
class PathTracking(_MarkerObjective):
    """Integral over time of the squared distance of a marker from a prescribed path [m^2 s].

        psi = int weight(t) |r_P(t) - path(t)|^2 dt

    over the instants of the trajectory. With a window only a part of the motion counts,
    for instance its end, where a robot must come to rest.

    Raises:
        ValueError: If the window is not an interval; when the value is asked for, if the path or
            the weight has the wrong shape or holds NaN, or a name does not exist.
    """

    unit: ClassVar[str] = "m^2 s"
    _what: ClassVar[str] = "path tracking"

    #: Pair (x, y), in space (x, y, z), of motions, functions of an array of times, numbers, or
    #: arrays of shape (steps + 1,) if not all are; or an array of the positions at the instants of
    #: the trajectory, shape (steps + 1, 2), in space (steps + 1, 3) [m].
    path: tuple[Coordinate, ...] | Array
    #: Begin and end of the time that counts [s]; None takes the whole motion.
    window: tuple[float, float] | None = None
    #: Weight over time: function of an array of times, or array of shape (steps + 1,); None is 1.
    weight: Callable[[Array], ArrayLike] | Array | None = None

    def __post_init__(self) -> None:
        """Check names, path and window."""
        self._check_names()
        check_window("path tracking", self.window)
        if _is_pair_of_coordinates(self.path):
            if len(self.path) not in (2, 3):
                raise ValueError(
                    "path tracking: the path is a pair (x, y), in space (x, y, z), not of "
                    f"{len(self.path)} entries"
                )
            for axis, along in zip("xyz", self.path, strict=False):
                if np.ndim(along) == 1:  # of a function it is zero
                    validation.numbers(f"path tracking: the path along {axis}", along)
                else:
                    check_signal(f"path tracking: the path along {axis}", along)
        else:
            validation.numbers("path tracking: the path", self.path)
        if self.weight is not None and not callable(self.weight):
            validation.numbers("path tracking: the weight", self.weight)

    def value(self, trajectory: Trajectory, bodies: Bodies) -> float:
        distance = self._distance(trajectory, bodies)[0]
        return float(self._weights(trajectory) @ np.sum(distance**2, axis=1))

    def pullback(
        self, trajectory: Trajectory, bodies: Bodies
    ) -> tuple[TrajectoryBar, dict[str, VolumeIntegrals]]:
        distance, w = self._distance(trajectory, bodies)
        if trajectory.model.dimension == 3:
            motion = self._in_space(trajectory, bodies[self.body].markers[self.marker])
            r_bar = 2.0 * self._weights(trajectory)[:, None] * distance
            none = np.zeros_like(r_bar)
            return self._in_space_pullback(trajectory, bodies, motion, (r_bar, none, none))
        marker = bodies[self.body].markers[self.marker]
        where = trajectory.model.coordinates(self.body)
        theta, q = trajectory.y[:, where.rotation], trajectory.elastic(self.body)
        bar = TrajectoryBar.zeros(trajectory)
        r_bar = 2.0 * self._weights(trajectory)[:, None] * distance
        local = _turned(r_bar, -theta)
        bar.y[:, where.position] = r_bar
        bar.y[:, where.rotation] = np.sum(local * _quarter(w), axis=1)
        bar.y[:, where.elastic] = _through(local, marker.shapes_at(q))
        return bar, self._bars(bodies, local.T @ q, -0.5 * _products(local, q, q))

    def _distance(self, trajectory: Trajectory, bodies: Bodies) -> tuple[Array, Array]:
        """Vectors from path to marker, and the marker in the body's axes, (steps + 1, 2) [m]."""
        marker = self._body_marker(bodies)
        if trajectory.model.dimension == 3:
            motion = self._in_space(trajectory, marker)
            return motion.position - self._target(trajectory.t, 3), motion.c
        rigid = trajectory.rigid(self.body)
        w = marker.position + marker.shift(trajectory.elastic(self.body))
        return rigid[:, :2] + _turned(w, rigid[:, 2]) - self._target(trajectory.t, 2), w

    def _target(self, t: Array, d: int) -> Array:
        """The path at the time steps, shape (steps + 1, d) [m]."""
        if _is_pair_of_coordinates(self.path):
            if len(self.path) != d:
                raise ValueError(
                    f"path tracking: the path has {len(self.path)} coordinates, but the marker has "
                    f"{d}"
                )
            return np.column_stack(
                [
                    _tabulated(f"path tracking: the path along {axis}", along, t)
                    for axis, along in zip("xyz", self.path, strict=False)
                ]
            )
        array = np.asarray(self.path, dtype=np.float64)
        return _checked("path tracking: the path", array, (t.size, d))

    def _weights(self, trajectory: Trajectory) -> Array:
        weights = time_weights(trajectory, self.window, "path tracking")
        if self.weight is None:
            return weights
        return weights * _tabulated("path tracking: the weight", self.weight, trajectory.t)


@dataclass(frozen=True)
class _SquareOverTime(_MarkerObjective):
    """Integral over time of the square of a vector that belongs to a marker."""

    #: Begin and end of the time that counts [s]; None takes the whole motion.
    window: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Check names and window."""
        self._check_names()
        check_window(self._what, self.window)

    def _vectors(self, trajectory: Trajectory, bodies: Bodies) -> Array:
        """The vector over time, shape (steps + 1, 2 or 3)."""
        raise NotImplementedError

    def value(self, trajectory: Trajectory, bodies: Bodies) -> float:
        weights = time_weights(trajectory, self.window, self._what)
        return float(weights @ np.sum(self._vectors(trajectory, bodies) ** 2, axis=1))


@dataclass(frozen=True)
class MarkerVelocity(_SquareOverTime):
    """Integral over time of the squared velocity of a marker [m^2/s].

        psi = int |v_P|^2 dt

    over the instants of the trajectory: with a window at its end, how much of a motion from rest to
    rest is left, or how fast a tool comes in.

    Raises:
        ValueError: If the window is not an interval; when the value is asked for, if a name does
            not exist.
    """

    unit: ClassVar[str] = "m^2/s"
    _what: ClassVar[str] = "marker velocity"

    def velocity(self, trajectory: Trajectory, bodies: Bodies) -> Array:
        """Velocity of the marker in global axes, shape (steps + 1, 2 or 3) [m/s].

        Args:
            trajectory: Result of the simulation.
            bodies: Volume integrals of the bodies, by name.

        Raises:
            ValueError: If a name does not exist; the message lists those that do.
        """
        marker = self._body_marker(bodies)
        if trajectory.model.dimension == 3:
            return self._in_space(trajectory, marker).velocity
        where = trajectory.model.coordinates(self.body)
        own, angle = self._relative(trajectory, marker)[1], trajectory.y[:, where.rotation]
        return trajectory.v[:, where.position] + _turned(own, angle)

    def _vectors(self, trajectory: Trajectory, bodies: Bodies) -> Array:
        return self.velocity(trajectory, bodies)

    def pullback(
        self, trajectory: Trajectory, bodies: Bodies
    ) -> tuple[TrajectoryBar, dict[str, VolumeIntegrals]]:
        marker = self._body_marker(bodies)
        weights = time_weights(trajectory, self.window, self._what)
        v_bar = 2.0 * weights[:, None] * self.velocity(trajectory, bodies)
        if trajectory.model.dimension == 3:
            motion, none = self._in_space(trajectory, marker), np.zeros_like(v_bar)
            return self._in_space_pullback(trajectory, bodies, motion, (none, v_bar, none))
        where = trajectory.model.coordinates(self.body)
        y, v = trajectory.y, trajectory.v
        q, rate = y[:, where.elastic], v[:, where.elastic]
        place, own = self._relative(trajectory, marker)
        own_bar = _turned(v_bar, -y[:, where.rotation])
        place_bar = -v[:, where.rotation, None] * _quarter(own_bar)  # J^T = -J
        shapes = marker.shapes_at(q)
        bar = TrajectoryBar.zeros(trajectory)
        bar.v[:, where.position] = v_bar
        bar.v[:, where.rotation] = np.sum(own_bar * _quarter(place), axis=1)
        bar.v[:, where.elastic] = _through(own_bar, shapes)
        bar.y[:, where.rotation] = np.sum(own_bar * _quarter(own), axis=1)
        bar.y[:, where.elastic] = _through(place_bar, shapes)
        if marker.stiffening is not None:
            T = marker.stiffening
            bar.y[:, where.elastic] -= np.einsum("td,djk,tk->tj", own_bar, T, rate)
        bends_bar = 0.5 * _products(place_bar, q, q) + _products(own_bar, rate, q)
        shapes_bar: Array = place_bar.T @ q
        shapes_bar += own_bar.T @ rate
        return bar, self._bars(bodies, shapes_bar, -bends_bar)

    def _relative(self, trajectory: Trajectory, marker: BodyMarker) -> tuple[Array, Array]:
        """The vectors w and omega J w + (Phi - T q) q', shape (steps + 1, 2) each."""
        where = trajectory.model.coordinates(self.body)
        q, rate = trajectory.y[:, where.elastic], trajectory.v[:, where.elastic]
        place = marker.position + marker.shift(q)
        drift = np.einsum("tdj,tj->td", marker.shapes_at(q), rate)
        return place, trajectory.v[:, where.rotation, None] * _quarter(place) + drift


@dataclass(frozen=True)
class MarkerAcceleration(_SquareOverTime):
    """Integral over time of the squared acceleration of a marker [m^2/s^3].

        psi = int |a_P|^2 dt

    over the instants of the trajectory: how hard a payload or a passenger is shaken. Its
    square root over the duration is the root mean square of the acceleration. Where the mechanism
    gives the ground an acceleration, that of the marker counts relative to the ground.

    Raises:
        ValueError: If the window is not an interval; when the value is asked for, if a name does
            not exist.
    """

    unit: ClassVar[str] = "m^2/s^3"
    _what: ClassVar[str] = "marker acceleration"

    def acceleration(self, trajectory: Trajectory, bodies: Bodies) -> Array:
        """Acceleration of the marker in global axes, shape (steps + 1, 2 or 3) [m/s^2].

        Args:
            trajectory: Result of the simulation.
            bodies: Volume integrals of the bodies, by name.

        Raises:
            ValueError: If a name does not exist; the message lists those that do.
        """
        marker = self._body_marker(bodies)
        if trajectory.model.dimension == 3:
            return self._in_space(trajectory, marker).acceleration
        where = trajectory.model.coordinates(self.body)
        b, angle = self._relative(trajectory, marker)[-1], trajectory.y[:, where.rotation]
        return trajectory.w[:, where.position] + _turned(b, angle)

    def _vectors(self, trajectory: Trajectory, bodies: Bodies) -> Array:
        return self.acceleration(trajectory, bodies)

    def pullback(
        self, trajectory: Trajectory, bodies: Bodies
    ) -> tuple[TrajectoryBar, dict[str, VolumeIntegrals]]:
        marker = self._body_marker(bodies)
        weights = time_weights(trajectory, self.window, self._what)
        if trajectory.model.dimension == 3:
            motion = self._in_space(trajectory, marker)
            second = 2.0 * weights[:, None] * motion.acceleration
            none = np.zeros_like(second)
            return self._in_space_pullback(trajectory, bodies, motion, (none, none, second))
        where = trajectory.model.coordinates(self.body)
        y, v, w = trajectory.y, trajectory.v, trajectory.w
        omega, alpha = (part[:, where.rotation, None] for part in (v, w))
        place, drift, b = self._relative(trajectory, marker)
        a_bar = 2.0 * weights[:, None] * self.acceleration(trajectory, bodies)
        b_bar = _turned(a_bar, -y[:, where.rotation])
        # J^T = -J
        place_bar = -alpha * _quarter(b_bar) - omega**2 * b_bar
        drift_bar = -2.0 * omega * _quarter(b_bar)
        bar = TrajectoryBar.zeros(trajectory)
        elastic, rotation = where.elastic, where.rotation
        bar.w[:, where.position] = a_bar
        bar.w[:, rotation] = np.sum(b_bar * _quarter(place), axis=1)
        q, rate, growth = (part[:, elastic] for part in (y, v, w))
        shapes = marker.shapes_at(q)
        bar.w[:, elastic] = _through(b_bar, shapes)
        bar.v[:, rotation] = np.sum(b_bar * 2.0 * (_quarter(drift) - omega * place), axis=1)
        bar.v[:, elastic] = _through(drift_bar, shapes)
        bar.y[:, rotation] = np.sum(b_bar * _quarter(b), axis=1)
        bar.y[:, elastic] = _through(place_bar, shapes)
        if marker.stiffening is not None:
            T = marker.stiffening
            bar.v[:, elastic] -= 2.0 * np.einsum("td,djk,tk->tj", b_bar, T, rate)
            bar.y[:, elastic] -= np.einsum("td,djk,tk->tj", drift_bar, T, rate)
            bar.y[:, elastic] -= np.einsum("td,djk,tk->tj", b_bar, T, growth)
        shapes_bar = place_bar.T @ q + drift_bar.T @ rate + b_bar.T @ growth
        bends_bar = 0.5 * _products(place_bar, q, q) + _products(drift_bar, rate, q)
        bends_bar += _products(b_bar, growth, q) + _products(b_bar, rate, rate)
        return bar, self._bars(bodies, shapes_bar, -bends_bar)

    def _relative(self, trajectory: Trajectory, marker: BodyMarker) -> tuple[Array, Array, Array]:
        """The vectors w, (Phi - T q) q' and b of the module's formula, (steps + 1, 2) each."""
        where = trajectory.model.coordinates(self.body)
        y, v, w = trajectory.y, trajectory.v, trajectory.w
        omega, alpha = (part[:, where.rotation, None] for part in (v, w))
        q, rate, growth = (part[:, where.elastic] for part in (y, v, w))
        shapes = marker.shapes_at(q)
        place = marker.position + marker.shift(q)
        drift = np.einsum("tdj,tj->td", shapes, rate)
        b = alpha * _quarter(place) + np.einsum("tdj,tj->td", shapes, growth)
        if marker.stiffening is not None:
            b -= np.einsum("tj,djk,tk->td", rate, marker.stiffening, rate)
        return place, drift, b - omega**2 * place + 2.0 * omega * _quarter(drift)


def _is_pair_of_coordinates(path: object) -> bool:
    """Whether a path is given by its coordinates over time, not by an array of positions."""
    return isinstance(path, tuple | list) and any(
        isinstance(part, Motion | Real) or callable(part) for part in path
    )


def _through(bars: Array, shapes: Array) -> Array:
    """Vectors (n, 2) pulled back through shape functions (n, 2, modes)."""
    return np.asarray(np.einsum("td,tdj->tj", bars, shapes))


def _products(bars: Array, a: Array, b: Array) -> Array:
    """Sum over time of vectors (n, 2) times the products of two sets of coordinates (n, modes)."""
    return np.asarray(np.einsum("td,tj,tk->djk", bars, a, b, optimize=True))


def _tabulated(what: str, function: Coordinate | Array, t: Array) -> Array:
    """A function of time at the time steps, shape (steps + 1,)."""
    if isinstance(function, Motion) or callable(function):
        values = evaluated(function, t, what)
    else:
        values = np.asarray(function, dtype=np.float64)
    return _checked(what, np.broadcast_to(values, t.shape) if values.ndim == 0 else values, t.shape)


def _checked(what: str, array: Array, shape: tuple[int, ...]) -> Array:
    if array.shape != shape:
        raise ValueError(
            f"{what} has shape {array.shape}, but with {shape[0]} time steps it must have {shape}"
        )
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{what} holds NaN or infinity")
    return array


def _turned(vectors: Array, angles: Array) -> Array:
    """Turn vectors (n, 2) by angles (n,)."""
    return np.cos(angles)[:, None] * vectors + np.sin(angles)[:, None] * _quarter(vectors)


def _quarter(vectors: Array) -> Array:
    """Turn vectors (n, 2) by a quarter turn."""
    return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)
