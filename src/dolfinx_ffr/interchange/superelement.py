# SPDX-License-Identifier: MIT
"""A body as a superelement: mass and stiffness for small motions of its interfaces and its modes.

The frame of a body removes six motions of its interfaces. With them, x = (rigid motion, q), and the
square map y = T x to y = (displacements and rotations of all interfaces, coordinates of the normal
modes), the matrices are T^-T M T^-1 and T^-T K T^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array, Integers
from ..tensors import axial, cross_matrix, theta
from .format import Arrays, elastic, markers


@dataclass(frozen=True)
class Superelement:
    """Matrices of all motions of some interfaces, and of modes with the interfaces held."""

    names: list[str]  #: Of the interfaces
    positions: Array  #: (n, 3) in the body's frame [m]
    mass: Array  #: (6 n + modes, 6 n + modes): x, y, z and rotations of each interface, then modes
    stiffness: Array  #: Likewise


def superelement(arrays: Arrays) -> Superelement:
    """The superelement of a body with the constraint modes of its interfaces, or a ValueError."""
    mass, S, P, K = elastic(arrays)
    r = len(S) - 1
    names, marker_arrays = markers(arrays)
    positions = marker_arrays["positions"]
    shapes = [marker_arrays["displacements"], marker_arrays["rotations"]]
    motions = np.concatenate(shapes, axis=1)  # (markers, 6, modes)
    interfaces, n_constraint_modes = _interfaces(motions)

    # y = T x, see above; the normal modes stay as they are
    T = np.eye(6 + r)
    n_motions = 6 + n_constraint_modes
    complete = 6 * len(interfaces) == n_motions
    if complete:
        for row, marker in enumerate(interfaces):
            block = T[6 * row : 6 * row + 6]
            block[:, :6] = np.eye(6)
            block[:3, 3:6] = -cross_matrix(positions[marker])
            block[:, 6:] = motions[marker]
    if not complete or np.linalg.cond(T[:n_motions, :n_motions]) > 1e12:
        raise ValueError(
            "the body lacks the shape functions of a superelement; take a FlexibleBody in space, "
            "whose modes of Craig and Bampton are six for each interface but one"
        )

    lever, turned = -cross_matrix(S[0]), axial(P[1:, 0]).T
    body_mass = np.block(
        [
            [mass * np.eye(3), lever, S[1:].T],
            [lever.T, theta(P[0, 0]), turned],
            [S[1:], turned.T, np.einsum("abkk->ab", P[1:, 1:])],
        ]
    )
    body_stiffness = np.zeros_like(body_mass)
    body_stiffness[6:, 6:] = K
    inverse = np.linalg.inv(T)
    mass_matrix, stiffness = (inverse.T @ m @ inverse for m in (body_mass, body_stiffness))
    return Superelement(
        names=[names[marker] for marker in interfaces],
        positions=positions[interfaces],
        mass=0.5 * (mass_matrix + mass_matrix.T),
        stiffness=0.5 * (stiffness + stiffness.T),
    )


def _interfaces(motions: Array) -> tuple[Integers, int]:
    """Markers of interfaces, which no normal mode moves, and the number of constraint modes.

    The frame holds six motions of the interfaces, and each of the others has a constraint mode.
    """
    n_markers, _, r = motions.shape
    for n in range(n_markers, 0, -1):
        n_constraint_modes = 6 * n - 6
        if n_constraint_modes <= r:
            at_rest = np.all(motions[:, :, n_constraint_modes:] == 0.0, axis=(1, 2))
            if np.count_nonzero(at_rest) == n:
                return np.flatnonzero(at_rest), n_constraint_modes
    return np.zeros(0, dtype=np.int64), 0
