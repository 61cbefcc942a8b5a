# SPDX-License-Identifier: MIT
"""A point of a body where joints, forces or point masses attach."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from ..documentation import Shown

#: Rotation by a quarter turn, the matrix J of the equations of motion.
QUARTER_TURN: Array = np.array([[0.0, -1.0], [1.0, 0.0]])

#: Loads of a body's own inertia, and the shape of their fields, by dimension
LOADS: dict[int, dict[str, tuple[int, ...]]] = {
    2: {"omega2": (), "alpha": (), "acceleration": (2,)},
    3: {"rotation": (3, 3), "acceleration": (3,)},
}

#: Relative difference of entries that ought to be the same, above which a matrix is refused.
ASYMMETRY = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class BodyMarker(Shown):
    """A point of a body where joints, forces or point masses attach.

    The same class holds derivatives: then ``position``, ``displacement`` and ``rotation`` are the
    derivatives of a number with respect to the place and the entries of the shape functions there.

    Attributes:
        position: Undeformed position in the body's frame, shape (2,), in space (3,) [m].
        displacement: Shape functions of the elastic displacement at the point (Phi_P), shape (2,
            modes), in space (3, modes).
        rotation: Shape functions of the elastic rotation at the point (Psi_P), shape (modes,), in
            space about the body's axes, shape (3, modes) [rad/m].
        stiffening: Geometric stiffness T_P of the body by a unit force at the point along each of
            the body's axes, each symmetric, shape (2 or 3, modes, modes) [1/m]; None if that is not
            modelled. With it the displacement of the point is Phi_P q - 1/2 (q . T_Px q, q . T_Py
            q): a bent beam's end comes nearer. The work of a force F is then F . (Phi_P - T_P q)
            dq: it stiffens the body.
        axes: Axes of the point in space as columns in the body's frame, shape (3, 3), in which axes
            of joints and directions of forces are given; None are the axes of the body.
    """

    position: Array
    displacement: Array
    rotation: Array
    stiffening: Array | None = None
    axes: Array | None = None

    def __post_init__(self) -> None:
        for name, given in list(vars(self).items()):
            if given is not None or name not in ("stiffening", "axes"):
                object.__setattr__(self, name, as_array(given))
        if self.axes is not None and self.axes.shape == (3, 3):
            object.__setattr__(self, "axes", validation.nearest_rotation(self.axes))

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.position.size)

    @property
    def planar(self) -> bool:
        """Whether it is a marker of a body in the plane."""
        return self.dimension == 2

    @staticmethod
    def of_rigid_body(position: ArrayLike, axes: ArrayLike | None = None) -> BodyMarker:
        """A point of a body without shape functions, from its ``position`` and ``axes``."""
        place = as_array(position)
        no_shapes = np.zeros((place.size, 0))
        return BodyMarker(
            position=place,
            displacement=no_shapes,
            rotation=no_shapes if place.size == 3 else np.zeros(0),
            axes=None if axes is None else as_array(axes),
        )

    @property
    def basis(self) -> Array:
        """Reference position and shape functions side by side, shape (2 or 3, modes + 1)."""
        return np.column_stack([self.position, self.displacement])

    def shift(self, q: Array) -> Array:
        """Elastic displacement in the body's axes at ``q`` (..., modes), (..., 2 or 3) [m]."""
        linear = q @ self.displacement.T
        if self.stiffening is None:
            return linear
        return linear - 0.5 * np.einsum("...j,djk,...k->...d", q, self.stiffening, q)

    def shapes_at(self, q: Array) -> Array:
        """Derivative of :meth:`shift` with respect to ``q``, shape (..., 2 or 3, modes) [-]."""
        if self.stiffening is None:
            return np.broadcast_to(self.displacement, (*q.shape[:-1], *self.displacement.shape))
        return self.displacement - np.einsum("djk,...k->...dj", self.stiffening, q)

    def leading(self, modes: int) -> BodyMarker:
        """The marker with the first ``modes`` shape functions only."""
        stiffening = None if self.stiffening is None else self.stiffening[:, :modes, :modes]
        shapes = self.displacement[:, :modes], self.rotation[..., :modes]
        return BodyMarker(self.position, *shapes, stiffening, self.axes)

    def scaled(self, factor: float) -> BodyMarker:
        """All entries times a ``factor``, but for the axes."""
        stiffening = None if self.stiffening is None else factor * self.stiffening
        shapes = factor * self.displacement, factor * self.rotation
        return BodyMarker(factor * self.position, *shapes, stiffening, self.axes)

    def __add__(self, other: BodyMarker) -> BodyMarker:
        """Sum entry by entry; missing stiffness is zero, axes are those of the first with any."""
        parts = [m.stiffening for m in (self, other) if m.stiffening is not None]
        return BodyMarker(
            self.position + other.position,
            self.displacement + other.displacement,
            self.rotation + other.rotation,
            np.sum(parts, axis=0) if parts else None,
            other.axes if self.axes is None else self.axes,
        )

    def dot(self, other: BodyMarker) -> float:
        """Inner product over all entries with the ``other`` point, which has as many modes."""
        total = float(self.position @ other.position + np.sum(self.rotation * other.rotation))
        total += float(np.sum(self.displacement * other.displacement))
        if self.stiffening is not None and other.stiffening is not None:
            total += float(np.sum(self.stiffening * other.stiffening))
        return total


def as_array(values: ArrayLike) -> Array:
    """Numbers as a contiguous array."""
    return np.ascontiguousarray(validation.numbers("integrals of a body", values))


def largest_share(entries: Array, diagonal: Array) -> float:
    """Largest entry of matrices (..., n, n) over sqrt(d_i d_j) of a diagonal, where not zero."""
    root = np.sqrt(np.maximum(diagonal, 0.0))
    sizes = np.broadcast_to(np.outer(root, root), entries.shape)
    shares = np.divide(np.abs(entries), sizes, out=np.zeros(entries.shape), where=sizes > 0.0)
    return float(np.max(shares, initial=0.0))


def check_stiffening(what: str, array: Array, shape: tuple[int, ...], G: Array) -> None:
    """Refuse geometric stiffness (..., modes, modes) that is not symmetric relative to G."""
    validation.real_array(what, array, shape)
    inertia = np.diag(G)[1:]
    defect = largest_share(array - np.swapaxes(array, -1, -2), inertia)
    size = largest_share(array, inertia)
    if defect > ASYMMETRY * size:
        raise ValueError(
            f"{what} must be symmetric, but entries differ by {defect / size:.1e} of the largest"
        )


def check_body_marker(where: str, point: BodyMarker, d: int, r: int, G: Array) -> None:
    """Refuse a marker that does not fit a body of ``d`` dimensions and ``r`` shape functions."""
    validation.real_array(f"{where}: position", point.position, (d,))
    validation.real_array(f"{where}: displacement", point.displacement, (d, r))
    validation.real_array(f"{where}: rotation", point.rotation, (r,) if d == 2 else (d, r))
    if point.stiffening is not None:
        check_stiffening(f"{where}: stiffening", point.stiffening, (d, r, r), G)
    if point.axes is not None:
        if d == 2:
            raise ValueError(f"{where}: markers of bodies in the plane have no axes of their own")
        validation.rotation(f"{where}: axes", point.axes)


def check_loads(name: str, stiffening: Mapping[str, Array], d: int, r: int, G: Array) -> None:
    """Refuse geometric stiffness by unknown loads, of a wrong shape, or not symmetric."""
    for load, array in stiffening.items():
        what = f"body {name!r}: stiffening by {load!r}"
        if load not in LOADS[d]:
            raise ValueError(f"{what} is not supported; give some of the loads {list(LOADS[d])}")
        check_stiffening(what, array, (*LOADS[d][load], r, r), G)


def inertia_of_point(position: Array, mass: float) -> dict[str, Array]:
    """Inertia force of a point mass in the body's axes by unit load, shape (*load, *force)."""
    unit = np.eye(position.size)
    inertia = {"acceleration": -mass * unit}
    if position.size == 3:
        return inertia | {"rotation": -mass * np.einsum("l,ki->kli", position, unit)}
    return inertia | {"omega2": mass * position, "alpha": -mass * (QUARTER_TURN @ position)}
