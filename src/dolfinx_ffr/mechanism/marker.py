# SPDX-License-Identifier: MIT
"""Markers, which joints and forces connect.

A :data:`Marker` is a name, not a shape function. It is one of

* a point of a body, :data:`BodyPoint`, written ``("rod", "left")``: name of the body, name of one
  of its markers;
* a point of the ground, :class:`Ground`;
* a point that moves as prescribed, :class:`Moving`: a crank of given motion is such a marker, not
  a body.

The name ``"left"`` stands for a :class:`BodyMarker`, the position and the shape functions of the
reduced body at that point. The reduction makes it from an :class:`Interface`, boundary facets that
move as one rigid body, or from a ``PointMarker``, a point of the mesh that deforms with the body.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from .motion import Motion, tabulated
from .rotation import (
    RotationLike,
    ask_for_radians,
    checked_rotation,
    rotation_matrix,
    upright_matrix,
)

Pair = tuple[float, float]
Triple = tuple[float, float, float]

#: Name of a body and name of one of its markers.
BodyPoint = tuple[str, str]


@dataclass(frozen=True)
class Ground:
    """A marker fixed to the ground.

    ``Ground()`` is the origin with the global axes, in the plane and in space.

    Attributes:
        position: Two components in the plane, three in space [m].
        angle: Angle of the marker's axes in the plane [rad].
        name: Name for messages.
        rotation: Rotation of the marker's axes in space: a vector along its axis as long as the
            angle [rad], a matrix whose columns are the axes, or a rotation of SciPy; None is none.
    """

    position: Pair | Triple = (0.0, 0.0)
    angle: float = 0.0
    name: str = "ground"
    rotation: RotationLike | None = None

    def __post_init__(self) -> None:
        check_position("ground: position", self.position, self.rotation is not None)
        ask_for_radians("ground: angle", validation.number("ground: angle", self.angle))
        validation.name("ground: name", self.name)
        # In tuples, so that markers can be compared.
        object.__setattr__(self, "position", tuple(float(x) for x in self.position))
        if self.rotation is not None:
            rotation = checked_rotation("ground: rotation", self.rotation)
            object.__setattr__(self, "rotation", rotation)
        if self.angle != 0.0 and self.dimension == 3:
            raise ValueError("ground: in space the axes turn by a rotation, not by an angle")

    @property
    def dimension(self) -> int | None:
        """2 in the plane, 3 in space; None for the origin with the global axes, which fits both."""
        if self.rotation is not None or len(self.position) == 3:
            return 3
        return 2 if any(self.position) or self.angle != 0.0 else None

    def tabulate_in_space(self, times: Array, where: str) -> Array:
        """Position and axes at times, see :meth:`Moving.tabulate_in_space` for ``where``."""
        table = np.zeros((times.size, 3, 4, 3))
        table[:, 0, 0, : len(self.position)] = self.position
        rotation = self.rotation
        A = upright_matrix(self.angle) if rotation is None else rotation_matrix(rotation)
        table[:, 0, 1:] = A.T
        return table

    def tabulate_in_plane(self, times: Array, where: str) -> Array:
        """Position and angle at times, see :meth:`Moving.tabulate_in_plane` for ``where``."""
        table = np.zeros((times.size, 3, 3))
        table[:, 0] = *self.position, self.angle
        return table

    def turns_in_space(self, times: Array, where: str) -> Array:
        """Zeros at times, see :meth:`Moving.turns_in_space` for ``where``."""
        return np.zeros((times.size, 3))


@dataclass(frozen=True)
class Moving:
    """A marker that moves as prescribed.

    Attributes:
        x: Motion of the position along x [m].
        y: Motion of the position along y [m].
        angle: Motion of the angle of the marker's axes [rad].
        name: Name for messages.
        z: Motion of the position along z [m]: the marker is one in space. None in the plane.
        axis: In space the axis, in the marker's own axes and of any length, about which they turn
            by the angle.
        rotation: In space the rotation of the marker's axes at the angle zero, see :class:`Ground`.
    """

    x: Motion
    y: Motion
    angle: Motion = field(default_factory=lambda: Motion.constant(0.0))
    name: str = "moving marker"
    z: Motion | None = None
    axis: Triple = (0.0, 0.0, 1.0)
    rotation: RotationLike | None = None

    def __post_init__(self) -> None:
        validation.name("moving marker: name", self.name)
        needed = "a Motion (Motion.constant(...) where it is held)"
        for coordinate in ("x", "y", "angle", *(["z"] if self.z is not None else [])):
            validation.instance(
                f"{self.name}: {coordinate}", getattr(self, coordinate), Motion, needed
            )
        axis_vector(f"{self.name}: axis", self.axis)
        if self.rotation is not None:
            rotation = checked_rotation(f"{self.name}: rotation", self.rotation)
            object.__setattr__(self, "rotation", rotation)
            if self.z is None:
                raise ValueError(f"{self.name}: a marker with a rotation is one in space; give z")

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return 2 if self.z is None else 3

    def tabulate_in_space(self, times: Array, where: str) -> Array:
        """Position [m] and the three axes at times, each with its two derivatives.

        The shape is (n, 3 derivatives, 4 vectors, 3); ``where`` names the marker's user in errors.
        """
        out = np.zeros((times.size, 3, 4, 3))
        for k, motion in enumerate((self.x, self.y, self.z)):
            if motion is not None:
                out[:, :, 0, k] = tabulated(motion, times, where).T

        # Rodrigues' formula, where N is the matrix of the cross product with the unit vector n
        angle, rate, acceleration = tabulated(self.angle, times, where)[:, :, None, None]
        n = np.array(self.axis) / np.linalg.norm(self.axis)
        N = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
        start = np.eye(3) if self.rotation is None else rotation_matrix(self.rotation)
        A = start @ (np.eye(3) + np.sin(angle) * N + (1.0 - np.cos(angle)) * N @ N)

        A_dot = A @ N * rate
        A_ddot = A @ N * acceleration + A @ N @ N * rate**2
        for k, derivative in enumerate((A, A_dot, A_ddot)):
            out[:, k, 1:] = derivative.transpose(0, 2, 1)  # the axes are the columns
        return out

    def tabulate_in_plane(self, times: Array, where: str) -> Array:
        """x, y [m] and the angle [rad] at times, each with its two derivatives.

        The shape is (n, 3 derivatives, 3); ``where`` names the marker's user in errors.
        """
        return np.stack([tabulated(motion, times, where).T for motion in self.motions], axis=2)

    def turns_in_space(self, times: Array, where: str) -> Array:
        """Unwrapped angle at times, along the axis in global axes, shape (n, 3) [rad].

        ``where`` names the marker's user in errors.
        """
        n = np.array(self.axis) / np.linalg.norm(self.axis)
        n = n if self.rotation is None else rotation_matrix(self.rotation) @ n
        return tabulated(self.angle, times, where)[0][:, None] * n

    @property
    def motions(self) -> tuple[Motion, ...]:
        """Motions of x, y and angle, in space also of z."""
        return (self.x, self.y, self.angle) + (() if self.z is None else (self.z,))

    def direction(self, components: Triple) -> list[Motion]:
        """The motions of x, y and z of a direction of given ``components`` in the marker's axes."""
        n, axis_unit = np.array(components), np.array(self.axis) / np.linalg.norm(self.axis)
        start = np.eye(3) if self.rotation is None else rotation_matrix(self.rotation)
        tangential = np.cross(axis_unit, n)
        radial = -np.cross(axis_unit, tangential)
        vectors = (start @ vector for vector in (n - radial, radial, tangential))
        return [
            self.angle.turning(*map(float, coefficients))
            for coefficients in zip(*vectors, strict=True)
        ]

    @staticmethod
    def circle(
        center: Pair | Triple,
        radius: float,
        angle: Motion,
        name: str = "crank pin",
        axis: Triple = (0.0, 0.0, 1.0),
    ) -> Moving:
        """The end of a prescribed crank: a point on a circle whose angle is given.

        Args:
            center: Centre of the circle, of three components in space [m].
            radius: Radius of the circle [m].
            angle: Motion of the angle from the x axis [rad]; the marker's axes turn with it. In
                space it counts from the direction that is x where the axis is z, y where it is x
                and z where it is y, and the marker's axes are those three at the angle zero: x
                points along the radius, z along the axis.
            name: Name for messages.
            axis: Axis of the circle in space, in the global axes and of any length.
        """
        length = validation.number(f"{name}: radius", radius)
        validation.instance(f"{name}: angle", angle, Motion, "a Motion")
        spatial, label = np.shape(center) == (3,), f"{name}: center"
        shape, expected = ((3,), "") if spatial else ((2,), "two components")
        middle = validation.real_array(label, center, shape, expected=expected)
        normal = axis_vector(f"{name}: axis", axis) if spatial else (0.0, 0.0, 1.0)
        e_1, e_2 = perpendicular(normal)
        paths = []
        for c, e, f in zip(middle, e_1, e_2, strict=False):
            paths.append(angle.turning(float(c), length * float(e), length * float(f)))
        if not spatial:
            return Moving(paths[0], paths[1], angle, name)
        axes = np.stack([e_1, e_2, np.cross(e_1, e_2)], axis=1)
        return Moving(paths[0], paths[1], angle, name, paths[2], rotation=axes)


Marker = BodyPoint | Ground | Moving


def check_marker(what: str, marker: object) -> None:
    """Raise a TypeError for an object that is no marker."""
    if isinstance(marker, Ground | Moving):
        return
    names = marker if isinstance(marker, tuple) else ()
    if len(names) != 2 or not all(isinstance(name, str) for name in names):
        raise TypeError(
            f'{what}: a marker must be ("body", "marker"), Ground(...) or Moving(...), but it is '
            f"{validation.described(marker)}"
        )


def marker_name(marker: Marker) -> str:
    """Name of a marker for messages."""
    return ".".join(marker) if isinstance(marker, tuple) else marker.name


def perpendicular(axis: ArrayLike) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed triad with an axis (3,), e_1 x e_2 = axis.

    Where the axis is z, e_1 is x; where it is x, y; where it is y, z.
    """
    return _triad(*np.asarray(axis, dtype=np.float64).tolist())


@lru_cache(maxsize=64)
def _triad(x: float, y: float, z: float) -> tuple[Array, Array]:
    """The two unit vectors of :func:`perpendicular`, read-only because they are cached."""
    n = np.array([x, y, z])
    n = n / np.linalg.norm(n)
    e_1 = np.eye(3)[(int(np.argmax(np.abs(n))) + 1) % 3]
    e_1 = e_1 - (e_1 @ n) * n
    e_1 /= np.linalg.norm(e_1)
    e_2 = np.cross(n, e_1)
    e_1.flags.writeable = e_2.flags.writeable = False
    return e_1, e_2


def axis_vector(what: str, axis: object) -> Triple:
    """Three numbers that are not all zero; anything else is a TypeError or ValueError."""
    x, y, z = validation.direction(what, axis, 3, expected="three components")
    return x, y, z


def check_position(what: str, position: object, spatial: bool) -> None:
    """Raise a ValueError for an object that is no position in the plane or in space.

    If ``spatial``, two components are refused unless they are zeros, the origin.
    """
    if np.shape(position) == (3,):  # type: ignore[arg-type]
        validation.real_array(what, position)
        return
    expected = "two components, in space three"
    x, y = validation.real_array(what, position, (2,), expected=expected)
    if spatial and (x or y):
        raise ValueError(f"{what} must have three components in space, but it has two")
