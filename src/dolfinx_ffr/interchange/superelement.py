# SPDX-License-Identifier: MIT
"""A body as a superelement: mass and stiffness for small motions of its interfaces and its modes.

The frame of a body removes six motions of its interfaces. With them, x = (rigid motion, q), and the
square map y = T x to y = (displacements and rotations of all interfaces, coordinates of the normal
modes), the matrices are T^-T M T^-1 and T^-T K T^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .format import Arrays, axial, cross_matrix, elastic, markers, theta


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
    r, (every, at) = len(S) - 1, markers(arrays)
    motions = np.concatenate([at["displacements"], at["rotations"]], axis=1)  # marker, 6, q
    for n in range(len(every), 0, -1):  # as many as have no share in the modes that are left
        of_interfaces = 6 * n - 6
        if of_interfaces > r:
            continue
        own = np.flatnonzero(np.all(motions[:, :, of_interfaces:] == 0.0, axis=(1, 2)))
        if len(own) == n:
            break
    else:
        own, of_interfaces = np.zeros(0, dtype=np.int64), 0
    size, inner = 6 + r, 6 + of_interfaces
    T = np.eye(size)
    if square := 6 * len(own) == inner:
        for row, k in enumerate(own):
            block = T[6 * row : 6 * row + 6]
            block[:, :6] = np.eye(6)
            block[:3, 3:6] = -cross_matrix(at["positions"][k])
            block[:, 6:] = motions[k]
    if not square or np.linalg.cond(T[:inner, :inner]) > 1e12:
        raise ValueError(
            "the body has not the shape functions of a superelement: those of Craig and Bampton, "
            "six for each interface but one, in space; bodies in the plane do not move out of it"
        )
    lever, turned = -cross_matrix(S[0]), axial(P[1:, 0]).T
    whole = np.block(
        [
            [mass * np.eye(3), lever, S[1:].T],
            [lever.T, theta(P[0, 0]), turned],
            [S[1:], turned.T, np.einsum("abkk->ab", P[1:, 1:])],
        ]
    )
    stiffness = np.zeros_like(whole)
    stiffness[6:, 6:] = K
    back = np.linalg.inv(T)
    made = [back.T @ matrix @ back for matrix in (whole, stiffness)]
    names = [every[k] for k in own]
    return Superelement(names, at["positions"][own], *(0.5 * (m + m.T) for m in made))
