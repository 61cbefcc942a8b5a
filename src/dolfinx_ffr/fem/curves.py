# SPDX-License-Identifier: MIT
"""Curves in the plane that bound a body: lines, arcs of circles, B-splines.

Each knows its ends exactly, so that curves that follow each other share a point to the last bit.
Areas are exact by Green's theorem,

    A = 1/2 oint (x dy - y dx),   A x_c = 1/2 oint x^2 dy,   A y_c = -1/2 oint y^2 dx.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ..arrays import Array
from .polylines import chord_lengths

#: Gauss' rule by which an arc of at most a quarter circle is integrated, exact to round-off
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
#: Lengths and first derivatives that are nothing but round-off, over the length of their spline
_ROUND_OFF = 1e-9


class ShapeError(ValueError):
    """A shape that has no mesh, or encloses no part, whoever asks for it."""


class CurveError(ShapeError):
    """Curves cross, or are so near each other that no mesh fits them."""


class Curve(ABC):
    """A curve from `start` to `end`."""

    start: Array  #: (2,) [m]
    end: Array  #: (2,) [m]

    @abstractmethod
    def at(self, t: Array) -> Array:
        """Points at parameters from 0 to 1, shape (n, 2) [m]."""

    @abstractmethod
    def slope(self, t: Array) -> Array:
        """Derivatives with respect to the parameter, shape (n, 2) [m]."""

    @abstractmethod
    def reversed(self) -> Curve:
        """The same curve from its end to its start."""

    @abstractmethod
    def breaks(self) -> Array:
        """Parameters between which it is a polynomial, or less than a quarter of a circle."""

    @abstractmethod
    def parameters(self, tolerance: float) -> Array:
        """Parameters between which the chord is nowhere farther away than ``tolerance`` [m]."""

    @abstractmethod
    def moved(self, start: Array, end: Array) -> Curve:
        """The curve between two points next to its ends."""

    @abstractmethod
    def cut(self, cuts: Sequence[float]) -> Sequence[Curve]:
        """The same curve in parts that end at these parameters, which increase from 0 to 1."""

    def pieces(self) -> Sequence[Curve]:
        """The curve in as many parts as OpenCASCADE takes for sure."""
        return [self]

    def points(self, tolerance: float) -> Array:
        """A polygon (n, 2) within ``tolerance``, with vertices on the curve and both ends exact."""
        vertices = self.at(self.parameters(tolerance))
        vertices[0], vertices[-1] = self.start, self.end
        return vertices

    def moments(self) -> Array:
        """The integrals of the module's description: area, and its moments about y and x, (3,)."""
        t, w = self._quadrature
        (x, y), (dx, dy), half = self.at(t).T, self.slope(t).T, 0.5 * w
        return np.array([half @ (x * dy - y * dx), half @ (x * x * dy), -half @ (y * y * dx)])

    @cached_property
    def length(self) -> float:
        """Its length [m]."""
        t, w = self._quadrature
        return float(w @ np.linalg.norm(self.slope(t), axis=1))

    @property
    def _quadrature(self) -> tuple[Array, Array]:
        """Parameters and weights of Gauss' rule between the breaks."""
        ends = self.breaks()
        half = 0.5 * np.diff(ends)
        t = ends[:-1, None] + half[:, None] * (_NODES[None, :] + 1.0)
        return t.ravel(), (half[:, None] * _WEIGHTS[None, :]).ravel()


@dataclass(frozen=True, eq=False)
class Line(Curve):
    """A straight line."""

    start: Array  #: (2,) [m]
    end: Array  #: (2,) [m]

    def at(self, t: Array) -> Array:
        return self.start + np.multiply.outer(t, self.end - self.start)

    def slope(self, t: Array) -> Array:
        return np.tile(self.end - self.start, (len(t), 1))

    def reversed(self) -> Line:
        return Line(self.end, self.start)

    def breaks(self) -> Array:
        return np.array([0.0, 1.0])

    def parameters(self, tolerance: float) -> Array:
        return self.breaks()

    def moved(self, start: Array, end: Array) -> Line:
        return Line(start, end)

    def cut(self, cuts: Sequence[float]) -> list[Line]:
        points = [self.start, *self.at(np.asarray(cuts)), self.end]
        return [Line(a, b) for a, b in pairwise(points)]


@dataclass(frozen=True, eq=False)
class Arc(Curve):
    """An arc of a circle, or a whole circle if start and end are equal."""

    start: Array  #: (2,) [m]
    end: Array  #: (2,) [m]
    center: Array  #: (2,) [m]
    sweep: float  #: Angle from start to end, counterclockwise positive [rad]

    @property
    def radius(self) -> float:
        """Radius of the circle [m]."""
        return float(np.linalg.norm(self.start - self.center))

    @property
    def angle(self) -> float:
        """Angle of the start from the x axis [rad]."""
        return float(np.arctan2(*(self.start - self.center)[::-1]))

    def at(self, t: Array) -> Array:
        angle = self.angle + self.sweep * np.asarray(t)
        return self.center + self.radius * np.column_stack([np.cos(angle), np.sin(angle)])

    def slope(self, t: Array) -> Array:
        angle = self.angle + self.sweep * np.asarray(t)
        return self.sweep * self.radius * np.column_stack([-np.sin(angle), np.cos(angle)])

    def reversed(self) -> Arc:
        return Arc(self.end, self.start, self.center, -self.sweep)

    def breaks(self) -> Array:
        return np.linspace(0.0, 1.0, int(np.ceil(abs(self.sweep) / 1.5)) + 1)

    def parameters(self, tolerance: float) -> Array:
        step = 2.0 * np.arccos(max(1.0 - tolerance / self.radius, 0.5))
        return np.linspace(0.0, 1.0, int(np.ceil(abs(self.sweep) / step)) + 1)

    @staticmethod
    def along(points: Array, center: Array) -> Arc:
        """The arc from the first to the last of points (n, 2) on a circle about ``center``."""
        angles = np.unwrap(np.arctan2(*(points - center).T[::-1]))
        return Arc(points[0], points[-1], center, float(angles[-1] - angles[0]))

    def moved(self, start: Array, end: Array) -> Arc:
        if np.array_equal(start, end):
            full_turn = float(np.copysign(2.0 * np.pi, self.sweep))
            return Arc(start, end, self.center + start - self.start, full_turn)
        # the circle through both ends on which they are as far apart as before
        half = 0.5 * (end - start)
        away = np.array([-half[1], half[0]]) / np.tan(0.5 * self.sweep)
        return Arc(start, end, start + half + away, self.sweep)

    def cut(self, cuts: Sequence[float]) -> list[Arc]:
        t = np.array([0.0, *cuts, 1.0])
        points = [self.start, *self.at(t[1:-1]), self.end]
        sweeps = self.sweep * np.diff(t)
        ends = zip(pairwise(points), sweeps, strict=True)
        return [Arc(a, b, self.center, float(sweep)) for (a, b), sweep in ends]

    def pieces(self) -> list[Arc]:
        n = int(np.ceil(abs(self.sweep) / 2.0))
        return self.cut((np.arange(1, n) / n).tolist())


@dataclass(frozen=True, eq=False)
class Spline(Curve):
    """A B-spline that begins and ends at its first and last control point."""

    knots: Array  #: (n + degree + 1,) from 0 to 1, the first and last degree + 1 alike
    control: Array  #: (n, 2) [m]
    degree: int = 3  #: Of the polynomials

    @property
    def start(self) -> Array:  # type: ignore[override]
        """First point, shape (2,) [m]."""
        return self.control[0]

    @property
    def end(self) -> Array:  # type: ignore[override]
        """Last point, shape (2,) [m]."""
        return self.control[-1]

    @cached_property
    def _curve(self) -> BSpline:
        return BSpline(self.knots, self.control, self.degree)

    def at(self, t: Array) -> Array:
        return np.asarray(self._curve(t))

    def slope(self, t: Array) -> Array:
        return np.asarray(self._curve(t, 1))

    def reversed(self) -> Spline:
        return Spline(1.0 - self.knots[::-1], self.control[::-1], self.degree)

    def breaks(self) -> Array:
        return np.unique(self.knots)

    def moved(self, start: Array, end: Array) -> Spline:
        control = np.array(self.control)
        control[0], control[-1] = start, end
        return Spline(self.knots, control, self.degree)

    def pieces(self) -> list[Spline]:
        if not np.array_equal(self.start, self.end):
            return [self]
        # a closed one in halves, cut at a knot near the middle where there is one
        inner = self.breaks()
        return self.cut([0.5 if len(inner) < 3 else float(inner[len(inner) // 2])])

    def polynomials(self) -> list[Spline]:
        """The same curve as splines of one polynomial each."""
        return self.cut(self.breaks()[1:-1].tolist())

    def with_lines(self) -> list[Curve]:
        """The same curve as splines and lines, with nonzero derivatives at their ends.

        Where the first and second derivatives of a cubic vanish at an end, it is straight up to the
        next knot.
        """
        if self.degree == 1:
            return [Line(start, end) for start, end in pairwise(self.control)]

        breaks = self.breaks()
        nothing = _ROUND_OFF * self.length
        speeds = np.linalg.norm(self.slope(breaks[[0, -1]]), axis=1)
        beside = zip(breaks[[1, -2]].tolist(), speeds, strict=True)
        cuts = {cut for cut, speed in beside if speed < nothing} - {0.0, 1.0}
        return [
            Line(piece.start, piece.end) if piece._is_line(nothing) else piece
            for piece in self.cut(sorted(cuts))
        ]

    def _is_line(self, tolerance: float) -> bool:
        """Whether it goes from its start to its end within a ``tolerance`` of the chord [m]."""
        chord = self.end - self.start
        length = float(np.hypot(*chord))
        if length == 0.0:
            return False
        offsets = self.control - self.start
        across = offsets @ np.array([-chord[1], chord[0]]) / length
        forward = np.diff(offsets @ chord / length)
        return bool(np.max(np.abs(across)) < tolerance and np.min(forward) > -tolerance)

    def cut(self, cuts: Sequence[float]) -> list[Spline]:
        pieces = []
        for a, b in pairwise([0.0, *cuts, 1.0]):
            inside = self.knots[(self.knots > a) & (self.knots < b)]
            ones = np.ones(self.degree + 1)
            knots = np.concatenate([0.0 * ones, (inside - a) / (b - a), ones])
            pieces.append(Spline.of(self.at, knots, self.degree, (a, b)))
        pieces[0].control[0], pieces[-1].control[-1] = self.start, self.end
        for piece, following in pairwise(pieces):
            following.control[0] = piece.end
        return pieces

    @staticmethod
    def of(
        function: Callable[[Array], Array],
        knots: Array,
        degree: int,
        interval: tuple[float, float] = (0.0, 1.0),
    ) -> Spline:
        """The spline on given knots that a part of a function of parameters, to (n, 2), is."""
        # Greville's points, at which a spline is determined by its values
        greville = np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree).mean(axis=1)
        values = function(interval[0] + (interval[1] - interval[0]) * greville)
        spline = make_interp_spline(greville, values, k=degree, t=knots)
        return Spline(knots, np.array(spline.c), degree)

    @staticmethod
    def through(points: Array) -> Spline:
        """A cubic spline through at least four points (n, 2) on a smooth curve [m]."""
        spline = make_interp_spline(chord_lengths(points), points, k=3)
        control = np.array(spline.c)
        control[0], control[-1] = points[0], points[-1]
        return Spline(np.asarray(spline.t), control, 3)

    @staticmethod
    def around(points: Array) -> Spline:
        """A closed cubic spline, smooth everywhere, around points (n, 2) on a curve [m]."""
        ring = np.vstack([points, points[:1]])
        t = chord_lengths(ring)
        periodic = make_interp_spline(t, ring, k=3, bc_type="periodic")
        spline = Spline.of(periodic, np.concatenate([np.zeros(3), t, np.ones(3)]), 3)
        spline.control[0] = spline.control[-1] = ring[0]
        return spline

    def parameters(self, tolerance: float) -> Array:
        ends = self.breaks()
        if self.degree == 1:
            return ends
        # the second derivative of a cubic is largest at an end of each span
        inside = 1e-9 * np.diff(ends)
        bend = self._curve.derivative(2)
        sides = np.stack([bend(ends[:-1] + inside), bend(ends[1:] - inside)])
        largest = np.max(np.linalg.norm(sides, axis=2), axis=0)
        if self.degree > 3:
            middle = bend(0.5 * (ends[1:] + ends[:-1]))
            largest = np.maximum(largest, np.linalg.norm(middle, axis=1))
        counts = np.ceil(np.diff(ends) * np.sqrt(largest / (8.0 * tolerance))).astype(int)
        counts = np.maximum(counts, 1)
        within = np.arange(np.sum(counts)) - np.repeat(np.cumsum(counts) - counts, counts)
        steps = np.repeat(np.diff(ends) / counts, counts)
        return np.append(within * steps + np.repeat(ends[:-1], counts), ends[-1])


@dataclass(frozen=True, eq=False)
class Drawn:
    """A curve of a drawing."""

    curve: Curve  #: In metres
    names: frozenset[str]  #: Its layer, and the layers of curves that lie on it
    #: Name of its line type if it has gaps, as those of centre lines and hidden edges, or ""
    line_type: str = ""


def enclosed(loop: Sequence[Curve]) -> Array:
    """Area that a closed loop encloses, counterclockwise positive, and its moments, (3,)."""
    return np.sum([curve.moments() for curve in loop], axis=0)


def polygon(loop: Sequence[Curve], tolerance: float) -> Array:
    """The vertices (n, 2) of a closed loop within ``tolerance``, the first one not repeated [m]."""
    return np.concatenate([curve.points(tolerance)[:-1] for curve in loop])
