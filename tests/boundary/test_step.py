# SPDX-License-Identifier: MIT
"""The step of a boundary beside a general optimiser."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.sparse import csc_matrix, csr_matrix, diags

from dolfinx_ffr.boundary.step import best_step


@pytest.mark.parametrize(("kind", "error"), [(np.asarray, 1e-5), (csr_matrix, 1e-3)])
@pytest.mark.parametrize("seed", range(4))
def test_the_step_is_the_minimum_within_the_constraints(
    seed: int, kind: Callable[[np.ndarray], Any], error: float
) -> None:
    """Of a few constraints exactly, of many, with sparse slopes, by iterations."""
    random = np.random.default_rng(seed)
    n, m = 12, 5
    metric = csc_matrix(diags([-1.0, 3.0, -1.0], [-1, 0, 1], shape=(n, n)))
    gradient, slopes = random.standard_normal(n), random.standard_normal((m, n))
    values = random.uniform(-0.5, 0.2, m)
    held = np.arange(n) == 0
    found = best_step(metric, gradient, values, kind(slopes), held, 0.3)
    assert np.max(np.abs(found.offsets)) <= 0.45 + 1e-12
    assert found.offsets[0] == 0.0
    assert np.min(found.multipliers) >= 0.0

    def cost(a: np.ndarray) -> float:
        return float(0.5 * a @ (metric @ a) + found.weight * gradient @ a)

    best = minimize(
        cost,
        np.zeros(n),
        jac=lambda a: metric @ a + found.weight * gradient,
        constraints=[
            {"type": "ineq", "fun": lambda a: -values - slopes @ a, "jac": lambda a: -slopes},
            {"type": "eq", "fun": lambda a: a[:1], "jac": lambda a: np.eye(n)[:1]},
        ],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert best.success
    assert np.max(values + slopes @ found.offsets) < 0.1 * error
    assert np.max(np.abs(found.offsets - best.x)) < error


def test_without_constraints_it_is_steepest_descent_in_the_metric() -> None:
    metric = csc_matrix(diags([1.0, 2.0, 4.0]))
    nothing = np.zeros(0), np.zeros((0, 3))
    found = best_step(metric, np.array([1.0, -1.0, 1.0]), *nothing, np.zeros(3, dtype=bool), 0.1)
    assert found.offsets == pytest.approx([-0.1, 0.05, -0.025])
