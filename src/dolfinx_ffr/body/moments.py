# SPDX-License-Identifier: MIT
"""Second moments P_ab = int rho w_a w_b^T of a body in space: contractions and checks.

All matrices of the equations of motion are contractions of P. With

    theta(Z) = tr(Z) 1 - Z,      axial(Z) = (Z_32 - Z_23, Z_13 - Z_31, Z_21 - Z_12)

theta(P_00) is the inertia tensor about the origin of the frame, axial(P_ab) is int rho w_b x w_a.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from ..tensors import axial
from .marker import ASYMMETRY, largest_share

#: Smallest eigenvalue of a matrix at unit diagonal that passes for zero.
_ROUND_OFF = 1e-9


def views_of_moments(P: Array) -> tuple[Array, Array]:
    """Read-only int rho w_a . w_b (n, n) and int rho w_a x w_b (n, n, 3), or empty."""
    whole = P if P.ndim == 4 and P.shape[2:] == (3, 3) else np.zeros((0, 0, 3, 3))
    G, N = np.einsum("abkk->ab", whole), -axial(whole)
    for view in (G, N):
        view.setflags(write=False)
    return G, N


def dimension_of_inertia(inertia: Any, positions: Iterable[Any]) -> int:
    """Dimension of a rigid body: 2 where its inertia is one number, 3 for three or a tensor."""
    if not validation.is_number(inertia):
        return 3
    if any(np.shape(getattr(point, "position", point)) == (3,) for point in positions):
        raise ValueError(
            "rigid body: in space the inertia is a tensor, or three moments about the body's axes, "
            f"but it is one number; of a ball it is {(float(inertia),) * 3}"
        )
    return 2


def moments_of_rigid_body(mass: float, center: Array, inertia: ArrayLike) -> Array:
    """Second moments (1, 1, 3, 3) of a rigid body by its inertia tensor (3, 3) or diagonal (3,)."""
    J = validation.real_array("rigid body: inertia", inertia)
    J = np.diag(J) if J.shape == (3,) else J
    needed = "shape (3, 3), or (3,) for its diagonal"
    validation.real_array("rigid body: inertia", J, (3, 3), expected=needed)
    if largest_share(J - J.T, np.diag(J)) > ASYMMETRY or np.any(np.diag(J) <= 0.0):
        raise ValueError(
            "rigid body: the inertia tensor must be symmetric with a positive diagonal, but it is "
            f"{J.tolist()} kg m^2"
        )
    J = 0.5 * (J + J.T)
    principal = np.linalg.eigvalsh(J)
    if principal[0] <= 0.0 or principal[2] > (principal[0] + principal[1]) * (1.0 + _ROUND_OFF):
        a, b, c = principal
        raise ValueError(
            f"rigid body: no body has the principal moments of inertia {a:.6g}, {b:.6g} and "
            f"{c:.6g} kg m^2: all must be positive, and none may exceed the sum of the two others"
        )
    P = 0.5 * np.trace(J) * np.eye(3) - J + mass * np.outer(center, center)
    return np.asarray(P[None, None])


def check_moments(name: str, P: Array, shape: tuple[int, ...]) -> None:
    """Refuse second moments that have another shape, or P_ab that differ from P_ba^T."""
    validation.real_array(f"body {name!r}: integral P", P, shape)
    traces = np.einsum("aaii->a", P)
    skew = np.max(np.abs(P - P.transpose(1, 0, 3, 2)), axis=(2, 3), initial=0.0)
    defect = largest_share(skew, traces)
    if defect > ASYMMETRY:
        raise ValueError(
            f"body {name!r}: integral P must satisfy P_ab = P_ba^T, but entries differ by "
            f"{defect:.1e} relative to the diagonal"
        )


def check_gram_matrix(name: str, mass: float, S: Array, P: Array) -> None:
    """Refuse integrals that no mass has: the Gram matrix of 1 and all components is indefinite.

    S is of shape (n, d), P of shape (n, n, d, d).
    """
    n = S.size
    _refuse_indefinite(name, "S and P", mass, S.ravel(), P.transpose(0, 2, 1, 3).reshape(n, n))


def check_flat_gram_matrix(name: str, mass: float, S: Array, G: Array, N: Array) -> None:
    """Refuse integrals in the plane that no mass has, by the Gram matrix of 1 and all x + i y.

    S is of shape (n, 2), G and N of shape (n, n).
    """
    _refuse_indefinite(name, "S, G and N", mass, S[:, 0] + 1j * S[:, 1], G + 1j * N)


def _refuse_indefinite(name: str, what: str, mass: float, first: Any, second: Any) -> None:
    """Refuse moments of first and of second order that make an indefinite matrix with the mass."""
    n = len(first)
    gram = np.empty((n + 1, n + 1), dtype=second.dtype)
    gram[0, 0], gram[0, 1:], gram[1:, 0] = mass, first, first.conj()
    gram[1:, 1:] = second
    smallest = smallest_scaled_eigenvalue(0.5 * (gram + gram.conj().T))
    if smallest < -_ROUND_OFF:
        raise ValueError(
            f"body {name!r}: no distribution of mass has these m, {what} (the Gram matrix of the "
            f"shape functions has the eigenvalue {smallest:.1e} after scaling to unit diagonal); "
            "check the inertia about all axes, and use one frame for all integrals"
        )


def smallest_scaled_eigenvalue(matrix: Any) -> float:
    """Smallest eigenvalue of a symmetric or Hermitian matrix after scaling to unit diagonal.

    It is negative for a diagonal that is not positive.
    """
    diagonal = np.real(np.diag(matrix))
    if matrix.size == 0:
        return 0.0
    if np.any(diagonal < 0.0):
        return -1.0
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return float(np.linalg.eigvalsh(matrix * np.outer(scale, scale))[0])
