# SPDX-License-Identifier: MIT
"""The tests of derivatives must themselves tell right from wrong."""

from __future__ import annotations

import numpy as np
import pytest

from dolfinx_ffr.verification import (
    TaylorResult,
    assert_taylor_order,
    convergence_order,
    taylor_test,
)

X = np.array([[0.3, 1.2], [0.7, -0.4]])
D = np.array([[1.0, -0.5], [0.25, 2.0]])


def function(x: np.ndarray) -> float:
    return float(np.sum(np.sin(x) * x**2))


def gradient(x: np.ndarray) -> np.ndarray:
    return np.cos(x) * x**2 + 2.0 * np.sin(x) * x


def taylor(error: float = 0.0, **steps: tuple[float, ...]) -> TaylorResult:
    """Taylor's test of the function with a gradient that is off by an error."""
    return taylor_test(function, lambda d: float(np.sum((gradient(X) + error) * d)), X, D, **steps)


def test_right_gradient_has_order_two() -> None:
    assert taylor().order == pytest.approx(2.0, abs=0.05)
    assert_taylor_order(taylor())


@pytest.mark.parametrize("error", [1.0, 1e-3])
def test_wrong_gradient_is_found(error: float) -> None:
    with pytest.raises(AssertionError, match="Taylor order"):
        assert_taylor_order(taylor(error))


def test_linear_function_passes_and_wrong_slope_does_not() -> None:
    assert_taylor_order(taylor_test(lambda x: float(3.0 * x), lambda d: 3.0 * float(d), 1.0, 1.0))
    wrong = taylor_test(lambda x: float(3.0 * x), lambda d: 2.0 * float(d), 1.0, 1.0)
    with pytest.raises(AssertionError, match=r"below 1\.9"):
        assert_taylor_order(wrong)


def test_remainders_in_the_noise_are_not_taken_for_an_answer() -> None:
    with pytest.raises(AssertionError, match="stand clear of round-off"):
        assert_taylor_order(taylor(steps=(1e-8, 1e-9, 1e-10)))


def test_convergence_order() -> None:
    h = np.array([0.4, 0.2, 0.1])
    assert convergence_order(h, 7.0 * h**3) == pytest.approx(3.0, abs=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: taylor_test(function, lambda d: 0.0, X, D[0]), "direction has shape"),
        (lambda: taylor(steps=(1e-3, 1e-2)), "the largest first"),
        (lambda: taylor_test(lambda x: np.nan, lambda d: 0.0, X, D), "NaN or infinite"),
        (lambda: convergence_order([1.0], [1.0]), "at least two"),
        (lambda: convergence_order([1.0, 0.5], [1.0, 0.0]), "must be positive"),
    ],
)
def test_refused(call, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()
