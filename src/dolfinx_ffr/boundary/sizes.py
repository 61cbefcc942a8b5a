# SPDX-License-Identifier: MIT
"""Members, gaps and radii no smaller than a minimum, as constraints on the controls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from ..arrays import Array
from .options import CURVES
from .outline import Boundary


class Rows(NamedTuple):
    """Constraints value + slope . offsets <= 0."""

    values: Array  #: (m,)
    slopes: Array | csr_matrix  #: (m, controls) [1/m]
    least: Array  #: Size of which the value is 1 - size / least, (m,) [m]
    oversize: float = CURVES.oversize  #: Factor by which the least size exceeds the minimum

    @staticmethod
    def none(controls: int) -> Rows:
        """No constraints on a number of controls."""
        empty = np.zeros((0, controls))
        return Rows(np.zeros(0), empty, np.zeros(0))

    @property
    def smallest(self) -> float:
        """The smallest size that has a constraint [m]; infinite if there is none."""
        return float(np.min(self.least * (1.0 - self.values), initial=np.inf))

    @property
    def size_violation(self) -> float:
        """Largest relative violation of the minimum size; at least zero."""
        return max(0.0, 1.0 - self.oversize * (1.0 - float(np.max(self.values, initial=-np.inf))))


def _rows(values: list[Array], slopes: list[Array], least: float, oversize: float) -> Rows:
    """Constraints below each other, of one ``least`` size [m]."""
    stacked = np.concatenate(values)
    return Rows(stacked, np.vstack(slopes), np.broadcast_to(least, stacked.shape), oversize)


def size_rows(boundary: Boundary) -> Rows:
    """1 - d / d_min for the narrowest place beside each control, of members and of gaps.

    The way d between two points of the boundary is the shortest one at both, so at fixed parameters
    its derivative is exact. Of places that are mirror images one has a constraint.
    """
    options, samples = boundary.options, boundary.samples()
    x, n = samples.points, samples.normals
    widest = options.seen * max(boundary.member, boundary.gap)
    pairs = cKDTree(x).query_pairs(widest, output_type="ndarray")
    pairs = pairs[np.einsum("ij,ij->i", n[pairs[:, 0]], n[pairs[:, 1]]) < options.facing]
    i, j = np.concatenate([pairs, pairs[:, ::-1]]).T
    displacement = x[j] - x[i]
    distance = np.linalg.norm(displacement, axis=1)
    moves = np.diff(samples.rows.indptr) > 0
    values, slopes = [np.zeros(0)], [np.zeros((0, boundary.n_controls))]
    minima = [np.zeros(0)]
    # through the material, and through the void
    for side, least in (
        (-1.0, options.oversize * boundary.member),
        (1.0, options.oversize * boundary.gap),
    ):
        met = side * np.einsum("ij,ij->i", displacement, n[i]) > options.across * distance
        near = distance < options.seen * least
        chosen = np.flatnonzero(met & near & (distance > 0.0) & moves[i])
        chosen = chosen[np.argsort(distance[chosen], kind="stable")]
        # of each point the nearest, and of all points at which a control nearest_control most
        chosen = chosen[np.unique(i[chosen], return_index=True)[1]]
        chosen = chosen[np.argsort(distance[chosen], kind="stable")]
        nearest_control = np.asarray(samples.rows[i[chosen]].argmax(axis=1)).ravel()
        controls, first = np.unique(nearest_control, return_index=True)
        chosen = chosen[first[boundary.leads[controls]]]
        apart = samples.rows[i[chosen]] - samples.rows[j[chosen]]
        along = -displacement[chosen] / distance[chosen, None]
        projected = np.einsum("md,kd->mk", along, boundary.normals)
        values.append(1.0 - distance[chosen] / least)
        slopes.append(-apart.toarray() * projected / least)
        minima.append(np.full(len(chosen), least))
    return Rows(
        np.concatenate(values), np.concatenate(slopes), np.concatenate(minima), options.oversize
    )


def radius_rows(boundary: Boundary) -> Rows:
    """1 - rho / rho_min where the radius of curvature rho is smallest near each control.

    At fixed parameters the derivative of the curvature is exact, and where it is largest along the
    curve that is the derivative of the largest one.
    """
    options = boundary.options
    least = options.oversize * boundary.radius
    values, slopes = [np.zeros(0)], [np.zeros((0, boundary.n_controls))]
    for key, curve in boundary.free.items():
        if not least:
            break
        s = curve.bend_parameters(options.sample * least)
        turn, a, b, size = curve.turn(s)
        tight = np.flatnonzero(np.abs(turn) * options.seen * least > 1.0)
        # of the points at which a control nearest_control most the tightest
        tight = tight[np.argsort(-np.abs(turn[tight]), kind="stable")]
        nearest_control = np.asarray(curve.rows(s[tight]).argmax(axis=1)).ravel()
        controls, first_of = np.unique(nearest_control, return_index=True)
        tight = tight[first_of[boundary.leads[boundary.first[key] + controls]]]
        a, b, size, turn = a[tight], b[tight], size[tight], turn[tight]
        # d turn by a and by b, times the normals of the controls
        by_b = np.column_stack([-a[:, 1], a[:, 0]]) / size[:, None] ** 3
        by_a = np.column_stack([b[:, 1], -b[:, 0]]) / size[:, None] ** 3
        by_a -= 3.0 * (turn / size**2)[:, None] * a
        normals = curve.control_normals
        change = curve.rows(s[tight], 1).toarray() * (by_a @ normals.T)
        change += curve.rows(s[tight], 2).toarray() * (by_b @ normals.T)
        change *= (np.sign(turn) / turn**2 / least)[:, None]
        values.append(1.0 - 1.0 / np.abs(turn) / least)
        slopes.append(boundary.wide(csr_matrix(change), key).toarray())
    return _rows(values, slopes, least, options.oversize)


def control_position_rows(boundary: Boundary, reach: float) -> Rows:
    """Controls stay where they may be, after a step of at most ``reach`` [m]."""
    values, slopes = [], []
    for side, displacement in zip((1.0, -1.0), boundary.ways(reach), strict=True):
        near = np.flatnonzero(
            boundary.leads & ~boundary.fixed & (displacement < (1.0 - 1e-9) * reach)
        )
        rows = np.zeros((len(near), boundary.n_controls))
        rows[np.arange(len(near)), near] = side / boundary.member
        values.append(-displacement[near] / boundary.member)
        slopes.append(rows)
    return _rows(values, slopes, np.inf, boundary.options.oversize)
