# SPDX-License-Identifier: MIT
"""Integral compliance: value, pullback at fixed trajectory, refused names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate
from scenes import Bodies, four_bar

from dolfinx_ffr.dynamics import Trajectory, simulate
from dolfinx_ffr.objective import IntegralCompliance
from dolfinx_ffr.verification import assert_taylor_order, taylor_test


@pytest.fixture(scope="module")
def motion() -> tuple[Trajectory, Bodies]:
    scene = four_bar(steps=60)
    return simulate(scene.mechanism, scene.bodies, scene.integrator), scene.bodies


def test_is_twice_the_integral_of_the_strain_energy(motion: tuple[Trajectory, Bodies]) -> None:
    trajectory, bodies = motion
    expected = {
        name: 2.0 * scipy.integrate.trapezoid(trajectory.strain_energy(name), trajectory.t)
        for name in bodies
    }
    assert expected["coupler"] > 0.0
    for name in bodies:
        value = IntegralCompliance([name]).value(trajectory, bodies)
        assert value == pytest.approx(expected[name], rel=1e-13)
    total = IntegralCompliance().value(trajectory, bodies)
    assert total == pytest.approx(sum(expected.values()), rel=1e-13)
    weighted = IntegralCompliance(weights={"coupler": 3.0}).value(trajectory, bodies)
    assert weighted == pytest.approx(total + 2.0 * expected["coupler"], rel=1e-13)


def test_pullback_at_fixed_integrals(motion: tuple[Trajectory, Bodies]) -> None:
    trajectory, bodies = motion
    objective = IntegralCompliance(weights={"rocker": 0.5})
    bar, _ = objective.pullback(trajectory, bodies)
    for part in (bar.v, bar.w, bar.multipliers):
        np.testing.assert_array_equal(part, 0.0)
    direction = np.random.default_rng(0).normal(size=trajectory.y.shape) * trajectory.y.std(axis=0)
    result = taylor_test(
        lambda y: objective.value(replace(trajectory, y=y), bodies),
        lambda d: float(np.sum(bar.y * d)),
        trajectory.y,
        direction,
        steps=[0.5 / 2.0**k for k in range(5)],
    )
    assert_taylor_order(result)


def test_pullback_at_fixed_trajectory(motion: tuple[Trajectory, Bodies]) -> None:
    trajectory, bodies = motion
    objective = IntegralCompliance(["coupler"])
    _, explicit = objective.pullback(trajectory, bodies)
    assert not explicit["rocker"].K.any()
    # The value is linear in K.
    doubled = {**bodies, "coupler": replace(bodies["coupler"], K=2.0 * bodies["coupler"].K)}
    growth = objective.value(trajectory, doubled) - objective.value(trajectory, bodies)
    slope = float(np.sum(explicit["coupler"].K * bodies["coupler"].K))
    assert growth == pytest.approx(slope, rel=1e-13)


@pytest.mark.parametrize(
    ("objective", "message"),
    [
        (IntegralCompliance(["rod"]), r"of body 'rod', but the bodies are \['crank', 'coupler'"),
        (IntegralCompliance(weights={"rod": 1.0}), "of body 'rod', but the bodies are"),
    ],
)
def test_unknown_body(
    motion: tuple[Trajectory, Bodies], objective: IntegralCompliance, message: str
) -> None:
    trajectory, bodies = motion
    with pytest.raises(ValueError, match=message):
        objective.value(trajectory, bodies)
    with pytest.raises(ValueError, match=message):
        objective.pullback(trajectory, bodies)


def test_weight_must_be_a_number() -> None:
    with pytest.raises(ValueError, match="weight of body 'rod' is nan"):
        IntegralCompliance(weights={"rod": float("nan")})
