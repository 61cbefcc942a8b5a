# SPDX-License-Identifier: MIT
"""Curves that move: uniform cubic B-splines, closed or between two points that stay."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from scipy.sparse import csr_matrix

from ..arrays import Array, Integers, Mask
from ..fem import Spline
from .options import CURVES

#: Parameters in a span at which the curvature is evaluated: where controls are near each other it
#: changes within a small share of a radius
_BENDS = 32
#: Points for each control to which a curve is fitted: a curve with fewer would miss them
_DENSE = 16
#: Points and weights of Gauss: three integrate polynomials of degree 5
_GAUSS = np.polynomial.legendre.leggauss(3)


class Bending(NamedTuple):
    """Curvature and derivatives of a curve at some parameters."""

    curvature: Array  #: (points,) [1/m]
    slope: Array  #: First derivative by the parameter, (points, 2) [m]
    bend: Array  #: Second derivative, (points, 2) [m]
    speed: Array  #: Length of the first derivative, infinite where it vanishes, (points,) [m]


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

    # ------------------------------------------------------------------ at parameters

    def _basis(self, s: Array, derivative: int) -> tuple[Array, Integers]:
        """Values of the four B-splines at parameters, and numbers of their controls, (points, 4).

        Or a ``derivative`` by the parameter.
        """
        n, spans = len(self.control), self.spans
        span = np.clip(np.floor(s).astype(np.int64), 0, spans - 1)
        t = np.asarray(s) - span
        u = 1.0 - t
        if derivative == 0:
            cube = t**3
            basis = [u**3, 3 * cube - 6 * t**2 + 4, -3 * cube + 3 * t**2 + 3 * t + 1, cube]
        elif derivative == 1:
            basis = [-3 * u**2, 9 * t**2 - 12 * t, -9 * t**2 + 6 * t + 3, 3 * t**2]
        else:
            basis = [6 * u, 18 * t - 12, 6 - 18 * t, 6 * t]

        if self.closed:
            controls = np.arange(n + 3) % n
        else:  # the first and the last one count three times
            controls = np.clip(np.arange(n + 4) - 2, 0, n - 1)
        return np.stack(basis, axis=1) / 6.0, controls[span[:, None] + np.arange(4)]

    def rows(self, s: Array, derivative: int = 0) -> csr_matrix:
        """Weights of the controls in points at parameters, or in a derivative, (points, n)."""
        weights, controls = self._basis(s, derivative)
        row_starts = np.arange(0, 4 * len(weights) + 1, 4)
        shape = len(weights), len(self.control)
        return csr_matrix((weights.ravel(), controls.ravel(), row_starts), shape)

    def at(self, s: Array, derivative: int = 0) -> Array:
        """Points at parameters from 0 to `spans`, or a derivative, shape (points, 2) [m]."""
        weights, controls = self._basis(s, derivative)
        return np.einsum("pk,pkd->pd", weights, self.control[controls])

    def normals(self, s: Array) -> Array:
        """Unit normals out of the material, shape (points, 2)."""
        slope = self.at(s, 1)
        normal = np.column_stack([slope[:, 1], -slope[:, 0]])
        return normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]

    def bending(self, s: Array) -> Bending:
        """Curvature and derivatives at parameters (points,)."""
        slope, bend = (self.at(s, order) for order in (1, 2))
        speed = np.linalg.norm(slope, axis=1)
        # at the ends of an open curve, where it is straight, the first derivative vanishes
        speed[speed < 1e-6 * np.max(speed)] = np.inf
        curvature = (slope[:, 0] * bend[:, 1] - slope[:, 1] * bend[:, 0]) / speed**3
        return Bending(curvature, slope, bend, speed)

    @property
    def smallest_radius(self) -> float:
        """The smallest radius of curvature [m]."""
        s = np.linspace(0.0, self.spans, _BENDS * self.spans + 1)
        return 1.0 / max(float(np.max(np.abs(self.bending(s).curvature))), 1e-300)

    @property
    def peaks(self) -> Array:
        """Parameters at which each control weighs most, shape (n,)."""
        n = len(self.control)
        if self.closed:
            return (np.arange(n) - 1.0) % n
        s = np.arange(n) + 1.0
        s[[0, -1]] = 0.0, self.spans
        return s

    @cached_property
    def control_normals(self) -> Array:
        """Normals of the curve where each control weighs most, shape (n, 2)."""
        return self.normals(self.peaks)

    @cached_property
    def area(self) -> tuple[float, Array]:
        """The area on its left [m^2] but for a constant, and its slopes by offsets (n,) [m]."""
        t, weights = _GAUSS
        s = (np.arange(self.spans)[:, None] + 0.5 + 0.5 * t).ravel()
        weights = np.tile(0.5 * weights, self.spans)
        (x, y), (dx, dy) = (self.at(s, order).T for order in (0, 1))
        by_control = self.rows(s).T @ (weights[:, None] * np.column_stack([dy, -dx]))
        slopes = np.einsum("kd,kd->k", by_control, self.control_normals)
        return 0.5 * float(weights @ (x * dy - y * dx)), slopes

    def sampled(self, step: float, per_span: int = 4) -> Array:
        """Parameters of points about ``step`` [m] apart at most, ``per_span`` or more in a span."""
        fine = self.at(np.linspace(0.0, self.spans, 8 * self.spans + 1))
        length = float(np.linalg.norm(np.diff(fine, axis=0), axis=1).sum())
        count = max(math.ceil(length / step), per_span * self.spans)
        return np.linspace(0.0, self.spans, count, endpoint=False)

    def bend_parameters(self, step: float) -> Array:
        """Parameters of points about ``step`` [m] apart at most that show each bend, (points,)."""
        return self.sampled(step, _BENDS)

    def nearest(self, points: Array, start: Array) -> Array:
        """Parameters of the curve's points nearest to ``points``, by Newton's method.

        It begins at parameters ``start``. Shapes: (n, 2), (n,), (n,).
        """
        s = start
        for _ in range(5):
            tangent = self.at(s, 1)
            tangential = np.einsum("ij,ij->i", points - self.at(s), tangent)
            s = s + tangential / np.maximum(np.einsum("ij,ij->i", tangent, tangent), 1e-300)
            s = s % self.spans if self.closed else np.clip(s, 0.0, self.spans)
        return s

    # ------------------------------------------------------------------ other curves

    def moved(self, control: Array) -> FreeCurve:
        """The same curve with other controls."""
        return replace(self, control=control)

    def spline(self) -> Spline:
        """The same curve in the form that drawings have."""
        spans = self.spans
        ends = np.ones(4)
        knots = np.concatenate([0.0 * ends, np.arange(1, spans) / spans, ends])
        spline = Spline.of(lambda t: self.at(np.asarray(t) * spans), knots, 3)
        # ends that meet are the same to the last bit
        if self.closed:
            spline.control[-1] = spline.control[0]
        else:
            spline.control[0], spline.control[-1] = self.control[0], self.control[-1]
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
        vertices = np.vstack([points, points[:1]]) if closed else points
        chords = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
        arc_length = np.concatenate([[0.0], np.cumsum(chords)])
        length = float(arc_length[-1])
        n = max(round(length / spacing), 5 if closed else 3)
        n = math.ceil(n / multiple) * multiple
        curve = FreeCurve(np.zeros((n, 2)), nodes)

        t = np.linspace(0.0, 1.0, _DENSE * n, endpoint=not closed)
        samples = np.column_stack(
            [np.interp(t * length, arc_length, vertices[:, i]) for i in (0, 1)]
        )
        weights = curve.rows(t * curve.spans)
        identity = np.eye(n)
        differences = np.roll(identity, 1, axis=0) + np.roll(identity, -1, axis=0) - 2.0 * identity
        if not closed:
            differences[[0, -1]] = 0.0
        # second differences of the controls weigh as much as the points: steps along the elements
        # of a mesh go, members stay where they are
        matrix = (weights.T @ weights).toarray() + _DENSE * differences.T @ differences
        if closed:
            return curve.moved(_fitted_ring(weights, matrix, samples, t))
        return curve.moved(_fitted_between(weights, matrix, samples, points[[0, -1]]))


def _fitted_ring(weights: csr_matrix, matrix: Array, samples: Array, t: Array) -> Array:
    """Controls of a closed curve by the normal equations, (n, 2) [m].

    Smoothing shrinks a curve of few controls by a factor, which a circle has, too.
    """
    angle = 2.0 * np.pi * t
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    control = np.linalg.solve(matrix, weights.T @ np.hstack([samples, circle]))
    shrinking = float(np.mean(np.linalg.norm(weights @ control[:, 2:], axis=1)))
    center = np.mean(control[:, :2], axis=0)
    return np.asarray(center + (control[:, :2] - center) / shrinking)


def _fitted_between(weights: csr_matrix, matrix: Array, samples: Array, ends: Array) -> Array:
    """Controls of a curve between two ends (2, 2) by the normal equations, (n, 2) [m]."""
    control = np.zeros((len(matrix), 2))
    control[[0, -1]] = ends
    right = (weights.T @ samples - matrix @ control)[1:-1]
    control[1:-1] = np.linalg.solve(matrix[1:-1, 1:-1], right)
    return control


def confined(
    curve: FreeCurve,
    control: Array,
    control_region: shapely.Geometry,
    curve_region: shapely.Geometry,
    step: float,
) -> FreeCurve:
    """The curve with these controls (n, 2), moved to the nearest places within two regions.

    It runs inside the polygon of its controls, so it may still cut into a convex solid, or leave
    the body at a notch. So points of it some ``step`` [m] apart that are outside the
    ``curve_region``, but for those at its ends, take their controls along as they move into it.
    """
    for _ in range(CURVES.confinements):
        control = control + _displacements(control, control_region)
        moved = curve.moved(np.where(curve.fixed[:, None], curve.control, control))
        s = _inner_parameters(moved, step)
        displacements = _displacements(moved.at(s), curve_region)
        if np.max(np.abs(displacements), initial=0.0) < 0.01 * step:
            break
        outside = np.any(displacements, axis=1)
        weights = moved.rows(s[outside])
        total_weight = np.maximum(weights.sum(axis=0).A1, 1e-300)
        motion = (weights.T @ displacements[outside]) / total_weight[:, None]
        control = moved.control + CURVES.overshoot * motion
    return moved


def _inner_parameters(curve: FreeCurve, step: float) -> Array:
    """Parameters of points about ``step`` [m] apart that are not in a span at an end.

    They are as many in each span, so that mirror images stay alike.
    """
    per_span = math.ceil(len(curve.sampled(step)) / curve.spans)
    s = np.arange(per_span * curve.spans) / per_span
    return s if curve.closed else s[(s > 1.0) & (s < curve.spans - 1.0)]


def _displacements(points: Array, region: shapely.Geometry) -> Array:
    """From points (n, 2) outside a region to the nearest place in it, zero from others [m]."""
    displacements = np.zeros_like(points)
    shapely.prepare(region)
    outside = np.flatnonzero(~shapely.contains_xy(region, points))
    if len(outside):
        shortest = shapely.shortest_line(region, shapely.points(points[outside]))
        ends = shapely.get_coordinates(shortest).reshape(-1, 2, 2)
        displacements[outside] = ends[:, 0] - ends[:, 1]
    return displacements
