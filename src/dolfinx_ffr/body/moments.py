# SPDX-License-Identifier: MIT
"""Second moments P_ab = int rho w_a w_b^T of a body in space: what follows from them, and checks.

All matrices of the equations of motion are contractions of P. With

    theta(Z) = tr(Z) 1 - Z,      axial(Z) = (Z_32 - Z_23, Z_13 - Z_31, Z_21 - Z_12)

theta(P_00) is the inertia tensor about the origin of the frame, axial(P_ab) is int rho w_b x w_a.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation
from .marker import ASYMMETRY, largest_share

__all__ = [
    "axial",
    "check_gram_matrix",
    "check_moments",
    "cross_matrix",
    "mass_matrix_in_space",
    "moments_of_rigid_body",
    "smallest_scaled_eigenvalue",
    "theta",
    "views_of_moments",
]

Array = NDArray[np.float64]

#: Smallest eigenvalue of a matrix at unit diagonal that passes for zero.
_ROUND_OFF = 1e-9


def cross_matrix(x: Array) -> Array:
    """The matrix of the cross product with a vector, shape (3, 3).

    Args:
        x: The vector, shape (3,).
    """
    return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])


def theta(Z: Array) -> Array:
    """The matrices tr(Z) 1 - Z.

    Args:
        Z: Matrices, shape (..., 3, 3).
    """
    return np.trace(Z, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - Z


def axial(Z: Array) -> Array:
    """The vectors of the antisymmetric parts of matrices, shape (..., 3).

    Args:
        Z: Matrices, shape (..., 3, 3).
    """
    return np.stack(
        [
            Z[..., 2, 1] - Z[..., 1, 2],
            Z[..., 0, 2] - Z[..., 2, 0],
            Z[..., 1, 0] - Z[..., 0, 1],
        ],
        axis=-1,
    )


def views_of_moments(P: Array) -> tuple[Array, Array]:
    """Int rho w_a . w_b, and int rho w_a x w_b, to be read only.

    Args:
        P: The second moments, shape (n, n, 3, 3).

    Returns:
        Arrays of shape (n, n) and (n, n, 3) [kg m^2]; empty ones where P has another shape.
    """
    if P.ndim != 4 or P.shape[2:] != (3, 3):
        return np.zeros((0, 0)), np.zeros((0, 0, 3))
    G, N = np.einsum("abkk->ab", P), -axial(P)
    for view in (G, N):
        view.setflags(write=False)
    return G, N


def moments_of_rigid_body(mass: float, center: Array, inertia: ArrayLike) -> Array:
    """Second moment of a rigid body, shape (1, 1, 3, 3) [kg m^2].

    Args:
        mass: Mass [kg].
        center: Centre of mass in the body's frame, shape (3,) [m].
        inertia: Inertia tensor about the centre of mass, shape (3, 3), or its diagonal, shape (3,)
            [kg m^2].

    Raises:
        TypeError: If the inertia holds something else than numbers.
        ValueError: If no distribution of mass has this inertia.
    """
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


def mass_matrix_in_space(mass: float, S: Array, P: Array) -> Array:
    """Mass matrix of the undeformed body in its frame's position, shape (6 + modes, 6 + modes).

    Args:
        mass: Mass [kg].
        S: Int rho w_a, shape (modes + 1, 3) [kg m].
        P: Second moments, shape (modes + 1, modes + 1, 3, 3) [kg m^2].

    Returns:
        Rows of the velocity of the frame [kg], of the angular velocity [kg m^2] and of the elastic
        coordinates.
    """
    n = 5 + len(S)
    matrix, lever = np.zeros((n, n)), cross_matrix(S[0])
    matrix[:3, :3] = mass * np.eye(3)
    matrix[:3, 3:6], matrix[3:6, :3] = -lever, lever
    matrix[:3, 6:], matrix[6:, :3] = S[1:].T, S[1:]
    matrix[3:6, 3:6] = theta(P[0, 0])
    matrix[6:, 3:6] = axial(P[1:, 0])
    matrix[3:6, 6:] = matrix[6:, 3:6].T
    matrix[6:, 6:] = np.einsum("abkk->ab", P[1:, 1:])
    return matrix


def check_moments(name: str, P: Array, shape: tuple[int, ...]) -> None:
    """Refuse second moments that lack their shape or their symmetry.

    Args:
        name: Name of the body, for the message.
        P: The second moments.
        shape: The shape that they must have.

    Raises:
        ValueError: If the shape is another one, a number is not finite, or P_ab is not P_ba^T.
    """
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
    """Refuse integrals that no distribution of mass has.

    The components of all fields w_a, and 1, are functions whose Gram matrix holds m, S and P.

    Args:
        name: Name of the body, for the message.
        mass: Mass [kg].
        S: Int rho w_a, shape (modes + 1, 3) [kg m].
        P: Second moments, shape (modes + 1, modes + 1, 3, 3) [kg m^2].

    Raises:
        ValueError: If the Gram matrix has a negative eigenvalue.
    """
    n = 3 * len(S)
    gram = np.empty((n + 1, n + 1))
    gram[0, 0], gram[0, 1:], gram[1:, 0] = mass, S.ravel(), S.ravel()
    gram[1:, 1:] = P.transpose(0, 2, 1, 3).reshape(n, n)
    smallest = smallest_scaled_eigenvalue(0.5 * (gram + gram.T))
    if smallest < -_ROUND_OFF:
        raise ValueError(
            f"body {name!r}: no distribution of mass has these m, S and P (the Gram matrix of the "
            f"shape functions has the eigenvalue {smallest:.1e} after scaling to unit diagonal); "
            "check the inertia about all axes, and that S and P are of one frame"
        )


def smallest_scaled_eigenvalue(matrix: Array) -> float:
    """Smallest eigenvalue after scaling to unit diagonal; negative for a non-positive diagonal.

    Args:
        matrix: A symmetric matrix, shape (n, n).
    """
    diagonal = np.diag(matrix)
    if matrix.size == 0:
        return 0.0
    if np.any(diagonal < 0.0):
        return -1.0
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return float(np.linalg.eigvalsh(matrix * np.outer(scale, scale))[0])
