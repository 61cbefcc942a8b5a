# SPDX-License-Identifier: MIT
"""Controls of curves that are spread evenly along them, as steps move them across only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .curve import FreeCurve
from .outline import Boundary


def spread(boundary: Boundary) -> Boundary:
    """The boundary with controls that are less uneven along their curves, of the same area.

    Where a curve grows it would have too few controls, and where it shrinks they would crowd. On
    rods from 60x6 and 120x12 elements psi is 0.7 % and 1.8 % larger after twelve steps without.
    """
    offsets = []
    curves = {key: _spread(curve) for key, curve in boundary.free.items()}
    for key, curve in curves.items():
        area, gains = curve.area
        missing = boundary.free[key].area[0] - area
        free = np.where(curve.fixed, 0.0, gains)
        offsets.append(missing * free / max(float(free @ free), 1e-300))
    shares = boundary.expansion
    alike = shares.T @ np.concatenate(offsets) / shares.sum(axis=0).A1
    return replace(boundary, free=curves).moved(shares @ alike)


def _spread(curve: FreeCurve) -> FreeCurve:
    """The curve with each control half of the way along it to the middle of its neighbours.

    Of distances that alternate nothing is left.
    """
    control, normals = curve.control, curve.control_normals
    middle = 0.5 * (np.roll(control, 1, axis=0) + np.roll(control, -1, axis=0))
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    motion = 0.5 * np.einsum("ij,ij->i", middle - control, tangents) * ~curve.fixed
    return curve.moved(control + motion[:, None] * tangents)
