# SPDX-License-Identifier: MIT
"""Prescribed motions: exact derivatives, and refused ones."""

from __future__ import annotations

import numpy as np
import pytest

from dolfinx_ffr.mechanism import Moving
from dolfinx_ffr.mechanism.motion import Motion


def test_smooth_step_rests_at_both_ends_and_holds() -> None:
    motion = Motion.smooth_step(3.0, 2.0, start=0.5)
    table = motion.tabulate([0.0, 0.5, 1.5, 2.5, 4.0])
    np.testing.assert_allclose(table[0], [0.0, 0.0, 1.5, 3.0, 3.0], rtol=1e-15)
    np.testing.assert_allclose(table[1], [0.0, 0.0, 1.875 * 3.0 / 2.0, 0.0, 0.0], rtol=1e-15)
    np.testing.assert_allclose(table[2], 0.0, atol=1e-15)


@pytest.mark.parametrize(
    "motion",
    [
        Motion.constant(3.0),
        Motion.polynomial([1.0, -2.0, 0.5, 3.0]),
        Motion.smooth_step(7.0, 1.3),
        Moving.circle((1.0, 2.0), 0.3, Motion.smooth_step(20.0, 2.0)).x,
        Moving.circle((1.0, 2.0), 0.3, Motion.smooth_step(20.0, 2.0)).y,
        Motion(
            lambda t: np.sin(900.0 * t),
            lambda t: 900.0 * np.cos(900.0 * t),
            lambda t: -810000.0 * np.sin(900.0 * t),
        ),
    ],
)
def test_right_derivatives_pass(motion: Motion) -> None:
    motion.check(0.0, 2.0)


def test_jumps_are_known() -> None:
    step = Motion.smooth_step(3.0, 2.0, start=0.5)
    assert step.jumps == (0.5, 2.5)
    assert Moving.circle((0.0, 0.0), 1.0, step).y.jumps == step.jumps
    assert Motion.polynomial([1.0, 2.0]).jumps == ()


def test_circle_stays_on_the_circle() -> None:
    pin = Moving.circle((0.1, -0.2), 0.3, Motion.polynomial([0.3, 2.0, 5.0]))
    t = np.linspace(0.0, 1.0, 11)
    x, y = pin.x.tabulate(t), pin.y.tabulate(t)
    np.testing.assert_allclose(np.hypot(x[0] - 0.1, y[0] + 0.2), 0.3, rtol=1e-14)
    np.testing.assert_allclose(np.hypot(x[1], y[1]), 0.3 * (2.0 + 10.0 * t), rtol=1e-14)
    np.testing.assert_allclose(x[0, 0], 0.1 + 0.3 * np.cos(0.3), rtol=1e-15)
    np.testing.assert_allclose(y[0, 0], -0.2 + 0.3 * np.sin(0.3), rtol=1e-15)


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (
            Motion(np.sin, lambda t: -np.cos(t), lambda t: -np.sin(t), "swing"),
            "motion 'swing': the velocity is not the derivative of the value: at t = .* s it is",
        ),
        (
            Motion(np.sin, np.cos, np.sin, "swing"),
            "motion 'swing': the acceleration is not the derivative of the velocity",
        ),
        (
            Motion(np.sin, lambda t: 1.01 * np.cos(t), lambda t: -1.01 * np.sin(t), "swing"),
            "the velocity is not the derivative of the value",
        ),
        (
            Motion(lambda t: np.where(t < 1.0, t, np.nan), lambda t: 1.0, lambda t: 0.0, "gap"),
            "motion 'gap': the value is NaN or infinite at t = 1",
        ),
        (Motion(lambda t: t[:-1], lambda t: 1.0, lambda t: 0.0, "short"), "has shape"),
    ],
)
def test_refused(motion: Motion, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        motion.check(0.0, 2.0)


def test_smooth_step_needs_a_duration() -> None:
    with pytest.raises(ValueError, match="duration must be positive, but it is 0"):
        Motion.smooth_step(1.0, 0.0)
