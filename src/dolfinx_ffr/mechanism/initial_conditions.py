# SPDX-License-Identifier: MIT
"""Initial conditions: placements, and how the start is found from them.

The joints always close at the start: positions satisfy C(y, 0) = 0 and velocities dC/dt = 0, and
the accelerations follow from the equations of motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from .marker import Pair, Triple, check_position
from .rotation import (
    RotationLike,
    ask_for_radians,
    checked_rotation,
    rotation_matrix,
    rotation_vector,
)


@dataclass(frozen=True)
class Placement:
    """The approximate position and velocity of a body at the start.

    They are corrected so that the joints close, by the smallest change of position and angle, and
    of their velocities. In space the position has three components, and a rotation takes the place
    of the angle.

    Attributes:
        position: Position of the origin of the body's frame, of three components in space [m].
        angle: Angle of the body's frame in the plane [rad].
        velocity: Velocity of the origin of the body's frame, likewise [m/s].
        angular_velocity: Angular velocity, in space of three components along the global axes
            [rad/s].
        rotation: Rotation of the body's frame in space: a vector along its axis as long as the
            angle [rad], a matrix whose columns are the axes of the frame, or a rotation of SciPy;
            None is none. For torsional springs about its axis a vector is an unwrapped angle; a
            matrix has no full turns.
    """

    position: Pair | Triple = (0.0, 0.0)
    angle: float = 0.0
    velocity: Pair | Triple = (0.0, 0.0)
    angular_velocity: float | Triple = 0.0
    rotation: RotationLike | None = None

    def validate(self, what: str) -> None:
        """Refuse, by the name ``what``, anything but finite numbers of the right count.

        An angle of more than a full turn, as degrees are, brings a PlacementWarning.
        """
        spatial = self._spatial
        for vector in ("position", "velocity"):
            check_position(f"{what}: {vector}", getattr(self, vector), spatial)
        ask_for_radians(f"{what}: angle", validation.number(f"{what}: angle", self.angle))
        spin = self.angular_velocity
        if np.ndim(spin) == 0:
            validation.number(f"{what}: angular_velocity", spin)
        else:
            needed = "three components, those along the global axes in space"
            spin_label = f"{what}: angular_velocity"
            validation.real_array(spin_label, spin, (3,), expected=needed)
        if self.rotation is not None:
            checked_rotation(f"{what}: rotation", self.rotation)
        if spatial and self.angle != 0.0:
            raise ValueError(f"{what}: in space give a rotation instead of an angle")
        if spatial and np.ndim(spin) == 0 and spin != 0.0:
            raise ValueError(f"{what}: in space angular_velocity must have three components")

    @property
    def dimension(self) -> int | None:
        """2 in the plane, 3 in space; None where all is zero, which fits both."""
        if self._spatial:
            return 3
        numbers = (*self.position, *self.velocity, self.angle, self.angular_velocity)
        return 2 if any(numbers) else None

    @property
    def _spatial(self) -> bool:
        """Whether something is given that only a placement in space has."""
        vectors = (self.position, self.velocity, self.angular_velocity)
        return self.rotation is not None or any(np.shape(vector) == (3,) for vector in vectors)

    @property
    def in_space(self) -> tuple[Array, Array, Array, Array]:
        """Position [m], rotation vector [rad], velocity [m/s] and angular velocity [rad/s].

        Of shape (3,) each, the angular velocity along the axes of the body's frame.
        """
        position, velocity, spin = np.zeros(3), np.zeros(3), np.zeros(3)
        position[: len(self.position)] = self.position
        velocity[: len(self.velocity)] = self.velocity
        rotation = np.zeros(3) if self.rotation is None else rotation_vector(self.rotation)
        if np.ndim(self.angular_velocity):
            spin[:] = rotation_matrix(rotation).T @ np.asarray(self.angular_velocity)
        return position, rotation, velocity, spin


class Start:
    """How the motion begins."""

    #: Whether the static equilibrium is sought, which may be far from the placements
    in_equilibrium: ClassVar[bool] = False

    def validate(self, modes: Mapping[str, int]) -> None:
        """Raise a ValueError for values that do not fit the ``modes`` of the bodies, by name."""

    def elastic_state(self, body: str, modes: int) -> tuple[Array, Array]:
        """Elastic coordinates of a body at the start and their velocities, shape (modes,) each."""
        return np.zeros(modes), np.zeros(modes)

    def resized(self, modes: Mapping[str, int]) -> Start:
        """The same start for bodies with other numbers of ``modes``; the first modes agree."""
        return self


@dataclass(frozen=True)
class Assembled(Start):
    """The placements, corrected so that the joints close, with bodies undeformed or as given.

    The corrections of position and angle, and of their velocities, are the smallest ones. First
    the undeformed bodies are corrected, then the deformed ones.

    Attributes:
        elastic: Elastic coordinates at the start, shape (modes,), by name of the body; zero where
            not given.
        elastic_velocity: Their rates of change per second, shape (modes,), by name of the body;
            zero where not given.
    """

    elastic: Mapping[str, ArrayLike] = field(default_factory=dict)
    elastic_velocity: Mapping[str, ArrayLike] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for quantity in ("elastic", "elastic_velocity"):
            by_body = validation.by_name(f"start: {quantity}", getattr(self, quantity), "arrays")
            for name, values in by_body.items():
                validation.real_array(f"start: {quantity} of body {name!r}", values)

    def validate(self, modes: Mapping[str, int]) -> None:
        for quantity in ("elastic", "elastic_velocity"):
            for name, values in getattr(self, quantity).items():
                if name not in modes:
                    raise ValueError(
                        f"start: {quantity} of {name!r}, but the bodies are {list(modes)}"
                    )
                if np.shape(values) != (modes[name],):
                    raise ValueError(
                        f"start: {quantity} of body {name!r} must have shape {(modes[name],)}, "
                        f"but it has shape {np.shape(values)}"
                    )

    def elastic_state(self, body: str, modes: int) -> tuple[Array, Array]:
        zeros = np.zeros(modes)
        values = (self.elastic.get(body, zeros), self.elastic_velocity.get(body, zeros))
        elastic, velocity = (np.array(array, dtype=np.float64) for array in values)
        return elastic, velocity

    def resized(self, modes: Mapping[str, int]) -> Assembled:
        def sized(by_body: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
            arrays = {name: np.asarray(array, dtype=np.float64) for name, array in by_body.items()}
            return {
                name: np.append(array[: modes[name]], np.zeros(max(0, modes[name] - array.size)))
                for name, array in arrays.items()
            }

        return Assembled(sized(self.elastic), sized(self.elastic_velocity))


@dataclass(frozen=True)
class StaticEquilibrium(Start):
    """The static equilibrium of the deformed bodies under gravity and the forces at t = 0.

    It satisfies r(y, 0, 0) + C_y^T lambda = 0 and C(y, 0) = 0, without dampers and inertia. The
    search goes downhill from the placements, so that a pendulum comes to hang. The velocities are
    those of the placements, corrected so that the joints close; the elastic coordinates start at
    rest. The gradient contains its dependence on the bodies.
    """

    in_equilibrium: ClassVar[bool] = True
