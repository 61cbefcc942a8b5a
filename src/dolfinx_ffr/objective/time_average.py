# SPDX-License-Identifier: MIT
"""Integrals and power means over the time steps, and objectives that are such means.

They are taken by the trapezoidal rule, with the Radau IIA method by the weights of its stages,
which have its order. A window is integrated to its ends, also if these are within a step.
"""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from .. import validation
from ..arrays import Array
from ..dynamics import Trajectory, stage_integrals
from .base import Objective, Response

#: Round-off of the sum of earlier steps, as a part of a step
_ROUND_OFF = 1e-9


def check_window(what: str, window: tuple[float, float] | None) -> None:
    """Refuse a time window that is no interval (begin, end); None is the whole motion."""
    if window is None:
        return
    begin, end = validation.real_array(f"{what}: the window", window, (2,), expected="two times")
    if not begin < end:
        raise ValueError(
            f"{what}: the window must be (begin, end) with begin < end, but it is {window}"
        )


def time_weights(
    trajectory: Trajectory, window: tuple[float, float] | None = None, what: str = "objective"
) -> Array:
    """Weights of integrals over time, or over a window (begin, end), shape of the instants [s].

    A window may begin and end within a step: the integrand in this step is the polynomial through
    its stages, and with constant steps the line between its ends.
    """
    if window is None and trajectory.weights is not None:
        return trajectory.weights
    t, ends = trajectory.t, trajectory.step_ends
    begin, end = (t[0], t[-1]) if window is None else (max(window[0], t[0]), min(window[1], t[-1]))
    if not begin < end:
        raise ValueError(
            f"{what}: the window {window} s is outside of the motion, which goes from "
            f"{t[0]:g} s to {t[-1]:g} s"
        )
    h, weights = np.diff(ends), np.zeros_like(t)
    length = np.where(h > 0.0, h, 1.0)  # an instant behind a jump may follow at the same time
    low, high = (_share((limit - ends[:-1]) / length) for limit in (begin, end))
    if trajectory.weights is not None:
        weights[1:] = np.ravel(h[:, None] * (stage_integrals(high) - stage_integrals(low)))
        return weights
    covered, middle = h * (high - low), 0.5 * (high + low)
    weights[:-1] += covered * (1.0 - middle)
    weights[1:] += covered * middle
    return weights


def _share(place: Array) -> Array:
    """Places within steps, 0 and 1 their ends, of times before, in and after each step."""
    # ends of steps are sums: a window that ends there by round-off cuts no step
    rounded = np.round(place)
    return np.clip(np.where(np.abs(place - rounded) < _ROUND_OFF, rounded, place), 0.0, 1.0)


def power_mean(values: Array, weights: Array, power: float) -> tuple[float, Array]:
    """Power mean (sum_k weight_k c_k^p / sum_k weight_k)^(1/p) and its derivative by c, shape (n,).

    It lies between mean (p = 1) and maximum (p to infinity). Where all values, which are not
    negative, are zero, the mean has a kink, and the derivative is given as zero.
    """
    share = weights / np.sum(weights)
    # a value of weight zero may be so large that its power overflows
    values = np.where(share > 0.0, values, 0.0)
    largest = float(np.max(values))  # divided out, so that no power overflows
    if largest == 0.0:
        return 0.0, np.zeros_like(values)
    mean = largest * float(share @ (values / largest) ** power) ** (1.0 / power)
    return mean, share * (values / mean) ** (power - 1.0)


class MeanOverTime(Objective):
    """Power mean over time of a size, or its largest value.

    psi = (1/T int |s(t)|^p dt)^(1/p), or max |s(t)| of the instants with ``peak``. The instant of
    the peak may change with the design, so the derivatives of a peak are the derivatives of the
    power mean, times the ratio of the peak to the mean at the same design.
    """

    power: float  #: The power p, above 1
    window: tuple[float, float] | None  #: Begin and end of the time that counts [s]
    peak: bool  #: Whether it is the largest size instead of the mean

    def _check_mean(self, what: str) -> None:
        """Refuse wrong fields."""
        validation.number(f"{what}: the power", self.power, least=1.0)
        if self.power == 1.0:
            raise ValueError(
                f"{what}: with a power of 1 the mean has a kink where the size vanishes; take a "
                "larger power"
            )
        validation.flag(f"{what}: peak", self.peak)
        check_window(what, self.window)

    @abstractmethod
    def _sizes(self, response: Response) -> tuple[Array, Array]:
        """Sizes, which are not negative, and weights of the instants, shape (steps + 1,) each."""

    def _sizes_bar(self, response: Response) -> Array:
        """Derivative of the number by the sizes, shape (steps + 1,)."""
        mean, slopes = power_mean(*self._sizes(response), self.power)
        return slopes * (self.largest(response) / mean) if self.peak and mean > 0.0 else slopes

    def evaluate(self, response: Response) -> float:
        if self.peak:
            return self.largest(response)
        return power_mean(*self._sizes(response), self.power)[0]

    def largest(self, response: Response) -> float:
        """The largest size of the instants that count at a ``response``, in the unit of psi."""
        sizes, weights = self._sizes(response)
        return float(np.max(sizes[weights > 0.0]))
