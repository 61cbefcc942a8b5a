# SPDX-License-Identifier: MIT
"""Scattered interpolation: reproduction, leave-one-out errors, SciPy, convergence, bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from dolfinx_ffr import ExponentialSpline, Gaussian, Multiquadric, ThinPlate, Wendland
from dolfinx_ffr.design.rbf import Kernel
from dolfinx_ffr.paper.rbf_interpolation import (
    IllConditionedWarning,
    ScatteredInterpolation,
    best_length,
)
from dolfinx_ffr.verification import convergence_order

KERNELS: list[Kernel] = [ExponentialSpline(0.5), Gaussian(0.12), Multiquadric(0.1)]
KERNELS += [ThinPlate(), Wendland(0.6)]
SYSTEMS = [
    pytest.param(kernel, degree, id=f"{kernel!r} {degree}")
    for kernel in KERNELS
    for degree in (-1, 0, 1, 2)
    if kernel.minimal_degree < 1 or degree >= 1
]


def scattered(n: int, seed: int = 0) -> np.ndarray:
    """Points in the rectangle [0, 1] x [0, 0.5] that are not too close, in no order."""
    rng = np.random.default_rng(seed)
    columns = math.ceil(math.sqrt(2 * n))
    rows = math.ceil(n / columns)
    x, y = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows / 2)
    grid = np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(-0.3, 0.3, (x.size, 2)) / columns
    return rng.permutation(grid)[:n]


def smooth(x: np.ndarray) -> np.ndarray:
    return np.sin(4.0 * x[:, 0] + 0.3) * np.exp(x[:, 1])


@pytest.mark.parametrize(("kernel", "degree"), SYSTEMS)
def test_values_are_met_and_polynomials_exact(kernel: Kernel, degree: int) -> None:
    points, queries = scattered(60), scattered(40, seed=5)
    values = np.random.default_rng(1).standard_normal((60, 2))
    interpolation = ScatteredInterpolation(points, kernel, degree=degree)
    interpolated = interpolation(values, points)
    assert np.max(np.abs(interpolated - values)) < min(
        1e-14 * interpolation.condition + 1e-12, 1e-7
    )
    assert interpolation(values[:, 1], points) == pytest.approx(interpolated[:, 1], abs=1e-9)
    for i, j in [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]:
        if i + j <= degree:
            interpolated = interpolation(points[:, 0] ** i * points[:, 1] ** j, queries)
            assert interpolated == pytest.approx(queries[:, 0] ** i * queries[:, 1] ** j, abs=1e-8)


@pytest.mark.parametrize(("kernel", "degree"), SYSTEMS)
def test_leave_one_out_errors_are_those_of_refitting(kernel: Kernel, degree: int) -> None:
    points = scattered(45)
    values = np.random.default_rng(2).standard_normal(45)
    errors = ScatteredInterpolation(points, kernel, degree=degree).leave_one_out(values)
    for i in range(45):
        others_of_points = np.arange(45) != i
        interpolation = ScatteredInterpolation(points[others_of_points], kernel, degree=degree)
        expected = values[i] - interpolation(values[others_of_points], points[i : i + 1])[0]
        assert errors[i] == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_scipy_agrees() -> None:
    names = {"gaussian": Gaussian(0.1), "multiquadric": Multiquadric(0.1)}
    points, queries = scattered(50), scattered(70, seed=3)
    values = np.random.default_rng(4).standard_normal(50)
    for name, kernel in {**names, "thin_plate_spline": ThinPlate()}.items():
        ours = ScatteredInterpolation(points, kernel, degree=1)(values, queries)
        theirs = RBFInterpolator(points, values, kernel=name, epsilon=10.0, degree=1)(queries)
        assert ours == pytest.approx(theirs, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize(
    ("kernel", "order"), [(ExponentialSpline(0.5), 1.4), (Wendland(0.8), 2.4), (ThinPlate(), 1.9)]
)
def test_a_smooth_field_is_met_ever_better(kernel: Kernel, order: float) -> None:
    """Away from the edge: orders of the kernels' native spaces, or better."""
    queries = np.random.default_rng(6).uniform([0.2, 0.15], [0.8, 0.35], (300, 2))
    counts = [50, 200, 800]
    errors = []
    for n in counts:
        points = scattered(n)
        interpolated = ScatteredInterpolation(points, kernel, degree=1)(smooth(points), queries)
        errors.append(math.sqrt(np.mean((interpolated - smooth(queries)) ** 2)))
    assert convergence_order([n**-0.5 for n in counts], errors) > order
    assert errors[-1] < 2e-3


@pytest.mark.parametrize("degree", [-1, 1])
@pytest.mark.parametrize("kernel", [Gaussian(3.0), Multiquadric(5.0)], ids=repr)
def test_ill_conditioning_is_said_and_survived(kernel: Kernel, degree: int) -> None:
    points, queries = scattered(200), scattered(80, seed=8)
    with pytest.warns(IllConditionedWarning, match=f"{type(kernel).__name__}.*shorten"):
        interpolation = ScatteredInterpolation(points, kernel, degree=degree)
        interpolated = interpolation(smooth(points), queries)
    assert interpolation.condition > 1e13
    assert interpolated == pytest.approx(smooth(queries), abs=0.05)


def test_best_length_is_where_the_leave_one_out_error_is_smallest() -> None:
    points = scattered(80)
    values = np.sin(9.0 * points[:, 0]) + np.random.default_rng(3).standard_normal(80) * 0.01

    def size(length: float) -> float:
        interpolation = ScatteredInterpolation(points, Gaussian(length))
        return float(np.sqrt(np.mean(interpolation.leave_one_out(values) ** 2)))

    best = best_length(Gaussian, points, values, bounds=(0.04, 0.25))
    assert size(best) <= 1.001 * min(size(length) for length in np.geomspace(0.04, 0.25, 25))


@pytest.mark.parametrize(
    ("points", "kernel", "options", "message"),
    [
        (np.zeros((4, 3)), Gaussian(1.0), {}, r"points must have shape \(n, 2\)"),
        (np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]]), Gaussian(1.0), {}, "coincide"),
        (scattered(9), ThinPlate(), {"degree": 0}, "needs a polynomial of degree 1"),
        (scattered(9), Wendland(0.01), {}, "does not reach from point to point"),
        (scattered(9) * [1.0, 0.0], Gaussian(0.1), {"degree": 1}, "lie on a line"),
        (np.arange(60000.0).reshape(-1, 2), Gaussian(0.1), {}, "make a dense matrix of"),
    ],
)
def test_bad_points_are_refused(
    points: np.ndarray, kernel: Kernel, options: dict[str, int], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        ScatteredInterpolation(points, kernel, **options)


def test_bad_values_and_queries_are_refused() -> None:
    points = scattered(9)
    interpolation = ScatteredInterpolation(points, Gaussian(0.1))
    for call in (interpolation.leave_one_out, lambda values: interpolation(values, points)):
        with pytest.raises(ValueError, match="must have 9 values, one a point"):
            call(np.ones(8))
        with pytest.raises(ValueError, match="values holds NaN or infinity"):
            call(np.full(9, np.nan))
    for queries in ([0.0, 0.0], [[0.0, math.inf]]):
        with pytest.raises(ValueError, match="queries"):
            interpolation(np.ones(9), queries)
    assert interpolation(np.ones(9), np.zeros((0, 2))).shape == (0,)
    with pytest.raises(ValueError, match="can be left out"):
        ScatteredInterpolation(scattered(3), ThinPlate()).leave_one_out(np.ones(3))
    with pytest.raises(ValueError, match="ill-conditioned at every length"):
        best_length(Gaussian, scattered(80), np.ones(80), bounds=(50.0, 100.0))
