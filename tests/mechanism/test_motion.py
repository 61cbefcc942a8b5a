# SPDX-License-Identifier: MIT
"""Prescribed motions: exact derivatives, and refused ones."""

from __future__ import annotations

from dataclasses import replace

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


def pulse() -> Motion:
    """A pulse of a millisecond long after the start."""

    def values(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = (np.asarray(t) - 17.0) / 1e-3
        return x, np.exp(-(x**2))

    return Motion(
        lambda t: values(t)[1],
        lambda t: -2e3 * np.prod(values(t), axis=0),
        lambda t: 1e6 * (4.0 * values(t)[0] ** 2 - 2.0) * values(t)[1],
    )


def sawtooth() -> Motion:
    """A value that jumps every second, with a velocity that is held."""
    return Motion(lambda t: np.mod(t, 1.0), lambda t: 0.0 * t + 1.0, lambda t: 0.0 * t, "saw")


#: Motions with short or no changes in a long time, and oscillations that are much faster; others.
SCALES = [
    Motion.smooth_step(6.0, 1.0),
    Motion.smooth_step(6.0, 1.0, start=250.0),
    Motion.smooth_step(1e-3, 1e-4, start=0.3),
    Moving.circle((0.0, 0.0), 0.3, Motion.smooth_step(60.0, 1.0)).x,
    Motion(
        lambda t: np.sin(900.0 * t),
        lambda t: 900.0 * np.cos(900.0 * t),
        lambda t: -810000.0 * np.sin(900.0 * t),
    ),
    pulse(),
    sawtooth(),
    Motion(lambda t: np.abs(t - 1.0), lambda t: np.sign(t - 1.0), lambda t: 0.0 * t, "kink"),
    Motion.constant(3.0),
    Motion.polynomial([1.0, -2.0, 0.5, 3.0]),
    Moving.circle((1.0, 2.0), 0.3, Motion.smooth_step(20.0, 2.0)).x,
    Moving.circle((1.0, 2.0), 0.3, Motion.smooth_step(20.0, 2.0)).y,
]


@pytest.mark.parametrize("end", [2.0, 300.0, 1e5])
@pytest.mark.parametrize("motion", SCALES, ids=range(len(SCALES)))
def test_right_derivatives_pass_in_times_of_any_length(motion: Motion, end: float) -> None:
    motion.check(0.0, end)


@pytest.mark.parametrize("part", ["velocity", "acceleration"])
@pytest.mark.parametrize("motion", SCALES[:5], ids=range(5))
def test_wrong_derivatives_are_found_in_long_times(motion: Motion, part: str) -> None:
    right = getattr(motion, part)
    wrong = replace(motion, **{part: lambda t: 1.01 * np.asarray(right(t))})
    with pytest.raises(ValueError, match=f"{part} is not the derivative"):
        wrong.check(0.0, 300.0)


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
