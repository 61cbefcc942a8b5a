# SPDX-License-Identifier: MIT
"""Curves without ripples: short waves that no step asks for, and meshes cannot tell from noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays import Array
from .curve import FreeCurve
from .outline import Boundary

#: Share of the shortest wave that controls can show, which is left
_LEFT = 0.5
#: Times the curvature of a minimum member from which on a curve turns by intention
_TURN = 0.5


def faired(boundary: Boundary, share: float = 1.0) -> Boundary:
    """The same with controls less uneven, and with short waves made smaller, but for corners.

    The offsets a of controls along their normals minimise |a|^2 plus a ``share`` of the weighted
    changes of the curvature, the third differences of the controls across the curve (M. Eck, J.
    Hadenfeld, Computing Supplementum 10, 1995, doi:10.1007/978-3-7091-7584-2_3), and keep the area
    beside each curve. Waves along six or more controls hardly change.
    """
    member, shares = boundary.member, boundary.shares
    even = replace(boundary, free={key: slid(curve) for key, curve in boundary.free.items()})
    curves = boundary.free.items()
    offsets = [ripples(even.free[k], member, c.area[0], share) for k, c in curves]
    return even.moved(shares @ (shares.T @ np.concatenate(offsets) / shares.sum(axis=0).A1))


def slid(curve: FreeCurve) -> FreeCurve:
    """The same with controls moved along the curve, each half of the way to amid its neighbours.

    Steps move controls across the curve only, so where a curve grows it had too few of them, and
    where it shrinks they crowd. Of distances that alternate nothing is left.
    """
    x, normals = curve.control, curve.control_normals
    amid = 0.5 * (np.roll(x, 1, axis=0) + np.roll(x, -1, axis=0))
    along = np.column_stack([-normals[:, 1], normals[:, 0]])
    way = 0.5 * np.einsum("ij,ij->i", amid - x, along) * ~curve.held
    return curve.moved(x + way[:, None] * along)


def ripples(
    curve: FreeCurve, member: float, area: float | None = None, share: float = 1.0
) -> Array:
    """Offsets of the controls of one curve along their normals (n,) that make them smaller [m].

    The area beside it, `FreeCurve.area`, becomes ``area`` [m^2], by default the one it has.
    """
    n, x, normals = len(curve.control), curve.control, curve.control_normals
    first = np.arange(n if curve.closed else n - 3)
    four = (first[:, None] + np.arange(4)) % n
    if not len(four):
        return np.zeros(n)
    along = x[four[:, 2]] - x[four[:, 1]]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-300)
    across = np.column_stack([along[:, 1], -along[:, 0]]) / length[:, None]
    # third differences, and second ones amid them
    change = np.einsum("j,mjd,md->m", [-1.0, 3.0, -3.0, 1.0], x[four], across)
    bend = np.einsum("j,mjd,md->m", [0.5, -0.5, -0.5, 0.5], x[four], across) / length**2
    weight = share * (1.0 / _LEFT - 1.0) / 64.0 / (1.0 + (bend * member / _TURN) ** 2) ** 2
    slopes = np.zeros((len(first), n))
    own = np.array([-1.0, 3.0, -3.0, 1.0]) * np.einsum("mjd,md->mj", normals[four], across)
    np.put_along_axis(slopes, four, own, axis=1)
    free = np.flatnonzero(~curve.held)
    matrix = (np.eye(n) + slopes.T @ (weight[:, None] * slopes))[np.ix_(free, free)]
    now, gains = curve.area
    right = np.column_stack([-slopes.T[free] @ (weight * change), gains[free]])
    offsets, wider = np.zeros(n), np.zeros(n)
    offsets[free], wider[free] = np.linalg.solve(matrix, right).T
    more = curve.moved(x + offsets[:, None] * normals).area[0] - (now if area is None else area)
    offsets -= more / (gains @ wider) * wider
    return offsets
