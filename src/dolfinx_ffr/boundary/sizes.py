# SPDX-License-Identifier: MIT
"""Members, gaps and radii no smaller than a minimum, as linear constraints on the offsets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from ..arrays import Array, Integers, Mask
from .curve import Bending, FreeCurve
from .options import CURVES
from .outline import Boundary, Samples


class Rows(NamedTuple):
    """Constraints value + slope . offsets <= 0."""

    values: Array  #: (m,)
    slopes: Array | csr_matrix  #: (m, offsets) [1/m]
    least: Array  #: Size of which the value is 1 - size / least, (m,) [m]
    oversize: float = CURVES.oversize  #: Factor by which the least size exceeds the minimum

    @staticmethod
    def none(n_offsets: int) -> Rows:
        """No constraints on a number of offsets."""
        return Rows(np.zeros(0), np.zeros((0, n_offsets)), np.zeros(0))

    @property
    def smallest(self) -> float:
        """The smallest size that has a constraint [m]; infinite if there is none."""
        return float(np.min(self.least * (1.0 - self.values), initial=np.inf))

    @property
    def size_violation(self) -> float:
        """Largest relative violation of the minimum size; at least zero."""
        return max(0.0, 1.0 - self.oversize * (1.0 - float(np.max(self.values, initial=-np.inf))))


class Widths(NamedTuple):
    """Straight lines between two samples of a boundary, shapes (widths, ...)."""

    start: Integers  #: Numbers of the samples at one end
    end: Integers  #: At the other end
    displacement: Array  #: From start to end, (widths, 2) [m]
    length: Array  #: [m]


def size_rows(boundary: Boundary) -> Rows:
    """1 - d / d_min for the narrowest place beside each control, of members and of gaps.

    The distance d between two points of the boundary is the shortest one at both, so at fixed
    parameters its derivative is exact. Of places that are mirror images one has a constraint.
    """
    samples = boundary.samples()
    widths = _widths(samples, CURVES.constrained * max(boundary.member, boundary.gap))
    values, slopes, minima = [], [], []
    for outwards, minimum in ((False, boundary.member), (True, boundary.gap)):
        least = CURVES.oversize * minimum
        chosen = _narrowest_places(boundary, samples, widths, outwards, least)
        values.append(1.0 - widths.length[chosen] / least)
        slopes.append(_width_slopes(boundary, samples, widths, chosen) / least)
        minima.append(np.full(len(chosen), least))
    by_controls = np.concatenate(slopes)
    return Rows(np.concatenate(values), by_controls @ boundary.expansion, np.concatenate(minima))


def _widths(samples: Samples, widest: float) -> Widths:
    """Lines up to the ``widest`` [m] between samples that face each other, in both directions."""
    points, normals = samples.points, samples.normals
    pairs = cKDTree(points).query_pairs(widest, output_type="ndarray")
    product = np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]])
    # two normals along a width, up to the angle arccos(across), are twice that from opposite
    pairs = pairs[product < 1.0 - 2.0 * CURVES.across**2]
    start, end = np.concatenate([pairs, pairs[:, ::-1]]).T
    displacement = points[end] - points[start]
    return Widths(start, end, displacement, np.linalg.norm(displacement, axis=1))


def _narrowest_places(
    boundary: Boundary, samples: Samples, widths: Widths, outwards: bool, least: float
) -> Integers:
    """Numbers of the widths that have a constraint: one for each orbit that is near one at all.

    Widths that lead ``outwards`` are gaps, others members; their ``least`` length is in [m].
    """
    start, length = widths.start, widths.length
    sign = 1.0 if outwards else -1.0
    along_normal = np.einsum("ij,ij->i", widths.displacement, samples.normals[start])
    is_across = sign * along_normal > CURVES.across * length
    is_near = length < CURVES.constrained * least
    moves = np.diff(samples.rows.indptr) > 0
    chosen = np.flatnonzero(is_across & is_near & (length > 0.0) & moves[start])

    # of each sample the shortest width, and of samples at which one control weighs most, too
    chosen = chosen[np.argsort(length[chosen], kind="stable")]
    chosen = chosen[np.unique(start[chosen], return_index=True)[1]]
    chosen = chosen[np.argsort(length[chosen], kind="stable")]
    nearest_control = np.asarray(samples.rows[start[chosen]].argmax(axis=1)).ravel()
    controls, shortest = np.unique(nearest_control, return_index=True)
    return np.asarray(chosen[shortest[boundary.leads[controls]]])


def _width_slopes(boundary: Boundary, samples: Samples, widths: Widths, chosen: Integers) -> Array:
    """Derivatives of minus the length of m ``chosen`` widths by offsets of controls.

    Their shape is (m, controls). Constraints fall where widths grow, hence the sign.
    """
    weights = samples.rows[widths.start[chosen]] - samples.rows[widths.end[chosen]]
    direction = -widths.displacement[chosen] / widths.length[chosen, None]
    along_normals = np.einsum("md,kd->mk", direction, boundary.normals)
    return np.asarray(-weights.toarray() * along_normals)


def radius_rows(boundary: Boundary) -> Rows:
    """1 - rho / rho_min where the radius of curvature rho is smallest near each control.

    At fixed parameters the derivative of the curvature is exact, and where it is largest along the
    curve that is the derivative of the largest one.
    """
    least = CURVES.oversize * boundary.radius
    if least == 0.0:
        return Rows.none(boundary.n_offsets)
    values = [np.zeros(0)]
    slopes = [np.zeros((0, boundary.n_controls))]
    for key, curve in boundary.free.items():
        s = curve.bend_parameters(CURVES.sample * least)
        bending = curve.bending(s)
        leads = boundary.leads[boundary.controls_of(key)]
        tight = _tightest_places(curve, s, np.abs(bending.curvature), leads, least)
        s, bending = s[tight], Bending(*(quantity[tight] for quantity in bending))
        values.append(1.0 - 1.0 / np.abs(bending.curvature) / least)
        curve_slopes = csr_matrix(_radius_slopes(curve, s, bending, least))
        slopes.append(boundary.on_all_controls(curve_slopes, key).toarray())
    stacked = np.concatenate(values)
    by_controls = np.concatenate(slopes)
    return Rows(stacked, by_controls @ boundary.expansion, np.full(len(stacked), least))


def _tightest_places(
    curve: FreeCurve, s: Array, curvature: Array, leads: Mask, least: float
) -> Integers:
    """Where radii have a constraint: at one parameter for each control that ``leads`` its orbit.

    Only where the radius is near the ``least`` one [m]. Returned are places in the parameters ``s``
    (n,), at which the absolute curvature is given, (n,) [1/m].
    """
    tight = np.flatnonzero(curvature * CURVES.constrained * least > 1.0)
    # of the points at which one control weighs most the tightest
    tight = tight[np.argsort(-curvature[tight], kind="stable")]
    nearest_control = np.asarray(curve.rows(s[tight]).argmax(axis=1)).ravel()
    controls, tightest = np.unique(nearest_control, return_index=True)
    return np.asarray(tight[tightest[leads[controls]]])


def _radius_slopes(curve: FreeCurve, s: Array, bending: Bending, least: float) -> Array:
    """Derivatives of -radius / least at parameters (m,) by offsets of controls, (m, controls)."""
    curvature, slope, bend, speed = bending
    # derivatives of the curvature by the first and the second derivative of the curve
    by_bend = np.column_stack([-slope[:, 1], slope[:, 0]]) / speed[:, None] ** 3
    by_slope = np.column_stack([bend[:, 1], -bend[:, 0]]) / speed[:, None] ** 3
    by_slope -= 3.0 * (curvature / speed**2)[:, None] * slope

    # a control moves the curve along the normal of the control
    normals = curve.control_normals
    curvature_slopes = curve.rows(s, 1).toarray() * (by_slope @ normals.T)
    curvature_slopes += curve.rows(s, 2).toarray() * (by_bend @ normals.T)

    by_curvature = np.sign(curvature) / curvature**2 / least
    return np.asarray(by_curvature[:, None] * curvature_slopes)


def control_position_rows(boundary: Boundary, reach: float) -> Rows:
    """Controls stay where they may be, after a step of at most ``reach`` [m]."""
    values, slopes = [], []
    for sign, path in zip((1.0, -1.0), boundary.free_paths(reach), strict=True):
        is_blocked = path < (1.0 - 1e-9) * reach
        blocked = np.flatnonzero(boundary.leads & ~boundary.fixed & is_blocked)
        rows = np.zeros((len(blocked), boundary.n_controls))
        rows[np.arange(len(blocked)), blocked] = sign / boundary.member
        values.append(-path[blocked] / boundary.member)
        slopes.append(rows)
    stacked = np.concatenate(values)
    by_controls = np.concatenate(slopes)
    return Rows(stacked, by_controls @ boundary.expansion, np.full(len(stacked), np.inf))
