# SPDX-License-Identifier: MIT
"""Prescribed motions with their exact first and second derivatives, and other functions of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation

Array = NDArray[np.float64]
TimeFunction = Callable[[Array], ArrayLike]

#: Instants at which derivatives are compared with differences: all over an interval, and as many
#: where something moves, of so many that are looked at.
_CHECKS, _SCAN = 97, 1001
#: Steps of the differences, in parts of the interval; the shorter ones where the first disagree.
_STEPS = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)


@dataclass(frozen=True)
class _SmoothStep:
    """Rest-to-rest motion, whose functions can be pickled as those within a function cannot."""

    distance: float
    duration: float
    start: float

    def _share(self, t: Array) -> Array:
        return np.minimum(np.maximum((np.asarray(t) - self.start) / self.duration, 0.0), 1.0)

    def value(self, t: Array) -> Array:
        x = self._share(t)
        return self.distance * x**3 * (10.0 + x * (-15.0 + 6.0 * x))

    def velocity(self, t: Array) -> Array:
        x = self._share(t)
        return self.distance / self.duration * 30.0 * (x * (1.0 - x)) ** 2

    def acceleration(self, t: Array) -> Array:
        x = self._share(t)
        return self.distance / self.duration**2 * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)


@dataclass(frozen=True)
class Motion:
    """A prescribed coordinate c(t): value, velocity and acceleration.

    Each is a function of an array of times, shape (n,) [s], that returns an array of shape (n,) or
    a number. Velocity and acceleration are given, not differenced: the constraints on velocities
    and the initial accelerations use them, and a wrong one spoils the accuracy without any other
    sign. :meth:`check` finds it.

    Raises:
        TypeError: If value, velocity or acceleration is no function.
        ValueError: If a time of a jump is NaN or infinite.
    """

    value: TimeFunction  #: c(t) [m or rad].
    velocity: TimeFunction  #: First derivative of c [m/s or rad/s].
    acceleration: TimeFunction  #: Second derivative of c [m/s^2 or rad/s^2].
    name: str = ""  #: Name for messages and plots.
    #: Times at which c or a derivative of it jumps [s]; :class:`RadauIIA` ends steps there.
    jumps: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        validation.name("motion: name", self.name)
        for part in ("value", "velocity", "acceleration"):
            what = f"motion {self.name!r}: the {part}"
            validation.function(what, getattr(self, part), "an array of times")
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
            coefficients: c_0, c_1, ..., finite numbers; (c_0, omega) is a uniform motion.
            name: Name for messages and plots.
        """
        given = validation.real_array("polynomial: coefficients", coefficients, (None,))
        if not given.size:
            raise ValueError("polynomial: coefficients must hold at least one number")
        p = np.polynomial.Polynomial(given)
        return Motion(p, p.deriv(1), p.deriv(2), name or f"polynomial of degree {p.degree()}")

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
        step = _SmoothStep(
            validation.number("smooth_step: the distance", distance),
            validation.number("smooth_step: the duration", duration, above=0.0, unit="s"),
            validation.number("smooth_step: the start", start),
        )
        ends = (step.start, step.start + step.duration)
        parts = step.value, step.velocity, step.acceleration
        return Motion(*parts, name or "smooth step", ends)

    def tabulate(self, times: ArrayLike) -> Array:
        """Value, velocity and acceleration at given times (n,), shape (3, n).

        Raises:
            ValueError: If a function returns another shape, NaN or infinity.
        """
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        what = f"motion {self.name!r}: the"
        parts = ("value", "velocity", "acceleration")
        return np.stack([sample(getattr(self, part), t, f"{what} {part}") for part in parts])

    def check(self, start: float, end: float, tolerance: float = 1e-3) -> None:
        """Compare velocity and acceleration with differences over an interval.

        Where something moves there are more instants, and the differences become shorter until they
        agree, or round-off hides them: short motions, jumps and long rests matter as little as the
        length of the interval.

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
        here = self.tabulate(t)
        allowed = tolerance * np.max(np.abs(here[1:]), axis=1)
        noise = 1e-14 * np.max(np.abs(here[:2]), axis=1)
        for row, (low, high) in enumerate((("value", "velocity"), ("velocity", "acceleration"))):
            function, what = getattr(self, low), f"motion {self.name!r}: the {low}"
            wrong, found = np.arange(t.size), 0.0 * t
            for step in (end - start) * np.array(_STEPS):
                at = t[wrong]
                before, after = (sample(function, at + k * step, what) for k in (-1, 1))
                found[wrong] = (after - before) / ((at + step) - (at - step))
                error = np.abs(found[wrong] - here[row + 1, wrong])
                open_ = error > allowed[row] + noise[row] / step
                wrong, error = wrong[open_], error[open_]
                # The next step would hide the error of a point behind round-off.
                if not wrong.size or np.any(100.0 * noise[row] > error * step):
                    break
            if wrong.size:
                worst = wrong[np.argmax(np.abs(found - here[row + 1])[wrong])]
                raise ValueError(
                    f"motion {self.name!r}: the {high} is not the derivative of the {low}: at "
                    f"t = {t[worst]:.6g} s it is {here[row + 1, worst]:.6g}, but differences give "
                    f"{found[worst]:.6g}"
                )

    def _lively_instants(self, start: float, end: float) -> Array:
        """Instants over an interval, half of them where value and velocity change; (n,) [s]."""
        scan = np.linspace(start, end, _SCAN)
        parts = (("value", self.value), ("velocity", self.velocity))
        table = [sample(f, scan, f"motion {self.name!r}: the {part}") for part, f in parts]
        changes = np.abs(np.diff(table))
        changes /= np.maximum(np.sum(changes, axis=1, keepdims=True), np.finfo(float).tiny)
        shares = np.cumsum(np.sum(changes, axis=0), dtype=np.float64)
        # An irrational stride keeps the instants off the kinks that sit at round fractions.
        stride = (np.arange(_CHECKS) * 0.6180339887498949) % 1.0
        evenly = start + (end - start) * stride
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
    """Refuse what is no finite number, function of times or Motion: a TypeError or ValueError."""
    if isinstance(signal, Motion) or (callable(signal) and not isinstance(signal, type)):
        return
    if not validation.is_number(signal):
        raise TypeError(
            f"{what} must be a number, a function of an array of times, or a Motion, but it is "
            f"{validation.described(signal)}"
        )
    validation.number(what, signal)


def evaluated(signal: Signal, times: Array, what: str) -> Array:
    """Evaluate a signal: shape () if it is constant, otherwise (n,), one value per time.

    The result may hold NaN.

    Raises:
        ValueError: If the function fails, or gives something else; the message says how it is to
            be written.
    """
    function = signal.value if isinstance(signal, Motion) else signal
    if not callable(function):
        return np.asarray(function, dtype=np.float64)
    try:
        given = function(times)
    except (TypeError, ValueError) as error:  # what functions of one number raise
        raise ValueError(
            f"{what} cannot be computed for an array of {times.size} times: {error}; write the "
            "function with NumPy (numpy.sin instead of math.sin, numpy.where instead of if)"
        ) from error
    result = validation.numbers(f"{what} at {times.size} times", given)
    if result.shape not in ((), times.shape):
        raise ValueError(f"{what} at {times.size} times has shape {result.shape}")
    return result


def sample(signal: Signal, times: ArrayLike, what: str) -> Array:
    """Values of a signal at given times, shape (n,); a ValueError if one is NaN or infinite."""
    t = np.asarray(times, dtype=np.float64)
    values = np.array(np.broadcast_to(evaluated(signal, t, what), t.shape))
    if not np.all(np.isfinite(values)):
        first = t[np.argmin(np.isfinite(values))]
        raise ValueError(f"{what} is NaN or infinite at t = {first:g} s")
    return values


def is_zero(*signals: object) -> bool:
    """Whether all signals are the number zero."""
    return not any(callable(s) or isinstance(s, Motion) or s != 0.0 for s in signals)


def tabulated(motion: Motion, times: ArrayLike, user: str) -> Array:
    """:meth:`Motion.tabulate`, shape (3, n), for a marker or joint whom errors name."""
    try:
        return motion.tabulate(times)
    except ValueError as error:
        raise ValueError(f"{user}: {error}") from error
