# SPDX-License-Identifier: MIT
"""Curves that move: uniform cubic B-splines, closed or between two points that stay."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from scipy.sparse import csr_matrix

from ..arrays import Array, Integers, Mask
from ..fem import Spline
from .options import CURVES, BoundaryOptions

#: Parameters in a span, its ends among them, at which the curvature is looked at: where controls
#: are near each other it changes within a small share of a radius
_BENDS = 32
#: Points for each control to which a curve is fitted, at least: a curve with fewer would miss them
_DENSE = 16
#: Points and weights of Gauss: three integrate polynomials of degree 5
_GAUSS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, eq=False)
class FreeCurve:
    """A uniform cubic B-spline with the material on its left.

    An open one has its first and last control three times: there it ends, and they stay.
    """

    control: Array  #: (n, 2) [m]
    #: Numbers of the nodes of the fixed curves between which it runs, None where it is closed
    nodes: tuple[int, int] | None = None

    @property
    def closed(self) -> bool:
        """Whether it has no ends."""
        return self.nodes is None

    @property
    def spans(self) -> int:
        """Number of its polynomials, and largest parameter."""
        return len(self.control) if self.closed else len(self.control) + 1

    @property
    def fixed(self) -> Mask:
        """Whether a control stays, shape (n,)."""
        fixed = np.zeros(len(self.control), dtype=bool)
        if not self.closed:
            fixed[[0, -1]] = True
        return fixed

    def _shares(self, s: Array, derivative: int) -> tuple[Array, Integers]:
        """Shares of the controls that count at parameters, and their numbers, (points, 4) each."""
        n, m = len(self.control), self.spans
        k = np.clip(np.floor(s).astype(np.int64), 0, m - 1)
        t = np.asarray(s) - k
        u = 1.0 - t
        if derivative == 0:
            cube = t**3
            parts = [u**3, 3 * cube - 6 * t**2 + 4, -3 * cube + 3 * t**2 + 3 * t + 1, cube]
        elif derivative == 1:
            parts = [-3 * u**2, 9 * t**2 - 12 * t, -9 * t**2 + 6 * t + 3, 3 * t**2]
        else:
            parts = [6 * u, 18 * t - 12, 6 - 18 * t, 6 * t]
        around = np.arange(n + 3) % n if self.closed else np.clip(np.arange(n + 4) - 2, 0, n - 1)
        return np.stack(parts, axis=1) / 6.0, around[k[:, None] + np.arange(4)]

    def rows(self, s: Array, derivative: int = 0) -> csr_matrix:
        """Shares of the controls in points at parameters, or in a derivative, (points, n)."""
        shares, columns = self._shares(s, derivative)
        first = np.arange(0, 4 * len(shares) + 1, 4)
        size = len(shares), len(self.control)
        return csr_matrix((shares.ravel(), columns.ravel(), first), size)

    def at(self, s: Array, derivative: int = 0) -> Array:
        """Points at parameters from 0 to `spans`, or a derivative, shape (points, 2) [m]."""
        shares, columns = self._shares(s, derivative)
        return np.einsum("pk,pkd->pd", shares, self.control[columns])

    def normals(self, s: Array) -> Array:
        """Unit normals out of the material, shape (points, 2)."""
        slope = self.at(s, 1)
        normal = np.column_stack([slope[:, 1], -slope[:, 0]])
        return normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]

    def turn(self, s: Array) -> tuple[Array, Array, Array, Array]:
        """Curvature at parameters (points,) [1/m], first and second derivatives, and speed."""
        a, b = (self.at(s, order) for order in (1, 2))
        size = np.linalg.norm(a, axis=1)
        # at the ends of an open curve, where it is straight, the slope vanishes
        size[size < 1e-6 * np.max(size)] = np.inf
        return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / size**3, a, b, size

    @property
    def smallest_radius(self) -> float:
        """The smallest radius of curvature [m]."""
        s = np.linspace(0.0, self.spans, _BENDS * self.spans + 1)
        return 1.0 / max(float(np.max(np.abs(self.turn(s)[0]))), 1e-300)

    @property
    def peaks(self) -> Array:
        """Parameters at which each control weighs most, shape (n,)."""
        n = len(self.control)
        s = (np.arange(n) - 1.0) % n if self.closed else np.arange(n) + 1.0
        if not self.closed:
            s[[0, -1]] = 0.0, self.spans
        return s

    @cached_property
    def control_normals(self) -> Array:
        """Normals of the curve where each control weighs most, shape (n, 2)."""
        return self.normals(self.peaks)

    @cached_property
    def area(self) -> tuple[float, Array]:
        """The area on its left [m^2] but for a constant, and its slopes by offsets (n,) [m]."""
        t, share = _GAUSS
        s = (np.arange(self.spans)[:, None] + 0.5 + 0.5 * t).ravel()
        (x, y), (u, v) = (self.at(s, order).T for order in (0, 1))
        share = np.tile(0.5 * share, self.spans)
        slopes = self.rows(s).T @ (share[:, None] * np.column_stack([v, -u]))
        slopes = np.einsum("kd,kd->k", slopes, self.control_normals)
        return 0.5 * float(share @ (x * v - y * u)), slopes

    def sampled(self, step: float, each: int = 4) -> Array:
        """Parameters, ``each`` of a span or more, of points at most about ``step`` [m] apart."""
        fine = self.at(np.linspace(0.0, self.spans, 8 * self.spans + 1))
        length = float(np.linalg.norm(np.diff(fine, axis=0), axis=1).sum())
        count = max(math.ceil(length / step), each * self.spans)
        return np.linspace(0.0, self.spans, count, endpoint=False)

    def bend_parameters(self, step: float) -> Array:
        """Parameters of points at most about ``step`` [m] apart that show each bend, (points,)."""
        return self.sampled(step, _BENDS)

    def nearest(self, points: Array, near: Array) -> Array:
        """Parameters of the nearest points, from parameters ``near`` them, by Newton's method."""
        s = near
        for _ in range(5):
            t = self.at(s, 1)
            off = np.einsum("ij,ij->i", points - self.at(s), t)
            s = s + off / np.maximum(np.einsum("ij,ij->i", t, t), 1e-300)
            s = s % self.spans if self.closed else np.clip(s, 0.0, self.spans)
        return s

    def moved(self, control: Array) -> FreeCurve:
        """The same curve with other controls."""
        return replace(self, control=control)

    def spline(self) -> Spline:
        """The same curve as drawings hold it."""
        m = self.spans
        ends = np.ones(4)
        knots = np.concatenate([0.0 * ends, np.arange(1, m) / m, ends])
        spline = Spline.of(lambda t: self.at(np.asarray(t) * m), knots, 3)
        first, last = (0, 0) if self.closed else (0, -1)
        start = spline.control[0] if self.closed else self.control[first]
        spline.control[0] = start
        spline.control[-1] = start if self.closed else self.control[last]
        return spline

    @staticmethod
    def fit(
        points: Array, spacing: float, nodes: tuple[int, int] | None = None, multiple: int = 1
    ) -> FreeCurve:
        """A curve along a polygon, smoothed.

        Args:
            points: Vertices, shape (n, 2); of a closed curve the first one is not repeated [m].
            spacing: Distance of the controls [m].
            nodes: Nodes at both ends, as the field; None for a closed curve.
            multiple: Divisor of the number of controls of a closed curve.
        """
        closed = nodes is None
        ring = np.vstack([points, points[:1]]) if closed else points
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
        length = float(along[-1])
        n = max(round(length / spacing), 5 if closed else 3)
        n = -(-n // multiple) * multiple
        curve = FreeCurve(np.zeros((n, 2)), nodes)
        t = np.linspace(0.0, 1.0, _DENSE * n, endpoint=not closed)
        x = np.column_stack([np.interp(t * length, along, ring[:, i]) for i in (0, 1)])
        shares = curve.rows(t * curve.spans)
        one = np.eye(n)
        bend = np.roll(one, 1, axis=0) + np.roll(one, -1, axis=0) - 2.0 * one
        if not closed:
            bend[[0, -1]] = 0.0
        # second differences of the controls weigh as much as the points: steps along the elements
        # of a mesh go, members stay where they are
        matrix = (shares.T @ shares).toarray() + _DENSE * bend.T @ bend
        if closed:
            # smoothing shrinks what has few controls; a circle tells by how much
            angle = 2.0 * np.pi * t
            circle = np.column_stack([np.cos(angle), np.sin(angle)])
            control = np.linalg.solve(matrix, shares.T @ np.hstack([x, circle]))
            radius = float(np.mean(np.linalg.norm(shares @ control[:, 2:], axis=1)))
            middle = np.mean(control[:, :2], axis=0)
            return curve.moved(middle + (control[:, :2] - middle) / radius)
        right = shares.T @ x
        control = np.zeros((n, 2))
        control[[0, -1]] = points[[0, -1]]
        right = (right - matrix @ control)[1:-1]
        control[1:-1] = np.linalg.solve(matrix[1:-1, 1:-1], right)
        return curve.moved(control)


def kept(
    curve: FreeCurve,
    control: Array,
    room: shapely.Geometry,
    clear: shapely.Geometry,
    step: float,
    options: BoundaryOptions = CURVES,
) -> FreeCurve:
    """The curve with these controls (n, 2), moved to the nearest places within ``room``.

    It runs inside the polygon of its controls, so it may still cut into a convex solid, or leave
    the body at a notch: points of it some ``step`` [m] apart that are not in ``clear``, but for
    those at its ends, take their controls there.
    """
    for _ in range(options.keeping):
        control = control + _displacements(control, room)
        moved = curve.moved(np.where(curve.fixed[:, None], curve.control, control))
        # as many in each span, so that mirror images stay alike
        samples = -(-len(moved.sampled(step)) // moved.spans)
        s = np.arange(samples * moved.spans) / samples
        s = s if moved.closed else s[(s > 1.0) & (s < moved.spans - 1.0)]
        displacements = _displacements(moved.at(s), clear)
        out = np.any(displacements, axis=1)
        if np.max(np.abs(displacements), initial=0.0) < 0.01 * step:
            break
        shares = moved.rows(s[out])
        weight = np.maximum(shares.sum(axis=0).A1, 1e-300)
        control = (
            moved.control + options.overshoot * (shares.T @ displacements[out]) / weight[:, None]
        )
    return moved


def _displacements(points: Array, room: shapely.Geometry) -> Array:
    """From points (n, 2) outside a region to the nearest place in it, zero from others [m]."""
    displacements = np.zeros_like(points)
    shapely.prepare(room)
    out = np.flatnonzero(~shapely.contains_xy(room, points))
    if len(out):
        shortest = shapely.shortest_line(room, shapely.points(points[out]))
        ends = shapely.get_coordinates(shortest).reshape(-1, 2, 2)
        displacements[out] = ends[:, 0] - ends[:, 1]
    return displacements
