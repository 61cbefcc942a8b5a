# SPDX-License-Identifier: MIT
"""Prescribed motions with their exact first and second derivatives, and other functions of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .. import validation
from ..arrays import Array
from .laws import (
    Combined,
    Composed,
    Fourier,
    KnownLaw,
    OnCircle,
    OutsideError,
    Polynomial,
    SmoothStep,
    Stated,
    spline,
)
from .table import read_motion

TimeFunction = Callable[[Array], ArrayLike]
_Made: TypeAlias = KnownLaw | Composed

#: Number of instants at which derivatives are compared with differences, over the whole interval
#: and again where the motion changes
_CHECKS = 97
#: Number of instants by which it is seen where the motion changes
_SCAN = 1001
#: Steps of the differences, as parts of the interval; where one disagrees the next one is tried
_STEPS = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
#: Length of a name beyond which a sum of motions is named "sum"
_LONGEST_NAME = 60


@dataclass(frozen=True)
class Motion:
    """A prescribed coordinate c(t): value, velocity and acceleration.

    Each is a function of an array of times, shape (n,) [s], that returns an array of shape (n,) or
    a number. Velocity and acceleration are given, not differenced: the constraints on velocities
    and the initial accelerations use them, and a wrong one spoils the accuracy without any other
    sign. :meth:`check` finds it.

    Attributes:
        value: c(t) [m or rad].
        velocity: First derivative of c [m/s or rad/s].
        acceleration: Second derivative of c [m/s^2 or rad/s^2].
        name: Name for messages and plots.
        jumps: Times at which c or a derivative of it jumps [s]; :class:`RadauIIA` ends steps there.
    """

    value: TimeFunction
    velocity: TimeFunction
    acceleration: TimeFunction
    name: str = ""
    jumps: tuple[float, ...] = ()

    __array_ufunc__ = None  # numbers of NumPy leave sums and products to the motion

    def __post_init__(self) -> None:
        validation.name("motion: name", self.name)
        for function in ("value", "velocity", "acceleration"):
            label = f"motion {self.name!r}: the {function}"
            validation.function(label, getattr(self, function), "an array of times")
        validation.real_array(f"motion {self.name!r}: jumps", self.jumps, (None,))

    @staticmethod
    def constant(value: float, name: str = "") -> Motion:
        """A coordinate that stays at a finite value [m or rad]; the name is for messages."""
        fixed = validation.number("constant motion: the value", value)
        return Motion.polynomial([fixed], name or f"constant {fixed:g}")

    @staticmethod
    def polynomial(coefficients: Sequence[float], name: str = "") -> Motion:
        """The polynomial sum_k c_k t^k.

        Args:
            coefficients: Finite numbers c_0 [m or rad], c_1 [m/s or rad/s], c_2 [m/s^2 or rad/s^2],
                ...; (c_0, omega) is a uniform motion.
            name: Name for messages and plots.
        """
        numbers = validation.real_array("polynomial: coefficients", coefficients, (None,))
        if not numbers.size:
            raise ValueError("polynomial: coefficients must hold at least one number")
        return Motion._of_law(
            Polynomial(numbers), name or f"polynomial of degree {numbers.size - 1}"
        )

    @staticmethod
    def smooth_step(distance: float, duration: float, start: float = 0.0, name: str = "") -> Motion:
        """Rest-to-rest motion distance * (10 s^3 - 15 s^4 + 6 s^5), s = (t - start) / duration.

        Velocity and acceleration vanish at both ends, where the third derivative jumps; the value
        is constant before and after.

        Args:
            distance: Distance covered [m or rad].
            duration: Time taken, positive [s].
            start: Time of the start [s].
            name: Name for messages and plots.
        """
        step = SmoothStep(
            validation.number("smooth_step: the distance", distance),
            validation.number("smooth_step: the duration", duration, above=0.0, unit="s"),
            validation.number("smooth_step: the start", start),
        )
        ends = (step.start, step.start + step.duration)
        return Motion._of_law(step, name or "smooth step", ends)

    @staticmethod
    def fourier(
        period: float,
        cosines: Sequence[float] = (),
        sines: Sequence[float] = (),
        mean: float = 0.0,
        name: str = "",
    ) -> Motion:
        """The series mean + sum_k (a_k cos(k omega t) + b_k sin(k omega t)), omega = 2 pi / period.

        Args:
            period: Period of the slowest part, positive [s].
            cosines: Amplitudes a_1, a_2, ... [m or rad].
            sines: Amplitudes b_1, b_2, ... [m or rad]; of both the shorter list ends with zeros.
            mean: Mean value [m or rad].
            name: Name for messages and plots.
        """
        period = validation.number("fourier: the period", period, above=0.0, unit="s")
        amplitudes = [
            validation.real_array(f"fourier: {kind}", numbers, (None,))
            for kind, numbers in (("cosines", cosines), ("sines", sines))
        ]
        harmonics = max(kind.size for kind in amplitudes)
        a, b = (np.pad(kind, (0, harmonics - kind.size)) for kind in amplitudes)
        rates = 2.0 * math.pi / period * np.arange(1, harmonics + 1)
        law = Fourier(validation.number("fourier: the mean", mean), a, b, rates)
        return Motion._of_law(law, name or "Fourier series")

    @staticmethod
    def spline(
        times: ArrayLike,
        values: ArrayLike,
        *,
        ends: str | tuple[str, str] = "rest",
        degree: int = 5,
        smoothing: float | None = None,
        name: str = "",
    ) -> Motion:
        """The spline through values at given times, with smooth accelerations.

        It is linear in the values, and has degree - 1 continuous derivatives between its ends.

        Args:
            times: Times, shape (n,), each later than the one before [s].
            values: Values at these times, shape (n,) [m or rad].
            ends: Motion beyond both ends, or a pair of words for start and end. At ``"rest"`` the
                first (degree - 1) / 2 derivatives vanish, and the value stays beyond. In
                ``"uniform"`` motion acceleration and jerk vanish (with degree 7 also the next
                derivative), and the velocity stays beyond. ``"natural"`` ends let derivatives from
                the third on vanish (with degree 7 from the fourth), and nothing is known beyond: a
                simulation that asks for it is refused. A ``"periodic"`` motion repeats itself; its
                last value must be the first.
            degree: 5 or 7; of degree 7 accelerations have four continuous derivatives.
            smoothing: Distance of the knots of a spline with these ends that is fitted to the
                values by least squares, instead of passing through all of them [s]: changes within
                that time are smoothed as noise. The distance is shortened so that it divides the
                interval. None: no smoothing.
            name: Name for messages and plots.


        Natural splines: I. J. Schoenberg, Proceedings of the National Academy of
        Sciences 52 (1964), doi:10.1073/pnas.52.4.947.
        """
        label = f"spline {name!r}" if name else "spline"
        law = spline(label, times, values, ends, degree, smoothing)
        return Motion._of_law(law, name or "spline", law.jumps)

    @staticmethod
    def from_table(
        path: str | PathLike[str],
        value: str,
        *,
        time: str = "time",
        unit: str | None = None,
        time_unit: str | None = None,
        unwrap: bool | None = None,
        ends: str | tuple[str, str] = "natural",
        degree: int = 5,
        smoothing: float | None = None,
        name: str = "",
    ) -> Motion:
        """A measured or planned motion from two columns of a text file, by :meth:`spline`.

        The first line names the columns, which commas, semicolons or tabulators separate, for
        example ``time [ms], shoulder [deg]``; empty lines and those that begin with # do not count.

        Args:
            path: Path of the file, which every rank reads.
            value: Name of the column of values, without the unit.
            time: Name of the column of times, without the unit.
            unit: Unit of the values: "rad", "mrad", "deg", "rev", "m", "cm", "mm" or "um". None:
                that in brackets behind the name of the column.
            time_unit: Unit of the times, "s", "ms", "us", "min" or "h", likewise.
            unwrap: Whether angles jump by a full turn somewhere, as measured ones do, and are to be
                unwrapped: True takes the shorter way from row to row, False the angles as they are.
                None refuses angles that change by more than half a turn from one row to the next.
            ends: Motion beyond the ends, see :meth:`spline`.
            degree: Degree of the spline.
            smoothing: Distance of knots for a fit instead of interpolation [s], see :meth:`spline`.
            name: Name for messages and plots; by default the names of file and column.

        Raises:
            OSError: If the file cannot be read.
            ValueError: If a column or a unit is missing or not known, an entry is no finite number,
                times are repeated or do not increase, or as :meth:`spline` does.
        """
        units = (time_unit, unit)
        read = read_motion(path, (time, value), units, unwrap)
        name = name or f"{Path(path).name}: {value}"
        law = spline(f"table {name!r}", *read, ends, degree, smoothing)
        return Motion._of_law(law, name, law.jumps)

    @staticmethod
    def _of_law(law: _Made, name: str, jumps: tuple[float, ...] = ()) -> Motion:
        """The motion of a law."""
        return Motion(law.value, law.velocity, law.acceleration, name, jumps)

    @property
    def _law(self) -> KnownLaw | None:
        """The law whose methods the three functions are, if it has derivatives by its numbers."""
        law, derivatives = getattr(self.value, "__self__", None), (self.velocity, self.acceleration)
        if not isinstance(law, KnownLaw):
            return None
        of_one_law = all(getattr(function, "__self__", None) is law for function in derivatives)
        return law if of_one_law else None

    def stated(self) -> Stated:
        """The numbers that define the motion, (numbers,), and its other properties, or None."""
        law = self._law
        return (np.zeros(0), None) if law is None else law.stated()

    def pullback(self, t: Array, bars: Array) -> Array:
        """Derivatives by the numbers of `stated`, shape (numbers,).

        Args:
            t: Times, shape (n,) [s].
            bars: Derivatives by value, velocity and acceleration there, shape (3, n).
        """
        law = self._law
        return np.zeros(0) if law is None else law.pullback(t, bars)

    def turning(self, middle: float, cosine: float, sine: float) -> Motion:
        """The motion of a coordinate that turns with this angle.

        The motion is middle + cosine cos(c) + sine sin(c), a coordinate of a point on a circle.
        """
        return Motion._of_law(OnCircle(middle, cosine, sine, self), self.name, self.jumps)

    def _sum(self, added: object, sign: float) -> Motion:
        """This motion plus or minus another, or a number."""
        if isinstance(added, Motion):
            name, jumps = f"{self.name} {'+' if sign > 0.0 else '-'} {added.name}", added.jumps
            name = name if len(name) <= _LONGEST_NAME else "sum"
        elif validation.is_number(added):
            # a wrong number has the message of a constant motion
            added = Motion.constant(added)  # type: ignore[arg-type]
            name, jumps = self.name, ()
        else:
            return NotImplemented
        law = Combined(((1.0, self), (sign, added)))
        return Motion._of_law(law, name, tuple(sorted({*self.jumps, *jumps})))

    def __add__(self, other: Motion | float) -> Motion:
        """The sum with another motion, or with a number [m or rad]."""
        return self._sum(other, 1.0)

    __radd__ = __add__

    def __sub__(self, other: Motion | float) -> Motion:
        """The difference from another motion, or from a number [m or rad]."""
        return self._sum(other, -1.0)

    def __rsub__(self, other: float) -> Motion:
        return -self + other

    def __mul__(self, factor: float) -> Motion:
        """The motion times a number."""
        if not validation.is_number(factor):
            return NotImplemented
        factor = validation.number(f"motion {self.name!r}: the factor", factor)
        return Motion._of_law(Combined(((factor, self),)), self.name, self.jumps)

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> Motion:
        """The motion divided by a number other than zero."""
        if not validation.is_number(divisor):
            return NotImplemented
        if divisor == 0.0:
            raise ZeroDivisionError(f"motion {self.name!r} is divided by zero")
        return self * (1.0 / divisor)

    def __neg__(self) -> Motion:
        return self * -1.0

    def of(self, inner: Motion, jumps: Sequence[float] | None = None) -> Motion:
        """This motion as a function of another, c(t) = self(inner(t)).

        A cam is its profile over the angle, a function of the angle over time; a delay or another
        speed are a polynomial of degree 1: ``motion.of(Motion.polynomial([-delay, 1.0]))``.

        Args:
            inner: The argument of this motion over time, in the place of its time.
            jumps: Times at which the inner motion passes a jump of this one [s]. None: they are
                found if the inner motion is a polynomial of degree 1, or this one has no jumps.
        """
        validation.instance(f"motion {self.name!r} of", inner, Motion, "a Motion")
        label = f"motion {self.name!r} of {inner.name!r}: jumps"
        if jumps is None:
            passages = self._passed(inner)
            if passages is None:
                raise ValueError(
                    f"{label} cannot be found: give the times at which {inner.name!r} passes "
                    f"{list(self.jumps)}, where {self.name!r} is not smooth"
                )
        else:
            passages = validation.real_array(label, jumps, (None,))
            values = sample(inner, passages, f"motion {inner.name!r}: the value")
            for t, x in zip(passages, values, strict=True):
                if not any(abs(x - jump) <= 1e-6 * max(abs(jump), 1.0) for jump in self.jumps):
                    raise ValueError(
                        f"{label}: at t = {t:g} s {inner.name!r} is {x:.9g}, but {self.name!r} has "
                        f"its jumps at {list(self.jumps)}"
                    )
        all_jumps = {*inner.jumps, *(float(t) for t in passages)}
        name = f"{self.name} of {inner.name}"
        return Motion._of_law(Composed(self, inner), name, tuple(sorted(all_jumps)))

    def _passed(self, inner: Motion) -> Array | None:
        """Times at which another motion passes the jumps of this one [s], None if not known."""
        line, jumps = inner._law, np.array(self.jumps, dtype=np.float64)
        if not jumps.size:
            return jumps
        if not isinstance(line, Polynomial) or np.any(line.coefficients[2:]):
            return None
        start, speed = np.pad(line.coefficients, (0, 1))[:2]
        return (jumps - start) / speed if speed else jumps[:0]

    def tabulate(self, times: ArrayLike) -> Array:
        """Value, velocity and acceleration at given times (n,), shape (3, n).

        Raises:
            ValueError: If a function returns another shape, NaN or infinity.
        """
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        label = f"motion {self.name!r}: the"
        names = ("value", "velocity", "acceleration")
        return np.stack([sample(getattr(self, name), t, f"{label} {name}") for name in names])

    def check(self, start: float, end: float, tolerance: float = 1e-3) -> None:
        """Compare velocity and acceleration with differences over an interval.

        More instants are compared where the motion changes, and the steps of the differences become
        shorter until they agree or round-off hides them, so that short motions, jumps and long
        rests are treated as well.

        Args:
            start: Start of the interval [s].
            end: End of the interval [s].
            tolerance: Largest difference allowed, relative to the largest rate.

        Raises:
            ValueError: If the velocity is not the derivative of the value, or the acceleration not
                the derivative of the velocity.
        """
        step = _STEPS[0] * (end - start)
        t = np.clip(self._lively_instants(start, end), start + step, end - step)
        table = self.tabulate(t)
        allowed = tolerance * np.max(np.abs(table[1:]), axis=1)
        noise = 1e-14 * np.max(np.abs(table[:2]), axis=1)
        for row, (low, high) in enumerate((("value", "velocity"), ("velocity", "acceleration"))):
            function, label = getattr(self, low), f"motion {self.name!r}: the {low}"
            suspects, slopes = np.arange(t.size), 0.0 * t
            for step in (end - start) * np.array(_STEPS):
                instants = t[suspects]
                below, above = (sample(function, instants + k * step, label) for k in (-1, 1))
                slopes[suspects] = (above - below) / ((instants + step) - (instants - step))
                error = np.abs(slopes[suspects] - table[row + 1, suspects])
                disagrees = error > allowed[row] + noise[row] / step
                suspects, error = suspects[disagrees], error[disagrees]
                # The next step would hide the error of a point behind round-off.
                if not suspects.size or np.any(100.0 * noise[row] > error * step):
                    break
            if suspects.size:
                worst = suspects[np.argmax(np.abs(slopes - table[row + 1])[suspects])]
                raise ValueError(
                    f"motion {self.name!r}: the {high} is not the derivative of the {low}: at "
                    f"t = {t[worst]:.6g} s it is {table[row + 1, worst]:.6g}, but differences give "
                    f"{slopes[worst]:.6g}"
                )

    def _lively_instants(self, start: float, end: float) -> Array:
        """Instants over an interval, half of them where value and velocity change; (n,) [s]."""
        # how much of their whole change value and velocity have behind them
        scan = np.linspace(start, end, _SCAN)
        functions = (("value", self.value), ("velocity", self.velocity))
        table = [sample(f, scan, f"motion {self.name!r}: the {name}") for name, f in functions]
        changes = np.abs(np.diff(table))
        changes /= np.maximum(np.sum(changes, axis=1, keepdims=True), np.finfo(float).tiny)
        shares = np.cumsum(np.sum(changes, axis=0), dtype=np.float64)

        # An irrational stride keeps the instants off the kinks that sit at round fractions.
        stride = (np.arange(_CHECKS) * 0.6180339887498949) % 1.0
        evenly = start + (end - start) * stride

        # a few between any two jumps, however near these are
        corners = np.unique(np.clip([start, *self.jumps, end], start, end))
        between = (corners[:-1, None] + np.diff(corners)[:, None] * stride[1:6]).ravel()

        if not shares[-1] > 0.0:
            return np.concatenate([evenly, between])
        moving = np.interp(stride * shares[-1], np.append(0.0, shares), scan)
        return np.concatenate([evenly, moving, between])


#: A quantity over time: a number, a function of an array of times (n,) [s], or a Motion, whose
#: value alone counts.
Signal = Motion | TimeFunction | float


def check_signal(what: str, signal: object) -> None:
    """Raise an error unless a signal is a finite number, a function of times or a Motion."""
    if isinstance(signal, Motion) or (callable(signal) and not isinstance(signal, type)):
        return
    if not validation.is_number(signal):
        raise TypeError(
            f"{what} must be a number, a function of an array of times, or a Motion, but it is "
            f"{validation.described(signal)}"
        )
    validation.number(what, signal)


def evaluated(signal: Signal, times: Array, what: str) -> Array:
    """Evaluate a signal: shape () if it is constant, otherwise (n,), one value per time."""
    function = signal.value if isinstance(signal, Motion) else signal
    if not callable(function):
        return np.asarray(function, dtype=np.float64)
    try:
        values = function(times)
    except OutsideError as error:
        raise ValueError(f"{what} {error}") from error
    except (TypeError, ValueError) as error:  # what functions of one number raise
        raise ValueError(
            f"{what} cannot be computed for an array of {times.size} times: {error}; write the "
            "function with NumPy (numpy.sin instead of math.sin, numpy.where instead of if)"
        ) from error
    result = validation.numbers(f"{what} at {times.size} times", values)
    if result.shape not in ((), times.shape):
        raise ValueError(f"{what} at {times.size} times has shape {result.shape}")
    return result


def sample(signal: Signal, times: ArrayLike, what: str) -> Array:
    """Values of a signal at given times, shape (n,); a ValueError if one is NaN or infinite."""
    t = np.asarray(times, dtype=np.float64)
    values = evaluated(signal, t, what)
    finite = np.isfinite(values)
    if not finite.all():
        instant = t[np.argmin(np.full(t.shape, finite))]
        raise ValueError(f"{what} is NaN or infinite at t = {instant:g} s")
    return np.full(t.shape, values)


def is_zero(*signals: object) -> bool:
    """Whether all signals are the number zero."""
    return not any(callable(s) or isinstance(s, Motion) or s != 0.0 for s in signals)


def tabulated(motion: Motion, times: ArrayLike, user: str) -> Array:
    """:meth:`Motion.tabulate`, shape (3, n), for a marker or joint whom errors name."""
    try:
        return motion.tabulate(times)
    except ValueError as error:
        raise ValueError(f"{user}: {error}") from error
