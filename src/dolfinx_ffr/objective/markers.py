# SPDX-License-Identifier: MIT
"""Objectives of the motion of a marker: distance from a path, velocity, acceleration.

The kinematics come from `motion_of_marker` in space, in which a body in the plane is embedded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Real
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from ..body import BodyMarker
from ..dynamics import (
    IN_SPACE,
    MarkerMotion,
    State,
    Trajectory,
    TrajectoryBar,
    columns_in_space,
    marker_motion_pullback,
    motion_of_marker,
)
from ..mechanism import Motion, check_signal, evaluated
from .base import Derivatives, Inventory, Objective, Response, no_body, no_marker
from .time_average import check_window, time_weights

#: A coordinate over time: a motion, a function of an array of times, or a constant.
Coordinate: TypeAlias = Motion | Callable[[Array], ArrayLike] | float


@dataclass(frozen=True, eq=False)
class _IntegralOfSquare(Objective):
    """Integral over time of the square of a vector of one marker of a body."""

    body: str  #: Name of the body
    marker: str  #: Name of the marker

    _what: ClassVar[str]  #: Name for messages
    _vector: ClassVar[str]  #: Name of the vector in `MarkerMotion`

    def _check_names(self) -> None:
        validation.name(f"{self._what}: body", self.body)
        validation.name(f"{self._what}: marker", self.marker)

    def validate(self, inventory: Inventory) -> None:
        markers = inventory.markers
        if self.body not in markers:
            raise no_body(self._what, self.body, markers)
        if self.marker not in markers[self.body]:
            raise no_marker(self._what, self.marker, self.body, markers[self.body])

    def vectors(self, response: Response) -> Array:
        """The vector at a ``response`` in global axes, shape (steps + 1, 2 or 3)."""
        vectors: Array = getattr(self._motion(response), self._vector)
        return vectors[:, : response.trajectory.model.dimension]

    def _weights(self, trajectory: Trajectory) -> Array:
        """Weights of the instants, shape (steps + 1,)."""
        raise NotImplementedError

    def evaluate(self, response: Response) -> float:
        weights = self._weights(response.trajectory)
        return float(weights @ np.sum(self.vectors(response) ** 2, axis=1))

    def derivatives(self, response: Response) -> Derivatives:
        weights = self._weights(response.trajectory)
        bar = 2.0 * weights[:, None] * self.vectors(response)
        return self._pullback(response, **{self._vector: bar})

    def _motion(self, response: Response) -> MarkerMotion:
        """The motion of the marker, as if in space."""
        self.validate(response.inventory)
        return _moved(response, self.body, self.marker)[2]

    def _pullback(self, response: Response, **bars: Array) -> Derivatives:
        """Derivatives from those by vectors of the marker, by name, (steps + 1, 2 or 3)."""
        self.validate(response.inventory)
        return marker_derivatives(response, self.body, self.marker, **bars)


def marker_derivatives(
    response: Response,
    body: str,
    marker: str,
    *,
    position: Array | None = None,
    velocity: Array | None = None,
    acceleration: Array | None = None,
) -> Derivatives:
    """The derivatives of a number that depends on the motion of a marker, for users' objectives.

    They are by the trajectory and by the shape functions of the body at the marker, which change
    with its density, also at a fixed trajectory.

    Args:
        response: The argument of `Objective.derivatives`.
        body: Name of the body.
        marker: Name of the marker.
        position: Derivatives of the number by `Trajectory.marker_path`, shape (steps + 1, 2), in
            space (steps + 1, 3); None if it does not depend on it.
        velocity: Likewise by `Trajectory.marker_velocity`.
        acceleration: Likewise by `Trajectory.marker_acceleration`.
    """
    trajectory = response.trajectory
    moved_marker, state, motion = _moved(response, body, marker)
    d = trajectory.model.dimension

    def in_space(name: str, bar: Array | None) -> Array:
        padded = np.zeros_like(motion.position)
        if bar is not None:
            label = f"marker derivatives: by the {name}"
            padded[:, :d] = validation.real_array(label, bar, (len(trajectory.t), d))
        return padded

    by_place, by_velocity = in_space("position", position), in_space("velocity", velocity)
    bars = by_place, by_velocity, in_space("acceleration", acceleration)
    pulled = marker_motion_pullback(IN_SPACE, moved_marker, state, motion, bars)
    columns_of_body = trajectory.model.coordinates(body).all
    columns = (
        slice(None) if d == 3 else columns_in_space(columns_of_body.stop - columns_of_body.start)
    )
    total = TrajectoryBar.zeros(trajectory)
    for out, by_state in ((total.y, pulled.y), (total.v, pulled.v), (total.w, pulled.w)):
        out[:, columns_of_body] = by_state[:, columns]
    integrals = {
        name: body_integrals.zeros_like() for name, body_integrals in response.bodies.items()
    }
    markers = integrals[body].markers
    zero = markers[marker]
    markers[marker] = replace(
        zero,
        position=pulled.position[:d],
        displacement=pulled.displacement[:d],
        stiffening=None if zero.stiffening is None else pulled.stiffening[:d],
    )
    return Derivatives(total, integrals)


def _moved(response: Response, body: str, marker: str) -> tuple[BodyMarker, State, MarkerMotion]:
    """A marker, the state of its body and its motion, as if in space."""
    trajectory, bodies = response.trajectory, response.bodies
    if body not in bodies:
        raise no_body("motion of a marker", body, bodies)
    if marker not in bodies[body].markers:
        raise ValueError(
            f"body {body!r} has no marker {marker!r}; its markers are {list(bodies[body].markers)}"
        )
    columns = trajectory.model.coordinates(body).all
    states = (array[:, columns] for array in (trajectory.y, trajectory.v, trajectory.w))
    return motion_of_marker(bodies[body].markers[marker], *states)


@dataclass(frozen=True, eq=False)
class PathTracking(_IntegralOfSquare):
    """Integral over time of the squared distance of a marker from a prescribed path [m^2 s].

        psi = int weight(t) |r_P(t) - path(t)|^2 dt

    over the instants of the trajectory. With a window only a part of the motion counts,
    for instance its end, where a robot must come to rest.

    Attributes:
        body: Name of the body.
        marker: Name of the marker.
        path: Pair (x, y), in space (x, y, z), of motions, functions of an array of times, numbers,
            or arrays of shape (steps + 1,) if not all are; or an array of the positions at the
            instants of the trajectory, shape (steps + 1, 2), in space (steps + 1, 3) [m].
        window: Begin and end of the time that counts [s]; None takes the whole motion.
        weight: Weight over time: function of an array of times, or array of shape (steps + 1,);
            None is 1.
    """

    unit: ClassVar[str] = "m^2 s"
    _what: ClassVar[str] = "path tracking"
    _vector: ClassVar[str] = "position"

    path: tuple[Coordinate, ...] | Array
    window: tuple[float, float] | None = None
    weight: Callable[[Array], ArrayLike] | Array | None = None

    def __post_init__(self) -> None:
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

    def vectors(self, response: Response) -> Array:
        """Vectors from path to marker at a ``response``, shape (steps + 1, 2 or 3) [m]."""
        positions = super().vectors(response)
        return positions - self._target(response.trajectory.t, positions.shape[1])

    def _target(self, t: Array, d: int) -> Array:
        """The path at the time steps, shape (steps + 1, d) [m]."""
        if _is_pair_of_coordinates(self.path):
            if len(self.path) != d:
                count = len(self.path)
                raise ValueError(
                    f"path tracking: the path has {count} coordinates, but the marker has {d}"
                )
            columns = [
                _tabulated(f"path tracking: the path along {axis}", coordinate, t)
                for axis, coordinate in zip("xyz", self.path, strict=False)
            ]
            return np.column_stack(columns)
        array = np.asarray(self.path, dtype=np.float64)
        return _checked("path tracking: the path", array, (t.size, d))

    def _weights(self, trajectory: Trajectory) -> Array:
        weights = time_weights(trajectory, self.window, "path tracking")
        if self.weight is None:
            return weights
        importance = _tabulated("path tracking: the weight", self.weight, trajectory.t)
        if np.any(importance < 0.0):
            instant = trajectory.t[np.argmax(importance < 0.0)]
            raise ValueError(
                f"path tracking: the weight is negative, first at t = {instant:.4g} s, where psi "
                "would fall as the marker leaves its path; give weights that are not negative"
            )
        return weights * importance


@dataclass(frozen=True)
class _IntegralOverWindow(_IntegralOfSquare):
    """Integral over time of the square of a vector, all instants of a window alike."""

    #: Begin and end of the time that counts [s]; None takes the whole motion.
    window: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        self._check_names()
        check_window(self._what, self.window)

    def _weights(self, trajectory: Trajectory) -> Array:
        return time_weights(trajectory, self.window, self._what)


@dataclass(frozen=True)
class MarkerVelocity(_IntegralOverWindow):
    """Integral over time of the squared velocity of a marker [m^2/s].

        psi = int |v_P|^2 dt

    over the instants of the trajectory: with a window at its end, the rest of a motion from rest to
    rest, or the speed with which a tool arrives.

    Attributes:
        body: Name of the body.
        marker: Name of the marker.
        window: Begin and end of the time that counts [s]; None takes the whole motion.
    """

    unit: ClassVar[str] = "m^2/s"
    _what: ClassVar[str] = "marker velocity"
    _vector: ClassVar[str] = "velocity"


@dataclass(frozen=True)
class MarkerAcceleration(_IntegralOverWindow):
    """Integral over time of the squared acceleration of a marker [m^2/s^3].

        psi = int |a_P|^2 dt

    over the instants of the trajectory: how hard a payload or a passenger is shaken. The root of
    psi over the duration is the root mean square of the acceleration. If the mechanism gives the
    ground an acceleration, the acceleration of the marker is relative to the ground.

    Attributes:
        body: Name of the body.
        marker: Name of the marker.
        window: Begin and end of the time that counts [s]; None takes the whole motion.
    """

    unit: ClassVar[str] = "m^2/s^3"
    _what: ClassVar[str] = "marker acceleration"
    _vector: ClassVar[str] = "acceleration"


@dataclass(frozen=True)
class ResidualVibration(_IntegralOverWindow):
    """Mean square of the vibration of a marker after a stop, over a window [m^2].

        psi = 1/T int |r_P - r_0|^2 + tau^2 |v_P|^2 dt,    r_0 the mean of r_P over the window

    or r_0 the given place of the stop: then psi is the error at the end of a cycle. With
    tau = 1 / omega a vibration with the frequency omega counts the same by place and by velocity,
    so that psi hardly depends on where the window cuts it.

    Attributes:
        body: Name of the body.
        marker: Name of the marker.
        window: Begin and end of the time that counts [s]; None takes the whole motion.
        tau: Time by which velocities are multiplied [s].
        place: Where the marker is to stop, (x, y), in space (x, y, z) [m]; None takes the mean.
    """

    unit: ClassVar[str] = "m^2"
    _what: ClassVar[str] = "residual vibration"
    _vector: ClassVar[str] = "position"

    tau: float = 0.0
    place: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        validation.number("residual vibration: tau", self.tau, least=0.0, unit="s")

    def _weights(self, trajectory: Trajectory) -> Array:
        weights = super()._weights(trajectory)
        return weights / np.sum(weights)

    def vectors(self, response: Response) -> Array:
        """Vectors from the place of the stop to the marker at a ``response``, [m]."""
        positions = super().vectors(response)
        if self.place is None:
            return positions - self._weights(response.trajectory) @ positions
        label = "residual vibration: the place"
        return positions - validation.real_array(label, self.place, (positions.shape[1],))

    def _velocities(self, response: Response) -> Array:
        velocities: Array = self._motion(response).velocity
        return velocities[:, : response.trajectory.model.dimension]

    def evaluate(self, response: Response) -> float:
        weights = self._weights(response.trajectory)
        squares = np.sum(self._velocities(response) ** 2, axis=1)
        return super().evaluate(response) + self.tau**2 * float(weights @ squares)

    def derivatives(self, response: Response) -> Derivatives:
        # the weighted sum of the vectors from their mean is zero, so its share vanishes
        w = 2.0 * self._weights(response.trajectory)[:, None]
        velocity = self.tau**2 * w * self._velocities(response)
        return self._pullback(response, position=w * self.vectors(response), velocity=velocity)


def _is_pair_of_coordinates(path: object) -> bool:
    """Whether a path is given by its coordinates over time, not by an array of positions."""
    return isinstance(path, tuple | list) and any(
        isinstance(coordinate, Motion | Real) or callable(coordinate) for coordinate in path
    )


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
