# SPDX-License-Identifier: MIT
"""Smooth curves through points: splines of as few knots as a tolerance allows.

The smoothing spline is that of P. Dierckx, Computer Graphics and Image Processing 20 (1982),
doi:10.1016/0146-664X(82)90043-0, by FITPACK in SciPy.
"""

from __future__ import annotations

import warnings

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline, splprep

from ..arrays import Array
from ..fem import Curve, Line, ShapeError, Spline, chord_lengths, cross, turns
from .field import Field, evaluated
from .options import CURVES

_AXES = np.eye(2)


def thinned(points: Array, least: float) -> Array:
    """Both ends of a chain of points (n, 2), and those between that are ``least`` apart [m]."""
    chosen = [0]
    for i in range(1, len(points) - 1):
        near_end = np.hypot(*(points[-1] - points[i])) < least
        if not near_end and np.hypot(*(points[i] - points[chosen[-1]])) >= least:
            chosen.append(i)
    return points[[*chosen, len(points) - 1]]


def corners(points: Array, field: Field, *, closed: bool) -> tuple[Array, list[int]]:
    """A chain of zeros of a field with its corners added, shape (m, 2) [m], and their numbers.

    A side of the chain cuts a corner off. It is where the sides before and after it would meet, if
    the field there is much nearer to zero than in the middle of the side; on a smooth curve it is
    not. Ends are no corners; of a closed chain, whose last point is the first, 0 stands for both.
    """
    ring = np.vstack([points[-2:-1], points, points[1:3]]) if closed else points
    d = np.diff(ring, axis=0)
    turn = turns(d)
    n, shift = len(points) - 1, 1 if closed else 0
    # side i + 1 of the ring, between the vertices i + 1 and i + 2, with the sides i and i + 2
    turn_at_side = np.abs(turn[:-1] + turn[1:])
    sharp = (np.abs(turn) > CURVES.corner).nonzero()[0] + 1 - shift
    candidate = np.flatnonzero(turn_at_side > CURVES.corner)
    # a chain that turns back on itself has sides that never meet
    area = np.abs(cross(d[candidate], d[candidate + 2]))
    lengths = np.linalg.norm(d[candidate], axis=1) * np.linalg.norm(d[candidate + 2], axis=1)
    candidate = candidate[area > 1e-3 * lengths]
    cut_off, added = np.zeros(0, dtype=np.int64), np.zeros((0, 2))
    if len(candidate):
        p, q = ring[candidate + 1], ring[candidate + 2]
        side_before, side_after = d[candidate], d[candidate + 2]
        s = cross(q - p, side_after) / cross(side_before, side_after)
        meeting = p + s[:, None] * side_before
        ahead = (s > 0.0) & (np.einsum("ij,ij->i", q - meeting, side_after) > 0.0)
        near = np.linalg.norm(meeting - p, axis=1) < 2.0 * np.linalg.norm(q - p, axis=1)
        values = np.abs(evaluated(field, np.vstack([meeting, 0.5 * (p + q)])))
        at_meeting, at_middle = values.reshape(2, -1)
        accepted = ahead & near & (at_meeting < 0.2 * at_middle)
        # of neighbours the side that turns most
        for i in np.flatnonzero(accepted):
            beside = accepted & (np.abs(candidate - candidate[i]) == 1)
            turns_more = turn_at_side[candidate[beside]] > turn_at_side[candidate[i]]
            accepted[i] = not np.any(turns_more)
        sides = candidate[accepted] + 1
        if closed:
            sides = (sides - shift) % n
        cut_off, first = np.unique(sides, return_index=True)
        added = meeting[accepted][first]
    ends = np.concatenate([cut_off, cut_off + 1])
    if closed:
        ends, sharp = ends % n, sharp % n
    sharp = np.setdiff1d(sharp, ends)
    at_sharp = sharp + np.searchsorted(cut_off, sharp)
    at_added = cut_off + 1 + np.arange(len(cut_off))
    return np.insert(points, cut_off + 1, added, axis=0), sorted(map(int, [*at_sharp, *at_added]))


def followed(points: Array, field: Field, tolerance: float, *, closed: bool = False) -> Curve:
    """A curve through points (n, 2) on the zero line of a field, and through more where it bends.

    The tolerance is its largest distance from the zero line [m]; a closed one has no corner where
    it closes.
    """
    # the line may pass through a corner of the lattice, which two of its cells then find
    is_new = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-3 * tolerance
    points = points[np.append(True, is_new)] if np.any(is_new) else points
    least_points = 6 if closed else 3
    rounds = CURVES.rounds if len(points) > least_points else 0
    for _ in range(rounds):
        u = chord_lengths(points)
        spline = make_interp_spline(u, points, k=3, bc_type="periodic" if closed else None)
        between = spline(0.5 * (u[1:] + u[:-1]))
        reach = 0.2 * np.linalg.norm(np.diff(points, axis=0), axis=1)
        zeros = projected(between, field, reach)
        distance = np.linalg.norm(zeros - between, axis=1)
        is_off = (distance > tolerance) & (distance < reach)
        if not np.any(is_off):
            break
        points = np.insert(points, np.flatnonzero(is_off) + 1, zeros[is_off], axis=0)
    return fitted(points, tolerance, closed=closed)


def projected(points: Array, field: Field, reach: Array) -> Array:
    """The points of the zero line next to given ones (n, 2), by Newton's method.

    They are no farther than ``reach`` (n,) [m]; differences are taken over a thousandth of it.
    """
    x = points.copy()
    h = 1e-3 * reach[:, None]
    for _ in range(2):
        around = [x, *(x + side * h * e for e in _AXES for side in (1.0, -1.0))]
        value, right, left, up, down = evaluated(field, np.vstack(around)).reshape(5, -1)
        slope = np.column_stack([right - left, up - down]) / (2.0 * h)

        # Newton's step along the slope is the value over the square of the slope, times the slope
        square = np.einsum("ij,ij->i", slope, slope)
        divisor = np.where(square > 0.0, square, 1.0)
        steps = np.where(square > 0.0, value / divisor, 0.0)
        # no farther than asked for, where the slope is next to nothing
        longest = reach / np.sqrt(divisor)
        x = x - np.clip(steps, -longest, longest)[:, None] * slope
    return x


def fitted(points: Array, tolerance: float, *, closed: bool = False) -> Curve:
    """A curve from the first to the last of points (n, 2), at most a tolerance [m] from all."""
    start, end = points[0], points[-1]
    chord = end - start
    length = float(np.hypot(*chord))
    if not closed and length > 0.0:
        normal = np.array([-chord[1], chord[0]]) / length
        along = (points - start) @ chord
        if np.max(np.abs((points - start) @ normal)) <= tolerance and np.all(np.diff(along) > 0.0):
            return Line(start, end)
    if not np.any(np.ptp(points, axis=0)):
        x, y = 1e3 * start
        raise ShapeError(
            f"part: the zero line has a piece without length near ({x:.6g}, {y:.6g}) mm; give "
            "another resolution"
        )
    u = chord_lengths(points)
    if closed and len(points) < 6:  # a speck: its polygon
        return Spline(np.concatenate([[0.0], u, [1.0]]), points.copy(), 1)
    degree = min(3, len(points) - 1)
    weights = np.ones(len(points))
    if not closed:
        weights[[0, -1]] = 1e3
    for share in CURVES.smoothing:
        smoothing = len(points) * (share * tolerance) ** 2
        with warnings.catch_warnings():
            # more knots than it likes; the distance is looked at here
            warnings.simplefilter("ignore")
            (knots, coefficients, k), _ = splprep(
                points.T, w=weights, u=u, s=smoothing, k=degree, per=closed
            )
        spline = BSpline(knots, np.transpose(coefficients), k)
        if np.max(np.linalg.norm(spline(u) - points, axis=1)) <= tolerance:
            break
    return _clamped(spline, start, end)


def _clamped(spline: BSpline, start: Array, end: Array) -> Spline:
    """The ``spline`` with clamped knots on [0, 1], from ``start`` to ``end``, (2,) each."""
    k = spline.k
    inner = spline.t[(spline.t > 1e-12) & (spline.t < 1.0 - 1e-12)]
    knots = np.concatenate([np.zeros(k + 1), inner, np.ones(k + 1)])
    clamped = Spline.of(spline, knots, k)
    clamped.control[0], clamped.control[-1] = start, end
    return clamped
