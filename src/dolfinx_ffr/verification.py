# SPDX-License-Identifier: MIT
"""Taylor tests of derivatives and observed orders of convergence.

For a function with derivative g, the remainder

    R(s) = f(x + s d) - f(x) - s g.d

falls like s^2 as the step s is halved; with a wrong derivative it falls like s. So the observed
order is a direct test of a pullback, and needs no tolerance.

Under MPI ``function`` returns the same number on every rank, and ``gradient_dot`` the inner product
summed over the ranks; all ranks call the tests with their own part of ``x`` and ``direction``.

Example:
    >>> import numpy as np
    >>> x, d = np.array([1.0, 2.0]), np.array([0.3, -0.4])
    >>> result = taylor_test(lambda x: float(np.sum(x**4)), lambda d: float(4 * x**3 @ d), x, d)
    >>> assert_taylor_order(result)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array

#: Steps of :func:`taylor_test` where none are given: four halvings.
DEFAULT_STEPS: tuple[float, ...] = tuple(1e-2 / 2.0**k for k in range(5))


@dataclass(frozen=True)
class TaylorResult:
    """Outcome of a Taylor test.

    Attributes:
        steps: Steps s, shape (n,).
        remainders: |f(x + s d) - f(x) - s g.d| at each step, shape (n,).
        differences: |f(x + s d) - f(x)| at each step, shape (n,).
        orders: Observed order of the remainder between consecutive steps, shape (n - 1,).
        order: Order of the remainder by a least-squares fit through all steps above round-off.
        usable: Number of steps whose remainder stands clear of round-off.
        value: Value at x.
        slope: Directional derivative g.d.
    """

    steps: Array
    remainders: Array
    differences: Array
    orders: Array
    order: float
    usable: int
    value: float
    slope: float

    def __str__(self) -> str:
        lines = ["      step     difference      remainder   order"]
        for k, step in enumerate(self.steps):
            order = f"{self.orders[k - 1]:7.3f}" if k else "      -"
            lines.append(
                f"{step:10.3e}   {self.differences[k]:12.5e}   {self.remainders[k]:12.5e} {order}"
            )
        return "\n".join([*lines, f"order {self.order:.3f} from {self.usable} steps"])


def taylor_test(
    function: Callable[[Array], float],
    gradient_dot: Callable[[Array], float],
    x: ArrayLike,
    direction: ArrayLike,
    *,
    steps: Sequence[float] = DEFAULT_STEPS,
    roundoff: float = 1e-14,
) -> TaylorResult:
    """Remainders of the first-order Taylor expansion and their observed orders.

    Args:
        function: The number f(x); the same on all ranks.
        gradient_dot: The derivative of f at ``x`` in a direction, summed over all ranks.
        x: Point of expansion, any shape; under MPI the part owned by this rank.
        direction: Direction d, shape of ``x``.
        steps: Steps s, largest first.
        roundoff: Relative accuracy of f. Remainders below a hundred times this share of the
            largest value are left out of the fit.

    Returns:
        The order is about 2 for a right derivative, about 1 for a wrong one, infinite where the
        remainder vanishes to round-off at all steps (a linear function), and NaN where too few
        remainders stand clear of round-off to tell.
    """
    point = np.asarray(x, dtype=np.float64)
    d = np.asarray(direction, dtype=np.float64)
    s = np.asarray(steps, dtype=np.float64)
    if d.shape != point.shape:
        raise ValueError(f"direction has shape {d.shape}, but the point has shape {point.shape}")
    if s.ndim != 1 or s.size < 2 or np.any(s <= 0.0) or np.any(np.diff(s) >= 0.0):
        raise ValueError("steps must be at least two positive numbers, the largest first")
    value = float(function(point))
    slope = float(gradient_dot(d))
    values = np.array([float(function(point + step * d)) for step in s])
    if not np.all(np.isfinite(values)) or not np.isfinite(value) or not np.isfinite(slope):
        raise ValueError("the function or its derivative is NaN or infinite near the point")
    remainders = np.abs(values - value - s * slope)
    noise = 100.0 * roundoff * max(abs(value), float(np.max(np.abs(values))))
    clear = remainders > noise
    # Only the leading run counts: beyond the first remainder in the noise all are noise.
    usable = int(s.size if clear.all() else np.argmin(clear))
    tiny = np.finfo(float).tiny
    orders = np.diff(np.log(np.maximum(remainders, tiny))) / np.diff(np.log(s))
    differences = np.abs(values - value)
    if usable >= 2:
        order = convergence_order(s[:usable], remainders[:usable])
    else:
        linear = usable == 0 and differences[0] > 1e6 * noise
        order = float("inf") if linear else float("nan")
    return TaylorResult(s, remainders, differences, orders, order, usable, value, slope)


def assert_taylor_order(result: TaylorResult, minimum: float = 1.9, points: int = 3) -> None:
    """Assert that the remainder falls with at least the given order.

    Args:
        result: Outcome of :func:`taylor_test`.
        minimum: Least order of the fit and of each pair of consecutive usable steps.
        points: Least number of steps that stand clear of round-off.

    Raises:
        AssertionError: With the table of remainders, if orders are too small or steps too few.
    """
    if np.isinf(result.order):
        return
    if result.usable < points:
        raise AssertionError(
            f"only {result.usable} of {result.steps.size} remainders stand clear of round-off, "
            f"{points} are needed; take larger steps\n{result}"
        )
    worst = min(result.order, float(np.min(result.orders[: result.usable - 1])))
    if not worst >= minimum:
        raise AssertionError(f"Taylor order {worst:.3f} is below {minimum}\n{result}")


def convergence_order(h: ArrayLike, errors: ArrayLike) -> float:
    """The order p for which C h^p fits the ``errors`` best, by least squares of the logarithms.

    The sizes ``h`` and the ``errors`` have the shape (n,).
    """
    x, y = np.asarray(h, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    if x.shape != y.shape or x.ndim != 1 or x.size < 2:
        raise ValueError("a fit needs as many errors as sizes, and at least two")
    if not (np.all(x > 0.0) and np.all(y > 0.0)):
        raise ValueError("sizes and errors must be positive")
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])
