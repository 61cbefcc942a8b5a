# SPDX-License-Identifier: MIT
"""The bare method of moving asymptotes, on published problems and beside another method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from dolfinx_ffr.optimization.moving_asymptotes import Asymptotes, Secants, _Subproblem
from dolfinx_ffr.verification import convergence_order

#: Values f_0 ... f_m and their gradients, shape (1 + m, n)
Functions = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def cantilever(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weight of a beam of five hollow boxes, and its tip's deflection (Svanberg 1987, 5.1)."""
    c = np.array([61.0, 37.0, 19.0, 7.0, 1.0])
    values = [0.0624 * x.sum(), np.sum(c / x**3) - 1.0]
    return np.array(values), np.array([np.full(5, 0.0624), -3.0 * c / x**4])


def spheres(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The point of two intersecting balls that is nearest to the origin."""
    centers = np.array([[0.0, 0.0, 0.0], [5.0, 2.0, 1.0], [3.0, 4.0, 3.0]])
    away = x - centers
    return np.sum(away**2, axis=1) - [0.0, 9.0, 9.0], 2.0 * away


def run(
    functions: Functions, start: list[float], low: float, high: float, steps: int, **options: float
) -> tuple[np.ndarray, np.ndarray]:
    """Variables and multipliers after some steps."""
    x = np.array(start)
    state = Asymptotes(np.full(len(x), low), np.full(len(x), high), x, **options)
    multipliers = np.zeros(0)
    for _ in range(steps):
        values, slopes = functions(state.x)
        state, multipliers = state.step(slopes[0], values[1:], slopes[1:])
    return state.x, multipliers


def test_cantilever_of_five_boxes() -> None:
    """The published optimum; all sections matter, and the constraint is active."""
    x, multipliers = run(cantilever, [5.0] * 5, 1.0, 10.0, 30, move=1.0)
    assert x == pytest.approx([6.016, 5.309, 4.494, 3.502, 2.153], abs=2e-3)
    values = cantilever(x)[0]
    assert values[0] == pytest.approx(1.340, abs=5e-4)
    assert values[1] == pytest.approx(0.0, abs=1e-6)
    # the optimum scales as c^(1/4): the multiplier is a third of the weight
    assert multipliers == pytest.approx([values[0] / 3.0], rel=1e-3)


def test_several_active_constraints_beside_another_method() -> None:
    """SLSQP finds the same, and the multipliers fulfil the conditions of Karush and others."""
    start = [4.0, 3.0, 2.0]
    x, multipliers = run(spheres, start, 0.0, 5.0, 60, move=0.3)
    result = minimize(
        lambda y: spheres(y)[0][0],
        start,
        method="SLSQP",
        bounds=[(0.0, 5.0)] * 3,
        constraints=[{"type": "ineq", "fun": lambda y: -spheres(y)[0][1:]}],
        options={"ftol": 1e-14},
    )
    assert x == pytest.approx(result.x, abs=1e-4)
    values, slopes = spheres(x)
    assert values[1:] == pytest.approx([0.0, 0.0], abs=1e-4)
    assert np.all(multipliers > 0.1)
    assert slopes[0] + multipliers @ slopes[1:] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("together", [True, False])
def test_constraints_that_cannot_be_met_are_violated_least(together: bool) -> None:
    """One that is out of reach draws to the bound, two that contradict each other in between."""

    def functions(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if together:  # x <= 0.2 and x >= 0.6
            return np.array([-x[0], x[0] - 0.2, 0.6 - x[0]]), np.array([[-1.0], [1.0], [-1.0]])
        return np.array([x[0], 2.0 - x[0]]), np.array([[1.0], [-1.0]])

    x, multipliers = run(functions, [0.1], 0.0, 1.0, 30)
    violation = np.maximum(functions(x)[0][1:], 0.0).sum()
    assert violation == pytest.approx(0.4 if together else 1.0, abs=1e-3)
    assert np.all(multipliers > 100.0)


def test_without_constraints_and_without_a_slope() -> None:
    """Downhill to the bounds; where there is no slope nothing moves."""
    slope = np.array([1.0, -2.0, 0.0])
    state = Asymptotes(np.zeros(3), np.ones(3), np.full(3, 0.5))
    for _ in range(10):
        state, multipliers = state.step(slope, np.zeros(0), np.zeros((0, 3)))
    assert state.x == pytest.approx([0.0, 1.0, 0.5]) and len(multipliers) == 0
    flat, _ = Asymptotes(np.zeros(2), np.ones(2), np.array([0.3, 0.6])).step(
        np.zeros(2), np.zeros(0), np.zeros((0, 2))
    )
    assert flat.x.tolist() == [0.3, 0.6]


def test_steps_keep_the_move_limit_and_a_retreat_halves_it() -> None:
    state = Asymptotes(np.zeros(3), np.full(3, 2.0), np.ones(3), 0.1)
    slope = np.array([1.0, -1.0, 1e-3])
    for _ in range(3):
        tried, _ = state.step(slope, np.zeros(0), np.zeros((0, 3)))
        assert np.max(np.abs(tried.x - state.x)) == pytest.approx(0.2)
        kept, state = state, tried
    back = state.retreat(kept)
    assert back.x is kept.x and back.move == 0.05
    again, _ = back.step(slope, np.zeros(0), np.zeros((0, 3)))
    assert np.max(np.abs(again.x - back.x)) == pytest.approx(0.1)
    assert again.reach == pytest.approx(0.5 * state.reach)


def test_largest_of_several_functions() -> None:
    """The smallest circle around points: its radius is the least largest distance from a centre.

    Around a triangle with acute angles that is the circumscribed circle; a point inside of it, and
    a wide angle, whose longest side is a diameter, leave a distance that does not count.
    """
    for points, center in (
        ([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0]], [2.0, 1.0]),
        ([[0.0, 0.0], [4.0, 0.0], [1.0, 3.0], [2.0, 0.5]], [2.0, 1.0]),
        ([[0.0, 0.0], [4.0, 0.0], [1.0, 0.5]], [2.0, 0.0]),
    ):
        away = np.array(points)
        state = Asymptotes(np.full(2, -5.0), np.full(2, 5.0), np.array([-3.0, 4.0]))
        for _ in range(60):
            distances = state.x - away
            squares = np.sum(distances**2, axis=1)
            scale = np.max(squares)
            state, multipliers = state.step(
                np.zeros(2), squares / scale, 2.0 * distances / scale, bounded=len(away)
            )
        np.testing.assert_allclose(state.x, center, atol=1e-5)
        # the centre is the mean of the points that count, with their multipliers as weights
        assert np.sum(multipliers) == pytest.approx(1.0, abs=1e-6)
        np.testing.assert_allclose(multipliers @ away, center, atol=1e-4)


def test_largest_function_below_a_constraint() -> None:
    """Min max(x, -x) + y such that x y >= 1; with x and y above zero that is x = y = 1."""
    state = Asymptotes(np.full(2, 0.1), np.full(2, 5.0), np.array([3.0, 0.7]))
    for _ in range(60):
        x, y = state.x
        state, multipliers = state.step(
            np.array([0.0, 1.0]),
            np.array([x, -x, 1.0 - x * y]),
            np.array([[1.0, 0.0], [-1.0, 0.0], [-y, -x]]),
            bounded=2,
        )
    np.testing.assert_allclose(state.x, [1.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(multipliers, [1.0, 0.0, 1.0], atol=1e-5)


def test_a_dual_at_round_off_takes_no_more_evaluations(monkeypatch: pytest.MonkeyPatch) -> None:
    """One constraint of many variables: Newton ends by the gradient once the dual stands still."""
    taken = []
    dual = _Subproblem._dual

    def counted(self: _Subproblem, *arguments: np.ndarray) -> tuple[float, np.ndarray]:
        taken.append(1)
        return dual(self, *arguments)

    monkeypatch.setattr(_Subproblem, "_dual", counted)
    rng, n = np.random.default_rng(3), 2000
    for _ in range(20):
        slope, slopes = -rng.uniform(size=n), np.full((1, n), 1.0 / n)
        state = Asymptotes(np.zeros(n), np.ones(n), np.full(n, 0.5))
        after, _ = state.step(slope, np.array([rng.uniform(-0.02, 0.02)]), slopes)
        assert np.all(np.isfinite(after.x))
    assert len(taken) < 20 * 60


def test_secants_are_the_second_derivatives_of_separable_functions() -> None:
    """By each variable that has changed; the others keep theirs, and one that falls does slowly."""
    first, second = np.array([1.0, 2.0, 3.0]), np.array([1.5, 2.0, 2.5])
    secants = Secants.begin(first, first[None] ** 2).next(second, second[None] ** 2)
    assert secants.curvature == pytest.approx(np.array([[2.5, 0.0, 5.5]]))
    third = np.array([2.0, 2.5, 2.0])
    linear = secants.gradients + np.array([[0.0, 1.0, 0.0]])
    assert secants.next(third, linear).curvature == pytest.approx(np.array([[1.25, 2.0, 2.75]]))
    assert secants.next(second, linear) is secants  # a step was taken back


def test_steps_with_second_derivatives_are_those_of_newton() -> None:
    """Of a separable quadratic function a step leaves the cube of its length."""
    minimum, curvature = np.array([0.5, 0.4, 0.6]), np.array([2.0, 3.0, 4.0])
    distances, errors = np.array([0.08, 0.04, 0.02]), []
    for distance in distances:
        x = minimum + distance * np.array([1.0, -1.0, 0.5])
        slope, earlier = curvature * (x - minimum), curvature * (x + 0.01 - minimum)
        secants = Secants.begin(x + 0.01, earlier[None]).next(x, slope[None])
        state = replace(Asymptotes(np.zeros(3), np.ones(3), x, 1.0), secants=secants)
        after, _ = state.step(slope, np.zeros(0), np.zeros((0, 3)))
        errors.append(np.max(np.abs(after.x - minimum)))
    assert convergence_order(distances, errors) == pytest.approx(3.0, abs=0.1)


def test_what_can_still_be_gained_is_nothing_at_the_optimum() -> None:
    """And at the start at least what a linear program gains, for any multipliers."""

    def gain(x: np.ndarray, multipliers: np.ndarray) -> float:
        values, slopes = cantilever(x)
        state = Asymptotes(np.ones(5), np.full(5, 10.0), x)
        return state.possible_gain(slopes[0], values[1:], slopes[1:], multipliers, 0.1)

    optimum, multipliers = run(cantilever, [5.0] * 5, 1.0, 10.0, 60, move=1.0)
    assert abs(gain(optimum, multipliers)) < 1e-6
    x = np.full(5, 5.5)
    values, slopes = cantilever(x)
    box = [(-0.9, 0.9)] * 5
    program = linprog(slopes[0], slopes[1:], -values[1:], bounds=box)
    for factor in (0.5, 1.0, 2.0):
        assert gain(x, factor * multipliers) >= -program.fun - 1e-12


def test_multipliers_of_several_active_constraints_are_fitted() -> None:
    """Those of a step that ends elsewhere would say that much can be gained at an optimum."""
    state = Asymptotes(np.zeros(3), np.ones(3), np.full(3, 0.5))
    slope, slopes = -np.array([3.0, 2.0, 1.0]), np.eye(3) + 0.1
    exact = np.linalg.solve(slopes.T, -slope)
    assert np.all(exact > 0.0)
    assert state.possible_gain(slope, np.zeros(3), slopes, 0.5 * exact, 0.1) < 1e-12
    # one of them has room: along it the objective falls, by what it leaves free
    room = np.array([0.0, 0.0, -0.01])
    left = state.possible_gain(slope, room, slopes, 0.5 * exact, 0.1)
    assert exact[2] * 0.01 <= left <= 1.5 * exact[2] * 0.01
