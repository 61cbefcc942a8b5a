# SPDX-License-Identifier: MIT
"""Prescribed motions with their exact first and second derivatives, and other functions of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Motion", "Signal", "sample"]

Array = NDArray[np.float64]
TimeFunction = Callable[[Array], ArrayLike]

#: Instants at which derivatives are compared with differences.
_CHECKS = 97


@dataclass(frozen=True)
class Motion:
    """A prescribed coordinate c(t): value, velocity and acceleration.

    Each is a function of an array of times, shape (n,) [s], that returns an array of shape (n,) or
    a number. Velocity and acceleration are given, not differenced: the constraints on velocities
    and the initial accelerations use them, and a wrong one spoils the accuracy without any other
    sign. :meth:`check` finds it.
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

    @staticmethod
    def constant(value: float, name: str = "") -> Motion:
        """A coordinate that is held.

        Args:
            value: The constant [m or rad].
            name: Name for messages and plots.
        """
        return Motion.polynomial([value], name or f"constant {value:g}")

    @staticmethod
    def polynomial(coefficients: Sequence[float], name: str = "") -> Motion:
        """The polynomial sum_k c_k t^k.

        Args:
            coefficients: c_0, c_1, ...; (c_0, omega) is a uniform motion.
            name: Name for messages and plots.
        """
        p = np.polynomial.Polynomial(np.asarray(coefficients, dtype=np.float64))
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
            ValueError: If the duration is not positive.
        """
        if not duration > 0.0:
            raise ValueError(f"smooth_step: the duration must be positive, but it is {duration}")

        def s(t: Array) -> Array:
            return np.minimum(np.maximum((np.asarray(t) - start) / duration, 0.0), 1.0)

        def value(t: Array) -> Array:
            x = s(t)
            return distance * x**3 * (10.0 + x * (-15.0 + 6.0 * x))

        def velocity(t: Array) -> Array:
            x = s(t)
            return distance / duration * 30.0 * (x * (1.0 - x)) ** 2

        def acceleration(t: Array) -> Array:
            x = s(t)
            return distance / duration**2 * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)

        ends = (start, start + duration)
        return Motion(value, velocity, acceleration, name or "smooth step", ends)

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
            result = np.asarray(function(t), dtype=np.float64)
            if result.shape not in ((), t.shape):
                raise ValueError(
                    f"motion {self.name!r}: the {part} at {t.size} times has shape {result.shape}"
                )
            table[row] = result
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
    function = signal.value if isinstance(signal, Motion) else signal
    result = np.asarray(function(t) if callable(function) else function, dtype=np.float64)
    if result.shape not in ((), t.shape):
        raise ValueError(f"{what} at {t.size} times has shape {result.shape}")
    values = np.array(np.broadcast_to(result, t.shape))
    if not np.all(np.isfinite(values)):
        first = t[np.argmin(np.isfinite(values))]
        raise ValueError(f"{what} is NaN or infinite at t = {first:g} s")
    return values
