# SPDX-License-Identifier: MIT
"""Prescribed motions with their exact first and second derivatives, and other functions of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import validation

__all__ = [
    "Motion",
    "Signal",
    "check_signal",
    "evaluated",
    "right_hand_side",
    "sample",
    "tabulated",
]

Array = NDArray[np.float64]
TimeFunction = Callable[[Array], ArrayLike]

#: Instants at which derivatives are compared with differences.
_CHECKS = 97


@dataclass(frozen=True)
class _SmoothStep:
    """Rest-to-rest motion, whose functions can be pickled as those within a function cannot."""

    distance: float
    duration: float
    start: float

    def _share(self, t: Array) -> Array:
        return np.minimum(np.maximum((np.asarray(t) - self.start) / self.duration, 0.0), 1.0)

    def value(self, t: Array) -> Array:
        """The distance covered at times ``t``."""
        x = self._share(t)
        return self.distance * x**3 * (10.0 + x * (-15.0 + 6.0 * x))

    def velocity(self, t: Array) -> Array:
        """The velocity at times ``t``."""
        x = self._share(t)
        return self.distance / self.duration * 30.0 * (x * (1.0 - x)) ** 2

    def acceleration(self, t: Array) -> Array:
        """The acceleration at times ``t``."""
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

    #: c(t) [m or rad].
    value: TimeFunction
    #: First derivative of c [m/s or rad/s].
    velocity: TimeFunction
    #: Second derivative of c [m/s^2 or rad/s^2].
    acceleration: TimeFunction
    #: Name for messages and plots.
    name: str = ""
    #: Times at which c or a derivative of it jumps [s]; :class:`RadauIIA` ends steps there.
    jumps: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check the kinds of the arguments."""
        validation.name("motion: name", self.name)
        for part in ("value", "velocity", "acceleration"):
            what = f"motion {self.name!r}: the {part}"
            validation.function(what, getattr(self, part), "an array of times")
        validation.real_array(f"motion {self.name!r}: jumps", self.jumps, (None,))

    @staticmethod
    def constant(value: float, name: str = "") -> Motion:
        """A coordinate that is held.

        Args:
            value: The constant [m or rad].
            name: Name for messages and plots.

        Raises:
            TypeError: If the constant is no number.
            ValueError: If it is NaN or infinite.
        """
        held = validation.number("constant motion: the value", value)
        return Motion.polynomial([held], name or f"constant {held:g}")

    @staticmethod
    def polynomial(coefficients: Sequence[float], name: str = "") -> Motion:
        """The polynomial sum_k c_k t^k.

        Args:
            coefficients: c_0, c_1, ...; (c_0, omega) is a uniform motion.
            name: Name for messages and plots.

        Raises:
            TypeError: If the coefficients are no list of numbers.
            ValueError: If there is none, or one is NaN or infinite.
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
        is held before and after.

        Args:
            distance: Distance covered [m or rad].
            duration: Time taken [s].
            start: Time of the start [s].
            name: Name for messages and plots.

        Raises:
            TypeError: If an argument is no number.
            ValueError: If the duration is not positive, or a number is NaN or infinite.
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
        """Value, velocity and acceleration at given times.

        Args:
            times: Times, shape (n,) [s].

        Returns:
            Array of shape (3, n).

        Raises:
            ValueError: If a function returns another shape, NaN or infinity.
        """
        t = np.asarray(times, dtype=np.float64)
        table = np.empty((3, t.size))
        parts = (("value", self.value), ("velocity", self.velocity))
        for row, (part, function) in enumerate((*parts, ("acceleration", self.acceleration))):
            table[row] = evaluated(function, t, f"motion {self.name!r}: the {part}")
            if not np.all(np.isfinite(table[row])):
                first = t[np.argmin(np.isfinite(table[row]))]
                raise ValueError(
                    f"motion {self.name!r}: the {part} is NaN or infinite at t = {first:g} s"
                )
        return table

    def check(self, start: float, end: float, tolerance: float = 1e-3) -> None:
        """Compare velocity and acceleration with differences over an interval.

        Args:
            start: Begin of the interval [s].
            end: End of the interval [s].
            tolerance: Largest difference allowed, relative to the largest rate.

        Raises:
            ValueError: If the velocity is not the derivative of the value, or the acceleration not
                that of the velocity.
        """
        span = end - start
        step = 1e-6 * span
        # An irrational stride keeps the instants off the kinks that sit at round fractions.
        t = start + step + (span - 2.0 * step) * ((np.arange(_CHECKS) * 0.6180339887498949) % 1.0)
        before, here, after = (self.tabulate(t + k * step) for k in (-1, 0, 1))
        for row, (low, high) in enumerate((("value", "velocity"), ("velocity", "acceleration"))):
            difference = (after[row] - before[row]) / (2.0 * step)
            rate = np.max(np.abs(here[row + 1])) + np.max(np.abs(difference))
            noise = 1e-15 * np.max(np.abs(here[row])) / step
            error = np.abs(difference - here[row + 1])
            worst = int(np.argmax(error))
            if error[worst] > tolerance * rate + 10.0 * noise:
                raise ValueError(
                    f"motion {self.name!r}: the {high} is not the derivative of the {low}: at "
                    f"t = {t[worst]:.6g} s it is {here[row + 1, worst]:.6g}, but differences give "
                    f"{difference[worst]:.6g}"
                )


#: A quantity over time: a number, a function of an array of times (n,) [s], or a Motion, of which
#: only the value counts.
Signal = Motion | TimeFunction | float


def check_signal(what: str, signal: object) -> None:
    """Refuse what is no quantity over time.

    Args:
        what: Name of the quantity, for the message.
        signal: What is given for it.

    Raises:
        TypeError: If it is neither a number nor a function nor a Motion.
        ValueError: If it is a number that is NaN or infinite.
    """
    if isinstance(signal, Motion) or (callable(signal) and not isinstance(signal, type)):
        return
    if not validation.is_number(signal):
        raise TypeError(
            f"{what} must be a number, a function of an array of times, or a Motion, but it is "
            f"{validation.described(signal)}"
        )
    validation.number(what, signal)


def evaluated(signal: Signal, times: Array, what: str) -> Array:
    """Values of a quantity as its function gives them: one for all times, or one for each.

    Args:
        signal: The quantity.
        times: Times, shape (n,) [s].
        what: Name of the quantity, for the message.

    Returns:
        Array of shape () or (n,); it may hold NaN.

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
    """Values of a quantity at given times.

    Args:
        signal: The quantity.
        times: Times, shape (n,) [s].
        what: Name of the quantity, for the message.

    Returns:
        Array of shape (n,).

    Raises:
        ValueError: If the quantity has another shape, is NaN or infinite.
    """
    t = np.asarray(times, dtype=np.float64)
    values = np.array(np.broadcast_to(evaluated(signal, t, what), t.shape))
    if not np.all(np.isfinite(values)):
        first = t[np.argmin(np.isfinite(values))]
        raise ValueError(f"{what} is NaN or infinite at t = {first:g} s")
    return values


def tabulated(motion: Motion, times: ArrayLike, user: str) -> Array:
    """Value, velocity and acceleration of a motion, as :meth:`Motion.tabulate`, for a user.

    Args:
        motion: The motion.
        times: Times, shape (n,) [s].
        user: The marker or joint that it moves, for the message.

    Returns:
        Array of shape (3, n).

    Raises:
        ValueError: If a function returns another shape, NaN or infinity.
    """
    try:
        return motion.tabulate(times)
    except ValueError as error:
        raise ValueError(f"{user}: {error}") from error


def right_hand_side(
    motion: Motion | None, constant: float, times: Array, joint: str, *, positive: bool
) -> Array:
    """Right-hand side of a constraint, constant + motion(t), and its two derivatives.

    Args:
        motion: The motion, if there is one.
        constant: Constant part [m or rad].
        times: Times, shape (n,) [s].
        joint: Name of the joint, for messages.
        positive: Whether it is a length, which must not vanish.

    Returns:
        Array of shape (n, 3).

    Raises:
        ValueError: If a value is NaN or infinite, or a length is not positive.
    """
    table = np.zeros((times.size, 3))
    if motion is not None:
        table += tabulated(motion, times, f"joint {joint!r}").T
    table[:, 0] += constant
    if positive and not np.min(table[:, 0]) > 0.0:
        k = int(np.argmax(~(table[:, 0] > 0.0)))
        raise ValueError(
            f"joint {joint!r}: the length must be positive at all times, but it is "
            f"{table[k, 0]:.6g} m at t = {times[k]:.6g} s"
        )
    return table
