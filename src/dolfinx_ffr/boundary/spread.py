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
    even_curves = {key: _evened(curve) for key, curve in boundary.free.items()}
    offsets = []
    for key, curve in even_curves.items():
        area, area_slopes = curve.area
        lost_area = boundary.free[key].area[0] - area
        area_slopes = np.where(curve.fixed, 0.0, area_slopes)
        offsets.append(lost_area * area_slopes / max(float(area_slopes @ area_slopes), 1e-300))
    return replace(boundary, free=even_curves).moved(
        boundary.mean_of_orbits(np.concatenate(offsets))
    )


def _evened(curve: FreeCurve) -> FreeCurve:
    """The curve with each control moved along it, half of the way to the middle of its neighbours.

    Distances that alternate become equal.
    """
    control, normals = curve.control, curve.control_normals
    middles = 0.5 * (np.roll(control, 1, axis=0) + np.roll(control, -1, axis=0))
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    along = 0.5 * np.einsum("ij,ij->i", middles - control, tangents) * ~curve.fixed
    return curve.moved(control + along[:, None] * tangents)
