# SPDX-License-Identifier: MIT
"""The step of a boundary beside a general optimiser."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.sparse import csc_matrix, csr_matrix, diags

from dolfinx_ffr.boundary.curve import FreeCurve
from dolfinx_ffr.boundary.spread import _evened
from dolfinx_ffr.boundary.step import best_step, curvature, secants


@pytest.mark.parametrize(
    ("kind", "known", "error"),
    [(np.asarray, 0, 1e-5), (np.asarray, 3, 1e-5), (csr_matrix, 0, 1e-3), (csr_matrix, 3, 1e-3)],
)
@pytest.mark.parametrize("seed", range(2))
def test_the_step_is_the_minimum_within_the_constraints(
    seed: int, kind: Callable[[np.ndarray], Any], known: int, error: float
) -> None:
    """Of a few constraints exactly, of many, with sparse slopes, by iterations."""
    random = np.random.default_rng(seed)
    n, m = 12, 5
    metric = csc_matrix(diags([-1.0, 3.0, -1.0], [-1, 0, 1], shape=(n, n)))
    gradient, slopes = random.standard_normal(n), random.standard_normal((m, n))
    values = random.uniform(-0.5, 0.2, m)
    fixed = np.arange(n) == 0
    curved = random.standard_normal((n, known))
    computed = best_step(metric, gradient, values, kind(slopes), fixed, 0.3, curved)
    whole = metric.toarray() + computed.weight * curved @ curved.T
    assert np.max(np.abs(computed.offsets)) <= 0.45 + 1e-12
    assert computed.offsets[0] == 0.0
    assert np.min(computed.multipliers) >= 0.0
    fall = -gradient @ computed.offsets - 0.5 * np.sum((computed.offsets @ curved) ** 2)
    assert computed.promised == pytest.approx(fall, rel=1e-12)

    def cost(a: np.ndarray) -> float:
        return float(0.5 * a @ (whole @ a) + computed.weight * gradient @ a)

    best = minimize(
        cost,
        np.zeros(n),
        jac=lambda a: whole @ a + computed.weight * gradient,
        constraints=[
            {"type": "ineq", "fun": lambda a: -values - slopes @ a, "jac": lambda a: -slopes},
            {"type": "eq", "fun": lambda a: a[:1], "jac": lambda a: np.eye(n)[:1]},
        ],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert best.success
    assert np.max(values + slopes @ computed.offsets) < 0.1 * error
    assert np.max(np.abs(computed.offsets - best.x)) < error


@pytest.mark.parametrize("kind", [np.asarray, csr_matrix])
@pytest.mark.parametrize("rows", [[[0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]])
def test_constraints_without_a_slope_cost_nothing(
    rows: list[list[float]], kind: Callable[[np.ndarray], Any]
) -> None:
    """They are violated whatever the step is: it is that of the others alone."""
    metric, gradient = csc_matrix(diags([2.0, 2.0])), np.ones(2)
    values = np.array([0.1, -0.05])[: len(rows)]
    fixed = np.zeros(2, dtype=bool)
    computed = best_step(metric, gradient, values, kind(np.array(rows)), fixed, 0.3)
    alone = best_step(metric, gradient, values[1:], kind(np.array(rows)[1:]), fixed, 0.3)
    np.testing.assert_allclose(computed.offsets, alone.offsets)
    np.testing.assert_allclose(computed.multipliers, [0.0, *alone.multipliers])


def test_steps_tell_the_curvature_along_them() -> None:
    """Of a quadratic form it is exact there, and nowhere more than it; what is negative is left."""
    random = np.random.default_rng(0)
    bends = random.standard_normal((6, 6))
    form, metric, known = (
        bends @ bends.T,
        csc_matrix(diags(np.arange(1.0, 7.0))),
        np.zeros((2, 0, 0)),
    )
    x = random.standard_normal(6)
    for move in random.standard_normal((3, 6)):
        known, x = secants(known, move, form @ x), x + move
        computed = curvature(metric, known, form @ x)
        assert computed.shape == (6, known.shape[1])
        assert computed @ computed.T @ move == pytest.approx(form @ move)
        assert np.min(np.linalg.eigvalsh(form - computed @ computed.T)) > -1e-9
    assert curvature(metric, secants(known[:, :0], move, form @ x), form @ (x - move)).size == 0
    assert curvature(metric, secants(known[:, :0], 0.0 * move, x), form @ x).size == 0
    for _ in range(9):
        known = secants(known, move, x)
    assert known.shape == (2, 8, 6)


def test_steps_that_know_the_curvature_go_along_a_narrow_valley() -> None:
    """Of two directions one is a hundred times as steep: without it they go across."""
    metric, curvatures, left = csc_matrix(np.eye(2)), np.array([100.0, 1.0]), []
    nothing = np.zeros(0), np.zeros((0, 2)), np.zeros(2, dtype=bool)
    for learns in (False, True):
        x, known = np.array([0.5, 10.0]), np.zeros((2, 0, 0))
        for _ in range(20):
            gradient = curvatures * x
            step = best_step(metric, gradient, *nothing, 0.4, curvature(metric, known, gradient))
            known = secants(known, step.offsets, gradient) if learns else known
            x = x + step.offsets
        left.append(float(curvatures @ x**2))
    assert left[1] < 0.2 * left[0], left


def test_controls_of_a_curve_become_even_and_its_area_stays() -> None:
    angle = 2.0 * np.pi * np.arange(40) / 40
    uneven = angle + 0.02 * np.where(np.arange(40) % 2, -1.0, 1.0)
    even = _evened(FreeCurve(np.column_stack([np.cos(uneven), np.sin(uneven)])))
    assert np.diff(np.unwrap(np.arctan2(*even.control.T[::-1]))) == pytest.approx(0.157, abs=1e-3)
