# SPDX-License-Identifier: MIT
"""Laws of motion: value, velocity and acceleration of a coordinate, in the classes behind `Motion`.

Each is a class whose methods are these three functions of an array of times; methods can be
pickled, functions within a function cannot. Derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
import scipy.linalg
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, make_interp_spline

from .. import validation
from ..arrays import Array, Mask

#: Numbers that define something, (numbers,), and its other properties; None if these are not known
Stated: TypeAlias = tuple[Array, Hashable]
_Derivative = tuple[Array, Mask, Mask]

#: Motions at an end of a spline
ENDS = ("rest", "uniform", "natural")
#: Degrees of splines; with lower ones accelerations have kinks
DEGREES = (5, 7)
#: Part of a spline's length by which times may be outside of it, which allows for round-off
_SLACK = 1e-9
#: Smallest distance of two values of a spline, as a part of its length: at 1e-8 round-off takes
#: half of the digits of accelerations, at 1e-9 all digits of values
_NEAREST = 1e-7
#: Largest number of entries in the matrix of a fit, 160 MB
_LARGEST_FIT = 20_000_000
#: Largest number of instants for which the values of B-splines are stored
_MOST_STORED = 20_000
#: Largest number of values of a spline whose coefficients a matrix gives
_MOST_VALUES = 400


class Law(Protocol):
    """The interface of laws and motions."""

    @property
    def value(self) -> Callable[[Array], ArrayLike]:
        """The coordinate as a function of times (n,)."""

    @property
    def velocity(self) -> Callable[[Array], ArrayLike]:
        """Its first derivative."""

    @property
    def acceleration(self) -> Callable[[Array], ArrayLike]:
        """Its second derivative."""

    def stated(self) -> Stated:
        """The numbers that define it, (numbers,), and its other properties; None if not known."""

    def pullback(self, t: Array, bars: Array) -> Array:
        """Derivatives by the numbers from derivatives by the functions at times (n,), (3, n)."""


class OutsideError(ValueError):
    """A time at which a law is not known."""


class _Formula:
    """A law whose three functions are one function, `at`, of the order of the derivative."""

    def at(self, order: int, t: Array) -> Array:
        raise NotImplementedError

    def value(self, t: Array) -> Array:
        return self.at(0, t)

    def velocity(self, t: Array) -> Array:
        return self.at(1, t)

    def acceleration(self, t: Array) -> Array:
        return self.at(2, t)


@dataclass(frozen=True)
class SmoothStep(_Formula):
    """Rest-to-rest motion, a polynomial of degree 5."""

    distance: float
    duration: float
    start: float

    def stated(self) -> Stated:
        return np.array([self.distance]), (SmoothStep, self.duration, self.start)

    def pullback(self, t: Array, bars: Array) -> Array:
        unit = replace(self, distance=1.0)
        return np.array([np.vdot(bars, [unit.value(t), unit.velocity(t), unit.acceleration(t)])])

    def at(self, order: int, t: Array) -> Array:
        x = np.minimum(np.maximum((np.asarray(t) - self.start) / self.duration, 0.0), 1.0)
        if order == 0:
            return self.distance * x**3 * (10.0 + x * (-15.0 + 6.0 * x))
        if order == 1:
            return self.distance / self.duration * 30.0 * (x * (1.0 - x)) ** 2
        return self.distance / self.duration**2 * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)


@dataclass(frozen=True, eq=False)
class Polynomial(_Formula):
    """A polynomial of time."""

    coefficients: Array  #: (coefficients,)

    def at(self, order: int, t: Array) -> Array:
        return polynomial.polyval(t, polynomial.polyder(self.coefficients, order))

    def stated(self) -> Stated:
        return self.coefficients, (Polynomial, self.coefficients.size)

    def pullback(self, t: Array, bars: Array) -> Array:
        k = np.arange(self.coefficients.size)
        powers = np.asarray(t)[:, None] ** k
        gradient = bars[0] @ powers
        gradient[1:] += k[1:] * (bars[1] @ powers[:, :-1])
        gradient[2:] += (k * (k - 1))[2:] * (bars[2] @ powers[:, :-2])
        return gradient


@dataclass(frozen=True, eq=False)
class Fourier(_Formula):
    """A mean and the harmonics of a period."""

    mean: float
    cosines: Array  #: (harmonics,)
    sines: Array  #: (harmonics,)
    rates: Array  #: (harmonics,) angular frequencies [rad/s]

    def at(self, order: int, t: Array) -> Array:
        mean, cosines, sines = self.mean, self.cosines, self.sines
        for _ in range(order):
            mean, cosines, sines = 0.0, self.rates * sines, -self.rates * cosines
        phase = np.multiply.outer(np.asarray(t), self.rates)
        return np.asarray(mean + (np.cos(phase) @ cosines + np.sin(phase) @ sines))

    def stated(self) -> Stated:
        numbers = np.concatenate([[self.mean], self.cosines, self.sines])
        return numbers, (Fourier, self.rates.tobytes())

    def pullback(self, t: Array, bars: Array) -> Array:
        phase = np.multiply.outer(np.asarray(t), self.rates)
        (c, rate, bend), (s, rise, dip) = bars @ np.cos(phase), bars @ np.sin(phase)
        cosines = c - self.rates * rise - self.rates**2 * bend
        sines = s + self.rates * rate - self.rates**2 * dip
        return np.concatenate([[np.sum(bars[0])], cosines, sines])


@dataclass(frozen=True, eq=False)
class Combined(_Formula):
    """Weighted sum of laws."""

    terms: tuple[tuple[float, Law], ...]

    def stated(self) -> Stated:
        stated = [law.stated() for _, law in self.terms]
        numbers, fixed = [n for n, _ in stated], tuple(f for _, f in stated)
        weights = [weight for weight, _ in self.terms]
        return np.concatenate([weights, *numbers]), None if None in fixed else (Combined, fixed)

    def pullback(self, t: Array, bars: Array) -> Array:
        weights = [
            np.vdot(bars, [np.broadcast_to(function(t), t.shape) for function in _parts(law)])
            for _, law in self.terms
        ]
        laws = [law.pullback(t, weight * bars) for weight, law in self.terms]
        return np.concatenate([weights, *laws])

    def at(self, order: int, t: Array) -> Array:
        values = (weight * np.asarray(_parts(law)[order](t)) for weight, law in self.terms)
        return sum(values, np.zeros(np.shape(t)))


@dataclass(frozen=True, eq=False)
class Composed(_Formula):
    """A law as a function of another one."""

    outer: Law
    inner: Law

    def at(self, order: int, t: Array) -> Array:
        x = np.array(np.broadcast_to(np.asarray(self.inner.value(t)), np.shape(t)))
        if order == 0:
            return np.asarray(self.outer.value(x))
        slope, rate = np.asarray(self.outer.velocity(x)), np.asarray(self.inner.velocity(t))
        if order == 1:
            return slope * rate
        bend = np.asarray(self.outer.acceleration(x)) * rate**2
        return bend + slope * np.asarray(self.inner.acceleration(t))


@dataclass(frozen=True, eq=False)
class OnCircle(_Formula):
    """A coordinate that turns with an angle, middle + cosine cos(angle) + sine sin(angle)."""

    middle: float
    cosine: float
    sine: float
    angle: Law

    def stated(self) -> Stated:
        numbers, fixed = self.angle.stated()
        all_numbers = np.array([self.middle, self.cosine, self.sine, *numbers])
        return all_numbers, fixed and (OnCircle, fixed)

    def at(self, order: int, t: Array) -> Array:
        phi = self.angle.value(t)
        if order == 0:
            return self.middle + _wave(self.cosine, self.sine, phi)
        slope, rate = _wave(self.sine, -self.cosine, phi), np.asarray(self.angle.velocity(t))
        if order == 1:
            return slope * rate
        growth = np.asarray(self.angle.acceleration(t))
        return slope * growth - _wave(self.cosine, self.sine, phi) * rate**2

    def pullback(self, t: Array, bars: Array) -> Array:
        phi, rate, growth = (
            np.broadcast_to(function(t), t.shape) for function in _parts(self.angle)
        )
        c, s = np.cos(phi), np.sin(phi)
        slope, curvature = self.sine * c - self.cosine * s, -self.cosine * c - self.sine * s
        # Value, velocity, acceleration are g, g' phi', g'' phi'^2 + g' phi'' of g = c, s
        by_cosine = bars[0] * c - bars[1] * s * rate - bars[2] * (c * rate**2 + s * growth)
        by_sine = bars[0] * s + bars[1] * c * rate + bars[2] * (c * growth - s * rate**2)
        by_numbers = np.array([np.sum(bars[0]), np.sum(by_cosine), np.sum(by_sine)])
        of_angle = np.array(
            [
                bars[0] * slope
                + bars[1] * curvature * rate
                + bars[2] * (curvature * growth - slope * rate**2),
                bars[1] * slope + 2.0 * bars[2] * curvature * rate,
                bars[2] * slope,
            ]
        )
        return np.concatenate([by_numbers, self.angle.pullback(t, of_angle)])


def _wave(cosine: float, sine: float, phi: ArrayLike) -> Array:
    """The sum of a cosine and a sine of angles (n,); mostly one of the amplitudes is zero."""
    waves = [a * f(phi) for a, f in ((cosine, np.cos), (sine, np.sin)) if a]
    return sum(waves[1:], waves[0]) if waves else np.zeros(np.shape(phi))


def _parts(law: Law) -> tuple[Callable[[Array], ArrayLike], ...]:
    """The three functions of a law."""
    return law.value, law.velocity, law.acceleration


class _LinearMap(NamedTuple):
    """Matrices from the values of a spline to coefficients of B-splines, by order of derivative."""

    fixed: Hashable  #: Places of the values, degree and ends, on which the matrices depend
    knots: tuple[Array, Array, Array]
    degrees: tuple[int, int, int]
    matrices: tuple[Array, Array, Array]  #: (coefficients, values) each


@dataclass(frozen=True, eq=False)
class Spline(_Formula):
    """A spline over time, which goes on beyond its ends at rest, uniformly or periodically."""

    start: float  #: Time of the first value [s]
    unit: float  #: Time for which one unit of the splines' variable stands [s]
    length: float  #: Length of the splines in these units
    ends: tuple[str, str]
    source: BSpline | Array  #: The spline, or the values from which ``linear_map`` makes it
    linear_map: _LinearMap | None = None
    #: By order of the derivative the last times, and the derivative there
    _cache: dict[int, tuple[Array, _Derivative]] = field(
        default_factory=dict, init=False, repr=False
    )

    @cached_property
    def parts(self) -> list[BSpline]:
        """The spline and its derivatives by the variable."""
        if self.linear_map is None:
            assert isinstance(self.source, BSpline)
            return [self.source, self.source.derivative(1), self.source.derivative(2)]
        _, *by_order = self.linear_map
        return [
            BSpline.construct_fast(t, m @ self.source, k) for t, k, m in zip(*by_order, strict=True)
        ]

    def stated(self) -> Stated:
        if self.linear_map is None:
            return np.zeros(0), None
        return np.asarray(self.source), (
            Spline,
            self.start,
            self.unit,
            self.ends,
            self.linear_map.fixed,
        )

    def pullback(self, t: Array, bars: Array) -> Array:
        assert self.linear_map is not None
        gradient = np.zeros(self.linear_map.matrices[0].shape[1])
        for order, (bar, matrix) in enumerate(zip(bars, self.linear_map.matrices, strict=True)):
            _, *sides = self._derivative(order, t)
            bar = np.where(self._at_rest(order, sides), 0.0, bar)
            rows = self._rows(order, t)
            gradient += (rows.T @ bar) @ matrix[: rows.shape[1]] / self.unit**order
            for end, beyond, edge in zip(self.ends, sides, self._edges, strict=True):
                if order == 0 and end == "uniform" and np.any(bar[beyond]):
                    beyond_bar = np.array([bar[beyond] @ (np.asarray(t)[beyond] - edge)])
                    gradient += self.pullback(
                        np.array([edge]), np.array([0.0 * beyond_bar, beyond_bar, 0.0 * beyond_bar])
                    )
        return gradient

    @property
    def _edges(self) -> tuple[float, float]:
        """Times of the ends [s]."""
        return self.start, self.start + self.length * self.unit

    @property
    def jumps(self) -> tuple[float, ...]:
        """Times at which the law changes over to rest or to a uniform motion [s]."""
        edges_and_ends = zip(self._edges, self.ends, strict=True)
        return tuple(t for t, end in edges_and_ends if end in ("rest", "uniform"))

    def _derivative(self, order: int, t: Array) -> _Derivative:
        """Derivative by t of the spline at times (n,), and masks of times before and after it.

        Beyond an end it is the derivative at this end. The last result is stored, as a crank's pin
        asks for the same angle many times.
        """
        stored = self._cache.get(order)
        if stored is None or not np.array_equal(stored[0], t):
            stored = self._cache[order] = np.array(t), self._evaluate(order, t)
        values, below, above = stored[1]
        return values.copy(), below, above

    def _variable(self, t: Array) -> tuple[Array, Array]:
        """The spline's variable at times, and this variable clipped to the spline, (n,) each."""
        x = (np.asarray(t, dtype=np.float64) - self.start) / self.unit
        if self.ends[0] == "periodic":
            x = np.mod(x, self.length)
        return x, np.clip(x, 0.0, self.length)

    def _rows(self, order: int, t: Array) -> Any:
        """The B-splines of the derivative of this ``order`` at times (n,).

        A sparse matrix with a row for each time and a column for each B-spline.
        """
        derivative = self.parts[order]
        return _basis(derivative.t.tobytes(), derivative.k, self._variable(t)[1].tobytes())

    def _evaluate(self, order: int, t: Array) -> _Derivative:
        """The result of `_derivative`, computed anew."""
        x, inside = self._variable(t)
        slack = _SLACK * self.length
        for end_kind, beyond in zip(self.ends, (x < -slack, x > self.length + slack), strict=True):
            if end_kind == "natural" and np.any(beyond):
                start, end = self._edges
                raise OutsideError(
                    f"is defined from {start:.6g} s to {end:.6g} s, not at t = "
                    f"{np.asarray(t)[beyond][0]:.6g} s; give values at later or earlier times, or "
                    'ends="rest", "uniform" or "periodic"'
                )
        derivative = self.parts[order]
        if inside.ndim == 1 and inside.size <= _MOST_STORED:
            basis = self._rows(order, t)
            values = basis @ derivative.c[: basis.shape[1]] / self.unit**order
        else:
            values = np.asarray(derivative(inside), dtype=np.float64) / self.unit**order
        return values, x < 0.0, x > self.length

    def at(self, order: int, t: Array) -> Array:
        values, *sides = self._derivative(order, t)
        values[self._at_rest(order, sides)] = 0.0
        for end, beyond, edge in zip(self.ends, sides, self._edges, strict=True):
            # beyond an end of uniform motion the velocity is that at the end
            if order == 0 and end == "uniform" and np.any(beyond):
                speed = self._derivative(1, np.array([edge]))[0][0]
                values[beyond] += speed * (np.asarray(t)[beyond] - edge)
        return values

    def _at_rest(self, order: int, sides: Sequence[Mask]) -> Mask:
        """Mask of the times beyond an end where a derivative is zero, from masks (n,) of both."""
        at_rest = np.zeros(sides[0].shape, dtype=bool)
        for end, beyond in zip(self.ends, sides, strict=True):
            if end in ((), ("rest",), ("rest", "uniform"))[order]:
                at_rest |= beyond
        return at_rest


#: Laws with derivatives by their numbers
KnownLaw: TypeAlias = SmoothStep | Polynomial | Fourier | Combined | OnCircle | Spline


@lru_cache(maxsize=64)
def _basis(knots: bytes, degree: int, x: bytes) -> Any:
    """Values of B-splines at places x, a sparse matrix that splines of the same knots share."""
    return BSpline.design_matrix(np.frombuffer(x), np.frombuffer(knots), degree)


def spline(
    what: str,
    times: ArrayLike,
    values: ArrayLike,
    ends: str | tuple[str, str],
    degree: int,
    smoothing: float | None,
) -> Spline:
    """The spline through values (n,) at times (n,) [s], or fitted to them; see `Motion.spline`."""
    t = validation.real_array(f"{what}: times", times, (None,))
    one_value_each = f"one value for each of the {t.size} times"
    c = validation.real_array(f"{what}: values", values, (t.size,), expected=one_value_each)
    both_ends = _ends(what, ends)
    degree = int(validation.integer(f"{what}: the degree", degree))
    if degree not in DEGREES:
        raise ValueError(f"{what}: the degree must be 5 or 7, but it is {degree}")
    if t.size < 2:
        raise ValueError(f"{what}: a spline needs at least two values, but there are {t.size}")
    if not np.all(np.diff(t) > 0.0):
        k = int(np.argmin(np.diff(t) > 0.0))
        raise ValueError(
            f"{what}: times must increase, but entry {k + 1} is {t[k + 1]:.9g} s after {t[k]:.9g} s"
        )
    periodic = both_ends[0] == "periodic"
    if periodic:
        c = _closed(what, c)
    knots, span = t, float(t[-1] - t[0])
    k = int(np.argmin(np.diff(t)))
    if smoothing is None and t[k + 1] - t[k] < _NEAREST * span:
        raise ValueError(
            f"{what}: entries {k} and {k + 1} are {t[k + 1] - t[k]:.3g} s apart in a motion of "
            f"{span:.3g} s, too near each other for a smooth curve through both; leave one out"
        )
    if smoothing is not None:
        distance = validation.number(f"{what}: smoothing", smoothing, above=0.0, unit="s")
        pieces = max(int(np.ceil(span / distance - _SLACK)), 1)
        if pieces >= t.size:
            raise ValueError(
                f"{what}: smoothing = {distance:g} s has more knots than there are values; take "
                "more time between knots, or none to go through all values"
            )
        knots = np.linspace(t[0], t[-1], pieces + 1)
    fewest = (
        degree + 1 if periodic else 2 if both_ends != ("natural", "natural") else (degree + 1) // 2
    )
    if knots.size < fewest:
        raise ValueError(
            f"{what}: a spline of degree {degree} with these ends needs at least {fewest} "
            f"{'values' if smoothing is None else 'knots'}, but there are {knots.size}"
        )
    # In units of the mean distance of knots the derivatives at the ends have the size of values.
    unit = span / (knots.size - 1)
    x = (knots - t[0]) / unit
    x[-1] = knots.size - 1
    if smoothing is not None:
        c = _fitted(what, x, np.minimum((t - t[0]) / unit, x[-1]), c, degree, both_ends)
    extent = float(t[0]), unit, float(x[-1]), both_ends
    if smoothing is None and c.size <= _MOST_VALUES:
        return Spline(*extent, c, _linear_map(x.tobytes(), degree, both_ends))
    return Spline(*extent, _through(x, c, degree, both_ends))


def _ends(what: str, ends: str | tuple[str, str]) -> tuple[str, str]:
    """The motions at both ends, from one word for both or a pair of words."""
    label = f"{what}: ends"
    if isinstance(ends, str):
        word = validation.choice(label, ends, (*ENDS, "periodic"))
        return word, word
    pair = validation.listed(label, ends, "one word, or a pair of them for start and end")
    if len(pair) != 2:
        raise ValueError(f"{label} must be one word, or a pair, but there are {len(pair)}")
    start_kind, end_kind = (validation.choice(label, word, ENDS) for word in pair)
    return start_kind, end_kind


def _closed(what: str, values: Array) -> Array:
    """Values of a period, the last equal to the first; a ValueError where they differ."""
    if abs(values[-1] - values[0]) > 1e-9 * float(np.ptp(values)):
        raise ValueError(
            f"{what}: a periodic motion ends with its first value, {values[0]:.9g}, but the last "
            f"is {values[-1]:.9g}; give the value at the end of the period, too, and add a "
            "Motion.polynomial for the gain of a period"
        )
    return np.append(values[:-1], values[0])


def _through(x: Array, values: Array, degree: int, ends: tuple[str, str]) -> BSpline:
    """The spline through values, shape (n,) or (n, columns), at x (n,).

    A spline of degree 2 m - 1 has m - 1 derivatives that vanish at each end. They begin with the
    first one at rest, with the second one in uniform motion, and with order m at a natural end,
    where the integral of the squared derivative of order m is least.
    """
    if ends[0] == "periodic":
        return make_interp_spline(x, values, degree, bc_type="periodic")
    m, zero = (degree + 1) // 2, np.zeros(values.shape[1:]) if values.ndim > 1 else 0.0
    first_order = {"rest": 1, "uniform": 2, "natural": m}
    conditions = [[(first_order[end] + k, zero) for k in range(m - 1)] for end in ends]
    return make_interp_spline(x, values, degree, bc_type=tuple(conditions))


@lru_cache(maxsize=16)
def _linear_map(x: bytes, degree: int, ends: tuple[str, str]) -> _LinearMap:
    """The matrices from values at x to the spline through them, which many splines share.

    Derivatives that vanish at an end do so without round-off.
    """
    places = np.frombuffer(x)
    unit = np.eye(places.size)
    if ends[0] == "periodic":
        unit[-1] = unit[0]
    value = _through(places, unit, degree, ends)
    slope, curvature = value.derivative(1), value.derivative(2)
    return _LinearMap(
        fixed=(x, degree, ends),
        knots=(value.t, slope.t, curvature.t),
        degrees=(value.k, slope.k, curvature.k),
        matrices=(value.c, slope.c, curvature.c),
    )


def _fitted(
    what: str, x: Array, places: Array, values: Array, degree: int, ends: tuple[str, str]
) -> Array:
    """Values at knots x (knots,) whose spline is closest to values (n,) at some places, (n,)."""
    if x.size * places.size > _LARGEST_FIT:
        raise ValueError(
            f"{what}: {x.size} knots are too many for a fit to {places.size} values; take more "
            "time between knots, or fewer values"
        )
    unknowns = np.eye(x.size)
    if ends[0] == "periodic":
        unknowns = unknowns[:, :-1]
        unknowns[-1, 0] = 1.0
    matrix = _through(x, unknowns, degree, ends)(places)
    solution, _, rank, _ = scipy.linalg.lstsq(matrix, values, cond=1e-8, lapack_driver="gelsy")
    if rank < unknowns.shape[1]:
        raise ValueError(
            f"{what}: there are too few values near some of the {x.size} knots; between two values "
            f"there are up to {np.max(np.diff(places)):.2g} distances of knots, so that smoothing "
            "must be larger"
        )
    return np.asarray(unknowns @ solution)
