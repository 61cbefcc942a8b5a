# SPDX-License-Identifier: MIT
"""A point of a body where joints, forces or point masses attach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation

__all__ = [
    "ASYMMETRY",
    "BodyMarker",
    "as_array",
    "check_stiffening",
    "largest_share",
]

Array = NDArray[np.float64]

#: Relative difference of entries that ought to be the same, above which a matrix is refused.
ASYMMETRY = 1e-9


@dataclass(frozen=True, eq=False)
class BodyMarker:
    """A point of a body where joints, forces or point masses attach.

    The same class holds derivatives: then ``displacement`` and ``rotation`` are the derivatives of
    a number with respect to the entries of the shape functions, and ``position``, which is data and
    never depends on the design, is zero.
    """

    #: Undeformed position in the body's frame, shape (2,) [m].
    position: Array
    #: Shape functions of the elastic displacement at the point (Phi_P), shape (2, modes).
    displacement: Array
    #: Shape functions of the elastic rotation at the point (Psi_P), shape (modes,) [rad/m].
    rotation: Array
    #: Geometric stiffness T_P of the body by a unit force at the point along the body's axes x and
    #: y, each symmetric, shape (2, modes, modes) [1/m]; None if that is not modelled. With it the
    #: displacement of the point is Phi_P q - 1/2 (q . T_Px q, q . T_Py q): a bent beam's end comes
    #: nearer. The work of a force F is then F . (Phi_P - T_P q) dq, so that it stiffens the body.
    stiffening: Array | None = None

    def __post_init__(self) -> None:
        """Turn lists and other numbers into arrays."""
        for name in ("position", "displacement", "rotation"):
            object.__setattr__(self, name, as_array(getattr(self, name)))
        if self.stiffening is not None:
            object.__setattr__(self, "stiffening", as_array(self.stiffening))

    @property
    def basis(self) -> Array:
        """Reference position and shape functions side by side, shape (2, modes + 1)."""
        return np.column_stack([self.position, self.displacement])

    def shift(self, q: Array) -> Array:
        """Elastic displacement in the body's axes, shape (..., 2) [m].

        Args:
            q: Elastic coordinates, shape (..., modes).
        """
        linear = q @ self.displacement.T
        if self.stiffening is None:
            return linear
        return linear - 0.5 * np.einsum("...j,djk,...k->...d", q, self.stiffening, q)

    def shapes_at(self, q: Array) -> Array:
        """Derivative of :meth:`shift` with respect to q, shape (..., 2, modes) [-].

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
        shapes = self.displacement[:, :modes], self.rotation[:modes]
        return BodyMarker(self.position, *shapes, stiffening)

    def scaled(self, factor: float) -> BodyMarker:
        """All entries times a factor.

        Args:
            factor: The factor.
        """
        stiffening = None if self.stiffening is None else factor * self.stiffening
        shapes = factor * self.displacement, factor * self.rotation
        return BodyMarker(factor * self.position, *shapes, stiffening)

    def __add__(self, other: BodyMarker) -> BodyMarker:
        """Sum entry by entry; geometric stiffness that one of the two lacks counts as zero."""
        parts = [m.stiffening for m in (self, other) if m.stiffening is not None]
        return BodyMarker(
            self.position + other.position,
            self.displacement + other.displacement,
            self.rotation + other.rotation,
            np.sum(parts, axis=0) if parts else None,
        )

    def dot(self, other: BodyMarker) -> float:
        """Inner product over all entries.

        Args:
            other: A point with as many shape functions.
        """
        total = float(self.position @ other.position + self.rotation @ other.rotation)
        total += float(np.sum(self.displacement * other.displacement))
        if self.stiffening is not None and other.stiffening is not None:
            total += float(np.sum(self.stiffening * other.stiffening))
        return total


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
