# SPDX-License-Identifier: MIT
"""Integrals and power means over the time steps.

By the trapezoidal rule; with the Radau IIA method by the weights of its stages, which have its
order, and where a window cuts a step, by the integral of the polynomial through the stages.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import validation
from ..dynamics import Trajectory, stage_integrals

__all__ = ["check_window", "power_mean", "time_weights", "trapezoidal_weights"]

Array = NDArray[np.float64]


def check_window(what: str, window: tuple[float, float] | None) -> None:
    """Refuse a time window that is not an interval.

    Args:
        what: Name of the objective, for the message.
        window: Begin and end [s]; None stands for the whole motion.
    """
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
    """Weights of integrals over time, one for each instant of a trajectory [s].

    Args:
        trajectory: Result of the simulation.
        window: Begin and end of the time that counts [s]; None takes all. With constant steps it
            is that of the steps inside.
        what: Name of the objective, for the message.

    Raises:
        ValueError: If fewer than two times lie in the window.
    """
    if trajectory.weights is None:
        return trapezoidal_weights(trajectory.t, window, what)
    if window is None:
        return trajectory.weights
    ends = trajectory.step_ends
    begin, end = max(window[0], ends[0]), min(window[1], ends[-1])
    if not begin < end:
        raise ValueError(
            f"{what}: the window {window} s is outside of the motion, which goes from "
            f"{ends[0]:g} s to {ends[-1]:g} s"
        )
    h = np.diff(ends)
    low = np.clip((begin - ends[:-1]) / h, 0.0, 1.0)
    high = np.clip((end - ends[:-1]) / h, 0.0, 1.0)
    weights = np.zeros_like(trajectory.t)
    weights[1:] = np.ravel(h[:, None] * (stage_integrals(high) - stage_integrals(low)))
    return weights


def trapezoidal_weights(
    t: Array, window: tuple[float, float] | None = None, what: str = "objective"
) -> Array:
    """Weights of the trapezoidal rule at times t, shape of t [s].

    Args:
        t: Times, shape (n,) [s].
        window: Begin and end of the time that counts [s]: of the steps inside; None takes all.
        what: Name of the objective, for the message.

    Raises:
        ValueError: If fewer than two times lie in the window.
    """
    first, last = 0, t.size
    if window is not None:
        # Times are sums of steps: one that round-off has put outside still counts.
        slack = 1e-9 * (t[-1] - t[0])
        first = int(np.searchsorted(t, window[0] - slack))
        last = int(np.searchsorted(t, window[1] + slack, "right"))
        if last - first < 2:
            raise ValueError(
                f"{what}: fewer than two time steps lie in the window {window} s; the motion goes "
                f"from {t[0]:g} s to {t[-1]:g} s in {t.size - 1} steps"
            )
    weights = np.zeros_like(t)
    steps = 0.5 * np.diff(t[first:last])
    weights[first : last - 1] += steps
    weights[first + 1 : last] += steps
    return weights


def power_mean(values: Array, weights: Array, power: float) -> tuple[float, Array]:
    """Power mean (sum_k weight_k c_k^p / sum_k weight_k)^(1/p) and its derivative.

    It lies between mean (p = 1) and maximum (p to infinity). The largest value is divided out
    first, so that no power overflows.

    Args:
        values: Values c_k that are not negative, shape (n,).
        weights: Weights, shape (n,).
        power: The power p, at least 1.

    Returns:
        The mean and its derivative with respect to each value, shape (n,); zero where all values
        are zero, where the mean of a power has a kink.
    """
    share = weights / np.sum(weights)
    # What does not count may be so large that its power overflows.
    values = np.where(share > 0.0, values, 0.0)
    largest = float(np.max(values))
    if largest == 0.0:
        return 0.0, np.zeros_like(values)
    mean = largest * float(share @ (values / largest) ** power) ** (1.0 / power)
    return mean, share * (values / mean) ** (power - 1.0)
