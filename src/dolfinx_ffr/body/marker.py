# SPDX-License-Identifier: MIT
"""A point of a body where joints, forces or point masses attach."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation

__all__ = [
    "ASYMMETRY",
    "QUARTER_TURN",
    "BodyMarker",
    "as_array",
    "check_body_marker",
    "check_loads",
    "check_stiffening",
    "inertia_of_point",
    "largest_share",
    "rigid_marker",
    "stacked_loads",
]

Array = NDArray[np.float64]

#: Rotation by a quarter turn, the matrix J of the equations of motion.
QUARTER_TURN: Array = np.array([[0.0, -1.0], [1.0, 0.0]])

#: Relative difference of entries that ought to be the same, above which a matrix is refused.
ASYMMETRY = 1e-9


@dataclass(frozen=True, eq=False)
class BodyMarker:
    """A point of a body where joints, forces or point masses attach.

    The same class holds derivatives: then ``displacement`` and ``rotation`` are the derivatives of
    a number with respect to the entries of the shape functions, and ``position``, which is data and
    never depends on the design, is zero.
    """

    #: Undeformed position in the body's frame, shape (2,), in space (3,) [m].
    position: Array
    #: Shape functions of the elastic displacement at the point (Phi_P), shape (2, modes), in space
    #: (3, modes).
    displacement: Array
    #: Shape functions of the elastic rotation at the point (Psi_P), shape (modes,), in space about
    #: the body's axes, shape (3, modes) [rad/m].
    rotation: Array
    #: Geometric stiffness T_P of the body by a unit force at the point along each of the body's
    #: axes, each symmetric, shape (2 or 3, modes, modes) [1/m]; None if that is not modelled. With
    #: it the displacement of the point is Phi_P q - 1/2 (q . T_Px q, q . T_Py q): a bent beam's end
    #: comes nearer. The work of a force F is then F . (Phi_P - T_P q) dq: it stiffens the body.
    stiffening: Array | None = None
    #: Axes of the point in space as columns in the body's frame, shape (3, 3), in which axes of
    #: joints and directions of forces are given; None are those of the body.
    axes: Array | None = None

    def __post_init__(self) -> None:
        """Turn lists and other numbers into arrays."""
        for name in ("position", "displacement", "rotation"):
            object.__setattr__(self, name, as_array(getattr(self, name)))
        for name in ("stiffening", "axes"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, as_array(getattr(self, name)))

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.position.size)

    @staticmethod
    def of_rigid_body(position: ArrayLike, axes: ArrayLike | None = None) -> BodyMarker:
        """A point of a body without shape functions.

        Args:
            position: Position in the body's frame, shape (2,) or (3,) [m].
            axes: Its axes in space as columns, shape (3, 3); None are those of the body.
        """
        where = as_array(position)
        none = np.zeros((where.size, 0))
        own = None if axes is None else as_array(axes)
        return BodyMarker(where, none, none if where.size == 3 else np.zeros(0), None, own)

    @property
    def basis(self) -> Array:
        """Reference position and shape functions side by side, shape (2 or 3, modes + 1)."""
        return np.column_stack([self.position, self.displacement])

    def shift(self, q: Array) -> Array:
        """Elastic displacement in the body's axes, shape (..., 2 or 3) [m].

        Args:
            q: Elastic coordinates, shape (..., modes).
        """
        linear = q @ self.displacement.T
        if self.stiffening is None:
            return linear
        return linear - 0.5 * np.einsum("...j,djk,...k->...d", q, self.stiffening, q)

    def shapes_at(self, q: Array) -> Array:
        """Derivative of :meth:`shift` with respect to q, shape (..., 2 or 3, modes) [-].

        Args:
            q: Elastic coordinates, shape (..., modes).
        """
        if self.stiffening is None:
            return np.broadcast_to(self.displacement, (*q.shape[:-1], *self.displacement.shape))
        return self.displacement - np.einsum("djk,...k->...dj", self.stiffening, q)

    def leading(self, modes: int) -> BodyMarker:
        """The same point with the first shape functions alone.

        Args:
            modes: Number of shape functions that are kept.
        """
        stiffening = None if self.stiffening is None else self.stiffening[:, :modes, :modes]
        shapes = self.displacement[:, :modes], self.rotation[..., :modes]
        return BodyMarker(self.position, *shapes, stiffening, self.axes)

    def scaled(self, factor: float) -> BodyMarker:
        """All entries times a factor, but for the axes.

        Args:
            factor: The factor.
        """
        stiffening = None if self.stiffening is None else factor * self.stiffening
        shapes = factor * self.displacement, factor * self.rotation
        return BodyMarker(factor * self.position, *shapes, stiffening, self.axes)

    def __add__(self, other: BodyMarker) -> BodyMarker:
        """Sum entry by entry; geometric stiffness that one of the two lacks counts as zero.

        The axes are those of the first, or of the other if it has none.
        """
        parts = [m.stiffening for m in (self, other) if m.stiffening is not None]
        return BodyMarker(
            self.position + other.position,
            self.displacement + other.displacement,
            self.rotation + other.rotation,
            np.sum(parts, axis=0) if parts else None,
            other.axes if self.axes is None else self.axes,
        )

    def dot(self, other: BodyMarker) -> float:
        """Inner product over all entries.

        Args:
            other: A point with as many shape functions.
        """
        total = float(self.position @ other.position + np.sum(self.rotation * other.rotation))
        total += float(np.sum(self.displacement * other.displacement))
        if self.stiffening is not None and other.stiffening is not None:
            total += float(np.sum(self.stiffening * other.stiffening))
        return total


def rigid_marker(what: str, given: ArrayLike | BodyMarker, d: int) -> BodyMarker:
    """A marker of a rigid body from its position, or as it is.

    Args:
        what: Name of the marker, for the message.
        given: Position in the body's frame [m], or the marker.
        d: 2 in the plane, 3 in space.

    Raises:
        TypeError: If it holds something else than numbers.
        ValueError: If the position has not d components, or one is not finite.
    """
    if isinstance(given, BodyMarker):
        return given
    return BodyMarker.of_rigid_body(validation.real_array(what, given, (d,)))


def as_array(values: ArrayLike) -> Array:
    """Numbers as a contiguous array.

    Args:
        values: The numbers.
    """
    return np.ascontiguousarray(validation.numbers("integrals of a body", values))


def largest_share(entries: Array, diagonal: Array) -> float:
    """Largest entry of a matrix relative to the diagonal ones of its row and column.

    So entries with different units are compared, and no unit hides a slip.

    Args:
        entries: The entries, shape (..., n, n).
        diagonal: Sizes of the rows and columns squared, shape (n,); entries at zeros do not count.
    """
    root = np.sqrt(np.maximum(diagonal, 0.0))
    sizes = np.broadcast_to(np.outer(root, root), entries.shape)
    shares = np.divide(np.abs(entries), sizes, out=np.zeros(entries.shape), where=sizes > 0.0)
    return float(np.max(shares, initial=0.0))


def check_stiffening(what: str, array: Array, shape: tuple[int, ...], G: Array) -> None:
    """Refuse geometric stiffness that is not symmetric.

    Args:
        what: Its name, for the message.
        array: The geometric stiffness, shape (..., modes, modes).
        shape: The shape that it must have.
        G: The body's integral G, whose diagonal makes unlike entries comparable.

    Raises:
        ValueError: If it is not of that shape, not finite or not symmetric.
    """
    validation.real_array(what, array, shape)
    inertia = np.diag(G)[1:]
    defect = largest_share(array - np.swapaxes(array, -1, -2), inertia)
    size = largest_share(array, inertia)
    if defect > ASYMMETRY * size:
        raise ValueError(
            f"{what} must be symmetric, but entries differ by {defect / size:.1e} of the largest"
        )


def check_body_marker(where: str, point: BodyMarker, d: int, r: int, G: Array) -> None:
    """Refuse a marker that does not fit its body.

    Args:
        where: Body and marker, for the message.
        point: The marker.
        d: 2 in the plane, 3 in space.
        r: Number of shape functions of the body.
        G: The body's integral G.

    Raises:
        ValueError: If an array has the wrong shape, is not finite or lacks its symmetry.
    """
    validation.real_array(f"{where}: position", point.position, (d,))
    validation.real_array(f"{where}: displacement", point.displacement, (d, r))
    validation.real_array(f"{where}: rotation", point.rotation, (r,) if d == 2 else (d, r))
    if point.stiffening is not None:
        check_stiffening(f"{where}: stiffening", point.stiffening, (d, r, r), G)
    if point.axes is not None:
        if d == 2:
            raise ValueError(f"{where}: markers of bodies in the plane have no axes of their own")
        A = validation.real_array(f"{where}: axes", point.axes, (3, 3))
        if np.max(np.abs(A.T @ A - np.eye(3))) > ASYMMETRY or np.linalg.det(A) < 0.0:
            raise ValueError(
                f"{where}: the axes must be perpendicular unit vectors in a right-handed order, "
                f"but they are {A.T.tolist()}"
            )


def check_loads(name: str, stiffening: Mapping[str, Array], d: int, r: int, G: Array) -> None:
    """Refuse geometric stiffness by loads that do not exist, or that is not symmetric.

    Args:
        name: Name of the body, for the message.
        stiffening: Geometric stiffness by load.
        d: 2 in the plane, 3 in space.
        r: Number of shape functions of the body.
        G: The body's integral G.

    Raises:
        ValueError: If a load or a shape is another one, or an array is not symmetric.
    """
    shapes: dict[str, tuple[int, ...]]
    shapes = {"omega2": (r, r), "alpha": (r, r), "acceleration": (2, r, r)}
    if d == 3:
        shapes = {"rotation": (3, 3, r, r), "acceleration": (3, r, r)}
    for load, array in stiffening.items():
        if load not in shapes:
            raise ValueError(
                f"body {name!r}: stiffening by {load!r}, but the loads are {list(shapes)}"
            )
        check_stiffening(f"body {name!r}: stiffening by {load!r}", array, shapes[load], G)


def inertia_of_point(position: Array, mass: float) -> dict[str, Array]:
    """Inertia force of a point mass in the body's axes, by load of the body.

    Args:
        position: Of the point in the body's frame, shape (2,) or (3,) [m].
        mass: Its mass [kg].

    Returns:
        Arrays whose first axes are those of the load, the last that of the force.
    """
    if position.size == 3:
        unit = np.eye(3)
        rotation = -mass * np.einsum("l,ki->kli", position, unit)
        return {"rotation": rotation, "acceleration": -mass * unit}
    return {
        "omega2": mass * position,
        "alpha": -mass * (QUARTER_TURN @ position),
        "acceleration": -mass * np.eye(2),
    }


def stacked_loads(stiffening: Mapping[str, Array], d: int, r: int) -> Array:
    """Geometric stiffness of all loads one after the other, zero where there is none.

    Args:
        stiffening: Geometric stiffness by load.
        d: 2 in the plane, 3 in space.
        r: Number of shape functions of the body.

    Returns:
        By omega^2, alpha and the acceleration, shape (4, r, r); in space by the loads of the
        rotation and by the acceleration, shape (12, r, r).
    """
    shapes = {"omega2": (1, r, r), "alpha": (1, r, r), "acceleration": (2, r, r)}
    if d == 3:
        shapes = {"rotation": (9, r, r), "acceleration": (3, r, r)}
    none = np.zeros((9, r, r))
    parts = [stiffening.get(load, none[: n[0]]).reshape(n) for load, n in shapes.items()]
    return np.concatenate(parts)
